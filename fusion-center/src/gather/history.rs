//! What the centre keeps of one node: its sets by period, its life, its clock, its counts.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet, VecDeque};

use proto::geom::{Gaussian, Node};
use proto::ids::BootId;
use proto::measured::line_of_sight;
use proto::time::{CentreTime, ClockEstimate};
use proto::wire::{PointSet, Received};

use super::Offer;
use super::grid::Grid;

/// Lives of an agent that are remembered, so that a second agent of the same name is noticed.
const FORMER_LIFE_COUNT: usize = 8;
/// Sequence numbers remembered beyond the window, so that what comes again is recognised.
const SEQUENCE_MEMORY: usize = 4096;

/// Whose life a message belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Life {
    /// The agent that is running.
    Current,
    /// An agent that started just now.
    New,
    /// An agent that another has followed.
    Former,
}

/// One point and how strong it was.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeptPoint {
    /// The middle of the target in the node's frame, without the error of the half depth.
    pub position: Gaussian<Node>,
    /// Power over noise, decibels of power.
    pub snr_db: f64,
}

impl KeptPoint {
    /// The position with the error of the half depth.
    #[must_use]
    pub fn with_half_depth_error(&self, half_depth_sigma_m: f64) -> Gaussian<Node> {
        let outward = line_of_sight(&self.position.mean.coords_m);
        let variance_m2 = outward * outward.transpose() * half_depth_sigma_m.powi(2);
        Gaussian { mean: self.position.mean, cov_m2: self.position.cov_m2 + variance_m2 }
    }
}

/// A set as it is kept.
#[derive(Clone, Debug, PartialEq)]
pub struct KeptSet {
    /// The agent's life.
    pub boot: BootId,
    /// The agent's count.
    pub sequence: u64,
    /// Middle of the measurement.
    pub time: CentreTime,
    /// When it came.
    pub arrival: CentreTime,
    /// The targets' middles.
    pub points: Vec<KeptPoint>,
    /// Standard deviation of the targets' half depth, metres.
    pub half_depth_sigma_m: f64,
}

impl KeptSet {
    /// What is kept of `set`, measured at `time`.
    #[must_use]
    pub fn new(time: CentreTime, arrival: CentreTime, set: &Received<PointSet>) -> Self {
        let PointSet { half_depth_m, half_depth_sigma_m, points, .. } = &set.body;
        let points = points.iter().map(|point| KeptPoint {
            position: point.middle(*half_depth_m, 0.0),
            snr_db: point.snr_db,
        });
        let (boot, sequence) = (set.stamp.boot, set.stamp.sequence);
        let (points, half_depth_sigma_m) = (points.collect(), *half_depth_sigma_m);
        Self { boot, sequence, time, arrival, points, half_depth_sigma_m }
    }
}

/// What the centre keeps of one node.
#[derive(Debug)]
pub struct NodeHistory {
    window_count: usize,
    /// When anything was last heard of it.
    pub last_heard: CentreTime,
    /// Its current life.
    pub boot: BootId,
    former: VecDeque<BootId>,
    /// What it knows of the centre's clock.
    pub clock: Option<ClockEstimate>,
    pub(super) awaiting_clock: VecDeque<(CentreTime, Received<PointSet>)>,
    sets: BTreeMap<i64, KeptSet>,
    /// Sets older than the window, of periods that are worth keeping.
    reserve: BTreeMap<i64, KeptSet>,
    seen: BTreeSet<u64>,
    first_sequence: Option<u64>,
    /// The sequence number that should come next.
    pub next_sequence: u64,
    /// Sets that came, each counted once.
    pub received_count: u64,
    /// Sets that came twice or fell into a period that had one.
    pub duplicate_count: u64,
    /// Sets that came too late, or from a former life.
    pub late_count: u64,
    /// Messages refused.
    pub refused_count: u64,
}

impl NodeHistory {
    pub(super) fn new(window_count: usize) -> Self {
        Self {
            window_count,
            last_heard: CentreTime(0),
            boot: BootId(0),
            former: VecDeque::new(),
            clock: None,
            awaiting_clock: VecDeque::new(),
            sets: BTreeMap::new(),
            reserve: BTreeMap::new(),
            seen: BTreeSet::new(),
            first_sequence: None,
            next_sequence: 0,
            received_count: 0,
            duplicate_count: 0,
            late_count: 0,
            refused_count: 0,
        }
    }

    /// The sets of the window, by period.
    #[must_use]
    pub fn sets(&self) -> &BTreeMap<i64, KeptSet> {
        &self.sets
    }

    /// The sets kept from before the window, by period.
    #[must_use]
    pub fn reserve(&self) -> &BTreeMap<i64, KeptSet> {
        &self.reserve
    }

