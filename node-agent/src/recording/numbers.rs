//! Numbers of arrays and data files: what they are made of, and what they say.

use rustfft::num_complex::Complex;

use crate::imaging::single;

/// What the numbers stand for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NumberKind {
    /// One floating-point number.
    Real,
    /// Real and imaginary part, one after the other.
    Complex,
    /// One signed integer.
    Integer,
}

/// Which byte comes first.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ByteOrder {
    LittleFirst,
    BigFirst,
}

/// How long a part of a number is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Width {
    Four,
    Eight,
}

/// How numbers are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct NumberType {
    pub(super) kind: NumberKind,
    pub(super) width: Width,
    pub(super) order: ByteOrder,
}

impl NumberType {
    /// Bytes of one number.
    pub(super) fn byte_count(self) -> u64 {
        let part = match self.width {
            Width::Four => 4,
            Width::Eight => 8,
        };
        if self.kind == NumberKind::Complex { 2 * part } else { part }
    }

    /// Appends the complex numbers of `bytes`, rounded to single precision.
    pub(super) fn append_complex(self, bytes: &[u8], to: &mut Vec<Complex<f32>>) {
        let wide = |part: f64| single(part);
        match (self.width, self.order) {
            (Width::Four, ByteOrder::LittleFirst) => pairs(bytes, f32::from_le_bytes, to),
            (Width::Four, ByteOrder::BigFirst) => pairs(bytes, f32::from_be_bytes, to),
            (Width::Eight, ByteOrder::LittleFirst) => {
                pairs(bytes, |part| wide(f64::from_le_bytes(part)), to);
            }
            (Width::Eight, ByteOrder::BigFirst) => {
                pairs(bytes, |part| wide(f64::from_be_bytes(part)), to);
            }
        }
    }

    /// Appends the real numbers or integers of `bytes`.
    pub(super) fn append_real(self, bytes: &[u8], to: &mut Vec<f64>) {
        let little = self.order == ByteOrder::LittleFirst;
        let four = |part: [u8; 4]| if little { part } else { reversed(part) };
        let eight = |part: [u8; 8]| if little { part } else { reversed(part) };
        match (self.kind, self.width) {
            (NumberKind::Integer, Width::Four) => {
                each(bytes, |part| f64::from(i32::from_le_bytes(four(part))), to);
            }
            (NumberKind::Integer, Width::Eight) => {
                each(bytes, |part| i64::from_le_bytes(eight(part)) as f64, to);
            }
            (_, Width::Four) => {
                each(bytes, |part| f64::from(f32::from_le_bytes(four(part))), to);
            }
            (_, Width::Eight) => each(bytes, |part| f64::from_le_bytes(eight(part)), to),
        }
    }
}

fn reversed<const N: usize>(mut bytes: [u8; N]) -> [u8; N] {
    bytes.reverse();
    bytes
}

fn pairs<const N: usize>(
    bytes: &[u8],
    number: impl Fn([u8; N]) -> f32,
    to: &mut Vec<Complex<f32>>,
) {
    let (parts, _) = bytes.as_chunks::<N>();
    to.extend(parts.chunks_exact(2).map(|pair| Complex::new(number(pair[0]), number(pair[1]))));
}

fn each<const N: usize>(bytes: &[u8], number: impl Fn([u8; N]) -> f64, to: &mut Vec<f64>) {
    let (parts, _) = bytes.as_chunks::<N>();
    to.extend(parts.iter().map(|part| number(*part)));
}

/// Bytes of `samples`, the lowest byte first, real part before imaginary part.
pub(super) fn bytes_of<'a>(samples: impl IntoIterator<Item = &'a Complex<f32>>) -> Vec<u8> {
    samples
        .into_iter()
        .flat_map(|sample| [sample.re, sample.im])
        .flat_map(f32::to_le_bytes)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_type_reads_what_the_standard_says() {
        use {ByteOrder::*, NumberKind::*, Width::*};
        // 1.5 and −2 in IEEE 754, written out by hand, the highest byte first.
        let four = [0x3f, 0xc0, 0, 0, 0xc0, 0, 0, 0];
        let eight = [0x3f, 0xf8, 0, 0, 0, 0, 0, 0, 0xc0, 0, 0, 0, 0, 0, 0, 0];
        let swapped = |bytes: &[u8], width: usize| -> Vec<u8> {
            bytes.chunks(width).flat_map(|part| part.iter().rev().copied()).collect()
        };
        for (width, order, bytes) in [
            (Four, BigFirst, four.to_vec()),
            (Four, LittleFirst, swapped(&four, 4)),
            (Eight, BigFirst, eight.to_vec()),
            (Eight, LittleFirst, swapped(&eight, 8)),
        ] {
            let (mut complex, mut real) = (Vec::new(), Vec::new());
            let number = NumberType { kind: Complex, width, order };
            number.append_complex(&bytes, &mut complex);
            assert_eq!(number.byte_count(), bytes.len() as u64);
            assert_eq!(complex, [rustfft::num_complex::Complex::new(1.5, -2.0)]);
            NumberType { kind: Real, ..number }.append_real(&bytes, &mut real);
            assert_eq!(real, [1.5, -2.0]);
        }
        let mut whole = Vec::new();
        let integer = |width, order| NumberType { kind: Integer, width, order };
        integer(Four, LittleFirst).append_real(&[0xfe, 0xff, 0xff, 0xff], &mut whole);
        integer(Eight, BigFirst).append_real(&[0, 0, 0, 0, 0, 0, 1, 2], &mut whole);
        assert_eq!(whole, [-2.0, 258.0]);
    }
}
