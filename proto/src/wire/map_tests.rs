//! Golden bytes and every refusal of what wide-area radars and the centre say of targets.

use proptest::prelude::*;

use super::*;
use crate::ids::{BootId, NodeId};

const STAMP: Stamp = Stamp { boot: BootId(0x0102_0304_0506_0708), sequence: 9, sent_ns: 10 };

fn node() -> NodeId {
    "n1".parse().unwrap()
}

fn place() -> GeoRecord {
    GeoRecord { lat_deg: 40.5, lon_deg: -111.75, height_m: 1250.0 }
}

fn report() -> DwellReport {
    DwellReport {
        index: 7,
        place: place(),
        slant_sigma_m: Some(10.0),
        cross_sigma_m: Some(40.0),
        radial_m_per_s: Some(-4.5),
        radial_sigma_m_per_s: Some(0.5),
        wrap_m_per_s: Some(32.0),
        snr_db: Some(17.0),
        truth: Some(3),
    }
}

fn dwell() -> Dwell {
    Dwell {
        node: node(),
        time_unix_s: 1_700_000_000.25,
        revisit_index: 4,
        dwell_index: 5,
        is_last_of_revisit: true,
        sensor: GeoRecord { lat_deg: 41.0, lon_deg: -112.0, height_m: 9000.0 },
        flight: Some(FlightRecord { course_deg: 90.0, speed_m_per_s: 120.0, climb_m_per_s: -0.5 }),
        area: DwellArea {
            center: place(),
            range_half_extent_m: 4000.0,
            angle_half_extent_deg: 2.5,
        },
        minimum_detectable_m_per_s: Some(1.5),
        detection_probability: Some(0.75),
        is_simulated: false,
        reports: vec![report()],
    }
}

fn track(id: u64) -> MapTrack {
    MapTrack {
        id,
        status: MapStatus::Stopped,
        time_unix_s: 1_700_000_000.5,
        place: place(),
        velocity_m_per_s: [12.5, -0.5],
        covariance: [100.0, 0.125, 0.25, 0.0, 200.0, 0.0, 0.5, 3.0, 0.0, 4.0],
        report_count: 12,
        seen_unix_s: 1_700_000_000.25,
        report: Some(MapReport { node: node(), revisit_index: 4, dwell_index: 5, report_index: 7 }),
        report_share: 0.875,
    }
}

