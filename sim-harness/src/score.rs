//! How good the result is: each node's estimated pose beside its true one.

use proto::geom::{Node, Ref, Se2};
use proto::ids::NodeId;
use proto::wire::{Evidence, LatencyReport, NodeState, Outcome, PoseRecord};
use serde::Serialize;

use crate::observe::Seen;
use crate::scenario::{NodePlan, Scenario};

/// Standard deviations of a pose.
#[derive(Clone, Copy, Debug, Serialize)]
pub(crate) struct Sigma {
    pub(crate) x_m: f64,
    pub(crate) y_m: f64,
    pub(crate) heading_deg: f64,
}

/// One node's result.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct NodeScore {
    pub(crate) node: NodeId,
    pub(crate) is_reference: bool,
    pub(crate) pose_ref_from_node: Option<PoseRecord>,
    pub(crate) truth: PoseRecord,
    pub(crate) position_error_m: Option<f64>,
    pub(crate) angle_error_deg: Option<f64>,
    pub(crate) sigma: Option<Sigma>,
    /// Squared pose error in units of its covariance; 3 on average if the covariance is true.
    pub(crate) normalised_error: Option<f64>,
    /// Epoch of the transform in force.
    pub(crate) epoch: Option<u64>,
    pub(crate) outcome: String,
    pub(crate) missing: Option<String>,
    /// Its process ended before the run did.
    pub(crate) was_lost: bool,
    pub(crate) within_bounds: bool,
    pub(crate) solve_ms: f64,
    pub(crate) periods_used: u32,
    pub(crate) matched_points: u32,
    pub(crate) evidence: Evidence,
    pub(crate) state: Option<String>,
    pub(crate) sets_sent: u64,
    pub(crate) sets_received: u64,
    pub(crate) sets_missing: u64,
    pub(crate) sets_dropped: u64,
    pub(crate) periods_skipped: u64,
    pub(crate) frames_refused: u64,
    pub(crate) messages_refused: u64,
    pub(crate) transform_latency: Option<LatencyReport>,
}

/// The score of one node.
pub(crate) fn score(scenario: &Scenario, node: &NodePlan, seen: &Seen) -> NodeScore {
    let truth = scenario.truth(node);
    let is_reference = node.id == scenario.reference;
    let registration = seen.registration.as_ref();
    let transform = registration.and_then(|registration| registration.transform);
    let pose: Option<Se2<Ref, Node>> = transform.map(|t| t.pose_ref_from_node.into());
    let errors = pose.map(|pose| errors(&pose, &truth));
    let bounds = scenario.bounds.of(&node.id);
    let is_near = |off: Errors| {
        let angle_deg = off.angle_rad.abs().to_degrees();
        off.position_m <= bounds.position_m && angle_deg <= bounds.angle_deg
    };
    // A pose that its own centre doubts, or of a node that it does not hear, is no result.
    let is_live = seen.line.as_ref().is_some_and(|line| line.state == NodeState::Live);
    let within_bounds =
        errors.is_none_or(is_near) && ((errors.is_some() && is_live) || bounds.is_optional);
    let evidence = registration.map_or_else(Evidence::default, |r| r.evidence);
    let covariance = transform.filter(|_| !is_reference).map(|t| t.covariance_matrix());
    let sigma = covariance.map(|matrix| Sigma {
        x_m: matrix[(0, 0)].sqrt(),
        y_m: matrix[(1, 1)].sqrt(),
        heading_deg: matrix[(2, 2)].sqrt().to_degrees(),
    });
    let (outcome, missing) = outcome(registration.map(|registration| &registration.outcome));
    let (status, line) = (seen.status.as_ref(), seen.line.as_ref());
    NodeScore {
        node: node.id.clone(),
        is_reference,
        pose_ref_from_node: pose.map(PoseRecord::from),
        truth: truth.into(),
        position_error_m: errors.map(|errors| errors.position_m),
        angle_error_deg: errors.map(|errors| errors.angle_rad.to_degrees()),
        sigma,
        normalised_error: errors.zip(covariance).and_then(|(e, c)| e.normalised(&c)),
        epoch: transform.map(|t| t.epoch),
        outcome,
        missing,
        was_lost: false,
        within_bounds: within_bounds || is_reference,
        solve_ms: evidence.solve_ms,
        periods_used: evidence.period_count,
        matched_points: evidence.matched_point_count,
        evidence,
        state: line.map(|line| state(line.state).to_owned()),
        sets_sent: status.map_or(0, |status| status.next_sequence),
        sets_received: line.map_or(0, |line| line.received_count),
        sets_missing: line.map_or(0, |line| line.missing_count),
        sets_dropped: status.map_or(0, |status| status.counters.dropped_set_count),
        periods_skipped: status.map_or(0, |status| status.counters.skipped_period_count),
        frames_refused: status.map_or(0, |status| status.counters.refused_frame_count),
        messages_refused: line.map_or(0, |line| line.refused_count),
        transform_latency: status.and_then(|status| status.latency),
    }
}

