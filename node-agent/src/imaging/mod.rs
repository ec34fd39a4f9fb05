//! From raw frequency samples to a coherent image: canceller, window, compression, back-projection.
//!
//! Conventions, each held by a test of the file named:
//! a scatterer of reflectivity `a` and delay `τ` answers `S(f) = a exp(−j 2π f τ)` (`compress`);
//! profiles are scaled so that it peaks at `|s| = |a|`, at `t = τ`, with the carrier removed
//! (`compress`); delays are those of both legs together (`backproject`); images are stored row by
//! row, rows along `y` (`backproject`).

use rustfft::num_complex::Complex;
use thiserror::Error;

use proto::radar::InvalidRadar;

pub mod backproject;
pub mod calibration;
pub mod canceller;
pub mod compress;
pub mod oracle;
pub mod pixels;
pub mod resample;
pub mod wall;
pub mod wall_estimate;
pub mod window;

/// One pass over the band by all channels.
#[derive(Clone, Debug, PartialEq)]
pub struct Sweep {
    /// When it was taken, seconds on the node's clock.
    pub time_s: f64,
    /// Raw samples `[channel][frequency]`, channel `t · rx_count + r`.
    pub samples: Vec<Complex<f32>>,
}

/// Why a setting makes no sense.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("{field} is {value}: {remedy}")]
pub struct InvalidSetting {
    /// Which setting, as it is written in the file.
    pub field: String,
    /// What it was, as text.
    pub value: String,
    /// What would do.
    pub remedy: &'static str,
}

impl From<InvalidRadar> for InvalidSetting {
    fn from(invalid: InvalidRadar) -> Self {
        Self { field: invalid.field.to_owned(), value: invalid.value, remedy: invalid.remedy }
    }
}

/// What is wrong with a setting: the field, what it was and what would do.
pub(crate) fn invalid(
    field: impl Into<String>,
    value: impl std::fmt::Debug,
    remedy: &'static str,
) -> InvalidSetting {
    InvalidSetting { field: field.into(), value: format!("{value:?}"), remedy }
}

/// The nearest single-precision number: what samples, tables and images are kept in.
#[expect(
    clippy::cast_possible_truncation,
    reason = "24 bits hold 140 dB, far more than the dynamic range of a sweep"
)]
pub(crate) fn single(value: f64) -> f32 {
    value as f32
}

/// [`single`] of both parts.
pub(crate) fn single_complex(value: Complex<f64>) -> Complex<f32> {
    Complex::new(single(value.re), single(value.im))
}

/// A sample in double precision: what sums over many are taken in.
pub(crate) fn double(sample: Complex<f32>) -> Complex<f64> {
    Complex::new(f64::from(sample.re), f64::from(sample.im))
}

/// The ratio of powers of `value_db`.
pub(crate) fn from_db(value_db: f64) -> f64 {
    10_f64.powf(0.1 * value_db)
}
