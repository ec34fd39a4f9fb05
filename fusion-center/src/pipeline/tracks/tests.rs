//! Tracks against drawn poses, and what the centre keeps and forgets.

use nalgebra::{Vector3, Vector4};
use proto::bus::{BusEvent, Delivery};
use proto::keys::Topic;
use proto::time::NodeTime;
use proto::wire::{Counters, Picture, PointSet, Stamp, decode, encode};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::super::drawn::{groups, id, pairs};
use super::super::{Centre, Effect, Event};
use super::*;
use crate::config::GatherConfig;

const CENTRE: BootId = BootId(9);
const SECOND_NS: i64 = 1_000_000_000;

fn record(id: u64, status: TrackStatus) -> TrackRecord {
    TrackRecord {
        id,
        status,
        state: [1.0, 6.0, 0.5, -1.0],
        covariance: packed_covariance(&Matrix4::from_diagonal(&Vector4::new(1e-3, 2e-3, 0.1, 0.2))),
        extent_m2: [0.04, 0.0, 0.01],
        appearance: 0.75,
        unseen_s: 0.0,
    }
}

/// The oracle: the same track placed by many drawn poses, with drawn errors of its own.
#[test]
fn a_placed_track_spreads_as_drawn_poses_do() {
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let sigmas = Vector3::new(0.1, 0.2, 0.03);
    let pose_covariance = Matrix3::from_diagonal(&sigmas.component_mul(&sigmas));
    let track = record(1, TrackStatus::Confirmed);
    let placed = place(Se2::new(3.0, 1.0, 2.0), &pose_covariance, &track);
    let own: Vector4<f64> = track.covariance_matrix().diagonal().map(f64::sqrt);
    let draw_count = 40_000;
    let mut sum = Matrix4::zeros();
    for _ in 0..draw_count {
        let mut normal = || -> f64 { StandardNormal.sample(&mut random) };
        let [x, y, turn] = [0, 1, 2].map(|axis| sigmas[axis] * normal());
        let drawn = Se2::<Ref, Node>::new(3.0 + x, 1.0 + y, 2.0 + turn);
        let [at_x, at_y, vx, vy] =
            [0, 1, 2, 3].map(|axis| track.state[axis] + own[axis] * normal());
        let at = drawn * Point::<Node>::new(at_x, at_y);
        // A velocity is the way of one second, worked out between two points.
        let next = drawn * Point::<Node>::new(at_x + vx, at_y + vy);
        let way = next.coords_m - at.coords_m;
        let state = Vector4::new(at.x_m(), at.y_m(), way.x, way.y);
        let error = state - Vector4::from(placed.state);
        sum += error * error.transpose();
    }
    let spread = sum / f64::from(draw_count);
    // Relative error of a variance from 40 000 draws: sqrt(2/40000) = 0.7 %; five of these, and
    // what a turn of 0.03 rad adds beyond first order, 0.1 %.
    let sigma = spread.diagonal().map(f64::sqrt);
    for row in 0..4 {
        for column in 0..4 {
            let scale = sigma[row] * sigma[column];
            let error = (spread[(row, column)] - placed.covariance_matrix()[(row, column)]) / scale;
            assert!(error.abs() < 0.04, "({row}, {column}): {error}");
        }
    }
}

#[test]
fn a_quarter_turn_swaps_what_it_should() {
    let track = record(1, TrackStatus::Confirmed);
    let quarter = Se2::new(10.0, 20.0, std::f64::consts::FRAC_PI_2);
    let placed = place(quarter, &Matrix3::zeros(), &track);
    let near = |got: &[f64], want: &[f64]| {
        assert!(got.iter().zip(want).all(|(g, w)| (g - w).abs() < 1e-12), "{got:?} {want:?}");
    };
    near(&placed.state, &[4.0, 21.0, 1.0, 0.5]);
    near(&placed.extent_m2, &[0.01, 0.0, 0.04]);
    let diagonal = placed.covariance_matrix().diagonal();
    near(diagonal.as_slice(), &[2e-3, 1e-3, 0.2, 0.1]);
    assert_eq!((placed.id, placed.status), (track.id, track.status));
}

