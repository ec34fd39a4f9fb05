//! Errors of poses, additive in `(x_m, y_m, heading_rad)`, and what they do to what poses place.
//!
//! A pose `a = (t_a, φ_a)` maps `z` to `Φ_a z + t_a`. With `r⊥ = (−r_y, r_x)`, the derivative of a
//! turned arm by the turn, and to first order in the errors, the derivatives by `(x, y, heading)` are
//! - of a point: `[I, (Φ_a z)⊥]`;
//! - of the product `a b`: `[[I, (Φ_a t_b)⊥], [0, 1]]` by `a`, `diag(Φ_a, 1)` by `b`;
//! - of the inverse, at `t'`: `−[[Φ_aᵀ, t'⊥], [0, 1]]`;
//! - of `b` seen from `a`, at `t_s`: `−[[Φ_aᵀ, t_s⊥], [0, 1]]` by `a`, `diag(Φ_aᵀ, 1)` by `b`.

use nalgebra::{Cholesky, Matrix2, Matrix2x3, Matrix3, Vector2, Vector3};

use super::{Frame, Se2, wrap_angle};

/// What a value does when the two poses that it is computed from err.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ByBoth {
    /// Derivative by `(x_m, y_m, heading_rad)` of the first pose.
    pub by_first: Matrix3<f64>,
    /// Derivative by `(x_m, y_m, heading_rad)` of the second pose.
    pub by_second: Matrix3<f64>,
}

impl<To: Frame, From: Frame> Se2<To, From> {
    /// `(x_m, y_m, heading_rad)`.
    #[must_use]
    pub fn numbers(&self) -> Vector3<f64> {
        let shift_m = self.translation_m();
        Vector3::new(shift_m.x, shift_m.y, self.heading_rad())
    }

    /// The pose with these `(x_m, y_m, heading_rad)`.
    #[must_use]
    pub fn from_numbers(numbers: &Vector3<f64>) -> Self {
        Self::new(numbers.x, numbers.y, numbers.z)
    }

    /// The pose with an error of `(x_m, y_m, heading_rad)` added.
    #[must_use]
    pub fn plus(&self, error: &Vector3<f64>) -> Self {
        Self::from_numbers(&(self.numbers() + error))
    }

    /// The error `(x_m, y_m, heading_rad)` of this pose where `other` is the truth, with the heading
    /// in (−π, π].
    #[must_use]
    pub fn minus(&self, other: &Self) -> Vector3<f64> {
        let shift_m = self.translation_m() - other.translation_m();
        let turn_rad = wrap_angle(self.heading_rad() - other.heading_rad());
        Vector3::new(shift_m.x, shift_m.y, turn_rad)
    }

    /// The same motion between other frames, where the same axes go by other names: the reference
    /// of a pair of nodes is a node, too.
    #[must_use]
    pub fn renamed<Outer: Frame, Inner: Frame>(&self) -> Se2<Outer, Inner> {
        Se2::new(self.translation_m().x, self.translation_m().y, self.heading_rad())
    }

    /// Derivative of [`Self::inverse`] by this pose.
    #[must_use]
    pub fn inverse_by_pose(&self) -> Matrix3<f64> {
        turned_back(&self.rotation(), &self.inverse().translation_m())
    }

    /// Derivatives of `self * inner`.
    #[must_use]
    pub fn product_by_poses<Inner: Frame>(&self, inner: &Se2<From, Inner>) -> ByBoth {
        let turn = self.rotation();
        let by_first = carried_by_pose(&(turn * inner.translation_m()));
        ByBoth { by_first, by_second: turned(&turn) }
    }

    /// `other` as seen from this one, `self⁻¹ other`, with its derivatives.
    #[must_use]
    pub fn between<Other: Frame>(&self, other: &Se2<To, Other>) -> (Se2<From, Other>, ByBoth) {
        let seen = self.inverse() * *other;
        let turn = self.rotation();
        let by_first = turned_back(&turn, &seen.translation_m());
        (seen, ByBoth { by_first, by_second: turned(&turn.transpose()) })
    }
}

