//! The local frame: east, north and up at a place, where tracks live.

use nalgebra::{Matrix2, Matrix3, Vector3};

use super::{EcefPosition, GeoPosition, GeodesyError};

/// How near the height of [`EnuFrame::on_surface`] comes to what was asked for, metres.
const HEIGHT_TOLERANCE_M: f64 = 1e-6;
/// Each step leaves of the error no more than (distance / earth's radius)², so that this many
/// serve up to 3000 km.
const HEIGHT_STEPS_MAX: usize = 40;

/// The frame of east, north and up in the plane that touches the ellipsoid's normal at its origin.
///
/// Curvature is not removed: a place at the origin's height 20 km away is 31 m below the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EnuFrame {
    origin: GeoPosition,
    origin_ecef_m: Vector3<f64>,
    enu_from_ecef: Matrix3<f64>,
}

/// A place in an [`EnuFrame`], metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EnuPoint {
    /// Towards true east at the origin.
    pub east_m: f64,
    /// Towards true north at the origin.
    pub north_m: f64,
    /// Along the ellipsoid's normal at the origin.
    pub up_m: f64,
}

impl EnuPoint {
    fn vector_m(&self) -> Vector3<f64> {
        Vector3::new(self.east_m, self.north_m, self.up_m)
    }
}

impl From<Vector3<f64>> for EnuPoint {
    fn from(vector_m: Vector3<f64>) -> Self {
        Self { east_m: vector_m.x, north_m: vector_m.y, up_m: vector_m.z }
    }
}

/// Where a place is seen from an [`EnuFrame`]'s origin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    /// From true north, clockwise, in [0, 360), degrees.
    pub azimuth_deg: f64,
    /// Above the plane through the origin, degrees. No refraction.
    pub elevation_deg: f64,
    /// The straight line, metres.
    pub slant_range_m: f64,
}

impl EnuFrame {
    /// The frame at a place. At a pole east and north are those of the position's longitude.
    #[must_use]
    pub fn new(origin: GeoPosition) -> Self {
        let (sin_lat, cos_lat) = origin.lat_deg().to_radians().sin_cos();
        let (sin_lon, cos_lon) = origin.lon_deg().to_radians().sin_cos();
        let enu_from_ecef = Matrix3::new(
            -sin_lon,
            cos_lon,
            0.0,
            -sin_lat * cos_lon,
            -sin_lat * sin_lon,
            cos_lat,
            cos_lat * cos_lon,
            cos_lat * sin_lon,
            sin_lat,
        );
        Self { origin, origin_ecef_m: origin.to_ecef().0, enu_from_ecef }
    }

    /// Where the frame stands.
    #[must_use]
    pub fn origin(&self) -> GeoPosition {
        self.origin
    }

    /// A place in this frame.
    #[must_use]
    pub fn to_enu(&self, place: &GeoPosition) -> EnuPoint {
        self.enu_of_ecef(&place.to_ecef())
    }

    /// A geocentric place in this frame.
    #[must_use]
    pub fn enu_of_ecef(&self, place: &EcefPosition) -> EnuPoint {
        (self.enu_from_ecef * (place.0 - self.origin_ecef_m)).into()
    }

    /// A place of this frame in geocentric coordinates.
    #[must_use]
    pub fn to_ecef(&self, point: &EnuPoint) -> EcefPosition {
        EcefPosition(self.origin_ecef_m + self.enu_from_ecef.transpose() * point.vector_m())
    }

    /// A place of this frame by latitude, longitude and height.
    ///
    /// # Errors
    /// If it is not near the surface of the earth.
    pub fn to_geo(&self, point: &EnuPoint) -> Result<GeoPosition, GeodesyError> {
        self.to_ecef(point).to_geo()
    }

