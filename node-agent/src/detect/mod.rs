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

use proto::measured::{MeasuredPoint, packed};
use proto::radar::{Array, Band, SPEED_OF_LIGHT_M_PER_S};

use crate::imaging::backproject::CoherentImage;
use crate::imaging::compress::Profiles;
use crate::imaging::pixels::Pixels;
use crate::imaging::window::effective_bandwidth_hz;

pub use config::{Covariance, DetectionConfig, Ghosts, SecondLook, Threshold};
use moments::{Blob, Polar, cartesian_from_polar, to_cartesian};
use regions::Region;
use resolve::{Finding, Resolver};

pub mod config;
mod excess;
pub mod fading;
mod fit;
pub mod ghosts;
pub mod moments;
pub mod regions;
pub mod resolve;
pub mod response;
mod table;
pub mod threshold;

/// A region reaches down to half the amplitude of its peak (−6 dB).
const REGION_FRACTION: f32 = 0.5;
/// Variance in range of power-weighted moments over the bound.
const RANGE_VARIANCE_FACTOR: f64 = 1.5;
/// The same across.
const CROSS_VARIANCE_FACTOR: f64 = 1.15;
/// Smallest `SNR_I` that enters a covariance: below, the bound is no bound any more.
const MIN_SNR: f64 = 1.0;
/// No point is surer than this, metres: the antennas are not placed better.
const MIN_SIGMA_M: f64 = 1e-4;

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
    let pixel_noise = f64::from(scan.noise_power) * scan.image.channel_count as f64;
    let peaks = ghosts::without_ghosts(&peaks, pixel_noise, resolver.model(), &config.ghosts);
    let regions = regions::regions(scan.image, scan.amplitude, &peaks, REGION_FRACTION);
    let first_look: Vec<Finding> =
        regions.iter().map(|region| look(scan, config, precision, region)).collect();
    let mut findings = match config.second_look {
        SecondLook::Off => first_look,
        SecondLook::TwoPoints { min_separation_m } => {
            resolver.look_again(scan, first_look, min_separation_m)
        }
    };
    if let Threshold::Noise { power_ratio, .. } = config.threshold {
        findings.retain(|finding| power_ratio < finding.detection_ratio);
    }
    findings.sort_by(|a, b| b.power_ratio.total_cmp(&a.power_ratio));
    findings
        .iter()
        .filter_map(|finding| measured_point(&scan.image.pixels, finding, config))
        .collect()
}

/// The moments of a region and what the bound says of them.
fn look(
    scan: &Scan<'_>,
    config: &DetectionConfig,
    precision: &Precision,
    region: &Region,
) -> Finding {
    let blob = moments::moments(&scan.image.pixels, scan.amplitude, region, config.centroid);
    let Blob { place, extent_m2 } = blob;
    let noise = f64::from(scan.noise_power) * scan.image.channel_count as f64;
    let power_ratio = f64::from(region.peak.power) / noise.max(f64::MIN_POSITIVE);
    let double_snr = 2.0 * (power_ratio - 1.0).max(MIN_SNR);
    let polar_cov = Matrix2::from_diagonal(&Vector2::new(
        RANGE_VARIANCE_FACTOR * precision.range_m.powi(2) / double_snr,
        CROSS_VARIANCE_FACTOR * precision.sine.powi(2) / double_snr,
    ));
    Finding {
        place,
        polar_cov,
        extent_m2,
        unexplained_m2: excess::excess_m2(&blob, precision, power_ratio),
        power_ratio,
        detection_ratio: power_ratio,
    }
}

/// The point of a finding in the node's Cartesian frame; `None` if its numbers are not finite.
fn measured_point(
    pixels: &Pixels,
    finding: &Finding,
    config: &DetectionConfig,
) -> Option<MeasuredPoint> {
    let coords_m = to_cartesian(&finding.place);
    let cov_m2 = match config.covariance {
        Covariance::Measured => {
            let jacobian = cartesian_from_polar(&finding.place);
            let glint_m2 = in_node(&finding.place, config.glint_range_m, config.glint_cross_m);
            jacobian * finding.polar_cov * jacobian.transpose() + glint_m2 + finding.unexplained_m2
        }
        Covariance::ScaledMoment { scale } => {
            // A region of one row of pixels has no extent across it: a pixel's is added.
            let pixel_m2 = pixel_m(pixels, finding).powi(2) / 12.0;
            (finding.extent_m2 + Matrix2::identity() * pixel_m2) * scale
        }
    };
    let sure_m2 = cov_m2 + Matrix2::identity() * MIN_SIGMA_M.powi(2);
    let point = MeasuredPoint {
        x_m: coords_m.x,
        y_m: coords_m.y,
        cov_m2: packed(&sure_m2),
        snr_db: 10.0 * finding.power_ratio.log10(),
        extent_m2: packed(&finding.extent_m2),
        radial_velocity_m_per_s: None,
    };
    let finite = [coords_m.x, coords_m.y, point.snr_db].iter().all(|value| value.is_finite())
        && point.extent_m2.iter().all(|value| value.is_finite());
    // Cholesky's decomposition refuses what is not positive, and numbers that are none.
    (finite && sure_m2.cholesky().is_some()).then_some(point)
}

/// The size of a pixel where `finding` is, metres.
fn pixel_m(pixels: &Pixels, finding: &Finding) -> f64 {
    match pixels {
        Pixels::Cartesian(grid) => grid.pixel_m,
        Pixels::Polar(grid) => grid.range_step_m.max(finding.place.x * grid.sine_step),
    }
}

/// The covariance with the given standard deviations along and across the line of sight.
fn in_node(place: &Polar, range_m: f64, cross_m: f64) -> Matrix2<f64> {
    let along = to_cartesian(&Polar::new(1.0, place.y));
    let across = Vector2::new(along.y, -along.x);
    along * along.transpose() * range_m.powi(2) + across * across.transpose() * cross_m.powi(2)
}

#[cfg(test)]
mod crossing;
#[cfg(test)]
mod people;
#[cfg(test)]
mod study;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod trials;
#[cfg(test)]
mod walks;

#[cfg(test)]
mod figures {
    use super::*;
    use proto::radar::Grid;

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
            detection_ratio: 100.0,
        };
        let glint =
            DetectionConfig { glint_range_m: 0.1, glint_cross_m: 0.2, ..DetectionConfig::points() };
        let pixels = Pixels::Cartesian(Grid::default());
        let point = measured_point(&pixels, &finding, &glint).unwrap();
        assert!((point.x_m - 3.0).abs() < 1e-12 && (point.y_m - 4.0).abs() < 1e-12);
        assert!((point.snr_db - 20.0).abs() < 1e-9);
        let cov_m2 = point.position().cov_m2;
        let (along, across) = (Vector2::new(0.6, 0.8), Vector2::new(0.8, -0.6));
        let along_m2 = 0.01_f64.powi(2) + 0.1_f64.powi(2);
        let across_m2 = (5.0 * 0.02 / 0.8_f64).powi(2) + 0.2_f64.powi(2);
        assert!((along.dot(&(cov_m2 * along)) - along_m2).abs() < 2e-8);
        assert!((across.dot(&(cov_m2 * across)) - across_m2).abs() < 2e-8);
        assert!(along.dot(&(cov_m2 * across)).abs() < 1e-12);
    }
}
