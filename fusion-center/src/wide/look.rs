//! A dwell as a look: plots in the local plane with covariances, the sensor, what it could see.

use nalgebra::{Vector2, Vector3};
use proto::geodesy::GeodesyError;
use proto::wire::{Dwell, DwellReport};

use super::config::WideConfig;
use super::frame::{LocalFrame, MAX_REACH_M};
use super::sighting::{M2_PER_KM2, Sighting, usable};
use crate::tracking::{Area, Coverage, Look, Platform, Plot};

/// Wider views are no beams.
const MAX_BEAM_HALF_WIDTH_RAD: f64 = 0.25;
/// Lines of sight steeper than this, distance over ground by slant range, have no direction over ground
/// that could be relied on, the vertical being off by as much 130 km from the frame's origin.
const MIN_GROUND_SHARE: f64 = 0.02;

/// Which look of which sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LookName {
    /// Which sensor, counted from zero.
    pub sensor_index: u32,
    /// Which of its looks.
    pub look_index: u64,
}

/// A look that owns its plots.
#[derive(Clone, Debug)]
pub struct OwnedLook {
    /// When, calendar time of the data (Unix), seconds.
    pub time_s: f64,
    /// Which look.
    pub name: LookName,
    /// The sensor over the plane of the targets, if its place is known.
    pub platform: Option<Platform>,
    /// What it could see.
    pub coverage: Coverage,
    /// False plots expected per square metre.
    pub clutter_per_m2: f64,
    /// What it saw; reports from right under the sensor, and from beyond [`MAX_REACH_M`], are left out.
    pub plots: Vec<Plot>,
}

impl OwnedLook {
    /// As trackers take it.
    #[must_use]
    pub fn look(&self) -> Look<'_> {
        Look {
            time_s: self.time_s,
            sensor_index: self.name.sensor_index,
            look_index: self.name.look_index,
            platform: self.platform,
            coverage: self.coverage,
            clutter_per_m2: self.clutter_per_m2,
            plots: &self.plots,
        }
    }
}

/// A dwell in the local frame; `config` says what the dwell does not.
///
/// # Errors
/// If one of its places is none.
pub fn own_look(
    dwell: &Dwell,
    frame: &LocalFrame,
    config: &WideConfig,
    name: LookName,
) -> Result<OwnedLook, GeodesyError> {
    let sensor_m = frame.local_m(&dwell.sensor)?;
    let center_m = frame.local_m(&dwell.area.center)?;
    let velocity_m_per_s = velocity(dwell, frame)?;
    let area = area(dwell, &sensor_m, &center_m);
    let mut plots = Vec::with_capacity(dwell.reports.len());
    for report in &dwell.reports {
        let place_m = frame.local_m(&report.place)?;
        let line_m = place_m - sensor_m;
        let is_oblique = MIN_GROUND_SHARE * line_m.norm() < line_m.xy().norm();
        if is_oblique && place_m.norm() <= MAX_REACH_M {
            plots.push(sighting(report).plot(place_m.xy(), &line_m, config));
        }
    }
    // The plane of the targets: what the earth curves away at the place looked at is not height.
    let position_m = sensor_m.xy().push(sensor_m.z - center_m.z);
    let beam_index = beam_index(&area, &velocity_m_per_s);
    let least = dwell.minimum_detectable_m_per_s.or(config.minimum_detectable_m_per_s);
    Ok(OwnedLook {
        time_s: dwell.time_unix_s,
        name,
        platform: Some(Platform { position_m, velocity_m_per_s, beam_index }),
        coverage: Coverage {
            area,
            detection_probability: usable(
                dwell.detection_probability.unwrap_or(config.detection_probability),
            ),
            minimum_detectable_m_per_s: least,
        },
        clutter_per_m2: config.clutter_per_km2 / M2_PER_KM2,
        plots,
    })
}

/// The sensor's velocity in the local frame; zero if not stated.
fn velocity(dwell: &Dwell, frame: &LocalFrame) -> Result<Vector3<f64>, GeodesyError> {
    let Some(flight) = dwell.flight else { return Ok(Vector3::zeros()) };
    let (sin_course, cos_course) = flight.course_deg.to_radians().sin_cos();
    let over_ground = Vector2::new(sin_course, cos_course) * flight.speed_m_per_s;
    frame.turned(&over_ground.push(flight.climb_m_per_s), &dwell.sensor)
}

fn area(dwell: &Dwell, sensor_m: &Vector3<f64>, center_m: &Vector3<f64>) -> Area {
    let middle_m = (center_m - sensor_m).xy();
    let range_m = middle_m.norm();
    let half_m = dwell.area.range_half_extent_m;
    Area::Sector {
        origin_m: sensor_m.xy(),
        direction_rad: middle_m.y.atan2(middle_m.x),
        half_width_rad: dwell.area.angle_half_extent_deg.to_radians().min(std::f64::consts::PI),
        min_range_m: (range_m - half_m).max(0.0),
        max_range_m: range_m + half_m,
    }
}

/// Beam positions, counted by the beam's width counter-clockwise from the direction of flight.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "not negative; a beam is too narrow to be counted only below a billionth of a turn"
)]
fn beam_index(area: &Area, velocity_m_per_s: &Vector3<f64>) -> Option<u32> {
    let Area::Sector { direction_rad, half_width_rad, .. } = area else { return None };
    let flown = velocity_m_per_s.xy();
    let is_beam = (1e-8..=MAX_BEAM_HALF_WIDTH_RAD).contains(half_width_rad);
    if !is_beam || flown.norm() <= 0.0 {
        return None;
    }
    let off_rad = (direction_rad - flown.y.atan2(flown.x)).rem_euclid(std::f64::consts::TAU);
    Some((off_rad / (2.0 * half_width_rad)).floor() as u32)
}

fn sighting(report: &DwellReport) -> Sighting {
    Sighting {
        index: report.index,
        slant_sigma_m: report.slant_sigma_m,
        cross_sigma_m: report.cross_sigma_m,
        radial_m_per_s: report.radial_m_per_s,
        radial_sigma_m_per_s: report.radial_sigma_m_per_s,
        wrap_m_per_s: report.wrap_m_per_s,
        snr_db: report.snr_db,
    }
}
