//! Zones by their rules, the projection against published values and against its definition.

use nalgebra::Complex;

use super::*;
use crate::geodesy::{FLATTENING, SEMI_MAJOR_AXIS_M};

/// What issue and specification ask for, metres.
const MILLIMETRE: f64 = 1e-3;

fn position(lat_deg: f64, lon_deg: f64) -> GeoPosition {
    GeoPosition::new(lat_deg, lon_deg, 0.0).unwrap()
}

fn grid(number: u8, hemisphere: Hemisphere) -> UtmGrid {
    UtmGrid::new(UtmZone::new(number, hemisphere).unwrap()).unwrap()
}

fn number_of(lat_deg: f64, lon_deg: f64) -> u8 {
    UtmZone::of(&position(lat_deg, lon_deg)).unwrap().number()
}

/// Latitude, longitude, zone, hemisphere, easting, northing, as GeoConvert of GeographicLib 2.5.2
/// gives them \[geographiclib\]; the last two ask for the zone next door.
const PUBLISHED: &[(f64, f64, u8, Hemisphere, f64, f64)] = &[
    (33.3, 44.4, 38, Hemisphere::North, 444_140.544_918, 3_684_706.355_550),
    (-33.87, 151.21, 56, Hemisphere::South, 334_435.706_142, 6_250_816.397_805),
    (40.748_433, -73.985_656, 18, Hemisphere::North, 585_632.081_342, 4_511_326.153_664),
    (51.5, -0.12, 30, Hemisphere::North, 699_889.806_985, 5_709_362.292_819),
    (0.0, 0.0, 31, Hemisphere::North, 166_021.443_081, 0.0),
    (60.0, 5.0, 32, Hemisphere::North, 276_979.926_401, 6_658_157.202_407),
    (63.9, 2.9, 31, Hemisphere::North, 495_091.311_823, 7_085_874.811_547),
    (78.0, 8.9, 31, Hemisphere::North, 636_716.845_989, 8_665_261.549_758),
    (78.0, 9.0, 33, Hemisphere::North, 360_973.603_635, 8_665_496.995_777),
    (78.0, 20.9, 33, Hemisphere::North, 636_716.845_989, 8_665_261.549_758),
    (78.0, 21.0, 35, Hemisphere::North, 360_973.603_635, 8_665_496.995_777),
    (78.0, 41.9, 37, Hemisphere::North, 567_282.208_955, 8_660_035.492_844),
    (83.9, -179.9, 1, Hemisphere::North, 465_609.168_730, 9_317_795.753_332),
    (-79.9, 123.0, 51, Hemisphere::South, 500_000.0, 1_129_575.677_877),
    (-80.0, 10.0, 32, Hemisphere::South, 519_384.803_296, 1_118_247.585_193),
    (45.0, 3.0, 31, Hemisphere::North, 500_000.0, 4_982_950.400_227),
    (-45.0, -177.0, 1, Hemisphere::South, 500_000.0, 5_017_049.599_773),
    (10.0, 179.999_999_9, 60, Hemisphere::North, 828_928.725_085, 1_106_908.854_143),
    (-1e-6, 177.0, 60, Hemisphere::South, 500_000.0, 9_999_999.889_470),
    (45.0, 8.0, 31, Hemisphere::North, 894_076.745_034, 4_995_124.532_466),
    (40.0, -2.0, 31, Hemisphere::North, 73_106.697_733, 4_439_746.917_134),
];

