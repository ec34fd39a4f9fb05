//! The sweeps a node takes of a scene, and the truth about them.
//!
//! `S_tr(f) = Σ a exp(−j 2π f (τ_t + τ_r)) + noise`, over all scatterers before the array, with the
//! delays of [`leg_path_m`]. A sweep is a function of the seed, the period and the time alone.
//! Cost `scatterers · channels · frequencies`.

use std::f64::consts::{FRAC_1_SQRT_2, TAU};

use nalgebra::Vector2;
use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};
use rand_distr::{Distribution, StandardNormal};
use rustfft::num_complex::Complex;
use serde::{Deserialize, Serialize};

use proto::geom::{Node, Point, Se2, World};
use proto::radar::{Array, Band, Grid, SPEED_OF_LIGHT_M_PER_S};

use crate::imaging::wall::leg_path_m;
use crate::imaging::{InvalidSetting, Sweep, single};

use super::noise::{Disturbance, from_db};
use super::scene::{Scene, Target, TargetKind};

/// Scatterers of a person.
const BODY_SCATTERER_COUNT: usize = 6;
/// Half the depth (along the walk) and half the width of a person, metres.
const BODY_HALF_AXES_M: (f64, f64) = (0.14, 0.25);
/// A scatterer this much nearer to the node is brighter by a factor e of amplitude, metres: 24 dB
/// from the back of a body to its front.
const BODY_SHADE_M: f64 = 0.1;
/// False targets lie at least this far before the array, metres: nearer ones are not detected.
const MIN_FALSE_DEPTH_M: f64 = 0.5;

/// The radar whose sweeps are made.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Radar {
    /// Frequencies.
    pub band: Band,
    /// Antennas.
    pub array: Array,
    /// Where false targets can be.
    pub grid: Grid,
}

/// A node at a known pose in a known scene.
#[derive(Clone, Debug)]
pub struct EchoSimulator {
    scene: Scene,
    node_from_world: Se2<Node, World>,
    radar: Radar,
    disturbance: Disturbance,
    seed: u64,
}

/// What a stream of random numbers is for.
#[derive(Clone, Copy)]
enum Purpose {
    Noise = 0,
    Missed = 1,
    False = 2,
    BodyShape = 3,
    BodyGain = 4,
}

/// One thing that reflects, in the node's frame.
struct Scatterer {
    place_m: Vector2<f64>,
    gain: Complex<f64>,
}

impl EchoSimulator {
    /// A node at `pose_world_from_node` that looks at `scene`. Give every node a seed of its own:
    /// misses, false targets and noise follow from it.
    ///
    /// # Errors
    /// Names the first setting that makes no sense.
    pub fn new(
        scene: &Scene,
        pose_world_from_node: Se2<World, Node>,
        radar: &Radar,
        disturbance: &Disturbance,
        seed: u64,
    ) -> Result<Self, InvalidSetting> {
        scene.check()?;
        radar.band.check()?;
        radar.array.check()?;
        radar.grid.check()?;
        disturbance.check()?;
        Ok(Self {
            scene: scene.clone(),
            node_from_world: pose_world_from_node.inverse(),
            radar: radar.clone(),
            disturbance: *disturbance,
            seed,
        })
    }

    /// The sweep of period `period_index`, taken at `time_s`.
    #[must_use]
    pub fn sweep(&self, period_index: u64, time_s: f64) -> Sweep {
        let (array, step_count) = (&self.radar.array, self.radar.band.step_count);
        let mut samples = vec![Complex::new(0.0, 0.0); array.channel_count() * step_count];
        for scatterer in self.scatterers(period_index, time_s) {
            let legs = |antennas: &[[f64; 2]]| -> Vec<f64> {
                antennas.iter().map(|antenna| self.leg_m(antenna, &scatterer.place_m)).collect()
            };
            let (tx_m, rx_m) = (legs(&array.tx_m), legs(&array.rx_m));
            let paths_m = tx_m.iter().flat_map(|tx| rx_m.iter().map(move |rx| tx + rx));
            for (channel, path_m) in samples.chunks_exact_mut(step_count).zip(paths_m) {
                self.add_echo(channel, path_m, scatterer.gain);
            }
        }
        self.add_noise(&mut samples, period_index);
        let samples = samples.iter().map(|s| Complex::new(single(s.re), single(s.im))).collect();
        Sweep { time_s, samples }
    }

    /// Where the middles of all targets are at `time_s`, in the order of the scene, also of those
    /// that are missed or outside the image.
    #[must_use]
    pub fn targets_in_node(&self, time_s: f64) -> Vec<Point<Node>> {
        let in_node = |target: &Target| self.node_from_world * target.position(time_s);
        self.scene.targets.iter().map(in_node).collect()
    }

