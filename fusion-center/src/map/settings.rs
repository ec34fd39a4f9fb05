//! What is assumed of wide-area radars that do not say it, and how long the centre waits for them.

use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::mode::TrackingConfig;
use super::output::OutputConfig;
use super::reorder::Patience;

/// How targets of wide-area radars are followed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WideConfig {
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
    pub assumed: AssumedConfig,
    /// The tracker.
    pub tracking: TrackingConfig,
    /// Where tracks go besides the network.
    pub output: OutputConfig,
}

/// What is assumed where dwells do not say it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AssumedConfig {
    /// Standard deviation along the line of sight (slant), metres.
    pub slant_sigma_m: f64,
    /// Standard deviation across the line of sight, metres.
    pub cross_sigma_m: f64,
    /// Standard deviation of the radial velocity, metres per second.
    pub radial_sigma_m_per_s: f64,
    /// Probability that a target in the area is seen.
    pub detection_probability: f64,
    /// False plots per square metre of the area in a dwell.
    pub clutter_per_m2: f64,
    /// What the radial velocities of the data mean.
    pub radial: RadialSign,
}

/// What the radial velocities of the data mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RadialSign {
    /// Positive away from the sensor, as STANAG 4607 has them.
    #[default]
    Receding,
    /// Positive towards the sensor.
    Approaching,
    /// Nothing: they are left out.
    Unused,
}

impl Default for AssumedConfig {
    /// Deviations and clutter are those of the load scene of \[wide-area\]: σ 20 m, 200 false plots
    /// on 800 km², detected with probability 0.9, radial velocity to 1 m/s.
    fn default() -> Self {
        Self {
            slant_sigma_m: 20.0,
            cross_sigma_m: 20.0,
            radial_sigma_m_per_s: 1.0,
            detection_probability: 0.9,
            clutter_per_m2: 2.5e-7,
            radial: RadialSign::Receding,
        }
    }
}

impl Default for WideConfig {
    fn default() -> Self {
        Self {
            max_wait_s: 2.0,
            silent_after_s: 10.0,
            max_sensor_count: 32,
            max_waiting_count: 10_000,
            publish_interval_s: 0.5,
            publish_tentative: false,
            assumed: AssumedConfig::default(),
            tracking: TrackingConfig::default(),
            output: OutputConfig::default(),
        }
    }
}

impl WideConfig {
    /// The first setting that makes no sense, its value and what would do.
    #[must_use]
    pub fn complaint(&self) -> Option<String> {
        let AssumedConfig { slant_sigma_m, cross_sigma_m, radial_sigma_m_per_s, .. } = self.assumed;
        let ranges = [
            ("max_wait_s", self.max_wait_s, 0.0, 600.0),
            ("silent_after_s", self.silent_after_s, 0.1, 3600.0),
            ("max_sensor_count", self.max_sensor_count as f64, 1.0, 256.0),
            ("max_waiting_count", self.max_waiting_count as f64, 1.0, 1e6),
            ("publish_interval_s", self.publish_interval_s, 0.05, 60.0),
            ("assumed.slant_sigma_m", slant_sigma_m, 1e-3, 1e4),
            ("assumed.cross_sigma_m", cross_sigma_m, 1e-3, 1e4),
            ("assumed.radial_sigma_m_per_s", radial_sigma_m_per_s, 1e-3, 100.0),
            ("assumed.detection_probability", self.assumed.detection_probability, 0.01, 0.9999),
            ("assumed.clutter_per_m2", self.assumed.clutter_per_m2, 1e-15, 1.0),
        ];
        for (name, value, least, most) in ranges {
            if !(least..=most).contains(&value) {
                return Some(format!("wide.{name} is {value}: use {least} to {most}"));
            }
        }
        let tracking = self.tracking.check().err().map(|error| format!("wide.tracking: {error}"));
        tracking.or_else(|| self.output.complaint())
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
