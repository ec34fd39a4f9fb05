//! A gate over delay that lets an interval through and shuts out what lies before and behind it.
//!
//! Echoes with delays `τ_j` half a resolution cell apart span what an interval can hold:
//! `a(τ)_k = exp(−j 2π (f_k − f̄) τ)`, `f̄` the middle of the band. Their Gram matrix is real,
//! `G_ij = D(τ_i − τ_j)`, `D(t) = sin(π K Δf t) / sin(π Δf t)`; with `G = U Λ Uᵀ` the columns of
//! `V = A U Λ^{−1/2}` are orthonormal, and those with the largest `Λ` are the functions of the band
//! that are best concentrated in the interval \[slepian1978\]. Samples are replaced by `Vᴴ x`: white
//! noise stays white, an echo at `τ` becomes the real vector `Λ^{−1/2} Uᵀ D(τ_j − τ)`.
//! Cost: one eigenvalue problem of `J ≈ 2 · interval / cell`, then `K J` for each channel.

use crate::imaging::double;
use std::f64::consts::{PI, TAU};

use nalgebra::{DMatrix, DVector};
use proto::radar::Band;
use rustfft::num_complex::Complex;

/// Delays per resolution cell `1 / (K Δf)`.
const DELAYS_PER_CELL: f64 = 2.0;
/// A function is let through if this share of what it holds comes from the interval: an echo from
/// beyond leaks in with −30 dB at most. With 0.9 the errors of fits were twice what they claimed.
const MIN_CONCENTRATION: f64 = 0.999;

/// The gate of one band and interval.
#[derive(Clone, Debug)]
pub(super) struct Gate {
    step_hz: f64,
    step_count: f64,
    delays_s: Vec<f64>,
    /// `U Λ^{−1/2}`, `[delay][function]`.
    basis: DMatrix<f64>,
}

impl Gate {
    /// The gate from `from_s` to `to_s`.
    pub(super) fn new(band: &Band, from_s: f64, to_s: f64) -> Self {
        let (step_hz, step_count) = (band.step_hz, band.step_count as f64);
        let spacing_s = 1.0 / (DELAYS_PER_CELL * step_count * step_hz);
        #[expect(clippy::cast_possible_truncation, reason = "some dozens of delays")]
        let delay_count = ((to_s - from_s) / spacing_s).ceil().max(2.0) as usize;
        let delays_s: Vec<f64> = (0..delay_count).map(|j| from_s + spacing_s * j as f64).collect();
        let gram = DMatrix::from_fn(delay_count, delay_count, |i, j| {
            dirichlet(step_hz, step_count, delays_s[i] - delays_s[j])
        });
        let eigen = gram.symmetric_eigen();
        // All delays of the period 1/Δf together would give the identity times this.
        let whole = 1.0 / (spacing_s * step_hz);
        let columns: Vec<DVector<f64>> = (0..delay_count)
            .filter(|n| MIN_CONCENTRATION < eigen.eigenvalues[*n] / whole)
            .map(|n| eigen.eigenvectors.column(n) / eigen.eigenvalues[n].sqrt())
            .collect();
        let basis = if columns.is_empty() {
            DMatrix::zeros(delay_count, 0)
        } else {
            DMatrix::from_columns(&columns)
        };
        Self { step_hz, step_count, delays_s, basis }
    }

    /// Numbers left of a channel.
    pub(super) fn width(&self) -> usize {
        self.basis.ncols()
    }

    /// An echo of amplitude 1 at `delay_s`, its carrier's phase removed.
    pub(super) fn echo(&self, delay_s: f64) -> DVector<f64> {
        let near = DVector::from_iterator(
            self.delays_s.len(),
            self.delays_s.iter().map(|t_s| dirichlet(self.step_hz, self.step_count, t_s - delay_s)),
        );
        self.basis.tr_mul(&near)
    }

    /// What passes of one channel's samples over frequency: real parts, imaginary parts.
    pub(super) fn pass(&self, sweep: &[Complex<f32>]) -> [DVector<f64>; 2] {
        let middle = 0.5 * (self.step_count - 1.0);
        let at_delay = |t_s: &f64| -> Complex<f64> {
            let step = Complex::cis(TAU * self.step_hz * t_s);
            let mut turn = Complex::cis(-TAU * self.step_hz * middle * t_s);
            let mut sum = Complex::new(0.0, 0.0);
            for sample in sweep {
                sum += double(*sample) * turn;
                turn *= step;
            }
            sum
        };
        let profile: Vec<Complex<f64>> = self.delays_s.iter().map(at_delay).collect();
        [|z: &Complex<f64>| z.re, |z: &Complex<f64>| z.im].map(|part| {
            self.basis.tr_mul(&DVector::from_iterator(profile.len(), profile.iter().map(part)))
        })
    }
}

/// `sin(π K Δf t) / sin(π Δf t)`.
fn dirichlet(step_hz: f64, step_count: f64, t_s: f64) -> f64 {
    let slow = (PI * step_hz * t_s).sin();
    if slow.abs() < 1e-12 { step_count } else { (PI * step_count * step_hz * t_s).sin() / slow }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::single;
    use rand::{SeedableRng, rngs::ChaCha8Rng};
    use rand_distr::{Distribution, StandardNormal};

    const FROM_S: f64 = -3.3e-9;
    const TO_S: f64 = 19e-9;
    /// Samples are single precision.
    const ROUNDING: f64 = 1e-5;

    fn echo_samples(band: &Band, delay_s: f64) -> Vec<Complex<f32>> {
        let middle_hz = band.start_hz + 0.5 * band.step_hz * (band.step_count as f64 - 1.0);
        (0..band.step_count)
            .map(|k| Complex::cis(-TAU * (band.frequency_hz(k) - middle_hz) * delay_s))
            .map(|s| Complex::new(single(s.re), single(s.im)))
            .collect()
    }

    #[test]
    fn an_echo_within_passes_and_one_without_does_not() {
        for band in [Band::default(), Band { step_count: 200, ..Band::default() }] {
            let gate = Gate::new(&band, FROM_S, TO_S);
            for (delay_s, least, most) in
                [(1e-9, 0.7, 1.001), (13e-9, 0.7, 1.001), (25e-9, 0.0, 0.001)]
            {
                let [re, im] = gate.pass(&echo_samples(&band, delay_s));
                let want = gate.echo(delay_s);
                assert!((re - &want).norm() < ROUNDING * want.norm().max(1.0));
                assert!(im.norm() < ROUNDING * (band.step_count as f64));
                let share = want.norm_squared() / band.step_count as f64;
                assert!((least..most).contains(&share), "{delay_s}: {share}");
            }
        }
    }

    #[test]
    fn white_noise_stays_white() {
        let band = Band::default();
        let gate = Gate::new(&band, FROM_S, TO_S);
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut sum = DMatrix::zeros(gate.width(), gate.width());
        let trial_count = 2000;
        for _ in 0..trial_count {
            let noise: Vec<Complex<f32>> = (0..band.step_count)
                .map(|_| {
                    Complex::new(StandardNormal.sample(&mut rng), StandardNormal.sample(&mut rng))
                })
                .collect();
            let [re, _] = gate.pass(&noise);
            sum += &re * re.transpose();
        }
        let off = sum / f64::from(trial_count) - DMatrix::identity(gate.width(), gate.width());
        // Five standard deviations of a variance over 2000 trials.
        assert!(off.amax() < 0.16, "{off}");
    }
}
