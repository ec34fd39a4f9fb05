//! Periods from point sets that come late, twice, never, and by clocks of their own.
//!
//! Every set is placed by the time of its measurement, brought to the centre's clock, on a grid of
//! periods whose phase follows the reference node's sets. What is kept is bounded by the
//! configuration: a window of periods for each of a limited number of nodes. Every set is either
//! kept or counted with a reason. Of what is older than the window a bounded number of periods stays
//! in reserve, chosen so that places once seen stay known ([`Place`]).

mod grid;
mod history;
mod reserve;

use std::collections::BTreeMap;
use std::time::Duration;

use proto::ids::{BootId, NodeId};
use proto::time::{CentreTime, ClockEstimate};
use proto::wire::{PointSet, Received};

pub use history::{KeptPoint, KeptSet, Life, NodeHistory};
pub use reserve::Place;

use crate::config::GatherConfig;
use grid::{Grid, Placed, Speaker};
use reserve::Reserve;

/// How far ahead of its arrival a set may say it was measured: clocks of a site part by
/// milliseconds, so this much is a broken clock, and believing it would let one node move the
/// window of all.
const FUTURE_LIMIT: Duration = Duration::from_secs(1);

/// What became of a set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Offer {
    /// Kept, in this period.
    Kept(i64),
    /// Kept aside until the node's clock is known.
    AwaitsClock,
    /// Came before, or its period already has a set of this node.
    Duplicate,
    /// Older than the window.
    Late,
    /// Measured after it arrived: the node's clock is wrong.
    FromTheFuture,
    /// From a life of the agent that another has followed: two agents may share one name.
    FormerLife,
    /// There are as many nodes as there may be.
    TooManyNodes,
}

impl Offer {
    /// A short label, for counting.
    #[must_use]
    pub fn label(self) -> &'static str {
        match self {
            Self::Kept(_) => "kept",
            Self::AwaitsClock => "awaits_clock",
            Self::Duplicate => "duplicate",
            Self::Late => "late",
            Self::FromTheFuture => "from_the_future",
            Self::FormerLife => "former_life",
            Self::TooManyNodes => "too_many_nodes",
        }
    }

    /// Why a set was not kept, and what to do about it.
    #[must_use]
    pub fn reason(self) -> &'static str {
        match self {
            Self::Kept(_) | Self::AwaitsClock => "it is used",
            Self::Duplicate => "it came before, or its period has a set of this node",
            Self::Late => "it is older than gather.window_count periods",
            Self::FromTheFuture => "measured after it arrived: the node's clock is wrong",
            Self::FormerLife => "another agent has followed: are there two of this name?",
            Self::TooManyNodes => "gather.max_node_count nodes are known: raise it, or restart",
        }
    }
}

/// The sets of all nodes, by period.
#[derive(Debug)]
pub struct Gather {
    config: GatherConfig,
    reference: NodeId,
    centre_boot: BootId,
    grid: Grid,
    nodes: BTreeMap<NodeId, NodeHistory>,
    reserve: Reserve,
    closed_through: Option<i64>,
}

impl Gather {
    /// Nothing gathered yet. `centre_boot` names the clock that estimates must speak of.
    #[must_use]
    pub fn new(config: GatherConfig, reference: NodeId, centre_boot: BootId) -> Self {
        let grid = Grid::new(Duration::from_secs_f64(config.period_s));
        Self {
            config,
            reference,
            centre_boot,
            grid,
            nodes: BTreeMap::new(),
            reserve: Reserve::new(config.reserve_count),
            closed_through: None,
        }
    }

    /// Every node ever heard.
    pub fn nodes(&self) -> impl Iterator<Item = (&NodeId, &NodeHistory)> {
        self.nodes.iter()
    }

    /// Every node's set of one period.
    pub fn sets_in(&self, period: i64) -> impl Iterator<Item = (&NodeId, &KeptSet)> {
        self.nodes
            .iter()
            .filter_map(move |(node, history)| Some((node, history.sets().get(&period)?)))
    }

    /// One node's history.
    #[must_use]
    pub fn node(&self, node: &NodeId) -> Option<&NodeHistory> {
        self.nodes.get(node)
    }

    /// One node's history, to count in.
    pub fn node_mut(&mut self, node: &NodeId) -> Option<&mut NodeHistory> {
        self.nodes.get_mut(node)
    }

    /// Takes a set in. Returns what became of it and, where it made the node's clock known, the
    /// periods of the sets that had waited for that.
    pub fn offer(&mut self, now: CentreTime, set: Received<PointSet>) -> (Offer, Vec<i64>) {
        let node = set.body.node.clone();
        let known = self.nodes.contains_key(&node);
        // The reference node always finds a place.
        let is_reference = node == self.reference;
        if !known && !is_reference && self.config.max_node_count <= self.nodes.len() {
            return (Offer::TooManyNodes, Vec::new());
        }
        let window_count = self.config.window_count;
        let history =
            self.nodes.entry(node.clone()).or_insert_with(|| NodeHistory::new(window_count));
        let life = history.hear(now, set.stamp.boot);
        if life == Life::Former {
            history.late_count += 1;
            return (Offer::FormerLife, Vec::new());
        }
        if !history.count_arrival(set.stamp.sequence) {
            return (Offer::Duplicate, Vec::new());
        }
        let clock = set.body.clock;
        let released = clock.map_or_else(Vec::new, |clock| self.learn_clock(&node, clock));
        (self.place(&node, now, set), released)
    }

