//! Problems that do not decide the pose: no solver may be sure of a wrong one.

use nalgebra::{Matrix2, Vector2};
use proto::geom::{Gaussian, Point};
use rand::RngExt;

use super::{Missing, Outcome, Pairwise, Period, Problem, Solution, Solver};
use crate::simulate::{Conditions, Paths, Sampler, Trial, line_paths, paper_paths};

const TRY_COUNT: u64 = 500;

/// A determined pose may be wrong by five standard deviations of three unknowns, not by more.
const MAX_NEES: f64 = 25.0;

fn solve(problem: &Problem) -> Solution {
    let solution = Pairwise::default().solve(problem, None);
    assert!(solution.evidence.log_odds.is_finite() && solution.evidence.chi_square.is_finite());
    solution
}

/// Outcomes `[determined, ambiguous, underdetermined]`; fails on a sure but wrong pose.
pub(super) fn outcomes(name: &str, draw: impl Fn(u64) -> Trial) -> [usize; 3] {
    outcomes_of(name, TRY_COUNT, draw)
}

pub(super) fn outcomes_of(name: &str, try_count: u64, draw: impl Fn(u64) -> Trial) -> [usize; 3] {
    outcomes_within(MAX_NEES, (name, try_count), draw)
}

fn outcomes_within(
    max_nees: f64,
    (name, try_count): (&str, u64),
    draw: impl Fn(u64) -> Trial,
) -> [usize; 3] {
    let mut counts = [0; 3];
    for seed in 0..try_count {
        let case = draw(seed);
        let solution = solve(&case.problem);
        let kind = match solution.outcome {
            Outcome::Determined => 0,
            Outcome::Ambiguous { .. } => 1,
            Outcome::Underdetermined { .. } => 2,
        };
        counts[kind] += 1;
        if kind == 0 {
            let estimate = solution.estimate.unwrap();
            let nees = case.nees(&estimate);
            assert!(nees < max_nees, "{name} {seed}: {nees} {:?}", solution.evidence);
        }
    }
    println!("{name}: {counts:?}");
    counts
}

pub(super) fn observe(
    paths: impl Fn(&mut Sampler) -> Paths,
    conditions: Conditions,
) -> impl Fn(u64) -> Trial {
    move |seed| {
        let mut sampler = Sampler::new(seed);
        let drawn = paths(&mut sampler);
        sampler.observe(&drawn, &conditions)
    }
}

/// The reference side of one trial with the node's side of another.
pub(super) fn unrelated(seed: u64, draw: &impl Fn(u64) -> Trial) -> Trial {
    let (mut case, other) = (draw(seed), draw(seed + 10_000));
    for (period, elsewhere) in case.problem.periods.iter_mut().zip(&other.problem.periods) {
        period.in_node.clone_from(&elsewhere.in_node);
    }
    case
}

#[test]
fn one_straight_target_is_never_sure_and_wrong() {
    let line = |_: &mut Sampler| line_paths(&[[[2.0, 3.0], [8.0, 8.0]]], 8);
    assert_eq!(outcomes("line", observe(line, Conditions::WITH_FALSE_POINTS))[0], 0);
    let slow = |_: &mut Sampler| line_paths(&[[[4.0, 4.0], [5.0, 5.5]]], 8);
    outcomes("slow line", observe(slow, Conditions::WITH_FALSE_POINTS));
}

#[test]
fn two_standing_targets_are_never_determined() {
    let standing = |_: &mut Sampler| vec![vec![Vector2::new(3.0, 4.0), Vector2::new(7.0, 6.0)]; 20];
    let counts = outcomes("standing", observe(standing, Conditions::CLEAN));
    assert_eq!(counts[0], 0);
    let once = |_: &mut Sampler| vec![vec![Vector2::new(3.0, 4.0), Vector2::new(7.0, 6.0)]];
    assert_eq!(outcomes("two points", observe(once, Conditions::CLEAN))[0], 0);
}

#[test]
fn targets_that_mirror_each_other_leave_half_a_turn() {
    let mirrored =
        |_: &mut Sampler| line_paths(&[[[2.0, 3.0], [8.0, 8.0]], [[8.0, 7.0], [2.0, 2.0]]], 8);
    let counts = outcomes("symmetric", observe(mirrored, Conditions::MISSES));
    assert_eq!(counts[0], 0);
    let case = observe(mirrored, Conditions::CLEAN)(7);
    let Outcome::Ambiguous { rivals } = solve(&case.problem).outcome else { panic!("ambiguous") };
    assert!(rivals[0].log_odds.abs() < 6.9);
}

