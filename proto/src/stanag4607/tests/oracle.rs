//! Bytes put together by hand from the table of fields, and what they must mean.

use super::super::{
    Ba16, Ba32, Dwell, FreeText, HistoryBase, HistoryStep, JobDefinition, Mission, Packet,
    PlatformLocation, ProcessingHistory, Sa16, Sa32, Segment, SegmentKind, TestAndStatus, Text,
    TruthTag,
};
use super::{bytes, header, packet, segment};

/// Angles that are powers of two of a turn come out exactly; sums of few of them nearly so.
const EXACT: f64 = 1e-12;

fn close(found: Option<f64>, expected: f64) {
    let found = found.expect("a value");
    assert!((found - expected).abs() < EXACT, "{found} instead of {expected}");
}

fn only(bytes: &[u8]) -> Segment {
    let packet = Packet::decode(bytes).unwrap();
    assert_eq!(packet.header, header());
    assert_eq!(packet.encode_as_read().unwrap(), bytes);
    assert_eq!(packet.segments.len(), 1);
    packet.segments[0].clone()
}

/// All fields of D1, each with a number that shows where it came from.
const FULL_DWELL: &str = "
    ffff ffff ffff 0000                     D1
    0102 0304 01 0001 05265c00              D2 D3 D4 D5 D6 = 86,400,000 ms
    20000000 c0000000 00092a58              D7 = 22.5, D8 = 270, D9 = 600,664 cm
    00000010 00000020                       D10 D11
    00000064 000000c8 012c                  D12 = 1 m, D13 = 2 m, D14 = 3 m
    4000 0001d4c0 ec                        D15 = 90, D16 = 120 m/s, D17 = -2 m/s
    07 03e8 0064                            D18 = 7, D19 = 1 m/s, D20 = 1 m/s
    8000 4000 c000                          D21 = 180, D22 = 45, D23 = -45
    40000000 80000000 0540 0100             D24 = 45, D25 = 180, D26 = 10.5 km, D27 = 1.40625
    2000 e000 2000 0f                       D28 = 45, D29 = -22.5, D30 = 22.5, D31 = 1.5 m/s
    0005 e0000000 20000000 ffff 0002 fff6   D32.1 .2 = -22.5 .3 = 45 .4 = -1 .5 = 2 .6 = -10 m
    fe0c 0bb8 f6 82 64                      .7 = -5 m/s .8 = 30 m/s .9 = -10 .10 = 130 .11 = 100
    03e8 0064 05 0032 07 00000102 f9        .12 = 10 m .13 = 10 m .14 = 5 .15 .16 .17 .18 = -3.5
";

/// The digits of a listing: names of fields and what follows `=` left out.
fn listed(listing: &str) -> Vec<u8> {
    let is_hex = |word: &&str| {
        word.len().is_multiple_of(2) && word.chars().all(|c| matches!(c, '0'..='9' | 'a'..='f'))
    };
    let digits = listing.lines().flat_map(|line| line.split_whitespace().take_while(is_hex));
    bytes(&digits.collect::<String>())
}

fn full_dwell() -> Dwell {
    let Segment::Dwell(dwell) = only(&packet(&segment(2, &listed(FULL_DWELL)))) else {
        panic!("no dwell")
    };
    *dwell
}

