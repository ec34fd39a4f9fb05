//! Checks of fields that come from outside.

use nalgebra::{Matrix2, Matrix3};
use thiserror::Error;

use crate::measured::{MeasuredPoint, symmetric};

/// A field that makes no sense.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("{field} is {value}: {expected}")]
pub struct Invalid {
    /// Which field.
    pub field: &'static str,
    /// What it held, as text.
    pub value: String,
    /// What was expected.
    pub expected: &'static str,
}

/// Farthest coordinate that is believed, metres.
const MAX_COORDINATE_M: f64 = 1e5;
/// Largest half-depth of a target that is believed, metres.
const MAX_HALF_DEPTH_M: f64 = 2.0;
/// Smallest and largest standard deviation that is believed, metres.
const SIGMA_RANGE_M: std::ops::RangeInclusive<f64> = 1e-6..=1e4;
/// Relative asymmetry left by rounding in a matrix that was computed in f64.
const ASYMMETRY: f64 = 1e-9;

#[expect(clippy::fn_params_excessive_bools, reason = "reads like an assertion")]
pub(super) fn require(
    good: bool,
    field: &'static str,
    value: impl std::fmt::Debug,
    expected: &'static str,
) -> Result<(), Invalid> {
    if good { Ok(()) } else { Err(Invalid { field, value: format!("{value:?}"), expected }) }
}

pub(super) fn at_most(field: &'static str, count: usize, limit: usize) -> Result<(), Invalid> {
    require(count <= limit, field, count, "more entries than a message may have")
}

pub(super) fn coordinate(field: &'static str, value_m: f64) -> Result<(), Invalid> {
    let believable = value_m.is_finite() && value_m.abs() <= MAX_COORDINATE_M;
    require(believable, field, value_m, "a finite coordinate within 100 km is expected")
}

pub(super) fn finite(field: &'static str, value: f64) -> Result<(), Invalid> {
    require(value.is_finite(), field, value, "a finite number is expected")
}

pub(super) fn not_negative(field: &'static str, value: f64) -> Result<(), Invalid> {
    let good = value.is_finite() && 0.0 <= value;
    require(good, field, value, "a finite number of zero or more is expected")
}

/// A part of a whole.
pub(super) fn share(field: &'static str, value: f64) -> Result<(), Invalid> {
    require((0.0..=1.0).contains(&value), field, value, "0 to 1 is expected")
}

/// Half the depth of a target, or its spread: no body is deeper.
pub(super) fn half_depth(field: &'static str, value_m: f64) -> Result<(), Invalid> {
    let believable = (0.0..=MAX_HALF_DEPTH_M).contains(&value_m);
    require(believable, field, value_m, "0 to 2 m is expected")
}

/// A covariance of positions: finite, positive definite, with believable axes.
pub(super) fn covariance(field: &'static str, cov_m2: [f64; 3]) -> Result<(), Invalid> {
    let good = cov_m2.iter().all(|entry| entry.is_finite()) && {
        let eigenvalues = Matrix2::symmetric_eigenvalues(&symmetric(cov_m2));
        let sigma_m = |variance: f64| variance.max(0.0).sqrt();
        eigenvalues.iter().all(|variance| SIGMA_RANGE_M.contains(&sigma_m(*variance)))
    };
    require(good, field, cov_m2, "a positive definite covariance in m² is expected")
}

/// A second moment: finite, not negative.
pub(super) fn second_moment(field: &'static str, [xx, xy, yy]: [f64; 3]) -> Result<(), Invalid> {
    let finite = [xx, xy, yy].iter().all(|entry| entry.is_finite());
    let slack = 1e-9 * (1.0 + xx.abs() * yy.abs());
    let good = finite && 0.0 <= xx && 0.0 <= yy && xy * xy <= xx * yy + slack;
    require(good, field, [xx, xy, yy], "a second moment in m² is expected")
}

/// A covariance of `(x_m, y_m, heading_rad)`: finite, symmetric, positive definite; or zero, for
/// the reference node, whose pose is known exactly.
pub(super) fn pose_covariance(field: &'static str, rows: &[[f64; 3]; 3]) -> Result<(), Invalid> {
    let matrix = Matrix3::from_fn(|row, column| rows[row][column]);
    let is_zero = matrix.iter().all(|entry| entry.abs() <= 0.0);
    let good = matrix.iter().all(|entry| entry.is_finite())
        && (matrix - matrix.transpose()).norm() <= ASYMMETRY * matrix.norm()
        && (is_zero || matrix.cholesky().is_some());
    require(good, field, rows, "a symmetric positive definite matrix, or zero, is expected")
}

pub(super) fn point(point: &MeasuredPoint) -> Result<(), Invalid> {
    coordinate("points.x_m", point.x_m)?;
    coordinate("points.y_m", point.y_m)?;
    covariance("points.cov_m2", point.cov_m2)?;
    second_moment("points.extent_m2", point.extent_m2)?;
    finite("points.snr_db", point.snr_db)?;
    point.radial_velocity_m_per_s.map_or(Ok(()), |v| finite("points.radial_velocity_m_per_s", v))
}
