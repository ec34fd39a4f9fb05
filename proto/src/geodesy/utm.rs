//! Universal Transverse Mercator: zones, coordinates both ways, grid convergence and scale.

use std::fmt;

use ::geodesy::authoring::{
    Context, Coor2D, CoordinateTuple, Fwd, Inv, Jacobian, Minimal, OpHandle,
};

use super::{GeoPosition, GeodesyError, ellipsoid, wrap_lon_deg};

/// South of it there is no UTM, degrees.
pub const SOUTHERN_END_DEG: f64 = -80.0;
/// North of it there is no UTM, degrees.
pub const NORTHERN_END_DEG: f64 = 84.0;
/// Farther off a zone's central meridian its grid is refused, degrees of longitude. A zone is
/// 3 degrees wide to either side (Svalbard's 6); the series is good to nanometres beyond 30.
const OFF_MERIDIAN_MAX_DEG: f64 = 30.0;

/// Northern grids count from the equator, southern ones from 10,000 km south of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Hemisphere {
    /// North, the equator included.
    North,
    /// South.
    South,
}

/// A zone of the grid in one hemisphere; written `49N`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct UtmZone {
    number: u8,
    hemisphere: Hemisphere,
}

impl UtmZone {
    /// Zone 1 to 60.
    ///
    /// # Errors
    /// If there is no such zone.
    pub fn new(number: u8, hemisphere: Hemisphere) -> Result<Self, GeodesyError> {
        if !(1..=60).contains(&number) {
            return Err(GeodesyError::Zone { number });
        }
        Ok(Self { number, hemisphere })
    }

    /// The zone a place belongs to, with the exceptions of Norway (32V reaches to 3 degrees east)
    /// and Svalbard (31X, 33X, 35X and 37X only) \[nga-utm\].
    ///
    /// # Errors
    /// South of 80 degrees south and north of 84 degrees north.
    pub fn of(place: &GeoPosition) -> Result<Self, GeodesyError> {
        let (lat_deg, lon_deg) = (place.lat_deg(), place.lon_deg());
        if !(SOUTHERN_END_DEG..=NORTHERN_END_DEG).contains(&lat_deg) {
            return Err(GeodesyError::OutsideUtm { lat_deg });
        }
        let hemisphere = if lat_deg < 0.0 { Hemisphere::South } else { Hemisphere::North };
        Self::new(number_at(lat_deg, lon_deg), hemisphere)
    }

    /// 1 to 60.
    #[must_use]
    pub fn number(&self) -> u8 {
        self.number
    }

    /// Which grid.
    #[must_use]
    pub fn hemisphere(&self) -> Hemisphere {
        self.hemisphere
    }

    /// The longitude where grid north is true north, degrees.
    #[must_use]
    pub fn central_meridian_deg(&self) -> f64 {
        6.0 * f64::from(self.number) - 183.0
    }
}

impl fmt::Display for UtmZone {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let letter = match self.hemisphere {
            Hemisphere::North => 'N',
            Hemisphere::South => 'S',
        };
        write!(out, "{}{letter}", self.number)
    }
}

fn number_at(lat_deg: f64, lon_deg: f64) -> u8 {
    let norway = (56.0..64.0).contains(&lat_deg) && (3.0..12.0).contains(&lon_deg);
    let svalbard = lat_deg >= 72.0 && (0.0..42.0).contains(&lon_deg);
    if norway {
        return 32;
    }
    if svalbard {
        let borders_deg = [(33.0, 37), (21.0, 35), (9.0, 33)];
        let passed = borders_deg.into_iter().find(|(border_deg, _)| lon_deg >= *border_deg);
        return passed.map_or(31, |(_, number)| number);
    }
    (1..60_u8).find(|number| lon_deg < 6.0 * f64::from(*number) - 180.0).unwrap_or(60)
}

/// Coordinates in the grid of a zone. The height is not part of the grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UtmPosition {
    /// Whose grid.
    pub zone: UtmZone,
    /// 500,000 on the central meridian, metres.
    pub easting_m: f64,
    /// From the equator; in the south plus 10,000,000, metres.
    pub northing_m: f64,
}

/// How the grid lies on the ground at a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridFactors {
    /// The true azimuth of grid north, clockwise, degrees: true azimuth = grid azimuth + this.
    pub convergence_deg: f64,
    /// A short distance in the grid by the same distance on the ellipsoid.
    pub scale: f64,
}

