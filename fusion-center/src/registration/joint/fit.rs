//! Pose and lasting offsets from all tracks together, by Gauss-Newton.
//!
//! Unknowns are the pose `(x, y, φ)`, the offsets of both sides that all targets share, and those of
//! each target; trajectories are eliminated track by track (see `passes`). Offsets are in units of
//! their standard deviation, along the line of sight `η = a + b`, `a` of variance `s` shared by all
//! targets of a side and `b` of variance `1 − s` each target's own; across it `ζ`, all each target's
//! own. Of a track with information `I` about pose, `η` and `ζ` the elimination of `o = (b, ζ)` with
//! the prior's precision `P` leaves `I_θθ − I_θo (I_oo + P)⁻¹ I_oθ` for `θ`, pose and `a`, in which
//! `I_θo` is that of pose and `η` with `η` and `ζ`.
//!
//! The acceleration noise of each track is the likeliest of a few, so that a straight walk is worth
//! what a straight walk is worth and a bent one does not bend the pose.

use std::ops::SubAssign;

use nalgebra::{
    Cholesky, Matrix4, Matrix5, Matrix5x4, SMatrix, SVector, Vector2, Vector4, Vector5,
};

use super::super::prepared::Motion;
use super::passes::{Pass, Setting, filtered};
use super::scans::Offsets;
use super::tracks::{Member, Track};
use crate::statistics::Ratio;

/// Acceleration noise that a track may have, m²/s³: none, then from a slow drift to a turn at a
/// corner.
const NOISES_M2PS3: [f64; 8] = [0.0, 1e-4, 1e-3, 1e-2, 0.03, 0.1, 0.3, 1.0];

/// Those of them that are tried first.
const FAR_NOISES: [usize; 2] = [3, 6];

/// What each costs in log likelihood before the points speak: people turn and change pace, so a
/// straight walk at constant speed must be proven. Tuned on rooms with points of 5 to 40 cm (seeds
/// 0..200), where straight and bent look alike and a free choice gives NEES of 4.0; in the scene of
/// \[registration\] prices between 1 and 8 change RMSE by less than 1 %.
const NOISE_PRICES: [f64; 8] = [8.0, 8.0, 8.0, 6.0, 4.0, 2.0, 0.0, 0.0];

/// s: share of the variance along the line of sight that all targets of a side have in common.
pub(super) const COMMON_SHARE: f64 = 0.5;

/// Steps after which the fit has failed, and steps in which noise may still change.
const MAX_STEP_COUNT: usize = 12;
const NOISE_STEP_COUNT: usize = 6;

/// A step shorter than this, squared and in units of the covariance, ends the fit: a Gauss-Newton step
/// leaves a small part of its length. After one shorter than the other, noises stay.
const CONVERGED: f64 = 1e-2;
const SETTLED: f64 = 0.1;

/// A track and what is currently assumed of it.
struct Fitted<'a> {
    members: &'a [Member],
    noise_index: usize,
    /// `b` by side, `ζ` by side.
    own_offsets: Vector4<f64>,
    reduced: Reduced,
}

/// A track's information with its own offsets eliminated.
#[derive(Clone, Copy, Default)]
struct Reduced {
    information: Matrix5<f64>,
    pull: Vector5<f64>,
    /// `(I_oo + P)⁻¹` times the pull, and times `I_oθ`: the own offsets' step is the first less the
    /// second times the common step.
    own_pull: Vector4<f64>,
    own_slope: Matrix5x4<f64>,
    /// What of the information is lost because points may be others'.
    lost: Matrix5<f64>,
    chi_square: f64,
    used_count: usize,
}

/// The result.
pub(super) struct Joint {
    pub(super) motion: Motion,
    /// Inverse observed information of `(x, y, heading, a of the reference, a of the node)`.
    pub(super) covariance: Matrix5<f64>,
    /// χ² per degree of freedom.
    pub(super) residual: Ratio,
    /// Squared pulls of the tracks in units of what independent errors give.
    pub(super) lasting: Ratio,
}

