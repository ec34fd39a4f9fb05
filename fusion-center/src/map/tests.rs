//! Scans to looks against direct geometry, the way back to the earth, and provenance.

use nalgebra::{Matrix4, Vector2, Vector3, Vector4};
use proto::geodesy::{EnuFrame, EnuPoint, GeoPosition};
use proto::plots::{LocalPlot, LocalScan, Scan};
use proto::wire::{Dwell, DwellArea, DwellReport, FlightRecord, GeoRecord};

use super::looks::look_of;
use super::*;
use crate::tracking::{Area, ReportId};

/// Places must come back to this, metres.
const PLACE_M: f64 = 1e-3;

fn record(lat_deg: f64, lon_deg: f64, height_m: f64) -> GeoRecord {
    GeoRecord { lat_deg, lon_deg, height_m }
}

fn report(place: GeoRecord) -> DwellReport {
    DwellReport {
        index: 5,
        place,
        slant_sigma_m: Some(10.0),
        cross_sigma_m: Some(40.0),
        radial_m_per_s: Some(-4.0),
        radial_sigma_m_per_s: None,
        wrap_m_per_s: Some(30.0),
        snr_db: Some(12.0),
        truth: Some(3),
    }
}

fn dwell(time_unix_s: f64, reports: Vec<DwellReport>) -> Dwell {
    Dwell {
        node: "eye".parse().unwrap(),
        time_unix_s,
        revisit_index: 2,
        dwell_index: 7,
        is_last_of_revisit: true,
        sensor: record(40.8, 111.5, 7000.0),
        flight: Some(FlightRecord { course_deg: 90.0, speed_m_per_s: 120.0, climb_m_per_s: 0.0 }),
        area: DwellArea {
            center: record(40.8, 111.7, 1000.0),
            range_half_extent_m: 5000.0,
            angle_half_extent_deg: 3.0,
        },
        minimum_detectable_m_per_s: Some(1.0),
        detection_probability: None,
        is_simulated: true,
        reports,
    }
}

fn geographic(dwell: Dwell) -> Scan {
    Scan::Geographic(Box::new(dwell))
}

#[test]
fn places_on_the_earth_come_back_to_the_millimetre() {
    for (lat_deg, lon_deg, height_m) in
        [(40.8, 111.7, 1000.0), (40.95, 111.95, 1310.0), (40.5, 111.2, 0.0), (41.5, 112.5, 500.0)]
    {
        let place = record(lat_deg, lon_deg, height_m);
        let scan = geographic(dwell(10.0, vec![report(place)]));
        let ground = Ground::of(&geographic(dwell(0.0, Vec::new()))).unwrap();
        let at_m = ground.flat(&scan).unwrap().unwrap().scan.plots[0].at_m;
        let state = Vector4::new(at_m[0], at_m[1], 3.0, 4.0);
        let found = ground.geo_state(&state, &Matrix4::identity(), height_m).unwrap().unwrap();
        let there = EnuFrame::new(GeoPosition::new(lat_deg, lon_deg, height_m).unwrap());
        let back = GeoPosition::new(found.place.lat_deg, found.place.lon_deg, height_m).unwrap();
        let EnuPoint { east_m, north_m, up_m } = there.to_enu(&back);
        let error_m = Vector3::new(east_m, north_m, up_m).norm();
        assert!(error_m < PLACE_M, "{place:?}: {error_m}");
    }
}

/// The direction of a velocity on the map against two places a second apart.
#[test]
fn velocities_turn_with_the_meridians() {
    let ground = Ground::of(&geographic(dwell(0.0, Vec::new()))).unwrap();
    let state = Vector4::new(60_000.0, 50_000.0, 20.0, -11.0);
    let covariance = Matrix4::from_diagonal(&Vector4::new(400.0, 25.0, 4.0, 1.0));
    let now = ground.geo_state(&state, &covariance, 900.0).unwrap().unwrap();
    let later = state + Vector4::new(20.0, -11.0, 0.0, 0.0);
    let then = ground.geo_state(&later, &covariance, 900.0).unwrap().unwrap();
    let at = GeoPosition::new(now.place.lat_deg, now.place.lon_deg, 900.0).unwrap();
    let after = GeoPosition::new(then.place.lat_deg, then.place.lon_deg, 900.0).unwrap();
    let moved = EnuFrame::new(at).to_enu(&after);
    let stepped = Vector2::new(moved.east_m, moved.north_m);
    // The plane is flat and the earth is not: a part in ten thousand at 80 km.
    assert!((stepped - now.velocity_m_per_s).norm() < 3e-3, "{stepped} {}", now.velocity_m_per_s);
    let turned_m = (now.velocity_m_per_s - state.fixed_rows::<2>(2)).norm();
    assert!(0.1 < turned_m, "half a degree at 20 m/s shows: {turned_m}");
    let main = now.covariance.fixed_view::<2, 2>(0, 0).symmetric_eigenvalues();
    assert!((main.max() - 400.0).abs() < 0.2 && (main.min() - 25.0).abs() < 0.2, "{main}");
    assert!(1.0 < now.covariance[(0, 1)].abs(), "the axes of the error turn too");
}

