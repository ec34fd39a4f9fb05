//! What a tracker holds over many looks, and that no state that it lets out is without a number.

use super::super::{DefaultConfig, DefaultTracker};
use super::load_tests::roads;
use super::scenes::four_targets;
use super::score::run;
use crate::tracking::{Look, Tracker};

/// What a tracker may hold more after the second half of many looks than after the first, bytes: by
/// chance more is open at one end than at the other. A hundredth of what it holds.
const MOST_MORE: i64 = 50_000;

/// What a tracker holds more after the second half of `look_count` looks, bytes: convoys that begin anew
/// every 30 looks.
fn grown(look_count: usize) -> i64 {
    let scene = roads(60, 3);
    let span_s = 150.0;
    let mut tracker = DefaultTracker::new(DefaultConfig::wide_area()).unwrap();
    let mut settled = Vec::new();
    let mut go_on = |looks: std::ops::Range<usize>| {
        for index in looks {
            let taken = &scene.looks[index % scene.looks.len()];
            let time_s = taken.time_s + span_s * (index / scene.looks.len()) as f64;
            tracker.look(&Look { time_s, ..taken.look(index) }).unwrap();
            settled.clear();
            tracker.take_settled(&mut settled);
        }
    };
    go_on(0..look_count / 2);
    allocation_counter::measure(|| go_on(look_count / 2..look_count)).bytes_current
}

#[test]
fn memory_is_flat() {
    let more = grown(1200);
    assert!(more <= MOST_MORE, "{more}");
}

#[test]
#[ignore = "minutes: 100,000 looks"]
fn study_memory() {
    let more = grown(100_000);
    println!("{more} bytes more after the second 50,000 looks");
    assert!(more <= MOST_MORE, "{more}");
}

/// Errors of 57 m at targets 50 m apart, one plot in eight lost, standing targets not seen.
#[test]
fn every_number_is_finite() {
    for seed in 0..40 {
        let mut scene = four_targets(3300.0, 0.0, seed);
        for (index, look) in scene.looks.iter_mut().enumerate() {
            look.coverage.minimum_detectable_m_per_s = Some(0.05);
            if index % 2 == 1 {
                look.plots.pop();
            }
        }
        for step in run(&scene, &DefaultConfig::wide_area()) {
            let means = step.state.iter().chain(&step.smoothed_state);
            let spreads = step.covariance.iter().chain(&step.smoothed_covariance);
            assert!(means.chain(spreads).all(|value| value.is_finite()), "{seed}: {step:?}");
            let least = step.smoothed_covariance.symmetric_eigenvalues().min();
            assert!(0.0 < least, "{seed}: {step:?}");
        }
    }
}
