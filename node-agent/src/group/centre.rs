//! From the detections of one body to its measured point.
//!
//! The centre `c` is the smoothed geometric median, which a swinging arm or a reflection among
//! the members hardly moves: it minimises `Σ sqrt(|q_i − c|² + ε²)` over the positions `q_i`, by
//! reweighted means `c ← Σ w_i q_i / Σ w_i`, `w_i = 1 / sqrt(|q_i − c|² + ε²)` (Weiszfeld 1937).
//! `ε` keeps the weight finite where the centre meets a member.
//!
//! Its covariance, with `u` along and `v` across the line of sight at range `r`, is
//! `σ_r² u uᵀ + (σ_c² + (σ_θ r)²) v vᵀ + E/n`: what the body and the radar leave however many
//! detections there are, and the mean's share of the second moment `E` of `n` detections. That
//! the detections are independent is not true, and the first two terms make up for it.

use nalgebra::{Matrix2, Vector2};
use proto::measured::{MeasuredPoint, packed};

use super::config::GroupConfig;
use crate::source::recorded::Detection;

/// Smoothing of the geometric median: about the resolution of range of the recordings' radars.
const SMOOTHING_M: f64 = 0.05;
/// Steps of at most this length end the search: a hundredth of the centre's error.
const STEP_TOLERANCE_M: f64 = 1e-4;
/// The search more than halves its error with each step; a bound for the exceptions.
const MAX_STEP_COUNT: usize = 100;

/// The measured point of `body`, one detection or more.
pub(super) fn measured_point(body: &[&Detection], config: &GroupConfig) -> MeasuredPoint {
    let positions_m: Vec<Vector2<f64>> = body.iter().map(|d| Vector2::new(d.x_m, d.y_m)).collect();
    let centre_m = geometric_median(&positions_m);
    let extent_m2 = second_moment(&positions_m);
    let cov_m2 = residual_covariance(centre_m, config) + extent_m2 / body.len() as f64;
    let strongest_db = body.iter().filter_map(|d| d.snr_db).reduce(f64::max);
    MeasuredPoint {
        x_m: centre_m.x,
        y_m: centre_m.y,
        cov_m2: packed(&cov_m2),
        snr_db: strongest_db.unwrap_or(config.unstated_snr_db),
        extent_m2: packed(&extent_m2),
        radial_velocity_m_per_s: median(body.iter().filter_map(|d| d.v_m_per_s).collect()),
    }
}

fn mean(positions_m: &[Vector2<f64>]) -> Vector2<f64> {
    positions_m.iter().sum::<Vector2<f64>>() / positions_m.len() as f64
}

fn geometric_median(positions_m: &[Vector2<f64>]) -> Vector2<f64> {
    let mut centre_m = mean(positions_m);
    for _ in 0..MAX_STEP_COUNT {
        let weight = |p: &Vector2<f64>| 1.0 / (p - centre_m).norm().hypot(SMOOTHING_M);
        let weighted: Vector2<f64> = positions_m.iter().map(|p| p * weight(p)).sum();
        let next_m = weighted / positions_m.iter().map(weight).sum::<f64>();
        let step_m = (next_m - centre_m).norm();
        centre_m = next_m;
        if step_m < STEP_TOLERANCE_M {
            break;
        }
    }
    centre_m
}

/// About the mean, not the median: so an outlier shows as extent.
fn second_moment(positions_m: &[Vector2<f64>]) -> Matrix2<f64> {
    let mean_m = mean(positions_m);
    let squares = positions_m.iter().map(|p| (p - mean_m) * (p - mean_m).transpose());
    squares.sum::<Matrix2<f64>>() / positions_m.len() as f64
}

fn residual_covariance(centre_m: Vector2<f64>, config: &GroupConfig) -> Matrix2<f64> {
    let range_m = centre_m.norm();
    // At the node itself there is no line of sight; boresight stands in for it.
    let along = if f64::EPSILON < range_m { centre_m / range_m } else { Vector2::y() };
    let across = Vector2::new(-along.y, along.x);
    let cross_m = config.sigma_cross_m.hypot(config.sigma_bearing_rad * range_m);
    along * along.transpose() * config.sigma_range_m.powi(2)
        + across * across.transpose() * cross_m.powi(2)
}

/// The middle value, or the mean of the two middle ones; none of none.
fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let upper = values.get(values.len() / 2)?;
    let lower = values.get((values.len() - 1) / 2)?;
    Some(0.5 * (lower + upper))
}

#[cfg(test)]
mod tests {
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    use super::*;

    fn seen(x_m: f64, y_m: f64, v_m_per_s: Option<f64>, snr_db: Option<f64>) -> Detection {
        Detection { time_s: 0.0, x_m, y_m, z_m: None, v_m_per_s, snr_db }
    }