#[test]
fn every_field_of_a_dwell_is_where_the_table_has_it() {
    let dwell = full_dwell();
    assert_eq!((dwell.revisit_index, dwell.dwell_index), (0x102, 0x304));
    assert!(dwell.ends_revisit());
    assert_eq!((dwell.report_count, dwell.time_ms), (1, 86_400_000));
    let sensor = dwell.sensor();
    close(Some(sensor.lat_deg), 22.5);
    close(Some(sensor.lon_deg), -90.0);
    close(Some(sensor.height_m), 6006.64);
    assert_eq!((dwell.latitude_scale, dwell.longitude_scale), (Some(Sa32(16)), Some(Ba32(32))));
    assert_eq!((dwell.along_sigma_cm, dwell.across_sigma_cm), (Some(100), Some(200)));
    assert_eq!(dwell.altitude_sigma_cm, Some(300));
    let motion = dwell.motion().unwrap();
    close(Some(motion.track_rad), std::f64::consts::FRAC_PI_2);
    close(Some(motion.speed_m_per_s), 120.0);
    close(Some(motion.climb_m_per_s), -2.0);
    assert_eq!(dwell.track_sigma_deg, Some(7));
    assert_eq!((dwell.speed_sigma_mm_per_s, dwell.climb_sigma_cm_per_s), (Some(1000), Some(100)));
    close(dwell.platform_heading.map(Ba16::deg), 180.0);
    close(dwell.platform_pitch.map(Sa16::deg), 45.0);
    close(dwell.platform_roll.map(Sa16::deg), -45.0);
    let area = dwell.area();
    close(Some(area.lat_deg), 45.0);
    close(Some(area.lon_deg), -180.0);
    close(Some(area.half_range_m), 10_500.0);
    close(Some(area.half_angle_rad), 1.406_25_f64.to_radians());
    close(dwell.sensor_heading.map(Ba16::deg), 45.0);
    close(dwell.sensor_pitch.map(Sa16::deg), -22.5);
    close(dwell.sensor_roll.map(Sa16::deg), 22.5);
    close(dwell.minimum_velocity_m_per_s(), 1.5);
}

#[test]
fn every_field_of_a_report_is_where_the_table_has_it() {
    let dwell = full_dwell();
    let report = dwell.reports[0];
    assert_eq!(report.index, Some(5));
    assert_eq!(dwell.location_deg(&report), Some((-22.5, 45.0)));
    assert_eq!((report.delta_latitude, report.delta_longitude), (Some(-1), Some(2)));
    assert_eq!(report.height_m, Some(-10));
    close(report.radial_velocity_m_per_s(), -5.0);
    close(report.wrap_velocity_m_per_s(), 30.0);
    assert_eq!(report.snr_db, Some(-10));
    assert_eq!((report.classification, report.class_percent), (Some(130), Some(100)));
    close(report.slant_sigma_m(), 10.0);
    close(report.cross_sigma_m(), 10.0);
    assert_eq!(report.height_sigma_m, Some(5));
    close(report.radial_sigma_m_per_s(), 0.5);
    assert_eq!(report.truth(), Some(TruthTag { application: 7, entity: 0x102 }));
    close(report.cross_section_db(), -3.5);
}

#[test]
fn only_the_fields_that_the_mask_names_are_read() {
    // D2 to D9, D24 to D27, D31 and D32.4, D32.5, D32.9.
    let mask = 0xff00_03c4_6200_0000_u64;
    let fields = "0001 0002 00 0002 00000001 00000000 00000000 00000000
        10000000 fffffff0 0000 0000 14 0003 fffe 05 0004 0010 06";
    let bytes = packet(&segment(2, &[&mask.to_be_bytes()[..], &bytes(fields)].concat()));
    let Segment::Dwell(dwell) = only(&bytes) else { panic!("no dwell") };
    assert_eq!(dwell.minimum_velocity_dm_per_s, Some(20));
    let second = dwell.reports[1];
    assert_eq!((second.delta_latitude, second.delta_longitude), (Some(4), Some(16)));
    assert_eq!((second.snr_db, second.index, second.latitude), (Some(6), None, None));
    // Steps without D10 and D11 place nothing.
    assert_eq!(dwell.location(&second), None);
    assert_eq!(dwell.motion(), None);
}

/// `lat = D24 + D10 D32.4`, `lon = (D25 + D11 D32.5) mod 2^32`, in 128 bits.
#[test]
fn reduced_locations_are_sums_of_raw_integers() {
    let cases = [
        (1 << 30, 0xffff_fff0, 1165, 583, 54, 268),
        (-(1 << 30), 5, 1165, 583, -54, -268),
        (0, 0, 65_535, u32::MAX, 32_767, 32_767),
        (0, 0x8000_0000, 65_535, u32::MAX, -32_768, -32_768),
        (971_477_816, 2_935_780_205, -7, 0x8000_0000, -3, 3),
    ];
    for (area_latitude, area_longitude, north, east, rows, columns) in cases {
        let report = super::TargetReport {
            delta_latitude: Some(rows),
            delta_longitude: Some(columns),
            ..Default::default()
        };
        let dwell = Dwell {
            area_latitude: Sa32(area_latitude),
            area_longitude: Ba32(area_longitude),
            latitude_scale: Some(Sa32(north)),
            longitude_scale: Some(Ba32(east)),
            ..Dwell::default()
        };
        let latitude = i128::from(area_latitude) + i128::from(north) * i128::from(rows);
        let sum = i128::from(area_longitude) + i128::from(east) * i128::from(columns);
        let longitude = u32::try_from(sum.rem_euclid(1 << 32)).unwrap();
        let expected = i32::try_from(latitude).ok().map(|raw| (Sa32(raw), Ba32(longitude)));
        assert_eq!(dwell.location(&report), expected);
    }
}

