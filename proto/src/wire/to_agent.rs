//! What the centre tells the agents and everybody who watches.

use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

use super::check::Invalid;
use super::check::{
    at_most, coordinate, covariance, finite, not_negative, pose_covariance, require, share,
};
use super::codec::Message;
use super::header::Kind;
use super::people::{MAX_PEOPLE_COUNT, PersonInPicture};
use super::tracks::{MAX_PICTURE_TRACK_COUNT, TrackInPicture};
use crate::geom::{Node, Ref, Se2};
use crate::ids::{BootId, NodeId};
use crate::time::{CentreTime, NodeTime};

const MAX_NODE_COUNT: usize = 256;
const MAX_TARGET_COUNT: usize = 1024;
const MAX_RIVAL_COUNT: usize = 16;
const MAX_TEXT_LENGTH: usize = 256;

/// The answer to a [`super::ClockProbe`]; the centre's boot id is in the header.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ClockAnswer {
    /// Who asked.
    pub node: NodeId,
    /// The asking clock, as asked.
    pub asked: NodeTime,
    /// The centre's clock when the question arrived.
    pub answered: CentreTime,
}

impl Message for ClockAnswer {
    const KIND: Kind = Kind::ClockAnswer;
    const SCHEMA: u16 = 1;
    const MAX_BYTES: usize = 128;

    fn check(&self) -> Result<(), Invalid> {
        Ok(())
    }
}

/// A pose of a node in `Ref`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PoseRecord {
    /// Where the node's origin lies.
    pub x_m: f64,
    /// Where the node's origin lies.
    pub y_m: f64,
    /// How far its axes are turned, counter-clockwise.
    pub heading_rad: f64,
}

impl From<Se2<Ref, Node>> for PoseRecord {
    fn from(pose_ref_from_node: Se2<Ref, Node>) -> Self {
        let translation_m = pose_ref_from_node.translation_m();
        let heading_rad = pose_ref_from_node.heading_rad();
        Self { x_m: translation_m.x, y_m: translation_m.y, heading_rad }
    }
}

impl From<PoseRecord> for Se2<Ref, Node> {
    fn from(pose: PoseRecord) -> Self {
        Self::new(pose.x_m, pose.y_m, pose.heading_rad)
    }
}

impl PoseRecord {
    pub(super) fn check(&self) -> Result<(), Invalid> {
        coordinate("pose.x_m", self.x_m)?;
        coordinate("pose.y_m", self.y_m)?;
        let turned = self.heading_rad.is_finite() && self.heading_rad.abs() <= 4.0;
        require(turned, "pose.heading_rad", self.heading_rad, "an angle in (−π, π] is expected")
    }
}

/// A transform that the centre stands by.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Transform {
    /// Counts the transforms accepted for this node. It grows over restarts of the centre too, once
    /// the node's agent has said which it holds or where the centre keeps a state file.
    pub epoch: u64,
    /// When it was accepted.
    pub accepted: CentreTime,
    /// Maps points of the node into `Ref`.
    pub pose_ref_from_node: PoseRecord,
    /// Covariance of `(x_m, y_m, heading_rad)` in `Ref`.
    pub covariance: [[f64; 3]; 3],
}

impl Transform {
    /// [`Self::covariance`] as a matrix.
    #[must_use]
    pub fn covariance_matrix(&self) -> Matrix3<f64> {
        Matrix3::from_fn(|row, column| self.covariance[row][column])
    }
}

/// Another pose that the data would allow.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Rival {
    /// The other pose.
    pub pose_ref_from_node: PoseRecord,
    /// Natural logarithm of the best pose's odds against this one.
    pub log_odds: f64,
}

/// What the data say about a node's pose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Outcome {
    /// This is the reference node: its pose defines `Ref`.
    Reference,
    /// One pose, and no other comes near it.
    Determined,
    /// Several poses explain the data.
    Ambiguous {
        /// The poses, best first.
        rivals: Vec<Rival>,
    },
    /// Too little to go on.
    Underdetermined {
        /// What is missing, for people.
        missing: String,
    },
    /// One pose with respect to other nodes, but none of them hangs together with the reference:
    /// where it stands in `Ref` is not known.
    Detached {
        /// The other nodes.
        with: Vec<NodeId>,
    },
}

