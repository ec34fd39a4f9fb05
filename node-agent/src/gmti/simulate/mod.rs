//! Moving targets, the aircraft that sees them, and the dwells that it would report.
//!
//! ```text
//! preset | own targets ─ Scene ─► Way of each target ┐
//! platform, scan, noise ─────────────────────────────┴─► SimulatedGmti ─► Dwell, with truth tags
//! ```
//!
//! Everything happens in a local frame of east and north, the ground at one height above the
//! ellipsoid; places leave it as latitude and longitude.

mod config;
mod geometry;
mod radar;
mod scenes;
#[cfg(test)]
mod tests;
mod way;

pub use config::{
    BeamConfig, ClutterConfig, DetectionConfig, NoiseConfig, OriginConfig, PlaceNoise,
    PlatformConfig, Preset, ScanConfig, Scene, SimulatedGmtiConfig, TargetConfig,
};
pub use geometry::{Carrier, Side, Sight, wrapped};
pub use radar::{SimulatedGmti, SimulationError, TruthState};
pub use scenes::{Layout, four_targets, load, three_targets};
pub use way::{Motion, Way, WayPoint};
