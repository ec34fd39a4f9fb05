//! Records read back by a decoder of the tests' own, and golden bytes that another one has read.

use std::collections::BTreeMap;

use proto::geodesy::GeoPosition;

use super::*;
use crate::export::{TrackStatus, sample};

fn settings() -> Cat062Settings {
    Cat062Settings { sac: 25, sic: 201, origin: Origin::Simulated, frame: Some(sample::frame()) }
}

fn bytes_of(track: &GeoTrack, message: Message) -> Vec<u8> {
    record(&Entry { track, number: 513, message }, &settings()).unwrap()
}

/// The names of the items by field reference number, with their lengths; 0 where the length
/// follows from the item's first octets. After the published profile, spares left out.
const PROFILE: [(usize, &str, usize); 12] = [
    (1, "010", 2),
    (3, "015", 1),
    (4, "070", 3),
    (5, "105", 8),
    (6, "100", 6),
    (7, "185", 4),
    (12, "040", 2),
    (13, "080", 0),
    (14, "290", 0),
    (15, "200", 1),
    (18, "130", 2),
    (27, "500", 0),
];

type Items = BTreeMap<&'static str, Vec<u8>>;

/// The positions of the bits that are set, the lowest bit of each octet saying whether one more
/// octet belongs to the list; and what follows the list.
fn present(bytes: &[u8]) -> (Vec<usize>, &[u8]) {
    let octet_count = bytes.iter().position(|octet| octet % 2 == 0).unwrap() + 1;
    let (head, rest) = bytes.split_at(octet_count);
    let bits: String = head.iter().map(|octet| format!("{octet:08b}")[..7].to_owned()).collect();
    (bits.match_indices('1').map(|(index, _)| index + 1).collect(), rest)
}

fn compound_length(bytes: &[u8], lengths: &[usize]) -> usize {
    let (fields, rest) = present(bytes);
    bytes.len() - rest.len() + fields.iter().map(|field| lengths[field - 1]).sum::<usize>()
}

fn decoded(bytes: &[u8]) -> (Items, &[u8]) {
    let (fields, mut rest) = present(bytes);
    let mut items = Items::new();
    for field in fields {
        let (_, name, fixed) = PROFILE.iter().find(|row| row.0 == field).unwrap();
        let length = match *name {
            "080" => rest.iter().position(|octet| octet % 2 == 0).unwrap() + 1,
            "290" => compound_length(rest, &[1, 1, 1, 1, 2, 1, 1, 1, 1, 1]),
            "500" => compound_length(rest, &[4, 2, 4, 1, 1, 2, 2, 1]),
            _ => *fixed,
        };
        items.insert(name, rest[..length].to_vec());
        rest = &rest[length..];
    }
    (items, rest)
}

/// Two's complement of any width.
fn signed(bytes: &[u8]) -> f64 {
    let value = bytes.iter().fold(0_i64, |sum, octet| sum * 256 + i64::from(*octet));
    let turn = 1_i64 << (8 * bytes.len());
    (if value >= turn / 2 { value - turn } else { value }) as f64
}

fn unsigned(bytes: &[u8]) -> f64 {
    bytes.iter().fold(0.0, |sum, octet| sum * 256.0 + f64::from(*octet))
}

fn items_of(track: &GeoTrack, message: Message) -> Items {
    let bytes = bytes_of(track, message);
    let (items, rest) = decoded(&bytes);
    assert!(rest.is_empty(), "{rest:?}");
    items
}

#[test]
fn a_decoder_finds_the_track_again() {
    let track = sample::confirmed();
    let items = items_of(&track, Message::First);
    assert_eq!(items["010"], [25, 201]);
    // 12:00:40 in 1/128 s.
    assert!((unsigned(&items["070"]) - 128.0 * 43_240.0).abs() < 0.5);
    let angle = 180.0 / 2.0_f64.powi(25);
    let found = GeoPosition::new(
        signed(&items["105"][..4]) * angle,
        signed(&items["105"][4..]) * angle,
        track.position.height_m(),
    );
    // Half a step is 0.3 m to the north and 0.23 m to the east.
    assert!(found.unwrap().to_ecef().distance_m(&track.position.to_ecef()) < 0.4);
    let point = sample::frame().to_enu(&track.position);
    assert!((signed(&items["100"][..3]) * 0.5 - point.east_m).abs() <= 0.25);
    assert!((signed(&items["100"][3..]) * 0.5 - point.north_m).abs() <= 0.25);
    assert!((signed(&items["185"][..2]) * 0.25 - 10.0).abs() <= 0.125);
    assert!((signed(&items["185"][2..]) * 0.25 - 7.5).abs() <= 0.125);
    assert_eq!(items["040"], [2, 1]);
    // 40 s old, seen now.
    assert_eq!(items["290"], [0b1100_0000, 160, 0]);
    assert!((signed(&items["130"]) * 6.25 * 0.3048 - 1_050.0).abs() < 1.0);
    // σ 30 m and 20 m, √420 m, 15 m of height, 2 and 1.5 m/s.
    assert_eq!(items["500"], [0b1101_0100, 0, 60, 0, 40, 0, 41, 8, 8, 6]);
}

