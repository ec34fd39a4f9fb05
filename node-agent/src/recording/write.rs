//! Writes recordings sweep by sweep; a file has its final name only when it is whole.
//!
//! Sweeps go to a temporary file in the same folder. `finish` packs it (NPZ, for a moment twice the
//! space) or writes the metadata (SigMF), flushes to disk and renames.

use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use rustfft::num_complex::Complex;
use serde_json::{Value, json};
use sha2::{Digest, Sha512};
use tempfile::NamedTempFile;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::bytes::hexadecimal;
use super::check::{self, SweepShape};
use super::error::{RecordingError, RecordingFault};
use super::npy::header_bytes;
use super::numbers::bytes_of;
use super::sigmf::{self, Pair, field};
use super::{RecordingHeader, transposed};
use crate::imaging::Sweep;

/// Most times that metadata lists: 40 bytes for each keep it within what is read, 11 h at 10 Hz.
const MAX_SIGMF_PERIOD_COUNT: u64 = sigmf::MAX_META_BYTES / 40;

/// How an NPZ archive is packed. Noise hardly shrinks, so that `Stored` is the usual choice.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum NpzPacking {
    /// As numpy.savez does.
    #[default]
    Stored,
    /// As `numpy.savez_compressed` does.
    Deflated,
}

#[derive(Debug)]
enum Target {
    Npz(PathBuf),
    Sigmf(Pair),
}

/// Writes one recording.
#[derive(Debug)]
pub struct RecordingWriter {
    path: PathBuf,
    target: Target,
    packing: NpzPacking,
    header: RecordingHeader,
    shape: SweepShape,
    data: BufWriter<NamedTempFile>,
    hash: Sha512,
    time_s: Vec<f64>,
}

impl RecordingWriter {
    /// Begins a recording at `path`, which ends in `.npz`, `.sigmf-meta` or `.sigmf-data`.
    ///
    /// # Errors
    /// Another ending, a header that makes no sense, a folder that cannot be written.
    pub fn create(path: &Path, header: RecordingHeader) -> Result<Self, RecordingError> {
        Self::begin(path, header).map_err(|fault| RecordingError::new(path, fault))
    }

