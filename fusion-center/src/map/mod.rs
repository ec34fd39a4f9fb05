//! Targets of wide-area radars on the map: dwells of all sensors in order, followed, told.
//!
//! ```text
//! dwell ── check ── Reorder ── Follower: plane, look, tracker ── MapTracks ── publish, outputs
//! ```

mod follower;
mod ground;
mod looks;
pub mod mode;
mod output;
pub mod reorder;
mod settings;
#[cfg(test)]
mod tests;

pub use follower::{FollowError, Follower, Source, map_status};
pub use ground::{GeoState, Ground};
pub use output::{OutputConfig, udp_address};
pub use settings::{AssumedConfig, RadialSign, WideConfig};
