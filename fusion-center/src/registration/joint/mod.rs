//! The last stage of the default solver: pose, trajectories and lasting offsets fitted together.
//!
//! Pairs of points that both sides saw at once are not all that tells the pose. A target moves
//! smoothly, so points that one side alone saw, also in periods in which the other saw nothing, say
//! where it was when the other saw it; and what both saw at different times is brought together by
//! its motion and not by the assumption that nothing moved. So from the best pairwise pose the
//! points of both sides are joined to tracks (`tracks`), and the pose is the one under which
//! nearly straight walks explain all of them best (`passes`, `fit`).
//!
//! How far behind the seen surface the middle of a target lies is known no better than a standard
//! deviation. It differs from person to person and, as a person turns, from walk to walk; and it
//! has a part that all share, because clothes, wall and detector are common to all and because
//! several tracks may be one person's. Both parts are unknowns with half of the variance each, for
//! each side, and the pose's covariance holds what they cost. What shines of a body also lies aside
//! of its middle for as long as the body keeps its direction; that each track has by itself.
//!
//! The stage never makes the answer worse: without tracks, without convergence or with a pose that
//! the pairwise one excludes, there is no result, and the pairwise one stays.

use nalgebra::{Cholesky, Matrix3, Vector3};
use proto::geom::squared_length;

use super::modes::Mode;
use super::prepared::Prepared;
use super::{Period, PoseEstimate, Problem};
use crate::statistics::SIGNIFICANT_SIGMAS;

mod filter;
mod fit;
mod passes;
mod scans;
mod tracks;

use fit::{Joint, fit};
use passes::Setting;
use scans::Scans;
use tracks::{Ground, Track, VELOCITY_SIGMA_MPS, form_tracks};

/// Standard deviations of the pairwise pose within which the joint one must lie.
const MAX_MOVE_SIGMAS: f64 = 5.0;

/// Factor between the determinants of the covariances beyond which the joint fit knows less than
/// the pairs: twice the variance in each of three dimensions. It has lost points then.
const MAX_VAGUER: f64 = 8.0;

/// Rounds of forming tracks and fitting; a second one where the first changes its ground.
const MAX_ROUND_COUNT: usize = 4;

/// A move of the pose beyond this many of the fit's standard deviations asks for new tracks.
const NEW_TRACKS_SIGMAS: f64 = 3.0;

/// So does a factor on the covariances that was too large by this factor.
const NEW_TRACKS_SCALE: f64 = 1.3;

/// Part of a point's typical error up to which the ways of targets between the times of both sides
/// leave the pairs' residuals as they are.
const NEGLIGIBLE_WALK: f64 = 0.3;

/// Share of the points in tracks that must be in established ones: targets that turn up anew in
/// every period have no tracks but by chance.
const MIN_ESTABLISHED_SHARE: f64 = 0.5;

/// The pose of the joint fit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Joined {
    pub(super) estimate: PoseEstimate,
    /// Factor on the covariance, because residuals contradict the stated errors or tracks disagree
    /// by more than theirs; 1 where they agree. The factor on the points' covariances is part of it.
    pub(super) covariance_inflation: f64,
}

/// The joint fit from the best mode, whose published estimate is `pairwise`, its covariance widened
/// by `pairwise_inflation`; `None` where that must stay.
pub(super) fn joined(
    problem: &Problem,
    data: &Prepared,
    (mode, pairwise, pairwise_inflation): (&Mode, &PoseEstimate, f64),
) -> Option<Joined> {
    let scans = Scans::new(problem);
    if scans.duration_s() <= 0.0 {
        return None;
    }
    let moved = moved_between(problem, data);
    // Residuals of pairs that were not seen at once hold the targets' motion too.
    let walked_m = moved_variance_m2(problem).sqrt();
    let is_at_once = walked_m < NEGLIGIBLE_WALK * data.typical_sigma_m;
    let least_inflation = if is_at_once { pairwise_inflation } else { 1.0 };
    let has_offsets = problem.ref_half_depth_sigma_m > 0.0 || problem.node_half_depth_sigma_m > 0.0;
    let start = PoseEstimate { covariance: pairwise.covariance + moved, ..*pairwise };
    let density = scans.points.len() as f64 / (scans.scans.len() as f64 * data.area_m2);
    let mut ground = Ground {
        motion: mode.motion,
        pose_covariance: start.covariance,
        covariance_scale: mode.covariance_scale,
        log_density: density.ln(),
    };
    for _ in 0..MAX_ROUND_COUNT {
        let tracks = form_tracks(&scans, &ground);
        if !has_offsets && established_share(&tracks) < MIN_ESTABLISHED_SHARE {
            return None;
        }
        let setting = Setting {
            points: &scans.points,
            motion: ground.motion,
            covariance_scale: ground.covariance_scale,
            outlier_log_density: ground.log_density,
        };
        let joint =
            if has_offsets { fit::<8>(&setting, &tracks) } else { fit::<4>(&setting, &tracks) }?;
        let next = ground.after(&joint);
        if next.is_like(&ground, &joint) {
            let least = least_inflation / ground.covariance_scale;
            return accepted(&joint, &start, (ground.covariance_scale, least));
        }
        ground = next;
    }
    None
}

