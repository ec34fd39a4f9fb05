//! The sweeps of a source into a recording, with the truth beside them where the source knows it.

use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use indicatif::ProgressBar;
use tempfile::NamedTempFile;
use thiserror::Error;
use tokio_util::sync::CancellationToken;

use super::truth::{TruthLine, truth_path};
use crate::config::Opened;
use crate::recording::{RecordingError, RecordingHeader, RecordingWriter};
use crate::source::{Frame, SourceError};

/// Why a recording was not written.
#[derive(Debug, Error)]
pub enum RecordError {
    /// The source is damaged.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The recording cannot be written.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The source delivers detections.
    #[error("the source delivers detections, not sweeps: use source simulated or echoes")]
    NoSweeps,
    /// The source has no end.
    #[error("the source has no end: say how many periods with --periods")]
    NoEnd,
    /// The truth cannot be written.
    #[error("writing the truth {path:?}: {reason}")]
    Truth {
        /// The file.
        path: PathBuf,
        /// What the system says.
        reason: io::Error,
    },
}

/// Writes the first `period_count` periods of `opened` (all, if not said) to `path`, and the truth
/// to `NAME.truth.jsonl` beside it. Ends early with `stop`; what was recorded until then is kept.
/// Returns the number of sweeps written.
///
/// # Errors
/// If the source ends early or delivers no sweeps, or a file cannot be written.
pub fn record(
    mut opened: Opened,
    path: &Path,
    period_count: Option<u64>,
    progress: &ProgressBar,
    stop: &CancellationToken,
) -> Result<u64, RecordError> {
    let available = opened.source.period_count();
    let wanted = match (period_count, available) {
        (Some(wanted), Some(available)) => wanted.min(available),
        (Some(count), None) | (None, Some(count)) => count,
        (None, None) => return Err(RecordError::NoEnd),
    };
    progress.set_length(wanted);
    let chain = &opened.config.chain;
    let header = RecordingHeader {
        band: chain.band,
        array: chain.array.clone(),
        background: opened.background.take(),
        node: Some(opened.config.node.to_string()),
    };
    let mut writer = RecordingWriter::create(path, header)?;
    let mut truth = TruthFile::beside(path);
    let mut written_count = 0;
    for period in 0..wanted {
        if stop.is_cancelled() {
            break;
        }
        let Frame::Sweep(sweep) = opened.source.frame(period)? else {
            return Err(RecordError::NoSweeps);
        };
        writer.write_sweep(&sweep)?;
        if let Some(known) = opened.source.truth(period) {
            truth.take(&TruthLine::of(period, sweep.time_s, &known))?;
        }
        written_count += 1;
        progress.inc(1);
    }
    writer.finish()?;
    truth.finish()?;
    progress.finish_and_clear();
    Ok(written_count)
}

/// The file of the truth, made when the first line comes; it has its name when it is whole.
struct TruthFile {
    path: PathBuf,
    output: Option<BufWriter<NamedTempFile>>,
}

impl TruthFile {
    fn beside(recording: &Path) -> Self {
        Self { path: truth_path(recording), output: None }
    }

    fn take(&mut self, line: &TruthLine) -> Result<(), RecordError> {
        let written = self.try_take(line);
        written.map_err(|reason| RecordError::Truth { path: self.path.clone(), reason })
    }

    fn try_take(&mut self, line: &TruthLine) -> io::Result<()> {
        let output = match &mut self.output {
            Some(output) => output,
            none => {
                let folder = self.path.parent().filter(|folder| !folder.as_os_str().is_empty());
                let file = NamedTempFile::new_in(folder.unwrap_or(Path::new(".")))?;
                none.insert(BufWriter::new(file))
            }
        };
        serde_json::to_writer(&mut *output, line)?;
        output.write_all(b"\n")
    }

    fn finish(self) -> Result<(), RecordError> {
        let Self { path, output } = self;
        let Some(output) = output else { return Ok(()) };
        let file = output.into_inner().map_err(io::IntoInnerError::into_error);
        let kept = file.and_then(|file| Ok(file.persist(&path).map(drop)?));
        kept.map_err(|reason| RecordError::Truth { path, reason })
    }
}
