//! Sweeps of a scene that is known.

use proto::geom::Se2;
use serde::{Deserialize, Serialize};

use super::{Frame, SourceError, SweepSource};
use crate::imaging::invalid;
use crate::simulate::{Disturbance, EchoSimulator, Radar, Scene, Truth};

/// The node is shoved: from `at_s` on it stands elsewhere.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Move {
    /// When, seconds of the scene.
    pub at_s: f64,
    /// By how much, in the world's frame, metres.
    pub dx_m: f64,
    /// By how much, in the world's frame, metres.
    pub dy_m: f64,
    /// By how much it is turned on the spot, degrees counter-clockwise.
    pub turn_deg: f64,
}

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
    /// Moves of the node on the way, ascending in time.
    pub moves: Vec<Move>,
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
            moves: Vec::new(),
            disturbance: Disturbance::default(),
            scene: Scene::default(),
        }
    }
}

impl SimulatedConfig {
    /// `x_m`, `y_m`, `heading_deg` of every place that the node has, and from when on it is there.
    fn places(&self) -> Result<Vec<(f64, [f64; 3])>, SourceError> {
        let mut place = [self.x_m, self.y_m, self.heading_deg];
        let mut places = vec![(f64::NEG_INFINITY, place)];
        for (index, shove) in self.moves.iter().enumerate() {
            let Move { at_s, dx_m, dy_m, turn_deg } = *shove;
            let is_later = places.last().is_some_and(|(before_s, _)| *before_s < at_s);
            if !is_later || ![at_s, dx_m, dy_m, turn_deg].iter().all(|value| value.is_finite()) {
                let field = format!("moves[{index}]");
                return Err(invalid(field, shove, "use finite numbers and ascending times").into());
            }
            place = [place[0] + dx_m, place[1] + dy_m, place[2] + turn_deg];
            places.push((at_s, place));
        }
        Ok(places)
    }
}

/// The simulated source.
#[derive(Debug)]
pub struct Simulated {
    /// The node at each of its places, and from when on it is there.
    simulators: Vec<(f64, EchoSimulator)>,
    config: SimulatedConfig,
}

impl Simulated {
    /// A node of `radar` in its scene.
    ///
    /// # Errors
    /// Names the first setting that makes no sense.
    pub fn new(config: &SimulatedConfig, radar: &Radar) -> Result<Self, SourceError> {
        let SimulatedConfig { scene, disturbance, seed, .. } = config;
        let simulator = |(from_s, [x_m, y_m, heading_deg]): (f64, [f64; 3])| {
            let pose_world_from_node = Se2::new(x_m, y_m, heading_deg.to_radians());
            let made = EchoSimulator::new(scene, pose_world_from_node, radar, disturbance, *seed)?;
            Ok((from_s, made))
        };
        let places = config.places()?.into_iter().map(simulator);
        let simulators = places.collect::<Result<_, SourceError>>()?;
        Ok(Self { simulators, config: config.clone() })
    }

    /// The node where it is at `time_s`.
    fn at(&self, time_s: f64) -> &EchoSimulator {
        let later = self.simulators.partition_point(|(from_s, _)| *from_s <= time_s);
        &self.simulators[later.saturating_sub(1)].1
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
        let time_s = self.time_s(period);
        Some(self.at(time_s).truth(period, time_s))
    }

    fn frame(&mut self, period: u64) -> Result<Frame, SourceError> {
        let time_s = self.time_s(period);
        Ok(Frame::Sweep(self.at(time_s).sweep(period, time_s)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn config(moves: Vec<Move>) -> SimulatedConfig {
        let way_points = vec![crate::simulate::WayPoint { time_s: 0.0, x_m: 1.0, y_m: 4.0 }];
        let kind = crate::simulate::TargetKind::Point;
        let target = crate::simulate::Target { way_points, kind, amplitude_db: 0.0 };
        let scene = Scene { targets: vec![target], ..Scene::default() };
        SimulatedConfig { moves, scene, period_s: 1.0, ..SimulatedConfig::default() }
    }

    #[test]
    fn a_moved_node_sees_what_stands_elsewhere() {
        let shove = |at_s, turn_deg| Move { at_s, dx_m: 0.5, dy_m: -1.0, turn_deg };
        let config = config(vec![shove(2.0, 90.0), shove(4.5, 0.0)]);
        let source = Simulated::new(&config, &Radar::default()).unwrap();
        // By hand: from (0.5, -1) the target is at (0.5, 5); turned by 90 degrees that is (5, -0.5).
        // From (1, -2) it is at (0, 6), turned (6, 0).
        for (period, x_m, y_m) in [(0, 1.0, 4.0), (1, 1.0, 4.0), (2, 5.0, -0.5), (5, 6.0, 0.0)] {
            let at = source.truth(period).unwrap().targets_in_node[0];
            let off_m = (at.x_m() - x_m).abs().max((at.y_m() - y_m).abs());
            assert!(off_m < 1e-9, "{period}: {at:?}");
        }
    }

    #[test]
    fn moves_out_of_order_are_refused() {
        let shove = |at_s| Move { at_s, dx_m: 0.1, dy_m: 0.0, turn_deg: 0.0 };
        for moves in [vec![shove(2.0), shove(1.0)], vec![shove(f64::NAN)]] {
            let refused = Simulated::new(&config(moves), &Radar::default()).unwrap_err();
            assert!(refused.to_string().contains("moves["), "{refused}");
        }
    }
}
