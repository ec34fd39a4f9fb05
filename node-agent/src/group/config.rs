//! The settings of grouping: what each is for, and why its default is what it is.
//!
//! The defaults were chosen on indoor recordings of one to two walking people by three 77 GHz
//! radars at 20 Hz, whose centres were registered with each other; "by likelihood" below means
//! the likelihood of matched centres after that registration, which knows no surveyed pose.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::calibrate::Calibration;
use crate::source::recorded::Detection;

/// From this tilt on the floor straight below lies within 30° of boresight, where radars see it.
const LOOKS_DOWN_DEG: f64 = 60.0;

/// How detections become people.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GroupConfig {
    /// Length of a period. Half a second holds ten frames, so that a body gives about ten moving
    /// detections, while a walker goes half a metre; 0.3 to 1 s registered equally well.
    pub period_s: f64,
    /// Slower detections are furniture. Stated speeds are steps of about 0.12 m/s, and standing
    /// people sway: anything above zero counts. Detections without a speed all count.
    pub min_speed_m_per_s: f64,
    /// Height of the sensor above the floor, without which heights are not examined.
    pub sensor_height_m: Option<f64>,
    /// How far boresight looks below the horizon, degrees: 90 is straight down. From 60 on the
    /// radar is levelled by the floor's echo, where its height is known.
    pub tilt_deg: f64,
    /// The radar's own constant errors, where somebody measured them.
    pub calibration: Calibration,
    /// Lowest height above the floor of a body's detections: reflections in the floor lie below.
    pub body_min_height_m: f64,
    /// Greatest height above the floor of a body's detections: reflections in the ceiling lie
    /// above. Limits of 0.5 and 1.6 m lost points and gained nothing.
    pub body_max_height_m: f64,
    /// Nearest planar range: the bearing of anything closer means little.
    pub min_range_m: f64,
    /// Farthest planar range.
    pub max_range_m: f64,
    /// The part of the node's plane that counts, where not all of it does.
    pub area: Option<Area>,
    /// Detections this close are of one body. 0.3 to 0.6 m registered alike: 0.4 m is the best by
    /// likelihood, 0.6 m by the tape, and people who pass closer than this become one point.
    pub cluster_radius_m: f64,
    /// Fewer moving detections within that radius and period are noise: half of the ten frames.
    /// 3 to 6 registered alike; at 8 people are missed.
    pub min_detection_count: usize,
    /// Error of a centre along the line of sight that more detections do not average out:
    /// 0.04 m by likelihood.
    pub sigma_range_m: f64,
    /// The same across the line of sight, at zero range.
    pub sigma_cross_m: f64,
    /// The same across the line of sight, for each metre of range.
    pub sigma_bearing_rad: f64,
    /// How far a body's middle lies behind what the radar sees, less the radar's own offset of
    /// range: 0.10 m for bodies, less 0.07 m for boards whose delay nobody calibrated (a floor at
    /// a taped 2.45 m was seen at 2.53 m, and makers state 0.05 to 0.08 m).
    pub half_depth_m: f64,
    /// How sure that is: 0.03 m of each.
    pub half_depth_sigma_m: f64,
    /// What points claim where the recording states no SNR.
    pub unstated_snr_db: f64,
}

/// A rectangle of the node's plane.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Area {
    /// Leftmost.
    pub x_min_m: f64,
    /// Rightmost.
    pub x_max_m: f64,
    /// Nearest, or farthest behind the node where negative.
    pub y_min_m: f64,
    /// Farthest.
    pub y_max_m: f64,
}

impl Default for GroupConfig {
    fn default() -> Self {
        Self {
            period_s: 0.5,
            min_speed_m_per_s: 0.05,
            sensor_height_m: None,
            tilt_deg: 0.0,
            calibration: Calibration::default(),
            body_min_height_m: 0.3,
            body_max_height_m: 1.8,
            min_range_m: 0.3,
            max_range_m: 10.0,
            area: None,
            cluster_radius_m: 0.5,
            min_detection_count: 5,
            sigma_range_m: 0.04,
            sigma_cross_m: 0.03,
            sigma_bearing_rad: 0.02,
            half_depth_m: 0.03,
            half_depth_sigma_m: 0.045,
            unstated_snr_db: 15.0,
        }
    }
}

/// Why settings of grouping make no sense.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("group.{field} is {value}: {remedy}")]
pub struct InvalidGroup {
    /// Which setting.
    pub field: &'static str,
    /// What it was, as text.
    pub value: String,
    /// What would do.
    pub remedy: &'static str,
}

/// Whether a setting makes sense, its name, its value, and what would do.
type Check<'a> = (bool, &'static str, &'a dyn std::fmt::Debug, &'static str);