#[test]
fn a_dwell_without_reports_has_no_bytes_of_them() {
    let fields = "ffffffffffff0000".to_owned() + &"00".repeat(FULL_DWELL_BYTES - 8 - REPORT_BYTES);
    let Segment::Dwell(dwell) = only(&packet(&segment(2, &bytes(&fields)))) else {
        panic!("no dwell")
    };
    assert_eq!(dwell.reports, []);
    assert_eq!(dwell.mask, 0xffff_ffff_ffff_0000);
}

/// Bytes of all fields: widths of D1 to D31 and of D32 summed by hand.
const FULL_DWELL_BYTES: usize = 8 + 11 + 12 + 8 + 10 + 7 + 5 + 6 + 12 + 7 + REPORT_BYTES;
const REPORT_BYTES: usize = 2 + 8 + 4 + 2 + 4 + 3 + 7 + 5 + 1;

#[test]
fn the_widths_are_those_of_the_table() {
    assert_eq!(listed(FULL_DWELL).len(), FULL_DWELL_BYTES);
}

#[test]
fn a_mission_names_its_date() {
    let fields = [b"PLAN-1      FLIGHT-22   ".as_slice(), &[14], b"CONF A    ", &[7, 232, 2, 29]];
    let Segment::Mission(mission) = only(&packet(&segment(1, &fields.concat()))) else {
        panic!("no mission")
    };
    assert_eq!(
        (mission.plan.trimmed(), mission.flight_plan.trimmed()),
        ("PLAN-1".into(), "FLIGHT-22".into())
    );
    assert_eq!(
        (mission.platform_type, mission.platform_configuration.trimmed()),
        (14, "CONF A".into())
    );
    assert_eq!((mission.year, mission.month, mission.day), (2024, 2, 29));
    // 2024-02-29 is day 19,782 of Unix time.
    assert_eq!(mission.midnight_unix_ms(), Ok(19_782 * 86_400_000));
}

#[test]
fn a_job_states_what_the_radar_can_do() {
    let fields = "00000009 12 4d4f44454c20 05 63
        00000001 00000002 00000003 00000004 00000005 00000006 00000007 00000008
        11 0064 0010 0020 0030 04 0050 03e8 0100 0032 0f 5a 3c 02 03";
    let Segment::JobDefinition(job) = only(&packet(&segment(5, &bytes(fields)))) else {
        panic!("no job")
    };
    let expected = JobDefinition {
        job_id: 9,
        sensor_type: 0x12,
        sensor_model: Text::new("MODEL").unwrap(),
        target_filtering: 5,
        priority: 99,
        a_latitude: Sa32(1),
        a_longitude: Ba32(2),
        b_latitude: Sa32(3),
        b_longitude: Ba32(4),
        c_latitude: Sa32(5),
        c_longitude: Ba32(6),
        d_latitude: Sa32(7),
        d_longitude: Ba32(8),
        radar_mode: 0x11,
        revisit_ds: 100,
        along_sigma_dm: 16,
        across_sigma_dm: 32,
        altitude_sigma_dm: 48,
        track_sigma_deg: 4,
        speed_sigma_mm_per_s: 80,
        slant_sigma_cm: 1000,
        cross_sigma: Ba16(256),
        radial_sigma_cm_per_s: 50,
        minimum_velocity_dm_per_s: 15,
        detection_percent: 90,
        false_alarm_minus_db: 60,
        terrain_model: 2,
        geoid_model: 3,
    };
    assert_eq!(*job, expected);
    assert_eq!(job.corners()[3], (Sa32(7), Ba32(8)));
    close(job.revisit_s(), 10.0);
    close(job.slant_sigma_m(), 10.0);
    close(job.cross_sigma_rad(), 1.406_25_f64.to_radians());
    close(job.radial_sigma_m_per_s(), 0.5);
    close(job.minimum_velocity_m_per_s(), 1.5);
    close(job.detection_probability(), 0.9);
    close(job.false_alarms_per_m2(), 1e-6);
}

