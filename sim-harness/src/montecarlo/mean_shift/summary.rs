//! All trials of one tracker in one experiment: figures with their confidence intervals.

use serde::Serialize;

pub(super) use super::super::statistics::Figure;
use super::super::statistics::{Bootstrap, Proportion};
use super::trial::Outcome;
use crate::metrics::Score;

/// The figures of one tracker in one experiment; those of nothing are `None`.
#[derive(Clone, Debug, Serialize)]
pub(in super::super) struct Figures {
    pub(in super::super) rmse_m: Option<Figure>,
    /// The same of near sides against where what people reflect comes from on average.
    pub(in super::super) near_side_rmse_m: Option<Figure>,
    /// The same of smoothed places.
    pub(in super::super) smoothed_rmse_m: Option<Figure>,
    pub(in super::super) missed_share: Option<Figure>,
    pub(in super::super) false_per_frame: Option<Figure>,
    pub(in super::super) switches_per_run: Option<Figure>,
    /// Trials without a miss, a false report or a switch, with Wilson's interval: it tells how sure
    /// it is that there are none.
    pub(in super::super) flawless: Proportion,
    pub(in super::super) purity: Option<Figure>,
    pub(in super::super) completeness: Option<Figure>,
    pub(in super::super) initiation_delay_s: Option<Figure>,
    /// Share of people who were found at all.
    pub(in super::super) found_share: Option<Figure>,
    pub(in super::super) nees: Option<Figure>,
    /// Root mean square over all moments, with those before anybody is confirmed.
    pub(in super::super) gospa_m: Option<Figure>,
    /// Localisation, missed, false: their sum is the square of `gospa_m`.
    pub(in super::super) gospa_parts_m2: Option<[f64; 3]>,
    pub(in super::super) ospa_m: Option<Figure>,
}

/// One moment of all trials.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct MomentFigures {
    pub(super) rmse_m: Option<f64>,
    /// Share of people who are not found; counted from the first frame on.
    pub(super) unfound_share: f64,
    pub(super) false_per_frame: f64,
}

/// All trials of one tracker in one experiment.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Summary {
    pub(super) tracker: &'static str,
    pub(super) figures: Figures,
    /// Time of the tracker per frame, microseconds. Differs from run to run.
    pub(super) track_us: Option<f64>,
    pub(super) over_time: Vec<MomentFigures>,
    /// Counts and sums, trial by trial.
    pub(super) trials: Vec<Score>,
}

impl Summary {
    /// Of these trials; the intervals follow from `seed`.
    pub(super) fn new(tracker: &'static str, outcomes: &[Outcome], seed: u64) -> Self {
        let trials: Vec<Score> = outcomes.iter().map(|outcome| outcome.score).collect();
        let frame_count: usize = trials.iter().map(|score| score.frame_count).sum();
        let took_s: f64 = outcomes.iter().map(|outcome| outcome.took.as_secs_f64()).sum();
        let moments = outcomes.iter().map(|outcome| outcome.frames.len()).max().unwrap_or(0);
        let moment =
            |index: usize| outcomes.iter().filter_map(move |one| one.frames.get(index)).copied();
        let rmse_m = |of: fn(&Outcome) -> Score| {
            let scores: Vec<Score> = outcomes.iter().map(of).collect();
            figures(&scores, seed).rmse_m
        };
        let figures = Figures {
            near_side_rmse_m: rmse_m(|outcome| outcome.near_side),
            smoothed_rmse_m: rmse_m(|outcome| outcome.smoothed),
            ..figures(&trials, seed)
        };
        Self {
            tracker,
            figures,
            track_us: (0 < frame_count).then(|| 1e6 * took_s / frame_count as f64),
            over_time: (0..moments).map(|index| of_moment(moment(index).sum())).collect(),
            trials,
        }
    }
}

fn of_moment(score: Score) -> MomentFigures {
    let share = |part: usize, whole: usize| part as f64 / (whole as f64).max(1.0);
    MomentFigures {
        rmse_m: score.rmse_m(),
        unfound_share: share(score.truth_count - score.pair_count, score.truth_count),
        false_per_frame: share(score.false_count, score.frame_count),
    }
}

