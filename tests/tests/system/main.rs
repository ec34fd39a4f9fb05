//! Whole-system tests: real processes on loopback, one file per promise.
//!
//! One test binary, because each one that links the network takes its own half minute to build.

#![expect(
    clippy::unwrap_used,
    clippy::panic,
    clippy::disallowed_methods,
    reason = "a test's helpers fail as tests do, and deadlines of real processes are real time"
)]

mod agent_dies;
mod centre_dies;
mod configuration;
mod garbage;
mod main_job;
mod moved_node;
mod nothing_left_behind;
mod recordings;
mod register;
mod support;
mod tracks;
mod wide_area;
