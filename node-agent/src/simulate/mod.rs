//! A scene that is known, and the sweeps a node would take of it.

pub mod body;
pub mod coupling;
pub mod echoes;
pub mod mirrors;
pub mod noise;
pub mod presets;
pub mod receiver;
pub mod scene;
pub mod slab;
pub mod truth;

mod fading;
mod spectra;
mod steady;
mod streams;
mod way;

#[cfg(test)]
mod levels;
#[cfg(test)]
mod oracle;

pub use body::{Body, Fluctuation};
pub use coupling::Coupling;
pub use echoes::{EchoSimulator, Radar};
pub use mirrors::{Reflector, Shadow};
pub use noise::{Disturbance, Noise};
pub use receiver::{GainDrift, PhaseNoise};
pub use scene::{AmplitudeLaw, Clutter, Scene, Target, TargetKind, WayPoint};
pub use slab::{Transmission, WallEffects};
pub use truth::{Cause, Ghost, Truth};
