//! The settings of detection and the three sets of them that are in use.

use serde::{Deserialize, Serialize};

use crate::imaging::{InvalidSetting, invalid};

use super::moments::Centroid;

/// What counts as standing out.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Threshold {
    /// Above the noise.
    Noise {
        /// Power over the noise power of a pixel; with a second look, the power that a point
        /// explains over the noise power, which has no loss by the window.
        #[serde(default = "default_power_ratio")]
        power_ratio: f64,
        /// Coherence factor.
        #[serde(default = "default_min_coherence")]
        min_coherence: f64,
    },
    /// Above a fraction of the largest amplitude of the image, as the seed has it: finds weak
    /// targets only if there is no strong one, and always finds something.
    Relative {
        /// The fraction, 0 to 1.
        fraction: f64,
    },
}

/// Whether broad or neighbouring peaks are looked at again with a model.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum SecondLook {
    /// Moments only.
    Off,
    /// One against two point responses; what neither explains gets its extent as error.
    TwoPoints {
        /// Two points nearer than this, metres, are taken as one target: the width of a person.
        min_separation_m: f64,
    },
}

/// Where the covariance of a point comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Covariance {
    /// From the noise that was measured.
    #[default]
    Measured,
    /// A multiple of the second moment of the region \[registration, eq. (7)\]: a size, not an
    /// error. The seed does not give the scale.
    ScaledMoment {
        /// The multiple `ρ`.
        scale: f64,
    },
}

/// Which peaks are taken for what a stronger target throws elsewhere, not for targets.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Ghosts {
    /// None is looked for.
    Keep,
    /// Sidelobes, echoes inside the wall, and second peaks of one body are dropped.
    Drop {
        /// A peak must stand out this much of the sidelobes of all stronger ones, decibels.
        #[serde(default = "default_sidelobe_margin_db")]
        sidelobe_margin_db: f64,
        /// Behind a target by the wall's optical thickness, a peak this much weaker is an echo
        /// inside the wall, decibels. Of no effect if the chain has no wall.
        #[serde(default = "default_wall_echo_db")]
        wall_echo_db: f64,
        /// Peaks nearer than this to a stronger one belong to the same body, metres; 0 for points.
        /// A good quarter of it before and behind a peak, the body throws sidelobes of its own.
        #[serde(default = "default_body_m")]
        body_m: f64,
    },
}

/// Settings of detection.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DetectionConfig {
    /// What counts as standing out.
    pub threshold: Threshold,
    /// Nothing is detected nearer to the array than this along boresight: there all channels agree.
    pub min_depth_m: f64,
    /// Peaks nearer than this in range and ...
    pub separation_range_m: f64,
    /// ... this in the sine of the angle are one.
    pub separation_sine: f64,
    /// Which peaks are no targets.
    pub ghosts: Ghosts,
    /// Which moments give the point.
    pub centroid: Centroid,
    /// Where the covariance comes from.
    pub covariance: Covariance,
    /// Standard deviation in range of what a target reflects: 0 for points.
    pub glint_range_m: f64,
    /// The same across: 0 for points.
    pub glint_cross_m: f64,
    /// What is done about broad and neighbouring peaks.
    pub second_look: SecondLook,
}

impl Default for DetectionConfig {
    fn default() -> Self {
        Self::people()
    }
}

fn default_power_ratio() -> f64 {
    14.0
}

fn default_min_coherence() -> f64 {
    0.25
}

fn default_sidelobe_margin_db() -> f64 {
    8.0
}

fn default_wall_echo_db() -> f64 {
    22.0
}

fn default_body_m() -> f64 {
    0.55
}

impl DetectionConfig {
    /// For targets smaller than the wavelength: measured at the bound, near ones resolved. The
    /// threshold finds 98.3 % of the crossing targets of falling amplitude, 23 dB at the strongest,
    /// at 0.04 false points in a run of 8 sweeps.
    #[must_use]
    pub fn points() -> Self {
        Self {
            threshold: Threshold::Noise { power_ratio: 13.6, min_coherence: 0.25 },
            min_depth_m: 0.4,
            separation_range_m: 0.22,
            separation_sine: 0.12,
            ghosts: Ghosts::Drop { sidelobe_margin_db: 4.0, wall_echo_db: 22.0, body_m: 0.0 },
            centroid: Centroid::PolarPower,
            covariance: Covariance::Measured,
            glint_range_m: 0.0,
            glint_cross_m: 0.0,
            second_look: SecondLook::TwoPoints { min_separation_m: 0.6 },
        }
    }