#[test]
fn published_places_are_met_to_a_millimetre_both_ways() {
    for &(lat_deg, lon_deg, number, hemisphere, easting_m, northing_m) in PUBLISHED {
        let (place, grid) = (position(lat_deg, lon_deg), grid(number, hemisphere));
        let found = grid.to_utm(&place).unwrap();
        assert!((found.easting_m - easting_m).abs() < MILLIMETRE, "{place:?} {found:?}");
        assert!((found.northing_m - northing_m).abs() < MILLIMETRE, "{place:?} {found:?}");
        let back = grid.to_geo(easting_m, northing_m, 0.0).unwrap();
        let off_m = back.to_ecef().distance_m(&place.to_ecef());
        assert!(off_m < MILLIMETRE, "{place:?} {back:?}");
    }
    for &(lat_deg, lon_deg, number, hemisphere, ..) in &PUBLISHED[..PUBLISHED.len() - 2] {
        let zone = UtmZone::of(&position(lat_deg, lon_deg)).unwrap();
        assert_eq!((zone.number(), zone.hemisphere()), (number, hemisphere), "{zone}");
    }
}

/// The projection by its definition: conformal, and with constant scale along the central
/// meridian. Conformal maps of the isometric plane `q + iλ` are its analytic functions, so that
/// northing + i easting = k0 m(χ) with m the meridian's arc and χ the complex latitude whose
/// isometric latitude is `q + iλ`; χ by Newton's method, m by Gauss' quadrature along a straight
/// line. Returns easting and northing in metres, convergence in degrees and scale.
fn by_definition(lat_deg: f64, off_deg: f64) -> (f64, f64, f64, f64) {
    let e2 = FLATTENING * (2.0 - FLATTENING);
    let e = e2.sqrt();
    let one = Complex::new(1.0, 0.0);
    let isometric = |lat: Complex<f64>| lat.sin().atanh() - (lat.sin() * e).atanh() * e;
    let lat = Complex::new(lat_deg.to_radians(), 0.0);
    let wanted = isometric(lat) + Complex::new(0.0, off_deg.to_radians());
    let mut chi = lat;
    for _ in 0..50 {
        let slope = (one - chi.sin().powu(2) * e2) * chi.cos() / (1.0 - e2);
        chi -= (isometric(chi) - wanted) * slope;
    }
    let arc_slope = |t: Complex<f64>| {
        let w = one - t.sin().powu(2) * e2;
        (w * w * w).sqrt().inv() * (SEMI_MAJOR_AXIS_M * (1.0 - e2))
    };
    // Composite rule of Gauss with three nodes.
    let piece_count = 4_000;
    let (node, outer, inner) = (0.6_f64.sqrt(), 5.0 / 18.0, 8.0 / 18.0);
    let mut arc = Complex::new(0.0, 0.0);
    for piece in 0..piece_count {
        let at = |x: f64| chi * ((f64::from(piece) + 0.5 + 0.5 * x) / f64::from(piece_count));
        let sum = arc_slope(at(-node)) * outer + arc_slope(at(0.0)) * inner;
        arc += (sum + arc_slope(at(node)) * outer) * chi / f64::from(piece_count);
    }
    let turned = chi.cos() * SEMI_MAJOR_AXIS_M / (one - chi.sin().powu(2) * e2).sqrt();
    let parallel_m = (lat.cos() * SEMI_MAJOR_AXIS_M / (one - lat.sin().powu(2) * e2).sqrt()).re;
    let k0 = 0.9996;
    let scale = k0 * turned.norm() / parallel_m;
    (5e5 + k0 * arc.im, k0 * arc.re, -turned.arg().to_degrees(), scale)
}

#[test]
fn coordinates_convergence_and_scale_follow_from_the_definition() {
    let (grid, meridian_deg) = (grid(49, Hemisphere::North), 111.0);
    for lat_deg in [0.5, 10.0, 25.0, 40.8, 56.0, 72.0, 80.0, 84.0] {
        for off_deg in [-12.0, -6.0, -3.0, -1.0, 0.0, 0.7, 3.0, 4.5] {
            let place = position(lat_deg, meridian_deg + off_deg);
            let (easting_m, northing_m, convergence_deg, scale) = by_definition(lat_deg, off_deg);
            let found = grid.to_utm(&place).unwrap();
            assert!((found.easting_m - easting_m).abs() < MILLIMETRE, "{place:?} {found:?}");
            assert!((found.northing_m - northing_m).abs() < MILLIMETRE, "{place:?} {found:?}");
            let factors = grid.factors(&place).unwrap();
            // Differences over 64 m: 1e-7 degrees turn 20 km by 0.03 mm.
            let off = (factors.convergence_deg - convergence_deg).abs();
            assert!(off < 1e-7, "{place:?} {factors:?} {convergence_deg}");
            assert!((factors.scale - scale).abs() < 1e-9, "{place:?} {factors:?} {scale}");
        }
    }
}

