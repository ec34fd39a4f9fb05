//! How well the published tracker follows the two people of the four experiments.

use nalgebra::Vector2;

use super::*;
use crate::tracking::TrackStatus;
use crate::tracking::experiments::{Experiment, FRAME_COUNT, Stage, middle_m, paper_chain};
use crate::tracking::shift::Weighting;

/// A track farther away than this does not follow a person, metres.
const GATE_M: f64 = 1.0;

/// What became of some runs.
#[derive(Clone, Copy, Debug, Default)]
struct Score {
    run_count: f64,
    square_m2: f64,
    hit_count: f64,
    missed_count: f64,
    false_count: f64,
    switch_count: f64,
    nees: f64,
    /// Squared errors in range, and across over the range, of what is hit.
    polar: [f64; 2],
}

impl Score {
    fn rmse_m(&self) -> f64 {
        (self.square_m2 / self.hit_count.max(1.0)).sqrt()
    }

    /// Counts a track that follows a person.
    fn hit(&mut self, track: &Track, truth_m: &Vector2<f64>) {
        let error_m = middle_m(&Vector2::new(track.state.x, track.state.y)) - truth_m;
        let covariance = track.covariance.fixed_view::<2, 2>(0, 0).into_owned();
        let along = truth_m.normalize();
        self.square_m2 += error_m.norm_squared();
        self.hit_count += 1.0;
        self.nees += error_m.dot(&(covariance.try_inverse().unwrap() * error_m));
        self.polar[0] += error_m.dot(&along).powi(2);
        self.polar[1] += (error_m.perp(&along) / truth_m.norm()).powi(2);
    }

    fn per_frame(&self, count: f64) -> f64 {
        count / (self.run_count * f64::from(FRAME_COUNT - FIRST))
    }
}

/// Frames until a person can be confirmed: more than 12 of the last 20.
const FIRST: u32 = 20;

/// Each person takes the nearest confirmed track that is free, nearer pair first.
fn pairs(tracks: &[&Track], middles_m: &[Vector2<f64>; 2]) -> Vec<(usize, usize, f64)> {
    let mut all = Vec::new();
    for (t, track) in tracks.iter().enumerate() {
        let seen_m = Vector2::new(track.state.x, track.state.y);
        for (p, truth_m) in middles_m.iter().enumerate() {
            all.push((t, p, (middle_m(&seen_m) - truth_m).norm()));
        }
    }
    all.retain(|(_, _, distance_m)| *distance_m < GATE_M);
    all.sort_by(|a, b| a.2.total_cmp(&b.2));
    let mut taken: Vec<(usize, usize, f64)> = Vec::new();
    for pair in all {
        if taken.iter().all(|other| other.0 != pair.0 && other.1 != pair.1) {
            taken.push(pair);
        }
    }
    taken
}

fn runs(stage: &Stage, config: &PaperConfig, seeds: std::ops::Range<u64>) -> Score {
    let mut score = Score::default();
    for seed in seeds {
        let mut tracker = PaperTracker::new(config).unwrap();
        let mut last: [Option<u64>; 2] = [None; 2];
        let watch = |shown: &crate::tracking::experiments::Shown<'_>| {
            let tracks = tracker.track(&shown.frame)?;
            let told: Vec<&Track> =
                tracks.iter().filter(|t| t.status != TrackStatus::Tentative).collect();
            let pairs = pairs(&told, &shown.middles_m);
            for (t, p, _) in &pairs {
                let id = told[*t].id;
                score.switch_count += f64::from(last[*p].is_some_and(|before| before != id));
                last[*p] = Some(id);
            }
            for (t, p, _) in pairs.iter().filter(|_| FIRST <= shown.index) {
                score.hit(told[*t], &shown.middles_m[*p]);
            }
            if FIRST <= shown.index {
                score.missed_count += (2 - pairs.len()) as f64;
                score.false_count += (told.len() - pairs.len()) as f64;
            }
            Ok(())
        };
        stage.play(seed, watch).unwrap();
        score.run_count += 1.0;
    }
    score
}

fn print(name: &str, experiment: Experiment, score: &Score) {
    println!(
        "{name:>28} experiment {}: RMSE {:.3} m ({:.3} m in range, {:.4} rad), missed {:.3}, false {:.3}, switches {:.2}, NEES {:.2}",
        experiment.number(),
        score.rmse_m(),
        (score.polar[0] / score.hit_count.max(1.0)).sqrt(),
        (score.polar[1] / score.hit_count.max(1.0)).sqrt(),
        score.per_frame(score.missed_count),
        score.per_frame(score.false_count),
        score.switch_count / score.run_count,
        score.nees / score.hit_count.max(1.0),
    );
}

fn stage(experiment: Experiment) -> Stage {
    Stage::new(experiment, &paper_chain()).unwrap()
}

/// The ablation: `W_u = 1`.
fn without_weights() -> PaperConfig {
    PaperConfig { weighting: Weighting::Even, ..PaperConfig::default() }
}

#[test]
fn the_experiments_end_about_as_the_paper_mode_can() {
    // Seeds that no setting was chosen on. Two runs scatter widely: bounds are 1.5 times the RMSE in
    // m, and 3 times the missed and false people per frame, of six.
    let bounds = [[0.42, 0.3, 0.55], [0.45, 0.3, 0.4], [0.42, 1.5, 1.1], [0.38, 0.4, 0.6]];
    for (experiment, [rmse_m, missed, more]) in Experiment::all().into_iter().zip(bounds) {
        let score = runs(&stage(experiment), &PaperConfig::default(), 11..13);
        print("paper", experiment, &score);
        assert!(score.rmse_m() < rmse_m);
        assert!(score.per_frame(score.missed_count) < missed);
        assert!(score.per_frame(score.false_count) < more);
    }
}

#[test]
fn without_weights_it_is_twice_as_bad() {
    // At 25 dB: at 15 dB noise and fading rule the errors of both.
    for experiment in &Experiment::all()[..2] {
        let stage = stage(*experiment).at_snr_db(25.0);
        let [with, without] =
            [PaperConfig::default(), without_weights()].map(|c| runs(&stage, &c, 11..13));
        print("paper", *experiment, &with);
        print("without W_u", *experiment, &without);
        assert!(2.0 * with.rmse_m().powi(2) < without.rmse_m().powi(2));
        let wrong = |score: &Score| score.missed_count + score.false_count;
        assert!(2.0 * wrong(&with) < wrong(&without));
    }
}

#[test]
#[ignore = "minutes: the table of the experiments, with and without W_u"]
fn study_experiments() {
    for snr_db in [15.0, 25.0] {
        for (name, config) in
            [("paper", PaperConfig::default()), ("without W_u", without_weights())]
        {
            for experiment in Experiment::all() {
                let score = runs(&stage(experiment).at_snr_db(snr_db), &config, 11..17);
                print(&format!("{name} {snr_db} dB"), experiment, &score);
            }
        }
    }
}
