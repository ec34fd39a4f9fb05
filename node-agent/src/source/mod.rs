//! Where a node's sweeps come from: a simulated scene or a recording.
//!
//! A source delivers one frame per period and says when in its own time the period was measured;
//! the service decides when that is in the world. Sources are passive and know no clock.

pub mod recorded;
mod replay;
mod simulated;

use thiserror::Error;

pub use recorded::{Detection, RecordingError};
pub use replay::{Replay, ReplayConfig};
pub use simulated::{Simulated, SimulatedConfig};

use crate::imaging::{InvalidSetting, Sweep};

/// What a source delivers for one period.
#[derive(Clone, Debug, PartialEq)]
pub enum Frame {
    /// Raw frequency samples, to be imaged.
    Sweep(Sweep),
    /// Detections of a radar that images by itself, to be grouped.
    Detections(Vec<Detection>),
}

/// Why a source cannot be used.
#[derive(Debug, Error)]
pub enum SourceError {
    /// The scene or the radar makes no sense.
    #[error("simulated source: {0}")]
    Simulated(#[from] InvalidSetting),
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
}

/// A source of sweeps, one per period.
pub trait SweepSource: Send {
    /// How many periods there are; `None` without end.
    fn period_count(&self) -> Option<u64>;

    /// Seconds from the start of the source to the middle of a period, in the source's own time.
    fn middle_s(&self, period: u64) -> f64;

    /// What was measured in a period. Periods may be skipped but not repeated.
    fn frame(&mut self, period: u64) -> Frame;
}
