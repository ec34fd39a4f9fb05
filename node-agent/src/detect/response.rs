//! What a point gives in the profiles, and the samples to compare it with.
//!
//! A point of reflectivity 1 at `[r, u]` gives `s_tr(t) = exp(−j 2π f_c τ) D(t − τ)`,
//! `D(t) = Σ_k w_k exp(j 2π (f_k − f_c) t)`, with the delay `τ` of both legs by the wall model.
//! Samples are taken a resolution cell apart and whitened: the window makes the noise of neighbours
//! alike, `ρ(t) = Σ w_k² exp(j 2π (f_k − f_c) t) / Σ w_k²`. Assumes noise that is white over the band.

use std::f64::consts::TAU;

use nalgebra::{DMatrix, DVector};
use rustfft::num_complex::Complex;

use proto::radar::{Array, Band, SPEED_OF_LIGHT_M_PER_S};

use crate::imaging::wall::WallModel;

use super::Scan;
use super::moments::{Polar, to_cartesian};

/// Profiles are compared this far before and behind the places, metres of range.
const PATCH_MARGIN_M: f64 = 0.35;
/// Tables reach this far, in resolution cells `1 / (K Δf)`, and are zero beyond.
const TABLE_HALF_CELLS: f64 = 12.0;
/// Entries of a table per cell: linear interpolation errs by −74 dB.
const TABLE_STEPS_PER_CELL: f64 = 64.0;
/// `2 · 12 · 64` steps.
const TABLE_ENTRY_COUNT: usize = 1537;
/// The point response of one radar and wall.
#[derive(Clone, Debug)]
pub struct PointModel {
    array: Array,
    wall: WallModel,
    carrier_hz: f64,
    cell_s: f64,
    response: Table,
    noise_correlation: Table,
}

/// A function of delay, tabulated.
#[derive(Clone, Debug)]
struct Table {
    cell_s: f64,
    values: Vec<Complex<f64>>,
}

/// Profile samples around some places.
#[derive(Clone, Debug)]
pub struct Patch {
    /// Delays of the samples of each channel, seconds.
    pub delays_s: Vec<Vec<f64>>,
    /// The root of the noise's covariance over `σ²`, each channel.
    noise_roots: Vec<DMatrix<Complex<f64>>>,
    /// The samples, whitened, channel after channel.
    pub samples: DVector<Complex<f64>>,
    /// Noise power of a sample.
    pub noise_power: f64,
}

impl PointModel {
    /// Tabulates the response of a radar with one weight per frequency.
    #[must_use]
    pub fn new(band: &Band, array: &Array, wall: &WallModel, weights: &[f64]) -> Self {
        let cell_s = 1.0 / (band.step_hz * band.step_count as f64);
        let power: f64 = weights.iter().map(|w| w * w).sum();
        let noise_weights: Vec<f64> = weights.iter().map(|w| w * w / power).collect();
        Self {
            array: array.clone(),
            wall: *wall,
            carrier_hz: band.carrier_hz(),
            cell_s,
            response: Table::new(band, cell_s, weights),
            noise_correlation: Table::new(band, cell_s, &noise_weights),
        }
    }

