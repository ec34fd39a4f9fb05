//! Launches a distributed scenario on localhost, every agent and the centre a process of its own,
//! and scores what comes out.

pub mod cli;
mod draw;
mod launch;
pub mod metrics;
mod montecarlo;
pub mod moves;
mod observe;
mod plan;
mod progress;
mod rehearsal;
mod report;
mod resources;
mod run;
pub mod scenario;
mod score;
mod wide_run;
