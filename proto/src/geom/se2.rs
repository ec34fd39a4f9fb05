//! Rigid motions of the plane, SE(2), with both frames in the type.
//!
//! `pose_a_from_b: Se2<A, B>` maps coordinates in `B` to coordinates in `A`:
//! `z_a = Φ(φ) z_b + [Δx, Δy]`, `Φ = [[cos φ, −sin φ], [sin φ, cos φ]]`
//! \[registration, eq. (9)\]. It is also the pose of `B`'s origin and axes in `A`.
//!
//! Tangents are ordered `[x, y, theta]`; `exp` and `log` are those of the group, updates multiply
//! from the left: `exp(ξ) · pose`.

use std::fmt;
use std::marker::PhantomData;
use std::ops::Mul;

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

use super::{Frame, Gaussian, Point};

/// An element of se(2): `[x, y, theta]` in metres, metres and radians.
pub type Tangent = Vector3<f64>;

/// Below this angle the closed forms of `exp` and `log` lose digits to `0/0`; the series is exact
/// to rounding there (its first dropped term is angle⁴/120).
const SMALL_ANGLE_RAD: f64 = 1e-4;

/// The rigid motion that takes coordinates in `From` to coordinates in `To`.
#[derive(Clone, Copy, PartialEq)]
pub struct Se2<To: Frame, From: Frame> {
    translation_m: Vector2<f64>,
    heading_rad: f64,
    frames: PhantomData<(To, From)>,
}

impl<To: Frame, From: Frame> Se2<To, From> {
    /// The motion that turns by `heading_rad` and then moves by `(x_m, y_m)`, both seen in `To`.
    #[must_use]
    pub fn new(x_m: f64, y_m: f64, heading_rad: f64) -> Self {
        let translation_m = Vector2::new(x_m, y_m);
        Self { translation_m, heading_rad: wrap_angle(heading_rad), frames: PhantomData }
    }

    /// The motion that changes nothing: both frames coincide.
    #[must_use]
    pub fn identity() -> Self {
        Self::new(0.0, 0.0, 0.0)
    }

    /// Where the origin of `From` lies in `To`, metres.
    #[must_use]
    pub fn translation_m(&self) -> Vector2<f64> {
        self.translation_m
    }

    /// How far `From` is turned against `To`, in (−π, π], counter-clockwise.
    #[must_use]
    pub fn heading_rad(&self) -> f64 {
        self.heading_rad
    }

    /// The rotation matrix Φ.
    #[must_use]
    pub fn rotation(&self) -> Matrix2<f64> {
        let (sin, cos) = self.heading_rad.sin_cos();
        Matrix2::new(cos, -sin, sin, cos)
    }

    /// The motion back, from `To` to `From`.
    #[must_use]
    pub fn inverse(&self) -> Se2<From, To> {
        let moved = -(self.rotation().transpose() * self.translation_m);
        Se2::new(moved.x, moved.y, -self.heading_rad)
    }

    /// The motion reached by following the constant twist `tangent` for one unit of time.
    #[must_use]
    pub fn exp(tangent: &Tangent) -> Self {
        let moved = left_jacobian(tangent.z) * tangent.xy();
        Self::new(moved.x, moved.y, tangent.z)
    }

    /// The twist whose [`Self::exp`] is this motion, with its angle in (−π, π].
    #[must_use]
    pub fn log(&self) -> Tangent {
        let angle = self.heading_rad;
        let half = 0.5 * angle;
        let diagonal = if angle.abs() < SMALL_ANGLE_RAD {
            1.0 - angle * angle / 12.0
        } else {
            half * half.cos() / half.sin()
        };
        let inverse = Matrix2::new(diagonal, half, -half, diagonal);
        let linear = inverse * self.translation_m;
        Tangent::new(linear.x, linear.y, angle)
    }

    /// The adjoint: `T · exp(ξ) = exp(Ad_T ξ) · T`, with `ξ` in `From` and `Ad_T ξ` in `To`.
    #[must_use]
    pub fn adjoint(&self) -> Matrix3<f64> {
        let (sin, cos) = self.heading_rad.sin_cos();
        let t = self.translation_m;
        Matrix3::new(cos, -sin, t.y, sin, cos, -t.x, 0.0, 0.0, 1.0)
    }

