//! READ FIRST: one node's whole chain, from a raw sweep to measured points, on one screen.

use std::borrow::Cow;

use rustfft::num_complex::Complex;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use proto::measured::MeasuredPoint;
use proto::radar::{Array, Band, Grid};

use crate::detect::fading::{Focus, Living};
use crate::detect::resolve::Resolver;
use crate::detect::response::PointModel;
use crate::detect::{self, DetectionConfig, Precision, Scan, threshold};
use crate::imaging::backproject::{
    Backprojector, Coherence, CoherentImage, Geometry, Means, Workspace,
};
use crate::imaging::calibration::Calibration;
use crate::imaging::canceller::{Cancelled, Canceller, CancellerConfig, Gates};
use crate::imaging::compress::{Compressed, Compressor};
use crate::imaging::pixels::{Pixels, PolarGrid};
use crate::imaging::resample::resample;
use crate::imaging::wall::WallModel;
use crate::imaging::window::Window;
use crate::imaging::{InvalidSetting, Sweep, invalid};

/// Longest profile, so that a typing error cannot ask for all memory.
const MAX_FFT_LENGTH: usize = 1 << 18;

/// Samples of a profile for each frequency, at least.
const MIN_OVERSAMPLING: usize = 4;
/// Larger samples would overflow single precision in the energy of an image.
const MAX_AMPLITUDE: f32 = 1e9;

/// On which pixels targets are looked for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MeasureOn {
    /// Those of the picture, `grid`.
    #[default]
    Image,
    /// Those of `polar`: the same information at a tenth of the cost; pictures are interpolated.
    Polar,
}

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
    /// How it is measured whether the channels agree.
    pub coherence: Coherence,
    /// Threads that share the pixels.
    pub thread_count: usize,
    /// On which pixels targets are looked for.
    pub measure_on: MeasureOn,
    /// Pixels to measure on instead of `grid`, if `measure_on` says so.
    pub polar: PolarGrid,
    /// What the hardware does to each channel.
    pub calibration: Calibration,
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
            coherence: Coherence::default(),
            thread_count: 1,
            measure_on: MeasureOn::default(),
            polar: PolarGrid::default(),
            calibration: Calibration::default(),
            detection: DetectionConfig::default(),
        }
    }
}

impl ChainConfig {
    /// For point targets in a scene without static echoes, as the seed simulates them.
    #[must_use]
    pub fn of_points() -> Self {
        let (canceller, detection) = (CancellerConfig::None, DetectionConfig::points());
        Self { canceller, detection, ..Self::default() }
    }

    /// What the seed does from end to end \[registration, sections 3-4\]. Its own simulation has no
    /// static echoes: set `canceller` to `none` for scenes like that, or every target shows twice.
    #[must_use]
    pub fn paper() -> Self {
        Self {
            canceller: CancellerConfig::TwoPulse,
            window: Window::Rectangular,
            detection: DetectionConfig::paper(),
            ..Self::default()
        }
    }

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
        self.polar.check()?;
        self.calibration.check(self.array.channel_count())?;
        self.means().check()?;
        if !(self.band.step_count..=MAX_FFT_LENGTH).contains(&self.fft_length) {
            let remedy =
                "use band.step_count to 262144, best a power of two about 7 times the count";
            return Err(invalid("fft_length", self.fft_length, remedy));
        }
        Ok(())
    }

    /// The same settings for another radar; profiles are lengthened where its band has so many
    /// frequencies that they would be coarse.
    #[must_use]
    pub fn with_radar(self, band: Band, array: Array) -> Self {
        let least = (MIN_OVERSAMPLING * band.step_count).next_power_of_two();
        let fine = MIN_OVERSAMPLING * band.step_count <= self.fft_length;
        let fft_length = if fine { self.fft_length } else { least };
        Self { band, array, fft_length, ..self }
    }

    fn means(&self) -> Means {
        let Self { coherence, thread_count, .. } = *self;
        Means { coherence, thread_count, ..Means::default() }
    }

    /// The pixels that are computed.
    fn pixels(&self) -> Pixels {
        match self.measure_on {
            MeasureOn::Image => Pixels::Cartesian(self.grid),
            MeasureOn::Polar => Pixels::Polar(self.polar),
        }
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
    /// A sample is no number, or beyond what can be computed with.
    #[error(
        "taking the sweep at {time_s} s: channel {channel}, frequency {frequency} is not finite or above 1e9: scale the samples"
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

/// The image of one sweep as the chain computed it; lent until the next sweep.
#[derive(Clone, Copy, Debug)]
pub struct ImageView<'a> {
    /// The pixels of a picture of it.
    pub grid: Grid,
    /// `|I|²` and how well the channels agree, on the pixels that were measured on.
    pub coherent: &'a CoherentImage,
    /// Mean amplitude of the channels weighted by coherence, 1 for an echo of reflectivity 1.
    pub amplitude: &'a [f32],
    /// Root mean square of the noise in the mean of the channels, without weighting.
    pub noise_amplitude: f32,
}

