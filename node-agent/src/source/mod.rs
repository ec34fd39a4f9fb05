//! Where a node's sweeps come from: a simulated scene, recorded detections, recorded echoes.
//!
//! A source delivers one frame per period and says when in its own time the period was measured;
//! the service decides when that is in the world. Sources are passive and know no clock.

mod echoes;
pub mod recorded;
mod replay;
mod simulated;

use thiserror::Error;

pub use echoes::{Echoes, EchoesConfig};
pub use recorded::{Detection, RecordingError};
pub use replay::{Replay, ReplayConfig};
pub use simulated::{Move, Simulated, SimulatedConfig};

use crate::imaging::{InvalidSetting, Sweep};
use crate::recording;
use crate::simulate::Truth;

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
    /// The recorded echoes cannot be read.
    #[error(transparent)]
    Echoes(#[from] recording::RecordingError),
    /// The live source is not played.
    #[error("source is live: it cannot be played, only followed by a running agent")]
    Live,
    /// The chain's settings do not go with the recording.
    #[error("configuration: {0}")]
    Chain(InvalidSetting),
    /// There are fewer periods than were stated.
    #[error("period {period} is not in the recording: it ended before")]
    Ended {
        /// The first period that is missing.
        period: u64,
    },
}

/// A source of sweeps, one per period.
pub trait SweepSource: Send {
    /// How many periods there are; `None` without end.
    fn period_count(&self) -> Option<u64>;

    /// Seconds from the start of the source to the middle of a period, in the source's own time.
    fn middle_s(&self, period: u64) -> f64;

    /// What is truly in a period, for sources that know.
    fn truth(&self, _period: u64) -> Option<Truth> {
        None
    }

    /// What was measured in a period. Periods may be skipped but not repeated.
    ///
    /// # Errors
    /// If the source is damaged from here on.
    fn frame(&mut self, period: u64) -> Result<Frame, SourceError>;
}
