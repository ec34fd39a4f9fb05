//! One track filtered: what it tells about the pose and the offsets with its trajectory eliminated.
//!
//! With innovations `ν + V θ` of covariances `F` (see `filter`), `θ` the small changes of pose and
//! offsets, the trajectory's elimination leaves `Σ (ν + V θ)ᵀ F⁻¹ (ν + V θ)`: information
//! `Σ Vᵀ F⁻¹ V` and pull `−Σ Vᵀ F⁻¹ ν`. A point farther from its prediction than one that has
//! nothing to do with the target would be, at the density `λ`, is left out and counts `−ln λ`; of the
//! others the information is lost that the doubt about them costs.

use nalgebra::SMatrix;

use super::super::prepared::Motion;
use super::filter::{Innovation, State};
use super::scans::{Offsets, Seen};
use super::tracks::{Member, VELOCITY_SIGMA_MPS};

/// Squared Mahalanobis distance below which a point is no outlier, however wide its prediction: 99.75 %
/// of a target's points. The second point of a track could be anywhere within a step.
const MIN_OUTLIER_CHI_SQUARE: f64 = 12.0;

/// Natural logarithm of the odds beyond which a point is the target's for certain.
const SURE_LOG_ODDS: f64 = 9.0;

/// What a track is filtered under.
#[derive(Clone, Copy)]
pub(super) struct Setting<'a> {
    pub(super) points: &'a [Seen],
    pub(super) motion: Motion,
    pub(super) covariance_scale: f64,
    /// `ln λ`; minus infinity where every point is taken in.
    pub(super) outlier_log_density: f64,
}

/// What a filtered track tells.
#[derive(Clone, Copy)]
pub(super) struct Pass<const C: usize> {
    /// `Σ [ν V]ᵀ F⁻¹ [ν V]`, only the upper triangle; zero without columns of derivatives, as only
    /// the likelihood is wanted then.
    pub(super) normal: SMatrix<f64, C, C>,
    /// What of that is lost because points may be others', only the upper triangle:
    /// `Σ (1 − p) [ν V]ᵀ F⁻¹ [ν V] + p (1 − p) g gᵀ`, `g = [ν V]ᵀ F⁻¹ ν`.
    pub(super) lost: SMatrix<f64, C, C>,
    /// Natural logarithm of the likelihood of all points after the first.
    pub(super) log_likelihood: f64,
    /// Points taken in after the first.
    pub(super) used_count: usize,
}

impl<const C: usize> Pass<C> {
    fn add(&mut self, innovation: &Innovation<C>, own_chance: f64) {
        let weighted = innovation.columns.map(|column| innovation.precision * column);
        let doubt = 1.0 - own_chance;
        let pulls = weighted.map(|column| column.dot(&innovation.columns[0]));
        for (right, weighted_right) in weighted.iter().enumerate() {
            for left in 0..=right {
                let product = innovation.columns[left].dot(weighted_right);
                self.normal[(left, right)] += product;
                self.lost[(left, right)] +=
                    doubt * (product + own_chance * pulls[left] * pulls[right]);
            }
        }
    }
}

/// Probability `p = N / (N + λ)` that a point is the target's; where the prediction is so wide that λ
/// exceeds it nearly everywhere, a small part of its own peak stands for λ.
fn own_chance(log_density: f64, chi_square: f64, outlier_log_density: f64) -> f64 {
    let peak = log_density + 0.5 * chi_square;
    let other = outlier_log_density.min(peak - 0.5 * MIN_OUTLIER_CHI_SQUARE);
    let log_odds = log_density - other;
    if log_odds > SURE_LOG_ODDS { 1.0 } else { 1.0 / (1.0 + (-log_odds).exp()) }
}

/// Filters the points `members` under acceleration noise `noise_m2ps3` and `offsets` in standard
/// deviations.
pub(super) fn filtered<const C: usize>(
    setting: &Setting<'_>,
    members: &[Member],
    (noise_m2ps3, offsets): (f64, &Offsets),
) -> Pass<C> {
    let mut pass = Pass {
        normal: SMatrix::zeros(),
        lost: SMatrix::zeros(),
        log_likelihood: 0.0,
        used_count: 0,
    };
    let observed = |member: &Member| {
        setting.points[member.point].observed::<C>(
            &setting.motion,
            offsets,
            setting.covariance_scale,
        )
    };
    let Some((first, rest)) = members.split_first() else { return pass };
    let mut state = State::starting(&observed(first), VELOCITY_SIGMA_MPS);
    for member in rest {
        let point = observed(member);
        let step_s = point.time_s - state.time_s();
        state.predict(point.time_s, member.way.noise(step_s, noise_m2ps3));
        let innovation = state.innovation(&point);
        let is_far = innovation.chi_square > MIN_OUTLIER_CHI_SQUARE;
        let log_density = innovation.log_density();
        if is_far && log_density < setting.outlier_log_density {
            pass.log_likelihood += setting.outlier_log_density;
            continue;
        }
        if C > 1 {
            let chi_square = innovation.chi_square;
            let own = own_chance(log_density, chi_square, setting.outlier_log_density);
            pass.add(&innovation, own);
        }
        pass.log_likelihood += log_density;
        pass.used_count += 1;
        state.absorb(&innovation);
    }
    pass
}
