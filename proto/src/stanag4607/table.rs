//! Reading and writing fields in the order of a table, one line per field.

use super::error::{Fault, Place, ReadError};
use super::number::{B16, Ba16, Ba32, Sa16, Sa32, Text};
use super::segment::SegmentKind;

/// A place in a segment from which fields are read one after the other.
#[derive(Debug, Clone)]
pub(super) struct Cursor<'a> {
    packet: &'a [u8],
    at: usize,
    end: usize,
    segment: Option<(usize, SegmentKind)>,
}

impl<'a> Cursor<'a> {
    /// From byte `start` of a packet to its byte `end`.
    pub(super) fn new(
        packet: &'a [u8],
        span: std::ops::Range<usize>,
        segment: Option<(usize, SegmentKind)>,
    ) -> Self {
        Self { packet, at: span.start, end: span.end.min(packet.len()), segment }
    }

    /// Bytes left.
    pub(super) fn left(&self) -> usize {
        self.end.saturating_sub(self.at)
    }

    /// What is wrong with the field at this place.
    pub(super) fn fault(&self, field: &'static str, fault: Fault) -> ReadError {
        let byte_offset = self.at as u64;
        let place = Place { packet_index: 0, segment: self.segment, field, byte_offset };
        ReadError { place, fault }
    }

    /// The next `width` bytes.
    pub(super) fn take(
        &mut self,
        field: &'static str,
        width: usize,
    ) -> Result<&'a [u8], ReadError> {
        let available = self.left();
        let next = self.packet.get(self.at..self.at + width.min(available));
        let bytes = next.filter(|bytes| bytes.len() == width);
        let fault = Fault::FieldTruncated { width, available };
        let bytes = bytes.ok_or_else(|| self.fault(field, fault))?;
        self.at += width;
        Ok(bytes)
    }

    /// All bytes that are left.
    pub(super) fn rest(&mut self, field: &'static str) -> Result<&'a [u8], ReadError> {
        self.take(field, self.left())
    }

    /// That nothing is left.
    pub(super) fn finish(&self) -> Result<(), ReadError> {
        match self.left() {
            0 => Ok(()),
            count => Err(self.fault("end", Fault::BytesAfterFields { count })),
        }
    }
}

/// A value of fixed width.
pub(super) trait Field: Sized {
    /// Bytes on the wire.
    const WIDTH: usize;

    /// From the next bytes.
    fn read(cursor: &mut Cursor<'_>, name: &'static str) -> Result<Self, ReadError>;

    /// To the end of `out`.
    fn write(&self, out: &mut Vec<u8>);
}

impl<const N: usize> Field for [u8; N] {
    const WIDTH: usize = N;

    fn read(cursor: &mut Cursor<'_>, name: &'static str) -> Result<Self, ReadError> {
        let mut bytes = [0; N];
        bytes.copy_from_slice(cursor.take(name, N)?);
        Ok(bytes)
    }

    fn write(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(self);
    }
}

impl<const N: usize> Field for Text<N> {
    const WIDTH: usize = N;

    fn read(cursor: &mut Cursor<'_>, name: &'static str) -> Result<Self, ReadError> {
        Ok(Self(Field::read(cursor, name)?))
    }

    fn write(&self, out: &mut Vec<u8>) {
        Field::write(&self.0, out);
    }
}

macro_rules! big_endian {
    ($($number:ty),*) => {$(
        impl Field for $number {
            const WIDTH: usize = size_of::<$number>();

            fn read(cursor: &mut Cursor<'_>, name: &'static str) -> Result<Self, ReadError> {
                Ok(Self::from_be_bytes(Field::read(cursor, name)?))
            }

            fn write(&self, out: &mut Vec<u8>) {
                out.extend_from_slice(&self.to_be_bytes());
            }
        }
    )*};
}
big_endian!(u8, i8, u16, i16, u32, i32, u64);

macro_rules! wrapped {
    ($($wrapper:ident($number:ty)),*) => {$(
        impl Field for $wrapper {
            const WIDTH: usize = size_of::<$number>();

            fn read(cursor: &mut Cursor<'_>, name: &'static str) -> Result<Self, ReadError> {
                Ok(Self(Field::read(cursor, name)?))
            }

            fn write(&self, out: &mut Vec<u8>) {
                Field::write(&self.0, out);
            }
        }
    )*};
}
wrapped!(Ba16(u16), Ba32(u32), Sa16(i16), Sa32(i32), B16(u16));

/// A place in a masked table: always there (`T`), or there where the mask says so (`Option<T>`).
pub(super) trait Slot: Sized {
    /// Bytes on the wire where it is there.
    const WIDTH: usize;
    /// Whether the mask must announce it.
    const MANDATORY: bool;

    /// From the next bytes if `mask` has `bit`.
    fn read(cursor: &mut Cursor<'_>, name: &'static str, there: u64) -> Result<Self, ReadError>;

