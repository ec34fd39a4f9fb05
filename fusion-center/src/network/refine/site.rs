//! The points of a group's nodes in flat arrays, and where each unknown stands.

use std::collections::BTreeMap;
use std::ops::Range;

use nalgebra::{Matrix2, Vector2};
use proto::geom::{Gaussian, Node};
use proto::ids::NodeId;
use proto::measured::line_of_sight;

use super::super::SiteProblem;
use super::super::relative::Pose;
use crate::statistics::spread;
use crate::usable::usable_cov_m2;

/// Targets walk this fast, metres per second, between the times of two nodes' sets of one period.
const WALK_M_PER_S: f64 = 1.0;

/// Offsets along the line of sight that are known to this, metres, are known.
const MIN_DEPTH_SIGMA_M: f64 = 1e-4;

/// A measured point in its node's frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct SitePoint {
    pub(super) node: usize,
    pub(super) mean: Vector2<f64>,
    pub(super) cov: Matrix2<f64>,
    /// Unit vector along the line of sight.
    pub(super) outward: Vector2<f64>,
}

impl SitePoint {
    fn usable(node: usize, point: &Gaussian<Node>) -> Option<Self> {
        let mean = point.mean.coords_m;
        let cov = usable_cov_m2(&mean, &point.cov_m2)?;
        Some(Self { node, mean, cov, outward: line_of_sight(&mean) })
    }
}

impl SitePoint {
    /// The point as seen when its target may have walked this far in any direction.
    fn later(self, walked_m: f64) -> Self {
        Self { cov: self.cov + Matrix2::identity() * walked_m.powi(2), ..self }
    }
}

/// The mean time of the named nodes' sets of each period, seconds.
fn middles_s(problem: &SiteProblem, names: &[&NodeId]) -> BTreeMap<i64, f64> {
    let mut sums: BTreeMap<i64, (f64, f64)> = BTreeMap::new();
    for view in names.iter().filter_map(|name| problem.views.get(*name)) {
        for (period, set) in &view.sets {
            let (sum, count) = sums.entry(*period).or_default();
            *sum += set.time_s;
            *count += 1.0;
        }
    }
    sums.into_iter().map(|(period, (sum, count))| (period, sum / count)).collect()
}

/// The points of all nodes, period by period.
#[derive(Clone, Debug)]
pub(super) struct Site {
    pub(super) names: Vec<NodeId>,
    pub(super) points: Vec<SitePoint>,
    /// Points by period, in order of periods that at least two nodes have points in.
    pub(super) periods: Vec<Range<usize>>,
    /// By node: points per period and m².
    pub(super) densities_per_m2: Vec<f64>,
    /// By node: deviation of the lasting offset, `None` where it is known.
    pub(super) depth_sigmas_m: Vec<Option<f64>>,
}

impl Site {
    /// The points of the named nodes.
    pub(super) fn new(problem: &SiteProblem, names: &[&NodeId]) -> Self {
        let middles_s = middles_s(problem, names);
        let mut by_period: BTreeMap<i64, Vec<SitePoint>> = BTreeMap::new();
        let mut depth_sigmas_m = Vec::new();
        for (node, name) in names.iter().enumerate() {
            let Some(view) = problem.views.get(*name) else {
                depth_sigmas_m.push(None);
                continue;
            };
            let sigma_m = view.half_depth_sigma_m;
            depth_sigmas_m.push((sigma_m > MIN_DEPTH_SIGMA_M).then_some(sigma_m));
            for (period, set) in &view.sets {
                let walked_m = WALK_M_PER_S * (set.time_s - middles_s[period]).abs();
                let usable = set.points.iter().filter_map(|point| SitePoint::usable(node, point));
                let moving = usable.map(|point| point.later(walked_m));
                by_period.entry(*period).or_default().extend(moving);
            }
        }
        let (mut points, mut periods) = (Vec::new(), Vec::new());
        for set in by_period.into_values() {
            let is_shared = set.iter().any(|point| point.node != set[0].node);
            if is_shared {
                periods.push(points.len()..points.len() + set.len());
                points.extend(set);
            }
        }
        let names: Vec<NodeId> = names.iter().map(|name| (*name).clone()).collect();
        let densities_per_m2 = densities(names.len(), &points, periods.len());
        Self { names, points, periods, densities_per_m2, depth_sigmas_m }
    }

    pub(super) fn node_count(&self) -> usize {
        self.names.len()
    }
}

fn densities(node_count: usize, points: &[SitePoint], period_count: usize) -> Vec<f64> {
    let density = |node: usize| {
        let own = points.iter().filter(move |point| point.node == node).map(|point| point.mean);
        let count = own.clone().count();
        // A node without points has no area; nothing asks for its density.
        let area_m2 = if count > 0 { spread(own).covered_area_m2() } else { 1.0 };
        count.max(1) as f64 / (period_count.max(1) as f64 * area_m2)
    };
    (0..node_count).map(density).collect()
}

/// The unknowns' current values.
#[derive(Clone, Debug)]
pub(super) struct State {
    /// In the gauge's frame.
    pub(super) poses: Vec<Pose>,
    /// Offsets along the line of sight.
    pub(super) depths_m: Vec<f64>,
}

/// Where the unknowns of each node stand among all.
#[derive(Clone, Debug)]
pub(super) struct Layout {
    starts: Vec<usize>,
    has_depth: Vec<bool>,
    pub(super) size: usize,
}

impl Layout {
    /// Node by node: pose (not of node 0), then offset where it is unknown.
    pub(super) fn new(site: &Site) -> Self {
        let has_depth: Vec<bool> = site.depth_sigmas_m.iter().map(Option::is_some).collect();
        let mut size = 0;
        let mut starts = Vec::with_capacity(has_depth.len());
        for (node, has) in has_depth.iter().enumerate() {
            starts.push(size);
            size += if node == 0 { 0 } else { 3 } + usize::from(*has);
        }
        Self { starts, has_depth, size }
    }

    pub(super) fn pose_start(&self, node: usize) -> Option<usize> {
        (node != 0).then(|| self.starts[node])
    }

    pub(super) fn depth_index(&self, node: usize) -> Option<usize> {
        let after_pose = self.starts[node] + if node == 0 { 0 } else { 3 };
        self.has_depth[node].then_some(after_pose)
    }

    /// Which unknown of all the `local`-th of `(x, y, heading, offset)` of a node is.
    pub(super) fn index(&self, node: usize, local: usize) -> Option<usize> {
        if local < 3 {
            self.pose_start(node).map(|start| start + local)
        } else {
            self.depth_index(node)
        }
    }
}
