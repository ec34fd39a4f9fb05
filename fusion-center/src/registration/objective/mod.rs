//! The paper's objective, the L2 cross term of two Gaussian mixtures under a rigid motion, with its
//! gradient and Hessian.
//!
//! `f(θ) = − Σ_k Σ_l Σ_j q_lj`, `q_lj = N(d; 0, S)` in 1/m², `d = z_l − (Φ z_j + t)`,
//! `S = s (R_l + Φ R_j Φᵀ)` \[registration, eq. (18)\]. The factor `s` on all covariances is the
//! role of the paper's ρ (eq. 7): with the measured covariances as they are the minima are needles
//! that no swarm finds.
//!
//! With `P = S⁻¹`, `a = P d`, `m = Φ z_j`, `u = ∂m/∂φ = Q m` (`Q` the quarter turn) and
//! `R = Φ R_j Φᵀ`, `S' = s (Q R + R Qᵀ)`, `S'' = 2 s (Q R Qᵀ − R)`, the logarithm `ℓ = ln q` has
//! `ℓ_t = a`, `ℓ_φ = aᵀu + ½ aᵀS'a − ½ tr(P S')`, `ℓ_tt = −P`, `ℓ_tφ = −P w`, `w = u + S'a`,
//! `ℓ_φφ = −wᵀPw − aᵀm + ½ aᵀS''a + ½ tr(P S' P S') − ½ tr(P S'')`,
//! and `∂f = − Σ q ∂ℓ`, `∂²f = − Σ q (∂²ℓ + ∂ℓ ∂ℓᵀ)`.
//!
//! differs: covariances turn as `Φ R Φᵀ` and not by eq. (17), because that one turns them the
//! wrong way where the decomposition returns a reflection.
//!
//! Assumes usable points, as `Prepared` leaves them. Cost: one pass over all pairs of points of
//! one period; pairs too far apart to matter cost no exponential.

use std::f64::consts::TAU;

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use proto::geom::{Node, Ref, Se2};

use super::Problem;
use super::prepared::{Blob, Motion, Prepared};

/// Beyond this squared Mahalanobis distance a Gaussian is below 1e-17 of its peak.
pub(super) const NEGLIGIBLE_CHI_SQUARE: f64 = 80.0;

/// The objective at a pose and its derivatives by `(x_m, y_m, heading_rad)`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct L2Objective {
    /// `f`, 1/m², at most 0.
    pub value_per_m2: f64,
    /// `∂f`, 1/m² per metre, metre, radian.
    pub gradient: Vector3<f64>,
    /// `∂²f`, symmetric, 1/m² per product of two of metre, metre, radian.
    pub hessian: Matrix3<f64>,
}

/// The objective and its derivatives. Points that are not finite or have no positive definite
/// covariance do not count.
#[must_use]
pub fn l2_objective(
    problem: &Problem,
    pose_ref_from_node: &Se2<Ref, Node>,
    covariance_scale: f64,
) -> L2Objective {
    let shift = pose_ref_from_node.translation_m();
    let motion = Motion::new(shift.x, shift.y, pose_ref_from_node.heading_rad());
    l2_derivatives(&Prepared::new(problem), &motion, covariance_scale)
}

/// As [`l2_objective`] of data laid out already.
pub(super) fn l2_derivatives(
    data: &Prepared,
    motion: &Motion,
    covariance_scale: f64,
) -> L2Objective {
    let mut sum = L2Objective::default();
    for_each_pair(data, motion, |point, mapped| {
        if let Some(pair) = Pair::near(point, mapped, covariance_scale) {
            pair.add_to(&mut sum, &Turned::new(motion, mapped, covariance_scale));
        }
    });
    sum
}

/// The objective alone.
pub(super) fn l2_value(data: &Prepared, motion: &Motion, covariance_scale: f64) -> f64 {
    let mut value = 0.0;
    for_each_pair(data, motion, |point, mapped| {
        value -= Pair::near(point, mapped, covariance_scale).map_or(0.0, |p| p.density_per_m2());
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

/// A pair of points that are near each other.
struct Pair {
    offset_m: [f64; 2],
    /// `S` as `[xx, xy, yy]`, m².
    cov_m2: [f64; 3],
    determinant_m4: f64,
    /// `dᵀ adj(S) d`, m⁴: the squared Mahalanobis distance times the determinant.
    distance_m4: f64,
}

impl Pair {
    /// `None` where the Gaussian is negligible.
    fn near(point: &Blob, mapped: &Blob, scale: f64) -> Option<Self> {
        let [dx, dy] = [point.x - mapped.x, point.y - mapped.y];
        let [xx, xy, yy] = [
            (point.xx + mapped.xx) * scale,
            (point.xy + mapped.xy) * scale,
            (point.yy + mapped.yy) * scale,
        ];
        let determinant_m4 = xx * yy - xy * xy;
        let distance_m4 = dx * dx * yy - 2.0 * dx * dy * xy + dy * dy * xx;
        (distance_m4 < NEGLIGIBLE_CHI_SQUARE * determinant_m4).then_some(Self {
            offset_m: [dx, dy],
            cov_m2: [xx, xy, yy],
            determinant_m4,
            distance_m4,
        })
    }

    /// `q`.
    fn density_per_m2(&self) -> f64 {
        let exponent = -0.5 * self.distance_m4 / self.determinant_m4;
        exponent.exp() / (TAU * self.determinant_m4.sqrt())
    }

    fn add_to(&self, sum: &mut L2Objective, turned: &Turned) {
        let [xx, xy, yy] = self.cov_m2;
        let precision = Matrix2::new(yy, -xy, -xy, xx) / self.determinant_m4;
        let pull = precision * Vector2::from(self.offset_m);
        let Turned { arm, first, second } = turned;
        let turn = Vector2::new(-arm.y, arm.x);
        let bent = turn + first * pull;
        let by_first = precision * first;
        let trace_second = (precision * second).trace();
        let by_heading = pull.dot(&turn) + 0.5 * pull.dot(&(first * pull)) - 0.5 * by_first.trace();
        let mixed = -(precision * bent);
        let twice_heading = bent.dot(&mixed) - pull.dot(arm)
            + 0.5 * (pull.dot(&(second * pull)) + (by_first * by_first).trace() - trace_second);
        let slope = Vector3::new(pull.x, pull.y, by_heading);
        let (px, pxy, py) = (precision[(0, 0)], precision[(0, 1)], precision[(1, 1)]);
        let curvature = Matrix3::new(
            -px,
            -pxy,
            mixed.x, //
            -pxy,
            -py,
            mixed.y, //
            mixed.x,
            mixed.y,
            twice_heading,
        );
        let density = self.density_per_m2();
        sum.value_per_m2 -= density;
        sum.gradient -= slope * density;
        sum.hessian -= (curvature + slope * slope.transpose()) * density;
    }
}

/// What the heading does to a node's point: `m`, `S'` and `S''`.
struct Turned {
    arm: Vector2<f64>,
    first: Matrix2<f64>,
    second: Matrix2<f64>,
}

impl Turned {
    fn new(motion: &Motion, mapped: &Blob, scale: f64) -> Self {
        let arm = Vector2::new(mapped.x - motion.x, mapped.y - motion.y);
        let (across, difference) = (2.0 * mapped.xy * scale, (mapped.xx - mapped.yy) * scale);
        let first = Matrix2::new(-across, difference, difference, across);
        let second = Matrix2::new(-difference, -across, -across, difference) * 2.0;
        Self { arm, first, second }
    }
}

#[cfg(test)]
mod tests;
