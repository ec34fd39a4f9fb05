//! Recorded detections of a radar that images by itself, read from CSV or JSON Lines.
//!
//! Columns (CSV) or keys (JSON Lines): `t_s`, `x_m`, `y_m`, and where known `z_m`, `v_m_per_s`,
//! `snr_db`, in any order; see [`Detection`]. Files are read line by line. Lines, rows and times
//! have limits, so that a file of another kind is refused early.

mod error;

use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

use serde::Deserialize;

pub use error::{LineFault, RecordingError};

/// Longest line, bytes: six numbers with their names need less than 200.
const MAX_LINE_BYTES: u64 = 4096;
/// Largest number of detections held, about 1.2 GB: a file of another kind stops here.
const MAX_DETECTION_COUNT: usize = 1 << 24;
/// How far a time may lie before the latest one. Recorders that merge several threads disorder
/// frames by a few tenths of a second; a clock that was set back goes farther.
const MAX_STEP_BACK_S: f64 = 1.0;
/// Largest time: the year 5138 of Unix time. Milliseconds taken for seconds lie beyond.
const MAX_TIME_S: f64 = 1e11;

/// Names of the columns; the first [`REQUIRED_COUNT`] must be there.
const COLUMNS: [&str; 6] = ["t_s", "x_m", "y_m", "z_m", "v_m_per_s", "snr_db"];
const REQUIRED_COUNT: usize = 3;

/// One detection, in the sensor's own levelled frame: `x` to the right when looking along
/// boresight, `y` along boresight, `z` up from the sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// Seconds of the recording's clock, zero or more.
    pub time_s: f64,
    /// To the right, metres.
    pub x_m: f64,
    /// Along boresight, metres.
    pub y_m: f64,
    /// Up from the sensor, metres, where the radar measures it.
    pub z_m: Option<f64>,
    /// Speed away from the radar, where it measures it.
    pub v_m_per_s: Option<f64>,
    /// Power over noise as the radar states it, decibels.
    pub snr_db: Option<f64>,
}

/// What a file held.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// At least one detection, by time; those of equal time in the order of the file.
    pub detections: Vec<Detection>,
    /// How many stood after a later one.
    pub out_of_order_count: usize,
}

/// Reads the recording at `path`; the ending `.csv` or `.jsonl` says its kind.
///
/// # Errors
/// Names the file, the line, the column, and what would do.
pub fn read_recording(path: &Path) -> Result<Recording, RecordingError> {
    let parse = match path.extension().and_then(|extension| extension.to_str()) {
        Some("csv") => parse_csv,
        Some("jsonl") => parse_json_lines,
        _ => return Err(RecordingError::UnknownKind { path: path.to_owned() }),
    };
    let file = File::open(path)
        .map_err(|source| RecordingError::Open { path: path.to_owned(), source })?;
    parse(&file, path)
}

fn parse_csv(file: impl Read, path: &Path) -> Result<Recording, RecordingError> {
    let mut columns: Option<Vec<usize>> = None;
    let mut rows = Rows::new(MAX_DETECTION_COUNT);
    for_each_line(file, path, |text| match &columns {
        None => csv_columns(text).map(|known| columns = Some(known)),
        Some(known) => csv_row(text, known).and_then(|row| rows.push(row)),
    })?;
    rows.finish(path)
}

fn parse_json_lines(file: impl Read, path: &Path) -> Result<Recording, RecordingError> {
    let mut rows = Rows::new(MAX_DETECTION_COUNT);
    for_each_line(file, path, |text| {
        let row = serde_json::from_str(text).map_err(|error| json_fault(&error))?;
        rows.push(row)
    })?;
    rows.finish(path)
}

/// Hands every line that is not blank to `take`, never holding more than one.
fn for_each_line(
    file: impl Read,
    path: &Path,
    mut take: impl FnMut(&str) -> Result<(), LineFault>,
) -> Result<(), RecordingError> {
    let mut reader = BufReader::new(file);
    let mut bytes = Vec::new();
    for line in 1.. {
        bytes.clear();
        let mut bounded = reader.by_ref().take(MAX_LINE_BYTES + 1);
        let read = bounded.read_until(b'\n', &mut bytes);
        let read_error = |source| RecordingError::Read { path: path.to_owned(), line, source };
        if read.map_err(read_error)? == 0 {
            break;
        }
        let outcome =
            line_text(&bytes).and_then(|text| if text.is_empty() { Ok(()) } else { take(text) });
        outcome.map_err(|fault| RecordingError::Line { path: path.to_owned(), line, fault })?;
    }
    Ok(())
}