    fn begin(path: &Path, header: RecordingHeader) -> Result<Self, RecordingFault> {
        let is_npz = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("npz"));
        let target = match Pair::of(path) {
            Some(pair) => Target::Sigmf(pair),
            None if is_npz => Target::Npz(path.to_owned()),
            None => return Err(RecordingFault::UnknownKind),
        };
        header.band.check().map_err(RecordingFault::Radar)?;
        header.array.check().map_err(RecordingFault::Radar)?;
        let shape = SweepShape::of(&header.band, &header.array);
        let sample_count = shape.sample_count() as u64;
        check::at_most("a sweep", sample_count, check::MAX_SWEEP_SAMPLE_COUNT, "samples")?;
        let name_length = header.node.iter().flat_map(|name| name.chars()).count() as u64;
        check::at_most("node", name_length, super::npz::MAX_NAME_LENGTH, "characters")?;
        if let Some(background) = &header.background {
            fits("background", shape, background)?;
            check::samples("background", shape, 0, background)?;
        }
        let data = temporary_beside(path).map_err(|source| write_fault("the sweeps", source))?;
        let mut writer = Self {
            path: path.to_owned(),
            target,
            packing: NpzPacking::default(),
            header,
            shape,
            data: BufWriter::new(data),
            hash: Sha512::default(),
            time_s: Vec::new(),
        };
        // SigMF has the background in its leading sweep.
        if let (Target::Sigmf(_), Some(background)) = (&writer.target, &writer.header.background) {
            let bytes = bytes_of(&by_frequency(background, shape));
            writer.append(&bytes)?;
        }
        Ok(writer)
    }

    /// Packs an NPZ archive so; SigMF is never packed.
    #[must_use]
    pub fn packed(mut self, packing: NpzPacking) -> Self {
        self.packing = packing;
        self
    }

    /// Appends one sweep. One that is refused leaves the recording as it was.
    ///
    /// # Errors
    /// A sweep of another shape, not finite, or not after the one before; a disk that is full.
    pub fn write_sweep(&mut self, sweep: &Sweep) -> Result<(), RecordingError> {
        self.append_sweep(sweep).map_err(|fault| RecordingError::new(&self.path, fault))
    }

    fn append_sweep(&mut self, sweep: &Sweep) -> Result<(), RecordingFault> {
        let index = self.time_s.len() as u64;
        let limit = match self.target {
            Target::Npz(_) => check::MAX_LISTED_PERIOD_COUNT,
            Target::Sigmf(_) => MAX_SIGMF_PERIOD_COUNT,
        };
        check::at_most("the recording", index + 1, limit, "sweeps")?;
        fits("a sweep", self.shape, &sweep.samples)?;
        check::samples("a sweep", self.shape, index, &sweep.samples)?;
        check::finite("time_s", &[sweep.time_s])?;
        if let Some(before_s) = self.time_s.last().copied().filter(|last| sweep.time_s <= *last) {
            let time_s = sweep.time_s;
            return Err(RecordingFault::TimesNotAscending { index, before_s, time_s });
        }
        let bytes = match self.target {
            Target::Npz(_) => bytes_of(&sweep.samples),
            Target::Sigmf(_) => bytes_of(&by_frequency(&sweep.samples, self.shape)),
        };
        self.append(&bytes)?;
        self.time_s.push(sweep.time_s);
        Ok(())
    }

    fn append(&mut self, bytes: &[u8]) -> Result<(), RecordingFault> {
        if matches!(self.target, Target::Sigmf(_)) {
            self.hash.update(bytes);
        }
        self.data.write_all(bytes).map_err(|source| write_fault("the sweeps", source))
    }

    /// Completes the recording and gives it its name. A recording that was there is replaced.
    ///
    /// # Errors
    /// No sweep at all; a disk that is full. Nothing is left behind then.
    pub fn finish(self) -> Result<(), RecordingError> {
        let path = self.path.clone();
        self.complete().map_err(|fault| RecordingError::new(&path, fault))
    }

    fn complete(self) -> Result<(), RecordingFault> {
        if self.time_s.is_empty() {
            return Err(RecordingFault::NoPeriods);
        }
        match &self.target {
            Target::Npz(path) => {
                let path = path.clone();
                self.complete_npz(&path).map_err(|source| write_fault("the archive", source))
            }
            Target::Sigmf(pair) => {
                let pair = pair.clone();
                self.complete_sigmf(&pair).map_err(|source| write_fault("the pair", source))
            }
        }
    }

    fn complete_npz(self, path: &Path) -> io::Result<()> {
        let mut sweeps = self.data.into_inner().map_err(io::IntoInnerError::into_error)?;
        sweeps.seek(SeekFrom::Start(0))?;
        let band = &self.header.band;
        let freq_hz: Vec<f64> = (0..band.step_count).map(|k| band.frequency_hz(k)).collect();
        let mut archive = NpzWriter::new(BufWriter::new(temporary_beside(path)?), self.packing);
        archive.real("freq_hz", &[freq_hz.len()], &freq_hz)?;
        for (name, antennas) in
            [("tx_m", &self.header.array.tx_m), ("rx_m", &self.header.array.rx_m)]
        {
            archive.real(name, &[antennas.len(), 2], antennas.as_flattened())?;
        }
        archive.real("period_time_s", &[self.time_s.len()], &self.time_s)?;
        let SweepShape { tx_count, rx_count, step_count } = self.shape;
        if let Some(background) = &self.header.background {
            archive.begin("background", "<c8", &[tx_count, rx_count, step_count])?;
            archive.zip.write_all(&bytes_of(background))?;
        }
        if let Some(name) = &self.header.node {
            archive.begin("node", &format!("<U{}", name.chars().count()), &[])?;
            let bytes: Vec<u8> = name.chars().flat_map(|c| u32::from(c).to_le_bytes()).collect();
            archive.zip.write_all(&bytes)?;
        }
        archive.begin("echoes", "<c8", &[self.time_s.len(), tx_count, rx_count, step_count])?;
        io::copy(&mut sweeps, &mut archive.zip)?;
        let file = archive.zip.finish()?.into_inner().map_err(io::IntoInnerError::into_error)?;
        publish(file, path)
    }

    fn complete_sigmf(self, pair: &Pair) -> io::Result<()> {
        let data = self.data.into_inner().map_err(io::IntoInnerError::into_error)?;
        let mut meta = BufWriter::new(temporary_beside(&pair.meta)?);
        let fields = metadata(&self.header, &self.time_s, &hexadecimal(&self.hash.finalize()));
        serde_json::to_writer_pretty(&mut meta, &fields)?;
        // Old metadata must not describe new data, not even for a moment.
        match std::fs::remove_file(&pair.meta) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        publish(data, &pair.data)?;
        publish(meta.into_inner().map_err(io::IntoInnerError::into_error)?, &pair.meta)
    }
}

