//! The default solver: pair hypotheses, robust maximum likelihood, decision.

use serde::{Deserialize, Serialize};

use super::decide::{DecisionConfig, decide_among};
use super::hypotheses::propose;
use super::likelihood::{Model, score};
use super::modes::{START_SHARE, refine_all, rescaled, separated};
use super::prepared::{Motion, Prepared};
use super::{Problem, Solution, Solver};

/// Factor on all covariances while hypotheses are ranked: they carry the errors of two points.
const RANKING_SCALE: f64 = 2.0;

/// Hypotheses that a ranking over some periods passes on to the ranking over all of them.
const SHORT_LIST_COUNT: usize = 128;

/// Starts closer than this many typical standard deviations climb to the same maximum.
const SEPARATION_SIGMAS: f64 = 4.0;

/// Settings of the default solver.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PairwiseConfig {
    /// Seed of the draws where candidate pairs are too many to try all.
    pub seed: u64,
    /// Shortest segment, metres, that may fix a heading.
    pub min_baseline_m: f64,
    /// How many standard deviations the lengths of two segments may differ.
    pub length_gate_sigma: f64,
    /// Up to this many pairs of candidate matches are tried in full.
    pub exhaustive_pair_limit: usize,
    /// Most hypotheses that are ranked.
    pub max_hypothesis_count: usize,
    /// Pairs of points that the first ranking of one hypothesis looks at.
    pub ranking_pair_count: usize,
    /// Separated hypotheses that are refined.
    pub mode_count: usize,
    /// Poses that carry the node's points less than this apart, metres, are the same pose.
    pub merge_distance_m: f64,
}

impl Default for PairwiseConfig {
    fn default() -> Self {
        Self {
            seed: 1,
            min_baseline_m: 0.5,
            length_gate_sigma: 3.0,
            exhaustive_pair_limit: 200_000,
            max_hypothesis_count: 2_000,
            ranking_pair_count: 800,
            mode_count: 10,
            merge_distance_m: 0.1,
        }
    }
}

/// The default solver.
#[derive(Clone, Debug, Default)]
pub struct Pairwise {
    config: PairwiseConfig,
    decision: DecisionConfig,
}

impl Pairwise {
    /// The solver with these settings.
    #[must_use]
    pub fn new(config: PairwiseConfig, decision: DecisionConfig) -> Self {
        Self { config, decision }
    }
}

impl Solver for Pairwise {
    fn name(&self) -> &'static str {
        "default"
    }

    fn solve(&self, problem: &Problem) -> Solution {
        let data = Prepared::new(problem);
        let ranked = rank(&data, propose(&data, &self.config), &self.config);
        let radius_m = self.config.merge_distance_m.max(SEPARATION_SIGMAS * data.typical_sigma_m);
        let starts = separated(&data, &ranked, self.config.mode_count, radius_m);
        let modes = refine_all(&data, &starts, self.config.merge_distance_m);
        let modes = rescaled(&data, modes, self.config.merge_distance_m);
        decide_among(&data, &modes, problem.periods.len(), &self.decision)
    }
}

/// Hypotheses, best first. Where periods are many, all hypotheses compete on evenly spread ones
/// and only the best on all.
fn rank(data: &Prepared, motions: Vec<Motion>, config: &PairwiseConfig) -> Vec<Motion> {
    if motions.is_empty() {
        return motions;
    }
    let model = Model::new(data, START_SHARE, RANKING_SCALE);
    let pair_count: usize = data.spans.iter().map(super::prepared::Span::pair_count).sum();
    let stride = (pair_count / config.ranking_pair_count.max(1)).max(1);
    let some: Vec<usize> = (0..data.spans.len()).step_by(stride).collect();
    let ranked = sorted_by_score(&model, motions, &some);
    if stride == 1 {
        return ranked;
    }
    let short_list = ranked.into_iter().take(SHORT_LIST_COUNT).collect();
    let all: Vec<usize> = (0..data.spans.len()).collect();
    sorted_by_score(&model, short_list, &all)
}

fn sorted_by_score(model: &Model<'_>, motions: Vec<Motion>, spans: &[usize]) -> Vec<Motion> {
    let mut scored: Vec<(f64, Motion)> =
        motions.into_iter().map(|motion| (score(model, &motion, spans), motion)).collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    scored.into_iter().map(|(_, motion)| motion).collect()
}
