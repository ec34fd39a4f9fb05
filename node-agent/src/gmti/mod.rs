//! A wide-area radar: moving targets on the ground, seen from an aircraft, dwell by dwell.

mod config;
mod played;
pub mod simulate;

pub use config::{GmtiConfig, GmtiSource};
pub use played::{Next, Played, PlayedError, taken};