/// The grid of one zone, made once and used for many places.
#[derive(Debug)]
pub struct UtmGrid {
    zone: UtmZone,
    context: Minimal,
    operation: OpHandle,
}

impl UtmGrid {
    /// The grid of a zone.
    ///
    /// # Errors
    /// If the library refuses it.
    pub fn new(zone: UtmZone) -> Result<Self, GeodesyError> {
        let mut context = Minimal::new();
        let south = match zone.hemisphere {
            Hemisphere::North => "",
            Hemisphere::South => " south",
        };
        let operation = context.op(&format!("utm zone={}{south} ellps=WGS84", zone.number))?;
        Ok(Self { zone, context, operation })
    }

    /// The grid of the zone a place belongs to.
    ///
    /// # Errors
    /// If it belongs to none.
    pub fn at(place: &GeoPosition) -> Result<Self, GeodesyError> {
        Self::new(UtmZone::of(place)?)
    }

    /// Whose grid it is.
    #[must_use]
    pub fn zone(&self) -> UtmZone {
        self.zone
    }

    /// A place in this grid; it may lie in a neighbouring zone.
    ///
    /// # Errors
    /// If it is outside UTM's latitudes or far from this zone.
    pub fn to_utm(&self, place: &GeoPosition) -> Result<UtmPosition, GeodesyError> {
        self.check(place)?;
        let mut coordinates = [radians_of(place)];
        self.context.apply(self.operation, Fwd, &mut coordinates)?;
        let (easting_m, northing_m) = coordinates[0].xy();
        Ok(UtmPosition { zone: self.zone, easting_m, northing_m })
    }

    /// The place of grid coordinates, at a height above the ellipsoid; all in metres.
    ///
    /// # Errors
    /// If there is none near this zone.
    pub fn to_geo(
        &self,
        easting_m: f64,
        northing_m: f64,
        height_m: f64,
    ) -> Result<GeoPosition, GeodesyError> {
        let mut coordinates = [Coor2D::raw(easting_m, northing_m)];
        self.context.apply(self.operation, Inv, &mut coordinates)?;
        let (lon_rad, lat_rad) = coordinates[0].xy();
        let nowhere = || GeodesyError::Grid { easting_m, northing_m, zone: self.zone };
        if !lat_rad.is_finite() || !lon_rad.is_finite() {
            return Err(nowhere());
        }
        let place = GeoPosition::new(lat_rad.to_degrees(), lon_rad.to_degrees(), height_m)?;
        // Rounding may lift a place on UTM's border over it, hence a margin of a centimetre.
        let margin_deg = 1e-7;
        let lats_deg = SOUTHERN_END_DEG - margin_deg..=NORTHERN_END_DEG + margin_deg;
        let near = self.off_meridian_deg(&place).abs() <= OFF_MERIDIAN_MAX_DEG;
        if near && lats_deg.contains(&place.lat_deg()) { Ok(place) } else { Err(nowhere()) }
    }

    /// Convergence and scale at a place.
    ///
    /// # Errors
    /// If it is outside UTM's latitudes or far from this zone.
    pub fn factors(&self, place: &GeoPosition) -> Result<GridFactors, GeodesyError> {
        self.check(place)?;
        let jacobian = Jacobian::new(
            &self.context,
            self.operation,
            [1_f64.to_degrees(), 1.0],
            [false, false],
            ellipsoid(),
            radians_of(place),
        )?;
        let factors = jacobian.factors();
        Ok(GridFactors {
            convergence_deg: factors.meridian_convergence,
            scale: factors.meridional_scale,
        })
    }

    fn check(&self, place: &GeoPosition) -> Result<(), GeodesyError> {
        let lat_deg = place.lat_deg();
        if !(SOUTHERN_END_DEG..=NORTHERN_END_DEG).contains(&lat_deg) {
            return Err(GeodesyError::OutsideUtm { lat_deg });
        }
        let off_deg = self.off_meridian_deg(place);
        if off_deg.abs() > OFF_MERIDIAN_MAX_DEG {
            return Err(GeodesyError::FarFromMeridian { off_deg, zone: self.zone });
        }
        Ok(())
    }

    fn off_meridian_deg(&self, place: &GeoPosition) -> f64 {
        wrap_lon_deg(place.lon_deg() - self.zone.central_meridian_deg())
    }
}

fn radians_of(place: &GeoPosition) -> Coor2D {
    Coor2D::raw(place.lon_deg().to_radians(), place.lat_deg().to_radians())
}

#[cfg(test)]
mod tests;
