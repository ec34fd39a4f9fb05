//! Whether radial velocities have the sign that they should: do targets go where they say?
//!
//! Each plot that says a radial velocity is asked at later looks of its sensor: where would it be by
//! then? It votes for a sign if a plot is there under that sign only; across the line of sight nothing
//! is expected but that nobody is faster than [`MAX_SPEED_M_PER_S`]. Plots that happen to be there do so
//! for either sign alike, so that without information the difference of the votes is that of tossed
//! coins. Plots whose velocity is known only up to less than twice that speed have no vote.

use std::collections::VecDeque;

use nalgebra::Vector2;

use crate::tracking::{Plot, Radial};

/// Nobody on the ground is faster, metres per second.
const MAX_SPEED_M_PER_S: f64 = 40.0;
/// Over longer times nobody goes straight on, seconds.
const MAX_GAP_S: f64 = 40.0;
/// Distances within so many standard deviations agree.
const AGREE_SIGMAS: f64 = 3.0;
/// Fewer votes decide nothing.
const MIN_VOTE_COUNT: u32 = 16;
/// Tossed coins differ by more than so many standard deviations once in 16,000 times; the votes are
/// looked at after every look.
const DECIDED_SIGMAS: f64 = 4.0;
/// Plots of a look that are asked: votes need no more, and time must have a bound.
const ASKED_COUNT: usize = 50;
/// Plots that wait to be asked.
const KEPT_COUNT: usize = 300;
/// Pairs of plots after which the sign stays open: a second of work in all.
const MAX_PAIR_COUNT: usize = 100_000_000;

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

/// Watches the looks of one sensor until the sign of its radial velocities is decided.
#[derive(Clone, Debug, Default)]
pub struct SignWatch {
    sign: DopplerSign,
    /// Plots that are to be asked with their times, seconds, oldest first.
    kept: VecDeque<(f64, Plot)>,
    pair_count: usize,
}

impl SignWatch {
    /// Takes the next look in order of time; says the verdict at the look that decides it, once.
    pub fn take(&mut self, time_s: f64, plots: &[Plot]) -> Option<Verdict> {
        if self.is_over() {
            return None;
        }
        while self.kept.front().is_some_and(|(first_s, _)| *first_s + MAX_GAP_S < time_s) {
            self.kept.pop_front();
        }
        for (first_s, plot) in &self.kept {
            if let Some(expected) = Expected::new(plot, time_s - first_s) {
                self.sign.ask(&expected, plots);
                self.pair_count += plots.len();
            }
        }
        let with_velocity = plots.iter().filter(|plot| plot.radial.is_some());
        self.kept.extend(with_velocity.take(ASKED_COUNT).map(|plot| (time_s, plot.clone())));
        self.kept.drain(..self.kept.len().saturating_sub(KEPT_COUNT));
        if self.is_over() {
            self.kept = VecDeque::new();
        }
        Some(self.sign.verdict()).filter(|verdict| *verdict != Verdict::Undecided)
    }

    /// The votes so far.
    #[must_use]
    pub fn sign(&self) -> DopplerSign {
        self.sign
    }

    fn is_over(&self) -> bool {
        self.sign.verdict() != Verdict::Undecided || MAX_PAIR_COUNT < self.pair_count
    }
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
    fn new(plot: &'a Plot, gap_s: f64) -> Option<Self> {
        let Radial { velocity_m_per_s, sigma_m_per_s, direction, wrap_m_per_s } = plot.radial?;
        if wrap_m_per_s.is_some_and(|span| span < 2.0 * MAX_SPEED_M_PER_S) {
            return None;
        }
        let share = direction.norm();
        let along = direction.try_normalize(f64::MIN_POSITIVE)?;
        let over_ground = velocity_m_per_s / share;
        let spread_m = gap_s * sigma_m_per_s / share;
        let left = MAX_SPEED_M_PER_S.powi(2) - over_ground.powi(2);
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
    fn ask(&mut self, one: &Expected<'_>, later: &[Plot]) {
        let found = later.iter().filter_map(|other| one.is_at(other));
        match found.fold([false; 2], |any, now| [any[0] || now[0], any[1] || now[1]]) {
            [true, false] => self.as_stated_count = self.as_stated_count.saturating_add(1),
            [false, true] => self.reversed_count = self.reversed_count.saturating_add(1),
            _ => {}
        }
    }

    /// Decided where the votes differ by more than four standard deviations of tossed coins.
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
