//! What a run of a tracker is worth: counts and sums, which add over runs, and the figures of them.

use std::iter::Sum;
use std::ops::Add;

use serde::Serialize;

use super::distance::Gospa;

/// Counts and sums of one run, or of several added. Figures of nothing are `None`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Score {
    /// Moments looked at.
    pub frame_count: usize,
    /// Moments of everybody who is there, added.
    pub truth_count: usize,
    /// Of these, those after the allowance.
    pub due_count: usize,
    /// Of the due, those without an estimate within the gate.
    pub missed_count: usize,
    /// Moments of everybody who is reported, added.
    pub estimate_count: usize,
    /// Of these, those that belong to nobody.
    pub false_count: usize,
    /// Pairs of a true place and an estimate.
    pub pair_count: usize,
    /// Of the pairs, those whose track is with the truth that it is with most often.
    pub pure_count: usize,
    /// Of the due, those held by the track that holds this truth most often.
    pub held_count: usize,
    /// How often somebody was found under another identity than the time before.
    pub switch_count: usize,
    /// Squared distances of the pairs, added, square metres.
    pub squares_m2: f64,
    /// Everybody who was ever there.
    pub person_count: usize,
    /// Of these, those that were found at least once.
    pub found_count: usize,
    /// Time from being there to being found first, added over those found, seconds.
    pub delay_s: f64,
    /// Squared errors in units of the stated covariance, added over the pairs that state one.
    pub normalised: f64,
    /// Pairs that state a covariance.
    pub normalised_count: usize,
    /// GOSPA's parts, added over the moments.
    pub gospa: Gospa,
    /// OSPA, added over the moments, metres.
    pub ospa_m: f64,
}

impl Score {
    /// Root mean square distance of the pairs, metres.
    #[must_use]
    pub fn rmse_m(&self) -> Option<f64> {
        ratio(self.squares_m2, self.pair_count).map(f64::sqrt)
    }

    /// Share of the due moments in which somebody was missed.
    #[must_use]
    pub fn missed_share(&self) -> Option<f64> {
        ratio(self.missed_count as f64, self.due_count)
    }

    /// Reports of nobody, per moment.
    #[must_use]
    pub fn false_per_frame(&self) -> Option<f64> {
        ratio(self.false_count as f64, self.frame_count)
    }

    /// Share of the pairs in which a track is with the one whom it is mostly with: 1 if no track
    /// ever changes over to somebody else.
    #[must_use]
    pub fn purity(&self) -> Option<f64> {
        ratio(self.pure_count as f64, self.pair_count)
    }

    /// Share of the due moments that are held by each one's longest track: 1 if everybody is
    /// followed under one identity all the time.
    #[must_use]
    pub fn completeness(&self) -> Option<f64> {
        ratio(self.held_count as f64, self.due_count)
    }

    /// Mean time to being found first, of those found, seconds.
    #[must_use]
    pub fn initiation_delay_s(&self) -> Option<f64> {
        ratio(self.delay_s, self.found_count)
    }

    /// Mean squared error in units of the stated covariance; 2 if that is true.
    #[must_use]
    pub fn nees(&self) -> Option<f64> {
        ratio(self.normalised, self.normalised_count)
    }

    /// Root mean square of GOSPA over the moments, metres.
    #[must_use]
    pub fn gospa_m(&self) -> Option<f64> {
        ratio(self.gospa.distance_m().powi(2), self.frame_count).map(f64::sqrt)
    }

    /// GOSPA's parts per moment, square metres: `[localisation, missed, false]`, of which `gospa_m`
    /// is the root of the sum.
    #[must_use]
    pub fn gospa_parts_m2(&self) -> Option<[f64; 3]> {
        let Gospa { localisation_m2, missed_m2, false_m2 } = self.gospa;
        let frames = self.frame_count as f64;
        let parts = [localisation_m2, missed_m2, false_m2].map(|part| part / frames);
        (0 < self.frame_count).then_some(parts)
    }

    /// Mean OSPA over the moments, metres.
    #[must_use]
    pub fn mean_ospa_m(&self) -> Option<f64> {
        ratio(self.ospa_m, self.frame_count)
    }
}

impl Add for Score {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            frame_count: self.frame_count + other.frame_count,
            truth_count: self.truth_count + other.truth_count,
            due_count: self.due_count + other.due_count,
            missed_count: self.missed_count + other.missed_count,
            estimate_count: self.estimate_count + other.estimate_count,
            false_count: self.false_count + other.false_count,
            pair_count: self.pair_count + other.pair_count,
            pure_count: self.pure_count + other.pure_count,
            held_count: self.held_count + other.held_count,
            switch_count: self.switch_count + other.switch_count,
            squares_m2: self.squares_m2 + other.squares_m2,
            person_count: self.person_count + other.person_count,
            found_count: self.found_count + other.found_count,
            delay_s: self.delay_s + other.delay_s,
            normalised: self.normalised + other.normalised,
            normalised_count: self.normalised_count + other.normalised_count,
            gospa: self.gospa + other.gospa,
            ospa_m: self.ospa_m + other.ospa_m,
        }
    }
}

impl Sum for Score {
    fn sum<I: Iterator<Item = Self>>(scores: I) -> Self {
        scores.fold(Self::default(), Add::add)
    }
}

impl Add for Gospa {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            localisation_m2: self.localisation_m2 + other.localisation_m2,
            missed_m2: self.missed_m2 + other.missed_m2,
            false_m2: self.false_m2 + other.false_m2,
        }
    }
}

fn ratio(of: f64, count: usize) -> Option<f64> {
    (0 < count).then(|| of / count as f64)
}
