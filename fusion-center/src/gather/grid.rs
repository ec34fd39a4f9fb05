//! The centre's grid of periods: a running count whose phase follows the reference node.

use std::time::Duration;

use proto::time::CentreTime;

/// What placing a set did to the grid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Placed {
    /// Periods are where they were.
    PhaseKept,
    /// The reference node spoke for the first time: sets kept so far must be placed anew.
    PhaseChanged,
}

/// Whose set is placed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Speaker {
    /// The reference node, which leads the phase.
    Reference,
    /// Any other node.
    Other,
}

/// One period whose time is known; all others follow from it.
#[derive(Clone, Copy, Debug)]
struct Anchor {
    period: i64,
    middle: CentreTime,
    is_reference: bool,
}

/// Period `k` lasts half a period before and after `middle(k)`.
#[derive(Clone, Debug)]
pub(super) struct Grid {
    period_ns: i64,
    anchor: Option<Anchor>,
}

impl Grid {
    pub(super) fn new(period: Duration) -> Self {
        let period_ns = i64::try_from(period.as_nanos()).unwrap_or(i64::MAX).max(1);
        Self { period_ns, anchor: None }
    }

    /// Tells the grid of a set. Until the reference node speaks, the first set of anybody gives
    /// the phase; then each of the reference's sets moves it, so that a reference clock that runs
    /// fast or slow never drifts over the edge of a period.
    pub(super) fn place(&mut self, time: CentreTime, speaker: Speaker) -> Placed {
        let is_reference = speaker == Speaker::Reference;
        let Some(anchor) = self.anchor else {
            self.anchor = Some(Anchor { period: 0, middle: time, is_reference });
            return Placed::PhaseKept;
        };
        if !is_reference || (anchor.is_reference && time <= anchor.middle) {
            return Placed::PhaseKept;
        }
        self.anchor = Some(Anchor { period: self.period(time), middle: time, is_reference });
        if anchor.is_reference { Placed::PhaseKept } else { Placed::PhaseChanged }
    }

    /// The period that an instant belongs to.
    pub(super) fn period(&self, time: CentreTime) -> i64 {
        let Some(anchor) = self.anchor else { return 0 };
        let from_anchor_ns = time.0.saturating_sub(anchor.middle.0);
        anchor.period + from_anchor_ns.saturating_add(self.period_ns / 2).div_euclid(self.period_ns)
    }

    /// The middle of a period.
    pub(super) fn middle(&self, period: i64) -> CentreTime {
        let Some(anchor) = self.anchor else { return CentreTime(0) };
        let periods = period.saturating_sub(anchor.period);
        CentreTime(anchor.middle.0.saturating_add(periods.saturating_mul(self.period_ns)))
    }
}

#[cfg(test)]
mod tests {
    use super::Speaker::{Other, Reference};
    use super::*;

    fn ms(value: i64) -> CentreTime {
        CentreTime(value * 1_000_000)
    }

    #[test]
    fn periods_reach_half_a_period_to_both_sides() {
        let mut grid = Grid::new(Duration::from_millis(100));
        assert_eq!(grid.place(ms(1000), Reference), Placed::PhaseKept);
        for (at, period) in [(950, 0), (949, -1), (1049, 0), (1050, 1), (800, -2), (1200, 2)] {
            assert_eq!(grid.period(ms(at)), period, "{at} ms");
        }
        assert_eq!(grid.middle(-3), ms(700));
    }

    #[test]
    fn a_drifting_reference_never_slips_a_period() {
        // 1 % fast: after 100 periods a fixed grid would be a whole period off.
        let mut grid = Grid::new(Duration::from_millis(100));
        for k in 0..300 {
            grid.place(ms(101 * k), Reference);
            assert_eq!(grid.period(ms(101 * k)), k);
        }
    }

    #[test]
    fn the_reference_takes_the_phase_over_once() {
        let mut grid = Grid::new(Duration::from_millis(100));
        grid.place(ms(0), Other);
        assert_eq!(grid.place(ms(140), Other), Placed::PhaseKept);
        assert_eq!(grid.place(ms(240), Reference), Placed::PhaseChanged);
        assert_eq!((grid.period(ms(240)), grid.middle(2)), (2, ms(240)));
        assert_eq!(grid.place(ms(340), Reference), Placed::PhaseKept);
        assert_eq!(
            grid.place(ms(290), Reference),
            Placed::PhaseKept,
            "late sets do not turn it back"
        );
        assert_eq!(grid.middle(3), ms(340));
    }
}