#[test]
fn the_middle_lies_behind_what_is_seen() {
    let seen = TrackRecord { state: [3.0, 4.0, 1.0, 0.0], ..record(1, TrackStatus::Confirmed) };
    let of = middle(&seen, 0.5, 0.2);
    assert!((Vector4::from(of.state) - Vector4::new(3.3, 4.4, 1.0, 0.0)).norm() < 1e-12);
    let [xx, xy, _, _, yy, ..] = of.covariance;
    // 0.04 m² along (0.6, 0.8).
    let added = [xx - 1e-3 - 0.0144, xy - 0.0192, yy - 2e-3 - 0.0256];
    assert!(added.iter().all(|rest| rest.abs() < 1e-12), "{added:?}");
}

fn clock() -> ClockEstimate {
    ClockEstimate { centre_boot: CENTRE, offset_ns: 5 * SECOND_NS, error_ns: 1000 }
}

fn set(name: &str, sequence: u64) -> Received<PointSet> {
    let body = PointSet {
        node: id(name),
        period: sequence,
        time: NodeTime(sequence * 100_000_000),
        clock: Some(clock()),
        half_depth_m: 0.0,
        half_depth_sigma_m: 0.0,
        points: Vec::new(),
        counters: Counters::default(),
    };
    Received { stamp: Stamp { boot: BootId(1), sequence, sent_ns: 0 }, body }
}

/// A centre's gather that has heard one set of each node.
fn heard(names: &[&str]) -> Gather {
    let mut gather = Gather::new(GatherConfig::default(), id("n1"), CENTRE);
    for name in names {
        gather.offer(CentreTime(6 * SECOND_NS), set(name, 0));
    }
    gather
}

fn tracks(name: &str, boot: u64, sequence: u64, tracks: Vec<TrackRecord>) -> Received<NodeTracks> {
    let body = NodeTracks {
        node: id(name),
        period: sequence,
        time: NodeTime(0),
        clock: None,
        half_depth_m: 0.0,
        half_depth_sigma_m: 0.0,
        refused_count: 0,
        tracks,
    };
    Received { stamp: Stamp { boot: BootId(boot), sequence, sent_ns: 0 }, body }
}

/// `n1` the reference and `n2` registered; `n3` is not.
fn poses() -> Poses {
    let mut poses = Poses::new(id("n1"));
    poses.announce_reference(CentreTime(0));
    let pairs = pairs(&[(("n1", "n2"), (-5.0, 5.0, 0.0))]);
    poses.take(CentreTime(0), &groups(&pairs.edges()), &pairs);
    poses
}

#[test]
fn sure_tracks_of_registered_nodes_are_shown_where_they_are() {
    let (mut gather, poses) = (heard(&["n1", "n2", "n3"]), poses());
    let mut followed = Followed::default();
    let now = CentreTime(6 * SECOND_NS);
    let all = || {
        let statuses = [TrackStatus::Tentative, TrackStatus::Confirmed, TrackStatus::Coasting];
        statuses.into_iter().zip(1..).map(|(status, id)| record(id, status)).collect::<Vec<_>>()
    };
    for name in ["n1", "n2", "n3", "n4"] {
        assert_eq!(followed.take(now, &mut gather, tracks(name, 1, 0, all())), Ok(()));
    }
    assert_eq!(followed.newest.len(), 3, "a stranger is not kept");
    let shown = followed.shown(&gather, &poses);
    let who: Vec<(&str, u64)> = shown.iter().map(|one| (one.node.as_str(), one.track.id)).collect();
    assert_eq!(who, [("n1", 2), ("n1", 3), ("n2", 2), ("n2", 3)]);
    assert!(shown.iter().all(|one| one.time == CentreTime(5 * SECOND_NS)));
    let [x_m, y_m, ..] = shown[2].track.state;
    assert!((x_m + 4.0).hypot(y_m - 11.0) < 1e-6, "{x_m} {y_m}");
    // The pose's error is in it: 1 cm and, at 6 m, 0.01 rad.
    assert!(1e-3 < shown[2].track.covariance[0] - shown[0].track.covariance[0]);
}

