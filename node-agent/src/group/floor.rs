//! Levelling a radar that looks down by the floor's echo.
//!
//! A level floor reflects like a mirror: its echo comes from straight below, at the sensor's height,
//! wherever else the radar believes it to be. The direction cosines at which a resting echo of that
//! range stands, less those of straight down, are the radar's own errors, be they of its channels or
//! of its mounting. Nothing but the sensor's height is needed, and no other node.

use std::collections::BTreeSet;

use nalgebra::Vector3;

use super::calibrate::{Axes, Calibration};
use super::config::GroupConfig;
use crate::source::recorded::Detection;

/// The floor's slant range may differ from the sensor's height by this much: delays in the board
/// make up to 0.1 m, the tape 0.03 m.
const RANGE_TOLERANCE_M: f64 = 0.15;
/// Largest error of a direction cosine that is looked for: twice what 40° between channels make.
const MAX_BIAS: f64 = 0.42;
/// The floor must be seen in at least this share of the frames: people step in between now and
/// then, and what is there more rarely is no floor. It was seen in 0.7 to 1.0 of them.
const MIN_FRAME_SHARE: f64 = 0.3;
/// The median distance of the cosines from their median: one echo stays within 0.015, which is a
/// quarter of the resolution of eight channels; several things do not.
const MAX_SPREAD: f64 = 0.05;
/// Fewer frames than this say nothing: one second of the usual 20 Hz.
const MIN_FRAME_COUNT: usize = 20;

/// Errors of direction that the floor's echo gives away.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FloorEcho {
    /// The errors of both direction cosines; the range is left as it is.
    pub calibration: Calibration,
    /// Slant range of the echo less the sensor's height, metres: the error of range, as far as the
    /// height is known.
    pub excess_range_m: f64,
    /// In which share of the frames it stands.
    pub frame_share: f64,
}

/// The floor's echo among `detections` of a radar that looks down: `None` where the sensor's
/// height or the detections' heights are not known, or nothing is like a floor.
pub(super) fn floor_echo(detections: &[Detection], config: &GroupConfig) -> Option<FloorEcho> {
    let height_m = config.sensor_height_m?;
    let axes = Axes::new(config.tilt_rad());
    let down = axes.cosines(&-Vector3::z());
    let near_floor: Vec<Sighting> = detections
        .iter()
        .filter(|d| d.v_m_per_s.is_none_or(|v| v.abs() <= config.min_speed_m_per_s))
        .filter_map(|d| Sighting::of(d, &axes, &down))
        .filter(|seen| (seen.range_m - height_m).abs() <= RANGE_TOLERANCE_M)
        .filter(|seen| seen.azimuth.hypot(seen.elevation) <= MAX_BIAS)
        .collect();
    let frames = |times_s: &mut dyn Iterator<Item = f64>| {
        times_s.map(f64::to_bits).collect::<BTreeSet<u64>>().len()
    };
    let frame_count = frames(&mut detections.iter().map(|d| d.time_s));
    let seen_count = frames(&mut near_floor.iter().map(|seen| seen.time_s));
    let frame_share = seen_count as f64 / frame_count.max(1) as f64;
    if seen_count < MIN_FRAME_COUNT || frame_share < MIN_FRAME_SHARE {
        return None;
    }
    let azimuth_bias = median(near_floor.iter().map(|seen| seen.azimuth))?;
    let elevation_bias = median(near_floor.iter().map(|seen| seen.elevation))?;
    let off =
        |seen: &Sighting| (seen.azimuth - azimuth_bias).hypot(seen.elevation - elevation_bias);
    let spread = median(near_floor.iter().map(off))?;
    let range_m = median(near_floor.iter().map(|seen| seen.range_m))?;
    let calibration = Calibration { range_bias_m: 0.0, azimuth_bias, elevation_bias };
    (spread <= MAX_SPREAD).then_some(FloorEcho {
        calibration,
        excess_range_m: range_m - height_m,
        frame_share,
    })
}

/// Where a detection stands as the array sees it.
struct Sighting {
    time_s: f64,
    range_m: f64,
    /// Its direction cosines less those of straight down.
    azimuth: f64,
    elevation: f64,
}

impl Sighting {
    fn of(detection: &Detection, axes: &Axes, down: &Vector3<f64>) -> Option<Self> {
        let position_m = Vector3::new(detection.x_m, detection.y_m, detection.z_m?);
        let range_m = position_m.norm();
        let cosines = axes.cosines(&(position_m / range_m));
        (f64::EPSILON < range_m && 0.0 < cosines.z).then_some(Self {
            time_s: detection.time_s,
            range_m,
            azimuth: cosines.x - down.x,
            elevation: cosines.y - down.y,
        })
    }
}

