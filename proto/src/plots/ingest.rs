//! Bytes of any of the formats, in pieces of any size, to scans.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{BadLine, COLUMNS, LineKind, Naming, PacketScans, RowLines, Scan};
use crate::stanag4607::{NoSuchDate, PACKET_HEADER_BYTES, Packet, ReadError, Reader};
use crate::wire::Invalid;

/// How plots are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Format {
    /// STANAG 4607, editions 30, 31 and 41.
    #[serde(rename = "4607")]
    Stanag4607,
    /// Comma-separated values.
    #[serde(rename = "csv")]
    Csv,
    /// JSON Lines.
    #[serde(rename = "jsonl")]
    JsonLines,
}

/// What could not be used of the input.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum Damage {
    /// A line was left out.
    #[error("line {}: {}", .0.line, .0.fault)]
    Line(BadLine),
    /// A packet was left out.
    #[error(transparent)]
    Packet(#[from] ReadError),
    /// A mission begins on no day.
    #[error("mission of platform {platform:?}: {fault}; its times go on as before")]
    Mission {
        /// P8.
        platform: String,
        /// What is wrong with it.
        fault: NoSuchDate,
    },
    /// A dwell comes before any mission segment: nothing is left out.
    #[error(
        "platform {platform:?}: its mission segment, which says the date, is missing before the \
         first dwell; times count from 1 January 1970 until one comes"
    )]
    Undated {
        /// P8.
        platform: String,
    },
    /// A capture lacks a part of a connection.
    #[error("{lost_count} bytes of a connection are missing from the capture")]
    Gap {
        /// How many.
        lost_count: u64,
    },
    /// A report was left out that says no place.
    #[error("revisit {revisit_index}, dwell {dwell_index}, report {report_index}: no location")]
    Placeless {
        /// D2.
        revisit_index: u16,
        /// D3.
        dwell_index: u16,
        /// Its place among the dwell's reports, from 0.
        report_index: u32,
    },
    /// A dwell, or a report of it, was left out that makes no sense.
    #[error("revisit {revisit_index}, dwell {dwell_index}, report {report_index:?}: {fault}")]
    Senseless {
        /// D2.
        revisit_index: u16,
        /// D3.
        dwell_index: u16,
        /// Which report, or none for the dwell.
        report_index: Option<u32>,
        /// What is wrong with it.
        fault: Invalid,
    },
}

impl Damage {
    /// A short name, for counting.
    #[must_use]
    pub fn label(&self) -> &'static str {
        match self {
            Self::Line(bad) => bad.fault.label(),
            Self::Packet(_) => "packet",
            Self::Mission { .. } => "mission",
            Self::Undated { .. } => "undated",
            Self::Gap { .. } => "gap",
            Self::Placeless { .. } => "placeless",
            Self::Senseless { .. } => "senseless",
        }
    }
}

impl Format {
    /// The format that `head`, the beginning of the input, is of; else the one that the name says.
    #[must_use]
    pub fn detect(name: &str, head: &[u8]) -> Option<Self> {
        let text = std::str::from_utf8(head.split(|byte| *byte == b'\n').next().unwrap_or(head));
        let text = text.unwrap_or_default().trim_start_matches('\u{feff}').trim_start();
        let is_column = |cell: &str| COLUMNS.contains(&cell.trim());
        if is_packet(head) {
            return Some(Self::Stanag4607);
        }
        if text.starts_with('{') {
            return Some(Self::JsonLines);
        }
        if text.split(',').any(is_column) {
            return Some(Self::Csv);
        }
        let ending = name.rsplit_once('.').map(|(_, ending)| ending.to_ascii_lowercase());
        match ending.as_deref() {
            Some("4607" | "gmti" | "stanag" | "bin") => Some(Self::Stanag4607),
            Some("csv") => Some(Self::Csv),
            Some("jsonl" | "json" | "ndjson") => Some(Self::JsonLines),
            _ => None,
        }
    }
}