impl ByBoth {
    /// Covariance of the value from those of the two poses, whose errors are independent.
    #[must_use]
    pub fn covariance(&self, of_first: &Matrix3<f64>, of_second: &Matrix3<f64>) -> Matrix3<f64> {
        self.by_first * of_first * self.by_first.transpose()
            + self.by_second * of_second * self.by_second.transpose()
    }
}

/// `[I, r⊥]`: derivative of where a point lies by the pose that places it; `arm_m` leads from the
/// pose's origin to the point, metres, seen in the outer frame.
#[must_use]
pub fn point_by_pose(arm_m: &Vector2<f64>) -> Matrix2x3<f64> {
    Matrix2x3::new(1.0, 0.0, -arm_m.y, 0.0, 1.0, arm_m.x)
}

/// `[[I, r⊥], [0, 1]]`: derivative of the pose of a frame that hangs at `arm_m`, as
/// [`point_by_pose`], on the frame that is posed.
#[must_use]
pub fn carried_by_pose(arm_m: &Vector2<f64>) -> Matrix3<f64> {
    Matrix3::new(1.0, 0.0, -arm_m.y, 0.0, 1.0, arm_m.x, 0.0, 0.0, 1.0)
}

/// `eᵀ C⁻¹ e` of an error `(x_m, y_m, heading_rad)`; `None` where `C` is not positive definite.
#[must_use]
pub fn squared_length(error: &Vector3<f64>, covariance: &Matrix3<f64>) -> Option<f64> {
    Some(error.dot(&Cholesky::new(*covariance)?.solve(error)))
}

/// `diag(Φ, 1)`.
fn turned(rotation: &Matrix2<f64>) -> Matrix3<f64> {
    rotation.to_homogeneous()
}

/// `−[[Φᵀ, r⊥], [0, 1]]`.
fn turned_back(rotation: &Matrix2<f64>, arm_m: &Vector2<f64>) -> Matrix3<f64> {
    let (cos, sin) = (rotation[(0, 0)], rotation[(1, 0)]);
    Matrix3::new(-cos, -sin, arm_m.y, sin, -cos, -arm_m.x, 0.0, 0.0, -1.0)
}

#[cfg(test)]
mod tests {
    use super::super::{Node, Point, Ref, World};
    use super::*;

    /// Step of the differences, metres and radians, and what their second order leaves of poses some
    /// metres long.
    const STEP: f64 = 1e-6;
    const TOLERANCE: f64 = 1e-8;

    type Pose = Se2<Ref, Node>;

    /// Headings on both sides of the wrap, and in all quadrants.
    fn poses() -> Vec<Pose> {
        let headings = [-3.1, -2.0, -0.6, 0.0, 0.9, 2.4, std::f64::consts::PI];
        headings.map(|heading| Pose::new(3.0 - heading, heading - 2.0, heading)).to_vec()
    }

    fn others() -> Vec<Se2<Node, World>> {
        [(1.0, -4.0, 3.0), (-2.5, 0.5, -1.4)].map(|(x, y, turn)| Se2::new(x, y, turn)).to_vec()
    }

    /// The oracle: central differences of `value` in the pose's numbers.
    fn differences<A: Frame, B: Frame, C: Frame, D: Frame>(
        at: &Se2<A, B>,
        value: impl Fn(&Se2<A, B>) -> Se2<C, D>,
    ) -> Matrix3<f64> {
        let column = |axis: usize| {
            let mut numbers = [at.numbers(), at.numbers()];
            numbers[0][axis] += STEP;
            numbers[1][axis] -= STEP;
            let [more, less] = numbers.map(|n| value(&Se2::new(n.x, n.y, n.z)));
            let moved = (more.translation_m() - less.translation_m()) / (2.0 * STEP);
            let turned = (more.heading_rad() - less.heading_rad() + 1.0)
                .rem_euclid(std::f64::consts::TAU)
                - 1.0;
            Vector3::new(moved.x, moved.y, turned / (2.0 * STEP))
        };
        Matrix3::from_columns(&[column(0), column(1), column(2)])
    }

