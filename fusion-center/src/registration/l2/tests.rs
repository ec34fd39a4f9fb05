//! The global search against dense grids with Newton descents, threads and limits.

use super::super::objective::l2_value;
use super::super::{Missing, Outcome};
use super::*;
use crate::simulate::{Conditions, trial};

/// Relative: two descents end within their limit of gain.
const SAME_VALUE: f64 = 1e-9;

/// Grid points of the oracle that are descended from.
const DESCENT_COUNT: usize = 60;

/// The best value of descents from the best of many poses.
fn best_of(data: &Prepared, mut poses: Vec<(f64, Motion)>, scale: f64) -> f64 {
    poses.sort_by(|a, b| a.0.total_cmp(&b.0));
    let descents = poses.iter().take(DESCENT_COUNT).map(|(_, motion)| {
        let (_, at) = descend(data, motion, scale);
        at.value_per_m2
    });
    descents.fold(0.0, f64::min)
}

/// The oracle for needles: every heading in steps of a fifth of a degree, with every pair of points
/// of a period laid together exactly.
fn best_of_pairs(data: &Prepared, scale: f64) -> f64 {
    let mut poses = Vec::new();
    let pairs: Vec<(usize, usize)> = data
        .spans
        .iter()
        .flat_map(|span| span.refs.clone().flat_map(|l| span.nodes.clone().map(move |j| (l, j))))
        .collect();
    for step in 0..1800 {
        let turn = Motion::new(0.0, 0.0, f64::from(step).to_radians() * 0.2);
        for (l, j) in &pairs {
            let (point, node) = (&data.refs[*l], &data.nodes[*j]);
            let (x, y) = turn.turned(node.x, node.y);
            let motion = Motion { x: point.x - x, y: point.y - y, ..turn };
            poses.push((l2_value(data, &motion, scale), motion));
        }
    }
    best_of(data, poses, scale)
}

/// The oracle for wide Gaussians: a grid over all poses.
fn best_of_grid(data: &Prepared, scale: f64) -> f64 {
    let mut poses = Vec::new();
    for (turn, x, y) in
        (0..90).flat_map(|turn| (-30..=30).flat_map(move |x| (-30..=30).map(move |y| (turn, x, y))))
    {
        let heading_rad = f64::from(turn).to_radians() * 4.0;
        let motion = Motion::new(f64::from(x) * 0.4, f64::from(y) * 0.4, heading_rad);
        let value = l2_value(data, &motion, scale);
        if value < -1e-3 {
            poses.push((value, motion));
        }
    }
    best_of(data, poses, scale)
}

fn found(data: &Prepared, config: &L2Config) -> search::Found {
    search::search(data, &[], config).unwrap().1
}

#[test]
fn the_search_from_nothing_finds_what_grids_find() {
    for seed in 40..44 {
        let case = trial(&Conditions::WITH_FALSE_POINTS, seed);
        let data = Prepared::new(&case.problem);
        let config = L2Config::default();
        let (searched, oracle) = (found(&data, &config), best_of_pairs(&data, 1.0));
        assert!(searched.value >= -oracle * (1.0 - SAME_VALUE), "{searched:?} {oracle}");
        assert!(searched.bound >= -oracle);
        assert!(searched.bound <= searched.value * (1.0 + config.relative_gap) * (1.0 + 1e-12));
    }
    for seed in 40..42 {
        let case = trial(&Conditions::MISSES, seed);
        let data = Prepared::new(&case.problem);
        let config = L2Config { covariance_scale: 400.0, ..L2Config::default() };
        let (searched, oracle) = (found(&data, &config), best_of_grid(&data, 400.0));
        assert!(searched.value >= -oracle * (1.0 - SAME_VALUE), "{searched:?} {oracle}");
        assert!(searched.bound >= -oracle);
    }
}

#[test]
fn a_descent_ends_where_the_gradient_vanishes() {
    for seed in 0..10 {
        let case = trial(&Conditions::MISSES, seed);
        let data = Prepared::new(&case.problem);
        let truth = case.truth();
        let start = Motion::new(truth.x + 0.01, truth.y - 0.01, truth.z + 0.002);
        let (motion, at) = descend(&data, &start, 1.0);
        assert!(nalgebra::Cholesky::new(at.hessian).is_some());
        let left = at.hessian.try_inverse().unwrap() * at.gradient;
        assert!(left.amax() < 1e-6, "{left:?}");
        assert!(at.value_per_m2 <= l2_value(&data, &start, 1.0));
        assert!(data.displacement_m(&motion, &start) < 0.5);
    }
}

#[test]
fn the_result_does_not_depend_on_threads_or_on_starts() {
    let case = trial(&Conditions::WITH_FALSE_POINTS, 50);
    let solve = |thread_count: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(thread_count).build().unwrap();
        pool.install(|| {
            (L2::default().solve(&case.problem, None), L2::default().optimum(&case.problem))
        })
    };
    let one = solve(1);
    assert_eq!(one.0.outcome, Outcome::Determined);
    for thread_count in [2, 5] {
        assert_eq!(solve(thread_count), one, "{thread_count}");
    }
    let cold = found(&Prepared::new(&case.problem), &L2Config::default());
    let warm = one.1.unwrap();
    assert!((cold.value + warm.value_per_m2).abs() < SAME_VALUE * cold.value);
}

#[test]
fn too_few_boxes_leave_a_gap_that_is_reported() {
    let case = trial(&Conditions::CLEAN, 3);
    let few = L2Config { max_box_count: 500, ..L2Config::default() };
    let open = L2::new(few, DecisionConfig::default()).optimum(&case.problem).unwrap();
    assert!(open.relative_gap() > 0.1, "{open:?}");
    let closed = L2::default().optimum(&case.problem).unwrap();
    assert!(closed.relative_gap() < 0.01 + 1e-9, "{closed:?}");
    assert!(closed.box_count > open.box_count);
    assert!(open.bound_per_m2 <= closed.value_per_m2);
}

#[test]
fn nothing_shared_is_underdetermined() {
    let solution = L2::default().solve(&Problem::default(), None);
    let missing = Missing::SharedPeriods { period_count: 0 };
    assert_eq!(solution.outcome, Outcome::Underdetermined { missing });
    assert_eq!(L2::default().optimum(&Problem::default()), None);
}
