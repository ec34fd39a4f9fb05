//! Scans on a plane to looks against direct geometry, provenance, and settings.

use nalgebra::Vector2;
use proto::plots::{LocalPlot, LocalScan, Scan};
use proto::wire::{Dwell, DwellArea, DwellReport, FlightRecord, GeoRecord};

use super::*;
use crate::tracking::ReportId;
use crate::wide::{LookName, RadialConvention, WideConfig};

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
    let name = LookName { sensor_index: 4, look_index: 9 };
    let look_with = |one: &LocalScan, radial_convention: RadialConvention| {
        let assumed = WideConfig { radial_convention, ..WideConfig::default() };
        let look = Ground::Plane.look(&Scan::Local(one.clone()), &assumed, name);
        let look = look.unwrap().unwrap();
        assert_eq!((look.look().sensor_index, look.look().look_index), (4, 9));
        look.look().plots[0].clone()
    };
    let found = look_with(&scan, RadialConvention::Away);
    let (along, across) = (Vector2::new(0.6, 0.8), Vector2::new(-0.8, 0.6));
    // 5000 m up at 5000 m over ground: 45 degrees, and 6 m of slant are 6 √2 m of ground.
    assert!((along.dot(&(found.covariance_m2 * along)) - 72.0).abs() < 1e-9);
    assert!((across.dot(&(found.covariance_m2 * across)) - 400.0).abs() < 1e-9);
    assert!(along.dot(&(found.covariance_m2 * across)).abs() < 1e-9);
    let radial = found.radial.unwrap();
    // 10 m/s straight away over ground recede by 10 cos 45°.
    assert!((radial.direction.dot(&(along * 10.0)) - 10.0 / 2.0_f64.sqrt()).abs() < 1e-9);
    assert!((radial.velocity_m_per_s - 5.0).abs() < 1e-12);
    assert!((radial.sigma_m_per_s - 2.0).abs() < 1e-12);
    let reversed = look_with(&scan, RadialConvention::Towards).radial.unwrap();
    assert!((reversed.velocity_m_per_s + 5.0).abs() < 1e-12);
    let blind = look_with(&LocalScan { sensor_m: None, ..scan }, RadialConvention::Away);
    assert!(blind.radial.is_none());
    assert!((blind.covariance_m2 - nalgebra::Matrix2::identity() * 400.0).norm() < 1e-9);
}

/// One car going east past a sensor; every step of its track names the report that it took.
#[test]
fn a_car_becomes_a_track_that_knows_its_reports() {
    let mut follower = Follower::new(&MapConfig::default()).unwrap();
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

/// What is said of a sensor that has a car drive away from it at 15 m/s and reports this radial velocity.
fn complaints(radial_m_per_s: f64, radial_convention: RadialConvention) -> Vec<String> {
    let assumed = WideConfig { radial_convention, ..MapConfig::default().assumed };
    let mut follower = Follower::new(&MapConfig { assumed, ..MapConfig::default() }).unwrap();
    for step in 0..12_u32 {
        let place = record(40.8, 111.7 + 6e-5 * 12.0 * f64::from(step), 1000.0);
        let known = Some(radial_m_per_s);
        let one = DwellReport { radial_m_per_s: known, wrap_m_per_s: None, ..report(place) };
        let time_unix_s = 100.0 + 4.0 * f64::from(step);
        let scan = Dwell { revisit_index: step, ..dwell(time_unix_s, vec![one]) };
        follower.take(&geographic(scan)).unwrap();
    }
    follower.complaints()
}

#[test]
fn a_sensor_whose_radial_velocities_have_the_other_sign_is_named_with_the_remedy() {
    assert!(complaints(14.3, RadialConvention::Away).is_empty());
    assert!(complaints(-14.3, RadialConvention::Towards).is_empty());
    let said = complaints(-14.3, RadialConvention::Away).join(", ");
    assert!(said.contains("sensor eye") && said.ends_with("radial_convention = \"towards\""));
    let back = complaints(14.3, RadialConvention::Towards).join(", ");
    assert!(back.ends_with("radial_convention = \"away\""), "{back}");
}

#[test]
fn what_cannot_be_followed_is_refused_and_costs_nothing() {
    let mut follower = Follower::new(&MapConfig::default()).unwrap();
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
    assert_eq!(MapConfig::default().complaint(), None);
    let said = |change: fn(&mut MapConfig)| {
        let mut config = MapConfig::default();
        change(&mut config);
        config.complaint().unwrap_or_default()
    };
    assert!(said(|one| one.max_wait_s = -1.0).starts_with("wide.max_wait_s is -1: use 0 to 600"));
    assert!(said(|one| one.assumed.clutter_per_km2 = 0.0).contains("wide.assumed.clutter_per_km2"));
    assert!(said(|one| one.tracking.paper.max_track_count = 0).starts_with("wide.tracking.paper"));
    assert!(said(|one| one.output.interval_s = 0.0).contains("wide.output.interval_s"));
    let address = said(|one| "tcp/1.2.3.4:5".clone_into(&mut one.output.cot));
    assert!(address.contains("wide.output.cot") && address.contains("udp/ADDRESS:PORT"));
    assert_eq!(udp_address("udp/[::1]:7").unwrap().port(), 7);
}

/// A table that sets one key leaves the others as they are without it.
#[test]
fn a_file_that_sets_one_key_changes_no_other() {
    let read: MapConfig = toml::from_str("[assumed]\nslant_sigma_m = 11.0").unwrap();
    let mut expected = MapConfig::default();
    expected.assumed.slant_sigma_m = 11.0;
    assert_eq!(read, expected);
}
