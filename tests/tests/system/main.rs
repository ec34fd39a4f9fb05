//! Whole-system tests: real processes on loopback, one file per promise.
//!
//! One test binary, because each one that links the network takes its own half minute to build.

mod agent_dies;
mod centre_dies;
mod configuration;
mod garbage;
mod main_job;
mod nothing_left_behind;
mod support;
