//! All trials of one tracker under one condition: figures with their confidence intervals, and every
//! pair of trackers trial by trial.

use serde::Serialize;

use super::super::statistics::{Bootstrap, Figure};
use super::entrants::Entrant;
use super::trial::{Outcome, Tally};
use crate::metrics::Score;

/// The figures of one tracker under one condition; those of nothing are `None`.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Figures {
    /// Share of links whose both plots are of the same target.
    pub(super) right_links: Option<Figure>,
    /// Links that this is a share of.
    pub(super) link_count: usize,
    /// Share of plots of the target to which the track belonged at its origin.
    pub(super) identity: Option<Figure>,
    /// Share of plots of the target that the track has most of.
    pub(super) purity: Option<Figure>,
    /// Smoothed places against that target.
    pub(super) rmse_m: Option<Figure>,
    /// The same, not smoothed.
    pub(super) filtered_rmse_m: Option<Figure>,
    /// Squared errors of the latter in units of their covariance; 1 if that is true.
    pub(super) nees_per_dimension: Option<Figure>,
    /// Root mean square over all moments, of what is reported at once.
    pub(super) gospa_m: Option<Figure>,
    /// Localisation, missed, false: their sum is the square of `gospa_m`.
    pub(super) gospa_parts_m2: Option<[f64; 3]>,
    pub(super) missed_share: Option<Figure>,
    pub(super) false_per_look: Option<Figure>,
    pub(super) tracks_per_run: Option<Figure>,
    pub(super) switches_per_run: Option<Figure>,
    pub(super) initiation_delay_s: Option<Figure>,
}

/// One tracker under one condition.
#[derive(Clone, Debug, Serialize)]
pub(super) struct EntrantResult {
    pub(super) mode: Entrant,
    pub(super) figures: Figures,
    /// Processor time per look, microseconds. Differs from run to run.
    pub(super) look_us: Option<f64>,
    /// Counts and sums, trial by trial.
    pub(super) trials: Vec<Tally>,
}

impl EntrantResult {
    /// Of these trials; the intervals follow from `seed`.
    pub(super) fn new(mode: Entrant, outcomes: &[&Outcome], seed: u64) -> Self {
        let trials: Vec<Tally> = outcomes.iter().map(|outcome| outcome.tally).collect();
        let times = || outcomes.iter().flat_map(|outcome| &outcome.took);
        let look_count = times().count();
        let took_s: f64 = times().map(std::time::Duration::as_secs_f64).sum();
        let look_us = (0 < look_count).then(|| 1e6 * took_s / look_count as f64);
        Self { mode, figures: figures(&trials, seed), look_us, trials }
    }
}

fn figures(trials: &[Tally], seed: u64) -> Figures {
    let all = Bootstrap::new(trials, seed);
    let run_count = trials.len().max(1) as f64;
    let of_score =
        |of: fn(&Score) -> Option<f64>| all.figure(move |tally: &Tally| of(&tally.score));
    Figures {
        right_links: all.figure(|tally| tally.plot_links.right_link_rate()),
        link_count: all.total.plot_links.link_count,
        identity: all.figure(|tally| tally.links.identity_rate()),
        purity: all.figure(|tally| tally.links.purity()),
        rmse_m: all.figure(Tally::rmse_m),
        filtered_rmse_m: all.figure(Tally::filtered_rmse_m),
        nees_per_dimension: all.figure(Tally::nees_per_dimension),
        gospa_m: of_score(Score::gospa_m),
        gospa_parts_m2: all.total.score.gospa_parts_m2(),
        missed_share: of_score(Score::missed_share),
        false_per_look: of_score(Score::false_per_frame),
        tracks_per_run: all.figure(|tally| Some(tally.links.track_count as f64 / run_count)),
        switches_per_run: all.figure(|tally| Some(tally.links.switch_count as f64 / run_count)),
        initiation_delay_s: of_score(Score::initiation_delay_s),
    }
}

/// In how many trials one is better than, as good as, worse than another.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub(super) struct Record {
    pub(super) win_count: usize,
    pub(super) tie_count: usize,
    pub(super) loss_count: usize,
}

impl Record {
    /// More is better.
    fn of(pairs: impl Iterator<Item = (f64, f64)>) -> Self {
        let mut record = Self::default();
        for (one, other) in pairs {
            let counted = match one.total_cmp(&other) {
                std::cmp::Ordering::Greater => &mut record.win_count,
                std::cmp::Ordering::Equal => &mut record.tie_count,
                std::cmp::Ordering::Less => &mut record.loss_count,
            };
            *counted += 1;
        }
        record
    }

    /// As people read it.
    pub(super) fn text(&self) -> String {
        format!("{}/{}/{}", self.win_count, self.tie_count, self.loss_count)
    }

    /// Share of wins.
    pub(super) fn win_share(&self) -> f64 {
        let count = self.win_count + self.tie_count + self.loss_count;
        self.win_count as f64 / (count as f64).max(1.0)
    }
}

/// Two trackers on the same flights.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Duel {
    pub(super) one: Entrant,
    pub(super) other: Entrant,
    /// By the share of right links.
    pub(super) right_links: Record,
    /// By the mean square error of smoothed places.
    pub(super) mean_square: Record,
}

/// Every pair, in the order of the trackers.
pub(super) fn duels(entrants: &[EntrantResult]) -> Vec<Duel> {
    let pairs = (0..entrants.len()).flat_map(|i| (i + 1..entrants.len()).map(move |j| (i, j)));
    pairs.map(|(i, j)| duel(&entrants[i], &entrants[j])).collect()
}

fn duel(one: &EntrantResult, other: &EntrantResult) -> Duel {
    let trials = || one.trials.iter().zip(&other.trials);
    // Who has no track at all is worse than anybody.
    let links = |tally: &Tally| tally.plot_links.right_link_rate().unwrap_or(-1.0);
    let closeness = |tally: &Tally| -tally.mean_square_m2().unwrap_or(f64::INFINITY);
    Duel {
        one: one.mode,
        other: other.mode,
        right_links: Record::of(trials().map(|(a, b)| (links(a), links(b)))),
        mean_square: Record::of(trials().map(|(a, b)| (closeness(a), closeness(b)))),
    }
}