    /// Whether target number `target_index` shows in period `period_index`.
    #[must_use]
    pub fn is_visible(&self, target_index: usize, period_index: u64) -> bool {
        let mut rng = self.stream(Purpose::Missed, target_index, period_index);
        rng.random::<f64>() < self.disturbance.detection_probability
    }

    /// Where the false target of period `period_index` is, if there is one.
    #[must_use]
    pub fn false_target(&self, period_index: u64) -> Option<Point<Node>> {
        let mut rng = self.stream(Purpose::False, 0, period_index);
        let shows = rng.random::<f64>() < self.disturbance.false_point_probability;
        let (across, along) = (rng.random::<f64>(), rng.random::<f64>());
        let grid = &self.radar.grid;
        let near_m = grid.y_min_m.max(MIN_FALSE_DEPTH_M);
        let far_m = grid.y_m(grid.row_count - 1).max(near_m);
        let width_m = grid.x_m(grid.column_count - 1) - grid.x_min_m;
        let place = Point::new(grid.x_min_m + across * width_m, near_m + along * (far_m - near_m));
        shows.then_some(place)
    }

    /// The largest amplitude a target reaches anywhere on its way; 1 without targets.
    ///
    /// It does not depend on time, as a receiver's noise does not.
    #[must_use]
    pub fn reference_amplitude(&self) -> f64 {
        let strongest = |target: &Target| {
            let nearest_m = self.nearest_m(target);
            self.scene.amplitude_law.amplitude(nearest_m) * from_db(target.amplitude_db).sqrt()
        };
        self.scene.targets.iter().map(strongest).reduce(f64::max).unwrap_or(1.0)
    }

    /// How near the middle of `target` comes to the array's centre, metres.
    fn nearest_m(&self, target: &Target) -> f64 {
        let node_m = self.node_from_world.inverse().translation_m();
        let places: Vec<Vector2<f64>> =
            target.way_points.iter().map(|p| Vector2::new(p.x_m, p.y_m)).collect();
        let of_leg = |leg: &[Vector2<f64>]| {
            let along = leg[1] - leg[0];
            let share = (node_m - leg[0]).dot(&along) / along.norm_squared().max(f64::MIN_POSITIVE);
            (leg[0] + along * share.clamp(0.0, 1.0) - node_m).norm()
        };
        let standing_m = (places[0] - node_m).norm();
        places.windows(2).map(of_leg).fold(standing_m, f64::min)
    }

    fn scatterers(&self, period_index: u64, time_s: f64) -> Vec<Scatterer> {
        let mut all = Vec::new();
        for (index, target) in self.scene.targets.iter().enumerate() {
            let middle = self.node_from_world * target.position(time_s);
            if !self.is_visible(index, period_index) {
                continue;
            }
            match target.kind {
                TargetKind::Point => all.push(self.scatterer(middle, target.amplitude_db)),
                TargetKind::Person => all.extend(self.body(index, period_index, time_s)),
            }
        }
        for clutter in &self.scene.clutter {
            let place = self.node_from_world * Point::new(clutter.x_m, clutter.y_m);
            all.push(self.scatterer(place, clutter.amplitude_db));
        }
        all.extend(self.false_target(period_index).map(|place| self.scatterer(place, 0.0)));
        let wall_m = self.scene.wall.map_or(0.0, |wall| wall.thickness_m);
        all.retain(|scatterer| wall_m < scatterer.place_m.y);
        all
    }

    fn scatterer(&self, place: Point<Node>, amplitude_db: f64) -> Scatterer {
        let law = self.scene.amplitude_law.amplitude(place.coords_m.norm());
        let gain = Complex::new(law * from_db(amplitude_db).sqrt(), 0.0);
        Scatterer { place_m: place.coords_m, gain }
    }

