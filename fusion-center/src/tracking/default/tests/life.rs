//! Births and deaths, several sensors, overlapping dwells, and looks that are refused.

use nalgebra::{Matrix2, Vector2};

use super::super::{DefaultConfig, DefaultTracker};
use super::scenes::{EVERYWHERE, normal, rng};
use crate::tracking::{Area, Coverage, Look, LookError, Plot, Radial, Status, Tracker};

fn plot(x: f64, y: f64, sigma: f64) -> Plot {
    Plot {
        position_m: Vector2::new(x, y),
        covariance_m2: Matrix2::identity() * sigma * sigma,
        radial: None,
        strength_db: None,
        report_index: 0,
    }
}

fn look<'a>(time_s: f64, look_index: u64, plots: &'a [Plot]) -> Look<'a> {
    let coverage = Coverage { detection_probability: 0.9, ..EVERYWHERE };
    Look {
        time_s,
        sensor_index: 0,
        look_index,
        platform: None,
        coverage,
        clutter_per_m2: 1e-7,
        plots,
    }
}

fn wide() -> DefaultTracker {
    DefaultTracker::new(DefaultConfig::wide_area()).unwrap()
}

/// A target at 10 m/s, seen `count` times.
fn followed(count: u32) -> DefaultTracker {
    let mut tracker = wide();
    for scan in 0..count {
        let time_s = 4.0 * f64::from(scan);
        tracker.look(&look(time_s, u64::from(scan), &[plot(10.0 * time_s, 0.0, 10.0)])).unwrap();
    }
    tracker
}

#[test]
fn a_track_is_confirmed_and_coasts_and_ends() {
    assert_eq!(followed(2).tracks()[0].status, Status::Tentative);
    let mut tracker = followed(5);
    assert_eq!(tracker.tracks()[0].status, Status::Confirmed);
    let mut end = None;
    for scan in 5..40_u32 {
        tracker.look(&look(4.0 * f64::from(scan), u64::from(scan), &[])).unwrap();
        match tracker.tracks() {
            [track] => assert_eq!(track.status, Status::Coasting),
            _ => end = end.or(Some(scan)),
        }
    }
    // Each miss costs ln 10 nats, 12 are allowed.
    assert_eq!(end, Some(10));
    let mut settled = Vec::new();
    tracker.take_settled(&mut settled);
    assert_eq!(settled.len(), 11);
    assert!(settled.is_sorted_by(|a, b| a.time_s < b.time_s));
}

#[test]
fn where_nobody_looked_nothing_is_missed() {
    let mut tracker = followed(5);
    let before = tracker.tracks()[0].clone();
    let area = Area::Sector {
        origin_m: Vector2::new(0.0, -5000.0),
        direction_rad: 0.0,
        half_width_rad: 0.1,
        min_range_m: 0.0,
        max_range_m: 4000.0,
    };
    for index in 5..20 {
        let away = Coverage { area, ..look(0.0, 0, &[]).coverage };
        let empty = Look { coverage: away, ..look(16.0 + index as f64 * 1e-3, index, &[]) };
        tracker.look(&empty).unwrap();
    }
    assert_eq!(tracker.tracks(), &[before]);
}

#[test]
fn ids_are_never_given_again() {
    let mut tracker = wide();
    let mut ids = std::collections::BTreeSet::new();
    for index in 0..300_u32 {
        let x = 1e4 * f64::from(index / 6);
        let plots = [plot(x, 0.0, 10.0)];
        let plots = if index % 6 < 4 { &plots[..] } else { &[] };
        let known = ids.clone();
        tracker.look(&look(5.0 * f64::from(index), u64::from(index), plots)).unwrap();
        for track in tracker.tracks() {
            let is_new = ids.insert(track.id);
            assert!(!is_new || known.last() < Some(&track.id));
        }
    }
    assert_eq!(ids.len(), 50);
}

