//! NPZ archives as numpy.savez and numpy.savez_compressed write them.
//!
//! Small arrays are read whole within limits; `echoes` is left to be read sweep by sweep.

use std::fs::File;
use std::io::BufReader;

use proto::radar::Array;
use rustfft::num_complex::Complex;
use zip::{CompressionMethod, ZipArchive};

use super::bytes::{ByteSource, Checksum, Entry, Packing};
use super::check::{self, SweepShape};
use super::error::RecordingFault;
use super::npy::ArrayHead;
use super::numbers::{ByteOrder, NumberType};
use super::{Contents, PeriodTimes, RecordingHeader, SampleOrder, Samples};

/// Arrays of a recording. Others are passed over, unless their name is so near to one of these that
/// it may be a misspelt one.
const ARRAYS: [&str; 7] =
    ["echoes", "freq_hz", "tx_m", "rx_m", "period_time_s", "background", "node"];
/// Letters, at most, by which a misspelt name is off.
const MISSPELT_LETTER_COUNT: usize = 2;
/// Longest piece of a name shown in a message, in characters.
const SHOWN_LENGTH: usize = 60;
/// Longest name of a node, in characters.
pub(super) const MAX_NAME_LENGTH: u64 = 256;

/// Reads all but the echoes.
pub(super) fn read(file: &File) -> Result<Contents, RecordingFault> {
    let mut archive = Archive::open(file)?;
    let (source, echoes) = archive.required("echoes", "complex64 [period][tx][rx][freq]")?;
    let number = echoes.complex_type()?;
    let &[period_count, tx_count, rx_count, step_count] = echoes.shape() else {
        return Err(shape_fault(&echoes, "4 axes: [period][tx][rx][freq]"));
    };
    if echoes.is_fortran() {
        return Err(RecordingFault::FortranOrder { array: echoes.name });
    }
    let header_byte_count = source.position();
    announced(source.entry(), &echoes, header_byte_count, number)?;
    if period_count == 0 {
        return Err(RecordingFault::NoPeriods);
    }
    let band = check::band_of(&archive.list("freq_hz", check::MAX_FREQUENCY_COUNT)?)?;
    let array = Array { tx_m: archive.antennas("tx_m")?, rx_m: archive.antennas("rx_m")? };
    let array = check::checked_array(array)?;
    let shape = SweepShape::of(&band, &array);
    let found = [tx_count, rx_count, step_count];
    if found != [shape.tx_count, shape.rx_count, shape.step_count].map(|count| count as u64) {
        let expected = format!(
            "[period][{}][{}][{}] by tx_m, rx_m and freq_hz",
            shape.tx_count, shape.rx_count, shape.step_count
        );
        return Err(shape_fault(&echoes, &expected));
    }
    let sweep_count = shape.sample_count() as u64;
    check::at_most("a sweep", sweep_count, check::MAX_SWEEP_SAMPLE_COUNT, "samples")?;
    let times = archive.times(period_count)?;
    let background = archive.background(shape)?;
    let node = archive.name()?;
    let header = RecordingHeader { band, array, background, node };
    // The sources of a file share its position, so this one starts anew.
    let mut source = ByteSource::open(file, source.entry().clone())?;
    source.pass(header_byte_count)?;
    let samples = Samples { number, order: SampleOrder::ByChannel, shape };
    Ok(Contents { header, times, period_count, samples, source, first_byte: header_byte_count })
}

struct Archive<'a> {
    file: &'a File,
    archive: ZipArchive<BufReader<File>>,
}

/// Whether `name` is not `meant` but may have been meant for it.
fn is_nearly(name: &str, meant: &str) -> bool {
    let own = || ARRAYS.iter().any(|array| name.strip_suffix(".npy") == Some(array));
    (1..=MISSPELT_LETTER_COUNT).contains(&strsim::levenshtein(name, meant)) && !own()
}

