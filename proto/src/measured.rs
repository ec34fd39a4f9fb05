//! A measured point: where a node saw something, how sure it is, and how strong it was.

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use crate::geom::{Gaussian, Node, Point};

/// One detection of one period, in the node's frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeasuredPoint {
    /// Along the array, metres.
    pub x_m: f64,
    /// Along boresight, metres.
    pub y_m: f64,
    /// Covariance of the position error, `[xx, xy, yy]` in m².
    pub cov_m2: [f64; 3],
    /// Power over noise in the image (or as the recording states it), decibels of power.
    pub snr_db: f64,
    /// Second moment of what was seen, `[xx, xy, yy]` in m²: how large it looks, not how wrong it
    /// is.
    pub extent_m2: [f64; 3],
    /// Speed away from the node, where the radar measures it.
    pub radial_velocity_m_per_s: Option<f64>,
}

impl MeasuredPoint {
    /// The measured position with its error.
    #[must_use]
    pub fn position(&self) -> Gaussian<Node> {
        Gaussian { mean: Point::new(self.x_m, self.y_m), cov_m2: symmetric(self.cov_m2) }
    }

    /// The position of the target's middle: a body reflects from its near side, so the middle lies
    /// `half_depth_m` (± `half_depth_sigma_m`) farther out on the line of sight.
    #[must_use]
    pub fn middle(&self, half_depth_m: f64, half_depth_sigma_m: f64) -> Gaussian<Node> {
        let surface = self.position();
        let outward = line_of_sight(&surface.mean.coords_m);
        Gaussian {
            mean: Point::from_coords(surface.mean.coords_m + outward * half_depth_m),
            cov_m2: surface.cov_m2 + outward * outward.transpose() * half_depth_sigma_m.powi(2),
        }
    }
}

/// The unit vector from a node at the origin to `position_m`; zero at the origin itself.
#[must_use]
pub fn line_of_sight(position_m: &Vector2<f64>) -> Vector2<f64> {
    let range_m = position_m.norm();
    if range_m <= f64::EPSILON { Vector2::zeros() } else { position_m / range_m }
}

/// The matrix of `[xx, xy, yy]`.
#[must_use]
pub fn symmetric([xx, xy, yy]: [f64; 3]) -> Matrix2<f64> {
    Matrix2::new(xx, xy, xy, yy)
}

/// The three numbers `[xx, xy, yy]` of a symmetric matrix.
#[must_use]
pub fn packed(matrix: &Matrix2<f64>) -> [f64; 3] {
    [matrix[(0, 0)], 0.5 * (matrix[(0, 1)] + matrix[(1, 0)]), matrix[(1, 1)]]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_lies_behind_the_surface_and_is_less_sure_in_range_only() {
        let point = MeasuredPoint {
            x_m: 3.0,
            y_m: 4.0,
            cov_m2: [0.01, 0.0, 0.01],
            snr_db: 10.0,
            extent_m2: [0.0; 3],
            radial_velocity_m_per_s: None,
        };
        let middle = point.middle(0.5, 0.2);
        assert!((middle.mean.coords_m - Vector2::new(3.3, 4.4)).norm() < 1e-12);
        let along = Vector2::new(0.6, 0.8);
        let across = Vector2::new(-0.8, 0.6);
        assert!((along.dot(&(middle.cov_m2 * along)) - 0.05).abs() < 1e-12);
        assert!((across.dot(&(middle.cov_m2 * across)) - 0.01).abs() < 1e-12);
    }
}
