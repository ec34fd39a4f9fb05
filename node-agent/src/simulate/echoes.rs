//! The sweeps a node takes of a scene.
//!
//! `S_tr(f) = Σ g G_t(f) G_r(f) + static echoes`, over all scatterers before the array, with the
//! one-way responses `G_a(f) = Σ_v A_v exp(−j 2π f τ_av)` over the ways `v` from antenna `a` to the
//! scatterer: straight, over each mirror, and each with passes inside the wall. So an echo that
//! comes back over another way than it went is there too. The receiver's factors and its noise
//! follow. Amplitude laws take distances from the array's centre, over a mirror those of the
//! image, and their root for each way. A sweep is a function of the seed, the period and the time
//! alone. Cost `scatterers · frequencies · (antennas · ways + channels)`.

use crate::imaging::{from_db, single_complex};
use std::f64::consts::TAU;

use nalgebra::Vector2;
use rand::RngExt;
use rustfft::num_complex::Complex;
use serde::{Deserialize, Serialize};

use proto::geom::{Node, Point, Se2, World};
use proto::radar::{Array, Band, Grid};

use crate::imaging::{InvalidSetting, Sweep};

use super::body::Walker;
use super::mirrors::Mirror;
use super::noise::Disturbance;
use super::receiver::factors;
use super::scene::{Scene, Target, TargetKind};
use super::slab::Slab;
use super::spectra::Spectra;
use super::steady::Steady;
use super::streams::{Moment, Purpose, Streams, gaussian};

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
    pub(super) scene: Scene,
    pub(super) node_from_world: Se2<Node, World>,
    pub(super) radar: Radar,
    pub(super) disturbance: Disturbance,
    pub(super) streams: Streams,
    pub(super) slab: Slab,
    pub(super) mirrors: Vec<Mirror>,
    /// What moves on legs, for targets that do.
    walkers: Vec<Option<Walker>>,
    pub(super) steady: Steady,
}

