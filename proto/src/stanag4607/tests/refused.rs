//! Every error of reading and of writing, produced once, with its place.

use super::super::{
    B16, Fault, FreeText, HistoryStep, JobDefinition, Packet, PlatformLocation, ProcessingHistory,
    Sa32, Segment, SegmentKind, TargetReport, TestAndStatus, WriteError,
};
use super::{bytes, dwell, packet, packet_of, sample, segment};

/// The error of one packet has this text, which holds place and numbers.
fn refuses(bytes: &[u8], expected: &str) {
    assert_eq!(Packet::decode(bytes).unwrap_err().to_string(), expected);
}

fn with(at: usize, value: &[u8]) -> Vec<u8> {
    let mut changed = sample().encode().unwrap();
    changed[at..at + value.len()].copy_from_slice(value);
    changed
}

/// Where the dwell of the sample begins, after the header and a mission of 44 bytes.
const DWELL: usize = 76;

#[test]
fn headers_that_cannot_be() {
    let whole = sample().encode().unwrap();
    let edition = "packet 0, P1 at byte 0: edition \"20\" is not one of 30, 31 and 41";
    refuses(&with(0, b"20"), edition);
    let small = "packet 0, P2 at byte 2: a packet of 31 bytes is smaller than its header of 32";
    refuses(&with(2, &31_u32.to_be_bytes()), small);
    let large = "packet 0, whole packet at byte 0: the packet has 10000 bytes and the input ends \
        after 140 of them";
    refuses(&with(2, &10_000_u32.to_be_bytes()), large);
    let cut = "packet 0, whole packet at byte 0: the packet has 140 bytes and the input ends \
        after 100 of them";
    refuses(&whole[..100], cut);
    let more = "packet 0, end at byte 140: 3 bytes follow the packet; a datagram holds one packet";
    refuses(&[whole, vec![0; 3]].concat(), more);
}

#[test]
fn segments_that_cannot_be() {
    let small = "packet 0, S2 at byte 76: a segment of 4 bytes is smaller than its header of 5";
    refuses(&with(DWELL + 1, &4_u32.to_be_bytes()), small);
    let large = "packet 0, S2 at byte 76: a segment of 4294967295 bytes does not fit into the 64 \
        left in the packet";
    refuses(&with(DWELL + 1, &u32::MAX.to_be_bytes()), large);
    let stub = "packet 0, S1 at byte 32: 3 bytes are left, too few for the header of a segment";
    refuses(&packet(&[1, 0, 0]), stub);
    let short = "packet 0, segment 0 (mission), M7 at byte 75: the field has 1 bytes and the \
        segment ends after 0 of them";
    refuses(&packet(&segment(1, &[0; 38])), short);
    let long = "packet 0, segment 0 (platform location), end at byte 60: 2 bytes are left after \
        the last field";
    refuses(&packet(&segment(13, &[0; 25])), long);
}

#[test]
fn dwells_that_cannot_be() {
    let masked = "packet 0, segment 1 (dwell), D9 at byte 81: the mask 0xfe0003c180000000 leaves \
        out this mandatory field";
    refuses(&with(DWELL + 5, &[0xfe]), masked);
    // D5 is the fourth field after the mask of eight bytes.
    let many = "packet 0, segment 1 (dwell), D32 at byte 124: 65535 entries of 8 bytes do not fit \
        into the 16 left";
    refuses(&with(DWELL + 5 + 13, &u16::MAX.to_be_bytes()), many);
    let mask = 0xff00_03c0_0000_0000_u64;
    let empty = "packet 0, segment 1 (dwell), D32 at byte 124: 2 reports are announced, and the \
        mask selects none of their fields";
    refuses(&with(DWELL + 5, &mask.to_be_bytes()), empty);
}

#[test]
fn histories_that_cannot_be() {
    let many = "packet 0, segment 0 (processing history), C6 at byte 58: 3 entries of 23 bytes do \
        not fit into the 23 left";
    refuses(&packet(&segment(12, &[3; 21 + 23])), many);
}

