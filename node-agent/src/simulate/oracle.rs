//! A slow world, ray by ray, written another way, and the comparison with it.
//!
//! Rays through the wall are found by trial over the points where they enter and leave it, faces
//! reflect by Fresnel's sine formulas, bounce after bounce; images are mirrored coordinates; every
//! pair of ways is one exponential for every frequency.

use std::f64::consts::{PI, TAU};

use nalgebra::Vector2;
use proto::geom::{Node, Se2, World};
use proto::radar::Wall;
use rustfft::num_complex::Complex;

use super::echoes::Radar;
use super::streams::{Moment, Streams};
use super::*;

/// Errors of single ways and sums over the target's amplitude: -100 dB.
const TOLERANCE: f64 = 1e-5;
const LIGHT_M_PER_S: f64 = 299_792_458.0;

/// Wall of the tests: front at 0.3 m, 0.2 m thick.
const FRONT_M: f64 = 0.3;
const THICK_M: f64 = 0.2;
const INDEX: f64 = 2.2;
const CONDUCTIVITY: f64 = 0.02;

#[derive(Clone, Copy)]
struct Ray {
    path_m: f64,
    amplitude: f64,
}

/// Where `f` is least and its value there, by golden sections.
fn least(from: f64, to: f64, f: impl Fn(f64) -> f64) -> (f64, f64) {
    let keep = 0.5 * (5_f64.sqrt() - 1.0);
    let (mut low, mut high) = (from, to);
    let mut inner = high - keep * (high - low);
    let mut f_inner = f(inner);
    for _ in 0..44 {
        // `inner` divides the interval; the new point mirrors it.
        let other = low + high - inner;
        let f_other = f(other);
        let other_is_lower = f_other < f_inner;
        let (kept, dropped) = if other_is_lower { (other, inner) } else { (inner, other) };
        if dropped < kept {
            low = dropped
        } else {
            high = dropped
        }
        if other_is_lower {
            (inner, f_inner) = (other, f_other);
        }
    }
    (inner, f_inner)
}

/// A ray `across_m` aside through `before_m` of air, `crossings` of the wall and `after_m` of air.
fn ray(across_m: f64, before_m: f64, crossings: i32, after_m: f64) -> Ray {
    let aside_m = across_m.abs();
    let total_m = |enter_m: f64, each_m: f64| {
        let rest_m = aside_m - enter_m - f64::from(crossings) * each_m;
        enter_m.hypot(before_m)
            + INDEX * f64::from(crossings) * each_m.hypot(THICK_M)
            + rest_m.hypot(after_m)
    };
    let inner = |enter_m: f64| {
        least(0.0, (aside_m - enter_m) / f64::from(crossings), |each_m| total_m(enter_m, each_m))
    };
    let (enter_m, path_m) = least(0.0, aside_m, |enter_m| inner(enter_m).1);
    let each_m = inner(enter_m).0;
    let (outside, inside) = ((enter_m / before_m).atan(), (each_m / THICK_M).atan());
    let alpha = 0.5 * CONDUCTIVITY * (4e-7 * PI / 8.854_187_812_8e-12_f64).sqrt() / INDEX;
    let loss = (-alpha * each_m.hypot(THICK_M)).exp();
    let sum = (outside + inside).sin();
    let (reflected, passed) = if sum < 1e-6 {
        ((1.0 - INDEX) / (1.0 + INDEX), 4.0 * INDEX / (1.0 + INDEX).powi(2))
    } else {
        let there = 2.0 * inside.sin() * outside.cos() / sum;
        let back = 2.0 * outside.sin() * inside.cos() / sum;
        (-(outside - inside).sin() / sum, there * back)
    };
    let mut amplitude = passed * loss;
    for _ in 1..crossings {
        amplitude *= -reflected * loss;
    }
    if crossings == 0 {
        amplitude = reflected;
    }
    Ray { path_m, amplitude }
}

/// The front face's own echo: one straight ray to a mirrored antenna, and its reflection.
fn front_echo(across_m: f64, air_m: f64) -> Ray {
    let outside = (across_m.abs() / air_m).atan();
    let inside = (outside.sin() / INDEX).asin();
    let amplitude = if outside < 1e-9 {
        (1.0 - INDEX) / (1.0 + INDEX)
    } else {
        -(outside - inside).sin() / (outside + inside).sin()
    };
    Ray { path_m: across_m.hypot(air_m), amplitude }
}

