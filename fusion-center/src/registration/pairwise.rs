//! The default solver: pair hypotheses, robust maximum likelihood, decision.

use serde::{Deserialize, Serialize};

use super::decide::{DecisionConfig, decide_among};
use super::hypotheses::{propose, propose_few};
use super::likelihood::{Model, score};
use super::modes::{
    Mode, START_SHARE, merged, refine_all, refine_from, refine_hopeful, rescaled, separated,
};
use super::prepared::{Motion, Prepared, Span};
use super::{Known, Problem, Solution, Solver};

/// Factor on all covariances while hypotheses are ranked: they carry the errors of two points.
const RANKING_SCALE: f64 = 2.0;

/// Hypotheses that a ranking over some periods passes on to the ranking over all of them.
const SHORT_LIST_COUNT: usize = 128;

/// How far these are apart, as a share of the distance of starts.
const SHORT_LIST_SHARE: f64 = 0.3;

/// Fresh hypotheses per solution that starts from known modes.
const FRESH_COUNT: usize = 48;

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
            ranking_pair_count: 300,
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

    fn solve(&self, problem: &Problem, known: Option<&Known>) -> Solution {
        let data = Prepared::new(problem);
        let resumed = known.filter(|last| last.may_resume(&data)).and_then(|last| {
            let modes = self.resume(&data, last)?;
            Some((last.resumed(&modes), modes))
        });
        let (next, modes) = resumed.unwrap_or_else(|| {
            let modes = self.search(&data);
            (Known::searched(&data, &modes), modes)
        });
        let mut solution = decide_among(&data, &modes, problem.periods.len(), &self.decision);
        solution.known = next.with_outcome(&solution.outcome);
        solution
    }
}

impl Pairwise {
    /// How far apart starts are.
    fn separation_m(&self, data: &Prepared) -> f64 {
        self.config.merge_distance_m.max(SEPARATION_SIGMAS * data.typical_sigma_m)
    }

    /// The modes from nothing.
    fn search(&self, data: &Prepared) -> Vec<Mode> {
        let radius_m = self.separation_m(data);
        let pair_count = self.config.ranking_pair_count;
        let ranked = rank(data, propose(data, &self.config), (pair_count, radius_m));
        let starts = separated(data, &ranked, self.config.mode_count, radius_m);
        let modes = refine_all(data, &starts, self.config.merge_distance_m);
        rescaled(data, modes, self.config.merge_distance_m)
    }

    /// The modes from the known ones and the best of a few fresh hypotheses; `None` where they
    /// explain the data no longer.
    fn resume(&self, data: &Prepared, known: &Known) -> Option<Vec<Mode>> {
        let merge_distance_m = self.config.merge_distance_m;
        let mut modes: Vec<Mode> =
            known.starts().filter_map(|start| refine_from(data, start, 1.0)).collect();
        let config = PairwiseConfig {
            seed: self.config.seed.wrapping_add(u64::from(known.resumed_count()) + 1),
            max_hypothesis_count: FRESH_COUNT.min(self.config.max_hypothesis_count),
            ..self.config.clone()
        };
        let radius_m = self.separation_m(data);
        let is_new = |motion: &&Motion| {
            modes.iter().all(|mode| data.displacement_m(&mode.motion, motion) > radius_m)
        };
        let drawn = propose_few(data, &config);
        let ranked = rank(data, drawn, (config.ranking_pair_count, radius_m));
        let fresh = ranked.iter().find(is_new).copied();
        modes.extend(fresh.and_then(|motion| refine_hopeful(data, motion, &modes)));
        let modes = rescaled(data, merged(data, modes, merge_distance_m), merge_distance_m);
        known.still_explains(data, &modes).then_some(modes)
    }
}

/// Hypotheses, best first. Where periods are many, all hypotheses compete on evenly spread ones of
/// about `pair_count` pairs, and of those that are some way apart the best compete on all.
fn rank(
    data: &Prepared,
    motions: Vec<Motion>,
    (pair_count, radius_m): (usize, f64),
) -> Vec<Motion> {
    if motions.is_empty() {
        return motions;
    }
    let model = Model::new(data, START_SHARE, RANKING_SCALE);
    let given: usize = data.spans.iter().map(Span::pair_count).sum();
    let stride = (given / pair_count.max(1)).max(1);
    let some: Vec<usize> = (0..data.spans.len()).step_by(stride).collect();
    let ranked = sorted_by_score(&model, motions, &some);
    if stride == 1 {
        return ranked;
    }
    let short_list = separated(data, &ranked, SHORT_LIST_COUNT, SHORT_LIST_SHARE * radius_m);
    let all: Vec<usize> = (0..data.spans.len()).collect();
    sorted_by_score(&model, short_list, &all)
}

fn sorted_by_score(model: &Model<'_>, motions: Vec<Motion>, spans: &[usize]) -> Vec<Motion> {
    let mut scored: Vec<(f64, Motion)> =
        motions.into_iter().map(|motion| (score(model, &motion, spans), motion)).collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    scored.into_iter().map(|(_, motion)| motion).collect()
}
