//! Packets one after the other from files, datagrams and streams, going on after damage.

use super::error::{Place, ReadError};
use super::header::{
    Edition, LEAST_PACKET_SIZE, LEAST_SEGMENT_SIZE, PACKET_HEADER_BYTES, SEGMENT_HEADER_BYTES,
};
use super::packet::{Packet, frame, truncated};

/// Largest packet that is accepted unless the reader is told otherwise: room for some 25,000
/// reports with all their fields. It bounds how long a stream with a damaged size is waited for.
pub const DEFAULT_PACKET_LIMIT: u32 = 1 << 20;

/// Finds packets in bytes, from the first one on or after damage.
#[derive(Debug, Clone)]
struct Scanner {
    limit: u32,
    /// Offset in the input of the first byte not yet used.
    offset: u64,
    packet_index: u64,
    skipped_count: u64,
    walked: usize,
    is_lost: bool,
}

/// What comes next in some bytes, and how many of them are used up by it.
struct Step {
    used: usize,
    packet: Option<Result<Packet, ReadError>>,
}

impl Scanner {
    fn new(limit: u32) -> Self {
        Self { limit, offset: 0, packet_index: 0, skipped_count: 0, walked: 0, is_lost: false }
    }

    /// The next packet of `bytes`, none while more bytes are needed; `end` if none will come.
    fn step(&mut self, bytes: &[u8], end: End) -> Step {
        let skipped = if self.is_lost { self.skip_to_header(bytes, end) } else { 0 };
        let mut step = self.packet(&bytes[skipped..], end);
        step.used += skipped;
        step
    }

    fn packet(&mut self, bytes: &[u8], end: End) -> Step {
        if bytes.is_empty() || self.is_lost {
            return Step { used: 0, packet: None };
        }
        let framed = match frame(bytes, self.limit, &mut self.walked) {
            Ok(None) if end == End::Here => Err(truncated(bytes)),
            Ok(None) => return Step { used: 0, packet: None },
            Ok(Some(size)) => Ok(size),
            Err(error) => Err(error),
        };
        match framed {
            Ok(size) => self.hand_out(Packet::read(&bytes[..size]), size),
            Err(error) => {
                // No size can be trusted: the next packet is looked for from the next byte on.
                self.is_lost = true;
                self.skipped_count += 1;
                self.hand_out(Err(error), 1)
            }
        }
    }

    fn hand_out(&mut self, packet: Result<Packet, ReadError>, used: usize) -> Step {
        let (packet_index, offset) = (self.packet_index, self.offset);
        let packet = packet.map_err(|error| moved(error, packet_index, offset));
        self.packet_index += 1;
        self.walked = 0;
        self.offset += used as u64;
        Step { used, packet: Some(packet) }
    }

    /// How many bytes are before the next plausible header, or before the bytes that may still
    /// become one.
    fn skip_to_header(&mut self, bytes: &[u8], end: End) -> usize {
        let looks = |at: usize| self.looks(&bytes[at..]);
        let is_candidate = |at: &usize| match looks(*at) {
            Looks::Right => true,
            Looks::Short => end == End::Open,
            Looks::Wrong => false,
        };
        let first = (0..bytes.len()).find(is_candidate);
        self.is_lost = !first.is_some_and(|at| looks(at) == Looks::Right);
        let skipped = first.unwrap_or(bytes.len());
        self.skipped_count += skipped as u64;
        self.offset += skipped as u64;
        skipped
    }

    /// Whether a packet seems to begin here: a known edition, a size within the limit,
    /// classification and exercise as the standard lists them, a first segment that fits.
    fn looks(&self, bytes: &[u8]) -> Looks {
        let Some(edition) = bytes.first_chunk() else { return Looks::Short };
        if Edition::from_bytes(*edition).is_none() {
            return Looks::Wrong;
        }
        if bytes.len() < PACKET_HEADER_BYTES {
            return Looks::Short;
        }
        let is_plausible = (LEAST_PACKET_SIZE..=self.limit).contains(&size_at(bytes, 2))
            && (1..=5).contains(&bytes[8])
            && matches!(bytes[13], 0..=2 | 128..=130);
        if is_plausible { first_segment_looks(bytes) } else { Looks::Wrong }
    }
}

