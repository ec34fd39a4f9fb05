//! Scenes: where targets are, and the looks that a radar has at them.

use nalgebra::{Matrix2, Vector2, Vector3};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;

use crate::tracking::{Area, Coverage, Look, Platform, Plot, Radial};

/// A plot's truth: which target, or none.
pub(super) type Truth = Option<usize>;

/// Everything a look needs, owned.
#[derive(Clone, Debug)]
pub(super) struct Taken {
    pub(super) time_s: f64,
    pub(super) sensor_index: u32,
    pub(super) platform: Option<Platform>,
    pub(super) coverage: Coverage,
    pub(super) clutter_per_m2: f64,
    pub(super) plots: Vec<Plot>,
    pub(super) truths: Vec<Truth>,
}

impl Taken {
    pub(super) fn look(&self, index: usize) -> Look<'_> {
        Look {
            time_s: self.time_s,
            sensor_index: self.sensor_index,
            look_index: index as u64,
            platform: self.platform,
            coverage: self.coverage,
            clutter_per_m2: self.clutter_per_m2,
            plots: &self.plots,
        }
    }
}

/// A scene: looks, and the true state of each target at each.
#[derive(Clone, Debug)]
pub(super) struct Scene {
    pub(super) looks: Vec<Taken>,
    pub(super) truth: Vec<Vec<[f64; 4]>>,
}

pub(super) fn rng(seed: u64, stream: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(stream);
    rng
}

pub(super) fn normal(rng: &mut ChaCha8Rng) -> f64 {
    rng.sample(StandardNormal)
}

/// How plots are measured.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sensor {
    pub(super) position_m: Vector3<f64>,
    pub(super) variances_m2: [f64; 2],
    pub(super) sigma_radial_m_per_s: f64,
    pub(super) sigma_strength_db: f64,
}

impl Sensor {
    pub(super) fn platform(&self) -> Platform {
        let velocity_m_per_s = Vector3::new(120.0, 0.0, 0.0);
        Platform { position_m: self.position_m, velocity_m_per_s, beam_index: None }
    }

    /// A plot of a target with the state `(x, y, u, v)`.
    pub(super) fn plot(&self, state: [f64; 4], mean_db: Option<f64>, rng: &mut ChaCha8Rng) -> Plot {
        let [sx, sy] = self.variances_m2.map(f64::sqrt);
        let position_m = Vector2::new(state[0] + sx * normal(rng), state[1] + sy * normal(rng));
        let off = Vector3::new(position_m.x, position_m.y, 0.0) - self.position_m;
        let direction = off.xy() / off.norm();
        let radial = direction.x * state[2] + direction.y * state[3];
        let radial = Radial {
            velocity_m_per_s: radial + self.sigma_radial_m_per_s * normal(rng),
            sigma_m_per_s: self.sigma_radial_m_per_s,
            direction,
            wrap_m_per_s: None,
        };
        let strength_db = mean_db.map(|mean_db| mean_db + self.sigma_strength_db * normal(rng));
        let [vx, vy] = self.variances_m2;
        let covariance_m2 = Matrix2::new(vx, 0.0, 0.0, vy);
        Plot { position_m, covariance_m2, radial: Some(radial), strength_db, report_index: 0 }
    }
}

pub(super) const EVERYWHERE: Coverage = Coverage {
    area: Area::Everywhere,
    detection_probability: 1.0,
    minimum_detectable_m_per_s: None,
};

/// Shuffles plots and numbers them.
pub(super) fn shuffled(
    mut plots: Vec<(Plot, Truth)>,
    rng: &mut ChaCha8Rng,
) -> (Vec<Plot>, Vec<Truth>) {
    for last in (1..plots.len()).rev() {
        plots.swap(last, rng.random_range(0..=last));
    }
    for (index, (plot, _)) in plots.iter_mut().enumerate() {
        plot.report_index = u32::try_from(index).unwrap();
    }
    plots.into_iter().unzip()
}

/// The four targets of the specification: two parallel at 50 m, two that cross at 23 degrees; 40 scans
/// of 4 s, 50 m each. Turned by `turn_rad` about their middle, 19 km from the radar.
pub(super) fn four_targets(variance_m2: f64, turn_rad: f64, seed: u64) -> Scene {
    const SCANS: usize = 40;
    const PERIOD_S: f64 = 4.0;
    const SPEED: f64 = 12.5;
    let half = 11.5_f64.to_radians();
    // Middle of each target's way and its direction.
    let ways = [(250.0, 0.0), (300.0, 0.0), (-600.0, half), (-600.0, -half)];
    let strengths = [14.0, 17.0, 20.0, 23.0];
    let mut rng = rng(seed, 0);
    let (sin, cos) = turn_rad.sin_cos();
    let turned = |x: f64, y: f64| [cos * x - sin * y, sin * x + cos * y];
    let mut scene = Scene { looks: Vec::new(), truth: Vec::new() };
    for scan in 0..SCANS {
        let time_s = PERIOD_S * scan as f64;
        let from_middle_s = time_s - PERIOD_S * 0.5 * (SCANS - 1) as f64;
        let states: Vec<[f64; 4]> = ways
            .iter()
            .map(|(aside, angle)| {
                let [u, v] = [SPEED * angle.cos(), SPEED * angle.sin()];
                let [x, y] = turned(u * from_middle_s, aside + v * from_middle_s);
                let [u, v] = turned(u, v);
                [x, 19_000.0 + y, u, v]
            })
            .collect();
        let sensor = Sensor {
            position_m: Vector3::new(120.0 * from_middle_s, 0.0, 6000.0),
            variances_m2: [variance_m2; 2],
            sigma_radial_m_per_s: 1.0,
            sigma_strength_db: 3.0,
        };
        let plots = (0..4)
            .map(|k| (sensor.plot(states[k], Some(strengths[k]), &mut rng), Some(k)))
            .collect();
        let (plots, truths) = shuffled(plots, &mut rng);
        scene.looks.push(Taken {
            time_s,
            sensor_index: 0,
            platform: Some(sensor.platform()),
            coverage: EVERYWHERE,
            clutter_per_m2: 1e-9,
            plots,
            truths,
        });
        scene.truth.push(states);
    }
    scene
}
