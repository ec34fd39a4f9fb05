//! Why a recording cannot be read or written: the file, the array or field, and what would do.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use proto::radar::InvalidRadar;
use thiserror::Error;

/// Why a recording cannot be read or written.
#[derive(Debug, Error)]
#[error("recording {path:?}: {fault}")]
pub struct RecordingError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    #[source]
    pub fault: Box<RecordingFault>,
}

impl RecordingError {
    pub(super) fn new(path: &Path, fault: RecordingFault) -> Self {
        Self { path: path.to_owned(), fault: Box::new(fault) }
    }
}

/// Which sample of a recording, each index from 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Number of the sweep.
    pub period_index: u64,
    /// Transmitter.
    pub tx_index: usize,
    /// Receiver.
    pub rx_index: usize,
    /// Frequency.
    pub frequency_index: usize,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { period_index, tx_index, rx_index, frequency_index } = self;
        write!(f, "period {period_index}, tx {tx_index}, rx {rx_index}, freq {frequency_index}")
    }
}

/// What is wrong with a recording.
#[derive(Debug, Error)]
pub enum RecordingFault {
    /// Neither NPZ nor SigMF.
    #[error(
        "no recording of echoes; name an .npz or .sigmf-meta file, and unpack a .sigmf archive with tar first"
    )]
    UnknownKind,
    /// A folder, a pipe or a device.
    #[error("not a regular file; name the file itself")]
    NotAFile,
    /// The system does not let it be opened.
    #[error("opening {file:?} fails: {source}; check that it is there and may be read")]
    Open {
        /// The file, one of the pair of a SigMF recording.
        file: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// Reading broke off.
    #[error("reading {part} fails: {source}; copy the file again")]
    Read {
        /// Array or file.
        part: String,
        /// What the system says.
        source: io::Error,
    },
    /// Writing broke off.
    #[error("writing {part} fails: {source}; check the folder and its free space")]
    Write {
        /// Array or file.
        part: String,
        /// What the system says.
        source: io::Error,
    },
    /// The archive cannot be listed.
    #[error("the archive is damaged or cut off ({reason}); copy the file again or record again")]
    Archive {
        /// What the reader says.
        reason: String,
    },
    /// An array is packed in a way that is not read.
    #[error("array {array} is packed as {found}; write it with numpy.savez or savez_compressed")]
    Packing {
        /// Its name.
        array: String,
        /// What was found.
        found: String,
    },
    /// An array that every recording needs is not there.
    #[error("array {array} is missing; add it as {expected}")]
    MissingArray {
        /// Its name.
        array: String,
        /// What it must be.
        expected: &'static str,
    },
    /// An array whose name may be misspelt.
    #[error("array {array:?} may be meant for {meant:?}; rename it, so that it is not mistaken")]
    UnknownArray {
        /// Its name.
        array: String,
        /// The name that it may stand for.
        meant: &'static str,
    },
    /// An array's own description cannot be read.
    #[error("array {array} has an unreadable header ({reason}); write it with numpy")]
    ArrayHeader {
        /// Its name.
        array: String,
        /// What is wrong.
        reason: String,
    },
    /// Numbers of another type.
    #[error("array {array} is {found}; convert it to {expected}")]
    NumberType {
        /// Its name.
        array: String,
        /// Its type, as numpy writes it.
        found: String,
        /// What would do.
        expected: &'static str,
    },
    /// The first axis runs fastest.
    #[error("array {array} is in Fortran order; write numpy.ascontiguousarray({array})")]
    FortranOrder {
        /// Its name.
        array: String,
    },
    /// A shape that does not fit the others.
    #[error("{array} has the shape {found:?}; expected {expected}")]
    Shape {
        /// Array or field.
        array: String,
        /// Its shape.
        found: Vec<u64>,
        /// What would fit.
        expected: String,
    },
    /// More than is ever read.
    #[error(
        "{part} has {found} {unit}, more than {limit}; split the recording or check the header"
    )]
    TooLarge {
        /// Array, field or file.
        part: String,
        /// How many.
        found: u64,
        /// How many are read.
        limit: u64,
        /// Of what.
        unit: &'static str,
    },
    /// Less data than announced.
    #[error(
        "{part} ends after {found} bytes, {expected} are announced; copy the file again or record again"
    )]
    Truncated {
        /// Array or file.
        part: String,
        /// Bytes there.
        found: u64,
        /// Bytes announced.
        expected: u64,
    },
    /// The data is not what was written.
    #[error("{part} is damaged ({reason}); copy the file again")]
    Damaged {
        /// Array or file.
        part: String,
        /// What shows it.
        reason: String,
    },
    /// Not one sweep.
    #[error("it holds no period; record again or name another file")]
    NoPeriods,
    /// A sample that is no number, or too large for single precision.
    #[error("{array} holds {value} at {place}; remove or replace that sweep")]
    SampleNotFinite {
        /// Array or file.
        array: String,
        /// Where.
        place: Place,
        /// What stands there.
        value: String,
    },
    /// An entry of an array or list that is no number.
    #[error("{array}[{index}] is {value}; use finite numbers")]
    NotFinite {
        /// Array or field.
        array: String,
        /// Index in the order of the file, from 0.
        index: usize,
        /// What stands there.
        value: f64,
    },
    /// Time does not go on.
    #[error("the time of period {index} is {time_s} s after {before_s} s; times must ascend")]
    TimesNotAscending {
        /// Number of the period, from 0.
        index: u64,
        /// Time of the period before.
        before_s: f64,
        /// Its time.
        time_s: f64,
    },
    /// Frequencies that fall or stay.
    #[error(
        "freq_hz[{index}] is {found_hz} Hz after {before_hz} Hz; sort the frequencies and the samples in ascending order"
    )]
    FrequenciesNotAscending {
        /// Index, from 0.
        index: usize,
        /// The frequency before.
        before_hz: f64,
        /// The frequency.
        found_hz: f64,
    },
    /// Frequencies that are not equally spaced.
    #[error(
        "freq_hz[{index}] is {found_hz} Hz, an even grid has {expected_hz} Hz; use equal steps (to {tolerance} of a step)"
    )]
    FrequenciesNotUniform {
        /// Index, from 0.
        index: usize,
        /// The frequency.
        found_hz: f64,
        /// What the first and the last one give.
        expected_hz: f64,
        /// Largest deviation, in steps.
        tolerance: f64,
    },
    /// A radar that makes no sense.
    #[error(transparent)]
    Radar(InvalidRadar),
    /// The metadata is no JSON object.
    #[error("the metadata is no JSON: {reason}; write one JSON object in UTF-8")]
    Json {
        /// What the parser says, with line and column.
        reason: String,
    },
    /// A field of the metadata that is missing or unusable.
    #[error("field {field} is {found}; expected {expected}")]
    Field {
        /// Its name.
        field: String,
        /// What stands there, cut to a readable length.
        found: String,
        /// What would do.
        expected: String,
    },
    /// An extension without which the data may mean something else.
    #[error(
        "it needs the SigMF extension {name:?}, which is not known here; convert it or declare the extension optional"
    )]
    Extension {
        /// Its name.
        name: String,
    },
    /// The samples turn the other way.
    #[error(
        "its echoes stand at negative delays: read so, the samples are exp(+j 2 pi f tau), documented is exp(-j 2 pi f tau); {remedy}"
    )]
    OppositePhase {
        /// What would do.
        remedy: &'static str,
    },
}