    /// The 3×3 homogeneous matrix.
    #[must_use]
    pub fn to_matrix(&self) -> Matrix3<f64> {
        let (sin, cos) = self.heading_rad.sin_cos();
        let t = self.translation_m;
        Matrix3::new(cos, -sin, t.x, sin, cos, t.y, 0.0, 0.0, 1.0)
    }
}

/// `V(θ)` of `exp`: the integral of the rotation along the twist.
fn left_jacobian(angle_rad: f64) -> Matrix2<f64> {
    let (along, across) = if angle_rad.abs() < SMALL_ANGLE_RAD {
        (1.0 - angle_rad * angle_rad / 6.0, 0.5 * angle_rad)
    } else {
        (angle_rad.sin() / angle_rad, (1.0 - angle_rad.cos()) / angle_rad)
    };
    Matrix2::new(along, -across, across, along)
}

/// The same angle in (−π, π].
#[must_use]
pub fn wrap_angle(angle_rad: f64) -> f64 {
    let turn = std::f64::consts::TAU;
    let wrapped = angle_rad.rem_euclid(turn);
    if std::f64::consts::PI < wrapped { wrapped - turn } else { wrapped }
}

impl<To: Frame, Via: Frame, From: Frame> Mul<Se2<Via, From>> for Se2<To, Via> {
    type Output = Se2<To, From>;

    fn mul(self, right: Se2<Via, From>) -> Se2<To, From> {
        let moved = self.rotation() * right.translation_m + self.translation_m;
        Se2::new(moved.x, moved.y, self.heading_rad + right.heading_rad)
    }
}

impl<To: Frame, From: Frame> Mul<Point<From>> for Se2<To, From> {
    type Output = Point<To>;

    fn mul(self, point: Point<From>) -> Point<To> {
        Point::from_coords(self.rotation() * point.coords_m + self.translation_m)
    }
}

impl<To: Frame, From: Frame> Mul<Gaussian<From>> for Se2<To, From> {
    type Output = Gaussian<To>;

    /// Covariances turn as `Φ R Φᵀ`.
    ///
    /// differs: \[registration, eq. (17)\] writes `(UΦ) S (UΦ)ᵀ`, because that is the same only
    /// where the decomposition's `U` is a proper rotation.
    fn mul(self, gaussian: Gaussian<From>) -> Gaussian<To> {
        let rotation = self.rotation();
        let cov_m2 = rotation * gaussian.cov_m2 * rotation.transpose();
        Gaussian { mean: self * gaussian.mean, cov_m2 }
    }
}

