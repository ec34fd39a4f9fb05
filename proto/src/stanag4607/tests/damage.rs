//! Files cut at every byte and bytes changed by chance: no panic, no large allocation, and errors
//! that say where.

use allocation_counter::measure;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use super::super::{Packet, ReadError, Reader, packets};
use super::file_tests::all_files;
use super::sample;

const MIB: u64 = 1 << 20;

/// Files of others where there are some, and a packet of our own in any case.
fn inputs() -> Vec<Vec<u8>> {
    let own = sample().encode().unwrap();
    std::iter::once(own).chain(all_files().into_iter().map(|(_, bytes)| bytes)).collect()
}

/// Reads everything, once as a whole and once in pieces, and checks what every answer must keep.
fn read(bytes: &[u8]) -> Vec<Result<Packet, ReadError>> {
    let mut found = Vec::new();
    let used = measure(|| found = packets(bytes).collect());
    // The whole of a file is held as packets here; a reader alone holds one of them.
    let most = MIB + MOST_PER_BYTE * bytes.len() as u64;
    assert!(used.bytes_max < most, "{} bytes for {}", used.bytes_max, bytes.len());
    for (index, packet) in found.iter().enumerate() {
        match packet {
            Ok(packet) => assert!(packet.encode_as_read().is_ok()),
            Err(error) => {
                assert_eq!(error.place.packet_index, index as u64);
                assert!(error.place.byte_offset <= bytes.len() as u64, "{error}");
            }
        }
    }
    found
}

fn in_pieces(bytes: &[u8], size: usize) -> Vec<Result<Packet, ReadError>> {
    let mut reader = Reader::new();
    let mut found = Vec::new();
    for piece in bytes.chunks(size) {
        reader.feed(piece);
        found.extend(reader.by_ref());
    }
    reader.end();
    found.extend(reader);
    found
}

/// A cut in the long file is made in its first 4 KiB, where all its kinds of packets are.
#[test]
fn a_cut_at_any_byte_is_reported_at_its_packet() {
    for bytes in inputs() {
        let whole: Vec<_> = packets(&bytes).map(Result::unwrap).collect();
        let mut ends = vec![0];
        for packet in &whole {
            ends.push(ends[ends.len() - 1] + packet.encode_as_read().unwrap().len());
        }
        for cut in 0..bytes.len().min(4096) {
            let found = read(&bytes[..cut]);
            let complete = ends.iter().filter(|&&end| 0 < end && end <= cut).count();
            let (good, errors): (Vec<_>, Vec<_>) = found.into_iter().partition(Result::is_ok);
            assert_eq!(good.len(), complete);
            assert_eq!(errors.len(), usize::from(!ends.contains(&cut)), "cut at {cut}");
            for error in errors {
                assert_eq!(error.unwrap_err().place.byte_offset, ends[complete] as u64);
            }
        }
    }
}

/// A datagram with one changed, removed or added byte, or with a number set to its largest.
fn damaged(bytes: &[u8], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for _ in 0..rng.random_range(1..4) {
        let at = rng.random_range(0..bytes.len());
        match rng.random_range(0..5) {
            0 => bytes[at] = rng.random(),
            1 => bytes[at] ^= 1 << rng.random_range(0..8),
            2 => drop(bytes.remove(at)),
            3 => bytes.insert(at, rng.random()),
            _ => bytes[at..].iter_mut().take(4).for_each(|byte| *byte = 0xff),
        }
    }
    bytes
}

#[test]
fn ten_thousand_mutations_end_well() {
    let mut rng = ChaCha8Rng::seed_from_u64(4607);
    let inputs: Vec<Vec<u8>> =
        inputs().into_iter().map(|bytes| bytes[..bytes.len().min(4096)].to_vec()).collect();
    let mut refused = 0;
    for trial in 0..10_000 {
        let bytes = damaged(&inputs[trial % inputs.len()], &mut rng);
        let mut found = None;
        let used = measure(|| found = Some(Packet::decode(&bytes)));
        assert!(used.bytes_max < MIB, "{} bytes", used.bytes_max);
        refused += usize::from(found.unwrap().is_err());
        let whole = read(&bytes);
        let size = rng.random_range(1..200);
        assert_eq!(in_pieces(&bytes, size), whole, "trial {trial}, pieces of {size}");
    }
    // Many changes only change a value; most of the rest break a size or a count.
    assert!((3000..10_000).contains(&refused), "{refused} refused");
}

#[test]
fn lying_sizes_allocate_nothing() {
    let lies = [(2, 4), (32 + 1, 4), (76 + 1, 4), (76 + 5 + 13, 2)];
    for (at, width) in lies {
        let mut bytes = sample().encode().unwrap();
        bytes[at..at + width].fill(0xff);
        let used = measure(|| assert!(Packet::decode(&bytes).is_err()));
        assert!(used.bytes_max < 2000, "{} bytes for the lie at {at}", used.bytes_max);
        let streamed = measure(|| {
            let mut reader = Reader::new();
            reader.feed(&bytes);
            assert!(reader.next_packet().is_some_and(|packet| packet.is_err()));
        });
        assert!(streamed.bytes_max < 2000, "{} bytes for the lie at {at}", streamed.bytes_max);
    }
}

/// The densest packet there is: reports of one byte each, and segments of five.
#[test]
fn memory_stays_in_proportion_to_the_bytes() {
    let mask = 0xff00_03c0_0200_0000_u64.to_be_bytes();
    let mut dense = [&mask[..], &[0; 35]].concat();
    dense[8 + 5..8 + 7].copy_from_slice(&u16::MAX.to_be_bytes());
    dense.resize(dense.len() + 65_535, 7);
    let dense = super::packet(&super::segment(2, &dense));
    let empty = super::packet(&super::segment(99, &[]).repeat(10_000));
    for bytes in [dense, empty] {
        let mut found = None;
        let used = measure(|| found = Some(Packet::decode(&bytes)));
        assert!(found.unwrap().is_ok());
        let factor = used.bytes_max / bytes.len() as u64;
        assert!(factor < MOST_PER_BYTE, "{factor} times");
    }
}

/// Bytes allocated per byte received, at most: a report has 18 fields of which one byte may be
/// there, and a growing list is held twice for a moment.
const MOST_PER_BYTE: u64 = 128;
