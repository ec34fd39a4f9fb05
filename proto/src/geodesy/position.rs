//! Geodetic and geocentric positions, and the way between them.

use ::geodesy::prelude::{Coor3D, CoordinateTuple, GeoCart};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use super::{GeodesyError, ellipsoid};

/// Heights outside are taken for a wrong unit, metres.
const HEIGHTS_M: std::ops::RangeInclusive<f64> = -20_000.0..=100_000.0;

/// A place by latitude, longitude and height above the ellipsoid of WGS 84.
///
/// Always valid: the latitude within ±90 degrees, the longitude in [−180, 180).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Written", into = "Written")]
pub struct GeoPosition {
    lat_deg: f64,
    lon_deg: f64,
    height_m: f64,
}

impl GeoPosition {
    /// A place from degrees (longitudes from −360 to 360 are brought into [−180, 180)) and metres.
    ///
    /// # Errors
    /// If a number is outside its range or not a number.
    pub fn new(lat_deg: f64, lon_deg: f64, height_m: f64) -> Result<Self, GeodesyError> {
        if !(-90.0..=90.0).contains(&lat_deg) {
            return Err(GeodesyError::Latitude { lat_deg });
        }
        if !(-360.0..=360.0).contains(&lon_deg) {
            return Err(GeodesyError::Longitude { lon_deg });
        }
        if !HEIGHTS_M.contains(&height_m) {
            return Err(GeodesyError::Height { height_m });
        }
        Ok(Self { lat_deg, lon_deg: wrap_lon_deg(lon_deg), height_m })
    }

    /// North positive, degrees.
    #[must_use]
    pub fn lat_deg(&self) -> f64 {
        self.lat_deg
    }

    /// East positive, in [−180, 180), degrees.
    #[must_use]
    pub fn lon_deg(&self) -> f64 {
        self.lon_deg
    }

    /// Above the ellipsoid, metres.
    #[must_use]
    pub fn height_m(&self) -> f64 {
        self.height_m
    }

    /// The same place at another height above the ellipsoid, metres.
    ///
    /// # Errors
    /// If the height is outside its range.
    pub fn at_height(&self, height_m: f64) -> Result<Self, GeodesyError> {
        Self::new(self.lat_deg, self.lon_deg, height_m)
    }

    /// The same place in geocentric coordinates.
    #[must_use]
    pub fn to_ecef(&self) -> EcefPosition {
        let (lat_rad, lon_rad) = (self.lat_deg.to_radians(), self.lon_deg.to_radians());
        let cartesian = ellipsoid().cartesian(&Coor3D::raw(lon_rad, lat_rad, self.height_m));
        EcefPosition(Vector3::new(cartesian.x(), cartesian.y(), cartesian.z()))
    }
}

/// A place by geocentric coordinates of WGS 84, metres: x towards latitude 0 longitude 0, z along
/// the axis to the north.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EcefPosition(pub Vector3<f64>);

impl EcefPosition {
    /// The same place by latitude, longitude and height.
    ///
    /// # Errors
    /// If it is not near the surface.
    pub fn to_geo(&self) -> Result<GeoPosition, GeodesyError> {
        let found = ellipsoid().geographic(&Coor3D::raw(self.0.x, self.0.y, self.0.z));
        GeoPosition::new(found.y().to_degrees(), found.x().to_degrees(), found.z())
    }

    /// Above the ellipsoid, metres; of any place, near the surface or not.
    pub(super) fn height_m(&self) -> f64 {
        ellipsoid().geographic(&Coor3D::raw(self.0.x, self.0.y, self.0.z)).z()
    }

    /// The straight line to another place, metres.
    #[must_use]
    pub fn distance_m(&self, other: &Self) -> f64 {
        (self.0 - other.0).norm()
    }
}

/// A longitude of any number of turns in [−180, 180), degrees.
#[must_use]
pub fn wrap_lon_deg(lon_deg: f64) -> f64 {
    if (-180.0..180.0).contains(&lon_deg) {
        return lon_deg;
    }
    let wrapped = (lon_deg + 180.0).rem_euclid(360.0) - 180.0;
    // The remainder of a tiny negative number rounds up to a whole turn.
    if wrapped < 180.0 { wrapped } else { -180.0 }
}

/// How a position is written in configuration files and messages.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    lat_deg: f64,
    lon_deg: f64,
    #[serde(default)]
    height_m: f64,
}

impl TryFrom<Written> for GeoPosition {
    type Error = GeodesyError;

    fn try_from(written: Written) -> Result<Self, GeodesyError> {
        Self::new(written.lat_deg, written.lon_deg, written.height_m)
    }
}