fn line_text(bytes: &[u8]) -> Result<&str, LineFault> {
    if MAX_LINE_BYTES < bytes.len() as u64 && bytes.last() != Some(&b'\n') {
        return Err(LineFault::TooLong { limit_bytes: MAX_LINE_BYTES });
    }
    let Ok(text) = std::str::from_utf8(bytes) else { return Err(LineFault::NotText) };
    // Some editors mark the start of a file so.
    Ok(text.trim_start_matches('\u{feff}').trim())
}

/// For every cell of a row the index in [`COLUMNS`] that the header gives it.
fn csv_columns(header: &str) -> Result<Vec<usize>, LineFault> {
    let mut columns = Vec::new();
    for column in csv_cells(header) {
        match COLUMNS.iter().position(|known| *known == column) {
            None => return Err(LineFault::UnknownColumn { column: column.to_owned() }),
            Some(index) if columns.contains(&index) => {
                return Err(LineFault::RepeatedColumn { column: column.to_owned() });
            }
            Some(index) => columns.push(index),
        }
    }
    match (0..REQUIRED_COUNT).find(|index| !columns.contains(index)) {
        Some(index) => Err(LineFault::MissingColumn { column: COLUMNS[index] }),
        None => Ok(columns),
    }
}

fn csv_row(text: &str, columns: &[usize]) -> Result<Row, LineFault> {
    let (got, want) = (csv_cells(text).count(), columns.len());
    if got != want {
        return Err(LineFault::CellCount { got, want });
    }
    let mut numbers = [None; COLUMNS.len()];
    for (cell, &index) in csv_cells(text).zip(columns) {
        let number: Option<f64> = cell.parse().ok().filter(|number: &f64| number.is_finite());
        let may_be_empty = REQUIRED_COUNT <= index;
        if number.is_none() && !(cell.is_empty() && may_be_empty) {
            let readable = cell.chars().take(40).collect();
            return Err(LineFault::BadNumber { column: COLUMNS[index], text: readable });
        }
        numbers[index] = number;
    }
    let [t_s, x_m, y_m, z_m, v_m_per_s, snr_db] = numbers;
    Ok(Row { t_s, x_m, y_m, z_m, v_m_per_s, snr_db })
}

/// The cells of a line. Neither names nor numbers hold a comma or a quote, so that quotes, which
/// some writers put around every cell, protect nothing.
fn csv_cells(text: &str) -> impl Iterator<Item = &str> {
    text.split(',').map(|cell| cell.trim().trim_matches('"').trim())
}

fn json_fault(error: &serde_json::Error) -> LineFault {
    // The parser is given one line at a time and calls each of them line 1.
    let text = error.to_string();
    let reason = text.rsplit_once(" at line ").map_or(text.as_str(), |(reason, _)| reason);
    LineFault::BadJson { character: error.column(), reason: reason.to_owned() }
}

/// One line as it stands; the names are those of [`COLUMNS`].
#[derive(Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields, expecting = "not an object of numbers")]
struct Row {
    t_s: Option<f64>,
    x_m: Option<f64>,
    y_m: Option<f64>,
    z_m: Option<f64>,
    v_m_per_s: Option<f64>,
    snr_db: Option<f64>,
}

impl Row {
    fn detection(&self) -> Result<Detection, LineFault> {
        let missing = |column| LineFault::MissingColumn { column };
        Ok(Detection {
            time_s: self.t_s.ok_or(missing("t_s"))?,
            x_m: self.x_m.ok_or(missing("x_m"))?,
            y_m: self.y_m.ok_or(missing("y_m"))?,
            z_m: self.z_m,
            v_m_per_s: self.v_m_per_s,
            snr_db: self.snr_db,
        })
    }
}

/// The detections so far.
struct Rows {
    limit_count: usize,
    latest_s: f64,
    recording: Recording,
}

impl Rows {
    fn new(limit_count: usize) -> Self {
        let recording = Recording { detections: Vec::new(), out_of_order_count: 0 };
        Self { limit_count, latest_s: 0.0, recording }
    }

    fn push(&mut self, row: Row) -> Result<(), LineFault> {
        let detection = row.detection()?;
        let (time_s, latest_s) = (detection.time_s, self.latest_s);
        if !(0.0..=MAX_TIME_S).contains(&time_s) {
            return Err(LineFault::TimeOutOfRange { time_s });
        }
        if time_s < latest_s - MAX_STEP_BACK_S {
            return Err(LineFault::TimeJumpsBack { latest_s, time_s });
        }
        if self.limit_count <= self.recording.detections.len() {
            return Err(LineFault::TooManyDetections { limit_count: self.limit_count });
        }
        self.recording.detections.push(detection);
        self.recording.out_of_order_count += usize::from(time_s < latest_s);
        self.latest_s = latest_s.max(time_s);
        Ok(())
    }