#[test]
fn status_bits_follow_the_track() {
    let status = |track: &GeoTrack, message| items_of(track, message)["080"].clone();
    let [confirmed, tentative, coasting, stopped] =
        <[GeoTrack; 4]>::try_from(sample::all()).unwrap();
    // One sensor, geometric altitude from a 3-D radar, confirmed; simulated, first message.
    let first = [0b1010_1001, 0b1010_0001, 1, 0b0011_1001, 0b1000_0001, 0b0001_0000];
    assert_eq!(status(&confirmed, Message::First), first);
    // Height assumed, tentative; an update.
    let second = [0b1011_1011, 0b1000_0001, 1, 0b0011_1001, 0b1000_0001, 0b0001_0000];
    assert_eq!(status(&tentative, Message::Update), second);
    // Two sensors; the last message; coasting.
    let third = [0b0010_1001, 0b1100_0001, 1, 0b1111_1001, 0b1000_0001, 0b0001_0000];
    assert_eq!(status(&coasting, Message::Last), third);
    assert_eq!(coasting.status, TrackStatus::Coasting);
    assert_eq!(status(&stopped, Message::Update)[3], 0b0011_1001);
}

#[test]
fn values_beyond_their_fields_become_the_largest_ones() {
    let mut track = sample::confirmed();
    track.position = sample::position(-89.9, 0.0, 99_000.0);
    track.velocity_m_per_s = nalgebra::Vector2::new(9_000.0, -9_000.0);
    track.covariance_m2 = nalgebra::Matrix2::new(2e9, -1.9e9, -1.9e9, 2e9);
    track.height_sigma_m = Some(1e4);
    track.first_seen_unix_s -= 1e5;
    let items = items_of(&track, Message::Update);
    assert_eq!(items["185"], [0x7f, 0xff, 0x80, 0x00]);
    assert_eq!(items["100"][3..], [0x80, 0, 0]);
    assert_eq!(items["130"], 24_000_u16.to_be_bytes());
    assert_eq!(items["290"], [0b1100_0000, 255, 0]);
    assert_eq!(items["500"][..7], [0b1101_0100, 0xff, 0xff, 0xff, 0xff, 0x80, 0]);
    assert_eq!(items["500"][7], 255);
    // A plot that is newer than the estimate has age 0, not a huge one.
    track.last_seen_unix_s = track.time_unix_s + 1.0;
    assert_eq!(items_of(&track, Message::Update)["290"][2], 0);
}

#[test]
fn midnight_and_the_antimeridian_are_the_start_of_their_ranges() {
    let mut track = sample::confirmed();
    track.time_unix_s = sample::NOON_UNIX_S + 43_199.999;
    track.history.clear();
    track.position = sample::position(0.0, 179.999_999_9, 0.0);
    let items = items_of(&track, Message::Update);
    assert_eq!(items["070"], [0, 0, 0]);
    assert!((signed(&items["105"][4..]) * 180.0 / 2.0_f64.powi(25) + 180.0).abs() < 1e-9);
}

#[test]
fn what_is_not_known_is_left_out() {
    let tentative = &sample::all()[1];
    let entry = Entry { track: tentative, number: 1, message: Message::Update };
    let bytes = record(&entry, &Cat062Settings { frame: None, ..settings() }).unwrap();
    let (items, _) = decoded(&bytes);
    assert!(!items.contains_key("100"));
    assert_eq!(items["500"][0], 0b1100_0000);
}

#[test]
fn blocks_hold_all_records_and_fit_datagrams() {
    let tracks: Vec<GeoTrack> = (0..100).map(|id| GeoTrack { id, ..sample::confirmed() }).collect();
    let entry = |(number, track)| Entry { track, number, message: Message::Update };
    let entries: Vec<Entry<'_>> = (1..).zip(&tracks).map(entry).collect();
    let blocks = blocks(&entries, &settings()).unwrap();
    let mut numbers = Vec::new();
    for block in &blocks {
        assert!(block.len() <= DATAGRAM_BYTES_MAX);
        assert_eq!(block[0], 62);
        assert_eq!(usize::from(block[1]) * 256 + usize::from(block[2]), block.len());
        let mut rest = &block[3..];
        while !rest.is_empty() {
            let (items, after) = decoded(rest);
            numbers.push(items["040"][1]);
            rest = after;
        }
    }
    assert!(blocks.len() > 2);
    assert_eq!(numbers, (1..=100).collect::<Vec<u8>>());
    assert!(super::blocks(&[], &settings()).unwrap().is_empty());
}

#[test]
fn an_impossible_track_is_refused() {
    let track = GeoTrack { time_unix_s: f64::NAN, ..sample::confirmed() };
    let entry = Entry { track: &track, number: 1, message: Message::Update };
    assert!(matches!(record(&entry, &settings()), Err(ExportError::Time { .. })));
}