/// Edition, a size that can be, and a classification that exists.
pub(super) fn is_packet(head: &[u8]) -> bool {
    let Some(size) = head.get(2..6).and_then(|bytes| bytes.try_into().ok()) else { return false };
    let known = [b"30", b"31", b"41"].iter().any(|edition| head.starts_with(*edition));
    let is_classified = head.get(8).is_some_and(|class| (1..=5).contains(class));
    known && is_classified && PACKET_HEADER_BYTES <= u32::from_be_bytes(size) as usize
}

/// Reads one input.
#[derive(Clone, Debug)]
pub struct Ingest {
    kind: Kind,
}

#[derive(Clone, Debug)]
enum Kind {
    Packets(Box<Reader>, PacketScans),
    Lines(Box<RowLines>, Naming),
}

impl Ingest {
    /// Of `format`, whose dwells are named as `naming` says.
    #[must_use]
    pub fn new(format: Format, naming: Naming) -> Self {
        let lines = |kind, named: Naming| {
            let rows = RowLines::new(kind, named.fallback().clone());
            Kind::Lines(Box::new(rows), named)
        };
        let kind = match format {
            Format::Stanag4607 => Kind::Packets(Box::default(), PacketScans::new(naming)),
            Format::Csv => lines(LineKind::Csv, naming),
            Format::JsonLines => lines(LineKind::Json, naming),
        };
        Self { kind }
    }

    /// Takes the next bytes of a stream; what is complete, and what could not be used, goes to
    /// `into`.
    pub fn feed(&mut self, bytes: &[u8], into: &mut Vec<Result<Scan, Damage>>) {
        match &mut self.kind {
            Kind::Packets(reader, scans) => {
                reader.feed(bytes);
                take_packets(reader, scans, into);
            }
            Kind::Lines(lines, naming) => {
                let mut found = Vec::new();
                lines.feed(bytes, &mut found);
                take_lines(naming, found, into);
            }
        }
    }

    /// Takes a datagram: a whole packet, or whole lines, which make whole dwells.
    pub fn datagram(&mut self, bytes: &[u8], into: &mut Vec<Result<Scan, Damage>>) {
        match &mut self.kind {
            Kind::Packets(_, scans) => match Packet::decode(bytes) {
                Ok(packet) => scans.take(&packet, into),
                Err(fault) => into.push(Err(fault.into())),
            },
            Kind::Lines(..) => {
                self.feed(bytes, into);
                self.finish(into);
            }
        }
    }

    /// Ends the input; bytes that follow are of a new one of the same kind.
    pub fn finish(&mut self, into: &mut Vec<Result<Scan, Damage>>) {
        match &mut self.kind {
            Kind::Packets(reader, scans) => {
                reader.end();
                take_packets(reader, scans, into);
                **reader = Reader::new();
            }
            Kind::Lines(lines, naming) => {
                let mut found = Vec::new();
                lines.finish(&mut found);
                take_lines(naming, found, into);
            }
        }
    }
}

fn take_packets(
    reader: &mut Reader,
    scans: &mut PacketScans,
    into: &mut Vec<Result<Scan, Damage>>,
) {
    while let Some(read) = reader.next_packet() {
        match read {
            Ok(packet) => scans.take(&packet, into),
            Err(fault) => into.push(Err(fault.into())),
        }
    }
}

fn take_lines(
    naming: &Naming,
    found: Vec<Result<Scan, BadLine>>,
    into: &mut Vec<Result<Scan, Damage>>,
) {
    into.extend(found.into_iter().map(|one| match one {
        Ok(scan) => Ok(named(scan, naming)),
        Err(bad) => Err(Damage::Line(bad)),
    }));
}

fn named(mut scan: Scan, naming: &Naming) -> Scan {
    if let Naming::Fixed(node) = naming {
        match &mut scan {
            Scan::Geographic(dwell) => dwell.node.clone_from(node),
            Scan::Local(local) => local.node.clone_from(node),
        }
    }
    scan
}
