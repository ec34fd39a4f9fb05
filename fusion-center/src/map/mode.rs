//! Which tracker follows targets of wide-area radars, and its settings.

use serde::{Deserialize, Serialize};

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
    /// Of the association of the paper and its rivals.
    pub paper: PaperConfig,
}

impl TrackingConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first setting that makes no sense.
    pub fn check(&self) -> Result<(), InvalidSetting> {
        self.tracker().map(drop)
    }

    /// A tracker that knows nobody.
    ///
    /// # Errors
    /// If a setting makes no sense.
    pub fn tracker(&self) -> Result<Box<dyn Tracker>, InvalidSetting> {
        let mode = match self.mode {
            TrackerKind::Default | TrackerKind::Paper => Mode::Paper,
            TrackerKind::Nn => Mode::Nearest,
            TrackerKind::Belief => Mode::Belief,
        };
        Ok(Box::new(PaperTracker::new(mode, &self.paper)?))
    }
}
