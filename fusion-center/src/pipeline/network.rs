//! When the solutions of pairs are combined into the poses of all nodes.
//!
//! Combining runs beside the event loop as solving does, one at a time; where it takes long, it
//! pauses so that it takes no more than a tenth of one core.

use std::collections::BTreeSet;
use std::time::Duration;

use proto::ids::NodeId;
use proto::time::CentreTime;

use crate::gather::{Gather, NodeHistory};
use crate::network::{Edge, Group, NodeView, SeenSet, SiteProblem, combine, refined};
use crate::registration::Outcome;

/// Combining pauses this many times as long as it took.
const PAUSE_FACTOR: u32 = 9;

/// Solutions of pairs, ready to be combined.
#[derive(Clone, Debug)]
pub struct Combination {
    /// The node whose frame is `Ref`.
    pub reference: NodeId,
    /// Every node.
    pub nodes: Vec<NodeId>,
    /// The solutions in force.
    pub edges: Vec<Edge>,
    /// What all nodes saw, to refine the poses from; `None` where a pinned pose must stay.
    pub problem: Option<SiteProblem>,
    pub(super) generation: u64,
}

impl Combination {
    /// The poses of all nodes.
    #[must_use]
    pub fn groups(&self) -> Vec<Group> {
        let groups = combine(&self.reference, &self.nodes, &self.edges);
        match &self.problem {
            Some(problem) => refined(problem, groups),
            None => groups,
        }
    }
}

/// The edges with pins in the place of what was solved. A pin is the operator's word and no vote:
/// of a pinned node's pairs only those count through which a node comes in that nothing else joins
/// to the reference. Were the pin wrong, its pairs would contradict those of nodes rightly placed.
pub(super) fn with_pins(reference: &NodeId, edges: Vec<Edge>, pins: Vec<Edge>) -> Vec<Edge> {
    let pinned: BTreeSet<&NodeId> = pins.iter().map(|pin| &pin.second).collect();
    let reached = reached(reference, &edges, &pinned);
    let is_placed = |node: &NodeId| pinned.contains(node) || reached.contains(node);
    let is_used = |edge: &Edge| {
        let ends = [&edge.first, &edge.second];
        !(ends.iter().any(|node| pinned.contains(*node)) && ends.iter().all(|node| is_placed(node)))
    };
    let mut used: Vec<Edge> = edges.iter().filter(|edge| is_used(edge)).cloned().collect();
    used.extend(pins);
    used
}

/// The nodes that determined edges without pinned nodes join to the reference.
fn reached(reference: &NodeId, edges: &[Edge], pinned: &BTreeSet<&NodeId>) -> BTreeSet<NodeId> {
    let mut reached = BTreeSet::from([reference.clone()]);
    loop {
        let steps = edges
            .iter()
            .filter(|edge| edge.solution.outcome == Outcome::Determined)
            .flat_map(|edge| [(&edge.first, &edge.second), (&edge.second, &edge.first)]);
        let is_new = |(from, to): &(&NodeId, &NodeId)| {
            reached.contains(*from) && !reached.contains(*to) && !pinned.contains(*to)
        };
        let new: Vec<NodeId> = steps.filter(is_new).map(|(_, to)| to.clone()).collect();
        if new.is_empty() {
            return reached;
        }
        reached.extend(new);
    }
}

/// What all nodes saw whose clocks are good.
pub(super) fn site_problem(gather: &Gather, reference: &NodeId) -> SiteProblem {
    let good = gather.nodes().filter(|(_, history)| gather.is_clock_good(history));
    let views = good.map(|(node, history)| (node.clone(), view(history))).collect();
    SiteProblem { reference: reference.clone(), views }
}

fn view(history: &NodeHistory) -> NodeView {
    let mut view = NodeView::default();
    for (period, set) in history.all_sets() {
        view.half_depth_sigma_m = view.half_depth_sigma_m.max(set.half_depth_sigma_m);
        let points = set.points.iter().map(|point| point.position).collect();
        view.sets.insert(period, SeenSet { time_s: set.time.0 as f64 * 1e-9, points });
    }
    view
}

/// A combined [`Combination`].
#[derive(Clone, Debug)]
pub struct Combined {
    /// What was combined.
    pub combination: Combination,
    /// The poses.
    pub groups: Vec<Group>,
    /// How long it took.
    pub time: Duration,
}

/// What is under way and what is to be done.
#[derive(Debug)]
pub(super) struct Network {
    /// The solutions in force are others than those last combined.
    pub(super) is_stale: bool,
    in_flight: bool,
    /// A combination ended just now.
    has_news: bool,
    /// Counts the wishes to start over: combinations of earlier solutions are not believed.
    generation: u64,
    rests_until: CentreTime,
}

impl Network {
    pub(super) fn new() -> Self {
        let rests_until = CentreTime(0);
        Self { is_stale: false, in_flight: false, has_news: false, generation: 0, rests_until }
    }

    /// Whether a combination may start now.
    pub(super) fn is_due(&self, now: CentreTime) -> bool {
        self.is_stale && !self.in_flight && self.rests_until <= now
    }

    /// Whether what the poses say holds for now: nothing is being combined, and nothing waits for
    /// it that came since the last time was told of.
    pub(super) fn is_quiet(&mut self) -> bool {
        !self.in_flight && (std::mem::take(&mut self.has_news) || !self.is_stale)
    }

    /// Notes that a combination starts; returns its generation.
    pub(super) fn start(&mut self) -> u64 {
        (self.is_stale, self.in_flight) = (false, true);
        self.generation
    }

    /// Notes that it ended. True if it is to be believed.
    pub(super) fn end(&mut self, now: CentreTime, combined: &Combined) -> bool {
        (self.in_flight, self.has_news) = (false, true);
        let pause = combined.time.saturating_mul(PAUSE_FACTOR);
        let pause_ns = i64::try_from(pause.as_nanos()).unwrap_or(i64::MAX);
        self.rests_until = CentreTime(now.0.saturating_add(pause_ns));
        combined.combination.generation == self.generation
    }

    /// It broke: it may be tried again when something changes.
    pub(super) fn give_up(&mut self) {
        self.in_flight = false;
    }

    /// What is being combined is not believed any longer.
    pub(super) fn start_over(&mut self) {
        self.generation += 1;
        self.is_stale = true;
    }
}

#[cfg(test)]
mod tests;
