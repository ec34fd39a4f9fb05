//! What stands out of the noise: the noise power, the threshold and the peaks above it.
//!
//! The noise power of a profile sample is `σ² = median |s|² / ln 2` over all channels and delays
//! (the median of an exponential distribution is `ln 2` of its mean); targets fill so few range
//! cells that they move the median little. A pixel's noise power is then `N σ²` for `N` channels.

use std::f32::consts::LN_2;

use crate::imaging::backproject::CoherentImage;
use crate::imaging::compress::Profiles;
use crate::imaging::single;

use super::{DetectionConfig, SecondLook, Threshold};

/// Half the width in pixels of the square in which a local maximum is the largest.
const PEAK_HALF_WIDTH: usize = 2;
/// Profile samples of which the median is taken, at most: 2 % standard deviation of the median.
const MAX_MEDIAN_SAMPLES: usize = 4096;

/// Pixels that are compared with the threshold at once.
const BLOCK_LENGTH: usize = 64;
/// Peaks above this share of the threshold are looked at again: the window costs 0.9 dB of the power
/// that a fit explains.
const CANDIDATE_SHARE: f64 = 0.72;

/// A local maximum of the image's power.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peak {
    /// Pixel number in the image.
    pub index: usize,
    /// `|I|²` there.
    pub power: f32,
    /// Distance from the array centre, metres.
    pub range_m: f64,
    /// Sine of the angle from boresight, positive along `x`.
    pub sine: f64,
}

/// The noise power `σ²` of one profile sample; 0 if the profiles are empty.
#[must_use]
pub fn noise_power(profiles: &Profiles) -> f32 {
    // An odd stride visits all phases of the oversampled profile.
    let stride = profiles.samples.len().div_ceil(MAX_MEDIAN_SAMPLES).max(1) | 1;
    let mut powers: Vec<f32> =
        profiles.samples.iter().step_by(stride).map(|sample| sample.norm_sqr()).collect();
    if powers.is_empty() {
        return 0.0;
    }
    let middle = powers.len() / 2;
    let (_, median, _) = powers.select_nth_unstable_by(middle, f32::total_cmp);
    *median / LN_2
}

/// The peaks above the threshold, strongest first, none close to a stronger one.
#[must_use]
pub fn peaks(
    image: &CoherentImage,
    amplitude: &[f32],
    noise_power: f32,
    config: &DetectionConfig,
) -> Vec<Peak> {
    let gate = Gate::new(image, amplitude, noise_power, config);
    let mut found = Vec::new();
    for (block, powers) in image.power.chunks(BLOCK_LENGTH).enumerate() {
        // Nearly all blocks hold nothing: comparing them whole lets the processor do it in lanes.
        if powers.iter().fold(0, |count, power| count + u32::from(gate.min_power < *power)) == 0 {
            continue;
        }
        let first = block * BLOCK_LENGTH;
        for index in first..first + powers.len() {
            if gate.min_power < image.power[index]
                && is_ridge(image, index)
                && gate.passes(image, amplitude, index)
                && is_local_maximum(image, index)
                && config.min_depth_m <= image.pixels.coords_m(index).y
            {
                let place = image.pixels.polar(index);
                let (range_m, sine) = (place.x, place.y);
                found.push(Peak { index, power: image.power[index], range_m, sine });
            }
        }
    }
    found.sort_by(|a, b| b.power.total_cmp(&a.power).then(a.index.cmp(&b.index)));
    suppress(&found, config)
}

/// The threshold in numbers.
struct Gate {
    min_power: f32,
    min_coherence: f32,
    min_amplitude: f32,
}

impl Gate {
    fn new(
        image: &CoherentImage,
        amplitude: &[f32],
        noise_power: f32,
        config: &DetectionConfig,
    ) -> Self {
        let noise = image.channel_count as f32 * noise_power;
        match config.threshold {
            Threshold::Noise { power_ratio, min_coherence } => {
                let share = match config.second_look {
                    SecondLook::Off => 1.0,
                    SecondLook::TwoPoints { .. } => CANDIDATE_SHARE,
                };
                Self {
                    min_power: single(power_ratio * share) * noise,
                    min_coherence: single(min_coherence),
                    min_amplitude: 0.0,
                }
            }
            Threshold::Relative { fraction } => {
                let largest = amplitude.iter().fold(0.0, |a: f32, b| a.max(*b));
                let min_amplitude = single(fraction) * largest;
                Self { min_power: 0.0, min_coherence: 0.0, min_amplitude }
            }
        }
    }

    fn passes(&self, image: &CoherentImage, amplitude: &[f32], index: usize) -> bool {
        self.min_power < image.power[index]
            && image.power[index].is_finite()
            && self.min_amplitude < amplitude[index]
            && self.min_coherence < image.coherence(index)
    }
}

/// Whether neither the pixel before nor the one after is stronger, nor the one before as strong:
/// what most pixels of a blob fail at once. Pixels at the end of a row are not asked.
fn is_ridge(image: &CoherentImage, index: usize) -> bool {
    let column = index % image.pixels.column_count();
    let own = image.power[index];
    let is_inside = 0 < column && column + 1 < image.pixels.column_count();
    !is_inside || (image.power[index - 1] < own && image.power[index + 1] <= own)
}

