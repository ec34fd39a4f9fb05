//! The 32 bytes at the beginning of every packet.

use super::error::{Fault, ReadError};
use super::number::Text;
use super::table::{Cursor, Field, Fixed, fixed_table};

/// Bytes of the header of a packet.
pub const PACKET_HEADER_BYTES: usize = 32;

/// The same as P2 counts it.
pub(super) const LEAST_PACKET_SIZE: u32 = 32;

/// Bytes of the header of a segment: its type and its size.
pub const SEGMENT_HEADER_BYTES: usize = 5;

/// The same as S2 counts it.
pub(super) const LEAST_SEGMENT_SIZE: u32 = 5;

/// The editions of the standard that are read and written.
///
/// The segments that this module types have the same fields in all three. The editions differ in
/// the rule for P10: see [`Edition::job_id_only_with_data`]. Other editions are refused by name,
/// since their masks may mean other fields, and a wrong guess would be a target in a wrong place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Edition {
    /// `30`, of 2010.
    V30,
    /// `31`.
    V31,
    /// `41`, AEDP-4607 edition A of 2024.
    #[default]
    V41,
}

impl Edition {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::V30, Self::V31, Self::V41];

    /// P1.
    #[must_use]
    pub fn bytes(self) -> [u8; 2] {
        match self {
            Self::V30 => *b"30",
            Self::V31 => *b"31",
            Self::V41 => *b"41",
        }
    }

    /// The edition that P1 names.
    #[must_use]
    pub fn from_bytes(bytes: [u8; 2]) -> Option<Self> {
        Self::ALL.into_iter().find(|edition| edition.bytes() == bytes)
    }

    /// Whether P10 must be zero in a packet without dwells and HRR, as edition 41 wants it.
    /// Packets of edition 30 name the job there, too.
    #[must_use]
    pub fn job_id_only_with_data(self) -> bool {
        self == Self::V41
    }
}

/// P1 and P3 to P10; P2, the size, follows from the segments.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PacketHeader {
    /// P1: the edition that the packet follows.
    pub edition: Edition,
    /// P3 to P10.
    pub origin: Origin,
}

fixed_table! {
    /// P3 to P10: who sends, under what classification, in which mission and job.
    pub struct Origin {
        /// P3: country code of the platform.
        nationality: Text<2> = "P3",
        /// P4: 1 top secret, 2 secret, 3 confidential, 4 restricted, 5 unclassified.
        classification: u8 = "P4",
        /// P5: the system of classification.
        classification_system: Text<2> = "P5",
        /// P6: control and handling, one bit each.
        security_codes: u16 = "P6",
        /// P7: 0 operation, 1 and 2 its simulation; 128, 129 and 130 the same of an exercise.
        exercise: u8 = "P7",
        /// P8: the platform's name.
        platform_id: Text<10> = "P8",
        /// P9: the mission of the platform.
        mission_id: u32 = "P9",
        /// P10: the job that asked for the data, 0 for none.
        job_id: u32 = "P10",
    }
}

/// Classification of what anybody may see (P4).
pub const UNCLASSIFIED: u8 = 5;
/// P7 of simulated data.
pub const SIMULATED: u8 = 1;

impl PacketHeader {
    /// Edition and P2 of the header at the beginning of `packet`, which has all 32 bytes.
    pub(super) fn read(packet: &[u8]) -> Result<(Self, u32), ReadError> {
        let mut cursor = Cursor::new(packet, 0..PACKET_HEADER_BYTES, None);
        let found: [u8; 2] = Field::read(&mut cursor, "P1")?;
        let unknown =
            || Cursor::new(packet, 0..0, None).fault("P1", Fault::UnknownEdition { found });
        let edition = Edition::from_bytes(found).ok_or_else(unknown)?;
        let size = Field::read(&mut cursor, "P2")?;
        let origin = Origin::read(&mut cursor)?;
        Ok((Self { edition, origin }, size))
    }

    /// The 32 bytes for a packet of `size` bytes.
    pub(super) fn write(&self, size: u32, out: &mut Vec<u8>) {
        Field::write(&self.edition.bytes(), out);
        Field::write(&size, out);
        self.origin.write(out);
    }
}