    /// All sets kept, oldest first.
    pub fn all_sets(&self) -> impl Iterator<Item = (i64, &KeptSet)> {
        let reserved = self.reserve.iter().filter(|(period, _)| !self.sets.contains_key(period));
        reserved.chain(&self.sets).map(|(period, set)| (*period, set))
    }

    /// The set of one period, if it is kept.
    #[must_use]
    pub fn set_in(&self, period: i64) -> Option<&KeptSet> {
        self.sets.get(&period).or_else(|| self.reserve.get(&period))
    }

    /// The last period with a set.
    #[must_use]
    pub fn newest_period(&self) -> Option<i64> {
        self.sets.keys().next_back().copied()
    }

    fn oldest_period(&self) -> Option<i64> {
        self.sets.keys().next().copied()
    }

    /// The first period after `period` with a set.
    #[must_use]
    pub fn first_period_after(&self, period: i64) -> Option<i64> {
        self.sets.range(period.saturating_add(1)..).next().map(|(found, _)| *found)
    }

    /// Sets of this life that never came, so far.
    #[must_use]
    pub fn missing_count(&self) -> u64 {
        let first = self.first_sequence.unwrap_or(self.next_sequence);
        (self.next_sequence - first).saturating_sub(self.received_count)
    }

    /// Notes that the agent with this boot id was heard; a new life starts its counts over, while
    /// its sets stay: the node did not move because its agent restarted.
    pub fn hear(&mut self, now: CentreTime, boot: BootId) -> Life {
        if self.former.contains(&boot) {
            return Life::Former;
        }
        self.last_heard = self.last_heard.max(now);
        if boot == self.boot {
            return Life::Current;
        }
        if self.first_sequence.is_some() {
            self.former.push_back(self.boot);
            if FORMER_LIFE_COUNT < self.former.len() {
                self.former.pop_front();
            }
        }
        self.boot = boot;
        self.clock = None;
        self.awaiting_clock.clear();
        self.seen.clear();
        self.first_sequence = None;
        self.next_sequence = 0;
        self.received_count = 0;
        Life::New
    }

    /// Counts a set by its sequence number; false if it came before.
    pub(super) fn count_arrival(&mut self, sequence: u64) -> bool {
        if !self.seen.insert(sequence) {
            self.duplicate_count += 1;
            return false;
        }
        if self.window_count + SEQUENCE_MEMORY < self.seen.len() {
            self.seen.pop_first();
        }
        self.first_sequence =
            Some(self.first_sequence.map_or(sequence, |first| first.min(sequence)));
        self.next_sequence = self.next_sequence.max(sequence.saturating_add(1));
        self.received_count += 1;
        true
    }

    pub(super) fn wait_for_clock(&mut self, arrival: CentreTime, set: Received<PointSet>) {
        self.awaiting_clock.push_back((arrival, set));
        if self.window_count < self.awaiting_clock.len() {
            self.awaiting_clock.pop_front();
            self.late_count += 1;
        }
    }

    pub(super) fn keep(&mut self, period: i64, set: KeptSet) -> Offer {
        let window = i64::try_from(self.window_count).unwrap_or(i64::MAX);
        let newest = self.newest_period().unwrap_or(period).max(period);
        if period <= newest.saturating_sub(window) {
            self.late_count += 1;
            return Offer::Late;
        }
        if self.sets.contains_key(&period) {
            self.duplicate_count += 1;
            return Offer::Duplicate;
        }
        self.sets.insert(period, set);
        while self.oldest_period().is_some_and(|oldest| oldest <= newest - window) {
            self.reserve.extend(self.sets.pop_first());
        }
        Offer::Kept(period)
    }

    /// Puts every set into the period that the changed grid gives it.
    pub(super) fn place_anew(&mut self, grid: &Grid) {
        for (_, set) in std::mem::take(&mut self.sets) {
            match self.sets.entry(grid.period(set.time)) {
                Entry::Vacant(period) => drop(period.insert(set)),
                Entry::Occupied(_) => self.duplicate_count += 1,
            }
        }
        let reserve = std::mem::take(&mut self.reserve).into_values();
        self.reserve = reserve.map(|set| (grid.period(set.time), set)).collect();
    }

    /// Drops what is kept from before the window, save for these periods.
    pub(super) fn keep_reserve(&mut self, kept: &BTreeSet<i64>) {
        self.reserve.retain(|period, _| kept.contains(period));
    }

    /// Drops the sets of all periods before `first`.
    pub(super) fn forget_before(&mut self, first: i64) {
        self.reserve.retain(|period, _| first <= *period);
        self.sets = self.sets.split_off(&first);
    }

    pub(super) fn forget_sets(&mut self) {
        self.sets.clear();
        self.reserve.clear();
    }
}
