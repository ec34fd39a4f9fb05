//! Many nodes: from pairs of nodes that see the same targets to the poses of all.
//!
//! ```text
//! SiteProblem ── every pair with common periods ── Solver ── edges ── combine ── refine ── groups
//! ```
//! An [`Edge`] is one solved pair. [`combine`] turns edges into groups of nodes with poses in the
//! frame of each group's gauge; nodes out of the reference's sight come in through others.

use std::collections::BTreeMap;

use proto::geom::{Gaussian, Node, Ref, Se2};
use proto::ids::NodeId;

use crate::registration::{PoseEstimate, Problem, Seen, Solution, Solver};

mod adjust;
mod combine;
mod dense;
#[cfg(test)]
mod drawn_edges;
mod graph;
mod open;
mod pairs;
mod refine;
mod relative;
#[cfg(test)]
mod site_cases;

pub use open::{AGREEMENT_LOG_ODDS, combine_judged};
pub use refine::refine;
pub use relative::inverse;

/// What one node saw in one period.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SeenSet {
    /// When, seconds by the clock that all nodes share.
    pub time_s: f64,
    /// The targets' middles in the node's frame.
    pub points: Vec<Gaussian<Node>>,
}

/// What one node saw.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NodeView {
    /// See [`Problem::node_half_depth_sigma_m`].
    pub half_depth_sigma_m: f64,
    /// By period.
    pub sets: BTreeMap<i64, SeenSet>,
}

impl NodeView {
    fn seen<'a>(&self, set: &'a SeenSet) -> Seen<impl Iterator<Item = Gaussian<Node>> + use<'a>> {
        let half_depth_sigma_m = self.half_depth_sigma_m;
        Seen { time_s: set.time_s, half_depth_sigma_m, points: set.points.iter().copied() }
    }
}

/// What is to be registered: the views of all nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct SiteProblem {
    /// The node whose frame is the common frame.
    pub reference: NodeId,
    /// Every node's view, the reference's too.
    pub views: BTreeMap<NodeId, NodeView>,
}

/// One solved pair of nodes. In its solution `Ref` is the frame of the first, `Node` that of the
/// second.
#[derive(Clone, Debug, PartialEq)]
pub struct Edge {
    /// The first node.
    pub first: NodeId,
    /// The second node.
    pub second: NodeId,
    /// The second's pose in the first's frame.
    pub solution: Solution,
}

/// One node's place in its group.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// The pose in the frame of the group's gauge, with its marginal covariance.
    pub estimate: PoseEstimate,
    /// The nodes through which the pose came by the fewest edges, the gauge first, this node last.
    pub via: Vec<NodeId>,
    /// What speaks for the place.
    pub standing: Standing,
}

/// What speaks for a node's place.
#[derive(Clone, Debug, PartialEq)]
pub enum Standing {
    /// The group's frame is this node's.
    Gauge,
    /// Loops of edges agree: no single edge carries the place.
    Confirmed {
        /// Edges across the weakest cut between the gauge and this node, at least two.
        way_count: usize,
    },
    /// At least one edge on the way to the gauge is in no loop. It is determined, but were it
    /// wrong, nothing would tell.
    Unconfirmed,
    /// As many edges speak for other places. Only found in [`Group::doubtful`].
    Undecided {
        /// The other poses, in the frame of the group's gauge.
        rivals: Vec<Se2<Ref, Node>>,
    },
    /// No other node's place is known in this one's frame.
    Alone {
        /// Edges of this node without a usable pose.
        unusable_count: usize,
        /// Edges of this node that others contradict.
        contradicted_count: usize,
    },
}

/// Nodes whose poses hang together.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// The node whose frame the poses are in: the reference where it belongs to the group, else
    /// the first by name.
    pub gauge: NodeId,
    /// Every node of the group, the gauge with the identity. All places are determined.
    pub nodes: BTreeMap<NodeId, Placed>,
    /// Nodes of other groups that edges join to this one without deciding where they are: the
    /// likeliest pose, [`Standing::Undecided`]. For display, never for use.
    pub doubtful: BTreeMap<NodeId, Placed>,
    /// What [`refine`] did.
    pub refinement: Refinement,
}

/// What the joint refinement of a group did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Refinement {
    /// Poses and covariances are those of the edges.
    Untried,
    /// Poses and covariances are those of the measured points of all nodes together.
    Joint {
        /// Points that met points of other nodes, expected number.
        matched_count: f64,
        /// Sum of squared residuals in units of their variance.
        chi_square: f64,
        /// Its expectation.
        degrees_of_freedom: f64,
        /// The largest factor by which a covariance was widened because residuals contradict the
        /// stated ones or last longer than a period; 1 where they agree.
        covariance_inflation: f64,
    },
    /// It was tried, and the poses of the edges were kept.
    Refused {
        /// What spoke against it.
        reason: RefusedRefinement,
    },
}

