//! The experiment indoors, small.

use super::*;

fn experiment(words: &str) -> anyhow::Result<Experiment> {
    #[derive(clap::Parser)]
    struct Line {
        #[command(flatten)]
        flags: Flags,
    }
    let words = ["indoors"].into_iter().chain(words.split_whitespace());
    Experiment::new(&<Line as clap::Parser>::try_parse_from(words)?.flags)
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
    let report = experiment("--trials 3 --seed 5").unwrap().run(&CancellationToken::new()).unwrap();
    let figures = &report.figures;
    assert!(figures.rmse_m.unwrap().value < 0.2, "{}", report.table());
    assert!(figures.missed_share.unwrap().value < 0.1, "{}", report.table());
    assert!(figures.false_per_frame.unwrap().value < 0.2, "{}", report.table());
    assert_eq!(report.outcomes.len(), 3);
    assert_eq!(report.bars().len(), 3);
}
