//! SigMF pairs: JSON metadata with the extension `transmural`, and samples in a file beside it.
//!
//! Samples stand by sweep, by frequency, then by channel; a sweep is `step_count` SigMF samples of
//! `tx · rx` channels.

use std::ffi::OsStr;
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use proto::radar::{Array, Band};
use rustfft::num_complex::Complex;
use serde_json::{Map, Value};

use super::bytes::{ByteSource, Checksum, Entry, Packing};
use super::check::{self, SweepShape};
use super::error::RecordingFault;
use super::numbers::{ByteOrder, NumberKind, NumberType, Width};
use super::{Contents, PeriodTimes, RecordingHeader, SampleOrder, Samples};
use crate::recording::SweepMean;

/// Largest metadata read.
pub(super) const MAX_META_BYTES: u64 = 1 << 24;
/// Most leading sweeps averaged to the background.
const MAX_BACKGROUND_COUNT: u64 = 1 << 16;
/// Longest piece of a value shown in a message, in characters.
const SHOWN_LENGTH: usize = 60;
/// Name and version of the extension.
pub(super) const EXTENSION: &str = "transmural";
pub(super) const EXTENSION_VERSION: &str = "1.0.0";
/// Version of SigMF that is written.
pub(super) const SIGMF_VERSION: &str = "1.2.0";

/// Fields of the extension, without `transmural:`.
pub(super) mod field {
    pub(in super::super) const START_HZ: &str = "start_hz";
    pub(in super::super) const STEP_HZ: &str = "step_hz";
    pub(in super::super) const STEP_COUNT: &str = "step_count";
    pub(in super::super) const TX_M: &str = "tx_m";
    pub(in super::super) const RX_M: &str = "rx_m";
    pub(in super::super) const PERIOD_TIME_S: &str = "period_time_s";
    pub(in super::super) const PERIOD_S: &str = "period_s";
    pub(in super::super) const FIRST_S: &str = "first_s";
    pub(in super::super) const BACKGROUND_COUNT: &str = "background_sweep_count";
    pub(in super::super) const NODE: &str = "node";
    pub(super) const ALL: [&str; 10] = [
        START_HZ,
        STEP_HZ,
        STEP_COUNT,
        TX_M,
        RX_M,
        PERIOD_TIME_S,
        PERIOD_S,
        FIRST_S,
        BACKGROUND_COUNT,
        NODE,
    ];
}

/// The two files of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Pair {
    pub(super) meta: PathBuf,
    pub(super) data: PathBuf,
}

impl Pair {
    /// Both files if `path` names either.
    pub(super) fn of(path: &Path) -> Option<Self> {
        let extension = path.extension().and_then(OsStr::to_str)?;
        let beside = |ending: &str| path.with_extension(ending);
        matches!(extension, "sigmf-meta" | "sigmf-data")
            .then(|| Self { meta: beside("sigmf-meta"), data: beside("sigmf-data") })
    }
}

/// Reads the metadata and the background.
pub(super) fn read(meta: &File, data: &File) -> Result<Contents, RecordingFault> {
    let root = parsed(meta)?;
    let global = Fields(object(root.get("global"), "global")?);
    refuse_foreign(&root, &global)?;
    let number = number_type(&global)?;
    let band = Band {
        start_hz: global.number(field::START_HZ)?,
        step_hz: global.number(field::STEP_HZ)?,
        step_count: global.count(field::STEP_COUNT)?,
    };
    let band = check::checked_band(band)?;
    let array = Array { tx_m: global.antennas(field::TX_M)?, rx_m: global.antennas(field::RX_M)? };
    let array = check::checked_array(array)?;
    let shape = SweepShape::of(&band, &array);
    let channels = global.0.get("core:num_channels").unwrap_or(&Value::Null);
    if channels.as_u64() != Some(shape.channel_count() as u64) {
        let expected = format!("{}, tx_m times rx_m", shape.channel_count());
        return Err(field_fault("core:num_channels", channels, &expected));
    }
    let sweep_count = shape.sample_count() as u64;
    check::at_most("a sweep", sweep_count, check::MAX_SWEEP_SAMPLE_COUNT, "samples")?;
    let samples = Samples { number, order: SampleOrder::ByFrequency, shape };
    let mut source = ByteSource::open(data, entry(data, &global)?)?;
    let background_count = global.optional_count(field::BACKGROUND_COUNT)?;
    let first_byte = background_count.saturating_mul(samples.byte_count());
    let data_bytes = source.entry().byte_count.saturating_sub(first_byte);
    let (times, period_count) = times(&global, data_bytes.div_ceil(samples.byte_count()))?;
    let background = background(&mut source, &samples, background_count)?;
    let node = global.text(field::NODE)?;
    let header = RecordingHeader { band, array, background, node };
    Ok(Contents { header, times, period_count, samples, source, first_byte })
}

