//! How good tracks are against the truth.

use std::collections::BTreeMap;

use super::super::{DefaultConfig, DefaultTracker};
use super::scenes::Scene;
use crate::tracking::{Settled, Status, Tracker};

/// Counts and sums over one or many runs.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Score {
    pub(super) links: usize,
    pub(super) right_links: usize,
    /// Of them, those to or from false plots.
    pub(super) clutter_links: usize,
    pub(super) updates: usize,
    pub(super) own_updates: usize,
    pub(super) square_error_m2: f64,
    pub(super) filtered_square_error_m2: f64,
    pub(super) error_count: usize,
    pub(super) nees: f64,
    pub(super) smoothed_nees: f64,
    pub(super) tracks: usize,
    pub(super) majority: usize,
}

impl Score {
    pub(super) fn add(&mut self, other: &Self) {
        self.links += other.links;
        self.right_links += other.right_links;
        self.clutter_links += other.clutter_links;
        self.updates += other.updates;
        self.own_updates += other.own_updates;
        self.square_error_m2 += other.square_error_m2;
        self.filtered_square_error_m2 += other.filtered_square_error_m2;
        self.error_count += other.error_count;
        self.nees += other.nees;
        self.smoothed_nees += other.smoothed_nees;
        self.tracks += other.tracks;
        self.majority += other.majority;
    }

    pub(super) fn link_rate(&self) -> f64 {
        self.right_links as f64 / self.links.max(1) as f64
    }

    pub(super) fn identity_rate(&self) -> f64 {
        self.own_updates as f64 / self.updates.max(1) as f64
    }

    pub(super) fn purity(&self) -> f64 {
        self.majority as f64 / self.updates.max(1) as f64
    }

    pub(super) fn rmse_m(&self) -> f64 {
        (self.square_error_m2 / self.error_count.max(1) as f64).sqrt()
    }

    pub(super) fn filtered_rmse_m(&self) -> f64 {
        (self.filtered_square_error_m2 / self.error_count.max(1) as f64).sqrt()
    }

    /// Per dimension.
    pub(super) fn nees(&self) -> f64 {
        self.nees / (4 * self.error_count.max(1)) as f64
    }

    pub(super) fn smoothed_nees(&self) -> f64 {
        self.smoothed_nees / (4 * self.error_count.max(1)) as f64
    }
}

/// All steps of all tracks of a run.
pub(super) fn run(scene: &Scene, config: &DefaultConfig) -> Vec<Settled> {
    let mut tracker = DefaultTracker::new(config.clone()).unwrap();
    let mut settled = Vec::new();
    for (index, taken) in scene.looks.iter().enumerate() {
        tracker.look(&taken.look(index)).unwrap();
        tracker.take_settled(&mut settled);
    }
    tracker.finish();
    tracker.take_settled(&mut settled);
    settled
}

/// What is right among `settled` looks at `scene`. A track is of the target that most of its first
/// four plots are of.
pub(super) fn score(scene: &Scene, settled: &[Settled]) -> Score {
    let mut tracks: BTreeMap<u64, Vec<&Settled>> = BTreeMap::new();
    for step in settled {
        tracks.entry(step.track).or_default().push(step);
    }
    let mut score = Score::default();
    for steps in tracks.values() {
        if steps.iter().all(|step| step.status == Status::Tentative) {
            continue;
        }
        score.tracks += 1;
        one(scene, steps, &mut score);
    }
    score
}

fn most(values: impl Iterator<Item = usize>) -> Option<(usize, usize)> {
    let mut counts: BTreeMap<usize, usize> = BTreeMap::new();
    values.for_each(|value| *counts.entry(value).or_default() += 1);
    counts.into_iter().max_by_key(|(value, count)| (*count, usize::MAX - value))
}

fn one(scene: &Scene, steps: &[&Settled], score: &mut Score) {
    let truth_of = |step: &Settled| {
        step.report.map(|report| {
            let look = &scene.looks[usize::try_from(report.look_index).unwrap()];
            look.truths[report.report_index as usize]
        })
    };
    let truths: Vec<Option<usize>> = steps.iter().filter_map(|step| truth_of(step)).collect();
    for pair in truths.windows(2) {
        score.links += 1;
        score.right_links += usize::from(pair[0].is_some() && pair[0] == pair[1]);
        score.clutter_links += usize::from(pair[0].is_none() || pair[1].is_none());
    }
    let own = most(truths.iter().take(4).filter_map(|truth| *truth)).map(|(target, _)| target);
    score.updates += truths.len();
    score.own_updates += truths.iter().filter(|truth| own.is_some() && **truth == own).count();
    score.majority += most(truths.iter().filter_map(|truth| *truth)).map_or(0, |(_, count)| count);
    let Some(own) = own else { return };
    for step in steps {
        let at = scene.looks.iter().position(|look| (look.time_s - step.time_s).abs() < 1e-9);
        let truth = nalgebra::Vector4::from(scene.truth[at.unwrap()][own]);
        let (off, better) = (step.state - truth, step.smoothed_state - truth);
        score.error_count += 1;
        score.filtered_square_error_m2 += off.fixed_rows::<2>(0).norm_squared();
        score.square_error_m2 += better.fixed_rows::<2>(0).norm_squared();
        score.nees += off.dot(&(step.covariance.try_inverse().unwrap() * off));
        let inverse = step.smoothed_covariance.try_inverse().unwrap();
        score.smoothed_nees += better.dot(&(inverse * better));
    }
}
