//! The objective against matrices without shortcuts and against finite differences.

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use proto::geom::{Gaussian, Node, Ref, Se2};

use super::*;
use crate::simulate::{Conditions, trial};

/// Steps of the finite differences, metres, metres, radians: about 1e-3 of the narrowest Gaussian
/// here, across an arm of 8 m.
const STEPS: [f64; 3] = [1e-5, 1e-5, 1e-6];

/// Relative to the largest component by these units: central differences with those steps leave
/// about 1e-6.
const DERIVATIVE_TOLERANCE: f64 = 2e-5;

/// Relative: two orders of summation.
const VALUE_TOLERANCE: f64 = 1e-12;

/// An arm, metres, that makes heading and position comparable.
const ARM_M: f64 = 6.0;

fn density(d: &Vector2<f64>, cov: &Matrix2<f64>) -> f64 {
    let exponent = -0.5 * d.dot(&(cov.try_inverse().unwrap() * d));
    exponent.exp() / (cov * TAU).determinant().sqrt()
}

/// The oracle: eq. (18) with matrices and no shortcut.
fn oracle(problem: &Problem, theta: &Vector3<f64>, scale: f64) -> f64 {
    let pose = Se2::<Ref, Node>::new(theta.x, theta.y, theta.z);
    let one = |point: &Gaussian<Ref>, mapped: &Gaussian<Ref>| {
        let d = point.mean.coords_m - mapped.mean.coords_m;
        density(&d, &((point.cov_m2 + mapped.cov_m2) * scale))
    };
    let mut sum = 0.0;
    for period in &problem.periods {
        for mapped in period.in_node.iter().map(|node| pose * *node) {
            sum -= period.in_ref.iter().map(|point| one(point, &mapped)).sum::<f64>();
        }
    }
    sum
}

fn at(problem: &Problem, theta: &Vector3<f64>, scale: f64) -> L2Objective {
    l2_objective(problem, &Se2::new(theta.x, theta.y, theta.z), scale)
}

/// In units of the widest component, with the heading by the arm.
fn by_arm(value: f64, row: usize) -> f64 {
    if row == 2 { value / ARM_M } else { value }
}

fn check_gradient(found: &Vector3<f64>, numeric: &Vector3<f64>) {
    let scaled = |v: &Vector3<f64>| Vector3::from_fn(|row, _| by_arm(v[row], row));
    let (found, numeric) = (scaled(found), scaled(numeric));
    let error = (found - numeric).amax();
    assert!(error < DERIVATIVE_TOLERANCE * numeric.amax(), "{found:?} {numeric:?}");
}

fn check_hessian(found: &Matrix3<f64>, numeric: &Matrix3<f64>) {
    let scaled = |m: &Matrix3<f64>| {
        Matrix3::from_fn(|row, column| by_arm(by_arm(m[(row, column)], row), column))
    };
    let (found, numeric) = (scaled(found), scaled(numeric));
    let error = (found - numeric).amax();
    assert!(error < DERIVATIVE_TOLERANCE * numeric.amax(), "{found} {numeric}");
    assert!((found - found.transpose()).amax() < VALUE_TOLERANCE * found.amax());
}

#[test]
fn value_gradient_and_hessian_agree_with_the_formula_and_its_finite_differences() {
    for seed in [3, 4] {
        let case = trial(&Conditions::WITH_FALSE_POINTS, seed);
        for (offset, scale) in [
            (Vector3::new(0.01, -0.02, 0.004), 1.0),
            (Vector3::new(-0.3, 0.2, 0.03), 4.0),
            (Vector3::new(0.5, 0.6, -0.1), 25.0),
        ] {
            check_at(&case.problem, &(case.truth() + offset), scale);
        }
    }
}

fn check_at(problem: &Problem, theta: &Vector3<f64>, scale: f64) {
    let found = at(problem, theta, scale);
    let expected = oracle(problem, theta, scale);
    let tolerance = VALUE_TOLERANCE * expected.abs();
    assert!((found.value_per_m2 - expected).abs() < tolerance);
    let motion = Motion::new(theta.x, theta.y, theta.z);
    assert!((l2_value(&Prepared::new(problem), &motion, scale) - expected).abs() < tolerance);
    let (mut slope, mut curvature) = (Vector3::zeros(), Matrix3::zeros());
    for (axis, length) in STEPS.into_iter().enumerate() {
        let mut step = Vector3::zeros();
        step[axis] = length;
        let (up, down) = (theta + step, theta - step);
        let rise = oracle(problem, &up, scale) - oracle(problem, &down, scale);
        slope[axis] = rise / (2.0 * length);
        let change = at(problem, &up, scale).gradient - at(problem, &down, scale).gradient;
        curvature.set_column(axis, &(change / (2.0 * length)));
    }
    check_gradient(&found.gradient, &slope);
    check_hessian(&found.hessian, &curvature);
}

#[test]
fn the_heading_of_one_elongated_pair_turns_its_covariance() {
    // With the node's point at its own origin only the covariance depends on the heading.
    let needle = |x: f64, y: f64| {
        let cov_m2 = Matrix2::new(0.09, 0.01, 0.01, 0.01);
        (proto::geom::Point::new(x, y), cov_m2)
    };
    let (mean, cov_m2) = needle(0.2, 0.1);
    let in_ref = vec![Gaussian { mean, cov_m2 }];
    let in_node = vec![Gaussian { mean: proto::geom::Point::new(0.0, 0.0), cov_m2 }];
    let period = crate::registration::Period { in_ref, in_node, ..Default::default() };
    let problem = Problem { periods: vec![period], ..Problem::default() };
    for heading_rad in [0.0, 0.4, 1.3, -2.0] {
        check_at(&problem, &Vector3::new(0.05, -0.02, heading_rad), 1.0);
    }
}

#[test]
fn far_points_and_no_points_give_zero() {
    let case = trial(&Conditions::CLEAN, 1);
    let far = at(&case.problem, &Vector3::new(500.0, 0.0, 0.0), 1.0);
    assert_eq!(far, L2Objective::default());
    assert_eq!(at(&Problem::default(), &Vector3::zeros(), 1.0), L2Objective::default());
}
