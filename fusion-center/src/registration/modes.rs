//! Modes of the likelihood ratio: separated starts, their refinement, and duplicates merged.

use nalgebra::{Cholesky, Matrix3, Vector3};
use proto::geom::squared_length;

use super::likelihood::{Fit, Model, Room, evaluate, evaluate_slope};
use super::prepared::{Motion, Prepared};
use crate::statistics::{Ratio, SIGNIFICANT_SIGMAS};

/// Share of common points assumed before the data say anything.
pub(super) const START_SHARE: f64 = 0.5;

/// Factor on all covariances while the pose is still coarse, and how many steps that lasts.
const COARSE_SCALE: f64 = 4.0;
const COARSE_STEP_COUNT: usize = 6;
const FINE_STEP_COUNT: usize = 20;

/// Times a step that lowers the likelihood is halved before the climb ends.
const HALVING_COUNT: usize = 6;

/// A climb ends after a step shorter than this, squared and in units of the covariance, and a change
/// of the share below the other; what is left is a small part of that.
const CONVERGED: (f64, f64) = (1e-6, 3e-4);
const COARSELY_CONVERGED: (f64, f64) = (1e-2, 3e-2);

/// Loss of log likelihood that rounding may cause.
const ROUNDING: f64 = 1e-9;

/// Share of the best coarse likelihood ratio below which a start is given up.
const HOPELESS_SHARE: f64 = 0.1;

/// Coarse maxima closer than this share of the merging distance are one.
const COARSE_MERGE_SHARE: f64 = 0.5;

/// Rounds of widening, and the widest: errors three times as large as stated.
const RESCALING_COUNT: usize = 4;
const MAX_COVARIANCE_SCALE: f64 = 9.0;

/// Two modes closer than this, squared and in units of the covariance, are one.
const MERGE_CHI_SQUARE: f64 = 25.0;

/// A local maximum of the likelihood ratio.
#[derive(Clone, Debug)]
pub(super) struct Mode {
    pub(super) motion: Motion,
    pub(super) share: f64,
    /// Factor on all covariances under which the mode was found; 1 unless residuals ask for more.
    pub(super) covariance_scale: f64,
    pub(super) fit: Fit,
    /// Inverse of the observed information of `(x, y, heading)`.
    pub(super) covariance: Matrix3<f64>,
}

impl Mode {
    pub(super) fn model<'a>(&self, data: &'a Prepared) -> Model<'a> {
        Model::new(data, self.share, self.covariance_scale)
    }

    /// Two residuals per matched pair less the three unknowns.
    pub(super) fn degrees_of_freedom(&self) -> f64 {
        (2.0 * self.fit.matched - 3.0).max(0.0)
    }

    /// χ² per degree of freedom where that is significantly above 1, else 1.
    pub(super) fn residual_ratio(&self) -> f64 {
        let ratio = Ratio::of_chi_square(self.fit.chi_square, self.degrees_of_freedom());
        ratio.if_significant(SIGNIFICANT_SIGMAS)
    }
}

/// The first `count` starts of a list that is sorted best first, each at least `radius_m` away
/// from every better one.
pub(super) fn separated(
    data: &Prepared,
    sorted: &[Motion],
    count: usize,
    radius_m: f64,
) -> Vec<Motion> {
    let mut kept: Vec<Motion> = Vec::with_capacity(count);
    for motion in sorted {
        if kept.len() == count {
            break;
        }
        if kept.iter().all(|other| data.displacement_m(other, motion) > radius_m) {
            kept.push(*motion);
        }
    }
    kept
}

/// Climbs from `start` to a maximum of the likelihood ratio in pose and share, first with wide
/// covariances. `None` where fewer than two points meet: no information about the heading.
pub(super) fn refine(data: &Prepared, start: Motion) -> Option<Mode> {
    refine_fine(data, &climb_coarsely(data, start))
}

fn refine_fine(data: &Prepared, coarse: &Climbed) -> Option<Mode> {
    refine_from(data, (coarse.motion, coarse.share), 1.0)
}

/// As [`refine`], unless the start stays hopeless with wide covariances against `others`. The
/// climb with wide covariances is over `rough`, some of the periods of `data`.
pub(super) fn refine_hopeful(
    (rough, data): (&Prepared, &Prepared),
    start: Motion,
    others: &[Mode],
) -> Option<Mode> {
    let best = others.iter().map(|mode| mode.fit.log_ratio).fold(0.0, f64::max);
    let part = rough.nodes.len() as f64 / data.nodes.len() as f64;
    let coarse = climb_coarsely(rough, start);
    is_hopeful(coarse.fit.log_ratio, best * part).then(|| refine_fine(data, &coarse)).flatten()
}

