//! Any model that can be written is read again as the same model.

use proptest::collection::vec;
use proptest::option::of;
use proptest::prelude::*;

use super::super::{
    B16, Ba16, Ba32, Dwell, Edition, FreeText, HistoryBase, HistoryStep, JobDefinition, Mission,
    Origin, Packet, PacketHeader, PlatformLocation, ProcessingHistory, Sa16, Sa32, Segment,
    SegmentKind, TargetReport, TestAndStatus, Text, packets,
};

fn text<const N: usize>() -> impl Strategy<Value = Text<N>> {
    vec(any::<u8>(), N).prop_map(|bytes| Text(bytes.try_into().unwrap()))
}

/// Which fields are there is chosen once for all reports of a dwell.
fn report(there: u32) -> impl Strategy<Value = TargetReport> {
    let bytes = (any::<[i16; 6]>(), any::<[u16; 3]>(), any::<[u8; 6]>(), any::<[u32; 3]>());
    bytes.prop_map(move |(short, word, byte, long)| {
        let has = |bit: u32| there >> bit & 1 == 1;
        TargetReport {
            index: has(0).then_some(word[0]),
            latitude: has(1).then_some(Sa32(long[0].cast_signed())),
            longitude: has(2).then_some(Ba32(long[1])),
            delta_latitude: has(3).then_some(short[0]),
            delta_longitude: has(4).then_some(short[1]),
            height_m: has(5).then_some(short[2]),
            radial_velocity_cm_per_s: has(6).then_some(short[3]),
            wrap_velocity_cm_per_s: has(7).then_some(word[1]),
            snr_db: has(8).then_some(byte[0].cast_signed()),
            classification: has(9).then_some(byte[1]),
            class_percent: has(10).then_some(byte[2]),
            slant_sigma_cm: has(11).then_some(word[2]),
            cross_sigma_dm: has(12).then_some(short[4].cast_unsigned()),
            height_sigma_m: has(13).then_some(byte[3]),
            radial_sigma_cm_per_s: has(14).then_some(short[5].cast_unsigned()),
            truth_application: has(15).then_some(byte[4]),
            truth_entity: has(16).then_some(long[2]),
            cross_section_half_db: has(17).then_some(byte[5].cast_signed()),
        }
    })
}

fn reports() -> impl Strategy<Value = Vec<TargetReport>> {
    (1_u32..1 << 18).prop_flat_map(|there| vec(report(there), 0..20))
}

fn ba16() -> impl Strategy<Value = Ba16> {
    any::<u16>().prop_map(Ba16)
}

fn sa16() -> impl Strategy<Value = Sa16> {
    any::<i16>().prop_map(Sa16)
}

fn ba32() -> impl Strategy<Value = Ba32> {
    any::<u32>().prop_map(Ba32)
}

fn sa32() -> impl Strategy<Value = Sa32> {
    any::<i32>().prop_map(Sa32)
}

prop_compose! {
    fn mandatory()(
        (revisit_index, dwell_index, last_dwell, time_ms) in any::<(u16, u16, u8, u32)>(),
        (sensor_latitude, sensor_longitude, sensor_altitude_cm) in (sa32(), ba32(), any::<i32>()),
        (area_latitude, area_longitude, half_range, area_half_angle)
            in (sa32(), ba32(), any::<u16>(), ba16()),
    ) -> Dwell {
        Dwell {
            revisit_index, dwell_index, last_dwell, time_ms, sensor_latitude, sensor_longitude,
            sensor_altitude_cm, area_latitude, area_longitude, area_half_range: B16(half_range),
            area_half_angle, ..Dwell::default()
        }
    }
}

prop_compose! {
    fn dwell()(
        mandatory in mandatory(),
        (latitude_scale, longitude_scale) in (of(sa32()), of(ba32())),
        (along_sigma_cm, across_sigma_cm, altitude_sigma_cm)
            in any::<(Option<u32>, Option<u32>, Option<u16>)>(),
        (speed_mm_per_s, climb_dm_per_s, track) in (of(any::<u32>()), of(any::<i8>()), of(ba16())),
        (track_sigma_deg, speed_sigma_mm_per_s, climb_sigma_cm_per_s)
            in any::<(Option<u8>, Option<u16>, Option<u16>)>(),
        (platform_heading, platform_pitch, platform_roll) in (of(ba16()), of(sa16()), of(sa16())),
        (sensor_heading, sensor_pitch, sensor_roll) in (of(ba16()), of(sa16()), of(sa16())),
        minimum_velocity_dm_per_s in any::<Option<u8>>(),
        reports in reports(),
    ) -> Dwell {
        Dwell {
            latitude_scale, longitude_scale, along_sigma_cm, across_sigma_cm, altitude_sigma_cm,
            track, speed_mm_per_s, climb_dm_per_s, track_sigma_deg, speed_sigma_mm_per_s,
            climb_sigma_cm_per_s, platform_heading, platform_pitch, platform_roll, sensor_heading,
            sensor_pitch, sensor_roll, minimum_velocity_dm_per_s, reports, ..mandatory
        }.sealed()
    }
}

