//! The settings of the default tracker.

use serde::{Deserialize, Serialize};

use crate::detect::DetectionConfig;
use crate::imaging::{InvalidSetting, invalid};

/// Default of `target.half_depth_m`.
pub const HALF_DEPTH_M: f64 = 0.1;

/// A way of moving, see `motion`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Gait {
    /// How long the velocity lasts, seconds.
    pub memory_s: f64,
    /// How strongly it is pushed, m²/s³.
    pub push_m2_per_s3: f64,
    /// Share of that across the way, 0 to 1: the faster, the more it counts.
    pub aside_share: f64,
    /// How long a person moves that way, seconds.
    pub sojourn_s: f64,
}

/// Where people come and go, besides the border of the image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Door {
    /// Its middle in the node's frame, metres.
    pub x_m: f64,
    /// Its middle in the node's frame, metres.
    pub y_m: f64,
    /// How far from it people appear and disappear, metres.
    pub radius_m: f64,
}

/// What points are of: the same as in the chain that measured them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyModel {
    /// How far behind the measured surface a person's middle is, metres: `target.half_depth_m`.
    pub half_depth_m: f64,
    /// Standard deviation of the wander of what a body reflects that is in the covariance of every
    /// point, in range and across, metres: `chain.detection.glint_range_m` and `glint_cross_m`.
    pub glint_m: [f64; 2],
}

impl BodyModel {
    /// That of a chain with `detection` whose targets are that deep.
    #[must_use]
    pub fn new(half_depth_m: f64, detection: &DetectionConfig) -> Self {
        Self { half_depth_m, glint_m: [detection.glint_range_m, detection.glint_cross_m] }
    }
}

impl Default for BodyModel {
    /// People, as a node's configuration has them if nothing else is said.
    fn default() -> Self {
        Self::new(HALF_DEPTH_M, &DetectionConfig::people())
    }
}

/// Settings of the default tracker. The defaults were chosen on seeds above 1000 of the four
/// experiments; see the study beside the tracker for the figures on others.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DefaultConfig {
    /// Walking straight on.
    pub steady: Gait,
    /// Starting, stopping and turning.
    pub turning: Gait,
    /// The half depth of a body seen from the front is less by this share, and more seen from the
    /// side.
    pub aspect_share: f64,
    /// Standard deviations of errors that last, in range and across, metres: half depths differ, and
    /// what a body reflects is not its middle.
    pub lasting_sigmas_m: [f64; 2],
    /// How long the wander of what a body reflects lasts, seconds.
    pub glint_s: f64,
    /// Share of the chain's variance for it that a point of usual brightness has.
    pub glint_share: f64,
    /// Share of the rest of a point's covariance that is noise.
    pub noise_share: f64,
    /// Chance that a person who is there gives a point.
    pub detection_probability: f64,
    /// Points of nobody, and of those who are new, per square metre and frame.
    pub new_per_m2: f64,
    /// A point farther away than so many standard deviations is somebody else.
    pub gate_sigmas: f64,
    /// A point within so many standard deviations of what is seen of somebody is theirs, and begins
    /// nobody.
    pub body_sigmas: f64,
    /// Power over the noise, coherence counted, at which the image supports a track without a point.
    pub weak_power_ratio: f64,
    /// How much the image must look like the template to support a track, 0 to 1.
    pub min_appearance: f64,
    /// Logarithm of the odds at which a track is confirmed.
    pub confirm_score: f64,
    /// The same for one that began at a door or at the border of the image.
    pub confirm_score_at_doors: f64,
    /// Points that a confirmed track must have had.
    pub confirm_point_count: u32,
    /// A tentative track ends after so long without support, seconds.
    pub tentative_coast_s: f64,
    /// One who walked, and is not seen any more, seconds.
    pub walking_coast_s: f64,
    /// One who walked before and stood, seconds.
    pub standing_coast_s: f64,
    /// One who was never seen to walk, seconds: a breath. It may be a shadow.
    pub still_coast_s: f64,
    /// One who is outside the image or at a door, seconds.
    pub exit_coast_s: f64,
    /// Slower people stand, metres per second.
    pub standing_m_per_s: f64,
    /// A new track is that of somebody lost before, if it is no farther from where they were last
    /// seen than this, metres, and ...
    pub relink_m: f64,
    /// ... this for every second since, metres per second.
    pub relink_m_per_s: f64,
    /// Where people come and go.
    pub doors: Vec<Door>,
    /// This near to the border of the image people appear, metres.
    pub border_m: f64,
    /// Smoothed states are this old, seconds.
    pub smoothing_lag_s: f64,
    /// People followed at most.
    pub max_track_count: usize,
}

impl Default for DefaultConfig {
    fn default() -> Self {
        Self {
            steady: Gait {
                memory_s: 100.0,
                push_m2_per_s3: 5e-4,
                aside_share: 1.0,
                sojourn_s: 4.0,
            },
            turning: Gait { memory_s: 1.0, push_m2_per_s3: 1.3, aside_share: 0.1, sojourn_s: 1.0 },
            aspect_share: 0.4,
            lasting_sigmas_m: [0.025, 0.042],
            glint_s: 0.1,
            glint_share: 0.5,
            noise_share: 0.5,
            detection_probability: 0.6,
            new_per_m2: 3e-4,
            gate_sigmas: 5.0,
            body_sigmas: 4.0,
            weak_power_ratio: 3.0,
            min_appearance: 0.6,
            confirm_score: 14.0,
            confirm_score_at_doors: 6.0,
            confirm_point_count: 3,
            tentative_coast_s: 0.8,
            walking_coast_s: 2.0,
            standing_coast_s: 30.0,
            still_coast_s: 4.0,
            exit_coast_s: 0.8,
            standing_m_per_s: 0.2,
            relink_m: 0.5,
            relink_m_per_s: 1.2,
            doors: Vec::new(),
            border_m: 0.5,
            smoothing_lag_s: 1.0,
            max_track_count: 32,
        }
    }
}

