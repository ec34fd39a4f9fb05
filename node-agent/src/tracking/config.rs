//! Which tracker follows people, and its settings.

use serde::{Deserialize, Serialize};

use super::Tracker;
use super::default::{BodyModel, DefaultConfig, DefaultTracker};
use super::paper::{PaperConfig, PaperTracker};
use crate::imaging::InvalidSetting;

/// Which tracker follows people.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TrackingMode {
    /// Nobody is followed.
    #[default]
    Off,
    /// The best one.
    Default,
    /// That of the paper \[mean-shift\].
    Paper,
}

/// How people are followed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrackingConfig {
    /// Which tracker.
    pub mode: TrackingMode,
    /// Settings of the paper's tracker.
    pub paper: PaperConfig,
    /// Settings of the default tracker.
    pub default: DefaultConfig,
}

impl TrackingConfig {
    /// Checks every field, also those of the tracker that is not chosen.
    ///
    /// # Errors
    /// Names the first field that makes no sense, from `tracking` on, and what would do.
    pub fn check(&self) -> Result<(), InvalidSetting> {
        let checked = self.paper.check().and_then(|()| self.default.check());
        // One of the two names its fields from the file's root on.
        checked.map_err(|InvalidSetting { field, value, remedy }| {
            let field = field.strip_prefix("tracking.").unwrap_or(&field);
            InvalidSetting { field: format!("tracking.{field}"), value, remedy }
        })
    }

    /// A tracker that knows nobody yet, of points with that `body`; `None` if nobody is to be followed.
    ///
    /// # Errors
    /// If a setting makes no sense.
    pub fn tracker(&self, body: BodyModel) -> Result<Option<Box<dyn Tracker>>, InvalidSetting> {
        Ok(match self.mode {
            TrackingMode::Off => None,
            TrackingMode::Default => Some(Box::new(DefaultTracker::new(&self.default, body)?)),
            TrackingMode::Paper => Some(Box::new(PaperTracker::new(&self.paper)?)),
        })
    }

    /// How far behind the positions of tracks people's middles lie and the standard deviation of
    /// that, metres, where the same of measured points is `of_points_m`. The paper's tracker follows
    /// what is seen; the default one says middles, with that error in their covariances.
    #[must_use]
    pub fn half_depth_m(&self, of_points_m: (f64, f64)) -> (f64, f64) {
        match self.mode {
            TrackingMode::Paper => of_points_m,
            TrackingMode::Off | TrackingMode::Default => (0.0, 0.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_chosen_tracker_is_built_and_nonsense_named_from_the_root_on() {
        let mut config = TrackingConfig::default();
        assert!(config.tracker(BodyModel::default()).unwrap().is_none());
        for mode in [TrackingMode::Default, TrackingMode::Paper] {
            config.mode = mode;
            assert!(config.tracker(BodyModel::default()).unwrap().is_some());
        }
        config.paper.bin_count = 1;
        assert_eq!(config.check().unwrap_err().field, "tracking.paper.bin_count");
        assert!(config.tracker(BodyModel::default()).is_err());
        config.paper = PaperConfig::default();
        config.default.min_appearance = 2.0;
        assert_eq!(config.check().unwrap_err().field, "tracking.default.min_appearance");
    }

    #[test]
    fn only_what_follows_surfaces_leaves_the_half_depth_to_the_listener() {
        let of =
            |mode| TrackingConfig { mode, ..TrackingConfig::default() }.half_depth_m((0.1, 0.05));
        assert_eq!(of(TrackingMode::Paper), (0.1, 0.05));
        assert_eq!(of(TrackingMode::Default), (0.0, 0.0));
    }
}
