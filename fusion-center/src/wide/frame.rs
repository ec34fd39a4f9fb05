//! The local plane in which targets are followed, and what is in it as places on the earth.

use nalgebra::{Matrix2, Matrix4, Vector2, Vector3, Vector4};
use proto::geodesy::{EnuFrame, EnuPoint, GeoPosition, GeodesyError};
use proto::wire::{Dwell, GeoRecord};

/// Places farther from the origin than this, straight through the earth, are not followed, metres. The
/// earth is 310 km below the plane there, and lengths on it are too short by 1 in 20; beyond a quarter
/// of the way around it a place in the plane would stand for one on this side of the earth.
pub const MAX_REACH_M: f64 = 2e6;

/// East and north at a place, with the height of the ground there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalFrame {
    enu: EnuFrame,
}

/// A target as a map shows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlacedTrack {
    /// Where.
    pub place: GeoRecord,
    /// Direction over ground, degrees clockwise from true north, 0 to 360; any where it stands.
    pub course_deg: f64,
    /// Metres per second.
    pub speed_m_per_s: f64,
    /// `(east, north)` of the place itself, metres per second.
    pub velocity_m_per_s: Vector2<f64>,
    /// Covariance of `(east_m, north_m, east_m_per_s, north_m_per_s)`, also of the place itself.
    pub covariance: Matrix4<f64>,
}

impl LocalFrame {
    /// The frame whose origin is this place.
    ///
    /// # Errors
    /// If it is no place.
    pub fn new(origin: &GeoRecord) -> Result<Self, GeodesyError> {
        Ok(Self { enu: EnuFrame::new(position(origin)?) })
    }

    /// The frame whose origin is where a dwell looked.
    ///
    /// # Errors
    /// If that is no place.
    pub fn of_dwell(dwell: &Dwell) -> Result<Self, GeodesyError> {
        Self::new(&dwell.area.center)
    }

    /// Height of the origin above the ellipsoid, metres: that of targets of which none is known.
    #[must_use]
    pub fn height_m(&self) -> f64 {
        self.enu.origin().height_m()
    }

    /// A place as `(east, north, up)`, metres. Up is above the plane, from which the earth curves away.
    ///
    /// # Errors
    /// If it is no place.
    pub fn local_m(&self, place: &GeoRecord) -> Result<Vector3<f64>, GeodesyError> {
        let EnuPoint { east_m, north_m, up_m } = self.enu.to_enu(&position(place)?);
        Ok(Vector3::new(east_m, north_m, up_m))
    }

    /// How far a place is from the origin, straight through the earth, metres.
    ///
    /// # Errors
    /// If it is no place.
    pub fn off_m(&self, place: &GeoRecord) -> Result<f64, GeodesyError> {
        Ok(self.local_m(place)?.norm())
    }

    /// The place over `(east, north)` at this height above the ellipsoid.
    ///
    /// # Errors
    /// If there is none.
    pub fn place(&self, at_m: &Vector2<f64>, height_m: f64) -> Result<GeoRecord, GeodesyError> {
        Ok(record(&self.enu.on_surface(at_m.x, at_m.y, height_m)?))
    }

    /// A velocity `(east, north, up)` at a place, by its components in this frame.
    ///
    /// # Errors
    /// If that is no place.
    pub fn turned(
        &self,
        velocity_m_per_s: &Vector3<f64>,
        at: &GeoRecord,
    ) -> Result<Vector3<f64>, GeodesyError> {
        Ok(EnuFrame::new(position(at)?).vector_into(&self.enu, velocity_m_per_s))
    }

    /// A state `(x_m, y_m, x_m_per_s, y_m_per_s)` and its covariance at a height above the ellipsoid:
    /// velocity and covariance are turned to the east and north of the place, `v' = R v`,
    /// `C' = R C Rᵀ`, with `R` the part of the rotation between the two frames that keeps the plane.
    ///
    /// # Errors
    /// If the state is at no place.
    pub fn placed(
        &self,
        state: &Vector4<f64>,
        covariance: &Matrix4<f64>,
        height_m: f64,
    ) -> Result<PlacedTrack, GeodesyError> {
        let at_m = state.fixed_rows::<2>(0).into_owned();
        let found = self.enu.on_surface(at_m.x, at_m.y, height_m)?;
        let rotation = self.enu.rotation_into(&EnuFrame::new(found));
        let turn: Matrix2<f64> = rotation.fixed_view::<2, 2>(0, 0).into_owned();
        let velocity_m_per_s = turn * state.fixed_rows::<2>(2);
        let mut both = Matrix4::zeros();
        both.fixed_view_mut::<2, 2>(0, 0).copy_from(&turn);
        both.fixed_view_mut::<2, 2>(2, 2).copy_from(&turn);
        let course_deg = velocity_m_per_s.x.atan2(velocity_m_per_s.y).to_degrees();
        let course_deg = course_deg.rem_euclid(360.0);
        Ok(PlacedTrack {
            place: record(&found),
            // A tiny negative angle rounds up to a whole turn.
            course_deg: if course_deg < 360.0 { course_deg } else { 0.0 },
            speed_m_per_s: velocity_m_per_s.norm(),
            velocity_m_per_s,
            covariance: both * covariance * both.transpose(),
        })
    }
}

fn position(place: &GeoRecord) -> Result<GeoPosition, GeodesyError> {
    GeoPosition::new(place.lat_deg, place.lon_deg, place.height_m)
}

fn record(place: &GeoPosition) -> GeoRecord {
    GeoRecord { lat_deg: place.lat_deg(), lon_deg: place.lon_deg(), height_m: place.height_m() }
}
