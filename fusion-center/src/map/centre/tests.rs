//! Dwells of several sensors, late, doubled and damaged, through the state machine.

use proto::wire::{DwellArea, DwellReport, GeoRecord, MapStatus, Message};
use tokio::time::Instant;

use super::*;
use crate::map::{Messages, OutputConfig};
use crate::tracking::{TrackerKind, TrackingConfig};

const SITE: &str = "lab";

fn centre(config: MapConfig) -> MapCentre {
    MapCentre::new(config, SITE.parse().unwrap(), BootId(7)).unwrap()
}

fn with_files() -> MapConfig {
    let output = OutputConfig {
        cot: "udp/127.0.0.1:1".to_owned(),
        geojson: Some("t.geojson".into()),
        kml: Some("t.kml".into()),
        csv: Some("t.csv".into()),
        ..OutputConfig::default()
    };
    MapConfig { output, ..MapConfig::default() }
}

/// A car that goes east by 15 m/s, as `node` sees it.
fn dwell(node: &str, time_s: f64) -> Dwell {
    let place = GeoRecord { lat_deg: 40.8, lon_deg: 111.7 + 1.78e-4 * time_s, height_m: 1000.0 };
    Dwell {
        node: node.parse().unwrap(),
        time_unix_s: 1.7e9 + time_s,
        revisit_index: 0,
        dwell_index: 0,
        is_last_of_revisit: true,
        sensor: GeoRecord { lat_deg: 40.6, lon_deg: 111.6, height_m: 7000.0 },
        flight: None,
        area: DwellArea {
            center: GeoRecord { lat_deg: 40.8, lon_deg: 111.7, height_m: 1000.0 },
            range_half_extent_m: 10_000.0,
            angle_half_extent_deg: 20.0,
        },
        minimum_detectable_m_per_s: None,
        detection_probability: Some(0.95),
        is_simulated: false,
        reports: vec![DwellReport {
            index: 0,
            place,
            slant_sigma_m: Some(10.0),
            cross_sigma_m: Some(10.0),
            radial_m_per_s: None,
            radial_sigma_m_per_s: None,
            wrap_m_per_s: None,
            snr_db: None,
            truth: None,
        }],
    }
}

fn delivery(node: &str, bytes: Vec<u8>) -> Delivery {
    let key = format!("transmural/1/{SITE}/up/{node}/dwells");
    Delivery { key, event: BusEvent::Message(bytes), arrived: Instant::now() }
}

fn bytes(dwell: &Dwell, sequence: u64) -> Vec<u8> {
    encode(Stamp { boot: BootId(1), sequence, sent_ns: 0 }, dwell).unwrap()
}

fn at(seconds: f64) -> CentreTime {
    #[expect(clippy::cast_possible_truncation, reason = "small")]
    let ns = (seconds * 1e9) as i64;
    CentreTime(ns)
}

fn send(centre: &mut MapCentre, now_s: f64, dwell: &Dwell, sequence: u64) -> Vec<MapEffect> {
    let delivery = delivery(dwell.node.as_str(), bytes(dwell, sequence));
    centre.step(at(now_s), MapEvent::Delivered(delivery, at(now_s)))
}

fn published(effects: &[MapEffect]) -> Vec<MapTracks> {
    let of = |effect: &MapEffect| match effect {
        MapEffect::Publish(Topic::MapTracks, bytes) => Some(decode(bytes).unwrap().body),
        _ => None,
    };
    effects.iter().filter_map(of).collect()
}

#[test]
fn two_sensors_in_turn_make_one_track_on_the_map() {
    // The second sensor is first heard after two and a half seconds: others are waited for as long.
    let mut centre = centre(MapConfig { max_wait_s: 3.0, ..MapConfig::default() });
    let mut told = Vec::new();
    for scan in 0..20_u64 {
        let time_s = 2.0 * scan as f64;
        // The second sensor's dwells come late, behind the next of the first.
        told.extend(send(&mut centre, time_s, &dwell("a", time_s), scan));
        if let Some(before) = scan.checked_sub(1) {
            let late = dwell("b", 2.0 * before as f64 + 1.0);
            told.extend(send(&mut centre, time_s + 0.5, &late, before));
        }
    }
    told.extend(centre.finish(at(60.0)));
    let maps = published(&told);
    let last = maps.last().unwrap();
    assert_eq!((last.counts.dwell_count, last.counts.late_count), (39, 0), "{:?}", last.counts);
    let [track] = last.tracks.as_slice() else { panic!("{:?}", last.tracks) };
    assert_eq!(track.status, MapStatus::Confirmed);
    assert!((track.velocity_m_per_s[0] - 15.0).abs() < 1.5, "{track:?}");
    assert!((track.place.lon_deg - 111.7 - 1.78e-4 * 38.0).abs() < 2e-4, "{track:?}");
    assert_eq!(track.report_count, 39);
    assert_eq!(track.report.as_ref().unwrap().node.as_str(), "a");
    assert!(!last.is_simulated && (last.time_unix_s - 1.7e9 - 38.0).abs() < 1e-6);
    assert!(maps.len() < 40, "at most one map in its interval: {}", maps.len());
}

