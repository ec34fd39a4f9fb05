//! STANAG 4607, the format of moving target reports of ground surveillance radars: read and written.
//!
//! Bytes become [`Packet`]s by [`packets`] (a file), [`Reader`] (a stream) and [`Packet::decode`]
//! (a datagram), and bytes again by [`Packet::encode`]. The model holds the raw integers that
//! travel, so that what was read is written bit by bit; methods give metres, seconds, degrees and
//! radians, and constructors take them.
//!
//! Layout \[wide-area, Formats\]: big-endian; a header of 32 bytes (P1 to P10), then segments, each
//! of a type (one byte), a size that counts its own five bytes (four bytes), and its fields. A
//! dwell begins with a mask of 64 bits: bit `65 − n` for Dn, bit `34 − k` for D32.k.
//!
//! Editions 30, 31 and 41 are read; see [`Edition`]. Mission, dwell, job definition, free text,
//! test and status, processing history and platform location are typed, everything else is kept
//! byte by byte. What does not fit the layout is an error that names packet, segment, field and
//! byte; what fits the layout and is out of the standard's range is read as it is and refused only
//! when written by [`Packet::encode`].
//!
//! No size in the input is believed before the bytes are there: a packet takes at most 128 times
//! its bytes (reports of one byte each; some six times with the fields of a usual report).

mod check;
mod dwell;
mod error;
mod header;
mod job;
mod number;
mod packet;
mod reader;
mod segment;
mod table;
mod target;
mod time;
mod units;

#[cfg(test)]
mod tests;

pub use dwell::{Dwell, TargetReport};
pub use error::{Fault, Place, ReadError, WriteError};
pub use header::{
    Edition, Origin, PACKET_HEADER_BYTES, PacketHeader, SEGMENT_HEADER_BYTES, SIMULATED,
    UNCLASSIFIED,
};
pub use job::JobDefinition;
pub use number::{B16, Ba16, Ba32, OutOfRange, Sa16, Sa32, Text, TextError};
pub use packet::Packet;
pub use reader::{DEFAULT_PACKET_LIMIT, Packets, Reader, packets};
pub use segment::{
    FreeText, HistoryBase, HistoryStep, Mission, PlatformLocation, ProcessingHistory, Segment,
    SegmentKind, TestAndStatus,
};
pub use target::{DwellArea, Geodetic, SensorMotion, TargetSigmas, TruthTag};
pub use time::{MissionClock, NoSuchDate};
