//! The drift of the radio, seen on echoes that do not move.
//!
//! A channel's gain changes by `1 + δ` from sweep to sweep, and all its static echoes with it:
//! `δ = Σ_n w_n b_n* (x_n − b_n) / (Σ_n w_n |b_n|² + q σ² / s²)` over the range gates `n`, the least
//! squares for `x = (1 + δ) b + noise` with the prior standard deviation `s` of `δ`; `σ²` is the noise
//! power of a sample, and `q` samples share one resolution cell. Gates where nothing moves have
//! `w = 1` and the slow background for `b`; live ones the fast one, which never falls far behind, and
//! `w = 1 / max(1, energy over noise)²`. Where echoes are too weak to tell a drift, the prior keeps `δ`
//! at nothing, and targets lose nothing to it.

use rustfft::num_complex::Complex;

/// Prior standard deviation of `δ` between two sweeps: what radios drift by in a second, so that
/// echoes 60 dB above a target are followed without lag.
const PRIOR_SIGMA: f64 = 5e-4;
/// Every how many samples one is taken: profiles are oversampled by more.
const STRIDE: usize = 3;

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
        product += Complex::new(f64::from(term.re), f64::from(term.im));
        power += f64::from(b.norm_sqr() * weight);
    }
    product / (power + doubt).max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests {
    use super::*;

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
        let want = Complex::new(f64::from(wanted.re), f64::from(wanted.im));
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
    fn without_echo_and_noise_there_is_no_change() {
        let zeros = [Complex::new(0.0, 0.0); 9];
        let backgrounds = Backgrounds { slow: &zeros, fast: &zeros, live_weight: &[0.0; 9] };
        assert!(gain_change(&zeros, &backgrounds, 0.0).norm() < f64::MIN_POSITIVE);
    }
}
