//! A whole input, file or pipe, to scans: its format found out, captures of network traffic taken
//! apart.

use std::collections::BTreeMap;
use std::io::{Cursor, Read};
use std::net::SocketAddr;

use thiserror::Error;

use super::ingest::is_packet;
use super::{COLUMNS, Damage, Format, Ingest, Naming, Scan};
use crate::pcap::{Capture, CaptureError, Content, Payload, TcpStream};

/// How much of an input is looked at to find out what it is, bytes.
const HEAD_BYTES: u64 = 4096;
/// How much is read at once, bytes.
const PIECE_BYTES: usize = 1 << 16;
/// Connections of a capture that are followed; those beyond are passed over.
const MAX_FLOW_COUNT: usize = 64;
/// How captures begin: pcap in both byte orders, in micro- and nanoseconds, and pcapng.
const CAPTURE_MAGICS: [[u8; 4]; 5] = [
    [0xa1, 0xb2, 0xc3, 0xd4],
    [0xd4, 0xc3, 0xb2, 0xa1],
    [0xa1, 0xb2, 0x3c, 0x4d],
    [0x4d, 0x3c, 0xb2, 0xa1],
    [0x0a, 0x0d, 0x0d, 0x0a],
];

/// Why an input cannot be read, or not further.
#[derive(Debug, Error)]
pub enum InputError {
    /// Reading failed.
    #[error("reading {name}: {source}")]
    Read {
        /// Of the input.
        name: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// It is of no known format.
    #[error(
        "{name} is neither STANAG 4607 (editions 30, 31, 41) nor a capture of it, nor CSV whose \
         first line names some of {columns}, nor JSON Lines: name the format with --format"
    )]
    Unknown {
        /// Of the input.
        name: String,
        /// All columns of CSV.
        columns: String,
    },
    /// A capture is damaged.
    #[error("{name}: {fault}")]
    Capture {
        /// Of the input.
        name: String,
        /// What is wrong with it.
        fault: CaptureError,
    },
}

/// An input that is read piece by piece.
pub struct Input<'a> {
    name: String,
    kind: Kind<'a>,
}

