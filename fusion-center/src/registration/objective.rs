//! The paper's objective: the L2 cross term of two Gaussian mixtures under a rigid motion.
//!
//! `f(θ) = − Σ_k Σ_l Σ_j N(z_l − (Φ z_j + t); 0, s (R_l + Φ R_j Φᵀ))`, in 1/m²
//! \[registration, eq. (18)\]. The factor `s` on all covariances is the role of the paper's ρ
//! (eq. 7): with the measured covariances as they are the minima are needles that no swarm finds.
//!
//! differs: covariances turn as `Φ R Φᵀ` and not by eq. (17), because that one turns them the
//! wrong way where the decomposition returns a reflection.

use nalgebra::Vector3;
use proto::geom::{Node, Ref, Se2};

use super::Problem;
use super::likelihood::differentiate;
use super::prepared::{Blob, Motion, Prepared};

/// Beyond this squared Mahalanobis distance a Gaussian is below 1e-17 of its peak.
const NEGLIGIBLE_CHI_SQUARE: f64 = 80.0;

/// The objective (1/m², at most 0) and its gradient by `(x_m, y_m, heading_rad)`. Points that are
/// not finite or have no positive definite covariance do not count.
#[must_use]
pub fn l2_objective(
    problem: &Problem,
    pose_ref_from_node: &Se2<Ref, Node>,
    covariance_scale: f64,
) -> (f64, Vector3<f64>) {
    let data = Prepared::new(problem);
    let shift = pose_ref_from_node.translation_m();
    let motion = Motion::new(shift.x, shift.y, pose_ref_from_node.heading_rad());
    let mut value = 0.0;
    let mut gradient = Vector3::zeros();
    for_each_pair(&data, &motion, |point, mapped| {
        let density = density_per_m2(point, mapped, covariance_scale);
        if density > 0.0 {
            let slope = differentiate(&motion, point, mapped, covariance_scale).gradient;
            value -= density;
            gradient -= slope * density;
        }
    });
    (value, gradient)
}

/// The objective alone, for the swarm.
pub(super) fn l2_value(data: &Prepared, motion: &Motion, covariance_scale: f64) -> f64 {
    let mut value = 0.0;
    for_each_pair(data, motion, |point, mapped| {
        value -= density_per_m2(point, mapped, covariance_scale);
    });
    value
}

fn for_each_pair(data: &Prepared, motion: &Motion, mut visit: impl FnMut(&Blob, &Blob)) {
    for span in &data.spans {
        for node in &data.nodes[span.nodes.clone()] {
            let mapped = motion.apply(node);
            for point in &data.refs[span.refs.clone()] {
                visit(point, &mapped);
            }
        }
    }
}

fn density_per_m2(point: &Blob, mapped: &Blob, scale: f64) -> f64 {
    let (dx, dy) = (point.x - mapped.x, point.y - mapped.y);
    let (xx, xy, yy) = (point.xx + mapped.xx, point.xy + mapped.xy, point.yy + mapped.yy);
    let det = xx * yy - xy * xy;
    let chi_square = (dx * dx * yy - 2.0 * dx * dy * xy + dy * dy * xx) / (det * scale);
    if chi_square > NEGLIGIBLE_CHI_SQUARE {
        return 0.0;
    }
    (-0.5 * chi_square).exp() / (std::f64::consts::TAU * scale * det.sqrt())
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix2, Vector2};
    use proto::geom::Gaussian;

    use super::*;
    use crate::simulate::{Conditions, trial};

    fn density(d: &Vector2<f64>, cov: &Matrix2<f64>) -> f64 {
        let exponent = -0.5 * d.dot(&(cov.try_inverse().unwrap() * d));
        exponent.exp() / (cov * std::f64::consts::TAU).determinant().sqrt()
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

    #[test]
    fn value_and_gradient_agree_with_the_formula_and_its_finite_differences() {
        /// Relative to the largest component; central differences of 1e-6 leave about 1e-8.
        const GRADIENT_TOLERANCE: f64 = 1e-5;
        let trial = trial(&Conditions::WITH_FALSE_POINTS, 3);
        let truth = trial.truth();
        for (offset, scale) in [
            (Vector3::new(0.01, -0.02, 0.004), 1.0),
            (Vector3::new(-0.3, 0.2, 0.03), 4.0),
            (Vector3::new(0.5, 0.6, -0.1), 25.0),
        ] {
            let theta = truth + offset;
            let pose = Se2::new(theta.x, theta.y, theta.z);
            let (value, gradient) = l2_objective(&trial.problem, &pose, scale);
            let expected = oracle(&trial.problem, &theta, scale);
            assert!((value - expected).abs() < 1e-12 * expected.abs().max(1.0));
            let data = Prepared::new(&trial.problem);
            let motion = Motion::new(theta.x, theta.y, theta.z);
            assert!((l2_value(&data, &motion, scale) - expected).abs() < 1e-12 * expected.abs());
            let mut numeric = Vector3::zeros();
            for axis in 0..3 {
                let mut step = Vector3::zeros();
                step[axis] = 1e-6;
                let (up, down) = (theta + step, theta - step);
                numeric[axis] = (oracle(&trial.problem, &up, scale)
                    - oracle(&trial.problem, &down, scale))
                    / 2e-6;
            }
            let error = (gradient - numeric).amax();
            assert!(error < GRADIENT_TOLERANCE * numeric.amax(), "{gradient:?} {numeric:?}");
        }
    }
}
