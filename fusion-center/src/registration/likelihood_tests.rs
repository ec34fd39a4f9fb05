//! The likelihood ratio against sums over all matchings and finite differences.

use proto::geom::{Node, Ref, Se2};

use super::super::Problem;
use super::*;
use crate::simulate::{Conditions, Trial, trial};

fn density(case: &Trial, period: usize, pair: (usize, usize), pose: &Se2<Ref, Node>) -> f64 {
    let period = &case.problem.periods[period];
    let (point, mapped) = (&period.in_ref[pair.0], *pose * period.in_node[pair.1]);
    let cov = point.cov_m2 + mapped.cov_m2;
    let d = point.mean.coords_m - mapped.mean.coords_m;
    let exponent = -0.5 * d.dot(&(cov.try_inverse().unwrap() * d));
    exponent.exp() / (TAU * cov.determinant().sqrt())
}

/// The sum over all partial matchings of the node's points from `node` on with the free points.
fn matchings(weights: &[Vec<f64>], node: usize, free: &[bool]) -> f64 {
    if node == weights.len() {
        return 1.0;
    }
    let mut sum = matchings(weights, node + 1, free);
    for index in (0..free.len()).filter(|index| free[*index]) {
        let mut rest = free.to_vec();
        rest[index] = false;
        sum += weights[node][index] * matchings(weights, node + 1, &rest);
    }
    sum
}

/// The oracle: Λ of the module doc with the exact sum over matchings.
fn oracle(case: &Trial, data: &Prepared, theta: &Vector3<f64>, share: f64) -> f64 {
    let pose = Se2::<Ref, Node>::new(theta.x, theta.y, theta.z);
    let volume = data.spans.len() as f64 * data.area_m2;
    let (n0, n1) = (data.refs.len() as f64, data.nodes.len() as f64);
    let (a, b) = (n0 / volume, n1 / volume);
    let c = share * a.min(b);
    let kappa = c / ((a - c) * (b - c));
    let mut total = volume * c + n0 * (1.0 - c / a).ln() + n1 * (1.0 - c / b).ln();
    for (index, period) in case.problem.periods.iter().enumerate() {
        let row = |node: usize| -> Vec<f64> {
            let weight = |point| kappa * density(case, index, (point, node), &pose);
            (0..period.in_ref.len()).map(weight).collect()
        };
        let weights: Vec<Vec<f64>> = (0..period.in_node.len()).map(row).collect();
        total += matchings(&weights, 0, &vec![true; period.in_ref.len()]).ln();
    }
    total
}

fn motion(theta: &Vector3<f64>) -> Motion {
    Motion::new(theta.x, theta.y, theta.z)
}

fn offsets() -> [Vector3<f64>; 4] {
    [
        Vector3::zeros(),
        Vector3::new(0.02, -0.01, 0.003),
        Vector3::new(-0.05, 0.04, -0.006),
        Vector3::new(0.3, 0.3, 0.05),
    ]
}

#[test]
fn the_ratio_is_the_sum_over_matchings_where_pairs_do_not_compete() {
    for seed in 0..10 {
        let case = trial(&Conditions::WITH_FALSE_POINTS, seed);
        let data = Prepared::new(&case.problem);
        if data.spans.len() < case.problem.periods.len() {
            continue;
        }
        for (offset, share) in offsets().iter().zip([0.5, 0.8, 0.3, 0.1]) {
            let theta = case.truth() + offset;
            let model = Model::new(&data, share, 1.0);
            let found = evaluate(&model, &motion(&theta)).log_ratio;
            let expected = oracle(&case, &data, &theta, share);
            // Weights below NEGLIGIBLE_WEIGHT, and rare crossings of the two targets.
            assert!((found - expected).abs() < 0.01, "{seed} {offset:?}: {found} {expected}");
            let ranked = score(&model, &motion(&theta), &mut Vec::new()) + model.pose_free_terms();
            assert!((ranked - found).abs() < 1e-9, "{ranked} {found}");
        }
    }
}

#[test]
fn competing_points_count_once() {
    // Two equal reference points for one of the node: exact sum 1 + 2 w, not (1 + w)².
    let case = trial(&Conditions::CLEAN, 1);
    let mut doubled =
        Problem { periods: vec![case.problem.periods[0].clone()], ..Problem::default() };
    let period = &mut doubled.periods[0];
    period.in_node.truncate(1);
    period.in_ref[1] = period.in_ref[0];
    let data = Prepared::new(&doubled);
    let model = Model::new(&data, 0.5, 1.0);
    let mut single = case;
    single.problem = doubled;
    let expected = oracle(&single, &data, &single.truth(), 0.5);
    let found = evaluate(&model, &motion(&single.truth()));
    assert!((found.log_ratio - expected).abs() < 1e-9, "{} {expected}", found.log_ratio);
    assert!(found.matched <= 1.0);
}

#[test]
fn gradient_and_information_agree_with_finite_differences() {
    /// Relative to the largest component; differences of 1e-6 leave about 1e-7.
    const GRADIENT_TOLERANCE: f64 = 1e-5;
    /// The expected information differs from the curvature by the residuals' share of it.
    const INFORMATION_TOLERANCE: f64 = 0.15;
    let case = trial(&Conditions::WITH_FALSE_POINTS, 3);
    let data = Prepared::new(&case.problem);
    for scale in [1.0, 4.0] {
        let model = Model::new(&data, 0.6, scale);
        let at = |theta: &Vector3<f64>| evaluate(&model, &motion(theta));
        for offset in offsets() {
            let theta = case.truth() + offset;
            let fit = at(&theta);
            let mut numeric = Vector3::zeros();
            for axis in 0..3 {
                let mut step = Vector3::zeros();
                step[axis] = 1e-6;
                numeric[axis] =
                    (at(&(theta + step)).log_ratio - at(&(theta - step)).log_ratio) / 2e-6;
            }
            let error = (fit.gradient - numeric).amax();
            assert!(error < GRADIENT_TOLERANCE * numeric.amax().max(1.0), "{error} {numeric:?}");
        }
        let mut curvature = Matrix3::zeros();
        for axis in 0..3 {
            let mut step = Vector3::zeros();
            step[axis] = 1e-5;
            let (up, down) = (at(&(case.truth() + step)), at(&(case.truth() - step)));
            curvature.set_column(axis, &((down.gradient - up.gradient) / 2e-5));
        }
        let fit = at(&case.truth());
        let error = (fit.complete - fit.lost - curvature).amax() / curvature.amax();
        assert!(error < INFORMATION_TOLERANCE, "{error}");
    }
}
