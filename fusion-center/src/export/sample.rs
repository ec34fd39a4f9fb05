//! Tracks for the tests of the formats: the golden files show these.

use nalgebra::{Matrix2, Vector2};
use proto::geodesy::{EnuFrame, GeoPosition};

use super::{GeoFix, GeoTrack, TrackStatus};

/// 2026-11-22T12:00:00Z.
pub(super) const NOON_UNIX_S: f64 = 1_795_348_800.0;
/// Time between looks of the sample, seconds.
pub(super) const REVISIT_S: f64 = 4.0;

pub(super) fn position(lat_deg: f64, lon_deg: f64, height_m: f64) -> GeoPosition {
    GeoPosition::new(lat_deg, lon_deg, height_m).unwrap()
}

/// Where the sample's map stands: Hohhot.
pub(super) fn frame() -> EnuFrame {
    EnuFrame::new(position(40.8, 111.7, 1_050.0))
}

/// A track that moved straight for eleven looks from a place in the sample's frame, metres and
/// metres per second.
pub(super) fn straight(id: u64, start_m: [f64; 2], velocity_m_per_s: [f64; 2]) -> GeoTrack {
    let at = |look: f64| {
        let east_m = start_m[0] + velocity_m_per_s[0] * REVISIT_S * look;
        let north_m = start_m[1] + velocity_m_per_s[1] * REVISIT_S * look;
        frame().on_surface(east_m, north_m, 1_050.0).unwrap()
    };
    let time_unix_s = NOON_UNIX_S + 10.0 * REVISIT_S;
    let fix = |look: u32| GeoFix {
        time_unix_s: NOON_UNIX_S + f64::from(look) * REVISIT_S,
        position: at(f64::from(look)),
    };
    GeoTrack {
        id,
        name: GeoTrack::name_of("transmural", "20261122T1200", id),
        status: TrackStatus::Confirmed,
        time_unix_s,
        position: at(10.0),
        velocity_m_per_s: velocity_m_per_s.into(),
        covariance_m2: Matrix2::new(900.0, 420.0, 420.0, 400.0),
        velocity_covariance_m2_per_s2: Some(Matrix2::new(4.0, 0.5, 0.5, 2.25)),
        height_sigma_m: Some(15.0),
        first_seen_unix_s: NOON_UNIX_S,
        last_seen_unix_s: time_unix_s,
        sensors: vec!["gmti-1".to_owned()],
        report: Some(4_711),
        history: (0..10).map(fix).collect(),
    }
}

pub(super) fn confirmed() -> GeoTrack {
    straight(7, [2_000.0, -1_500.0], [10.0, 7.5])
}

/// One of each status; the last one crosses the antimeridian and has a name that needs care.
pub(super) fn all() -> Vec<GeoTrack> {
    let tentative = GeoTrack {
        status: TrackStatus::Tentative,
        history: Vec::new(),
        velocity_covariance_m2_per_s2: None,
        height_sigma_m: None,
        report: None,
        ..straight(8, [-3_000.0, 800.0], [-12.0, 3.0])
    };
    let coasting = GeoTrack {
        status: TrackStatus::Coasting,
        last_seen_unix_s: NOON_UNIX_S + 30.0,
        sensors: vec!["gmti-1".to_owned(), "gmti-2".to_owned()],
        ..straight(9, [-1_000.0, 2_500.0], [4.0, -14.0])
    };
    vec![confirmed(), tentative, coasting, across_the_antimeridian()]
}

pub(super) fn across_the_antimeridian() -> GeoTrack {
    let fix = |look: u32| GeoFix {
        time_unix_s: NOON_UNIX_S + f64::from(look) * REVISIT_S,
        position: position(-16.5, 179.998 + 0.000_4 * f64::from(look), 0.0),
    };
    GeoTrack {
        id: 70_000,
        name: "ship <\"A\" & 'B'>, quay; 3".to_owned(),
        status: TrackStatus::Stopped,
        velocity_m_per_s: Vector2::zeros(),
        position: fix(10).position,
        history: (0..10).map(fix).collect(),
        covariance_m2: Matrix2::new(40_000.0, 0.0, 0.0, 2_500.0),
        ..confirmed()
    }
}