impl<'a> Archive<'a> {
    fn open(file: &'a File) -> Result<Self, RecordingFault> {
        let handle = file.try_clone().map_err(read_fault)?;
        let archive = ZipArchive::new(BufReader::new(handle)).map_err(|e| archive_fault(&e))?;
        if archive.has_duplicate_names() {
            let reason = "two arrays of the same name".to_owned();
            return Err(RecordingFault::Archive { reason });
        }
        for name in archive.file_names_raw().map(String::from_utf8_lossy) {
            let is_meant = |array: &&str| is_nearly(&name, &format!("{array}.npy"));
            if let Some(meant) = ARRAYS.into_iter().find(is_meant) {
                let array = name.trim_end_matches(".npy").chars().take(SHOWN_LENGTH).collect();
                return Err(RecordingFault::UnknownArray { array, meant });
            }
        }
        Ok(Self { file, archive })
    }

    /// The array `name`, its header read, if it is there.
    fn optional(&mut self, name: &str) -> Result<Option<(ByteSource, ArrayHead)>, RecordingFault> {
        let Some(index) = self.archive.index_for_name(&format!("{name}.npy")) else {
            return Ok(None);
        };
        let found = self.archive.by_index_raw(index).map_err(|e| archive_fault(&e))?;
        let packing = match found.compression() {
            _ if found.encrypted() => Err("encrypted".to_owned()),
            CompressionMethod::Stored => Ok(Packing::Stored),
            CompressionMethod::Deflated => Ok(Packing::Deflated),
            other => Err(other.to_string()),
        };
        let array = name.to_owned();
        let packing = packing.map_err(|other| RecordingFault::Packing { array, found: other })?;
        let entry = Entry {
            name: name.to_owned(),
            start: found.data_start().unwrap_or(0),
            packed_byte_count: found.compressed_size(),
            byte_count: found.size(),
            packing,
            checksum: Checksum::Crc32(found.crc32()),
        };
        drop(found);
        let mut source = ByteSource::open(self.file, entry)?;
        let head = ArrayHead::read(&mut source)?;
        Ok(Some((source, head)))
    }

    fn required(
        &mut self,
        name: &str,
        expected: &'static str,
    ) -> Result<(ByteSource, ArrayHead), RecordingFault> {
        let array = name.to_owned();
        self.optional(name)?.ok_or(RecordingFault::MissingArray { array, expected })
    }

    fn list(&mut self, name: &str, limit: u64) -> Result<Vec<f64>, RecordingFault> {
        let (source, head) = self.required(name, "float64, one number for each frequency")?;
        if head.shape().len() != 1 {
            return Err(shape_fault(&head, "1 axis"));
        }
        read_real(source, &head, limit)
    }

    fn antennas(&mut self, name: &str) -> Result<Vec<[f64; 2]>, RecordingFault> {
        let expected = "float64 [antenna][2], x and y in metres in the node's frame";
        let (source, head) = self.required(name, expected)?;
        let &[count, 2] = head.shape() else { return Err(shape_fault(&head, "[antenna][2]")) };
        let numbers = read_real(source, &head, 2 * check::MAX_ANTENNA_COUNT)?;
        check::finite(name, &numbers)?;
        let count = usize::try_from(count).unwrap_or(numbers.len());
        Ok((0..count)
            .map(|n| {
                if head.is_fortran() {
                    [numbers[n], numbers[count + n]]
                } else {
                    [numbers[2 * n], numbers[2 * n + 1]]
                }
            })
            .collect())
    }

    fn times(&mut self, period_count: u64) -> Result<PeriodTimes, RecordingFault> {
        let name = "period_time_s";
        let Some((source, head)) = self.optional(name)? else { return Ok(PeriodTimes::Assumed) };
        if head.shape() != [period_count] {
            let expected = format!("[{period_count}], one time for each period of echoes");
            return Err(shape_fault(&head, &expected));
        }
        let time_s = read_real(source, &head, check::MAX_LISTED_PERIOD_COUNT)?;
        check::times(name, &time_s)?;
        Ok(PeriodTimes::Listed(time_s))
    }

