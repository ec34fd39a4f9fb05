//! System tracks as ASTERIX category 062, edition 1.18 (and 1.20, which differs in other items).
//!
//! What a record holds \[asterix-062\]: I062/010 source, 070 time of track, 105 position (WGS 84),
//! 100 position (Cartesian, where a frame is given), 185 velocity, 040 track number, 080 status,
//! 290 ages of the track and of its last primary plot, 130 geometric altitude, 500 accuracies.
//! I062/295 is left out: all of its ages are of data that aircraft send.
//!
//! Track numbers have 16 bits, a tracker's ids 64: [`TrackNumbers`] hands them out.

mod items;
mod numbers;

pub use numbers::TrackNumbers;

use proto::geodesy::EnuFrame;

use super::{DATAGRAM_BYTES_MAX, ExportError, GeoTrack, Origin};

const CATEGORY: u8 = 62;
/// Category and length come before the records of a block.
const BLOCK_HEADER_BYTES: usize = 3;
/// Items told of by one octet of the field specification; its last bit says that more follow.
const ITEMS_PER_OCTET: usize = 7;

/// Who sends the tracks.
#[derive(Clone, Debug, PartialEq)]
pub struct Cat062Settings {
    /// System area code, assigned by Eurocontrol.
    pub sac: u8,
    /// System identification code within the area.
    pub sic: u8,
    /// Whether the tracks come out of a simulation.
    pub origin: Origin,
    /// Where the system's Cartesian coordinates have their origin, in the plane that touches the
    /// earth there; without it I062/100 is left out.
    pub frame: Option<EnuFrame>,
}

/// Which of the messages about a track this one is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Message {
    /// The first: nobody has heard of it.
    First,
    /// One of many.
    Update,
    /// The last: receivers drop the track.
    Last,
}

/// A track under its number of 16 bits.
#[derive(Clone, Copy, Debug)]
pub struct Entry<'a> {
    /// The track.
    pub track: &'a GeoTrack,
    /// From [`TrackNumbers`].
    pub number: u16,
    /// Which message about it.
    pub message: Message,
}

/// Data blocks that hold all entries in their order, each small enough for one datagram.
///
/// # Errors
/// If a track says something that is not possible.
pub fn blocks(
    entries: &[Entry<'_>],
    settings: &Cat062Settings,
) -> Result<Vec<Vec<u8>>, ExportError> {
    let mut blocks: Vec<Vec<u8>> = Vec::new();
    for entry in entries {
        let record = record(entry, settings)?;
        match blocks.last_mut() {
            Some(block) if block.len() + record.len() <= DATAGRAM_BYTES_MAX => block.extend(record),
            _ => blocks.push([vec![CATEGORY, 0, 0], record].concat()),
        }
    }
    for block in &mut blocks {
        let [_, _, high, low] = be_length(block.len());
        block[1..BLOCK_HEADER_BYTES].copy_from_slice(&[high, low]);
    }
    Ok(blocks)
}

/// A block ends before a datagram does, so that its length always fits.
fn be_length(length: usize) -> [u8; 4] {
    u32::try_from(length).unwrap_or(u32::MAX).to_be_bytes()
}

/// One record: the field specification and the items that it tells of.
///
/// # Errors
/// If the track says something that is not possible.
pub fn record(entry: &Entry<'_>, settings: &Cat062Settings) -> Result<Vec<u8>, ExportError> {
    entry.track.check()?;
    let items = items::all(entry, settings);
    Ok([field_specification(items.iter().map(|item| item.field)), joined(&items)].concat())
}

fn joined(items: &[items::Item]) -> Vec<u8> {
    items.iter().flat_map(|item| item.bytes.iter().copied()).collect()
}

/// Bit 8 of the first octet stands for field reference number 1; bit 1 of each octet says that
/// another follows. Compound items tell of their subfields in the same way.
fn field_specification(fields: impl Iterator<Item = usize>) -> Vec<u8> {
    let mut octets: Vec<u8> = vec![0];
    for field in fields {
        let (octet, bit) = ((field - 1) / ITEMS_PER_OCTET, (field - 1) % ITEMS_PER_OCTET);
        while octets.len() <= octet {
            octets.last_mut().into_iter().for_each(|last| *last |= 1);
            octets.push(0);
        }
        octets[octet] |= 0x80 >> bit;
    }
    octets
}

#[cfg(test)]
mod tests;
