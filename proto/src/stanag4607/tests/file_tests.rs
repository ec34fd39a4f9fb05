//! Files of other senders: read, counted, and written again byte by byte.
//!
//! The files stay where they are; a test skips with a message where one is absent.

use std::fs;
use std::path::{Path, PathBuf};

use super::super::{
    Dwell, Edition, MissionClock, Packet, Segment, SegmentKind, WriteError, packets,
};

const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/stanag4607");

/// A file of the folder, or none with a message.
pub(super) fn file(name: &str) -> Option<Vec<u8>> {
    let path = Path::new(FOLDER).join(name);
    let found = fs::read(&path).ok();
    if found.is_none() {
        println!("skipped: {} is not there", path.display());
    }
    found
}

/// All files of the folder that hold packets.
pub(super) fn all_files() -> Vec<(PathBuf, Vec<u8>)> {
    let folders = [PathBuf::from(FOLDER), Path::new(FOLDER).join("edition_a_synthetic")];
    let entries = folders.iter().filter_map(|folder| fs::read_dir(folder).ok()).flatten();
    let is_packets = |path: &PathBuf| {
        path.extension().is_some_and(|extension| extension == "4607" || extension == "gmti")
    };
    let mut paths: Vec<PathBuf> =
        entries.filter_map(|entry| Some(entry.ok()?.path())).filter(is_packets).collect();
    paths.sort();
    if paths.is_empty() {
        println!("skipped: nothing in {FOLDER}");
    }
    paths.into_iter().filter_map(|path| fs::read(&path).ok().map(|bytes| (path, bytes))).collect()
}

fn dwells(packets: &[Packet]) -> Vec<&Dwell> {
    let segments = packets.iter().flat_map(|packet| &packet.segments);
    let dwells = segments.filter_map(|segment| match segment {
        Segment::Dwell(dwell) => Some(&**dwell),
        _ => None,
    });
    dwells.collect()
}

#[test]
fn every_packet_is_written_as_it_was_read() {
    for (path, bytes) in all_files() {
        let read: Result<Vec<Packet>, _> = packets(&bytes).collect();
        let read = read.unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        let written: Vec<u8> =
            read.iter().flat_map(|packet| packet.encode_as_read().unwrap()).collect();
        assert!(written == bytes, "{} changed", path.display());
    }
}

/// The sums were made by another implementation, `stanag4607` 0.1.0 of the Python package index,
/// which also agrees in all 809 lines of all fields of all files of the folder. Each sum weighs
/// the reports with their number, so that their order counts.
#[test]
fn the_ten_targets_are_as_another_reader_sees_them() {
    let Some(bytes) = file("ten-targets-situation-awareness.4607") else { return };
    let read: Vec<Packet> = packets(&bytes).collect::<Result<_, _>>().unwrap();
    assert_eq!(read.len(), 194);
    assert!(read.iter().all(|packet| packet.header.edition == Edition::V30));
    let dwells = dwells(&read);
    assert_eq!(dwells.len(), 154);
    let mut sums = [0_i64; 4];
    let mut entities = std::collections::BTreeSet::new();
    let reports = dwells.iter().flat_map(|dwell| dwell.reports.iter().map(move |r| (dwell, r)));
    for (number, (dwell, report)) in (1..).zip(reports) {
        let (latitude, longitude) = dwell.location(report).unwrap();
        let truth = report.truth().unwrap();
        entities.insert(truth);
        sums[0] += number * i64::from(latitude.0);
        sums[1] += number * i64::from(longitude.0);
        sums[2] += number * i64::from(dwell.time_ms);
        sums[3] += number * i64::from(truth.entity);
    }
    assert_eq!(sums, [23_178_646_330_861, 70_101_703_592_209, 697_000_459_854, 134_679]);
    assert_eq!(dwells.iter().map(|dwell| dwell.reports.len()).sum::<usize>(), 218);
    assert_eq!(entities.len(), 10);
}

#[test]
fn the_ten_targets_have_a_date_and_places() {
    let Some(bytes) = file("ten-targets-situation-awareness.4607") else { return };
    let mut clock = MissionClock::default();
    let (mut first_s, mut last_s) = (f64::INFINITY, f64::NEG_INFINITY);
    for segment in packets(&bytes).flat_map(|packet| packet.unwrap().segments) {
        match segment {
            Segment::Mission(mission) => clock.set(&mission).unwrap(),
            Segment::Dwell(dwell) => {
                let time_s = clock.unix_s(dwell.time_ms).unwrap();
                (first_s, last_s) = (first_s.min(time_s), last_s.max(time_s));
                let (sensor, area) = (dwell.sensor(), dwell.area());
                assert!((sensor.lat_deg - area.lat_deg).abs() < 1.0);
                assert!((sensor.lon_deg - area.lon_deg).abs() < 1.0);
            }
            _ => {}
        }
    }
    // 2010-11-30 00:00 UTC is 1,291,075,200 s; the dwells are from 28,802.150 s to 29,393.229 s.
    assert!((first_s - 1_291_104_002.15).abs() < 1e-6);
    assert!((last_s - 1_291_104_593.229).abs() < 1e-6);
}

#[test]
fn segments_without_a_type_of_their_own_are_kept() {
    let Some(bytes) = file("edition_a_synthetic/reserved_and_extension_segments_recorded.gmti")
    else {
        return;
    };
    let packet = Packet::decode(&bytes).unwrap();
    let kinds: Vec<u8> = packet.segments.iter().map(|segment| segment.kind().0).collect();
    assert_eq!(kinds, [1, 8, 132, 2]);
    let expected = Segment::Other { kind: SegmentKind(132), bytes: vec![0xde, 0xad, 0xbe, 0xef] };
    assert_eq!(packet.segments[2], expected);
}

/// The strict writer takes what keeps to the standard, and names what does not.
#[test]
fn the_strict_writer_knows_the_editions() {
    for (path, bytes) in all_files() {
        for packet in packets(&bytes) {
            let packet = packet.unwrap();
            let strict = packet.encode();
            let is_named = matches!(strict, Err(WriteError::FieldRange { field: "P10", .. }));
            let has_data = packet
                .segments
                .iter()
                .any(|segment| matches!(segment.kind(), SegmentKind::DWELL | SegmentKind::HRR));
            let is_old = packet.header.edition == Edition::V30;
            let is_fine = has_data || is_old || packet.header.origin.job_id == 0;
            assert_eq!(is_named, !is_fine, "{}", path.display());
            assert!(!is_fine || strict.is_ok(), "{}: {strict:?}", path.display());
        }
    }
}
