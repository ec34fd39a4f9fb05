//! Tests of the codec: against bytes put together by hand, public files, damage and chance.

mod any;
mod damage;
mod file_tests;
mod oracle;
mod refused;
mod scales;
mod stream;

use super::{
    Dwell, DwellArea, Edition, Geodetic, Mission, Origin, Packet, PacketHeader, Segment,
    TargetReport, Text,
};

/// Bytes written as hexadecimal digits, with spaces anywhere.
fn bytes(hex: &str) -> Vec<u8> {
    let digits: Vec<u32> = hex.chars().filter_map(|digit| digit.to_digit(16)).collect();
    let byte = |pair: &[u32]| u8::try_from(pair[0] * 16 + pair[1]).unwrap();
    digits.chunks(2).map(byte).collect()
}

/// A segment of some type around some fields.
fn segment(kind: u8, fields: &[u8]) -> Vec<u8> {
    let size = u32::try_from(fields.len() + 5).unwrap();
    [&[kind], &size.to_be_bytes()[..], fields].concat()
}

/// A packet of edition 41 around some segments: `XN`, unclassified, platform `TESTBED`.
fn packet(segments: &[u8]) -> Vec<u8> {
    let size = u32::try_from(segments.len() + 32).unwrap();
    let origin = bytes("584e 05 5858 0000 81 54455354424544202020 00000007 00000009");
    [b"41", &size.to_be_bytes()[..], &origin, segments].concat()
}

fn header() -> PacketHeader {
    let origin = Origin {
        nationality: Text::new("XN").unwrap(),
        classification: 5,
        classification_system: Text::new("XX").unwrap(),
        security_codes: 0,
        exercise: 129,
        platform_id: Text::new("TESTBED").unwrap(),
        mission_id: 7,
        job_id: 9,
    };
    PacketHeader { edition: Edition::V41, origin }
}

fn dwell() -> Dwell {
    let sensor = Geodetic { lat_deg: 40.0, lon_deg: -3.0, height_m: 6000.0 };
    let area =
        DwellArea { lat_deg: 40.1, lon_deg: -2.9, half_range_m: 5000.0, half_angle_rad: 0.02 };
    let report = |lat_deg| TargetReport::at_deg(lat_deg, -2.91).unwrap();
    Dwell::new(1000, sensor, area).unwrap().with_reports(vec![report(40.11), report(40.12)])
}

fn packet_of(segments: Vec<Segment>) -> Packet {
    Packet { header: header(), segments }
}

/// A packet with a mission and a dwell of two reports.
fn sample() -> Packet {
    let mission = Mission { year: 2024, month: 2, day: 29, ..Mission::default() };
    packet_of(vec![Segment::Mission(mission), Segment::Dwell(Box::new(dwell()))])
}
