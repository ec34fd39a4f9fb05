//! How far a plot is from what a track leads one to expect, attribute by attribute.
//!
//! The association degrees of \[wide-area, eqs. (5), (7)-(9)\]:
//!
//! ```text
//! d_r = |r − r̂| / r_e   d_θ = |θ − θ̂| / θ_e   d_v = |v − v_prev| / v_e   d_s = |s − s_prev| / s_e
//! D = w_r d_r + w_θ d_θ + w_v d_v + w_s d_s,   Σ w = 1
//! ```
//!
//! Errors that are not set are those of the new plot: `r_e² = gᵀ C g` with its covariance `C` and the
//! gradient `g` of the range on the plane, `θ_e` likewise, `v_e` as the plot states it. A difference
//! of radial velocities that are known up to multiples of a wrap is the least. Where one of the two
//! plots lacks an attribute, the weights of the others are raised to sum 1.

use nalgebra::{Matrix2, Vector2};

use super::config::{PaperConfig, PerAttribute};
use super::geometry::{Gradients, Sight};
use crate::tracking::Plot;

/// No range is measured better, metres, and no angle, radians: keeps a plot right below the sensor
/// or straight ahead, where one of them does not change with the place, from having no error.
const MIN_RANGE_ERROR_M: f64 = 1e-3;
const MIN_ANGLE_ERROR_RAD: f64 = 1e-7;

/// Association degrees of range, cone angle, radial velocity and strength, where there are any.
pub(super) type Degrees = [Option<f64>; 4];

/// `r_e`, metres, of a plot of this covariance.
pub(super) fn range_error_m(config: &PaperConfig, plot: &Plot, gradients: &Gradients) -> f64 {
    set_or(config.range_error_m, || sigma(&plot.covariance_m2, &gradients.range))
        .max(MIN_RANGE_ERROR_M)
}

/// `θ_e`, radians.
pub(super) fn angle_error_rad(config: &PaperConfig, plot: &Plot, gradients: &Gradients) -> f64 {
    set_or(config.angle_error_rad, || sigma(&plot.covariance_m2, &gradients.cone))
        .max(MIN_ANGLE_ERROR_RAD)
}

/// Standard deviation of what changes by `gradient`.
fn sigma(covariance_m2: &Matrix2<f64>, gradient: &Vector2<f64>) -> f64 {
    gradient.dot(&(covariance_m2 * gradient)).max(0.0).sqrt()
}

/// A setting, or what is measured if it is 0.
fn set_or(setting: f64, measured: impl FnOnce() -> f64) -> f64 {
    if 0.0 < setting { setting } else { measured() }
}

/// Degrees of a new `plot`, seen as `seen` with `gradients`, against `expected` from the plot
/// `before`.
pub(super) fn degrees(
    config: &PaperConfig,
    (expected, before): (&Sight, &Plot),
    (seen, plot): (&Sight, &Plot),
    gradients: &Gradients,
) -> Degrees {
    let range = (seen.range_m - expected.range_m).abs();
    let cone = (seen.cone_rad - expected.cone_rad).abs();
    let radial = plot.radial.zip(before.radial).map(|(new, old)| {
        let off = new.velocity_m_per_s - old.velocity_m_per_s;
        let error = set_or(config.radial_error_m_per_s, || new.sigma_m_per_s);
        unwrapped(off, new.wrap_m_per_s).abs() / error
    });
    let strength = plot.strength_db.zip(before.strength_db);
    [
        Some(range / range_error_m(config, plot, gradients)),
        Some(cone / angle_error_rad(config, plot, gradients)),
        radial,
        strength.map(|(new, old)| (new - old).abs() / config.strength_error_db),
    ]
}

/// The value nearest to 0 that differs from `off` by a multiple of `wrap`.
fn unwrapped(off: f64, wrap: Option<f64>) -> f64 {
    wrap.map_or(off, |wrap| off - wrap * (off / wrap).round())
}

/// `D`: the weighted sum \[wide-area, eq. (9)\].
pub(super) fn weighted(degrees: &Degrees, weights: &PerAttribute) -> f64 {
    let present = || degrees.iter().zip(weights.array()).filter_map(|(d, w)| Some(((*d)?, w)));
    let total: f64 = present().map(|(_, weight)| weight).sum();
    present().map(|(degree, weight)| degree * weight).sum::<f64>() / total
}
