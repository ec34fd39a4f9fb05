//! The header of an array as numpy writes it: number type, order of axes, shape.

use npyz::{DType, Endianness, NpyHeader, Order, TypeChar};

use super::bytes::ByteSource;
use super::error::RecordingFault;
use super::numbers::{ByteOrder, NumberKind, NumberType, Width};

/// Longest header read: those of plain arrays need about 120 bytes.
const MAX_HEADER_BYTES: u64 = 4096;
/// Deepest nesting read: a dictionary with a tuple needs two.
const MAX_BRACKET_COUNT: usize = 16;
/// Magic, version and a length of two bytes.
const PREAMBLE_BYTES: usize = 10;

/// What an array says about itself.
#[derive(Clone)]
pub(super) struct ArrayHead {
    pub(super) name: String,
    header: NpyHeader,
}

impl ArrayHead {
    /// Reads the header at the start of `source`, which then stands at the first number.
    pub(super) fn read(source: &mut ByteSource) -> Result<Self, RecordingFault> {
        let name = source.entry().name.clone();
        let fault = |reason: &str| RecordingFault::ArrayHeader {
            array: name.clone(),
            reason: reason.to_owned(),
        };
        let mut bytes = vec![0; PREAMBLE_BYTES];
        source.fill(&mut bytes)?;
        if !bytes.starts_with(b"\x93NUMPY") {
            return Err(fault("no NPY array"));
        }
        let mut length = u64::from(u16::from_le_bytes([bytes[8], bytes[9]]));
        if 1 < bytes[6] {
            let mut high = [0; 2];
            source.fill(&mut high)?;
            length += u64::from(u16::from_le_bytes(high)) << 16;
            bytes.extend(high);
        }
        if MAX_HEADER_BYTES < length {
            return Err(fault("longer than 4096 bytes"));
        }
        source.for_pieces(length, |piece| bytes.extend_from_slice(piece))?;
        // The parser descends with every bracket and multiplies all axes unchecked.
        if MAX_BRACKET_COUNT < bytes.iter().filter(|byte| b"([{".contains(byte)).count() {
            return Err(fault("too many brackets"));
        }
        if digits_product(&bytes).is_none() {
            return Err(fault("the axes multiply to more than 2^64 numbers"));
        }
        let header = NpyHeader::from_reader(&bytes[..]).map_err(|e| fault(&e.to_string()))?;
        Ok(Self { name, header })
    }

    pub(super) fn shape(&self) -> &[u64] {
        self.header.shape()
    }

    pub(super) fn is_fortran(&self) -> bool {
        self.header.order() == Order::Fortran && 1 < self.shape().len()
    }

    /// How many numbers are announced.
    pub(super) fn number_count(&self) -> u64 {
        self.shape().iter().fold(1, |product: u64, axis| product.saturating_mul(*axis))
    }

    /// The type of numbers that are complex.
    pub(super) fn complex_type(&self) -> Result<NumberType, RecordingFault> {
        let number = self.number_type().filter(|number| number.kind == NumberKind::Complex);
        number.ok_or_else(|| self.type_fault("complex64 or complex128"))
    }

    /// The type of numbers that are real or whole.
    pub(super) fn real_type(&self) -> Result<NumberType, RecordingFault> {
        let number = self.number_type().filter(|number| number.kind != NumberKind::Complex);
        number.ok_or_else(|| self.type_fault("float64 or float32"))
    }

    /// Bytes of one character and how many there are, of a single text.
    pub(super) fn text_size(&self) -> Result<(usize, u64, ByteOrder), RecordingFault> {
        let DType::Plain(text) = self.header.dtype() else { return Err(self.type_fault("str")) };
        let order = byte_order(text.endianness());
        match text.type_char() {
            TypeChar::UnicodeStr if self.shape().is_empty() => Ok((4, text.size_field(), order)),
            TypeChar::ByteStr if self.shape().is_empty() => Ok((1, text.size_field(), order)),
            _ => Err(self.type_fault("str (one text, no axes)")),
        }
    }

    fn number_type(&self) -> Option<NumberType> {
        let DType::Plain(plain) = self.header.dtype() else { return None };
        let kind = match plain.type_char() {
            TypeChar::Float => NumberKind::Real,
            TypeChar::Complex => NumberKind::Complex,
            TypeChar::Int => NumberKind::Integer,
            _ => return None,
        };
        let width = match (kind, plain.size_field()) {
            (NumberKind::Complex, 8) | (NumberKind::Real | NumberKind::Integer, 4) => Width::Four,
            (NumberKind::Complex, 16) | (NumberKind::Real | NumberKind::Integer, 8) => Width::Eight,
            _ => return None,
        };
        Some(NumberType { kind, width, order: byte_order(plain.endianness()) })
    }

    fn type_fault(&self, expected: &'static str) -> RecordingFault {
        let (array, found) = (self.name.clone(), self.header.dtype().descr());
        RecordingFault::NumberType { array, found, expected }
    }
}

fn byte_order(endianness: Endianness) -> ByteOrder {
    if endianness == Endianness::Big { ByteOrder::BigFirst } else { ByteOrder::LittleFirst }
}

/// The product of all numbers in a text, those of zero left out: no less than any product of axes.
fn digits_product(bytes: &[u8]) -> Option<u64> {
    let runs = bytes[PREAMBLE_BYTES..].split(|byte| !byte.is_ascii_digit());
    runs.filter(|run| !run.is_empty()).try_fold(1_u64, |product, run| {
        let number: u64 = std::str::from_utf8(run).ok()?.parse().ok()?;
        product.checked_mul(number.max(1))
    })
}

/// The header numpy would write for numbers of type `descr`, with the magic before it.
pub(super) fn header_bytes(descr: &str, shape: &[u64]) -> Vec<u8> {
    let axes: String = shape.iter().map(|axis| format!("{axis},")).collect();
    let text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({axes}), }}");
    // numpy aligns the numbers to 64 bytes and ends the text with a line feed. Four axes of twenty
    // digits fit into 192 bytes, so that the length needs one byte.
    let padded = (PREAMBLE_BYTES + text.len() + 1).next_multiple_of(64) - PREAMBLE_BYTES;
    let length = u8::try_from(padded).unwrap_or(u8::MAX);
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend([length, 0]);
    bytes.extend(format!("{text:<width$}\n", width = usize::from(length) - 1).bytes());
    bytes
}
