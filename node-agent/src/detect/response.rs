//! What a point gives in the profiles, and the samples to compare it with.
//!
//! A point of reflectivity 1 at `[r, u]` gives `s_tr(t) = exp(−j 2π f_c τ) D(t − τ)`,
//! `D(t) = Σ_k w_k exp(j 2π (f_k − f_c) t)`, with the delay `τ` in seconds of both legs by the wall
//! model, and `∂s/∂τ = −exp(−j 2π f_c τ) [j 2π f_c D + D′]`.
//! Samples are taken 0.7 resolution cells apart and whitened: the window makes the noise of neighbours
//! alike, `ρ(t) = Σ w_k² exp(j 2π (f_k − f_c) t) / Σ w_k²`. Assumes noise that is white over the band.
//! In the image of `N` channels, a point at `x₀` shows at `x` with the share
//! `(|Σ' exp(j 2π f_c Δτ_tr) Ď(Δτ_tr)| + Σ'' Ď(Δτ_tr)) / N` of its amplitude at most, `Δτ` being the
//! difference of delays, `Ď(t)` the largest `|D|` at `|t|` or beyond, `Σ'` over the channels that
//! see the main lobe there and `Σ''` over those that see sidelobes, whose signs are not followed.

use crate::imaging::double;
use std::f64::consts::TAU;

use nalgebra::{DMatrix, DVector};
use rustfft::num_complex::Complex;

use proto::radar::{Array, Band, SPEED_OF_LIGHT_M_PER_S};

use crate::imaging::wall::WallModel;

use super::Scan;
use super::moments::{Polar, to_cartesian};
use super::table::Table;

/// Profiles are compared this far before and behind the places, metres of range.
const PATCH_MARGIN_M: f64 = 0.35;
/// Distance of the samples in resolution cells `1 / (K Δf)`: at one cell, what the window suppresses
/// aliases, and the error grows by 7 %.
const STRIDE_CELLS: f64 = 0.7;
/// Where the response is less than this share of its peak it is a sidelobe.
const SIDELOBE_SHARE: f64 = 0.05;
/// Steps of the differences of delays: range in metres and sine.
const DIFFERENCE_STEP: [f64; 2] = [1e-4, 1e-4];

/// The point response of one radar and wall.
#[derive(Clone, Debug)]
pub struct PointModel {
    array: Array,
    wall: WallModel,
    carrier_hz: f64,
    cell_s: f64,
    response: Table,
    slope_per_s: Table,
    envelope: Table,
    noise_correlation: Table,
}

/// Profile samples around some places.
#[derive(Clone, Debug)]
pub struct Patch {
    /// Delays of the samples of each channel, seconds, evenly spaced.
    pub delays_s: Vec<Vec<f64>>,
    /// The samples, whitened, channel after channel.
    pub samples: DVector<Complex<f64>>,
    /// Noise power `σ²` of a sample.
    pub noise_power: f64,
    /// The transposed inverse of the root of the noise's covariance over `σ²`, for the longest
    /// channel; its first rows and columns serve shorter ones.
    whitening: DMatrix<Complex<f64>>,
}

impl PointModel {
    /// Tabulates the response of a radar with one weight per frequency.
    #[must_use]
    pub fn new(band: &Band, array: &Array, wall: &WallModel, weights: &[f64]) -> Self {
        let cell_s = 1.0 / (band.step_hz * band.step_count as f64);
        let power: f64 = weights.iter().map(|w| w * w).sum();
        let offset_rad = |k: usize| TAU * (band.frequency_hz(k) - band.carrier_hz());
        let table = |value: &dyn Fn(usize, f64) -> Complex<f64>| {
            let terms: Vec<_> =
                weights.iter().enumerate().map(|(k, w)| (offset_rad(k), value(k, *w))).collect();
            Table::new(cell_s, &terms)
        };
        let response = table(&|_, w| Complex::new(w, 0.0));
        Self {
            array: array.clone(),
            wall: *wall,
            carrier_hz: band.carrier_hz(),
            cell_s,
            envelope: response.envelope(),
            response,
            slope_per_s: table(&|k, w| Complex::new(0.0, offset_rad(k) * w)),
            noise_correlation: table(&|_, w| Complex::new(w * w / power, 0.0)),
        }
    }

    /// The samples of all channels around `places`, less than a resolution cell apart; `None` if there are none.
    #[expect(clippy::cast_possible_truncation, reason = "delays of at most some thousand samples")]
    #[must_use]
    pub fn patch(&self, scan: &Scan<'_>, places: &[Polar]) -> Option<Patch> {
        let rate_hz = scan.profiles.sample_rate_hz;
        let stride = ((self.cell_s * rate_hz * STRIDE_CELLS) as usize).max(1);
        let margin_s = 2.0 * PATCH_MARGIN_M / SPEED_OF_LIGHT_M_PER_S;
        let of_places: Vec<Vec<f64>> = places.iter().map(|place| self.delays_s(place)).collect();
        let mut delays_s = Vec::new();
        let mut values = Vec::new();
        for (channel, profile) in scan.profiles.channels().enumerate() {
            let of_channel = || of_places.iter().map(|delays| delays[channel]);
            let from_s = of_channel().fold(f64::INFINITY, f64::min) - margin_s;
            let to_s = of_channel().fold(0.0, f64::max) + margin_s;
            let last = ((to_s * rate_hz) as usize).min(profile.len() - 1);
            let chosen = ((from_s * rate_hz).max(0.0) as usize..=last).step_by(stride);
            delays_s.push(chosen.clone().map(|n| n as f64 / rate_hz).collect::<Vec<f64>>());
            values.extend(chosen.map(|n| double(profile[n])));
        }
        let longest = delays_s.iter().max_by_key(|delays: &&Vec<f64>| delays.len())?;
        let whitening = self.whitening(longest)?.transpose();
        let noise_power = f64::from(scan.noise_power).max(f64::MIN_POSITIVE);
        let mut patch = Patch { delays_s, samples: DVector::zeros(0), noise_power, whitening };
        patch.whiten(&mut values);
        patch.samples = DVector::from_vec(values);
        Some(patch)
    }