#[test]
fn what_is_late_doubled_or_damaged_is_counted_and_costs_nothing() {
    let mut centre = centre(MapConfig::default());
    for scan in 0..6_u64 {
        send(&mut centre, 3.0 * scan as f64, &dwell("a", 4.0 * scan as f64), scan);
    }
    send(&mut centre, 16.0, &dwell("a", 8.0), 2);
    send(&mut centre, 16.0, &dwell("b", 3.0), 0);
    let impostor = delivery("c", bytes(&dwell("b", 30.0), 1));
    centre.step(at(17.0), MapEvent::Delivered(impostor, at(17.0)));
    for garbage in [b"short".to_vec(), vec![7; 400]] {
        centre.step(at(17.0), MapEvent::Delivered(delivery("a", garbage), at(17.0)));
    }
    let oversized = Delivery { event: BusEvent::Oversized(1 << 24), ..delivery("a", Vec::new()) };
    centre.step(at(17.0), MapEvent::Delivered(oversized, at(17.0)));
    let foreign = Delivery { key: "elsewhere".to_owned(), ..delivery("a", Vec::new()) };
    centre.step(at(17.0), MapEvent::Delivered(foreign, at(17.0)));
    let effects = centre.finish(at(18.0));
    let maps = published(&effects);
    let counts = maps[0].counts;
    assert_eq!((counts.dwell_count, counts.duplicate_count, counts.late_count), (6, 1, 1));
    assert_eq!(counts.refused_count, 5);
    for label in ["impostor", "too_short", "foreign", "oversized", "key", "late"] {
        assert_eq!(centre.refusals.total(label), 1, "{label}");
    }
    assert_eq!(maps[0].tracks.len(), 1);
}

#[test]
fn sensors_beyond_the_limit_and_unusable_dwells_are_refused() {
    let mut one = centre(MapConfig { max_sensor_count: 1, ..MapConfig::default() });
    send(&mut one, 0.0, &dwell("a", 0.0), 0);
    send(&mut one, 0.0, &dwell("b", 0.0), 0);
    assert_eq!((one.counts().refused_count, one.refusals.total("crowded")), (1, 1));
    assert!(one.step(at(1.0), MapEvent::Tick).is_empty(), "it waits for others at the start");
    assert_eq!(published(&one.step(at(2.0), MapEvent::Tick)).len(), 1);
    assert!(one.step(at(9.0), MapEvent::Tick).is_empty(), "nothing is new");
}

/// On the other side of the earth a place in the plane would stand for one on this side.
#[test]
fn another_region_is_refused_and_followed_once_nothing_comes_from_the_first() {
    let mut centre = centre(MapConfig::default());
    let elsewhere = |time_s: f64| {
        let mut one = dwell("b", time_s);
        for place in [&mut one.sensor, &mut one.area.center, &mut one.reports[0].place] {
            (place.lat_deg, place.lon_deg) = (-place.lat_deg, place.lon_deg - 180.0);
        }
        one
    };
    let mut told = Vec::new();
    for scan in 0..6_u64 {
        let time_s = 4.0 * scan as f64;
        told.extend(send(&mut centre, time_s, &dwell("a", time_s), scan));
        told.extend(send(&mut centre, time_s + 1.0, &elsewhere(time_s + 1.0), scan));
    }
    let last = |effects: &[MapEffect]| published(effects).pop().unwrap().tracks;
    told.extend(centre.step(at(50.0), MapEvent::Tick));
    let first = last(&told);
    assert!(first.len() == 1 && (first[0].place.lat_deg - 40.8).abs() < 0.01, "{first:?}");
    assert_eq!(centre.refusals.total("unusable"), 6);
    told.clear();
    for scan in 0..6_u64 {
        let time_s = 500.0 + 4.0 * scan as f64;
        told.extend(send(&mut centre, time_s, &elsewhere(time_s), 10 + scan));
    }
    let second = last(&told);
    assert!(second.len() == 1 && (second[0].place.lat_deg + 40.8).abs() < 0.01, "{second:?}");
    assert!((second[0].place.lon_deg + 68.3 - 1.78e-4 * 520.0).abs() < 0.01, "{second:?}");
    assert_ne!(second[0].id, first[0].id, "ids are never given again");
}

