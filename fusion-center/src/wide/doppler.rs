//! Whether radial velocities have the sign that they should: do targets go where they say?

use std::fmt;

use nalgebra::Vector2;

use super::look::OwnedLook;
use crate::tracking::{Plot, Radial};

/// Distances within so many standard deviations agree.
const AGREE_SIGMAS: f64 = 3.0;
/// Fewer votes decide nothing.
const MIN_VOTE_COUNT: u32 = 12;
/// Votes by chance differ by more than so many standard deviations once in 400 times.
const DECIDED_SIGMAS: f64 = 3.0;

/// What the plots say of the sign of their radial velocities.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Targets go as positive = away says.
    AsStated,
    /// Targets go the other way.
    Reversed,
    /// Too few plots, or they contradict each other.
    Undecided,
}

/// How many plots find a successor only under one of the signs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DopplerSign {
    /// Only where positive is away.
    pub as_stated_count: u32,
    /// Only where positive is towards.
    pub reversed_count: u32,
}

/// Every pair of looks of one sensor between `min_gap_s` and `max_gap_s` apart is asked: each plot that
/// says a radial velocity, where would it be by then? It votes for a sign if a plot of the later look
/// is there under that sign only; across the line of sight nothing is expected but that nobody is
/// faster than `max_speed_m_per_s`. Plots that happen to be there do so for either sign alike, so that
/// without information the difference of the votes is that of tossed coins. Plots whose velocity is
/// known only up to less than twice that speed have no vote.
#[must_use]
pub fn doppler_sign(
    looks: &[OwnedLook],
    (min_gap_s, max_gap_s): (f64, f64),
    max_speed_m_per_s: f64,
) -> DopplerSign {
    let mut sign = DopplerSign::default();
    for (index, first) in looks.iter().enumerate() {
        let later = looks[index + 1..].iter().filter(|second| {
            let gap_s = second.time_s - first.time_s;
            let is_same = second.name.sensor_index == first.name.sensor_index;
            is_same && (min_gap_s..=max_gap_s).contains(&gap_s)
        });
        for second in later {
            sign.ask(first, second, max_speed_m_per_s);
        }
    }
    sign
}

/// Where a plot is expected later, seen along its line of sight over ground.
struct Expected<'a> {
    plot: &'a Plot,
    along: Vector2<f64>,
    /// Forward or back, metres.
    moved_m: f64,
    /// Of `moved_m` without the later plot's error, square metres.
    variance_m2: f64,
    /// Across, at most, metres.
    across_m: f64,
}

impl<'a> Expected<'a> {
    fn new(plot: &'a Plot, gap_s: f64, max_speed_m_per_s: f64) -> Option<Self> {
        let Radial { velocity_m_per_s, sigma_m_per_s, direction, wrap_m_per_s } = plot.radial?;
        if wrap_m_per_s.is_some_and(|span| span < 2.0 * max_speed_m_per_s) {
            return None;
        }
        let share = direction.norm();
        let along = direction.try_normalize(f64::MIN_POSITIVE)?;
        let over_ground = velocity_m_per_s / share;
        let spread_m = gap_s * sigma_m_per_s / share;
        let left = max_speed_m_per_s.powi(2) - over_ground.powi(2);
        (0.0 < left).then(|| Self {
            plot,
            along,
            moved_m: over_ground * gap_s,
            variance_m2: along.dot(&(plot.covariance_m2 * along)) + spread_m * spread_m,
            across_m: left.sqrt() * gap_s,
        })
    }

    /// Whether another plot is where this one would be, as stated and reversed; `None` where the two
    /// cannot be told apart.
    fn is_at(&self, other: &Plot) -> Option<[bool; 2]> {
        let moved_m = other.position_m - self.plot.position_m;
        let (forward_m, sideways_m) = (self.along.dot(&moved_m), self.along.perp(&moved_m).abs());
        let other_m2 = self.along.dot(&(other.covariance_m2 * self.along));
        let reach_m = AGREE_SIGMAS * (self.variance_m2 + other_m2).sqrt();
        if self.moved_m.abs() <= reach_m || self.across_m + reach_m < sideways_m {
            return None;
        }
        Some([1.0, -1.0].map(|sign| (forward_m - sign * self.moved_m).abs() <= reach_m))
    }
}

impl DopplerSign {
    fn ask(&mut self, first: &OwnedLook, second: &OwnedLook, max_speed_m_per_s: f64) {
        let gap_s = second.time_s - first.time_s;
        let expected =
            first.plots.iter().filter_map(|plot| Expected::new(plot, gap_s, max_speed_m_per_s));
        for one in expected {
            let found = second.plots.iter().filter_map(|other| one.is_at(other));
            match found.fold([false; 2], |any, now| [any[0] || now[0], any[1] || now[1]]) {
                [true, false] => self.as_stated_count = self.as_stated_count.saturating_add(1),
                [false, true] => self.reversed_count = self.reversed_count.saturating_add(1),
                _ => {}
            }
        }
    }

    /// Decided where the votes differ by more than three standard deviations of tossed coins.
    #[must_use]
    pub fn verdict(&self) -> Verdict {
        let count = self.as_stated_count.saturating_add(self.reversed_count);
        let lead = f64::from(self.as_stated_count) - f64::from(self.reversed_count);
        let is_decided =
            MIN_VOTE_COUNT <= count && DECIDED_SIGMAS * f64::from(count).sqrt() < lead.abs();
        match (is_decided, 0.0 < lead) {
            (false, _) => Verdict::Undecided,
            (true, true) => Verdict::AsStated,
            (true, false) => Verdict::Reversed,
        }
    }
}

impl fmt::Display for DopplerSign {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { as_stated_count, reversed_count } = self;
        match self.verdict() {
            Verdict::AsStated => write!(
                f,
                "radial velocities are positive away from the sensor: {as_stated_count} plots go \
                 so, {reversed_count} the other way"
            ),
            Verdict::Reversed => write!(
                f,
                "radial velocities are positive towards the sensor: {reversed_count} plots go so, \
                 {as_stated_count} the other way; set radial_convention = \"towards\""
            ),
            Verdict::Undecided => write!(
                f,
                "the sign of radial velocities is not decided: {as_stated_count} plots speak for \
                 away, {reversed_count} for towards"
            ),
        }
    }
}