/// To `place`, with `passes` more inside.
fn way(antenna: &Vector2<f64>, place: &Vector2<f64>, passes: i32) -> Ray {
    let after_m = place.y - FRONT_M - THICK_M;
    ray(place.x - antenna.x, FRONT_M - antenna.y, 2 * passes + 1, after_m)
}

fn rays(antenna: &Vector2<f64>, place: &Vector2<f64>) -> [Ray; 2] {
    [way(antenna, place, 0), way(antenna, place, 1)]
}

/// The ends of a mirror and its reflection coefficient.
type Flat = (Vector2<f64>, Vector2<f64>, f64);

fn mirrored(place: &Vector2<f64>, (a, b, _): &Flat) -> Vector2<f64> {
    // The line n · x = c.
    let n = Vector2::new(b.y - a.y, a.x - b.x).normalize();
    place - n * (2.0 * (n.dot(place) - n.dot(a)))
}

fn add(samples: &mut [Complex<f64>], radar: &Radar, path_m: f64, gain: Complex<f64>) {
    for (k, sample) in samples.iter_mut().enumerate() {
        let hz = radar.band.start_hz + k as f64 * radar.band.step_hz;
        *sample += gain * Complex::from_polar(1.0, -TAU * hz * path_m / LIGHT_M_PER_S);
    }
}

fn shade(from: &Vector2<f64>, to: &Vector2<f64>, person: &Vector2<f64>) -> f64 {
    let nearest = least(0.0, 1.0, |share| (from + (to - from) * share - person).norm()).1;
    1.0 - (1.0 - 10_f64.powf(-8.0 / 20.0)) * (-nearest * nearest / (2.0 * 0.2 * 0.2)).exp()
}

/// World places in the frame of the tests' node, at (3, −1) and turned by 0.1 rad.
fn in_node(x_m: f64, y_m: f64) -> Vector2<f64> {
    let (dx, dy) = (x_m - 3.0, y_m + 1.0);
    let (sin, cos) = 0.1_f64.sin_cos();
    Vector2::new(cos * dx + sin * dy, -sin * dx + cos * dy)
}

const MIRRORS: [([f64; 2], [f64; 2], f64); 2] =
    [([-1.0, 0.5], [-1.2, 9.0], -5.0), ([-1.0, 9.5], [7.0, 10.0], -3.0)];
const CLUTTER: [[f64; 2]; 2] = [[2.0, 5.0], [4.5, 7.0]];

fn everything() -> (Scene, Disturbance) {
    let walk = |x_m: f64, y_m: f64| {
        vec![WayPoint { time_s: 0.0, x_m, y_m }, WayPoint { time_s: 4.0, x_m: x_m + 1.0, y_m: 6.0 }]
    };
    let target = |x_m, y_m, kind| Target { way_points: walk(x_m, y_m), kind, amplitude_db: 3.0 };
    let reflector = |(from_m, to_m, reflection_db)| Reflector { from_m, to_m, reflection_db };
    let clutter = |[x_m, y_m]: [f64; 2]| Clutter { x_m, y_m, amplitude_db: 20.0 };
    let scene = Scene {
        targets: vec![
            target(2.0, 3.0, TargetKind::Point),
            target(3.0, 3.5, TargetKind::Body(Body::default())),
            target(1.0, 4.0, TargetKind::Person),
        ],
        clutter: CLUTTER.map(clutter).to_vec(),
        amplitude_law: AmplitudeLaw::InverseSquare,
        wall: Some(Wall { thickness_m: THICK_M, permittivity: INDEX * INDEX }),
        wall_effects: WallEffects {
            stand_off_m: FRONT_M,
            transmission: Transmission::Fresnel,
            conductivity_s_per_m: CONDUCTIVITY,
            inner_pass_count: 1,
            face_echo_count: 4,
        },
        reflectors: MIRRORS.map(reflector).to_vec(),
        shadow: Some(Shadow { loss_db: 8.0, half_width_m: 0.2 }),
        specular_db: 7.0,
    };
    let disturbance = Disturbance {
        false_point_probability: 1.0,
        coupling: Some(Coupling::default()),
        phase_noise: PhaseNoise { common_rad: 0.1, channel_rad: 0.05, walk_rad_per_sqrt_s: 0.2 },
        gain_drift: GainDrift { trend_db_per_min: 1.0, rms_db: 0.5, correlation_s: 10.0 },
        ..Disturbance::default()
    };
    (scene, disturbance)
}

fn pose() -> Se2<World, Node> {
    Se2::new(3.0, -1.0, 0.1)
}

