//! The covariance of other estimators against closed forms and quadrature, and the limits on it.

use nalgebra::Matrix2;

use super::super::Missing;
use super::super::modes::fixed;
use super::*;
use crate::simulate::{Conditions, trial};

/// Probabilities of matches below 1 change the covariance by less.
const RATIO_TOLERANCE: f64 = 0.01;

/// The paper's scene with the same round covariance everywhere and no noise.
fn even_problem() -> (Prepared, Motion) {
    let case = trial(&Conditions::CLEAN, 3);
    let truth = case.truth();
    let motion = Motion::new(truth.x, truth.y, truth.z);
    let mut data = Prepared::aligned(&case.problem);
    let nodes = data.nodes.clone();
    for (point, node) in data.refs.iter_mut().zip(&nodes) {
        *point = Blob { xx: 4e-4, xy: 0.0, yy: 4e-4, ..motion.apply(node) };
    }
    for node in &mut data.nodes {
        (node.xx, node.xy, node.yy) = (4e-4, 0.0, 4e-4);
    }
    (data, motion)
}

/// The ratio of an L2 estimate's variance to the bound for equal pairs, by quadrature of its score
/// `q' = −q x / s` and slope `q'' = q (x² / s − 1) / s`, `q = N(x; 0, s)`, over `N(0, 1)` in the
/// plane.
fn ratio_by_quadrature(s: f64) -> f64 {
    const STEP: f64 = 0.02;
    let (mut slope, mut variance) = (0.0, 0.0);
    for (i, j) in (-400..=400).flat_map(|i| (-400..=400).map(move |j| (i, j))) {
        let d = Vector2::new(f64::from(i) * STEP, f64::from(j) * STEP);
        let chance = (-0.5 * d.norm_squared()).exp() * STEP * STEP;
        let q = (-0.5 * d.norm_squared() / s).exp();
        slope += chance * q * (1.0 - d.x * d.x / s) / s;
        variance += chance * (q * d.x / s).powi(2);
    }
    // The chance lacks 1 / 2π.
    variance * std::f64::consts::TAU / (slope * slope)
}

#[test]
fn equal_pairs_give_the_ratio_of_the_quadrature() {
    let (data, motion) = even_problem();
    let mode = fixed(&data, motion).unwrap();
    for scale in [0.5, 1.0, 4.0] {
        let own = l2_covariance(&data, &mode, scale).unwrap();
        let ratio = Cholesky::new(mode.covariance).unwrap().solve(&own);
        let expected = ratio_by_quadrature(scale);
        let error = (ratio - Matrix3::identity() * expected).amax();
        assert!(error < RATIO_TOLERANCE * 10.0, "{ratio} {expected}");
        assert!((ratio.trace() / 3.0 / expected - 1.0).abs() < RATIO_TOLERANCE, "{expected}");
    }
    assert!((ratio_by_quadrature(1.0) - 16.0 / 9.0).abs() < 1e-6);
}

#[test]
fn pairs_weigh_by_the_peaks_of_their_gaussians() {
    // Half of the pairs ten times as wide: by hand, information and score of pair i are
    // proportional to 1/v_i², 1/v_i³ with the variance v_i.
    let (mut data, motion) = even_problem();
    for (index, (point, node)) in data.refs.iter_mut().zip(&mut data.nodes).enumerate() {
        if index % 2 == 0 {
            (point.xx, point.yy, node.xx, node.yy) = (4e-3, 4e-3, 4e-3, 4e-3);
        }
    }
    let mode = fixed(&data, motion).unwrap();
    let own = l2_covariance(&data, &mode, 1.0).unwrap();
    let (mut bread, mut filling) = (Matrix3::zeros(), Matrix3::zeros());
    for (index, node) in data.nodes.iter().enumerate() {
        let variance_m2: f64 = if index % 2 == 0 { 8e-3 } else { 8e-4 };
        let by_pose = jacobian(&motion, node);
        let square = by_pose.transpose() * Matrix2::identity() * by_pose;
        bread += square / 4.0 / variance_m2.powi(2);
        filling += square / 9.0 / variance_m2.powi(3);
    }
    let expected = bread.try_inverse().unwrap() * filling * bread.try_inverse().unwrap();
    assert!((own - expected).amax() < 5.0 * RATIO_TOLERANCE * expected.amax(), "{own} {expected}");
}

#[test]
fn the_jacobian_is_that_of_the_mapped_point() {
    let motion = Motion::new(1.0, -2.0, 0.7);
    let node = Blob { x: 3.0, y: 4.0, xx: 1.0, xy: 0.0, yy: 1.0 };
    let by_pose = jacobian(&motion, &node);
    let at = motion.apply(&node);
    for axis in 0..3 {
        let mut step = nalgebra::Vector3::zeros();
        step[axis] = 1e-6;
        let moved = motion.plus(&step).apply(&node);
        let numeric = Vector2::new(moved.x - at.x, moved.y - at.y) / 1e-6;
        assert!((by_pose.column(axis) - numeric).norm() < 1e-5, "{axis}");
    }
}

