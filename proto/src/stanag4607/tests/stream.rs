//! Packets in pieces, and the way back after damage.

use super::super::{Fault, Packet, ReadError, Reader, Segment, packets};
use super::{sample, segment};

/// Three packets that differ in their mission number.
fn three() -> Vec<Vec<u8>> {
    let numbered = |number| {
        let mut packet = sample();
        packet.header.origin.mission_id = number;
        packet.encode().unwrap()
    };
    (1..=3).map(numbered).collect()
}

fn missions(found: &[Result<Packet, ReadError>]) -> Vec<u32> {
    found.iter().flatten().map(|packet| packet.header.origin.mission_id).collect()
}

fn faults(found: &[Result<Packet, ReadError>]) -> Vec<Fault> {
    found.iter().filter_map(|packet| Some(packet.as_ref().err()?.fault)).collect()
}

#[test]
fn pieces_of_any_size_give_the_same_packets() {
    let bytes = three().concat();
    let whole: Vec<_> = packets(&bytes).map(Result::unwrap).collect();
    for size in [1, 2, 3, 31, 32, 33, 100, bytes.len()] {
        let mut reader = Reader::new();
        let mut found = Vec::new();
        for piece in bytes.chunks(size) {
            reader.feed(piece);
            found.extend(reader.by_ref().map(Result::unwrap));
        }
        assert_eq!(found, whole, "pieces of {size}");
        assert_eq!((reader.waiting_count(), reader.skipped_count()), (0, 0));
        reader.end();
        assert!(reader.next_packet().is_none());
    }
}

#[test]
fn a_damaged_segment_costs_one_packet() {
    let mut parts = three();
    // The first byte of D1, after the header of the packet, the mission, and a segment header.
    let mask_at = 32 + 44 + 5;
    parts[1][mask_at] = 0;
    let bytes = parts.concat();
    let found: Vec<_> = packets(&bytes).collect();
    assert_eq!(missions(&found), [1, 3]);
    let error = found[1].as_ref().unwrap_err();
    assert_eq!(error.fault, Fault::MandatoryAbsent { mask: 0x0000_03c1_8000_0000 });
    assert_eq!(error.place.packet_index, 1);
    assert_eq!(error.place.byte_offset, (parts[0].len() + mask_at) as u64);
}

#[test]
fn wrong_sizes_are_noticed_and_passed_over() {
    // P1, P2 twice, S2 of the first segment.
    for (at, value) in [(0, b'9'), (3, 0xff), (5, 0x21), (36, 0x2d)] {
        let mut parts = three();
        parts[1][at] = value;
        let bytes = parts.concat();
        let mut found = packets(&bytes);
        let all: Vec<_> = found.by_ref().collect();
        assert_eq!(missions(&all), [1, 3], "byte {at}");
        assert_eq!(faults(&all).len(), 1, "byte {at}");
        assert_eq!(found.skipped_count(), parts[1].len() as u64);

        let mut reader = Reader::new();
        reader.feed(&bytes);
        assert_eq!(reader.by_ref().collect::<Vec<_>>(), all);
    }
}

#[test]
fn noise_between_packets_is_passed_over() {
    let parts = three();
    // Headers with an impossible classification, an impossible exercise, a segment of no size.
    let mut fakes = vec![super::packet(&segment(1, &[0; 39])); 3];
    (fakes[0][8], fakes[1][13], fakes[2][36]) = (0, 3, 0);
    let words = b"30 41 31 noise that is no header \x00\x30\x30";
    let noise = [&words[..], &fakes.concat(), &[0; 50]].concat();
    let bytes = [&noise[..], &parts[0], &noise, &parts[1], &parts[2], &noise].concat();
    let found: Vec<_> = packets(&bytes).collect();
    assert_eq!(missions(&found), [1, 2, 3]);
    assert_eq!(faults(&found).len(), 3);
}

#[test]
fn a_packet_that_is_cut_is_an_error_only_at_the_end() {
    let parts = three();
    let cut = parts[0].len() + 40;
    let mut reader = Reader::new();
    reader.feed(&parts.concat()[..cut]);
    assert_eq!(reader.by_ref().count(), 1);
    assert_eq!(reader.waiting_count(), 40);
    reader.end();
    let error = reader.next_packet().unwrap().unwrap_err();
    let size = u32::try_from(parts[1].len()).unwrap();
    assert_eq!(error.fault, Fault::PacketTruncated { size, available: 40 });
    assert_eq!(error.place.byte_offset, parts[0].len() as u64);
    assert!(reader.next_packet().is_none());
}

/// A size that lies within the limit would make the reader wait for a megabyte; the segments
/// that do not fill it give the lie away before.
#[test]
fn a_lying_packet_does_not_hold_up_the_stream() {
    let mut parts = three();
    parts[0][2..6].copy_from_slice(&0x000f_0000_u32.to_be_bytes());
    let mut reader = Reader::new();
    reader.feed(&parts.concat());
    let found: Vec<_> = reader.by_ref().collect();
    assert_eq!(missions(&found), [2, 3]);
}

#[test]
fn packets_beyond_the_limit_are_refused() {
    let bytes = three().concat();
    let mut reader = Reader::with_limit(100);
    reader.feed(&bytes);
    let found: Vec<_> = reader.by_ref().collect();
    let size = u32::try_from(three()[0].len()).unwrap();
    assert_eq!(faults(&found), [Fault::PacketTooLarge { size, limit: 100 }]);
}

#[test]
fn segments_of_no_content_are_fine() {
    let bytes = super::packet(&[segment(200, &[]), segment(201, &[])].concat());
    let packet = Packet::decode(&bytes).unwrap();
    assert!(packet.segments.iter().all(|one| matches!(one, Segment::Other { .. })));
    assert_eq!(Packet::decode(&super::packet(&[])).unwrap().segments, []);
}