#[test]
fn faults_carry_numbers() {
    let error = Packet::decode(&with(0, b"99")).unwrap_err();
    assert_eq!(error.fault, Fault::UnknownEdition { found: *b"99" });
    assert_eq!((error.place.segment, error.place.field), (None, "P1"));
}

fn writing(segment: impl Into<Segment>) -> WriteError {
    let refused = Packet { segments: vec![segment.into()], ..sample() };
    refused.encode().unwrap_err()
}

impl From<super::Dwell> for Segment {
    fn from(dwell: super::Dwell) -> Self {
        Self::Dwell(Box::new(dwell))
    }
}

/// `(field, value)` of a value out of its range.
fn out_of_range(segment: impl Into<Segment>) -> (&'static str, i64) {
    match writing(segment) {
        WriteError::FieldRange { field, value, .. } => (field, value),
        other => panic!("{other}"),
    }
}

#[test]
fn masks_and_counts_that_disagree_are_not_written() {
    let mut unsealed = dwell();
    unsealed.track_sigma_deg = Some(3);
    let (mask, bit) = (dwell().mask, 1 << 47);
    let masked = WriteError::MaskDisagrees { segment_index: 0, mask, fields: mask | bit };
    assert_eq!(writing(unsealed.clone()), masked);
    assert!(packet_of(vec![unsealed.into()]).encode_as_read().is_err());

    let mut uneven = dwell();
    uneven.reports[1].snr_db = Some(3);
    assert!(matches!(writing(uneven), WriteError::MaskDisagrees { .. }));

    let mut uncounted = dwell();
    uncounted.reports.pop();
    let field = "D5";
    let (segment_index, count, present, limit) = (0, 2, 1, 65_535);
    let counted = WriteError::CountDisagrees { segment_index, field, count, present, limit };
    assert_eq!(writing(uncounted), counted);
    let crowded = dwell().with_reports(vec![dwell().reports[0]; 65_536]);
    assert!(matches!(writing(crowded), WriteError::CountDisagrees { present: 65_536, .. }));

    let steps = vec![HistoryStep::default(); 256];
    let history = ProcessingHistory { steps, ..ProcessingHistory::default() };
    let refused = packet_of(vec![Segment::ProcessingHistory(history)]).encode_as_read();
    let expected = "segment 0: C1 says 255, there are 256; at most 255 fit";
    assert_eq!(refused.unwrap_err().to_string(), expected);
}

#[test]
fn broken_groups_are_not_written() {
    let fields = |change: fn(&mut super::Dwell)| {
        let mut broken = dwell();
        change(&mut broken);
        match writing(broken.sealed()) {
            WriteError::BrokenGroup { fields, .. } => fields,
            other => panic!("{other}"),
        }
    };
    assert_eq!(fields(|dwell| dwell.latitude_scale = Some(Sa32(1))), "D10 and D11");
    assert_eq!(fields(|dwell| dwell.along_sigma_cm = Some(1)), "D12 to D14");
    assert_eq!(fields(|dwell| dwell.climb_dm_per_s = Some(1)), "D15 to D17");
    assert_eq!(fields(|dwell| dwell.track_sigma_deg = Some(1)), "D18 to D20");
    assert_eq!(fields(|dwell| dwell.platform_heading = Some(Default::default())), "D21 to D23");
    let both = "either D32.2 and D32.3 or D32.4 and D32.5";
    assert_eq!(
        fields(|dwell| dwell.reports.iter_mut().for_each(|report| report.latitude = None)),
        "D32.2 and D32.3"
    );
    assert_eq!(
        fields(|dwell| {
            for report in &mut dwell.reports {
                *report = TargetReport { snr_db: Some(1), ..TargetReport::default() };
            }
        }),
        both
    );
    let deltas = |report: &mut TargetReport| {
        (report.latitude, report.longitude) = (None, None);
        (report.delta_latitude, report.delta_longitude) = (Some(1), Some(1));
    };
    let mut placeless = dwell();
    placeless.reports.iter_mut().for_each(deltas);
    let expected = "segment 0: D32.4, D32.5 and their steps D10, D11 go together or not at all";
    assert_eq!(writing(placeless.sealed()).to_string(), expected);
    let mut spare = dwell();
    spare.mask |= 1;
    assert!(matches!(writing(spare), WriteError::BrokenGroup { .. }));
}

