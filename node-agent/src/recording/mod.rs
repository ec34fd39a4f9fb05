//! Recorded echoes: NPZ and SigMF files in and out, one sweep at a time (`docs/recordings.md`).
//!
//! A recording states its band and its array; samples are `[channel][frequency]` in the phase
//! convention of [`crate::imaging`], an echo of delay `τ` turning as `exp(−j 2π f τ)`. Memory is that
//! of one sweep, the background and the list of times, and nothing is allocated on the word of a
//! header: buffers grow with data that was read.

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use proto::radar::{Array, Band};
use rustfft::num_complex::Complex;

use crate::imaging::canceller::CancellerConfig;
use crate::imaging::{InvalidSetting, Sweep, invalid};
use crate::pipeline::ChainConfig;

mod bytes;
mod check;
mod error;
mod mean;
mod npy;
mod npz;
mod numbers;
mod phase;
mod sigmf;
mod write;

#[cfg(test)]
mod damage;
#[cfg(test)]
mod faults;
#[cfg(test)]
mod tests;

use bytes::ByteSource;
use check::SweepShape;
use numbers::NumberType;

pub use error::{Place, RecordingError, RecordingFault};
pub(crate) use mean::SweepMean;
pub use phase::{PhaseSign, phase_sign};
pub use write::{NpzPacking, RecordingWriter};

/// Time between sweeps where a recording does not state it.
pub const ASSUMED_PERIOD_S: f64 = 0.1;
/// Sweeps looked at to tell the sign of the phase.
const PHASE_SWEEP_COUNT: u64 = 64;
/// Most samples held for that, 32 MiB.
const PHASE_SAMPLE_COUNT: u64 = 1 << 22;
/// Sweeps from one looked at to the next, at most: one second at 10 Hz, in which people move.
const PHASE_STRIDE: u64 = 10;

/// What a recording says before its first sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordingHeader {
    /// Frequencies.
    pub band: Band,
    /// Antennas, in metres in the node's frame.
    pub array: Array,
    /// The scene without targets, `[channel][frequency]`, channel `t · rx_count + r`.
    pub background: Option<Vec<Complex<f32>>>,
    /// Name of the node that recorded.
    pub node: Option<String>,
}

impl RecordingHeader {
    /// The settings `chain` for the radar of this recording.
    ///
    /// # Errors
    /// If they want a background that the recording has not.
    pub fn fitted(&self, chain: ChainConfig) -> Result<ChainConfig, InvalidSetting> {
        if self.background.is_none() && chain.canceller == CancellerConfig::Background {
            let remedy = "the recording has no array of this name: use another canceller";
            return Err(invalid("chain.canceller", chain.canceller, remedy));
        }
        Ok(chain.with_radar(self.band, self.array.clone()))
    }
}

/// When sweeps were taken.
#[derive(Clone, Debug, PartialEq)]
pub enum PeriodTimes {
    /// Seconds on the node's clock, one for each sweep, ascending.
    Listed(Vec<f64>),
    /// Evenly, as the recording says.
    Even {
        /// Time of the first sweep, seconds.
        first_s: f64,
        /// Time from one sweep to the next, seconds.
        period_s: f64,
    },
    /// The recording is silent: evenly from 0 with [`ASSUMED_PERIOD_S`].
    Assumed,
}

impl PeriodTimes {
    /// Time of sweep number `index`, seconds.
    #[must_use]
    pub fn time_s(&self, index: u64) -> f64 {
        match self {
            Self::Listed(time_s) => usize::try_from(index)
                .ok()
                .and_then(|index| time_s.get(index))
                .copied()
                .unwrap_or(f64::NAN),
            Self::Even { first_s, period_s } => first_s + period_s * index as f64,
            Self::Assumed => ASSUMED_PERIOD_S * index as f64,
        }
    }

    /// Whether the times are assumed, so that speeds and rates are only as good as that.
    #[must_use]
    pub fn are_assumed(&self) -> bool {
        *self == Self::Assumed
    }
}

/// In which order the samples of a sweep stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum SampleOrder {
    /// `[channel][frequency]`.
    ByChannel,
    /// `[frequency][channel]`.
    ByFrequency,
}

