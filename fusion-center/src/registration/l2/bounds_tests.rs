//! The bounds against the objective at many poses of many boxes.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use super::super::super::objective::l2_value;
use super::*;
use crate::registration::Problem;
use crate::simulate::{Conditions, Trial, large_room, trial};

/// Relative: the bound and the objective round differently.
const ROUNDING: f64 = 1e-9;

/// Boxes around the true pose, whose half sides halve from metres to micrometres.
fn boxes(case: &Trial, data: &Prepared, rng: &mut ChaCha8Rng) -> Vec<PoseBox> {
    let truth = case.truth();
    let turn = Motion::new(0.0, 0.0, truth.z);
    let (x, y) = turn.turned(data.node_center_m.x, data.node_center_m.y);
    (0..22)
        .map(|level| {
            let half_m = 4.0 * 0.5_f64.powi(level);
            // Long boxes in turn, so that every way to move is the one that matters.
            let mut part = || half_m * 10.0_f64.powf(rng.random_range(-2.5..0.0));
            let (half_x_m, half_y_m, half_heading_rad) = (part(), part(), 0.4 * part());
            let mut near = |half: f64| half * rng.random_range(-1.0..1.0);
            PoseBox {
                x_m: truth.x + x + near(half_x_m),
                y_m: truth.y + y + near(half_y_m),
                heading_rad: truth.z + near(half_heading_rad),
                half_x_m,
                half_y_m,
                half_heading_rad,
            }
        })
        .collect()
}

/// One point of the reference and two of the node, most of whose sum is one pair: no other pair's
/// slack hides a bound that is too low.
fn one_pair(mut case: Trial) -> Trial {
    case.problem.periods.truncate(1);
    case.problem.periods[0].in_ref.truncate(1);
    case
}

/// A pose of the box: a corner, a face or the inside.
fn pose_within(of: &PoseBox, rng: &mut ChaCha8Rng) -> PoseBox {
    let mut part = |half: f64| {
        let at: f64 = rng.random_range(-1.6..1.6);
        half * at.clamp(-1.0, 1.0)
    };
    PoseBox {
        x_m: of.x_m + part(of.half_x_m),
        y_m: of.y_m + part(of.half_y_m),
        heading_rad: of.heading_rad + part(of.half_heading_rad),
        ..*of
    }
}

fn check(case: &Trial, scale: f64, seed: u64) {
    let data = Prepared::new(&case.problem);
    let bounder = Bounder::new(&data, scale);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    for pose_box in boxes(case, &data, &mut rng) {
        let value = bounder.value(&pose_box);
        let exact = -l2_value(&data, &bounder.middle(&pose_box), scale);
        assert!((value.middle - exact).abs() <= ROUNDING * exact, "{pose_box:?} {value:?} {exact}");
        assert!(value.upper >= value.middle * (1.0 - ROUNDING));
        for _ in 0..150 {
            let inside = pose_within(&pose_box, &mut rng);
            let there = -l2_value(&data, &bounder.middle(&inside), scale);
            let limit = value.upper * (1.0 + ROUNDING) + 1e-12;
            assert!(there <= limit, "{pose_box:?} {there} above {}", value.upper);
        }
    }
}

#[test]
fn no_pose_of_a_box_exceeds_its_bound() {
    for seed in 0..12 {
        for scale in [1.0, 20.0, 400.0] {
            check(&trial(&Conditions::WITH_FALSE_POINTS, seed), scale, seed);
        }
    }
    for seed in 0..200 {
        check(&one_pair(trial(&Conditions::CLEAN, seed)), 1.0, seed);
    }
    for seed in 0..3 {
        check(&large_room(seed, 4), 1.0, seed);
    }
}

#[test]
fn bounds_close_in_on_the_value() {
    /// A box of micrometres and microradians: the objective changes by its slope, below 1/cm.
    const TIGHT: f64 = 2e-3;
    let case = trial(&Conditions::CLEAN, 5);
    let data = Prepared::new(&case.problem);
    let bounder = Bounder::new(&data, 1.0);
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let last = *boxes(&case, &data, &mut rng).last().unwrap();
    let value = bounder.value(&last);
    assert!(value.middle > 0.0 && value.upper < value.middle * (1.0 + TIGHT), "{value:?}");
}

#[test]
fn halves_cover_the_box_and_roots_cover_the_turn() {
    let case = trial(&Conditions::CLEAN, 5);
    let data = Prepared::new(&case.problem);
    let bounder = Bounder::new(&data, 1.0);
    let roots = bounder.roots(36);
    let turn: f64 = roots.iter().map(|root| 2.0 * root.half_heading_rad).sum();
    assert!((turn - TAU).abs() < 1e-9);
    let volume = |b: &PoseBox| b.half_x_m * b.half_y_m * b.half_heading_rad;
    let mut parent = roots[7];
    for _ in 0..20 {
        let [low, high] = Bounder::halves(&parent, data.node_spread_m);
        assert!((volume(&low) + volume(&high) - volume(&parent)).abs() < 1e-9 * volume(&parent));
        let ends = |of: fn(&PoseBox) -> (f64, f64)| {
            let ((a, half_a), (b, half_b), (c, half_c)) = (of(&low), of(&high), of(&parent));
            let covers = (a - half_a - c + half_c).abs() + (b + half_b - c - half_c).abs();
            assert!(covers < 1e-9, "{low:?} {high:?} {parent:?}");
        };
        ends(|b| (b.x_m, b.half_x_m));
        ends(|b| (b.y_m, b.half_y_m));
        ends(|b| (b.heading_rad, b.half_heading_rad));
        parent = high;
    }
}

#[test]
fn nothing_lies_outside_of_the_roots() {
    let case = trial(&Conditions::WITH_FALSE_POINTS, 8);
    let data = Prepared::new(&case.problem);
    let bounder = Bounder::new(&data, 1.0);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for root in bounder.roots(36) {
        let heading_rad = root.heading_rad + root.half_heading_rad * rng.random_range(-1.0..1.0);
        let beside = PoseBox { x_m: root.x_m + root.half_x_m, heading_rad, ..root };
        let below = PoseBox { y_m: root.y_m - root.half_y_m, heading_rad, ..root };
        for outside in [beside, below] {
            assert!(-l2_value(&data, &bounder.middle(&outside), 1.0) < 1e-9);
        }
    }
    let empty = Prepared::new(&Problem::default());
    assert_eq!(Bounder::new(&empty, 1.0).value(&bounder.roots(1)[0]).upper.to_bits(), 0);
}