    fn check(found: &Matrix3<f64>, expected: &Matrix3<f64>, what: &str) {
        assert!((found - expected).amax() < TOLERANCE, "{what}: {found} {expected}");
    }

    #[test]
    fn derivatives_are_those_of_central_differences() {
        for pose in poses() {
            check(&pose.inverse_by_pose(), &differences(&pose, |a| a.inverse()), "inverse");
            for inner in others() {
                let product = pose.product_by_poses(&inner);
                check(&product.by_first, &differences(&pose, |a| *a * inner), "product, first");
                check(&product.by_second, &differences(&inner, |b| pose * *b), "product, second");
                let outer = pose * inner;
                let (seen, between) = pose.between(&outer);
                assert!(seen.minus(&inner).norm() < TOLERANCE, "{seen:?} {inner:?}");
                let by_first = differences(&pose, |a| a.inverse() * outer);
                let by_second = differences(&outer, |b| pose.inverse() * *b);
                check(&between.by_first, &by_first, "between, first");
                check(&between.by_second, &by_second, "between, second");
            }
        }
    }

    #[test]
    fn a_point_and_a_carried_frame_move_as_differences_say() {
        let point = Point::<Node>::new(2.0, -5.0);
        let hung = Se2::<Node, World>::new(2.0, -5.0, 0.3);
        for pose in poses() {
            let arm_m = pose.rotation() * point.coords_m;
            let by_pose = differences(&pose, |a| *a * hung);
            check(&carried_by_pose(&arm_m), &by_pose, "carried");
            let of_point = by_pose.fixed_view::<2, 3>(0, 0) - point_by_pose(&arm_m);
            assert!(of_point.amax() < TOLERANCE, "{of_point}");
        }
    }

    #[test]
    fn a_difference_is_what_was_added_across_the_wrap() {
        for pose in poses() {
            for error in [Vector3::new(0.3, -0.2, 0.5), Vector3::new(-1.0, 2.0, -3.0)] {
                let off = pose.plus(&error).minus(&pose) - error;
                assert!(off.norm() < TOLERANCE, "{pose:?} {off}");
            }
            let renamed: Se2<Node, Ref> = pose.renamed();
            assert!((renamed.to_matrix() - pose.to_matrix()).amax() < TOLERANCE);
        }
    }

    #[test]
    fn covariances_of_both_add_up() {
        // By hand: a quarter turn swaps the inner pose's axes; the outer heading's error moves the
        // inner origin, 2 m ahead along y, by 2 m per radian along −x.
        let outer = Pose::new(1.0, 1.0, std::f64::consts::FRAC_PI_2);
        let inner = Se2::<Node, World>::new(2.0, 0.0, 0.0);
        let of_outer = Matrix3::from_diagonal(&Vector3::new(0.0, 0.0, 0.01));
        let of_inner = Matrix3::from_diagonal(&Vector3::new(0.04, 0.09, 0.02));
        let found = outer.product_by_poses(&inner).covariance(&of_outer, &of_inner);
        let expected = Matrix3::new(0.13, 0.0, -0.02, 0.0, 0.04, 0.0, -0.02, 0.0, 0.03);
        check(&found, &expected, "sum");
    }

    #[test]
    fn a_squared_length_counts_correlation_and_refuses_what_is_no_covariance() {
        // By hand: the inverse of [[2, 1], [1, 2]] is [[2, −1], [−1, 2]] / 3.
        let covariance = Matrix3::new(2.0, 1.0, 0.0, 1.0, 2.0, 0.0, 0.0, 0.0, 4.0);
        let found = squared_length(&Vector3::new(1.0, -1.0, 2.0), &covariance).unwrap();
        assert!((found - 3.0).abs() < TOLERANCE, "{found}");
        assert_eq!(squared_length(&Vector3::x(), &Matrix3::zeros()), None);
    }
}
