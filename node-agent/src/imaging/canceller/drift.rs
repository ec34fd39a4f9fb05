//! The drift of the radio, seen on echoes that do not move.
//!
//! A channel's gain changes by `1 + δ` from sweep to sweep, and all its static echoes with it:
//! `δ = Σ_n w_n b_n* (x_n − b_n) / (Σ_n w_n |b_n|² + q σ² / s²)` over the range gates `n`, the least
//! squares for `x = (1 + δ) b + noise` with the prior standard deviation `s` of `δ`; `σ²` is the noise
//! power of a sample, and `q` samples share one resolution cell. Gates where nothing moves have
//! `w = 1` and the slow background for `b`; live ones the fast one, which never falls far behind, and
//! `w = 1 / max(1, energy over noise)²`. Where echoes are too weak to tell a drift, the prior keeps `δ`
//! at nothing, and targets lose nothing to it.

use crate::imaging::double;
use rustfft::num_complex::Complex;

/// Prior standard deviation of `δ` between two sweeps: what radios drift by in a second, so that
/// echoes 60 dB above a target are followed without lag.
const PRIOR_SIGMA: f64 = 5e-4;
/// Every how many samples one is taken: profiles are oversampled by more.
const STRIDE: usize = 3;

/// A step of the gain is farther from 1 than this; less is drift.
const MIN_STEP: f64 = 0.2;
/// Share of the power that a step may leave unexplained: targets, and noise.
const MAX_UNEXPLAINED: f64 = 0.1;
/// Steps beyond this, or its inverse, leave nothing to go on with.
const MAX_STEP: f64 = 1e6;

/// Echoes beside the strongest one must stand out of the noise by this much to bear witness.
const MIN_WITNESS_RATIO: f64 = 100.0;
/// ... and hold this share of the background's power: more than the sidelobes of the strongest.
const MIN_WITNESS_SHARE: f64 = 0.01;
/// Witnesses are this far from the strongest echo, in resolution cells: beyond its main lobe.
const WITNESS_CELLS: f64 = 4.0;

/// What noise and sampling do to profiles.
#[derive(Clone, Copy, Debug)]
pub struct Grain {
    /// Noise power of a sample.
    pub noise_power: f64,
    /// Samples in a resolution cell.
    pub per_cell: f64,
}

/// The factor `g` by which all echoes of a channel changed at once, `x ≈ g f` for the background
/// `f`, if that explains the sweep and is no drift.
///
/// One target that moves turns the phase of its echo, too: so the echoes away from the strongest one
/// must say the same.
#[must_use]
pub fn step(
    samples: &[Complex<f32>],
    background: &[Complex<f32>],
    grain: &Grain,
) -> Option<Complex<f64>> {
    let all = Scaling::of(samples.iter().zip(background));
    let factor = all.factor();
    let is_far = MIN_STEP < (factor - 1.0).norm();
    if !is_far || !(MAX_STEP.recip()..MAX_STEP).contains(&factor.norm()) || !all.is_explained() {
        return None;
    }
    let strength = |n: &usize| background[*n].norm_sqr();
    let strongest = (0..background.len()).max_by(|a, b| strength(a).total_cmp(&strength(b)))?;
    let away = |n: usize| WITNESS_CELLS * grain.per_cell < n.abs_diff(strongest) as f64;
    let pairs = samples.iter().zip(background).enumerate();
    let witness = Scaling::of(pairs.filter(|(n, _)| away(*n)).map(|(_, pair)| pair));
    let agrees = (witness.factor() - factor).norm() < MIN_STEP * factor.norm();
    let least =
        (MIN_WITNESS_RATIO * grain.noise_power * witness.count).max(MIN_WITNESS_SHARE * all.known);
    let speaks = least < witness.known && witness.is_explained();
    (agrees && speaks).then_some(factor)
}

/// How well `x ≈ g f`.
struct Scaling {
    product: Complex<f64>,
    known: f64,
    power: f64,
    count: f64,
}

impl Scaling {
    fn of<'a>(pairs: impl Iterator<Item = (&'a Complex<f32>, &'a Complex<f32>)>) -> Self {
        let none = Self { product: Complex::new(0.0, 0.0), known: 0.0, power: 0.0, count: 0.0 };
        pairs.step_by(STRIDE).fold(none, |sum, (x, b)| Self {
            product: sum.product + double(*b).conj() * double(*x),
            known: sum.known + double(*b).norm_sqr(),
            power: sum.power + double(*x).norm_sqr(),
            count: sum.count + 1.0,
        })
    }

    fn factor(&self) -> Complex<f64> {
        self.product / self.known
    }

    fn is_explained(&self) -> bool {
        // What the projection leaves of the power.
        self.power - self.product.norm_sqr() / self.known < MAX_UNEXPLAINED * self.power
    }
}

/// The backgrounds of one channel.
#[derive(Clone, Copy, Debug)]
pub struct Backgrounds<'a> {
    /// For quiet gates.
    pub slow: &'a [Complex<f32>],
    /// For live gates.
    pub fast: &'a [Complex<f32>],
    /// `w` of live gates, 0 for quiet ones.
    pub live_weight: &'a [f32],
}

