//! From an image to measured points: threshold, regions, moments, and how sure they are.
//!
//! The error of a point in range and across, with the SNR of its peak `SNR_I = |I|² / (N σ²) − 1`:
//! `σ_r = c / (4π β sqrt(2 SNR_I))`, `σ_u = 1 / (2 k σ_x sqrt(2 SNR_I))`, `σ_c = r σ_u / cos θ`,
//! `R = A diag(1.5 σ_r² + g_r², 1.15 σ_c² + g_c²) Aᵀ`, `A = [e_r e_c]`, with the effective
//! bandwidth `β` in hertz, `k = 2π f_c / c`, the aperture's `σ_x`, and the wander `g` of what a
//! person reflects (glint), metres. The factors are what moments lose against the bound.
//!
//! differs: \[registration, eq. (7)\] scales the second moment of the region, because that
//! is a size, not an error: one scale cannot serve points and people.

use std::f64::consts::{PI, TAU};

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use proto::measured::{MeasuredPoint, packed};
use proto::radar::{Array, Band, SPEED_OF_LIGHT_M_PER_S};

use crate::imaging::backproject::CoherentImage;
use crate::imaging::compress::Profiles;
use crate::imaging::window::effective_bandwidth_hz;
use crate::imaging::{InvalidSetting, invalid};

use moments::{Blob, Centroid, Polar, cartesian_from_polar, to_cartesian};
use regions::Region;
use resolve::{Finding, Resolver};

pub mod moments;
pub mod regions;
pub mod resolve;
pub mod response;
pub mod threshold;

/// A region reaches down to half the amplitude of its peak (−6 dB).
const REGION_FRACTION: f32 = 0.5;
/// Variance in range of power-weighted moments over the bound.
const RANGE_VARIANCE_FACTOR: f64 = 1.5;
/// The same across.
const CROSS_VARIANCE_FACTOR: f64 = 1.15;
/// Smallest `SNR_I` that enters a covariance: below, the bound is no bound any more.
const MIN_SNR: f64 = 1.0;

/// What counts as standing out.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Threshold {
    /// Above the noise.
    Noise {
        /// Power over the noise power of a pixel.
        power_ratio: f64,
        /// Coherence factor.
        min_coherence: f64,
    },
    /// Above a fraction of the largest amplitude of the image, as the seed has it: finds weak
    /// targets only if there is no strong one, and always finds something.
    Relative {
        /// The fraction, 0 to 1.
        fraction: f64,
    },
}

/// Whether broad or neighbouring peaks are looked at again with a model.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum SecondLook {
    /// Moments only.
    Off,
    /// One against two point responses; what neither explains gets its extent as error.
    TwoPoints {
        /// Two points nearer than this, metres, are taken as one target: the width of a person.
        min_separation_m: f64,
    },
}

/// Settings of detection.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DetectionConfig {
    /// What counts as standing out.
    pub threshold: Threshold,
    /// Nothing is detected nearer to the array than this along boresight: there all channels agree.
    pub min_depth_m: f64,
    /// Peaks nearer than this in range and ...
    pub separation_range_m: f64,
    /// ... this in the sine of the angle are one.
    pub separation_sine: f64,
    /// Which moments give the point.
    pub centroid: Centroid,
    /// Standard deviation in range of what a target reflects: 0 for points, 0.11 for people.
    pub glint_range_m: f64,
    /// The same across: 0 for points, 0.13 for people.
    pub glint_cross_m: f64,
    /// What is done about broad and neighbouring peaks.
    pub second_look: SecondLook,
}

impl Default for DetectionConfig {
    fn default() -> Self {
        Self {
            threshold: Threshold::Noise { power_ratio: 12.0, min_coherence: 0.4 },
            min_depth_m: 0.4,
            separation_range_m: 0.22,
            separation_sine: 0.12,
            centroid: Centroid::PolarPower,
            glint_range_m: 0.0,
            glint_cross_m: 0.0,
            second_look: SecondLook::TwoPoints { min_separation_m: 0.6 },
        }
    }
}