impl GroupConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), InvalidGroup> {
        let mut checks =
            self.gate_checks().into_iter().chain(self.point_checks()).chain(self.radar_checks());
        match checks.find(|(good, ..)| !good) {
            Some((_, field, value, remedy)) => {
                Err(InvalidGroup { field, value: format!("{value:?}"), remedy })
            }
            None => Ok(()),
        }
    }

    fn gate_checks(&self) -> [Check<'_>; 8] {
        let period = (0.001..=3600.0).contains(&self.period_s);
        let speed = self.min_speed_m_per_s.is_finite() && 0.0 <= self.min_speed_m_per_s;
        let height = self.sensor_height_m.is_none_or(f64::is_finite);
        let bottom = self.body_min_height_m.is_finite();
        let top = self.body_min_height_m < self.body_max_height_m;
        let near = self.min_range_m.is_finite() && 0.0 <= self.min_range_m;
        let far = self.min_range_m < self.max_range_m;
        let ordered = |a: Area| a.x_min_m < a.x_max_m && a.y_min_m < a.y_max_m;
        let area = self.area.is_none_or(ordered);
        [
            (period, "period_s", &self.period_s, "use 0.001 to 3600 s"),
            (speed, "min_speed_m_per_s", &self.min_speed_m_per_s, "use 0 m/s or more"),
            (height, "sensor_height_m", &self.sensor_height_m, "use metres above the floor"),
            (bottom, "body_min_height_m", &self.body_min_height_m, "use metres above the floor"),
            (top, "body_max_height_m", &self.body_max_height_m, "use more than body_min_height_m"),
            (near, "min_range_m", &self.min_range_m, "use 0 m or more"),
            (far, "max_range_m", &self.max_range_m, "use more than min_range_m"),
            (area, "area", &self.area, "use x_min_m < x_max_m and y_min_m < y_max_m"),
        ]
    }

    fn point_checks(&self) -> [Check<'_>; 8] {
        // A covariance of zero would outweigh every other measurement.
        let positive = |sigma_m: f64| (0.001..=10.0).contains(&sigma_m);
        let radius = (0.01..=10.0).contains(&self.cluster_radius_m);
        let count = 1 <= self.min_detection_count;
        let (range, cross) = (positive(self.sigma_range_m), positive(self.sigma_cross_m));
        let bearing = (0.0..=1.0).contains(&self.sigma_bearing_rad);
        let depth = (-1.0..=1.0).contains(&self.half_depth_m);
        let depth_sigma = (0.0..=1.0).contains(&self.half_depth_sigma_m);
        let snr = self.unstated_snr_db.is_finite();
        [
            (radius, "cluster_radius_m", &self.cluster_radius_m, "use 0.01 to 10 m"),
            (count, "min_detection_count", &self.min_detection_count, "use 1 or more"),
            (range, "sigma_range_m", &self.sigma_range_m, "use 0.001 to 10 m"),
            (cross, "sigma_cross_m", &self.sigma_cross_m, "use 0.001 to 10 m"),
            (bearing, "sigma_bearing_rad", &self.sigma_bearing_rad, "use 0 to 1 rad"),
            (depth, "half_depth_m", &self.half_depth_m, "use -1 to 1 m"),
            (depth_sigma, "half_depth_sigma_m", &self.half_depth_sigma_m, "use 0 to 1 m"),
            (snr, "unstated_snr_db", &self.unstated_snr_db, "use decibels"),
        ]
    }

    fn radar_checks(&self) -> [Check<'_>; 4] {
        let Calibration { range_bias_m, azimuth_bias, elevation_bias } = &self.calibration;
        let tilt = (-90.0..=90.0).contains(&self.tilt_deg);
        let within = |bias: &f64| (-0.9..=0.9).contains(bias);
        let (azimuth, elevation) = (within(azimuth_bias), within(elevation_bias));
        let range = (-1.0..=1.0).contains(range_bias_m);
        [
            (tilt, "tilt_deg", &self.tilt_deg, "use -90 to 90 degrees, 90 for straight down"),
            (range, "calibration.range_bias_m", range_bias_m, "use -1 to 1 m"),
            (azimuth, "calibration.azimuth_bias", azimuth_bias, "use -0.9 to 0.9"),
            (elevation, "calibration.elevation_bias", elevation_bias, "use -0.9 to 0.9"),
        ]
    }

    /// The tilt in radians.
    pub(super) fn tilt_rad(&self) -> f64 {
        self.tilt_deg.to_radians()
    }

    /// Whether the floor straight below is in view.
    pub(super) fn looks_down(&self) -> bool {
        LOOKS_DOWN_DEG <= self.tilt_deg
    }

    /// Whether `detection` may be of a person: it moves, at body height, in range and area. What
    /// the recording does not state is not held against it.
    pub(super) fn lets_through(&self, detection: &Detection) -> bool {
        let Detection { x_m, y_m, .. } = *detection;
        let moves = detection.v_m_per_s.is_none_or(|v| self.min_speed_m_per_s < v.abs());
        let heights_m = self.body_min_height_m..=self.body_max_height_m;
        let height_m =
            detection.z_m.zip(self.sensor_height_m).map(|(z_m, sensor_m)| z_m + sensor_m);
        let upright = height_m.is_none_or(|height_m| heights_m.contains(&height_m));
        let in_range = (self.min_range_m..=self.max_range_m).contains(&x_m.hypot(y_m));
        let inside = self.area.is_none_or(|area| {
            (area.x_min_m..=area.x_max_m).contains(&x_m)
                && (area.y_min_m..=area.y_max_m).contains(&y_m)
        });
        moves && upright && in_range && inside
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_make_sense_and_every_nonsense_is_named() {
        let good = GroupConfig::default();
        assert_eq!(good.check(), Ok(()));
        let calibrated = |calibration| GroupConfig { calibration, ..good };
        let backwards = Area { x_min_m: 1.0, x_max_m: -1.0, y_min_m: 0.0, y_max_m: 1.0 };
        let bad = [
            ("period_s", GroupConfig { period_s: 0.0, ..good }),
            ("min_speed_m_per_s", GroupConfig { min_speed_m_per_s: -1.0, ..good }),
            ("sensor_height_m", GroupConfig { sensor_height_m: Some(f64::NAN), ..good }),
            ("tilt_deg", GroupConfig { tilt_deg: 91.0, ..good }),
            (
                "calibration.range_bias_m",
                calibrated(Calibration { range_bias_m: f64::NAN, ..Calibration::default() }),
            ),
            (
                "calibration.azimuth_bias",
                calibrated(Calibration { azimuth_bias: 1.0, ..Calibration::default() }),
            ),
            (
                "calibration.elevation_bias",
                calibrated(Calibration { elevation_bias: -1.0, ..Calibration::default() }),
            ),
            ("body_min_height_m", GroupConfig { body_min_height_m: f64::NAN, ..good }),
            ("body_max_height_m", GroupConfig { body_max_height_m: 0.1, ..good }),
            ("min_range_m", GroupConfig { min_range_m: f64::INFINITY, ..good }),
            ("max_range_m", GroupConfig { max_range_m: f64::NAN, ..good }),
            ("area", GroupConfig { area: Some(backwards), ..good }),
            ("cluster_radius_m", GroupConfig { cluster_radius_m: 0.0, ..good }),
            ("min_detection_count", GroupConfig { min_detection_count: 0, ..good }),
            ("sigma_range_m", GroupConfig { sigma_range_m: 0.0, ..good }),
            ("sigma_cross_m", GroupConfig { sigma_cross_m: f64::NAN, ..good }),
            ("sigma_bearing_rad", GroupConfig { sigma_bearing_rad: 2.0, ..good }),
            ("half_depth_m", GroupConfig { half_depth_m: 2.0, ..good }),
            ("half_depth_sigma_m", GroupConfig { half_depth_sigma_m: -0.1, ..good }),
            ("unstated_snr_db", GroupConfig { unstated_snr_db: f64::NAN, ..good }),
        ];
        for (field, config) in bad {
            assert_eq!(config.check().unwrap_err().field, field);
        }
    }

    #[test]
    fn each_gate_closes_on_its_own_and_only_on_what_is_stated() {
        let area = Area { x_min_m: -1.0, x_max_m: 2.0, y_min_m: -3.0, y_max_m: 5.0 };
        let gates = GroupConfig {
            sensor_height_m: Some(1.0),
            area: Some(area),
            max_range_m: 4.0,
            ..GroupConfig::default()
        };
        let walker = Detection {
            time_s: 0.0,
            x_m: 1.0,
            y_m: 2.0,
            z_m: Some(0.0),
            v_m_per_s: Some(-0.5),
            snr_db: None,
        };
        let open = [
            walker,
            Detection { v_m_per_s: None, z_m: None, ..walker },
            Detection { v_m_per_s: Some(0.06), z_m: Some(0.75), ..walker },
            Detection { y_m: -2.0, z_m: Some(-0.65), ..walker },
        ];
        assert!(open.iter().all(|detection| gates.lets_through(detection)));
        let shut = [
            Detection { v_m_per_s: Some(0.0), ..walker },
            Detection { v_m_per_s: Some(-0.04), ..walker },
            Detection { z_m: Some(0.85), ..walker },
            Detection { z_m: Some(-0.75), ..walker },
            Detection { x_m: 0.2, y_m: 0.2, ..walker },
            Detection { y_m: 4.5, ..walker },
            Detection { x_m: -1.1, ..walker },
            Detection { y_m: -3.1, ..walker },
        ];
        assert!(shut.iter().all(|detection| !gates.lets_through(detection)));
        let blind = GroupConfig { sensor_height_m: None, ..gates };
        assert!(blind.lets_through(&Detection { z_m: Some(9.0), ..walker }));
    }

    #[test]
    fn files_may_set_some_fields_and_no_unknown_ones() {
        let some: GroupConfig = toml::from_str("sensor_height_m = 1.1\nperiod_s = 1.0").unwrap();
        let expected =
            GroupConfig { sensor_height_m: Some(1.1), period_s: 1.0, ..GroupConfig::default() };
        assert_eq!(some, expected);
        assert!(toml::from_str::<GroupConfig>("period = 1.0").is_err());
    }
}