#[test]
fn the_definition_agrees_with_published_places() {
    for &(lat_deg, lon_deg, number, hemisphere, easting_m, northing_m) in PUBLISHED {
        if hemisphere == Hemisphere::South {
            continue;
        }
        let meridian_deg = UtmZone::new(number, hemisphere).unwrap().central_meridian_deg();
        let found = by_definition(lat_deg, wrap_lon_deg(lon_deg - meridian_deg));
        assert!((found.0 - easting_m).abs() < 1e-4, "{lat_deg} {lon_deg}: {found:?}");
        assert!((found.1 - northing_m).abs() < 1e-4, "{lat_deg} {lon_deg}: {found:?}");
    }
}

/// Of PROJ 9.5.1: `pyproj.Proj(proj="utm", zone=49, ellps="WGS84").get_factors(lon, lat)`.
#[test]
fn convergence_and_scale_are_those_of_another_program() {
    let grid = grid(49, Hemisphere::North);
    for (lat_deg, off_deg, convergence_deg, scale) in [
        (40.8, 0.7, 0.457_407_615, 0.999_642_915_43),
        (84.0, 3.0, 2.983_595_467, 0.999_614_959_11),
        (80.0, -6.0, -5.909_496_910, 0.999_764_740_15),
        (56.0, -12.0, -9.994_192_488, 1.006_438_731_20),
    ] {
        let factors = grid.factors(&position(lat_deg, 111.0 + off_deg)).unwrap();
        assert!((factors.convergence_deg - convergence_deg).abs() < 1e-7, "{factors:?}");
        assert!((factors.scale - scale).abs() < 1e-9, "{factors:?}");
    }
}

/// The specification's figure: 0.46 degrees at Hohhot, 160 m at 20 km \[wide-area, geodesy\].
#[test]
fn convergence_at_hohhot_moves_a_target_by_160_m_at_20_km() {
    let hohhot = position(40.8, 111.7);
    let grid = UtmGrid::at(&hohhot).unwrap();
    assert_eq!(grid.zone().to_string(), "49N");
    let convergence_deg = grid.factors(&hohhot).unwrap().convergence_deg;
    assert!((convergence_deg - 0.457_408).abs() < 1e-6, "{convergence_deg}");
    let moved_m = 20_000.0 * convergence_deg.to_radians();
    assert!((moved_m - 160.0).abs() < 1.0, "{moved_m}");
    // The same from two points of the grid: going true north, easting falls by this much.
    let north = crate::geodesy::EnuFrame::new(hohhot).on_surface(0.0, 20_000.0, 0.0).unwrap();
    let (start, end) = (grid.to_utm(&hohhot).unwrap(), grid.to_utm(&north).unwrap());
    assert!((start.easting_m - end.easting_m - moved_m).abs() < 1.0, "{start:?} {end:?}");
}

#[test]
fn whole_zones_lead_back_to_a_millimetre_up_to_their_edges_and_ends() {
    for number in 1..=60_u8 {
        leads_back(&grid(number, Hemisphere::North), [0.0, 1e-9, 12.3, 45.0, 60.0, 84.0]);
        leads_back(&grid(number, Hemisphere::South), [-1e-9, -12.3, -45.0, -60.0, -79.9, -80.0]);
    }
}