impl NodeScore {
    /// Whether it is a node other than the reference with a pose that nobody doubts.
    pub(crate) fn is_registered(&self) -> bool {
        let is_live = self.state.as_deref() == Some(state(NodeState::Live));
        !self.is_reference && self.pose_ref_from_node.is_some() && is_live
    }

    /// What is known of it, for people: the state comes first where it is not all well.
    pub(crate) fn verdict(&self) -> String {
        let missing = self.missing.as_ref().map_or_else(String::new, |text| format!(": {text}"));
        let found = format!("{}{missing}", self.outcome);
        let live = state(NodeState::Live);
        let mut verdict = match self.state.as_deref().filter(|state| *state != live) {
            Some(state) => format!("{state}; newest solve: {found}"),
            None => found,
        };
        if !self.within_bounds {
            verdict.push_str(" OUT OF BOUNDS");
        }
        verdict
    }

    /// A node that was lost on the way had no chance to reach the bounds: it is not held against
    /// the result.
    pub(crate) fn judged(self) -> Self {
        Self { within_bounds: self.within_bounds || self.was_lost, ..self }
    }
}

/// Estimated minus true pose.
#[derive(Clone, Copy, Debug)]
struct Errors {
    x_m: f64,
    y_m: f64,
    position_m: f64,
    angle_rad: f64,
}

fn errors(pose: &Se2<Ref, Node>, truth: &Se2<Ref, Node>) -> Errors {
    let error = pose.minus(truth);
    Errors { x_m: error.x, y_m: error.y, position_m: error.xy().norm(), angle_rad: error.z }
}

impl Errors {
    fn normalised(&self, covariance: &nalgebra::Matrix3<f64>) -> Option<f64> {
        let error = nalgebra::Vector3::new(self.x_m, self.y_m, self.angle_rad);
        Some(error.dot(&(covariance.try_inverse()? * error)))
    }
}

fn outcome(outcome: Option<&Outcome>) -> (String, Option<String>) {
    let (name, missing) = match outcome {
        None => ("unknown", None),
        Some(Outcome::Reference) => ("reference", None),
        Some(Outcome::Determined) => ("determined", None),
        Some(Outcome::Ambiguous { rivals }) => {
            ("ambiguous", Some(format!("{} other poses fit as well", rivals.len())))
        }
        Some(Outcome::Underdetermined { missing }) => ("underdetermined", Some(missing.clone())),
        Some(Outcome::Detached { with }) => {
            let names: Vec<&str> = with.iter().map(NodeId::as_str).collect();
            let missing = format!("hangs together with {} only", names.join(", "));
            ("detached", Some(missing))
        }
    };
    (name.to_owned(), missing)
}

fn state(state: NodeState) -> &'static str {
    match state {
        NodeState::Live => "live",
        NodeState::Unregistered => "unregistered",
        NodeState::ClockUnknown => "clock unknown",
        NodeState::Silent => "silent",
        NodeState::Suspect => "suspect",
    }
}

