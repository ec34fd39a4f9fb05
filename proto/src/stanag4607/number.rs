//! The scaled numbers and the fixed texts of the format, raw as they travel, with their units.
//!
//! Raw integers are kept so that what is read is written again bit by bit. Conversions to raw
//! round to the nearest step, halves away from zero.

use std::fmt;

const TURN_DEG: f64 = 360.0;
const HALF_TURN_DEG: f64 = 180.0;
const STEPS_16: f64 = 65_536.0;
const STEPS_32: f64 = 4_294_967_296.0;

/// A value in units that its field cannot hold.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("{field} holds {low} to {high} {unit}; {value} does not fit")]
pub struct OutOfRange {
    /// The field of the format, such as `D32.7`.
    pub field: &'static str,
    /// What was to be stored.
    pub value: f64,
    /// Smallest value of the field.
    pub low: f64,
    /// Largest value of the field.
    pub high: f64,
    /// Unit of the three numbers.
    pub unit: &'static str,
}

/// A field that stores `step` units per count, and the counts that it may hold.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scale {
    pub(super) field: &'static str,
    pub(super) unit: &'static str,
    pub(super) step: f64,
    pub(super) low: i64,
    pub(super) high: i64,
}

impl Scale {
    /// The count nearest to `value`: `round(value / step)`, refused outside `low..=high`.
    #[expect(clippy::cast_possible_truncation, reason = "checked against the range just before")]
    #[expect(clippy::cast_precision_loss, reason = "ranges of 32-bit fields are exact in f64")]
    pub(super) fn count(&self, value: f64) -> Result<i64, OutOfRange> {
        let count = (value / self.step).round();
        if !count.is_finite() || count < self.low as f64 || (self.high as f64) < count {
            let low = self.low as f64 * self.step;
            let high = self.high as f64 * self.step;
            return Err(OutOfRange { field: self.field, value, low, high, unit: self.unit });
        }
        Ok(count as i64)
    }
}

/// A full circle in 2^16 steps, unsigned: `360° raw / 2^16`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Ba16(pub u16);

/// A full circle in 2^32 steps, unsigned: `360° raw / 2^32`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Ba32(pub u32);

/// Half a circle in 2^16 steps, signed: `180° raw / 2^16`, −90° to just below 90°.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Sa16(pub i16);

/// Half a circle in 2^32 steps, signed: `180° raw / 2^32`, −90° to just below 90°.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Sa32(pub i32);

/// Sign and magnitude with seven bits of fraction: `± magnitude / 2^7`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct B16(pub u16);

/// Steps of a circle for an angle: wrapped to one turn, nearest step.
#[expect(clippy::cast_possible_truncation, reason = "between 0 and the number of steps")]
#[expect(clippy::cast_sign_loss, reason = "the remainder of rem_euclid is never negative")]
fn circle_steps(field: &'static str, deg: f64, steps: f64) -> Result<u64, OutOfRange> {
    if !deg.is_finite() {
        return Err(OutOfRange { field, value: deg, low: 0.0, high: TURN_DEG, unit: "deg" });
    }
    let count = (deg.rem_euclid(TURN_DEG) / TURN_DEG * steps).round();
    Ok(count as u64)
}

/// Steps of a signed angle: nearest step; the step that would be +90° becomes the one below it.
fn signed_steps(field: &'static str, deg: f64, steps: f64) -> Result<i64, OutOfRange> {
    let step = HALF_TURN_DEG / steps;
    #[expect(clippy::cast_possible_truncation, reason = "2^15 or 2^31")]
    let half = (steps / 2.0) as i64;
    let scale = Scale { field, unit: "deg", step, low: -half, high: half };
    Ok(scale.count(deg)?.min(half - 1))
}

#[expect(clippy::cast_possible_truncation, reason = "reduced to the width of the field before")]
mod angles {
    use super::{
        B16, Ba16, Ba32, HALF_TURN_DEG, OutOfRange, STEPS_16, STEPS_32, Sa16, Sa32, Scale,
        TURN_DEG, circle_steps, signed_steps,
    };

    impl Ba16 {
        /// In [0, 360) degrees.
        #[must_use]
        pub fn deg(self) -> f64 {
            f64::from(self.0) * TURN_DEG / STEPS_16
        }

        /// In [0, 2π) radians.
        #[must_use]
        pub fn rad(self) -> f64 {
            self.deg().to_radians()
        }

        /// The nearest step to an angle in degrees, after wrapping it to one turn.
        ///
        /// # Errors
        /// If the angle is not finite.
        pub fn from_deg(deg: f64) -> Result<Self, OutOfRange> {
            let steps = circle_steps("BA16", deg, STEPS_16)?;
            Ok(Self((steps & 0xffff) as u16))
        }
    }

    impl Ba32 {
        /// In [0, 360) degrees.
        #[must_use]
        pub fn deg(self) -> f64 {
            f64::from(self.0) * TURN_DEG / STEPS_32
        }

        /// In [−180, 180) degrees, as longitudes are written elsewhere.
        #[must_use]
        pub fn signed_deg(self) -> f64 {
            f64::from(self.0.cast_signed()) * TURN_DEG / STEPS_32
        }

