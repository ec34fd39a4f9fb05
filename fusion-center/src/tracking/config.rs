//! Settings of trackers that make no sense.

use thiserror::Error;

/// A setting of a tracker that makes no sense.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("{field} is {value}: {remedy}")]
pub struct InvalidSetting {
    /// Which, from the tracker's table on.
    pub field: String,
    /// What it is, as text.
    pub value: String,
    /// What would do.
    pub remedy: String,
}

impl InvalidSetting {
    pub(super) fn new(field: &str, value: impl ToString, remedy: &str) -> Self {
        Self { field: field.to_owned(), value: value.to_string(), remedy: remedy.to_owned() }
    }
}