#[test]
fn a_job_without_statements_gives_none() {
    let Segment::JobDefinition(job) = only(&packet(&segment(5, &[0xff; 68]))) else {
        panic!("no job")
    };
    let job = JobDefinition { revisit_ds: 0, cross_sigma: Ba16(0x8000), ..*job };
    let stated = [
        job.revisit_s(),
        job.slant_sigma_m(),
        job.cross_sigma_rad(),
        job.radial_sigma_m_per_s(),
        job.minimum_velocity_m_per_s(),
        job.detection_probability(),
        job.false_alarms_per_m2(),
    ];
    assert_eq!(stated, [None; 7]);
}

#[test]
fn a_platform_tells_where_it_is() {
    let fields = "000003e8 20000000 c0000000 ffffff9c 4000 0001d4c0 fd";
    let expected = PlatformLocation {
        time_ms: 1000,
        latitude: Sa32(1 << 29),
        longitude: Ba32(3 << 30),
        altitude_cm: -100,
        track: Ba16(1 << 14),
        speed_mm_per_s: 120_000,
        climb_dm_per_s: -3,
    };
    assert_eq!(only(&packet(&segment(13, &bytes(fields)))), Segment::PlatformLocation(expected));
}

#[test]
fn the_small_segments_are_read_field_by_field() {
    let status = bytes("00000009 0001 0002 00000003 28 10");
    let expected = TestAndStatus {
        job_id: 9,
        revisit_index: 1,
        dwell_index: 2,
        time_ms: 3,
        hardware: 0x28,
        mode: 0x10,
    };
    assert_eq!(only(&packet(&segment(10, &status))), Segment::TestAndStatus(expected));

    let text = b"FROM      TO        two\nlines";
    let (originator, recipient) = (Text::new("FROM").unwrap(), Text::new("TO").unwrap());
    let note = FreeText { originator, recipient, text: b"two\nlines".to_vec() };
    assert_eq!(only(&packet(&segment(6, text))), Segment::FreeText(note));

    let raw = segment(64, &[1, 2, 3]);
    let other = Segment::Other { kind: SegmentKind(64), bytes: vec![1, 2, 3] };
    assert_eq!(only(&packet(&raw)), other);
}

#[test]
fn a_history_lists_its_steps() {
    let base_hex = "02 5a5a 53594e30303030312020 00000001 00000002";
    let step_hex = "01 5a59 53594e30303030322020 00000003 00000004 0102";
    let fields = bytes(&(base_hex.to_owned() + step_hex + step_hex));
    let Segment::ProcessingHistory(history) = only(&packet(&segment(12, &fields))) else {
        panic!("no history")
    };
    let step = HistoryStep {
        sequence: 1,
        nationality: Text::new("ZY").unwrap(),
        platform_id: Text::new("SYN00002").unwrap(),
        mission_id: 3,
        job_id: 4,
        processing: 0x102,
    };
    let base = HistoryBase {
        nationality: Text::new("ZZ").unwrap(),
        platform_id: Text::new("SYN00001").unwrap(),
        mission_id: 1,
        job_id: 2,
    };
    assert_eq!(history, ProcessingHistory { base, steps: vec![step; 2] });
}

#[test]
fn a_mission_segment_is_written_as_the_table_has_it() {
    let mission = Mission {
        plan: Text::new("PLAN-1").unwrap(),
        flight_plan: Text::new("FLIGHT-22").unwrap(),
        platform_type: 14,
        platform_configuration: Text::new("CONF A").unwrap(),
        year: 2024,
        month: 2,
        day: 29,
    };
    let fields = [b"PLAN-1      FLIGHT-22   ".as_slice(), &[14], b"CONF A    ", &[7, 232, 2, 29]];
    let written = super::packet_of(vec![Segment::Mission(mission)]).encode_as_read().unwrap();
    assert_eq!(written, packet(&segment(1, &fields.concat())));
}
