//! The experiment indoors, small.

use super::super::Results;
use super::super::study::words::{asked, reported};
use super::*;

fn experiment(words: &str) -> anyhow::Result<Experiment> {
    asked(words)
}

#[test]
fn what_makes_no_sense_is_named() {
    for (words, named) in [
        ("--trials 0", "--trials"),
        ("--gate-m 0", "gate_m"),
        ("recorded", "recording"),
        ("nowhere", "nowhere"),
    ] {
        let refused = experiment(words).err().unwrap();
        assert!(format!("{refused:#}").contains(named), "{words}: {refused:#}");
    }
}

/// Three people, four nodes: each is followed by one track, near where they are.
#[test]
fn the_centre_follows_everybody_in_the_office() {
    let report = reported::<Experiment>("--trials 3 --seed 5");
    let figures = &report.figures;
    assert!(figures.rmse_m.unwrap().value < 0.2, "{}", report.table());
    assert!(figures.missed_share.unwrap().value < 0.1, "{}", report.table());
    assert!(figures.false_per_frame.unwrap().value < 0.2, "{}", report.table());
    assert_eq!(report.outcomes.len(), 3);
    assert_eq!(report.bars().len(), 3);
}
