//! The plane in which targets of wide-area radars are followed, and the way back to the earth.

use nalgebra::{Matrix2, Matrix4, Vector2, Vector3, Vector4};
use proto::geodesy::{EnuFrame, GeoPosition, GeodesyError};
use proto::plots::{LocalPlot, LocalScan, Scan};
use proto::wire::{Dwell, DwellReport, GeoRecord};

/// Where the plane of the targets lies.
#[derive(Clone, Copy, Debug)]
pub enum Ground {
    /// Local east and north about a place on the earth: good for some hundred kilometres around.
    Earth(EnuFrame),
    /// The data's own plane, nowhere on the earth.
    Plane,
}

/// A sector of a ring in the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sector {
    /// Its middle.
    pub(super) center_m: Vector2<f64>,
    /// From there to the near and far end.
    pub(super) range_half_extent_m: f64,
    /// To either side, as seen from the sensor.
    pub(super) angle_half_extent_rad: f64,
}

/// A scan in the plane.
#[derive(Clone, Debug)]
pub(super) struct Flat {
    /// What it says of sensor and plots.
    pub(super) scan: LocalScan,
    /// Of the sensor, if it is known.
    pub(super) sensor_velocity_m_per_s: Option<Vector3<f64>>,
    /// What it could see, if that is a part of the plane.
    pub(super) sector: Option<Sector>,
}

/// A state on the earth.
#[derive(Clone, Debug, PartialEq)]
pub struct GeoState {
    /// Where.
    pub place: GeoRecord,
    /// Velocity to the east and to the north there, metres per second.
    pub velocity_m_per_s: Vector2<f64>,
    /// Covariance of east, north and their velocities there.
    pub covariance: Matrix4<f64>,
}

impl Ground {
    /// The plane for a scan and those after it: about the middle of what it could see, at the height
    /// of its plots.
    ///
    /// # Errors
    /// If the scan says a place that is none.
    pub fn of(scan: &Scan) -> Result<Self, GeodesyError> {
        let Scan::Geographic(dwell) = scan else { return Ok(Self::Plane) };
        let GeoRecord { lat_deg, lon_deg, height_m } = dwell.area.center;
        let height_m = dwell.reports.first().map_or(height_m, |report| report.place.height_m);
        Ok(Self::Earth(EnuFrame::new(GeoPosition::new(lat_deg, lon_deg, height_m)?)))
    }

    /// `scan` in this plane; `None` if the one is on the earth and the other is not.
    pub(super) fn flat(&self, scan: &Scan) -> Result<Option<Flat>, GeodesyError> {
        match (self, scan) {
            (Self::Earth(frame), Scan::Geographic(dwell)) => Ok(Some(flat(frame, dwell)?)),
            (Self::Plane, Scan::Local(local)) => {
                Ok(Some(Flat { scan: local.clone(), sensor_velocity_m_per_s: None, sector: None }))
            }
            _ => Ok(None),
        }
    }

    /// A state of the plane on the earth, for a target at this height; `None` on a plane of its own.
    ///
    /// Velocity and covariance turn with the difference of the two tangent planes, that is with the
    /// convergence of the meridians; the height is taken as it is.
    ///
    /// # Errors
    /// If the state is nowhere near the surface.
    pub fn geo_state(
        &self,
        state: &Vector4<f64>,
        covariance: &Matrix4<f64>,
        height_m: f64,
    ) -> Result<Option<GeoState>, GeodesyError> {
        let Self::Earth(frame) = self else { return Ok(None) };
        let place = frame.on_surface(state.x, state.y, height_m)?;
        let turn = frame.rotation_into(&EnuFrame::new(place));
        let turn: Matrix2<f64> = turn.fixed_view::<2, 2>(0, 0).into_owned();
        let mut both = Matrix4::zeros();
        both.fixed_view_mut::<2, 2>(0, 0).copy_from(&turn);
        both.fixed_view_mut::<2, 2>(2, 2).copy_from(&turn);
        let place = GeoRecord {
            lat_deg: place.lat_deg(),
            lon_deg: place.lon_deg(),
            height_m: place.height_m(),
        };
        Ok(Some(GeoState {
            place,
            velocity_m_per_s: turn * Vector2::new(state.z, state.w),
            covariance: both * covariance * both.transpose(),
        }))
    }
}

fn flat(frame: &EnuFrame, dwell: &Dwell) -> Result<Flat, GeodesyError> {
    let place = position(&dwell.sensor)?;
    let sensor = frame.to_enu(&place);
    let velocity = dwell.flight.map(|flight| {
        let (sin, cos) = flight.course_deg.to_radians().sin_cos();
        let speed_m_per_s = flight.speed_m_per_s;
        let there = Vector3::new(speed_m_per_s * sin, speed_m_per_s * cos, flight.climb_m_per_s);
        EnuFrame::new(place).vector_into(frame, &there)
    });
    let plots: Result<Vec<LocalPlot>, GeodesyError> =
        dwell.reports.iter().map(|report| flat_plot(frame, report)).collect();
    let sees_all = 180.0 <= dwell.area.angle_half_extent_deg;
    let center = frame.to_enu(&position(&dwell.area.center)?);
    let sector = Sector {
        center_m: Vector2::new(center.east_m, center.north_m),
        range_half_extent_m: dwell.area.range_half_extent_m,
        angle_half_extent_rad: dwell.area.angle_half_extent_deg.to_radians(),
    };
    let scan = LocalScan {
        time_s: dwell.time_unix_s,
        node: dwell.node.clone(),
        revisit_index: dwell.revisit_index,
        dwell_index: dwell.dwell_index,
        sensor_m: Some([sensor.east_m, sensor.north_m, sensor.up_m]),
        detection_probability: dwell.detection_probability,
        minimum_detectable_m_per_s: dwell.minimum_detectable_m_per_s,
        plots: plots?,
    };
    let sector = (!sees_all).then_some(sector);
    Ok(Flat { scan, sensor_velocity_m_per_s: velocity, sector })
}

fn flat_plot(frame: &EnuFrame, report: &DwellReport) -> Result<LocalPlot, GeodesyError> {
    let at = frame.to_enu(&position(&report.place)?);
    Ok(LocalPlot {
        index: report.index,
        at_m: [at.east_m, at.north_m],
        slant_sigma_m: report.slant_sigma_m,
        cross_sigma_m: report.cross_sigma_m,
        radial_m_per_s: report.radial_m_per_s,
        radial_sigma_m_per_s: report.radial_sigma_m_per_s,
        wrap_m_per_s: report.wrap_m_per_s,
        snr_db: report.snr_db,
        truth: report.truth,
    })
}

fn position(place: &GeoRecord) -> Result<GeoPosition, GeodesyError> {
    GeoPosition::new(place.lat_deg, place.lon_deg, place.height_m)
}
