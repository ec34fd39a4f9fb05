//! A pose of one node in another's frame with its covariance: chains, inverses, differences.
//!
//! Errors are additive in `(x_m, y_m, heading_rad)` in the frame that the pose is given in. To
//! first order, `c = a ∘ b` has `C_c = A C_a Aᵀ + B C_b Bᵀ` with `A = [[I, Φ_a' t_b], [0, 1]]`,
//! `Φ' = ∂Φ/∂φ`, and `B = diag(Φ_a, 1)`; the inverse has `D C Dᵀ`, `D = −[[Φᵀ, Φ'ᵀ t], [0, 1]]`.
//! Assumes that the errors of links of one chain are independent.

use nalgebra::{Cholesky, Matrix3, Vector3};
use proto::geom::{Node, Ref, Se2, wrap_angle};

use crate::registration::PoseEstimate;

/// A pose whose position is farther out, metres, or whose variance is larger, is none.
const MAX_POSITION_M: f64 = 1e6;

/// The pose of a frame in another with its covariance. Frames are nodes by index here, so no type
/// can hold them: names say `from` (the frame it is given in) and `to` (the frame that is posed).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Relative {
    /// `(x_m, y_m, heading_rad)`.
    pub(super) pose: Vector3<f64>,
    pub(super) covariance: Matrix3<f64>,
}

impl Relative {
    pub(super) fn identity() -> Self {
        Self { pose: Vector3::zeros(), covariance: Matrix3::zeros() }
    }

    /// `None` where the pose is not finite or the covariance is not positive definite.
    pub(super) fn usable(estimate: &PoseEstimate) -> Option<Self> {
        let pose = numbers(&estimate.pose_ref_from_node);
        let covariance = (estimate.covariance + estimate.covariance.transpose()) * 0.5;
        let is_near = pose.iter().all(|value| value.abs() < MAX_POSITION_M);
        let is_bounded = covariance.iter().all(|value| value.abs() < MAX_POSITION_M);
        let is_definite = is_near && is_bounded && Cholesky::new(covariance).is_some();
        is_definite.then_some(Self { pose, covariance })
    }

    pub(super) fn estimate(&self) -> PoseEstimate {
        let pose_ref_from_node = Se2::<Ref, Node>::new(self.pose.x, self.pose.y, self.pose.z);
        PoseEstimate { pose_ref_from_node, covariance: self.covariance }
    }

    /// This pose, then `next` as seen from it.
    pub(super) fn then(&self, next: &Self) -> Self {
        let (sin, cos) = self.pose.z.sin_cos();
        let turned_x = cos * next.pose.x - sin * next.pose.y;
        let turned_y = sin * next.pose.x + cos * next.pose.y;
        let own = Matrix3::new(1.0, 0.0, -turned_y, 0.0, 1.0, turned_x, 0.0, 0.0, 1.0);
        let turn = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
        Self {
            pose: compose(&self.pose, &next.pose),
            covariance: own * self.covariance * own.transpose()
                + turn * next.covariance * turn.transpose(),
        }
    }

    /// The other way round.
    pub(super) fn inverse(&self) -> Self {
        let (sin, cos) = self.pose.z.sin_cos();
        let pose = invert(&self.pose);
        let back = Matrix3::new(-cos, -sin, pose.y, sin, -cos, -pose.x, 0.0, 0.0, -1.0);
        Self { pose, covariance: back * self.covariance * back.transpose() }
    }

    /// Squared difference of two poses of the same frame in units of both covariances.
    pub(super) fn chi_square_to(&self, other: &Self) -> f64 {
        let step = difference(&self.pose, &other.pose);
        let factor = Cholesky::new(self.covariance + other.covariance);
        factor.map_or(f64::INFINITY, |factor| step.dot(&factor.solve(&step)))
    }
}

/// The estimate the other way round: `t' = −Φᵀ t`, `φ' = −φ`, and what becomes of the covariance.
/// `Ref` and `Node` change places.
#[must_use]
pub fn inverse(estimate: &PoseEstimate) -> PoseEstimate {
    let pose = numbers(&estimate.pose_ref_from_node);
    Relative { pose, covariance: estimate.covariance }.inverse().estimate()
}

