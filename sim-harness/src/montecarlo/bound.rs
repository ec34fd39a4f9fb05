//! The Cramér-Rao bound of simulated echoes: of one point, of a node's pose, and the errors that
//! an efficient estimator would make.
//!
//! A point of amplitude `A` at `p` gives channel `c` the samples
//! `A exp(−j 2π f τ_c(p))`, `τ_c = (|p − t_c| + |p − r_c|) / c0`, in circular white noise of power
//! `v` per sample. With `g = 2π f ∇τ_c` in rad/m over all `N` samples and an unknown complex
//! amplitude that all samples share, the information about `p` is
//! `(2 A² / v) (Σ g gᵀ − Σ g Σ gᵀ / N)` in 1/m². Assumes that the other points are known: two that
//! merge are less precise, so that the bound is a lower one.

use std::f64::consts::TAU;

use nalgebra::{Cholesky, Matrix2, Matrix3, Vector2, Vector3};
use node_agent::config::AgentConfig;
use node_agent::simulate::{AmplitudeLaw, Noise, Scene, TargetKind};
use proto::geom::{Frame, Gaussian, Point};
use proto::radar::{Array, Band, SPEED_OF_LIGHT_M_PER_S};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;

use super::score::PoseError;

/// How precisely a radar can measure where a point is.
#[derive(Clone, Debug)]
pub(super) struct PointBound {
    array: Array,
    /// `A² / v` of one sample.
    snr: f64,
    /// Number of frequencies, sum and sum of squares of the angular ones, rad/s.
    frequency_count: f64,
    sum_rad_per_s: f64,
    square_sum: f64,
}

impl PointBound {
    /// For points of amplitude 1 in noise of `noise_power` per frequency sample.
    pub(super) fn new(band: &Band, array: &Array, noise_power: f64) -> Self {
        let turns = || (0..band.step_count).map(|index| TAU * band.frequency_hz(index));
        Self {
            array: array.clone(),
            snr: 1.0 / noise_power,
            frequency_count: band.step_count as f64,
            sum_rad_per_s: turns().sum(),
            square_sum: turns().map(|turn| turn * turn).sum(),
        }
    }

    /// For an agent's simulated radar; `None` where the scene is not one of equal points in the
    /// open, or without noise: for people, walls and ghosts no bound is known.
    pub(super) fn of_agent(agent: &AgentConfig) -> Option<Self> {
        let Scene { targets, wall, reflectors, amplitude_law, .. } = &agent.simulated.scene;
        let is_plain = |target: &node_agent::simulate::Target| {
            target.kind == TargetKind::Point && target.amplitude_db.abs() <= f64::EPSILON
        };
        let noise = &agent.simulated.disturbance.noise;
        let is_open = wall.is_none() && reflectors.is_empty();
        let is_known = is_open && *amplitude_law == AmplitudeLaw::Equal && *noise != Noise::None;
        let (band, array) = (&agent.chain.band, &agent.chain.array);
        let noise_power = noise.power_per_frequency(1.0, band.step_count);
        let is_bounded = is_known && targets.iter().all(is_plain);
        is_bounded.then(|| Self::new(band, array, noise_power))
    }

    /// The information about the place `place_m`, 1/m².
    fn information(&self, place_m: &Vector2<f64>) -> Matrix2<f64> {
        let towards = |antenna: &[f64; 2]| (place_m - Vector2::from(*antenna)).normalize();
        let Array { tx_m, rx_m } = &self.array;
        let slopes = tx_m.iter().flat_map(|tx| {
            rx_m.iter().map(move |rx| (towards(tx) + towards(rx)) / SPEED_OF_LIGHT_M_PER_S)
        });
        let mut squares = Matrix2::zeros();
        let mut sum = Vector2::zeros();
        let mut channel_count = 0.0;
        for slope in slopes {
            squares += slope * slope.transpose();
            sum += slope;
            channel_count += 1.0;
        }
        let sample_count = channel_count * self.frequency_count;
        let mean_part = sum * sum.transpose() * (self.sum_rad_per_s.powi(2) / sample_count);
        (squares * self.square_sum - mean_part) * (2.0 * self.snr)
    }

    /// The best measurement of a point, its mean at the point itself.
    pub(super) fn measured<F: Frame>(&self, place: Point<F>) -> Option<Gaussian<F>> {
        let cov_m2 = self.information(&place.coords_m).try_inverse()?;
        Some(Gaussian { mean: place, cov_m2 })
    }
}

/// Errors that an efficient estimator of a pose with this covariance would make.
pub(super) fn efficient_errors(
    covariance: &Matrix3<f64>,
    seed: u64,
    draw_count: usize,
) -> Vec<PoseError> {
    let Some(factor) = Cholesky::new(*covariance) else { return Vec::new() };
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut draw = || {
        let normal = Vector3::from_fn(|_, _| rng.sample::<f64, _>(StandardNormal));
        PoseError::of(&(factor.l() * normal))
    };
    (0..draw_count).map(|_| draw()).collect()
}

#[cfg(test)]
mod tests {
    use proto::geom::Node;

    use super::*;