/// Spare bits, and bits of reports that are not there, are kept as well.
fn any_dwell() -> impl Strategy<Value = Segment> {
    (dwell(), any::<u32>()).prop_map(|(mut dwell, bits)| {
        let free = if dwell.reports.is_empty() { 0x3_ffff_ffff } else { 0xffff };
        dwell.mask |= u64::from(bits) & free;
        Segment::Dwell(Box::new(dwell))
    })
}

prop_compose! {
    fn mission()(
        plan in text(), flight_plan in text(), platform_configuration in text(),
        (platform_type, year, month, day) in any::<(u8, u16, u8, u8)>(),
    ) -> Segment {
        Segment::Mission(Mission {
            plan, flight_plan, platform_type, platform_configuration, year, month, day,
        })
    }
}

prop_compose! {
    fn job()(
        sensor_model in text(),
        corners in any::<[u32; 8]>(),
        byte in any::<[u8; 10]>(),
        word in any::<[u16; 8]>(),
        job_id in any::<u32>(),
    ) -> Segment {
        let latitude = |index: usize| Sa32(corners[index].cast_signed());
        let longitude = |index: usize| Ba32(corners[index]);
        Segment::JobDefinition(Box::new(JobDefinition {
            job_id, sensor_type: byte[0], sensor_model, target_filtering: byte[1],
            priority: byte[2], a_latitude: latitude(0), a_longitude: longitude(1),
            b_latitude: latitude(2), b_longitude: longitude(3), c_latitude: latitude(4),
            c_longitude: longitude(5), d_latitude: latitude(6), d_longitude: longitude(7),
            radar_mode: byte[3], revisit_ds: word[0], along_sigma_dm: word[1],
            across_sigma_dm: word[2], altitude_sigma_dm: word[3], track_sigma_deg: byte[4],
            speed_sigma_mm_per_s: word[4], slant_sigma_cm: word[5], cross_sigma: Ba16(word[6]),
            radial_sigma_cm_per_s: word[7], minimum_velocity_dm_per_s: byte[5],
            detection_percent: byte[6], false_alarm_minus_db: byte[7], terrain_model: byte[8],
            geoid_model: byte[9],
        }))
    }
}

prop_compose! {
    fn history()(
        origin in (text(), text(), any::<u32>(), any::<u32>()),
        steps in vec((text(), text(), any::<(u8, u32, u32, u16)>()), 0..5),
    ) -> Segment {
        let (nationality, platform_id, mission_id, job_id) = origin;
        let base = HistoryBase { nationality, platform_id, mission_id, job_id };
        let step = |(country, platform, numbers): (_, _, (u8, u32, u32, u16))| HistoryStep {
            sequence: numbers.0,
            nationality: country,
            platform_id: platform,
            mission_id: numbers.1,
            job_id: numbers.2,
            processing: numbers.3,
        };
        let steps = steps.into_iter().map(step).collect();
        Segment::ProcessingHistory(ProcessingHistory { base, steps })
    }
}

fn small() -> impl Strategy<Value = Segment> {
    let text = (text(), text(), vec(any::<u8>(), 0..50));
    let text = text.prop_map(|(originator, recipient, text)| {
        Segment::FreeText(FreeText { originator, recipient, text })
    });
    let status = any::<(u32, u16, u16, u32, u8, u8)>().prop_map(
        |(job_id, revisit_index, dwell_index, time_ms, hardware, mode)| {
            let status =
                TestAndStatus { job_id, revisit_index, dwell_index, time_ms, hardware, mode };
            Segment::TestAndStatus(status)
        },
    );
    let location = (any::<(u32, i32, u32, i8)>(), sa32(), ba32(), ba16()).prop_map(
        |((time_ms, altitude_cm, speed_mm_per_s, climb_dm_per_s), latitude, longitude, track)| {
            Segment::PlatformLocation(PlatformLocation {
                time_ms,
                latitude,
                longitude,
                altitude_cm,
                track,
                speed_mm_per_s,
                climb_dm_per_s,
            })
        },
    );
    let other = (14_u8.., vec(any::<u8>(), 0..50))
        .prop_map(|(kind, bytes)| Segment::Other { kind: SegmentKind(kind), bytes });
    prop_oneof![text, status, location, other]
}

prop_compose! {
    fn packet()(
        edition in prop::sample::select(&Edition::ALL[..]),
        (nationality, classification_system, platform_id) in (text(), text(), text()),
        (classification, security_codes, exercise, mission_id, job_id)
            in any::<(u8, u16, u8, u32, u32)>(),
        segments in vec(prop_oneof![any_dwell(), mission(), job(), history(), small()], 0..5),
    ) -> Packet {
        let origin = Origin {
            nationality, classification, classification_system, security_codes, exercise,
            platform_id, mission_id, job_id,
        };
        Packet { header: PacketHeader { edition, origin }, segments }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, failure_persistence: None, ..Default::default() })]

    #[test]
    fn what_is_written_is_read_again(packet in packet(), next in packet()) {
        let bytes = packet.encode_as_read().unwrap();
        prop_assert_eq!(&Packet::decode(&bytes).unwrap(), &packet);
        let both = [bytes, next.encode_as_read().unwrap()].concat();
        let read: Vec<Packet> = packets(&both).map(Result::unwrap).collect();
        prop_assert_eq!(read, vec![packet, next]);
    }
}
