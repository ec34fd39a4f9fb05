//! What is checked before a packet is written.

use super::dwell::{Dwell, SPARE_BITS, TargetReport};
use super::error::WriteError;
use super::job::JobDefinition;
use super::packet::Packet;
use super::segment::{FreeText, Mission, PlatformLocation, Segment, SegmentKind, TestAndStatus};
use super::table::Masked;

/// That counts and masks say what there is: without that nobody could read the bytes.
pub(super) fn can_be_read_again(packet: &Packet) -> Result<(), WriteError> {
    for (segment_index, segment) in packet.segments.iter().enumerate() {
        match segment {
            Segment::Dwell(dwell) => dwell_agrees(segment_index, dwell)?,
            Segment::ProcessingHistory(history) => {
                let present = history.steps.len();
                let count = present.min(usize::from(u8::MAX));
                count_agrees(segment_index, "C1", [count, present, usize::from(u8::MAX)])?;
            }
            _ => {}
        }
    }
    Ok(())
}

fn dwell_agrees(segment_index: usize, dwell: &Dwell) -> Result<(), WriteError> {
    let (count, present) = (usize::from(dwell.report_count), dwell.reports.len());
    count_agrees(segment_index, "D5", [count, present, usize::from(u16::MAX)])?;
    let with_bits = |bits: u64| dwell.fields() & !TargetReport::BITS | bits;
    let odd = dwell.reports.iter().map(|report| with_bits(report.present_bits()));
    let fields = odd.into_iter().find(|&fields| fields != dwell.mask).unwrap_or(dwell.fields());
    if fields == dwell.mask {
        return Ok(());
    }
    Err(WriteError::MaskDisagrees { segment_index, mask: dwell.mask, fields })
}

/// `[what the field says, how many there are, how many it can say]`.
fn count_agrees(
    segment_index: usize,
    field: &'static str,
    [count, present, limit]: [usize; 3],
) -> Result<(), WriteError> {
    if count == present {
        return Ok(());
    }
    Err(WriteError::CountDisagrees { segment_index, field, count, present, limit })
}

/// That all values are within the ranges of the standard and groups are complete.
pub(super) fn conforms(packet: &Packet) -> Result<(), WriteError> {
    header_conforms(packet)?;
    for (index, segment) in packet.segments.iter().enumerate() {
        let limits = match segment {
            Segment::Mission(mission) => of_mission(mission),
            Segment::Dwell(dwell) => {
                groups_are_complete(index, dwell)?;
                of_dwell(dwell)
            }
            Segment::JobDefinition(job) => of_job(job),
            Segment::FreeText(text) => of_text(text),
            Segment::TestAndStatus(status) => of_status(status),
            Segment::PlatformLocation(location) => of_location(location),
            Segment::ProcessingHistory(history) => {
                vec![Limit::new("C1", history.steps.len(), 1, 255)]
            }
            Segment::Other { .. } => Vec::new(),
        };
        within(Some(index), &limits)?;
    }
    Ok(())
}

/// P4 and P10.
fn header_conforms(packet: &Packet) -> Result<(), WriteError> {
    let origin = &packet.header.origin;
    let is_data =
        |segment: &Segment| matches!(segment.kind(), SegmentKind::DWELL | SegmentKind::HRR);
    let has_data = packet.segments.iter().any(is_data);
    let without_job = packet.header.edition.job_id_only_with_data() && !has_data;
    let job_low = i64::from(has_data);
    let job_high = if without_job { 0 } else { i64::from(u32::MAX) };
    let limits = [
        Limit::new("P4", origin.classification, 1, 5),
        Limit::new("P10", origin.job_id, job_low, job_high),
    ];
    within(None, &limits)
}

/// A raw value and where it must lie.
struct Limit {
    field: &'static str,
    value: i64,
    low: i64,
    high: i64,
}

impl Limit {
    /// Counts beyond 63 bits are out of every range.
    fn new(field: &'static str, value: impl TryInto<i64>, low: i64, high: i64) -> Self {
        Self { field, value: value.try_into().unwrap_or(i64::MAX), low, high }
    }

    /// A field that may be absent.
    fn optional(
        field: &'static str,
        value: Option<impl TryInto<i64>>,
        low: i64,
        high: i64,
    ) -> Option<Self> {
        value.map(|value| Self::new(field, value, low, high))
    }

    /// A field whose largest number says that there is no statement.
    fn stated(field: &'static str, value: impl TryInto<i64>, high: i64, none: i64) -> Option<Self> {
        let limit = Self::new(field, value, 0, high);
        (limit.value != none).then_some(limit)
    }
}

fn within(segment_index: Option<usize>, limits: &[Limit]) -> Result<(), WriteError> {
    let outside = |limit: &&Limit| !(limit.low..=limit.high).contains(&limit.value);
    let Some(&Limit { field, value, low, high }) = limits.iter().find(outside) else {
        return Ok(());
    };
    Err(WriteError::FieldRange { segment_index, field, value, low, high })
}

/// Times count up to 46 days.
const LONGEST_MS: i64 = 4_000_000_000;
/// 500 m below the ellipsoid to 20,000 km above it.
const ALTITUDES_CM: (i64, i64) = (-50_000, 2_000_000_000);
/// 8 km/s.
const FASTEST_MM_PER_S: i64 = 8_000_000;