fn parsed(meta: &File) -> Result<Map<String, Value>, RecordingFault> {
    let mut text = Vec::new();
    let look = meta.take(MAX_META_BYTES + 1).read_to_end(&mut text);
    let part = "the metadata".to_owned();
    look.map_err(|source| RecordingFault::Read { part, source })?;
    check::at_most("the metadata", text.len() as u64, MAX_META_BYTES, "bytes")?;
    serde_json::from_slice(&text)
        .map_err(|error| RecordingFault::Json { reason: error.to_string() })
}

fn object<'a>(
    value: Option<&'a Value>,
    name: &str,
) -> Result<&'a Map<String, Value>, RecordingFault> {
    let value = value.unwrap_or(&Value::Null);
    value.as_object().ok_or_else(|| field_fault(name, value, "an object"))
}

/// What may mean that the samples are other than they seem.
fn refuse_foreign(root: &Map<String, Value>, global: &Fields) -> Result<(), RecordingFault> {
    let version = global.0.get("core:version").unwrap_or(&Value::Null);
    if !version.as_str().is_some_and(|version| version.starts_with("1.")) {
        return Err(field_fault("core:version", version, "a SigMF version 1.x"));
    }
    global.extensions()?;
    for (name, harmless) in [
        ("core:metadata_only", Value::Bool(false)),
        ("core:dataset", Value::Null),
        ("core:trailing_bytes", Value::from(0)),
    ] {
        let value = global.0.get(name).filter(|value| **value != harmless);
        if let Some(value) = value {
            let expected =
                "no such field: put all samples into one .sigmf-data file of the same name";
            return Err(field_fault(name, value, expected));
        }
    }
    let captures = root.get("captures").and_then(Value::as_array);
    for capture in captures.into_iter().flatten() {
        let header = capture.get("core:header_bytes").unwrap_or(&Value::Null);
        if !header.is_null() && *header != 0 {
            return Err(field_fault("core:header_bytes", header, "0: samples without gaps"));
        }
    }
    let known = |key: &str| field::ALL.contains(&key);
    let ours = global.0.keys().filter_map(|key| key.strip_prefix("transmural:"));
    match ours.into_iter().find(|key| !known(key)) {
        None => Ok(()),
        Some(key) => {
            let value = global.own(key).unwrap_or(&Value::Null);
            Err(field_fault(&qualified(key), value, &format!("one of {}", field::ALL.join(", "))))
        }
    }
}

fn number_type(global: &Fields) -> Result<NumberType, RecordingFault> {
    let value = global.0.get("core:datatype").unwrap_or(&Value::Null);
    let (width, order) = match value.as_str() {
        Some("cf32_le") => (Width::Four, ByteOrder::LittleFirst),
        Some("cf32_be") => (Width::Four, ByteOrder::BigFirst),
        Some("cf64_le") => (Width::Eight, ByteOrder::LittleFirst),
        Some("cf64_be") => (Width::Eight, ByteOrder::BigFirst),
        _ => return Err(field_fault("core:datatype", value, "\"cf32_le\" (or cf64_le, _be)")),
    };
    Ok(NumberType { kind: NumberKind::Complex, width, order })
}

fn entry(data: &File, global: &Fields) -> Result<Entry, RecordingFault> {
    let part = "the data file".to_owned();
    let length = data.metadata().map_err(|source| RecordingFault::Read { part, source })?.len();
    let checksum = match global.0.get("core:sha512") {
        None => Checksum::Unknown,
        Some(Value::String(digits)) if digits.len() == 128 => {
            Checksum::Sha512(digits.to_ascii_lowercase())
        }
        Some(other) => return Err(field_fault("core:sha512", other, "128 hexadecimal digits")),
    };
    Ok(Entry {
        name: "the data file".to_owned(),
        start: 0,
        packed_byte_count: length,
        byte_count: length,
        packing: Packing::Stored,
        checksum,
    })
}

