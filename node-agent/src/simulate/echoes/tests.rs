//! Echoes against geometry by hand, and the statistics of noise, misses and people.

use crate::imaging::wall::leg_path_m;

use super::super::noise::Noise;
use super::super::scene::{AmplitudeLaw, Clutter, WayPoint};
use super::*;
use proto::radar::Wall;
use std::f64::consts::FRAC_PI_2;

fn standing(x_m: f64, y_m: f64) -> Target {
    let way_points = vec![WayPoint { time_s: 0.0, x_m, y_m }];
    Target { way_points, kind: TargetKind::Point, amplitude_db: 0.0 }
}

fn simulator(scene: &Scene, disturbance: Disturbance) -> EchoSimulator {
    let looking_along_x = Se2::new(0.0, 5.0, -FRAC_PI_2);
    EchoSimulator::new(scene, looking_along_x, &Radar::default(), &disturbance, 9).unwrap()
}

/// The echo of places in the node's frame, with amplitudes, by two plain loops.
fn plain_echo(places: &[(f64, f64, f64)], wall: Option<&Wall>) -> Vec<Complex<f64>> {
    let radar = Radar::default();
    let sample = |tx: &[f64; 2], rx: &[f64; 2], frequency_hz: f64| {
        let mut sum = Complex::new(0.0, 0.0);
        for (x_m, y_m, amplitude) in places {
            let path_m = leg_path_m(x_m - tx[0], *y_m, wall) + leg_path_m(x_m - rx[0], *y_m, wall);
            let phase_rad = TAU * frequency_hz * path_m / 299_792_458.0;
            sum += Complex::new(phase_rad.cos(), -phase_rad.sin()) * *amplitude;
        }
        sum
    };
    let mut samples = Vec::new();
    for tx in &radar.array.tx_m {
        for rx in &radar.array.rx_m {
            samples.extend((0..301).map(|k| sample(tx, rx, 1.6e9 + 2e6 * f64::from(k))));
        }
    }
    samples
}

fn assert_same(got: &Sweep, want: &[Complex<f64>]) {
    assert_eq!(got.samples.len(), want.len());
    for (a, b) in got.samples.iter().zip(want) {
        // Rounding to single precision of sums below 4.
        assert!((f64::from(a.re) - b.re).hypot(f64::from(a.im) - b.im) < 1e-6);
    }
}

#[test]
fn echoes_are_those_of_a_geometry_worked_out_by_hand() {
    // A node at (0, 5) looking along +x sees the world's (x, y) at (5 − y, x).
    let wall = Wall { thickness_m: 0.24, permittivity: 5.0 };
    let mut strong = standing(6.0, 4.0);
    strong.amplitude_db = 6.0;
    let behind = standing(-2.0, 5.0);
    let clutter = vec![Clutter { x_m: 7.0, y_m: 8.0, amplitude_db: -20.0 }];
    let scene = Scene { targets: vec![strong, behind], clutter, ..Scene::default() };
    let places = [(1.0, 6.0, 10_f64.powf(0.3)), (-3.0, 7.0, 0.1)];
    let first_sweep = |of: &Scene| simulator(of, Disturbance::default()).sweep(0, 0.0);
    assert_same(&first_sweep(&scene), &plain_echo(&places, None));
    let walled = Scene { wall: Some(wall), ..scene.clone() };
    assert_same(&first_sweep(&walled), &plain_echo(&places, Some(&wall)));
    let far = Scene { amplitude_law: AmplitudeLaw::InverseSquare, ..scene };
    let faded = [(1.0, 6.0, 10_f64.powf(0.3) / 37.0), (-3.0, 7.0, 0.1 / 58.0)];
    assert_same(&first_sweep(&far), &plain_echo(&faded, None));
    let truth = simulator(&far, Disturbance::default()).targets_in_node(0.0);
    assert!((truth[0].coords_m - Vector2::new(1.0, 6.0)).norm() < 1e-12);
    assert!((truth[1].coords_m - Vector2::new(0.0, -2.0)).norm() < 1e-12);
}

