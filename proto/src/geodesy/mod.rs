//! Places on the earth: geodetic, geocentric, local and grid coordinates, all on WGS 84.
//!
//! The ellipsoid's and the projection's formulas are those of the `geodesy` library; this module
//! gives them types, checks and names. Latitudes and longitudes are in degrees as every format
//! outside writes them, heights are above the ellipsoid (not above sea level), azimuths and
//! courses run clockwise from true north.
//!
//! Track in an [`EnuFrame`]; use [`utm`] only where somebody asks for grid coordinates. A heading
//! is measured from true north and the grid's north is off by the [convergence](GridFactors): at
//! Hohhot 0.46 degrees, which is 160 m at 20 km \[wide-area, geodesy\].

mod enu;
mod position;
pub mod utm;

pub use enu::{EnuFrame, EnuPoint, Look};
pub use position::{EcefPosition, GeoPosition, wrap_lon_deg};
pub use utm::{GridFactors, Hemisphere, UtmGrid, UtmPosition, UtmZone};

use ::geodesy::prelude::Ellipsoid;

/// Semi-major axis of WGS 84, metres.
pub const SEMI_MAJOR_AXIS_M: f64 = 6_378_137.0;
/// Flattening of WGS 84.
pub const FLATTENING: f64 = 1.0 / 298.257_223_563;

/// A place, a zone or grid coordinates that do not exist, or that a formula is not good for.
#[derive(Debug, thiserror::Error)]
pub enum GeodesyError {
    /// Beyond a pole, or not a number.
    #[error("latitude {lat_deg} degrees is outside -90 to 90; are latitude and longitude swapped?")]
    Latitude {
        /// As given, degrees.
        lat_deg: f64,
    },
    /// More than one turn, or not a number.
    #[error("longitude {lon_deg} degrees is outside -360 to 360")]
    Longitude {
        /// As given, degrees.
        lon_deg: f64,
    },
    /// Below the sea's floor, above the atmosphere, or not a number.
    #[error(
        "height {height_m} m above the ellipsoid is outside -20 km to 100 km; is it in metres?"
    )]
    Height {
        /// As given, metres.
        height_m: f64,
    },
    /// Neither above nor below the point is there a place of that height.
    #[error(
        "no place {height_m} m high lies above or below {east_m} m east, {north_m} m north of the \
         frame; take a frame that stands nearer"
    )]
    BesideEarth {
        /// In the frame's plane, metres.
        east_m: f64,
        /// In the frame's plane, metres.
        north_m: f64,
        /// Above the ellipsoid, metres.
        height_m: f64,
    },
    /// No such zone.
    #[error("UTM zone {number} does not exist; zones are 1 to 60")]
    Zone {
        /// As given.
        number: u8,
    },
    /// UTM ends at 80 degrees south and at 84 degrees north.
    #[error(
        "latitude {lat_deg} degrees has no UTM zone; use latitude and longitude, or a local frame"
    )]
    OutsideUtm {
        /// Degrees.
        lat_deg: f64,
    },
    /// So far from the zone's central meridian that the grid means nothing.
    #[error(
        "{off_deg} degrees of longitude off the central meridian of zone {zone}; take a nearer zone"
    )]
    FarFromMeridian {
        /// Degrees, east positive.
        off_deg: f64,
        /// Whose grid was asked for.
        zone: UtmZone,
    },
    /// No place has these grid coordinates.
    #[error("easting {easting_m} m, northing {northing_m} m is no place of zone {zone}")]
    Grid {
        /// Metres.
        easting_m: f64,
        /// Metres.
        northing_m: f64,
        /// Whose grid.
        zone: UtmZone,
    },
    /// What the library says.
    #[error("the geodesy library refuses: {0}")]
    Library(#[from] ::geodesy::Error),
}

/// WGS 84.
fn ellipsoid() -> Ellipsoid {
    Ellipsoid::new(SEMI_MAJOR_AXIS_M, FLATTENING)
}