/// How the samples of a sweep are written.
#[derive(Clone, Copy, Debug)]
struct Samples {
    number: NumberType,
    order: SampleOrder,
    shape: SweepShape,
}

impl Samples {
    fn byte_count(&self) -> u64 {
        self.number.byte_count() * self.shape.sample_count() as u64
    }

    /// Reads one sweep and checks that all samples are numbers.
    fn read(
        &self,
        source: &mut ByteSource,
        period_index: u64,
    ) -> Result<Vec<Complex<f32>>, RecordingFault> {
        // What a header claims is not allocated beyond one piece; the rest grows as it is read.
        let mut samples = Vec::with_capacity(self.shape.sample_count().min(bytes::PIECE_BYTES / 8));
        source.for_pieces(self.byte_count(), |piece| {
            self.number.append_complex(piece, &mut samples);
        })?;
        if self.order == SampleOrder::ByFrequency {
            samples = transposed(&samples, self.shape.channel_count());
        }
        check::samples(&source.entry().name, self.shape, period_index, &samples)?;
        Ok(samples)
    }
}

/// `[column][row]` of `[row][column]`.
fn transposed(samples: &[Complex<f32>], column_count: usize) -> Vec<Complex<f32>> {
    (0..column_count).flat_map(|c| samples.iter().skip(c).step_by(column_count)).copied().collect()
}

/// What a format's reader hands over: all but the sweeps, and the source at the first of them.
#[derive(Debug)]
struct Contents {
    header: RecordingHeader,
    times: PeriodTimes,
    period_count: u64,
    samples: Samples,
    source: ByteSource,
    /// Bytes of the entry before the first sweep.
    first_byte: u64,
}

/// A recording, read sweep by sweep; also an iterator over its sweeps.
#[derive(Debug)]
pub struct Recording {
    path: PathBuf,
    file: File,
    contents: Contents,
    next_index: u64,
    is_over: bool,
    is_conjugated: bool,
}

impl Recording {
    /// Opens the recording at `path`, an NPZ archive or either file of a SigMF pair, and reads its
    /// header.
    ///
    /// # Errors
    /// Names the file, the array or field, what was found and what would do.
    pub fn open(path: &Path) -> Result<Self, RecordingError> {
        open_contents(path).map_err(|fault| RecordingError::new(path, fault)).map(
            |(file, contents)| Self {
                path: path.to_owned(),
                file,
                contents,
                next_index: 0,
                is_over: false,
                is_conjugated: false,
            },
        )
    }

    /// Band, array, background and name.
    #[must_use]
    pub fn header(&self) -> &RecordingHeader {
        &self.contents.header
    }

    /// When the sweeps were taken.
    #[must_use]
    pub fn times(&self) -> &PeriodTimes {
        &self.contents.times
    }

    /// How many sweeps there are, at least one. The last of a SigMF file may turn out to be cut off.
    #[must_use]
    pub fn period_count(&self) -> u64 {
        self.contents.period_count
    }

    /// Number of the sweep that is read next.
    #[must_use]
    pub fn next_index(&self) -> u64 {
        self.next_index
    }

    /// The same recording with every sample conjugated, for one in the opposite phase convention.
    #[must_use]
    pub fn conjugated(mut self) -> Self {
        self.is_conjugated = !self.is_conjugated;
        for sample in self.contents.header.background.iter_mut().flatten() {
            *sample = sample.conj();
        }
        self
    }

    /// The next sweep, `None` after the last. After an error there is none.
    ///
    /// The checksum of a recording read from its first to its last sweep is compared after the last
    /// one.
    ///
    /// # Errors
    /// Data that is cut off, damaged or not finite.
    pub fn next_sweep(&mut self) -> Result<Option<Sweep>, RecordingError> {
        if self.is_over {
            return Ok(None);
        }
        let outcome = self.read_next();
        self.is_over = !matches!(outcome, Ok(Some(_)));
        outcome.map_err(|fault| RecordingError::new(&self.path, fault))
    }

    fn read_next(&mut self) -> Result<Option<Sweep>, RecordingFault> {
        let Contents { samples, source, times, period_count, .. } = &mut self.contents;
        if *period_count <= self.next_index {
            return source.verify().map(|()| None);
        }
        let mut sweep = Sweep {
            time_s: times.time_s(self.next_index),
            samples: samples.read(source, self.next_index)?,
        };
        if self.is_conjugated {
            sweep.samples.iter_mut().for_each(|sample| *sample = sample.conj());
        }
        self.next_index += 1;
        Ok(Some(sweep))
    }

