//! Complete-graph matching: the second baseline of the paper.
//!
//! Both sides' points are the nodes of two complete graphs, their distances the edges' attributes;
//! the association with the least sum of squared differences of distances gives the pose by an
//! unweighted rigid least-squares fit \[registration, reference 9\]. Edges join points of any two
//! periods, associations only points of one; one period is the case of one. How many points both
//! sides have in common must be given, and no covariance is used: unknown misses are forced into
//! pairs and spoil the pose. That is the baseline as it is.
//!
//! The association over as many evenly spaced periods as the limit of candidates admits is found by
//! a spectral start with local improvement and, where every period has few possible associations,
//! by an exact branch and bound up to a limit of branches. Further periods take, greedily, the pairs
//! that agree best with those.

use serde::{Deserialize, Serialize};

use super::decide::DecisionConfig;
use super::judged::{Case, likely_motions};
use super::prepared::Prepared;
use super::{Known, Problem, Solution, Solver};

mod agreement;
mod exact;
mod rigid;
mod spectral;

use agreement::{Agreement, Association};

/// Settings of graph matching.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GraphConfig {
    /// How many points both sides have in common in every period; 0 for the fewer points of both.
    pub common_count: usize,
    /// Most pairs of points of one period, over all periods, that are associated at once.
    pub max_candidate_count: usize,
    /// Branches after which the exact search keeps what it has; 0 for none.
    pub max_branch_count: usize,
}

impl Default for GraphConfig {
    fn default() -> Self {
        Self { common_count: 0, max_candidate_count: 400, max_branch_count: 10_000 }
    }
}

/// The graph matching solver.
#[derive(Clone, Debug, Default)]
pub struct Graph {
    config: GraphConfig,
    decision: DecisionConfig,
}

impl Graph {
    /// The solver with these settings.
    #[must_use]
    pub fn new(config: GraphConfig, decision: DecisionConfig) -> Self {
        Self { config, decision }
    }

    /// Which of the reference's and the node's points belong together, as indices of `data`.
    fn associate(&self, data: &Prepared) -> Vec<(usize, usize)> {
        let agreement = Agreement::new(data, &self.config);
        let start = agreement.improved(spectral::association(&agreement, data.typical_sigma_m));
        let best = exact::search(&agreement, start, self.config.max_branch_count).association;
        agreement.extended(data, &best)
    }
}

impl Solver for Graph {
    fn name(&self) -> &'static str {
        "graph"
    }

    fn solve(&self, problem: &Problem, _known: Option<&Known>) -> Solution {
        let data = Prepared::new(problem);
        let case = Case::new(&data, problem, &self.decision);
        let pairs = self.associate(&data);
        match rigid::fit(&data, &pairs) {
            Some(motion) => case.judge(&motion, &likely_motions(problem), |_| {
                rigid::covariance(&data, &pairs, &motion)
            }),
            None => case.nothing_found(),
        }
    }
}

#[cfg(test)]
mod tests;