#[cfg(test)]
mod tests {
    use proto::ids::BootId;
    use proto::time::CentreTime;
    use proto::wire::{NodeInPicture, Registration, Transform};

    use super::*;
    use crate::scenario::find;

    /// A run's end: the second node of the paper, `off_m` from its true place.
    fn ended(scenario: &Scenario, off_m: f64, node_state: NodeState) -> Seen {
        let node = scenario.nodes.iter().find(|node| node.id != scenario.reference).unwrap();
        let truth = scenario.truth(node);
        let at = truth.translation_m();
        let (x_m, y_m, heading_rad) = (at.x + off_m, at.y, truth.heading_rad());
        let pose_ref_from_node = PoseRecord { x_m, y_m, heading_rad };
        let covariance = [[1e-4, 0.0, 0.0], [0.0, 1e-4, 0.0], [0.0, 0.0, 1e-4]];
        let accepted = CentreTime(0);
        let transform = Transform { epoch: 0, accepted, pose_ref_from_node, covariance };
        let registration = Registration {
            node: node.id.clone(),
            reference: scenario.reference.clone(),
            published: CentreTime(0),
            transform: Some(transform),
            outcome: Outcome::Determined,
            evidence: Evidence::default(),
            sets: None,
            solver: "default".to_owned(),
            via: Vec::new(),
            suspicion: None,
            is_pinned: false,
        };
        let line = NodeInPicture {
            node: node.id.clone(),
            state: node_state,
            silent_ms: 0,
            boot: BootId::random(),
            next_sequence: 8,
            received_count: 8,
            missing_count: 0,
            duplicate_count: 0,
            late_count: 0,
            refused_count: 0,
            epoch: Some(0),
            is_pinned: false,
        };
        Seen { status: None, registration: Some(registration), line: Some(line) }
    }

    #[test]
    fn only_a_node_that_is_live_at_the_end_is_right() {
        let scenario = find("paper").unwrap().resolve().unwrap();
        let node = scenario.nodes.iter().find(|node| node.id != scenario.reference).unwrap();
        let judged =
            |off_m, node_state| score(&scenario, node, &ended(&scenario, off_m, node_state));
        let good = judged(0.01, NodeState::Live);
        assert!(good.within_bounds && good.is_registered());
        assert_eq!(good.verdict(), "determined");
        for (node_state, named) in [
            (NodeState::Unregistered, "unregistered; newest solve: determined OUT OF BOUNDS"),
            (NodeState::Suspect, "suspect; newest solve: determined OUT OF BOUNDS"),
            (NodeState::Silent, "silent; newest solve: determined OUT OF BOUNDS"),
            (NodeState::ClockUnknown, "clock unknown; newest solve: determined OUT OF BOUNDS"),
        ] {
            let bad = judged(0.01, node_state);
            assert!(!bad.within_bounds && !bad.is_registered(), "{named}");
            assert_eq!(bad.verdict(), named);
        }
        let far = judged(1.0, NodeState::Live);
        assert!(!far.within_bounds && far.verdict().ends_with("OUT OF BOUNDS"));
        let unseen = score(&scenario, node, &Seen::default());
        assert!(!unseen.within_bounds && !unseen.is_registered());
    }

    #[test]
    fn a_node_that_need_not_be_registered_may_be_lost_but_not_wrong() {
        let mut scenario = find("paper").unwrap().resolve().unwrap();
        let node =
            scenario.nodes.iter().find(|node| node.id != scenario.reference).unwrap().clone();
        let mut own = scenario.bounds.of(&node.id);
        own.is_optional = true;
        scenario.bounds.node.insert(node.id.clone(), own);
        let is_within = |seen: &Seen| score(&scenario, &node, seen).within_bounds;
        assert!(is_within(&Seen::default()));
        assert!(is_within(&ended(&scenario, 0.01, NodeState::Silent)));
        assert!(!is_within(&ended(&scenario, 1.0, NodeState::Silent)));
        assert!(!is_within(&ended(&scenario, 1.0, NodeState::Live)));
    }
}