/// The times, and how many sweeps they and the data tell of.
fn times(global: &Fields, stored_count: u64) -> Result<(PeriodTimes, u64), RecordingFault> {
    if stored_count == 0 {
        return Err(RecordingFault::NoPeriods);
    }
    let listed = global.own(field::PERIOD_TIME_S);
    if let Some(value) = listed {
        let name = qualified(field::PERIOD_TIME_S);
        let time_s: Option<Vec<f64>> =
            value.as_array().and_then(|list| list.iter().map(Value::as_f64).collect());
        let time_s = time_s.ok_or_else(|| field_fault(&name, value, "a list of seconds"))?;
        check::times(&name, &time_s)?;
        let listed_count = time_s.len() as u64;
        if listed_count < stored_count {
            let expected = format!("[{stored_count}], one time for each sweep of the data");
            return Err(RecordingFault::Shape { array: name, found: vec![listed_count], expected });
        }
        // Fewer sweeps than times: reading ends with the sweep that is cut off.
        return Ok((PeriodTimes::Listed(time_s), listed_count));
    }
    if global.own(field::PERIOD_S).is_none() {
        return Ok((PeriodTimes::Assumed, stored_count));
    }
    let period_s = global.number(field::PERIOD_S)?;
    if period_s <= 0.0 {
        let value = Value::from(period_s);
        return Err(field_fault(&qualified(field::PERIOD_S), &value, "a positive number"));
    }
    let first = global.own(field::FIRST_S).map(|_| global.number(field::FIRST_S)).transpose()?;
    Ok((PeriodTimes::Even { first_s: first.unwrap_or(0.0), period_s }, stored_count))
}

/// The mean of the leading sweeps.
fn background(
    source: &mut ByteSource,
    samples: &Samples,
    count: u64,
) -> Result<Option<Vec<Complex<f32>>>, RecordingFault> {
    let name = qualified(field::BACKGROUND_COUNT);
    check::at_most(&name, count, MAX_BACKGROUND_COUNT, "sweeps")?;
    let mut mean = SweepMean::default();
    for index in 0..count {
        mean.add(&samples.read(source, index)?);
    }
    Ok((0 < count).then(|| mean.mean()))
}

fn qualified(key: &str) -> String {
    format!("{EXTENSION}:{key}")
}

fn field_fault(name: &str, value: &Value, expected: &str) -> RecordingFault {
    let found = match value {
        Value::Null => "missing".to_owned(),
        other => other.to_string().chars().take(SHOWN_LENGTH).collect(),
    };
    RecordingFault::Field { field: name.to_owned(), found, expected: expected.to_owned() }
}

/// The global fields.
struct Fields<'a>(&'a Map<String, Value>);

impl Fields<'_> {
    fn own(&self, key: &str) -> Option<&Value> {
        self.0.get(&qualified(key))
    }

    fn needed<T>(
        &self,
        key: &str,
        expected: &str,
        read: impl Fn(&Value) -> Option<T>,
    ) -> Result<T, RecordingFault> {
        let value = self.own(key).unwrap_or(&Value::Null);
        read(value).ok_or_else(|| field_fault(&qualified(key), value, expected))
    }

    fn number(&self, key: &str) -> Result<f64, RecordingFault> {
        self.needed(key, "a number", Value::as_f64)
    }

    fn count(&self, key: &str) -> Result<usize, RecordingFault> {
        let read = |value: &Value| value.as_u64().and_then(|count| usize::try_from(count).ok());
        self.needed(key, "a whole number", read)
    }

    fn optional_count(&self, key: &str) -> Result<u64, RecordingFault> {
        if self.own(key).is_none() {
            return Ok(0);
        }
        self.needed(key, "a whole number", Value::as_u64)
    }

    fn text(&self, key: &str) -> Result<Option<String>, RecordingFault> {
        if self.own(key).is_none() {
            return Ok(None);
        }
        self.needed(key, "a text", |value| value.as_str().map(str::to_owned)).map(Some)
    }

    fn antennas(&self, key: &str) -> Result<Vec<[f64; 2]>, RecordingFault> {
        let pair = |value: &Value| match value.as_array()?.as_slice() {
            [x, y] => Some([x.as_f64()?, y.as_f64()?]),
            _ => None,
        };
        let expected = "a list of [x, y] in metres";
        self.needed(key, expected, |value| value.as_array()?.iter().map(pair).collect())
    }

    /// `transmural` must be declared, and nothing else be needed.
    fn extensions(&self) -> Result<(), RecordingFault> {
        let value = self.0.get("core:extensions").unwrap_or(&Value::Null);
        let mut own_version = None;
        for extension in value.as_array().into_iter().flatten() {
            let name = extension.get("name").and_then(Value::as_str).unwrap_or_default();
            let is_optional = extension.get("optional").and_then(Value::as_bool) == Some(true);
            if name == EXTENSION {
                own_version = extension.get("version").and_then(Value::as_str);
            } else if !is_optional {
                return Err(RecordingFault::Extension { name: name.to_owned() });
            }
        }
        if own_version.is_some_and(|version| version.starts_with("1.")) {
            return Ok(());
        }
        let expected =
            "a list with {\"name\": \"transmural\", \"version\": \"1.0.0\", \"optional\": false}";
        Err(field_fault("core:extensions", value, expected))
    }
}
