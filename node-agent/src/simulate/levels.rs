//! How strong and how late echoes are in whole sweeps, and that the truth says where they show.

use std::f64::consts::TAU;

use nalgebra::Vector2;
use proto::geom::Se2;
use proto::radar::Wall;
use rustfft::num_complex::Complex;

use super::echoes::Radar;
use super::streams::Moment;
use super::*;

const LIGHT_M_PER_S: f64 = 299_792_458.0;

fn standing(x_m: f64, y_m: f64, kind: TargetKind) -> Target {
    Target { way_points: vec![WayPoint { time_s: 0.0, x_m, y_m }], kind, amplitude_db: 0.0 }
}

fn received(scene: &Scene, disturbance: &Disturbance) -> Vec<Complex<f64>> {
    let pose = Se2::identity();
    let simulator = EchoSimulator::new(scene, pose, &Radar::default(), disturbance, 3).unwrap();
    simulator.received(Moment { period_index: 0, time_s: 0.0 })
}

/// The amplitude of a channel's samples at a path of both legs: a matched filter with a Hann
/// window, so that other echoes do not interfere.
fn at_path(channel: &[Complex<f64>], path_m: f64) -> Complex<f64> {
    let turned = channel.iter().enumerate().map(|(k, sample)| {
        let weight = 1.0 - (TAU * (k as f64 + 0.5) / channel.len() as f64).cos();
        sample * Complex::cis(TAU * (1.6e9 + 2e6 * k as f64) * path_m / LIGHT_M_PER_S) * weight
    });
    turned.sum::<Complex<f64>>() / channel.len() as f64
}

/// The image of a place by plain back-projection through air.
fn at_place(samples: &[Complex<f64>], place: &Vector2<f64>) -> f64 {
    let radar = Radar::default();
    let leg_m = |antenna: &[f64; 2]| (place - Vector2::from(*antenna)).norm();
    let channels = samples.chunks_exact(301).enumerate().map(|(channel, sweep)| {
        let (tx, rx) = (&radar.array.tx_m[channel / 4], &radar.array.rx_m[channel % 4]);
        at_path(sweep, leg_m(tx) + leg_m(rx))
    });
    channels.sum::<Complex<f64>>().norm() / 8.0
}

fn db(amplitude: f64) -> f64 {
    20.0 * amplitude.log10()
}

fn difference(a: &[Complex<f64>], b: &[Complex<f64>]) -> Vec<Complex<f64>> {
    a.iter().zip(b).map(|(x, y)| x - y).collect()
}

#[test]
fn the_coupling_is_55_to_65_db_above_the_target_and_first() {
    let target = standing(0.5, 4.0, TargetKind::Point);
    let scene = Scene {
        targets: vec![target],
        amplitude_law: AmplitudeLaw::InverseSquare,
        ..Scene::default()
    };
    let calm = received(&scene, &Disturbance::default());
    let coupled = Disturbance { coupling: Some(Coupling::default()), ..Disturbance::default() };
    let coupling = difference(&received(&scene, &coupled), &calm);
    let radar = Radar::default();
    let power = |channel: &[Complex<f64>]| {
        channel.iter().map(|s| s.norm_sqr()).sum::<f64>() / channel.len() as f64
    };
    let mut levels = Vec::new();
    for (channel, (wave, echo)) in
        coupling.chunks_exact(301).zip(calm.chunks_exact(301)).enumerate()
    {
        let over_db = 10.0 * (power(wave) / power(echo)).log10();
        assert!((54.0..66.0).contains(&over_db), "channel {channel}: {over_db} dB");
        levels.push(over_db);
        let spacing_m = (radar.array.tx_m[channel / 4][0] - radar.array.rx_m[channel % 4][0]).abs();
        let direct_m = spacing_m + 0.299_792_458;
        let strongest_m = (0..400)
            .map(|k| 0.01 * f64::from(k))
            .max_by(|a, b| at_path(wave, *a).norm().total_cmp(&at_path(wave, *b).norm()))
            .unwrap();
        assert!((strongest_m - direct_m).abs() < 0.1, "{strongest_m} m for {direct_m} m");
        // Ripples of at most 1 dB, and of some.
        let (low, high) = wave.iter().fold((f64::INFINITY, 0.0_f64), |(low, high), s| {
            (low.min(s.norm()), high.max(s.norm()))
        });
        assert!((0.1..2.3).contains(&db(high / low)), "{} dB", db(high / low));
    }
    let spread = levels.iter().fold(0.0_f64, |a, l| a.max((l - levels[0]).abs()));
    assert!(1.0 < spread, "all channels alike");
}

