//! Tests of whole experiments.

use super::super::study::words::{asked, reported};
use super::super::{Results, carry_out};
use super::summary::Figures;
use super::*;

fn experiment(words: &str) -> anyhow::Result<Experiment> {
    asked(words)
}

fn report(words: &str) -> Report {
    reported::<Experiment>(words)
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

/// RMSE in metres, missed share, false per frame, switches per run.
fn four(report: &Report, number: usize, tracker: &str) -> [f64; 4] {
    let Figures { rmse_m, missed_share, false_per_frame, switches_per_run, .. } =
        figures(report, number, tracker);
    [rmse_m, missed_share, false_per_frame, switches_per_run].map(|figure| figure.unwrap().value)
}

fn assert_within(got: [f64; 4], most: [f64; 4], tracker: &str) {
    let is_within = got.iter().zip(most).all(|(got, most)| *got <= most);
    assert!(is_within, "{tracker}: {got:?}, at most {most:?}");
}

/// The same to the last digit on any number of threads. The bounds are about half again what these
/// two trials gave: default 0.103 m, 0.004, 0.007, 0; centroid 0.172 m, 0.081, 0.15, 2; paper
/// 0.244 m, 0.17, 13.8, 12.5.
#[test]
fn two_trials_are_as_good_as_measured_and_the_same_whatever_the_threads() {
    let words = "--experiment 1 --trials 2 --trackers centroid,default,paper --seed 9";
    let on = |thread_count: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(thread_count).build().unwrap();
        pool.install(|| report(words))
    };
    let (one, three) = (on(1), on(3));
    assert_within(four(&one, 1, "default"), [0.15, 0.03, 0.05, 0.5], "default");
    assert_within(four(&one, 1, "centroid"), [0.26, 0.13, 0.25, 4.0], "centroid");
    assert_within(four(&one, 1, "paper"), [0.36, 0.26, 21.0, 19.0], "paper");
    let tracker_names: Vec<_> =
        one.experiments[0].trackers.iter().map(|one| one.summary.tracker).collect();
    assert_eq!(tracker_names, ["centroid", "default", "paper"], "in the order asked for");
    assert_eq!(one.bars().len(), 1);
    assert_eq!(timeless(one), timeless(three));
}

/// Measured: 0.240 m and 11.7 false per frame with, 0.277 m and 26.6 without.
#[test]
fn without_its_weights_the_papers_tracker_is_worse() {
    let report =
        report("--experiment 2 --trials 2 --trackers paper,paper-without-weights --seed 9");
    let [rmse_m, _, false_per_frame, _] = four(&report, 2, "paper");
    let [even_rmse_m, _, even_false_per_frame, _] = four(&report, 2, "paper-without-weights");
    // Which of the two it costs depends on the settings of the tracker.
    let is_worse = rmse_m < even_rmse_m || 1.5 * false_per_frame < even_false_per_frame;
    assert!(is_worse, "{rmse_m} {even_rmse_m} {false_per_frame} {even_false_per_frame}");
    assert!(report.bars().is_empty(), "the bars are the default tracker's");
}

#[test]
fn the_report_is_written_as_json_svg_and_png() {
    let folder = tempfile::tempdir().unwrap();
    let experiment = experiment("--experiment 4 --trials 1 --trackers centroid --seed 3").unwrap();
    let report = carry_out(&experiment, folder.path(), &CancellationToken::new()).unwrap();
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    let document: serde_json::Value = serde_json::from_slice(&read("montecarlo.json")).unwrap();
    let centroid = &document["experiments"][0]["trackers"][0];
    assert_eq!(centroid["tracker"], "centroid");
    assert_eq!(centroid["over_time"].as_array().unwrap().len(), 140);
    assert_eq!(centroid["trials"][0]["frame_count"], 140);
    let rmse_m = centroid["figures"]["rmse_m"]["value"].as_f64().unwrap();
    assert!(0.01 < rmse_m && rmse_m < 0.5, "{rmse_m}");
    let svg = String::from_utf8(read("experiment-4.svg")).unwrap();
    assert!(svg.contains("RMS error") && svg.contains("paths of the first trial"));
    assert!(read("experiment-4.png").starts_with(b"\x89PNG"));
    assert!(report.table().contains("GOSPA: p 2, alpha 2, c 1 m"));
    let broken = carry_out(&experiment, &folder.path().join("none"), &CancellationToken::new());
    assert!(broken.err().unwrap().to_string().contains("montecarlo.json"));
}

#[test]
#[ignore = "minutes: all experiments and trackers, for the figures of the report"]
fn study_of_all_experiments() {
    for gate in ["0.5", "1"] {
        println!("{}", report(&format!("--trials 100 --gate-m {gate}")).table());
    }
}
