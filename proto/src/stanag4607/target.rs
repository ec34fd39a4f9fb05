//! Dwells and target reports in metres, seconds, degrees and radians: read out and put together.

use super::dwell::{Dwell, TargetReport};
use super::number::{B16, Ba16, Ba32, OutOfRange, Sa32, Scale};
use super::units::{CM_PER_M, DM_PER_M, M_PER_KM, MM_PER_M};

/// A place on the ellipsoid WGS 84.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geodetic {
    /// Latitude, degrees, positive north.
    pub lat_deg: f64,
    /// Longitude, degrees in [−180, 180), positive east.
    pub lon_deg: f64,
    /// Height above the ellipsoid, metres.
    pub height_m: f64,
}

/// The area that a dwell looks at: an annular sector around its centre, seen from the sensor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DwellArea {
    /// Latitude of the centre, degrees.
    pub lat_deg: f64,
    /// Longitude of the centre, degrees in [−180, 180).
    pub lon_deg: f64,
    /// Half the extent in range, metres.
    pub half_range_m: f64,
    /// Half the extent in angle, radians.
    pub half_angle_rad: f64,
}

/// How the sensor moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorMotion {
    /// Direction, radians clockwise from true north.
    pub track_rad: f64,
    /// Speed over ground, metres per second.
    pub speed_m_per_s: f64,
    /// Climb, metres per second, positive up.
    pub climb_m_per_s: f64,
}

/// Which simulated target a report is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TruthTag {
    /// The simulation.
    pub application: u8,
    /// The target in it.
    pub entity: u32,
}

/// Standard deviations of a report.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TargetSigmas {
    /// Along the line of sight, metres.
    pub slant_m: f64,
    /// Across the line of sight, metres.
    pub cross_m: f64,
    /// Height, metres.
    pub height_m: f64,
    /// Radial velocity, metres per second.
    pub radial_m_per_s: f64,
}

impl Dwell {
    /// D7 to D9: where the sensor is.
    #[must_use]
    pub fn sensor(&self) -> Geodetic {
        Geodetic {
            lat_deg: self.sensor_latitude.deg(),
            lon_deg: self.sensor_longitude.signed_deg(),
            height_m: f64::from(self.sensor_altitude_cm) / CM_PER_M,
        }
    }

    /// D24 to D27: where the radar looked.
    #[must_use]
    pub fn area(&self) -> DwellArea {
        DwellArea {
            lat_deg: self.area_latitude.deg(),
            lon_deg: self.area_longitude.signed_deg(),
            half_range_m: self.area_half_range.value() * M_PER_KM,
            half_angle_rad: self.area_half_angle.rad(),
        }
    }

    /// D15 to D17: how the sensor moves, if all three are there.
    #[must_use]
    pub fn motion(&self) -> Option<SensorMotion> {
        Some(SensorMotion {
            track_rad: self.track?.rad(),
            speed_m_per_s: f64::from(self.speed_mm_per_s?) / MM_PER_M,
            climb_m_per_s: f64::from(self.climb_dm_per_s?) / DM_PER_M,
        })
    }

    /// D31: the slowest radial velocity that this dwell detects, metres per second.
    #[must_use]
    pub fn minimum_velocity_m_per_s(&self) -> Option<f64> {
        Some(f64::from(self.minimum_velocity_dm_per_s?) / DM_PER_M)
    }

    /// D4: whether the visit ends with this dwell.
    #[must_use]
    pub fn ends_revisit(&self) -> bool {
        self.last_dwell != 0
    }

    /// Raw latitude and longitude of a report of this dwell; none if it has no complete location.
    ///
    /// From D32.2 and D32.3 if there, else, in raw integers, `lat = D24 + D10 D32.4` and
    /// `lon = (D25 + D11 D32.5) mod 2^32` \[wide-area, Formats\]. A latitude beyond ±90° is none.
    #[must_use]
    pub fn location(&self, report: &TargetReport) -> Option<(Sa32, Ba32)> {
        if let (Some(latitude), Some(longitude)) = (report.latitude, report.longitude) {
            return Some((latitude, longitude));
        }
        let north = i64::from(self.latitude_scale?.0) * i64::from(report.delta_latitude?);
        let latitude = i32::try_from(i64::from(self.area_latitude.0) + north).ok()?;
        let east = self.longitude_scale?.0.wrapping_mul(unsigned(report.delta_longitude?));
        Some((Sa32(latitude), Ba32(self.area_longitude.0.wrapping_add(east))))
    }

