//! Golden bytes, every refusal, and hostile input.

use proptest::prelude::*;

use super::*;
use crate::ids::{BootId, NodeId};
use crate::measured::MeasuredPoint;
use crate::time::{CentreTime, ClockEstimate, NodeTime};

const STAMP: Stamp = Stamp { boot: BootId(0x0102_0304_0506_0708), sequence: 9, sent_ns: 10 };

fn node() -> NodeId {
    "n1".parse().unwrap()
}

fn point() -> MeasuredPoint {
    MeasuredPoint {
        x_m: 1.0,
        y_m: 2.0,
        cov_m2: [0.25, 0.0, 0.5],
        snr_db: 12.0,
        extent_m2: [0.0, 0.0, 0.0],
        radial_velocity_m_per_s: Some(-1.0),
    }
}

fn point_set() -> PointSet {
    PointSet {
        node: node(),
        period: 3,
        time: NodeTime(4),
        clock: Some(ClockEstimate { centre_boot: BootId(5), offset_ns: -6, error_ns: 7 }),
        half_depth_m: 0.5,
        half_depth_sigma_m: 0.25,
        points: vec![point()],
        counters: Counters { point_count: 1, ..Counters::default() },
    }
}

fn transform() -> Transform {
    let pose_ref_from_node = PoseRecord { x_m: -5.0, y_m: 5.0, heading_rad: -1.5 };
    let covariance = [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.001]];
    Transform { epoch: 2, accepted: CentreTime(3), pose_ref_from_node, covariance }
}

fn registration() -> Registration {
    Registration {
        node: node(),
        reference: "n0".parse().unwrap(),
        published: CentreTime(1),
        transform: Some(transform()),
        outcome: Outcome::Determined,
        evidence: evidence(),
        sets: None,
        solver: "default".to_owned(),
        via: vec!["n0".parse().unwrap(), node()],
        suspicion: Some(suspicion()),
        is_pinned: true,
    }
}

fn evidence() -> Evidence {
    Evidence {
        matched_point_count: 40,
        distinct_point_count: 12,
        covariance_inflation: 1.5,
        certified_rival_share: Some(0.25),
        ..Evidence::default()
    }
}

fn suspicion() -> Suspicion {
    Suspicion {
        moved: node(),
        began: CentreTime(7),
        shift_x_m: 0.25,
        shift_y_m: -0.5,
        turn_rad: 0.125,
        chi_square: 90.0,
    }
}

fn answer() -> Answer {
    Answer { to: BootId(3), is_done: true, text: "pinned".to_owned() }
}

fn picture() -> Picture {
    let target = FusedTarget {
        x_m: 1.0,
        y_m: 2.0,
        cov_m2: [0.1, 0.0, 0.1],
        snr_db: 9.0,
        nodes: vec![node()],
    };
    Picture {
        reference: node(),
        period: 1,
        time: CentreTime(2),
        nodes: vec![line()],
        targets: vec![target],
        tracks: vec![TrackInPicture { node: node(), time: CentreTime(12), track: track(13) }],
        people: vec![person()],
    }
}

fn person() -> PersonInPicture {
    PersonInPicture {
        id: 14,
        status: TrackStatus::Confirmed,
        time: CentreTime(15),
        state: [1.0, 2.0, -0.5, 0.25],
        covariance: track(0).covariance,
        log_odds: 16.5,
        unseen_s: 0.125,
        nodes: vec!["n0".parse().unwrap(), node()],
        last: PointOfPerson { node: node(), sequence: 17, point_index: 18, share: 0.875 },
    }
}

fn track(id: u64) -> TrackRecord {
    TrackRecord {
        id,
        status: TrackStatus::Coasting,
        state: [1.0, 2.0, -0.5, 0.25],
        covariance: [1.0, 0.125, 0.25, 0.0, 2.0, 0.0, 0.5, 3.0, 0.0, 4.0],
        extent_m2: [0.0625, 0.0, 0.03125],
        appearance: 0.75,
        unseen_s: 0.5,
    }
}

