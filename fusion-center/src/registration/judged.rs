//! The common decision about a pose that another estimator found, with that estimator's own
//! covariance.
//!
//! Odds, matches and rivals are those of the likelihood ratio at the found pose. The covariance of
//! an estimator that minimises `Σ ψ` is the sandwich `A⁻¹ B A⁻¹`, `A` the expected Hessian and `B`
//! the variance of the gradient. For the L2 objective with covariances times `s`, a matched pair
//! with the true covariance `S`, `J = ∂(Φ z + t)`, has
//! `A = s / (s + 1)² · Jᵀ S⁻¹ J / √det S`, `B = 1 / (s + 2)² · Jᵀ S⁻¹ J / det S`
//! up to common factors: equal pairs at `s = 1` give (4/3)² times the bound \[registration,
//! eq. (18)\]. Assumes that covariances are as stated and that unmatched points add nothing.
//! Cost: one evaluation of the likelihood.

use nalgebra::{Cholesky, Matrix2x3, Matrix3, Vector2};
use proto::geom::{point_by_pose, principal_axes};

use super::decide::{DecisionConfig, decide_first, too_wide};
use super::likelihood::for_each_period;
use super::modes::{Mode, fixed, merged, refine, separated};
use super::prepared::{Blob, Motion, Prepared};
use super::{Outcome, Pairwise, PoseEstimate, Problem, Solution, Solver};

/// Poses that carry the points less than this apart, metres, are one rival.
const RIVAL_DISTANCE_M: f64 = 0.1;

/// Standard deviation of a heading of which nothing is known: `π / √3`.
const UNKNOWN_HEADING_SIGMA_RAD: f64 = 1.813_799;

/// What the decision is about.
pub(super) struct Case<'a> {
    pub(super) data: &'a Prepared,
    pub(super) given_period_count: usize,
    pub(super) decision: &'a DecisionConfig,
}

impl<'a> Case<'a> {
    /// What is judged: a problem as prepared, under the limits of `decision`.
    pub(super) fn new(data: &'a Prepared, problem: &Problem, decision: &'a DecisionConfig) -> Self {
        Self { data, given_period_count: problem.periods.len(), decision }
    }

    /// The answer of an estimator that found nothing.
    pub(super) fn nothing_found(&self) -> Solution {
        decide_first(self.data, &[], self.given_period_count, self.decision)
    }

    /// The decision about `found`, whose rivals are among `others`. `own_covariance` gives the
    /// estimator's covariance of `(x_m, y_m, heading_rad)` from the likelihood's view of the pose;
    /// where it has none, the likelihood's stands.
    pub(super) fn judge(
        &self,
        found: &Motion,
        others: &[Motion],
        own_covariance: impl FnOnce(&Mode) -> Option<Matrix3<f64>>,
    ) -> Solution {
        let modes = self.modes_of(found, others);
        let solution = decide_first(self.data, &modes, self.given_period_count, self.decision);
        let own = modes.first().and_then(|mode| Some((mode, own_covariance(mode)?)));
        match own {
            Some((mode, covariance)) => self.with_covariance(solution, mode, &covariance),
            None => solution,
        }
    }

    /// The found pose as it is, then the other poses, refined so that the decision sees how good
    /// they really are.
    fn modes_of(&self, found: &Motion, others: &[Motion]) -> Vec<Mode> {
        let data = self.data;
        let Some(best) = fixed(data, *found) else { return Vec::new() };
        let climbed = refine(data, *found);
        let top = climbed.as_ref().map_or(*found, |mode| mode.motion);
        let is_other = |mode: &Mode| {
            data.displacement_m(&top, &mode.motion) > RIVAL_DISTANCE_M
                && data.displacement_m(found, &mode.motion) > RIVAL_DISTANCE_M
        };
        let separate = separated(data, others, others.len(), RIVAL_DISTANCE_M);
        // The maximum beside the found pose takes part, so that what it cannot be told from is no
        // rival.
        let maxima = climbed.into_iter().chain(separate.iter().filter_map(|m| refine(data, *m)));
        let known = maxima.filter(|mode| self.is_fixed(mode));
        let distinct = merged(data, known.collect(), RIVAL_DISTANCE_M);
        std::iter::once(best).chain(distinct.into_iter().filter(is_other)).collect()
    }

