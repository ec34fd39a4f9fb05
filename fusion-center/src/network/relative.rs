//! A pose of one node in another's frame with its covariance: chains, inverses, distances.
//!
//! Errors are additive in `(x_m, y_m, heading_rad)` in the frame that the pose is given in; their
//! derivatives are those of `proto::geom`. Assumes that the errors of links of one chain are
//! independent.

use nalgebra::{Cholesky, Matrix3};
use proto::geom::{Node, Se2, squared_length};

use crate::registration::PoseEstimate;

/// A pose whose position is farther out, metres, or whose variance is larger, is none.
const MAX_POSITION_M: f64 = 1e6;

/// The pose of one node in another's frame. Frames are nodes by index here, so no type can tell
/// them apart: names say `from` (the frame it is given in) and `to` (the frame that is posed).
pub(super) type Pose = Se2<Node, Node>;

/// A pose with its covariance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Relative {
    pub(super) pose: Pose,
    pub(super) covariance: Matrix3<f64>,
}

impl Relative {
    pub(super) fn identity() -> Self {
        Self { pose: Pose::identity(), covariance: Matrix3::zeros() }
    }

    /// `None` where the pose is not finite or the covariance is not positive definite.
    pub(super) fn usable(estimate: &PoseEstimate) -> Option<Self> {
        let pose: Pose = estimate.pose_ref_from_node.renamed();
        let covariance = (estimate.covariance + estimate.covariance.transpose()) * 0.5;
        let is_near = pose.numbers().iter().all(|value| value.abs() < MAX_POSITION_M);
        let is_bounded = covariance.iter().all(|value| value.abs() < MAX_POSITION_M);
        let is_definite = is_near && is_bounded && Cholesky::new(covariance).is_some();
        is_definite.then_some(Self { pose, covariance })
    }

    pub(super) fn estimate(&self) -> PoseEstimate {
        PoseEstimate { pose_ref_from_node: self.pose.renamed(), covariance: self.covariance }
    }

    /// This pose, then `next` as seen from it.
    pub(super) fn then(&self, next: &Self) -> Self {
        let by_poses = self.pose.product_by_poses(&next.pose);
        let covariance = by_poses.covariance(&self.covariance, &next.covariance);
        Self { pose: self.pose * next.pose, covariance }
    }

    /// The other way round.
    pub(super) fn inverse(&self) -> Self {
        let by_pose = self.pose.inverse_by_pose();
        let covariance = by_pose * self.covariance * by_pose.transpose();
        Self { pose: self.pose.inverse(), covariance }
    }

    /// Squared difference of two poses of the same frame in units of both covariances.
    pub(super) fn chi_square_to(&self, other: &Self) -> f64 {
        let off = self.pose.minus(&other.pose);
        squared_length(&off, &(self.covariance + other.covariance)).unwrap_or(f64::INFINITY)
    }
}

/// The estimate the other way round: `t' = −Φᵀ t`, `φ' = −φ`, and what becomes of the covariance.
/// `Ref` and `Node` change places.
#[must_use]
pub fn inverse(estimate: &PoseEstimate) -> PoseEstimate {
    let pose = estimate.pose_ref_from_node.renamed();
    Relative { pose, covariance: estimate.covariance }.inverse().estimate()
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;

    use super::*;

    /// Standard deviation of a sampled covariance entry, relative, at 40,000 draws, times four.
    const SAMPLED: f64 = 0.03;

    fn relative(pose: [f64; 3], root: Matrix3<f64>) -> Relative {
        let [x_m, y_m, heading_rad] = pose;
        Relative { pose: Pose::new(x_m, y_m, heading_rad), covariance: root * root.transpose() }
    }

    fn cases() -> [Relative; 2] {
        let a = Matrix3::new(0.02, 0.0, 0.0, 0.01, 0.03, 0.0, -0.004, 0.003, 0.006);
        let b = Matrix3::new(0.04, 0.0, 0.0, -0.02, 0.01, 0.0, 0.002, 0.005, 0.004);
        [relative([3.0, -2.0, 2.5], a), relative([-1.0, 4.0, -1.7], b)]
    }

    /// The oracle: covariance of what `map` makes of drawn poses.
    fn sampled(map: impl Fn(Pose, Pose) -> Pose) -> Matrix3<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let [a, b] = cases();
        let center = map(a.pose, b.pose);
        let mut sum = Matrix3::zeros();
        let mut draw = |from: &Relative| {
            let normal = Vector3::from_fn(|_, _| rng.sample::<f64, _>(StandardNormal));
            from.pose.plus(&(Cholesky::new(from.covariance).unwrap().l() * normal))
        };
        for _ in 0..40_000 {
            let drawn = map(draw(&a), draw(&b));
            let error = drawn.minus(&center);
            sum += error * error.transpose() / 40_000.0;
        }
        sum
    }

    fn check(found: &Relative, pose: &Pose, covariance: &Matrix3<f64>) {
        assert!(found.pose.minus(pose).norm() < 1e-12, "{found:?} {pose:?}");
        let scale = |i: usize| covariance[(i, i)].sqrt();
        for (row, column) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)] {
            let off = found.covariance[(row, column)] - covariance[(row, column)];
            assert!(off.abs() < SAMPLED * scale(row) * scale(column), "{row} {column} {off}");
        }
    }

    #[test]
    fn a_chain_errs_as_drawn_chains_do() {
        let [a, b] = cases();
        check(&a.then(&b), &(a.pose * b.pose), &sampled(|one, two| one * two));
    }

    #[test]
    fn an_inverse_errs_as_drawn_inverses_do() {
        let [a, _] = cases();
        check(&a.inverse(), &a.pose.inverse(), &sampled(|one, _| one.inverse()));
    }

    #[test]
    fn unusable_estimates_are_told() {
        let good = cases()[0].estimate();
        assert!(Relative::usable(&good).is_some());
        let flat = PoseEstimate { covariance: Matrix3::zeros(), ..good };
        let lost = PoseEstimate { pose_ref_from_node: Se2::new(f64::NAN, 0.0, 0.0), ..good };
        let vague = PoseEstimate { covariance: Matrix3::identity() * f64::INFINITY, ..good };
        assert!([flat, lost, vague].iter().all(|bad| Relative::usable(bad).is_none()));
    }
}