/// The figures of these trials; the intervals follow from `seed`.
pub(in super::super) fn figures(trials: &[Score], seed: u64) -> Figures {
    let all = Bootstrap::new(trials, seed);
    let figure = |of: &dyn Fn(&Score) -> Option<f64>| all.figure(of);
    let run_count = trials.len().max(1) as f64;
    let found = |score: &Score| {
        (0 < score.person_count).then(|| score.found_count as f64 / score.person_count as f64)
    };
    let is_flawless =
        |score: &Score| score.missed_count + score.false_count + score.switch_count == 0;
    Figures {
        rmse_m: figure(&Score::rmse_m),
        near_side_rmse_m: None,
        smoothed_rmse_m: None,
        missed_share: figure(&Score::missed_share),
        false_per_frame: figure(&Score::false_per_frame),
        switches_per_run: figure(&|score| Some(score.switch_count as f64 / run_count)),
        flawless: Proportion::count_of(trials, is_flawless),
        purity: figure(&Score::purity),
        completeness: figure(&Score::completeness),
        initiation_delay_s: figure(&Score::initiation_delay_s),
        found_share: figure(&found),
        nees: figure(&Score::nees),
        gospa_m: figure(&Score::gospa_m),
        gospa_parts_m2: all.total.gospa_parts_m2(),
        ospa_m: figure(&Score::mean_ospa_m),
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use rand::SeedableRng;
    use rand::rngs::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;
    use crate::montecarlo::mean_shift::trial::Paths;

    fn outcome(score: Score) -> Outcome {
        let took = Duration::from_micros(30);
        let near_side = Score { squares_m2: 4.0 * score.squares_m2, ..score };
        let smoothed = Score::default();
        let paths = Paths::default();
        Outcome { score, near_side, smoothed, frames: vec![score], paths, took }
    }

    fn run(squares_m2: f64, false_count: usize) -> Score {
        Score {
            frame_count: 10,
            truth_count: 20,
            due_count: 20,
            pair_count: 16,
            missed_count: 4,
            switch_count: 1,
            squares_m2,
            false_count,
            ..Score::default()
        }
    }

    #[test]
    fn figures_are_of_all_trials_together() {
        let outcomes = [outcome(run(0.16, 3)), outcome(run(0.48, 0))];
        let summary = Summary::new("t", &outcomes, 1);
        let Figures { rmse_m, missed_share, false_per_frame, switches_per_run, flawless, .. } =
            summary.figures;
        assert!((rmse_m.unwrap().value - (0.64_f64 / 32.0).sqrt()).abs() < 1e-12);
        let near_side_rmse_m = summary.figures.near_side_rmse_m.unwrap().value;
        assert!((near_side_rmse_m - 2.0 * rmse_m.unwrap().value).abs() < 1e-12);
        assert!(summary.figures.smoothed_rmse_m.is_none());
        assert!((missed_share.unwrap().value - 0.2).abs() < 1e-12);
        assert!((false_per_frame.unwrap().value - 0.15).abs() < 1e-12);
        assert!((switches_per_run.unwrap().value - 1.0).abs() < 1e-12);
        assert_eq!((flawless.count, flawless.of), (0, 2));
        assert!((summary.track_us.unwrap() - 3.0).abs() < 1e-9);
        assert!((summary.over_time[0].unfound_share - 0.2).abs() < 1e-12);
        assert!(summary.figures.nees.is_none());
    }

    #[test]
    fn one_trial_has_no_interval() {
        let summary = Summary::new("t", &[outcome(run(0.16, 3))], 1);
        assert_eq!(summary.figures.rmse_m.unwrap().interval, None);
        assert!(Summary::new("t", &[], 1).figures.rmse_m.is_none());
    }

    /// Of 200 experiments of 60 trials each, 95 % hold the true value; the normal interval of that
    /// share is 0.03, and of few trials the bootstrap's interval is a little too short.
    #[test]
    fn the_interval_holds_the_true_value_as_often_as_it_says() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut one = || {
            let size: f64 = StandardNormal.sample(&mut rng);
            outcome(run(16.0 * size * size, 0))
        };
        let mut held_count = 0;
        for experiment in 0..200 {
            let outcomes: Vec<Outcome> = (0..60).map(|_| one()).collect();
            let rmse_m = Summary::new("t", &outcomes, experiment).figures.rmse_m.unwrap();
            let [low, high] = rmse_m.interval.unwrap();
            held_count += u32::from(low <= 1.0 && 1.0 <= high);
        }
        assert!((176..=198).contains(&held_count), "{held_count} of 200");
    }
}