impl From<GeoPosition> for Written {
    fn from(position: GeoPosition) -> Self {
        let GeoPosition { lat_deg, lon_deg, height_m } = position;
        Self { lat_deg, lon_deg, height_m }
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

    /// The worked example of EPSG method 9602 \[iogp-7-2\].
    #[test]
    fn the_published_example_is_met_both_ways() {
        let lat_deg = 53.0 + 48.0 / 60.0 + 33.82 / 3600.0;
        let lon_deg = 2.0 + 7.0 / 60.0 + 46.38 / 3600.0;
        let geo = position(lat_deg, lon_deg, 73.0);
        let published = EcefPosition(Vector3::new(3_771_793.968, 140_253.342, 5_124_304.349));
        assert!(geo.to_ecef().distance_m(&published) < MILLIMETRE);
        let back = published.to_geo().unwrap();
        assert!(back.to_ecef().distance_m(&geo.to_ecef()) < MILLIMETRE);
        assert!((back.height_m() - 73.0).abs() < MILLIMETRE);
    }

    /// Heun's fixed point: the latitude is where the normal through the place meets it.
    fn slow_geo(ecef: &Vector3<f64>) -> (f64, f64, f64) {
        let e2 = super::super::FLATTENING * (2.0 - super::super::FLATTENING);
        let axis_m = ecef.x.hypot(ecef.y);
        let mut lat = ecef.z.atan2(axis_m * (1.0 - e2));
        let normal_m =
            |at: f64| super::super::SEMI_MAJOR_AXIS_M / (1.0 - e2 * at.sin().powi(2)).sqrt();
        for _ in 0..200 {
            lat = (ecef.z + e2 * normal_m(lat) * lat.sin()).atan2(axis_m);
        }
        let a_m = super::super::SEMI_MAJOR_AXIS_M;
        let height_m =
            axis_m * lat.cos() + ecef.z * lat.sin() - a_m * (1.0 - e2 * lat.sin().powi(2)).sqrt();
        (lat.to_degrees(), ecef.y.atan2(ecef.x).to_degrees(), height_m)
    }

    #[test]
    fn every_place_up_to_a_hundred_kilometres_agrees_with_the_slow_solution() {
        for lat_deg in (-90..=90).step_by(5) {
            for lon_deg in [-180.0, -90.0, -0.1, 0.0, 37.0, 111.7, 179.999_999] {
                agree_at([-400.0, 0.0, 1_050.0, 12_000.0, 99_999.0], f64::from(lat_deg), lon_deg);
            }
        }
    }

    fn agree_at(heights_m: [f64; 5], lat_deg: f64, lon_deg: f64) {
        for height_m in heights_m {
            agrees(&position(lat_deg, lon_deg, height_m));
        }
    }

    /// An oracle of the way from ECEF, and by it a check of the way there.
    fn agrees(geo: &GeoPosition) {
        let ecef = geo.to_ecef();
        let (slow_lat_deg, slow_lon_deg, slow_height_m) = slow_geo(&ecef.0);
        assert!((slow_lat_deg - geo.lat_deg()).abs() < 1e-9, "{geo:?}");
        let turn_deg = wrap_lon_deg(slow_lon_deg - geo.lon_deg());
        assert!(turn_deg.to_radians().abs() * ecef.0.xy().norm() < MILLIMETRE, "{geo:?}");
        assert!((slow_height_m - geo.height_m()).abs() < MILLIMETRE, "{geo:?}");
        let back = ecef.to_geo().unwrap();
        assert!((back.height_m() - geo.height_m()).abs() < MILLIMETRE, "{geo:?} {back:?}");
        assert!(back.to_ecef().distance_m(&ecef) < MILLIMETRE, "{geo:?} {back:?}");
    }

    #[test]
    fn longitudes_wrap_to_a_half_open_turn() {
        let cases = [(180.0, -180.0), (-180.0, -180.0), (360.0, 0.0), (291.5, -68.5), (7.0, 7.0)];
        for (given, wrapped) in cases {
            assert!((wrap_lon_deg(given) - wrapped).abs() < 1e-12, "{given}");
        }
        assert!(wrap_lon_deg(-180.0 - 1e-14) < 180.0);
        assert!((position(10.0, 190.0, 0.0).lon_deg() + 170.0).abs() < 1e-12);
    }

    #[test]
    fn what_is_no_place_is_refused() {
        let lat = GeoPosition::new(111.7, 40.8, 0.0).unwrap_err();
        assert!(matches!(lat, GeodesyError::Latitude { .. }), "{lat}");
        let lon = GeoPosition::new(40.8, f64::NAN, 0.0).unwrap_err();
        assert!(matches!(lon, GeodesyError::Longitude { .. }), "{lon}");
        let height = GeoPosition::new(40.8, 111.7, 600_000.0).unwrap_err();
        assert!(matches!(height, GeodesyError::Height { .. }), "{height}");
        assert!(EcefPosition(Vector3::new(1.0, 2.0, 3.0)).to_geo().is_err());
    }
}