/// `(x_m, y_m, heading_rad)` of a pose.
pub(super) fn numbers(pose: &Se2<Ref, Node>) -> Vector3<f64> {
    let shift = pose.translation_m();
    Vector3::new(shift.x, shift.y, pose.heading_rad())
}

pub(super) fn compose(a: &Vector3<f64>, b: &Vector3<f64>) -> Vector3<f64> {
    let (sin, cos) = a.z.sin_cos();
    let (x, y) = (cos * b.x - sin * b.y, sin * b.x + cos * b.y);
    Vector3::new(a.x + x, a.y + y, wrap_angle(a.z + b.z))
}

pub(super) fn invert(a: &Vector3<f64>) -> Vector3<f64> {
    let (sin, cos) = a.z.sin_cos();
    Vector3::new(-cos * a.x - sin * a.y, sin * a.x - cos * a.y, wrap_angle(-a.z))
}

/// `a − b` with the heading in (−π, π].
pub(super) fn difference(a: &Vector3<f64>, b: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(a.x - b.x, a.y - b.y, wrap_angle(a.z - b.z))
}

#[cfg(test)]
mod tests {
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;

    use super::*;

    /// Standard deviation of a sampled covariance entry, relative, at 40,000 draws, times four.
    const SAMPLED: f64 = 0.03;

    fn relative(pose: [f64; 3], root: Matrix3<f64>) -> Relative {
        Relative { pose: Vector3::from(pose), covariance: root * root.transpose() }
    }

    fn cases() -> [Relative; 2] {
        let a = Matrix3::new(0.02, 0.0, 0.0, 0.01, 0.03, 0.0, -0.004, 0.003, 0.006);
        let b = Matrix3::new(0.04, 0.0, 0.0, -0.02, 0.01, 0.0, 0.002, 0.005, 0.004);
        [relative([3.0, -2.0, 2.5], a), relative([-1.0, 4.0, -1.7], b)]
    }

    fn typed(pose: &Vector3<f64>) -> Se2<Node, Node> {
        Se2::new(pose.x, pose.y, pose.z)
    }

    /// The oracle: covariance of what `map` makes of drawn poses.
    fn sampled(map: impl Fn(Se2<Node, Node>, Se2<Node, Node>) -> Se2<Node, Node>) -> Matrix3<f64> {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let [a, b] = cases();
        let center = map(typed(&a.pose), typed(&b.pose));
        let mut sum = Matrix3::zeros();
        let mut draw = |from: &Relative| {
            let normal = Vector3::from_fn(|_, _| rng.sample::<f64, _>(StandardNormal));
            typed(&(from.pose + Cholesky::new(from.covariance).unwrap().l() * normal))
        };
        for _ in 0..40_000 {
            let drawn = map(draw(&a), draw(&b));
            let shift = drawn.translation_m() - center.translation_m();
            let turn = wrap_angle(drawn.heading_rad() - center.heading_rad());
            let error = Vector3::new(shift.x, shift.y, turn);
            sum += error * error.transpose() / 40_000.0;
        }
        sum
    }

    fn check(found: &Relative, pose: &Se2<Node, Node>, covariance: &Matrix3<f64>) {
        let expected =
            Vector3::new(pose.translation_m().x, pose.translation_m().y, pose.heading_rad());
        assert!(difference(&found.pose, &expected).norm() < 1e-12, "{found:?} {pose:?}");
        let scale = |i: usize| covariance[(i, i)].sqrt();
        for (row, column) in [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)] {
            let off = found.covariance[(row, column)] - covariance[(row, column)];
            assert!(off.abs() < SAMPLED * scale(row) * scale(column), "{row} {column} {off}");
        }
    }

    #[test]
    fn a_chain_errs_as_drawn_chains_do() {
        let [a, b] = cases();
        check(&a.then(&b), &(typed(&a.pose) * typed(&b.pose)), &sampled(|one, two| one * two));
    }

    #[test]
    fn an_inverse_errs_as_drawn_inverses_do() {
        let [a, _] = cases();
        check(&a.inverse(), &typed(&a.pose).inverse(), &sampled(|one, _| one.inverse()));
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
