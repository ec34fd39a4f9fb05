//! Packets to dwells, formats told apart, and what cannot be used.

use super::*;
use crate::ids::NodeId;
use crate::stanag4607::{
    self as s4607, Ba16, Geodetic, JobDefinition, Mission, Packet, PacketHeader, Segment,
    SensorMotion, TargetReport, TargetSigmas, TruthTag,
};

/// 2023-11-14, 00:00 UTC.
const MIDNIGHT_UNIX_S: f64 = 1_699_920_000.0;
/// A hundredth of a second of arc is 0.3 m; the format's steps are finer.
const STEP_DEG: f64 = 1e-7;

fn node() -> NodeId {
    "n1".parse().unwrap()
}

fn mission() -> Segment {
    Segment::Mission(Mission { year: 2023, month: 11, day: 14, ..Mission::default() })
}

fn sensor() -> Geodetic {
    Geodetic { lat_deg: 40.0, lon_deg: 111.5, height_m: 9000.0 }
}

fn dwell(reports: Vec<TargetReport>) -> s4607::Dwell {
    let area = s4607::DwellArea {
        lat_deg: 40.2,
        lon_deg: 111.6,
        half_range_m: 4000.0,
        half_angle_rad: 0.1,
    };
    let motion = SensorMotion {
        track_rad: std::f64::consts::FRAC_PI_2,
        speed_m_per_s: 120.0,
        climb_m_per_s: 0.0,
    };
    let built = s4607::Dwell::new(3_600_000, sensor(), area).unwrap().with_motion(motion).unwrap();
    s4607::Dwell { revisit_index: 3, dwell_index: 2, last_dwell: 1, ..built }.with_reports(reports)
}

fn report() -> TargetReport {
    let sigmas = TargetSigmas { slant_m: 12.0, cross_m: 45.0, height_m: 5.0, radial_m_per_s: 0.5 };
    TargetReport::at_deg(40.21, 111.61)
        .unwrap()
        .with_velocity(-7.25, 30.0)
        .unwrap()
        .with_snr(17.0)
        .unwrap()
        .with_sigmas(sigmas)
        .unwrap()
        .with_truth(TruthTag { application: 1, entity: 77 })
}

fn packet(segments: Vec<Segment>) -> Packet {
    let mut header = PacketHeader::default();
    header.origin.classification = s4607::UNCLASSIFIED;
    header.origin.platform_id = s4607::Text::new("Kite 7").unwrap();
    header.origin.job_id = 9;
    header.origin.exercise = s4607::SIMULATED;
    Packet { header, segments }
}

fn bytes(segments: Vec<Segment>) -> Vec<u8> {
    packet(segments).encode_as_read().unwrap()
}

fn read(naming: Naming, pieces: &[&[u8]]) -> Vec<Result<Scan, Damage>> {
    let (mut ingest, mut found) = (Ingest::new(Format::Stanag4607, naming), Vec::new());
    pieces.iter().for_each(|piece| ingest.feed(piece, &mut found));
    ingest.finish(&mut found);
    found
}

fn only_dwell(found: &[Result<Scan, Damage>]) -> Dwell {
    let [Ok(Scan::Geographic(dwell))] = found else { panic!("{found:?}") };
    dwell.as_ref().clone()
}

#[test]
fn a_packet_gives_the_dwell_that_it_describes() {
    let whole = bytes(vec![mission(), Segment::Dwell(Box::new(dwell(vec![report()])))]);
    let found = only_dwell(&read(Naming::Own(node()), &[&whole]));
    assert_eq!(found.node.as_str(), "kite-7");
    assert!((found.time_unix_s - MIDNIGHT_UNIX_S - 3600.0).abs() < 1e-6);
    assert_eq!((found.revisit_index, found.dwell_index), (3, 2));
    assert!(found.is_last_of_revisit && found.is_simulated);
    assert!((found.sensor.lat_deg - 40.0).abs() < STEP_DEG);
    assert!((found.area.range_half_extent_m - 4000.0).abs() < 8.0);
    assert!((found.area.angle_half_extent_deg - 0.1_f64.to_degrees()).abs() < 0.01);
    let flight = found.flight.unwrap();
    assert!((flight.course_deg - 90.0).abs() < 0.01 && (flight.speed_m_per_s - 120.0).abs() < 1e-3);
    let one = found.reports[0];
    assert!((one.place.lat_deg - 40.21).abs() < STEP_DEG);
    assert!((one.place.lon_deg - 111.61).abs() < STEP_DEG);
    assert_eq!((one.radial_m_per_s, one.wrap_m_per_s), (Some(-7.25), Some(30.0)));
    assert_eq!((one.slant_sigma_m, one.cross_sigma_m), (Some(12.0), Some(45.0)));
    assert_eq!((one.snr_db, one.truth), (Some(17.0), Some(77)));
    // An agent speaks for itself, whatever the input says.
    assert_eq!(only_dwell(&read(Naming::Fixed(node()), &[&whole])).node, node());
    // In pieces it is the same.
    let pieces: Vec<&[u8]> = whole.chunks(7).collect();
    assert_eq!(only_dwell(&read(Naming::Own(node()), &pieces)), found);
}