    /// Whether the points tell more of every unknown than was known before. A swarm's best pose of
    /// a sector often meets no point at all: tails of far ones hold it, with a covariance of many
    /// metres, and the odds of such a plain, by the volume of a peak that it is not, are those of a
    /// good pose.
    fn is_fixed(&self, mode: &Mode) -> bool {
        let position = mode.covariance.fixed_view::<2, 2>(0, 0).into_owned();
        let (sigma_m, _, _) = principal_axes(&position);
        let sigma_rad = mode.covariance[(2, 2)].sqrt();
        mode.covariance.iter().all(|value| value.is_finite())
            && sigma_m < self.decision.prior_half_width_m
            && sigma_rad < UNKNOWN_HEADING_SIGMA_RAD
    }

    /// The solution with the estimator's covariance in the place of the likelihood's, and the limits of
    /// the spread checked again. What the decision made of the likelihood's covariance applies alike.
    fn with_covariance(&self, mut solution: Solution, mode: &Mode, own: &Matrix3<f64>) -> Solution {
        let Some(estimate) = solution.estimate else { return solution };
        let Some(factor) = Cholesky::new(mode.covariance) else { return solution };
        let widening = factor.solve(&estimate.covariance).trace() / 3.0;
        let added = estimate.covariance + (own - mode.covariance) * widening;
        let covariance = if Cholesky::new(added).is_some() { added } else { own * widening };
        solution.estimate = Some(PoseEstimate { covariance, ..estimate });
        if let Some(missing) = too_wide(self.data, mode, &covariance, self.decision) {
            solution.estimate = None;
            solution.outcome = Outcome::Underdetermined { missing };
        }
        solution
    }
}

/// The maxima of the likelihood ratio that the default solver finds, likeliest first: rivals, and
/// starts for other estimators.
pub(super) fn likely_motions(problem: &Problem) -> Vec<Motion> {
    let solution = Pairwise::default().solve(problem, None);
    solution.known.starts().map(|(motion, _)| motion).collect()
}

/// `J`: how a node's point moves in the reference frame with `(x, y, heading)`.
pub(super) fn jacobian(motion: &Motion, node: &Blob) -> Matrix2x3<f64> {
    let (x_m, y_m) = motion.turned(node.x, node.y);
    point_by_pose(&Vector2::new(x_m, y_m))
}

/// `A⁻¹ B A⁻¹`, symmetric; `None` where `A` is not positive definite.
pub(super) fn sandwich(bread: &Matrix3<f64>, filling: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let inverse = Cholesky::new(*bread)?.inverse();
    let covariance = inverse * filling * inverse;
    covariance.iter().all(|v| v.is_finite()).then(|| (covariance + covariance.transpose()) * 0.5)
}

/// The covariance of the minimum of the L2 objective with covariances times `covariance_scale`.
pub(super) fn l2_covariance(
    data: &Prepared,
    mode: &Mode,
    covariance_scale: f64,
) -> Option<Matrix3<f64>> {
    let (mut bread, mut filling) = (Matrix3::zeros(), Matrix3::zeros());
    for_each_period(&mode.model(data), &mode.motion, |period, _| {
        for link in &period.links {
            let by_pose = jacobian(&mode.motion, &data.nodes[link.node_index]);
            let precision = link.precision() * mode.covariance_scale;
            let information = by_pose.transpose() * precision * by_pose * link.weight;
            let inverse_det = precision.determinant();
            bread += information * inverse_det.max(0.0).sqrt();
            filling += information * inverse_det;
        }
    });
    let s = covariance_scale;
    sandwich(&(bread * (s / (s + 1.0).powi(2))), &(filling / (s + 2.0).powi(2)))
}

#[cfg(test)]
#[path = "judged_tests.rs"]
mod tests;
