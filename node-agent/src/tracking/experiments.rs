//! The four experiments of the mean-shift paper, simulated frame by frame with their truth.
//!
//! Room, wall and walks are those of `simulate::presets`; array and band those of \[mean-shift\]. The paper
//! measures in a real room and states no speed: here the longer walk of an experiment is done once
//! there and back in the 14 s, and both people walk at the same speed (0.86, 0.57, 0.71 and
//! 0.57 m/s in experiments 1 to 4; in the second the person on the shorter walk goes twice).
//! The scene is free space behind a wall that delays, and the chain takes the delay out exactly.
//! Both people reflect alike at all ranges. The noise is such that a point target of a person's
//! mean power has 15 dB in the image. Of the simulated people the mean of the peak power is then
//! 14.6 dB above it, the median 13 dB, and 5 % of the peaks are below 6 dB: bodies fade.

use nalgebra::Vector2;
use rustfft::num_complex::Complex;
use thiserror::Error;

use proto::geom::Se2;
use proto::radar::{Array, Band, Grid};

use crate::imaging::backproject::Coherence;
use crate::imaging::canceller::CancellerConfig;
use crate::imaging::wall::WallModel;
use crate::imaging::{InvalidSetting, invalid};
use crate::pipeline::{Chain, ChainConfig, ChainError, MeasureOn};
use crate::simulate::presets::{BRICK, ROOM_M, WALKS_M, two_walkers};
use crate::simulate::{
    Body, Disturbance, EchoSimulator, Noise, Radar, Scene, TargetKind, WayPoint,
};

use super::{Frame, FrameError};

/// Length of an experiment, seconds.
pub const DURATION_S: f64 = 14.0;
/// Time between frames, seconds.
pub const FRAME_S: f64 = 0.1;
/// Frames of an experiment.
pub const FRAME_COUNT: u32 = 140;
/// Peak power of a point target over the noise in the image without weighting, decibels.
pub const IMAGE_SNR_DB: f64 = 15.0;
/// How far a person's middle lies behind what is seen of it, metres. All walk towards the array or
/// away from it: of `target.half_depth_m`, which holds for all directions, that from the front.
pub const HALF_DEPTH_M: f64 = 0.06;

/// Size of a pixel, metres.
const PIXEL_M: f64 = 0.05;
/// Depth of the first row, metres: behind the wall, before the nearest walk.
const NEAR_M: f64 = 0.5;
/// Pixels over 7.55 m, and from 0.5 m to 12 m.
const PIXEL_COUNTS: [usize; 2] = [152, 231];

/// Why an experiment could not be run.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ExperimentError {
    /// The number of the experiment or a setting makes no sense.
    #[error("experiment: {0}")]
    Setting(#[from] InvalidSetting),
    /// The chain refused its settings or a sweep.
    #[error("experiment: {0}")]
    Chain(#[from] ChainError),
    /// A tracker refused a frame.
    #[error("experiment: {0}")]
    Frame(#[from] FrameError),
}

/// One of the four.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Experiment {
    index: usize,
}

impl Experiment {
    /// All four, in order.
    #[must_use]
    pub fn all() -> [Self; 4] {
        [0, 1, 2, 3].map(|index| Self { index })
    }

    /// Experiment `number`, 1 to 4.
    ///
    /// # Errors
    /// If there is no such experiment.
    pub fn numbered(number: usize) -> Result<Self, InvalidSetting> {
        match number {
            1..=4 => Ok(Self { index: number - 1 }),
            _ => Err(invalid("experiment", number, "use 1 to 4")),
        }
    }

    /// Its number in the paper, 1 to 4.
    #[must_use]
    pub fn number(self) -> usize {
        self.index + 1
    }

    /// The two people and the wall.
    #[must_use]
    pub fn scene(self) -> Scene {
        let walks_m = &WALKS_M[self.index];
        let mut scene = two_walkers(walks_m, TargetKind::Body(Body::default()), DURATION_S);
        let longest_m = walks_m.iter().map(length_m).fold(0.0, f64::max);
        let speed_m_per_s = 2.0 * longest_m / DURATION_S;
        for (target, walk_m) in scene.targets.iter_mut().zip(walks_m) {
            target.way_points = there_and_back(walk_m, length_m(walk_m) / speed_m_per_s);
        }
        scene
    }

    /// Where the middles of both people are, `[x, y]` in the node's frame in metres.
    #[must_use]
    pub fn middles_m(self, time_s: f64) -> [Vector2<f64>; 2] {
        let scene = self.scene();
        [0, 1].map(|person| scene.targets[person].position(time_s).coords_m)
    }
}

fn length_m([from_m, to_m]: &[[f64; 2]; 2]) -> f64 {
    (to_m[0] - from_m[0]).hypot(to_m[1] - from_m[1])
}

/// Way points of a walk whose leg takes `leg_s`, to the end of the experiment.
fn there_and_back([from_m, to_m]: &[[f64; 2]; 2], leg_s: f64) -> Vec<WayPoint> {
    let mut way_points = Vec::new();
    let (mut time_s, mut here, mut there) = (0.0, from_m, to_m);
    while time_s < DURATION_S + 0.5 * leg_s {
        way_points.push(WayPoint { time_s, x_m: here[0], y_m: here[1] });
        (here, there) = (there, here);
        time_s += leg_s;
    }
    way_points
}

/// The radar of the paper, with an image of the room.
#[must_use]
pub fn radar() -> Radar {
    let band = Band { start_hz: 1.6e9, step_hz: 2e6, step_count: 300 };
    Radar { band, array: Array::default(), grid: room() }
}

/// The room in pixels of 0.05 m.
#[must_use]
pub fn room() -> Grid {
    let [column_count, row_count] = PIXEL_COUNTS;
    Grid { x_min_m: -0.5 * ROOM_M[0], y_min_m: NEAR_M, pixel_m: PIXEL_M, column_count, row_count }
}

/// `chain` with the experiments' radar, room and wall, on the pixels of the room.
#[must_use]
pub fn in_the_room(chain: ChainConfig) -> ChainConfig {
    let Radar { band, array, grid } = radar();
    let wall = WallModel::Refraction(BRICK);
    ChainConfig { wall, grid, measure_on: MeasureOn::Image, ..chain }.with_radar(band, array)
}

/// The chain whose images the paper's tracker takes: phase coherence factor, and no canceller, as
/// the scene has no static echoes.
#[must_use]
pub fn paper_chain() -> ChainConfig {
    let (coherence, canceller) = (Coherence::Phase, CancellerConfig::None);
    in_the_room(ChainConfig { coherence, canceller, ..ChainConfig::default() })
}

/// What spoils the sweeps: white noise that leaves `image_snr_db` in the image, where the mean over
/// the channels has averaged it.
#[must_use]
pub fn disturbance(image_snr_db: f64) -> Disturbance {
    let channel_count = Array::default().channel_count() as f64;
    let snr_db = image_snr_db - 10.0 * channel_count.log10();
    Disturbance { noise: Noise::InBand { snr_db }, ..Disturbance::default() }
}

/// One frame with what is true in it.
#[derive(Clone, Copy, Debug)]
pub struct Shown<'a> {
    /// 0 to [`FRAME_COUNT`].
    pub index: u32,
    /// What a tracker is given.
    pub frame: Frame<'a>,
    /// Where the middles of both people are, `[x, y]` in metres.
    pub middles_m: [Vector2<f64>; 2],
    /// Where what they reflect comes from on average, `[x, y]` in metres: the mean of the scatterers
    /// of each, weighted by their mean powers.
    pub shining_m: [Vector2<f64>; 2],
}