#[test]
fn the_job_says_what_reports_leave_out() {
    let bare = TargetReport::at_deg(40.21, 111.61).unwrap();
    let job = JobDefinition {
        job_id: 9,
        slant_sigma_cm: 2000,
        cross_sigma: Ba16::from_deg(0.1).unwrap(),
        radial_sigma_cm_per_s: 150,
        minimum_velocity_dm_per_s: 25,
        detection_percent: 80,
        ..JobDefinition::default()
    };
    let segments = vec![
        mission(),
        Segment::JobDefinition(Box::new(job)),
        Segment::Dwell(Box::new(dwell(vec![bare]))),
    ];
    let found = only_dwell(&read(Naming::Own(node()), &[&bytes(segments)]));
    assert_eq!(found.detection_probability, Some(0.8));
    assert_eq!(found.minimum_detectable_m_per_s, Some(2.5));
    let one = found.reports[0];
    assert_eq!((one.slant_sigma_m, one.radial_sigma_m_per_s), (Some(20.0), Some(1.5)));
    // 0.21 degrees north is 23.3 km, 0.11 degrees east there 9.4 km, and 9 km down: 26.7 km. The
    // format has 0.1 degrees as 18 of the 65,536 steps of a turn.
    let cross_m = one.cross_sigma_m.unwrap();
    assert!(
        (cross_m - 26_700.0 * (18.0 * 360.0_f64 / 65_536.0).to_radians()).abs() < 0.1,
        "{cross_m}"
    );
    assert_eq!((one.radial_m_per_s, one.truth), (None, None));
    let silent = JobDefinition { detection_percent: 0, ..job };
    let unsaid = vec![
        mission(),
        Segment::JobDefinition(Box::new(silent)),
        Segment::Dwell(Box::new(dwell(Vec::new()))),
    ];
    let dwell_then = only_dwell(&read(Naming::Own(node()), &[&bytes(unsaid)]));
    assert_eq!(dwell_then.detection_probability, None);
}

#[test]
fn damage_is_named_and_the_rest_is_read() {
    let whole = bytes(vec![mission(), Segment::Dwell(Box::new(dwell(vec![report()])))]);
    let found = read(Naming::Own(node()), &[&whole, b"garbage between packets", &whole]);
    let scan_count = found.iter().filter(|one| one.is_ok()).count();
    let said: Vec<String> =
        found.iter().filter_map(|one| one.as_ref().err().map(ToString::to_string)).collect();
    assert_eq!((scan_count, said.len()), (2, 1), "{said:?}");
    assert!(said[0].starts_with("packet 1, P1 at byte"), "{said:?}");
    let mut ingest = Ingest::new(Format::Stanag4607, Naming::Own(node()));
    let mut single = Vec::new();
    ingest.datagram(&whole[..whole.len() - 1], &mut single);
    ingest.datagram(&whole, &mut single);
    assert!(single[0].is_err() && single[1].is_ok() && single.len() == 2, "{single:?}");
}

