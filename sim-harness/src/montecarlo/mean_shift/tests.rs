//! Tests of whole experiments.

use clap::Parser;

use super::summary::Figures;
use super::*;

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    flags: Flags,
}

fn experiment(words: &str) -> anyhow::Result<Experiment> {
    let words = std::iter::once("mean-shift").chain(words.split_whitespace());
    Experiment::new(&Line::try_parse_from(words)?.flags)
}

fn report(words: &str) -> Report {
    experiment(words).unwrap().run(&CancellationToken::new()).unwrap()
}

/// The report without what differs from run to run.
fn timeless(mut report: Report) -> String {
    report.elapsed_s = 0.0;
    for result in &mut report.experiments {
        result.took_s = 0.0;
        result.trackers.iter_mut().for_each(|one| one.summary.track_us = None);
    }
    report.json().unwrap()
}

fn figures<'a>(report: &'a Report, number: usize, tracker: &str) -> &'a Figures {
    let result = report.experiments.iter().find(|result| result.number == number).unwrap();
    let one = result.trackers.iter().find(|one| one.summary.tracker == tracker).unwrap();
    &one.summary.figures
}

#[test]
fn nonsense_is_named_with_its_remedy() {
    let complaint = |words: &str| format!("{:#}", experiment(words).err().unwrap());
    assert!(complaint("--trials 0").contains("--trials is 0: use 1 to"));
    assert!(complaint("--trackers magic").contains("paper-without-weights"));
    assert!(complaint("--experiment 5").contains("all"));
    assert!(complaint("--gate-m -1").contains("gate_m"), "{}", complaint("--gate-m -1"));
    let twice = experiment("--experiment 3,1,3 --trackers centroid").unwrap();
    assert_eq!(twice.name(), "mean-shift-13");
}

#[test]
fn a_stopped_experiment_says_so() {
    let stop = CancellationToken::new();
    stop.cancel();
    let error = experiment("--trials 2 --trackers centroid").unwrap().run(&stop).err().unwrap();
    assert!(error.to_string().contains("stopped"));
}

#[test]
fn trials_and_experiments_have_seeds_of_their_own() {
    let all = Scene::all();
    let seeds = [
        trial_seed(1, all[0], 0),
        trial_seed(1, all[0], 1),
        trial_seed(1, all[1], 0),
        trial_seed(2, all[0], 0),
    ];
    let distinct: std::collections::BTreeSet<u64> = seeds.into_iter().collect();
    assert_eq!(distinct.len(), 4);
}
