//! Registration: where a node stands in the reference frame, from points that both saw.
//!
//! A [`Solver`] takes the points of all periods that the reference side and one node share and
//! returns a [`Solution`]: the pose, its covariance, and above all whether the data decide it.
//! A solver never fails: data that cannot decide give [`Outcome::Ambiguous`] or
//! [`Outcome::Underdetermined`], and callers publish [`Outcome::Determined`] only.

use std::fmt;

use nalgebra::Matrix3;
use proto::geom::{Gaussian, Node, Ref, Se2};
use serde::{Deserialize, Serialize};

mod certificate;
mod decide;
mod evidence;
mod graph;
mod hypotheses;
mod joint;
mod judged;
mod known;
mod l2;
mod layout;
mod likelihood;
mod modes;
pub mod objective;
mod of_nodes;
mod offsets;
mod pairwise;
mod prepared;
mod runs;
mod settings;
mod swarm;
mod symmetry;

#[cfg(test)]
mod baseline_tests;
#[cfg(test)]
mod clutter_tests;
#[cfg(test)]
mod degenerate_tests;
#[cfg(test)]
mod scene_tests;
#[cfg(test)]
mod standing_tests;
#[cfg(test)]
mod statistics_tests;

pub use certificate::{Certificate, Uncertified};
pub use decide::DecisionConfig;
pub use graph::{Graph, GraphConfig};
pub use known::Known;
pub use l2::{L2, L2Config, L2Optimum};
pub use of_nodes::Seen;
pub use pairwise::{Pairwise, PairwiseConfig};
pub use settings::InvalidSolver;
pub use swarm::{Swarm, SwarmConfig};

/// One detection period seen by both sides.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Period {
    /// When the reference side measured, seconds from any origin that all periods share.
    pub ref_time_s: f64,
    /// When the node measured, by the same clock.
    pub node_time_s: f64,
    /// The reference side's points in the reference frame, whose origin is that side's array.
    pub in_ref: Vec<Gaussian<Ref>>,
    /// The node's points in its own frame.
    pub in_node: Vec<Gaussian<Node>>,
}

/// What is to be registered: periods in order of time. Periods may be empty on either side.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Problem {
    /// The periods, oldest first.
    pub periods: Vec<Period>,
    /// Standard deviation, metres, of an offset along the line of sight that lasts: how far behind
    /// what the reference side saw the middle of a target lies is known no better. The points'
    /// covariances do not hold it.
    pub ref_half_depth_sigma_m: f64,
    /// The same of the node's side.
    pub node_half_depth_sigma_m: f64,
}

/// A way to find a node's pose from shared points.
pub trait Solver: Send + Sync {
    /// A short name for logs and reports.
    fn name(&self) -> &'static str;

    /// The pose of the node and how far the data decide it. `known` is what the last solution of
    /// the same node found; it saves time, and with it rivals are sought near what was known and
    /// among few fresh hypotheses, and nothing is certified, which the evidence says. The same problem and the same `known`
    /// give the same bytes.
    fn solve(&self, problem: &Problem, known: Option<&Known>) -> Solution;
}

/// A solver's answer.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    /// The best pose; `None` where the data do not support any.
    pub estimate: Option<PoseEstimate>,
    /// Whether the data decide the pose. Publish `Determined` only.
    pub outcome: Outcome,
    /// The numbers behind the outcome.
    pub evidence: Evidence,
    /// What the next solution of this node may start from.
    pub known: Known,
}

/// A pose and how sure it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseEstimate {
    /// The node's pose in the reference frame.
    pub pose_ref_from_node: Se2<Ref, Node>,
    /// Covariance of the additive errors `(x_m, y_m, heading_rad)` in the reference frame.
    pub covariance: Matrix3<f64>,
}

/// Whether the data decide the pose.
#[derive(Clone, Debug, PartialEq)]
pub enum Outcome {
    /// One pose explains the data and no other comes near it.
    Determined,
    /// At least one clearly different pose explains the data nearly as well.
    Ambiguous {
        /// The other poses, likeliest first.
        rivals: Vec<Rival>,
    },
    /// The data are too few or too weak for any pose.
    Underdetermined {
        /// What the data lack.
        missing: Missing,
    },
}

/// Another pose that the data allow.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rival {
    /// The other pose.
    pub pose_ref_from_node: Se2<Ref, Node>,
    /// Natural logarithm of the best pose's odds against this one.
    pub log_odds: f64,
}