/// Why a transform in force is doubted: points of the node miss those of others by more than the
/// poses' uncertainty explains.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Suspicion {
    /// Who seems to have moved: the node itself, or the reference.
    pub moved: NodeId,
    /// When the points began to miss, as far as can be told.
    pub began: CentreTime,
    /// Correction of the pose that would make them meet again: x in `Ref`, metres.
    pub shift_x_m: f64,
    /// y in `Ref`, metres.
    pub shift_y_m: f64,
    /// Heading, radians.
    pub turn_rad: f64,
    /// That correction in units of its uncertainty, squared; 3 on average if nothing moved.
    pub chi_square: f64,
}

/// What a registration rests on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Evidence {
    /// Points of the node that found a partner.
    pub matched_point_count: u32,
    /// Places, apart from each other, at which they lie.
    pub distinct_point_count: u32,
    /// Periods in which both nodes were heard.
    pub period_count: u32,
    /// Sum of squared normalised residuals of the matched points.
    pub chi_square: f64,
    /// Its degrees of freedom.
    pub degrees_of_freedom: f64,
    /// By how much the covariance was multiplied because residuals contradict the stated one or
    /// errors last longer than a period: 1 where they agree, 0 where nothing was solved.
    pub covariance_inflation: f64,
    /// Natural logarithm of the pose's odds against "nothing in common".
    pub log_odds: f64,
    /// Natural logarithm of the pose's odds against the best separated rival, if there is one.
    pub rival_log_odds: Option<f64>,
    /// Proven: no pose apart from the best one has more than this share of its log likelihood
    /// ratio, 0 to 1. `None` where nothing was proven.
    pub certified_rival_share: Option<f64>,
    /// Time that the solver took.
    pub solve_ms: f64,
}

/// Which sets went in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SetsUsed {
    /// The node's life.
    pub boot: BootId,
    /// Sequence number of the first set.
    pub first_sequence: u64,
    /// Sequence number of the last set.
    pub last_sequence: u64,
    /// How many sets, of both sides together.
    pub count: u32,
    /// When the last of them arrived at the centre.
    pub last_arrival: CentreTime,
}

/// How a node stands to the reference node.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Registration {
    /// Which node.
    pub node: NodeId,
    /// The node whose frame is `Ref`.
    pub reference: NodeId,
    /// When this was published.
    pub published: CentreTime,
    /// The transform in force, if any was ever found: a bad result never replaces a good one.
    pub transform: Option<Transform>,
    /// What the newest solve says.
    pub outcome: Outcome,
    /// What it rests on.
    pub evidence: Evidence,
    /// Which sets went in; none before the first solve.
    pub sets: Option<SetsUsed>,
    /// Name of the solver.
    pub solver: String,
    /// The nodes through which the pose came, the reference first, this node last; empty where it
    /// came from no solution.
    pub via: Vec<NodeId>,
    /// Why the transform in force is doubted, if it is.
    pub suspicion: Option<Suspicion>,
    /// The operator keeps the transform in force: no result replaces it.
    pub is_pinned: bool,
}

impl Message for Registration {
    const KIND: Kind = Kind::Registration;
    const SCHEMA: u16 = 2;
    const MAX_BYTES: usize = 32 << 10;

    fn check(&self) -> Result<(), Invalid> {
        at_most("solver", self.solver.len(), MAX_TEXT_LENGTH)?;
        if let Some(transform) = &self.transform {
            transform.pose_ref_from_node.check()?;
            pose_covariance("transform.covariance", &transform.covariance)?;
        }
        self.evidence.check()?;
        at_most("via", self.via.len(), MAX_NODE_COUNT)?;
        self.suspicion.as_ref().map_or(Ok(()), Suspicion::check)?;
        match &self.outcome {
            Outcome::Reference | Outcome::Determined => Ok(()),
            Outcome::Ambiguous { rivals } => {
                at_most("outcome.rivals", rivals.len(), MAX_RIVAL_COUNT)?;
                rivals.iter().try_for_each(|rival| {
                    finite("rival.log_odds", rival.log_odds)?;
                    rival.pose_ref_from_node.check()
                })
            }
            Outcome::Underdetermined { missing } => {
                at_most("outcome.missing", missing.len(), MAX_TEXT_LENGTH)
            }
            Outcome::Detached { with } => at_most("outcome.with", with.len(), MAX_NODE_COUNT),
        }
    }
}