    /// Latitude and longitude of a report of this dwell, degrees, the longitude in [−180, 180).
    #[must_use]
    pub fn location_deg(&self, report: &TargetReport) -> Option<(f64, f64)> {
        let (latitude, longitude) = self.location(report)?;
        Some((latitude.deg(), longitude.signed_deg()))
    }

    /// A dwell without reports.
    ///
    /// # Errors
    /// If a number does not fit its field; the longitude may be any finite number.
    pub fn new(time_ms: u32, sensor: Geodetic, area: DwellArea) -> Result<Self, OutOfRange> {
        let dwell = Self {
            time_ms,
            sensor_latitude: Sa32::from_deg(sensor.lat_deg)?,
            sensor_longitude: Ba32::from_deg(sensor.lon_deg)?,
            sensor_altitude_cm: narrow(ALTITUDE.count(sensor.height_m)?),
            area_latitude: Sa32::from_deg(area.lat_deg)?,
            area_longitude: Ba32::from_deg(area.lon_deg)?,
            area_half_range: B16::from_value(area.half_range_m / M_PER_KM)?,
            area_half_angle: Ba16::from_deg(area.half_angle_rad.to_degrees())?,
            ..Self::default()
        };
        Ok(dwell.sealed())
    }

    /// Adds D15 to D17.
    ///
    /// # Errors
    /// If a number does not fit its field.
    pub fn with_motion(self, motion: SensorMotion) -> Result<Self, OutOfRange> {
        let track = Ba16::from_deg(motion.track_rad.to_degrees())?;
        let speed = narrow(SPEED.count(motion.speed_m_per_s)?);
        let climb = narrow(CLIMB.count(motion.climb_m_per_s)?);
        let (track, speed_mm_per_s, climb_dm_per_s) = (Some(track), Some(speed), Some(climb));
        Ok(Self { track, speed_mm_per_s, climb_dm_per_s, ..self }.sealed())
    }

    /// Adds D31, metres per second.
    ///
    /// # Errors
    /// If it does not fit its field.
    pub fn with_minimum_velocity(self, m_per_s: f64) -> Result<Self, OutOfRange> {
        let minimum_velocity_dm_per_s = Some(narrow(MINIMUM_VELOCITY.count(m_per_s)?));
        Ok(Self { minimum_velocity_dm_per_s, ..self }.sealed())
    }

    /// Adds the reports and seals the dwell.
    #[must_use]
    pub fn with_reports(self, reports: Vec<TargetReport>) -> Self {
        Self { reports, ..self }.sealed()
    }
}

impl TargetReport {
    /// D32.7: radial velocity, metres per second, positive away from the sensor.
    #[must_use]
    pub fn radial_velocity_m_per_s(&self) -> Option<f64> {
        Some(f64::from(self.radial_velocity_cm_per_s?) / CM_PER_M)
    }

    /// D32.8: the radial velocity is known up to multiples of this, metres per second.
    #[must_use]
    pub fn wrap_velocity_m_per_s(&self) -> Option<f64> {
        Some(f64::from(self.wrap_velocity_cm_per_s?) / CM_PER_M)
    }

    /// D32.12: standard deviation along the line of sight, metres.
    #[must_use]
    pub fn slant_sigma_m(&self) -> Option<f64> {
        Some(f64::from(self.slant_sigma_cm?) / CM_PER_M)
    }

    /// D32.13: standard deviation across the line of sight, metres.
    #[must_use]
    pub fn cross_sigma_m(&self) -> Option<f64> {
        Some(f64::from(self.cross_sigma_dm?) / DM_PER_M)
    }

    /// D32.15: standard deviation of the radial velocity, metres per second.
    #[must_use]
    pub fn radial_sigma_m_per_s(&self) -> Option<f64> {
        Some(f64::from(self.radial_sigma_cm_per_s?) / CM_PER_M)
    }

    /// D32.18: radar cross section, decibels.
    #[must_use]
    pub fn cross_section_db(&self) -> Option<f64> {
        Some(f64::from(self.cross_section_half_db?) / 2.0)
    }

    /// D32.16 and D32.17: the simulated target, if both are there.
    #[must_use]
    pub fn truth(&self) -> Option<TruthTag> {
        Some(TruthTag { application: self.truth_application?, entity: self.truth_entity? })
    }

