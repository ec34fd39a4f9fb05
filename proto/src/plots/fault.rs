//! What can be wrong with a line of plots, and what would do.

use thiserror::Error;

use crate::wire::Invalid;

/// Why a line of plots was left out.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum RowFault {
    /// Longer than any line of plots.
    #[error("longer than {limit_bytes} bytes: put one plot on each line")]
    TooLong {
        /// Bytes allowed.
        limit_bytes: usize,
    },
    /// Not text.
    #[error("not UTF-8 text: is this a file of another kind? name it with --format")]
    NotText,
    /// The first line of a CSV file does not name its columns well.
    #[error("column {column:?} is {problem}: the first line names the columns, which are {known}")]
    Header {
        /// As given.
        column: String,
        /// `unknown` or `named twice`.
        problem: &'static str,
        /// All that are known.
        known: String,
    },
    /// A row has more or fewer cells than there are columns.
    #[error("{got} cells where the first line names {want} columns")]
    CellCount {
        /// Cells found.
        got: usize,
        /// Columns named.
        want: usize,
    },
    /// A cell holds no value of its column.
    #[error("{column} is {text:?}: {detail}")]
    Cell {
        /// Which.
        column: String,
        /// What it holds, cut to a readable length.
        text: String,
        /// What is wrong with it.
        detail: String,
    },
    /// Not a JSON object of a plot or of a dwell.
    #[error("{detail}: one JSON object per line with the keys {known} is expected, or a dwell")]
    Json {
        /// What is wrong, and where.
        detail: String,
        /// All keys that are known.
        known: String,
    },
    /// A value is missing.
    #[error("{field} is missing: {remedy}")]
    Missing {
        /// Which.
        field: &'static str,
        /// What would do.
        remedy: &'static str,
    },
    /// A value makes no sense.
    #[error(transparent)]
    Invalid(#[from] Invalid),
    /// Places of both kinds in one row.
    #[error("{first} and {second} are both given: use latitude and longitude, or x and y")]
    Both {
        /// The one.
        first: &'static str,
        /// The other.
        second: &'static str,
    },
}

impl RowFault {
    /// A short name, for counting.
    #[must_use]
    pub fn label(&self) -> &'static str {
        match self {
            Self::TooLong { .. } => "too_long",
            Self::NotText => "not_text",
            Self::Header { .. } => "header",
            Self::CellCount { .. } => "cell_count",
            Self::Cell { .. } => "cell",
            Self::Json { .. } => "json",
            Self::Missing { .. } => "missing",
            Self::Invalid(_) => "invalid",
            Self::Both { .. } => "both",
        }
    }
}
