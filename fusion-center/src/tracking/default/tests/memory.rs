//! What a tracker holds over many looks, and that no state that it lets out is without a number.

use super::super::{DefaultConfig, DefaultTracker};
use super::load_tests::roads;
use super::scenes::four_targets;
use super::score::run;
use crate::tracking::{Look, Tracker};

/// Looks after which the convoys begin anew: memory is compared at the same look of a round.
const ROUND: usize = 30;

/// What a tracker holds more after each of `part_count` parts of `round_count` rounds than before the
/// first, bytes; one more part goes before.
fn held(part_count: usize, round_count: usize) -> Vec<i64> {
    let scene = roads(60, 3);
    assert_eq!(scene.looks.len(), ROUND);
    let span_s = 150.0;
    let mut tracker = DefaultTracker::new(DefaultConfig::wide_area()).unwrap();
    let mut settled = Vec::new();
    let mut go_on = |part: usize| {
        for index in part * round_count * ROUND..(part + 1) * round_count * ROUND {
            let taken = &scene.looks[index % ROUND];
            let time_s = taken.time_s + span_s * (index / ROUND) as f64;
            tracker.look(&Look { time_s, ..taken.look(index) }).unwrap();
            settled.clear();
            tracker.take_settled(&mut settled);
        }
    };
    go_on(0);
    let mut sum = 0;
    let mut more = |part| {
        sum += allocation_counter::measure(|| go_on(part)).bytes_current;
        sum
    };
    (1..=part_count).map(&mut more).collect()
}

/// The load repeats, so that after the rounds in which lists reach their size nothing is added.
#[test]
fn memory_is_flat() {
    let more = held(10, 1);
    assert!(more[4..].iter().all(|bytes| *bytes <= more[3]), "{more:?}");
}

#[test]
#[ignore = "minutes: 99,900 looks"]
fn study_memory() {
    let more = held(9, 333);
    println!("bytes more after each 9,990 looks: {more:?}");
    assert!(more.iter().all(|bytes| *bytes <= 0), "{more:?}");
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
