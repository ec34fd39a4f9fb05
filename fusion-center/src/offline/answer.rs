//! The answer to one problem, as JSON and as rows of a table.

use std::collections::BTreeMap;

use nalgebra::Matrix3;
use proto::geom::{Node, Ref, Se2};
use proto::ids::NodeId;
use serde::Serialize;

use super::{Asked, ClockJson};
use crate::network::{Edge, Group, Placed, SiteProblem, SiteSolution, Standing, inverse};
use crate::registration::{Evidence, Outcome, PoseEstimate, Rival, Solution};

/// The answer to one problem.
#[derive(Clone, Debug, Serialize)]
pub struct Answer {
    /// As the problem gave it.
    pub id: serde_json::Value,
    /// The node whose frame the poses are in.
    pub reference: NodeId,
    /// Every other node.
    pub nodes: BTreeMap<NodeId, NodeAnswer>,
    /// What was assumed.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// Time of all pairs of nodes together, microseconds.
    pub solve_us: f64,
}

/// What is known of one node.
#[derive(Clone, Debug, Serialize)]
pub struct NodeAnswer {
    /// The pose; of an ambiguous node the likeliest.
    pub pose_ref_from_node: Option<PoseJson>,
    /// Of the errors `(x_m, y_m, heading_rad)` in the reference's frame.
    pub covariance: Option<[[f64; 3]; 3]>,
    /// `determined`, `ambiguous` or `underdetermined`.
    pub outcome: &'static str,
    /// What the data lack, of an undetermined node.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub missing: Option<String>,
    /// The other poses that the data allow, of an ambiguous node.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub rivals: Vec<RivalJson>,
    /// Of a determined node: `confirmed` by loops of pairs, or `unconfirmed`, resting on single
    /// pairs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub standing: Option<&'static str>,
    /// The nodes through which the pose came, the reference first.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub via: Vec<NodeId>,
    /// The node's place among others, where none of them hangs together with the reference.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub group: Option<GroupJson>,
    /// The numbers behind the pair of this node with the last of `via` before it, or with the
    /// reference.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub evidence: Option<EvidenceJson>,
    /// The clocks of the same two nodes, where they seem to differ.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clock: Option<ClockJson>,
    /// Time of all pairs of nodes together, microseconds.
    pub solve_us: f64,
}

/// A pose.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PoseJson {
    /// Metres.
    pub x_m: f64,
    /// Metres.
    pub y_m: f64,
    /// Radians, counter-clockwise.
    pub heading_rad: f64,
}

/// Another pose that the data allow.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct RivalJson {
    /// The pose.
    pub pose_ref_from_node: PoseJson,
    /// Natural logarithm of the best pose's odds against this one; `None` where pairs of nodes
    /// disagree, and not the points of one.
    pub log_odds: Option<f64>,
}

/// A node's place in a group without the reference.
#[derive(Clone, Debug, Serialize)]
pub struct GroupJson {
    /// The node whose frame the group's poses are in.
    pub gauge: NodeId,
    /// Everybody in it.
    pub members: Vec<NodeId>,
    /// The pose in the gauge's frame.
    pub pose_gauge_from_node: PoseJson,
    /// Of the errors `(x_m, y_m, heading_rad)` in the gauge's frame.
    pub covariance: [[f64; 3]; 3],
}

/// See [`Evidence`].
#[derive(Clone, Debug, Serialize)]
pub struct EvidenceJson {
    matched_point_count: usize,
    distinct_point_count: usize,
    period_count: usize,
    chi_square: f64,
    degrees_of_freedom: f64,
    covariance_inflation: f64,
    log_odds: f64,
    rival_log_odds: Option<f64>,
    certified_rival_share: Option<f64>,
    /// Why nothing is proven.
    uncertified: Option<String>,
}

impl From<Se2<Ref, Node>> for PoseJson {
    fn from(pose: Se2<Ref, Node>) -> Self {
        let at = pose.translation_m();
        Self { x_m: at.x, y_m: at.y, heading_rad: pose.heading_rad() }
    }
}

impl From<Evidence> for EvidenceJson {
    fn from(evidence: Evidence) -> Self {
        Self {
            matched_point_count: evidence.matched_point_count,
            distinct_point_count: evidence.distinct_point_count,
            period_count: evidence.period_count,
            chi_square: evidence.chi_square,
            degrees_of_freedom: evidence.degrees_of_freedom,
            covariance_inflation: evidence.covariance_inflation,
            log_odds: evidence.log_odds,
            rival_log_odds: evidence.rival_log_odds,
            certified_rival_share: evidence.certificate.rival_share(),
            uncertified: evidence.certificate.reason().map(|reason| reason.to_string()),
        }
    }
}