    /// `L⁻¹` with `L Lᴴ` the covariance of the noise at `delays_s` over its power.
    fn whitening(&self, delays_s: &[f64]) -> Option<DMatrix<Complex<f64>>> {
        let entry =
            |row: usize, column: usize| self.noise_correlation.at(delays_s[row] - delays_s[column]);
        let covariance = DMatrix::from_fn(delays_s.len(), delays_s.len(), entry);
        let root = covariance.cholesky()?.unpack();
        root.solve_lower_triangular(&DMatrix::identity(delays_s.len(), delays_s.len()))
    }

    /// The delays of all channels to `place`, seconds.
    fn delays_s(&self, place: &Polar) -> Vec<f64> {
        let paths_m = self.wall.channel_paths_m(&self.array, &to_cartesian(place));
        paths_m.into_iter().map(|path_m| path_m / SPEED_OF_LIGHT_M_PER_S).collect()
    }

    /// What a point of reflectivity 1 at `place` gives in the samples of `patch`, whitened, and how
    /// that changes with range (per metre) and with the sine.
    #[must_use]
    pub fn response(&self, patch: &Patch, place: &Polar) -> [DVector<Complex<f64>>; 3] {
        let delays_s = self.delays_s(place);
        let slopes_s = [0, 1].map(|axis| self.delay_slopes_s(place, axis));
        let capacity = patch.samples.len();
        let mut columns = [(); 3].map(|()| Vec::with_capacity(capacity));
        for (channel, (delay_s, sampled_s)) in delays_s.iter().zip(&patch.delays_s).enumerate() {
            let carrier = Complex::cis(-TAU * self.carrier_hz * delay_s);
            let turn = Complex::new(0.0, TAU * self.carrier_hz);
            for t_s in sampled_s {
                let value = self.response.at(t_s - delay_s);
                let slope = -carrier * (turn * value + self.slope_per_s.at(t_s - delay_s));
                columns[0].push(carrier * value);
                columns[1].push(slope * slopes_s[0][channel]);
                columns[2].push(slope * slopes_s[1][channel]);
            }
        }
        columns.map(|mut column| {
            patch.whiten(&mut column);
            DVector::from_vec(column)
        })
    }

    /// `∂τ / ∂r` (axis 0) or `∂τ / ∂u` (axis 1) of all channels, by central differences.
    fn delay_slopes_s(&self, place: &Polar, axis: usize) -> Vec<f64> {
        let step = DIFFERENCE_STEP[axis];
        let shifted = |by: f64| {
            let mut moved = *place;
            moved[axis] += by;
            self.delays_s(&moved)
        };
        let pairs = shifted(step).into_iter().zip(shifted(-step));
        pairs.map(|(after, before)| (after - before) / (2.0 * step)).collect()
    }

    /// The share of the amplitude of a point at `from` that the image can show at `to`: 1 at the
    /// point itself.
    #[must_use]
    pub fn leakage(&self, from: &Polar, to: &Polar) -> f64 {
        let mut coherent = Complex::new(0.0, 0.0);
        let mut incoherent = 0.0;
        for (to_s, from_s) in self.delays_s(to).into_iter().zip(self.delays_s(from)) {
            let delay_s = to_s - from_s;
            let share = self.envelope.at_or_tail(delay_s);
            if share < SIDELOBE_SHARE {
                incoherent += share;
            } else {
                coherent += Complex::cis(TAU * self.carrier_hz * delay_s) * share;
            }
        }
        (coherent.norm() + incoherent) / self.array.channel_count() as f64
    }

    /// How much farther than a target at the sine `sine` its first echo inside the wall appears,
    /// metres of range: `d sqrt(ε − u²)`. `None` without a wall.
    #[must_use]
    pub fn wall_echo_m(&self, sine: f64) -> Option<f64> {
        match self.wall {
            WallModel::None => None,
            WallModel::Refraction(wall) | WallModel::FixedDelay(wall) => {
                Some(wall.thickness_m * (wall.permittivity - sine * sine).max(0.0).sqrt())
            }
        }
    }
}

impl Patch {
    /// Whitens `values`, channel after channel, in place.
    fn whiten(&self, values: &mut [Complex<f64>]) {
        let longest = self.whitening.nrows();
        let mut rest = values;
        for delays_s in &self.delays_s {
            let (channel, after) = rest.split_at_mut(delays_s.len());
            // From the last row up, since a row reads only the rows before it.
            for row in (0..channel.len()).rev() {
                let coefficients = &self.whitening.as_slice()[row * longest..][..=row];
                let terms = coefficients.iter().zip(channel.iter());
                channel[row] = terms.map(|(coefficient, value)| coefficient * value).sum();
            }
            rest = after;
        }
    }
}

#[cfg(test)]
mod tests;