    /// The scatterers of a person: fixed places on the body, Gaussian gains of this period whose
    /// mean power is that of a point.
    fn body(&self, target_index: usize, period_index: u64, time_s: f64) -> Vec<Scatterer> {
        let target = &self.scene.targets[target_index];
        let whole =
            self.scatterer(self.node_from_world * target.position(time_s), target.amplitude_db);
        let ahead = self.node_from_world.rotation() * target.direction(time_s);
        let aside = Vector2::new(-ahead.y, ahead.x);
        let towards_node = -whole.place_m.normalize();
        let mut shape = self.stream(Purpose::BodyShape, target_index, 0);
        let mut gains = self.stream(Purpose::BodyGain, target_index, period_index);
        let mut body = Vec::new();
        let mut power = 0.0;
        for _ in 0..BODY_SCATTERER_COUNT {
            let (radius, angle) = (shape.random::<f64>().sqrt(), TAU * shape.random::<f64>());
            let (half_depth_m, half_width_m) = BODY_HALF_AXES_M;
            let offset_m = ahead * (half_depth_m * radius * angle.cos())
                + aside * (half_width_m * radius * angle.sin());
            let shade = (offset_m.dot(&towards_node) / BODY_SHADE_M).exp();
            power += shade * shade;
            let gain = whole.gain * gaussian(&mut gains) * shade;
            body.push(Scatterer { place_m: whole.place_m + offset_m, gain });
        }
        for scatterer in &mut body {
            scatterer.gain /= power.sqrt();
        }
        body
    }

    fn leg_m(&self, antenna: &[f64; 2], place_m: &Vector2<f64>) -> f64 {
        leg_path_m(place_m.x - antenna[0], place_m.y - antenna[1], self.scene.wall.as_ref())
    }

    fn add_echo(&self, channel: &mut [Complex<f64>], path_m: f64, gain: Complex<f64>) {
        let delay_s = path_m / SPEED_OF_LIGHT_M_PER_S;
        let mut echo = gain * Complex::cis(-TAU * self.radar.band.start_hz * delay_s);
        let step = Complex::cis(-TAU * self.radar.band.step_hz * delay_s);
        for sample in channel {
            *sample += echo;
            echo *= step;
        }
    }

    fn add_noise(&self, samples: &mut [Complex<f64>], period_index: u64) {
        let step_count = self.radar.band.step_count;
        let noise = &self.disturbance.noise;
        let amplitude = noise.power_per_frequency(self.reference_amplitude(), step_count).sqrt();
        let mut rng = self.stream(Purpose::Noise, 0, period_index);
        for sample in samples {
            *sample += gaussian(&mut rng) * amplitude;
        }
    }

    /// Random numbers that depend on nothing but the seed and the arguments.
    fn stream(&self, purpose: Purpose, target_index: usize, period_index: u64) -> ChaCha8Rng {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let target = (target_index as u64) & 0xffff;
        rng.set_stream((period_index << 20) | (target << 4) | purpose as u64);
        rng
    }
}

/// A circular complex Gaussian number of power 1.
fn gaussian(rng: &mut ChaCha8Rng) -> Complex<f64> {
    let (re, im): (f64, f64) = (StandardNormal.sample(rng), StandardNormal.sample(rng));
    Complex::new(re, im) * FRAC_1_SQRT_2
}

#[cfg(test)]
mod tests {
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
                let path_m =
                    leg_path_m(x_m - tx[0], *y_m, wall) + leg_path_m(x_m - rx[0], *y_m, wall);
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
        let power =
            difference.iter().map(|d| f64::from(d.norm_sqr())).sum::<f64>() / 2408.0 / 301.0;
        assert!((power / (amplitude.powi(2) / 10_f64.powf(0.8)) - 1.0).abs() < 0.1);
    }

    #[test]
    fn sweeps_depend_on_seed_period_and_time_alone() {
        let mut person = standing(6.0, 4.0);
        person.kind = TargetKind::Person;
        let scene = Scene { targets: vec![person, standing(3.0, 6.0)], ..Scene::default() };
        let noise = Noise::InBand { snr_db: 8.0 };
        let disturbance =
            Disturbance { noise, detection_probability: 0.5, false_point_probability: 0.5 };
        let (early, late) = (simulator(&scene, disturbance), simulator(&scene, disturbance));
        let sweeps: Vec<Sweep> = (0..6).map(|k| early.sweep(k, 0.1 * k as f64)).collect();
        assert_eq!(late.sweep(5, 0.5), sweeps[5]);
        assert_eq!(late.sweep(2, 0.2), sweeps[2]);
        assert_ne!(late.sweep(3, 0.2), sweeps[2]);
    }

    #[test]
    fn misses_and_false_targets_come_as_often_as_asked_and_show_in_the_sweep() {
        let scene =
            Scene { targets: vec![standing(6.0, 4.0), standing(3.0, 6.0)], ..Scene::default() };
        let disturbance = Disturbance {
            noise: Noise::None,
            detection_probability: 0.8,
            false_point_probability: 0.1,
        };
        let simulator = simulator(&scene, disturbance);
        let period_count = 4000_u32;
        let seen = |target| {
            (0..u64::from(period_count)).filter(|k| simulator.is_visible(target, *k)).count()
        };
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
}
