//! One plot as a row: columns of a CSV file, or keys of a JSON object.

use serde::Deserialize;

use super::{LocalPlot, LocalScan, RowFault};
use crate::ids::{InvalidName, NodeId};
use crate::wire::{Dwell, DwellArea, DwellReport, FlightRecord, GeoRecord, Invalid};

/// Largest coordinate of a plane, metres.
const MAX_LOCAL_M: f64 = 1e7;
/// Standard deviations that are believed, metres or metres per second.
const SIGMAS: std::ops::RangeInclusive<f64> = 1e-6..=1e5;
/// Half extent of an area that is not stated: everything within sight of an aircraft, metres.
const EVERYWHERE_M: f64 = 1e6;

macro_rules! row {
    ($($(#[$doc:meta])* $name:ident: $kind:ty),* $(,)?) => {
        /// One plot, or a dwell without plots, as a row. Every column may be left out or empty,
        /// as far as the rest says enough.
        #[derive(Clone, Debug, Default, PartialEq, Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct PlotRow {
            $($(#[$doc])* pub $name: Option<$kind>,)*
        }

        /// The columns of a row.
        pub const COLUMNS: &[&str] = &[$(stringify!($name)),*];
    };
}

row! {
    /// When, Unix seconds; this or `time_s`.
    time_unix_s: f64,
    /// When, seconds on a clock of the data.
    time_s: f64,
    /// Name of the sensor; that of the node if left out.
    sensor: String,
    /// The sensor's count of sweeps; counted by dwells if left out.
    revisit: u32,
    /// The dwell's number in its revisit; 0 if left out.
    dwell: u32,
    /// Latitude of the plot, degrees; none of a dwell without plots.
    lat_deg: f64,
    /// Longitude of the plot, degrees.
    lon_deg: f64,
    /// Height of the plot above the ellipsoid, metres; 0 if left out.
    height_m: f64,
    /// First coordinate of the plot on a plane, metres, instead of a place on the earth.
    x_m: f64,
    /// Second coordinate of the plot on a plane, metres.
    y_m: f64,
    /// Standard deviation in every direction, metres, instead of the next two.
    sigma_m: f64,
    /// Standard deviation along the line of sight (slant), metres.
    slant_sigma_m: f64,
    /// Standard deviation across the line of sight, metres.
    cross_sigma_m: f64,
    /// Radial velocity, away from the sensor, freed of its motion, metres per second.
    radial_m_per_s: f64,
    /// Its standard deviation, metres per second.
    radial_sigma_m_per_s: f64,
    /// It is known up to multiples of this, metres per second.
    wrap_m_per_s: f64,
    /// Power over noise, decibels.
    snr_db: f64,
    /// Which target it really is, where that is known.
    truth: u32,
    /// Latitude of the sensor, degrees; needed with `lat_deg`.
    sensor_lat_deg: f64,
    /// Longitude of the sensor, degrees.
    sensor_lon_deg: f64,
    /// Height of the sensor, metres above the ellipsoid or the plane.
    sensor_height_m: f64,
    /// First coordinate of the sensor on the plane, metres.
    sensor_x_m: f64,
    /// Second coordinate of the sensor on the plane, metres.
    sensor_y_m: f64,
    /// Course of the sensor over ground, degrees clockwise from north.
    sensor_course_deg: f64,
    /// Speed of the sensor over ground, metres per second.
    sensor_speed_m_per_s: f64,
    /// Latitude of the middle of what the dwell could see; everything if left out.
    area_lat_deg: f64,
    /// Longitude of the middle of what the dwell could see.
    area_lon_deg: f64,
    /// From there to the near and far end, metres over ground.
    area_range_half_extent_m: f64,
    /// To either side of it as seen from the sensor, degrees.
    area_angle_half_extent_deg: f64,
    /// Slower targets are not seen, metres per second.
    minimum_detectable_m_per_s: f64,
    /// Probability that a target in the area is seen.
    detection_probability: f64,
}

/// What rows of one dwell have in common.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct DwellKey {
    pub(super) node: NodeId,
    pub(super) time_s: f64,
    pub(super) revisit: Option<u32>,
    pub(super) dwell: Option<u32>,
    pub(super) is_local: bool,
}

impl PlotRow {
    /// Which dwell it is of; rows without a sensor are of `node`.
    pub(super) fn key(&self, node: &NodeId) -> Result<DwellKey, RowFault> {
        let time_s = match (self.time_unix_s, self.time_s) {
            (Some(_), Some(_)) => {
                return Err(RowFault::Both { first: "time_unix_s", second: "time_s" });
            }
            (Some(time_s), None) | (None, Some(time_s)) => time_s,
            (None, None) => {
                let remedy = "give time_unix_s, or time_s on a clock of the data";
                return Err(RowFault::Missing { field: "time_unix_s", remedy });
            }
        };
        require(time_s.is_finite(), "time_s", time_s, "a finite number of seconds is expected")?;
        let is_on_earth = self.lat_deg.is_some() || self.sensor_lat_deg.is_some();
        let is_on_plane = self.x_m.is_some() || self.sensor_x_m.is_some();
        if is_on_earth && is_on_plane {
            return Err(RowFault::Both { first: "lat_deg", second: "x_m" });
        }
        let named = self.sensor.as_ref().map(|name| {
            name.parse().map_err(|error: InvalidName| RowFault::Cell {
                column: "sensor".to_owned(),
                text: error.text.clone(),
                detail: error.to_string(),
            })
        });
        Ok(DwellKey {
            node: named.transpose()?.unwrap_or_else(|| node.clone()),
            time_s,
            revisit: self.revisit,
            dwell: self.dwell,
            is_local: !is_on_earth,
        })
    }

    /// The dwell that it begins, still without plots. What a row of the dwell says of the dwell is
    /// taken from the first.
    pub(super) fn dwell(&self, key: &DwellKey, revisit_index: u32) -> Result<Dwell, RowFault> {
        let sensor = self.sensor_place()?;
        Ok(Dwell {
            node: key.node.clone(),
            time_unix_s: key.time_s,
            revisit_index,
            dwell_index: self.dwell.unwrap_or(0),
            is_last_of_revisit: self.dwell.is_none(),
            sensor,
            flight: self.flight(),
            area: self.area(sensor)?,
            minimum_detectable_m_per_s: self.minimum_detectable_m_per_s,
            detection_probability: self.detection_probability,
            is_simulated: false,
            reports: Vec::new(),
        })
    }

    fn sensor_place(&self) -> Result<GeoRecord, RowFault> {
        let missing = |field| RowFault::Missing {
            field,
            remedy: "give where the sensor was: errors and radial velocities are along its line of sight",
        };
        Ok(GeoRecord {
            lat_deg: self.sensor_lat_deg.ok_or_else(|| missing("sensor_lat_deg"))?,
            lon_deg: self.sensor_lon_deg.ok_or_else(|| missing("sensor_lon_deg"))?,
            height_m: self.sensor_height_m.ok_or_else(|| missing("sensor_height_m"))?,
        })
    }

    fn flight(&self) -> Option<FlightRecord> {
        let (course_deg, speed_m_per_s) = (self.sensor_course_deg?, self.sensor_speed_m_per_s?);
        Some(FlightRecord { course_deg, speed_m_per_s, climb_m_per_s: 0.0 })
    }

    fn area(&self, sensor: GeoRecord) -> Result<DwellArea, RowFault> {
        let remedy = "an area has area_lat_deg, area_lon_deg, area_range_half_extent_m and \
                      area_angle_half_extent_deg";
        let parts = [
            ("area_lat_deg", self.area_lat_deg),
            ("area_lon_deg", self.area_lon_deg),
            ("area_range_half_extent_m", self.area_range_half_extent_m),
            ("area_angle_half_extent_deg", self.area_angle_half_extent_deg),
        ];
        match parts.map(|(_, value)| value) {
            [None, None, None, None] => Ok(DwellArea {
                center: GeoRecord { height_m: 0.0, ..sensor },
                range_half_extent_m: EVERYWHERE_M,
                angle_half_extent_deg: 180.0,
            }),
            [Some(lat_deg), Some(lon_deg), Some(range_m), Some(angle_deg)] => Ok(DwellArea {
                center: GeoRecord { lat_deg, lon_deg, height_m: 0.0 },
                range_half_extent_m: range_m,
                angle_half_extent_deg: angle_deg,
            }),
            _ => {
                let absent = parts.iter().find(|(_, value)| value.is_none());
                let field = absent.map_or("area_lat_deg", |(name, _)| name);
                Err(RowFault::Missing { field, remedy })
            }
        }
    }

    /// The plot; `None` in a row that only says that a dwell was there.
    pub(super) fn report(&self, index: u32) -> Result<Option<DwellReport>, RowFault> {
        let (lat_deg, lon_deg) = match (self.lat_deg, self.lon_deg) {
            (None, None) => return Ok(None),
            (Some(lat_deg), Some(lon_deg)) => (lat_deg, lon_deg),
            (None, Some(_)) => return Err(half("lat_deg")),
            (Some(_), None) => return Err(half("lon_deg")),
        };
        let (slant_sigma_m, cross_sigma_m) = self.sigmas()?;
        Ok(Some(DwellReport {
            index,
            place: GeoRecord { lat_deg, lon_deg, height_m: self.height_m.unwrap_or(0.0) },
            slant_sigma_m,
            cross_sigma_m,
            radial_m_per_s: self.radial_m_per_s,
            radial_sigma_m_per_s: self.radial_sigma_m_per_s,
            wrap_m_per_s: self.wrap_m_per_s,
            snr_db: self.snr_db,
            truth: self.truth,
        }))
    }

    /// The scan on a plane that it begins, still without plots.
    pub(super) fn local_scan(
        &self,
        key: &DwellKey,
        revisit_index: u32,
    ) -> Result<LocalScan, RowFault> {
        let sensor_m = match (self.sensor_x_m, self.sensor_y_m) {
            (Some(x_m), Some(y_m)) => Some([x_m, y_m, self.sensor_height_m.unwrap_or(0.0)]),
            (None, None) => None,
            (None, Some(_)) => return Err(half("sensor_x_m")),
            (Some(_), None) => return Err(half("sensor_y_m")),
        };
        for coordinate_m in sensor_m.into_iter().flatten() {
            coordinate("sensor_x_m, sensor_y_m or sensor_height_m", coordinate_m)?;
        }
        let is_share = self.detection_probability.is_none_or(|p| (0.0..=1.0).contains(&p));
        require(is_share, "detection_probability", self.detection_probability, "use 0 to 1")?;
        let least = self.minimum_detectable_m_per_s;
        let is_speed = least.is_none_or(|speed| (0.0..=1e5).contains(&speed));
        require(is_speed, "minimum_detectable_m_per_s", least, "use 0 or more")?;
        Ok(LocalScan {
            time_s: key.time_s,
            node: key.node.clone(),
            revisit_index,
            dwell_index: self.dwell.unwrap_or(0),
            sensor_m,
            detection_probability: self.detection_probability,
            minimum_detectable_m_per_s: least,
            plots: Vec::new(),
        })
    }

    /// The plot on a plane; `None` in a row that only says that a dwell was there.
    pub(super) fn local_plot(&self, index: u32) -> Result<Option<LocalPlot>, RowFault> {
        let at_m = match (self.x_m, self.y_m) {
            (None, None) => return Ok(None),
            (Some(x_m), Some(y_m)) => [x_m, y_m],
            (None, Some(_)) => return Err(half("x_m")),
            (Some(_), None) => return Err(half("y_m")),
        };
        at_m.into_iter().try_for_each(|value_m| coordinate("x_m or y_m", value_m))?;
        let (slant_sigma_m, cross_sigma_m) = self.sigmas()?;
        for (field, value) in [("radial_m_per_s", self.radial_m_per_s), ("snr_db", self.snr_db)] {
            let good = value.is_none_or(f64::is_finite);
            require(good, field, value, "a finite number is expected")?;
        }
        Ok(Some(LocalPlot {
            index,
            at_m,
            slant_sigma_m,
            cross_sigma_m,
            radial_m_per_s: self.radial_m_per_s,
            radial_sigma_m_per_s: self.radial_sigma_m_per_s,
            wrap_m_per_s: self.wrap_m_per_s,
            snr_db: self.snr_db,
            truth: self.truth,
        }))
    }

    fn sigmas(&self) -> Result<(Option<f64>, Option<f64>), RowFault> {
        if self.sigma_m.is_some() && (self.slant_sigma_m.or(self.cross_sigma_m)).is_some() {
            return Err(RowFault::Both { first: "sigma_m", second: "slant_sigma_m" });
        }
        let sigmas = [
            ("sigma_m", self.sigma_m),
            ("slant_sigma_m", self.slant_sigma_m),
            ("cross_sigma_m", self.cross_sigma_m),
            ("radial_sigma_m_per_s", self.radial_sigma_m_per_s),
            ("wrap_m_per_s", self.wrap_m_per_s),
        ];
        for (field, value) in sigmas {
            let good = value.is_none_or(|sigma| SIGMAS.contains(&sigma));
            require(good, field, value, "more than 0 and at most 100000 is expected")?;
        }
        Ok((self.slant_sigma_m.or(self.sigma_m), self.cross_sigma_m.or(self.sigma_m)))
    }
}

fn half(field: &'static str) -> RowFault {
    RowFault::Missing { field, remedy: "a place has two coordinates" }
}

fn coordinate(field: &'static str, value_m: f64) -> Result<(), RowFault> {
    let good = value_m.is_finite() && value_m.abs() <= MAX_LOCAL_M;
    require(good, field, value_m, "a finite number of metres within 10000 km is expected")
}

#[expect(clippy::fn_params_excessive_bools, reason = "reads like an assertion")]
fn require(
    good: bool,
    field: &'static str,
    value: impl Into<Option<f64>>,
    expected: &'static str,
) -> Result<(), RowFault> {
    if good {
        return Ok(());
    }
    let value = value.into().map_or_else(String::new, |value| format!("{value:?}"));
    Err(Invalid { field, value, expected }.into())
}
