//! READ FIRST: one node's whole chain, from a raw sweep to measured points, on one screen.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use proto::measured::MeasuredPoint;
use proto::radar::{Array, Band, Grid};

use crate::detect::resolve::Resolver;
use crate::detect::response::PointModel;
use crate::detect::{self, DetectionConfig, Precision, Scan, threshold};
use crate::imaging::backproject::Backprojector;
use crate::imaging::canceller::{Cancelled, Canceller, CancellerConfig};
use crate::imaging::compress::Compressor;
use crate::imaging::wall::WallModel;
use crate::imaging::window::Window;
use crate::imaging::{InvalidSetting, Sweep, invalid};

/// Longest profile, so that a typing error cannot ask for all memory.
const MAX_FFT_LENGTH: usize = 1 << 18;

/// Settings of the chain.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ChainConfig {
    /// Frequencies of a sweep.
    pub band: Band,
    /// Antennas.
    pub array: Array,
    /// Pixels of the image.
    pub grid: Grid,
    /// The wall before the array.
    pub wall: WallModel,
    /// What removes static echoes.
    pub canceller: CancellerConfig,
    /// Weights over the band.
    pub window: Window,
    /// Delay samples of a profile, at least `band.step_count`; 2048 for 301 frequencies.
    pub fft_length: usize,
    /// What counts as a target.
    pub detection: DetectionConfig,
}

impl Default for ChainConfig {
    fn default() -> Self {
        Self {
            band: Band::default(),
            array: Array::default(),
            grid: Grid::default(),
            wall: WallModel::default(),
            canceller: CancellerConfig::default(),
            window: Window::default(),
            fft_length: 2048,
            detection: DetectionConfig::default(),
        }
    }
}

impl ChainConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense, and what would do.
    pub fn check(&self) -> Result<(), InvalidSetting> {
        self.band.check()?;
        self.array.check()?;
        self.grid.check()?;
        self.wall.check()?;
        self.canceller.check()?;
        self.detection.check()?;
        if !(self.band.step_count..=MAX_FFT_LENGTH).contains(&self.fft_length) {
            let remedy =
                "use band.step_count to 262144, best a power of two about 7 times the count";
            return Err(invalid("fft_length", self.fft_length, remedy));
        }
        Ok(())
    }
}

/// Why a sweep was refused, or the chain not built.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum ChainError {
    /// A setting makes no sense.
    #[error("building the chain: {0}")]
    Setting(#[from] InvalidSetting),
    /// The sweep is not from this radar.
    #[error("taking the sweep at {time_s} s: {got} samples, the radar has {want}")]
    SampleCount {
        /// When the sweep was taken.
        time_s: f64,
        /// Samples in the sweep.
        got: usize,
        /// Channels times frequencies.
        want: usize,
    },
    /// A sample is no number.
    #[error(
        "taking the sweep at {time_s} s: channel {channel}, frequency {frequency} is not finite"
    )]
    NotFinite {
        /// When the sweep was taken.
        time_s: f64,
        /// Channel index.
        channel: usize,
        /// Frequency index.
        frequency: usize,
    },
    /// The sweep was not taken after the one before.
    #[error("taking the sweep at {time_s} s: the one before was taken at {previous_s} s")]
    TimeNotAscending {
        /// When the sweep was taken.
        time_s: f64,
        /// When the one before was taken.
        previous_s: f64,
    },
}

/// Whether points can be expected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChainState {
    /// The points are all that was seen.
    Ready,
    /// The canceller does not know the background yet: no points, an empty image.
    WarmingUp,
}

/// The image of one sweep, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Where the pixels are.
    pub grid: Grid,
    /// Mean amplitude of the channels weighted by coherence, 1 for an echo of reflectivity 1.
    pub amplitude: Vec<f32>,
    /// Root mean square of the noise in the mean of the channels, without weighting.
    pub noise_amplitude: f32,
}

/// What one sweep gave.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    /// What was seen, strongest first.
    pub points: Vec<MeasuredPoint>,
    /// Where it was seen.
    pub image: Image,
    /// Whether points can be expected.
    pub state: ChainState,
}

/// The chain with its tables and the canceller's memory.
#[derive(Clone, Debug)]
pub struct Chain {
    config: ChainConfig,
    canceller: Canceller,
    compressor: Compressor,
    backprojector: Backprojector,
    precision: Precision,
    resolver: Resolver,
}

impl Chain {
    /// Builds all tables; takes some tens of milliseconds.
    ///
    /// # Errors
    /// If a setting makes no sense, or the image reaches beyond the radar's unambiguous range.
    pub fn new(config: &ChainConfig) -> Result<Self, ChainError> {
        config.check()?;
        let ChainConfig { band, array, grid, wall, fft_length, .. } = config;
        let weights = config.window.weights(band.step_count);
        Ok(Self {
            canceller: Canceller::new(config.canceller),
            compressor: Compressor::new(band, &weights, *fft_length),
            backprojector: Backprojector::new(band, array, grid, wall, *fft_length)?,
            precision: Precision::new(band, array, &weights),
            resolver: Resolver::new(PointModel::new(band, array, wall, &weights)),
            config: config.clone(),
        })
    }

    /// Takes the next sweep and gives the points seen in it.
    ///
    /// # Errors
    /// If the sweep has the wrong size, holds something that is no number, or was not taken after
    /// the one before; the chain is then as it was.
    pub fn process_sweep(&mut self, sweep: &Sweep) -> Result<Measured, ChainError> {
        self.check_sweep(sweep)?;
        let moving = match self.canceller.cancel(sweep) {
            Cancelled::Moving(moving) => moving,
            Cancelled::WarmingUp => return Ok(self.warming_up()),
        };
        let profiles = self.compressor.compress(&moving);
        let coherent = self.backprojector.image(&profiles);
        let amplitude = coherent.weighted_amplitude();
        let noise_power = threshold::noise_power(&profiles);
        let scan =
            Scan { profiles: &profiles, image: &coherent, amplitude: &amplitude, noise_power };
        let points = detect::detect(&scan, &self.config.detection, &self.precision, &self.resolver);
        let noise_amplitude = (noise_power / coherent.channel_count as f32).sqrt();
        let image = Image { grid: self.config.grid, amplitude, noise_amplitude };
        Ok(Measured { points, image, state: ChainState::Ready })
    }

    fn warming_up(&self) -> Measured {
        let grid = self.config.grid;
        let image = Image { grid, amplitude: vec![0.0; grid.pixel_count()], noise_amplitude: 0.0 };
        Measured { points: Vec::new(), image, state: ChainState::WarmingUp }
    }

    fn check_sweep(&self, sweep: &Sweep) -> Result<(), ChainError> {
        let time_s = sweep.time_s;
        let step_count = self.config.band.step_count;
        let (got, want) = (sweep.samples.len(), self.config.array.channel_count() * step_count);
        if got != want {
            return Err(ChainError::SampleCount { time_s, got, want });
        }
        let broken = |sample: &rustfft::num_complex::Complex<f32>| !sample.is_finite();
        if let Some(index) = sweep.samples.iter().position(broken) {
            let (channel, frequency) = (index / step_count, index % step_count);
            return Err(ChainError::NotFinite { time_s, channel, frequency });
        }
        match self.canceller.last_s() {
            Some(previous_s) if time_s.is_nan() || time_s <= previous_s => {
                Err(ChainError::TimeNotAscending { time_s, previous_s })
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests;
