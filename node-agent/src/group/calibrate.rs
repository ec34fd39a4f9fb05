//! Taking a radar's constant errors of range and direction out of its detections.
//!
//! A radar finds direction from the phases between its channels. A phase between them that nobody
//! calibrated shifts the direction cosines `s = q / R` along the array's two axes by a constant
//! each, and delays in the board lengthen the slant range `R = |q|` by a constant. With the array's
//! axes `a` (azimuth), `e` (elevation) and boresight `b`,
//!
//! `s_a ← s_a − κ_a`, `s_e ← s_e − κ_e`, `s_b ← ± sqrt(1 − s_a² − s_e²)`, `R ← R − ρ`,
//!
//! `q ← R (s_a a + s_e e + s_b b)`. For a boresight `τ` below the horizon, in the levelled frame,
//! `a = (1, 0, 0)`, `e = (0, sin τ, cos τ)`, `b = (0, cos τ, −sin τ)`. A detection without a height
//! lies in the plane, where only `κ_a` and `ρ` mean anything.
//!
//! A phase `δ` between the transmitters of the two rows shifts `s_e` by `δ/π`: 0.2 for 40°, the
//! size that is usual without calibration. The same between two transmitters of one row of eight
//! virtual channels shifts `s_a` by `8 δ / (42 π)`, the slope of a step: 0.04.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::source::recorded::Detection;

/// Constant errors of a radar.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Calibration {
    /// How much too long its ranges are, metres.
    pub range_bias_m: f64,
    /// How much too large the direction cosine along the array (to the right) is.
    pub azimuth_bias: f64,
    /// How much too large the direction cosine along the array's upward axis is.
    pub elevation_bias: f64,
}

impl Calibration {
    /// Whether there is nothing to correct.
    pub(super) fn is_nothing(&self) -> bool {
        [self.range_bias_m, self.azimuth_bias, self.elevation_bias]
            .iter()
            .all(|bias| bias.abs() < f64::EPSILON)
    }

    /// `detection` without the errors; `None` where no direction has the corrected cosines.
    pub(super) fn corrected(&self, detection: &Detection, tilt_rad: f64) -> Option<Detection> {
        let position_m = Vector3::new(detection.x_m, detection.y_m, detection.z_m.unwrap_or(0.0));
        let range_m = position_m.norm();
        if range_m <= self.range_bias_m.max(f64::EPSILON) {
            return None;
        }
        // Without a height the plane is all there is, and the array counts as upright.
        let (tilt_rad, elevation_bias) = match detection.z_m {
            Some(_) => (tilt_rad, self.elevation_bias),
            None => (0.0, 0.0),
        };
        let axes = Axes::new(tilt_rad);
        let seen = axes.cosines(&(position_m / range_m));
        let [azimuth, elevation] = [seen.x - self.azimuth_bias, seen.y - elevation_bias];
        let along_squared = 1.0 - azimuth * azimuth - elevation * elevation;
        if along_squared < 0.0 {
            return None;
        }
        let cosines = Vector3::new(azimuth, elevation, along_squared.sqrt().copysign(seen.z));
        let corrected_m = axes.direction(&cosines) * (range_m - self.range_bias_m);
        let z_m = detection.z_m.map(|_| corrected_m.z);
        Some(Detection { x_m: corrected_m.x, y_m: corrected_m.y, z_m, ..*detection })
    }
}

/// The array's axes in the levelled frame.
pub(super) struct Axes {
    azimuth: Vector3<f64>,
    elevation: Vector3<f64>,
    boresight: Vector3<f64>,
}

impl Axes {
    /// Of an array whose boresight looks `tilt_rad` below the horizon.
    pub(super) fn new(tilt_rad: f64) -> Self {
        let (sin, cos) = tilt_rad.sin_cos();
        Self {
            azimuth: Vector3::x(),
            elevation: Vector3::new(0.0, sin, cos),
            boresight: Vector3::new(0.0, cos, -sin),
        }
    }

    /// Direction cosines (azimuth, elevation, boresight) of a unit vector of the levelled frame.
    pub(super) fn cosines(&self, direction: &Vector3<f64>) -> Vector3<f64> {
        Vector3::new(
            self.azimuth.dot(direction),
            self.elevation.dot(direction),
            self.boresight.dot(direction),
        )
    }

    fn direction(&self, cosines: &Vector3<f64>) -> Vector3<f64> {
        self.azimuth * cosines.x + self.elevation * cosines.y + self.boresight * cosines.z
    }
}

#[cfg(test)]
mod tests {
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    use super::*;