#[test]
fn what_lacks_a_date_or_a_place_is_told() {
    let mut nowhere = dwell(vec![report(), report()]);
    for one in &mut nowhere.reports {
        one.longitude = None;
    }
    nowhere.reports[0].radial_velocity_cm_per_s = Some(5);
    let segments = vec![Segment::Dwell(Box::new(nowhere.sealed()))];
    let found = read(Naming::Own(node()), &[&bytes(segments)]);
    let labels: Vec<&str> =
        found.iter().filter_map(|one| one.as_ref().err().map(Damage::label)).collect();
    assert_eq!(labels, ["undated", "placeless", "placeless"]);
    let Some(Ok(Scan::Geographic(empty))) = found.last() else { panic!("{found:?}") };
    assert!(empty.reports.is_empty() && (empty.time_unix_s - 3600.0).abs() < 1e-9);
    let no_day = Mission { year: 2023, month: 13, day: 14, ..Mission::default() };
    let dayless = read(Naming::Own(node()), &[&bytes(vec![Segment::Mission(no_day)])]);
    assert_eq!(dayless[0].as_ref().unwrap_err().label(), "mission");
    let mut deep = dwell(vec![]);
    deep.sensor_altitude_cm = -2_000_000;
    let low = read(Naming::Own(node()), &[&bytes(vec![mission(), Segment::Dwell(deep.into())])]);
    assert_eq!(low[0].as_ref().unwrap_err().label(), "senseless");
}

#[test]
fn names_become_names_of_nodes() {
    let own = Naming::Own(node());
    assert_eq!(own.node("E-8C #4").as_str(), "e-8c--4");
    assert_eq!(own.node("  "), node());
    assert_eq!(own.node("centre"), node());
    assert_eq!(Naming::Fixed(node()).node("E-8C"), node());
}

#[test]
fn formats_are_told_by_content_and_else_by_name() {
    let detect = |name: &str, head: &[u8]| Format::detect(name, head);
    let whole = bytes(vec![mission()]);
    assert_eq!(detect("x.csv", &whole), Some(Format::Stanag4607));
    assert_eq!(detect("x.csv", b" {\"time_s\":1}\n"), Some(Format::JsonLines));
    assert_eq!(detect("x.jsonl", b"x_m,y_m,time_s\n1,2,3\n"), Some(Format::Csv));
    assert_eq!(detect("x.GMTI", b"??"), Some(Format::Stanag4607));
    assert_eq!(detect("x.jsonl", b""), Some(Format::JsonLines));
    assert_eq!(detect("x", b"hello, world\n"), None);
    assert_eq!(detect("-", b""), None);
}

/// A classic capture of one Ethernet frame for each payload, written by hand.
fn capture(datagrams: &[&[u8]]) -> Vec<u8> {
    let mut bytes = vec![0xd4, 0xc3, 0xb2, 0xa1, 2, 0, 4, 0];
    bytes.extend([0; 8]);
    bytes.extend(65_535_u32.to_le_bytes());
    bytes.extend(1_u32.to_le_bytes());
    for payload in datagrams {
        let udp_length = u16::try_from(8 + payload.len()).unwrap();
        let frame_length = u32::from(14 + 20 + udp_length);
        for value in [1_700_000_000, 0, frame_length, frame_length] {
            bytes.extend(value.to_le_bytes());
        }
        bytes.extend([2; 12]);
        bytes.extend([8, 0, 0x45, 0]);
        bytes.extend((20 + udp_length).to_be_bytes());
        bytes.extend([0, 0, 0, 0, 64, 17, 0, 0, 127, 0, 0, 1, 127, 0, 0, 1]);
        bytes.extend(5000_u16.to_be_bytes());
        bytes.extend(6000_u16.to_be_bytes());
        bytes.extend(udp_length.to_be_bytes());
        bytes.extend([0, 0]);
        bytes.extend(*payload);
    }
    bytes
}

fn through(bytes: &[u8], name: &str) -> Result<Vec<Result<Scan, Damage>>, InputError> {
    let (mut input, mut found) = (Input::open(bytes, name, None, Naming::Own(node()))?, Vec::new());
    while input.advance(&mut found)? {}
    Ok(found)
}

#[test]
fn an_input_finds_out_what_it_is() {
    let whole = bytes(vec![mission(), Segment::Dwell(Box::new(dwell(vec![report()])))]);
    let expected = read(Naming::Own(node()), &[&whole]);
    assert_eq!(through(&whole, "x").unwrap(), expected);
    let captured = capture(&[b"other traffic", &whole, &[]]);
    assert_eq!(through(&captured, "x").unwrap(), expected);
    let rows = b"time_s,x_m,y_m\n1,2,3\n";
    assert_eq!(through(rows, "-").unwrap().len(), 1);
    let unknown = through(b"once upon a time\n", "tale.txt").map(drop).unwrap_err().to_string();
    assert!(unknown.contains("tale.txt") && unknown.contains("--format"), "{unknown}");
    let cut = through(&captured[..captured.len() - 60], "x.pcap");
    assert!(cut.map(drop).unwrap_err().to_string().starts_with("x.pcap: "));
}