impl Answer {
    /// The answer that `solution` holds.
    #[must_use]
    pub fn new(asked: Asked, solution: &SiteSolution, solve_us: f64) -> Self {
        let Asked { id, problem, mut warnings } = asked;
        let others = problem.views.keys().filter(|node| **node != problem.reference);
        let answer = |node: &NodeId| {
            let found = of_node(&problem, node, solution);
            (node.clone(), NodeAnswer { solve_us, ..found })
        };
        let nodes: BTreeMap<NodeId, NodeAnswer> = others.map(answer).collect();
        let clocks = nodes.iter().filter_map(|(node, found)| Some((node, found.clock.as_ref()?)));
        warnings.extend(clocks.flat_map(|(node, clock)| clock.warnings(node)));
        Self { id, reference: problem.reference, nodes, warnings, solve_us }
    }

    /// Logs what was assumed.
    pub(super) fn warn(&self) {
        for warning in &self.warnings {
            tracing::warn!(id = %self.id, "{warning}");
        }
    }

    /// One row per node: problem, node, pose, standard deviations, matched points, outcome.
    #[must_use]
    pub fn rows(&self) -> Vec<Vec<String>> {
        self.nodes.iter().map(|(node, answer)| self.row(node, answer)).collect()
    }

    fn row(&self, node: &NodeId, answer: &NodeAnswer) -> Vec<String> {
        let pose = answer.pose_ref_from_node.map_or_else(
            || "none".to_owned(),
            |pose| format!("{:.3} {:.3} {:.2}°", pose.x_m, pose.y_m, pose.heading_rad.to_degrees()),
        );
        let sigmas = answer.covariance.map_or_else(String::new, |cov| {
            let sigma = |index: usize| cov[index][index].sqrt();
            format!("{:.3} {:.3} {:.2}°", sigma(0), sigma(1), sigma(2).to_degrees())
        });
        let matched = answer.evidence.as_ref().map_or(0, |evidence| evidence.matched_point_count);
        let mut outcome = answer.outcome.to_owned();
        let notes = answer.missing.iter().cloned().chain(answer.rivals.iter().map(|rival| {
            let PoseJson { x_m, y_m, heading_rad } = rival.pose_ref_from_node;
            let turn = heading_rad.to_degrees();
            let odds =
                rival.log_odds.map_or_else(String::new, |odds| format!(" (log odds {odds:.1})"));
            format!("or {x_m:.2} {y_m:.2} {turn:.1}°{odds}")
        }));
        for note in notes {
            outcome = format!("{outcome}: {note}");
        }
        let id = self.id.as_str().map_or_else(|| self.id.to_string(), ToOwned::to_owned);
        let id = id.escape_debug().to_string();
        vec![id, node.to_string(), pose, sigmas, matched.to_string(), outcome]
    }
}

fn of_node(problem: &SiteProblem, node: &NodeId, solution: &SiteSolution) -> NodeAnswer {
    let reference = &problem.reference;
    let group = solution.groups.iter().find(|group| group.nodes.contains_key(node));
    let placed = group.filter(|group| group.gauge == *reference).and_then(|g| g.nodes.get(node));
    let before = placed.and_then(|placed| placed.via.iter().rev().nth(1)).unwrap_or(reference);
    let edge = edge_between(solution, before, node);
    let evidence = edge.map(|edge| edge.solution.evidence.into());
    let open = NodeAnswer {
        pose_ref_from_node: None,
        covariance: None,
        outcome: "underdetermined",
        missing: None,
        rivals: Vec::new(),
        standing: None,
        via: Vec::new(),
        group: None,
        evidence,
        clock: edge.and_then(|edge| ClockJson::of(problem, before, edge)),
        solve_us: 0.0,
    };
    if let Some(placed) = placed {
        let standing = Some(match placed.standing {
            Standing::Confirmed { .. } => "confirmed",
            _ => "unconfirmed",
        });
        let via = placed.via.clone();
        return NodeAnswer { via, outcome: "determined", standing, ..open }.with(&placed.estimate);
    }
    let of_reference = solution.groups.iter().find(|one| one.gauge == *reference);
    let doubtful = of_reference.and_then(|one| one.doubtful.get(node));
    if let (Some(likeliest), None) = (doubtful, edge) {
        return open.doubtful(likeliest);
    }
    let group = group.filter(|group| 1 < group.nodes.len());
    NodeAnswer {
        group: group.and_then(|group| of_group(group, node)),
        ..open.undecided(edge, reference)
    }
}

impl NodeAnswer {
    fn with(self, estimate: &PoseEstimate) -> Self {
        Self {
            pose_ref_from_node: Some(estimate.pose_ref_from_node.into()),
            covariance: Some(rows_of(&estimate.covariance)),
            ..self
        }
    }