    /// The samples of all channels around `places`, a resolution cell apart; `None` if there are none.
    #[expect(clippy::cast_possible_truncation, reason = "delays of at most some thousand samples")]
    #[must_use]
    pub fn patch(&self, scan: &Scan<'_>, places: &[Polar]) -> Option<Patch> {
        let rate_hz = scan.profiles.sample_rate_hz;
        let stride = ((self.cell_s * rate_hz) as usize).max(1);
        let margin_s = 2.0 * PATCH_MARGIN_M / SPEED_OF_LIGHT_M_PER_S;
        let of_places: Vec<Vec<f64>> = places.iter().map(|place| self.delays_s(place)).collect();
        let mut patch = Patch {
            delays_s: Vec::new(),
            noise_roots: Vec::new(),
            samples: DVector::zeros(0),
            noise_power: f64::from(scan.noise_power).max(f64::MIN_POSITIVE),
        };
        let mut samples = Vec::new();
        for (channel, profile) in scan.profiles.channels().enumerate() {
            let of_channel = || of_places.iter().map(|delays| delays[channel]);
            let from_s = of_channel().fold(f64::INFINITY, f64::min) - margin_s;
            let to_s = of_channel().fold(0.0, f64::max) + margin_s;
            let last = ((to_s * rate_hz) as usize).min(profile.len() - 1);
            let chosen = ((from_s * rate_hz).max(0.0) as usize..=last).step_by(stride);
            let delays_s: Vec<f64> = chosen.clone().map(|n| n as f64 / rate_hz).collect();
            let root = self.noise_root(&delays_s)?;
            let values = chosen.map(|n| Complex::new(profile[n].re.into(), profile[n].im.into()));
            samples.extend(
                root.solve_lower_triangular(&DVector::from_iterator(delays_s.len(), values))?
                    .iter(),
            );
            patch.delays_s.push(delays_s);
            patch.noise_roots.push(root);
        }
        patch.samples = DVector::from_vec(samples);
        Some(patch)
    }

    /// `L` of `L Lᴴ`, the covariance of the noise at `delays_s` over its power.
    fn noise_root(&self, delays_s: &[f64]) -> Option<DMatrix<Complex<f64>>> {
        let entry =
            |row: usize, column: usize| self.noise_correlation.at(delays_s[row] - delays_s[column]);
        let covariance = DMatrix::from_fn(delays_s.len(), delays_s.len(), entry);
        Some(covariance.cholesky()?.unpack())
    }

    /// The delays of all channels to `place`, seconds.
    fn delays_s(&self, place: &Polar) -> Vec<f64> {
        let place_m = to_cartesian(place);
        let leg = |antenna: &[f64; 2]| {
            let path_m = self.wall.leg_path_m(place_m.x - antenna[0], place_m.y - antenna[1]);
            path_m / SPEED_OF_LIGHT_M_PER_S
        };
        let rx_s: Vec<f64> = self.array.rx_m.iter().map(leg).collect();
        self.array.tx_m.iter().map(leg).flat_map(|tx| rx_s.iter().map(move |rx| tx + rx)).collect()
    }

    /// What a point of reflectivity 1 at `place` gives in the samples of `patch`.
    #[must_use]
    pub fn response(&self, patch: &Patch, place: &Polar) -> DVector<Complex<f64>> {
        let mut response = DVector::zeros(patch.samples.len());
        let mut start = 0;
        let channels =
            self.delays_s(place).into_iter().zip(&patch.delays_s).zip(&patch.noise_roots);
        for ((delay_s, sampled_s), root) in channels {
            let carrier = Complex::cis(-TAU * self.carrier_hz * delay_s);
            let mut channel = response.rows_mut(start, sampled_s.len());
            for (value, t_s) in channel.iter_mut().zip(sampled_s) {
                *value = carrier * self.response.at(t_s - delay_s);
            }
            root.solve_lower_triangular_unchecked_mut(&mut channel);
            start += sampled_s.len();
        }
        response
    }
}

impl Table {
    /// `Σ_k w_k exp(j 2π (f_k − f_c) t)` over ±[`TABLE_HALF_CELLS`] cells.
    fn new(band: &Band, cell_s: f64, weights: &[f64]) -> Self {
        let value_at = |entry: usize| -> Complex<f64> {
            let t_s = cell_s * (entry as f64 / TABLE_STEPS_PER_CELL - TABLE_HALF_CELLS);
            let turn = |(k, w): (usize, &f64)| {
                Complex::cis(TAU * (band.frequency_hz(k) - band.carrier_hz()) * t_s) * w
            };
            weights.iter().enumerate().map(turn).sum()
        };
        Self { cell_s, values: (0..TABLE_ENTRY_COUNT).map(value_at).collect() }
    }