#[test]
fn a_wall_takes_from_the_echo_what_it_should_and_echoes_itself() {
    let wall = Wall { thickness_m: 0.24, permittivity: 5.0 };
    let lossless = Scene {
        targets: vec![standing(0.0, 5.0, TargetKind::Point)],
        wall: Some(wall),
        ..Scene::default()
    };
    let effects = WallEffects {
        stand_off_m: 0.3,
        transmission: Transmission::Fresnel,
        conductivity_s_per_m: 0.03,
        ..WallEffects::default()
    };
    let lossy = Scene { wall_effects: effects, ..lossless.clone() };
    let none = Disturbance::default();
    let (full, less) = (received(&lossless, &none), received(&lossy, &none));
    let path_m = 2.0 * (5.0 + 0.24 * (5.0_f64.sqrt() - 1.0));
    let level_db = db(at_path(&less[..301], path_m).norm() / at_path(&full[..301], path_m).norm());
    assert!((level_db + 13.3).abs() < 0.2, "{level_db} dB");
    let inner = WallEffects { inner_pass_count: 1, ..effects };
    let added =
        difference(&received(&Scene { wall_effects: inner, ..lossless.clone() }, &none), &less);
    let later_m = path_m + 2.0 * 0.24 * 5.0_f64.sqrt();
    // One pass on either leg: 6 dB more than −27.2 dB.
    let pass_db = db(at_path(&added[..301], later_m).norm() / at_path(&less[..301], path_m).norm());
    assert!((pass_db + 21.2).abs() < 0.7, "{pass_db} dB");
    let faces = WallEffects { face_echo_count: 2, ..effects };
    let scene = Scene { wall_effects: faces, specular_db: 0.0, ..lossless };
    let echoes = difference(&received(&scene, &none), &less);
    // Straight ahead: −8.35 dB from the front, −13.3 − 8.35 dB from the back; a cell of 0.5 m of path.
    let front_db = db(at_path(&echoes[1204..1505], 0.6_f64.hypot(0.2625)).norm());
    assert!((front_db + 8.35).abs() < 1.5, "{front_db} dB");
    let back_db = db(at_path(&echoes[1204..1505], 0.62 + 0.48 * 5.0_f64.sqrt()).norm());
    assert!((back_db + 21.6).abs() < 2.5, "{back_db} dB");
}

#[test]
fn ghosts_show_where_the_truth_says() {
    let side = Reflector { from_m: [2.5, 0.5], to_m: [2.5, 9.0], reflection_db: -6.0 };
    let scene = Scene {
        targets: vec![standing(0.8, 5.0, TargetKind::Point)],
        reflectors: vec![side],
        ..Scene::default()
    };
    let none = Disturbance::default();
    let simulator =
        EchoSimulator::new(&scene, Se2::identity(), &Radar::default(), &none, 3).unwrap();
    let truth = simulator.truth(0, 0.0);
    assert_eq!(truth.visible, [true]);
    let clean = received(&Scene { reflectors: Vec::new(), ..scene.clone() }, &none);
    let samples = difference(&received(&scene, &none), &clean);
    let causes: Vec<Cause> = truth.ghosts.iter().map(|g| g.cause).collect();
    assert_eq!(causes, [Cause::OneBounce, Cause::TwoBounces]);
    let [one, two] = [truth.ghosts[0], truth.ghosts[1]];
    assert!((two.place.coords_m - Vector2::new(4.2, 5.0)).norm() < 1e-9);
    assert!((two.over_target_db + 12.0).abs() < 1e-9 && (one.over_target_db + 6.0).abs() < 1e-9);
    let two_db = db(at_place(&samples, &two.place.coords_m));
    assert!((two_db + 12.0).abs() < 1.5, "{two_db} dB");
    // Two ways of −6 dB each, spread over directions: the strongest on the arc of a range.
    let on_arc = |range_m: f64| {
        let places = (-16..=16).map(|k| (0.05 * f64::from(k)).sin_cos());
        let levels =
            places.map(|(sin, cos)| at_place(&samples, &(Vector2::new(sin, cos) * range_m)));
        levels.fold(0.0, f64::max)
    };
    let range_m = one.place.coords_m.norm();
    let one_db = db(on_arc(range_m));
    assert!((-9.0..0.1).contains(&one_db), "{one_db} dB");
    let strongest_m = (0..60)
        .map(|k| range_m - 0.6 + 0.02 * f64::from(k))
        .max_by(|a, b| on_arc(*a).total_cmp(&on_arc(*b)))
        .unwrap();
    assert!((strongest_m - range_m).abs() < 0.1, "{strongest_m} m for {range_m} m");
}

