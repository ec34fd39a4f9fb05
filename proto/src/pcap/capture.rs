//! The blocks of a capture: frames with their time and the kind of link they came over.

use std::io::Read;

use pcap_parser::traits::{PcapNGPacketBlock, PcapReaderIterator};
use pcap_parser::{Block, Linktype, PcapBlockOwned, PcapError, PcapHeader, create_reader};

use super::frame::{Counts, Frame, Frames, Payload};

/// Room for the largest frame: captures are made with at most 256 KiB per frame.
const BUFFER_BYTES: usize = 1 << 20;

const NS_PER_S: i128 = 1_000_000_000;

/// A capture that cannot be read, or not further.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum CaptureError {
    /// The input does not begin as a capture does.
    #[error("this is no capture: it begins neither as pcap nor as pcapng")]
    NotACapture,
    /// The input failed.
    #[error("the capture could not be read after {read} bytes of it")]
    Input {
        /// Bytes used before.
        read: usize,
    },
    /// A block of the capture makes no sense, or the capture ends within it.
    #[error("the capture is damaged or cut at byte {read}; what came before was read")]
    Damaged {
        /// Bytes used before.
        read: usize,
    },
    /// A block is larger than any frame can be.
    #[error("the block at byte {read} is larger than {limit} bytes; the capture is damaged there")]
    BlockTooLarge {
        /// Bytes used before.
        read: usize,
        /// Most bytes of a block.
        limit: usize,
    },
}

/// An interface that frames were captured at.
#[derive(Debug, Clone, Copy)]
struct Interface {
    link: Linktype,
    ticks_per_s: u64,
    offset_s: i64,
}

/// Reads a capture and yields what UDP and TCP carried; after an error it is at its end.
pub struct Capture<'a> {
    blocks: Box<dyn PcapReaderIterator + Send + 'a>,
    interfaces: Vec<Interface>,
    frames: Frames,
    is_over: bool,
}

/// What one block came to.
enum Found {
    Payload(Payload),
    Nothing,
    /// More bytes are needed.
    Starved,
    Over,
}

impl<'a> Capture<'a> {
    /// Begins to read.
    ///
    /// # Errors
    /// If the input fails or is no capture.
    pub fn new(input: impl Read + Send + 'a) -> Result<Self, CaptureError> {
        let failed = |error: PcapError<&'static [u8]>| match error {
            PcapError::ReadError => CaptureError::Input { read: 0 },
            _ => CaptureError::NotACapture,
        };
        let blocks = create_reader(BUFFER_BYTES, input).map_err(failed)?;
        Ok(Self { blocks, interfaces: Vec::new(), frames: Frames::default(), is_over: false })
    }

    /// What was seen so far, and what of it could not be used.
    #[must_use]
    pub fn counts(&self) -> Counts {
        self.frames.counts()
    }

    fn step(&mut self) -> Result<Found, CaptureError> {
        let read = self.blocks.consumed();
        let (size, block) = match self.blocks.next() {
            Ok(next) => next,
            Err(PcapError::Eof) => return Ok(Found::Over),
            Err(PcapError::Incomplete(_)) => return Ok(Found::Starved),
            Err(PcapError::BufferTooSmall) => {
                return Err(CaptureError::BlockTooLarge { read, limit: BUFFER_BYTES });
            }
            Err(PcapError::ReadError) => return Err(CaptureError::Input { read }),
            Err(_) => return Err(CaptureError::Damaged { read }),
        };
        let frame = frame_of(&block, &mut self.interfaces);
        let payload = frame.and_then(|frame| self.frames.payload(&frame));
        self.blocks.consume(size);
        Ok(payload.map_or(Found::Nothing, Found::Payload))
    }

    /// Gets more bytes. At the end of the input the next step says whether a block is incomplete.
    fn refill(&mut self) -> Result<(), CaptureError> {
        let (read, waiting) = (self.blocks.consumed(), self.blocks.data().len());
        self.blocks.refill().map_err(|_input| CaptureError::Input { read })?;
        let is_stuck = self.blocks.data().len() == waiting && !self.blocks.reader_exhausted();
        if is_stuck { Err(CaptureError::Damaged { read }) } else { Ok(()) }
    }
}