/// One channel of the slow world.
struct SlowChannel<'a> {
    tx: Vector2<f64>,
    rx: Vector2<f64>,
    flats: &'a [Flat],
    people: &'a [Vector2<f64>],
}

impl SlowChannel<'_> {
    fn shaded(&self, place: &Vector2<f64>) -> f64 {
        let left = |p: &Vector2<f64>| shade(&self.tx, place, p) * shade(&self.rx, place, p);
        self.people.iter().map(left).product()
    }

    /// Straight and over the mirrors.
    fn ways(&self, antenna: &Vector2<f64>, place: &Vector2<f64>) -> Vec<Ray> {
        let mut all = rays(antenna, place).to_vec();
        for flat in self.flats {
            let image = mirrored(place, flat);
            let weight = flat.2 * place.norm() / image.norm();
            let weighted = |r: Ray| Ray { amplitude: r.amplitude * weight, ..r };
            all.extend(rays(antenna, &image).map(weighted));
        }
        all
    }

    fn target(&self, place: &Vector2<f64>) -> Vec<Ray> {
        pairs(&self.ways(&self.tx, place), &self.ways(&self.rx, place))
    }

    fn thing(&self, place: &Vector2<f64>) -> Vec<Ray> {
        let shaded = self.shaded(place);
        let left = |r: Ray| Ray { amplitude: r.amplitude * shaded, ..r };
        self.unshaded(place).into_iter().map(left).collect()
    }

    fn unshaded(&self, place: &Vector2<f64>) -> Vec<Ray> {
        pairs(&rays(&self.tx, place), &rays(&self.rx, place))
    }

    fn faces(&self) -> Vec<Ray> {
        let across_m = self.rx.x - self.tx.x;
        let mut all = vec![front_echo(across_m, 2.0 * FRONT_M)];
        all.extend((1..4).map(|back| ray(across_m, FRONT_M, 2 * back, FRONT_M)));
        all
    }

    fn mirror(&self, flat: &Flat) -> Vec<Ray> {
        let point = |share: f64| flat.0 + (flat.1 - flat.0) * share;
        let over = |share: f64, (there, back): (i32, i32)| {
            let (a, b) = (way(&self.tx, &point(share), there), way(&self.rx, &point(share), back));
            Ray { path_m: a.path_m + b.path_m, amplitude: a.amplitude * b.amplitude }
        };
        let best = |passes| least(0.0, 1.0, |share| over(share, passes).path_m).0;
        let shaded = self.shaded(&point(best((0, 0)))) * flat.2;
        let mut all = Vec::new();
        for passes in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let share = best(passes);
            let echo = over(share, passes);
            if (1e-6..=1.0 - 1e-6).contains(&share) {
                all.push(Ray { amplitude: echo.amplitude * shaded, ..echo });
            }
        }
        all
    }
}

fn pairs(there: &[Ray], back: &[Ray]) -> Vec<Ray> {
    let pair = |a: &Ray, b: &Ray| Ray {
        path_m: a.path_m + b.path_m,
        amplitude: a.amplitude * b.amplitude,
    };
    there.iter().flat_map(|a| back.iter().map(move |b| pair(a, b))).collect()
}

/// All of the scene; `targets` are scatterers, and `people` shade what stands.
fn slow_world(
    simulator: &EchoSimulator,
    targets: &[(Vector2<f64>, Complex<f64>)],
    people: &[Vector2<f64>],
) -> Vec<Complex<f64>> {
    let radar = Radar::default();
    let flat = |(a, b, db): &([f64; 2], [f64; 2], f64)| {
        (in_node(a[0], a[1]), in_node(b[0], b[1]), -(10_f64.powf(db / 20.0)))
    };
    let flats: Vec<Flat> = MIRRORS.iter().map(flat).collect();
    let phantom = simulator.false_target(3).unwrap().coords_m;
    let reference = simulator.reference_amplitude();
    let mut samples = vec![Complex::new(0.0, 0.0); 8 * 301];
    for (channel, sum) in samples.chunks_exact_mut(301).enumerate() {
        let tx = radar.array.tx_m[channel / 4].into();
        let rx = radar.array.rx_m[channel % 4].into();
        let slow = SlowChannel { tx, rx, flats: &flats, people };
        let mut echo = |rays: Vec<Ray>, gain: Complex<f64>| {
            rays.iter().for_each(|r| add(sum, &radar, r.path_m, gain * r.amplitude));
        };
        targets.iter().for_each(|(place, gain)| echo(slow.target(place), *gain));
        echo(slow.unshaded(&phantom), Complex::from(1.0 / phantom.norm_squared()));
        for [x_m, y_m] in CLUTTER {
            let place = in_node(x_m, y_m);
            echo(slow.thing(&place), Complex::from(10.0 / place.norm_squared()));
        }
        for r in slow.faces().into_iter().chain(flats.iter().flat_map(|f| slow.mirror(f))) {
            echo(vec![r], Complex::from(10_f64.powf(7.0 / 20.0) * 2.0 / r.path_m));
        }
        let distance_m = (tx.x - rx.x).abs();
        for wave in Coupling::default().waves(channel, distance_m, reference, &Streams::new(5)) {
            add(sum, &radar, wave.path_m, wave.gain);
        }
    }
    samples
}