fn metadata(header: &RecordingHeader, time_s: &[f64], sha512: &str) -> Value {
    let channel_count = header.array.channel_count();
    let mut global = json!({
        "core:datatype": "cf32_le",
        "core:version": sigmf::SIGMF_VERSION,
        "core:num_channels": channel_count,
        "core:sha512": sha512,
        "core:extensions": [{
            "name": sigmf::EXTENSION, "version": sigmf::EXTENSION_VERSION, "optional": false,
        }],
    });
    let own = [
        (field::START_HZ, json!(header.band.start_hz)),
        (field::STEP_HZ, json!(header.band.step_hz)),
        (field::STEP_COUNT, json!(header.band.step_count)),
        (field::TX_M, json!(header.array.tx_m)),
        (field::RX_M, json!(header.array.rx_m)),
        (field::PERIOD_TIME_S, json!(time_s)),
        (field::BACKGROUND_COUNT, json!(u8::from(header.background.is_some()))),
        (field::NODE, json!(header.node)),
    ];
    for (key, value) in own.into_iter().filter(|(_, value)| !value.is_null()) {
        global[format!("{}:{key}", sigmf::EXTENSION)] = value;
    }
    json!({ "global": global, "captures": [{ "core:sample_start": 0 }], "annotations": [] })
}

struct NpzWriter {
    zip: ZipWriter<BufWriter<NamedTempFile>>,
    options: SimpleFileOptions,
}

impl NpzWriter {
    fn new(file: BufWriter<NamedTempFile>, packing: NpzPacking) -> Self {
        let method = match packing {
            NpzPacking::Stored => CompressionMethod::Stored,
            NpzPacking::Deflated => CompressionMethod::Deflated,
        };
        // Sizes of 64 bits: nobody knows beforehand what becomes of 4 GiB.
        let options = SimpleFileOptions::default().compression_method(method).large_file(true);
        Self { zip: ZipWriter::new(file), options }
    }

    fn begin(&mut self, name: &str, descr: &str, shape: &[usize]) -> io::Result<()> {
        self.zip.start_file(format!("{name}.npy"), self.options)?;
        let axes: Vec<u64> = shape.iter().map(|axis| *axis as u64).collect();
        self.zip.write_all(&header_bytes(descr, &axes))
    }

    fn real(&mut self, name: &str, shape: &[usize], numbers: &[f64]) -> io::Result<()> {
        self.begin(name, "<f8", shape)?;
        let bytes: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
        self.zip.write_all(&bytes)
    }
}

/// `[frequency][channel]` of `[channel][frequency]`.
fn by_frequency(samples: &[Complex<f32>], shape: SweepShape) -> Vec<Complex<f32>> {
    transposed(samples, shape.step_count)
}

fn fits(part: &str, shape: SweepShape, samples: &[Complex<f32>]) -> Result<(), RecordingFault> {
    if samples.len() == shape.sample_count() {
        return Ok(());
    }
    let expected = format!("{} samples as band and array say", shape.sample_count());
    let found = vec![samples.len() as u64];
    Err(RecordingFault::Shape { array: part.to_owned(), found, expected })
}

fn temporary_beside(path: &Path) -> io::Result<NamedTempFile> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let mut builder = tempfile::Builder::new();
    builder.prefix(".recording-").suffix(".part");
    // As any file that a program writes, not private as temporary files are.
    #[cfg(unix)]
    builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder.unwrap_or(Path::new(".")))
}

/// Flushes to disk before the name appears, so that the name never stands for half a file.
fn publish(file: NamedTempFile, path: &Path) -> io::Result<()> {
    file.as_file().sync_all()?;
    file.persist(path).map(drop).map_err(|error| error.error)
}

fn write_fault(part: &str, source: io::Error) -> RecordingFault {
    RecordingFault::Write { part: part.to_owned(), source }
}
