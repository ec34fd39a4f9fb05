//! Captures put together by hand, in every format and over every kind of link.

use std::fmt::Write as _;
use std::io::{self, Read};

use allocation_counter::measure;
use etherparse::{IpFragOffset, IpNumber, Ipv4Header, PacketBuilder, UdpHeader};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use super::{Capture, CaptureError, Content, Counts, Payload, TcpStream};

const FROM: [u8; 4] = [192, 168, 0, 1];
const TO: [u8; 4] = [192, 168, 0, 2];

/// Ethernet, IPv4 and UDP around two bytes, written byte by byte from the headers' definitions.
const BY_HAND: [u8; 44] = [
    1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 0x08, 0x00, // to, from, IPv4
    0x45, 0, 0, 30, 0, 1, 0, 0, 64, 17, 0, 0, 192, 168, 0, 1, 192, 168, 0, 2, // 30 bytes, UDP
    0x10, 0x00, 0x12, 0x0f, 0, 10, 0, 0, // port 4096 to 4623, 10 bytes
    0xab, 0xcd,
];

/// A classic capture; numbers in the order of `big`.
struct Classic {
    magic: u32,
    link: u32,
    big: Big,
}

#[derive(Clone, Copy, PartialEq)]
enum Big {
    Endian,
    Not,
}

impl Big {
    fn long(self, value: u32) -> [u8; 4] {
        if self == Self::Endian { value.to_be_bytes() } else { value.to_le_bytes() }
    }

    fn short(self, value: u16) -> [u8; 2] {
        if self == Self::Endian { value.to_be_bytes() } else { value.to_le_bytes() }
    }
}

impl Classic {
    fn file(&self, frames: &[(u32, u32, &[u8])]) -> Vec<u8> {
        let mut file = self.big.long(self.magic).to_vec();
        for version in [2, 4] {
            file.extend(self.big.short(version));
        }
        for value in [0, 0, 65_535, self.link] {
            file.extend(self.big.long(value));
        }
        for (seconds, fraction, bytes) in frames {
            let size = u32::try_from(bytes.len()).unwrap();
            for value in [*seconds, *fraction, size, size] {
                file.extend(self.big.long(value));
            }
            file.extend_from_slice(bytes);
        }
        file
    }
}

const MICRO: u32 = 0xa1b2_c3d4;
const NANO: u32 = 0xa1b2_3c4d;
const ETHERNET: u32 = 1;

fn ethernet(frames: &[&[u8]]) -> Vec<u8> {
    let frames: Vec<_> = frames.iter().map(|frame| (1, 0, *frame)).collect();
    Classic { magic: MICRO, link: ETHERNET, big: Big::Not }.file(&frames)
}

fn read(file: &[u8]) -> (Vec<Payload>, Counts) {
    let mut capture = Capture::new(file).unwrap();
    let payloads = capture.by_ref().map(Result::unwrap).collect();
    (payloads, capture.counts())
}

fn hand_payload(time_ns: i64) -> Payload {
    Payload {
        time_ns,
        source: (FROM, 4096).into(),
        destination: (TO, 4623).into(),
        content: Content::Udp(vec![0xab, 0xcd]),
    }
}

#[test]
fn classic_captures_of_both_orders_and_resolutions() {
    for big in [Big::Endian, Big::Not] {
        for (magic, expected) in [(MICRO, 7_000_005_000), (NANO, 7_000_000_005)] {
            let file = Classic { magic, link: ETHERNET, big }.file(&[(7, 5, &BY_HAND)]);
            let (payloads, counts) = read(&file);
            assert_eq!(payloads, [hand_payload(expected)]);
            assert_eq!(counts, Counts { frame_count: 1, udp_count: 1, ..Counts::default() });
        }
    }
}

/// A block of pcapng: its type, its size twice, its fields filled to four bytes.
fn block(big: Big, kind: u32, fields: &[u8]) -> Vec<u8> {
    let filled = fields.len().next_multiple_of(4);
    let size = big.long(u32::try_from(filled + 12).unwrap());
    let mut block = [&big.long(kind)[..], &size, fields].concat();
    block.resize(8 + filled, 0);
    block.extend(size);
    block
}

