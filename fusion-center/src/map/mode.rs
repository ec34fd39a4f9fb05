//! Which tracker follows targets of wide-area radars, and its settings.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::tracking::default::{ConfigError, DefaultConfig, DefaultTracker};
use crate::tracking::paper::{Mode, PaperConfig, PaperTracker};
use crate::tracking::{InvalidSetting, Tracker};

/// Which tracker.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TrackerKind {
    /// Ours.
    #[default]
    Default,
    /// The global optimum of the association degrees \[wide-area\].
    Paper,
    /// The nearest neighbour by the same degrees.
    Nn,
    /// Belief functions.
    Belief,
}

/// Which tracker, and the settings of each.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrackingConfig {
    /// Which.
    pub mode: TrackerKind,
    /// Of ours.
    pub default: DefaultConfig,
    /// Of the association of the paper and its rivals.
    pub paper: PaperConfig,
}

/// A setting of a tracker that makes no sense.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum InvalidTracker {
    /// Of ours.
    #[error("default: {0}")]
    Default(#[from] ConfigError),
    /// Of the association of the paper and its rivals.
    #[error("paper: {0}")]
    Paper(#[from] InvalidSetting),
}

impl TrackingConfig {
    /// Checks the settings of all trackers.
    ///
    /// # Errors
    /// Names the first setting that makes no sense.
    pub fn check(&self) -> Result<(), InvalidTracker> {
        self.default.check()?;
        Ok(PaperTracker::new(Mode::Paper, &self.paper).map(drop)?)
    }

    /// A tracker that knows nobody.
    ///
    /// # Errors
    /// If a setting makes no sense.
    pub fn tracker(&self) -> Result<Box<dyn Tracker>, InvalidTracker> {
        let mode = match self.mode {
            TrackerKind::Default => {
                return Ok(Box::new(DefaultTracker::new(self.default.clone())?));
            }
            TrackerKind::Paper => Mode::Paper,
            TrackerKind::Nn => Mode::Nearest,
            TrackerKind::Belief => Mode::Belief,
        };
        Ok(Box::new(PaperTracker::new(mode, &self.paper)?))
    }
}