    fn point_of(body: &[Detection], config: &GroupConfig) -> MeasuredPoint {
        measured_point(&body.iter().collect::<Vec<_>>(), config)
    }

    /// The oracle: the cost of a centre, and a search over ever finer grids.
    fn best_centre(positions_m: &[Vector2<f64>]) -> Vector2<f64> {
        let cost = |c: &Vector2<f64>| -> f64 {
            positions_m.iter().map(|p| ((p - c).norm_squared() + 0.05 * 0.05).sqrt()).sum()
        };
        let mut best = Vector2::zeros();
        let mut pitch_m = 0.5;
        while 1e-5 < pitch_m {
            let grid =
                (-10..=10).flat_map(|i| (-10..=10).map(move |j| (f64::from(i), f64::from(j))));
            let around = grid.map(|(i, j)| best + Vector2::new(i, j) * pitch_m);
            best = around.min_by(|a, b| cost(a).total_cmp(&cost(b))).unwrap();
            pitch_m *= 0.5;
        }
        best
    }

    #[test]
    fn the_centre_minimises_the_distances_to_the_members() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        for count in [1, 2, 3, 8, 25] {
            let mut uniform = || random.random_range(-1.0..1.0);
            let positions_m: Vec<_> =
                (0..count).map(|_| Vector2::new(0.4 * uniform() + 1.0, uniform() - 2.0)).collect();
            let gap_m = (geometric_median(&positions_m) - best_centre(&positions_m)).norm();
            // Two members leave the cost flat between them, and the last steps are short.
            assert!(gap_m < 2e-3, "{count}: {gap_m} m");
        }
    }

    #[test]
    fn a_far_member_hardly_moves_the_centre_and_shows_in_the_extent() {
        let mut body: Vec<Detection> =
            [-0.1, -0.05, 0.0, 0.05, 0.1].iter().map(|x| seen(*x, 2.0, None, None)).collect();
        body.push(seen(0.0, 3.0, None, None));
        let point = point_of(&body, &GroupConfig::default());
        assert!(point.x_m.abs() < 0.01 && (point.y_m - 2.0).abs() < 0.05, "{point:?}");
        // Mean of y: 2 + 1/6; second moment: 5/6 · 1/6 = 5/36. Of x: 2 (0.01 + 0.0025)/6.
        for (got, want) in point.extent_m2.iter().zip([0.025 / 6.0, 0.0, 5.0 / 36.0]) {
            assert!((got - want).abs() < 1e-12, "{point:?}");
        }
    }

    #[test]
    fn the_covariance_follows_the_line_of_sight_and_the_number_of_detections() {
        let config = GroupConfig {
            sigma_range_m: 0.1,
            sigma_cross_m: 0.3,
            sigma_bearing_rad: 0.08,
            ..GroupConfig::default()
        };
        // At (3, 4): along is (0.6, 0.8); across at range 5 is hypot(0.3, 0.4) = 0.5.
        let [xx, xy, yy] = point_of(&[seen(3.0, 4.0, None, None); 3], &config).cov_m2;
        let expected = [0.36 * 0.01 + 0.64 * 0.25, 0.48 * (0.01 - 0.25), 0.64 * 0.01 + 0.36 * 0.25];
        for (got, want) in [xx, xy, yy].iter().zip(expected) {
            assert!((got - want).abs() < 1e-12, "{got} {want}");
        }
        // On boresight the spread along x adds its square over the count: 0.2² / 4.
        let spread = [-0.2, 0.2, -0.2, 0.2].map(|x| seen(x, 5.0, None, None));
        let wide = point_of(&spread, &config);
        assert!((wide.cov_m2[0] - (0.25 + 0.01)).abs() < 1e-9, "{wide:?}");
        assert!((wide.cov_m2[2] - 0.01).abs() < 1e-9, "{wide:?}");
    }

    #[test]
    fn strength_is_the_greatest_and_speed_the_median_of_what_is_stated() {
        let config = GroupConfig::default();
        let body = [
            seen(0.0, 2.0, Some(0.4), Some(11.0)),
            seen(0.0, 2.0, Some(-3.0), Some(24.0)),
            seen(0.0, 2.0, Some(0.5), None),
            seen(0.0, 2.0, None, Some(12.0)),
        ];
        let point = point_of(&body, &config);
        assert!((point.snr_db - 24.0).abs() < 1e-12);
        assert_eq!(point.radial_velocity_m_per_s, Some(0.4));
        let silent = point_of(&[seen(0.0, 2.0, None, None)], &config);
        assert!((silent.snr_db - config.unstated_snr_db).abs() < 1e-12);
        assert_eq!(silent.radial_velocity_m_per_s, None);
        assert_eq!(median(vec![4.0, 1.0, 2.0, 9.0]), Some(3.0));
    }
}