    /// Takes a node's clock estimate in, and places the sets that waited for one.
    pub fn learn_clock(&mut self, node: &NodeId, clock: ClockEstimate) -> Vec<i64> {
        if clock.centre_boot != self.centre_boot {
            return Vec::new();
        }
        let Some(history) = self.nodes.get_mut(node) else { return Vec::new() };
        history.clock = Some(clock);
        let waiting = std::mem::take(&mut history.awaiting_clock);
        let mut periods = Vec::new();
        for (arrival, set) in waiting {
            if let Offer::Kept(period) = self.place(node, arrival, set) {
                periods.push(period);
            }
        }
        periods
    }

    fn place(&mut self, node: &NodeId, arrival: CentreTime, set: Received<PointSet>) -> Offer {
        let is_reference = *node == self.reference;
        let speaker = if is_reference { Speaker::Reference } else { Speaker::Other };
        let Some(history) = self.nodes.get_mut(node) else { return Offer::TooManyNodes };
        let Some(clock) = history.clock else {
            history.wait_for_clock(arrival, set);
            return Offer::AwaitsClock;
        };
        let time = set.body.time.to_centre(&clock);
        if FUTURE_LIMIT < time.since(arrival) {
            history.late_count += 1;
            return Offer::FromTheFuture;
        }
        if self.grid.place(time, speaker) == Placed::PhaseChanged {
            self.nodes.values_mut().for_each(|other| other.place_anew(&self.grid));
        }
        let period = self.grid.period(time);
        let kept = KeptSet::new(time, arrival, &set);
        let offer =
            self.nodes.get_mut(node).map_or(Offer::TooManyNodes, |one| one.keep(period, kept));
        self.reserve.thin(&mut self.nodes);
        offer
    }

    /// Notes where a period's points lie, which decides whether it is worth keeping beyond the
    /// window.
    pub fn note_places(&mut self, period: i64, places: Vec<Place>) {
        self.reserve.note(period, places);
    }

    /// The period that an instant belongs to.
    #[must_use]
    pub fn period_at(&self, time: CentreTime) -> i64 {
        self.grid.period(time)
    }

    /// Whether the node's clock is known well enough to register with its sets.
    #[must_use]
    pub fn is_clock_good(&self, history: &NodeHistory) -> bool {
        let max_error_ns = Duration::from_secs_f64(self.config.max_clock_error_s).as_nanos();
        history.clock.is_some_and(|clock| u128::from(clock.error_ns) <= max_error_ns)
    }

    /// Whether [`Self::close_next`] has passed this period.
    #[must_use]
    pub fn is_closed(&self, period: i64) -> bool {
        self.closed_through.is_some_and(|closed| period <= closed)
    }

    /// Whether the node was heard within the limit.
    #[must_use]
    pub fn is_heard(&self, now: CentreTime, history: &NodeHistory) -> bool {
        now.since(history.last_heard) <= Duration::from_secs_f64(self.config.silent_after_s)
    }

    /// The next period that is complete, or has waited long enough: each is returned once.
    pub fn close_next(&mut self, now: CentreTime) -> Option<i64> {
        let closed = self.closed_through.unwrap_or(i64::MIN);
        let after = |history: &NodeHistory| history.first_period_after(closed);
        let next = self.nodes.values().filter_map(after).min()?;
        if !(self.is_complete(now, next) || self.has_waited(now, next)) {
            return None;
        }
        self.closed_through = Some(next);
        Some(next)
    }

    fn is_complete(&self, now: CentreTime, period: i64) -> bool {
        let mut awaited = self
            .nodes
            .values()
            .filter(|history| self.is_heard(now, history) && history.clock.is_some());
        awaited.all(|history| history.newest_period().is_some_and(|newest| period <= newest))
    }

    fn has_waited(&self, now: CentreTime, period: i64) -> bool {
        let waited = now.since(self.grid.middle(period));
        Duration::from_secs_f64(0.5 * self.config.period_s + self.config.max_wait_s) <= waited
    }

    /// The middle of a period.
    #[must_use]
    pub fn middle(&self, period: i64) -> CentreTime {
        self.grid.middle(period)
    }

    /// Forgets the sets of a node (and of nobody else), so that registration starts anew.
    pub fn forget(&mut self, node: &NodeId) {
        if let Some(history) = self.nodes.get_mut(node) {
            history.forget_sets();
        }
        self.reserve.forget(node);
    }

    /// Forgets the sets of a node from before period `first`.
    pub fn forget_before(&mut self, node: &NodeId, first: i64) {
        if let Some(history) = self.nodes.get_mut(node) {
            history.forget_before(first);
        }
        self.reserve.forget_before(node, first);
    }
}

#[cfg(test)]
mod tests;
