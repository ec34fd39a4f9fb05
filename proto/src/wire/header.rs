//! The fixed header before every payload, and the reasons for which bytes are refused.
//!
//! Little endian, 48 bytes, never changes:
//! `magic "TMUR" | header version u8 | codec u8 | kind u16 | schema u16 | flags u16 (0) |
//! reserved u32 (0) | boot id u64 | sequence u64 | sent, sender's clock u64 ns | payload length
//! u32 | CRC-32C u32`. The checksum covers the header without itself, and the payload.

use thiserror::Error;

use super::check::Invalid;
use crate::ids::BootId;

/// Length of the header.
pub const HEADER_BYTES: usize = 48;
const MAGIC: [u8; 4] = *b"TMUR";
const HEADER_VERSION: u8 = 1;
/// bincode 2, fixed-width little-endian integers.
const CODEC_BINCODE: u8 = 1;
const CRC_OFFSET: usize = 44;

/// What a payload holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[repr(u16)]
pub enum Kind {
    /// [`super::PointSet`]
    PointSet = 1,
    /// [`super::NodeStatus`]
    NodeStatus = 2,
    /// [`super::ClockProbe`]
    ClockProbe = 3,
    /// [`super::ClockAnswer`]
    ClockAnswer = 4,
    /// [`super::Registration`]
    Registration = 5,
    /// [`super::Picture`]
    Picture = 6,
    /// [`super::Command`]
    Command = 7,
    /// [`super::Answer`]
    Answer = 8,
    /// [`super::NodeTracks`]
    NodeTracks = 9,
    /// [`super::Dwell`]
    Dwell = 10,
    /// [`super::MapTracks`]
    MapTracks = 11,
}

/// Why bytes were not taken for a message.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum Refusal {
    /// Fewer bytes than a header has.
    #[error("{got} bytes are too short: a header alone has {HEADER_BYTES}")]
    TooShort {
        /// Bytes there.
        got: usize,
    },
    /// Not one of our messages.
    #[error("the first bytes are {got:02x?}, not \"TMUR\": this is not a Transmural message")]
    Foreign {
        /// The first four bytes.
        got: [u8; 4],
    },
    /// Header or codec of another version of this software.
    #[error(
        "header version {header} and codec {codec}: this build reads 1 and 1; run the same version on both sides"
    )]
    HeaderVersion {
        /// Header version found.
        header: u8,
        /// Codec found.
        codec: u8,
    },
    /// Another kind of message than the key promises.
    #[error("kind {got} where {want:?} was expected")]
    Kind {
        /// Kind found.
        got: u16,
        /// Kind that belongs on the key.
        want: Kind,
    },
    /// The payload's layout is of another version.
    #[error(
        "{kind:?} has schema {got}, this build reads {want}: run the same version on both sides"
    )]
    Schema {
        /// Kind of the message.
        kind: Kind,
        /// Schema found.
        got: u16,
        /// Schema of this build.
        want: u16,
    },
    /// More payload than this kind may have.
    #[error("a {kind:?} of {got} bytes is oversized: at most {limit}")]
    Oversized {
        /// Kind of the message.
        kind: Kind,
        /// Payload bytes there.
        got: usize,
        /// Most bytes allowed.
        limit: usize,
    },
    /// The stated length is not the length.
    #[error("the header states {stated} payload bytes, {got} are there: truncated or padded")]
    Length {
        /// Bytes according to the header.
        stated: u32,
        /// Bytes there.
        got: usize,
    },
    /// Damaged on the way.
    #[error("checksum {got:08x}, the header states {stated:08x}: damaged on the way")]
    Checksum {
        /// Checksum of what is there.
        got: u32,
        /// Checksum stated.
        stated: u32,
    },
    /// Reserved bits are set.
    #[error("reserved header fields are not zero")]
    Reserved,
    /// The payload is not what the schema says.
    #[error("the payload cannot be read as {kind:?}: {detail}")]
    Payload {
        /// Kind of the message.
        kind: Kind,
        /// What the decoder found.
        detail: String,
    },
    /// Bytes are left over behind the payload's last field.
    #[error("{left} bytes are left behind the last field of {kind:?}")]
    Trailing {
        /// Kind of the message.
        kind: Kind,
        /// How many.
        left: usize,
    },
    /// A field makes no sense.
    #[error(transparent)]
    Invalid(#[from] Invalid),
}