    /// The place above or below a point of the tangent plane that has a given height above the
    /// ellipsoid: where a target is that was tracked in the plane and stands on known terrain.
    ///
    /// # Errors
    /// If it is not near the surface of the earth.
    pub fn on_surface(
        &self,
        east_m: f64,
        north_m: f64,
        height_m: f64,
    ) -> Result<GeoPosition, GeodesyError> {
        let mut up_m = height_m - self.origin.height_m();
        for _ in 0..HEIGHT_STEPS_MAX {
            let found = self.to_ecef(&EnuPoint { east_m, north_m, up_m });
            let missing_m = height_m - found.height_m();
            if missing_m.abs() < HEIGHT_TOLERANCE_M {
                return found.to_geo()?.at_height(height_m);
            }
            up_m += missing_m;
        }
        Err(GeodesyError::BesideEarth { east_m, north_m, height_m })
    }

    /// How a place is seen from the origin.
    #[must_use]
    pub fn look_at(&self, place: &GeoPosition) -> Look {
        let EnuPoint { east_m, north_m, up_m } = self.to_enu(place);
        let ground_m = east_m.hypot(north_m);
        let azimuth_deg = east_m.atan2(north_m).to_degrees().rem_euclid(360.0);
        Look {
            // A tiny negative angle rounds up to a whole turn.
            azimuth_deg: if azimuth_deg < 360.0 { azimuth_deg } else { 0.0 },
            elevation_deg: up_m.atan2(ground_m).to_degrees(),
            slant_range_m: ground_m.hypot(up_m),
        }
    }

    /// The place that is seen so.
    ///
    /// # Errors
    /// If it is not near the surface of the earth.
    pub fn place_seen(&self, look: &Look) -> Result<GeoPosition, GeodesyError> {
        let (sin_az, cos_az) = look.azimuth_deg.to_radians().sin_cos();
        let (sin_el, cos_el) = look.elevation_deg.to_radians().sin_cos();
        let direction = Vector3::new(cos_el * sin_az, cos_el * cos_az, sin_el);
        self.to_geo(&(look.slant_range_m * direction).into())
    }

    /// The rotation that takes components of vectors in this frame to those in another:
    /// `v' = R v`, `C' = R C Rᵀ`.
    #[must_use]
    pub fn rotation_into(&self, other: &Self) -> Matrix3<f64> {
        other.enu_from_ecef * self.enu_from_ecef.transpose()
    }

    /// The horizontal part of that rotation, for what moves on the ground and is tracked in the
    /// plane of this frame: `v' = A v`, `C' = A C Aᵀ` with `v` east and north here, `v'` east and
    /// north in a frame at the target. It leaves out the tilt between the two planes: a share of
    /// (distance / earth's radius)²/2 of the vector, 5e-6 at 20 km.
    #[must_use]
    pub fn horizontal_into(&self, other: &Self) -> Matrix2<f64> {
        self.rotation_into(other).fixed_view::<2, 2>(0, 0).into_owned()
    }

    /// A vector of this frame (a velocity, say) by its components in another.
    #[must_use]
    pub fn vector_into(&self, other: &Self, vector: &Vector3<f64>) -> Vector3<f64> {
        self.rotation_into(other) * vector
    }

