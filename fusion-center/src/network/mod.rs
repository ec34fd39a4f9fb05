//! Many nodes: from pairs of nodes that see the same targets to the poses of all.
//!
//! ```text
//! SiteProblem ── every pair with common periods ── Solver ── edges ── combine ── refine ── groups
//! ```
//! An [`Edge`] is one solved pair. [`combine`] turns edges into groups of nodes with poses in the
//! frame of each group's gauge; nodes out of the reference's sight come in through others.

use std::collections::BTreeMap;

use nalgebra::Matrix3;
use proto::geom::{Gaussian, Node, Point, Ref, Se2};
use proto::ids::NodeId;

use crate::registration::{Outcome, Period, PoseEstimate, Problem, Solution, Solver};

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
    /// The pose in the frame of the group's gauge.
    pub estimate: PoseEstimate,
    /// The nodes through which the pose came, the gauge first, this node last.
    pub via: Vec<NodeId>,
}

/// Nodes whose poses hang together.
#[derive(Clone, Debug, PartialEq)]
pub struct Group {
    /// The node whose frame the poses are in: the reference where it belongs to the group, else
    /// the first by name.
    pub gauge: NodeId,
    /// Every node of the group, the gauge with the identity.
    pub nodes: BTreeMap<NodeId, Placed>,
}

/// The poses of all nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct SiteSolution {
    /// Groups, that of the reference first. A node without any determined edge is a group of its
    /// own.
    pub groups: Vec<Group>,
    /// Every pair that was tried.
    pub edges: Vec<Edge>,
}

impl SiteProblem {
    /// The problem of a pair: `second` in the frame of `first`, over their common periods.
    #[must_use]
    pub fn pair(&self, first: &NodeId, second: &NodeId) -> Problem {
        let (Some(one), Some(other)) = (self.views.get(first), self.views.get(second)) else {
            return Problem::default();
        };
        let common =
            one.sets.iter().filter_map(|(period, set)| Some((set, other.sets.get(period)?)));
        // The first node's own frame is `Ref`: only the name of the frame changes.
        let renamed = |point: &Gaussian<Node>| Gaussian::<Ref> {
            mean: Point::from_coords(point.mean.coords_m),
            cov_m2: point.cov_m2,
        };
        let period = |(in_first, in_second): (&SeenSet, &SeenSet)| Period {
            ref_time_s: in_first.time_s,
            node_time_s: in_second.time_s,
            in_ref: in_first.points.iter().map(renamed).collect(),
            in_node: in_second.points.clone(),
        };
        Problem {
            periods: common.map(period).collect(),
            ref_half_depth_sigma_m: one.half_depth_sigma_m,
            node_half_depth_sigma_m: other.half_depth_sigma_m,
        }
    }
}

/// Solves every pair of nodes with common periods and combines the poses.
#[must_use]
pub fn solve_site(problem: &SiteProblem, solver: &dyn Solver) -> SiteSolution {
    let mut edges = Vec::new();
    for (index, first) in problem.views.keys().enumerate() {
        for second in problem.views.keys().skip(index + 1) {
            let pair = problem.pair(first, second);
            if !pair.periods.is_empty() {
                let solution = solver.solve(&pair, None);
                edges.push(Edge { first: first.clone(), second: second.clone(), solution });
            }
        }
    }
    let nodes: Vec<NodeId> = problem.views.keys().cloned().collect();
    let groups = combine(&problem.reference, &nodes, &edges);
    SiteSolution { groups, edges }
}

/// The groups that the determined edges join.
#[must_use]
pub fn combine(reference: &NodeId, nodes: &[NodeId], edges: &[Edge]) -> Vec<Group> {
    let mut left: Vec<NodeId> = nodes.to_vec();
    left.sort_by_key(|node| (node != reference, node.clone()));
    let mut groups = Vec::new();
    while !left.is_empty() {
        let gauge = left.remove(0);
        let identity =
            PoseEstimate { pose_ref_from_node: Se2::identity(), covariance: Matrix3::zeros() };
        let mut group = Group { gauge: gauge.clone(), nodes: BTreeMap::new() };
        group.nodes.insert(gauge.clone(), Placed { estimate: identity, via: vec![gauge] });
        while let Some((node, placed)) = next_neighbour(&group, edges) {
            left.retain(|other| *other != node);
            group.nodes.insert(node, placed);
        }
        groups.push(group);
    }
    groups
}

fn next_neighbour(group: &Group, edges: &[Edge]) -> Option<(NodeId, Placed)> {
    edges.iter().filter(|edge| edge.solution.outcome == Outcome::Determined).find_map(|edge| {
        let placed = group.nodes.get(&edge.first)?;
        let estimate =
            edge.solution.estimate.filter(|_| !group.nodes.contains_key(&edge.second))?;
        let second = edge.second.clone();
        let via = [&placed.via[..], std::slice::from_ref(&second)].concat();
        let pose = placed.estimate.pose_ref_from_node;
        // `Node` of the first is the frame that the edge calls `Ref`.
        let step = Se2::<Node, Node>::new(
            estimate.pose_ref_from_node.translation_m().x,
            estimate.pose_ref_from_node.translation_m().y,
            estimate.pose_ref_from_node.heading_rad(),
        );
        let pose_ref_from_node = pose * step;
        let estimate = PoseEstimate { pose_ref_from_node, covariance: estimate.covariance };
        Some((second, Placed { estimate, via }))
    })
}
