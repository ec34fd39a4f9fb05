//! People followed: what a node's tracker says of them, and what the centre shows.

use nalgebra::Matrix4;
use serde::{Deserialize, Serialize};

use super::check::{
    Invalid, at_most, coordinate, covariance, half_depth, not_negative, require, second_moment,
    share,
};
use super::codec::Message;
use super::header::Kind;
use crate::ids::NodeId;
use crate::time::{CentreTime, ClockEstimate, NodeTime};

/// Most tracks of one node: more people than a node can tell apart.
const MAX_NODE_TRACK_COUNT: usize = 256;
/// Most tracks in one picture.
pub(super) const MAX_PICTURE_TRACK_COUNT: usize = 1024;
/// Nobody is faster, metres per second; times that run faster are allowed for.
const MAX_SPEED_M_PER_S: f64 = 1e4;

/// What errors call a track's state and covariance.
const NAMES: [&str; 4] =
    ["tracks.state x_m", "tracks.state y_m", "tracks.state velocity", "tracks.covariance"];

/// How sure a tracker is that somebody is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TrackStatus {
    /// Seen, not often enough to be reported as a person.
    Tentative,
    /// A person, seen in this period.
    Confirmed,
    /// A person who was seen before and is believed to be there still.
    Coasting,
}

/// Somebody who is followed.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackRecord {
    /// Never given again by the same node in the same life.
    pub id: u64,
    /// How sure.
    pub status: TrackStatus,
    /// `[x_m, y_m, x_m_per_s, y_m_per_s]`, in the frame of the record that holds this.
    pub state: [f64; 4],
    /// Covariance of `state`, its upper triangle row by row: `[xx, xy, xu, xv, yy, yu, yv, uu, uv,
    /// vv]` with the velocity `(u, v)`.
    pub covariance: [f64; 10],
    /// Second moments of what is seen of the person, `[xx, xy, yy]`, square metres.
    pub extent_m2: [f64; 3],
    /// How well the image looks like the person's template, 0 to 1.
    pub appearance: f64,
    /// How long ago the person was last seen, seconds of the node's source; 0 for now.
    pub unseen_s: f64,
}

impl TrackRecord {
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
        second_moment("tracks.extent_m2", self.extent_m2)?;
        share("tracks.appearance", self.appearance)?;
        not_negative("tracks.unseen_s", self.unseen_s)
    }
}

/// Checks a state `[x_m, y_m, x_m_per_s, y_m_per_s]` and its packed covariance, which errors call by
/// these names: first and second coordinate, velocity, covariance.
pub(super) fn moving(
    names: [&'static str; 4],
    state: &[f64; 4],
    packed: &[f64; 10],
) -> Result<(), Invalid> {
    let [x_m, y_m, x_m_per_s, y_m_per_s] = *state;
    coordinate(names[0], x_m)?;
    coordinate(names[1], y_m)?;
    for speed_m_per_s in [x_m_per_s, y_m_per_s] {
        let believable = speed_m_per_s.abs() <= MAX_SPEED_M_PER_S;
        let expected = "a velocity within 10 km/s is expected";
        require(believable, names[2], speed_m_per_s, expected)?;
    }
    let [xx, xy, _, _, yy, ..] = *packed;
    covariance(names[3], [xx, xy, yy])?;
    let good = packed.iter().all(|entry| entry.is_finite())
        && unpacked_covariance(packed).cholesky().is_some();
    require(good, names[3], packed, "a positive definite covariance is expected")
}

/// Where the entry of a symmetric 4×4 matrix stands in its upper triangle, row by row.
fn packed_index(row: usize, column: usize) -> usize {
    let (first, second) = (row.min(column), row.max(column));
    first * (7 - first) / 2 + second
}

/// The symmetric matrix of which `packed` is the upper triangle, row by row.
pub(super) fn unpacked_covariance(packed: &[f64; 10]) -> Matrix4<f64> {
    Matrix4::from_fn(|row, column| packed[packed_index(row, column)])
}

/// The upper triangle of a symmetric matrix, row by row; the mean of both halves.
#[must_use]
pub fn packed_covariance(matrix: &Matrix4<f64>) -> [f64; 10] {
    let mut packed = [0.0; 10];
    for row in 0..4 {
        for column in row..4 {
            packed[packed_index(row, column)] =
                0.5 * (matrix[(row, column)] + matrix[(column, row)]);
        }
    }
    packed
}

/// Everybody whom a node follows, after one period.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NodeTracks {
    /// Who follows; must be the node of the key.
    pub node: NodeId,
    /// The node's own count of periods: that of the point set of the same sweep.
    pub period: u64,
    /// Middle of the acquisition.
    pub time: NodeTime,
    /// What the node knew of the centre's clock when it sent.
    pub clock: Option<ClockEstimate>,
    /// How far behind a track's position the middle of the person lies; 0 if that is the position.
    pub half_depth_m: f64,
    /// Standard deviation of `half_depth_m` from person to person.
    pub half_depth_sigma_m: f64,
    /// Frames that the tracker has refused in this life, and tracks that made no sense.
    pub refused_count: u64,
    /// The tracks in the node's frame, in ascending order of id, possibly none.
    pub tracks: Vec<TrackRecord>,
}

impl NodeTracks {
    /// Most tracks that one message may have.
    pub const MAX_TRACK_COUNT: usize = MAX_NODE_TRACK_COUNT;
}

impl Message for NodeTracks {
    const KIND: Kind = Kind::NodeTracks;
    const SCHEMA: u16 = 1;
    const MAX_BYTES: usize = 64 << 10;

    fn check(&self) -> Result<(), Invalid> {
        at_most("tracks", self.tracks.len(), MAX_NODE_TRACK_COUNT)?;
        half_depth("half_depth_m", self.half_depth_m)?;
        half_depth("half_depth_sigma_m", self.half_depth_sigma_m)?;
        let ascends = self.tracks.windows(2).all(|pair| pair[0].id < pair[1].id);
        let ids = || self.tracks.iter().map(|track| track.id).collect::<Vec<_>>();
        if !ascends {
            return require(false, "tracks.id", ids(), "ascending ids are expected");
        }
        self.tracks.iter().try_for_each(TrackRecord::check)
    }
}

/// A node's track as the centre shows it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackInPicture {
    /// Who follows; an id is this node's own.
    pub node: NodeId,
    /// When the track was as stated.
    pub time: CentreTime,
    /// The track in `Ref`: the person's middle, its covariance with the error of the node's pose.
    pub track: TrackRecord,
}