    /// Jumps over `sweep_count` sweeps, at most to the end.
    ///
    /// # Errors
    /// Packed data that is cut off or damaged on the way.
    pub fn skip_sweeps(&mut self, sweep_count: u64) -> Result<(), RecordingError> {
        let count = sweep_count.min(self.contents.period_count - self.next_index);
        if count == 0 || self.is_over {
            return Ok(());
        }
        let byte_count = count.saturating_mul(self.contents.samples.byte_count());
        let outcome = self.contents.source.jump(byte_count);
        self.is_over = outcome.is_err();
        self.next_index += count;
        outcome.map_err(|fault| RecordingError::new(&self.path, fault))
    }

    /// Goes back to the first sweep.
    ///
    /// # Errors
    /// If the file cannot be read any more.
    pub fn rewind(&mut self) -> Result<(), RecordingError> {
        let entry = self.contents.source.entry().clone();
        let reopened = ByteSource::open(&self.file, entry).and_then(|mut source| {
            source.pass(self.contents.first_byte)?;
            Ok(source)
        });
        self.contents.source = reopened.map_err(|fault| RecordingError::new(&self.path, fault))?;
        (self.next_index, self.is_over) = (0, false);
        Ok(())
    }

    /// Looks at sweeps of the first minute, tells the sign of the phase and goes back to the first
    /// sweep.
    ///
    /// # Errors
    /// [`RecordingFault::OppositePhase`] where echoes clearly stand at negative delays; what
    /// [`Recording::next_sweep`] finds.
    pub fn check_phase(&mut self) -> Result<PhaseSign, RecordingError> {
        self.rewind()?;
        let sweep_size = self.contents.samples.shape.sample_count() as u64;
        let wanted = PHASE_SWEEP_COUNT.min(PHASE_SAMPLE_COUNT / sweep_size).max(2);
        let stride = (self.period_count() / wanted).clamp(1, PHASE_STRIDE);
        let mut sweeps = Vec::new();
        while (sweeps.len() as u64) < wanted {
            let Some(sweep) = self.next_sweep()? else { break };
            sweeps.push(sweep);
            self.skip_sweeps(stride - 1)?;
        }
        self.rewind()?;
        let RecordingHeader { band, background, .. } = self.header();
        match phase_sign(&sweeps, band, background.as_deref()) {
            PhaseSign::Opposite => {
                let remedy = if self.is_conjugated {
                    "read it without --conjugate"
                } else {
                    "read it with --conjugate or record numpy.conj(echoes)"
                };
                Err(RecordingError::new(&self.path, RecordingFault::OppositePhase { remedy }))
            }
            sign => Ok(sign),
        }
    }
}

impl Iterator for Recording {
    type Item = Result<Sweep, RecordingError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.next_sweep().transpose()
    }
}

fn open_contents(path: &Path) -> Result<(File, Contents), RecordingFault> {
    if let Some(pair) = sigmf::Pair::of(path) {
        let meta = open_file(&pair.meta)?;
        let data = open_file(&pair.data)?;
        let contents = sigmf::read(&meta, &data)?;
        return Ok((data, contents));
    }
    let file = open_file(path)?;
    let mut magic = Vec::new();
    let look = (&file).take(4).read_to_end(&mut magic);
    look.map_err(|source| RecordingFault::Read { part: "the file".to_owned(), source })?;
    let is_named = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("npz"));
    if !magic.starts_with(b"PK") && !is_named {
        return Err(RecordingFault::UnknownKind);
    }
    let contents = npz::read(&file)?;
    Ok((file, contents))
}

/// Opens a regular file; a pipe would block without end.
fn open_file(path: &Path) -> Result<File, RecordingFault> {
    let fault = |source: io::Error| RecordingFault::Open { file: path.to_owned(), source };
    let kind = std::fs::metadata(path).map_err(fault)?;
    if !kind.is_file() {
        return Err(RecordingFault::NotAFile);
    }
    File::open(path).map_err(fault)
}
