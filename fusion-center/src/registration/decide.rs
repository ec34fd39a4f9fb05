//! The decision: whether the modes found determine the pose, leave rivals, or prove nothing.
//!
//! The odds of a mode against "nothing in common" are, by Laplace's approximation over a uniform
//! prior of volume `V = (2 W)² 2π` m² rad,
//! `ln O = Λ' / r + ½ ln((2π)³ det(r q C)) − ln V`,
//! with Λ' the likelihood ratio in which what repeats counts once, `q` how often it repeats, `C` the
//! inverse observed information and `r` = χ²/degrees of freedom where that is significantly above 1.
//! Errors that last longer than a period are counted in Λ' and `q` already. The covariance is
//! `C max(r, s)`, `s` what errors that last longer add, and what lasting offsets along the lines of sight
//! add (see `offsets`). The default solver puts the joint fit's pose and covariance in their place.
//!
//! A mode is a rival of the best one if their `ln O` differ by less than the configured odds; if its
//! own `ln O` is more than a configured share of the best one's; or if the motion between the two
//! is a symmetry of the scene. Targets that mirror each other make two poses agree far beyond
//! chance, and which of them matches a few points more is then decided by misses.
//!
//! Assumes that the modes contain the global maximum and its rivals.

use std::f64::consts::TAU;

use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

use super::evidence::{BothRuns, matches_of};
use super::layout::{layout_of, one_walk_m};
use super::modes::Mode;
use super::offsets::offset_covariance;
use super::prepared::Prepared;
use super::symmetry::symmetric_share;
use super::{Certificate, Evidence, Known, Missing, Outcome, PoseEstimate, Rival, Solution};

/// Typical standard deviations by which two places must differ at least: with more of them, tracks
/// of noisy points fill few places and prove nothing; with fewer, standing targets seem to move.
const PLACE_SIGMAS: f64 = 1.0;

/// When a pose counts as determined.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DecisionConfig {
    /// Fewest matched points.
    pub min_matched_count: usize,
    /// Smallest share of the points of the side that has fewer that must match.
    pub min_matched_share: f64,
    /// Fewest places at which they lie.
    pub min_distinct_count: usize,
    /// Places closer than this, metres, are one.
    pub distinct_distance_m: f64,
    /// Smallest natural logarithm of the odds against "nothing in common".
    pub min_log_odds: f64,
    /// Smallest natural logarithm of the odds against any other pose.
    pub min_rival_log_odds: f64,
    /// Largest share of the best pose's log odds that another pose may have.
    pub max_rival_share: f64,
    /// Largest share of the points that the motion to another pose may carry onto other points.
    pub max_symmetric_share: f64,
    /// Largest standard deviation of the position, metres, in its worst direction.
    pub max_position_sigma_m: f64,
    /// Largest standard deviation of the heading, degrees.
    pub max_heading_sigma_deg: f64,
    /// Half the side of the square, metres, in which the node is sought before anything is known.
    pub prior_half_width_m: f64,
}

impl Default for DecisionConfig {
    fn default() -> Self {
        Self {
            min_matched_count: 3,
            // Tuned on strangers who all walk at one pace: 2 of 500 convinced by their odds, with 8 %
            // and 11 % matched; on 700 other seeds 1 did without this, none with it. Half of the
            // points false or missed leaves 25 % and more. What it costs nodes whose views hardly
            // overlap is not measured.
            min_matched_share: 0.15,
            min_distinct_count: 3,
            distinct_distance_m: 0.5,
            // Strangers on straight lines and symmetric pairs with misses came to 11.6 at most in 500
            // trials each; one in 300 of the paper's scenes with misses stays below 12.8.
            min_log_odds: 12.0,
            // ln 1000.
            min_rival_log_odds: 6.9,
            max_rival_share: 0.3,
            max_symmetric_share: 0.6,
            max_position_sigma_m: 0.5,
            max_heading_sigma_deg: 5.0,
            prior_half_width_m: 20.0,
        }
    }
}

/// A mode with all that the decision needs.
#[derive(Clone, Copy, Debug)]
struct Assessed<'a> {
    mode: &'a Mode,
    estimate: PoseEstimate,
    evidence: Evidence,
}

/// The modes' odds decide which is best.
pub(super) fn decide_among(
    data: &Prepared,
    modes: &[Mode],
    given_period_count: usize,
    config: &DecisionConfig,
) -> Solution {
    let mut assessed = assess_all(data, modes, config);
    assessed.sort_by(|a, b| b.evidence.log_odds.total_cmp(&a.evidence.log_odds));
    conclude(data, &assessed, given_period_count, config)
}

/// The first mode is the answer whatever its odds; the others can only be its rivals.
pub(super) fn decide_first(
    data: &Prepared,
    modes: &[Mode],
    given_period_count: usize,
    config: &DecisionConfig,
) -> Solution {
    let mut assessed = assess_all(data, modes, config);
    if let Some((_, rivals)) = assessed.split_first_mut() {
        rivals.sort_by(|a, b| b.evidence.log_odds.total_cmp(&a.evidence.log_odds));
    }
    conclude(data, &assessed, given_period_count, config)
}