impl ImageView<'_> {
    /// The picture, on `grid`: a copy, or interpolated if the chain measures on polar pixels.
    #[must_use]
    pub fn to_image(&self) -> Image {
        let amplitude = self.on_grid().into_owned();
        Image { grid: self.grid, amplitude, noise_amplitude: self.noise_amplitude }
    }

    /// The amplitude on `grid`: as it is, or interpolated if the chain measures on polar pixels.
    #[must_use]
    pub fn on_grid(&self) -> Cow<'_, [f32]> {
        match self.coherent.pixels {
            Pixels::Cartesian(_) => Cow::Borrowed(self.amplitude),
            Pixels::Polar(_) => {
                Cow::Owned(resample(self.coherent, &self.grid).weighted_amplitude())
            }
        }
    }
}

/// What one sweep gave.
#[derive(Clone, Debug)]
pub struct Measured<'a> {
    /// What was seen, strongest first.
    pub points: Vec<MeasuredPoint>,
    /// Where it was seen.
    pub image: ImageView<'a>,
    /// Whether points can be expected.
    pub state: ChainState,
}

/// The chain with its tables, the canceller's memory and that of one image.
#[derive(Clone, Debug)]
pub struct Chain {
    config: ChainConfig,
    canceller: Canceller,
    compressor: Compressor,
    compressed: Compressed,
    backprojector: Backprojector,
    workspace: Workspace,
    amplitude: Vec<f32>,
    precision: Precision,
    resolver: Resolver,
    living: Living,
}

impl Chain {
    /// Builds all tables; takes some tens of milliseconds.
    ///
    /// # Errors
    /// If a setting makes no sense, or the image reaches beyond the radar's unambiguous range.
    pub fn new(config: &ChainConfig) -> Result<Self, ChainError> {
        config.check()?;
        let ChainConfig { band, array, wall, fft_length, .. } = config;
        let weights = config.window.weights(band.step_count);
        let pixels = &config.pixels();
        let channel_count = array.channel_count();
        let compressor = Compressor::new(band, &weights, *fft_length).calibrated(
            &config.calibration,
            band,
            channel_count,
        )?;
        let geometry = Geometry { band, array, pixels, wall, fft_length: *fft_length };
        let backprojector = Backprojector::with_means(&geometry, &config.means())?;
        let gates = Gates {
            // The noise power is a median: it needs gates without targets, too.
            kept_count: (2 * backprojector.needed_sample_count()).min(*fft_length),
            per_cell: *fft_length as f64 / band.step_count as f64,
        };
        Ok(Self {
            canceller: Canceller::new(config.canceller, gates),
            compressed: compressor.memory(channel_count),
            compressor,
            workspace: backprojector.workspace(),
            amplitude: vec![0.0; pixels.pixel_count()],
            backprojector,
            living: Living::new(Focus::new(band, array, wall)),
            precision: Precision::new(band, array, &weights),
            resolver: Resolver::new(PointModel::new(band, array, wall, &weights)),
            config: config.clone(),
        })
    }

