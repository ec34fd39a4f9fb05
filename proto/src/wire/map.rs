//! What the centre says of the targets of wide-area radars: tracks on the map.

use nalgebra::Matrix4;
use serde::{Deserialize, Serialize};

use super::check::{Invalid, at_most, finite, require, share};
use super::codec::Message;
use super::dwell::{GeoRecord, time_unix};
use super::header::Kind;
use super::tracks::unpacked_covariance;
use crate::ids::NodeId;

/// Most tracks in one message.
const MAX_TRACK_COUNT: usize = 4096;
/// Nothing on the ground or in the air is faster, metres per second.
const MAX_SPEED_M_PER_S: f64 = 1e4;
/// Largest standard deviation of a place that is believed, metres.
const MAX_SIGMA_M: f64 = 1e6;

/// How sure the tracker is that a target is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MapStatus {
    /// Seen, not often enough to be reported.
    Tentative,
    /// A target, seen when it was last looked at.
    Confirmed,
    /// A target not seen when it was last looked at, believed to go on.
    Coasting,
    /// A target believed to stand, too slow to be detected.
    Stopped,
}

impl MapStatus {
    /// As it is written in files and tables.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Tentative => "tentative",
            Self::Confirmed => "confirmed",
            Self::Coasting => "coasting",
            Self::Stopped => "stopped",
        }
    }
}

/// A report of a dwell, for provenance.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct MapReport {
    /// Whose.
    pub node: NodeId,
    /// [`super::Dwell::revisit_index`]
    pub revisit_index: u32,
    /// [`super::Dwell::dwell_index`]
    pub dwell_index: u32,
    /// [`super::DwellReport::index`]
    pub report_index: u32,
}

/// A target on the map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MapTrack {
    /// Never given again in the same life of the centre.
    pub id: u64,
    /// How sure.
    pub status: MapStatus,
    /// When it was as stated: that of the last dwell that could have seen it, Unix seconds.
    pub time_unix_s: f64,
    /// Where.
    pub place: GeoRecord,
    /// Velocity to the east and to the north at `place`, metres per second.
    pub velocity_m_per_s: [f64; 2],
    /// Covariance of east, north (metres) and their velocities (metres per second) at `place`, its
    /// upper triangle row by row: `[ee, en, eu, ev, nn, nu, nv, uu, uv, vv]` with the velocity
    /// `(u, v)`.
    pub covariance: [f64; 10],
    /// How many reports it is made of.
    pub report_count: u32,
    /// When it was last seen, Unix seconds.
    pub seen_unix_s: f64,
    /// Its newest report, as long as the centre remembers whose it was.
    pub report: Option<MapReport>,
    /// How probable it is that `report` is of this target, 0 to 1.
    pub report_share: f64,
}

impl MapTrack {
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
        time_unix("tracks.time_unix_s", self.time_unix_s)?;
        time_unix("tracks.seen_unix_s", self.seen_unix_s)?;
        self.place.check()?;
        for speed_m_per_s in self.velocity_m_per_s {
            let believable = speed_m_per_s.abs() <= MAX_SPEED_M_PER_S;
            let expected = "a velocity within 10 km/s is expected";
            require(believable, "tracks.velocity_m_per_s", speed_m_per_s, expected)?;
        }
        for entry in self.covariance {
            finite("tracks.covariance", entry)?;
        }
        let [ee, _, _, _, nn, ..] = self.covariance;
        let good = self.covariance_matrix().cholesky().is_some()
            && [ee, nn].iter().all(|variance| variance.sqrt() <= MAX_SIGMA_M);
        let expected = "a positive definite covariance of at most 1000 km is expected";
        require(good, "tracks.covariance", self.covariance, expected)?;
        share("tracks.report_share", self.report_share)
    }
}

/// What the centre has done with dwells so far in this life.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct MapCounts {
    /// Dwells that the tracker took.
    pub dwell_count: u64,
    /// Reports in them.
    pub report_count: u64,
    /// Dwells that came after later ones were taken.
    pub late_count: u64,
    /// Dwells that came twice.
    pub duplicate_count: u64,
    /// Messages that were refused, and dwells or reports that the tracker could not use.
    pub refused_count: u64,
    /// Tracks that are not in the message: tentative ones, and those beyond its limit.
    pub hidden_count: u64,
}

/// Every target that is followed on the map.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MapTracks {
    /// The time of the newest dwell that was taken, Unix seconds.
    pub time_unix_s: f64,
    /// All sensors that contributed are simulated.
    pub is_simulated: bool,
    /// What was done so far.
    pub counts: MapCounts,
    /// The tracks, in ascending order of id, possibly none.
    pub tracks: Vec<MapTrack>,
}

impl MapTracks {
    /// Most tracks that one message may have.
    pub const MAX_TRACK_COUNT: usize = MAX_TRACK_COUNT;
}

impl Message for MapTracks {
    const KIND: Kind = Kind::MapTracks;
    const SCHEMA: u16 = 1;
    const MAX_BYTES: usize = 1 << 20;

    fn check(&self) -> Result<(), Invalid> {
        time_unix("time_unix_s", self.time_unix_s)?;
        at_most("tracks", self.tracks.len(), MAX_TRACK_COUNT)?;
        let fallen = self.tracks.windows(2).find(|pair| pair[1].id <= pair[0].id);
        if let Some([first, second]) = fallen {
            let ids = [first.id, second.id];
            return require(false, "tracks.id", ids, "ascending ids are expected");
        }
        self.tracks.iter().try_for_each(MapTrack::check)
    }
}