#[test]
fn several_sensors_at_the_same_instant_make_one_track() {
    let mut tracker = DefaultTracker::new(DefaultConfig::people()).unwrap();
    let mut rng = rng(4, 0);
    for period in 0..100_u32 {
        let time_s = 0.1 * f64::from(period);
        for sensor_index in 0..4 {
            let [dx, dy] = [0, 1].map(|_| 0.15 * normal(&mut rng));
            let plots = [plot(1.2 * time_s + dx, dy, 0.15)];
            let coverage = Coverage { detection_probability: 0.8, ..EVERYWHERE };
            let base = look(time_s, u64::from(period), &plots);
            tracker.look(&Look { sensor_index, coverage, clutter_per_m2: 1e-3, ..base }).unwrap();
        }
    }
    let [track] = tracker.tracks() else { panic!("{:?}", tracker.tracks()) };
    assert_eq!((track.id, track.plot_count), (1, 400));
    let off = (track.state[0] - 1.2 * 9.9).hypot(track.state[1]);
    assert!(off < 0.15 && (track.state[2] - 1.2).abs() < 0.3, "{:?}", track.state);
}

#[test]
fn two_reports_of_overlapping_dwells_make_one_track() {
    let mut tracker = wide();
    let mut rng = rng(5, 0);
    for dwell in 0..60_u32 {
        // Two dwells 3 s apart, then a pause of 27 s.
        let time_s = 30.0 * f64::from(dwell / 2) + 3.0 * f64::from(dwell % 2);
        let [dx, dy] = [0, 1].map(|_| 20.0 * normal(&mut rng));
        let plots = [plot(14.0 * time_s + dx, dy, 20.0)];
        tracker.look(&look(time_s, u64::from(dwell), &plots)).unwrap();
    }
    assert_eq!(tracker.tracks().len(), 1);
    assert_eq!(tracker.tracks()[0].plot_count, 60);
}

#[test]
fn memory_is_bounded_if_nobody_takes_what_is_settled() {
    let config =
        DefaultConfig { max_step_count: 500, smoothing_looks: 2, ..DefaultConfig::wide_area() };
    let mut tracker = DefaultTracker::new(config).unwrap();
    for scan in 0..20_000_u32 {
        let time_s = f64::from(scan);
        let apart = 1e5 * f64::from(scan / 50);
        let plots = [plot(time_s, 0.0, 10.0), plot(apart, 5e3, 10.0)];
        tracker.look(&look(time_s, u64::from(scan), &plots)).unwrap();
    }
    assert!(tracker.targets.len() < 10 && tracker.clusters.len() < 10);
    let held: usize = tracker.targets.iter().map(|target| target.trunk.len()).sum();
    assert!(held <= 500, "{held}");
    let mut settled = Vec::new();
    tracker.finish();
    tracker.take_settled(&mut settled);
    assert!(settled.len() <= 1000, "{}", settled.len());
    assert!(tracker.tracks().is_empty());
}

#[test]
fn looks_that_make_no_sense_are_refused_and_change_nothing() {
    let mut tracker = followed(5);
    let before = tracker.tracks().to_vec();
    let good = plot(0.0, 0.0, 1.0);
    let what = |of: &mut DefaultTracker, look: &Look<'_>| match of.look(look) {
        Err(LookError::Unusable { what, .. }) => what,
        other => panic!("{other:?}"),
    };
    let mut bad = [good.clone()];
    bad[0].position_m.x = f64::NAN;
    assert_eq!(what(&mut tracker, &look(20.0, 9, &bad)), "place of a plot");
    bad = [good.clone()];
    bad[0].covariance_m2[(0, 1)] = 2.0;
    assert_eq!(what(&mut tracker, &look(20.0, 9, &bad)), "skew of a plot's covariance");
    bad[0].covariance_m2[(1, 0)] = 2.0;
    assert_eq!(what(&mut tracker, &look(20.0, 9, &bad)), "determinant of a plot's covariance");
    bad = [good.clone()];
    bad[0].strength_db = Some(f64::INFINITY);
    assert_eq!(what(&mut tracker, &look(20.0, 9, &bad)), "strength of a plot");
    bad = [good];
    let direction = Vector2::new(1.0, 0.0);
    bad[0].radial =
        Some(Radial { velocity_m_per_s: 1.0, sigma_m_per_s: 0.0, direction, wrap_m_per_s: None });
    assert_eq!(what(&mut tracker, &look(20.0, 9, &bad)), "error of a radial velocity");
    assert_eq!(what(&mut tracker, &look(f64::NAN, 9, &[])), "time");
    let denser = Look { clutter_per_m2: -1.0, ..look(20.0, 9, &[]) };
    assert_eq!(what(&mut tracker, &denser), "clutter density");
    let late = tracker.look(&look(15.0, 9, &[])).unwrap_err();
    assert!(matches!(late, LookError::TooLate { previous_s: 16.0, .. }), "{late}");
    assert_eq!(tracker.tracks(), before);
}
