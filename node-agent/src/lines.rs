//! Point sets and tracks as JSON Lines, one line per period, and tracks as rows of a table.

use std::io::{self, Write};

use proto::ids::NodeId;
use proto::measured::MeasuredPoint;
use proto::wire::{Counters, TrackRecord, TrackStatus};
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

/// One period's tracks.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct TracksLine<'a> {
    /// Who follows.
    pub node: &'a NodeId,
    /// The source's count of periods.
    pub period: u64,
    /// When, in the source's own time.
    pub time_s: f64,
    /// Who is followed, in the node's frame, in ascending order of id.
    pub tracks: &'a [TrackRecord],
    /// How far behind a track's position the middle of the person lies.
    pub half_depth_m: f64,
    /// Standard deviation of that from person to person.
    pub half_depth_sigma_m: f64,
}

impl TracksLine<'_> {
    /// The names of the columns of [`Self::write_rows`].
    pub const COLUMNS: &'static str = "node,period,time_s,id,status,x_m,y_m,x_m_per_s,y_m_per_s,\
        cov_xx,cov_xy,cov_xu,cov_xv,cov_yy,cov_yu,cov_yv,cov_uu,cov_uv,cov_vv,\
        extent_xx_m2,extent_xy_m2,extent_yy_m2,appearance,unseen_s\n";

    /// Writes the line with its end.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn write(&self, mut output: impl Write) -> io::Result<()> {
        serde_json::to_writer(&mut output, self)?;
        output.write_all(b"\n")
    }

    /// Writes one row of comma-separated values for each track.
    ///
    /// # Errors
    /// If they cannot be written.
    pub fn write_rows(&self, mut output: impl Write) -> io::Result<()> {
        for track in self.tracks {
            let status = status_name(track.status);
            write!(output, "{},{},{},{},{status}", self.node, self.period, self.time_s, track.id)?;
            let numbers = track.state.iter().chain(&track.covariance).chain(&track.extent_m2);
            for number in numbers.chain([&track.appearance, &track.unseen_s]) {
                write!(output, ",{number}")?;
            }
            output.write_all(b"\n")?;
        }
        Ok(())
    }
}

/// The status in one word.
#[must_use]
pub fn status_name(status: TrackStatus) -> &'static str {
    match status {
        TrackStatus::Tentative => "tentative",
        TrackStatus::Confirmed => "confirmed",
        TrackStatus::Coasting => "coasting",
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

    #[test]
    fn tracks_have_the_documented_keys_and_columns() {
        let node = "n1".parse().unwrap();
        let track = TrackRecord {
            id: 7,
            status: TrackStatus::Coasting,
            state: [1.0, 2.0, 3.0, 4.0],
            covariance: [10.0, 11.0, 12.0, 13.0, 14.0, 15.0, 16.0, 17.0, 18.0, 19.0],
            extent_m2: [20.0, 21.0, 22.0],
            appearance: 0.5,
            unseen_s: 0.25,
        };
        let line = TracksLine {
            node: &node,
            period: 3,
            time_s: 0.3,
            tracks: &[track.clone(), track],
            half_depth_m: 0.1,
            half_depth_sigma_m: 0.05,
        };
        let (mut json, mut rows) = (Vec::new(), Vec::new());
        line.write(&mut json).unwrap();
        line.write_rows(&mut rows).unwrap();
        let value: serde_json::Value = serde_json::from_slice(&json).unwrap();
        assert_eq!(value["tracks"][0]["status"], "coasting");
        assert_eq!(value["tracks"][1]["state"], serde_json::json!([1.0, 2.0, 3.0, 4.0]));
        assert_eq!(value["tracks"][1]["covariance"].as_array().unwrap().len(), 10);
        for key in ["period", "time_s", "half_depth_m", "half_depth_sigma_m"] {
            assert!(value[key].is_number(), "{key}");
        }
        let rows = String::from_utf8(rows).unwrap();
        assert_eq!(rows.lines().count(), 2);
        let column_count = TracksLine::COLUMNS.split(',').count();
        assert!(rows.lines().all(|row| row.split(',').count() == column_count), "{rows}");
        assert!(rows.starts_with("n1,3,0.3,7,coasting,1,2,3,4,10,"), "{rows}");
        assert!(TracksLine::COLUMNS.ends_with("unseen_s\n") && !TracksLine::COLUMNS.contains(' '));
    }
}