#[test]
fn errors_lie_along_and_across_the_line_of_sight() {
    let plot = LocalPlot {
        index: 0,
        at_m: [3000.0, 4000.0],
        slant_sigma_m: Some(6.0),
        cross_sigma_m: Some(20.0),
        radial_m_per_s: Some(5.0),
        radial_sigma_m_per_s: None,
        wrap_m_per_s: None,
        snr_db: None,
        truth: None,
    };
    let scan = LocalScan {
        time_s: 1.0,
        node: "eye".parse().unwrap(),
        revisit_index: 0,
        dwell_index: 0,
        sensor_m: Some([0.0, 0.0, 5000.0]),
        detection_probability: None,
        minimum_detectable_m_per_s: None,
        plots: vec![plot],
    };
    let look_with = |scan: &LocalScan, radial: RadialSign| {
        let flat = Ground::Plane.flat(&Scan::Local(scan.clone())).unwrap().unwrap();
        let look = look_of(&flat, &AssumedConfig { radial, ..AssumedConfig::default() });
        look.look(0, 0).plots[0].clone()
    };
    let found = look_with(&scan, RadialSign::Receding);
    let (along, across) = (Vector2::new(0.6, 0.8), Vector2::new(-0.8, 0.6));
    // 5000 m up at 5000 m over ground: 45 degrees, and 6 m of slant are 6 √2 m of ground.
    assert!((along.dot(&(found.covariance_m2 * along)) - 72.0).abs() < 1e-9);
    assert!((across.dot(&(found.covariance_m2 * across)) - 400.0).abs() < 1e-9);
    assert!(along.dot(&(found.covariance_m2 * across)).abs() < 1e-9);
    let radial = found.radial.unwrap();
    // 10 m/s straight away over ground recede by 10 cos 45°.
    assert!((radial.direction.dot(&(along * 10.0)) - 10.0 / 2.0_f64.sqrt()).abs() < 1e-9);
    assert!((radial.velocity_m_per_s - 5.0).abs() < 1e-12);
    assert!((radial.sigma_m_per_s - 1.0).abs() < 1e-12);
    let reversed = look_with(&scan, RadialSign::Approaching).radial.unwrap();
    assert!((reversed.velocity_m_per_s + 5.0).abs() < 1e-12);
    assert!(look_with(&scan, RadialSign::Unused).radial.is_none());
    let blind = look_with(&LocalScan { sensor_m: None, ..scan }, RadialSign::Receding);
    assert!(blind.radial.is_none());
    assert!((blind.covariance_m2 - nalgebra::Matrix2::identity() * 400.0).norm() < 1e-9);
}

#[test]
fn a_dwell_covers_its_sector_and_its_sensor_flies() {
    let ground = Ground::of(&geographic(dwell(0.0, Vec::new()))).unwrap();
    let flat = ground.flat(&geographic(dwell(0.0, Vec::new()))).unwrap().unwrap();
    let owned = look_of(&flat, &AssumedConfig::default());
    let look = owned.look(4, 9);
    let platform = look.platform.unwrap();
    // 0.2 degrees of longitude at 40.8 degrees are 16.9 km; 6 km above the plane less its curvature.
    assert!((platform.position_m.x + 16_880.0).abs() < 30.0, "{}", platform.position_m);
    assert!((platform.position_m.z - 5977.0).abs() < 3.0, "{}", platform.position_m);
    assert!((platform.velocity_m_per_s.xy() - Vector2::new(120.0, 0.0)).norm() < 0.5);
    let Area::Sector { direction_rad, half_width_rad, min_range_m, max_range_m, .. } =
        look.coverage.area
    else {
        panic!("a sector")
    };
    assert!(direction_rad.abs() < 0.01 && (half_width_rad - 3.0_f64.to_radians()).abs() < 1e-12);
    assert!((max_range_m - min_range_m - 10_000.0).abs() < 1e-6);
    assert_eq!((look.sensor_index, look.look_index), (4, 9));
    let mut all = dwell(0.0, Vec::new());
    all.area.angle_half_extent_deg = 180.0;
    let flat = ground.flat(&geographic(all)).unwrap().unwrap();
    let everywhere = look_of(&flat, &AssumedConfig::default()).look(0, 0).coverage.area;
    assert_eq!(everywhere, Area::Everywhere);
}

