//! Back-projection as textbooks have it: what the fast kernels are checked against and compared with.
//!
//! Exact: `z_tr(x) = Σ_k w_k S_tr(f_k) exp(j 2π f_k (τ_t + τ_r))` over all frequencies in double
//! precision, without profile or table; `I = Σ z_tr`, `E = Σ |z_tr|²` \[registration, section 4\].
//! Textbook loop: for each pixel and channel two square roots, a linear interpolation of the profile
//! and a sine and cosine, in double precision, in air.

use std::f64::consts::TAU;

use nalgebra::Vector2;
use rustfft::num_complex::Complex;

use proto::radar::{Array, Band, SPEED_OF_LIGHT_M_PER_S};

use super::backproject::CoherentImage;
use super::compress::Profiles;
use super::pixels::Pixels;
use super::single;
use super::wall::WallModel;

/// The exact matched filter of one radar and wall.
#[derive(Clone, Copy, Debug)]
pub struct MatchedFilter<'a> {
    /// Frequencies of a sweep.
    pub band: &'a Band,
    /// Antennas.
    pub array: &'a Array,
    /// The wall before the array.
    pub wall: &'a WallModel,
    /// One weight per frequency.
    pub weights: &'a [f64],
}

impl MatchedFilter<'_> {
    /// The focused samples `z_tr` of all channels at `place_m`, `[x, y]` in the node's frame, metres,
    /// from `samples`, `[channel][frequency]`.
    #[must_use]
    pub fn focused(&self, samples: &[Complex<f32>], place_m: Vector2<f64>) -> Vec<Complex<f64>> {
        let leg_m = |antenna: &[f64; 2]| {
            self.wall.leg_path_m(place_m.x - antenna[0], place_m.y - antenna[1])
        };
        let paths_m = self
            .array
            .tx_m
            .iter()
            .flat_map(|tx| self.array.rx_m.iter().map(move |rx| leg_m(tx) + leg_m(rx)));
        let channels = samples.chunks_exact(self.band.step_count);
        paths_m.zip(channels).map(|(path_m, sweep)| self.channel(sweep, path_m)).collect()
    }

    /// One channel, its phase over `path_m` undone at every frequency.
    fn channel(&self, sweep: &[Complex<f32>], path_m: f64) -> Complex<f64> {
        let term = |(k, (sample, weight)): (usize, (&Complex<f32>, &f64))| {
            let turns = self.band.frequency_hz(k) * path_m / SPEED_OF_LIGHT_M_PER_S;
            let value = Complex::new(f64::from(sample.re), f64::from(sample.im));
            Complex::cis(TAU * turns) * value * *weight
        };
        sweep.iter().zip(self.weights).enumerate().map(term).sum()
    }
}

/// The image of `profiles` by the textbook's loop, in air.
#[must_use]
pub fn textbook_image(
    band: &Band,
    array: &Array,
    pixels: &Pixels,
    profiles: &Profiles,
) -> CoherentImage {
    let mut image = CoherentImage {
        pixels: *pixels,
        channel_count: array.channel_count(),
        power: Vec::with_capacity(pixels.pixel_count()),
        energy: Vec::with_capacity(pixels.pixel_count()),
        phase_coherence: Vec::new(),
    };
    let pairs: Vec<[[f64; 2]; 2]> =
        array.tx_m.iter().flat_map(|tx| array.rx_m.iter().map(move |rx| [*tx, *rx])).collect();
    for index in 0..pixels.pixel_count() {
        let place_m = pixels.coords_m(index);
        let (mut sum, mut energy) = (Complex::new(0.0, 0.0), 0.0);
        for (pair, profile) in pairs.iter().zip(profiles.channels()) {
            let path_m: f64 = pair
                .iter()
                .map(|[x_m, y_m]| ((place_m.x - x_m).powi(2) + (place_m.y - y_m).powi(2)).sqrt())
                .sum();
            let delay_s = path_m / SPEED_OF_LIGHT_M_PER_S;
            let value = interpolated(profile, delay_s * profiles.sample_rate_hz);
            sum += Complex::cis(TAU * band.carrier_hz() * delay_s) * value;
            energy += value.norm_sqr();
        }
        image.power.push(single(sum.norm_sqr()));
        image.energy.push(single(energy));
    }
    image
}

/// The value of `profile` at `delay` samples, by linear interpolation; zero beyond it.
#[expect(clippy::cast_possible_truncation, reason = "the whole part is meant")]
fn interpolated(profile: &[Complex<f32>], delay: f64) -> Complex<f64> {
    let before = delay as usize;
    let rest = delay - before as f64;
    let at = |index: usize| {
        let sample = profile.get(index).copied().unwrap_or_default();
        Complex::new(f64::from(sample.re), f64::from(sample.im))
    };
    at(before) * (1.0 - rest) + at(before + 1) * rest
}