    /// To the end of `out`, if there.
    fn write(&self, out: &mut Vec<u8>);

    /// Whether it is there.
    fn is_there(&self) -> bool;
}

impl<T: Field> Slot for T {
    const WIDTH: usize = T::WIDTH;
    const MANDATORY: bool = true;

    fn read(cursor: &mut Cursor<'_>, name: &'static str, _: u64) -> Result<Self, ReadError> {
        Field::read(cursor, name)
    }

    fn write(&self, out: &mut Vec<u8>) {
        Field::write(self, out);
    }

    fn is_there(&self) -> bool {
        true
    }
}

impl<T: Field> Slot for Option<T> {
    const WIDTH: usize = T::WIDTH;
    const MANDATORY: bool = false;

    fn read(cursor: &mut Cursor<'_>, name: &'static str, there: u64) -> Result<Self, ReadError> {
        if there == 0 { Ok(None) } else { Field::read(cursor, name).map(Some) }
    }

    fn write(&self, out: &mut Vec<u8>) {
        if let Some(value) = self {
            Field::write(value, out);
        }
    }

    fn is_there(&self) -> bool {
        self.is_some()
    }
}

/// Fields that follow one another, all of them there.
pub(super) trait Fixed: Sized {
    /// Bytes on the wire.
    const WIDTH: usize;

    /// From the next bytes.
    fn read(cursor: &mut Cursor<'_>) -> Result<Self, ReadError>;

    /// To the end of `out`.
    fn write(&self, out: &mut Vec<u8>);
}

/// A structure whose fields follow one another on the wire, all of them there.
macro_rules! fixed_table {
    (
        $(#[$about:meta])*
        pub struct $name:ident { $( $(#[$doc:meta])* $field:ident: $kind:ty = $label:literal, )* }
    ) => {
        $(#[$about])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
        pub struct $name { $( $(#[$doc])* pub $field: $kind, )* }

        impl Fixed for $name {
            const WIDTH: usize = 0 $( + <$kind as Field>::WIDTH )*;

            fn read(
                cursor: &mut Cursor<'_>,
            ) -> Result<Self, ReadError> {
                Ok(Self { $( $field: Field::read(cursor, $label)?, )* })
            }

            fn write(&self, out: &mut Vec<u8>) {
                $( Field::write(&self.$field, out); )*
            }
        }
    };
}

/// Fields that follow one another where a mask has their bits.
pub(super) trait Masked: Sized {
    /// All bits of the table.
    const BITS: u64;

    /// Bytes on the wire of the fields that the mask announces.
    fn width(mask: u64) -> usize;

    /// The first mandatory field that the mask leaves out.
    fn absent(mask: u64) -> Option<&'static str>;

    /// The bits of the fields that are there.
    fn present_bits(&self) -> u64;

    /// From the next bytes.
    fn read_table(cursor: &mut Cursor<'_>, mask: u64) -> Result<Self, ReadError>;

    /// To the end of `out`.
    fn write_table(&self, out: &mut Vec<u8>);
}

/// A structure whose fields follow one another on the wire where the bit after `@` is set.
///
/// Fields of the list `also` are not of the table; they are filled with their default.
macro_rules! masked_table {
    (
        $(#[$about:meta])*
        pub struct $name:ident {
            $( $(#[$doc:meta])* $field:ident: $kind:ty = $label:literal @ $bit:literal, )*
        }
        $( also { $( $(#[$also_doc:meta])* $also:ident: $also_kind:ty, )* } )?
    ) => {
        $(#[$about])*
        #[derive(Debug, Clone, PartialEq, Eq, Default)]
        pub struct $name {
            $( $(#[$doc])* pub $field: $kind, )*
            $( $( $(#[$also_doc])* pub $also: $also_kind, )* )?
        }

        impl Masked for $name {
            const BITS: u64 = 0 $( | 1 << $bit )*;

            fn width(mask: u64) -> usize {
                let mut width = 0;
                $( if mask >> $bit & 1 == 1 {
                    width += <$kind as Slot>::WIDTH;
                } )*
                width
            }

            fn absent(mask: u64) -> Option<&'static str> {
                let mut absent = None;
                $( if <$kind as Slot>::MANDATORY
                    && mask >> $bit & 1 == 0 {
                    absent = absent.or(Some($label));
                } )*
                absent
            }

            fn present_bits(&self) -> u64 {
                0 $( | u64::from(Slot::is_there(&self.$field)) << $bit )*
            }

            fn read_table(
                cursor: &mut Cursor<'_>,
                mask: u64,
            ) -> Result<Self, ReadError> {
                Ok(Self {
                    $( $field: Slot::read(
                        cursor, $label, mask >> $bit & 1,
                    )?, )*
                    $( $( $also: Default::default(), )* )?
                })
            }

            fn write_table(&self, out: &mut Vec<u8>) {
                $( Slot::write(&self.$field, out); )*
            }
        }
    };
}
pub(super) use {fixed_table, masked_table};