#[test]
fn values_out_of_range_are_not_written() {
    let changed = |change: fn(&mut super::Dwell)| {
        let mut odd = dwell();
        change(&mut odd);
        out_of_range(odd.sealed())
    };
    assert_eq!(changed(|dwell| dwell.last_dwell = 2), ("D4", 2));
    assert_eq!(changed(|dwell| dwell.time_ms = 4_000_000_001), ("D6", 4_000_000_001));
    assert_eq!(changed(|dwell| dwell.sensor_altitude_cm = -50_001), ("D9", -50_001));
    assert_eq!(changed(|dwell| dwell.area_half_range = B16(0x8000)), ("D26", 0x8000));
    let report = |report: TargetReport| out_of_range(dwell().with_reports(vec![report]));
    let located = dwell().reports[0];
    assert_eq!(report(TargetReport { height_m: Some(-1001), ..located }), ("D32.6", -1001));
    assert_eq!(report(TargetReport { class_percent: Some(101), ..located }), ("D32.11", 101));
    let vague = TargetReport { radial_sigma_cm_per_s: Some(5001), ..located };
    assert_eq!(report(vague), ("D32.15", 5001));
}

#[test]
fn other_segments_out_of_range_are_not_written() {
    let ranged = |segment: Segment| {
        let mut refused = packet_of(vec![segment]);
        refused.header.origin.job_id = 0;
        match refused.encode().unwrap_err() {
            WriteError::FieldRange { field, .. } => field,
            other => panic!("{other}"),
        }
    };
    let job = |change: fn(&mut JobDefinition)| {
        let mut odd = JobDefinition { job_id: 1, priority: 1, ..JobDefinition::default() };
        change(&mut odd);
        ranged(Segment::JobDefinition(Box::new(odd)))
    };
    assert_eq!(job(|job| job.job_id = 0), "J1");
    assert_eq!(job(|job| job.target_filtering = 8), "J4");
    assert_eq!(job(|job| job.priority = 100), "J5");
    assert_eq!(job(|job| job.along_sigma_dm = 10_001), "J16");
    assert_eq!(job(|job| job.detection_percent = 101), "J25");
    assert_eq!(ranged(Segment::Mission(super::Mission::default())), "M6");
    let late = TestAndStatus { time_ms: u32::MAX, ..TestAndStatus::default() };
    assert_eq!(ranged(Segment::TestAndStatus(late)), "T4");
    let fast = PlatformLocation { speed_mm_per_s: 8_000_001, ..PlatformLocation::default() };
    assert_eq!(ranged(Segment::PlatformLocation(fast)), "L6");
    assert_eq!(ranged(Segment::FreeText(FreeText::default())), "F3");
    assert_eq!(ranged(Segment::ProcessingHistory(ProcessingHistory::default())), "C1");
}

#[test]
fn headers_follow_their_edition() {
    let mut refused = sample();
    refused.header.origin.job_id = 0;
    let expected = "P10 is 0, not within 1 to 4294967295; correct it";
    assert_eq!(refused.encode().unwrap_err().to_string(), expected);
    refused.segments.pop();
    assert!(refused.encode().is_ok());
    refused.header.origin.job_id = 1;
    assert!(matches!(refused.encode(), Err(WriteError::FieldRange { field: "P10", .. })));
    refused.header.edition = super::Edition::V30;
    assert!(refused.encode().is_ok());
    refused.header.origin.classification = 0;
    assert!(matches!(refused.encode(), Err(WriteError::FieldRange { field: "P4", .. })));
}

#[test]
fn sizes_beyond_their_field_are_not_written() {
    // Four gigabytes are not allocated for a test: the error is made by hand.
    let error = WriteError::TooLarge { segment_index: Some(1), size: 1 << 33 };
    let expected = "segment 1: 8589934592 bytes are more than a size field can say";
    assert_eq!(error.to_string(), expected);
    assert_eq!(SegmentKind(77).to_string(), "type 77");
    assert_eq!(bytes("0a ff"), [10, 255]);
}
