//! Pulse compression: from samples over frequency to profiles over delay, carrier removed.
//!
//! `s(t) = Σ_k w_k S(f_k) exp(j 2π (f_k − f_c) t)`, `Σ w_k = 1`, at `t = n / (N Δf)`, by an inverse
//! FFT of length `N` over the samples padded with zeros. `t` repeats after `1 / Δf`. What the hardware
//! does to a channel (`calibration`) is undone by the same weights, which are then complex.
//! Cost `N log N` for each channel.

use crate::imaging::single_complex;
use std::fmt;
use std::sync::Arc;

use rustfft::num_complex::Complex;
use rustfft::{Fft, FftPlanner};

use proto::radar::Band;

use super::calibration::Calibration;
use super::{InvalidSetting, single};

/// Profiles of all channels, `[channel][delay sample]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Profiles {
    /// Samples of one profile.
    pub sample_count: usize,
    /// Delay samples per second.
    pub sample_rate_hz: f64,
    /// All samples, one channel after the other.
    pub samples: Vec<Complex<f32>>,
}

impl Profiles {
    /// The profile of each channel in turn.
    pub fn channels(&self) -> impl Iterator<Item = &[Complex<f32>]> {
        self.samples.chunks_exact(self.sample_count)
    }
}

/// The memory of one compression, reused from sweep to sweep.
#[derive(Clone, Debug)]
pub struct Compressed {
    /// The last profiles.
    pub profiles: Profiles,
    scratch: Vec<Complex<f32>>,
}

/// The window and the transform, planned once.
#[derive(Clone)]
pub struct Compressor {
    /// `[channel][frequency]`, or `[frequency]` if all channels are alike.
    weights: Vec<Complex<f32>>,
    step_count: usize,
    carrier_index: usize,
    sample_rate_hz: f64,
    transform: Arc<dyn Fft<f32>>,
}

impl fmt::Debug for Compressor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let length = self.transform.len();
        f.debug_struct("Compressor").field("fft_length", &length).finish_non_exhaustive()
    }
}

impl Compressor {
    /// Plans for `band` with one weight per frequency and `fft_length ≥ step_count` delay samples.
    #[must_use]
    pub fn new(band: &Band, weights: &[f64], fft_length: usize) -> Self {
        Self {
            weights: weights.iter().map(|w| Complex::new(single(*w), 0.0)).collect(),
            step_count: weights.len(),
            carrier_index: band.carrier_index(),
            sample_rate_hz: band.step_hz * fft_length as f64,
            transform: FftPlanner::new().plan_fft_inverse(fft_length),
        }
    }

    /// The same for channels that are as `calibration` says.
    ///
    /// # Errors
    /// If `calibration` is not for `channel_count` channels, or holds nonsense.
    pub fn calibrated(
        mut self,
        calibration: &Calibration,
        band: &Band,
        channel_count: usize,
    ) -> Result<Self, InvalidSetting> {
        calibration.check(channel_count)?;
        if calibration.is_ideal() {
            return Ok(self);
        }
        let window = &self.weights[..self.step_count];
        let of_channel = |channel: usize| {
            window.iter().enumerate().map(move |(k, weight)| {
                let undo = calibration.correction(channel, band.frequency_hz(k));
                weight * single_complex(undo)
            })
        };
        self.weights = (0..channel_count).flat_map(of_channel).collect();
        Ok(self)
    }

    /// The memory for `channel_count` channels.
    #[must_use]
    pub fn memory(&self, channel_count: usize) -> Compressed {
        let (sample_count, sample_rate_hz) = (self.transform.len(), self.sample_rate_hz);
        let samples = vec![Complex::default(); channel_count * sample_count];
        let scratch = vec![Complex::default(); self.transform.get_inplace_scratch_len()];
        Compressed { profiles: Profiles { sample_count, sample_rate_hz, samples }, scratch }
    }