/// Mean square way of targets between the times of the two sides.
fn moved_variance_m2(problem: &Problem) -> f64 {
    let square = |period: &Period| (period.node_time_s - period.ref_time_s).powi(2);
    let mean = problem.periods.iter().map(square).sum::<f64>() / problem.periods.len() as f64;
    mean * VELOCITY_SIGMA_MPS.powi(2)
}

/// Covariance of the pose `(x, y, heading)` because targets move between the times of the two
/// sides, which the pairwise pose neglects.
fn moved_between(problem: &Problem, data: &Prepared) -> Matrix3<f64> {
    let variance_m2 = moved_variance_m2(problem);
    let lever_m2 = data.node_spread_m.powi(2).max(1.0);
    let center = data.node_center_m.norm_squared();
    let heading = variance_m2 / lever_m2;
    let position = variance_m2 + center * heading;
    Matrix3::from_diagonal(&Vector3::new(position, position, heading))
}

impl Ground {
    /// What a fit leaves to form tracks on.
    fn after(&self, joint: &Joint) -> Self {
        let ratio = joint.residual.sum / joint.residual.expected.max(1.0);
        let needed = (self.covariance_scale * ratio).max(1.0);
        Self {
            motion: joint.motion,
            pose_covariance: joint.covariance.fixed_view::<3, 3>(0, 0).into_owned(),
            covariance_scale: needed.min(self.covariance_scale),
            log_density: self.log_density,
        }
    }

    /// Whether tracks formed on this would be those formed on `before`, which `joint` came from.
    fn is_like(&self, before: &Self, joint: &Joint) -> bool {
        let pose_covariance = joint.covariance.fixed_view::<3, 3>(0, 0).into_owned();
        let length = squared_length(&self.motion.minus(&before.motion), &pose_covariance);
        self.covariance_scale * NEW_TRACKS_SCALE >= before.covariance_scale
            && length.is_some_and(|square| square < NEW_TRACKS_SIGMAS.powi(2))
    }
}

fn established_share(tracks: &[Track]) -> f64 {
    let count = |of: &mut dyn Iterator<Item = &Track>| of.map(|t| t.members.len()).sum::<usize>();
    let all = count(&mut tracks.iter());
    count(&mut tracks.iter().filter(|track| track.is_established)) as f64 / all.max(1) as f64
}

/// The fit as an estimate, if the pairwise one allows it. Besides the factor on the points'
/// covariances comes the least factor on the result: where pairs contradict the stated errors, tracks
/// that follow the noise must not hide it.
fn accepted(
    joint: &Joint,
    pairwise: &PoseEstimate,
    (covariance_scale, least_inflation): (f64, f64),
) -> Option<Joined> {
    let residual = joint.residual.if_significant(SIGNIFICANT_SIGMAS).max(least_inflation);
    let inflation = residual.max(joint.lasting.if_significant(SIGNIFICANT_SIGMAS));
    let inverse: Matrix3<f64> = joint.covariance.fixed_view::<3, 3>(0, 0) * inflation;
    let covariance = (inverse + inverse.transpose()) * 0.5;
    let step = joint.motion.pose().minus(&pairwise.pose_ref_from_node);
    let length = squared_length(&step, &(pairwise.covariance + covariance))?;
    let is_near = length <= MAX_MOVE_SIGMAS.powi(2);
    let knows_less = covariance.determinant() > MAX_VAGUER * pairwise.covariance.determinant();
    let estimate = PoseEstimate { pose_ref_from_node: joint.motion.pose(), covariance };
    (is_near && !knows_less && Cholesky::new(covariance).is_some())
        .then_some(Joined { estimate, covariance_inflation: inflation * covariance_scale })
}

#[cfg(test)]
mod study;
#[cfg(test)]
mod tests;