    /// Rounding of a few operations on metres.
    const TOLERANCE_M: f64 = 1e-12;

    fn detection(x_m: f64, y_m: f64, z_m: Option<f64>) -> Detection {
        Detection { time_s: 0.5, x_m, y_m, z_m, v_m_per_s: Some(0.3), snr_db: Some(12.0) }
    }

    fn gap_m(a: &Detection, b: &Detection) -> f64 {
        let z_m = a.z_m.unwrap_or(0.0) - b.z_m.unwrap_or(0.0);
        Vector3::new(a.x_m - b.x_m, a.y_m - b.y_m, z_m).norm()
    }

    #[test]
    fn a_radar_that_looks_down_sees_its_upward_axis_along_y() {
        // 2 m below, seen 0.2 of the range too far forward; boresight is −z, elevation is +y.
        let bias = Calibration { elevation_bias: 0.2, ..Calibration::default() };
        let seen = detection(0.0, 0.4, Some(-2.0 * (1.0 - 0.2_f64.powi(2)).sqrt()));
        let right = bias.corrected(&seen, std::f64::consts::FRAC_PI_2).unwrap();
        assert!(gap_m(&right, &detection(0.0, 0.0, Some(-2.0))) < TOLERANCE_M, "{right:?}");
    }

    #[test]
    fn an_upright_radar_sees_its_biases_in_bearing_and_height() {
        let bias = Calibration { range_bias_m: 0.1, azimuth_bias: 0.6, ..Calibration::default() };
        let right = bias.corrected(&detection(3.06, 4.08, None), 1.0).unwrap();
        assert!(gap_m(&right, &detection(0.0, 5.0, None)) < TOLERANCE_M, "{right:?}");
        let high = Calibration { elevation_bias: 0.6, ..Calibration::default() };
        let level = high.corrected(&detection(0.0, 4.0, Some(3.0)), 0.0).unwrap();
        assert!(gap_m(&level, &detection(0.0, 5.0, Some(0.0))) < TOLERANCE_M, "{level:?}");
    }

    /// The oracle: the radar's measurement of a true place, worked out in the array's own
    /// coordinates, which a rotation about the horizontal axis carries into the levelled frame.
    #[test]
    fn correction_undoes_what_a_wrong_radar_does() {
        let mut random = ChaCha8Rng::seed_from_u64(8);
        for _ in 0..200 {
            let tilt_rad: f64 = random.random_range(0.0..1.6);
            let mut uniform = |width: f64| random.random_range(-width..width);
            let bias = Calibration {
                range_bias_m: uniform(0.1),
                azimuth_bias: uniform(0.1),
                elevation_bias: uniform(0.2),
            };
            let in_array = [uniform(1.0), uniform(1.0), 2.0];
            let range_m = in_array.iter().map(|v| v * v).sum::<f64>().sqrt();
            let seen_m = range_m + bias.range_bias_m;
            let right = in_array[0] / range_m + bias.azimuth_bias;
            let up = in_array[1] / range_m + bias.elevation_bias;
            let ahead = (1.0 - right * right - up * up).sqrt();
            let leveled = |[x, e, b]: [f64; 3]| {
                let y_m = b * tilt_rad.cos() + e * tilt_rad.sin();
                detection(x, y_m, Some(e * tilt_rad.cos() - b * tilt_rad.sin()))
            };
            let seen = leveled([right, up, ahead].map(|cosine| cosine * seen_m));
            let got = bias.corrected(&seen, tilt_rad).unwrap();
            assert!(gap_m(&got, &leveled(in_array)) < TOLERANCE_M, "{got:?}");
            assert_eq!((got.time_s, got.v_m_per_s, got.snr_db), (0.5, Some(0.3), Some(12.0)));
        }
    }

    #[test]
    fn what_has_no_direction_is_dropped_and_nothing_changes_nothing() {
        let wide = Calibration { azimuth_bias: -0.5, ..Calibration::default() };
        assert_eq!(wide.corrected(&detection(3.0, 1.0, None), 0.0), None);
        let long = Calibration { range_bias_m: 2.0, ..Calibration::default() };
        assert_eq!(long.corrected(&detection(0.0, 1.9, None), 0.0), None);
        assert_eq!(Calibration::default().corrected(&detection(0.0, 0.0, None), 0.0), None);
        assert!(Calibration::default().is_nothing() && !long.is_nothing());
        let behind = detection(0.4, -1.5, Some(0.3));
        let same = Calibration::default().corrected(&behind, 0.0).unwrap();
        assert!(gap_m(&same, &behind) < TOLERANCE_M);
    }
}