fn tracks() -> MapTracks {
    MapTracks {
        time_unix_s: 1_700_000_001.0,
        is_simulated: true,
        counts: MapCounts {
            dwell_count: 1,
            report_count: 2,
            late_count: 3,
            duplicate_count: 4,
            refused_count: 5,
            hidden_count: 6,
        },
        tracks: vec![track(3), MapTrack { report: None, ..track(8) }],
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The bytes of each kind as they were written when its schema was frozen. If one of these
/// assertions fails, the layout has changed: count the message's `SCHEMA` up.
#[test]
fn the_layout_is_frozen() {
    let of_dwell = hex(&encode(STAMP, &dwell()).unwrap());
    assert_eq!(of_dwell, include_str!("golden/dwell.hex").trim());
    let of_tracks = hex(&encode(STAMP, &tracks()).unwrap());
    assert_eq!(of_tracks, include_str!("golden/map_tracks.hex").trim());
}

/// Read by hand, with no code of the codec's: the name's length and letters, then the time.
#[test]
fn a_dwell_begins_with_its_node_and_time() {
    let bytes = encode(STAMP, &dwell()).unwrap();
    let payload = &bytes[HEADER_BYTES..];
    assert_eq!((&payload[..8], &payload[8..10]), (&[2, 0, 0, 0, 0, 0, 0, 0][..], &b"n1"[..]));
    let time_unix_s = f64::from_le_bytes(payload[10..18].try_into().unwrap());
    assert!((time_unix_s - 1_700_000_000.25).abs() < 1e-9);
}

#[test]
fn both_arrive_as_they_were_sent() {
    assert_eq!(decode::<Dwell>(&encode(STAMP, &dwell()).unwrap()).unwrap().body, dwell());
    assert_eq!(decode::<MapTracks>(&encode(STAMP, &tracks()).unwrap()).unwrap().body, tracks());
    let empty = Dwell { reports: Vec::new(), flight: None, ..dwell() };
    assert_eq!(decode::<Dwell>(&encode(STAMP, &empty).unwrap()).unwrap().body, empty);
}

fn assert_every_cut_and_bit_counts<M: Message>(message: &M) {
    let bytes = encode(STAMP, message).unwrap();
    for length in 0..bytes.len() {
        assert!(decode::<M>(&bytes[..length]).is_err(), "{length} bytes were taken");
    }
    for bit in 0..8 * bytes.len() {
        let mut damaged = bytes.clone();
        damaged[bit / 8] ^= 1 << (bit % 8);
        assert!(decode::<M>(&damaged).is_err(), "bit {bit} went unnoticed");
    }
}

#[test]
fn cut_and_damaged_messages_are_refused() {
    assert_every_cut_and_bit_counts(&dwell());
    assert_every_cut_and_bit_counts(&tracks());
    let other = encode(STAMP, &dwell()).unwrap();
    assert_eq!(decode::<MapTracks>(&other).unwrap_err().label(), "kind");
}

fn said_of(message: &impl Message) -> String {
    encode(STAMP, message).unwrap_err().to_string()
}

#[test]
fn senseless_dwells_are_refused_on_both_sides() {
    let with = |change: fn(&mut Dwell)| {
        let mut bad = dwell();
        change(&mut bad);
        said_of(&bad)
    };
    assert!(with(|one| one.time_unix_s = -1.0).contains("time_unix_s"));
    assert!(with(|one| one.time_unix_s = f64::NAN).contains("time_unix_s"));
    assert!(with(|one| one.sensor.lat_deg = 90.5).contains("lat_deg"));
    assert!(with(|one| one.sensor.lon_deg = -180.5).contains("lon_deg"));
    assert!(with(|one| one.sensor.height_m = 2e5).contains("height_m"));
    let flying = |change: fn(&mut FlightRecord)| {
        let mut bad = dwell();
        change(bad.flight.as_mut().unwrap());
        said_of(&bad)
    };
    assert!(flying(|flight| flight.course_deg = f64::NAN).contains("flight.course_deg"));
    assert!(flying(|flight| flight.speed_m_per_s = -1.0).contains("flight.speed_m_per_s"));
    assert!(flying(|flight| flight.climb_m_per_s = f64::INFINITY).contains("flight.climb"));
    assert!(with(|one| one.area.center.lat_deg = f64::NAN).contains("lat_deg"));
    assert!(with(|one| one.area.range_half_extent_m = -1.0).contains("area.range_half_extent_m"));
    assert!(with(|one| one.area.angle_half_extent_deg = f64::NAN).contains("area.angle_half"));
    assert!(with(|one| one.minimum_detectable_m_per_s = Some(-1.0)).contains("minimum_detect"));
    assert!(with(|one| one.detection_probability = Some(1.5)).contains("detection_probability"));
    assert!(with(|one| one.reports = vec![report(); 4097]).contains("reports is 4097"));
}

#[test]
fn senseless_reports_are_refused_on_both_sides() {
    let with = |change: fn(&mut DwellReport)| {
        let mut bad = report();
        change(&mut bad);
        said_of(&Dwell { reports: vec![report(), bad], ..dwell() })
    };
    assert!(with(|one| one.place.lat_deg = f64::NAN).contains("lat_deg"));
    assert!(with(|one| one.slant_sigma_m = Some(0.0)).contains("reports.slant_sigma_m"));
    assert!(with(|one| one.cross_sigma_m = Some(2e5)).contains("reports.cross_sigma_m"));
    assert!(with(|one| one.radial_m_per_s = Some(f64::NAN)).contains("reports.radial_m_per_s"));
    assert!(with(|one| one.radial_sigma_m_per_s = Some(-1.0)).contains("reports.radial_sigma"));
    assert!(with(|one| one.wrap_m_per_s = Some(f64::NAN)).contains("reports.wrap_m_per_s"));
    assert!(with(|one| one.snr_db = Some(f64::INFINITY)).contains("reports.snr_db"));
}

#[test]
fn senseless_tracks_are_refused_on_both_sides() {
    let with = |change: fn(&mut MapTrack)| {
        let mut bad = track(9);
        change(&mut bad);
        said_of(&MapTracks { tracks: vec![track(8), bad], ..tracks() })
    };
    assert!(with(|one| one.time_unix_s = f64::NAN).contains("tracks.time_unix_s"));
    assert!(with(|one| one.seen_unix_s = -5.0).contains("tracks.seen_unix_s"));
    assert!(with(|one| one.place.lon_deg = 181.0).contains("lon_deg"));
    assert!(with(|one| one.velocity_m_per_s[0] = 2e4).contains("tracks.velocity_m_per_s"));
    assert!(with(|one| one.velocity_m_per_s[1] = f64::NAN).contains("tracks.velocity_m_per_s"));
    assert!(with(|one| one.covariance[3] = f64::NAN).contains("tracks.covariance"));
    assert!(with(|one| one.covariance[9] = 0.0).contains("tracks.covariance"));
    assert!(with(|one| one.covariance[2] = 100.0).contains("tracks.covariance"));
    assert!(with(|one| one.covariance[0] = 1e13).contains("tracks.covariance"));
    assert!(with(|one| one.report_share = 1.5).contains("tracks.report_share"));
    let early = MapTracks { time_unix_s: -1.0, ..tracks() };
    assert!(said_of(&early).contains("time_unix_s"));
    let twice = MapTracks { tracks: vec![track(8), track(8)], ..tracks() };
    assert!(said_of(&twice).contains("tracks.id is [8, 8]"));
    let crowd = MapTracks { tracks: (0..4097).map(track).collect(), ..tracks() };
    assert!(said_of(&crowd).contains("tracks is 4097"));
}

#[test]
fn the_largest_messages_fit_their_limits() {
    let name: NodeId = "x".repeat(32).parse().unwrap();
    let full = Dwell { node: name.clone(), reports: vec![report(); 4096], ..dwell() };
    assert!(encode(STAMP, &full).is_ok());
    let named = MapReport { node: name, revisit_index: 1, dwell_index: 2, report_index: 3 };
    let long = |id| MapTrack { report: Some(named.clone()), ..track(id) };
    let crowded = MapTracks { tracks: (0..4096).map(long).collect(), ..tracks() };
    assert!(encode(STAMP, &crowded).is_ok());
}

/// A message of `kind` with this payload and a right checksum, as a hostile sender would make it.
fn sealed(kind: Kind, payload: &[u8]) -> Vec<u8> {
    let mut bytes = encode(STAMP, &dwell()).unwrap();
    bytes.truncate(HEADER_BYTES);
    bytes.extend_from_slice(payload);
    bytes[6] = u8::try_from(kind as u16).unwrap();
    bytes[40..44].copy_from_slice(&u32::try_from(payload.len()).unwrap().to_le_bytes());
    let checksum = crc32c::crc32c_append(crc32c::crc32c(&bytes[..44]), payload);
    bytes[44..48].copy_from_slice(&checksum.to_le_bytes());
    bytes
}

/// The payload of a good dwell with eight bytes replaced: lengths that lie among them.
fn lying(offset: usize, value: u64) -> Vec<u8> {
    let mut payload = encode(STAMP, &dwell()).unwrap()[HEADER_BYTES..].to_vec();
    let start = offset % (payload.len() - 8);
    payload[start..start + 8].copy_from_slice(&value.to_le_bytes());
    payload
}

proptest! {
    #[test]
    fn arbitrary_payloads_never_panic(payload in proptest::collection::vec(any::<u8>(), 0..600)) {
        prop_assert!(decode::<MapTracks>(&sealed(Kind::MapTracks, &payload)).is_err());
        if let Ok(got) = decode::<Dwell>(&sealed(Kind::Dwell, &payload)) {
            prop_assert!(got.body.reports.len() <= 4096);
        }
    }

    #[test]
    fn lengths_that_lie_never_panic(offset in 0_usize..400, value in any::<u64>()) {
        if let Ok(got) = decode::<Dwell>(&sealed(Kind::Dwell, &lying(offset, value))) {
            prop_assert!(got.body.check().is_ok());
        }
    }
}