enum Kind<'a> {
    Stream { from: Box<dyn Read + Send + 'a>, ingest: Box<Ingest>, is_over: bool },
    Capture { capture: Box<Capture<'a>>, flows: Flows },
}

/// What a capture carries, connection by connection.
struct Flows {
    naming: Naming,
    datagrams: Ingest,
    streams: BTreeMap<(SocketAddr, SocketAddr), (TcpStream, Ingest)>,
}

impl<'a> Input<'a> {
    /// Looks at the beginning of `from` to find out what it is, unless `format` says it.
    ///
    /// # Errors
    /// If it cannot be read, or is of no known format.
    pub fn open(
        mut from: impl Read + Send + 'a,
        name: &str,
        format: Option<Format>,
        naming: Naming,
    ) -> Result<Self, InputError> {
        let mut head = Vec::new();
        let read = from.by_ref().take(HEAD_BYTES).read_to_end(&mut head);
        read.map_err(|source| InputError::Read { name: name.to_owned(), source })?;
        let name = name.to_owned();
        let is_capture = CAPTURE_MAGICS.iter().any(|magic| head.starts_with(magic));
        let detected = format.or_else(|| Format::detect(&name, &head));
        let whole = Cursor::new(head).chain(from);
        if is_capture && matches!(format, None | Some(Format::Stanag4607)) {
            return Self::capture(whole, name, naming);
        }
        let Some(detected) = detected else {
            return Err(InputError::Unknown { name, columns: COLUMNS.join(", ") });
        };
        let ingest = Box::new(Ingest::new(detected, naming));
        let kind = Kind::Stream { from: Box::new(whole), ingest, is_over: false };
        Ok(Self { name, kind })
    }

    fn capture(
        whole: impl Read + Send + 'a,
        name: String,
        naming: Naming,
    ) -> Result<Self, InputError> {
        let capture = match Capture::new(whole) {
            Ok(capture) => Box::new(capture),
            Err(fault) => return Err(InputError::Capture { name, fault }),
        };
        let datagrams = Ingest::new(Format::Stanag4607, naming.clone());
        let flows = Flows { naming, datagrams, streams: BTreeMap::new() };
        Ok(Self { name, kind: Kind::Capture { capture, flows } })
    }

    /// Reads on; scans that are complete, and what could not be used, go to `into`. False at the end.
    ///
    /// # Errors
    /// If the input cannot be read further; what came before stands.
    pub fn advance(&mut self, into: &mut Vec<Result<Scan, Damage>>) -> Result<bool, InputError> {
        match &mut self.kind {
            Kind::Stream { is_over: true, .. } => Ok(false),
            Kind::Stream { from, ingest, is_over } => {
                let mut piece = vec![0; PIECE_BYTES];
                let read = from.read(&mut piece);
                let count =
                    read.map_err(|source| InputError::Read { name: self.name.clone(), source })?;
                ingest.feed(&piece[..count], into);
                if count == 0 {
                    ingest.finish(into);
                    *is_over = true;
                }
                Ok(!*is_over)
            }
            Kind::Capture { capture, flows } => match capture.next() {
                None => {
                    flows.finish(into);
                    Ok(false)
                }
                Some(Ok(payload)) => {
                    flows.take(&payload, into);
                    Ok(true)
                }
                Some(Err(fault)) => {
                    flows.finish(into);
                    Err(InputError::Capture { name: self.name.clone(), fault })
                }
            },
        }
    }
}

impl Flows {
    /// Takes what is of STANAG 4607, and passes over the rest of the traffic.
    fn take(&mut self, payload: &Payload, into: &mut Vec<Result<Scan, Damage>>) {
        match &payload.content {
            Content::Udp(bytes) if is_packet(bytes) => self.datagrams.datagram(bytes, into),
            Content::Udp(_) => {}
            Content::Tcp { bytes, .. } => {
                let key = (payload.source, payload.destination);
                let is_known = self.streams.contains_key(&key);
                let is_ours = holds_packet(bytes) && self.streams.len() < MAX_FLOW_COUNT;
                if !is_known && !is_ours {
                    return;
                }
                let new = || {
                    let ingest = Ingest::new(Format::Stanag4607, self.naming.clone());
                    (TcpStream::default(), ingest)
                };
                let (stream, ingest) = self.streams.entry(key).or_insert_with(new);
                let lost_before = stream.lost_count();
                let ready = stream.push(&payload.content);
                go_on(ingest, stream.lost_count() - lost_before, &ready, into);
            }
        }
    }

    fn finish(&mut self, into: &mut Vec<Result<Scan, Damage>>) {
        for (mut stream, mut ingest) in std::mem::take(&mut self.streams).into_values() {
            let mut lost_before = stream.lost_count();
            while let Some(ready) = stream.give_up() {
                go_on(&mut ingest, stream.lost_count() - lost_before, &ready, into);
                lost_before = stream.lost_count();
            }
            ingest.finish(into);
        }
    }
}

/// Reads on after `lost_count` bytes that are missing: what is before and after them is not one packet.
fn go_on(ingest: &mut Ingest, lost_count: u64, ready: &[u8], into: &mut Vec<Result<Scan, Damage>>) {
    if 0 < lost_count {
        ingest.finish(into);
        into.push(Err(Damage::Gap { lost_count }));
    }
    ingest.feed(ready, into);
}

/// Whether a piece of a stream begins with a packet, or, joined in the middle, holds one that ends with
/// the piece or is followed by another.
fn holds_packet(piece: &[u8]) -> bool {
    let is_followed = |start: usize| {
        let rest = &piece[start..];
        let size = rest.get(2..6).and_then(|bytes| bytes.try_into().ok()).map(u32::from_be_bytes);
        let after = size.and_then(|size| rest.get(size as usize..));
        is_packet(rest) && after.is_some_and(|after| after.is_empty() || is_packet(after))
    };
    is_packet(piece) || (1..piece.len()).any(is_followed)
}