#[test]
fn a_person_who_steps_into_the_line_of_sight_moves_the_back_wall() {
    let back = Reflector { from_m: [-3.0, 9.0], to_m: [3.0, 9.0], reflection_db: -6.0 };
    let mut person = standing(0.0, 4.0, TargetKind::Body(Body::default()));
    person.amplitude_db = -120.0;
    let shadow = Some(Shadow::default());
    let scene = Scene { targets: vec![person], reflectors: vec![back], shadow, ..Scene::default() };
    let none = Disturbance::default();
    let mut aside = scene.clone();
    aside.targets[0].way_points[0].x_m = 2.5;
    let free = received(&Scene { targets: Vec::new(), ..scene.clone() }, &none);
    let left = difference(&received(&aside, &none), &free);
    let wall = Vector2::new(0.0, 9.0);
    assert!(db(at_place(&left, &wall)) < -80.0, "shades from 2.5 m aside");
    let change = difference(&received(&scene, &none), &free);
    // The wall's echo of 5 − 6 dB loses 12 dB, so 2.5 dB less than all of it change.
    let seen_db = db(at_place(&change, &wall));
    assert!((seen_db + 1.0 + 2.5).abs() < 1.0, "{seen_db} dB");
    for range_m in [3.0, 4.0, 6.0, 8.0] {
        assert!(db(at_place(&change, &Vector2::new(0.0, range_m))) < seen_db - 10.0);
    }
    let truth = |of: &Scene| {
        let pose = Se2::identity();
        let simulator = EchoSimulator::new(of, pose, &Radar::default(), &none, 3).unwrap();
        simulator.truth(0, 0.0)
    };
    let ghosts = truth(&scene).ghosts;
    let ghost = ghosts.iter().find(|g| g.cause == Cause::ShadedMirror).unwrap();
    assert!((ghost.place.coords_m - wall).norm() < 1e-3);
    assert!((ghost.over_target_db - 120.0 - seen_db).abs() < 0.5, "{}", ghost.over_target_db);
    assert!(truth(&aside).ghosts.iter().all(|g| g.cause != Cause::ShadedMirror));
}

#[test]
fn successive_frames_of_a_standing_person_are_coherent() {
    let scene = Scene {
        targets: vec![standing(0.5, 4.0, TargetKind::Body(Body::default()))],
        ..Scene::default()
    };
    let none = Disturbance::default();
    let simulator =
        EchoSimulator::new(&scene, Se2::identity(), &Radar::default(), &none, 3).unwrap();
    let frame = |k: u32| {
        let moment = Moment { period_index: u64::from(k), time_s: 0.1 * f64::from(k) };
        simulator.received(moment)
    };
    let mut least = 1.0_f64;
    for k in 0..40 {
        let (a, b) = (frame(k), frame(k + 1));
        let power = |s: &[Complex<f64>]| s.iter().map(|x| x.norm_sqr()).sum::<f64>();
        let product: Complex<f64> = a.iter().zip(&b).map(|(x, y)| x.conj() * y).sum();
        least = least.min(product.norm() / (power(&a) * power(&b)).sqrt());
    }
    assert!((0.95..0.999_999).contains(&least), "frames correlate by {least}");
}