fn first_segment_looks(bytes: &[u8]) -> Looks {
    let left = size_at(bytes, 2) - LEAST_PACKET_SIZE;
    if left == 0 {
        return Looks::Right;
    }
    if bytes.len() < PACKET_HEADER_BYTES + SEGMENT_HEADER_BYTES {
        return Looks::Short;
    }
    let fits = (LEAST_SEGMENT_SIZE..=left).contains(&size_at(bytes, PACKET_HEADER_BYTES + 1));
    if fits { Looks::Right } else { Looks::Wrong }
}

fn size_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_be_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

/// What the bytes at some place look like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Looks {
    /// A packet begins here.
    Right,
    /// None does.
    Wrong,
    /// One may begin here; there are too few bytes to tell.
    Short,
}

/// Whether more bytes can follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum End {
    Open,
    Here,
}

/// An error of a packet at its place in the whole input.
fn moved(error: ReadError, packet_index: u64, offset: u64) -> ReadError {
    let byte_offset = error.place.byte_offset + offset;
    ReadError { place: Place { packet_index, byte_offset, ..error.place }, ..error }
}

/// Reads packets from bytes that come bit by bit, as from TCP or a large file.
///
/// Where sizes disagree, the input ends within a packet, or the edition is unknown, the reader
/// reports it once and goes on at the next place that looks like the header of a packet. Where
/// the sizes agree and a segment makes no sense, it reports that and goes on with the next packet.
/// An error is therefore never the end; `None` means that more bytes are needed.
///
/// Memory: the bytes that were fed and not yet read, at most a packet of the limit once
/// everything there was taken.
#[derive(Debug, Clone)]
pub struct Reader {
    scanner: Scanner,
    buffer: Vec<u8>,
    start: usize,
    end: End,
}

impl Default for Reader {
    fn default() -> Self {
        Self::new()
    }
}

impl Reader {
    /// With packets of at most [`DEFAULT_PACKET_LIMIT`] bytes.
    #[must_use]
    pub fn new() -> Self {
        Self::with_limit(DEFAULT_PACKET_LIMIT)
    }

    /// With packets of at most `limit` bytes.
    #[must_use]
    pub fn with_limit(limit: u32) -> Self {
        let scanner = Scanner::new(limit);
        Self { scanner, buffer: Vec::new(), start: 0, end: End::Open }
    }

    /// Adds what arrived.
    pub fn feed(&mut self, bytes: &[u8]) {
        self.buffer.drain(..self.start);
        self.start = 0;
        self.buffer.extend_from_slice(bytes);
    }

    /// Says that nothing more will arrive: an incomplete packet becomes an error.
    pub fn end(&mut self) {
        self.end = End::Here;
    }

    /// The next packet, or what is wrong with it; none if more bytes are needed.
    pub fn next_packet(&mut self) -> Option<Result<Packet, ReadError>> {
        let step = self.scanner.step(&self.buffer[self.start..], self.end);
        self.start += step.used;
        step.packet
    }

    /// Bytes that belonged to no packet so far.
    #[must_use]
    pub fn skipped_count(&self) -> u64 {
        self.scanner.skipped_count
    }

    /// Bytes that were fed and not yet used.
    #[must_use]
    pub fn waiting_count(&self) -> usize {
        self.buffer.len() - self.start
    }
}

impl Iterator for Reader {
    type Item = Result<Packet, ReadError>;

    fn next(&mut self) -> Option<Self::Item> {
        self.next_packet()
    }
}

/// The packets of a whole input, such as a file; see [`Reader`] for what happens after damage.
#[derive(Debug, Clone)]
pub struct Packets<'a> {
    scanner: Scanner,
    bytes: &'a [u8],
}

/// The packets of `bytes` one by one, each of at most [`DEFAULT_PACKET_LIMIT`] bytes.
#[must_use]
pub fn packets(bytes: &[u8]) -> Packets<'_> {
    Packets { scanner: Scanner::new(DEFAULT_PACKET_LIMIT), bytes }
}

impl Packets<'_> {
    /// Bytes that belonged to no packet so far.
    #[must_use]
    pub fn skipped_count(&self) -> u64 {
        self.scanner.skipped_count
    }
}

impl Iterator for Packets<'_> {
    type Item = Result<Packet, ReadError>;

    fn next(&mut self) -> Option<Self::Item> {
        let step = self.scanner.step(self.bytes, End::Here);
        self.bytes = &self.bytes[step.used..];
        step.packet
    }
}
