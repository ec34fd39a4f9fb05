//! Transmural's shared vocabulary: geometry, time, identifiers, the radar, messages, keys and the bus.
//!
//! Everything that two processes must agree on lives here and nowhere else.

pub mod bus;
pub mod config;
pub mod geodesy;
pub mod geom;
pub mod ids;
pub mod keys;
pub mod measured;
pub mod pcap;
pub mod plots;
pub mod process;
pub mod radar;
pub mod refusals;
pub mod stanag4607;
pub mod time;
pub mod wire;
