//! What the experiments leave: tables, one JSON document, pictures.

use std::path::Path;

use comfy_table::presets::UTF8_HORIZONTAL_ONLY;
use comfy_table::{CellAlignment, Table};
use serde::Serialize;

use super::super::Results;
use super::super::sheet::{Bar, document, draw, write};
use super::super::statistics::Figure;
use super::entrants::Entrant;
use super::load::{LoadResult, ScanTimes, Spread};
use super::picture::{Comparison, WaysPage};
use super::summary::{Duel, EntrantResult, Figures};
use super::{ConditionResult, Scenario};
use crate::metrics::Settings;

/// How often the paper's method must put together more rightly than its rivals: its figure 8.
const ORDER_SHARE: f64 = 0.9;

/// Everything the experiments have shown.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Report {
    pub(super) scenario: Scenario,
    pub(super) seed: u64,
    pub(super) trial_count: usize,
    /// What is scored at once.
    pub(super) settings: Settings,
    pub(super) conditions: Vec<ConditionResult>,
    pub(super) loads: Vec<LoadResult>,
    /// How long all of it took, seconds. Differs from run to run.
    pub(super) elapsed_s: f64,
}

impl Results for Report {
    fn table(&self) -> String {
        let Self { trial_count, seed, elapsed_s, .. } = self;
        let mut text =
            format!("wide-area experiments, {trial_count} trials, seed {seed}, {elapsed_s:.1} s\n");
        if !self.conditions.is_empty() {
            text += &format!("{}\n{}\n", self.figures_table(), self.duels_table());
        }
        if !self.loads.is_empty() {
            text += &format!("{}\n", self.loads_table());
        }
        text + &self.notes()
    }

    fn json(&self) -> anyhow::Result<String> {
        document(self, self.bars())
    }

    fn write(&self, folder: &Path) -> anyhow::Result<()> {
        write(folder, "montecarlo.json", self.json()?.as_bytes())?;
        if self.conditions.is_empty() {
            return Ok(());
        }
        draw(&WaysPage::of(self), folder, "ways")?;
        if self.scenario == Scenario::FourTargets {
            draw(&Comparison::of(self), folder, "comparison")?;
        }
        Ok(())
    }
}

impl Report {
    /// What is asked of this experiment; nothing of trackers that did not take part.
    pub(super) fn bars(&self) -> Vec<Bar> {
        let mut bars: Vec<Bar> = self.conditions.iter().flat_map(|one| self.bars_of(one)).collect();
        bars.extend(self.loads.iter().filter_map(load_bar));
        bars
    }

    fn bars_of(&self, result: &ConditionResult) -> Vec<Bar> {
        let mut bars = Vec::new();
        if self.scenario == Scenario::FourTargets {
            bars.extend(result.duels.iter().filter_map(|duel| order_bar(&result.label, duel)));
        }
        let default = result.entrants.iter().find(|one| one.mode == Entrant::Default);
        bars.extend(default.and_then(|ours| self.default_bar(result, &ours.figures)));
        bars
    }

    fn default_bar(&self, result: &ConditionResult, figures: &Figures) -> Option<Bar> {
        let least = |what, got: Option<Figure>, least: f64| Bound { what, got, least, most: 1.0 };
        let most = |what, got: Option<Figure>, most: f64| Bound { what, got, least: 0.0, most };
        let Figures { right_links, identity, rmse_m, filtered_rmse_m, nees_per_dimension, .. } =
            *figures;
        let is_rotated = result.label.contains("rotated");
        let bounds = match (self.scenario, result.variance_m2, is_rotated) {
            (Scenario::ThreeTargets, None, _) => vec![
                most("RMSE not smoothed, m", filtered_rmse_m, 4.7),
                Bound { what: "NEES", got: nees_per_dimension, least: 0.9, most: 1.15 },
            ],
            (Scenario::FourTargets, Some(400), false) => vec![
                least("right links", right_links, 0.965),
                least("identity", identity, 0.955),
                most("RMSE, m", rmse_m, 16.0),
            ],
            (Scenario::FourTargets, Some(900), false) => {
                vec![least("right links", right_links, 0.9), least("identity", identity, 0.89)]
            }
            (Scenario::FourTargets, Some(400), true) => {
                vec![least("identity", identity, 0.94), most("RMSE, m", rmse_m, 14.0)]
            }
            _ => return None,
        };
        Some(bar(&format!("default, {}", result.label), &bounds))
    }

    fn figures_table(&self) -> Table {
        let header = [
            "condition",
            "mode",
            "right links % (95 %)",
            "identity % (95 %)",
            "RMSE m (95 %)",
            "not smoothed",
            "NEES per dim.",
            "GOSPA m",
            "missed %",
            "false per look",
            "tracks",
            "switches",
            "us per look",
        ];
        let rows = self.conditions.iter().flat_map(|result| {
            let labels =
                std::iter::once(result.label.clone()).chain(std::iter::repeat(String::new()));
            labels.zip(&result.entrants).map(|(label, one)| row(label, one))
        });
        table(&header, rows)
    }

    fn duels_table(&self) -> Table {
        let header = [
            "condition",
            "trial by trial",
            "right links: win/tie/loss",
            "mean square error: win/tie/loss",
        ];
        let rows = self.conditions.iter().flat_map(|result| {
            let labels =
                std::iter::once(result.label.clone()).chain(std::iter::repeat(String::new()));
            labels.zip(&result.duels).map(|(label, duel)| {
                let who = format!("{} : {}", duel.one.name(), duel.other.name());
                vec![label, who, duel.right_links.text(), duel.mean_square.text()]
            })
        });
        table(&header, rows)
    }