/// The middle value, the upper one of two; none of none.
fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;

    use super::*;

    const HEIGHT_M: f64 = 2.4;
    const FRAME_COUNT: u32 = 200;
    /// Spread of a cosine from frame to frame: that of real boards.
    const JITTER: f64 = 0.01;
    /// Ten standard deviations of a median of 160.
    const TOLERANCE: f64 = 0.01;

    fn ceiling() -> GroupConfig {
        GroupConfig { sensor_height_m: Some(HEIGHT_M), tilt_deg: 90.0, ..GroupConfig::default() }
    }

    /// At cosines (to the right, along `y`) and slant range, below a radar that looks down.
    fn below(frame: u32, cosines: [f64; 2], range_m: f64) -> Detection {
        let [x, y] = cosines;
        let depth = (1.0 - x * x - y * y).sqrt();
        Detection {
            time_s: f64::from(frame) * 0.05,
            x_m: x * range_m,
            y_m: y * range_m,
            z_m: Some(-depth * range_m),
            v_m_per_s: Some(0.0),
            snr_db: None,
        }
    }

    /// The floor at an error of (0.03, −0.21), seen in four of five frames, a walker that passes
    /// at every range, and a chair.
    fn room(seed: u64) -> Vec<Detection> {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let mut detections = Vec::new();
        for frame in 0..FRAME_COUNT {
            let mut jitter = || JITTER * random.sample::<f64, _>(StandardNormal);
            if frame % 5 != 0 {
                let cosines = [0.03 + jitter(), -0.21 + jitter()];
                detections.push(below(frame, cosines, HEIGHT_M + 0.08));
            }
            detections.push(below(frame, [0.3 + jitter(), 0.2], 1.6));
            let way = f64::from(frame) / f64::from(FRAME_COUNT) - 0.5;
            let walker = below(frame, [way, 0.1 + jitter()], 1.5 + way);
            detections.push(Detection { v_m_per_s: Some(0.6), ..walker });
        }
        detections
    }

    #[test]
    fn the_floor_gives_the_error_of_direction_away() {
        for seed in 0..20 {
            let echo = floor_echo(&room(seed), &ceiling()).unwrap();
            let Calibration { azimuth_bias, elevation_bias, range_bias_m } = echo.calibration;
            assert!((azimuth_bias - 0.03).abs() < TOLERANCE, "{echo:?}");
            assert!((elevation_bias + 0.21).abs() < TOLERANCE, "{echo:?}");
            assert!(range_bias_m.abs() < 1e-12 && (echo.excess_range_m - 0.08).abs() < 1e-9);
            assert!((echo.frame_share - 0.8).abs() < 1e-9);
        }
    }

    #[test]
    fn a_radar_at_sixty_degrees_finds_straight_down_off_its_boresight() {
        let config = GroupConfig { tilt_deg: 60.0, ..ceiling() };
        let right = Calibration { azimuth_bias: 0.02, elevation_bias: 0.1, range_bias_m: 0.0 };
        // What the radar states where the floor truly is straight below: the errors are added.
        let wrong = Calibration { azimuth_bias: -0.02, elevation_bias: -0.1, range_bias_m: 0.0 };
        let seen = |frame| wrong.corrected(&below(frame, [0.0, 0.0], HEIGHT_M), config.tilt_rad());
        let detections: Vec<Detection> = (0..FRAME_COUNT).filter_map(seen).collect();
        let found = floor_echo(&detections, &config).unwrap().calibration;
        assert!((found.azimuth_bias - right.azimuth_bias).abs() < 1e-12, "{found:?}");
        assert!((found.elevation_bias - right.elevation_bias).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn what_is_no_floor_levels_nothing() {
        let good = room(1);
        let changed = |change: fn(Detection) -> Detection| -> Vec<Detection> {
            good.iter().copied().map(change).collect()
        };
        let unknown_height = GroupConfig { sensor_height_m: None, ..ceiling() };
        assert_eq!(floor_echo(&good, &unknown_height), None);
        let too_high = GroupConfig { sensor_height_m: Some(HEIGHT_M + 0.3), ..ceiling() };
        assert_eq!(floor_echo(&good, &too_high), None);
        let flat = changed(|d| Detection { z_m: None, ..d });
        assert_eq!(floor_echo(&flat, &ceiling()), None);
        let moving = changed(|d| Detection { v_m_per_s: Some(0.4), ..d });
        assert_eq!(floor_echo(&moving, &ceiling()), None);
        let short: Vec<Detection> = good.iter().copied().filter(|d| d.time_s < 0.9).collect();
        assert_eq!(floor_echo(&short, &ceiling()), None);
        let rare: Vec<Detection> = good
            .iter()
            .copied()
            .filter(|d| HEIGHT_M - 0.1 > d.x_m.hypot(d.y_m).hypot(d.z_m.unwrap()) || d.time_s < 2.0)
            .collect();
        assert_eq!(floor_echo(&rare, &ceiling()), None);
        // Two echoes of the floor's range at once: neither can be told to be it.
        let mut two = good.clone();
        let copies = good.iter().filter(|d| d.y_m < -0.3);
        let swapped: Vec<Detection> = copies.map(|d| Detection { y_m: -d.y_m, ..*d }).collect();
        two.extend(swapped);
        assert_eq!(floor_echo(&two, &ceiling()), None);
        assert_eq!(floor_echo(&[], &ceiling()), None);
    }
}
