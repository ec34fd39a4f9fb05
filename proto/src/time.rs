//! Two clocks that do not mix: a node's and the centre's, and the estimate that joins them.
//!
//! Both count nanoseconds of a monotonic clock from an origin of their own. Wall clocks are for
//! people only and never enter a computation.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::ids::BootId;

/// An instant on a node's monotonic clock, in nanoseconds since the agent's own origin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct NodeTime(pub u64);

/// An instant on the fusion centre's monotonic clock, in nanoseconds since its own origin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct CentreTime(pub i64);

impl NodeTime {
    /// The same instant on the centre's clock, by `clock`.
    #[must_use]
    pub fn to_centre(self, clock: &ClockEstimate) -> CentreTime {
        CentreTime(i64::try_from(self.0).unwrap_or(i64::MAX).saturating_add(clock.offset_ns))
    }
}

impl CentreTime {
    /// How long after `earlier` this is; zero if it is not.
    #[must_use]
    pub fn since(self, earlier: Self) -> Duration {
        Duration::from_nanos(u64::try_from(self.0.saturating_sub(earlier.0)).unwrap_or(0))
    }

    /// Seconds from `origin` to this instant, negative if it is before.
    #[must_use]
    pub fn seconds_since(self, origin: Self) -> f64 {
        self.0.saturating_sub(origin.0) as f64 * 1e-9
    }
}

/// What a node knows of the centre's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ClockEstimate {
    /// The life of the centre whose clock this speaks of.
    pub centre_boot: BootId,
    /// Centre time minus node time, nanoseconds.
    pub offset_ns: i64,
    /// Largest possible error of `offset_ns` by the round trip it came from, nanoseconds.
    pub error_ns: u64,
}

/// One question for the time: asked and received back by the node, stamped by the centre when the
/// question arrived, so that the time it took to answer counts as part of the way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Exchange {
    /// When the node asked.
    pub asked: NodeTime,
    /// The centre's clock when the question arrived.
    pub answered: CentreTime,
    /// When the answer was back.
    pub received: NodeTime,
    /// The life of the centre that answered.
    pub centre_boot: BootId,
}

/// Keeps the exchange with the shortest round trip of the last few: the path was least disturbed
/// there, and half the round trip bounds the error of the offset.
#[derive(Clone, Debug, Default)]
pub struct ClockFilter {
    recent: std::collections::VecDeque<(NodeTime, ClockEstimate)>,
}

/// Exchanges kept.
const WINDOW: usize = 16;
/// Quartz clocks part by no more than this, so that an old exchange is worth less: 100 ppm.
const DRIFT_PER_MILLION: u64 = 100;

impl ClockFilter {
    /// Takes one exchange in. A new life of the centre forgets the old one's clock.
    pub fn add(&mut self, exchange: &Exchange) {
        if self.recent.back().is_some_and(|(_, last)| last.centre_boot != exchange.centre_boot) {
            self.recent.clear();
        }
        let round_trip_ns = exchange.received.0.saturating_sub(exchange.asked.0);
        let middle_ns = exchange.asked.0.saturating_add(round_trip_ns / 2);
        let middle_ns = i64::try_from(middle_ns).unwrap_or(i64::MAX);
        let offset_ns = exchange.answered.0.saturating_sub(middle_ns);
        let error_ns = round_trip_ns / 2 + 1;
        let centre_boot = exchange.centre_boot;
        let estimate = ClockEstimate { centre_boot, offset_ns, error_ns };
        self.recent.push_back((exchange.received, estimate));
        if WINDOW < self.recent.len() {
            self.recent.pop_front();
        }
    }

    /// The best estimate at `now`, if any exchange succeeded. Its error grows with its age.
    #[must_use]
    pub fn estimate(&self, now: NodeTime) -> Option<ClockEstimate> {
        let aged = self.recent.iter().map(|(received, estimate)| {
            let age_ns = now.0.saturating_sub(received.0);
            let drift_ns = age_ns / 1_000_000 * DRIFT_PER_MILLION;
            ClockEstimate { error_ns: estimate.error_ns.saturating_add(drift_ns), ..*estimate }
        });
        aged.min_by_key(|estimate| estimate.error_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exchange(asked: u64, delay_there: u64, delay_back: u64, offset: i64) -> Exchange {
        let answered = CentreTime(i64::try_from(asked + delay_there).unwrap() + offset);
        let received = NodeTime(asked + delay_there + delay_back);
        Exchange { asked: NodeTime(asked), answered, received, centre_boot: BootId(1) }
    }

    #[test]
    fn the_error_bound_holds_for_any_split_of_the_round_trip() {
        for (there, back) in [(0, 1000), (1000, 0), (500, 500), (3, 8)] {
            for offset in [-5_000_000, 0, 7_000_000] {
                let mut filter = ClockFilter::default();
                filter.add(&exchange(1_000_000, there, back, offset));
                let estimate = filter.estimate(NodeTime(1_001_000)).unwrap();
                assert!(estimate.offset_ns.abs_diff(offset) <= estimate.error_ns);
            }
        }
    }

    #[test]
    fn the_least_disturbed_exchange_wins_and_a_restarted_centre_starts_over() {
        let mut filter = ClockFilter::default();
        filter.add(&exchange(0, 10_000, 0, 42));
        filter.add(&exchange(1_000_000, 10, 10, 42));
        filter.add(&exchange(2_000_000, 0, 90_000, 42));
        assert_eq!(filter.estimate(NodeTime(2_100_000)).unwrap().offset_ns, 42);
        let mut restarted = exchange(3_000_000, 70_000, 70_000, -9);
        restarted.centre_boot = BootId(2);
        filter.add(&restarted);
        assert_eq!(filter.estimate(NodeTime(4_000_000)).unwrap().offset_ns, -9);
    }

    #[test]
    fn an_old_exchange_gives_way_to_a_worse_but_fresh_one() {
        let hour_ns = 3_600_000_000_000;
        let mut filter = ClockFilter::default();
        filter.add(&exchange(0, 10, 10, 42));
        filter.add(&exchange(hour_ns, 2_000_000, 2_000_000, 77));
        let estimate = filter.estimate(NodeTime(hour_ns + 4_000_000)).unwrap();
        assert_eq!(estimate.offset_ns, 77);
        let later = filter.estimate(NodeTime(2 * hour_ns)).unwrap();
        assert!(300_000_000 < later.error_ns, "an hour at 100 ppm is 360 ms: {later:?}");
    }
}
