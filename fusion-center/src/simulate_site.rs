//! Simulated sites at the level of points: many nodes, each seeing the targets within its reach,
//! with the truth and the Cramér-Rao bound of all poses together.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use nalgebra::{DMatrix, Matrix2, Vector2, Vector3};
use proto::geom::{Gaussian, Node, Point, Se2, World, point_by_pose};
use proto::ids::{InvalidName, NodeId};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;

use crate::network::{NodeView, SeenSet, SiteProblem};
use crate::registration::PoseEstimate;
use crate::simulate::{Conditions, Paths};

/// How a site is drawn, beside the [`Conditions`] of the measurements.
#[derive(Clone, Copy, Debug)]
pub struct SiteConditions {
    /// Noise, misses and false points, as for two nodes.
    pub measuring: Conditions,
    /// How far a node sees, metres.
    pub reach_m: f64,
    /// Standard deviation of each node's offset along the line of sight, metres; the views state
    /// it.
    pub half_depth_sigma_m: f64,
}

/// A site, its truth, and what the true associations hold about it.
pub struct SiteTrial {
    /// What the solver gets. Nodes are called `n000`, `n001`, ...; the first is the reference.
    pub problem: SiteProblem,
    /// By node: its pose in the world.
    pub world_from_node: BTreeMap<NodeId, Se2<World, Node>>,
    /// Information of the true associations about all nodes' `(x_m, y_m, heading_rad)` in the
    /// frame of the reference, three rows per node in order of names, that of the reference too.
    pub information: DMatrix<f64>,
}

/// The name of a node by its number.
///
/// # Errors
/// Never for numbers that fit a name.
pub fn node_name(index: usize) -> Result<NodeId, InvalidName> {
    format!("n{index:03}").parse()
}

impl SiteTrial {
    /// `node` as seen from `gauge`, `(x_m, y_m, heading_rad)`.
    #[must_use]
    pub fn truth(&self, gauge: &NodeId, node: &NodeId) -> Option<Vector3<f64>> {
        let pose = self.world_from_node.get(gauge)?.inverse() * *self.world_from_node.get(node)?;
        Some(pose.numbers())
    }

    /// Estimate less truth in the frame of `gauge`.
    #[must_use]
    pub fn error(
        &self,
        gauge: &NodeId,
        node: &NodeId,
        estimate: &PoseEstimate,
    ) -> Option<Vector3<f64>> {
        let truth = Se2::from_numbers(&self.truth(gauge, node)?);
        Some(estimate.pose_ref_from_node.minus(&truth))
    }

    /// Trace of the bound's position covariance by node, m², in the frame of the reference; `None`
    /// where the true associations leave a node undetermined.
    #[must_use]
    pub fn position_bounds_m2(&self) -> Option<Vec<f64>> {
        let size = self.information.nrows() - 3;
        let inner = self.information.view((3, 3), (size, size)).into_owned();
        let covariance = inner.cholesky()?.inverse();
        let trace = |node: usize| {
            covariance[(3 * node, 3 * node)] + covariance[(3 * node + 1, 3 * node + 1)]
        };
        Some((0..size / 3).map(trace).collect())
    }
}

/// Draws what nodes at given poses see of given targets.
pub struct SiteSampler {
    /// Where everything random comes from.
    pub rng: ChaCha8Rng,
    nodes: Vec<Se2<World, Node>>,
    offsets_m: Vec<f64>,
    conditions: SiteConditions,
}

/// One node's point of a target, with the node's number.
type Seen = (usize, Gaussian<Node>);

