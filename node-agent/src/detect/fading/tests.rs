//! The ghost test on simulated sweeps of points that stand, breathe, come and go.

use super::*;
use crate::imaging::Sweep;
use crate::imaging::canceller::{Cancelled, Canceller, CancellerConfig, Gates};
use crate::imaging::compress::{Compressor, Profiles};
use crate::imaging::window::Window;
use crate::simulate::{
    Disturbance, EchoSimulator, Noise, Radar, Scene, Target, TargetKind, WayPoint,
};
use nalgebra::Matrix2;
use proto::geom::Se2;
use proto::measured::packed;

const SAMPLE_RATE_HZ: f64 = 2048.0 * 2e6;

fn focus() -> Focus {
    Focus::new(&Band::default(), &Array::default(), &WallModel::None)
}

fn target(way_points: &[(f64, f64, f64)]) -> Target {
    let way_points =
        way_points.iter().map(|&(time_s, x_m, y_m)| WayPoint { time_s, x_m, y_m }).collect();
    Target { way_points, kind: TargetKind::Point, amplitude_db: 0.0 }
}

/// A point at (0.5, 5) that breathes by 2.5 mm to either side, with corners at the turns.
fn breathing() -> Target {
    let turns: Vec<(f64, f64, f64)> = (0..20)
        .map(|k| (2.0 * f64::from(k), 0.5, 5.0 + 0.0025 * f64::from(2 * (k % 2) - 1)))
        .collect();
    target(&turns)
}

/// The canceller after the sweeps at 10 Hz up to `until_s`, of points with 16 dB in each channel.
fn watched(targets: Vec<Target>, until_s: f64) -> Canceller {
    let scene = Scene { targets, ..Scene::default() };
    let noise = Noise::InBand { snr_db: 16.0 };
    let disturbance = Disturbance { noise, ..Disturbance::default() };
    let simulator =
        EchoSimulator::new(&scene, Se2::identity(), &Radar::default(), &disturbance, 5).unwrap();
    let compressor = Compressor::new(&Band::default(), &Window::Taylor.weights(301), 2048);
    let gates = Gates { kept_count: 600, per_cell: 6.8 };
    let mut canceller = Canceller::new(CancellerConfig::default(), gates);
    for k in (0..).take_while(|k| 0.1 * (*k as f64) < until_s - 0.05) {
        let Sweep { time_s, samples } = simulator.sweep(k, 0.1 * k as f64);
        let profiles: Profiles = compressor.compress(&samples);
        let state = canceller.cancel(time_s, &profiles);
        assert_eq!(matches!(state, Cancelled::WarmingUp), k < 5);
    }
    canceller
}

fn point(x_m: f64, y_m: f64, snr_db: f64) -> MeasuredPoint {
    let none = packed(&Matrix2::zeros());
    MeasuredPoint { x_m, y_m, cov_m2: none, snr_db, extent_m2: none, radial_velocity_m_per_s: None }
}

/// Whether points of 25 dB at the places are live.
fn alive<const N: usize>(canceller: &mut Canceller, places: [(f64, f64); N]) -> [bool; N] {
    let seen = canceller.slow_fast_mut().unwrap();
    places.map(|(x_m, y_m)| {
        focus().looks(&point(x_m, y_m, 25.0), SAMPLE_RATE_HZ).is_live(seen, 25.0) != Some(false)
    })
}

