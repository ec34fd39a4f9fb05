//! Weights over the band that trade range sidelobes for width.
//!
//! Taylor's window of side lobe level `η` and `n̄` nearly equal side lobes:
//! `w(ξ) = 1 + 2 Σ_{m=1}^{n̄−1} F_m cos(2π m ξ)`, `ξ = (k + 1/2)/K − 1/2`,
//! `F_m = (−1)^{m+1} / 2 · Π_{i=1}^{n̄−1} [1 − m² / (s² (A² + (i − 1/2)²))] / Π_{j≠m} [1 − m²/j²]`,
//! `A = arcosh(η) / π`, `s² = n̄² / (A² + (n̄ − 1/2)²)` \[taylor1955\].
//!
//! Range is measured with the precision `c / (4π β sqrt(2 SNR))` where, for the peak of a profile
//! weighted by `w` and the SNR measured after weighting,
//! `β² = Σ w² (Σ w f²)² / (Σ w² f² (Σ w)²)`, `f` from the carrier, in hertz; it is the root mean
//! square bandwidth when all weights are equal.

use std::f64::consts::{PI, TAU};

use serde::{Deserialize, Serialize};

use proto::radar::Band;

/// Side lobes of the Taylor window below its peak.
const TAYLOR_SIDE_LOBE_DB: f64 = 35.0;
/// Number of nearly equal side lobes of the Taylor window, plus one.
const TAYLOR_NBAR: i32 = 5;

/// Which weights.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Window {
    /// None: narrowest, side lobes at −13 dB.
    Rectangular,
    /// Hann: side lobes fall fast, half as wide again.
    Hann,
    /// Taylor, −35 dB with n̄ = 5.
    #[default]
    Taylor,
}

impl Window {
    /// One weight per frequency, scaled to the sum 1 so that a profile peaks at the reflectivity.
    #[must_use]
    pub fn weights(self, step_count: usize) -> Vec<f64> {
        let place = |k: usize| (k as f64 + 0.5) / step_count as f64 - 0.5;
        let raw: Vec<f64> = match self {
            Self::Rectangular => vec![1.0; step_count],
            Self::Hann => (0..step_count).map(|k| 1.0 + (TAU * place(k)).cos()).collect(),
            Self::Taylor => {
                let terms = taylor_terms();
                (0..step_count).map(|k| cosine_series(&terms, place(k))).collect()
            }
        };
        let sum: f64 = raw.iter().sum();
        raw.iter().map(|w| w / sum).collect()
    }
}

/// Value of `1 + 2 Σ F_m cos(2π m ξ)`.
fn cosine_series(terms: &[f64], place: f64) -> f64 {
    let cosine = |(m, term): (usize, &f64)| term * (TAU * (m + 1) as f64 * place).cos();
    1.0 + 2.0 * terms.iter().enumerate().map(cosine).sum::<f64>()
}

/// The coefficients `F_m`, `m = 1 .. n̄ − 1`.
fn taylor_terms() -> Vec<f64> {
    let ratio = 10_f64.powf(TAYLOR_SIDE_LOBE_DB / 20.0);
    let a2 = (ratio.acosh() / PI).powi(2);
    let s2 = f64::from(TAYLOR_NBAR).powi(2) / (a2 + (f64::from(TAYLOR_NBAR) - 0.5).powi(2));
    let term = |m: i32| {
        let m2 = f64::from(m).powi(2);
        let zeros: f64 = (1..TAYLOR_NBAR)
            .map(|i| 1.0 - m2 / (s2 * (a2 + (f64::from(i) - 0.5).powi(2))))
            .product();
        let others: f64 =
            (1..TAYLOR_NBAR).filter(|j| *j != m).map(|j| 1.0 - m2 / f64::from(j).powi(2)).product();
        let sign = if m % 2 == 0 { -1.0 } else { 1.0 };
        0.5 * sign * zeros / others
    };
    (1..TAYLOR_NBAR).map(term).collect()
}

/// The effective bandwidth β in hertz of `weights` over `band`.
#[must_use]
pub fn effective_bandwidth_hz(weights: &[f64], band: &Band) -> f64 {
    let offset_hz = |k: usize| band.frequency_hz(k) - band.carrier_hz();
    let mut moments = [0.0; 4];
    for (k, w) in weights.iter().enumerate() {
        let f2 = offset_hz(k).powi(2);
        for (moment, value) in moments.iter_mut().zip([*w, w * f2, w * w, w * w * f2]) {
            *moment += value;
        }
    }
    let [w, w_f2, w2, w2_f2] = moments;
    (w2 / w2_f2).sqrt() * w_f2 / w
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The response at a delay of `cells` range cells, by the plain sum.
    fn response(weights: &[f64], cells: f64) -> f64 {
        let count = weights.len() as f64;
        let (re, im) = weights.iter().enumerate().fold((0.0, 0.0), |(re, im), (k, w)| {
            let (sin, cos) = (TAU * k as f64 * cells / count).sin_cos();
            (re + w * cos, im + w * sin)
        });
        re.hypot(im)
    }

    fn highest_side_lobe_db(window: Window, first_null_cells: f64) -> f64 {
        let weights = window.weights(301);
        let places = (0..2000).map(|i| first_null_cells + 0.01 * f64::from(i));
        20.0 * places.map(|cells| response(&weights, cells)).fold(0.0, f64::max).log10()
    }

    #[test]
    fn side_lobes_are_where_the_names_say() {
        assert!((highest_side_lobe_db(Window::Rectangular, 1.0) + 13.26).abs() < 0.1);
        assert!((highest_side_lobe_db(Window::Hann, 2.0) + 31.47).abs() < 0.1);
        let taylor_db = highest_side_lobe_db(Window::Taylor, 1.7);
        assert!((-35.5..-34.7).contains(&taylor_db), "{taylor_db}");
    }

    #[test]
    fn effective_bandwidths_and_losses_are_the_measured_ones() {
        let band = Band::default();
        // research 3.1: bandwidth in hertz and loss of SNR in dB.
        for (window, bandwidth_hz, loss_db) in [
            (Window::Rectangular, 0.174e9, 0.0),
            (Window::Taylor, 0.168e9, 0.93),
            (Window::Hann, 0.140e9, 1.75),
        ] {
            let weights = window.weights(band.step_count);
            assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12);
            let got_hz = effective_bandwidth_hz(&weights, &band);
            assert!((got_hz - bandwidth_hz).abs() < 0.0015e9, "{window:?}: {got_hz}");
            let squares: f64 = weights.iter().map(|w| w * w).sum();
            let got_db = 10.0 * (squares * weights.len() as f64).log10();
            assert!((got_db - loss_db).abs() < 0.03, "{window:?}: {got_db}");
        }
    }
}
