//! The filter of the smoothing that follows association: constant velocity, pushed by white noise.
//!
//! Per axis `F = [1 T; 0 1]`, `Q = q [T³/3 T²/2; T²/2 T]`, `z = p + n`, `n ~ N(0, C)` with the plot's
//! covariance `C`. Metres, seconds, `q` in m²/s³. It sees positions only and has no say in what is
//! associated.

use std::f64::consts::TAU;
use std::ops::SubAssign;

use nalgebra::{Matrix2x4, Matrix4, Vector4};

use crate::tracking::Plot;
use crate::tracking::smooth::{Belief, Pass};

/// What is known of a target from its first plot; either component of its velocity has the standard
/// deviation `speed_m_per_s`.
pub(super) fn first(plot: &Plot, speed_m_per_s: f64) -> Belief {
    let mut mean = Vector4::zeros();
    mean.fixed_rows_mut::<2>(0).copy_from(&plot.position_m);
    let mut covariance = Matrix4::identity() * speed_m_per_s.powi(2);
    covariance.fixed_view_mut::<2, 2>(0, 0).copy_from(&plot.covariance_m2);
    Belief { mean, covariance }
}

/// The step over `dt_s` without measurement, with `q` in m²/s³.
pub(super) fn coasted(before: &Belief, dt_s: f64, q: f64) -> Pass {
    let mut transition = Matrix4::identity();
    let mut noise = Matrix4::zeros();
    for axis in 0..2 {
        transition[(axis, axis + 2)] = dt_s;
        noise[(axis, axis)] = q * dt_s.powi(3) / 3.0;
        noise[(axis, axis + 2)] = q * dt_s.powi(2) / 2.0;
        noise[(axis + 2, axis)] = q * dt_s.powi(2) / 2.0;
        noise[(axis + 2, axis + 2)] = q * dt_s;
    }
    let predicted = Belief {
        mean: transition * before.mean,
        covariance: transition * before.covariance * transition.transpose() + noise,
    };
    Pass { transition, predicted, filtered: predicted }
}

/// What is known with `plot`, and the logarithm of the plot's density before it was seen (per m²);
/// nothing if rounding leaves no covariance of it. `P = (I − K H) P⁻ (I − K H)ᵀ + K C Kᵀ`
/// stays one where `P⁻ − K H P⁻` does not, after a long pause.
pub(super) fn updated(predicted: &Belief, plot: &Plot) -> Option<(Belief, f64)> {
    let Belief { mean, covariance } = predicted;
    let rows: Matrix2x4<f64> = covariance.fixed_view::<2, 4>(0, 0).into_owned();
    let spread = rows.fixed_view::<2, 2>(0, 0) + plot.covariance_m2;
    let factor = spread.cholesky()?;
    let off_m = plot.position_m - mean.fixed_rows::<2>(0);
    let scaled = factor.solve(&off_m);
    let gain = factor.solve(&rows).transpose();
    let mut rest = Matrix4::identity();
    rest.fixed_columns_mut::<2>(0).sub_assign(&gain);
    let joseph =
        rest * covariance * rest.transpose() + gain * plot.covariance_m2 * gain.transpose();
    let filtered = Belief {
        mean: mean + rows.transpose() * scaled,
        covariance: 0.5 * (joseph + joseph.transpose()),
    };
    if !filtered.is_sound() {
        return None;
    }
    let log_density = -0.5 * (off_m.dot(&scaled) + (TAU.powi(2) * spread.determinant()).ln());
    Some((filtered, log_density))
}
