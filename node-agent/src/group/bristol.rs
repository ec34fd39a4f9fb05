//! Grouping on real recordings: two radars' centres of the same people, at perpendicular views.

use std::path::Path;

use nalgebra::Vector2;
use proto::geom::{Gaussian, Node, Point, Ref, Se2, wrap_angle};

use super::{GroupConfig, by_window, group_period};
use crate::source::recorded::read_recording;

const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/bristol-3radar");
const SEQUENCES: [&str; 3] =
    ["multiple-tracking-jun05", "multiple-tracking-jun12", "fall-detection-jun10"];

/// Centres farther apart than this are of different people.
const MATCH_M: f64 = 0.6;
/// How far the fit may lie from the tape, which is itself good to a few centimetres and degrees.
const POSITION_TOLERANCE_M: f64 = 0.20;
const HEADING_TOLERANCE_DEG: f64 = 6.0;

/// Middles of people by the number of the period.
type Sightings = Vec<(u64, Vec<Gaussian<Node>>)>;

/// A person as both radars saw them: by the reference, by the other.
type Match = (Gaussian<Node>, Gaussian<Node>);

fn sightings(sequence: &Path, radar: &str, height_m: f64) -> Sightings {
    let config = GroupConfig { sensor_height_m: Some(height_m), ..GroupConfig::default() };
    let recording = read_recording(&sequence.join(format!("{radar}.csv"))).unwrap();
    let middle = |p: &proto::measured::MeasuredPoint| {
        p.middle(config.half_depth_m, config.half_depth_sigma_m)
    };
    by_window(recording.detections, config.period_s)
        .into_iter()
        .map(|(index, batch)| (index, group_period(&batch, &config).iter().map(middle).collect()))
        .collect()
}

/// The taped pose of a radar and its height above the floor.
fn taped(extrinsics: &serde_json::Value, radar: &str) -> (Se2<Ref, Node>, f64) {
    let pose = &extrinsics["pose_ref_from_node"][radar];
    let [x_m, y_m, heading_deg, height_m] =
        ["x_m", "y_m", "heading_deg", "height_m"].map(|key| pose[key].as_f64().unwrap());
    (Se2::new(x_m, y_m, heading_deg.to_radians()), height_m)
}

/// In `Ref` from the reference's sighting to the other's.
fn difference_m(pose_ref_from_node: &Se2<Ref, Node>, (reference, other): &Match) -> Vector2<f64> {
    (*pose_ref_from_node * other.mean).coords_m - reference.mean.coords_m
}

fn matches(reference: &Sightings, other: &Sightings, pose: &Se2<Ref, Node>) -> Vec<Match> {
    let gap_m = |pair: &Match| difference_m(pose, pair).norm();
    let nearest = |person: &Gaussian<Node>, candidates: &[Gaussian<Node>]| {
        let pairs = candidates.iter().map(|candidate| (*candidate, *person));
        pairs.min_by(|a, b| gap_m(a).total_cmp(&gap_m(b))).filter(|pair| gap_m(pair) < MATCH_M)
    };
    let mut found = Vec::new();
    for (index, people) in other {
        let same_period = reference.iter().find(|(number, _)| number == index);
        let candidates = same_period.map_or(&[][..], |(_, candidates)| candidates);
        found.extend(people.iter().filter_map(|person| nearest(person, candidates)));
    }
    found
}

/// The least-squares motion of the matches, in closed form.
fn rigid_fit(pairs: &[Match]) -> Se2<Ref, Node> {
    let count = pairs.len() as f64;
    let a0: Vector2<f64> = pairs.iter().map(|p| p.0.mean.coords_m).sum::<Vector2<f64>>() / count;
    let b0: Vector2<f64> = pairs.iter().map(|p| p.1.mean.coords_m).sum::<Vector2<f64>>() / count;
    let (mut dot, mut cross) = (0.0, 0.0);
    for (a, b) in pairs {
        let (a, b) = (a.mean.coords_m - a0, b.mean.coords_m - b0);
        dot += b.dot(&a);
        cross += b.perp(&a);
    }
    let turned = Se2::<Ref, Node>::new(0.0, 0.0, cross.atan2(dot));
    let moved = a0 - (turned * Point::from_coords(b0)).coords_m;
    Se2::new(moved.x, moved.y, turned.heading_rad())
}

/// Squared difference over its stated covariance, for each of the two degrees of freedom.
fn mean_chi_square(pairs: &[Match], pose: &Se2<Ref, Node>) -> f64 {
    let turn = pose.rotation();
    let one = |pair: &Match| {
        let cov_m2 = pair.0.cov_m2 + turn * pair.1.cov_m2 * turn.transpose();
        let difference = difference_m(pose, pair);
        difference.dot(&(cov_m2.try_inverse().unwrap() * difference))
    };
    0.5 * pairs.iter().map(one).sum::<f64>() / pairs.len() as f64
}

#[test]
fn perpendicular_radars_agree_on_people_and_with_the_tape() {
    if !Path::new(FOLDER).is_dir() {
        eprintln!("skipped: {FOLDER} is absent");
        return;
    }
    for sequence in SEQUENCES {
        let folder = Path::new(FOLDER).join(sequence);
        let text = std::fs::read_to_string(folder.join("extrinsics.json")).unwrap();
        let extrinsics = serde_json::from_str(&text).unwrap();
        let ori = sightings(&folder, "ori", taped(&extrinsics, "ori").1);
        let (tape, side_height_m) = taped(&extrinsics, "side");
        let side = sightings(&folder, "side", side_height_m);
        let (mut pose, mut pairs) = (tape, Vec::new());
        for _ in 0..30 {
            pairs = matches(&ori, &side, &pose);
            pose = rigid_fit(&pairs);
        }
        let off_m = (pose.translation_m() - tape.translation_m()).norm();
        let off_deg = wrap_angle(pose.heading_rad() - tape.heading_rad()).to_degrees();
        let chi_square = mean_chi_square(&pairs, &pose);
        let seen_count: usize = side.iter().map(|(_, people)| people.len()).sum();
        eprintln!(
            "{sequence}: {off_deg:.1}°, {off_m:.3} m, χ² {chi_square:.2}, {} of {seen_count} matched",
            pairs.len()
        );
        assert!(off_m < POSITION_TOLERANCE_M && off_deg.abs() < HEADING_TOLERANCE_DEG);
        // 30 to 100 matches, of which neighbours in time share their errors: hence the wide band.
        assert!((0.5..1.8).contains(&chi_square));
        assert!(2 * seen_count < 3 * pairs.len());
    }
}