fn leads_back(grid: &UtmGrid, lats_deg: [f64; 6]) {
    for lat_deg in lats_deg {
        for off_deg in [-3.0, -1.5, 0.0, 2.999_999, 3.0] {
            let place = position(lat_deg, grid.zone().central_meridian_deg() + off_deg);
            let utm = grid.to_utm(&place).unwrap();
            let back = grid.to_geo(utm.easting_m, utm.northing_m, 0.0).unwrap();
            assert!(back.to_ecef().distance_m(&place.to_ecef()) < MILLIMETRE, "{place:?} {back:?}");
        }
    }
}

#[test]
fn zones_follow_the_rules_of_norway_and_svalbard() {
    let cases = [
        (40.8, 111.7, 49),
        (40.8, 108.0, 49),
        (40.8, 113.999_999, 49),
        (40.8, 114.0, 50),
        (0.0, -180.0, 1),
        (0.0, 179.999_999, 60),
        (0.0, 180.0, 1),
        (55.999_999, 4.0, 31),
        (56.0, 2.999_999, 31),
        (56.0, 3.0, 32),
        (63.999_999, 11.9, 32),
        (64.0, 3.0, 31),
        (60.0, 12.0, 33),
        (71.999_999, 8.0, 32),
        (72.0, -0.1, 30),
        (72.0, 8.999_999, 31),
        (72.0, 9.0, 33),
        (80.0, 20.999_999, 33),
        (80.0, 21.0, 35),
        (84.0, 32.999_999, 35),
        (84.0, 33.0, 37),
        (84.0, 41.999_999, 37),
        (84.0, 42.0, 38),
    ];
    for (lat_deg, lon_deg, number) in cases {
        assert_eq!(number_of(lat_deg, lon_deg), number, "{lat_deg} {lon_deg}");
    }
    let zone = UtmZone::of(&position(-1e-9, 111.7)).unwrap();
    assert_eq!(zone.to_string(), "49S");
    assert_eq!(UtmZone::of(&position(0.0, 111.7)).unwrap().hemisphere(), Hemisphere::North);
}

#[test]
fn what_the_grid_is_not_good_for_is_refused() {
    let pole = UtmZone::of(&position(84.000_001, 0.0)).unwrap_err();
    assert!(matches!(pole, GeodesyError::OutsideUtm { .. }), "{pole}");
    let zone = UtmZone::new(61, Hemisphere::North).unwrap_err();
    assert!(matches!(zone, GeodesyError::Zone { number: 61 }), "{zone}");
    assert!(UtmZone::new(0, Hemisphere::South).is_err());
    let grid = grid(49, Hemisphere::North);
    let far = grid.to_utm(&position(40.0, -69.0)).unwrap_err();
    assert!(matches!(far, GeodesyError::FarFromMeridian { .. }), "{far}");
    let south = grid.to_utm(&position(-85.0, 111.0)).unwrap_err();
    assert!(matches!(south, GeodesyError::OutsideUtm { .. }), "{south}");
    let places = [(5e5, 1.2e7), (5e5, -9.9e6), (f64::NAN, 0.0), (1e9, 0.0), (6e6, 4e6)];
    for (easting_m, northing_m) in places {
        let nowhere = grid.to_geo(easting_m, northing_m, 0.0).unwrap_err();
        assert!(matches!(nowhere, GeodesyError::Grid { .. }), "{easting_m}: {nowhere}");
    }
    let library = UtmGrid { zone: grid.zone(), context: Minimal::new(), operation: grid.operation };
    let unknown = library.to_utm(&position(40.0, 111.0)).unwrap_err();
    assert!(matches!(unknown, GeodesyError::Library(_)), "{unknown}");
}

#[test]
fn a_grid_can_be_shared_between_threads() {
    fn needs_both<T: Send + Sync>(_: &T) {}
    needs_both(&grid(49, Hemisphere::North));
}
