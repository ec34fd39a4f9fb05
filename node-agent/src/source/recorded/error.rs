//! Why a recording cannot be read: the file, the line, the column, and what would do.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use super::{COLUMNS, MAX_STEP_BACK_S, MAX_TIME_S};

/// Why a recording cannot be read.
#[derive(Debug, Error)]
pub enum RecordingError {
    /// Neither CSV nor JSON Lines by its name.
    #[error("reading {path}: the name must end in .csv or .jsonl")]
    UnknownKind {
        /// The file.
        path: PathBuf,
    },
    /// The file cannot be opened.
    #[error("opening {path}")]
    Open {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// Reading broke off.
    #[error("reading {path}, line {line}")]
    Read {
        /// The file.
        path: PathBuf,
        /// Which line, counted from 1.
        line: u64,
        /// What the system says.
        source: io::Error,
    },
    /// Not one detection.
    #[error("reading {path}: it holds no detection; record again or name another file")]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// A line makes no sense.
    #[error("reading {path}, line {line}: {fault}")]
    Line {
        /// The file.
        path: PathBuf,
        /// Which line, counted from 1.
        line: u64,
        /// What is wrong with it.
        fault: LineFault,
    },
}

/// What is wrong with a line.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum LineFault {
    /// It is longer than any detection.
    #[error("longer than {limit_bytes} bytes; put one detection on each line")]
    TooLong {
        /// Longest line read.
        limit_bytes: u64,
    },
    /// Its bytes are not text.
    #[error("not UTF-8 text; save the file as UTF-8")]
    NotText,
    /// A column or key that every detection needs is not there.
    #[error("{column} is missing; every detection needs t_s, x_m and y_m")]
    MissingColumn {
        /// Its name.
        column: &'static str,
    },
    /// A column of the header has another name.
    #[error("unknown column {column:?}; remove it or rename it to one of {}", COLUMNS.join(", "))]
    UnknownColumn {
        /// Its name.
        column: String,
    },
    /// A column stands twice in the header.
    #[error("column {column:?} stands twice; remove one")]
    RepeatedColumn {
        /// Its name.
        column: String,
    },
    /// More or fewer cells than the header.
    #[error("{got} cells, the header has {want}; write one cell for each column")]
    CellCount {
        /// Cells of this line.
        got: usize,
        /// Cells of the header.
        want: usize,
    },
    /// A cell holds no finite number.
    #[error(
        "{column} is {text:?}; use a finite number (z_m, v_m_per_s and snr_db may be left empty)"
    )]
    BadNumber {
        /// Name of its column.
        column: &'static str,
        /// What it holds, cut to a readable length.
        text: String,
    },
    /// Not one JSON object of the known keys with finite numbers.
    #[error("character {character}: {reason}; write one object of numbers on each line, with keys of {}", COLUMNS.join(", "))]
    BadJson {
        /// Where in the line, counted from 1.
        character: usize,
        /// What the parser says.
        reason: String,
    },
    /// A time before zero or far in the future.
    #[error("t_s is {time_s}; use seconds from 0 to {MAX_TIME_S:e}")]
    TimeOutOfRange {
        /// The time.
        time_s: f64,
    },
    /// A time long before the latest one.
    #[error(
        "t_s falls from {latest_s} to {time_s}, by more than {MAX_STEP_BACK_S} s; split the recording where its clock was set back"
    )]
    TimeJumpsBack {
        /// The latest time so far.
        latest_s: f64,
        /// The time of this line.
        time_s: f64,
    },
    /// More detections than are held at once.
    #[error("more than {limit_count} detections; split the recording")]
    TooManyDetections {
        /// How many are held.
        limit_count: usize,
    },
}