/// An experiment with a chain, ready to be played with any seed.
#[derive(Clone, Debug)]
pub struct Stage {
    experiment: Experiment,
    /// A chain that knows the empty room and has seen nothing else.
    chain: Chain,
    image_snr_db: f64,
}

impl Stage {
    /// Builds the chain of `config`, see [`paper_chain`] and [`in_the_room`].
    ///
    /// # Errors
    /// If a setting makes no sense.
    pub fn new(experiment: Experiment, config: &ChainConfig) -> Result<Self, ExperimentError> {
        let mut chain = Chain::new(config)?;
        if config.canceller != CancellerConfig::None {
            let sample_count = config.array.channel_count() * config.band.step_count;
            chain.use_background(&vec![Complex::default(); sample_count])?;
        }
        Ok(Self { experiment, chain, image_snr_db: IMAGE_SNR_DB })
    }

    /// The same with another signal-to-noise ratio than [`IMAGE_SNR_DB`].
    #[must_use]
    pub fn at_snr_db(self, image_snr_db: f64) -> Self {
        Self { image_snr_db, ..self }
    }

    /// Simulates the experiment with `seed` and shows every frame to `each`, one image in memory at
    /// a time.
    ///
    /// # Errors
    /// If the chain was not built for this radar, or what `each` gives.
    pub fn play(
        &self,
        seed: u64,
        mut each: impl FnMut(&Shown<'_>) -> Result<(), FrameError>,
    ) -> Result<(), ExperimentError> {
        let scene = self.experiment.scene();
        let pose = Se2::identity();
        let spoilt = disturbance(self.image_snr_db);
        let simulator = EchoSimulator::new(&scene, pose, &radar(), &spoilt, seed)?;
        let mut chain = self.chain.clone();
        for index in 0..FRAME_COUNT {
            let time_s = FRAME_S * f64::from(index);
            let sweep = simulator.sweep(u64::from(index), time_s);
            let measured = chain.process_sweep(&sweep)?;
            let frame = Frame {
                time_s,
                grid: measured.image.grid,
                amplitude: measured.image.amplitude,
                noise_amplitude: measured.image.noise_amplitude,
                points: &measured.points,
            };
            let middles_m = [0, 1].map(|person| scene.targets[person].position(time_s).coords_m);
            let shining = simulator.shining_in_node(time_s);
            let shining_m = [0, 1].map(|person| shining[person].coords_m);
            each(&Shown { index, frame, middles_m, shining_m })?;
        }
        Ok(())
    }
}

/// The middle of a person whose near side is seen at `seen_m`: [`HALF_DEPTH_M`] farther out.
#[must_use]
pub fn middle_m(seen_m: &Vector2<f64>) -> Vector2<f64> {
    seen_m + proto::measured::line_of_sight(seen_m) * HALF_DEPTH_M
}

#[cfg(test)]
mod tests;