#[test]
fn unrelated_sets_are_never_determined() {
    for (name, noise_scale, period_count) in [("fine", 0.35, 8), ("coarse", 3.0, 60)] {
        let random = move |sampler: &mut Sampler| -> Paths {
            let mut draw = || sampler.rng.random_range(0.0..10.0);
            let mut period = || (0..2).map(|_| Vector2::new(draw(), draw())).collect();
            (0..period_count).map(|_| period()).collect()
        };
        let draw = observe(random, Conditions { noise_scale, ..Conditions::CLEAN });
        let counts = outcomes(name, |seed| unrelated(seed, &draw));
        assert_eq!(counts[0], 0, "{name}");
    }
}

#[test]
fn fixed_ghosts_of_both_sides_are_not_common_targets() {
    // Two ghosts of each side at the same distance in each of 100 periods, and one random point.
    let ghosts = |sampler: &mut Sampler| {
        let mut draw = || sampler.rng.random_range(1.0..9.0_f64);
        let (first, direction) = (Vector2::new(draw(), draw()), draw());
        let second = first + Vector2::new(direction.cos(), direction.sin()) * 4.0;
        (0..100).map(|_| vec![first, second, Vector2::new(draw(), draw())]).collect::<Paths>()
    };
    let counts = outcomes("ghosts", |seed| unrelated(seed, &observe(ghosts, Conditions::CLEAN)));
    assert_eq!(counts[0], 0);
}

#[test]
fn every_reason_can_be_produced() {
    let missing = |problem: &Problem, solver: &Pairwise| match solver.solve(problem, None).outcome {
        Outcome::Underdetermined { missing } => missing,
        other => panic!("{other:?}"),
    };
    let standard = Pairwise::default();
    let empty = Problem { periods: vec![Period::default(); 3], ..Problem::default() };
    assert_eq!(missing(&empty, &standard), Missing::SharedPeriods { period_count: 3 });
    let case = |conditions: Conditions, paths: Paths| Sampler::new(3).observe(&paths, &conditions);
    let one = case(Conditions::CLEAN, vec![vec![Vector2::new(3.0, 4.0)]; 5]).problem;
    assert_eq!(missing(&one, &standard), Missing::CommonPoints { shared_period_count: 5 });
    let pair = vec![Vector2::new(3.0, 4.0), Vector2::new(7.0, 6.0)];
    let two = case(Conditions::CLEAN, vec![pair.clone()]).problem;
    assert_eq!(missing(&two, &standard), Missing::MatchedPoints { matched: 2, needed: 3 });
    let standing = case(Conditions::CLEAN, vec![pair; 9]).problem;
    assert_eq!(missing(&standing, &standard), Missing::DistinctPoints { distinct: 2, needed: 3 });
    let scene = case(Conditions::CLEAN, paper_paths()).problem;
    let strict = |change: fn(&mut super::DecisionConfig)| {
        let mut decision = super::DecisionConfig::default();
        change(&mut decision);
        Pairwise::new(super::PairwiseConfig::default(), decision)
    };
    let few = missing(&scene, &strict(|c| c.min_matched_share = 1.1));
    assert!(matches!(few, Missing::MatchedShare { .. }), "{few:?}");
    let line = case(Conditions::CLEAN, line_paths(&[[[2.0, 3.0], [8.0, 8.0]]], 8)).problem;
    let walk = missing(&line, &standard);
    assert!(matches!(walk, Missing::StraightWalk { matched: 8, .. }), "{walk:?}");
    let weak = missing(&scene, &strict(|c| c.min_log_odds = 1e4));
    assert!(matches!(weak, Missing::Evidence { .. }), "{weak:?}");
    let wide = missing(&scene, &strict(|c| c.max_position_sigma_m = 1e-4));
    assert!(matches!(wide, Missing::PositionSpread { .. }), "{wide:?}");
    let turning = missing(&scene, &strict(|c| c.max_heading_sigma_deg = 1e-4));
    assert!(matches!(turning, Missing::HeadingSpread { .. }), "{turning:?}");
}

#[test]
fn broken_points_are_counted_and_change_nothing() {
    let clean = Sampler::new(4).observe(&paper_paths(), &Conditions::WITH_FALSE_POINTS).problem;
    let mut broken = clean.clone();
    let cov_m2 = Matrix2::identity();
    for (index, bad) in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY].into_iter().enumerate() {
        broken.periods[index].in_ref.push(Gaussian { mean: Point::new(bad, 1.0), cov_m2 });
        let flat = Gaussian { mean: Point::new(1.0, 1.0), cov_m2: cov_m2 * -bad };
        broken.periods[index].in_node.insert(0, flat);
    }
    broken.periods.insert(0, Period::default());
    let (expected, mut found) = (solve(&clean), solve(&broken));
    assert_eq!(found.evidence.ignored_point_count, 6);
    found.evidence.ignored_point_count = 0;
    assert_eq!(found, expected);
}

