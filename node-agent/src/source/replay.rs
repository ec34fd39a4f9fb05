//! Detections of a recording, played period by period.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::recorded::{Detection, read_recording};
use super::{Frame, SourceError, SweepSource};
use crate::group::{Corrected, GroupConfig, by_window, corrected, window_index};

/// A recording to play.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ReplayConfig {
    /// CSV or JSON Lines file of detections.
    pub path: PathBuf,
    /// Time in the recording at which to start, seconds of its clock; nodes of one recording must
    /// use the same. The first detection's period if left out.
    pub first_s: Option<f64>,
    /// Number of periods to play; all if left out.
    pub period_count: Option<u64>,
}

/// The recorded source. Periods are windows of the recording's own clock, so that nodes of one
/// recording cut it at the same instants.
#[derive(Debug)]
pub struct Replay {
    period_s: f64,
    period_count: u64,
    /// By period; those without detections are not there.
    batches: BTreeMap<u64, Vec<Detection>>,
}

impl Replay {
    /// Reads the recording and cuts it into periods.
    ///
    /// # Errors
    /// If it cannot be read; the error names file, line and column.
    pub fn new(config: &ReplayConfig, group: &GroupConfig) -> Result<Self, SourceError> {
        let recording = read_recording(&config.path)?;
        if 0 < recording.out_of_order_count {
            let count = recording.out_of_order_count;
            tracing::warn!(path = %config.path.display(), count, "detections sorted by time");
        }
        let recorded_first = recording.detections.first().map_or(0.0, |first| first.time_s);
        let origin = window_index(config.first_s.unwrap_or(recorded_first), group.period_s);
        let Corrected { detections, floor } = corrected(recording.detections, group);
        if let Some(floor) = floor {
            tracing::info!(path = %config.path.display(), ?floor, "levelled by the floor's echo");
        }
        let batches: BTreeMap<u64, Vec<Detection>> = by_window(detections, group.period_s)
            .into_iter()
            .filter_map(|(window, inside)| Some((window.checked_sub(origin)?, inside)))
            .collect();
        let recorded_count = batches.keys().next_back().map_or(0, |last| last + 1);
        let period_count =
            config.period_count.map_or(recorded_count, |count| count.min(recorded_count));
        Ok(Self { period_s: group.period_s, period_count, batches })
    }
}

impl SweepSource for Replay {
    fn period_count(&self) -> Option<u64> {
        Some(self.period_count)
    }

    fn middle_s(&self, period: u64) -> f64 {
        self.period_s * (period as f64 + 0.5)
    }

    fn frame(&mut self, period: u64) -> Result<Frame, SourceError> {
        Ok(Frame::Detections(self.batches.get(&period).cloned().unwrap_or_default()))
    }
}