    /// For people: one point for each, with the wander of what a body reflects in its covariance.
    /// Fitted together with a half depth of 0.10 m ± 0.05 m on 84 simulated walks with limbs
    /// (radial, tangential, oblique and turning, 0.5 to 1.5 m/s, 2 m to 8 m, 15 to 35 dB in the
    /// image); on 84 others the mean NEES is 1.75, between 1.6 and 1.95 for each way, range and SNR.
    #[must_use]
    pub fn people() -> Self {
        Self {
            threshold: Threshold::Noise { power_ratio: 14.0, min_coherence: 0.25 },
            ghosts: Ghosts::Drop { sidelobe_margin_db: 8.0, wall_echo_db: 22.0, body_m: 0.55 },
            glint_range_m: 0.07,
            glint_cross_m: 0.115,
            second_look: SecondLook::Off,
            ..Self::points()
        }
    }

    /// What the seed does \[registration, section 4\]: half of the largest amplitude, binary
    /// moments, and a scaled second moment as covariance. The seed does not give the scale; this
    /// one is right for points at 8 dB.
    #[must_use]
    pub fn paper() -> Self {
        Self {
            threshold: Threshold::Relative { fraction: 0.5 },
            ghosts: Ghosts::Keep,
            centroid: Centroid::Binary,
            covariance: Covariance::ScaledMoment { scale: 0.075 },
            second_look: SecondLook::Off,
            ..Self::points()
        }
    }

    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), InvalidSetting> {
        self.check_threshold()?;
        self.check_positive()?;
        self.check_ghosts()?;
        let min_separation_m = match self.second_look {
            SecondLook::Off => 0.0,
            SecondLook::TwoPoints { min_separation_m } => min_separation_m,
        };
        let metres = "use 0 or a positive number of metres";
        for (field, value) in [
            ("detection.glint_range_m", self.glint_range_m),
            ("detection.glint_cross_m", self.glint_cross_m),
            ("detection.second_look.two_points.min_separation_m", min_separation_m),
        ] {
            check_range(field, value, 0.0..1e3, metres)?;
        }
        Ok(())
    }

    fn check_positive(&self) -> Result<(), InvalidSetting> {
        let metres = "use a positive number of metres";
        let scale = match self.covariance {
            Covariance::Measured => 1.0,
            Covariance::ScaledMoment { scale } => scale,
        };
        for (field, value, remedy) in [
            ("detection.min_depth_m", self.min_depth_m, metres),
            ("detection.separation_range_m", self.separation_range_m, metres),
            ("detection.separation_sine", self.separation_sine, "use more than 0, about 0.12"),
            ("detection.covariance.scaled_moment.scale", scale, "use more than 0, about 0.075"),
        ] {
            check_range(field, value, f64::MIN_POSITIVE..1e3, remedy)?;
        }
        Ok(())
    }

    fn check_threshold(&self) -> Result<(), InvalidSetting> {
        match self.threshold {
            Threshold::Noise { power_ratio, min_coherence } => {
                let of_power = "detection.threshold.noise.power_ratio";
                check_range(of_power, power_ratio, 1.0..1e6, "use more than 1, about 14")?;
                let of_coherence = "detection.threshold.noise.min_coherence";
                check_range(of_coherence, min_coherence, 0.0..1.0, "use 0 to 1, about 0.25")
            }
            Threshold::Relative { fraction } => {
                let field = "detection.threshold.relative.fraction";
                check_range(field, fraction, 0.0..1.0, "use 0 to 1, about 0.5")
            }
        }
    }

    fn check_ghosts(&self) -> Result<(), InvalidSetting> {
        let Ghosts::Drop { sidelobe_margin_db, wall_echo_db, body_m } = self.ghosts else {
            return Ok(());
        };
        let decibels = "use 0 to 100 dB";
        for (field, value, most, remedy) in [
            ("detection.ghosts.drop.sidelobe_margin_db", sidelobe_margin_db, 100.0, decibels),
            ("detection.ghosts.drop.wall_echo_db", wall_echo_db, 100.0, decibels),
            ("detection.ghosts.drop.body_m", body_m, 5.0, "use 0 to 5 m"),
        ] {
            check_range(field, value, 0.0..most, remedy)?;
        }
        Ok(())
    }
}

