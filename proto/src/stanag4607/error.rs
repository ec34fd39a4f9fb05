//! What can be wrong with bytes that are read and with packets that are written, and where.

use std::fmt;

use super::segment::SegmentKind;

/// Where in the input something was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// Number of the packet in the input, from 0; packets that could not be read count.
    pub packet_index: u64,
    /// Number of the segment in its packet, from 0, and its kind; none in the packet's header.
    pub segment: Option<(usize, SegmentKind)>,
    /// The field as the standard names it, such as `P2` or `D32.7`.
    pub field: &'static str,
    /// Offset of the field from the beginning of the input, bytes.
    pub byte_offset: u64,
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "packet {}", self.packet_index)?;
        if let Some((index, kind)) = self.segment {
            write!(f, ", segment {index} ({kind})")?;
        }
        write!(f, ", {} at byte {}", self.field, self.byte_offset)
    }
}

/// A packet that could not be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{place}: {fault}")]
pub struct ReadError {
    /// Where.
    pub place: Place,
    /// What.
    pub fault: Fault,
}

/// What was wrong with a packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Fault {
    /// The first two bytes are no edition that this module knows.
    #[error("edition \"{}\" is not one of 30, 31 and 41", found.escape_ascii())]
    UnknownEdition {
        /// The two bytes.
        found: [u8; 2],
    },
    /// The packet claims to be smaller than its own header.
    #[error("a packet of {size} bytes is smaller than its header of 32")]
    PacketTooSmall {
        /// P2, bytes.
        size: u32,
    },
    /// The packet claims to be larger than the reader allows.
    #[error("a packet of {size} bytes is larger than the limit of {limit}")]
    PacketTooLarge {
        /// P2, bytes.
        size: u32,
        /// The reader's limit, bytes.
        limit: u32,
    },
    /// The input ends within a packet.
    #[error("the packet has {size} bytes and the input ends after {available} of them")]
    PacketTruncated {
        /// P2, bytes; the size of a header where even that is cut.
        size: u32,
        /// Bytes of it that are there.
        available: usize,
    },
    /// A datagram holds more than one packet.
    #[error("{count} bytes follow the packet; a datagram holds one packet")]
    BytesAfterPacket {
        /// Bytes after the packet.
        count: usize,
    },
    /// What is left of the packet is too short for the header of a segment.
    #[error("{available} bytes are left, too few for the header of a segment")]
    SegmentHeaderTruncated {
        /// Bytes left in the packet.
        available: usize,
    },
    /// A segment claims to be smaller than its own header.
    #[error("a segment of {size} bytes is smaller than its header of 5")]
    SegmentTooSmall {
        /// S2, bytes.
        size: u32,
    },
    /// A segment claims to reach beyond its packet.
    #[error("a segment of {size} bytes does not fit into the {available} left in the packet")]
    SegmentOverruns {
        /// S2, bytes.
        size: u32,
        /// Bytes left in the packet.
        available: usize,
    },
    /// The segment ends within a field.
    #[error("the field has {width} bytes and the segment ends after {available} of them")]
    FieldTruncated {
        /// Bytes of the field.
        width: usize,
        /// Bytes left in the segment.
        available: usize,
    },
    /// The mask leaves out a field that must be there.
    #[error("the mask {mask:#018x} leaves out this mandatory field")]
    MandatoryAbsent {
        /// D1.
        mask: u64,
    },
    /// A dwell claims reports, and its mask selects no field of them.
    #[error("{count} reports are announced, and the mask selects none of their fields")]
    ReportsWithoutFields {
        /// D5.
        count: u16,
    },
    /// A dwell claims more reports, or a history more records, than its segment has bytes for.
    #[error("{count} entries of {width} bytes do not fit into the {available} left")]
    CountOverruns {
        /// How many were announced.
        count: u16,
        /// Bytes of each.
        width: usize,
        /// Bytes left in the segment.
        available: usize,
    },
    /// Bytes are left where the segment should be at its end.
    #[error("{count} bytes are left after the last field")]
    BytesAfterFields {
        /// How many.
        count: usize,
    },
}

/// A packet that could not be written.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum WriteError {
    /// A field holds what the standard excludes.
    #[error("{}{field} is {value}, not within {low} to {high}; correct it", at(*segment_index))]
    FieldRange {
        /// Number of the segment in the packet; none for the packet's header.
        segment_index: Option<usize>,
        /// The field as the standard names it.
        field: &'static str,
        /// Its raw value.
        value: i64,
        /// Smallest raw value.
        low: i64,
        /// Largest raw value.
        high: i64,
    },
    /// Some fields of a group are there and others are not.
    #[error("{}{fields} go together or not at all", at(Some(*segment_index)))]
    BrokenGroup {
        /// Number of the segment in the packet.
        segment_index: usize,
        /// The fields of the group.
        fields: &'static str,
    },
    /// The mask does not say what fields there are.
    #[error("{}the mask says {mask:#018x}, the fields are {fields:#018x}; seal the dwell",
            at(Some(*segment_index)))]
    MaskDisagrees {
        /// Number of the segment in the packet.
        segment_index: usize,
        /// D1.
        mask: u64,
        /// What D1 should be for the fields that are there.
        fields: u64,
    },
    /// D5 or C1 does not say how many reports or records there are.
    #[error("{}{field} says {count}, there are {present}; at most {limit} fit",
            at(Some(*segment_index)))]
    CountDisagrees {
        /// Number of the segment in the packet.
        segment_index: usize,
        /// The counting field.
        field: &'static str,
        /// What it says.
        count: usize,
        /// How many there are.
        present: usize,
        /// How many there can be.
        limit: usize,
    },
    /// The segment or the packet is larger than its size field can say.
    #[error("{}{size} bytes are more than a size field can say", at(*segment_index))]
    TooLarge {
        /// Number of the segment in the packet; none for the packet.
        segment_index: Option<usize>,
        /// Bytes.
        size: usize,
    },
}

fn at(segment_index: Option<usize>) -> String {
    segment_index.map_or_else(String::new, |index| format!("segment {index}: "))
}