fn tracks() -> NodeTracks {
    NodeTracks {
        node: node(),
        period: 3,
        time: NodeTime(4),
        clock: None,
        half_depth_m: 0.5,
        half_depth_sigma_m: 0.25,
        refused_count: 6,
        tracks: vec![TrackRecord { status: TrackStatus::Tentative, ..track(7) }, track(8)],
    }
}

fn line() -> NodeInPicture {
    NodeInPicture {
        node: node(),
        state: NodeState::Suspect,
        silent_ms: 1,
        boot: BootId(2),
        next_sequence: 3,
        received_count: 4,
        missing_count: 5,
        duplicate_count: 6,
        late_count: 7,
        refused_count: 8,
        epoch: Some(9),
        is_pinned: false,
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The bytes of each kind as they were written when its schema was frozen. If one of these
/// assertions fails, the layout has changed: count the message's `SCHEMA` up.
#[test]
fn the_layout_is_frozen() {
    let probe = encode(STAMP, &ClockProbe { node: node(), asked: NodeTime(11) }).unwrap();
    assert_eq!(hex(&probe), include_str!("golden/clock_probe.hex").trim());
    assert_eq!(
        hex(&encode(STAMP, &point_set()).unwrap()),
        include_str!("golden/point_set.hex").trim()
    );
    assert_eq!(
        hex(&encode(STAMP, &registration()).unwrap()),
        include_str!("golden/registration.hex").trim()
    );
    assert_eq!(hex(&encode(STAMP, &picture()).unwrap()), include_str!("golden/picture.hex").trim());
    let followed = hex(&encode(STAMP, &tracks()).unwrap());
    assert_eq!(followed, include_str!("golden/node_tracks.hex").trim());
    let command = Command::Recalibrate { node: Some(node()) };
    assert_eq!(hex(&encode(STAMP, &command).unwrap()), include_str!("golden/command.hex").trim());
    let stated = StatedPose {
        pose_ref_from_node: transform().pose_ref_from_node,
        sigma_m: 0.5,
        sigma_rad: 0.25,
    };
    let pin = Command::Pin { node: node(), pose: Some(stated) };
    assert_eq!(hex(&encode(STAMP, &pin).unwrap()), include_str!("golden/pin.hex").trim());
    let told = hex(&encode(STAMP, &answer()).unwrap());
    assert_eq!(told, include_str!("golden/answer.hex").trim());
    let answer = ClockAnswer { node: node(), asked: NodeTime(1), answered: CentreTime(-2) };
    assert_eq!(
        hex(&encode(STAMP, &answer).unwrap()),
        include_str!("golden/clock_answer.hex").trim()
    );
    assert_eq!(
        hex(&encode(STAMP, &status()).unwrap()),
        include_str!("golden/node_status.hex").trim()
    );
}

fn status() -> NodeStatus {
    NodeStatus {
        node: node(),
        time: NodeTime(1),
        software: "0.1.0".to_owned(),
        source: SourceState::Finished,
        clock: None,
        next_sequence: 2,
        queue_length: 3,
        transform_epoch: Some(4),
        latency: Some(LatencyReport { count: 1, p50_ms: 1.0, p99_ms: 2.0, max_ms: 3.0 }),
        counters: Counters::default(),
    }
}

/// The header read by hand, with no code of the codec's.
#[test]
fn the_header_is_where_the_documentation_says() {
    let bytes = encode(STAMP, &point_set()).unwrap();
    assert_eq!(&bytes[0..4], b"TMUR");
    assert_eq!(&bytes[4..10], &[1, 1, 1, 0, 1, 0]);
    assert_eq!(&bytes[16..24], &[8, 7, 6, 5, 4, 3, 2, 1]);
    assert_eq!((bytes[24], bytes[32]), (9, 10));
    assert_eq!(usize::from(bytes[40]) + 256 * usize::from(bytes[41]), bytes.len() - 48);
}

fn assert_returns<M: Message + PartialEq + std::fmt::Debug>(message: &M) {
    let bytes = encode(STAMP, message).unwrap();
    assert_eq!(decode::<M>(&bytes).unwrap().body, *message);
}

#[test]
fn every_kind_arrives_as_it_was_sent() {
    let set = decode::<PointSet>(&encode(STAMP, &point_set()).unwrap()).unwrap();
    assert_eq!((set.stamp, set.body), (STAMP, point_set()));
    assert_returns(&registration());
    assert_returns(&picture());
    assert_returns(&tracks());
    assert_returns(&status());
    assert_returns(&answer());
    let detached = Outcome::Detached { with: vec![node()] };
    assert_returns(&Registration { outcome: detached, ..registration() });
    assert_returns(&Command::Unpin { node: node() });
    assert_returns(&Command::Rollback { node: node() });
}

#[test]
fn every_cut_and_one_extra_byte_are_refused() {
    let bytes = encode(STAMP, &point_set()).unwrap();
    for length in 0..bytes.len() {
        assert!(decode::<PointSet>(&bytes[..length]).is_err(), "{length} bytes were taken");
    }
    let mut longer = bytes;
    longer.push(0);
    assert_eq!(decode::<PointSet>(&longer).unwrap_err().label(), "length");
}

#[test]
fn every_flipped_bit_is_refused() {
    let bytes = encode(STAMP, &point_set()).unwrap();
    for bit in 0..8 * bytes.len() {
        let mut damaged = bytes.clone();
        damaged[bit / 8] ^= 1 << (bit % 8);
        assert!(decode::<PointSet>(&damaged).is_err(), "bit {bit} went unnoticed");
    }
}

/// Bytes with the checksum made right again after `change`, as a hostile sender would.
fn resealed(change: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
    let mut bytes = encode(STAMP, &point_set()).unwrap();
    change(&mut bytes);
    let length = u32::try_from(bytes.len() - HEADER_BYTES).unwrap();
    bytes[40..44].copy_from_slice(&length.to_le_bytes());
    let checksum = crc32c::crc32c_append(crc32c::crc32c(&bytes[..44]), &bytes[HEADER_BYTES..]);
    bytes[44..48].copy_from_slice(&checksum.to_le_bytes());
    bytes
}

#[test]
fn each_refusal_has_its_reason() {
    let label = |bytes: &[u8]| decode::<PointSet>(bytes).unwrap_err().label();
    assert_eq!(label(b"short"), "too_short");
    assert_eq!(label(&[b'x'; 60]), "foreign");
    assert_eq!(label(&resealed(|bytes| bytes[4] = 2)), "header_version");
    assert_eq!(label(&resealed(|bytes| bytes[5] = 9)), "header_version");
    assert_eq!(label(&resealed(|bytes| bytes[6] = 2)), "kind");
    assert_eq!(label(&resealed(|bytes| bytes[8] = 7)), "schema");
    assert_eq!(label(&resealed(|bytes| bytes[12] = 1)), "reserved");
    assert_eq!(label(&resealed(|bytes| bytes.push(0))), "trailing");
    assert_eq!(label(&resealed(|bytes| bytes.truncate(60))), "payload");
    assert_eq!(label(&resealed(|bytes| bytes.resize(200_000, 0))), "oversized");
    // The node's name has the length 2 in its first eight bytes.
    assert_eq!(label(&resealed(|bytes| bytes[HEADER_BYTES + 7] = 0xff)), "payload");
    let mut damaged = resealed(|_| {});
    damaged[HEADER_BYTES] ^= 1;
    assert_eq!(label(&damaged), "checksum");
}

#[test]
fn senseless_fields_are_refused_on_both_sides() {
    let with = |change: fn(&mut MeasuredPoint)| {
        let mut set = point_set();
        change(&mut set.points[0]);
        encode(STAMP, &set).unwrap_err().to_string()
    };
    assert!(with(|point| point.x_m = f64::NAN).contains("points.x_m"));
    assert!(with(|point| point.y_m = f64::INFINITY).contains("points.y_m"));
    assert!(with(|point| point.cov_m2 = [1.0, 2.0, 1.0]).contains("points.cov_m2"));
    assert!(with(|point| point.cov_m2 = [1.0, 0.0, 0.0]).contains("points.cov_m2"));
    assert!(with(|point| point.extent_m2 = [-1.0, 0.0, 0.0]).contains("points.extent_m2"));
    assert!(with(|point| point.radial_velocity_m_per_s = Some(f64::NAN)).contains("velocity"));
    let deep = PointSet { half_depth_m: 1e300, ..point_set() };
    assert!(encode(STAMP, &deep).unwrap_err().to_string().contains("half_depth_m"));
    let crowd = PointSet { points: vec![point(); 2000], ..point_set() };
    assert!(encode(STAMP, &crowd).unwrap_err().to_string().contains("points is 2000"));
    let mut skewed = registration();
    skewed.transform = Some(Transform { covariance: [[1.0, 0.5, 0.0]; 3], ..transform() });
    assert_eq!(encode(STAMP, &skewed).unwrap_err().label(), "invalid");
    let mut doubted = registration();
    doubted.suspicion = Some(Suspicion { turn_rad: f64::NAN, ..suspicion() });
    assert!(encode(STAMP, &doubted).unwrap_err().to_string().contains("suspicion.turn_rad"));
    for (changed, named) in [
        (Evidence { certified_rival_share: Some(1.5), ..evidence() }, "certified_rival_share"),
        (Evidence { certified_rival_share: Some(-0.1), ..evidence() }, "certified_rival_share"),
        (Evidence { certified_rival_share: Some(f64::NAN), ..evidence() }, "certified_rival_share"),
        (Evidence { covariance_inflation: f64::INFINITY, ..evidence() }, "covariance_inflation"),
        (Evidence { covariance_inflation: -1.0, ..evidence() }, "covariance_inflation"),
    ] {
        let refusal = encode(STAMP, &Registration { evidence: changed, ..registration() });
        assert!(refusal.unwrap_err().to_string().contains(named), "{changed:?}");
    }
    let pose_ref_from_node = transform().pose_ref_from_node;
    for (sigma_m, sigma_rad, named) in [(0.0, 0.1, "sigma_m"), (0.1, 9.0, "sigma_rad")] {
        let pose = Some(StatedPose { pose_ref_from_node, sigma_m, sigma_rad });
        let refusal = encode(STAMP, &Command::Pin { node: node(), pose }).unwrap_err();
        assert!(refusal.to_string().contains(named), "{refusal}");
    }
    let long = Answer { text: "x".repeat(600), ..answer() };
    assert!(encode(STAMP, &long).unwrap_err().to_string().contains("text is 600"));
}

#[test]
fn senseless_people_are_refused() {
    let with = |change: fn(&mut PersonInPicture)| {
        let mut bad = person();
        change(&mut bad);
        let shown = Picture { people: vec![person(), bad], ..picture() };
        encode(STAMP, &shown).unwrap_err().to_string()
    };
    assert!(with(|one| one.state[0] = 1e6).contains("people.state x_m"));
    assert!(with(|one| one.state[1] = f64::NAN).contains("people.state y_m"));
    assert!(with(|one| one.state[3] = 1e5).contains("people.state velocity"));
    assert!(with(|one| one.covariance[9] = 0.0).contains("people.covariance"));
    assert!(with(|one| one.log_odds = f64::NAN).contains("people.log_odds"));
    assert!(with(|one| one.unseen_s = -1.0).contains("people.unseen_s"));
    assert!(with(|one| one.nodes.reverse()).contains("people.nodes"));
    assert!(with(|one| one.last.share = 1.5).contains("people.last.share"));
    let crowded = Picture { people: vec![person(); 513], ..picture() };
    assert!(encode(STAMP, &crowded).unwrap_err().to_string().contains("people is 513"));
    let full = Picture { people: vec![person(); PersonInPicture::MAX_COUNT], ..picture() };
    assert!(encode(STAMP, &full).is_ok(), "as many people as may be fit into a message");
}

#[test]
fn senseless_tracks_are_refused_on_both_sides() {
    let refusal = |message: &NodeTracks| encode(STAMP, message).unwrap_err().to_string();
    let with = |change: fn(&mut TrackRecord)| {
        let mut bad = track(9);
        change(&mut bad);
        let shown = TrackInPicture { node: node(), time: CentreTime(1), track: bad.clone() };
        let in_picture = Picture { tracks: vec![shown], ..picture() };
        let said = refusal(&NodeTracks { tracks: vec![track(8), bad], ..tracks() });
        assert_eq!(encode(STAMP, &in_picture).unwrap_err().to_string(), said);
        said
    };
    assert!(with(|one| one.state[0] = f64::NAN).contains("tracks.state x_m"));
    assert!(with(|one| one.state[1] = 1e6).contains("tracks.state y_m"));
    assert!(with(|one| one.state[2] = f64::INFINITY).contains("tracks.state velocity"));
    assert!(with(|one| one.state[3] = f64::NAN).contains("tracks.state velocity"));
    assert!(with(|one| one.covariance[0] = -1.0).contains("tracks.covariance"));
    assert!(with(|one| one.covariance[9] = 0.0).contains("tracks.covariance"));
    // The velocity cannot hang together with the position more than fully.
    assert!(with(|one| one.covariance[2] = 2.0).contains("tracks.covariance"));
    assert!(with(|one| one.covariance[5] = f64::NAN).contains("tracks.covariance"));
    assert!(with(|one| one.extent_m2[1] = 1.0).contains("tracks.extent_m2"));
    assert!(with(|one| one.appearance = 1.5).contains("tracks.appearance"));
    assert!(with(|one| one.unseen_s = -0.1).contains("tracks.unseen_s"));
    let deep = NodeTracks { half_depth_m: 3.0, ..tracks() };
    assert!(refusal(&deep).contains("half_depth_m"));
    let twice = NodeTracks { tracks: vec![track(8), track(8)], ..tracks() };
    assert!(refusal(&twice).contains("tracks.id is [8, 8]"));
    let crowd = NodeTracks { tracks: (0..257).map(track).collect(), ..tracks() };
    assert!(refusal(&crowd).contains("tracks is 257"));
}

#[test]
fn the_upper_triangle_is_where_the_documentation_says() {
    let matrix =
        nalgebra::Matrix4::from_fn(|row, column| (row.min(column) * 10 + row.max(column)) as f64);
    let packed = packed_covariance(&matrix);
    let expected = [0.0, 1.0, 2.0, 3.0, 11.0, 12.0, 13.0, 22.0, 23.0, 33.0];
    assert!(
        packed.iter().zip(expected).all(|(got, want)| (got - want).abs() < 1e-12),
        "{packed:?}"
    );
    let record = TrackRecord { covariance: packed, ..track(1) };
    assert!((record.covariance_matrix() - matrix).norm() < 1e-12);
}

#[test]
fn the_largest_tracks_fit_their_limits() {
    let full = NodeTracks { tracks: (0..256).map(track).collect(), ..tracks() };
    assert!(encode(STAMP, &full).is_ok());
    let shown = |id| TrackInPicture { node: node(), time: CentreTime(1), track: track(id) };
    let crowded = Picture { tracks: (0..1024).map(shown).collect(), ..picture() };
    assert!(encode(STAMP, &crowded).is_ok());
}

#[test]
fn the_largest_set_fits_its_limit() {
    let full = PointSet { points: vec![point(); 1024], ..point_set() };
    assert!(encode(STAMP, &full).is_ok());
}

proptest! {
    #[test]
    fn arbitrary_payloads_never_panic(payload in proptest::collection::vec(any::<u8>(), 0..600)) {
        let bytes = resealed(|bytes| {
            bytes.truncate(HEADER_BYTES);
            bytes.extend_from_slice(&payload);
        });
        if let Ok(got) = decode::<PointSet>(&bytes) {
            prop_assert!(got.body.points.len() <= 1024);
        }
    }
}