    fn finish(mut self, path: &Path) -> Result<Recording, RecordingError> {
        if self.recording.detections.is_empty() {
            return Err(RecordingError::Empty { path: path.to_owned() });
        }
        self.recording.detections.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        Ok(self.recording)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A reader that never gives more than seven bytes, so that lines are cut anywhere.
    struct Slowly<'a>(&'a [u8]);

    impl Read for Slowly<'_> {
        fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
            let end = buffer.len().min(7);
            self.0.read(&mut buffer[..end])
        }
    }

    /// A disk that fails.
    struct Broken;

    impl Read for Broken {
        fn read(&mut self, _: &mut [u8]) -> std::io::Result<usize> {
            Err(std::io::Error::other("broken"))
        }
    }

    fn csv_of(text: &str) -> Result<Recording, RecordingError> {
        parse_csv(Slowly(text.as_bytes()), Path::new("walk.csv"))
    }

    fn json_of(text: &str) -> Result<Recording, RecordingError> {
        parse_json_lines(Slowly(text.as_bytes()), Path::new("walk.jsonl"))
    }

    fn fault_of(outcome: Result<Recording, RecordingError>) -> (u64, LineFault) {
        match outcome.unwrap_err() {
            RecordingError::Line { line, fault, .. } => (line, fault),
            other => panic!("{other:?}"),
        }
    }

    fn detection(time_s: f64, x_m: f64, y_m: f64) -> Detection {
        Detection { time_s, x_m, y_m, z_m: None, v_m_per_s: None, snr_db: None }
    }

    #[test]
    fn both_kinds_give_the_same_detections_in_any_order_of_columns() {
        let whole = Detection {
            z_m: Some(-0.25),
            v_m_per_s: Some(-1.5),
            snr_db: Some(12.0),
            ..detection(0.05, 1.0, 2.0)
        };
        let expected = [whole, Detection { z_m: None, snr_db: None, ..whole }];
        let csv = csv_of(
            "\u{feff}snr_db,\"x_m\", y_m,t_s,v_m_per_s,z_m\r\n12,1,2,\"0.05\",-1.5,-0.25\r\n\r\n,1.0,2,5e-2,-1.5,",
        );
        assert_eq!(csv.unwrap().detections, expected);
        let json = json_of(
            "{\"snr_db\":12,\"x_m\":1,\"y_m\":2,\"t_s\":0.05,\"v_m_per_s\":-1.5,\"z_m\":-0.25}\n\n{\"z_m\":null,\"x_m\":1,\"y_m\":2,\"t_s\":0.05,\"v_m_per_s\":-1.5}",
        );
        assert_eq!(json.unwrap().detections, expected);
    }

    #[test]
    fn times_are_sorted_stably_and_the_disorder_is_counted() {
        let read = csv_of("t_s,x_m,y_m\n1,1,0\n0.9,2,0\n0.95,6,0\n1,3,0\n0.9,4,0\n2,5,0").unwrap();
        let order: Vec<f64> = read.detections.iter().map(|d| d.x_m).collect();
        assert_eq!(order, [2.0, 4.0, 6.0, 1.0, 3.0, 5.0]);
        assert_eq!(read.out_of_order_count, 3);
    }

    #[test]
    fn every_fault_of_a_csv_line_is_named_with_its_line() {
        let long = format!("t_s,x_m,y_m\n0,1,2\n0,1,{}\n", "1".repeat(5000));
        let name = |column: &str| column.to_owned();
        let cases = [
            ("t_s,x_m\n", 1, LineFault::MissingColumn { column: "y_m" }),
            ("\nt_s,x_m,y_m,speed\n", 2, LineFault::UnknownColumn { column: name("speed") }),
            ("t_s,x_m,y_m,x_m\n", 1, LineFault::RepeatedColumn { column: name("x_m") }),
            ("t_s,x_m,y_m\n0,1,2\n0,1\n", 3, LineFault::CellCount { got: 2, want: 3 }),
            ("t_s,x_m,y_m\n0,1,\n", 2, LineFault::BadNumber { column: "y_m", text: name("") }),
            (
                "t_s,x_m,y_m,z_m\n\n\n0,1,2,nan\n",
                4,
                LineFault::BadNumber { column: "z_m", text: name("nan") },
            ),
            (
                "t_s,x_m,y_m\n0,1e999,2\n",
                2,
                LineFault::BadNumber { column: "x_m", text: name("1e999") },
            ),
            ("t_s,x_m,y_m\n-0.1,1,2\n", 2, LineFault::TimeOutOfRange { time_s: -0.1 }),
            ("t_s,x_m,y_m\n1.7e12,1,2\n", 2, LineFault::TimeOutOfRange { time_s: 1.7e12 }),
            (
                "t_s,x_m,y_m\n5,1,2\n3.5,1,2\n",
                3,
                LineFault::TimeJumpsBack { latest_s: 5.0, time_s: 3.5 },
            ),
            (long.as_str(), 3, LineFault::TooLong { limit_bytes: MAX_LINE_BYTES }),
        ];
        for (text, line, fault) in cases {
            assert_eq!(fault_of(csv_of(text)), (line, fault), "{text:.60}");
        }
        let message = csv_of("t_s,x_m,y_m,speed\n").unwrap_err().to_string();
        assert_eq!(
            message,
            "reading walk.csv, line 1: unknown column \"speed\"; remove it or rename it to one of t_s, x_m, y_m, z_m, v_m_per_s, snr_db"
        );
    }

    #[test]
    fn every_fault_of_a_json_line_is_named_with_its_line() {
        let good = "{\"t_s\":0,\"x_m\":1,\"y_m\":2}\n";
        for (bad, what) in [
            ("{\"t_s\":0,\"x_m\":1,\"y_m\":2,\"speed\":3}", "speed"),
            ("{\"t_s\":0,\"x_m\":1,\"y_m\":2,\"x_m\":3}", "duplicate field `x_m`"),
            ("{\"t_s\":0,\"x_m\":NaN,\"y_m\":2}", "character"),
            ("{\"t_s\":0,\"x_m\":1e999,\"y_m\":2}", "out of range"),
            ("0,1,2", "an object of numbers"),
        ] {
            let error = json_of(&format!("{good}\n{bad}\n{good}")).unwrap_err();
            let is_json = matches!(
                &error,
                RecordingError::Line { line: 3, fault: LineFault::BadJson { .. }, .. }
            );
            assert!(is_json && error.to_string().contains(what), "{error}");
            assert!(!error.to_string().contains("line 1"), "{error}");
        }
        let missing = LineFault::MissingColumn { column: "t_s" };
        assert_eq!(fault_of(json_of("{\"x_m\":1,\"y_m\":2}")), (1, missing));
        let long = format!("{good}{}", " ".repeat(4097));
        assert_eq!(
            fault_of(json_of(&long)),
            (2, LineFault::TooLong { limit_bytes: MAX_LINE_BYTES })
        );
    }

    #[test]
    fn a_line_of_the_longest_length_is_read_and_rows_have_a_limit() {
        let padded = format!("t_s,x_m,y_m\n{:>4096}\n0,1,2", "0,1,2");
        assert_eq!(csv_of(&padded).unwrap().detections.len(), 2);
        let row: Row = serde_json::from_str("{\"t_s\":0,\"x_m\":1,\"y_m\":2}").unwrap();
        let mut rows = Rows::new(1);
        assert_eq!(rows.push(row), Ok(()));
        assert_eq!(rows.push(row), Err(LineFault::TooManyDetections { limit_count: 1 }));
    }

    #[test]
    fn files_that_are_no_recording_are_refused() {
        for empty in [csv_of(""), csv_of("t_s,x_m,y_m\n"), json_of("\n \n")] {
            assert!(matches!(empty, Err(RecordingError::Empty { .. })), "{empty:?}");
        }
        let bytes = parse_csv(&b"t_s,x_m,y_m\n0,\xff,1\n"[..], Path::new("walk.csv"));
        assert_eq!(fault_of(bytes), (2, LineFault::NotText));
        let broken = parse_csv((&b"t_s,x_m,y_m\n0,1,2\n"[..]).chain(Broken), Path::new("walk.csv"));
        assert!(matches!(broken, Err(RecordingError::Read { line: 3, .. })), "{broken:?}");
        let kind = read_recording(Path::new("walk.txt"));
        assert!(matches!(kind, Err(RecordingError::UnknownKind { .. })), "{kind:?}");
        let absent = read_recording(Path::new("no-such-folder/walk.csv"));
        assert!(matches!(absent, Err(RecordingError::Open { .. })), "{absent:?}");
    }

    #[test]
    fn the_ending_of_the_name_says_the_kind() {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in
            [("a.csv", "t_s,x_m,y_m\n0,1,2"), ("a.jsonl", "{\"t_s\":0,\"x_m\":1,\"y_m\":2}")]
        {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            assert_eq!(read_recording(&path).unwrap().detections, [detection(0.0, 1.0, 2.0)]);
        }
    }
}
