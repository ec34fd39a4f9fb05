//! Joint refinement: the poses of all nodes of a group from the measured points themselves.
//!
//! A target seen by several nodes in one period ties all of them together and counts once per
//! node. Unknown are the poses of all nodes but the gauge, each node's lasting offset along its
//! lines of sight (prior `N(0, σ²)`, the stated half-depth deviation), and the targets' places,
//! which are eliminated. Rounds alternate between association (see `association`) and one
//! Gauss-Newton step (see `equations`), first with widened covariances while the poses are coarse.
//!
//! Covariances are the inverse of the weighted information, times χ² per degree of freedom where
//! that is significantly above 1, or times the ratio of the scores of blocks of periods to what
//! independent errors give where errors last. A result that explains the points worse than the
//! edges' poses do, or that contradicts them, is not used.

use nalgebra::{Matrix3, Vector2, Vector3};
use proto::geom::squared_length;
use proto::ids::NodeId;

use super::dense::Symmetric;
use super::relative::Relative;
use super::{Group, Refinement, RefusedRefinement, SiteProblem, Standing};
use crate::statistics::{Ratio, SIGNIFICANT_SIGMAS};

mod association;
mod equations;
mod site;
#[cfg(test)]
mod tests;

use association::{Association, associate};
use equations::{Equations, node_ratios};
use site::{Layout, Site, State};

/// Rounds with widened covariances, and by how much: poses of edges err about as much as points.
const COARSE_ROUND_COUNT: usize = 2;
const COARSE_SCALE: f64 = 4.0;

/// Most rounds; a few suffice unless associations go to and fro.
const MAX_ROUND_COUNT: usize = 14;

/// A step whose mean square per unknown in units of the covariance is below this ends the rounds.
const CONVERGED: f64 = 1e-5;

/// Loss of log likelihood below which two results are equally good: the likelihood compared is
/// that of each point given the others, whose maximum lies near that of the joint one, not on it.
const MAX_LOG_LOSS: f64 = 1.0;

/// Squared distance in units of the edges' covariance that a node may move: 1e-5 of χ² with three
/// degrees of freedom. Beyond it one of the two is wrong, and the edges have been checked.
const MAX_MOVE_CHI_SQUARE: f64 = 25.9;

/// The group with poses and covariances from the points of all its nodes, or as it was.
#[must_use]
pub fn refine(problem: &SiteProblem, group: &Group) -> Group {
    let names: Vec<&NodeId> = std::iter::once(&group.gauge)
        .chain(group.nodes.keys().filter(|name| **name != group.gauge))
        .collect();
    if names.len() < 2 {
        return group.clone();
    }
    let site = Site::new(problem, &names);
    let start = State {
        poses: names
            .iter()
            .map(|name| group.nodes[*name].estimate.pose_ref_from_node.renamed())
            .collect(),
        depths_m: vec![0.0; names.len()],
    };
    let mut refined = group.clone();
    let outcome = fit(&site, &start).and_then(|fitted| accepted(&site, (&start, group), fitted));
    let fitted = match outcome {
        Ok(fitted) => fitted,
        Err(reason) => {
            refined.refinement = Refinement::Refused { reason };
            return refined;
        }
    };
    for (node, name) in names.iter().enumerate().skip(1) {
        if let Some(placed) = refined.nodes.get_mut(*name) {
            placed.estimate = fitted.placed(node).estimate();
        }
    }
    refined.refinement = fitted.summary();
    refined
}

/// Refined poses with their covariances.
struct Fitted {
    state: State,
    covariances: Vec<Matrix3<f64>>,
    inflations: Vec<f64>,
    association: Association,
    chi_square: f64,
    degrees_of_freedom: f64,
}

impl Fitted {
    fn placed(&self, node: usize) -> Relative {
        let covariance = self.covariances[node] * self.inflations[node];
        Relative { pose: self.state.poses[node], covariance }
    }

    fn summary(&self) -> Refinement {
        Refinement::Joint {
            matched_count: self.association.matched,
            chi_square: self.chi_square,
            degrees_of_freedom: self.degrees_of_freedom,
            covariance_inflation: self.inflations.iter().fold(1.0, |most, value| most.max(*value)),
        }
    }
}