/// A section with one interface of some resolution and one frame at a count of ticks.
fn section(big: Big, resolution: Option<u8>, ticks: u64) -> Vec<u8> {
    let versions = [big.short(1), big.short(0)].concat();
    let header = [&big.long(0x1a2b_3c4d)[..], &versions, &[0xff; 8]].concat();
    let option = |power| [&big.short(9)[..], &big.short(1), &[power, 0, 0, 0]].concat();
    let end = [0; 4];
    let options = resolution.map_or(Vec::new(), |one| [option(one), end.to_vec()].concat());
    let interface = [&big.short(1)[..], &[0; 2], &big.long(65_535), &options].concat();
    let size = big.long(44);
    let (high, low) = ((ticks >> 32) as u32, (ticks & 0xffff_ffff) as u32);
    let times = [big.long(0), big.long(high), big.long(low)].concat();
    let frame = [&times[..], &size, &size, &BY_HAND].concat();
    [block(big, 0x0a0d_0d0a, &header), block(big, 1, &interface), block(big, 6, &frame)].concat()
}

#[test]
fn pcapng_in_both_orders_and_any_resolution() {
    for big in [Big::Endian, Big::Not] {
        let cases = [
            (None, 7_000_000, 7_000_000_000),
            (Some(9), 7_000_000_005, 7_000_000_005),
            (Some(3), 7, 7_000_000),
            (Some(0x8a), 1024 + 512, 1_500_000_000),
        ];
        for (resolution, ticks, expected) in cases {
            let file = [section(big, resolution, ticks), section(big, None, 0)].concat();
            assert_eq!(read(&file).0, [hand_payload(expected), hand_payload(0)]);
        }
    }
}

#[test]
fn every_kind_of_link() {
    let ip = &BY_HAND[14..];
    let tagged = [&BY_HAND[..12], &[0x81, 0, 0, 5], &BY_HAND[12..]].concat();
    let cooked = [&[0, 0, 0, 1, 0, 6, 1, 2, 3, 4, 5, 6, 0, 0, 0x08, 0x00], ip].concat();
    let cooked_2 = [&[0x08, 0x00][..], &[0; 18], ip].concat();
    let links = [
        (1, tagged),
        (0, [&[2, 0, 0, 0], ip].concat()),
        (108, [&[0, 0, 0, 2], ip].concat()),
        (101, ip.to_vec()),
        (12, ip.to_vec()),
        (14, ip.to_vec()),
        (228, ip.to_vec()),
        (113, cooked),
        (276, cooked_2),
    ];
    for (link, frame) in links {
        let file = Classic { magic: MICRO, link, big: Big::Not }.file(&[(0, 0, &frame)]);
        assert_eq!(read(&file).0, [hand_payload(0)], "link {link}");
    }
}

#[test]
fn version_6_as_well() {
    let [mut from, mut to] = [[0; 16]; 2];
    (from[15], to[15]) = (1, 2);
    let builder = PacketBuilder::ipv6(from, to, 9).udp(5, 6);
    let mut frame = Vec::new();
    builder.write(&mut frame, b"six").unwrap();
    let file = Classic { magic: MICRO, link: 229, big: Big::Not }.file(&[(0, 0, &frame)]);
    let (payloads, _) = read(&file);
    assert_eq!(payloads[0].content, Content::Udp(b"six".to_vec()));
    assert_eq!(payloads[0].source, (from, 5).into());
}

/// Parts of a datagram, of `size` bytes each but the last.
fn fragments(number: u16, payload: &[u8], size: usize) -> Vec<Vec<u8>> {
    let udp = UdpHeader::without_ipv4_checksum(9, 10, payload.len()).unwrap();
    let whole = [&udp.to_bytes()[..], payload].concat();
    let last = whole.len().div_ceil(size) - 1;
    let part = |(index, bytes): (usize, &[u8])| {
        let length = u16::try_from(bytes.len()).unwrap();
        let mut ip = Ipv4Header::new(length, 64, IpNumber::UDP, FROM, TO).unwrap();
        ip.identification = number;
        ip.more_fragments = index < last;
        let offset = u16::try_from(index * size / 8).unwrap();
        ip.fragment_offset = IpFragOffset::try_new(offset).unwrap();
        [&BY_HAND[..14], &ip.to_bytes(), bytes].concat()
    };
    whole.chunks(size).enumerate().map(part).collect()
}