/// Two people who wander for a minute at 5 periods per second, turning smoothly.
pub(super) fn wanderers(sampler: &mut Sampler) -> Paths {
    let mut people: Vec<[f64; 3]> =
        (0..2).map(|_| std::array::from_fn(|_| sampler.rng.random_range(2.0..8.0_f64))).collect();
    let mut step = |person: &mut [f64; 3]| {
        let [x, y, heading] = *person;
        let next = (x + 0.15 * heading.cos(), y + 0.15 * heading.sin());
        let inside = (1.0..9.0).contains(&next.0) && (1.0..9.0).contains(&next.1);
        let turned = heading + 0.15 * sampler.normal() + if inside { 0.0 } else { 2.0 };
        *person = if inside { [next.0, next.1, turned] } else { [x, y, turned] };
        Vector2::new(person[0], person[1])
    };
    (0..300).map(|_| people.iter_mut().map(&mut step).collect()).collect()
}

/// Two or three people who walk straight at their pace from one random place to the next.
pub(super) fn walkers(period_s: f64, period_count: usize) -> impl Fn(&mut Sampler) -> Paths {
    move |sampler| {
        let person_count = sampler.rng.random_range(2..4);
        let people: Vec<Vec<Vector2<f64>>> =
            (0..person_count).map(|_| walk(sampler, 0.8 * period_s, period_count)).collect();
        (0..period_count).map(|k| people.iter().map(|path| path[k]).collect()).collect()
    }
}

fn walk(sampler: &mut Sampler, step_m: f64, period_count: usize) -> Vec<Vector2<f64>> {
    let mut draw = || Vector2::from_fn(|_, _| sampler.rng.random_range(1.0..9.0_f64));
    let (mut at, mut goal) = (draw(), draw());
    let mut next = || {
        let way = goal - at;
        if way.norm() < step_m {
            goal = draw();
        } else {
            at += way * (step_m / way.norm());
        }
        at
    };
    (0..period_count).map(|_| next()).collect()
}

#[test]
fn unrelated_walkers_in_the_same_room_are_not_determined() {
    /// Each try has 64 to 150 periods.
    const WALKER_TRY_COUNT: u64 = 250;
    /// Chance of one in 250.
    const MOST_DETERMINED: usize = 1;
    for (period_s, period_count, noise_scale) in [(0.5, 64, 1.0), (0.1, 150, 2.5)] {
        let conditions = Conditions {
            detection_probability: 0.9,
            false_probability: 0.1,
            noise_scale,
            period_s,
        };
        let draw = observe(walkers(period_s, period_count), conditions);
        let counts = (0..WALKER_TRY_COUNT).fold([0, 0], |[sure, all], seed| {
            let is_sure = solve(&unrelated(seed, &draw).problem).outcome == Outcome::Determined;
            [sure + usize::from(is_sure), all + 1]
        });
        println!("unrelated walkers {period_s} s {noise_scale}: {counts:?}");
        assert!(counts[0] <= MOST_DETERMINED, "{period_s} {noise_scale}: {counts:?}");
    }
}

#[test]
fn related_walkers_are_found() {
    const RELATED_TRY_COUNT: u64 = 40;
    for (period_s, period_count) in [(0.5, 64), (0.1, 150)] {
        let conditions = Conditions {
            detection_probability: 0.9,
            false_probability: 0.1,
            noise_scale: 2.5,
            period_s,
        };
        let draw = observe(walkers(period_s, period_count), conditions);
        let counts = outcomes_of("walkers", RELATED_TRY_COUNT, draw);
        assert!(counts[0] >= 30, "{period_s}: {counts:?}");
    }
}

/// Noisy data as a real room gives them: σ of 6 to 40 cm, half the points missed, many false.
const ROUGH: Conditions = Conditions {
    detection_probability: 0.5,
    false_probability: 0.6,
    noise_scale: 3.0,
    period_s: 0.5,
};

#[test]
fn wanderers_in_rough_data_are_found_and_strangers_are_not() {
    /// Each try has 300 periods; 48 keep the test at a few seconds.
    const ROUGH_TRY_COUNT: u64 = 48;
    /// The widening is read off pairs inside the gate, and so falls short by up to a fifth.
    const DOUBTFUL_NEES: f64 = 1.2 * MAX_NEES;
    let draw = observe(wanderers, ROUGH);
    let related = outcomes_of("wanderers", ROUGH_TRY_COUNT, &draw);
    assert!(related[0] >= 40, "{related:?}");
    let strange = outcomes_of("strangers", ROUGH_TRY_COUNT, |seed| unrelated(seed, &draw));
    assert_eq!(strange[0], 0);
    // Errors twice as large as stated must widen the covariance, not mislead.
    let doubtful = outcomes_within(DOUBTFUL_NEES, ("doubtful", ROUGH_TRY_COUNT), |seed| {
        let mut case = draw(seed);
        for period in &mut case.problem.periods {
            period.in_ref.iter_mut().for_each(|point| point.cov_m2 *= 0.25);
            period.in_node.iter_mut().for_each(|point| point.cov_m2 *= 0.25);
        }
        case
    });
    assert!(doubtful[0] >= 40, "{doubtful:?}");
}
