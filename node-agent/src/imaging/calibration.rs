//! What the hardware does to each channel, and how it is undone.
//!
//! The sweep of a channel holds the true echo times `g exp(j φ) exp(−j 2π f d)` with the gain `g`, the
//! phase `φ` in radians and the delay `d` in seconds (of cables, say). The weights of compression hold
//! its inverse, so that the geometry of the image stays ideal.

use std::f64::consts::TAU;

use rustfft::num_complex::Complex;
use serde::{Deserialize, Serialize};

use super::{InvalidSetting, invalid};

/// Largest gain or loss, decibels.
const MAX_GAIN_DB: f64 = 120.0;
/// Longest delay, seconds: 300 m of cable.
const MAX_DELAY_S: f64 = 1e-6;

/// The channels' errors, each list in the order of the channels, `t · rx_count + r`; an empty list
/// stands for ideal channels.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Calibration {
    /// Gains, decibels.
    pub gain_db: Vec<f64>,
    /// Phases, radians.
    pub phase_rad: Vec<f64>,
    /// Delays beyond those of the paths through air and wall, seconds.
    pub delay_s: Vec<f64>,
}

impl Calibration {
    /// Checks every list for a radar of `channel_count` channels.
    ///
    /// # Errors
    /// Names the first list that has another length, or holds a number that makes no sense.
    pub fn check(&self, channel_count: usize) -> Result<(), InvalidSetting> {
        for (field, list, limit) in [
            ("calibration.gain_db", &self.gain_db, MAX_GAIN_DB),
            ("calibration.phase_rad", &self.phase_rad, TAU),
            ("calibration.delay_s", &self.delay_s, MAX_DELAY_S),
        ] {
            if !list.is_empty() && list.len() != channel_count {
                let value = format!("{} numbers for {channel_count} channels", list.len());
                return Err(invalid(field, value, "list one number per channel, or none"));
            }
            if let Some(value) = list.iter().find(|value| !(-limit..=limit).contains(*value)) {
                return Err(invalid(field, value, "use at most ±120 dB, ±2π rad and ±1e-6 s"));
            }
        }
        Ok(())
    }

    /// Whether there is nothing to undo.
    #[must_use]
    pub fn is_ideal(&self) -> bool {
        [&self.gain_db, &self.phase_rad, &self.delay_s].into_iter().all(Vec::is_empty)
    }

    /// What a sample of `channel` at `frequency_hz` is multiplied by to become the true echo.
    #[must_use]
    pub fn correction(&self, channel: usize, frequency_hz: f64) -> Complex<f64> {
        let of = |list: &[f64]| list.get(channel).copied().unwrap_or(0.0);
        let turn_rad = TAU * frequency_hz * of(&self.delay_s) - of(&self.phase_rad);
        Complex::from_polar(10_f64.powf(-of(&self.gain_db) / 20.0), turn_rad)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::compress::Compressor;
    use crate::imaging::single;
    use crate::imaging::window::Window;
    use proto::radar::Band;
    use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};

    /// Rounding of a single-precision transform of samples near one.
    const TOLERANCE: f32 = 3e-6;

    /// What hardware with these errors makes of the true echo, written out.
    fn distorted(true_echo: Complex<f32>, errors: [f64; 3], frequency_hz: f64) -> Complex<f32> {
        let [gain_db, phase_rad, delay_s] = errors;
        let angle_rad = phase_rad - TAU * frequency_hz * delay_s;
        let (sin, cos) = angle_rad.sin_cos();
        let gain = 10_f64.powf(gain_db / 20.0);
        true_echo * Complex::new(single(gain * cos), single(gain * sin))
    }

    #[test]
    fn a_distorted_sweep_gives_the_profiles_of_the_ideal_one() {
        let band = Band::default();
        let errors = [[3.0, 0.4, 0.0], [-2.0, -1.1, 2.3e-9], [0.0, 3.0, -0.7e-9]];
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        let ideal: Vec<Complex<f32>> = (0..3 * band.step_count)
            .map(|_| Complex::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0)))
            .collect();
        let bend = |(index, sample): (usize, &Complex<f32>)| {
            let (channel, k) = (index / band.step_count, index % band.step_count);
            distorted(*sample, errors[channel], band.frequency_hz(k))
        };
        let sweep: Vec<Complex<f32>> = ideal.iter().enumerate().map(bend).collect();
        let column = |i: usize| errors.iter().map(|e| e[i]).collect::<Vec<f64>>();
        let calibration =
            Calibration { gain_db: column(0), phase_rad: column(1), delay_s: column(2) };
        let plain = Compressor::new(&band, &Window::Taylor.weights(band.step_count), 2048);
        let want = plain.compress(&ideal);
        let got = plain.calibrated(&calibration, &band, 3).unwrap().compress(&sweep);
        let worst = got.samples.iter().zip(&want.samples).map(|(a, b)| (a - b).norm());
        assert!(worst.fold(0.0, f32::max) < TOLERANCE);
    }

    #[test]
    fn lists_of_nonsense_are_named() {
        assert_eq!(Calibration::default().check(8), Ok(()));
        let short = Calibration { phase_rad: vec![0.0; 7], ..Calibration::default() };
        assert_eq!(short.check(8).unwrap_err().field, "calibration.phase_rad");
        let odd = Calibration { delay_s: vec![f64::NAN, 0.0], ..Calibration::default() };
        assert_eq!(odd.check(2).unwrap_err().field, "calibration.delay_s");
        let loud = Calibration { gain_db: vec![200.0], ..Calibration::default() };
        assert_eq!(loud.check(1).unwrap_err().field, "calibration.gain_db");
        let band = Band::default();
        let compressor = Compressor::new(&band, &[1.0 / 301.0; 301], 2048);
        assert!(compressor.calibrated(&short, &band, 8).is_err());
    }
}
