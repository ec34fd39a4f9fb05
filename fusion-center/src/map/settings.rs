//! How targets of wide-area radars are followed: how long dwells wait for one another, what is
//! assumed where they do not say it, the tracker, and where tracks go.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::output::OutputConfig;
use super::reorder::Patience;
use crate::tracking::TrackingConfig;
use crate::wide::WideConfig;

/// How targets of wide-area radars are followed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MapConfig {
    /// How long a dwell waits for what may come before it from other sensors, seconds.
    pub max_wait_s: f64,
    /// A sensor not heard for this long is not waited for, seconds.
    pub silent_after_s: f64,
    /// Sensors beyond this number are refused.
    pub max_sensor_count: usize,
    /// Dwells that wait; beyond this number the oldest goes on without waiting.
    pub max_waiting_count: usize,
    /// Tracks are published at most this often, seconds.
    pub publish_interval_s: f64,
    /// Tentative tracks are published too.
    pub publish_tentative: bool,
    /// What is assumed where dwells do not say it.
    pub assumed: WideConfig,
    /// The tracker.
    pub tracking: TrackingConfig,
    /// Where tracks go besides the network.
    pub output: OutputConfig,
}

impl Default for MapConfig {
    fn default() -> Self {
        Self {
            max_wait_s: 2.0,
            silent_after_s: 10.0,
            max_sensor_count: 32,
            max_waiting_count: 10_000,
            publish_interval_s: 0.5,
            publish_tentative: false,
            assumed: WideConfig::default(),
            tracking: TrackingConfig::default(),
            output: OutputConfig::default(),
        }
    }
}

impl MapConfig {
    /// The first setting that makes no sense, its value and what would do.
    #[must_use]
    pub fn complaint(&self) -> Option<String> {
        let ranges = [
            ("max_wait_s", self.max_wait_s, 0.0, 600.0),
            ("silent_after_s", self.silent_after_s, 0.1, 3600.0),
            ("max_sensor_count", self.max_sensor_count as f64, 1.0, 256.0),
            ("max_waiting_count", self.max_waiting_count as f64, 1.0, 1e6),
            ("publish_interval_s", self.publish_interval_s, 0.05, 60.0),
        ];
        for (name, value, least, most) in ranges {
            if !(least..=most).contains(&value) {
                return Some(format!("wide.{name} is {value}: use {least} to {most}"));
            }
        }
        let assumed = self.assumed.check().err().map(|error| format!("wide.assumed.{error}"));
        let tracking = self.tracking.check().err().map(|error| format!("wide.{error}"));
        assumed.or(tracking).or_else(|| self.output.complaint())
    }

    /// For the reordering.
    #[must_use]
    pub fn patience(&self) -> Patience {
        Patience {
            max_wait: Duration::from_secs_f64(self.max_wait_s.clamp(0.0, 600.0)),
            silent_after: Duration::from_secs_f64(self.silent_after_s.clamp(0.1, 3600.0)),
            max_sensor_count: self.max_sensor_count,
            max_waiting_count: self.max_waiting_count,
        }
    }
}
