//! How much larger a blob is than that of one body: two people in one blob make it wide.
//!
//! The blob of one body has the spread of the radar's response, whatever its SNR: standard
//! deviations of `0.66 ρ` in range and `0.31 υ` in the sine, `ρ = c / (4π β)` in metres and
//! `υ = 1 / (2 k σ_x)` ([`Precision`]); 95 of 100 lie below `q = 0.80 ρ (1 + 0.3 / sqrt(SNR))` and
//! `0.32 υ (1 + 0.8 / sqrt(SNR))`. Of two bodies `d` apart with the shares `p` and `1 − p` of the
//! power, the blob has a variance of `p (1 − p) d²` more and its centroid is off the nearer body by
//! `min(p, 1 − p) d`: what a variance `s²` exceeds `q²` by is the variance of an error, times a
//! factor for what the region's edge cuts away.
//! Assumes that a resolution cell is larger than a body. Fitted on walkers alone and pairs 0.7 m to
//! 1.0 m apart.

use nalgebra::{Matrix2, Vector2};

use super::Precision;
use super::moments::{Blob, cartesian_from_polar};

/// Largest standard deviation of one body's blob at high SNR over the radar's `ρ` and `υ`.
const ONE_BODY: [f64; 2] = [0.80, 0.32];
/// How noise widens that, over the root of the SNR.
const BY_NOISE: [f64; 2] = [0.3, 0.8];
/// Variance of the error over excess variance of the blob: more in the sine, where two bodies that
/// are in phase widen the blob little.
const ERROR_PER_EXCESS: [f64; 2] = [1.0, 3.0];

/// The covariance that the excess extent of `blob` adds to its place, in the node's frame, m²; `snr`
/// is that of its peak in the image, a ratio of powers. Zero if the blob is that of one body.
pub(super) fn excess_m2(blob: &Blob, precision: &Precision, snr: f64) -> Matrix2<f64> {
    let jacobian = cartesian_from_polar(&blob.place);
    let Some(inverse) = jacobian.try_inverse() else { return Matrix2::zeros() };
    let extent = inverse * blob.extent_m2 * inverse.transpose();
    let cells = [precision.range_m, precision.sine];
    let error = [0, 1].map(|axis| {
        let widened = 1.0 + BY_NOISE[axis] / snr.max(1.0).sqrt();
        let limit = ONE_BODY[axis] * cells[axis] * widened;
        ERROR_PER_EXCESS[axis] * (extent[(axis, axis)] - limit * limit).max(0.0)
    });
    jacobian * Matrix2::from_diagonal(&Vector2::from(error)) * jacobian.transpose()
}

#[cfg(test)]
mod tests {
    use super::super::moments::Polar;
    use super::*;

    const PRECISION: Precision = Precision { range_m: 0.14, sine: 0.15 };

    /// The blob of two bodies at `place ± half`, each with the spread `one`.
    fn two(place: Polar, half: Polar, one: Polar) -> Blob {
        let spread = Matrix2::from_diagonal(&one.component_mul(&one)) + half * half.transpose();
        let jacobian = cartesian_from_polar(&place);
        Blob { place, extent_m2: jacobian * spread * jacobian.transpose() }
    }

    #[test]
    fn one_body_adds_nothing_and_two_add_their_distance() {
        let (place, one) = (Polar::new(4.0, 0.6), Polar::new(0.09, 0.045));
        let alone = excess_m2(&two(place, Polar::zeros(), one), &PRECISION, 100.0);
        assert!(alone.norm() < 1e-12, "{alone}");
        // Along and across the line of sight of (2.4, 3.2).
        let (along, across) = (Vector2::new(0.6, 0.8), Vector2::new(0.8, -0.6));
        let behind = excess_m2(&two(place, Polar::new(0.3, 0.0), one), &PRECISION, 1e6);
        let want_m2 = 0.09_f64.powi(2) + 0.3_f64.powi(2) - (0.8_f64 * 0.14).powi(2);
        assert!((along.dot(&(behind * along)) / want_m2 - 1.0).abs() < 2e-3);
        assert!(across.dot(&(behind * across)).abs() < 1e-9);
        let beside = excess_m2(&two(place, Polar::new(0.0, 0.1), one), &PRECISION, 1e6);
        let sine2 = 0.045_f64.powi(2) + 0.1_f64.powi(2) - (0.32_f64 * 0.15).powi(2);
        let aside_m2 = 3.0 * sine2 * (4.0 / 0.8_f64).powi(2);
        assert!((across.dot(&(beside * across)) / aside_m2 - 1.0).abs() < 2e-3);
        assert!(along.dot(&(beside * along)).abs() < 1e-9);
    }

    #[test]
    fn noise_widens_what_one_body_may_show() {
        let blob = two(Polar::new(4.0, 0.0), Polar::zeros(), Polar::new(0.09, 0.054));
        assert!(excess_m2(&blob, &PRECISION, 20.0).norm() < 1e-12);
        assert!(1e-3 < excess_m2(&blob, &PRECISION, 1e4).norm());
    }

    #[test]
    fn a_place_without_angles_adds_nothing() {
        // At the array's centre, no angle is defined.
        let blob = Blob { place: Polar::zeros(), extent_m2: Matrix2::identity() };
        assert!(excess_m2(&blob, &PRECISION, 100.0).norm() < 1e-12);
    }
}
