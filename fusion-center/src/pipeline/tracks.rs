//! The people whom nodes follow, as last heard, mapped into the common frame.
//!
//! A track's position is moved to the person's middle, the half depth farther out on the line of
//! sight as with points. With the pose `z_ref = Φ z_node + t` and its covariance `P` of
//! `(x_m, y_m, heading_rad)`, state and covariance are then
//! `(Φ z + t, Φ v)` and `B C Bᵀ + J P Jᵀ`, `B = diag(Φ, Φ)`,
//! `J = [[I, (Φ z)⊥], [0, (Φ v)⊥]]`, `a⊥ = (−a_y, a_x)`: turning the node turns the velocity too.

use std::collections::BTreeMap;
use std::time::Duration;

use nalgebra::{Matrix2, Matrix3, Matrix4, Matrix4x3, Vector2};
use proto::geom::{Node, Point, Ref, Se2};
use proto::ids::{BootId, NodeId};
use proto::measured::{line_of_sight, packed, symmetric};
use proto::time::{CentreTime, ClockEstimate};
use proto::wire::{
    NodeTracks, Received, TrackInPicture, TrackRecord, TrackStatus, packed_covariance,
};

use super::poses::Poses;
use crate::gather::{Gather, Life};

/// Most tracks that one picture shows.
const MAX_SHOWN_COUNT: usize = 512;

/// What was last heard of one node's tracks.
#[derive(Clone, Debug)]
struct Heard {
    boot: BootId,
    sequence: u64,
    arrival: CentreTime,
    tracks: NodeTracks,
}

/// Every node's newest tracks: at most one message for each node whose sets are gathered.
#[derive(Debug, Default)]
pub(super) struct Followed {
    newest: BTreeMap<NodeId, Heard>,
}

impl Followed {
    /// Takes a node's tracks in, unless newer ones are there. Returns why they are of no use.
    pub(super) fn take(
        &mut self,
        now: CentreTime,
        gather: &mut Gather,
        heard: Received<NodeTracks>,
    ) -> Result<(), Unused> {
        let Received { stamp, body: tracks } = heard;
        // Whose sets are not taken in has no pose; so strangers cost no memory.
        let Some(history) = gather.node_mut(&tracks.node) else { return Ok(()) };
        if history.hear(now, stamp.boot) == Life::Former {
            return Err(Unused::FormerLife);
        }
        let (boot, sequence, arrival) = (stamp.boot, stamp.sequence, now);
        let is_newer = |last: &Heard| last.boot != boot || last.sequence < sequence;
        if self.newest.get(&tracks.node).is_none_or(is_newer) {
            self.newest.insert(tracks.node.clone(), Heard { boot, sequence, arrival, tracks });
        }
        Ok(())
    }

    /// Forgets what was heard longer ago than `limit`.
    pub(super) fn forget_old(&mut self, now: CentreTime, limit: Duration) {
        self.newest.retain(|_, heard| now.since(heard.arrival) <= limit);
    }

    /// Forgets what a node has said.
    pub(super) fn forget(&mut self, node: &NodeId) {
        self.newest.remove(node);
    }

    /// Confirmed and coasting tracks of registered nodes, in `Ref`, by node and id.
    pub(super) fn shown(&self, gather: &Gather, poses: &Poses) -> Vec<TrackInPicture> {
        let mut shown = Vec::new();
        for (node, Heard { tracks, .. }) in &self.newest {
            let Some((pose_ref_from_node, covariance)) = poses.pose(node) else { continue };
            let clock: Option<ClockEstimate> = gather.node(node).and_then(|history| history.clock);
            let Some(clock) = clock else { continue };
            let time = tracks.time.to_centre(&clock);
            let sure = tracks.tracks.iter().filter(|one| one.status != TrackStatus::Tentative);
            shown.extend(sure.map(|track| {
                let middle = middle(track, tracks.half_depth_m, tracks.half_depth_sigma_m);
                let placed = place(pose_ref_from_node, &covariance, &middle);
                TrackInPicture { node: node.clone(), time, track: placed }
            }));
        }
        // One node's wild track must not cost everybody the picture.
        shown.retain(|one| one.track.check().is_ok());
        shown.truncate(MAX_SHOWN_COUNT);
        shown
    }
}

/// Why tracks were not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Unused {
    /// Another agent of this name has followed.
    FormerLife,
}

impl Unused {
    /// A short label of the reason, for counting.
    pub(super) fn label(self) -> &'static str {
        match self {
            Self::FormerLife => "former_life",
        }
    }

    /// What to do about it.
    pub(super) fn reason(self) -> &'static str {
        match self {
            Self::FormerLife => "another agent has followed: are there two of this name?",
        }
    }
}

/// The track of a person's middle, made of that of what is seen.
fn middle(track: &TrackRecord, half_depth_m: f64, half_depth_sigma_m: f64) -> TrackRecord {
    let [x_m, y_m, x_m_per_s, y_m_per_s] = track.state;
    let outward = line_of_sight(&Vector2::new(x_m, y_m));
    let at_m = Vector2::new(x_m, y_m) + outward * half_depth_m;
    let mut covariance = track.covariance_matrix();
    let mut of_position = covariance.fixed_view_mut::<2, 2>(0, 0);
    of_position += outward * outward.transpose() * half_depth_sigma_m.powi(2);
    TrackRecord {
        state: [at_m.x, at_m.y, x_m_per_s, y_m_per_s],
        covariance: packed_covariance(&covariance),
        ..track.clone()
    }
}

/// The track in `Ref`, less sure by as much as the node's pose is unsure.
fn place(
    pose_ref_from_node: Se2<Ref, Node>,
    pose_covariance: &Matrix3<f64>,
    track: &TrackRecord,
) -> TrackRecord {
    let [x_m, y_m, x_m_per_s, y_m_per_s] = track.state;
    let rotation: Matrix2<f64> = pose_ref_from_node.rotation();
    let at = pose_ref_from_node * Point::<Node>::new(x_m, y_m);
    let arm = rotation * Vector2::new(x_m, y_m);
    let velocity = rotation * Vector2::new(x_m_per_s, y_m_per_s);
    let mut both = Matrix4::zeros();
    both.fixed_view_mut::<2, 2>(0, 0).copy_from(&rotation);
    both.fixed_view_mut::<2, 2>(2, 2).copy_from(&rotation);
    #[rustfmt::skip]
    let jacobian = Matrix4x3::new(
        1.0, 0.0, -arm.y,
        0.0, 1.0, arm.x,
        0.0, 0.0, -velocity.y,
        0.0, 0.0, velocity.x,
    );
    let covariance = both * track.covariance_matrix() * both.transpose()
        + jacobian * pose_covariance * jacobian.transpose();
    let extent = rotation * symmetric(track.extent_m2) * rotation.transpose();
    TrackRecord {
        state: [at.x_m(), at.y_m(), velocity.x, velocity.y],
        covariance: packed_covariance(&covariance),
        extent_m2: packed(&extent),
        ..track.clone()
    }
}

#[cfg(test)]
mod tests;
