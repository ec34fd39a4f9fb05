//! What offsets along the line of sight that all points of a side share add to the covariance.
//!
//! Let every point of the reference side lie `b₀` too near along its line of sight `u`, and every
//! one of the node's `b₁`, with known standard deviations. To first order the estimate moves by
//! `C h b`, `h₀ = Σ p Jᵀ S⁻¹ u_l`, `h₁ = −Σ p Jᵀ S⁻¹ Φ u_j` over the matched pairs, so that
//! `σ₀² C h₀ h₀ᵀ C + σ₁² C h₁ h₁ᵀ C` is added, however many points there are. `S` holds the same
//! variances as if they were independent from point to point, which errs on the safe side.
//!
//! Assumes that all targets are off by the same amount: what differs between them averages out.

use nalgebra::{Matrix3, Vector2, Vector3};
use proto::measured::line_of_sight;

use super::likelihood::{Link, for_each_period};
use super::modes::Mode;
use super::prepared::{Blob, Motion, Prepared};

/// The part of the covariance of `(x, y, heading)` that more points do not reduce.
pub(super) fn offset_covariance(data: &Prepared, mode: &Mode) -> Matrix3<f64> {
    let [of_ref, of_node] = data.half_depth_sigma_m;
    if of_ref <= 0.0 && of_node <= 0.0 {
        return Matrix3::zeros();
    }
    let mut pulls = [Vector3::zeros(); 2];
    for_each_period(&mode.model(data), &mode.motion, |period, _| {
        for link in &period.links {
            pulls[0] += pull(data, &mode.motion, link, sight(&data.refs[link.ref_index]));
            let (x, y) = {
                let outward = sight(&data.nodes[link.node_index]);
                mode.motion.turned(outward.x, outward.y)
            };
            pulls[1] += pull(data, &mode.motion, link, -Vector2::new(x, y));
        }
    });
    let [of_ref_side, of_node_side] = pulls.map(|pull| mode.covariance * pull);
    of_ref_side * of_ref_side.transpose() * of_ref.powi(2)
        + of_node_side * of_node_side.transpose() * of_node.powi(2)
}

fn sight(blob: &Blob) -> Vector2<f64> {
    line_of_sight(&Vector2::new(blob.x, blob.y))
}

/// `p Jᵀ S⁻¹ u`.
fn pull(data: &Prepared, motion: &Motion, link: &Link, outward: Vector2<f64>) -> Vector3<f64> {
    let node = &data.nodes[link.node_index];
    let (x, y) = motion.turned(node.x, node.y);
    let weighed = link.precision() * outward * link.weight;
    Vector3::new(weighed.x, weighed.y, -y * weighed.x + x * weighed.y)
}

#[cfg(test)]
mod tests {
    use super::super::modes::refine;
    use super::*;
    use crate::simulate::{Conditions, trial};

    #[test]
    fn the_covariance_is_that_of_poses_from_shifted_points() {
        /// Small enough for the first order, large against where climbs stop.
        const OFFSET_M: f64 = 4e-3;
        /// Metres and radians: the second order and the ends of the climbs.
        const TOLERANCE: f64 = 4e-4;
        let mut case = trial(&Conditions::CLEAN, 3);
        let truth = case.truth();
        let start = Motion::new(truth.x, truth.y, truth.z);
        let pose = |problem: &super::super::Problem| {
            let mode = refine(&Prepared::new(problem), start).unwrap();
            Vector3::new(mode.motion.x, mode.motion.y, mode.motion.heading_rad())
        };
        (case.problem.ref_half_depth_sigma_m, case.problem.node_half_depth_sigma_m) =
            (OFFSET_M, 0.0);
        let data = Prepared::new(&case.problem);
        let of_ref = offset_covariance(&data, &refine(&data, start).unwrap());
        let mut shifted = case.problem.clone();
        for point in shifted.periods.iter_mut().flat_map(|period| &mut period.in_ref) {
            point.mean.coords_m += line_of_sight(&point.mean.coords_m) * OFFSET_M;
        }
        let moved = pose(&shifted) - pose(&case.problem);
        check(&of_ref, &moved, TOLERANCE);
        (case.problem.ref_half_depth_sigma_m, case.problem.node_half_depth_sigma_m) =
            (0.0, OFFSET_M);
        let other = Prepared::new(&case.problem);
        let of_node = offset_covariance(&other, &refine(&other, start).unwrap());
        let mut pushed = case.problem.clone();
        for point in pushed.periods.iter_mut().flat_map(|period| &mut period.in_node) {
            point.mean.coords_m += line_of_sight(&point.mean.coords_m) * OFFSET_M;
        }
        check(&of_node, &(pose(&pushed) - pose(&case.problem)), TOLERANCE);
    }

    fn check(covariance: &Matrix3<f64>, moved: &Vector3<f64>, tolerance: f64) {
        let sigmas = covariance.diagonal().map(f64::sqrt);
        assert!((sigmas - moved.abs()).abs().max() < tolerance, "{sigmas} {moved}");
        assert!(moved.norm() > 5.0 * tolerance, "{moved}");
        for (a, b) in [(0, 1), (0, 2), (1, 2)] {
            let product = moved[a] * moved[b];
            let is_same_sign = covariance[(a, b)] * product >= 0.0;
            assert!(is_same_sign || product.abs() < tolerance * moved.norm(), "{covariance}");
        }
    }

    #[test]
    fn without_offsets_nothing_is_added() {
        let case = trial(&Conditions::CLEAN, 3);
        let truth = case.truth();
        let data = Prepared::new(&case.problem);
        let mode = refine(&data, Motion::new(truth.x, truth.y, truth.z)).unwrap();
        assert!(offset_covariance(&data, &mode).norm() <= 0.0);
    }
}
