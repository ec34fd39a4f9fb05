//! Raw sweeps of a recording, played period by period.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use super::{Frame, SourceError, SweepSource};
use crate::recording::{Recording, RecordingError};

/// A recording of echoes to play.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct EchoesConfig {
    /// NPZ or SigMF file (`docs/recordings.md`).
    pub path: PathBuf,
    /// The recording has the opposite phase convention, `exp(+j 2π f τ)`.
    pub conjugate: bool,
    /// Number of periods to play; all if left out.
    pub period_count: Option<u64>,
}

impl EchoesConfig {
    /// Opens the recording at its first sweep.
    ///
    /// # Errors
    /// If it cannot be read, or has clearly the other phase convention.
    pub fn open(&self) -> Result<Recording, RecordingError> {
        let recording = Recording::open(&self.path)?;
        let mut recording = if self.conjugate { recording.conjugated() } else { recording };
        let sign = recording.check_phase()?;
        let path = self.path.display();
        tracing::debug!(%path, ?sign, "sign of the phase");
        if recording.times().are_assumed() {
            tracing::warn!(%path, "the recording states no times: 0.1 s per period assumed");
        }
        Ok(recording)
    }
}

/// The source of recorded echoes.
#[derive(Debug)]
pub struct Echoes {
    recording: Recording,
    period_count: u64,
}

impl Echoes {
    /// Opens the recording.
    ///
    /// # Errors
    /// If it cannot be read, or has clearly the other phase convention.
    pub fn new(config: &EchoesConfig) -> Result<Self, SourceError> {
        let recording = config.open()?;
        let recorded_count = recording.period_count();
        let period_count =
            config.period_count.map_or(recorded_count, |count| count.min(recorded_count));
        Ok(Self { recording, period_count })
    }

    /// The recording, for what it says of its radar.
    #[must_use]
    pub fn recording(&self) -> &Recording {
        &self.recording
    }
}

impl SweepSource for Echoes {
    fn period_count(&self) -> Option<u64> {
        Some(self.period_count)
    }

    fn middle_s(&self, period: u64) -> f64 {
        let times = self.recording.times();
        times.time_s(period) - times.time_s(0)
    }

    fn frame(&mut self, period: u64) -> Result<Frame, SourceError> {
        self.recording.skip_sweeps(period.saturating_sub(self.recording.next_index()))?;
        let sweep = self.recording.next_sweep()?;
        sweep.map(Frame::Sweep).ok_or(SourceError::Ended { period })
    }
}
