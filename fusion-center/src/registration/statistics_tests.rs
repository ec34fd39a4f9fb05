//! Statistical acceptance of the default solver on the paper's scene and on larger rooms.

use nalgebra::Vector3;

use super::{Outcome, Pairwise, Solution, Solver};
use crate::simulate::{Conditions, Trial, large_room, office, trial};

const TRIAL_COUNT: u64 = 500;

/// Mean of a χ² variable of 3 degrees of freedom over 500 trials: outside with chance 1e-4.
const NEES_BOUNDS: (f64, f64) = (2.6, 3.45);

/// What 500 trials gave.
#[derive(Debug, Default)]
struct Tally {
    in_box: f64,
    gross: usize,
    undetermined: usize,
    rmse_over_bound: f64,
    mean_nees: f64,
}

fn is_in_box(error: &Vector3<f64>) -> bool {
    error.xy().norm() < 0.05 && error.z.abs().to_degrees() < 1.0
}

fn tally(draw: impl Fn(u64) -> Trial) -> Tally {
    tally_from(0, |solver, case| solver.solve(&case.problem, None), draw)
}

fn tally_from(
    first_seed: u64,
    solve: impl Fn(&Pairwise, &Trial) -> Solution,
    draw: impl Fn(u64) -> Trial,
) -> Tally {
    let solver = Pairwise::default();
    let mut tally = Tally::default();
    let (mut squares, mut bounds, mut nees, mut solved) = (0.0, 0.0, 0.0, 0.0);
    for seed in first_seed..first_seed + TRIAL_COUNT {
        let case = draw(seed);
        let solution = solve(&solver, &case);
        tally.undetermined += usize::from(solution.outcome != Outcome::Determined);
        let Some(estimate) = solution.estimate else { continue };
        let error = case.error(&estimate);
        tally.in_box += f64::from(u8::from(is_in_box(&error))) / TRIAL_COUNT as f64;
        tally.gross += usize::from(error.xy().norm() > 0.5);
        squares += error.xy().norm_squared();
        bounds += case.bound().map_or(0.0, |bound| bound[(0, 0)] + bound[(1, 1)]);
        nees += case.nees(&estimate);
        solved += 1.0;
    }
    tally.rmse_over_bound = (squares / bounds).sqrt();
    tally.mean_nees = nees / solved;
    tally
}

fn check(name: &str, tally: &Tally, (box_rate, max_ratio): (f64, f64)) {
    println!("{name}: {tally:?}");
    assert!(tally.in_box >= box_rate, "{name}: {tally:?}");
    assert_eq!(tally.gross, 0, "{name}: {tally:?}");
    assert!(tally.undetermined < 5, "{name}: {tally:?}");
    assert!(tally.rmse_over_bound <= max_ratio, "{name}: {tally:?}");
    let (low, high) = NEES_BOUNDS;
    assert!((low..high).contains(&tally.mean_nees), "{name}: {tally:?}");
}

#[test]
fn default_solver_meets_the_bars_without_misses() {
    check("clean", &tally(|seed| trial(&Conditions::CLEAN, seed)), (0.995, 1.0));
}

#[test]
fn default_solver_meets_the_bars_with_misses() {
    check("misses", &tally(|seed| trial(&Conditions::MISSES, seed)), (0.99, 0.85));
}

#[test]
fn default_solver_meets_the_bars_with_misses_and_false_points() {
    check("false", &tally(|seed| trial(&Conditions::WITH_FALSE_POINTS, seed)), (0.985, 0.90));
}

#[test]
fn solutions_that_resume_meet_the_bars() {
    let resumed = |solver: &Pairwise, case: &Trial| {
        let known = solver.solve(&case.problem, None).known;
        solver.solve(&case.problem, Some(&known))
    };
    let draw = |seed| trial(&Conditions::WITH_FALSE_POINTS, seed);
    check("resumed", &tally_from(1_000, resumed, draw), (0.985, 0.90));
}

#[test]
#[ignore = "minutes: the bars on other seeds"]
fn study_of_the_bars_on_other_seeds() {
    for first_seed in [1_000, 5_000, 20_000, 40_000] {
        for (name, conditions) in [
            ("clean", Conditions::CLEAN),
            ("misses", Conditions::MISSES),
            ("false", Conditions::WITH_FALSE_POINTS),
        ] {
            let solve = |solver: &Pairwise, case: &Trial| solver.solve(&case.problem, None);
            let tally = tally_from(first_seed, solve, |seed| trial(&conditions, seed));
            println!("{first_seed} {name}: {tally:?}");
        }
    }
}

#[test]
fn larger_rooms_are_determined_near_the_bound() {
    let solver = Pairwise::default();
    for (name, cases) in [
        ("office", (0..60).map(office).collect::<Vec<_>>()),
        ("large", (0..5).map(|seed| large_room(seed, 300)).collect()),
    ] {
        let (mut squares, mut bounds) = (0.0, 0.0);
        for case in &cases {
            let solution = solver.solve(&case.problem, None);
            assert_eq!(solution.outcome, Outcome::Determined, "{name} {:?}", solution.evidence);
            squares += case.error(&solution.estimate.unwrap()).xy().norm_squared();
            bounds += case.bound().map_or(0.0, |b| b[(0, 0)] + b[(1, 1)]);
        }
        let ratio = (squares / bounds).sqrt();
        println!("{name}: {ratio:.3}");
        // 60 and 5 trials of two degrees of freedom: standard deviations of 6 % and 22 %.
        assert!(ratio < if cases.len() > 10 { 1.25 } else { 1.7 }, "{name}: {ratio}");
    }
}

#[test]
fn errors_that_last_longer_than_a_period_widen_the_covariance() {
    // A swaying offset of 10 cm hides below the noise of single points but not of blocks.
    let solver = Pairwise::default();
    for (amplitude_m, is_wide) in [(0.0, false), (0.1, true)] {
        let mut case = large_room(3, 240);
        for (index, period) in case.problem.periods.iter_mut().enumerate() {
            let offset_m = amplitude_m * (index as f64 / 240.0 * std::f64::consts::TAU).sin();
            period.in_node.iter_mut().for_each(|point| point.mean.coords_m.x += offset_m);
        }
        let inflation = solver.solve(&case.problem, None).evidence.covariance_inflation;
        assert_eq!(inflation > 1.5, is_wide, "{amplitude_m} {inflation}");
    }
}
