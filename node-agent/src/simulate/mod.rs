//! A scene that is known, and the sweeps a node would take of it.

pub mod echoes;
pub mod noise;
pub mod scene;

pub use echoes::{EchoSimulator, Radar};
pub use noise::{Disturbance, Noise};
pub use scene::{AmplitudeLaw, Clutter, Scene, Target, TargetKind, WayPoint};
