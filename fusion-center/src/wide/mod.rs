//! Between a wide-area radar's dwells and looks in a local plane, and back from tracks to the earth.
//!
//! ```text
//! Dwell ───── LocalFrame ─┬► OwnedLook ─► Tracker ─► Track ─ LocalFrame ─► PlacedTrack
//! LocalScan ──────────────┘
//! ```
//!
//! The plane touches the earth where the first dwell looked; places keep their height beside it. 100 km
//! from there lengths are wrong by 1 in 8000 and north by half a degree, both of which the way back
//! undoes. What is more than 2,000 km away is not followed: see [`MAX_REACH_M`].

mod config;
mod doppler;
mod frame;
mod local;
mod look;
mod sighting;
#[cfg(test)]
mod tests;

pub use config::{InvalidWide, RadialConvention, WideConfig};
pub use doppler::{DopplerSign, SignWatch, Verdict};
pub use frame::{LocalFrame, MAX_REACH_M, PlacedTrack};
pub use local::local_look;
pub use look::{LookName, OwnedLook, own_look};
