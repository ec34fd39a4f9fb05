//! Windows of equal length over a recording.

use std::collections::BTreeMap;

use crate::source::recorded::Detection;

/// The detections of every window that has any, by the number of the window, which spans
/// `[index, index + 1) · period_s` of the recording's clock: the same in all recordings of one
/// clock. Times are zero or more, as [`crate::source::recorded::Recording`] holds them.
#[must_use]
pub fn by_window(detections: Vec<Detection>, period_s: f64) -> BTreeMap<u64, Vec<Detection>> {
    let mut windows: BTreeMap<u64, Vec<Detection>> = BTreeMap::new();
    for detection in detections {
        windows.entry(window_index(detection.time_s, period_s)).or_default().push(detection);
    }
    windows
}

/// The number of the window that holds `time_s`, seconds of the recording's clock.
#[must_use]
#[expect(
    clippy::cast_possible_truncation,
    reason = "down to the window; readers keep times within 0 to 1e11 s"
)]
pub fn window_index(time_s: f64, period_s: f64) -> u64 {
    (time_s / period_s) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn windows(times_s: &[f64]) -> Vec<(u64, Vec<f64>)> {
        let detection = |time_s| Detection {
            time_s,
            x_m: 0.0,
            y_m: 1.0,
            z_m: None,
            v_m_per_s: None,
            snr_db: None,
        };
        by_window(times_s.iter().copied().map(detection).collect(), 0.5)
            .into_iter()
            .map(|(index, inside)| (index, inside.iter().map(|d| d.time_s).collect()))
            .collect()
    }

    #[test]
    fn windows_stand_on_multiples_of_the_period() {
        let expected = [(1, vec![0.6, 0.9]), (2, vec![1.0, 1.0, 1.49]), (5, vec![2.5])];
        assert_eq!(windows(&[0.6, 0.9, 1.0, 1.0, 1.49, 2.5]), expected);
        assert_eq!(windows(&[0.0, 0.2]), [(0, vec![0.0, 0.2])]);
        assert_eq!(windows(&[]), []);
    }

    #[test]
    fn calendar_times_cost_no_more_than_small_ones() {
        assert_eq!(windows(&[0.1, 1.7e9]), [(0, vec![0.1]), (3_400_000_000, vec![1.7e9])]);
    }
}