fn fit(site: &Site, start: &State) -> Result<Fitted, RefusedRefinement> {
    let layout = Layout::new(site);
    let mut state = start.clone();
    let mut share = association::START_SHARE;
    for round in 0..MAX_ROUND_COUNT {
        let scale = if round < COARSE_ROUND_COUNT { COARSE_SCALE } else { 1.0 };
        let association = associate(site, &state, (scale, share));
        share = association.share;
        let equations = Equations::new((site, &layout), &state, &association);
        let step = equations.step().ok_or(RefusedRefinement::Undetermined)?;
        state = state.plus(&layout, &step.values);
        if round > COARSE_ROUND_COUNT && step.mean_square < CONVERGED {
            break;
        }
    }
    let association = associate(site, &state, (1.0, share));
    let equations = Equations::new((site, &layout), &state, &association);
    let (chi_square, degrees_of_freedom) = (equations.chi_square, equations.degrees_of_freedom);
    let ratio =
        Ratio::of_chi_square(chi_square, degrees_of_freedom).if_significant(SIGNIFICANT_SIGMAS);
    let lasting = node_ratios(site, &equations);
    let inverse = equations.inverse().ok_or(RefusedRefinement::Undetermined)?;
    let covariances =
        (0..site.node_count()).map(|node| pose_block(&inverse, layout.pose_start(node))).collect();
    let inflations = lasting.into_iter().map(|lasting| lasting.max(ratio)).collect();
    Ok(Fitted { state, covariances, inflations, association, chi_square, degrees_of_freedom })
}

fn pose_block(inverse: &Symmetric, start: Option<usize>) -> Matrix3<f64> {
    start.map_or_else(Matrix3::zeros, |start| {
        Matrix3::from_fn(|row, column| inverse.get(start + row, start + column))
    })
}

/// The fit, unless the poses of the edges are the better or the safer ones.
fn accepted(
    site: &Site,
    (start, group): (&State, &Group),
    fitted: Fitted,
) -> Result<Fitted, RefusedRefinement> {
    let share = fitted.association.share;
    let log_loss = associate(site, start, (1.0, share)).log_ratio - fitted.association.log_ratio;
    if log_loss.is_nan() || log_loss > MAX_LOG_LOSS {
        return Err(RefusedRefinement::Unlikelier { log_loss });
    }
    for (node, name) in site.names.iter().enumerate().skip(1) {
        let placed = &group.nodes[name];
        if placed.standing == Standing::Gauge {
            continue;
        }
        let off = fitted.state.poses[node].minus(&start.poses[node]);
        let chi_square = squared_length(&off, &placed.estimate.covariance).unwrap_or(f64::INFINITY);
        if chi_square > MAX_MOVE_CHI_SQUARE {
            return Err(RefusedRefinement::Moved { chi_square });
        }
    }
    let log_growth = log_growth(site, group, &fitted);
    if log_growth > 0.0 { Err(RefusedRefinement::Vaguer { log_growth }) } else { Ok(fitted) }
}

/// By how much the logarithm of the covariances' determinants grows, on average over the nodes.
fn log_growth(site: &Site, group: &Group, fitted: &Fitted) -> f64 {
    let of_node = |(node, name): (usize, &NodeId)| {
        let before = group.nodes[name].estimate.covariance.determinant();
        let after = fitted.placed(node).covariance.determinant();
        (after / before).ln()
    };
    let growth = site.names.iter().enumerate().skip(1).map(of_node);
    growth.sum::<f64>() / (site.names.len() - 1) as f64
}

impl State {
    /// The state with a step of all unknowns added.
    fn plus(&self, layout: &Layout, step: &[f64]) -> Self {
        let mut next = self.clone();
        for node in 0..self.poses.len() {
            if let Some(start) = layout.pose_start(node) {
                let change = Vector3::from_column_slice(&step[start..start + 3]);
                next.poses[node] = self.poses[node].plus(&change);
            }
            if let Some(index) = layout.depth_index(node) {
                next.depths_m[node] += step[index];
            }
        }
        next
    }

    /// The point moved out along its line of sight, before it is turned.
    fn middle(&self, node: usize, point: &site::SitePoint) -> Vector2<f64> {
        point.mean + point.outward * self.depths_m[node]
    }
}