#[test]
fn fragments_are_put_together_in_any_order() {
    let payload: Vec<u8> = (0..4000_u32).map(|value| (value % 251) as u8).collect();
    let [first, second] = [1, 2].map(|number| fragments(number, &payload, 1480));
    assert_eq!(first.len(), 3);
    let order = [&second[2], &first[1], &first[2], &second[0], &first[0], &second[1]];
    let frames: Vec<&[u8]> = order.iter().map(|frame| frame.as_slice()).collect();
    let (payloads, counts) = read(&ethernet(&frames));
    assert_eq!(payloads.len(), 2);
    assert!(payloads.iter().all(|one| one.content == Content::Udp(payload.clone())));
    assert!(payloads.iter().all(|one| one.source.port() == 9));
    assert_eq!((counts.udp_count, counts.fragment_count, counts.unfinished_count), (2, 6, 0));
}

#[test]
fn missing_fragments_are_counted_and_bounded() {
    let parts: Vec<Vec<u8>> =
        (0..1000).map(|number| fragments(number, &[7; 2000], 1480).swap_remove(0)).collect();
    let frames: Vec<&[u8]> = parts.iter().map(Vec::as_slice).collect();
    let file = ethernet(&frames);
    let mut counts = Counts::default();
    let used = measure(|| counts = read(&file).1);
    assert_eq!((counts.unfinished_count, counts.udp_count), (1000, 0));
    // A buffer of one megabyte and 64 waiting parts.
    assert!(used.bytes_max < (1 << 20) + 64 * 8000, "{} bytes", used.bytes_max);
}

#[test]
fn what_is_of_no_use_is_counted() {
    let mut arp = BY_HAND;
    arp[13] = 6;
    let mut icmp = BY_HAND;
    icmp[23] = 1;
    let mut senseless = BY_HAND;
    senseless[14] = 0x41;
    let (payloads, counts) = read(&ethernet(&[&icmp, &senseless, &arp]));
    assert_eq!(payloads, []);
    assert_eq!((counts.other_count, counts.unreadable_count), (2, 1));

    let mut cut = ethernet(&[&BY_HAND]);
    cut[24 + 12] = 200;
    assert_eq!(read(&cut).1.cut_count, 1);
    let file = Classic { magic: MICRO, link: 147, big: Big::Not }.file(&[(0, 0, &BY_HAND)]);
    assert_eq!(read(&file).1.unknown_link_count, 1);
}

#[test]
fn what_is_no_capture_is_refused() {
    let refused = |bytes: &[u8]| Capture::new(bytes).err().unwrap();
    assert_eq!(refused(b""), CaptureError::NotACapture);
    assert_eq!(refused(b"41"), CaptureError::NotACapture);
    assert_eq!(refused(&[7; 100]), CaptureError::NotACapture);
}

#[test]
fn damage_ends_a_capture_after_what_came_before() {
    let good = ethernet(&[&BY_HAND, &BY_HAND]);
    let mut capture = Capture::new(&good[..good.len() - 1]).unwrap();
    assert_eq!(capture.next(), Some(Ok(hand_payload(1_000_000_000))));
    let read = 24 + 16 + BY_HAND.len();
    assert_eq!(capture.next(), Some(Err(CaptureError::Damaged { read })));
    assert_eq!(capture.next(), None);

    let mut huge = good.clone();
    huge[24 + 8..24 + 12].fill(0xff);
    let found = Capture::new(&huge[..]).unwrap().next();
    assert_eq!(found, Some(Err(CaptureError::BlockTooLarge { read: 24, limit: 1 << 20 })));
}

/// Gives a few bytes at a time, then fails.
struct Failing<'a>(&'a [u8]);

impl Read for Failing<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.0.is_empty() {
            return Err(io::ErrorKind::ConnectionReset.into());
        }
        let count = self.0.len().min(buffer.len()).min(50);
        buffer[..count].copy_from_slice(&self.0[..count]);
        self.0 = &self.0[count..];
        Ok(count)
    }
}

#[test]
fn an_input_that_fails_is_named() {
    let file = ethernet(&[&BY_HAND, &BY_HAND]);
    let found: Vec<_> = Capture::new(Failing(&file)).unwrap().collect();
    let read = file.len();
    assert_eq!(found.len(), 3);
    assert_eq!(found[2], Err(CaptureError::Input { read }));
    assert_eq!(Capture::new(Failing(&[])).err(), Some(CaptureError::Input { read: 0 }));
}

