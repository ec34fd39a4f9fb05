//! The bytes of one array or data file in order, unpacked and checked against their checksum.
//!
//! Memory is that of two buffers whatever the file says.

use std::fmt;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};

use flate2::Crc;
use flate2::bufread::DeflateDecoder;
use sha2::{Digest, Sha512};

use super::error::RecordingFault;

/// Bytes read at once; a multiple of every number's size.
pub(super) const PIECE_BYTES: usize = 1 << 16;

/// How bytes are packed in the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Packing {
    Stored,
    Deflated,
}

/// What the bytes must add up to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Checksum {
    Unknown,
    Crc32(u32),
    /// In lower-case hexadecimal digits.
    Sha512(String),
}

/// Where the bytes of one array or data file are.
#[derive(Clone, Debug)]
pub(super) struct Entry {
    /// Name for messages.
    pub(super) name: String,
    /// First byte in the file.
    pub(super) start: u64,
    /// Bytes in the file.
    pub(super) packed_byte_count: u64,
    /// Bytes as announced, unpacked.
    pub(super) byte_count: u64,
    pub(super) packing: Packing,
    pub(super) checksum: Checksum,
}

enum Running {
    None,
    Crc32(Crc),
    Sha512(Box<Sha512>),
}

/// Reads an [`Entry`] from its start.
pub(super) struct ByteSource {
    file: File,
    entry: Entry,
    reader: Box<dyn Read + Send>,
    running: Running,
    position: u64,
}

impl fmt::Debug for ByteSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { entry, position, .. } = self;
        f.debug_struct("ByteSource").field("entry", entry).field("position", position).finish()
    }
}

impl ByteSource {
    /// Starts at the first byte. Sources of one file share its position: use one at a time.
    pub(super) fn open(file: &File, entry: Entry) -> Result<Self, RecordingFault> {
        let handle = file.try_clone().and_then(|file| reader_at(file, &entry, 0));
        let reader = handle.map_err(|source| read_fault(&entry.name, source))?;
        let file = file.try_clone().map_err(|source| read_fault(&entry.name, source))?;
        let running = match entry.checksum {
            Checksum::Unknown => Running::None,
            Checksum::Crc32(_) => Running::Crc32(Crc::new()),
            Checksum::Sha512(_) => Running::Sha512(Box::default()),
        };
        Ok(Self { file, entry, reader, running, position: 0 })
    }

    pub(super) fn entry(&self) -> &Entry {
        &self.entry
    }

    /// Bytes behind, unpacked.
    pub(super) fn position(&self) -> u64 {
        self.position
    }

    /// Fills `buffer`; less than that is an error.
    pub(super) fn fill(&mut self, buffer: &mut [u8]) -> Result<(), RecordingFault> {
        let mut filled = 0;
        while filled < buffer.len() {
            match self.reader.read(&mut buffer[filled..]) {
                Ok(0) => return Err(self.cut_off(filled, buffer.len())),
                Ok(count) => filled += count,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(read_fault(&self.entry.name, error)),
            }
        }
        match &mut self.running {
            Running::None => {}
            Running::Crc32(crc) => crc.update(buffer),
            Running::Sha512(hash) => hash.update(&*buffer),
        }
        self.position += buffer.len() as u64;
        Ok(())
    }

    /// Reads `byte_count` bytes and forgets them.
    pub(super) fn pass(&mut self, byte_count: u64) -> Result<(), RecordingFault> {
        self.for_pieces(byte_count, |_| ())
    }

    /// Hands the next `byte_count` bytes to `take`, in pieces of [`PIECE_BYTES`] and a rest.
    pub(super) fn for_pieces(
        &mut self,
        byte_count: u64,
        mut take: impl FnMut(&[u8]),
    ) -> Result<(), RecordingFault> {
        let mut buffer = [0; PIECE_BYTES];
        let mut left = byte_count;
        while 0 < left {
            let length = usize::try_from(left).map_or(PIECE_BYTES, |left| left.min(PIECE_BYTES));
            self.fill(&mut buffer[..length])?;
            take(&buffer[..length]);
            left -= length as u64;
        }
        Ok(())
    }

