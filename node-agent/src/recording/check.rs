//! Checks that both formats share: frequency grid, antennas, times, samples and sizes.

use proto::radar::{Array, Band};
use rustfft::num_complex::Complex;

use super::error::{Place, RecordingFault};

/// How far a frequency may lie from the even grid, in steps: below 0.4° of phase at any delay
/// within the ambiguity interval, and more than the rounding of a grid in single precision.
const GRID_TOLERANCE_STEPS: f64 = 1e-3;
/// Largest sweep, in samples (32 MiB in memory): 64 channels of 65536 frequencies.
pub(super) const MAX_SWEEP_SAMPLE_COUNT: u64 = 1 << 22;
/// Largest number of periods whose times are listed: 4.8 days at 10 Hz, 32 MiB.
pub(super) const MAX_LISTED_PERIOD_COUNT: u64 = 1 << 22;
/// Largest number of antennas on each side and of frequencies, as [`Array`] and [`Band`] have it.
pub(super) const MAX_ANTENNA_COUNT: u64 = 64;
pub(super) const MAX_FREQUENCY_COUNT: u64 = 1 << 16;

/// Counts of transmitters, receivers and frequencies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct SweepShape {
    pub(super) tx_count: usize,
    pub(super) rx_count: usize,
    pub(super) step_count: usize,
}

impl SweepShape {
    pub(super) fn of(band: &Band, array: &Array) -> Self {
        let (tx_count, rx_count) = (array.tx_m.len(), array.rx_m.len());
        Self { tx_count, rx_count, step_count: band.step_count }
    }

    pub(super) fn channel_count(self) -> usize {
        self.tx_count * self.rx_count
    }

    pub(super) fn sample_count(self) -> usize {
        self.channel_count() * self.step_count
    }

    /// Which sample stands at `index` of `[channel][frequency]`.
    pub(super) fn place(self, period_index: u64, index: usize) -> Place {
        let (channel, frequency_index) = (index / self.step_count, index % self.step_count);
        let (tx_index, rx_index) = (channel / self.rx_count, channel % self.rx_count);
        Place { period_index, tx_index, rx_index, frequency_index }
    }
}

/// The band of a list of frequencies, which must be an even ascending grid.
pub(super) fn band_of(freq_hz: &[f64]) -> Result<Band, RecordingFault> {
    finite("freq_hz", freq_hz)?;
    for (index, pair) in freq_hz.windows(2).enumerate() {
        if pair[1] <= pair[0] {
            let (before_hz, found_hz) = (pair[0], pair[1]);
            return Err(RecordingFault::FrequenciesNotAscending {
                index: index + 1,
                before_hz,
                found_hz,
            });
        }
    }
    let (Some(first_hz), Some(last_hz)) = (freq_hz.first(), freq_hz.last()) else {
        return Err(too_few_frequencies(0));
    };
    if freq_hz.len() < 2 {
        return Err(too_few_frequencies(1));
    }
    let step_hz = (last_hz - first_hz) / (freq_hz.len() - 1) as f64;
    let band = Band { start_hz: *first_hz, step_hz, step_count: freq_hz.len() };
    for (index, found_hz) in freq_hz.iter().enumerate() {
        let expected_hz = band.frequency_hz(index);
        if GRID_TOLERANCE_STEPS * step_hz < (found_hz - expected_hz).abs() {
            let (found_hz, tolerance) = (*found_hz, GRID_TOLERANCE_STEPS);
            return Err(RecordingFault::FrequenciesNotUniform {
                index,
                found_hz,
                expected_hz,
                tolerance,
            });
        }
    }
    checked_band(band)
}

fn too_few_frequencies(count: u64) -> RecordingFault {
    let expected = "2 frequencies or more".to_owned();
    RecordingFault::Shape { array: "freq_hz".to_owned(), found: vec![count], expected }
}

/// The band itself, if it makes sense.
pub(super) fn checked_band(band: Band) -> Result<Band, RecordingFault> {
    band.check().map_err(RecordingFault::Radar)?;
    Ok(band)
}