    /// A covariance of this frame by its elements in another.
    #[must_use]
    pub fn covariance_into(&self, other: &Self, covariance: &Matrix3<f64>) -> Matrix3<f64> {
        let rotation = self.rotation_into(other);
        rotation * covariance * rotation.transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What issue and specification ask for, metres.
    const MILLIMETRE: f64 = 1e-3;

    fn position(lat_deg: f64, lon_deg: f64, height_m: f64) -> GeoPosition {
        GeoPosition::new(lat_deg, lon_deg, height_m).unwrap()
    }

    /// The worked example of EPSG methods 9836 and 9837 \[iogp-7-2\].
    #[test]
    fn the_published_example_is_met_both_ways() {
        let frame = EnuFrame::new(position(55.0, 5.0, 200.0));
        let origin = EcefPosition(Vector3::new(3_652_755.305_8, 319_574.679_9, 5_201_547.353_6));
        assert!(frame.origin().to_ecef().distance_m(&origin) < MILLIMETRE);
        let lat_deg = 53.0 + 48.0 / 60.0 + 33.82 / 3600.0;
        let lon_deg = 2.0 + 7.0 / 60.0 + 46.38 / 3600.0;
        let geo = position(lat_deg, lon_deg, 73.0);
        let published = Vector3::new(-189_013.869, -128_642.040, -4_220.171);
        let found = frame.to_enu(&geo);
        assert!((found.vector_m() - published).norm() < MILLIMETRE, "{found:?}");
        let back = frame.to_geo(&published.into()).unwrap();
        assert!(back.to_ecef().distance_m(&geo.to_ecef()) < MILLIMETRE);
    }

    /// East is the way a small step of longitude goes, north that of latitude, up that of height.
    #[test]
    fn the_axes_point_where_small_steps_go() {
        let step_deg = 1e-6;
        for (lat_deg, lon_deg) in [(40.8, 111.7), (-33.9, -70.7), (0.0, 0.0), (79.0, -179.9)] {
            let here = position(lat_deg, lon_deg, 1_000.0);
            let frame = EnuFrame::new(here);
            let step = |lat: f64, lon: f64, up_m: f64| {
                let there = position(lat_deg + lat, lon_deg + lon, 1_000.0 + up_m);
                (there.to_ecef().0 - here.to_ecef().0).normalize()
            };
            let axes = [step(0.0, step_deg, 0.0), step(step_deg, 0.0, 0.0), step(0.0, 0.0, 0.1)];
            for (row, axis) in axes.iter().enumerate() {
                let component = frame.enu_from_ecef.row(row).dot(&axis.transpose());
                assert!(component > 1.0 - 1e-9, "{lat_deg} {lon_deg} axis {row}: {component}");
            }
        }
    }

    #[test]
    fn a_place_on_the_ground_lies_under_its_point_of_the_plane() {
        let frame = EnuFrame::new(position(40.8, 111.7, 6_000.0));
        let place = frame.on_surface(14_000.0, -9_000.0, 1_050.0).unwrap();
        let point = frame.to_enu(&place);
        assert!((place.height_m() - 1_050.0).abs() < 1e-9);
        assert!((point.east_m - 14_000.0).abs() < MILLIMETRE, "{point:?}");
        assert!((point.north_m + 9_000.0).abs() < MILLIMETRE, "{point:?}");
        // Curvature: ground²/(2 R) below the plane.
        let sag_m = (14_000.0_f64.powi(2) + 9_000.0_f64.powi(2)) / (2.0 * 6.37e6);
        assert!((point.up_m + 4_950.0 + sag_m).abs() < 0.2, "{point:?} {sag_m}");
    }

    #[test]
    fn looks_are_clockwise_from_north_and_lead_back() {
        let frame = EnuFrame::new(position(40.8, 111.7, 6_000.0));
        let point = |east_m, north_m, up_m| frame.to_geo(&EnuPoint { east_m, north_m, up_m });
        for (azimuth_deg, east_m, north_m) in
            [(0.0, 0.0, 1e4), (90.0, 1e4, 0.0), (180.0, 0.0, -1e4), (270.0, -1e4, 0.0)]
        {
            let look = frame.look_at(&point(east_m, north_m, -5_000.0).unwrap());
            let off_deg = super::super::wrap_lon_deg(look.azimuth_deg - azimuth_deg);
            assert!(off_deg.abs() < 1e-7, "{look:?}");
            assert!((look.elevation_deg + 26.565_051_177).abs() < 1e-6, "{look:?}");
            assert!((look.slant_range_m - 11_180.339_887).abs() < MILLIMETRE, "{look:?}");
            let back = frame.to_enu(&frame.place_seen(&look).unwrap());
            let expected = Vector3::new(east_m, north_m, -5_000.0);
            assert!((back.vector_m() - expected).norm() < MILLIMETRE, "{back:?}");
        }
    }

    /// Moving a vector to another frame is moving its two ends.
    #[test]
    fn vectors_turn_as_their_ends_do_and_covariances_as_products_of_vectors() {
        let here = EnuFrame::new(position(40.8, 111.7, 1_000.0));
        let there = EnuFrame::new(position(41.3, 112.9, 30.0));
        let vector = Vector3::new(12.0, -7.0, 3.0);
        let start = EnuPoint { east_m: 90.0, north_m: 40.0, up_m: 5.0 };
        let end = EnuPoint::from(start.vector_m() + vector);
        let moved = |point: &EnuPoint| there.enu_of_ecef(&here.to_ecef(point)).vector_m();
        let expected = moved(&end) - moved(&start);
        let found = here.vector_into(&there, &vector);
        assert!((found - expected).norm() < 1e-6, "{found} {expected}");
        let covariance = here.covariance_into(&there, &(vector * vector.transpose()));
        assert!((covariance - expected * expected.transpose()).norm() < 1e-4);
    }

    /// What moves over the plane moves so over the ground below it.
    #[test]
    fn a_velocity_of_the_plane_is_that_of_the_place_on_the_ground() {
        let frame = EnuFrame::new(position(40.8, 111.7, 1_000.0));
        let (east_m, north_m, velocity) = (20_000.0, 5_000.0, nalgebra::Vector2::new(12.0, -7.0));
        let at = |time_s: f64| {
            let [east, north] = [east_m + velocity.x * time_s, north_m + velocity.y * time_s];
            frame.on_surface(east, north, 1_000.0).unwrap()
        };
        let there = EnuFrame::new(at(0.0));
        let (before, after) = (there.to_enu(&at(-1.0)), there.to_enu(&at(1.0)));
        let moved = 0.5 * (after.vector_m() - before.vector_m()).xy();
        let found = frame.horizontal_into(&there) * velocity;
        // 0.16 degrees of meridians that come together turn it by 37 mm/s; the tilt changes 0.1 mm/s.
        assert!((found - moved).norm() < 3e-4, "{found} {moved}");
        assert!((velocity - moved).norm() > 0.03, "{moved}");
    }

    #[test]
    fn frames_stand_on_the_antimeridian_and_on_the_poles() {
        let frame = EnuFrame::new(position(10.0, 179.999, 0.0));
        let across = frame.to_enu(&position(10.0, -179.999, 0.0));
        assert!((across.east_m - 219.28).abs() < 0.05 && across.north_m.abs() < 0.01, "{across:?}");
        for lat_deg in [90.0, -90.0] {
            let pole = EnuFrame::new(position(lat_deg, 0.0, 0.0));
            let near = pole.to_geo(&EnuPoint { east_m: 500.0, north_m: 200.0, up_m: 3.0 }).unwrap();
            let back = pole.to_enu(&near).vector_m();
            assert!((back - Vector3::new(500.0, 200.0, 3.0)).norm() < MILLIMETRE, "{back}");
        }
    }

    #[test]
    fn a_point_far_above_the_earth_is_no_place() {
        let frame = EnuFrame::new(position(40.8, 111.7, 0.0));
        let far = frame.to_geo(&EnuPoint { east_m: 0.0, north_m: 0.0, up_m: 1e6 });
        assert!(matches!(far, Err(GeodesyError::Height { .. })), "{far:?}");
        let low = EnuFrame::new(position(0.0, 111.7, 0.0));
        assert!(low.on_surface(3e6, 0.0, 0.0).is_ok());
        for (east_m, north_m) in [(0.0, 6.37e6), (1e8, 0.0), (f64::NAN, 0.0)] {
            let beside = low.on_surface(east_m, north_m, 0.0).unwrap_err();
            assert!(matches!(beside, GeodesyError::BesideEarth { .. }), "{beside}");
        }
    }
}
