//! What is taken for true where a dwell does not say.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// In which direction radial velocities are positive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RadialConvention {
    /// Away from the sensor.
    #[default]
    Away,
    /// Towards the sensor, as some sources write it against the standard.
    Towards,
}

/// Errors and chances that dwells leave out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WideConfig {
    /// Standard deviation along the line of sight (slant) of plots that state none, metres.
    pub slant_sigma_m: f64,
    /// Standard deviation across the line of sight of plots that state none, radians as seen from the
    /// sensor.
    pub cross_sigma_rad: f64,
    /// Standard deviation of radial velocities that state none, metres per second.
    pub radial_sigma_m_per_s: f64,
    /// In which direction radial velocities are positive. The log says so if targets go against them.
    pub radial_convention: RadialConvention,
    /// Probability that a target in a dwell's area is seen, where not stated.
    pub detection_probability: f64,
    /// Slower targets are not seen, metres per second of radial velocity, where not stated.
    pub minimum_detectable_m_per_s: Option<f64>,
    /// False plots expected per square kilometre and dwell. What a job of STANAG 4607 states (J26) does not
    /// take its place: it is nominal, and a density that is too high costs tracks.
    pub clutter_per_km2: f64,
}

/// False plots per square kilometre and dwell where nobody says how many. Set on the public ten-target
/// scene, whose dwells hold 1.4 plots on average: 0.0001 and 0.001 give its ten targets, 0.01 one track
/// too many, and 0.25, that of the load scene of \[wide-area\], one too few.
const LITTLE_CLUTTER_PER_KM2: f64 = 0.001;

/// But for the clutter nothing is tuned: 10 m, 1 mrad and 2 m/s are what the radar of the public
/// ten-target set states of itself \[wide-area\].
impl Default for WideConfig {
    fn default() -> Self {
        Self {
            slant_sigma_m: 10.0,
            cross_sigma_rad: 1e-3,
            radial_sigma_m_per_s: 2.0,
            radial_convention: RadialConvention::default(),
            detection_probability: 0.9,
            minimum_detectable_m_per_s: None,
            clutter_per_km2: LITTLE_CLUTTER_PER_KM2,
        }
    }
}

/// A setting that makes no sense.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("{field} is {value}: {remedy}")]
pub struct InvalidWide {
    /// Which, as it is written in the file.
    pub field: &'static str,
    /// What it is.
    pub value: f64,
    /// What would do.
    pub remedy: &'static str,
}

impl WideConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense, and what would do.
    pub fn check(&self) -> Result<(), InvalidWide> {
        let least = self.minimum_detectable_m_per_s.unwrap_or(0.0);
        let fields = [
            ("slant_sigma_m", self.slant_sigma_m, 1e-3..=1e5, "use 0.001 to 100000 m"),
            (
                "cross_sigma_rad",
                self.cross_sigma_rad,
                1e-9..=1.0,
                "use a positive angle below 1 rad",
            ),
            (
                "radial_sigma_m_per_s",
                self.radial_sigma_m_per_s,
                1e-3..=1e3,
                "use 0.001 to 1000 m/s",
            ),
            (
                "detection_probability",
                self.detection_probability,
                0.01..=0.9999,
                "use 0.01 to 0.9999",
            ),
            ("minimum_detectable_m_per_s", least, 0.0..=1e3, "use 0 to 1000 m/s"),
            ("clutter_per_km2", self.clutter_per_km2, 1e-9..=1e6, "use 1e-9 to 1000000"),
        ];
        let wrong = fields.into_iter().find(|(_, value, allowed, _)| !allowed.contains(value));
        wrong.map_or(Ok(()), |(field, value, _, remedy)| Err(InvalidWide { field, value, remedy }))
    }
}
