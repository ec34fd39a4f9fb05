//! Tests of whole experiments.

use tokio_util::sync::CancellationToken;

use super::study::words::{asked, reported};
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
    for result in &mut report.conditions {
        result.simulate_s = 0.0;
        result.methods.iter_mut().for_each(|method| method.solve_ms = None);
    }
    report.json().unwrap()
}

fn method<'a>(result: &'a ConditionResult, name: &str) -> &'a MethodScore {
    result.methods.iter().find(|method| method.method == name).unwrap()
}

#[test]
fn nonsense_is_named_with_its_remedy() {
    let complaint = |words: &str| format!("{:#}", experiment(words).err().unwrap());
    assert!(complaint("fig6 --trials 0").contains("--trials is 0: use 1 to"));
    assert!(complaint("fig6 --solvers magic").contains("default, swarm"));
    assert!(complaint("fig10 --level points").contains("--level echoes"));
    assert!(complaint("fig6 --scenario paper").contains("--level echoes"));
    assert!(complaint("fig6 --level echoes --scenario atlantis").contains("paper, "));
    assert!(complaint("fig8").contains("fig10"));
    let four = experiment("fig6 --level echoes --scenario office --trials 1").unwrap();
    let stopped = four.run(&CancellationToken::new()).err().unwrap();
    assert!(format!("{stopped:#}").contains("4 nodes"), "{stopped:#}");
}

#[test]
fn a_stopped_experiment_says_so() {
    let stop = CancellationToken::new();
    stop.cancel();
    let error = experiment("fig6 --trials 3 --solvers default").unwrap().run(&stop).err().unwrap();
    assert!(error.to_string().contains("stopped"));
}

/// What must hold at the level of points under one condition of figure 6.
struct PointBar {
    least_in_box: f64,
    /// Of the pairwise bound: trajectories know more than pairs.
    most_over_bound: f64,
}

/// In the order of the conditions.
const POINT_BARS: [PointBar; 3] = [
    PointBar { least_in_box: 0.995, most_over_bound: 1.0 },
    PointBar { least_in_box: 0.99, most_over_bound: 0.85 },
    PointBar { least_in_box: 0.985, most_over_bound: 0.90 },
];
/// Mean squared normalised error of three unknowns, 3 if the covariance is true.
const NEES: std::ops::RangeInclusive<f64> = 2.6..=3.45;
/// Fewer than one in a hundred may be called ambiguous or underdetermined.
const LEAST_DETERMINED: f64 = 0.99;

/// With 2,000 trials one standard deviation of a share of 0.99 is 0.002, of a ratio of errors 0.016,
/// of a mean squared normalised error 0.055.
#[test]
fn figure_6_from_points_meets_its_bars() {
    let report = report("fig6 --trials 2000 --solvers default --seed 20261122");
    assert_eq!(report.conditions.len(), POINT_BARS.len());
    for (result, bar) in report.conditions.iter().zip(POINT_BARS) {
        let (ours, label) = (method(result, "default"), result.condition.label);
        assert!(bar.least_in_box <= ours.in_box.share, "{label}: {:?}", ours.in_box);
        assert!(
            LEAST_DETERMINED < ours.determined.unwrap().share,
            "{label}: {:?}",
            ours.determined
        );
        assert_eq!(ours.gross_of_determined.unwrap().count, 0, "{label}");
        let [position, heading] = ours.rmse_over_bound.unwrap();
        let over_bound = position.max(heading);
        assert!(over_bound <= bar.most_over_bound, "{label}: {position} {heading}");
        let nees = ours.mean_normalised_error.unwrap();
        assert!(NEES.contains(&nees), "{label}: {nees}");
        let bound = method(result, "bound");
        assert_eq!(bound.in_box.of, 10 * ours.in_box.of);
        // Errors of an efficient estimator: their mean square error is the bound's own.
        assert!(bound.position_m.p95 <= ours.position_m.p95.map(|p95| 1.25 * p95));
    }
    assert!(report.table().contains("published: swarm J = 500"));
    assert!(report.bars().is_empty(), "points have no bar");
}

#[test]
fn the_swarm_is_in_figure_6_and_is_worse_with_fewer_particles() {
    let names = "default,swarm:60,swarm:3";
    let report = report(&format!("fig7 --trials 6 --solvers {names}"));
    let share = |name| method(&report.conditions[0], name).in_box.share;
    assert!(share("swarm:3") < share("swarm:60"), "{} {}", share("swarm:3"), share("swarm:60"));
}

#[test]
fn echoes_give_the_papers_box_and_the_same_whatever_the_threads() {
    let words = "fig6 --level echoes --trials 4 --solvers default --seed 7";
    let on = |thread_count: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(thread_count).build().unwrap();
        pool.install(|| report(words))
    };
    let (one, three) = (on(1), on(3));
    for result in &one.conditions {
        let ours = method(result, "default");
        assert!(3 <= ours.in_box.count, "{}: {:?}", result.condition.label, ours.in_box);
        // A target in five missed: 1.6 of two seen, give or take 0.1 in 64 sets.
        let expected = 2.0 * result.condition.detection_probability;
        for seen in result.points_per_period {
            assert!((seen - expected).abs() < 0.45, "{}: {seen}", result.condition.label);
        }
        assert!(method(result, "bound").in_box.share > 0.85);
    }
    assert_eq!(one.bars().len(), 3);
    assert_eq!(timeless(one), timeless(three));
}

#[test]
fn the_report_is_written_as_json_svg_and_png() {
    let folder = tempfile::tempdir().unwrap();
    let experiment = experiment("fig7 --trials 20 --solvers default --seed 3").unwrap();
    let report = carry_out(&experiment, folder.path(), &CancellationToken::new()).unwrap();
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    let document: serde_json::Value = serde_json::from_slice(&read("montecarlo.json")).unwrap();
    assert_eq!(document["figure"], "fig7");
    assert_eq!(document["conditions"][0]["methods"][1]["trials"].as_array().unwrap().len(), 20);
    assert_eq!(document["bars"].as_array().unwrap().len(), report.bars().len());
    let svg = String::from_utf8(read("errors.svg")).unwrap();
    assert!(svg.contains("Cramer-Rao bound") && svg.contains("position error"));
    assert!(read("errors.png").starts_with(b"\x89PNG"));
    let broken = carry_out(&experiment, &folder.path().join("none"), &CancellationToken::new());
    assert!(broken.err().unwrap().to_string().contains("montecarlo.json"));
}

#[test]
#[ignore = "minutes: the bars of the echo level, 500 trials per condition"]
fn study_of_the_bars_of_echoes() {
    for words in [
        "fig6 --level echoes --trials 500 --solvers default --seed 20261122",
        "fig6 --level echoes --scenario paper-physical --trials 500 --solvers default --seed 20261122",
    ] {
        let report = report(words);
        println!("{}", report.table());
        for bar in report.bars() {
            assert!(bar.is_met, "{}", bar.text);
        }
    }
}

#[test]
#[ignore = "minutes: every figure at both levels, for the figures of the report"]
fn study_of_all_figures() {
    for words in [
        "fig6 --trials 500 --solvers default",
        "fig6 --level echoes --trials 100 --solvers default",
        "fig6 --level echoes --scenario paper-physical --trials 100 --solvers default",
        "fig10 --solvers default",
    ] {
        println!("{}", report(words).table());
    }
}