#[test]
fn a_single_wrong_date_costs_one_dwell() {
    let mut centre = centre(MapConfig::default());
    for scan in 0..10_u64 {
        let time_s = 4.0 * scan as f64;
        let wrong = if scan == 4 { 1e8 } else { 0.0 };
        let mut one = dwell("a", time_s);
        one.time_unix_s += wrong;
        send(&mut centre, time_s, &one, scan);
    }
    let last = published(&centre.finish(at(60.0))).pop().unwrap();
    assert_eq!((last.counts.dwell_count, last.counts.late_count), (9, 0));
    assert_eq!((last.counts.refused_count, centre.refusals.total("leap")), (1, 1));
    assert_eq!(last.tracks.len(), 1);
}

/// A clock that is set back by a day: late for a minute, then the map is that of the new times.
#[test]
fn a_clock_that_is_set_back_stops_the_map_for_a_minute_only() {
    for kind in [TrackerKind::Default, TrackerKind::Paper] {
        let tracking = TrackingConfig { kind, ..TrackingConfig::default() };
        let mut centre = centre(MapConfig { tracking, ..MapConfig::default() });
        let mut told = Vec::new();
        for scan in 0..40_u64 {
            let time_s = 4.0 * scan as f64;
            let mut one = dwell("a", time_s);
            one.time_unix_s -= if scan < 10 { 0.0 } else { 86_400.0 };
            told.extend(send(&mut centre, time_s, &one, scan));
        }
        told.extend(centre.finish(at(200.0)));
        let maps = published(&told);
        let first = maps.iter().rev().find(|map| map.time_unix_s > 1.7e9 - 1000.0).unwrap();
        let last = maps.last().unwrap();
        assert_eq!((first.tracks.len(), last.tracks.len()), (1, 1), "{kind:?}");
        assert!(last.time_unix_s < 1.7e9 - 86_000.0, "{kind:?}");
        assert!(first.tracks[0].id < last.tracks[0].id, "{kind:?}: ids are never given again");
        // Ten before, sixteen within the minute, and what followed.
        assert_eq!((last.counts.late_count, last.counts.dwell_count), (16, 24), "{kind:?}");
    }
}

#[test]
fn reports_of_no_use_are_told() {
    let mut centre = centre(MapConfig::default());
    let mut under = dwell("a", 0.0);
    under.reports[0].place = GeoRecord { height_m: 1000.0, ..under.sensor };
    send(&mut centre, 0.0, &under, 0);
    centre.finish(at(9.0));
    assert_eq!((centre.refusals.total("unplaced"), centre.counts().dwell_count), (1, 1));
}

#[test]
fn the_same_events_give_the_same_bytes() {
    let run = || {
        let mut centre = centre(with_files());
        let mut all = Vec::new();
        for scan in 0..10_u64 {
            let effects =
                send(&mut centre, 4.0 * scan as f64, &dwell("a", 4.0 * scan as f64), scan);
            all.extend(effects.iter().map(|effect| format!("{effect:?}")));
        }
        all
    };
    assert_eq!(run(), run());
}

#[test]
fn files_and_datagrams_hold_what_is_shown_and_the_last_word_of_what_ended() {
    let mut centre = centre(with_files());
    let mut shown = Vec::new();
    for scan in 0..10_u64 {
        let effects = send(&mut centre, 4.0 * scan as f64, &dwell("a", 4.0 * scan as f64), scan);
        shown.extend(effects.into_iter().filter_map(|effect| match effect {
            MapEffect::Show(one) => Some(*one),
            MapEffect::Publish(..) => None,
        }));
    }
    let last = shown.last().unwrap();
    assert_eq!(last.tracks.len(), 1);
    assert!(5 < last.tracks[0].history.len() && last.tracks[0].sensors == ["a"]);
    let mut messages = Messages::new(with_files().output);
    let events = messages.cot(last).unwrap();
    assert!(events.len() == 1 && events[0].len() < 1400);
    assert!(String::from_utf8_lossy(&events[0]).contains("<event"));
    let names: Vec<String> =
        messages.files(last).unwrap().iter().map(|(path, _)| path.display().to_string()).collect();
    assert_eq!(names, ["t.geojson", "t.kml", "t.csv"]);
    let first = messages.cat062(last).unwrap();
    assert!(first.len() == 1 && first[0][0] == 62);
    let none = Shown { tracks: Vec::new(), ..last.clone() };
    assert_eq!(messages.cat062(&none).unwrap().len(), 1, "the track's last message");
    assert!(messages.cat062(&none).unwrap().is_empty());
}

#[test]
fn the_message_stays_within_its_limit() {
    const { assert!(MapTracks::MAX_BYTES <= proto::wire::MAX_PAYLOAD_BYTES) };
}
