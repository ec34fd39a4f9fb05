//! Sweeps of a scene that is known.

use proto::geom::Se2;
use serde::{Deserialize, Serialize};

use super::{Frame, SourceError, SweepSource};
use crate::simulate::{Disturbance, EchoSimulator, Radar, Scene, Truth};

/// A simulated scene and the node's place in it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SimulatedConfig {
    /// Where the array's centre is in the world, metres.
    pub x_m: f64,
    /// Where the array's centre is in the world, metres.
    pub y_m: f64,
    /// How far the node is turned: 0 looks along the world's `y`, counter-clockwise.
    pub heading_deg: f64,
    /// Length of a period in scene time, seconds.
    pub period_s: f64,
    /// Scene time of the first sweep, seconds.
    pub first_s: f64,
    /// Number of periods; without end if left out.
    pub period_count: Option<u64>,
    /// Seed of everything random; give every node its own.
    pub seed: u64,
    /// Noise, missed and false targets.
    pub disturbance: Disturbance,
    /// What is there to be seen.
    pub scene: Scene,
}

impl Default for SimulatedConfig {
    fn default() -> Self {
        Self {
            x_m: 0.0,
            y_m: 0.0,
            heading_deg: 0.0,
            period_s: 0.1,
            first_s: 0.0,
            period_count: None,
            seed: 1,
            disturbance: Disturbance::default(),
            scene: Scene::default(),
        }
    }
}

/// The simulated source.
#[derive(Debug)]
pub struct Simulated {
    simulator: EchoSimulator,
    config: SimulatedConfig,
}

impl Simulated {
    /// A node of `radar` in its scene.
    ///
    /// # Errors
    /// Names the first setting that makes no sense.
    pub fn new(config: &SimulatedConfig, radar: &Radar) -> Result<Self, SourceError> {
        let SimulatedConfig { x_m, y_m, heading_deg, scene, disturbance, seed, .. } = config;
        let pose_world_from_node = Se2::new(*x_m, *y_m, heading_deg.to_radians());
        let simulator = EchoSimulator::new(scene, pose_world_from_node, radar, disturbance, *seed)?;
        Ok(Self { simulator, config: config.clone() })
    }

    /// When a period is, in the scene's time.
    fn time_s(&self, period: u64) -> f64 {
        self.config.first_s + self.middle_s(period)
    }
}

impl SweepSource for Simulated {
    fn period_count(&self) -> Option<u64> {
        self.config.period_count
    }

    fn middle_s(&self, period: u64) -> f64 {
        self.config.period_s * period as f64
    }

    fn truth(&self, period: u64) -> Option<Truth> {
        Some(self.simulator.truth(period, self.time_s(period)))
    }

    fn frame(&mut self, period: u64) -> Result<Frame, SourceError> {
        Ok(Frame::Sweep(self.simulator.sweep(period, self.time_s(period))))
    }
}
