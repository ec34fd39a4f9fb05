//! Drawn graphs of edges with known truth, for tests.

use nalgebra::{Matrix3, Vector3};
use proto::geom::squared_length;
use proto::ids::NodeId;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;

use super::relative::{Pose, Relative};
use super::{Edge, Group};
use crate::registration::{Evidence, Known, Outcome, PoseEstimate, Rival, Solution};

pub(super) fn name(index: usize) -> NodeId {
    format!("n{index:03}").parse().unwrap()
}

pub(super) fn names(count: usize) -> Vec<NodeId> {
    (0..count).map(name).collect()
}

pub(super) fn solution(estimate: Option<PoseEstimate>, outcome: Outcome) -> Solution {
    Solution { estimate, outcome, evidence: Evidence::default(), known: Known::default() }
}

/// A site whose edges err independently.
pub(super) struct Draw {
    rng: ChaCha8Rng,
    pub(super) poses: Vec<Pose>,
}

impl Draw {
    pub(super) fn new(seed: u64, count: usize) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut pose = |index: usize| {
            let (row, column) = (index / 10, index % 10);
            let place = [column as f64 * 4.0, row as f64 * 4.0];
            Pose::new(place[0], place[1], rng.random_range(-3.0..3.0))
        };
        let poses: Vec<Pose> = (0..count).map(&mut pose).collect();
        let inverse = poses[0].inverse();
        let poses = poses.iter().map(|at| inverse * *at).collect();
        Self { rng, poses }
    }

    fn normal(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.rng.sample(StandardNormal))
    }

    /// An edge with an error drawn from its covariance, σ of 1 to 4 cm and 0.3 to 1°.
    pub(super) fn edge(&mut self, first: usize, second: usize) -> Edge {
        let truth = self.poses[first].inverse() * self.poses[second];
        let root = Matrix3::new(
            self.rng.random_range(0.01..0.04),
            0.0,
            0.0,
            self.rng.random_range(-0.02..0.02),
            self.rng.random_range(0.01..0.04),
            0.0,
            self.rng.random_range(-0.005..0.005),
            self.rng.random_range(-0.005..0.005),
            0.01,
        );
        let pose = truth.plus(&(root * self.normal()));
        let relative = Relative { pose, covariance: root * root.transpose() };
        let solution = solution(Some(relative.estimate()), Outcome::Determined);
        Edge { first: name(first), second: name(second), solution }
    }

    /// Moves an edge's pose anywhere with a confident covariance.
    pub(super) fn corrupt(&mut self, edge: &mut Edge) {
        let (x, y) = (self.rng.random_range(-10.0..10.0), self.rng.random_range(-10.0..10.0));
        let heading = self.rng.random_range(-3.1..3.1);
        set_pose(edge, Pose::new(x, y, heading), 1e-5);
    }

    pub(super) fn index(edge: &Edge) -> (usize, usize) {
        let of = |name: &NodeId| name.as_str()[1..].parse().unwrap();
        (of(&edge.first), of(&edge.second))
    }

    /// Turns edges by one and the same wrong motion of the node that they share.
    pub(super) fn corrupt_together(&self, edge: &mut Edge, node: usize, wrong: Pose) {
        let moved = self.poses[node] * wrong;
        let (first, second) = Self::index(edge);
        let at = |index: usize| if index == node { moved } else { self.poses[index] };
        set_pose(edge, at(first).inverse() * at(second), 1e-4);
    }

    pub(super) fn nees(&self, group: &Group, node: usize) -> f64 {
        let estimate = &group.nodes[&name(node)].estimate;
        let error = posed(estimate).minus(&self.poses[node]);
        squared_length(&error, &estimate.covariance).unwrap()
    }
}

pub(super) fn posed(estimate: &PoseEstimate) -> Pose {
    estimate.pose_ref_from_node.renamed()
}

fn set_pose(edge: &mut Edge, pose: Pose, variance: f64) {
    let covariance = Matrix3::identity() * variance;
    edge.solution.estimate = Some(Relative { pose, covariance }.estimate());
}

/// Neighbours of a grid of ten columns, with diagonals.
pub(super) fn grid_pairs(count: usize) -> Vec<(usize, usize)> {
    let is_near =
        |a: usize, b: usize| (a / 10).abs_diff(b / 10) < 2 && (a % 10).abs_diff(b % 10) < 2;
    let pairs = (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b)));
    pairs.filter(|(a, b)| is_near(*a, *b)).collect()
}

pub(super) fn all_pairs(count: usize) -> Vec<(usize, usize)> {
    (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b))).collect()
}

/// The edge with another pose, and which of the two is taken for the likelier.
pub(super) fn ambiguous(mut edge: Edge, (wrong, is_best_wrong): (Pose, bool)) -> Edge {
    let estimate = edge.solution.estimate.unwrap();
    let pose = posed(&estimate);
    let other = pose * wrong;
    let (best, rival) = if is_best_wrong { (other, pose) } else { (pose, other) };
    let covariance = estimate.covariance;
    let rival = Relative { pose: rival, covariance }.estimate().pose_ref_from_node;
    edge.solution.estimate = Some(Relative { pose: best, covariance }.estimate());
    let rivals = vec![Rival { pose_ref_from_node: rival, log_odds: 1.0 }];
    edge.solution.outcome = Outcome::Ambiguous { rivals };
    edge
}