#[test]
fn noise_has_the_power_asked_for_relative_to_the_strongest_target() {
    let mut walker = standing(6.0, 5.0);
    walker.way_points.push(WayPoint { time_s: 1.0, x_m: 2.0, y_m: 8.0 });
    let scene = Scene {
        targets: vec![walker],
        amplitude_law: AmplitudeLaw::InverseSquare,
        ..Scene::default()
    };
    let noise = Noise::InBand { snr_db: 8.0 };
    let noisy = simulator(&scene, Disturbance { noise, ..Disturbance::default() });
    // The line from (0, 6) to (−3, 2) in the node's frame passes the origin at 6 · 3/5 m.
    let amplitude = 1.0 / 3.6_f64.powi(2);
    assert!((noisy.reference_amplitude() - amplitude).abs() < 1e-12);
    let quiet = simulator(&scene, Disturbance::default());
    let difference: Vec<Complex<f32>> = noisy
        .sweep(3, 0.5)
        .samples
        .iter()
        .zip(&quiet.sweep(3, 0.5).samples)
        .map(|(a, b)| a - b)
        .collect();
    // Noise left in the mean over the frequencies of a channel, averaged: 2408 samples, 5 σ = 10 %.
    let power = difference.iter().map(|d| f64::from(d.norm_sqr())).sum::<f64>() / 2408.0 / 301.0;
    assert!((power / (amplitude.powi(2) / 10_f64.powf(0.8)) - 1.0).abs() < 0.1);
}

#[test]
fn sweeps_depend_on_seed_period_and_time_alone() {
    let mut person = standing(6.0, 4.0);
    person.kind = TargetKind::Person;
    let scene = Scene { targets: vec![person, standing(3.0, 6.0)], ..Scene::default() };
    let noise = Noise::InBand { snr_db: 8.0 };
    let disturbance = Disturbance {
        noise,
        detection_probability: 0.5,
        false_point_probability: 0.5,
        ..Disturbance::default()
    };
    let (early, late) = (simulator(&scene, disturbance), simulator(&scene, disturbance));
    let sweeps: Vec<Sweep> = (0..6).map(|k| early.sweep(k, 0.1 * k as f64)).collect();
    assert_eq!(late.sweep(5, 0.5), sweeps[5]);
    assert_eq!(late.sweep(2, 0.2), sweeps[2]);
    assert_ne!(late.sweep(3, 0.2), sweeps[2]);
}

#[test]
fn misses_and_false_targets_come_as_often_as_asked_and_show_in_the_sweep() {
    let scene = Scene { targets: vec![standing(6.0, 4.0), standing(3.0, 6.0)], ..Scene::default() };
    let disturbance = Disturbance {
        noise: Noise::None,
        detection_probability: 0.8,
        false_point_probability: 0.1,
        ..Disturbance::default()
    };
    let simulator = simulator(&scene, disturbance);
    let period_count = 4000_u32;
    let seen =
        |target| (0..u64::from(period_count)).filter(|k| simulator.is_visible(target, *k)).count();
    let falses = (0..u64::from(period_count)).filter_map(|k| simulator.false_target(k)).count();
    let share = |count: usize| count as f64 / f64::from(period_count);
    // 5 σ of 4000 draws: 3.2 % and 2.4 %.
    assert!((share(seen(0)) - 0.8).abs() < 0.032 && (share(seen(1)) - 0.8).abs() < 0.032);
    let both = (0..u64::from(period_count))
        .filter(|k| simulator.is_visible(0, *k) && simulator.is_visible(1, *k));
    assert!((share(both.count()) - 0.64).abs() < 0.038, "targets are missed together");
    assert!((share(falses) - 0.1).abs() < 0.024);
    let sides = [(1.0, 6.0), (-1.0, 3.0)];
    for k in 0..60 {
        let mut places: Vec<(f64, f64, f64)> = (0..2)
            .filter(|i| simulator.is_visible(*i, k))
            .map(|i| (sides[i].0, sides[i].1, 1.0))
            .collect();
        places.extend(simulator.false_target(k).map(|p| (p.x_m(), p.y_m(), 1.0)));
        assert_same(&simulator.sweep(k, 0.0), &plain_echo(&places, None));
    }
}

#[test]
fn a_person_has_the_power_of_a_point_and_a_bright_near_side() {
    let mut person = standing(6.0, 5.0);
    person.kind = TargetKind::Person;
    let simulator =
        simulator(&Scene { targets: vec![person], ..Scene::default() }, Disturbance::default());
    let (mut power, mut nearer) = (0.0, 0.0);
    let period_count = 2000_u32;
    for k in 0..u64::from(period_count) {
        for scatterer in simulator.scatterers(k, 0.0) {
            let offset_m = scatterer.place_m - Vector2::new(0.0, 6.0);
            assert!(offset_m.norm() <= 0.25);
            power += scatterer.gain.norm_sqr();
            nearer -= scatterer.gain.norm_sqr() * offset_m.y;
        }
    }
    // The standard deviation of one period's power is at most its mean: 5 σ are 11 %.
    assert!((power / f64::from(period_count) - 1.0).abs() < 0.11);
    assert!(0.02 < nearer / power, "the centre of brightness is {} m nearer", nearer / power);
}