    /// Goes on `byte_count` bytes later; what is jumped over is not checked, nor is the checksum.
    pub(super) fn jump(&mut self, byte_count: u64) -> Result<(), RecordingFault> {
        if self.entry.packing == Packing::Deflated {
            return self.pass(byte_count);
        }
        self.position = self.position.saturating_add(byte_count);
        self.running = Running::None;
        let handle = self.file.try_clone();
        self.reader = handle
            .and_then(|file| reader_at(file, &self.entry, self.position))
            .map_err(|source| read_fault(&self.entry.name, source))?;
        Ok(())
    }

    /// Compares the checksum, after the last byte.
    pub(super) fn verify(&mut self) -> Result<(), RecordingFault> {
        let good = match (&self.running, &self.entry.checksum) {
            (Running::Crc32(crc), Checksum::Crc32(expected)) => crc.sum() == *expected,
            (Running::Sha512(hash), Checksum::Sha512(expected)) => {
                hexadecimal(&hash.as_ref().clone().finalize()) == *expected
            }
            _ => true,
        };
        // Once is enough: a second look would only tell the same.
        self.running = Running::None;
        if good { Ok(()) } else { Err(damaged(&self.entry.name, "its checksum does not match")) }
    }

    fn cut_off(&self, filled: usize, wanted: usize) -> RecordingFault {
        let found = self.position + filled as u64;
        let expected = self.entry.byte_count.max(self.position + wanted as u64);
        RecordingFault::Truncated { part: self.entry.name.clone(), found, expected }
    }
}

fn reader_at(mut file: File, entry: &Entry, position: u64) -> io::Result<Box<dyn Read + Send>> {
    file.seek(SeekFrom::Start(entry.start.saturating_add(position)))?;
    let bounded = file.take(entry.packed_byte_count.saturating_sub(position));
    Ok(match entry.packing {
        Packing::Stored => Box::new(bounded),
        Packing::Deflated => {
            Box::new(DeflateDecoder::new(BufReader::with_capacity(PIECE_BYTES, bounded)))
        }
    })
}

/// Data that cannot be unpacked is damaged; all else is the system's doing.
fn read_fault(part: &str, source: io::Error) -> RecordingFault {
    use io::ErrorKind::{InvalidData, InvalidInput, UnexpectedEof};
    match source.kind() {
        InvalidData | InvalidInput | UnexpectedEof => damaged(part, &source.to_string()),
        _ => RecordingFault::Read { part: part.to_owned(), source },
    }
}

pub(super) fn damaged(part: &str, reason: &str) -> RecordingFault {
    RecordingFault::Damaged { part: part.to_owned(), reason: reason.to_owned() }
}

/// Two lower-case digits for each byte.
pub(super) fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A disk that is interrupted once, gives three bytes and then fails.
    struct Failing(u8);

    impl Read for Failing {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            self.0 += 1;
            match self.0 {
                1 => Err(io::ErrorKind::Interrupted.into()),
                2 => {
                    buffer[..3].fill(7);
                    Ok(3)
                }
                _ => Err(io::Error::other("broken")),
            }
        }
    }

    #[test]
    fn a_disk_that_fails_is_not_taken_for_damaged_data() {
        let entry = Entry {
            name: "echoes".to_owned(),
            start: 0,
            packed_byte_count: 8,
            byte_count: 8,
            packing: Packing::Stored,
            checksum: Checksum::Unknown,
        };
        let mut source = ByteSource::open(&tempfile::tempfile().unwrap(), entry).unwrap();
        let empty = source.fill(&mut [0; 2]).unwrap_err();
        assert!(matches!(empty, RecordingFault::Truncated { found: 0, expected: 8, .. }));
        source.reader = Box::new(Failing(0));
        let mut buffer = [0; 3];
        source.fill(&mut buffer).unwrap();
        assert_eq!((buffer, source.position()), ([7; 3], 3));
        assert!(matches!(source.fill(&mut buffer), Err(RecordingFault::Read { .. })));
    }

    #[test]
    fn digits_are_those_of_the_bytes() {
        assert_eq!(hexadecimal(&[0x00, 0x0f, 0xa1, 0xff]), "000fa1ff");
    }
}