    fn loads_table(&self) -> Table {
        let header = [
            "targets",
            "mode",
            "plots per scan",
            "ms per scan",
            "median",
            "longest",
            "smoothing ms",
            "right links %",
            "identity %",
            "purity %",
            "tracks",
            "more MiB",
        ];
        let percent = |share: Option<f64>| {
            share.map_or_else(String::new, |share| format!("{:.2}", 100.0 * share))
        };
        let rows = self.loads.iter().map(|one| {
            let ScanTimes { mean, median, longest } = one.scan_ms;
            vec![
                format!("{} {}", one.target_count, one.spread.name()),
                one.mode.name().to_owned(),
                format!("{:.0}", one.plot_count),
                format!("{mean:.3}"),
                format!("{median:.3}"),
                format!("{longest:.3}"),
                format!("{:.3}", one.smoothing_ms),
                percent(one.right_links),
                percent(one.identity),
                percent(one.purity),
                format!("{:.0}", one.track_count),
                format!("{:.1}", one.memory_mib),
            ]
        });
        table(&header, rows)
    }

    fn notes(&self) -> String {
        let Settings { gate_m, allowance_s, gospa_cutoff_m, .. } = self.settings;
        let mut notes = format!(
            "right links: consecutive plots of a track (of the published methods: every plot and the one \
             that it is joined to) that are of the same target; identity: plots of the target that \
             most of the track's first three were of; RMSE: against that target; NEES: 1 if \
             covariances are true. At once: missed: nobody within {gate_m} m, from \
             {allowance_s} s on; GOSPA: p 2, alpha 2, c {gospa_cutoff_m} m\n"
        );
        if !self.loads.is_empty() {
            notes += "times are of the processor, on one thread, for the present alone (nothing of the past is kept or smoothed), without the first five scans; more MiB: \
                      than before the load, without what earlier loads had used already\n";
        }
        notes + &self.bars().iter().map(Bar::line).collect::<String>()
    }
}

/// A figure and between what it must be.
struct Bound {
    what: &'static str,
    got: Option<Figure>,
    least: f64,
    most: f64,
}

fn bar(label: &str, bounds: &[Bound]) -> Bar {
    let value = |bound: &Bound| bound.got.map_or(f64::NAN, |figure| figure.value);
    let part = |bound: &Bound| {
        let Bound { what, least, most, .. } = bound;
        format!("{what} {:.4}, {least} to {most}", value(bound))
    };
    let parts: Vec<String> = bounds.iter().map(part).collect();
    let is_met = bounds.iter().all(|bound| (bound.least..=bound.most).contains(&value(bound)));
    Bar { text: format!("{label}: {}", parts.join("; ")), is_met }
}

/// The paper's method against one of its rivals.
fn order_bar(label: &str, duel: &Duel) -> Option<Bar> {
    let is_asked = duel.one == Entrant::Paper && duel.other != Entrant::Default;
    let share = duel.right_links.win_share();
    is_asked.then(|| Bar {
        text: format!(
            "paper above {} in right links, {label}: {share:.3} of the runs, at least {ORDER_SHARE}",
            duel.other.name()
        ),
        is_met: ORDER_SHARE <= share,
    })
}

fn load_bar(result: &LoadResult) -> Option<Bar> {
    let (most_ms, least_links) = match (result.mode, result.spread, result.target_count) {
        (Entrant::Default, Spread::Uniform, 1000) => (0.5, Some(0.999)),
        (Entrant::Default, Spread::Uniform, 5000) => (4.0, None),
        (Entrant::Default, Spread::Uniform, 20_000) => (30.0, None),
        (Entrant::Default, Spread::Roads, 1000) => (f64::INFINITY, Some(0.93)),
        _ => return None,
    };
    let (took_ms, links) = (result.scan_ms.mean, result.right_links.unwrap_or(0.0));
    let mut text = format!("{} {}", result.target_count, result.spread.name());
    if most_ms.is_finite() {
        text += &format!(": {took_ms:.3} ms per scan, at most {most_ms}");
    }
    if let Some(least) = least_links {
        text += &format!(": right links {links:.4}, at least {least}");
    }
    let is_right = least_links.is_none_or(|least| least <= links);
    Some(Bar { text, is_met: took_ms <= most_ms && is_right })
}

fn table(header: &[&str], rows: impl Iterator<Item = Vec<String>>) -> Table {
    let mut table = Table::new();
    table.load_style(UTF8_HORIZONTAL_ONLY).set_header(header.iter().copied());
    table.add_rows(rows);
    for column in 2..header.len() {
        if let Some(column) = table.column_mut(column) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    table
}

fn row(label: String, one: &EntrantResult) -> Vec<String> {
    let figures = &one.figures;
    let text = |figure: Option<Figure>, scale: f64, digits: usize| {
        figure.map_or_else(String::new, |known| {
            let interval = known.interval.map(|ends| ends.map(|end| scale * end));
            Figure { value: scale * known.value, interval }.text(digits)
        })
    };
    let value = |figure: Option<Figure>, scale: f64, digits: usize| {
        figure.map_or_else(String::new, |known| format!("{:.digits$}", scale * known.value))
    };
    vec![
        label,
        one.mode.name().to_owned(),
        text(figures.right_links, 100.0, 2),
        text(figures.identity, 100.0, 1),
        text(figures.rmse_m, 1.0, 1),
        value(figures.filtered_rmse_m, 1.0, 2),
        value(figures.nees_per_dimension, 1.0, 2),
        value(figures.gospa_m, 1.0, 1),
        value(figures.missed_share, 100.0, 2),
        value(figures.false_per_look, 1.0, 3),
        value(figures.tracks_per_run, 1.0, 2),
        value(figures.switches_per_run, 1.0, 2),
        one.look_us.map_or_else(String::new, |us| format!("{us:.0}")),
    ]
}
