//! The global optimum of the paper's objective with the stated covariances, by branch and bound.
//!
//! It shows what the paper's objective can give at best: its optimum is not efficient, its variance
//! tends to (4/3)² times the bound where all pairs are alike \[registration, eq. (18)\].

use nalgebra::Matrix3;
use proto::geom::{Node, Ref, Se2};
use serde::{Deserialize, Serialize};

use super::decide::DecisionConfig;
use super::judged::{Case, l2_covariance, likely_motions};
use super::prepared::{Motion, Prepared};
use super::{Known, Problem, Solution, Solver};

mod bounds;
mod descent;
mod search;

pub(super) use descent::descend;

/// Settings of the global search.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct L2Config {
    /// Factor on all covariances in the objective.
    pub covariance_scale: f64,
    /// Share by which a pose not excluded may exceed the one found.
    pub relative_gap: f64,
    /// Boxes of poses after which the search reports what it has.
    pub max_box_count: usize,
}

impl Default for L2Config {
    fn default() -> Self {
        Self { covariance_scale: 1.0, relative_gap: 0.01, max_box_count: 400_000 }
    }
}

/// The best pose of a global search and what is proven about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct L2Optimum {
    /// The pose.
    pub pose_ref_from_node: Se2<Ref, Node>,
    /// The objective there, 1/m², below 0.
    pub value_per_m2: f64,
    /// Proven: no pose has an objective below this, 1/m².
    pub bound_per_m2: f64,
    /// Boxes looked at.
    pub box_count: usize,
}

impl L2Optimum {
    /// By what share some other pose could still exceed this one: at most the configured gap,
    /// unless the boxes ran out.
    #[must_use]
    pub fn relative_gap(&self) -> f64 {
        self.bound_per_m2 / self.value_per_m2 - 1.0
    }
}

/// The global L2 solver.
#[derive(Clone, Debug, Default)]
pub struct L2 {
    config: L2Config,
    decision: DecisionConfig,
}

impl L2 {
    /// The solver with these settings.
    #[must_use]
    pub fn new(config: L2Config, decision: DecisionConfig) -> Self {
        Self { config, decision }
    }

    /// The global optimum with its proof; `None` where no two usable points share a period.
    #[must_use]
    pub fn optimum(&self, problem: &Problem) -> Option<L2Optimum> {
        let data = Prepared::new(problem);
        let (motion, found) = search::search(&data, &likely_motions(problem), &self.config)?;
        Some(L2Optimum {
            pose_ref_from_node: motion.pose(),
            value_per_m2: -found.value,
            bound_per_m2: -found.bound,
            box_count: found.box_count,
        })
    }
}

impl Solver for L2 {
    fn name(&self) -> &'static str {
        "l2"
    }

    fn solve(&self, problem: &Problem, _known: Option<&Known>) -> Solution {
        let data = Prepared::new(problem);
        let case = Case::new(&data, problem, &self.decision);
        let likely = likely_motions(problem);
        match search::search(&data, &likely, &self.config) {
            Some((motion, _)) => case.judge(&motion, &likely, |mode| {
                l2_covariance(&data, mode, self.config.covariance_scale)
            }),
            None => case.nothing_found(),
        }
    }
}

/// How far, `(x_m, y_m, heading_rad)`, a pose lies from the minimum of the objective beside it, as
/// the matrix of products to add to a covariance.
pub(super) fn distance_from_minimum(
    data: &Prepared,
    motion: &Motion,
    covariance_scale: f64,
) -> Matrix3<f64> {
    let (minimum, _) = descend(data, motion, covariance_scale);
    let step = minimum.minus(motion);
    step * step.transpose()
}

#[cfg(test)]
mod tests;
