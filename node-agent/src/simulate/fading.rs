//! Random functions of time that can be evaluated anywhere: fading and Brownian motion.
//!
//! Fading is a sum of `N` tones of equal strength and random phase,
//! `g(u, v) = N^(-1/2) Σ exp(j (a_n u + b_n v + φ_n))`, `a_n, b_n` normal of variance 2: its mean
//! power over `u` and `v` is 1, its correlation `exp(−Δu² − Δv²)`. `u` is time and `v` way, each
//! over its correlation length. For `N` = 16 its values are Gaussian but for the far tail (the
//! amplitude never exceeds 4).
//!
//! Brownian motion is Lévy's: the end of a span is drawn, then the middle of every half given its
//! ends, `W((s+t)/2) = (W(s) + W(t))/2 + sqrt((t − s)/4) n`, down to a millisecond, and straight
//! lines below.

use std::f64::consts::{SQRT_2, TAU};

use rand::{RngExt, rngs::ChaCha8Rng};
use rand_distr::{Distribution, StandardNormal};
use rustfft::num_complex::Complex;

/// Tones of a fading gain.
const TONE_COUNT: usize = 16;
/// Brownian motion is defined this far on either side of time 0, seconds: twelve days.
const SPAN_S: f64 = 1_048_576.0;
/// Halvings of the span, to 1 ms.
const HALVING_COUNT: usize = 30;

/// A complex gain of mean power 1 that changes smoothly.
#[derive(Clone, Debug)]
pub(super) struct Fading {
    /// Radians per unit of `u`, per unit of `v`, and at 0.
    tones: Vec<[f64; 3]>,
}

impl Fading {
    /// A gain of 0.
    pub(super) fn none() -> Self {
        Self { tones: Vec::new() }
    }

    pub(super) fn new(rng: &mut ChaCha8Rng) -> Self {
        let mut rate = || -> f64 {
            let normal: f64 = StandardNormal.sample(rng);
            SQRT_2 * normal
        };
        let rates: Vec<[f64; 2]> = (0..TONE_COUNT).map(|_| [rate(), rate()]).collect();
        let tones = rates.iter().map(|[u, v]| [*u, *v, TAU * rng.random::<f64>()]).collect();
        Self { tones }
    }

    /// The gain at `u` correlation times and `v` correlation ways.
    pub(super) fn at(&self, u: f64, v: f64) -> Complex<f64> {
        let tones = self.tones.iter().map(|[a, b, phase]| Complex::cis(a * u + b * v + phase));
        tones.sum::<Complex<f64>>() / (TONE_COUNT as f64).sqrt()
    }

    /// A real function of variance 1 with the same correlation.
    pub(super) fn real_at(&self, u: f64) -> f64 {
        SQRT_2 * self.at(u, 0.0).re
    }
}

/// Brownian motion of variance 1 per second at `time_s`, 0 at time 0. `normal(index)` must give
/// the same normal number for the same index; indices stay below 2^32.
pub(super) fn brownian(time_s: f64, normal: impl Fn(u64) -> f64) -> f64 {
    let side = u64::from(time_s < 0.0) << 31;
    let time_s = time_s.abs().min(SPAN_S);
    let (mut from, mut to) = ((0.0, 0.0), (SPAN_S, SPAN_S.sqrt() * normal(side)));
    let mut index = 1_u64;
    for _ in 0..HALVING_COUNT {
        let middle_s = 0.5 * (from.0 + to.0);
        let bridge = (0.25 * (to.0 - from.0)).sqrt() * normal(side | index);
        let middle = (middle_s, 0.5 * (from.1 + to.1) + bridge);
        let is_right = middle_s <= time_s;
        if is_right {
            from = middle
        } else {
            to = middle
        }
        index = (index << 1) | u64::from(is_right);
    }
    from.1 + (to.1 - from.1) * (time_s - from.0) / (to.0 - from.0)
}

#[cfg(test)]
mod tests {
    use super::super::streams::{Purpose, Streams};
    use super::*;

    #[test]
    fn fading_has_power_1_and_the_stated_correlation_in_time_and_way() {
        let gains: Vec<Fading> = (0..4000)
            .map(|k| Fading::new(&mut Streams::new(3).rng(Purpose::BodyFading, 0, k)))
            .collect();
        let correlation = |du: f64, dv: f64| {
            let products = gains.iter().map(|g| g.at(5.0 + du, 2.0 + dv) * g.at(5.0, 2.0).conj());
            products.sum::<Complex<f64>>() / 4000.0
        };
        for (du, dv) in
            [(0.0_f64, 0.0_f64), (0.5, 0.0), (1.0, 0.0), (0.0, 0.7), (0.6, 0.6), (3.0, 0.0)]
        {
            let want = (-du * du - dv * dv).exp();
            // The mean of 4000 products of variance at most 1: 5 σ are 0.08.
            assert!((correlation(du, dv) - want).norm() < 0.08, "{du} {dv}");
        }
        let fourth = gains.iter().map(|g| g.at(5.0, 2.0).norm_sqr().powi(2)).sum::<f64>() / 4000.0;
        // Gaussian: 2; N tones: 2 − 1/N; 5 σ of the mean are 0.3.
        assert!((fourth - 2.0).abs() < 0.4, "{fourth}");
        let variance = gains.iter().map(|g| g.real_at(1.0).powi(2)).sum::<f64>() / 4000.0;
        assert!((variance - 1.0).abs() < 0.12, "{variance}");
    }

    #[test]
    fn brownian_motion_has_independent_increments_of_the_variance_of_their_time() {
        let walk = |seed: u64, time_s: f64| {
            let streams = Streams::new(seed);
            brownian(time_s, |index| streams.normal(Purpose::PhaseWalk, 0, index))
        };
        let moments = |from: [f64; 2], then: [f64; 2]| {
            let (mut square, mut cross) = (0.0, 0.0);
            for seed in 0..1000 {
                let first = walk(seed, from[1]) - walk(seed, from[0]);
                square += first * first / 1000.0;
                cross += first * (walk(seed, then[1]) - walk(seed, then[0])) / 1000.0;
            }
            (square, cross)
        };
        for (from, then) in [
            ([3.0, 4.0], [4.0, 6.0]),
            ([1.7, 1.8], [1.8, 2.3]),
            ([0.0, 100.0], [100.0, 130.0]),
            ([-3.0, 0.0], [0.0, 3.0]),
        ] {
            let (square, cross) = moments(from, then);
            let (length_s, then_s) = (from[1] - from[0], then[1] - then[0]);
            // 5 σ of 1000 squares: 22 %; of products: 16 %.
            assert!((square / length_s - 1.0).abs() < 0.22, "{from:?}: {square}");
            assert!(cross.abs() < 0.16 * (length_s * then_s).sqrt(), "{from:?}: {cross}");
        }
        assert!(walk(1, 0.0).abs() < 1e-12);
        assert!((walk(1, 5.0) - walk(1, 5.0 + 1e-7)).abs() < 1e-4);
    }
}
