//! Windows of equal length over a recording.

use super::config::GroupConfig;
use crate::source::recorded::Detection;

/// The detections of one window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Period<'a> {
    /// Number of the window, which spans `[index, index + 1) · period_s` of the recording's clock:
    /// the same in all recordings of one clock.
    pub index: u64,
    /// Middle of the window, seconds of the recording's clock.
    pub mid_time_s: f64,
    /// What was detected in it, by time; may be empty.
    pub detections: &'a [Detection],
}

/// The windows from that of the first detection to that of the last, empty ones among them.
/// `detections` are by time, none before zero, as [`crate::source::recorded::Recording`] holds
/// them, and `config` passes its check.
pub fn periods<'a>(
    detections: &'a [Detection],
    config: &GroupConfig,
) -> impl Iterator<Item = Period<'a>> + use<'a> {
    let period_s = config.period_s;
    let index_of = move |detection: &Detection| window_index(detection.time_s, period_s);
    let first = detections.first().map_or(0, index_of);
    let end = detections.last().map_or(0, |last| index_of(last) + 1);
    let mut rest = detections;
    (first..end).map(move |index| {
        let (now, later) = rest.split_at(rest.partition_point(|d| index_of(d) <= index));
        rest = later;
        Period { index, mid_time_s: (index as f64 + 0.5) * period_s, detections: now }
    })
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "down to the window; readers keep times within 1e11 s, far from the largest u64"
)]
fn window_index(time_s: f64, period_s: f64) -> u64 {
    (time_s / period_s) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(time_s: f64) -> Detection {
        Detection { time_s, x_m: 0.0, y_m: 1.0, z_m: None, v_m_per_s: None, snr_db: None }
    }

    fn windows(times_s: &[f64]) -> Vec<(u64, f64, Vec<f64>)> {
        let detections: Vec<Detection> = times_s.iter().copied().map(at).collect();
        let config = GroupConfig { period_s: 0.5, ..GroupConfig::default() };
        periods(&detections, &config)
            .map(|p| (p.index, p.mid_time_s, p.detections.iter().map(|d| d.time_s).collect()))
            .collect()
    }

    #[test]
    fn windows_stand_on_multiples_of_the_period_and_empty_ones_are_there() {
        let expected = [
            (1, 0.75, vec![0.6, 0.9]),
            (2, 1.25, vec![1.0, 1.0, 1.49]),
            (3, 1.75, vec![]),
            (4, 2.25, vec![]),
            (5, 2.75, vec![2.5]),
        ];
        assert_eq!(windows(&[0.6, 0.9, 1.0, 1.0, 1.49, 2.5]), expected);
        assert_eq!(windows(&[0.0, 0.2]), [(0, 0.25, vec![0.0, 0.2])]);
        assert_eq!(windows(&[]), []);
    }

    #[test]
    fn recordings_of_one_clock_share_windows() {
        let early = windows(&[0.1, 7.2]);
        let late = windows(&[7.1, 9.0]);
        let shared = early.iter().find(|window| window.0 == 14).unwrap();
        assert_eq!((shared.0, shared.1), (late[0].0, late[0].1));
    }
}