#[test]
fn the_estimators_own_spread_is_held_to_the_limits() {
    let problem = trial(&Conditions::CLEAN, 3).problem;
    let data = Prepared::new(&problem);
    let found = likely_motions(&problem)[0];
    let judge = |own: Matrix3<f64>| {
        let decision = DecisionConfig::default();
        let case = Case { data: &data, given_period_count: 8, decision: &decision };
        case.judge(&found, &[], |_| Some(own))
    };
    let own = |sigma_m: f64, sigma_rad: f64| {
        let sigmas = nalgebra::Vector3::new(sigma_m, 0.02, sigma_rad);
        Matrix3::from_diagonal(&sigmas.component_mul(&sigmas))
    };
    let narrow = judge(own(0.03, 0.01));
    assert_eq!(narrow.outcome, Outcome::Determined);
    let error = narrow.estimate.unwrap().covariance - own(0.03, 0.01);
    assert!(error.amax() < 1e-12, "{error}");
    let outcome = judge(own(0.8, 0.01)).outcome;
    let is_position = matches!(
        outcome,
        Outcome::Underdetermined { missing: Missing::PositionSpread { sigma_m, .. } } if (sigma_m - 0.8).abs() < 1e-3
    );
    assert!(is_position, "{outcome:?}");
    let refused = judge(own(0.03, 0.2));
    assert_eq!(refused.estimate, None);
    let is_heading = matches!(
        refused.outcome,
        Outcome::Underdetermined { missing: Missing::HeadingSpread { .. } }
    );
    assert!(is_heading, "{:?}", refused.outcome);
}

#[test]
fn a_pose_beside_a_better_one_is_refused() {
    let case = trial(&Conditions::CLEAN, 3);
    let data = Prepared::new(&case.problem);
    let likely = likely_motions(&case.problem);
    let truth = case.truth();
    let wrong = Motion::new(truth.x + 3.0, truth.y - 2.0, truth.z + 1.5);
    let decision = DecisionConfig::default();
    let judged = Case { data: &data, given_period_count: 8, decision: &decision };
    let solution = judged.judge(&wrong, &likely, |_| None);
    assert_ne!(solution.outcome, Outcome::Determined);
}

#[test]
fn what_the_points_leave_as_open_as_before_is_not_fixed() {
    let (data, motion) = even_problem();
    let good = fixed(&data, motion).unwrap();
    let decision = DecisionConfig::default();
    let judged = Case { data: &data, given_period_count: 8, decision: &decision };
    let is_fixed = |sigmas: [f64; 3]| {
        let covariance = Matrix3::from_diagonal(&nalgebra::Vector3::from(sigmas.map(|s| s * s)));
        judged.is_fixed(&Mode { covariance, ..good.clone() })
    };
    assert!(judged.is_fixed(&good));
    // The square is 20 m to each side; a heading of which nothing is known has π/√3 = 1.814.
    assert!(is_fixed([19.0, 19.0, 1.8]));
    assert!(!is_fixed([0.1, 21.0, 0.1]) && !is_fixed([0.1, 0.1, 1.82]));
    assert!(!is_fixed([f64::NAN, 0.1, 0.1]) && !is_fixed([0.1, 0.1, f64::NAN]));
}

#[test]
fn sectors_in_which_a_swarm_found_nothing_are_no_rivals() {
    use super::super::{Swarm, SwarmConfig};
    let config = SwarmConfig { particle_count: 100, iteration_count: 60, ..SwarmConfig::default() };
    let decision = DecisionConfig::default();
    let swarm = Swarm::new(config, decision.clone());
    let (mut open_count, mut free_count) = (0, 0);
    for seed in 31_000..31_008 {
        let problem = trial(&Conditions::MISSES, seed).problem;
        let data = Prepared::new(&problem);
        let judged = Case { data: &data, given_period_count: 8, decision: &decision };
        let (found, sectors) = (likely_motions(&problem)[0], swarm.motions(&data));
        let is_free =
            |motion: &&Motion| refine(&data, **motion).is_some_and(|mode| !judged.is_fixed(&mode));
        free_count += sectors.iter().filter(is_free).count();
        let outcome = judged.judge(&found, &sectors, |_| None).outcome;
        open_count += usize::from(outcome != Outcome::Determined);
    }
    println!("{free_count} sectors without a pose, {open_count} poses open");
    assert!(free_count > 0 && open_count == 0, "{free_count} {open_count}");
}