    /// Gives the sweep of an empty room for a background, `[channel][frequency]`: `background` keeps
    /// it as it is, `slow_fast` starts from it.
    ///
    /// # Errors
    /// If it has not the size of a sweep or holds something that is no number.
    pub fn use_background(&mut self, empty: &[Complex<f32>]) -> Result<(), ChainError> {
        self.check_samples(0.0, empty)?;
        self.compressor.compress_into(empty, &mut self.compressed);
        self.canceller.use_background(&self.compressed.profiles);
        Ok(())
    }

    /// Takes the next sweep and gives the points seen in it.
    ///
    /// # Errors
    /// If the sweep has the wrong size, holds something that is no number, or was not taken after
    /// the one before; the chain is then as it was.
    pub fn process_sweep(&mut self, sweep: &Sweep) -> Result<Measured<'_>, ChainError> {
        self.check_sweep(sweep)?;
        self.compressor.compress_into(&sweep.samples, &mut self.compressed);
        let received = &self.compressed.profiles;
        let Cancelled::Moving(profiles) = self.canceller.cancel(sweep.time_s, received) else {
            return Ok(self.warming_up());
        };
        self.backprojector.project(profiles, &mut self.workspace);
        self.workspace.image.weighted_amplitude_into(&mut self.amplitude);
        let noise_power = threshold::noise_power(profiles);
        let (image, amplitude) = (&self.workspace.image, self.amplitude.as_slice());
        let scan = Scan { profiles, image, amplitude, noise_power };
        let mut points =
            detect::detect(&scan, &self.config.detection, &self.precision, &self.resolver);
        let sample_rate_hz = profiles.sample_rate_hz;
        let noise_amplitude = (noise_power / image.channel_count as f32).sqrt();
        if let Some(seen) = self.canceller.slow_fast_mut() {
            self.living.keep_living(&mut points, sweep.time_s, seen, sample_rate_hz);
        }
        Ok(Measured { points, image: self.view(noise_amplitude), state: ChainState::Ready })
    }

    fn view(&self, noise_amplitude: f32) -> ImageView<'_> {
        let (grid, coherent) = (self.config.grid, &self.workspace.image);
        ImageView { grid, coherent, amplitude: &self.amplitude, noise_amplitude }
    }

    fn warming_up(&mut self) -> Measured<'_> {
        let image = &mut self.workspace.image;
        let planes = [&mut image.power, &mut image.energy, &mut image.phase_coherence];
        planes.into_iter().chain([&mut self.amplitude]).for_each(|plane| plane.fill(0.0));
        Measured { points: Vec::new(), image: self.view(0.0), state: ChainState::WarmingUp }
    }

    fn check_sweep(&self, sweep: &Sweep) -> Result<(), ChainError> {
        let time_s = sweep.time_s;
        self.check_samples(time_s, &sweep.samples)?;
        let previous_s = self.canceller.last_s().unwrap_or(f64::NEG_INFINITY);
        let ascends = time_s.is_finite() && previous_s < time_s;
        if ascends { Ok(()) } else { Err(ChainError::TimeNotAscending { time_s, previous_s }) }
    }

    fn check_samples(&self, time_s: f64, samples: &[Complex<f32>]) -> Result<(), ChainError> {
        let step_count = self.config.band.step_count;
        let (got, want) = (samples.len(), self.config.array.channel_count() * step_count);
        if got != want {
            return Err(ChainError::SampleCount { time_s, got, want });
        }
        let is_good = |sample: &Complex<f32>| sample.norm_sqr() <= MAX_AMPLITUDE * MAX_AMPLITUDE;
        match samples.iter().position(|sample| !is_good(sample)) {
            None => Ok(()),
            Some(index) => Err(ChainError::NotFinite {
                time_s,
                channel: index / step_count,
                frequency: index % step_count,
            }),
        }
    }
}

#[cfg(test)]
mod story;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod upsets;