/// Climbs from a pose and share near a maximum.
pub(super) fn refine_from(
    data: &Prepared,
    start: (Motion, f64),
    covariance_scale: f64,
) -> Option<Mode> {
    let limits = Limits { step_count: FINE_STEP_COUNT, converged: CONVERGED };
    let fine = climb(data, start, covariance_scale, &limits);
    if fine.is_complete {
        return mode_of(fine, covariance_scale);
    }
    mode_at(data, (fine.motion, fine.share), covariance_scale)
}

fn climb_coarsely(data: &Prepared, start: Motion) -> Climbed {
    let limits = Limits { step_count: COARSE_STEP_COUNT, converged: COARSELY_CONVERGED };
    climb(data, (start, START_SHARE), COARSE_SCALE, &limits)
}

fn is_hopeful(log_ratio: f64, best: f64) -> bool {
    log_ratio >= HOPELESS_SHARE * best.max(0.0)
}

/// The modes again with all covariances widened until the best one's residuals agree with them.
/// The share of pairs near the gate grows with the covariances, hence a few rounds.
pub(super) fn rescaled(data: &Prepared, modes: Vec<Mode>, merge_distance_m: f64) -> Vec<Mode> {
    let mut current = modes;
    for _ in 0..RESCALING_COUNT {
        let Some(best) = current.first() else { break };
        let scale = (best.covariance_scale * best.residual_ratio()).min(MAX_COVARIANCE_SCALE);
        if scale <= best.covariance_scale {
            break;
        }
        let again = |mode: &Mode| refine_from(data, (mode.motion, mode.share), scale);
        current = merged(data, current.iter().filter_map(again).collect(), merge_distance_m);
    }
    current
}

/// The maxima that the starts climb to, without duplicates, likeliest first. Starts that stay
/// hopeless with wide covariances, over `rough`, some of the periods of `data`, do not climb on:
/// they can neither win nor be rivals.
pub(super) fn refine_all(
    (rough, data): (&Prepared, &Prepared),
    starts: &[Motion],
    merge_distance_m: f64,
) -> Vec<Mode> {
    let mut coarse: Vec<Climbed> =
        starts.iter().map(|start| climb_coarsely(rough, *start)).collect();
    coarse.sort_by(|a, b| b.fit.log_ratio.total_cmp(&a.fit.log_ratio));
    let best = coarse.first().map_or(0.0, |best| best.fit.log_ratio);
    let mut kept: Vec<Climbed> = Vec::with_capacity(coarse.len());
    for climbed in coarse.into_iter().filter(|one| is_hopeful(one.fit.log_ratio, best)) {
        let is_far = |other: &Climbed| {
            data.displacement_m(&other.motion, &climbed.motion)
                > COARSE_MERGE_SHARE * merge_distance_m
        };
        if kept.iter().all(is_far) {
            kept.push(climbed);
        }
    }
    let modes = kept.iter().filter_map(|climbed| refine_fine(data, climbed)).collect();
    merged(data, modes, merge_distance_m)
}

/// The mode record of a pose that is kept as it is; only the share is fitted.
pub(super) fn fixed(data: &Prepared, motion: Motion) -> Option<Mode> {
    let mut share = START_SHARE;
    for _ in 0..FINE_STEP_COUNT {
        let fit = evaluate(&Model::new(data, share, 1.0), &motion);
        share = Model::share_from(data, fit.matched);
    }
    mode_at(data, (motion, share), 1.0)
}

fn mode_at(data: &Prepared, at: (Motion, f64), covariance_scale: f64) -> Option<Mode> {
    let (motion, share) = at;
    let fit = evaluate(&Model::new(data, share, covariance_scale), &motion);
    mode_of(Climbed { motion, share, fit, is_complete: true }, covariance_scale)
}

fn mode_of(climbed: Climbed, covariance_scale: f64) -> Option<Mode> {
    let Climbed { motion, share, fit, .. } = climbed;
    let covariance = covariance(&fit)?;
    let finite = motion.x.is_finite() && motion.y.is_finite() && motion.cos.is_finite();
    let mode = Mode { motion, share, covariance_scale, fit, covariance };
    (finite && mode.fit.log_ratio.is_finite()).then_some(mode)
}