fn conclude(
    data: &Prepared,
    assessed: &[Assessed<'_>],
    given_period_count: usize,
    config: &DecisionConfig,
) -> Solution {
    let Some((best, others)) = assessed.split_first() else {
        return without_modes(data, given_period_count);
    };
    let mut evidence = best.evidence;
    evidence.rival_log_odds = others.first().map(|other| rival(best, other).log_odds);
    if let Some(missing) = missing(data, best, config) {
        let outcome = Outcome::Underdetermined { missing };
        return Solution { estimate: None, outcome, evidence, known: Known::default() };
    }
    let near: Vec<Rival> = others
        .iter()
        .filter(|other| is_rival(data, best, other, config))
        .map(|other| rival(best, other))
        .collect();
    let outcome =
        if near.is_empty() { Outcome::Determined } else { Outcome::Ambiguous { rivals: near } };
    Solution { estimate: Some(best.estimate), outcome, evidence, known: Known::default() }
}

fn without_modes(data: &Prepared, given_period_count: usize) -> Solution {
    let shared_period_count = data.spans.len();
    let missing = if shared_period_count == 0 {
        Missing::SharedPeriods { period_count: given_period_count }
    } else {
        Missing::CommonPoints { shared_period_count }
    };
    let evidence = Evidence {
        period_count: shared_period_count,
        ignored_point_count: data.ignored_count,
        covariance_inflation: 1.0,
        ..Evidence::default()
    };
    Solution {
        estimate: None,
        outcome: Outcome::Underdetermined { missing },
        evidence,
        known: Known::default(),
    }
}

fn is_rival(
    data: &Prepared,
    best: &Assessed<'_>,
    other: &Assessed<'_>,
    config: &DecisionConfig,
) -> bool {
    let (best_odds, other_odds) = (best.evidence.log_odds, other.evidence.log_odds);
    best_odds - other_odds < config.min_rival_log_odds
        || other_odds > config.max_rival_share * best_odds
        || symmetric_share(data, &best.mode.motion, &other.mode.motion) > config.max_symmetric_share
}

fn rival(best: &Assessed<'_>, other: &Assessed<'_>) -> Rival {
    Rival {
        pose_ref_from_node: other.estimate.pose_ref_from_node,
        log_odds: best.evidence.log_odds - other.evidence.log_odds,
    }
}

fn missing(data: &Prepared, best: &Assessed<'_>, config: &DecisionConfig) -> Option<Missing> {
    let evidence = &best.evidence;
    let (matched, distinct) = (evidence.matched_point_count, evidence.distinct_point_count);
    if matched < config.min_matched_count {
        return Some(Missing::MatchedPoints { matched, needed: config.min_matched_count });
    }
    let given = data.refs.len().min(data.nodes.len());
    if (matched as f64) < config.min_matched_share * given as f64 {
        return Some(Missing::MatchedShare { matched, given, needed: config.min_matched_share });
    }
    if distinct < config.min_distinct_count {
        return Some(Missing::DistinctPoints { distinct, needed: config.min_distinct_count });
    }
    let layout = || layout_of(data, best.mode, place_distance_m(data, config));
    let (log_odds, needed) = (evidence.log_odds, config.min_log_odds);
    if log_odds.is_nan() || log_odds < needed {
        return Some(Missing::Evidence { log_odds, needed, layout: layout() });
    }
    if let Some(length_m) = one_walk_m(data, best.mode) {
        return Some(Missing::StraightWalk { matched, length_m });
    }
    too_wide(data, best.mode, &best.estimate.covariance, config)
}

/// Which limit the standard deviations of a pose at `mode` exceed, if any.
pub(super) fn too_wide(
    data: &Prepared,
    mode: &Mode,
    covariance: &Matrix3<f64>,
    config: &DecisionConfig,
) -> Option<Missing> {
    let layout = || layout_of(data, mode, place_distance_m(data, config));
    let position = covariance.fixed_view::<2, 2>(0, 0).into_owned();
    let (sigma_m, _, _) = proto::geom::principal_axes(&position);
    if sigma_m > config.max_position_sigma_m {
        let limit_m = config.max_position_sigma_m;
        return Some(Missing::PositionSpread { sigma_m, limit_m, layout: layout() });
    }
    let sigma_rad = covariance[(2, 2)].sqrt();
    let limit_rad = config.max_heading_sigma_deg.to_radians();
    (sigma_rad > limit_rad).then(|| Missing::HeadingSpread {
        sigma_rad,
        limit_rad,
        layout: layout(),
    })
}

fn place_distance_m(data: &Prepared, config: &DecisionConfig) -> f64 {
    config.distinct_distance_m.max(PLACE_SIGMAS * data.typical_sigma_m)
}

fn assess_all<'a>(
    data: &Prepared,
    modes: &'a [Mode],
    config: &DecisionConfig,
) -> Vec<Assessed<'a>> {
    let runs = BothRuns::new(data, place_distance_m(data, config));
    modes.iter().map(|mode| assess(data, &runs, mode, config)).collect()
}

fn assess<'a>(
    data: &Prepared,
    runs: &BothRuns,
    mode: &'a Mode,
    config: &DecisionConfig,
) -> Assessed<'a> {
    let matches = matches_of(data, runs, mode);
    let residual_ratio = mode.residual_ratio();
    let doubt = residual_ratio.max(matches.widening);
    let covariance = mode.covariance * doubt + offset_covariance(data, mode);
    let volume = (2.0 * config.prior_half_width_m).powi(2) * TAU;
    let spread_of_all = mode.covariance * (residual_ratio * matches.repetition);
    let spread = spread_of_all.determinant() * TAU.powi(3);
    let log_odds = matches.log_ratio / residual_ratio + 0.5 * spread.ln() - volume.ln();
    let evidence = Evidence {
        matched_point_count: matches.matched_count,
        distinct_point_count: matches.distinct_count,
        period_count: data.spans.len(),
        ignored_point_count: data.ignored_count,
        chi_square: mode.fit.chi_square * mode.covariance_scale,
        degrees_of_freedom: mode.degrees_of_freedom(),
        covariance_inflation: doubt * mode.covariance_scale,
        log_odds,
        rival_log_odds: None,
        certificate: Certificate::default(),
    };
    let estimate = PoseEstimate { pose_ref_from_node: mode.motion.pose(), covariance };
    Assessed { mode, estimate, evidence }
}