    /// The profiles of `samples`, `[channel][frequency]`.
    #[must_use]
    pub fn compress(&self, samples: &[Complex<f32>]) -> Profiles {
        let mut memory = self.memory(samples.len() / self.step_count);
        self.compress_into(samples, &mut memory);
        memory.profiles
    }

    /// Sets `memory.profiles` to the profiles of `samples`, `[channel][frequency]`. The memory is
    /// one of [`Self::memory`] for as many channels.
    pub fn compress_into(&self, samples: &[Complex<f32>], memory: &mut Compressed) {
        let Compressed { profiles, scratch } = memory;
        let sample_count = self.transform.len();
        profiles.samples.fill(Complex::default());
        let channels = samples.chunks_exact(self.step_count);
        let weights = self.weights.chunks_exact(self.step_count).cycle();
        let targets = profiles.samples.chunks_exact_mut(sample_count);
        for ((profile, sweep), of_channel) in targets.zip(channels).zip(weights) {
            for (k, (sample, weight)) in sweep.iter().zip(of_channel).enumerate() {
                // The carrier goes to bin 0 and what lies below it to the end, as negative frequencies.
                let bin = (k + sample_count - self.carrier_index) % sample_count;
                profile[bin] = sample * weight;
            }
        }
        self.transform.process_with_scratch(&mut profiles.samples, scratch);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::window::Window;
    use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};
    use std::f64::consts::TAU;

    /// Rounding of a single-precision transform, relative to the largest value.
    const TRANSFORM_TOLERANCE: f64 = 2e-6;

    fn double(z: Complex<f32>) -> Complex<f64> {
        Complex::new(f64::from(z.re), f64::from(z.im))
    }

    /// The profile of one channel at `t_s`, as it is defined.
    fn plain_sum(sweep: &[Complex<f32>], weights: &[f64], t_s: f64) -> Complex<f64> {
        let band = Band { step_count: weights.len(), ..Band::default() };
        let turns = |k: usize| (band.frequency_hz(k) - band.carrier_hz()) * t_s;
        let term = |k: usize| double(sweep[k]) * weights[k] * Complex::cis(TAU * turns(k));
        (0..weights.len()).map(term).sum()
    }

    #[test]
    fn profiles_are_the_plain_sum_over_all_frequencies() {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        for (step_count, fft_length) in [(301, 2048), (300, 512), (20, 20)] {
            let band = Band { step_count, ..Band::default() };
            let weights = Window::Taylor.weights(step_count);
            let samples: Vec<Complex<f32>> = (0..2 * step_count)
                .map(|_| Complex::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0)))
                .collect();
            let profiles = Compressor::new(&band, &weights, fft_length).compress(&samples);
            for (profile, sweep) in profiles.channels().zip(samples.chunks_exact(step_count)) {
                let t_s = |n: usize| n as f64 / profiles.sample_rate_hz;
                let error = |n| (double(profile[n]) - plain_sum(sweep, &weights, t_s(n))).norm();
                let errors = [0, 1, 7, fft_length / 2, fft_length - 1].map(error);
                assert!(
                    errors.iter().all(|e| *e < TRANSFORM_TOLERANCE),
                    "{step_count}: {errors:?}"
                );
            }
        }
    }

    #[test]
    fn an_echo_peaks_at_its_delay_with_its_reflectivity_and_the_carriers_phase() {
        let band = Band::default();
        let compressor = Compressor::new(&band, &Window::Hann.weights(301), 2048);
        let t_s = 100.0 / (2048.0 * band.step_hz);
        let samples: Vec<Complex<f32>> = (0..301)
            .map(|k| Complex::cis(-TAU * band.frequency_hz(k) * t_s) * 0.7)
            .map(single_complex)
            .collect();
        let profiles = compressor.compress(&samples);
        let peak = profiles.samples[100];
        let want = Complex::cis(-TAU * band.carrier_hz() * t_s) * 0.7;
        assert!((f64::from(peak.re) - want.re).hypot(f64::from(peak.im) - want.im) < 1e-5);
        assert!(profiles.samples.iter().all(|s| s.norm() <= peak.norm() + 1e-6));
    }
}