        /// In [0, 2π) radians.
        #[must_use]
        pub fn rad(self) -> f64 {
            self.deg().to_radians()
        }

        /// The nearest step to an angle in degrees, after wrapping it to one turn.
        ///
        /// # Errors
        /// If the angle is not finite.
        pub fn from_deg(deg: f64) -> Result<Self, OutOfRange> {
            let steps = circle_steps("BA32", deg, STEPS_32)?;
            Ok(Self((steps & 0xffff_ffff) as u32))
        }
    }

    impl Sa16 {
        /// In [−90, 90) degrees.
        #[must_use]
        pub fn deg(self) -> f64 {
            f64::from(self.0) * HALF_TURN_DEG / STEPS_16
        }

        /// In [−π/2, π/2) radians.
        #[must_use]
        pub fn rad(self) -> f64 {
            self.deg().to_radians()
        }

        /// The nearest step to an angle in degrees; +90° becomes the largest step below it.
        ///
        /// # Errors
        /// If the angle is outside [−90, 90] degrees.
        pub fn from_deg(deg: f64) -> Result<Self, OutOfRange> {
            Ok(Self(signed_steps("SA16", deg, STEPS_16)? as i16))
        }
    }

    impl Sa32 {
        /// In [−90, 90) degrees.
        #[must_use]
        pub fn deg(self) -> f64 {
            f64::from(self.0) * HALF_TURN_DEG / STEPS_32
        }

        /// In [−π/2, π/2) radians.
        #[must_use]
        pub fn rad(self) -> f64 {
            self.deg().to_radians()
        }

        /// The nearest step to an angle in degrees; +90° becomes the largest step below it.
        ///
        /// # Errors
        /// If the angle is outside [−90, 90] degrees.
        pub fn from_deg(deg: f64) -> Result<Self, OutOfRange> {
            Ok(Self(signed_steps("SA32", deg, STEPS_32)? as i32))
        }
    }

    impl B16 {
        /// The number: magnitude in 1/128, negative where the sign bit is set.
        #[must_use]
        pub fn value(self) -> f64 {
            let magnitude = f64::from(self.0 & 0x7fff) / 128.0;
            if self.0 & 0x8000 == 0 { magnitude } else { -magnitude }
        }

        /// The nearest step to a number that is not negative.
        ///
        /// # Errors
        /// Outside 0 to 255.9921875.
        pub fn from_value(value: f64) -> Result<Self, OutOfRange> {
            let scale = Scale { field: "B16", unit: "", step: 1.0 / 128.0, low: 0, high: 0x7fff };
            Ok(Self((scale.count(value)? & 0x7fff) as u16))
        }
    }
}

/// A text of fixed width, byte by byte as it travels.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Text<const N: usize>(pub [u8; N]);

/// A text that a field of the format cannot hold.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TextError {
    /// More bytes than the field has.
    #[error("{text:?} has {length} bytes, the field holds {width}; shorten it")]
    TooLong {
        /// What was to be stored.
        text: String,
        /// Its length, bytes.
        length: usize,
        /// Bytes of the field.
        width: usize,
    },
    /// A character that is neither printable ASCII nor a line feed, form feed or carriage return.
    #[error("{text:?} has {found:?}; write printable ASCII")]
    NotBasic {
        /// What was to be stored.
        text: String,
        /// The first character that does not belong.
        found: char,
    },
}

/// Whether a byte is of the format's basic character set.
pub(super) fn is_basic(byte: u8) -> bool {
    matches!(byte, b' '..=b'~' | b'\n' | b'\r' | 0x0c)
}

impl<const N: usize> Text<N> {
    /// A text, filled with spaces to the width of the field.
    ///
    /// # Errors
    /// If it is longer than the field or not plain ASCII.
    pub fn new(text: &str) -> Result<Self, TextError> {
        let not_basic = |c: &char| !u8::try_from(*c).is_ok_and(is_basic);
        if let Some(found) = text.chars().find(not_basic) {
            return Err(TextError::NotBasic { text: text.to_owned(), found });
        }
        if N < text.len() {
            let (length, width) = (text.len(), N);
            return Err(TextError::TooLong { text: text.to_owned(), length, width });
        }
        let mut bytes = [b' '; N];
        bytes[..text.len()].copy_from_slice(text.as_bytes());
        Ok(Self(bytes))
    }

    /// The text without the spaces and zero bytes around it; what is not ASCII shows as `�`.
    #[must_use]
    pub fn trimmed(&self) -> String {
        let text: String = self.0.iter().map(|&byte| shown(byte)).collect();
        text.trim_matches(|c| c == ' ' || c == '\0').to_owned()
    }
}

fn shown(byte: u8) -> char {
    if byte.is_ascii() { char::from(byte) } else { char::REPLACEMENT_CHARACTER }
}

impl<const N: usize> Default for Text<N> {
    fn default() -> Self {
        Self([b' '; N])
    }
}

impl<const N: usize> fmt::Debug for Text<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "\"{}\"", self.0.escape_ascii())
    }
}