impl Evidence {
    fn check(&self) -> Result<(), Invalid> {
        finite("evidence.log_odds", self.log_odds)?;
        not_negative("evidence.chi_square", self.chi_square)?;
        not_negative("evidence.covariance_inflation", self.covariance_inflation)?;
        not_negative("evidence.solve_ms", self.solve_ms)?;
        self.certified_rival_share
            .map_or(Ok(()), |part| share("evidence.certified_rival_share", part))
    }
}

impl Suspicion {
    fn check(&self) -> Result<(), Invalid> {
        coordinate("suspicion.shift_x_m", self.shift_x_m)?;
        coordinate("suspicion.shift_y_m", self.shift_y_m)?;
        finite("suspicion.turn_rad", self.turn_rad)?;
        not_negative("suspicion.chi_square", self.chi_square)
    }
}

/// How the centre sees a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum NodeState {
    /// Heard lately and registered: its points are in the picture.
    Live,
    /// Heard lately, pose not known yet: its points are not in the picture.
    Unregistered,
    /// Heard lately, but its clock is not joined to the centre's yet.
    ClockUnknown,
    /// Not heard for longer than the limit.
    Silent,
    /// Heard lately and registered, but its points miss those of the others: it, or the reference,
    /// seems to have moved. Its points are in the picture under the transform in force.
    Suspect,
}

/// One node's line in the picture.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct NodeInPicture {
    /// Which node.
    pub node: NodeId,
    /// How the centre sees it.
    pub state: NodeState,
    /// Milliseconds since it was last heard.
    pub silent_ms: u64,
    /// Its current life.
    pub boot: BootId,
    /// Sequence number that its next set should have.
    pub next_sequence: u64,
    /// Sets taken in this life.
    pub received_count: u64,
    /// Sets that never came.
    pub missing_count: u64,
    /// Sets that came twice.
    pub duplicate_count: u64,
    /// Sets that came too late to be used.
    pub late_count: u64,
    /// Messages refused.
    pub refused_count: u64,
    /// Epoch of the transform used, if registered.
    pub epoch: Option<u64>,
    /// The operator keeps the transform in force.
    pub is_pinned: bool,
}

/// A target that one or more nodes see.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FusedTarget {
    /// In `Ref`.
    pub x_m: f64,
    /// In `Ref`.
    pub y_m: f64,
    /// Covariance in `Ref`, `[xx, xy, yy]`.
    pub cov_m2: [f64; 3],
    /// The strongest contributing point.
    pub snr_db: f64,
    /// Who contributed.
    pub nodes: Vec<NodeId>,
}

impl FusedTarget {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), Invalid> {
        coordinate("targets.x_m", self.x_m)?;
        coordinate("targets.y_m", self.y_m)?;
        covariance("targets.cov_m2", self.cov_m2)?;
        finite("targets.snr_db", self.snr_db)?;
        at_most("targets.nodes", self.nodes.len(), MAX_NODE_COUNT)
    }
}

/// Everybody's targets of one period in one frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Picture {
    /// The node whose frame is `Ref`.
    pub reference: NodeId,
    /// The centre's count of periods.
    pub period: i64,
    /// Middle of the period.
    pub time: CentreTime,
    /// Every node ever heard.
    pub nodes: Vec<NodeInPicture>,
    /// The targets.
    pub targets: Vec<FusedTarget>,
    /// The people that registered nodes follow, confirmed or coasting, in `Ref`: the newest of each
    /// node, by node and id.
    pub tracks: Vec<TrackInPicture>,
    /// The people whom all registered nodes together show, confirmed or coasting, by id.
    pub people: Vec<PersonInPicture>,
}

impl Message for Picture {
    const KIND: Kind = Kind::Picture;
    const SCHEMA: u16 = 4;
    const MAX_BYTES: usize = 512 << 10;

    fn check(&self) -> Result<(), Invalid> {
        at_most("nodes", self.nodes.len(), MAX_NODE_COUNT)?;
        at_most("targets", self.targets.len(), MAX_TARGET_COUNT)?;
        self.targets.iter().try_for_each(FusedTarget::check)?;
        at_most("tracks", self.tracks.len(), MAX_PICTURE_TRACK_COUNT)?;
        self.tracks.iter().try_for_each(|shown| shown.track.check())?;
        at_most("people", self.people.len(), MAX_PEOPLE_COUNT)?;
        self.people.iter().try_for_each(PersonInPicture::check)
    }
}