impl DefaultConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), InvalidSetting> {
        self.check_ranges()?;
        for (name, gait) in [("steady", &self.steady), ("turning", &self.turning)] {
            let values = [gait.memory_s, gait.push_m2_per_s3, gait.sojourn_s];
            let is_share = (0.0..=1.0).contains(&gait.aside_share);
            if !is_share || !values.iter().all(|value| (1e-6..=1e6).contains(value)) {
                return Err(invalid(of(name), gait, "use 1e-6 to 1e6, and a share of 0 to 1"));
            }
        }
        for (index, door) in self.doors.iter().enumerate() {
            let is_place = [door.x_m, door.y_m].iter().all(|m| m.abs() < 1e6);
            if !is_place || !(0.0..1e6).contains(&door.radius_m) {
                let field = of(&format!("doors[{index}]"));
                return Err(invalid(field, door, "use a place and a radius in metres"));
            }
        }
        if !self.lasting_sigmas_m.iter().all(|sigma_m| (0.0..=1.0).contains(sigma_m)) {
            return Err(invalid(of("lasting_sigmas_m"), self.lasting_sigmas_m, "use 0 to 1 m"));
        }
        if !(1..=1000).contains(&self.confirm_point_count) {
            let remedy = "use 1 to 1000 points";
            return Err(invalid(of("confirm_point_count"), self.confirm_point_count, remedy));
        }
        if !(1..=256).contains(&self.max_track_count) {
            return Err(invalid(of("max_track_count"), self.max_track_count, "use 1 to 256"));
        }
        Ok(())
    }

    fn check_ranges(&self) -> Result<(), InvalidSetting> {
        let seconds = [0.0, 86_400.0];
        for (field, value, [least, most]) in [
            ("aspect_share", self.aspect_share, [0.0, 1.0]),
            ("glint_s", self.glint_s, [1e-3, 60.0]),
            ("glint_share", self.glint_share, [0.0, 10.0]),
            ("noise_share", self.noise_share, [1e-3, 10.0]),
            ("detection_probability", self.detection_probability, [0.01, 0.999]),
            ("new_per_m2", self.new_per_m2, [1e-12, 1.0]),
            ("gate_sigmas", self.gate_sigmas, [1.0, 100.0]),
            ("body_sigmas", self.body_sigmas, [0.0, 10.0]),
            ("weak_power_ratio", self.weak_power_ratio, [1.0, 1e6]),
            ("min_appearance", self.min_appearance, [0.0, 1.0]),
            ("confirm_score", self.confirm_score, [0.0, 1e3]),
            ("confirm_score_at_doors", self.confirm_score_at_doors, [0.0, 1e3]),
            ("tentative_coast_s", self.tentative_coast_s, seconds),
            ("walking_coast_s", self.walking_coast_s, seconds),
            ("standing_coast_s", self.standing_coast_s, seconds),
            ("still_coast_s", self.still_coast_s, seconds),
            ("exit_coast_s", self.exit_coast_s, seconds),
            ("standing_m_per_s", self.standing_m_per_s, [0.0, 10.0]),
            ("relink_m", self.relink_m, [0.0, 10.0]),
            ("relink_m_per_s", self.relink_m_per_s, [0.0, 10.0]),
            ("border_m", self.border_m, [0.0, 1e3]),
            ("smoothing_lag_s", self.smoothing_lag_s, [0.0, 60.0]),
        ] {
            if !(least..=most).contains(&value) {
                let got = format!("{value}, not within {least} to {most}");
                return Err(invalid(of(field), got, "use a value in that range"));
            }
        }
        Ok(())
    }
}

/// The field as it is written in the file.
fn of(field: &str) -> String {
    format!("tracking.default.{field}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nonsense_is_named() {
        let good = DefaultConfig::default();
        assert_eq!(good.check(), Ok(()));
        let told = |config: DefaultConfig| config.check().unwrap_err().field;
        let nan = DefaultConfig { aspect_share: f64::NAN, ..good.clone() };
        assert_eq!(told(nan), "tracking.default.aspect_share");
        let frozen = Gait { memory_s: 0.0, ..good.steady };
        assert_eq!(
            told(DefaultConfig { steady: frozen, ..good.clone() }),
            "tracking.default.steady"
        );
        let door = Door { x_m: f64::INFINITY, y_m: 0.0, radius_m: 1.0 };
        let doors = DefaultConfig { doors: vec![door], ..good.clone() };
        assert_eq!(told(doors), "tracking.default.doors[0]");
        let nobody = DefaultConfig { max_track_count: 0, ..good.clone() };
        assert_eq!(told(nobody), "tracking.default.max_track_count");
        let unseen = DefaultConfig { confirm_point_count: 0, ..good };
        assert_eq!(told(unseen), "tracking.default.confirm_point_count");
    }
}