    fn background(
        &mut self,
        shape: SweepShape,
    ) -> Result<Option<Vec<Complex<f32>>>, RecordingFault> {
        let Some((mut source, head)) = self.optional("background")? else { return Ok(None) };
        let axes = [shape.tx_count, shape.rx_count, shape.step_count];
        if head.shape() != axes.map(|count| count as u64) {
            let expected = format!("{axes:?}, [tx][rx][freq] as echoes has");
            return Err(shape_fault(&head, &expected));
        }
        let number = head.complex_type()?;
        if head.is_fortran() {
            return Err(RecordingFault::FortranOrder { array: head.name });
        }
        announced(source.entry(), &head, source.position(), number)?;
        let mut background = Vec::new();
        source.for_pieces(number.byte_count() * head.number_count(), |piece| {
            number.append_complex(piece, &mut background);
        })?;
        source.verify()?;
        check::samples("background", shape, 0, &background)?;
        Ok(Some(background))
    }

    fn name(&mut self) -> Result<Option<String>, RecordingFault> {
        let Some((mut source, head)) = self.optional("node")? else { return Ok(None) };
        let (width, length, order) = head.text_size()?;
        check::at_most("node", length, MAX_NAME_LENGTH, "characters")?;
        let mut bytes = Vec::new();
        source.for_pieces(width as u64 * length, |piece| bytes.extend_from_slice(piece))?;
        source.verify()?;
        let code = |part: &[u8]| match order {
            ByteOrder::LittleFirst => part.iter().rev().fold(0, |c, b| c << 8 | u32::from(*b)),
            ByteOrder::BigFirst => part.iter().fold(0, |c, b| c << 8 | u32::from(*b)),
        };
        let text: Option<String> =
            bytes.chunks_exact(width).map(|part| char::from_u32(code(part))).collect();
        let text = text.ok_or_else(|| super::bytes::damaged("node", "no text"))?;
        let text = text.trim_end_matches('\0');
        Ok((!text.is_empty()).then(|| text.to_owned()))
    }
}

/// All numbers of a small array in the order of the file.
fn read_real(
    mut source: ByteSource,
    head: &ArrayHead,
    limit: u64,
) -> Result<Vec<f64>, RecordingFault> {
    let number = head.real_type()?;
    check::at_most(&head.name, head.number_count(), limit, "numbers")?;
    announced(source.entry(), head, source.position(), number)?;
    let mut numbers = Vec::new();
    source.for_pieces(number.byte_count() * head.number_count(), |piece| {
        number.append_real(piece, &mut numbers);
    })?;
    source.verify()?;
    Ok(numbers)
}

/// The shape must not claim other than the archive does.
fn announced(
    entry: &Entry,
    head: &ArrayHead,
    header_byte_count: u64,
    number: NumberType,
) -> Result<(), RecordingFault> {
    let data_byte_count = head.number_count().saturating_mul(number.byte_count());
    let expected = data_byte_count.saturating_add(header_byte_count);
    if entry.byte_count < expected {
        let (part, found) = (entry.name.clone(), entry.byte_count);
        return Err(RecordingFault::Truncated { part, found, expected });
    }
    if expected < entry.byte_count {
        return Err(super::bytes::damaged(&entry.name, "it holds more bytes than its shape says"));
    }
    Ok(())
}

fn shape_fault(head: &ArrayHead, expected: &str) -> RecordingFault {
    let (array, found) = (head.name.clone(), head.shape().to_vec());
    RecordingFault::Shape { array, found, expected: expected.to_owned() }
}

fn archive_fault(error: &zip::result::ZipError) -> RecordingFault {
    RecordingFault::Archive { reason: error.to_string() }
}

fn read_fault(source: std::io::Error) -> RecordingFault {
    RecordingFault::Read { part: "the archive".to_owned(), source }
}
