//! One radar node: sweeps in, measured points out.

pub mod cli;
pub mod config;
pub mod detect;
pub mod gmti;
pub mod group;
pub mod imaging;
pub mod lines;
pub mod offline;
pub mod pipeline;
pub mod plot;
pub mod recording;
pub mod service;
pub mod simulate;
pub mod source;
pub mod tracking;
