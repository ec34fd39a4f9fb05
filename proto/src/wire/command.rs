//! What an operator may ask of the centre, and what the centre answers.

use serde::{Deserialize, Serialize};

use super::check::{Invalid, at_most, require};
use super::codec::Message;
use super::header::Kind;
use super::to_agent::PoseRecord;
use crate::ids::{BootId, NodeId};

/// Longest answer, bytes.
const MAX_ANSWER_LENGTH: usize = 512;
/// Largest believable standard deviation of a stated position, metres.
const MAX_SIGMA_M: f64 = 10.0;
/// Largest believable standard deviation of a stated heading, radians.
const MAX_SIGMA_RAD: f64 = 1.0;

/// An operator's request.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Command {
    /// Forget what was seen so far and register anew: this node, or every node if none is named.
    /// The transforms in force stay until better ones are found.
    Recalibrate {
        /// Which node.
        node: Option<NodeId>,
    },
    /// No result replaces this node's transform until [`Self::Unpin`].
    Pin {
        /// Which node.
        node: NodeId,
        /// The pose to set first; the transform in force stays if left out.
        pose: Option<StatedPose>,
    },
    /// Results may replace this node's transform again.
    Unpin {
        /// Which node.
        node: NodeId,
    },
    /// Back to the transform that was in force before this one, which is pinned: the data that
    /// brought the present one would bring it back at once.
    Rollback {
        /// Which node.
        node: NodeId,
    },
}

/// A pose that an operator knows, and how well.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StatedPose {
    /// Maps points of the node into `Ref`.
    pub pose_ref_from_node: PoseRecord,
    /// Standard deviation of each coordinate, metres.
    pub sigma_m: f64,
    /// Standard deviation of the heading, radians.
    pub sigma_rad: f64,
}

impl Message for Command {
    const KIND: Kind = Kind::Command;
    const SCHEMA: u16 = 2;
    const MAX_BYTES: usize = 1 << 10;

    fn check(&self) -> Result<(), Invalid> {
        let Self::Pin { pose: Some(stated), .. } = self else { return Ok(()) };
        let StatedPose { pose_ref_from_node, sigma_m, sigma_rad } = stated;
        pose_ref_from_node.check()?;
        let good_m = (1e-4..=MAX_SIGMA_M).contains(sigma_m);
        require(good_m, "pose.sigma_m", sigma_m, "0.0001 to 10 m is expected")?;
        let good_rad = (1e-5..=MAX_SIGMA_RAD).contains(sigma_rad);
        require(good_rad, "pose.sigma_rad", sigma_rad, "0.00001 to 1 rad is expected")
    }
}

/// What the centre did about a [`Command`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Answer {
    /// The boot id in the command's header.
    pub to: BootId,
    /// Whether it was done.
    pub is_done: bool,
    /// What was done or why not, for people.
    pub text: String,
}

impl Message for Answer {
    const KIND: Kind = Kind::Answer;
    const SCHEMA: u16 = 1;
    const MAX_BYTES: usize = 1 << 10;

    fn check(&self) -> Result<(), Invalid> {
        at_most("text", self.text.len(), MAX_ANSWER_LENGTH)
    }
}
