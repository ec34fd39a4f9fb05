//! Statistical acceptance of the other solvers on the paper's scene: swarm, graph matching, L2.

use std::fmt;

use super::{
    DecisionConfig, Graph, GraphConfig, L2, L2Config, Outcome, Solution, Solver, Swarm, SwarmConfig,
};
use crate::simulate::{Conditions, Trial, large_room, office, trial};

/// Seeds of these trials, apart from those of other studies.
const FIRST_SEED: u64 = 20_000;

/// Beyond this position error, metres, a pose is no noisy version of the true one.
const GROSS_M: f64 = 0.5;

const CONDITIONS: [(&str, Conditions); 3] = [
    ("clean", Conditions::CLEAN),
    ("misses", Conditions::MISSES),
    ("false", Conditions::WITH_FALSE_POINTS),
];

/// What some trials gave; shares of all trials.
#[derive(Default)]
struct Tally {
    in_box: f64,
    gross: f64,
    determined: f64,
    /// Determined, but grossly wrong.
    wrong: usize,
    /// Root mean square position error over that of the bound, of poses not grossly wrong.
    rmse_over_bound: f64,
    /// Of determined poses, and of all that are not grossly wrong.
    nees: f64,
    nees_median: f64,
    time_ms: f64,
}

impl fmt::Display for Tally {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "box {:.3} gross {:.3} determined {:.3} wrong {} rmse/crlb {:.2} nees {:.2} median \
             {:.2} {:.2} ms",
            self.in_box,
            self.gross,
            self.determined,
            self.wrong,
            self.rmse_over_bound,
            self.nees,
            self.nees_median,
            self.time_ms
        )
    }
}

#[expect(clippy::disallowed_methods, reason = "the study reports times")]
fn timed(solver: &dyn Solver, case: &Trial) -> (Solution, f64) {
    let start = std::time::Instant::now();
    let solution = solver.solve(&case.problem, None);
    (solution, start.elapsed().as_secs_f64() * 1e3)
}

fn tally(solver: &dyn Solver, conditions: &Conditions, count: u64) -> Tally {
    let mut tally = Tally::default();
    let (mut squares, mut bounds) = (0.0, 0.0);
    let mut nees: Vec<f64> = Vec::new();
    let mut times: Vec<f64> = Vec::new();
    let share = 1.0 / count as f64;
    for seed in FIRST_SEED..FIRST_SEED + count {
        let case = trial(conditions, seed);
        let (solution, time_ms) = timed(solver, &case);
        times.push(time_ms);
        let Some(estimate) = solution.estimate else { continue };
        let error = case.error(&estimate);
        let is_gross = error.xy().norm() > GROSS_M;
        let in_box = error.xy().norm() < 0.05 && error.z.abs().to_degrees() < 1.0;
        tally.in_box += if in_box { share } else { 0.0 };
        tally.gross += if is_gross { share } else { 0.0 };
        if !is_gross {
            squares += error.xy().norm_squared();
            bounds += case.bound().map_or(0.0, |b| b[(0, 0)] + b[(1, 1)]);
        }
        if solution.outcome == Outcome::Determined {
            tally.determined += share;
            tally.wrong += usize::from(is_gross);
            nees.push(case.nees(&estimate));
        }
    }
    tally.rmse_over_bound = (squares / bounds).sqrt();
    tally.nees = nees.iter().sum::<f64>() / nees.len() as f64;
    tally.nees_median = median(nees);
    tally.time_ms = median(times);
    tally
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}

fn swarm(particle_count: usize) -> Swarm {
    Swarm::new(SwarmConfig { particle_count, ..SwarmConfig::default() }, DecisionConfig::default())
}

/// A decision that lets every pose pass that meets three points: what the estimator itself does.
fn lenient() -> DecisionConfig {
    DecisionConfig {
        min_distinct_count: 2,
        min_log_odds: -1e3,
        max_position_sigma_m: 100.0,
        max_heading_sigma_deg: 180.0,
        ..DecisionConfig::default()
    }
}

/// Mean of a χ² variable of 3 degrees of freedom: what is asked of every solver's covariance.
const NEES_BOUNDS: (f64, f64) = (2.0, 4.5);