/// One thing that reflects, in the node's frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scatterer {
    pub(super) place_m: Vector2<f64>,
    pub(super) gain: Complex<f64>,
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
        let node_from_world = pose_world_from_node.inverse();
        let streams = Streams::new(seed);
        let in_node = |[x_m, y_m]: [f64; 2]| (node_from_world * Point::new(x_m, y_m)).coords_m;
        let mirrors = scene
            .reflectors
            .iter()
            .map(|r| Mirror::new(in_node(r.from_m), in_node(r.to_m), r.reflection_db));
        let walker = |(index, target): (usize, &Target)| match &target.kind {
            TargetKind::Body(body) => Some(Walker::new(body, index, &target.way_points, &streams)),
            TargetKind::Point | TargetKind::Person => None,
        };
        let channel_count = radar.array.channel_count();
        let nothing = Steady::none(Spectra::zeros(channel_count, &radar.band));
        let mut simulator = Self {
            node_from_world,
            radar: radar.clone(),
            disturbance: *disturbance,
            streams,
            slab: Slab::new(scene.wall, scene.wall_effects),
            mirrors: mirrors.collect(),
            walkers: scene.targets.iter().enumerate().map(walker).collect(),
            steady: nothing,
            scene: scene.clone(),
        };
        simulator.steady = simulator.steady_echoes();
        Ok(simulator)
    }

    /// The sweep of period `period_index`, taken at `time_s`.
    #[must_use]
    pub fn sweep(&self, period_index: u64, time_s: f64) -> Sweep {
        let mut samples = self.received(Moment { period_index, time_s });
        self.add_noise(&mut samples, period_index);
        let samples = samples.into_iter().map(single_complex).collect();
        Sweep { time_s, samples }
    }

    /// What the receivers get, before their noise and in double precision.
    pub(super) fn received(&self, moment: Moment) -> Vec<Complex<f64>> {
        let mut sums = self.steady_at(moment);
        let mut ways = self.no_ways();
        for scatterer in self.scatterers(moment.period_index, moment.time_s) {
            self.add_scatterer(&mut sums, &mut ways, &scatterer, &self.mirrors);
        }
        if let Some(scatterer) = self.false_scatterer(moment.period_index) {
            self.add_scatterer(&mut sums, &mut ways, &scatterer, &[]);
        }
        let Disturbance { phase_noise, gain_drift, .. } = &self.disturbance;
        let channel_count = self.radar.array.channel_count();
        let turned = factors(phase_noise, gain_drift, &self.streams, moment, channel_count);
        for (channel, factor) in turned.into_iter().flatten().enumerate() {
            sums.scale(channel, factor);
        }
        sums.samples(self.radar.band.step_count)
    }

    /// Where the middles of all targets are at `time_s`, in the order of the scene, also of those
    /// that are missed or outside the image. Sway and swinging limbs are left out.
    #[must_use]
    pub fn targets_in_node(&self, time_s: f64) -> Vec<Point<Node>> {
        let in_node = |target: &Target| self.node_from_world * target.position(time_s);
        self.scene.targets.iter().map(in_node).collect()
    }

    /// Where what the targets reflect comes from on average at `time_s`, in the order of the scene:
    /// the places of the scatterers of a [`TargetKind::Body`], each counted with its mean power.
    /// Other targets have no shape that lasts, and are given their middles.
    #[must_use]
    pub fn shining_in_node(&self, time_s: f64) -> Vec<Point<Node>> {
        let middles = self.targets_in_node(time_s).into_iter();
        let shining = middles.zip(&self.walkers).map(|(middle, walker)| {
            let towards_node = self.towards_node(&middle.coords_m);
            walker.as_ref().map_or(middle, |walker| {
                let place_m = walker.shine_m(time_s, &towards_node);
                self.node_from_world * Point::from_coords(place_m)
            })
        });
        shining.collect()
    }

    /// The direction from `place_m` in the node's frame to the node, in the world.
    fn towards_node(&self, place_m: &Vector2<f64>) -> Vector2<f64> {
        -(self.node_from_world.rotation().transpose() * place_m).normalize()
    }

    /// Whether target number `target_index` shows in period `period_index`.
    #[must_use]
    pub fn is_visible(&self, target_index: usize, period_index: u64) -> bool {
        let mut rng = self.streams.rng(Purpose::Missed, target_index, period_index);
        rng.random::<f64>() < self.disturbance.detection_probability
    }

    /// Where the false target of period `period_index` is, if there is one.
    #[must_use]
    pub fn false_target(&self, period_index: u64) -> Option<Point<Node>> {
        let mut rng = self.streams.rng(Purpose::False, 0, period_index);
        let shows = rng.random::<f64>() < self.disturbance.false_point_probability;
        let (across, along) = (rng.random::<f64>(), rng.random::<f64>());
        let grid = &self.radar.grid;
        let near_m = grid.y_min_m.max(MIN_FALSE_DEPTH_M);
        let far_m = grid.y_m(grid.row_count - 1).max(near_m);
        let width_m = grid.x_m(grid.column_count - 1) - grid.x_min_m;
        let place = Point::new(grid.x_min_m + across * width_m, near_m + along * (far_m - near_m));
        shows.then_some(place)
    }

    /// The largest amplitude a target reaches anywhere on its way, behind the wall as seen
    /// straight through it; 1 without targets and wall.
    ///
    /// It does not depend on time, as a receiver's noise does not.
    #[must_use]
    pub fn reference_amplitude(&self) -> f64 {
        let strongest = |target: &Target| {
            let nearest_m = self.nearest_m(target);
            self.scene.amplitude_law.amplitude(nearest_m) * from_db(target.amplitude_db).sqrt()
        };
        let amplitude = self.scene.targets.iter().map(strongest).reduce(f64::max).unwrap_or(1.0);
        amplitude * self.slab.normal_amplitude().powi(2)
    }

    /// How near the middle of `target` comes to the array's centre, metres.
    fn nearest_m(&self, target: &Target) -> f64 {
        let node_m = self.node_m();
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

    /// Where the array's centre is in the world.
    fn node_m(&self) -> Vector2<f64> {
        self.node_from_world.inverse().translation_m()
    }

    /// What the targets that are seen consist of.
    pub(super) fn scatterers(&self, period_index: u64, time_s: f64) -> Vec<Scatterer> {
        let mut all = Vec::new();
        for (index, target) in self.scene.targets.iter().enumerate() {
            if !self.is_visible(index, period_index) {
                continue;
            }
            let whole =
                self.scatterer(self.node_from_world * target.position(time_s), target.amplitude_db);
            let moment = Moment { period_index, time_s };
            match &self.walkers[index] {
                Some(walker) => all.extend(self.walking(walker, &whole, moment)),
                None if target.kind == TargetKind::Person => {
                    all.extend(self.body(index, &whole, moment));
                }
                None => all.push(whole),
            }
        }
        all.retain(|scatterer| self.slab.is_open(&scatterer.place_m));
        all
    }

    fn false_scatterer(&self, period_index: u64) -> Option<Scatterer> {
        let place = self.false_target(period_index)?;
        Some(self.scatterer(place, 0.0)).filter(|s| self.slab.is_open(&s.place_m))
    }

    pub(super) fn scatterer(&self, place: Point<Node>, amplitude_db: f64) -> Scatterer {
        let law = self.scene.amplitude_law.amplitude(place.coords_m.norm());
        let gain = Complex::new(law * from_db(amplitude_db).sqrt(), 0.0);
        Scatterer { place_m: place.coords_m, gain }
    }

    fn walking(&self, walker: &Walker, whole: &Scatterer, moment: Moment) -> Vec<Scatterer> {
        let towards_node = self.towards_node(&whole.place_m);
        let in_node = |(place_m, gain): (Vector2<f64>, Complex<f64>)| {
            let place = self.node_from_world * Point::<World>::from_coords(place_m);
            Scatterer { place_m: place.coords_m, gain: whole.gain * gain }
        };
        let parts = walker.scatterers(moment, &towards_node, &self.streams);
        parts.into_iter().map(in_node).collect()
    }

    /// The scatterers of a person: fixed places on the body, Gaussian gains of this period whose
    /// mean power is that of a point.
    fn body(&self, target_index: usize, whole: &Scatterer, moment: Moment) -> Vec<Scatterer> {
        let target = &self.scene.targets[target_index];
        let ahead = self.node_from_world.rotation() * target.direction(moment.time_s);
        let aside = Vector2::new(-ahead.y, ahead.x);
        let towards_node = -whole.place_m.normalize();
        let mut shape = self.streams.rng(Purpose::BodyShape, target_index, 0);
        let mut gains = self.streams.rng(Purpose::BodyGain, target_index, moment.period_index);
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

    /// Room for the one-way responses of all transmitters and all receivers.
    pub(super) fn no_ways(&self) -> [Spectra; 2] {
        let Radar { array, band, .. } = &self.radar;
        [Spectra::zeros(array.tx_m.len(), band), Spectra::zeros(array.rx_m.len(), band)]
    }

    /// The images of a place in the mirrors that show it, with their amplitudes over the direct way.
    pub(super) fn images(
        &self,
        place_m: &Vector2<f64>,
        mirrors: &[Mirror],
    ) -> Vec<(Vector2<f64>, f64)> {
        let law = |m: &Vector2<f64>| self.scene.amplitude_law.amplitude(m.norm()).sqrt();
        let seen = |mirror: &Mirror| {
            let image_m = mirror.image(place_m).filter(|image_m| self.slab.is_open(image_m))?;
            Some((image_m, mirror.coefficient * law(&image_m) / law(place_m)))
        };
        mirrors.iter().filter_map(seen).collect()
    }

    pub(super) fn add_scatterer(
        &self,
        sums: &mut Spectra,
        ways: &mut [Spectra; 2],
        scatterer: &Scatterer,
        mirrors: &[Mirror],
    ) {
        let array = &self.radar.array;
        let mut ends = vec![(scatterer.place_m, 1.0)];
        ends.extend(self.images(&scatterer.place_m, mirrors));
        let [there, back] = ways;
        for (antennas, responses, gain) in [
            (&array.tx_m, &mut *there, scatterer.gain),
            (&array.rx_m, &mut *back, Complex::from(1.0)),
        ] {
            responses.clear();
            for (row, antenna) in antennas.iter().enumerate() {
                self.add_ways(responses, (row, antenna), &ends, gain);
            }
        }
        for channel in 0..array.channel_count() {
            let rx_count = array.rx_m.len();
            let pair = [(&*there, channel / rx_count), (&*back, channel % rx_count)];
            sums.add_product(channel, pair);
        }
    }

    /// Adds all ways from an antenna to the `ends`, a place and its images, to the antenna's row.
    fn add_ways(
        &self,
        responses: &mut Spectra,
        (row, antenna): (usize, &[f64; 2]),
        ends: &[(Vector2<f64>, f64)],
        gain: Complex<f64>,
    ) {
        for (end_m, amplitude) in ends {
            for leg in self.slab.legs(&Vector2::from(*antenna), end_m) {
                let weight = gain * (amplitude * leg.amplitude);
                responses.add_wave(row, &self.radar.band, leg.path_m, weight);
            }
        }
    }

    /// The antennas of every channel.
    pub(super) fn pairs(&self) -> impl Iterator<Item = (Vector2<f64>, Vector2<f64>)> + '_ {
        let Array { tx_m, rx_m } = &self.radar.array;
        tx_m.iter().flat_map(move |tx| rx_m.iter().map(move |rx| ((*tx).into(), (*rx).into())))
    }

    fn add_noise(&self, samples: &mut [Complex<f64>], period_index: u64) {
        let step_count = self.radar.band.step_count;
        let noise = &self.disturbance.noise;
        let amplitude = noise.power_per_frequency(self.reference_amplitude(), step_count).sqrt();
        let mut rng = self.streams.rng(Purpose::Noise, 0, period_index);
        for sample in samples {
            *sample += gaussian(&mut rng) * amplitude;
        }
    }
}

#[cfg(test)]
mod tests;