fn largest_difference(a: &[Complex<f64>], b: &[Complex<f64>]) -> f64 {
    assert_eq!(a.len(), b.len());
    assert!(
        a.iter().all(|s| s.is_finite()),
        "first at {:?}",
        a.iter().position(|s| !s.is_finite())
    );
    assert!(b.iter().all(|s| s.is_finite()), "slow at {:?}", b.iter().position(|s| !s.is_finite()));
    a.iter().zip(b).map(|(x, y)| (x - y).norm()).fold(0.0, f64::max)
}

#[test]
fn a_scene_with_everything_on_is_that_of_the_slow_world() {
    let (scene, disturbance) = everything();
    let simulator = EchoSimulator::new(&scene, pose(), &Radar::default(), &disturbance, 5).unwrap();
    let moment = Moment { period_index: 3, time_s: 1.3 };
    let scatterers: Vec<_> =
        simulator.scatterers(3, 1.3).iter().map(|s| (s.place_m, s.gain)).collect();
    assert_eq!(scatterers.len(), 1 + 14 + 6);
    let share = 1.3 / 4.0;
    let people = [in_node(3.0 + share, 3.5 + 2.5 * share), in_node(1.0 + share, 4.0 + 2.0 * share)];
    let mut want = slow_world(&simulator, &scatterers, &people);
    let turns = receiver::factors(
        &disturbance.phase_noise,
        &disturbance.gain_drift,
        &Streams::new(5),
        moment,
        8,
    );
    let turns = turns.unwrap();
    for (index, sample) in want.iter_mut().enumerate() {
        *sample *= turns[index / 301];
    }
    let got = simulator.received(moment);
    let reference = simulator.reference_amplitude();
    let worst = largest_difference(&got, &want);
    assert!(worst < TOLERANCE * reference, "{} dB", 20.0 * (worst / reference).log10());
    // Each part is there: without it the comparison fails by far.
    let parts: [fn(&mut Scene); 4] = [
        |s| s.wall_effects.inner_pass_count = 0,
        |s| s.wall_effects.face_echo_count = 3,
        |s| s.reflectors.truncate(1),
        |s| s.shadow = None,
    ];
    for (index, change) in parts.iter().enumerate() {
        let mut less = scene.clone();
        change(&mut less);
        let other = EchoSimulator::new(&less, pose(), &Radar::default(), &disturbance, 5)
            .unwrap()
            .received(moment);
        let off = largest_difference(&other, &want);
        assert!(1e-3 * reference < off, "part {index} makes {off} only");
    }
}

#[test]
fn a_way_over_a_mirror_is_the_shortest_over_all_its_points() {
    let flat: Flat = (Vector2::new(2.0, 1.0), Vector2::new(2.6, 9.0), -1.0);
    let mirror = mirrors::Mirror::new(flat.0, flat.1, -6.0);
    let (antenna, place) = (Vector2::new(0.1, 0.0), Vector2::new(0.5, 4.0));
    let over = |share: f64| {
        let point = flat.0 + (flat.1 - flat.0) * share;
        way(&antenna, &point, 0).path_m + (place - point).norm()
    };
    let want_m = least(0.0, 1.0, over).1;
    let wall = Wall { thickness_m: THICK_M, permittivity: INDEX * INDEX };
    let effects = WallEffects { stand_off_m: FRONT_M, ..WallEffects::default() };
    let slab = slab::Slab::new(Some(wall), effects);
    let got_m = slab.leg(&antenna, &mirror.image(&place).unwrap(), 0).path_m;
    assert!((got_m - want_m).abs() < 1e-9, "{got_m} for {want_m}");
}
