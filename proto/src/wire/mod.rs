//! The messages, by direction, and the one strict codec that turns them into bytes and back.
//!
//! A message is a fixed header of 48 bytes, written by hand so that a version mismatch can be
//! named even where the payload cannot be read, and a payload in bincode 2 with fixed-width
//! little-endian integers. Golden bytes in the tests keep the layout from drifting. Raw sweeps, which
//! drivers in other languages write, have a simpler layout of their own ([`RawSweep`]).

mod check;
mod codec;
mod command;
mod dwell;
mod header;
mod map;
mod people;
mod sweep;
mod to_agent;
mod to_centre;
mod tracks;

pub use check::Invalid;
pub use codec::{MAX_PAYLOAD_BYTES, Message, Received, Stamp, decode, encode};
pub use command::{Answer, Command, StatedPose};
pub use dwell::{Dwell, DwellArea, DwellReport, FlightRecord, GeoRecord};
pub use header::{HEADER_BYTES, Kind, Refusal};
pub use map::{MapCounts, MapReport, MapStatus, MapTrack, MapTracks};
pub use people::{PersonInPicture, PointOfPerson};
pub use sweep::{RawSweep, SWEEP_HEADER_BYTES, SweepRefusal};
pub use to_agent::{
    ClockAnswer, Evidence, FusedTarget, NodeInPicture, NodeState, Outcome, Picture, PoseRecord,
    Registration, Rival, SetsUsed, Suspicion, Transform,
};
pub use to_centre::{ClockProbe, Counters, LatencyReport, NodeStatus, PointSet, SourceState};
pub use tracks::{NodeTracks, TrackInPicture, TrackRecord, TrackStatus, packed_covariance};

#[cfg(test)]
mod map_tests;
#[cfg(test)]
mod tests;
