//! The fusion centre: point sets of many nodes in, their poses and one picture out.

pub mod cli;
pub mod config;
pub mod export;
pub mod fuse;
pub mod gather;
pub mod map;
pub mod network;
pub mod offline;
pub mod pipeline;
pub mod registration;
mod replace;
pub mod service;
pub mod simulate;
pub mod simulate_site;
mod statistics;
pub mod tracking;
mod usable;
pub mod wide;
