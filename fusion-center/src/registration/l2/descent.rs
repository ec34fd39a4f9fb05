//! Newton's method on the paper's objective: to the minimum beside a pose.

use nalgebra::{Cholesky, Matrix3, Vector3};

use super::super::objective::{L2Objective, l2_derivatives};
use super::super::prepared::{Motion, Prepared};

/// Most steps; near a minimum four are enough.
const MAX_STEP_COUNT: usize = 60;

/// Damping relative to the Hessian's size: where an indefinite Hessian starts, by what it grows,
/// and where the descent gives up.
const FIRST_DAMPING: f64 = 1e-3;
const DAMPING_GROWTH: f64 = 4.0;
const MAX_DAMPING: f64 = 1e8;

/// A step whose expected gain is below this share of the value ends the descent: 1e-7 standard
/// deviations.
const SETTLED_GAIN: f64 = 1e-14;

/// The minimum that damped Newton steps `−(H + μ D)⁻¹ g` reach from `start`, never above it, with
/// the objective there; `D` makes heading and position alike.
pub(in super::super) fn descend(
    data: &Prepared,
    start: &Motion,
    covariance_scale: f64,
) -> (Motion, L2Objective) {
    let arm_m2 = (data.node_center_m.norm_squared() + data.node_spread_m.powi(2)).max(1.0);
    let metric = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, arm_m2));
    let (mut motion, mut at) = (*start, l2_derivatives(data, start, covariance_scale));
    for _ in 0..MAX_STEP_COUNT {
        let Some((moved, next)) = step(data, (&motion, &at), &metric, covariance_scale) else {
            break;
        };
        (motion, at) = (moved, next);
    }
    (motion, at)
}

/// The first step, with growing damping, that lowers the objective; `None` where none is left.
fn step(
    data: &Prepared,
    (from, at): (&Motion, &L2Objective),
    metric: &Matrix3<f64>,
    covariance_scale: f64,
) -> Option<(Motion, L2Objective)> {
    let size = at.hessian.component_div(&metric.map(|v| v.max(1.0))).amax();
    let mut damping = 0.0;
    while damping < MAX_DAMPING {
        let damped = at.hessian + metric * (damping * size);
        if let Some(factor) = Cholesky::new(damped) {
            let move_by = -factor.solve(&at.gradient);
            if -move_by.dot(&at.gradient) <= SETTLED_GAIN * at.value_per_m2.abs() {
                return None;
            }
            let moved = from.plus(&move_by);
            let next = l2_derivatives(data, &moved, covariance_scale);
            if next.value_per_m2 < at.value_per_m2 {
                return Some((moved, next));
            }
        }
        damping = (damping * DAMPING_GROWTH).max(FIRST_DAMPING);
    }
    None
}