/// Fits with `C` columns, 4 without and 8 with offsets; `None` where it does not converge.
pub(super) fn fit<const C: usize>(start: &Setting<'_>, tracks: &[Track]) -> Option<Joint> {
    let mut fitted: Vec<Fitted<'_>> = tracks
        .iter()
        .map(|track| Fitted {
            members: &track.members,
            noise_index: 0,
            own_offsets: Vector4::zeros(),
            reduced: Reduced::default(),
        })
        .collect();
    let mut common = Vector2::zeros();
    let mut is_unsettled = true;
    let mut setting = Setting { outlier_log_density: f64::NEG_INFINITY, ..*start };
    for step_index in 0..MAX_STEP_COUNT {
        let may_choose = is_unsettled && (1..NOISE_STEP_COUNT).contains(&step_index);
        let far_indices: &[usize] = if step_index == 1 { &FAR_NOISES } else { &[] };
        let mut has_changed = step_index == 0;
        let (mut information, mut pull) = prior(&common);
        for track in &mut fitted {
            if may_choose {
                has_changed |= track.choose_noise(&setting, &common, far_indices);
            }
            track.reduced = track.reduced::<C>(&setting, &common);
            information += track.reduced.information;
            pull += track.reduced.pull;
        }
        let factor = Cholesky::new(information)?;
        let step = factor.solve(&pull);
        let length = step.dot(&pull);
        if !length.is_finite() {
            return None;
        }
        setting.motion = setting.motion.plus(&step.fixed_rows::<3>(0).into_owned());
        setting.outlier_log_density = start.outlier_log_density;
        common += step.fixed_rows::<2>(3);
        for track in &mut fitted {
            track.own_offsets += track.reduced.own_pull - track.reduced.own_slope.tr_mul(&step);
        }
        is_unsettled = has_changed || length > SETTLED;
        if length < CONVERGED && !has_changed {
            return Some(concluded(setting.motion, &factor, (&fitted, &step)));
        }
    }
    None
}

/// Information and pull of the common offsets' prior; the pose has none.
fn prior(common: &Vector2<f64>) -> (Matrix5<f64>, Vector5<f64>) {
    let precision = 1.0 / COMMON_SHARE;
    let information = Vector5::new(0.0, 0.0, 0.0, precision, precision);
    let pull = Vector5::new(0.0, 0.0, 0.0, -common.x * precision, -common.y * precision);
    (Matrix5::from_diagonal(&information), pull)
}