    /// The specification's figures for 8 dB in the band hold the last digit that they state.
    const STATED_RANGE_M: (f64, f64) = (0.014, 0.0005);
    const STATED_ANGLE_RAD: (f64, f64) = (0.0145, 0.000_05);

    fn physical() -> PointBound {
        let band = Band::default();
        let noise = Noise::InBand { snr_db: 8.0 };
        let noise_power = noise.power_per_frequency(1.0, band.step_count);
        PointBound::new(&band, &Array::default(), noise_power)
    }

    #[test]
    fn the_bound_of_a_point_is_the_specified_one() {
        let range_m = 6.0;
        let cov = physical().measured(Point::<Node>::new(0.0, range_m)).unwrap().cov_m2;
        let (along_m, across_rad) = (cov[(1, 1)].sqrt(), cov[(0, 0)].sqrt() / range_m);
        assert!((along_m - STATED_RANGE_M.0).abs() < STATED_RANGE_M.1, "{along_m}");
        assert!((across_rad - STATED_ANGLE_RAD.0).abs() < STATED_ANGLE_RAD.1, "{across_rad}");
    }

    /// The information from samples written out one by one: numeric derivatives of every sample by
    /// place and by the amplitude's two parts, then the block of the place in the full inverse.
    #[test]
    fn the_closed_form_is_that_of_the_samples_themselves() {
        let (band, array) = (Band { step_count: 23, ..Band::default() }, Array::default());
        let noise_power = 0.7;
        let place_m = [1.7, 3.1];
        let channels: Vec<_> =
            array.tx_m.iter().flat_map(|tx| array.rx_m.iter().map(move |rx| [tx, rx])).collect();
        let samples = |p: [f64; 2], re: f64, im: f64| {
            let leg = |a: &[f64; 2]| (p[0] - a[0]).hypot(p[1] - a[1]);
            let sample = |[tx, rx]: &[&[f64; 2]; 2], index: usize| {
                let delay_s = (leg(tx) + leg(rx)) / 299_792_458.0;
                let (sin, cos) = (-TAU * band.frequency_hz(index) * delay_s).sin_cos();
                [re * cos - im * sin, re * sin + im * cos]
            };
            let frequencies = || 0..band.step_count;
            let all = channels.iter().flat_map(|c| frequencies().flat_map(move |k| sample(c, k)));
            all.collect::<Vec<f64>>()
        };
        let step = 1e-5;
        let at = |d: [f64; 4]| samples([place_m[0] + d[0], place_m[1] + d[1]], 1.0 + d[2], d[3]);
        let derivative = |index: usize| -> Vec<f64> {
            let mut ahead = [0.0; 4];
            ahead[index] = step;
            let pairs = at(ahead).into_iter().zip(at(ahead.map(|d| -d)));
            pairs.map(|(a, b)| (a - b) / (2.0 * step)).collect()
        };
        let all: Vec<Vec<f64>> = (0..4).map(derivative).collect();
        let full = nalgebra::Matrix4::from_fn(|i, j| {
            let products = all[i].iter().zip(&all[j]).map(|(a, b)| a * b);
            products.sum::<f64>() * 2.0 / noise_power
        });
        let expected = full.try_inverse().unwrap().fixed_view::<2, 2>(0, 0).into_owned();
        let bound = PointBound::new(&band, &array, noise_power);
        let got = bound.measured(Point::<Node>::new(place_m[0], place_m[1])).unwrap().cov_m2;
        assert!((got - expected).norm() < 1e-4 * expected.norm(), "{got} {expected}");
    }

    #[test]
    fn efficient_errors_have_the_covariance() {
        let covariance = Matrix3::new(4e-4, 1e-4, 0.0, 1e-4, 9e-4, 0.0, 0.0, 0.0, 1e-4);
        let errors = efficient_errors(&covariance, 3, 20_000);
        let mean =
            |of: fn(&PoseError) -> f64| errors.iter().map(of).sum::<f64>() / errors.len() as f64;
        // Relative error of a mean square of 20 000 draws: 1 %; bound at four times that.
        assert!((mean(|e| e.position_m.powi(2)) / 13e-4 - 1.0).abs() < 0.04);
        assert!((mean(|e| e.angle_deg.to_radians().powi(2)) / 1e-4 - 1.0).abs() < 0.04);
        assert!(efficient_errors(&-covariance, 3, 5).is_empty());
    }

    #[test]
    fn only_equal_points_in_the_open_have_a_bound() {
        let mut agent = AgentConfig::default();
        agent.simulated.disturbance.noise = Noise::InBand { snr_db: 8.0 };
        assert!(PointBound::of_agent(&agent).is_some());
        let without = |change: fn(&mut AgentConfig)| {
            let mut changed = agent.clone();
            change(&mut changed);
            PointBound::of_agent(&changed).is_none()
        };
        assert!(without(|a| a.simulated.disturbance.noise = Noise::None));
        assert!(without(|a| a.simulated.scene.amplitude_law = AmplitudeLaw::InverseSquare));
        let wall = |a: &mut AgentConfig| {
            a.simulated.scene.wall =
                Some(proto::radar::Wall { thickness_m: 0.2, permittivity: 4.0 });
        };
        assert!(without(wall));
    }
}