/// The array itself, if it makes sense.
pub(super) fn checked_array(array: Array) -> Result<Array, RecordingFault> {
    array.check().map_err(RecordingFault::Radar)?;
    Ok(array)
}

/// Every number of a list must be one.
pub(super) fn finite(array: &str, numbers: &[f64]) -> Result<(), RecordingFault> {
    match numbers.iter().enumerate().find(|(_, number)| !number.is_finite()) {
        None => Ok(()),
        Some((index, value)) => {
            Err(RecordingFault::NotFinite { array: array.to_owned(), index, value: *value })
        }
    }
}

/// Times must be finite and ascend.
pub(super) fn times(array: &str, time_s: &[f64]) -> Result<(), RecordingFault> {
    finite(array, time_s)?;
    match time_s.windows(2).enumerate().find(|(_, pair)| pair[1] <= pair[0]) {
        None => Ok(()),
        Some((index, pair)) => Err(RecordingFault::TimesNotAscending {
            index: index as u64 + 1,
            before_s: pair[0],
            time_s: pair[1],
        }),
    }
}

/// Every sample of a sweep must be a number.
pub(super) fn samples(
    array: &str,
    shape: SweepShape,
    period_index: u64,
    samples: &[Complex<f32>],
) -> Result<(), RecordingFault> {
    match samples.iter().enumerate().find(|(_, sample)| !sample.is_finite()) {
        None => Ok(()),
        Some((index, sample)) => Err(RecordingFault::SampleNotFinite {
            array: array.to_owned(),
            place: shape.place(period_index, index),
            value: format!("{sample}"),
        }),
    }
}

/// Refuses a count above a limit.
pub(super) fn at_most(
    part: &str,
    found: u64,
    limit: u64,
    unit: &'static str,
) -> Result<(), RecordingFault> {
    if found <= limit {
        return Ok(());
    }
    Err(RecordingFault::TooLarge { part: part.to_owned(), found, limit, unit })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding of a fitted step, relative.
    const STEP_TOLERANCE: f64 = 1e-12;

    #[test]
    fn an_even_grid_is_a_band_also_when_rounded_to_single_precision() {
        let exact: Vec<f64> = (0..301).map(|k| 1.6e9 + 2e6 * f64::from(k)).collect();
        let rounded: Vec<f64> =
            exact.iter().map(|hz| f64::from(crate::imaging::single(*hz))).collect();
        let band = band_of(&exact).unwrap();
        assert_eq!(band.step_count, 301);
        assert!(
            (band.start_hz - 1.6e9).abs() < 1.0
                && (band.step_hz / 2e6 - 1.0).abs() < STEP_TOLERANCE
        );
        assert!((band_of(&rounded).unwrap().step_hz - 2e6).abs() < 1.0);
    }

    #[test]
    fn other_lists_of_frequencies_are_refused_by_name() {
        let falling = band_of(&[3e9, 2e9, 1e9]).unwrap_err();
        assert!(matches!(falling, RecordingFault::FrequenciesNotAscending { index: 1, .. }));
        let uneven = band_of(&[1e9, 1.002_004e9, 1.004e9]).unwrap_err();
        assert!(matches!(uneven, RecordingFault::FrequenciesNotUniform { index: 1, .. }));
        let hole = band_of(&[1e9, f64::NAN, 3e9]).unwrap_err();
        assert!(matches!(hole, RecordingFault::NotFinite { index: 1, .. }));
        for few in [&[][..], &[1e9]] {
            assert!(matches!(band_of(few), Err(RecordingFault::Shape { .. })));
        }
        assert!(matches!(band_of(&[-1e9, 1e9]), Err(RecordingFault::Radar(_))));
    }

    #[test]
    fn the_place_of_a_sample_counts_frequencies_first_then_receivers() {
        let shape = SweepShape { tx_count: 2, rx_count: 3, step_count: 5 };
        for (tx_index, rx_index, frequency_index) in [(0, 0, 4), (0, 2, 1), (1, 0, 0), (1, 2, 4)] {
            let index = (tx_index * 3 + rx_index) * 5 + frequency_index;
            let place = Place { period_index: 7, tx_index, rx_index, frequency_index };
            assert_eq!(shape.place(7, index), place);
        }
    }
}