/// Where a climb ended.
#[derive(Clone)]
struct Climbed {
    motion: Motion,
    share: f64,
    fit: Fit,
    /// Whether the fit holds what the unknown matching costs.
    is_complete: bool,
}

/// When a climb ends.
struct Limits {
    step_count: usize,
    converged: (f64, f64),
}

/// Expectation maximisation with one Gauss-Newton step per round, halved while it does not climb.
fn climb(
    data: &Prepared,
    (start, start_share): (Motion, f64),
    covariance_scale: f64,
    limits: &Limits,
) -> Climbed {
    let mut room = Room::default();
    let first = Model::new(data, start_share, covariance_scale);
    let mut at = Climbed {
        motion: start,
        share: start_share,
        fit: evaluate_slope(&first, &start, &mut room),
        is_complete: false,
    };
    for _ in 0..limits.step_count {
        let Some(step) = gauss_newton_step(&at.fit) else { break };
        let share = Model::share_from(data, at.fit.matched);
        let model = Model::new(data, share, covariance_scale);
        let length = step.dot(&(at.fit.complete * step));
        if length < limits.converged.0 && (share - at.share).abs() < limits.converged.1 {
            let motion = at.motion.plus(&step);
            return Climbed { motion, share, fit: evaluate(&model, &motion), is_complete: true };
        }
        let from = (&at.motion, at.fit.log_ratio);
        let Some((motion, fit)) = first_climbing(&model, from, &step, &mut room) else { break };
        at = Climbed { motion, share, fit, is_complete: false };
    }
    at
}

fn first_climbing(
    model: &Model<'_>,
    (from, level): (&Motion, f64),
    step: &Vector3<f64>,
    room: &mut Room,
) -> Option<(Motion, Fit)> {
    (0..HALVING_COUNT).find_map(|halving| {
        let moved = from.plus(&(step * 0.5_f64.powi(i32::try_from(halving).ok()?)));
        let fit = evaluate_slope(model, &moved, room);
        (fit.log_ratio >= level - ROUNDING * level.abs().max(1.0)).then_some((moved, fit))
    })
}

fn gauss_newton_step(fit: &Fit) -> Option<Vector3<f64>> {
    let step = Cholesky::new(fit.complete)?.solve(&fit.gradient);
    step.iter().all(|value| value.is_finite()).then_some(step)
}

/// Most of the information that a direction may lose because the matching is not known.
const MAX_LOST_SHARE: f64 = 0.9;

/// Inverse of the observed information, `complete − lost` (Louis' formula). A direction that would
/// lose nearly all keeps a tenth: the formula holds near a maximum only.
fn covariance(fit: &Fit) -> Option<Matrix3<f64>> {
    let root = Cholesky::new(fit.complete)?.l();
    let half = root.solve_lower_triangular(&fit.lost)?;
    let relative = root.solve_lower_triangular(&half.transpose())?;
    let inverse = if relative.trace() < MAX_LOST_SHARE {
        Cholesky::new(fit.complete - fit.lost)?.inverse()
    } else {
        let eigen = ((relative + relative.transpose()) * 0.5).symmetric_eigen();
        let left = eigen.eigenvalues.map(|share| 1.0 / (1.0 - share.clamp(0.0, MAX_LOST_SHARE)));
        let turn = eigen.eigenvectors;
        let back = root.transpose().solve_upper_triangular(&turn)?;
        back * Matrix3::from_diagonal(&left) * back.transpose()
    };
    let symmetric = (inverse + inverse.transpose()) * 0.5;
    symmetric.iter().all(|value| value.is_finite()).then_some(symmetric)
}

/// `modes` without those that lie within the uncertainty or within `radius_m` of a likelier one,
/// likeliest first.
pub(super) fn merged(data: &Prepared, mut modes: Vec<Mode>, radius_m: f64) -> Vec<Mode> {
    modes.sort_by(|a, b| b.fit.log_ratio.total_cmp(&a.fit.log_ratio));
    let mut kept: Vec<Mode> = Vec::with_capacity(modes.len());
    for mode in modes {
        let is_new = |other: &Mode| {
            data.displacement_m(&other.motion, &mode.motion) > radius_m
                && chi_square_between(other, &mode) > MERGE_CHI_SQUARE
        };
        if kept.iter().all(is_new) {
            kept.push(mode);
        }
    }
    kept
}

fn chi_square_between(a: &Mode, b: &Mode) -> f64 {
    squared_length(&b.motion.minus(&a.motion), &a.covariance).unwrap_or(f64::INFINITY)
}