    /// A node whose pairs with others disagree about its place.
    fn doubtful(self, placed: &Placed) -> Self {
        let rival = |pose: &Se2<Ref, Node>| RivalJson {
            pose_ref_from_node: (*pose).into(),
            log_odds: None,
        };
        let rivals = match &placed.standing {
            Standing::Undecided { rivals } => rivals.iter().map(rival).collect(),
            _ => Vec::new(),
        };
        let via = placed.via.clone();
        Self { outcome: "ambiguous", rivals, via, ..self }.with(&placed.estimate)
    }

    /// The best that the pair with the reference tells.
    fn undecided(self, edge: Option<&Edge>, reference: &NodeId) -> Self {
        let Some(edge) = edge else {
            let missing = format!("no period in common with {reference}");
            return Self { missing: Some(missing), ..self };
        };
        let solution = seen_from(edge, reference);
        match &solution.outcome {
            Outcome::Underdetermined { missing } => {
                Self { missing: Some(missing.to_string()), ..self }
            }
            Outcome::Determined => {
                let missing = "contradicted by the other pairs of nodes".to_owned();
                Self { missing: Some(missing), ..self }
            }
            Outcome::Ambiguous { rivals } => {
                let rivals = rivals.iter().map(RivalJson::from).collect();
                let answer = Self { outcome: "ambiguous", rivals, ..self };
                match &solution.estimate {
                    Some(estimate) => answer.with(estimate),
                    None => answer,
                }
            }
        }
    }
}

impl From<&Rival> for RivalJson {
    fn from(rival: &Rival) -> Self {
        let log_odds = Some(rival.log_odds);
        Self { pose_ref_from_node: rival.pose_ref_from_node.into(), log_odds }
    }
}

/// The edge's solution with `first` as the first of the two nodes.
fn seen_from(edge: &Edge, first: &NodeId) -> Solution {
    let mut solution = edge.solution.clone();
    if edge.first == *first {
        return solution;
    }
    solution.estimate = solution.estimate.as_ref().map(inverse);
    if let Outcome::Ambiguous { rivals } = &mut solution.outcome {
        for rival in rivals {
            rival.pose_ref_from_node = rival.pose_ref_from_node.inverse().renamed();
        }
    }
    solution
}

fn of_group(group: &Group, node: &NodeId) -> Option<GroupJson> {
    let Placed { estimate, .. } = group.nodes.get(node)?;
    Some(GroupJson {
        gauge: group.gauge.clone(),
        members: group.nodes.keys().cloned().collect(),
        pose_gauge_from_node: estimate.pose_ref_from_node.into(),
        covariance: rows_of(&estimate.covariance),
    })
}

fn edge_between<'a>(solution: &'a SiteSolution, one: &NodeId, other: &NodeId) -> Option<&'a Edge> {
    let joins = |edge: &&Edge| {
        (edge.first == *one && edge.second == *other)
            || (edge.first == *other && edge.second == *one)
    };
    solution.edges.iter().find(joins)
}

fn rows_of(covariance: &Matrix3<f64>) -> [[f64; 3]; 3] {
    std::array::from_fn(|row| std::array::from_fn(|column| covariance[(row, column)]))
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    #[test]
    fn the_covariance_of_the_inverse_is_that_of_inverted_poses() {
        const STEP: f64 = 1e-6;
        let pose = Vector3::new(2.0, -1.0, 0.7);
        let inverted_at = |theta: &Vector3<f64>| {
            let given = Se2::<Ref, Node>::new(theta.x, theta.y, theta.z);
            let inverted: Se2<Ref, Node> = given.inverse().renamed();
            let at = inverted.translation_m();
            Vector3::new(at.x, at.y, inverted.heading_rad())
        };
        let mut jacobian = Matrix3::zeros();
        for axis in 0..3 {
            let mut step = Vector3::zeros();
            step[axis] = STEP;
            jacobian.set_column(
                axis,
                &((inverted_at(&(pose + step)) - inverted_at(&(pose - step))) / (2.0 * STEP)),
            );
        }
        let covariance = Matrix3::new(0.04, 0.01, 0.002, 0.01, 0.09, -0.003, 0.002, -0.003, 0.01);
        let estimate =
            PoseEstimate { pose_ref_from_node: Se2::new(pose.x, pose.y, pose.z), covariance };
        let found = inverse(&estimate);
        let expected = jacobian * covariance * jacobian.transpose();
        assert!((found.covariance - expected).amax() < 1e-8, "{} {expected}", found.covariance);
        let back = inverse(&found);
        assert!((back.covariance - covariance).amax() < 1e-12);
    }
}
