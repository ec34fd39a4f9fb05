//! Modes of the likelihood ratio: separated starts, their refinement, and duplicates merged.

use nalgebra::{Cholesky, Matrix3, Vector3};

use super::likelihood::{Fit, Model, evaluate};
use super::prepared::{Motion, Prepared};

/// Share of common points assumed before the data say anything.
pub(super) const START_SHARE: f64 = 0.5;

/// Factor on all covariances while the pose is still coarse, and how many steps that lasts.
const COARSE_SCALE: f64 = 4.0;
const COARSE_STEP_COUNT: usize = 4;
const FINE_STEP_COUNT: usize = 20;

/// Times a step that lowers the likelihood is halved before the climb ends.
const HALVING_COUNT: usize = 6;

/// A step shorter than this, squared and in units of the covariance, ends the climb.
const CONVERGED: f64 = 1e-7;

/// Loss of log likelihood that rounding may cause.
const ROUNDING: f64 = 1e-9;

/// Share of the best coarse likelihood ratio below which a start is given up.
const HOPELESS_SHARE: f64 = 0.1;

/// Coarse maxima closer than this share of the merging distance are one.
const COARSE_MERGE_SHARE: f64 = 0.5;

/// Standard deviations by which χ² must exceed its expectation to count.
const SIGNIFICANT_SIGMAS: f64 = 3.0;

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
        let free = self.degrees_of_freedom();
        let is_significant = self.fit.chi_square > free + SIGNIFICANT_SIGMAS * (2.0 * free).sqrt();
        if is_significant && free >= 1.0 { self.fit.chi_square / free } else { 1.0 }
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
    refine_fine(data, &climb(data, (start, START_SHARE), COARSE_SCALE, COARSE_STEP_COUNT))
}

fn refine_fine(data: &Prepared, coarse: &Climbed) -> Option<Mode> {
    refine_from(data, (coarse.motion, coarse.share), 1.0)
}

/// As [`refine`], unless the start stays hopeless with wide covariances against `others`.
pub(super) fn refine_hopeful(data: &Prepared, start: Motion, others: &[Mode]) -> Option<Mode> {
    let best = others.iter().map(|mode| mode.fit.log_ratio).fold(0.0, f64::max);
    let coarse = climb(data, (start, START_SHARE), COARSE_SCALE, COARSE_STEP_COUNT);
    (coarse.log_ratio >= HOPELESS_SHARE * best).then(|| refine_fine(data, &coarse)).flatten()
}

/// Climbs from a pose and share near a maximum.
pub(super) fn refine_from(
    data: &Prepared,
    start: (Motion, f64),
    covariance_scale: f64,
) -> Option<Mode> {
    let fine = climb(data, start, covariance_scale, FINE_STEP_COUNT);
    mode_at(data, (fine.motion, fine.share), covariance_scale)
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
/// hopeless with wide covariances do not climb on: they can neither win nor be rivals.
pub(super) fn refine_all(data: &Prepared, starts: &[Motion], merge_distance_m: f64) -> Vec<Mode> {
    let mut coarse: Vec<Climbed> = starts
        .iter()
        .map(|start| climb(data, (*start, START_SHARE), COARSE_SCALE, COARSE_STEP_COUNT))
        .collect();
    coarse.sort_by(|a, b| b.log_ratio.total_cmp(&a.log_ratio));
    let hope = coarse.first().map_or(0.0, |best| HOPELESS_SHARE * best.log_ratio.max(0.0));
    let mut kept: Vec<Climbed> = Vec::with_capacity(coarse.len());
    for climbed in coarse.into_iter().filter(|climbed| climbed.log_ratio >= hope) {
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
    let covariance = covariance(&fit)?;
    let finite = motion.x.is_finite() && motion.y.is_finite() && motion.cos.is_finite();
    let mode = Mode { motion, share, covariance_scale, fit, covariance };
    (finite && mode.fit.log_ratio.is_finite()).then_some(mode)
}

/// Where a climb ended.
#[derive(Clone, Copy)]
struct Climbed {
    motion: Motion,
    share: f64,
    log_ratio: f64,
}

/// Expectation maximisation with one Gauss-Newton step per round, halved while it does not climb.
fn climb(
    data: &Prepared,
    (start, start_share): (Motion, f64),
    covariance_scale: f64,
    step_count: usize,
) -> Climbed {
    let (mut motion, mut share) = (start, start_share);
    let mut fit = evaluate(&Model::new(data, share, covariance_scale), &motion);
    for _ in 0..step_count {
        let Some(step) = gauss_newton_step(&fit) else { break };
        let next_share = Model::share_from(data, fit.matched);
        let model = Model::new(data, next_share, covariance_scale);
        let Some((moved, next)) = first_climbing(&model, &motion, &step, fit.log_ratio) else {
            break;
        };
        let length = step.dot(&(fit.complete * step));
        let settled = length < CONVERGED && (next_share - share).abs() < 1e-4;
        (motion, share, fit) = (moved, next_share, next);
        if settled {
            break;
        }
    }
    Climbed { motion, share, log_ratio: fit.log_ratio }
}

fn first_climbing(
    model: &Model<'_>,
    from: &Motion,
    step: &Vector3<f64>,
    level: f64,
) -> Option<(Motion, Fit)> {
    (0..HALVING_COUNT).find_map(|halving| {
        let moved = from.plus(&(step * 0.5_f64.powi(i32::try_from(halving).ok()?)));
        let fit = evaluate(model, &moved);
        (fit.log_ratio >= level - ROUNDING * level.abs().max(1.0)).then_some((moved, fit))
    })
}

fn gauss_newton_step(fit: &Fit) -> Option<Vector3<f64>> {
    let step = Cholesky::new(fit.complete)?.solve(&fit.gradient);
    step.iter().all(|value| value.is_finite()).then_some(step)
}

/// Inverse of the observed information, `complete − lost` (Louis' formula); of the complete one
/// where the loss leaves nothing positive definite.
fn covariance(fit: &Fit) -> Option<Matrix3<f64>> {
    let observed = fit.complete - fit.lost;
    let factor = Cholesky::new(observed).or_else(|| Cholesky::new(fit.complete))?;
    let inverse = factor.inverse();
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
    let turn = b.motion.heading_rad() - a.motion.heading_rad();
    let heading = proto::geom::wrap_angle(turn);
    let step = Vector3::new(b.motion.x - a.motion.x, b.motion.y - a.motion.y, heading);
    Cholesky::new(a.covariance).map_or(f64::INFINITY, |factor| step.dot(&factor.solve(&step)))
}
