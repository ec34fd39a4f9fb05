//! The published comparison: right links, identity and error of the three methods in paired runs.

use std::cmp::Ordering;
use std::ops::Range;

use super::scene::{Lie, Outcome, follow, scans};
use crate::tracking::Plot;
use crate::tracking::links::Links;
use crate::tracking::paper::{BeliefDecision, Mode, PaperConfig};

const VARIANCES_M2: [f64; 4] = [100.0, 400.0, 900.0, 3300.0];
/// The order reproduces in at least this share of the runs.
const LEAST_WIN_SHARE: f64 = 0.9;

struct Runs {
    lie: Lie,
    scans: Vec<Vec<(f64, Vec<Plot>)>>,
}

fn runs(lie: Lie, variance_m2: f64, seeds: Range<u64>) -> Runs {
    Runs { lie, scans: seeds.map(|seed| scans(lie, variance_m2, seed)).collect() }
}

fn outcomes(mode: Mode, config: &PaperConfig, runs: &Runs) -> Vec<Outcome> {
    runs.scans.iter().map(|scans| follow((mode, config), (runs.lie, scans))).collect()
}

/// Runs in which the first has a larger, the same, a smaller right-link rate.
fn wins(one: &[Outcome], other: &[Outcome]) -> [usize; 3] {
    let mut counts = [0; 3];
    let rates = |outcomes: &[Outcome]| -> Vec<f64> {
        outcomes.iter().map(|outcome| outcome.links.right_link_rate().unwrap()).collect()
    };
    for (of_one, of_other) in rates(one).iter().zip(rates(other)) {
        counts[match of_one.total_cmp(&of_other) {
            Ordering::Greater => 0,
            Ordering::Equal => 1,
            Ordering::Less => 2,
        }] += 1;
    }
    counts
}

/// Right links and identity, percent, and error, metres.
fn figures(outcomes: &[Outcome]) -> [f64; 3] {
    let sum: Links = outcomes.iter().map(|outcome| outcome.links).sum();
    let square_m2: f64 = outcomes.iter().map(|outcome| outcome.square_error_m2).sum();
    let percent = |rate: Option<f64>| 100.0 * rate.unwrap();
    let rmse_m = (square_m2 / outcomes.len() as f64).sqrt();
    [percent(sum.right_link_rate()), percent(sum.identity_rate()), rmse_m]
}

#[test]
fn the_published_order_reproduces() {
    let config = PaperConfig::published_links();
    for variance_m2 in VARIANCES_M2 {
        let runs = runs(Lie::Along, variance_m2, 2000..2200);
        let paper = outcomes(Mode::Paper, &config, &runs);
        for rival in [Mode::Nearest, Mode::Belief] {
            let [won, same, lost] = wins(&paper, &outcomes(rival, &config, &runs));
            let share = won as f64 / (won + same + lost) as f64;
            assert!(LEAST_WIN_SHARE <= share, "{rival:?} {variance_m2}: {won}/{same}/{lost}");
        }
    }
}

#[test]
fn the_figures_are_near_those_of_the_prototypes() {
    // Right links and identity, percent, as measured with prototypes: 500 runs of their scene. Bounds: four
    // standard deviations of 300 runs, and what scenes differ.
    let table = [
        (Mode::Paper, [[99.75, 97.6], [94.1, 78.2], [87.4, 73.0], [79.2, 62.5]], [1.5, 4.0]),
        (Mode::Nearest, [[97.1, 76.3], [87.9, 65.9], [81.7, 59.4], [72.6, 45.2]], [2.5, 4.0]),
        (Mode::Belief, [[91.0, 45.9], [83.7, 45.2], [77.8, 44.3], [68.2, 38.7]], [4.0, 9.0]),
    ];
    for (mode, rows, bounds) in table {
        for (variance_m2, row) in VARIANCES_M2.into_iter().zip(rows) {
            let runs = runs(Lie::Along, variance_m2, 1000..1300);
            let found = figures(&outcomes(mode, &PaperConfig::published_tracks(), &runs));
            for ((got, want), bound) in found.iter().zip(row).zip(bounds) {
                assert!((got - want).abs() < bound, "{mode:?} {variance_m2}: {got} {want}");
            }
        }
    }
}

/// `cargo test --release -p fusion-center --lib tracking::paper::tests::study -- --ignored --nocapture`
#[test]
#[ignore = "half a minute: prints the published comparison over 500 runs"]
fn study_four_targets() {
    let mut exclusive = PaperConfig::published_tracks();
    exclusive.belief.decision = BeliefDecision::Exclusive;
    let plain = PaperConfig::published_tracks();
    let methods = [
        ("paper", Mode::Paper, plain),
        ("nearest", Mode::Nearest, plain),
        ("belief", Mode::Belief, plain),
        ("belief, exclusive", Mode::Belief, exclusive),
    ];
    println!(
        "right links %, identity %, smoothed RMSE m | links of all plots %, paper won/same/lost"
    );
    let scenes = VARIANCES_M2.map(|variance_m2| (Lie::Along, variance_m2));
    for (lie, variance_m2) in scenes.into_iter().chain([(Lie::Across, 400.0)]) {
        println!("variance {variance_m2} m², {lie:?}");
        let runs = runs(lie, variance_m2, 0..500);
        let paper = outcomes(Mode::Paper, &PaperConfig::published_links(), &runs);
        for (name, mode, config) in methods {
            let [link, identity, rmse_m] = figures(&outcomes(mode, &config, &runs));
            let of_links = PaperConfig { belief: config.belief, ..PaperConfig::published_links() };
            let of_all = outcomes(mode, &of_links, &runs);
            let [won, same, lost] = wins(&paper, &of_all);
            let all = figures(&of_all)[0];
            println!(
                "{name:18} {link:6.2} {identity:6.1} {rmse_m:6.1} | {all:6.2} {won}/{same}/{lost}"
            );
        }
    }
}