impl Fitted<'_> {
    fn offsets(&self, common: &Vector2<f64>) -> Offsets {
        let [of_ref, of_node, across_of_ref, across_of_node] = self.own_offsets.into();
        [common.x + of_ref, common.y + of_node, across_of_ref, across_of_node]
    }

    /// Moves to a likelier noise; says whether it did. The first choice looks at noises far apart,
    /// because a walk that is far too straight for its points leaves most of them out and then seems
    /// to fit; then the neighbours of the best.
    fn choose_noise(
        &mut self,
        setting: &Setting<'_>,
        common: &Vector2<f64>,
        far_indices: &[usize],
    ) -> bool {
        let offsets = self.offsets(common);
        let valued = |index: usize| {
            let pass: Pass<1> = filtered(setting, self.members, (NOISES_M2PS3[index], &offsets));
            (index, pass.log_likelihood - NOISE_PRICES[index])
        };
        let better = |best: (usize, f64), index: usize| {
            let next = valued(index);
            if next.1 > best.1 { next } else { best }
        };
        let far = far_indices.iter().fold(valued(self.noise_index), |best, i| better(best, *i));
        let neighbours = [far.0.saturating_sub(1), (far.0 + 1).min(NOISES_M2PS3.len() - 1)];
        let is_other = |index: &usize| *index != far.0;
        let best = neighbours.into_iter().filter(is_other).fold(far, better);
        let has_changed = best.0 != self.noise_index;
        self.noise_index = best.0;
        has_changed
    }

    fn reduced<const C: usize>(&self, setting: &Setting<'_>, common: &Vector2<f64>) -> Reduced {
        let offsets = self.offsets(common);
        let noise_m2ps3 = NOISES_M2PS3[self.noise_index];
        let pass: Pass<C> = filtered(setting, self.members, (noise_m2ps3, &offsets));
        let (of_all, pull_of_all) = unpacked(&pass.normal);
        let (lost_of_all, _) = unpacked(&pass.lost);
        let information: Matrix5<f64> = of_all.fixed_view::<5, 5>(0, 0).into_owned();
        let lost: Matrix5<f64> = lost_of_all.fixed_view::<5, 5>(0, 0).into_owned();
        let pull: Vector5<f64> = pull_of_all.fixed_rows::<5>(0).into_owned();
        let (chi_square, used_count) = (pass.normal[(0, 0)], pass.used_count);
        if C < 8 {
            return Reduced {
                information,
                pull,
                lost,
                chi_square,
                used_count,
                ..Reduced::default()
            };
        }
        let along = 1.0 / (1.0 - COMMON_SHARE);
        let precision = Matrix4::from_diagonal(&Vector4::new(along, along, 1.0, 1.0));
        let own = of_all.fixed_view::<4, 4>(3, 3) + precision;
        let inverse = own.try_inverse().unwrap_or_default();
        let cross: Matrix5x4<f64> = of_all.fixed_view::<5, 4>(0, 3).into_owned();
        let own_pull = inverse * (pull_of_all.fixed_rows::<4>(3) - precision * self.own_offsets);
        let own_slope = cross * inverse;
        let mut elimination = SMatrix::<f64, 5, 7>::identity();
        elimination.fixed_columns_mut::<4>(3).sub_assign(&own_slope);
        Reduced {
            lost: elimination * lost_of_all * elimination.transpose(),
            information: information - own_slope * cross.transpose(),
            pull: pull - cross * own_pull,
            own_pull,
            own_slope,
            chi_square,
            used_count,
        }
    }
}

/// Information and pull of the pose `(x, y, heading)`, of `η` of the reference and of the node and of
/// `ζ` of the same.
fn unpacked<const C: usize>(normal: &SMatrix<f64, C, C>) -> (SMatrix<f64, 7, 7>, SVector<f64, 7>) {
    let (mut information, mut pull) = (SMatrix::zeros(), SVector::zeros());
    for right in 1..C {
        pull[right - 1] = -normal[(0, right)];
        for left in 1..=right {
            information[(left - 1, right - 1)] = normal[(left, right)];
            information[(right - 1, left - 1)] = normal[(left, right)];
        }
    }
    (information, pull)
}

fn concluded(
    motion: Motion,
    factor: &Cholesky<f64, nalgebra::Const<5>>,
    (fitted, step): (&[Fitted<'_>], &Vector5<f64>),
) -> Joint {
    let lost: Matrix5<f64> = fitted.iter().map(|track| track.reduced.lost).sum();
    let complete = factor.l() * factor.l().transpose();
    let observed = Cholesky::new(complete - lost);
    let covariance = observed.map_or_else(|| factor.inverse(), |left| left.inverse());
    let point_count: usize = fitted.iter().map(|track| track.reduced.used_count).sum();
    let chi_square = fitted.iter().map(|track| track.reduced.chi_square).sum();
    let free = (2.0 * point_count as f64 - 3.0).max(0.0);
    let mut lasting = Ratio { sum: 0.0, expected: 0.0, variance: 0.0 };
    for track in fitted {
        let pull = track.reduced.pull - track.reduced.information * step;
        let share = covariance * track.reduced.information;
        lasting.sum += pull.dot(&(covariance * pull));
        lasting.expected += share.trace() - (share * share).trace();
        lasting.variance += 2.0 * (share * share).trace();
    }
    let residual = Ratio::of_chi_square(chi_square, free);
    Joint { motion, covariance, residual, lasting }
}
