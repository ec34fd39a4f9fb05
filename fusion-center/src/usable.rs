//! Which measured points an estimator can use, and how their covariances are read.

use nalgebra::{Matrix2, Vector2};

/// Points farther out are no radar measurement; their squares would cost digits.
const MAX_COORDINATE_M: f64 = 1e5;

/// Smallest determinant of a usable covariance, m⁴: (0.1 mm)⁴. Below it weights would overflow.
const MIN_DETERMINANT_M4: f64 = 1e-16;

/// The covariance, m², made symmetric; `None` where the place is not finite or far out, or the
/// covariance is not positive definite or too wide.
pub(crate) fn usable_cov_m2(place_m: &Vector2<f64>, cov_m2: &Matrix2<f64>) -> Option<Matrix2<f64>> {
    let xy = 0.5 * (cov_m2[(0, 1)] + cov_m2[(1, 0)]);
    let (xx, yy) = (cov_m2[(0, 0)], cov_m2[(1, 1)]);
    let is_near = place_m.x.abs() < MAX_COORDINATE_M && place_m.y.abs() < MAX_COORDINATE_M;
    let is_definite = xx > 0.0 && xx * yy - xy * xy > MIN_DETERMINANT_M4;
    let is_bounded = xx + yy < MAX_COORDINATE_M;
    (is_near && is_definite && is_bounded).then(|| Matrix2::new(xx, xy, xy, yy))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_unusable_point_is_left_out() {
        let (place, cov) = (Vector2::new(1.0, 2.0), Matrix2::new(0.04, 0.02, 0.0, 0.09));
        let expected = Matrix2::new(0.04, 0.01, 0.01, 0.09);
        assert!((usable_cov_m2(&place, &cov).unwrap() - expected).amax() < 1e-15);
        for place_m in [[f64::NAN, 0.0], [0.0, f64::INFINITY], [0.0, -1e6], [1e5, 0.0]] {
            assert_eq!(usable_cov_m2(&place_m.into(), &cov), None, "{place_m:?}");
        }
        let covs = [
            [0.04, f64::NAN, 0.0, 0.09],
            [-0.04, 0.0, 0.0, -0.09],
            [0.04, 0.06, 0.06, 0.09],
            [1e-9, 0.0, 0.0, 1e-9],
            [9e4, 0.0, 0.0, 9e4],
            [f64::INFINITY, 0.0, 0.0, 1.0],
        ];
        for [xx, xy, yx, yy] in covs {
            assert_eq!(usable_cov_m2(&place, &Matrix2::new(xx, xy, yx, yy)), None, "{xx} {xy}");
        }
    }
}
