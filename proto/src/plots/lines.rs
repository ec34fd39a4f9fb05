//! Lines of CSV or JSON, fed in pieces of any size.

use csv::StringRecord;

use super::{COLUMNS, Group, PlotRow, RowFault, Scan};
use crate::ids::NodeId;
use crate::wire::{Dwell, Message};

/// Longest line, bytes: a dwell of the most reports, written as JSON.
const MAX_LINE_BYTES: usize = 4 << 20;
/// Longest part of a cell that is repeated in a complaint.
const SHOWN_LENGTH: usize = 40;

/// How a line holds a plot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LineKind {
    /// Comma-separated values; the first line names the columns.
    Csv,
    /// A JSON object: a plot with the columns as keys, or a whole dwell.
    Json,
}

/// A line that was left out.
#[derive(Clone, Debug, PartialEq)]
pub struct BadLine {
    /// Which, counted from 1.
    pub line: u64,
    /// Why.
    pub fault: RowFault,
}

/// Reads rows from bytes and joins them to scans.
#[derive(Clone, Debug)]
pub struct RowLines {
    kind: LineKind,
    group: Group,
    header: Option<StringRecord>,
    pending: Vec<u8>,
    is_skipping: bool,
    line: u64,
}

/// What a line gave.
type Taken = Result<Option<Scan>, RowFault>;

impl RowLines {
    /// Lines of `kind`; rows without a sensor's name are of `node`.
    #[must_use]
    pub fn new(kind: LineKind, node: NodeId) -> Self {
        let (group, pending) = (Group::new(node), Vec::new());
        Self { kind, group, header: None, pending, is_skipping: false, line: 0 }
    }

    /// Takes the next bytes; scans that are complete, and lines that were left out, go to `into`.
    pub fn feed(&mut self, bytes: &[u8], into: &mut Vec<Result<Scan, BadLine>>) {
        for piece in bytes.split_inclusive(|byte| *byte == b'\n') {
            let is_whole = piece.last() == Some(&b'\n');
            if !self.is_skipping && MAX_LINE_BYTES < self.pending.len() + piece.len() {
                self.is_skipping = true;
                self.pending.clear();
            }
            if !self.is_skipping {
                self.pending.extend_from_slice(piece);
            }
            if is_whole {
                self.end_line(into);
            }
        }
    }

    /// Ends the input: a last line without its end counts, and the open scan is complete.
    pub fn finish(&mut self, into: &mut Vec<Result<Scan, BadLine>>) {
        if !self.pending.is_empty() || self.is_skipping {
            self.end_line(into);
        }
        into.extend(self.group.finish().map(Ok));
    }

    fn end_line(&mut self, into: &mut Vec<Result<Scan, BadLine>>) {
        self.line += 1;
        let bytes = std::mem::take(&mut self.pending);
        let taken = if std::mem::take(&mut self.is_skipping) {
            Err(RowFault::TooLong { limit_bytes: MAX_LINE_BYTES })
        } else {
            self.take_line(&bytes, into)
        };
        match taken {
            Ok(scan) => into.extend(scan.map(Ok)),
            Err(fault) => into.push(Err(BadLine { line: self.line, fault })),
        }
        self.pending = bytes;
        self.pending.clear();
    }

    fn take_line(&mut self, bytes: &[u8], into: &mut Vec<Result<Scan, BadLine>>) -> Taken {
        let text = std::str::from_utf8(bytes).map_err(|_ignored| RowFault::NotText)?;
        let text = text.trim_start_matches('\u{feff}').trim();
        if text.is_empty() || text.starts_with('#') {
            return Ok(None);
        }
        match (self.kind, &self.header) {
            (LineKind::Json, _) => self.take_json(text, into),
            (LineKind::Csv, None) => {
                self.header = Some(header(text)?);
                Ok(None)
            }
            (LineKind::Csv, Some(columns)) => match csv_row(text, columns) {
                Ok(row) => self.group.take(&row),
                // Files joined end to end, and senders that connect again, name their columns again.
                Err(fault) => {
                    self.header = Some(header(text).map_err(|_ignored| fault)?);
                    Ok(None)
                }
            },
        }
    }

    /// A plot, or a dwell as a whole: the latter closes what is open.
    fn take_json(&mut self, text: &str, into: &mut Vec<Result<Scan, BadLine>>) -> Taken {
        let fault = |error: serde_json::Error| RowFault::Json {
            detail: error.to_string(),
            known: COLUMNS.join(", "),
        };
        if !text.contains("\"reports\"") {
            return self.group.take(&serde_json::from_str(text).map_err(fault)?);
        }
        let dwell: Dwell = serde_json::from_str(text).map_err(fault)?;
        dwell.check()?;
        into.extend(self.group.finish().map(Ok));
        Ok(Some(Scan::Geographic(Box::new(dwell))))
    }
}

fn header(text: &str) -> Result<StringRecord, RowFault> {
    let columns = record(text)?;
    for (index, column) in columns.iter().enumerate() {
        let is_repeated = columns.iter().take(index).any(|before| before == column);
        let problem = match (COLUMNS.contains(&column), is_repeated) {
            (false, _) => "unknown",
            (true, true) => "named twice",
            (true, false) => continue,
        };
        let column = shown(column);
        return Err(RowFault::Header { column, problem, known: COLUMNS.join(", ") });
    }
    Ok(columns)
}

fn csv_row(text: &str, columns: &StringRecord) -> Result<PlotRow, RowFault> {
    let cells = record(text)?;
    if cells.len() != columns.len() {
        return Err(RowFault::CellCount { got: cells.len(), want: columns.len() });
    }
    cells.deserialize(Some(columns)).map_err(|error| {
        let csv::ErrorKind::Deserialize { err, .. } = error.kind() else {
            return RowFault::NotText;
        };
        let index = err.field().and_then(|index| usize::try_from(index).ok());
        let cell = |record: &StringRecord| {
            shown(index.and_then(|index| record.get(index)).unwrap_or_default())
        };
        RowFault::Cell { column: cell(columns), text: cell(&cells), detail: err.kind().to_string() }
    })
}

/// The cells of one line.
fn record(text: &str) -> Result<StringRecord, RowFault> {
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let mut cells = StringRecord::new();
    reader.read_record(&mut cells).map_err(|_ignored| RowFault::NotText)?;
    Ok(cells)
}

fn shown(text: &str) -> String {
    text.chars().take(SHOWN_LENGTH).collect()
}