#[test]
fn the_coherent_sum_is_the_matched_filter() {
    let scene = Scene { targets: vec![target(&[(0.0, 1.0, 6.0)])], ..Scene::default() };
    let simulator =
        EchoSimulator::new(&scene, Se2::identity(), &Radar::default(), &Disturbance::default(), 1)
            .unwrap();
    let weights = Window::Taylor.weights(301);
    let profiles = Compressor::new(&Band::default(), &weights, 2048)
        .compress(&simulator.sweep(0, 0.0).samples);
    let at = |x_m: f64, y_m: f64| {
        let looks = focus().looks(&point(x_m, y_m, 25.0), SAMPLE_RATE_HZ);
        looks.coherent_sum(&profiles.samples)
    };
    // 8 channels of amplitude 1 with phase 0; linear interpolation errs by 1 % of the amplitude.
    assert!((at(1.0, 6.0) - Complex::new(8.0, 0.0)).norm() < 0.15, "{}", at(1.0, 6.0));
    assert!(at(1.0, 7.0).norm() < 0.3 && at(-1.0, 6.0).norm() < 4.0);
    assert!(at(1.0, 1e4).norm() < f64::MIN_POSITIVE, "beyond the profile");
}

#[test]
fn the_variance_is_that_of_a_sample() {
    let values = [1.0, 2.0, 3.0, 6.0].map(|re| Complex::new(re, -re));
    assert!((variance(&values) - 2.0 * 14.0 / 3.0).abs() < 1e-12);
    assert!(variance(&values[..1]).abs() < f64::MIN_POSITIVE);
}

#[test]
fn what_breathes_is_alive_and_what_stands_is_not() {
    let mut canceller = watched(vec![breathing(), target(&[(0.0, -2.0, 7.0)])], 20.0);
    let places = [(0.5, 5.0), (-2.0, 7.0), (1.0, 3.0)];
    assert_eq!(alive(&mut canceller, places), [true, false, false]);
}

#[test]
fn the_shadow_of_one_who_left_is_dropped_and_the_walker_stays() {
    let leaves = target(&[(8.0, 0.5, 5.0), (14.0, -2.5, 3.5)]);
    let places = [(0.5, 5.0), (-2.0, 3.75)];
    assert_eq!(alive(&mut watched(vec![leaves.clone()], 13.1), places), [false, true]);
    let mut canceller = watched(vec![leaves], 13.1);
    let mut points = places.map(|(x_m, y_m)| point(x_m, y_m, 25.0)).to_vec();
    let mut living = Living::new(focus());
    let seen = canceller.slow_fast_mut().unwrap();
    living.keep_living(&mut points, 13.0, seen, SAMPLE_RATE_HZ);
    assert_eq!(points.len(), 1);
    assert!((points[0].x_m + 2.0).abs() < 1e-9);
}

#[test]
fn a_trusted_place_lives_for_a_breath_and_an_untrusted_one_does_not() {
    // Nobody for 6 s, then one who comes, and whose place is looked at when he moves no more.
    let comes = target(&[(6.0, 0.5, 9.0), (8.0, 0.5, 5.0)]);
    let mut canceller = watched(vec![comes], 8.5);
    let mut living = Living::new(focus());
    let mut keep = |at_s: f64, tested: &mut Canceller| {
        let mut points = vec![point(0.5, 5.0, 25.0), point(0.5, 7.0, 25.0)];
        let seen = tested.slow_fast_mut().unwrap();
        living.keep_living(&mut points, at_s, seen, SAMPLE_RATE_HZ);
        points.iter().any(|p| p.y_m < 5.5)
    };
    assert!(keep(8.5, &mut canceller));
    // The same canceller with still sweeps only: nothing moves at any place.
    let mut still = watched(vec![target(&[(0.0, 0.5, 5.0)])], 8.5);
    assert_eq!(alive(&mut still, [(0.5, 5.0)]), [false]);
    assert!(keep(12.0, &mut still), "3.5 s later");
    assert!(!keep(13.0, &mut still), "4.5 s later");
    let mut young = watched(vec![target(&[(0.0, 0.5, 5.0)])], 2.0);
    assert!(keep(13.1, &mut canceller));
    assert!(!keep(13.2, &mut young), "learned for 2 s only");
}

#[test]
fn without_history_nothing_is_said_against_a_point() {
    let mut canceller =
        Canceller::new(CancellerConfig::default(), Gates { kept_count: 600, per_cell: 6.8 });
    assert_eq!(alive(&mut canceller, [(0.5, 5.0)]), [true]);
}
