//! What a horizontal covariance looks like on a map: an ellipse, a circle.

use nalgebra::Vector2;
use proto::geodesy::{EnuFrame, GeoPosition};
use proto::geom::principal_axes;
use serde::{Deserialize, Serialize};

use super::{ExportError, GeoTrack};

/// The share of the probability that ellipses on maps hold.
pub const ELLIPSE_SHARE: f64 = 0.95;
/// Corners of a drawn ellipse: a chord leaves the curve by 0.1 % of the axis.
const CORNER_COUNT: u32 = 64;
/// Nodes of the quadrature over the angle; a periodic integrand, so more bring nothing.
const ANGLE_COUNT: u32 = 256;
/// Halvings of an interval that begins at 3.7 sigma or less.
const BISECTION_COUNT: usize = 60;

/// What is meant by the radius of a circle of error.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum CircularError {
    /// One standard deviation along the axis where it is largest.
    Sigma,
    /// The circle around the estimate that holds this share of the probability, in (0, 1).
    Share(f64),
}

impl CircularError {
    /// The radius for a track's covariance, metres.
    ///
    /// # Errors
    /// If the share is no probability strictly between 0 and 1.
    pub fn radius_m(self, track: &GeoTrack) -> Result<f64, ExportError> {
        let (major_m, minor_m, _) = principal_axes(&track.covariance_m2);
        match self {
            Self::Sigma => Ok(major_m),
            Self::Share(share) if 0.0 < share && share < 1.0 => {
                Ok(radius_of_share(share, major_m, minor_m))
            }
            Self::Share(value) => {
                Err(ExportError::Setting { name: "ce share", value, range: "(0, 1)" })
            }
        }
    }
}

/// The radius r of the circle that holds a share of a Gaussian with standard deviations a ≥ b:
/// share = 1 − mean over φ of exp(−r² / (2 (a² cos² φ + b² sin² φ))). The whitened error has a
/// uniform angle φ and a Rayleigh length ρ, and the error's own length is
/// ρ √(a² cos² φ + b² sin² φ). Metres in, metres out.
fn radius_of_share(share: f64, major_m: f64, minor_m: f64) -> f64 {
    let outside = |radius_m: f64| {
        let terms = (0..ANGLE_COUNT).map(|index| {
            let angle = (f64::from(index) + 0.5) * std::f64::consts::TAU / f64::from(ANGLE_COUNT);
            let squared_m2 = (major_m * angle.cos()).powi(2) + (minor_m * angle.sin()).powi(2);
            (-0.5 * radius_m.powi(2) / squared_m2).exp()
        });
        terms.sum::<f64>() / f64::from(ANGLE_COUNT)
    };
    // A circle that is as wide as the ellipse is long holds more than the ellipse does.
    let (mut less_m, mut more_m) = (0.0, major_m * (-2.0 * (1.0 - share).ln()).sqrt());
    for _ in 0..BISECTION_COUNT {
        let middle_m = 0.5 * (less_m + more_m);
        if outside(middle_m) > 1.0 - share { less_m = middle_m } else { more_m = middle_m }
    }
    more_m
}

/// The ellipse that holds a share of a track's probability, in metres east and north of it;
/// counter-clockwise, not closed.
pub(super) fn outline_m(track: &GeoTrack, share: f64) -> Vec<Vector2<f64>> {
    let (major_m, minor_m, angle_rad) = principal_axes(&track.covariance_m2);
    // Of two dimensions: the squared length of the whitened error is exponential with mean 2.
    let factor = (-2.0 * (1.0 - share).ln()).sqrt();
    let (sin, cos) = angle_rad.sin_cos();
    let corner = |index: u32| {
        let turn = f64::from(index) * std::f64::consts::TAU / f64::from(CORNER_COUNT);
        let (along_m, across_m) = (factor * major_m * turn.cos(), factor * minor_m * turn.sin());
        Vector2::new(along_m * cos - across_m * sin, along_m * sin + across_m * cos)
    };
    (0..CORNER_COUNT).map(corner).collect()
}