impl Iterator for Capture<'_> {
    type Item = Result<Payload, CaptureError>;

    fn next(&mut self) -> Option<Self::Item> {
        while !self.is_over {
            let step = match self.step() {
                Ok(Found::Payload(payload)) => return Some(Ok(payload)),
                Ok(Found::Nothing) => continue,
                Ok(Found::Starved) => self.refill(),
                Ok(Found::Over) => {
                    self.is_over = true;
                    return None;
                }
                Err(error) => Err(error),
            };
            if let Err(error) = step {
                self.is_over = true;
                return Some(Err(error));
            }
        }
        None
    }
}

/// The frame in a block, if it holds one; headers and interfaces are remembered instead.
fn frame_of<'b>(
    block: &'b PcapBlockOwned<'_>,
    interfaces: &mut Vec<Interface>,
) -> Option<Frame<'b>> {
    match block {
        PcapBlockOwned::LegacyHeader(header) => {
            *interfaces = vec![of_header(header)];
            None
        }
        PcapBlockOwned::Legacy(frame) => {
            let interface = interfaces.first()?;
            let ticks = frame.ts_usec.into();
            let time_ns = i128::from(frame.ts_sec) * NS_PER_S + interface.fraction_ns(ticks);
            Some(interface.frame(time_ns, frame.data, frame.origlen))
        }
        PcapBlockOwned::NG(Block::SectionHeader(_)) => {
            interfaces.clear();
            None
        }
        PcapBlockOwned::NG(Block::InterfaceDescription(description)) => {
            interfaces.push(Interface {
                link: description.linktype,
                ticks_per_s: ticks_per_s(description.if_tsresol),
                offset_s: description.if_tsoffset,
            });
            None
        }
        PcapBlockOwned::NG(Block::EnhancedPacket(frame)) => {
            let interface = interfaces.get(frame.if_id as usize)?;
            let ticks = u64::from(frame.ts_high) << 32 | u64::from(frame.ts_low);
            let time_ns = interface.time_ns(ticks);
            Some(interface.frame(time_ns, frame.packet_data(), frame.origlen))
        }
        // Such a block has no time.
        PcapBlockOwned::NG(Block::SimplePacket(frame)) => {
            Some(interfaces.first()?.frame(0, frame.packet_data(), frame.origlen))
        }
        PcapBlockOwned::NG(_) => None,
    }
}

fn of_header(header: &PcapHeader) -> Interface {
    let ticks_per_s = if header.is_nanosecond_precision() { 1_000_000_000 } else { 1_000_000 };
    Interface { link: header.network, ticks_per_s, offset_s: 0 }
}

/// The option `if_tsresol`: a power of ten, or of two where the highest bit is set; what is beyond
/// 64 bits counts as microseconds, the default.
fn ticks_per_s(resolution: u8) -> u64 {
    let exponent = u32::from(resolution & 0x7f);
    let base: u64 = if resolution & 0x80 == 0 { 10 } else { 2 };
    base.checked_pow(exponent).unwrap_or(1_000_000)
}

impl Interface {
    /// Unix time of a count of ticks, nanoseconds.
    fn time_ns(&self, ticks: u64) -> i128 {
        i128::from(self.offset_s) * NS_PER_S + self.fraction_ns(ticks)
    }

    fn fraction_ns(&self, ticks: u64) -> i128 {
        i128::from(ticks) * NS_PER_S / i128::from(self.ticks_per_s)
    }

    /// Times beyond 64 bits, some 292 years from 1970, are no times and become 0.
    fn frame<'b>(&self, time_ns: i128, bytes: &'b [u8], full_size: u32) -> Frame<'b> {
        let time_ns = i64::try_from(time_ns).unwrap_or(0);
        let is_cut = bytes.len() < full_size as usize;
        Frame { time_ns, link: self.link, bytes, is_cut }
    }
}
