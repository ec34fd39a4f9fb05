//! Targets of wide-area radars on the map: dwells of all sensors in order, followed, told.
//!
//! ```text
//! dwell ── check ── Reorder ── Follower: plane, look, tracker ── MapTracks ── publish, outputs
//! ```

mod centre;
mod follower;
mod geo;
mod ground;
mod messages;
mod output;
pub mod reorder;
mod settings;
#[cfg(test)]
mod tests;

pub use centre::{MapCentre, MapEffect, MapEvent, Shown};
pub(crate) use centre::{leapt, unplaced};
pub(crate) use follower::node_of;
pub use follower::{FollowError, Follower, Source, map_status};
pub use geo::{Past, fix, geo_track};
pub use ground::Ground;
pub use messages::Messages;
pub use output::{OutputConfig, udp_address};
pub use settings::MapConfig;