    /// The value at `t_s`, by linear interpolation; zero beyond the table.
    #[expect(clippy::cast_possible_truncation, reason = "the whole part is meant")]
    fn at(&self, t_s: f64) -> Complex<f64> {
        let entry = (t_s / self.cell_s + TABLE_HALF_CELLS) * TABLE_STEPS_PER_CELL;
        if entry < 0.0 || (self.values.len() - 1) as f64 <= entry {
            return Complex::new(0.0, 0.0);
        }
        let before = entry as usize;
        let rest = entry - before as f64;
        self.values[before] * (1.0 - rest) + self.values[before + 1] * rest
    }
}

#[cfg(test)]
mod tests {
    use super::super::moments::to_polar;
    use super::*;
    use crate::imaging::backproject::CoherentImage;
    use crate::imaging::compress::{Compressor, Profiles};
    use crate::imaging::single;
    use crate::imaging::window::Window;
    use proto::radar::Grid;

    /// The profiles of one point, by the plain sum over legs and frequencies.
    fn profiles_of(place_m: [f64; 2], weights: &[f64]) -> Profiles {
        let (band, array) = (Band::default(), Array::default());
        let echo = |(tx, rx): (&[f64; 2], &[f64; 2])| -> Vec<Complex<f32>> {
            let path_m =
                (place_m[0] - tx[0]).hypot(place_m[1]) + (place_m[0] - rx[0]).hypot(place_m[1]);
            let turns = |k| band.frequency_hz(k) * path_m / SPEED_OF_LIGHT_M_PER_S;
            let sample = |z: Complex<f64>| Complex::new(single(z.re), single(z.im));
            (0..band.step_count).map(|k| sample(Complex::cis(-TAU * turns(k)))).collect()
        };
        let pairs = array.tx_m.iter().flat_map(|tx| array.rx_m.iter().map(move |rx| (tx, rx)));
        let samples: Vec<Complex<f32>> = pairs.flat_map(echo).collect();
        Compressor::new(&band, weights, 2048).compress(&samples)
    }

    #[test]
    fn the_model_is_what_compression_makes_of_an_echo() {
        let (band, array) = (Band::default(), Array::default());
        for window in [Window::Rectangular, Window::Taylor] {
            let weights = window.weights(band.step_count);
            let model = PointModel::new(&band, &array, &WallModel::None, &weights);
            let profiles = profiles_of([1.2, 3.9], &weights);
            let image = CoherentImage {
                grid: Grid::default(),
                channel_count: 8,
                power: vec![],
                energy: vec![],
            };
            let scan =
                Scan { profiles: &profiles, image: &image, amplitude: &[], noise_power: 1.0 };
            let place = to_polar(&nalgebra::Vector2::new(1.2, 3.9));
            // The patch lies around a place nearby: the tails of the response count, too.
            let patch = model.patch(&scan, &[place + Polar::new(0.1, 0.03)]).unwrap();
            assert!(24 <= patch.samples.len());
            let error =
                (model.response(&patch, &place) - &patch.samples).norm() / patch.samples.norm();
            assert!(error < 1e-3, "{window:?}: {error}");
        }
    }

    #[test]
    fn whitened_noise_is_white() {
        let band = Band::default();
        let weights = Window::Hann.weights(band.step_count);
        let model = PointModel::new(&band, &Array::default(), &WallModel::None, &weights);
        let delays_s: Vec<f64> = (0..5).map(|n| 1.5e-9 * f64::from(n)).collect();
        let root = model.noise_root(&delays_s).unwrap();
        let power: f64 = weights.iter().map(|w| w * w).sum();
        let covariance = &root * root.adjoint();
        for (row, column) in [(0, 0), (1, 0), (4, 2), (0, 3)] {
            let lag_s = delays_s[row] - delays_s[column];
            let want: Complex<f64> = (0..band.step_count)
                .map(|k| {
                    Complex::cis(TAU * (band.frequency_hz(k) - 1.9e9) * lag_s) * weights[k].powi(2)
                })
                .sum();
            assert!((covariance[(row, column)] - want / power).norm() < 1e-3, "{row} {column}");
        }
    }
}