/// Why poses from the joint refinement are not used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RefusedRefinement {
    /// The points that meet do not determine all nodes.
    Undetermined,
    /// The points are less likely under the refined poses than under those of the edges.
    Unlikelier {
        /// Logarithm of the likelihood of the edges' poses less that of the refined ones.
        log_loss: f64,
    },
    /// The points would tell less than the edges, which know the targets' motion too.
    Vaguer {
        /// Mean growth of the logarithm of the covariances' determinants.
        log_growth: f64,
    },
    /// A node moved farther than the edges allow.
    Moved {
        /// Squared distance in units of the edges' covariance.
        chi_square: f64,
    },
}

/// What became of an edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// It has no usable pose, or one of its nodes is unknown.
    Unusable,
    /// It carries the poses.
    Kept {
        /// Which of its rivals turned out right; `None` for its own estimate.
        rival_index: Option<usize>,
        /// Squared distance from what all other edges say, 3 expected; `None` where they say
        /// nothing.
        loop_chi_square: Option<f64>,
    },
    /// Others contradict it.
    Rejected {
        /// Squared distance from what the others say.
        loop_chi_square: f64,
        /// Edges across the weakest cut between its nodes.
        against_count: usize,
    },
    /// As many edges contradict it as agree with it, or it is ambiguous and no other decides.
    Undecided,
}

/// Groups, and what became of every edge.
#[derive(Clone, Debug, PartialEq)]
pub struct Combined {
    /// Groups, that of the reference first.
    pub groups: Vec<Group>,
    /// By edge.
    pub verdicts: Vec<Verdict>,
}

/// The poses of all nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct SiteSolution {
    /// Groups, that of the reference first. A node without any determined edge is a group of its
    /// own.
    pub groups: Vec<Group>,
    /// Every pair that was solved.
    pub edges: Vec<Edge>,
    /// What became of every edge.
    pub verdicts: Vec<Verdict>,
}

impl SiteProblem {
    /// The problem of a pair: `second` in the frame of `first`, over their common periods.
    #[must_use]
    pub fn pair(&self, first: &NodeId, second: &NodeId) -> Problem {
        let (Some(one), Some(other)) = (self.views.get(first), self.views.get(second)) else {
            return Problem::default();
        };
        let common = one
            .sets
            .iter()
            .filter_map(|(period, set)| Some((one.seen(set), other.seen(other.sets.get(period)?))));
        Problem::of_nodes(common)
    }
}

/// The groups that the edges join, that of the reference first. Each node is in exactly one.
#[must_use]
pub fn combine(reference: &NodeId, nodes: &[NodeId], edges: &[Edge]) -> Vec<Group> {
    combine_judged(reference, nodes, edges).groups
}

/// Most by which variances may fall below those of the solved edges together: all points together
/// tell more than pairs do by themselves, but errors that last, which pairs are searched for, do not
/// average out among nodes.
const MAX_GAIN: f64 = 2.0;

/// Each group of more than two nodes refined from its points, where these are points; a pair's own
/// solution knows more of two nodes. Of people, whose half depth is uncertain, the refinement is
/// left out: it takes the errors of each period as independent, and theirs last. In the `office`
/// scenario it made the error 0.090 m and the mean squared normalised error 4.9, where the edges had
/// 0.080 m and 3.1 (8 seeds).
#[must_use]
pub fn refined(problem: &SiteProblem, groups: Vec<Group>) -> Vec<Group> {
    let are_points = problem.views.values().all(|view| view.half_depth_sigma_m <= 0.0);
    let of_points = |group: Group| {
        let is_worth = are_points && group.nodes.len() > 2;
        if is_worth { sober(&group, refine(problem, &group)) } else { group }
    };
    groups.into_iter().map(of_points).collect()
}

/// `after` with no covariance much smaller than `before`.
fn sober(before: &Group, mut after: Group) -> Group {
    for (name, placed) in &mut after.nodes {
        let covariance = &mut placed.estimate.covariance;
        let of_edges = before.nodes[name].estimate.covariance.determinant();
        let ratio = of_edges / covariance.determinant();
        *covariance *= if ratio.is_finite() { (ratio.cbrt() / MAX_GAIN).max(1.0) } else { 1.0 };
    }
    after
}

/// Solves every pair of nodes that may share targets, combines the poses, and refines the groups. The same problem gives the same bytes, whatever the number of threads.
#[must_use]
pub fn solve_site(problem: &SiteProblem, solver: &dyn Solver) -> SiteSolution {
    let edges = pairs::solve_pairs(problem, solver);
    let nodes: Vec<NodeId> = problem.views.keys().cloned().collect();
    let Combined { groups, verdicts } = combine_judged(&problem.reference, &nodes, &edges);
    let groups = refined(problem, groups);
    SiteSolution { groups, edges, verdicts }
}