impl<To: Frame, From: Frame> fmt::Debug for Se2<To, From> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (t, heading) = (self.translation_m, self.heading_rad);
        write!(f, "Se2({:.4} m, {:.4} m, {:.3}°)", t.x, t.y, heading.to_degrees())
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::super::{Node, Ref, World};
    use super::*;

    type Pose = Se2<Ref, Node>;

    /// Both signs, zero, both sides of the series switch, and the wrap.
    const ANGLES_RAD: [f64; 11] =
        [-PI + 1e-9, -2.0, -0.7, -1.1e-4, -0.9e-4, 0.0, 0.9e-4, 1.1e-4, 0.7, 2.0, PI];

    /// Rounding of a few dozen f64 operations on numbers of order ten.
    const TOLERANCE: f64 = 1e-10;

    fn hat(t: &Tangent) -> Matrix3<f64> {
        Matrix3::new(0.0, -t.z, t.x, t.z, 0.0, t.y, 0.0, 0.0, 0.0)
    }

    /// The oracle: the matrix exponential by scaling, a long Taylor sum, and squaring.
    fn exp_oracle(tangent: &Tangent) -> Matrix3<f64> {
        let step = hat(tangent) / 1024.0;
        let mut term = Matrix3::identity();
        let mut sum = Matrix3::identity();
        for order in 1..20 {
            term = term * step / f64::from(order);
            sum += term;
        }
        (0..10).fold(sum, |power, _| power * power)
    }

    fn tangents() -> impl Iterator<Item = Tangent> {
        ANGLES_RAD.into_iter().flat_map(|angle| {
            [(0.0, 0.0), (3.0, -2.0), (-0.5, 7.0)].map(|(x, y)| Tangent::new(x, y, angle))
        })
    }

    #[test]
    fn exp_is_the_matrix_exponential() {
        for tangent in tangents() {
            let error = (Pose::exp(&tangent).to_matrix() - exp_oracle(&tangent)).norm();
            assert!(error < TOLERANCE, "{tangent:?}: {error}");
        }
    }

    #[test]
    fn log_names_the_twist_that_the_oracle_followed() {
        for tangent in tangents() {
            let matrix = exp_oracle(&tangent);
            let heading = matrix[(1, 0)].atan2(matrix[(0, 0)]);
            let log = Pose::new(matrix[(0, 2)], matrix[(1, 2)], heading).log();
            let turns = (log.z - tangent.z).rem_euclid(2.0 * PI);
            assert!(turns.min(2.0 * PI - turns) < TOLERANCE, "{tangent:?} {log:?}");
            if tangent.z.abs() < 3.0 {
                assert!((log - tangent).norm() < TOLERANCE, "{tangent:?} {log:?}");
            }
        }
    }

    #[test]
    fn adjoint_is_conjugation() {
        for tangent in tangents() {
            for pose_tangent in [Tangent::new(1.0, -4.0, 2.5), Tangent::new(-2.0, 0.3, -0.4)] {
                let pose = exp_oracle(&pose_tangent);
                let inverse = pose.try_inverse().unwrap();
                let moved = Pose::exp(&pose_tangent).adjoint() * tangent;
                let error = (hat(&moved) - pose * hat(&tangent) * inverse).norm();
                assert!(error < 1e-9, "{tangent:?} {pose_tangent:?}: {error}");
            }
        }
    }

    #[test]
    fn products_and_inverses_are_those_of_matrices() {
        let a = Se2::<Ref, World>::new(1.0, -2.0, 2.9);
        let b = Se2::<World, Node>::new(0.5, 4.0, 1.7);
        let product = a.to_matrix() * b.to_matrix();
        assert!(((a * b).to_matrix() - product).norm() < TOLERANCE);
        let inverse = a.to_matrix().try_inverse().unwrap();
        assert!((a.inverse().to_matrix() - inverse).norm() < TOLERANCE);
        let point = a * Point::<World>::new(3.0, -1.0);
        let expected = a.to_matrix() * Vector3::new(3.0, -1.0, 1.0);
        assert!((point.coords_m - expected.xy()).norm() < TOLERANCE);
    }

    #[test]
    fn a_node_at_the_left_wall_maps_as_the_specification_says() {
        // Reference at (5, 0) looking along +y, node at (0, 5) looking along +x: the target at
        // (2, 3) is (2, 2) in the node's frame and (−3, 3) in the reference frame.
        let pose_ref_from_node = Pose::new(-5.0, 5.0, -PI / 2.0);
        let point_in_ref = pose_ref_from_node * Point::new(2.0, 2.0);
        assert!((point_in_ref.coords_m - Vector2::new(-3.0, 3.0)).norm() < TOLERANCE);
    }

    #[test]
    fn covariance_turns_with_the_frame() {
        // A quarter turn swaps the variances; an eighth turn of diag(4, 1) is [[2.5, 1.5], ..].
        let cov_m2 = Matrix2::new(4.0, 0.0, 0.0, 1.0);
        let gaussian = Gaussian { mean: Point::new(0.0, 0.0), cov_m2 };
        let quarter = Pose::new(0.0, 0.0, PI / 2.0) * gaussian;
        assert!((quarter.cov_m2 - Matrix2::new(1.0, 0.0, 0.0, 4.0)).norm() < TOLERANCE);
        let eighth = Pose::new(0.0, 0.0, PI / 4.0) * gaussian;
        assert!((eighth.cov_m2 - Matrix2::new(2.5, 1.5, 1.5, 2.5)).norm() < TOLERANCE);
    }

    #[test]
    fn angles_wrap_to_half_open_turn() {
        for (angle, wrapped) in
            [(PI, PI), (-PI, PI), (3.0 * PI, PI), (-0.5, -0.5), (6.5, 6.5 - 2.0 * PI)]
        {
            assert!((wrap_angle(angle) - wrapped).abs() < 1e-12, "{angle}");
        }
    }
}