#[test]
fn the_newest_message_counts_and_silence_is_forgotten() {
    let (mut gather, poses) = (heard(&["n1"]), poses());
    let other = heard(&["n1"]);
    let mut followed = Followed::default();
    let mut hear = |kept: &mut Followed, at_s: i64, stamp: (u64, u64), track_id| {
        let track = vec![record(track_id, TrackStatus::Confirmed)];
        let told = tracks("n1", stamp.0, stamp.1, track);
        kept.take(CentreTime(at_s * SECOND_NS), &mut gather, told)
    };
    let ids = |kept: &Followed| -> Vec<u64> {
        kept.shown(&other, &poses).iter().map(|one| one.track.id).collect()
    };
    assert_eq!(hear(&mut followed, 6, (1, 5), 50), Ok(()));
    assert_eq!(hear(&mut followed, 7, (1, 4), 40), Ok(()));
    assert_eq!(ids(&followed), [50], "what overtook stays");
    assert_eq!(hear(&mut followed, 8, (2, 0), 1), Ok(()));
    assert_eq!(ids(&followed), [1], "an agent that starts anew counts anew");
    assert_eq!(hear(&mut followed, 8, (1, 6), 60), Err(Unused::FormerLife));
    assert_eq!(ids(&followed), [1]);
    let limit = Duration::from_secs(3);
    followed.forget_old(CentreTime(11 * SECOND_NS), limit);
    assert_eq!(ids(&followed), [1]);
    followed.forget_old(CentreTime(11 * SECOND_NS + 1), limit);
    assert!(followed.newest.is_empty());
}

/// The centre as a whole: what a node says of its tracks ends in the picture.
#[test]
fn told_tracks_are_in_the_next_picture_and_others_are_refused() {
    let config = std::sync::Arc::new(crate::config::CentreConfig::default());
    let mut centre = Centre::new(config, CENTRE);
    let message = |key: &str, bytes: Vec<u8>| Delivery {
        key: format!("transmural/1/site/up/{key}"),
        event: BusEvent::Message(bytes),
        arrived: tokio::time::Instant::now(),
    };
    let set = |sequence: u64| {
        let Received { stamp, body } = set("n1", sequence);
        message("n1/points", encode(stamp, &body).unwrap())
    };
    let told = tracks("n1", 1, 0, vec![record(7, TrackStatus::Confirmed)]);
    let told = encode(told.stamp, &told.body).unwrap();
    let traffic = [
        set(0),
        message("n1/tracks", told.clone()),
        message("n2/tracks", told.clone()),
        message("n1/tracks", told[..60].to_vec()),
        message("n1/points", told),
        set(1),
    ];
    let mut pictures = Vec::new();
    for delivery in traffic {
        let now = CentreTime(6 * SECOND_NS);
        for effect in centre.step(now, Event::Delivered(delivery, now)) {
            if let Effect::Publish(Topic::Picture, bytes) = effect {
                pictures.push(decode::<Picture>(&bytes).unwrap().body);
            }
        }
    }
    let ids = |picture: &Picture| -> Vec<u64> {
        picture.tracks.iter().map(|shown| shown.track.id).collect()
    };
    assert_eq!(ids(pictures.first().unwrap()), Vec::<u64>::new());
    assert_eq!(ids(pictures.last().unwrap()), [7]);
    for label in ["impostor", "length", "kind"] {
        assert_eq!(centre.refusals().total(label), 1, "{label}");
    }
    let silent = CentreTime(10 * SECOND_NS);
    for effect in centre.step(silent, Event::Tick) {
        if let Effect::Publish(Topic::Picture, bytes) = effect {
            assert_eq!(ids(&decode::<Picture>(&bytes).unwrap().body), Vec::<u64>::new());
        }
    }
}
