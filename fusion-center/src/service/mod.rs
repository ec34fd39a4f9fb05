//! The shell around the pipeline: the clock, the network, the workers.

mod clock;
mod map;
mod run;
mod state;

pub use clock::Clock;
pub use run::{run, serve};
