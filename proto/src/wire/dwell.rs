//! What a wide-area radar's agent tells the centre: the plots of one dwell.

use serde::{Deserialize, Serialize};

use super::check::{Invalid, at_most, finite, not_negative, require, share};
use super::codec::Message;
use super::header::Kind;
use crate::ids::NodeId;

/// Most reports in one dwell.
const MAX_REPORT_COUNT: usize = 4096;
/// Highest and lowest height that is believed, metres.
const HEIGHTS_M: std::ops::RangeInclusive<f64> = -1e4..=1e5;
/// Times before and after this are not believed: 1970 and about 2200, seconds.
const TIMES_UNIX_S: std::ops::RangeInclusive<f64> = 0.0..=7.3e9;
/// Largest standard deviation of a place that is believed, metres.
const MAX_SIGMA_M: f64 = 1e5;

/// A place on the earth (WGS-84).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GeoRecord {
    /// Latitude, degrees, north positive.
    pub lat_deg: f64,
    /// Longitude, degrees, east positive, -180 to 180.
    pub lon_deg: f64,
    /// Height above the ellipsoid, metres.
    pub height_m: f64,
}

/// A calendar time that data may have.
pub(super) fn time_unix(field: &'static str, value_s: f64) -> Result<(), Invalid> {
    let known = TIMES_UNIX_S.contains(&value_s);
    require(known, field, value_s, "seconds from 1970 to 2200 are expected")
}

impl GeoRecord {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), Invalid> {
        let is_latitude = (-90.0..=90.0).contains(&self.lat_deg);
        require(is_latitude, "lat_deg", self.lat_deg, "-90 to 90 is expected")?;
        let is_longitude = (-180.0..=180.0).contains(&self.lon_deg);
        require(is_longitude, "lon_deg", self.lon_deg, "-180 to 180 is expected")?;
        let believable = HEIGHTS_M.contains(&self.height_m);
        require(believable, "height_m", self.height_m, "-10 km to 100 km is expected")
    }
}

/// How a sensor flies.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FlightRecord {
    /// Direction over ground, degrees clockwise from true north.
    pub course_deg: f64,
    /// Over ground, metres per second.
    pub speed_m_per_s: f64,
    /// Upwards, metres per second.
    pub climb_m_per_s: f64,
}

/// What a dwell could see: a sector of a ring on the ground, seen from the sensor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DwellArea {
    /// Its middle.
    pub center: GeoRecord,
    /// From the middle to the near and far end, metres over ground.
    pub range_half_extent_m: f64,
    /// To either side of the middle, as seen from the sensor, degrees.
    pub angle_half_extent_deg: f64,
}

/// One target as one dwell measured it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DwellReport {
    /// Its number in the dwell.
    pub index: u32,
    /// Where.
    pub place: GeoRecord,
    /// Standard deviation along the line of sight (slant), metres, if stated.
    pub slant_sigma_m: Option<f64>,
    /// Standard deviation across the line of sight, metres, if stated.
    pub cross_sigma_m: Option<f64>,
    /// Radial velocity, away from the sensor, freed of the sensor's motion, metres per second.
    pub radial_m_per_s: Option<f64>,
    /// Its standard deviation, metres per second, if stated.
    pub radial_sigma_m_per_s: Option<f64>,
    /// It is known up to multiples of this, metres per second, if given.
    pub wrap_m_per_s: Option<f64>,
    /// Power over noise, decibels of power.
    pub snr_db: Option<f64>,
    /// Which target it really is, where that is known.
    pub truth: Option<u32>,
}

/// The plots of one dwell, possibly none: an empty dwell says that nothing was seen there.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Dwell {
    /// Whose; must be the node of the key.
    pub node: NodeId,
    /// When, calendar time of the data (Unix), seconds.
    pub time_unix_s: f64,
    /// The sensor's count of sweeps over its area.
    pub revisit_index: u32,
    /// The dwell's number in its revisit.
    pub dwell_index: u32,
    /// The last one of its revisit.
    pub is_last_of_revisit: bool,
    /// Where the sensor was.
    pub sensor: GeoRecord,
    /// How it flew, if known.
    pub flight: Option<FlightRecord>,
    /// What it could see.
    pub area: DwellArea,
    /// Slower targets are not seen, metres per second, if stated.
    pub minimum_detectable_m_per_s: Option<f64>,
    /// Probability that a target in the area is seen, if stated.
    pub detection_probability: Option<f64>,
    /// Made by a simulation.
    pub is_simulated: bool,
    /// The plots.
    pub reports: Vec<DwellReport>,
}

impl Dwell {
    /// Most reports that one message may have.
    pub const MAX_REPORT_COUNT: usize = MAX_REPORT_COUNT;
}

impl DwellReport {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), Invalid> {
        self.place.check()?;
        let sigmas = [
            ("reports.slant_sigma_m", self.slant_sigma_m),
            ("reports.cross_sigma_m", self.cross_sigma_m),
            ("reports.radial_sigma_m_per_s", self.radial_sigma_m_per_s),
            ("reports.wrap_m_per_s", self.wrap_m_per_s),
        ];
        for (field, value) in sigmas {
            let good = value.is_none_or(|sigma| 0.0 < sigma && sigma <= MAX_SIGMA_M);
            require(good, field, value, "more than 0 and at most 100 km (or km/s) is expected")?;
        }
        self.radial_m_per_s.map_or(Ok(()), |value| finite("reports.radial_m_per_s", value))?;
        self.snr_db.map_or(Ok(()), |value| finite("reports.snr_db", value))
    }
}

impl Message for Dwell {
    const KIND: Kind = Kind::Dwell;
    const SCHEMA: u16 = 1;
    const MAX_BYTES: usize = 768 << 10;

    fn check(&self) -> Result<(), Invalid> {
        time_unix("time_unix_s", self.time_unix_s)?;
        self.sensor.check()?;
        if let Some(flight) = &self.flight {
            finite("flight.course_deg", flight.course_deg)?;
            not_negative("flight.speed_m_per_s", flight.speed_m_per_s)?;
            finite("flight.climb_m_per_s", flight.climb_m_per_s)?;
        }
        self.area.center.check()?;
        not_negative("area.range_half_extent_m", self.area.range_half_extent_m)?;
        not_negative("area.angle_half_extent_deg", self.area.angle_half_extent_deg)?;
        if let Some(least) = self.minimum_detectable_m_per_s {
            not_negative("minimum_detectable_m_per_s", least)?;
        }
        if let Some(probability) = self.detection_probability {
            share("detection_probability", probability)?;
        }
        at_most("reports", self.reports.len(), MAX_REPORT_COUNT)?;
        self.reports.iter().try_for_each(DwellReport::check)
    }
}