impl Refusal {
    /// A short label of the reason, for counting.
    #[must_use]
    pub fn label(&self) -> &'static str {
        match self {
            Self::TooShort { .. } => "too_short",
            Self::Foreign { .. } => "foreign",
            Self::HeaderVersion { .. } => "header_version",
            Self::Kind { .. } => "kind",
            Self::Schema { .. } => "schema",
            Self::Oversized { .. } => "oversized",
            Self::Length { .. } => "length",
            Self::Checksum { .. } => "checksum",
            Self::Reserved => "reserved",
            Self::Payload { .. } => "payload",
            Self::Trailing { .. } => "trailing",
            Self::Invalid(_) => "invalid",
        }
    }
}

/// What the header says about the sender.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) kind: Kind,
    pub(super) schema: u16,
    pub(super) boot: BootId,
    pub(super) sequence: u64,
    pub(super) sent_ns: u64,
}

/// The header's bytes followed by `payload`.
pub(super) fn seal(header: &Header, payload: &[u8]) -> Vec<u8> {
    let length = u32::try_from(payload.len()).unwrap_or(u32::MAX);
    let mut bytes = Vec::with_capacity(HEADER_BYTES + payload.len());
    bytes.extend_from_slice(&MAGIC);
    bytes.extend_from_slice(&[HEADER_VERSION, CODEC_BINCODE]);
    bytes.extend_from_slice(&(header.kind as u16).to_le_bytes());
    bytes.extend_from_slice(&header.schema.to_le_bytes());
    bytes.extend_from_slice(&[0; 6]);
    bytes.extend_from_slice(&header.boot.0.to_le_bytes());
    bytes.extend_from_slice(&header.sequence.to_le_bytes());
    bytes.extend_from_slice(&header.sent_ns.to_le_bytes());
    bytes.extend_from_slice(&length.to_le_bytes());
    let checksum = crc32c::crc32c_append(crc32c::crc32c(&bytes), payload);
    bytes.extend_from_slice(&checksum.to_le_bytes());
    bytes.extend_from_slice(payload);
    bytes
}

/// Checks everything that can be checked without reading the payload; returns header and payload.
pub(super) fn open(
    bytes: &[u8],
    want: Kind,
    schema: u16,
    limit: usize,
) -> Result<(Header, &[u8]), Refusal> {
    let Some((head, payload)) = bytes.split_at_checked(HEADER_BYTES) else {
        return Err(Refusal::TooShort { got: bytes.len() });
    };
    let magic = take::<4>(head, 0);
    if magic != MAGIC {
        return Err(Refusal::Foreign { got: magic });
    }
    if (head[4], head[5]) != (HEADER_VERSION, CODEC_BINCODE) {
        return Err(Refusal::HeaderVersion { header: head[4], codec: head[5] });
    }
    let kind = u16::from_le_bytes(take(head, 6));
    if kind != want as u16 {
        return Err(Refusal::Kind { got: kind, want });
    }
    if limit < payload.len() {
        return Err(Refusal::Oversized { kind: want, got: payload.len(), limit });
    }
    let stated_length = u32::from_le_bytes(take(head, 40));
    if stated_length as usize != payload.len() {
        return Err(Refusal::Length { stated: stated_length, got: payload.len() });
    }
    let stated = u32::from_le_bytes(take(head, CRC_OFFSET));
    let got = crc32c::crc32c_append(crc32c::crc32c(&head[..CRC_OFFSET]), payload);
    if got != stated {
        return Err(Refusal::Checksum { got, stated });
    }
    let got_schema = u16::from_le_bytes(take(head, 8));
    if got_schema != schema {
        return Err(Refusal::Schema { kind: want, got: got_schema, want: schema });
    }
    if head[10..16].iter().any(|byte| *byte != 0) {
        return Err(Refusal::Reserved);
    }
    let header = Header {
        kind: want,
        schema,
        boot: BootId(u64::from_le_bytes(take(head, 16))),
        sequence: u64::from_le_bytes(take(head, 24)),
        sent_ns: u64::from_le_bytes(take(head, 32)),
    };
    Ok((header, payload))
}

/// `N` bytes of the header from `offset`; the caller stays inside [`HEADER_BYTES`].
fn take<const N: usize>(head: &[u8], offset: usize) -> [u8; N] {
    std::array::from_fn(|index| head[offset + index])
}
