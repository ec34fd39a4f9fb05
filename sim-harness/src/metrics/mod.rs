//! How well a tracker follows: figures for people in a room and vehicles over a wide area alike, in
//! the plane, for any kind of identity.
//!
//! ```text
//! truths, estimates of each moment ─► Scorer ─► Score (one run) ─► counts add over runs
//!                                     └ pairs: optimal assignment, cut off at the gate
//! ```
//!
//! What each figure counts is written at its field in [`Score`].

use std::ops::RangeBounds;

use nalgebra::Matrix2;
use serde::Serialize;
use thiserror::Error;

mod assignment;
mod distance;
mod score;
mod scorer;
#[cfg(test)]
mod tests;

pub use assignment::{Costs, assignment};
pub use distance::{Gospa, OspaScale, gospa, ospa, pairs};
pub use score::Score;
pub use scorer::Scorer;

/// Somebody who is there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth<Id> {
    /// Who.
    pub id: Id,
    /// Where, metres.
    pub at_m: [f64; 2],
}

/// Somebody whom a tracker reports.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate<Id> {
    /// The track.
    pub id: Id,
    /// Where, metres.
    pub at_m: [f64; 2],
    /// How sure, square metres; `None` if the tracker does not say.
    pub covariance_m2: Option<Matrix2<f64>>,
}

/// What counts as found.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Settings {
    /// An estimate farther from a true place than this does not belong to it, metres.
    pub gate_m: f64,
    /// For so long after somebody first is there, nobody needs to have been found, seconds.
    pub allowance_s: f64,
    /// `c` of GOSPA, metres.
    pub gospa_cutoff_m: f64,
    /// `p` and `c` of OSPA.
    pub ospa: OspaScale,
}

/// A setting that makes no sense.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
#[error("scoring tracks: {field} is {value}; {remedy}")]
pub struct InvalidSettings {
    /// Which.
    pub field: &'static str,
    /// What it is.
    pub value: f64,
    /// What would do.
    pub remedy: &'static str,
}

impl Settings {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense, and what would do.
    pub fn check(&self) -> Result<(), InvalidSettings> {
        let Self { gate_m, allowance_s, gospa_cutoff_m, ospa } = *self;
        let length = "use a positive number of metres";
        within("gate_m", gate_m, f64::MIN_POSITIVE.., length)?;
        let remedy = "use 0 or a positive number of seconds";
        within("allowance_s", allowance_s, 0.0.., remedy)?;
        within("gospa_cutoff_m", gospa_cutoff_m, f64::MIN_POSITIVE.., length)?;
        let OspaScale { order, cutoff_m } = ospa;
        within("ospa.order", order, 1.0.., "use a finite number of at least 1")?;
        within("ospa.cutoff_m", cutoff_m, f64::MIN_POSITIVE.., length)
    }
}

/// Refuses what is not allowed, or not finite.
fn within(
    field: &'static str,
    value: f64,
    allowed: impl RangeBounds<f64>,
    remedy: &'static str,
) -> Result<(), InvalidSettings> {
    let is_good = allowed.contains(&value) && value.is_finite();
    is_good.then_some(()).ok_or(InvalidSettings { field, value, remedy })
}
