//! What a solver says, in the words of the wire; and every node's line in the picture.

use std::time::Duration;

use proto::geom::{Node, Ref, Se2};
use proto::ids::NodeId;
use proto::time::CentreTime;
use proto::wire::{Evidence, NodeInPicture, NodeState, Outcome, Rival};

use super::poses::Poses;
use crate::gather::{Gather, NodeHistory};
use crate::registration;

/// Most rival poses that are published.
const MAX_RIVAL_COUNT: usize = 8;

pub(super) fn outcome(outcome: &registration::Outcome) -> Outcome {
    match outcome {
        registration::Outcome::Determined => Outcome::Determined,
        registration::Outcome::Ambiguous { rivals } => Outcome::Ambiguous {
            rivals: rivals
                .iter()
                .take(MAX_RIVAL_COUNT)
                .map(|rival| Rival {
                    pose_ref_from_node: rival.pose_ref_from_node.into(),
                    log_odds: rival.log_odds,
                })
                .collect(),
        },
        registration::Outcome::Underdetermined { missing } => {
            Outcome::Underdetermined { missing: missing.to_string() }
        }
    }
}

/// The other poses of a node for which as many pairs speak: even odds.
pub(super) fn tied(rivals: &[Se2<Ref, Node>]) -> Vec<Rival> {
    let rival = |pose: &Se2<Ref, Node>| Rival { pose_ref_from_node: (*pose).into(), log_odds: 0.0 };
    rivals.iter().take(MAX_RIVAL_COUNT).map(rival).collect()
}

pub(super) fn evidence(evidence: &registration::Evidence, solve_time: Duration) -> Evidence {
    let count = |count: usize| u32::try_from(count).unwrap_or(u32::MAX);
    Evidence {
        matched_point_count: count(evidence.matched_point_count),
        distinct_point_count: count(evidence.distinct_point_count),
        period_count: count(evidence.period_count),
        chi_square: evidence.chi_square,
        degrees_of_freedom: evidence.degrees_of_freedom,
        covariance_inflation: evidence.covariance_inflation,
        log_odds: evidence.log_odds,
        rival_log_odds: evidence.rival_log_odds,
        // A bound above the best pose's own says nothing; one below "nothing in common" no more
        // than that.
        certified_rival_share: evidence
            .certificate
            .rival_share()
            .filter(|share| *share <= 1.0)
            .map(|share| share.max(0.0)),
        solve_ms: solve_time.as_secs_f64() * 1e3,
    }
}

/// Every node's line in the picture.
pub(super) fn node_lines(now: CentreTime, gather: &Gather, poses: &Poses) -> Vec<NodeInPicture> {
    let line = |(node, history): (&NodeId, &NodeHistory)| {
        let transform = poses.transform(node);
        let state = if !gather.is_heard(now, history) {
            NodeState::Silent
        } else if history.clock.is_none() {
            NodeState::ClockUnknown
        } else if transform.is_none() {
            NodeState::Unregistered
        } else if poses.suspicion(node).is_some() {
            NodeState::Suspect
        } else {
            NodeState::Live
        };
        let silent = now.since(history.last_heard);
        NodeInPicture {
            node: node.clone(),
            state,
            silent_ms: u64::try_from(silent.as_millis()).unwrap_or(u64::MAX),
            boot: history.boot,
            next_sequence: history.next_sequence,
            received_count: history.received_count,
            missing_count: history.missing_count(),
            duplicate_count: history.duplicate_count,
            late_count: history.late_count,
            refused_count: history.refused_count,
            epoch: transform.map(|transform| transform.epoch),
            is_pinned: poses.is_pinned(node),
        }
    };
    gather.nodes().map(line).collect()
}