    /// A report with D32.2 and D32.3.
    ///
    /// # Errors
    /// If the latitude is beyond ±90° or a number is not finite.
    pub fn at_deg(lat_deg: f64, lon_deg: f64) -> Result<Self, OutOfRange> {
        let (latitude, longitude) = (Sa32::from_deg(lat_deg)?, Ba32::from_deg(lon_deg)?);
        let (latitude, longitude) = (Some(latitude), Some(longitude));
        Ok(Self { latitude, longitude, ..Self::default() })
    }

    /// Adds D32.6, metres above the ellipsoid.
    ///
    /// # Errors
    /// Outside −1000 to 32,767 m.
    pub fn with_height(self, height_m: f64) -> Result<Self, OutOfRange> {
        Ok(Self { height_m: Some(narrow(HEIGHT.count(height_m)?)), ..self })
    }

    /// Adds D32.7 and D32.8, metres per second, the velocity positive away from the sensor.
    ///
    /// # Errors
    /// If a number does not fit its field.
    pub fn with_velocity(self, radial: f64, wrap: f64) -> Result<Self, OutOfRange> {
        let radial_velocity_cm_per_s = Some(narrow(RADIAL_VELOCITY.count(radial)?));
        let wrap_velocity_cm_per_s = Some(narrow(WRAP_VELOCITY.count(wrap)?));
        Ok(Self { radial_velocity_cm_per_s, wrap_velocity_cm_per_s, ..self })
    }

    /// Adds D32.9, decibels.
    ///
    /// # Errors
    /// Outside −128 to 127 dB.
    pub fn with_snr(self, snr_db: f64) -> Result<Self, OutOfRange> {
        Ok(Self { snr_db: Some(narrow(SNR.count(snr_db)?)), ..self })
    }

    /// Adds D32.12 to D32.15.
    ///
    /// # Errors
    /// If a number does not fit its field.
    pub fn with_sigmas(self, sigmas: TargetSigmas) -> Result<Self, OutOfRange> {
        Ok(Self {
            slant_sigma_cm: Some(narrow(SLANT_SIGMA.count(sigmas.slant_m)?)),
            cross_sigma_dm: Some(narrow(CROSS_SIGMA.count(sigmas.cross_m)?)),
            height_sigma_m: Some(narrow(HEIGHT_SIGMA.count(sigmas.height_m)?)),
            radial_sigma_cm_per_s: Some(narrow(RADIAL_SIGMA.count(sigmas.radial_m_per_s)?)),
            ..self
        })
    }

    /// Adds D32.16 and D32.17.
    #[must_use]
    pub fn with_truth(self, truth: TruthTag) -> Self {
        let (truth_application, truth_entity) = (Some(truth.application), Some(truth.entity));
        Self { truth_application, truth_entity, ..self }
    }
}

/// Two's complement in 32 bits, for products modulo 2^32.
fn unsigned(steps: i16) -> u32 {
    i32::from(steps).cast_unsigned()
}

/// A count that a [`Scale`] has checked; the fallback is never used.
fn narrow<T: TryFrom<i64> + Default>(count: i64) -> T {
    T::try_from(count).unwrap_or_default()
}

const fn scale(field: &'static str, unit: &'static str, per_unit: f64, range: (i64, i64)) -> Scale {
    Scale { field, unit, step: 1.0 / per_unit, low: range.0, high: range.1 }
}

// The ranges are those of the standard where they are narrower than the field.
const ALTITUDE: Scale = scale("D9", "m", CM_PER_M, (-50_000, 2_000_000_000));
const SPEED: Scale = scale("D16", "m/s", MM_PER_M, (0, 8_000_000));
const CLIMB: Scale = scale("D17", "m/s", DM_PER_M, (-128, 127));
const MINIMUM_VELOCITY: Scale = scale("D31", "m/s", DM_PER_M, (0, 255));
const HEIGHT: Scale = scale("D32.6", "m", 1.0, (-1000, 32_767));
const RADIAL_VELOCITY: Scale = scale("D32.7", "m/s", CM_PER_M, (-32_768, 32_767));
const WRAP_VELOCITY: Scale = scale("D32.8", "m/s", CM_PER_M, (0, 65_535));
const SNR: Scale = scale("D32.9", "dB", 1.0, (-128, 127));
const SLANT_SIGMA: Scale = scale("D32.12", "m", CM_PER_M, (0, 65_535));
const CROSS_SIGMA: Scale = scale("D32.13", "m", DM_PER_M, (0, 65_535));
const HEIGHT_SIGMA: Scale = scale("D32.14", "m", 1.0, (0, 255));
const RADIAL_SIGMA: Scale = scale("D32.15", "m/s", CM_PER_M, (0, 5000));