/// The corners of that ellipse on the earth, at the track's height.
///
/// # Errors
/// If it leaves the earth.
pub(super) fn corners(track: &GeoTrack) -> Result<Vec<GeoPosition>, ExportError> {
    let frame = EnuFrame::new(track.position);
    let height_m = track.position.height_m();
    let place = |corner: &Vector2<f64>| frame.on_surface(corner.x, corner.y, height_m);
    let placed = outline_m(track, ELLIPSE_SHARE).iter().map(place).collect::<Result<_, _>>();
    Ok(placed?)
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix2;
    use rand::SeedableRng;
    use rand::rngs::ChaCha8Rng;
    use rand_distr::{Distribution, StandardNormal};

    use super::*;
    use crate::export::sample;

    fn with_covariance(covariance_m2: Matrix2<f64>) -> GeoTrack {
        GeoTrack { covariance_m2, ..sample::confirmed() }
    }

    #[test]
    fn circles_of_round_and_of_flat_errors_are_those_of_tables() {
        let round = with_covariance(Matrix2::identity() * 100.0);
        let flat = with_covariance(Matrix2::new(100.0, 0.0, 0.0, 0.0));
        // 50, 90 and 95 % of a Rayleigh and of a half-normal distribution.
        let cases = [(0.5, 1.177_410, 0.674_490), (0.9, 2.145_966, 1.644_854)];
        for (share, round_sigmas, flat_sigmas) in
            cases.into_iter().chain([(0.95, 2.447_747, 1.959_964)])
        {
            let radius = |track| CircularError::Share(share).radius_m(track).unwrap();
            assert!((radius(&round) - 10.0 * round_sigmas).abs() < 1e-4, "{share}");
            assert!((radius(&flat) - 10.0 * flat_sigmas).abs() < 1e-4, "{share}");
        }
        assert!((CircularError::Sigma.radius_m(&flat).unwrap() - 10.0).abs() < 1e-12);
    }

    /// 100,000 draws leave 0.1 % (one standard deviation) of a share of 90 %.
    #[test]
    fn circle_and_ellipse_hold_what_they_say_of_drawn_errors() {
        let track = with_covariance(Matrix2::new(900.0, 420.0, 420.0, 400.0));
        let root = track.covariance_m2.cholesky().unwrap().l();
        let inverse = track.covariance_m2.try_inverse().unwrap();
        let radius_m = CircularError::Share(0.9).radius_m(&track).unwrap();
        let corner = outline_m(&track, ELLIPSE_SHARE)[11];
        let limit = corner.dot(&(inverse * corner));
        let mut random = ChaCha8Rng::seed_from_u64(11);
        let mut draw = || root * Vector2::from_fn(|_, _| StandardNormal.sample(&mut random));
        let draws: Vec<Vector2<f64>> = (0..100_000).map(|_| draw()).collect();
        let share = |inside: &dyn Fn(&Vector2<f64>) -> bool| {
            draws.iter().filter(|error| inside(error)).count() as f64 / draws.len() as f64
        };
        let in_circle = share(&|error| error.norm() < radius_m);
        let in_ellipse = share(&|error| error.dot(&(inverse * error)) < limit);
        assert!((in_circle - 0.9).abs() < 0.004, "{in_circle}");
        assert!((in_ellipse - 0.95).abs() < 0.003, "{in_ellipse}");
    }

    /// Every corner lies at the same Mahalanobis distance, and they turn counter-clockwise.
    #[test]
    fn the_outline_is_the_covariances_own() {
        let track = with_covariance(Matrix2::new(900.0, -420.0, -420.0, 400.0));
        let inverse = track.covariance_m2.try_inverse().unwrap();
        let outline = outline_m(&track, ELLIPSE_SHARE);
        let limit = -2.0 * (1.0 - ELLIPSE_SHARE).ln();
        assert!(outline.iter().all(|at| (at.dot(&(inverse * at)) - limit).abs() < 1e-9));
        let next = outline.iter().skip(1);
        assert!(outline.iter().zip(next).all(|(a, b)| a.x * b.y - a.y * b.x > 0.0));
        let frame = EnuFrame::new(track.position);
        for (corner, place) in outline.iter().zip(corners(&track).unwrap()) {
            let found = frame.to_enu(&place);
            assert!((found.east_m - corner.x).hypot(found.north_m - corner.y) < 1e-3);
        }
    }

    #[test]
    fn a_share_that_is_no_probability_is_refused() {
        for share in [0.0, 1.0, -0.5, 90.0, f64::NAN] {
            let error = CircularError::Share(share).radius_m(&sample::confirmed()).unwrap_err();
            assert!(matches!(error, ExportError::Setting { .. }), "{error}");
        }
    }

    #[test]
    fn no_error_is_a_point() {
        let exact = with_covariance(Matrix2::zeros());
        let radius_m = CircularError::Share(0.9).radius_m(&exact).unwrap();
        assert!(radius_m.abs() < 1e-12, "{radius_m}");
    }
}
