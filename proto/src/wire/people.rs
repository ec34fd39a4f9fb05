//! People followed by all nodes together, as the centre shows them.

use nalgebra::Matrix4;
use serde::{Deserialize, Serialize};

use super::check::{Invalid, at_most, finite, not_negative, require, share};
use super::tracks::{TrackStatus, moving, unpacked_covariance};
use crate::ids::NodeId;
use crate::time::CentreTime;

/// Most people in one picture.
pub(super) const MAX_PEOPLE_COUNT: usize = 512;
/// Most nodes that contribute to one person.
const MAX_NODE_COUNT: usize = 256;

/// What errors call a person's state and covariance.
const NAMES: [&str; 4] =
    ["people.state x_m", "people.state y_m", "people.state velocity", "people.covariance"];

/// Somebody whom the centre follows, in `Ref`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PersonInPicture {
    /// Never given again in the same life of the centre.
    pub id: u64,
    /// How sure.
    pub status: TrackStatus,
    /// When `state` held.
    pub time: CentreTime,
    /// The person's middle, `[x_m, y_m, x_m_per_s, y_m_per_s]`.
    pub state: [f64; 4],
    /// Covariance of `state` with the errors of the nodes' poses, packed as in
    /// [`super::TrackRecord`].
    pub covariance: [f64; 10],
    /// Logarithm of the odds for a person against chance points.
    pub log_odds: f64,
    /// How long before `time` the person was last seen, seconds.
    pub unseen_s: f64,
    /// Who has seen the person lately, by name.
    pub nodes: Vec<NodeId>,
    /// The newest point of the person.
    pub last: PointOfPerson,
}

/// A point that a person's track was made of.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PointOfPerson {
    /// Who measured it.
    pub node: NodeId,
    /// The node's sequence number of the set that it came in.
    pub sequence: u64,
    /// Which point of the set, from zero.
    pub point_index: u32,
    /// How probable it is that it is of this person, 0 to 1.
    pub share: f64,
}

impl PersonInPicture {
    /// Most people in one picture.
    pub const MAX_COUNT: usize = MAX_PEOPLE_COUNT;

    /// [`Self::covariance`] as a matrix.
    #[must_use]
    pub fn covariance_matrix(&self) -> Matrix4<f64> {
        unpacked_covariance(&self.covariance)
    }

    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), Invalid> {
        moving(NAMES, &self.state, &self.covariance)?;
        finite("people.log_odds", self.log_odds)?;
        not_negative("people.unseen_s", self.unseen_s)?;
        at_most("people.nodes", self.nodes.len(), MAX_NODE_COUNT)?;
        let ascends = self.nodes.windows(2).all(|pair| pair[0] < pair[1]);
        require(ascends, "people.nodes", &self.nodes, "names in ascending order are expected")?;
        share("people.last.share", self.last.share)
    }
}
