//! What the tests of detection share: a chain on any pixels, scenes, and a tally of errors.

use nalgebra::Vector2;
use proto::geom::Se2;
use proto::radar::{Array, Band, Grid};

use super::moments::{Polar, to_cartesian, to_polar};
use super::response::PointModel;
use super::*;
use crate::imaging::backproject::Backprojector;
use crate::imaging::compress::Compressor;
use crate::imaging::pixels::{Pixels, PolarGrid};
use crate::imaging::wall::WallModel;
use crate::imaging::window::Window;
use crate::simulate::{
    Disturbance, EchoSimulator, Noise, Radar, Scene, Target, TargetKind, WayPoint,
};

/// A chain from samples to points on any pixels.
pub(super) struct Rig {
    pub(super) compressor: Compressor,
    pub(super) backprojector: Backprojector,
    pub(super) precision: Precision,
    pub(super) resolver: Resolver,
    pub(super) config: DetectionConfig,
}

impl Rig {
    pub(super) fn new(pixels: &Pixels, wall: &WallModel, config: DetectionConfig) -> Self {
        let (band, array) = (Band::default(), Array::default());
        let weights = Window::Taylor.weights(band.step_count);
        Self {
            compressor: Compressor::new(&band, &weights, 2048),
            backprojector: Backprojector::new(&band, &array, pixels, wall, 2048).unwrap(),
            precision: Precision::new(&band, &array, &weights),
            resolver: Resolver::new(PointModel::new(&band, &array, wall, &weights)),
            config,
        }
    }

    pub(super) fn points(&self, sweep: &crate::imaging::Sweep) -> Vec<MeasuredPoint> {
        let profiles = self.compressor.compress(&sweep.samples);
        let image = self.backprojector.image(&profiles);
        let amplitude = image.weighted_amplitude();
        let noise_power = threshold::noise_power(&profiles);
        let scan = Scan { profiles: &profiles, image: &image, amplitude: &amplitude, noise_power };
        detect(&scan, &self.config, &self.precision, &self.resolver)
    }
}

pub(super) fn polar() -> Pixels {
    Pixels::Polar(PolarGrid::default())
}

pub(super) fn cartesian() -> Pixels {
    Pixels::Cartesian(Grid::default())
}

/// A grid that holds 8 m at 45°.
pub(super) fn shifted() -> Pixels {
    Pixels::Cartesian(Grid { x_min_m: -2.0, ..Grid::default() })
}

pub(super) fn standing(place: Polar, kind: TargetKind, amplitude_db: f64) -> Target {
    let place_m = to_cartesian(&place);
    let way_points = vec![WayPoint { time_s: 0.0, x_m: place_m.x, y_m: place_m.y }];
    Target { way_points, kind, amplitude_db }
}

pub(super) fn simulator(scene: &Scene, noise: Noise, seed: u64) -> EchoSimulator {
    let disturbance = Disturbance { noise, ..Disturbance::default() };
    EchoSimulator::new(scene, Se2::identity(), &Radar::default(), &disturbance, seed).unwrap()
}

/// How points are judged.
pub(super) struct Judge {
    /// A point belongs to a target within these, range in metres and sine.
    pub(super) gate: [f64; 2],
    /// Half the depth of a target and its standard deviation, metres.
    pub(super) half_depth_m: [f64; 2],
}

pub(super) const POINTS: Judge = Judge { gate: [0.3, 0.2], half_depth_m: [0.0, 0.0] };
pub(super) const PEOPLE: Judge = Judge { gate: [0.6, 0.5], half_depth_m: [0.10, 0.05] };

/// Errors and counts over many sweeps.
#[derive(Default, Clone)]
pub(super) struct Tally {
    pub(super) errors: Vec<Vector2<f64>>,
    pub(super) nees: Vec<f64>,
    pub(super) truth_count: usize,
    pub(super) false_count: usize,
    pub(super) false_at: Vec<(u64, Polar, f64)>,
}

impl Tally {
    pub(super) fn add(
        &mut self,
        period: u64,
        truths: &[Vector2<f64>],
        points: &[MeasuredPoint],
        judge: &Judge,
    ) {
        let (gate, half) = (judge.gate, judge.half_depth_m);
        let error = |point: &MeasuredPoint, truth: &Vector2<f64>| {
            to_polar(&point.middle(half[0], half[1]).mean.coords_m) - to_polar(truth)
        };
        let cost = |point: &MeasuredPoint, truth: &Vector2<f64>| {
            let e = error(point, truth).abs();
            (e.x / gate[0]).max(e.y / gate[1])
        };
        let mut free: Vec<&MeasuredPoint> = points.iter().collect();
        let mut missing: Vec<&Vector2<f64>> = truths.iter().collect();
        self.truth_count += truths.len();
        // The nearest pair first: a point between two targets belongs to the nearer one.
        loop {
            let pairs = (0..free.len()).flat_map(|p| (0..missing.len()).map(move |t| (p, t)));
            let rated = pairs.map(|(p, t)| (cost(free[p], missing[t]), p, t));
            let best = rated.filter(|(c, ..)| *c < 1.0).min_by(|a, b| a.0.total_cmp(&b.0));
            let Some((_, p, t)) = best else { break };
            let (point, truth) = (free.remove(p), missing.remove(t));
            let position = point.middle(half[0], half[1]);
            let off_m = position.mean.coords_m - truth;
            self.nees.push(off_m.dot(&(position.cov_m2.try_inverse().unwrap() * off_m)));
            self.errors.push(error(point, truth));
        }
        self.false_count += free.len();
        for point in free {
            self.false_at.push((period, to_polar(&point.position().mean.coords_m), point.snr_db));
        }
    }

    pub(super) fn mean(&self) -> Vector2<f64> {
        self.errors.iter().sum::<Vector2<f64>>() / self.errors.len() as f64
    }

    pub(super) fn rms(&self) -> Vector2<f64> {
        let squares: Vector2<f64> = self.errors.iter().map(|e| e.component_mul(e)).sum();
        (squares / self.errors.len() as f64).map(f64::sqrt)
    }

    pub(super) fn mean_nees(&self) -> f64 {
        self.nees.iter().sum::<f64>() / self.nees.len() as f64
    }
}
