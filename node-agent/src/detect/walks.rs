//! People on many ways, through the whole chain: what the studies of people have in common.

use std::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::{Rotation2, Vector2};
use proto::geom::Se2;
use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};

use super::moments::{Polar, to_cartesian};
use super::*;
use crate::imaging::canceller::CancellerConfig;
use crate::pipeline::{Chain, ChainConfig, MeasureOn};
use crate::simulate::{
    Clutter, Disturbance, EchoSimulator, Noise, Radar, Scene, Target, TargetKind, WayPoint,
};

/// Frames in a second.
pub(super) const RATE_HZ: f64 = 10.0;
/// Frames of the empty room before anyone comes, which teach the canceller.
const EMPTY_COUNT: u64 = 30;
/// Gain of the image over one channel, decibels: eight channels.
const ARRAY_GAIN_DB: f64 = 9.03;
/// What stands in the room, `[x, y]` in metres and decibels over a person.
const CLUTTER: [[f64; 3]; 4] =
    [[0.3, 0.6, 60.0], [-2.0, 4.2, 34.0], [2.5, 6.5, 30.0], [0.5, 8.0, 40.0]];

/// One person or more on their ways.
#[derive(Clone, Debug)]
pub(super) struct Walk {
    /// The targets.
    pub(super) targets: Vec<Target>,
    /// How long, frames.
    pub(super) frame_count: u64,
    /// Mean SNR of a person in the image, decibels.
    pub(super) image_snr_db: f64,
    /// For all that is random.
    pub(super) seed: u64,
}

/// What one frame gave.
#[derive(Clone, Debug)]
pub(super) struct Frame {
    /// Number of the frame.
    pub(super) index: u64,
    /// The middles of all people.
    pub(super) truths: Vec<Vector2<f64>>,
    /// What was measured.
    pub(super) points: Vec<MeasuredPoint>,
}

impl Walk {
    /// One person on way number `style` (radial, tangential, oblique, turning): start, speed (0.5 to
    /// 1.5 m/s) and SNR (15 to 35 dB) follow from `seed`.
    pub(super) fn single(kind: TargetKind, style: u64, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(77);
        let start = Polar::new(rng.random_range(2.0..8.0), rng.random_range(-0.6..0.6));
        let speed_m_per_s = rng.random_range(0.5..1.5);
        let image_snr_db = rng.random_range(15.0..35.0);
        let from_m = to_cartesian(&start);
        let away = if start.x < 5.0 { 1.0 } else { -1.0 };
        let inward = if 0.0 < start.y { -1.0 } else { 1.0 };
        let turn = match style {
            0 => 0.0,
            1 => FRAC_PI_2,
            _ => rng.random_range(0.4..1.2),
        };
        let outward = from_m.normalize() * away;
        let heading = Rotation2::new(-turn * inward * away) * outward;
        let to_m = from_m + heading * (speed_m_per_s * 2.5);
        let corner = if style == 3 { rng.random_range(-2.5..2.5) } else { 0.0 };
        let end_m = to_m + Rotation2::new(corner) * heading * (speed_m_per_s * 2.5);
        let way = |time_s: f64, m: Vector2<f64>| WayPoint { time_s, x_m: m.x, y_m: m.y };
        // He comes when the empty room has been learned.
        let way_points = vec![way(3.0, from_m), way(5.5, to_m), way(8.0, end_m)];
        let targets = vec![Target { way_points, kind, amplitude_db: 0.0 }];
        Self { targets, frame_count: 50, image_snr_db, seed }
    }

    /// Two people side by side or behind each other, `apart_m` apart, who walk alike.
    pub(super) fn pair(kind: TargetKind, apart_m: f64, seed: u64) -> Self {
        let mut one = Self::single(kind, seed % 4, seed);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(78);
        let aside_m = Rotation2::new(rng.random_range(0.0..TAU)) * Vector2::new(apart_m, 0.0);
        let mut other = one.targets[0].clone();
        for way_point in &mut other.way_points {
            way_point.x_m += aside_m.x;
            way_point.y_m += aside_m.y;
        }
        one.targets.push(other);
        one
    }

    /// All frames after the person came, through the whole default chain with `detection`.
    pub(super) fn frames(
        &self,
        canceller: CancellerConfig,
        detection: DetectionConfig,
        pixels: MeasureOn,
    ) -> Vec<Frame> {
        let config =
            ChainConfig { canceller, detection, measure_on: pixels, ..ChainConfig::default() };
        let mut chain = Chain::new(&config).unwrap();
        let snr_db = self.image_snr_db - ARRAY_GAIN_DB;
        let noise = Noise::InBand { snr_db };
        let clutter = match canceller {
            CancellerConfig::None => Vec::new(),
            _ => CLUTTER.map(|[x_m, y_m, db]| Clutter { x_m, y_m, amplitude_db: db }).to_vec(),
        };
        let targets = self.targets.clone();
        let scene = Scene { targets, clutter, ..Scene::default() };
        let with = |detection_probability| {
            let disturbance =
                Disturbance { noise, detection_probability, ..Disturbance::default() };
            EchoSimulator::new(&scene, Se2::identity(), &Radar::default(), &disturbance, self.seed)
                .unwrap()
        };
        let (empty, walked) = (with(0.0), with(1.0));
        let sweep = |of: &EchoSimulator, index: u64| of.sweep(index, index as f64 / RATE_HZ);
        if canceller != CancellerConfig::None {
            for index in 0..EMPTY_COUNT {
                chain.process_sweep(&sweep(&empty, index)).unwrap();
            }
        }
        let frame = |index| {
            let taken = sweep(&walked, index);
            let truths = walked.targets_in_node(taken.time_s).iter().map(|t| t.coords_m).collect();
            Frame { index, truths, points: chain.process_sweep(&taken).unwrap().points }
        };
        (EMPTY_COUNT..EMPTY_COUNT + self.frame_count).map(frame).collect()
    }
}
