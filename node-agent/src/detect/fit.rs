//! The places of a few points that explain the samples of a patch best.
//!
//! The samples `s` are compared with `Σ_i a_i g(r_i, u_i)`, `g` being the response of a point
//! ([`PointModel`]). The complex `a = (Gᴴ G)⁻¹ Gᴴ s` are eliminated by projection; the places are
//! fitted by Levenberg and Marquardt on the power `|s − G a|²` that is left, with the columns
//! `D = P (∂g_i/∂[r, u]_i) a_i`, `P = 1 − G (Gᴴ G)⁻¹ Gᴴ` \[kaufman1975\]. `Re Dᴴ D` is
//! `σ²/2` times the information of the places \[golub-pereyra1973\].

use nalgebra::{DMatrix, DVector};
use rustfft::num_complex::Complex;

use super::moments::Polar;
use super::response::{Patch, PointModel};

/// Iterations of a fit; five or so suffice.
const MAX_ITERATIONS: usize = 25;
/// A fit has converged when its residual falls by less than this share of the noise power of a
/// sample: the last step was a seventh of the error by noise, and what is left is its square ...
const NOISE_STOP: f64 = 0.02;
/// ... or by less than this share of itself.
const RELATIVE_STOP: f64 = 1e-6;
/// The most a place moves in one iteration: range in metres and sine.
const MAX_STEP: [f64; 2] = [0.1, 0.07];

/// Places, and what they leave.
#[derive(Clone, Debug)]
pub(super) struct Fit {
    /// `[r, u]` of each point.
    pub(super) places: Vec<Polar>,
    /// Reflectivity of each point.
    pub(super) amplitudes: Vec<Complex<f64>>,
    /// `|s − G a|²`.
    pub(super) residual_power: f64,
    /// By how much the residual would grow without each point: its matched-filter power.
    pub(super) own_powers: Vec<f64>,
    /// `Re Dᴴ D` over `[r₁, u₁, r₂, ...]`.
    pub(super) information: DMatrix<f64>,
    /// `Re Dᴴ (s − G a)`.
    gradient: DVector<f64>,
}

impl Fit {
    /// The places from `start` on that leave least; `None` if they are not determined.
    pub(super) fn new(model: &PointModel, patch: &Patch, start: &[Polar]) -> Option<Self> {
        let mut best = Self::at(model, patch, start)?;
        let mut damping = 1e-3;
        for _ in 0..MAX_ITERATIONS {
            let mut normal = best.information.clone();
            normal.set_diagonal(&(normal.diagonal() * (1.0 + damping)));
            let step = normal.cholesky()?.solve(&best.gradient);
            let moved: Vec<Polar> =
                best.places.iter().enumerate().map(|(i, p)| stepped(p, &step, i)).collect();
            let tried = Self::at(model, patch, &moved);
            let stop = (NOISE_STOP * patch.noise_power).max(RELATIVE_STOP * best.residual_power);
            let fall =
                tried.as_ref().map_or(-2.0 * stop, |t| best.residual_power - t.residual_power);
            damping *= if 0.0 < fall { 0.1 } else { 10.0 };
            best = tried.filter(|_| 0.0 < fall).unwrap_or(best);
            if fall.abs() < stop {
                break;
            }
        }
        Some(best)
    }

    /// Places and reflectivities.
    pub(super) fn points(&self) -> Vec<(Polar, Complex<f64>)> {
        self.places.iter().copied().zip(self.amplitudes.iter().copied()).collect()
    }

    /// The best amplitudes at `places`; `None` if the responses are not independent or something
    /// is no finite number.
    pub(super) fn at(model: &PointModel, patch: &Patch, places: &[Polar]) -> Option<Self> {
        let columns: Vec<[DVector<Complex<f64>>; 3]> =
            places.iter().map(|place| model.response(patch, place)).collect();
        let of_points: Vec<_> = columns.iter().map(|[g, _, _]| g.clone()).collect();
        let responses = DMatrix::from_columns(&of_points);
        let gram_inverse = responses.ad_mul(&responses).cholesky()?.inverse();
        let amplitudes = &gram_inverse * responses.ad_mul(&patch.samples);
        let residual = &patch.samples - &responses * &amplitudes;
        let of_places: Vec<_> = columns
            .iter()
            .zip(amplitudes.iter())
            .flat_map(|([_, by_range, by_sine], a)| [by_range * *a, by_sine * *a])
            .collect();
        let slopes = DMatrix::from_columns(&of_places);
        let overlap = responses.ad_mul(&slopes);
        let information = slopes.ad_mul(&slopes) - overlap.ad_mul(&(&gram_inverse * &overlap));
        let gradient = slopes.ad_mul(&residual);
        let own_power =
            |i: usize| amplitudes[i].norm_sqr() / gram_inverse[(i, i)].re.max(f64::MIN_POSITIVE);
        let residual_power = residual.norm_squared();
        residual_power.is_finite().then(|| Self {
            places: places.to_vec(),
            own_powers: (0..places.len()).map(own_power).collect(),
            residual_power,
            information: information.map(|z| z.re),
            gradient: gradient.map(|z| z.re),
            amplitudes: amplitudes.iter().copied().collect(),
        })
    }
}

/// Place number `index` moved by its part of `step`, still before the array.
fn stepped(place: &Polar, step: &DVector<f64>, index: usize) -> Polar {
    let part = |axis: usize| step[2 * index + axis].clamp(-MAX_STEP[axis], MAX_STEP[axis]);
    Polar::new((place.x + part(0)).max(0.0), (place.y + part(1)).clamp(-0.999, 0.999))
}