#[test]
fn damaged_captures_never_panic() {
    let mut rng = ChaCha8Rng::seed_from_u64(4607);
    let parts = fragments(1, &[7; 3000], 1480);
    let classic = ethernet(&[&BY_HAND, &parts[0], &parts[2], &parts[1]]);
    let sections = [section(Big::Endian, Some(9), 7), section(Big::Not, None, 7)].concat();
    for trial in 0..10_000 {
        let mut file = if trial % 2 == 0 { classic.clone() } else { sections.clone() };
        for _ in 0..rng.random_range(1..4) {
            let at = rng.random_range(0..file.len());
            file[at] = rng.random();
        }
        file.truncate(rng.random_range(0..=2 * file.len()));
        let used = measure(|| {
            if let Ok(capture) = Capture::new(&file[..]) {
                assert!(capture.count() < 20);
            }
        });
        assert!(used.bytes_max < 2 << 20, "trial {trial}: {} bytes", used.bytes_max);
    }
}

fn piece(sequence: u32, bytes: &[u8]) -> Content {
    Content::Tcp { sequence, starts: false, bytes: bytes.to_vec() }
}

#[test]
fn tcp_is_read_from_frames() {
    let builder = PacketBuilder::ethernet2([0; 6], [1; 6]).ipv4(FROM, TO, 9);
    let mut frame = Vec::new();
    builder.tcp(1, 2, 77, 100).write(&mut frame, b"data").unwrap();
    let (payloads, counts) = read(&ethernet(&[&frame]));
    assert_eq!(payloads[0].content, piece(77, b"data"));
    assert_eq!(payloads[0].destination, (TO, 2).into());
    assert_eq!(counts.tcp_count, 1);
}

#[test]
fn tcp_bytes_come_in_order_over_the_wrap_of_their_numbers() {
    let mut stream = TcpStream::default();
    let first = u32::MAX - 2;
    let start = Content::Tcp { sequence: first.wrapping_sub(1), starts: true, bytes: Vec::new() };
    assert_eq!(stream.push(&start), b"");
    assert_eq!(stream.push(&piece(first.wrapping_add(4), b"ef")), b"");
    assert_eq!(stream.push(&piece(first, b"ab")), b"ab");
    assert_eq!(stream.push(&piece(first, b"abc")), b"c");
    assert_eq!(stream.push(&piece(first.wrapping_add(2), b"cdef")), b"def");
    assert_eq!(stream.push(&piece(first.wrapping_add(1), b"bcd")), b"");
    assert_eq!(stream.push(&piece(first.wrapping_add(9), b"j")), b"");
    assert_eq!(stream.finish(), b"j");
    assert_eq!(stream.lost_count(), 3);
    assert_eq!(stream.push(&Content::Udp(vec![1])), b"");
}

/// Pieces of random places and sizes, shuffled, against the bytes that they were cut from.
#[test]
fn shuffled_pieces_give_the_original() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for trial in 0..200 {
        let original: Vec<u8> = (0..500).map(|_| rng.random()).collect();
        let base: u32 = rng.random();
        let mut cuts: Vec<usize> = (0..20).map(|_| rng.random_range(0..500)).collect();
        cuts.extend([0, 500]);
        cuts.sort_unstable();
        let mut pieces: Vec<(usize, usize)> =
            cuts.windows(2).map(|pair| (pair[0], (pair[1] + 7).min(500))).collect();
        for index in (1..pieces.len()).rev() {
            pieces.swap(index, rng.random_range(0..=index));
        }
        let mut stream = TcpStream::default();
        let sequence = base.wrapping_sub(1);
        stream.push(&Content::Tcp { sequence, starts: true, bytes: Vec::new() });
        let mut found = Vec::new();
        for (from, to) in pieces {
            let number = base.wrapping_add(u32::try_from(from).unwrap());
            found.extend(stream.push(&piece(number, &original[from..to])));
        }
        assert!(found == original, "trial {trial}");
        assert_eq!(stream.lost_count(), 0);
    }
}

#[test]
fn a_gap_is_given_up_when_too_much_waits() {
    let mut stream = TcpStream::default();
    assert_eq!(stream.push(&piece(0, b"a")), b"a");
    let mut found = 0;
    for index in 0..40 {
        found += stream.push(&piece(101 + index * 60_000, &[1; 60_000])).len();
    }
    assert_eq!(found, 40 * 60_000);
    assert_eq!(stream.lost_count(), 100);
}

#[test]
fn messages_say_what_to_know() {
    let mut text = String::new();
    write!(text, "{}", CaptureError::BlockTooLarge { read: 5, limit: 9 }).unwrap();
    assert_eq!(text, "the block at byte 5 is larger than 9 bytes; the capture is damaged there");
}