fn of_mission(mission: &Mission) -> Vec<Limit> {
    vec![Limit::new("M6", mission.month, 1, 12), Limit::new("M7", mission.day, 1, 31)]
}

fn of_status(status: &TestAndStatus) -> Vec<Limit> {
    vec![Limit::new("T4", status.time_ms, 0, LONGEST_MS)]
}

fn of_text(text: &FreeText) -> Vec<Limit> {
    vec![Limit::new("F3", text.text.len(), 1, 65_515)]
}

fn of_location(location: &PlatformLocation) -> Vec<Limit> {
    vec![
        Limit::new("L1", location.time_ms, 0, LONGEST_MS),
        Limit::new("L4", location.altitude_cm, ALTITUDES_CM.0, ALTITUDES_CM.1),
        Limit::new("L6", location.speed_mm_per_s, 0, FASTEST_MM_PER_S),
    ]
}

fn of_job(job: &JobDefinition) -> Vec<Limit> {
    let (word, byte) = (i64::from(u16::MAX), i64::from(u8::MAX));
    let always = [
        Limit::new("J1", job.job_id, 1, u32::MAX.into()),
        Limit::new("J4", job.target_filtering, 0, 7),
    ];
    let stated = [
        (job.priority != u8::MAX).then(|| Limit::new("J5", job.priority, 1, 99)),
        Limit::stated("J16", job.along_sigma_dm, 10_000, word),
        Limit::stated("J17", job.across_sigma_dm, 10_000, word),
        Limit::stated("J18", job.altitude_sigma_dm, 20_000, word),
        Limit::stated("J19", job.track_sigma_deg, 45, byte),
        Limit::stated("J23", job.radial_sigma_cm_per_s, 5000, word),
        Limit::stated("J25", job.detection_percent, 100, byte),
    ];
    always.into_iter().chain(stated.into_iter().flatten()).collect()
}

fn of_dwell(dwell: &Dwell) -> Vec<Limit> {
    let always = [
        Limit::new("D4", dwell.last_dwell, 0, 1),
        Limit::new("D6", dwell.time_ms, 0, LONGEST_MS),
        Limit::new("D9", dwell.sensor_altitude_cm, ALTITUDES_CM.0, ALTITUDES_CM.1),
        Limit::new("D26", dwell.area_half_range.0, 0, 0x7fff),
    ];
    let present = [
        Limit::optional("D12", dwell.along_sigma_cm, 0, 1_000_000),
        Limit::optional("D13", dwell.across_sigma_cm, 0, 1_000_000),
        Limit::optional("D16", dwell.speed_mm_per_s, 0, FASTEST_MM_PER_S),
        Limit::optional("D18", dwell.track_sigma_deg, 0, 45),
    ];
    let reports = dwell.reports.iter().flat_map(of_report);
    always.into_iter().chain(present.into_iter().flatten()).chain(reports).collect()
}

fn of_report(report: &TargetReport) -> impl Iterator<Item = Limit> + use<> {
    let limits = [
        Limit::optional("D32.6", report.height_m, -1000, i16::MAX.into()),
        Limit::optional("D32.11", report.class_percent, 0, 100),
        Limit::optional("D32.15", report.radial_sigma_cm_per_s, 0, 5000),
    ];
    limits.into_iter().flatten()
}

/// The bits of D1 for fields Dn.
const fn fields(first: u32, last: u32) -> u64 {
    let count = last - first + 1;
    ((1 << count) - 1) << (65 - last)
}

/// The bits of D1 for fields D32.k.
const fn report_fields(first: u32, last: u32) -> u64 {
    let count = last - first + 1;
    ((1 << count) - 1) << (34 - last)
}

const SCALES: u64 = fields(10, 11);
const LOCATION: u64 = report_fields(2, 3);
const DELTAS: u64 = report_fields(4, 5);

const GROUPS: [(u64, &str); 9] = [
    (SCALES, "D10 and D11"),
    (fields(12, 14), "D12 to D14"),
    (fields(15, 17), "D15 to D17"),
    (fields(18, 20), "D18 to D20"),
    (fields(21, 23), "D21 to D23"),
    (LOCATION, "D32.2 and D32.3"),
    (DELTAS, "D32.4 and D32.5"),
    (report_fields(7, 8), "D32.7 and D32.8"),
    (report_fields(16, 17), "D32.16 and D32.17"),
];

fn groups_are_complete(segment_index: usize, dwell: &Dwell) -> Result<(), WriteError> {
    let mask = dwell.mask;
    let is_broken = |(bits, _): &&(u64, &str)| ![0, *bits].contains(&(mask & bits));
    let broken = |fields| Err(WriteError::BrokenGroup { segment_index, fields });
    if let Some((_, fields)) = GROUPS.iter().find(is_broken) {
        return broken(fields);
    }
    if mask & SPARE_BITS != 0 {
        return broken("the spare bits of D1");
    }
    let has = |bits: u64| mask & bits != 0;
    if has(DELTAS) && !has(SCALES) {
        return broken("D32.4, D32.5 and their steps D10, D11");
    }
    if !dwell.reports.is_empty() && has(LOCATION) == has(DELTAS) {
        return broken("either D32.2 and D32.3 or D32.4 and D32.5");
    }
    Ok(())
}
