//! One packet: its frame, its segments, and both ways between bytes and model.

use super::check;
use super::error::{Fault, Place, ReadError, WriteError};
use super::header::{LEAST_PACKET_SIZE, PACKET_HEADER_BYTES, PacketHeader, SEGMENT_HEADER_BYTES};
use super::segment::{Segment, SegmentKind};
use super::table::Cursor;

/// A packet as it travels.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Packet {
    /// P1 and P3 to P10.
    pub header: PacketHeader,
    /// What it holds, in order.
    pub segments: Vec<Segment>,
}

impl Packet {
    /// The packet that `bytes` are, from the first to the last: what a UDP datagram holds.
    ///
    /// # Errors
    /// Says what is wrong and where; no more than 128 times the bytes is allocated.
    pub fn decode(bytes: &[u8]) -> Result<Self, ReadError> {
        let mut walked = 0;
        let size = frame(bytes, u32::MAX, &mut walked)?.ok_or_else(|| truncated(bytes))?;
        match bytes.len() - size {
            0 => Self::read(bytes),
            count => Err(Cursor::new(bytes, size..size, None)
                .fault("end", Fault::BytesAfterPacket { count })),
        }
    }

    /// The bytes of a packet that keeps to the standard.
    ///
    /// # Errors
    /// Names the first field out of the standard's range, the first broken group of fields, or a
    /// count, mask or size that does not fit what is there.
    pub fn encode(&self) -> Result<Vec<u8>, WriteError> {
        check::conforms(self)?;
        self.encode_as_read()
    }

    /// The bytes of a packet as it was read, whether or not its values keep to the standard.
    ///
    /// # Errors
    /// If a count, mask or size does not fit what is there, so that nobody could read the bytes.
    pub fn encode_as_read(&self) -> Result<Vec<u8>, WriteError> {
        check::can_be_read_again(self)?;
        let mut bytes = vec![0; PACKET_HEADER_BYTES];
        for (index, segment) in self.segments.iter().enumerate() {
            let too_large = |size| WriteError::TooLarge { segment_index: Some(index), size };
            segment.write(&mut bytes).map_err(too_large)?;
        }
        let size = bytes.len();
        let too_large = |_| WriteError::TooLarge { segment_index: None, size };
        let mut header = Vec::with_capacity(PACKET_HEADER_BYTES);
        self.header.write(u32::try_from(size).map_err(too_large)?, &mut header);
        bytes[..PACKET_HEADER_BYTES].copy_from_slice(&header);
        Ok(bytes)
    }

    /// From bytes whose [`frame`] is whole.
    pub(super) fn read(packet: &[u8]) -> Result<Self, ReadError> {
        let (header, _) = PacketHeader::read(packet)?;
        let mut segments = Vec::new();
        let mut at = PACKET_HEADER_BYTES;
        while let Some((kind, size)) = segment_header(packet, at) {
            let end = at + size as usize;
            let place = Some((segments.len(), kind));
            let mut cursor = Cursor::new(packet, at + SEGMENT_HEADER_BYTES..end, place);
            segments.push(Segment::read(kind, &mut cursor)?);
            at = end;
        }
        Ok(Self { header, segments })
    }
}

/// S1 and S2 at byte `at`, if all five bytes are there.
fn segment_header(packet: &[u8], at: usize) -> Option<(SegmentKind, u32)> {
    let bytes = packet.get(at..at + SEGMENT_HEADER_BYTES)?;
    let size = u32::from_be_bytes(bytes[1..].try_into().ok()?);
    Some((SegmentKind(bytes[0]), size))
}

/// The size of the packet at the beginning of `bytes` once all of it is there.
///
/// The sizes of its segments must fill the packet exactly, which is checked as far as there are
/// bytes, so that a wrong size is noticed before the reader waits for the end of it. `walked` is
/// where the check stopped; it goes on from there with more bytes, and begins at 0.
pub(super) fn frame(
    bytes: &[u8],
    limit: u32,
    walked: &mut usize,
) -> Result<Option<usize>, ReadError> {
    if bytes.len() < PACKET_HEADER_BYTES {
        return Ok(None);
    }
    let (_, packet_claim) = PacketHeader::read(bytes)?;
    let size = packet_size(bytes, packet_claim, limit)?;
    let mut at = (*walked).max(PACKET_HEADER_BYTES);
    while at < size {
        let left = size - at;
        let segment = segment_header(bytes, at);
        let place = Cursor::new(bytes, at..size, None);
        if left < SEGMENT_HEADER_BYTES {
            return Err(place.fault("S1", Fault::SegmentHeaderTruncated { available: left }));
        }
        let Some((_, claimed)) = segment else { break };
        at += segment_size(claimed, left).map_err(|fault| place.fault("S2", fault))?;
    }
    *walked = at;
    Ok((size <= bytes.len()).then_some(size))
}

/// P2, if a packet can have that size.
fn packet_size(bytes: &[u8], claimed: u32, limit: u32) -> Result<usize, ReadError> {
    let fault = |fault| Err(Cursor::new(bytes, 2..2, None).fault("P2", fault));
    if (claimed as usize) < PACKET_HEADER_BYTES {
        return fault(Fault::PacketTooSmall { size: claimed });
    }
    if limit < claimed {
        return fault(Fault::PacketTooLarge { size: claimed, limit });
    }
    Ok(claimed as usize)
}

/// S2, if a segment can have that size where the packet has `left` bytes.
fn segment_size(claimed: u32, left: usize) -> Result<usize, Fault> {
    let size = claimed as usize;
    if size < SEGMENT_HEADER_BYTES {
        return Err(Fault::SegmentTooSmall { size: claimed });
    }
    if left < size {
        return Err(Fault::SegmentOverruns { size: claimed, available: left });
    }
    Ok(size)
}

/// That the input ends within the packet it begins with.
pub(super) fn truncated(bytes: &[u8]) -> ReadError {
    let header = PacketHeader::read(bytes);
    let size = header.map_or(LEAST_PACKET_SIZE, |(_, size)| size);
    let place = Place { packet_index: 0, segment: None, field: "whole packet", byte_offset: 0 };
    ReadError { place, fault: Fault::PacketTruncated { size, available: bytes.len() } }
}