fn check_range(
    field: &str,
    value: f64,
    range: std::ops::Range<f64>,
    remedy: &'static str,
) -> Result<(), InvalidSetting> {
    if range.contains(&value) { Ok(()) } else { Err(invalid(field, value, remedy)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_of_nonsense_are_named() {
        for good in [DetectionConfig::points(), DetectionConfig::people(), DetectionConfig::paper()]
        {
            assert_eq!(good.check(), Ok(()));
        }
        let good = DetectionConfig::points();
        let noise = |power_ratio, min_coherence| Threshold::Noise { power_ratio, min_coherence };
        let relative = Threshold::Relative { fraction: 1.5 };
        let near = SecondLook::TwoPoints { min_separation_m: -1.0 };
        let ghosts = |sidelobe_margin_db, wall_echo_db, body_m| Ghosts::Drop {
            sidelobe_margin_db,
            wall_echo_db,
            body_m,
        };
        let scaled = Covariance::ScaledMoment { scale: 0.0 };
        for (bad, field) in [
            (DetectionConfig { threshold: noise(0.5, 0.4), ..good }, "noise.power_ratio"),
            (DetectionConfig { threshold: noise(12.0, 2.0), ..good }, "noise.min_coherence"),
            (DetectionConfig { threshold: relative, ..good }, "relative.fraction"),
            (DetectionConfig { min_depth_m: 0.0, ..good }, "min_depth_m"),
            (DetectionConfig { separation_range_m: -1.0, ..good }, "separation_range_m"),
            (DetectionConfig { separation_sine: f64::NAN, ..good }, "separation_sine"),
            (DetectionConfig { glint_range_m: 1e4, ..good }, "glint_range_m"),
            (DetectionConfig { glint_cross_m: -0.1, ..good }, "glint_cross_m"),
            (DetectionConfig { second_look: near, ..good }, "two_points.min_separation_m"),
            (DetectionConfig { ghosts: ghosts(-1.0, 22.0, 0.0), ..good }, "sidelobe_margin_db"),
            (DetectionConfig { ghosts: ghosts(6.0, f64::NAN, 0.0), ..good }, "wall_echo_db"),
            (DetectionConfig { ghosts: ghosts(6.0, 22.0, 9.0), ..good }, "body_m"),
            (DetectionConfig { covariance: scaled, ..good }, "scaled_moment.scale"),
        ] {
            let error = bad.check().unwrap_err();
            assert!(error.field.ends_with(field), "{error}");
        }
    }

    #[test]
    fn settings_are_written_in_toml_and_unknown_keys_refused() {
        let text = "
            covariance = { scaled_moment = { scale = 0.075 } }
            ghosts = 'keep'
            second_look = 'off'
            centroid = 'binary'
            threshold = { relative = { fraction = 0.5 } }
            glint_range_m = 0.0
            glint_cross_m = 0.0
        ";
        let config: DetectionConfig = toml::from_str(text).unwrap();
        assert_eq!(config, DetectionConfig::paper());
        assert_eq!(
            toml::from_str::<DetectionConfig>("covariance = 'measured'").unwrap(),
            DetectionConfig::default()
        );
        for preset in [DetectionConfig::people(), DetectionConfig::paper()] {
            let written = toml::to_string(&preset).unwrap();
            assert_eq!(toml::from_str::<DetectionConfig>(&written).unwrap(), preset);
        }
        assert!(toml::from_str::<DetectionConfig>("ghosts = { drop = { body = 1.0 } }").is_err());
    }
}