/// `σ² q / s²` for the noise power `σ²` of a sample, of which `per_cell` share a resolution cell.
#[must_use]
pub fn doubt(noise_power: f64, per_cell: f64) -> f64 {
    (per_cell / STRIDE as f64).max(1.0) * noise_power / PRIOR_SIGMA.powi(2)
}

/// `δ` of one channel; 0 if there is neither echo nor [`doubt`].
#[must_use]
pub fn gain_change(samples: &[Complex<f32>], known: &Backgrounds<'_>, doubt: f64) -> Complex<f64> {
    let (mut product, mut power) = (Complex::new(0.0, 0.0), 0.0);
    for n in (0..samples.len()).step_by(STRIDE) {
        let is_live = 0.0 < known.live_weight[n];
        let (b, weight) =
            if is_live { (known.fast[n], known.live_weight[n]) } else { (known.slow[n], 1.0) };
        let term = b.conj() * (samples[n] - b) * weight;
        product += double(term);
        power += f64::from(b.norm_sqr() * weight);
    }
    product / (power + doubt).max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRAIN: Grain = Grain { noise_power: 1e-4, per_cell: 6.8 };

    fn echoes(amplitude: f32) -> Vec<Complex<f32>> {
        (0..300)
            .map(|n| Complex::from_polar(amplitude, 0.7 * n as f32) * (0.05 * n as f32).sin())
            .collect()
    }

    /// `δ` at a noise power of 1e-4 with the same echoes in both backgrounds.
    fn change(
        samples: &[Complex<f32>],
        known: &[Complex<f32>],
        live_weight: &[f32],
    ) -> Complex<f64> {
        let backgrounds = Backgrounds { slow: known, fast: known, live_weight };
        gain_change(samples, &backgrounds, doubt(1e-4, 6.8))
    }

    #[test]
    fn a_change_of_gain_is_seen_on_strong_echoes_and_not_on_weak_ones() {
        let wanted = Complex::new(3e-4, -5e-4);
        let now: Vec<Complex<f32>> = echoes(1e3).iter().map(|b| b + b * wanted).collect();
        let want = double(wanted);
        for weight in [0.0, 0.3] {
            let got = change(&now, &echoes(1e3), &[weight; 300]);
            assert!((got - want).norm() < 2e-6, "{got}");
        }
        // A target in phase with a background of its own size, 30 dB above the noise.
        let target: Vec<Complex<f32>> = echoes(0.3).iter().map(|b| b * 2.0).collect();
        assert!(change(&target, &echoes(0.3), &[0.0; 300]).norm() < 0.01);
    }

    #[test]
    fn live_gates_weigh_little_and_are_compared_with_the_fast_background() {
        let (slow, mut now) = (echoes(1e3), echoes(1e3));
        let mut live_weight = [0.0; 300];
        for n in 20..60 {
            now[n] *= 1.1;
            live_weight[n] = 1e-4;
        }
        let seen = change(&now, &slow, &[0.0; 300]).norm();
        assert!(1e-3 < seen && change(&now, &slow, &live_weight).norm() < 1e-3 * seen);
        let backgrounds = Backgrounds { slow: &slow, fast: &now, live_weight: &live_weight };
        assert!(gain_change(&now, &backgrounds, doubt(1e-4, 6.8)).norm() < 1e-9);
    }

    #[test]
    fn a_step_is_told_from_drift_and_from_a_target() {
        let before = echoes(10.0);
        let turned = |factor: Complex<f32>| -> Vec<Complex<f32>> {
            before.iter().map(|b| b * factor).collect()
        };
        for factor in [Complex::cis(1.0_f32), Complex::new(-1.0, 0.0), Complex::new(1e4, 0.0)] {
            let got = step(&turned(factor), &before, &GRAIN).unwrap();
            let want = double(factor);
            assert!((got - want).norm() < 1e-4 * want.norm(), "{got}");
        }
        assert_eq!(step(&turned(Complex::new(1.01, 0.01)), &before, &GRAIN), None);
        assert_eq!(step(&turned(Complex::new(0.0, 0.0)), &before, &GRAIN), None);
        let mut with_target = before.clone();
        for x in &mut with_target[100..120] {
            *x += Complex::new(80.0, 0.0);
        }
        assert_eq!(step(&with_target, &before, &GRAIN), None);
        // One target and nothing else, half a radian on.
        let lobe = |phase: f32| -> Vec<Complex<f32>> {
            (0..300)
                .map(|n| Complex::from_polar((-(n as f32 - 150.0).powi(2) / 50.0).exp(), phase))
                .collect()
        };
        assert_eq!(step(&lobe(0.5), &lobe(0.0), &GRAIN), None);
    }

    #[test]
    fn without_echo_and_noise_there_is_no_change() {
        let zeros = [Complex::new(0.0, 0.0); 9];
        let backgrounds = Backgrounds { slow: &zeros, fast: &zeros, live_weight: &[0.0; 9] };
        assert!(gain_change(&zeros, &backgrounds, 0.0).norm() < f64::MIN_POSITIVE);
    }
}
