//! What a run shows while it goes on: a bar per node on a terminal, a line now and then elsewhere.

use std::collections::BTreeMap;
use std::io::{IsTerminal, Write};
use std::time::Duration;

use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle};
use proto::ids::NodeId;
use tokio::time::Instant;

use crate::observe::Observer;
use crate::scenario::Scenario;
use crate::score::score;

/// Off a terminal, a line this often.
const LINE_INTERVAL: Duration = Duration::from_secs(5);

/// Shows progress on standard error.
pub(crate) struct Progress {
    bars: MultiProgress,
    nodes: BTreeMap<NodeId, ProgressBar>,
    is_terminal: bool,
    next_line: Instant,
}

impl Progress {
    pub(crate) fn new(scenario: &Scenario) -> Self {
        let is_terminal = std::io::stderr().is_terminal();
        let bars = MultiProgress::with_draw_target(ProgressDrawTarget::stderr());
        let template = "{prefix:>8} {bar:24} {pos:>5}/{len} periods  {msg}";
        let style = ProgressStyle::with_template(template);
        let style = style.unwrap_or_else(|_| ProgressStyle::default_bar());
        let bar = |id: &NodeId| {
            let bar = scenario.period_count.map_or_else(ProgressBar::no_length, ProgressBar::new);
            bars.add(bar.with_style(style.clone()).with_prefix(id.to_string()))
        };
        let nodes = scenario.nodes.iter().map(|node| (node.id.clone(), bar(&node.id))).collect();
        Self { bars, nodes, is_terminal, next_line: Instant::now() + LINE_INTERVAL }
    }

    pub(crate) fn show(&mut self, scenario: &Scenario, observer: &Observer) {
        let mut line = Vec::new();
        for node in &scenario.nodes {
            let Some(seen) = observer.nodes.get(&node.id) else { continue };
            let score = score(scenario, node, seen);
            let message = match (score.position_error_m, score.angle_error_deg) {
                _ if score.is_reference => "reference".to_owned(),
                (Some(position_m), Some(angle_deg)) => {
                    format!("off by {position_m:.3} m, {angle_deg:+.2}°")
                }
                _ => score.missing.unwrap_or(score.outcome),
            };
            line.push(format!("{} {} periods, {message}", node.id, score.sets_received));
            if let Some(bar) = self.nodes.get(&node.id) {
                bar.set_position(score.sets_received);
                bar.set_message(message);
            }
        }
        if !self.is_terminal && self.next_line <= Instant::now() {
            self.next_line += LINE_INTERVAL;
            self.say(&line.join("; "));
        }
    }

    /// A line above the bars.
    pub(crate) fn say(&self, text: &str) {
        if self.is_terminal {
            // A closed standard error is no reason to stop the run.
            drop(self.bars.println(text));
        } else {
            drop(writeln!(std::io::stderr(), "{text}"));
        }
    }

    pub(crate) fn finish(&self) {
        self.nodes.values().for_each(ProgressBar::abandon);
    }
}