/// One car going east past a sensor; every step of its track names the report that it took.
#[test]
fn a_car_becomes_a_track_that_knows_its_reports() {
    let mut follower = Follower::new(&WideConfig::default()).unwrap();
    let mut settled = Vec::new();
    for step in 0..12_u32 {
        let time_unix_s = 100.0 + 4.0 * f64::from(step);
        // 15 m/s: 6e-5 degrees of longitude are 5.06 m here.
        let place = record(40.8, 111.7 + 6e-5 * 12.0 * f64::from(step), 1000.0);
        let mut one = report(place);
        one.radial_m_per_s = None;
        let scan = Dwell { revisit_index: step, ..dwell(time_unix_s, vec![one]) };
        follower.take(&geographic(scan)).unwrap();
        follower.take_settled(&mut settled);
    }
    let [track] = follower.tracks() else { panic!("{:?}", follower.tracks()) };
    let shown = follower.map_track(track).unwrap();
    assert!(shown.check().is_ok());
    let source = follower.source(track.last_report).unwrap();
    assert_eq!((source.report.revisit_index, source.report.report_index), (11, 5));
    assert_eq!((source.report.node.as_str(), source.truth), ("eye", Some(3)));
    assert_eq!(shown.report.as_ref(), Some(&source.report));
    assert!((shown.place.lon_deg - 111.708).abs() < 3e-4, "{shown:?}");
    assert!((shown.velocity_m_per_s[0] - 15.2).abs() < 2.0, "{shown:?}");
    follower.finish();
    follower.take_settled(&mut settled);
    assert_eq!(settled.iter().filter(|step| step.report.is_some()).count(), 12);
    let unknown = ReportId { sensor_index: 0, look_index: 12, report_index: 0 };
    assert!(follower.source(unknown).is_none());
}

#[test]
fn what_cannot_be_followed_is_refused_and_costs_nothing() {
    let mut follower = Follower::new(&WideConfig::default()).unwrap();
    follower.take(&geographic(dwell(100.0, vec![report(record(40.8, 111.7, 0.0))]))).unwrap();
    let late = follower.take(&geographic(dwell(50.0, Vec::new()))).unwrap_err();
    assert!(matches!(late, FollowError::Look(_)), "{late}");
    let mut nowhere = dwell(101.0, Vec::new());
    nowhere.sensor.lat_deg = 91.0;
    let place = follower.take(&geographic(nowhere)).unwrap_err();
    assert!(matches!(place, FollowError::Place(_)), "{place}");
    let local = LocalScan {
        time_s: 102.0,
        node: "eye".parse().unwrap(),
        revisit_index: 0,
        dwell_index: 0,
        sensor_m: None,
        detection_probability: None,
        minimum_detectable_m_per_s: None,
        plots: Vec::new(),
    };
    assert!(matches!(follower.take(&Scan::Local(local)), Err(FollowError::Mixed)));
    assert_eq!(follower.tracks().len(), 1);
}

#[test]
fn settings_that_make_no_sense_are_named() {
    assert_eq!(WideConfig::default().complaint(), None);
    let said = |change: fn(&mut WideConfig)| {
        let mut config = WideConfig::default();
        change(&mut config);
        config.complaint().unwrap_or_default()
    };
    assert!(said(|one| one.max_wait_s = -1.0).starts_with("wide.max_wait_s is -1: use 0 to 600"));
    assert!(said(|one| one.assumed.clutter_per_m2 = 0.0).contains("assumed.clutter_per_m2"));
    assert!(said(|one| one.tracking.paper.max_track_count = 0).contains("wide.tracking"));
    assert!(said(|one| one.output.interval_s = 0.0).contains("wide.output.interval_s"));
    let address = said(|one| "tcp/1.2.3.4:5".clone_into(&mut one.output.cot));
    assert!(address.contains("wide.output.cot") && address.contains("udp/ADDRESS:PORT"));
    assert_eq!(udp_address("udp/[::1]:7").unwrap().port(), 7);
}
