//! Points and Gaussians of the plane in a named kind of frame.

use std::marker::PhantomData;

use nalgebra::{Matrix2, Vector2};

use super::Frame;

/// A point in frame `F`, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point<F: Frame> {
    /// Coordinates `[x, y]` in metres.
    pub coords_m: Vector2<f64>,
    frame: PhantomData<F>,
}

impl<F: Frame> Point<F> {
    /// The point at `(x_m, y_m)`.
    #[must_use]
    pub fn new(x_m: f64, y_m: f64) -> Self {
        Self::from_coords(Vector2::new(x_m, y_m))
    }

    /// The point with coordinates `[x, y]` in metres.
    #[must_use]
    pub fn from_coords(coords_m: Vector2<f64>) -> Self {
        Self { coords_m, frame: PhantomData }
    }

    /// First coordinate in metres.
    #[must_use]
    pub fn x_m(&self) -> f64 {
        self.coords_m.x
    }

    /// Second coordinate in metres.
    #[must_use]
    pub fn y_m(&self) -> f64 {
        self.coords_m.y
    }
}

/// A position known up to a Gaussian error: mean and covariance in frame `F`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gaussian<F: Frame> {
    /// Where the position is believed to be.
    pub mean: Point<F>,
    /// Covariance of the error in m², symmetric positive definite.
    pub cov_m2: Matrix2<f64>,
}

impl<F: Frame> Gaussian<F> {
    /// The same position in a frame with the same axes and another name, see [`super::Se2::renamed`].
    #[must_use]
    pub fn renamed<Other: Frame>(&self) -> Gaussian<Other> {
        Gaussian { mean: Point::from_coords(self.mean.coords_m), cov_m2: self.cov_m2 }
    }
}

/// Standard deviations in metres along the two principal axes, larger first, and the direction of
/// the larger one in radians counter-clockwise from `x`. `cov_m2` is symmetric.
///
/// A negative eigenvalue left by rounding counts as zero.
#[must_use]
pub fn principal_axes(cov_m2: &Matrix2<f64>) -> (f64, f64, f64) {
    let mean = 0.5 * (cov_m2[(0, 0)] + cov_m2[(1, 1)]);
    let half_difference = 0.5 * (cov_m2[(0, 0)] - cov_m2[(1, 1)]);
    let radius = half_difference.hypot(cov_m2[(0, 1)]);
    let angle_rad = 0.5 * cov_m2[(0, 1)].atan2(half_difference);
    ((mean + radius).max(0.0).sqrt(), (mean - radius).max(0.0).sqrt(), angle_rad)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn principal_axes_agree_with_an_eigendecomposition() {
        for (xx, xy, yy) in
            [(4.0, 0.0, 1.0), (1.0, 0.0, 4.0), (2.0, 1.0, 2.0), (2.0, -1.0, 3.0), (1.0, 0.0, 1.0)]
        {
            let cov = Matrix2::new(xx, xy, xy, yy);
            let eigen = cov.symmetric_eigen();
            let (major_m, minor_m, angle_rad) = principal_axes(&cov);
            assert!((major_m.powi(2) - eigen.eigenvalues.max()).abs() < 1e-12);
            assert!((minor_m.powi(2) - eigen.eigenvalues.min()).abs() < 1e-12);
            let axis = Vector2::new(angle_rad.cos(), angle_rad.sin());
            assert!((cov * axis - axis * major_m.powi(2)).norm() < 1e-12, "{xx} {xy} {yy}");
        }
    }
}