/// The same capture of TCP: `pieces` with their sequence numbers.
fn tcp_capture(pieces: &[(u32, &[u8])]) -> Vec<u8> {
    let mut bytes = capture(&[]);
    for (sequence, payload) in pieces {
        let ip_length = u16::try_from(40 + payload.len()).unwrap();
        let frame_length = u32::from(14 + ip_length);
        for value in [1_700_000_000, 0, frame_length, frame_length] {
            bytes.extend(value.to_le_bytes());
        }
        bytes.extend([2; 12]);
        bytes.extend([8, 0, 0x45, 0]);
        bytes.extend(ip_length.to_be_bytes());
        bytes.extend([0, 0, 0, 0, 64, 6, 0, 0, 127, 0, 0, 1, 127, 0, 0, 1]);
        bytes.extend([0x13, 0x88, 0x17, 0x70]);
        bytes.extend(sequence.to_be_bytes());
        bytes.extend([0, 0, 0, 0, 0x50, 0x18, 4, 0, 0, 0, 0, 0]);
        bytes.extend(*payload);
    }
    bytes
}

/// Two halves of packets of one length would be a packet of their sum, with places of nobody.
#[test]
fn what_is_before_and_after_a_gap_of_a_connection_is_not_joined() {
    let at_minute = |minute: u32| {
        let mut one = dwell(vec![report()]);
        one.time_ms += 60_000 * minute;
        bytes(vec![mission(), Segment::Dwell(Box::new(one.sealed()))])
    };
    let sent: Vec<u8> = (0..6).flat_map(at_minute).collect();
    let (length, half) = (sent.len() / 6, sent.len() / 12);
    let (cut, again) = (length + half, 4 * length + half);
    let pieces = [(0, &sent[..cut]), (u32::try_from(again).unwrap(), &sent[again..])];
    let found = through(&tcp_capture(&pieces), "x").unwrap();
    let minutes: Vec<f64> = (found.iter().flatten())
        .map(|scan| (scan.time_s() - MIDNIGHT_UNIX_S - 3600.0) / 60.0)
        .collect();
    assert_eq!(minutes, [0.0, 5.0]);
    let labels: Vec<&str> =
        found.iter().filter_map(|one| one.as_ref().err()).map(Damage::label).collect();
    assert!(labels.contains(&"gap"), "{labels:?}");
}

#[test]
fn a_connection_is_joined_in_its_middle() {
    let whole = bytes(vec![mission(), Segment::Dwell(Box::new(dwell(vec![report()])))]);
    let sent: Vec<u8> = [&whole[20..], &whole, &whole].concat();
    let found = through(&tcp_capture(&[(7, &sent)]), "x").unwrap();
    assert_eq!(found.iter().flatten().count(), 2);
    let other = through(&tcp_capture(&[(7, b"GET /30 HTTP/1.1")]), "x").unwrap();
    assert!(other.is_empty(), "other traffic is passed over: {other:?}");
}

#[test]
fn a_reader_that_fails_is_named() {
    struct Broken;
    impl std::io::Read for Broken {
        fn read(&mut self, _: &mut [u8]) -> std::io::Result<usize> {
            Err(std::io::Error::other("no disk"))
        }
    }
    let opened = Input::open(Broken, "disk.4607", None, Naming::Own(node()));
    let Err(failed) = opened else { panic!("it opened") };
    assert_eq!(failed.to_string(), "reading disk.4607: no disk");
}

/// The ten-target scene, where it is there: 154 dwells and 218 reports, as the specification counts.
#[test]
fn the_shared_scene_has_the_dwells_and_reports_that_are_known() {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../shared/data/stanag4607/ten-targets-situation-awareness.4607"
    );
    let Ok(whole) = std::fs::read(path) else {
        let note = format!("skipped: {path} is not here\n");
        drop(std::io::Write::write_all(&mut std::io::stderr(), note.as_bytes()));
        return;
    };
    let found = read(Naming::Own(node()), &[&whole]);
    let damages: Vec<String> =
        found.iter().filter_map(|one| one.as_ref().err().map(ToString::to_string)).collect();
    assert!(damages.is_empty(), "{damages:?}");
    let counts = found.iter().flatten().map(Scan::plot_count);
    assert_eq!((counts.clone().count(), counts.sum::<usize>()), (154, 218));
}