fn check_nees(name: &str, tally: &Tally) {
    println!("{name}: {tally}");
    assert!((NEES_BOUNDS.0..NEES_BOUNDS.1).contains(&tally.nees), "{name}: {tally}");
    assert_eq!(tally.wrong, 0, "{name}: {tally}");
}

#[test]
fn graph_matching_is_good_without_misses_and_fails_with_them() {
    let solver = Graph::default();
    let [clean, misses, false_points] =
        CONDITIONS.map(|(_, conditions)| tally(&solver, &conditions, 300));
    for (name, tally) in [("clean", &clean), ("misses", &misses), ("false", &false_points)] {
        check_nees(&format!("graph {name}"), tally);
    }
    assert!(clean.in_box > 0.97 && clean.rmse_over_bound < 1.35, "{clean}");
    assert!(misses.in_box < 0.8 && false_points.in_box < misses.in_box, "{misses}");
}

#[test]
fn the_l2_optimum_is_as_inefficient_as_theory_says() {
    let clean = tally(&L2::default(), &Conditions::CLEAN, 30);
    check_nees("l2 clean", &clean);
    // 30 trials of two degrees of freedom: a standard deviation of 9 %.
    assert!((1.2..1.9).contains(&clean.rmse_over_bound), "{clean}");
    assert!(clean.determined > 0.9, "{clean}");
}

#[test]
fn a_small_swarm_is_worse_than_graph_matching() {
    let small = tally(&swarm(100), &Conditions::CLEAN, 20);
    let graph = tally(&Graph::default(), &Conditions::CLEAN, 20);
    println!("swarm 100: {small}; graph: {graph}");
    assert!(small.in_box < graph.in_box, "{small}; {graph}");
    assert!(small.nees < NEES_BOUNDS.1 && small.wrong == 0, "{small}");
}

/// Trials per condition and solver of the studies, and of the large swarm.
const STUDY_COUNT: u64 = 500;
const SLOW_STUDY_COUNT: u64 = 60;

#[test]
#[ignore = "minutes: 500 trials per condition and solver"]
fn study_of_graph_matching() {
    for (name, conditions) in &CONDITIONS {
        println!("graph {name}: {}", tally(&Graph::default(), conditions, STUDY_COUNT));
        let raw = Graph::new(GraphConfig::default(), lenient());
        println!("graph {name}, all poses: {}", tally(&raw, conditions, STUDY_COUNT));
    }
}

#[test]
#[ignore = "minutes: 500 trials per condition and solver"]
fn study_of_the_global_l2_optimum() {
    for (name, conditions) in &CONDITIONS {
        println!("l2 {name}: {}", tally(&L2::default(), conditions, STUDY_COUNT));
    }
}

#[test]
#[ignore = "minutes: 500 trials per condition and solver"]
fn study_of_a_small_swarm() {
    for (name, conditions) in &CONDITIONS {
        println!("swarm 100 {name}: {}", tally(&swarm(100), conditions, STUDY_COUNT));
    }
}

#[test]
#[ignore = "minutes: a swarm of 500 takes half a second per trial"]
fn study_of_a_large_swarm() {
    for (name, conditions) in &CONDITIONS {
        println!("swarm 500 {name}: {}", tally(&swarm(500), conditions, SLOW_STUDY_COUNT));
    }
}

#[test]
#[ignore = "minutes: rooms of thousands of pairs"]
fn study_of_larger_rooms() {
    let rooms = || {
        let offices = (0..8).map(|seed| ("office", office(seed)));
        offices.chain((0..2).map(|seed| ("large", large_room(seed, 300))))
    };
    for (name, case) in rooms() {
        let l2 = L2::new(L2Config::default(), DecisionConfig::default());
        let optimum = l2.optimum(&case.problem).unwrap();
        let (gap, boxes) = (optimum.relative_gap(), optimum.box_count);
        for solver in [&l2 as &dyn Solver, &Graph::default()] {
            let (solution, time_ms) = timed(solver, &case);
            let kind = solver.name();
            let error = solution.estimate.map(|e| (case.error(&e).xy().norm(), case.nees(&e)));
            let outcome = solution.outcome;
            println!("{name} {kind} {time_ms:.0} ms {error:?} {gap:.3} {boxes} {outcome:?}");
        }
    }
}