/// Whether no pixel of the square around is stronger, nor as strong and stored earlier.
fn is_local_maximum(image: &CoherentImage, index: usize) -> bool {
    let (row, column) = image.pixels.row_and_column(index);
    let columns = image.pixels.column_count();
    let own = image.power[row * columns + column];
    let rows = row.saturating_sub(PEAK_HALF_WIDTH)..(row + PEAK_HALF_WIDTH + 1);
    let from = column.saturating_sub(PEAK_HALF_WIDTH);
    let to = (column + PEAK_HALF_WIDTH + 1).min(columns);
    rows.take_while(|near| *near < image.pixels.row_count()).all(|near_row| {
        let before = |near_column: usize| (near_row, near_column) < (row, column);
        (from..to).all(|near_column| {
            let near = image.power[near_row * columns + near_column];
            if before(near_column) { near < own } else { near <= own }
        })
    })
}

/// Drops every peak within the separation ellipse of a stronger one that stays.
fn suppress(found: &[Peak], config: &DetectionConfig) -> Vec<Peak> {
    let mut kept: Vec<Peak> = Vec::new();
    for peak in found {
        let near = |stronger: &Peak| {
            let range = (peak.range_m - stronger.range_m) / config.separation_range_m;
            let sine = (peak.sine - stronger.sine) / config.separation_sine;
            range.hypot(sine) < 1.0
        };
        if !kept.iter().any(near) {
            kept.push(*peak);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::pixels::Pixels;
    use proto::radar::Grid;
    use rand::{SeedableRng, rngs::ChaCha8Rng};
    use rand_distr::{Distribution, StandardNormal};
    use rustfft::num_complex::Complex;

    fn image(spots: &[(usize, usize, f32)]) -> CoherentImage {
        let grid =
            Grid { x_min_m: -3.0, y_min_m: 0.0, pixel_m: 0.03, column_count: 200, row_count: 200 };
        let mut power = vec![1.0; grid.pixel_count()];
        for (row, column, value) in spots {
            power[row * 200 + column] = *value;
        }
        let energy = power.iter().map(|p| p / 8.0).collect();
        CoherentImage {
            pixels: Pixels::Cartesian(grid),
            channel_count: 8,
            power,
            energy,
            phase_coherence: vec![],
        }
    }

    fn found(image: &CoherentImage, threshold: Threshold) -> Vec<usize> {
        let second_look = SecondLook::Off;
        let config = DetectionConfig { threshold, second_look, ..DetectionConfig::points() };
        let amplitude = image.weighted_amplitude();
        peaks(image, &amplitude, 1.0, &config).iter().map(|peak| peak.index).collect()
    }

    #[test]
    fn the_noise_power_is_that_of_gaussian_noise_in_spite_of_targets() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut draw = || -> f32 { StandardNormal.sample(&mut rng) };
        let mut samples: Vec<Complex<f32>> =
            (0..8 * 2048).map(|_| Complex::new(3.0 * draw(), 3.0 * draw())).collect();
        for sample in &mut samples[100..200] {
            *sample = Complex::new(1e3, 0.0);
        }
        let profiles = Profiles { sample_count: 2048, sample_rate_hz: 1.0, samples };
        // The mean power is 2 · 3²; five standard deviations of a median of 3277 samples are 13 %.
        assert!((noise_power(&profiles) / 18.0 - 1.0).abs() < 0.13);
        let none = Profiles { sample_count: 1, sample_rate_hz: 1.0, samples: vec![] };
        assert!(noise_power(&none).abs() < f32::MIN_POSITIVE);
    }

    #[test]
    fn peaks_are_above_threshold_apart_and_beyond_the_blind_depth() {
        let noise = Threshold::Noise { power_ratio: 12.0, min_coherence: 0.4 };
        // Threshold 12 · 8 = 96; row 10 is at 0.3 m; (100, 103) is 0.09 m from (100, 100).
        let spots = [
            (100, 100, 200.0),
            (100, 103, 150.0),
            (10, 100, 500.0),
            (150, 50, 97.0),
            (150, 150, 95.0),
        ];
        assert_eq!(found(&image(&spots), noise), vec![100 * 200 + 100, 150 * 200 + 50]);
        let relative = Threshold::Relative { fraction: 0.5 };
        let amplitudes = [(100, 100, 400.0), (150, 50, 101.0), (150, 150, 99.0)];
        assert_eq!(found(&image(&amplitudes), relative), vec![100 * 200 + 100, 150 * 200 + 50]);
    }

    #[test]
    fn an_incoherent_pixel_is_no_peak_and_a_plateau_is_one() {
        let noise = Threshold::Noise { power_ratio: 12.0, min_coherence: 0.4 };
        let mut incoherent = image(&[(100, 100, 200.0)]);
        incoherent.energy[100 * 200 + 100] = 100.0;
        assert_eq!(found(&incoherent, noise), Vec::<usize>::new());
        let plateau = image(&[(100, 100, 200.0), (100, 101, 200.0), (101, 100, 200.0)]);
        assert_eq!(found(&plateau, noise), vec![100 * 200 + 100]);
    }
}