impl DetectionConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), InvalidSetting> {
        self.check_threshold()?;
        let positive = "use a positive number of metres";
        for (field, value, remedy) in [
            ("detection.min_depth_m", self.min_depth_m, positive),
            ("detection.separation_range_m", self.separation_range_m, positive),
            (
                "detection.separation_sine",
                self.separation_sine,
                "use a positive number, about 0.12",
            ),
        ] {
            if !(f64::MIN_POSITIVE..1e3).contains(&value) {
                return Err(invalid(field, value, remedy));
            }
        }
        let min_separation_m = match self.second_look {
            SecondLook::Off => 0.0,
            SecondLook::TwoPoints { min_separation_m } => min_separation_m,
        };
        for (field, value) in [
            ("detection.glint_range_m", self.glint_range_m),
            ("detection.glint_cross_m", self.glint_cross_m),
            ("detection.second_look.two_points.min_separation_m", min_separation_m),
        ] {
            if !(0.0..1e3).contains(&value) {
                return Err(invalid(field, value, "use 0 or a positive number of metres"));
            }
        }
        Ok(())
    }

    fn check_threshold(&self) -> Result<(), InvalidSetting> {
        let fractions = 0.0..1.0;
        match self.threshold {
            Threshold::Noise { power_ratio, .. } if !(1.0..1e6).contains(&power_ratio) => {
                let field = "detection.threshold.noise.power_ratio";
                Err(invalid(field, power_ratio, "use more than 1, about 12"))
            }
            Threshold::Noise { min_coherence, .. } if !fractions.contains(&min_coherence) => {
                let field = "detection.threshold.noise.min_coherence";
                Err(invalid(field, min_coherence, "use 0 to 1, about 0.4"))
            }
            Threshold::Relative { fraction } if !fractions.contains(&fraction) => {
                let field = "detection.threshold.relative.fraction";
                Err(invalid(field, fraction, "use 0 to 1, about 0.5"))
            }
            _ => Ok(()),
        }
    }
}

/// What bounds the precision of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Precision {
    /// `σ_r sqrt(2 SNR_I)`, metres.
    pub range_m: f64,
    /// `σ_u sqrt(2 SNR_I)`.
    pub sine: f64,
}

impl Precision {
    /// The bounds of a radar with one weight per frequency.
    #[must_use]
    pub fn new(band: &Band, array: &Array, weights: &[f64]) -> Self {
        let bandwidth_hz = effective_bandwidth_hz(weights, band);
        let wavenumber_per_m = TAU * band.carrier_hz() / SPEED_OF_LIGHT_M_PER_S;
        Self {
            range_m: SPEED_OF_LIGHT_M_PER_S / (4.0 * PI * bandwidth_hz),
            sine: 1.0 / (2.0 * wavenumber_per_m * array.aperture_sigma_m()),
        }
    }
}

/// An image with all that detection needs of it.
#[derive(Clone, Copy, Debug)]
pub struct Scan<'a> {
    /// Profiles of all channels.
    pub profiles: &'a Profiles,
    /// The image of these profiles.
    pub image: &'a CoherentImage,
    /// Its [`CoherentImage::weighted_amplitude`].
    pub amplitude: &'a [f32],
    /// Noise power of a profile sample.
    pub noise_power: f32,
}

/// The measured points of one scan, strongest first.
#[must_use]
pub fn detect(
    scan: &Scan<'_>,
    config: &DetectionConfig,
    precision: &Precision,
    resolver: &Resolver,
) -> Vec<MeasuredPoint> {
    let peaks = threshold::peaks(scan.image, scan.amplitude, scan.noise_power, config);
    let regions = regions::regions(scan.image, scan.amplitude, &peaks, REGION_FRACTION);
    let first_look: Vec<Finding> =
        regions.iter().map(|region| look(scan, config, precision, region)).collect();
    let findings = match config.second_look {
        SecondLook::Off => first_look,
        SecondLook::TwoPoints { min_separation_m } => {
            resolver.look_again(scan, first_look, min_separation_m)
        }
    };
    findings.iter().map(|finding| measured_point(finding, config)).collect()
}

/// The moments of a region and what the bound says of them.
fn look(
    scan: &Scan<'_>,
    config: &DetectionConfig,
    precision: &Precision,
    region: &Region,
) -> Finding {
    let Blob { place, extent_m2 } =
        moments::moments(&scan.image.grid, scan.amplitude, region, config.centroid);
    let noise = f64::from(scan.noise_power) * scan.image.channel_count as f64;
    let power_ratio = f64::from(region.peak.power) / noise.max(f64::MIN_POSITIVE);
    let double_snr = 2.0 * (power_ratio - 1.0).max(MIN_SNR);
    let polar_cov = Matrix2::from_diagonal(&Vector2::new(
        RANGE_VARIANCE_FACTOR * precision.range_m.powi(2) / double_snr,
        CROSS_VARIANCE_FACTOR * precision.sine.powi(2) / double_snr,
    ));
    let unexplained_m2 = Matrix2::zeros();
    Finding { place, polar_cov, extent_m2, unexplained_m2, power_ratio }
}