/// What the data lack.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Missing {
    /// No period has usable points on both sides.
    SharedPeriods {
        /// How many periods were given.
        period_count: usize,
    },
    /// No pose makes two points of the one side meet two of the other.
    CommonPoints {
        /// Periods with points on both sides.
        shared_period_count: usize,
    },
    /// Too few points meet.
    MatchedPoints {
        /// Points that meet under the best pose.
        matched: usize,
        /// How many are needed.
        needed: usize,
    },
    /// Too few of the points meet: walks of strangers do so here and there.
    MatchedShare {
        /// Points that meet under the best pose.
        matched: usize,
        /// Points of the side that has fewer, in shared periods.
        given: usize,
        /// The share of them that must meet.
        needed: f64,
    },
    /// Points meet, but always at the same few places.
    DistinctPoints {
        /// Places at which points meet.
        distinct: usize,
        /// How many are needed.
        needed: usize,
    },
    /// All common points lie on one straight walk at constant speed. Such walks of two strangers
    /// agree as soon as their speeds do, however many points they have.
    StraightWalk {
        /// Points that meet under the best pose.
        matched: usize,
        /// Length of the walk, metres.
        length_m: f64,
    },
    /// The agreement could be chance.
    Evidence {
        /// Logarithm of the odds of the best pose against "nothing in common".
        log_odds: f64,
        /// How much is needed.
        needed: f64,
        /// How the matched points lie.
        layout: Layout,
    },
    /// The position stays too uncertain.
    PositionSpread {
        /// Largest standard deviation of the position in metres.
        sigma_m: f64,
        /// The largest allowed.
        limit_m: f64,
        /// How the matched points lie.
        layout: Layout,
    },
    /// The heading stays too uncertain.
    HeadingSpread {
        /// Standard deviation of the heading in radians.
        sigma_rad: f64,
        /// The largest allowed.
        limit_rad: f64,
        /// How the matched points lie.
        layout: Layout,
    },
}

/// How the points that meet lie; lengths hold nearly all of them, 2.5 % may lie beyond either end.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Layout {
    /// All within one place.
    Place {
        /// Its extent, metres.
        length_m: f64,
    },
    /// Along one line.
    Line {
        /// Along it, metres.
        length_m: f64,
        /// Across it, metres.
        width_m: f64,
    },
    /// Over an area.
    Area {
        /// Its longer side, metres.
        length_m: f64,
        /// Its shorter side, metres.
        width_m: f64,
    },
}

impl fmt::Display for Missing {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::SharedPeriods { period_count } => write!(
                f,
                "none of {period_count} periods has points on both sides: \
                 let people walk where both nodes see"
            ),
            Self::CommonPoints { shared_period_count } => write!(
                f,
                "no two common points in {shared_period_count} shared periods: \
                 let people walk where both nodes see"
            ),
            Self::MatchedPoints { matched, needed } => write!(
                f,
                "{matched} common points, {} more needed: let people walk where both nodes see",
                needed.saturating_sub(matched)
            ),
            Self::MatchedShare { matched, given, needed } => write!(
                f,
                "{matched} of {given} points common, {:.0} % needed: \
                 let people walk where both nodes see",
                100.0 * needed
            ),
            Self::DistinctPoints { distinct: 1, needed } => write!(
                f,
                "common targets at one place only, {needed} places needed: let people walk about"
            ),
            Self::DistinctPoints { distinct, needed } => write!(
                f,
                "common targets at {distinct} places only, {needed} needed: let people walk about"
            ),
            Self::StraightWalk { matched, length_m } => write!(
                f,
                "all {matched} common points lie on one straight walk of {length_m:.1} m at \
                 constant speed: let one walk across it"
            ),
            Self::Evidence { log_odds, needed, layout } => write!(
                f,
                "log odds {log_odds:.1} against chance, at least {needed:.1} needed: {layout}"
            ),
            Self::PositionSpread { sigma_m, limit_m, layout } => {
                write!(f, "position known to {sigma_m:.2} m only, {limit_m:.2} m allowed: {layout}")
            }
            Self::HeadingSpread { sigma_rad, limit_rad, layout } => {
                let (sigma, limit) = (sigma_rad.to_degrees(), limit_rad.to_degrees());
                write!(f, "heading known to {sigma:.1}° only, {limit:.1}° allowed: {layout}")
            }
        }
    }
}

impl fmt::Display for Layout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Place { length_m } => write!(
                f,
                "common targets stayed within {length_m:.1} m; let people walk across the room"
            ),
            Self::Line { length_m, .. } => write!(
                f,
                "common targets kept to one line of {length_m:.1} m; let one walk across it"
            ),
            Self::Area { length_m, width_m } => write!(
                f,
                "common targets covered {length_m:.1} m by {width_m:.1} m; \
                 let people walk longer and farther apart"
            ),
        }
    }
}

