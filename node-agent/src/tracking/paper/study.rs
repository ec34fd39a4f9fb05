//! How well the published tracker follows the two people of the four experiments.

use nalgebra::Vector2;

use super::*;
use crate::tracking::TrackStatus;
use crate::tracking::experiments::{
    Experiment, FRAME_COUNT, HALF_DEPTH_M, Stage, middle_m, paper_chain,
};

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
}

impl Score {
    fn rmse_m(&self) -> f64 {
        (self.square_m2 / self.hit_count.max(1.0)).sqrt()
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

fn runs(experiment: Experiment, config: &PaperConfig, seeds: std::ops::Range<u64>) -> Score {
    let stage = Stage::new(experiment, &paper_chain()).unwrap();
    let mut score = Score::default();
    for seed in seeds {
        let mut tracker = PaperTracker::new(config).unwrap();
        let mut last: [Option<u64>; 2] = [None; 2];
        let watch = |shown: &crate::tracking::experiments::Shown<'_>| {
            let tracks = tracker.track(&shown.frame)?;
            let told: Vec<&Track> =
                tracks.iter().filter(|t| t.status != TrackStatus::Tentative).collect();
            let pairs = pairs(&told, &shown.middles_m);
            for (t, p, distance_m) in &pairs {
                let id = told[*t].id;
                score.switch_count += f64::from(last[*p].is_some_and(|before| before != id));
                last[*p] = Some(id);
                if FIRST <= shown.index {
                    score.square_m2 += distance_m * distance_m;
                    score.hit_count += 1.0;
                    let seen_m = Vector2::new(told[*t].state.x, told[*t].state.y);
                    let error_m = middle_m(&seen_m) - shown.middles_m[*p];
                    let covariance = told[*t].covariance.fixed_view::<2, 2>(0, 0).into_owned();
                    score.nees += error_m.dot(&(covariance.try_inverse().unwrap() * error_m));
                }
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
    assert!(HALF_DEPTH_M < GATE_M);
    score
}

fn print(name: &str, experiment: Experiment, score: &Score) {
    println!(
        "{name:>28} experiment {}: RMSE {:.3} m, missed {:.3}, false {:.3}, switches {:.2}, NEES {:.2}",
        experiment.number(),
        score.rmse_m(),
        score.per_frame(score.missed_count),
        score.per_frame(score.false_count),
        score.switch_count / score.run_count,
        score.nees / score.hit_count.max(1.0),
    );
}

#[test]
#[ignore = "minutes: the settings"]
fn study_settings() {
    let plain = PaperConfig::default();
    let mut settings = vec![("default".to_owned(), plain)];
    for noise_factor in [2.0, 3.0] {
        for floor_factor in [0.5, 1.0, 1.5, 2.0] {
            let config = PaperConfig { noise_factor, floor_factor, ..plain };
            settings.push((format!("noise {noise_factor} floor {floor_factor}"), config));
        }
    }
    for (name, config) in settings {
        for experiment in Experiment::all() {
            print(&name, experiment, &runs(experiment, &config, 1..4));
        }
    }
}

#[test]
#[ignore = "seconds: what noise looks like in these images"]
fn study_noise() {
    let stage = Stage::new(Experiment::all()[0], &paper_chain()).unwrap();
    let look = |shown: &crate::tracking::experiments::Shown<'_>| {
        if shown.index % 20 == 0 {
            let mut values = shown.frame.amplitude.to_vec();
            values.sort_by(f32::total_cmp);
            let noise = shown.frame.noise_amplitude;
            let at = |share: f64| {
                let index = (share * (values.len() - 1) as f64) as usize;
                values[index] / noise
            };
            println!(
                "noise {noise:.4}: quantiles over it .5 {:.3} .9 {:.3} .95 {:.3} .99 {:.3} .999 {:.3} 1 {:.3}",
                at(0.5),
                at(0.9),
                at(0.95),
                at(0.99),
                at(0.999),
                at(1.0)
            );
        }
        Ok(())
    };
    stage.play(1, look).unwrap();
}