/// The point of a finding in the node's Cartesian frame.
fn measured_point(finding: &Finding, config: &DetectionConfig) -> MeasuredPoint {
    let coords_m = to_cartesian(&finding.place);
    let jacobian = cartesian_from_polar(&finding.place);
    let glint_m2 = in_node(&finding.place, config.glint_range_m, config.glint_cross_m);
    let noise_m2 = jacobian * finding.polar_cov * jacobian.transpose();
    MeasuredPoint {
        x_m: coords_m.x,
        y_m: coords_m.y,
        cov_m2: packed(&(noise_m2 + glint_m2 + finding.unexplained_m2)),
        snr_db: 10.0 * finding.power_ratio.log10(),
        extent_m2: packed(&finding.extent_m2),
        radial_velocity_m_per_s: None,
    }
}

/// The covariance with the given standard deviations along and across the line of sight.
fn in_node(place: &Polar, range_m: f64, cross_m: f64) -> Matrix2<f64> {
    let along = to_cartesian(&Polar::new(1.0, place.y));
    let across = Vector2::new(along.y, -along.x);
    along * along.transpose() * range_m.powi(2) + across * across.transpose() * cross_m.powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bound_is_that_of_the_specification_at_8_db() {
        let band = Band::default();
        let precision = Precision::new(&band, &Array::default(), &[1.0 / 301.0; 301]);
        // spec 3.1: 1.4 cm and 14.5 mrad with SNR_I of 8 dB per channel times 8.
        let root = (2.0 * 8.0 * 10_f64.powf(0.8)).sqrt();
        assert!((precision.range_m / root - 0.0137).abs() < 1e-4);
        assert!((precision.sine / root - 0.0145).abs() < 1e-4);
    }

    #[test]
    fn covariances_lie_along_and_across_the_line_of_sight() {
        let finding = Finding {
            place: Polar::new(5.0, 0.6),
            polar_cov: Matrix2::from_diagonal(&Vector2::new(0.01_f64.powi(2), 0.02_f64.powi(2))),
            extent_m2: Matrix2::zeros(),
            unexplained_m2: Matrix2::zeros(),
            power_ratio: 100.0,
        };
        let glint = DetectionConfig {
            glint_range_m: 0.1,
            glint_cross_m: 0.2,
            ..DetectionConfig::default()
        };
        let point = measured_point(&finding, &glint);
        assert!((point.x_m - 3.0).abs() < 1e-12 && (point.y_m - 4.0).abs() < 1e-12);
        assert!((point.snr_db - 20.0).abs() < 1e-9);
        let cov_m2 = point.position().cov_m2;
        let (along, across) = (Vector2::new(0.6, 0.8), Vector2::new(0.8, -0.6));
        let along_m2 = 0.01_f64.powi(2) + 0.1_f64.powi(2);
        let across_m2 = (5.0 * 0.02 / 0.8_f64).powi(2) + 0.2_f64.powi(2);
        assert!((along.dot(&(cov_m2 * along)) - along_m2).abs() < 1e-12);
        assert!((across.dot(&(cov_m2 * across)) - across_m2).abs() < 1e-12);
        assert!(along.dot(&(cov_m2 * across)).abs() < 1e-12);
    }

    #[test]
    fn settings_of_nonsense_are_named() {
        let good = DetectionConfig::default();
        assert_eq!(good.check(), Ok(()));
        let noise = |power_ratio, min_coherence| Threshold::Noise { power_ratio, min_coherence };
        let near = SecondLook::TwoPoints { min_separation_m: -1.0 };
        for (bad, field) in [
            (DetectionConfig { threshold: noise(0.5, 0.4), ..good }, "noise.power_ratio"),
            (DetectionConfig { threshold: noise(12.0, 2.0), ..good }, "noise.min_coherence"),
            (
                DetectionConfig { threshold: Threshold::Relative { fraction: 1.5 }, ..good },
                "relative.fraction",
            ),
            (DetectionConfig { min_depth_m: 0.0, ..good }, "min_depth_m"),
            (DetectionConfig { separation_sine: f64::NAN, ..good }, "separation_sine"),
            (DetectionConfig { glint_cross_m: -0.1, ..good }, "glint_cross_m"),
            (DetectionConfig { second_look: near, ..good }, "two_points.min_separation_m"),
        ] {
            let error = bad.check().unwrap_err();
            assert!(error.field.ends_with(field), "{error}");
        }
    }
}