impl SiteSampler {
    /// Nodes at `positions_m` in the world, each turned at random.
    #[must_use]
    pub fn new(seed: u64, positions_m: &[[f64; 2]], conditions: SiteConditions) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let nodes =
            positions_m.iter().map(|[x, y]| Se2::new(*x, *y, rng.random_range(-PI..PI))).collect();
        let offsets_m = positions_m
            .iter()
            .map(|_| conditions.half_depth_sigma_m * rng.sample::<f64, _>(StandardNormal))
            .collect();
        Self { rng, nodes, offsets_m, conditions }
    }

    fn normal(&mut self) -> f64 {
        self.rng.sample(StandardNormal)
    }

    /// A point of what stands at `target_m` in the world.
    fn measure(&mut self, node: usize, target_m: &Vector2<f64>) -> Gaussian<Node> {
        let scale = self.conditions.measuring.noise_scale;
        let at = self.nodes[node].inverse() * Point::<World>::from_coords(*target_m);
        let range_sigma = scale * self.rng.random_range(0.02..0.04);
        let per_range = scale * self.rng.random_range(0.01..0.02);
        let range_m = at.coords_m.norm();
        let along = at.coords_m / range_m.max(1e-9);
        let across = Vector2::new(-along.y, along.x);
        let noise = along * (range_sigma * self.normal() - self.offsets_m[node])
            + across * (per_range * range_m.max(0.5) * self.normal());
        let mean = Point::from_coords(at.coords_m + noise);
        let seen = mean.coords_m / mean.coords_m.norm();
        let turn = Matrix2::new(seen.x, -seen.y, seen.y, seen.x);
        let cross_sigma = per_range * mean.coords_m.norm().max(0.5);
        let variances = Vector2::new(range_sigma, cross_sigma).map(|sigma| sigma * sigma);
        Gaussian { mean, cov_m2: turn * Matrix2::from_diagonal(&variances) * turn.transpose() }
    }

    fn distance_m(&self, node: usize, target_m: &Vector2<f64>) -> f64 {
        (self.nodes[node].translation_m() - target_m).norm()
    }

    fn seen(&mut self, target_m: &Vector2<f64>) -> Vec<Seen> {
        let conditions = self.conditions;
        let mut seen = Vec::new();
        for node in 0..self.nodes.len() {
            let is_near = self.distance_m(node, target_m) < conditions.reach_m;
            let is_lucky = self.rng.random::<f64>() < conditions.measuring.detection_probability;
            if is_near && is_lucky {
                seen.push((node, self.measure(node, target_m)));
            }
        }
        seen
    }

    fn false_point(&mut self, node: usize) -> Option<Gaussian<Node>> {
        if self.rng.random::<f64>() >= self.conditions.measuring.false_probability {
            return None;
        }
        let reach_m = self.conditions.reach_m;
        let range_m = reach_m * self.rng.random::<f64>().sqrt();
        let bearing = self.rng.random_range(-PI..PI);
        let offset = Vector2::new(bearing.cos(), bearing.sin()) * range_m;
        let place = self.nodes[node].translation_m() + offset;
        Some(self.measure(node, &place))
    }

    /// One trial over the given paths.
    ///
    /// # Errors
    /// If there are more nodes than names.
    pub fn observe(mut self, paths: &Paths) -> Result<SiteTrial, InvalidName> {
        let count = self.nodes.len();
        let names: Result<Vec<NodeId>, InvalidName> = (0..count).map(node_name).collect();
        let names = names?;
        let mut views = vec![
            NodeView {
                half_depth_sigma_m: self.conditions.half_depth_sigma_m,
                ..NodeView::default()
            };
            count
        ];
        let mut information = DMatrix::zeros(3 * count, 3 * count);
        for (period, targets) in (0_i64..).zip(paths) {
            let time_s = self.conditions.measuring.period_s * period as f64;
            let mut sets = vec![SeenSet { time_s, points: Vec::new() }; count];
            for target in targets {
                let seen = self.seen(target);
                self.inform(&mut information, &seen);
                seen.into_iter().for_each(|(node, point)| sets[node].points.push(point));
            }
            for (node, mut set) in sets.into_iter().enumerate() {
                set.points.extend(self.false_point(node));
                views[node].sets.insert(period, set);
            }
        }
        let world_from_node = names.iter().cloned().zip(self.nodes).collect();
        let reference = names[0].clone();
        let views = names.into_iter().zip(views).collect();
        Ok(SiteTrial { problem: SiteProblem { reference, views }, world_from_node, information })
    }

    /// `Σ Jᵢᵀ Wᵢ Jᵢ − (Σ Jᵢᵀ Wᵢ)(Σ Wᵢ)⁻¹(Σ Wᵢ Jᵢ)` over the points of one target.
    fn inform(&self, information: &mut DMatrix<f64>, seen: &[Seen]) {
        let ref_from_world = self.nodes[0].inverse();
        let terms = seen.iter().map(|(node, point)| {
            let pose = ref_from_world * self.nodes[*node];
            let turned = pose.rotation() * point.mean.coords_m;
            let weight = (pose.rotation() * point.cov_m2 * pose.rotation().transpose())
                .try_inverse()
                .unwrap_or_default();
            let jacobian = point_by_pose(&turned);
            (3 * node, jacobian, weight)
        });
        let terms: Vec<_> = terms.collect();
        let total: Matrix2<f64> = terms.iter().map(|term| term.2).sum();
        let shared = total.try_inverse().unwrap_or_default();
        for (row, left, left_weight) in &terms {
            let mut own = information.view_mut((*row, *row), (3, 3));
            own += left.transpose() * left_weight * left;
            for (column, right, right_weight) in &terms {
                let weight = left_weight * shared * right_weight;
                let mut view = information.view_mut((*row, *column), (3, 3));
                view -= left.transpose() * weight * right;
            }
        }
    }
}
