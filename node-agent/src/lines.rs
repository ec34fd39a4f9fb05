//! Point sets as JSON Lines: what the agent and the offline tool write, one line per period.

use std::io::{self, Write};

use proto::ids::NodeId;
use proto::measured::MeasuredPoint;
use proto::wire::Counters;
use serde::Serialize;

/// One period's points.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PointsLine<'a> {
    /// Who measured.
    pub node: &'a NodeId,
    /// The source's count of periods.
    pub period: u64,
    /// When, in the source's own time.
    pub time_s: f64,
    /// What was seen, in the node's frame.
    pub points: &'a [MeasuredPoint],
    /// What the node has done so far.
    pub counters: &'a Counters,
    /// How far behind a point the middle of its target lies.
    pub half_depth_m: f64,
    /// Standard deviation of that from target to target.
    pub half_depth_sigma_m: f64,
}

impl PointsLine<'_> {
    /// Writes the line with its end.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, mut output: impl Write) -> io::Result<()> {
        serde_json::to_writer(&mut output, self)?;
        output.write_all(b"\n")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_has_the_documented_keys() {
        let node = "n1".parse().unwrap();
        let point = MeasuredPoint {
            x_m: 1.0,
            y_m: 2.0,
            cov_m2: [0.1, 0.0, 0.2],
            snr_db: 20.0,
            extent_m2: [0.3, 0.0, 0.3],
            radial_velocity_m_per_s: None,
        };
        let line = PointsLine {
            node: &node,
            period: 3,
            time_s: 0.3,
            points: &[point],
            counters: &Counters { frame_count: 4, ..Counters::default() },
            half_depth_m: 0.13,
            half_depth_sigma_m: 0.05,
        };
        let mut text = Vec::new();
        line.write(&mut text).unwrap();
        let value: serde_json::Value = serde_json::from_slice(&text).unwrap();
        assert_eq!(value["node"], "n1");
        assert_eq!(value["points"][0]["cov_m2"], serde_json::json!([0.1, 0.0, 0.2]));
        assert_eq!(value["counters"]["frame_count"], 4);
        for key in ["period", "time_s", "half_depth_m", "half_depth_sigma_m"] {
            assert!(value[key].is_number(), "{key}");
        }
        assert_eq!(text.iter().filter(|byte| **byte == b'\n').count(), 1);
    }
}