/// The numbers behind an outcome.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Evidence {
    /// Pairs of points that more likely than not are the same target, over all periods.
    pub matched_point_count: usize,
    /// Places, farther apart than the configured distance, at which such pairs lie.
    pub distinct_point_count: usize,
    /// Periods with usable points on both sides.
    pub period_count: usize,
    /// Points left out because they were not finite or had no positive definite covariance.
    pub ignored_point_count: usize,
    /// Sum of squared residuals of the matched pairs in units of their variance.
    pub chi_square: f64,
    /// Twice the matched pairs less the three unknowns, at least 0.
    pub degrees_of_freedom: f64,
    /// By how much the covariance was multiplied because residuals contradict the stated one or
    /// errors last longer than a period; 1 where they agree.
    pub covariance_inflation: f64,
    /// Natural logarithm of the odds of the best pose against "nothing in common".
    pub log_odds: f64,
    /// Natural logarithm of the best pose's odds against the next separated one, if there is one.
    pub rival_log_odds: Option<f64>,
    /// Whether it is proven that no other pose comes near.
    pub certificate: Certificate,
}

/// Which solver to use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SolverKind {
    /// Pair hypotheses, then robust maximum likelihood: [`Pairwise`].
    #[default]
    Default,
    /// The particle swarm of \[registration\]: [`Swarm`].
    Swarm,
    /// Complete-graph matching, the baseline of \[registration\]: [`Graph`].
    Graph,
    /// The global optimum of the objective of \[registration\]: [`L2`].
    L2,
}

/// Settings of registration.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SolverConfig {
    /// Which solver to use.
    pub kind: SolverKind,
    /// When a pose counts as determined; all solvers.
    pub decision: DecisionConfig,
    /// Settings of the default solver.
    pub default: PairwiseConfig,
    /// Settings of the particle swarm.
    pub swarm: SwarmConfig,
    /// Settings of graph matching.
    pub graph: GraphConfig,
    /// Settings of the global search for the L2 optimum.
    pub l2: L2Config,
}

/// The solver that `config` names.
#[must_use]
pub fn build(config: &SolverConfig) -> Box<dyn Solver> {
    match config.kind {
        SolverKind::Default => {
            Box::new(Pairwise::new(config.default.clone(), config.decision.clone()))
        }
        SolverKind::Swarm => Box::new(Swarm::new(config.swarm.clone(), config.decision.clone())),
        SolverKind::Graph => Box::new(Graph::new(config.graph.clone(), config.decision.clone())),
        SolverKind::L2 => Box::new(L2::new(config.l2.clone(), config.decision.clone())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn configuration_names_the_solver_and_refuses_unknown_keys() {
        let config: SolverConfig =
            toml::from_str("kind = \"swarm\"\n[swarm]\nparticle_count = 7\n").unwrap();
        assert_eq!(build(&config).name(), "swarm");
        assert_eq!(config.swarm.particle_count, 7);
        assert_eq!(build(&SolverConfig::default()).name(), "default");
        for name in ["graph", "l2"] {
            let of_name: SolverConfig = toml::from_str(&format!("kind = \"{name}\"")).unwrap();
            assert_eq!(build(&of_name).name(), name);
        }
        for bad in ["kind = \"magic\"", "[default]\nhypotheses = 3", "[decision]\nx = 1"] {
            assert!(toml::from_str::<SolverConfig>(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn every_reason_shows_its_numbers_and_what_helps() {
        let line = Layout::Line { length_m: 4.0, width_m: 0.1 };
        let place = Layout::Place { length_m: 0.3 };
        let area = Layout::Area { length_m: 4.0, width_m: 2.5 };
        for (missing, parts) in [
            (Missing::SharedPeriods { period_count: 4 }, ["none of 4 periods", "both nodes see"]),
            (Missing::CommonPoints { shared_period_count: 5 }, ["in 5 shared", "both nodes see"]),
            (Missing::MatchedPoints { matched: 1, needed: 3 }, ["1 common", "2 more needed"]),
            (
                Missing::MatchedShare { matched: 8, given: 95, needed: 0.1 },
                ["8 of 95 points", "10 % needed"],
            ),
            (Missing::DistinctPoints { distinct: 1, needed: 3 }, ["at one place only", "3 places"]),
            (Missing::DistinctPoints { distinct: 2, needed: 3 }, ["at 2 places", "walk about"]),
            (
                Missing::StraightWalk { matched: 7, length_m: 5.25 },
                ["all 7 common", "walk of 5.2 m"],
            ),
            (
                Missing::Evidence { log_odds: 1.5, needed: 9.0, layout: place },
                ["1.5", "within 0.3 m"],
            ),
            (
                Missing::PositionSpread { sigma_m: 0.7, limit_m: 0.5, layout: line },
                ["0.70 m only, 0.50 m", "one line of 4.0 m; let one walk across"],
            ),
            (
                Missing::HeadingSpread { sigma_rad: 0.1, limit_rad: 0.05, layout: area },
                ["5.7° only, 2.9°", "4.0 m by 2.5 m"],
            ),
        ] {
            let shown = missing.to_string();
            assert!(parts.iter().all(|part| shown.contains(part)), "{shown}");
        }
    }
}
