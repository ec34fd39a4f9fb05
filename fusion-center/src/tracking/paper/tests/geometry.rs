//! Formulas against places in space.

use nalgebra::{Vector2, Vector3};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use crate::tracking::Platform;
use crate::tracking::paper::geometry::{Gradients, Sight, Way, line};

/// Rounding of lengths of some 10 km, metres.
const SAME_M: f64 = 1e-7;
/// The same seen from there, radians.
const SAME_RAD: f64 = 1e-11;
const TRIAL_COUNT: usize = 500;

struct Scene {
    from: Platform,
    place_m: Vector2<f64>,
}

/// A sensor at some height that flies anywhere, level or climbing, and a target anywhere.
fn scene(rng: &mut ChaCha8Rng, max_climb_m_per_s: f64) -> Scene {
    let mut some = |half: f64| rng.random_range(-half..half);
    let climb_m_per_s = max_climb_m_per_s * some(1.0);
    let from = Platform {
        position_m: Vector3::new(some(2e4), some(2e4), 5000.0 + some(3000.0)),
        velocity_m_per_s: Vector3::new(some(100.0), some(100.0), climb_m_per_s),
        beam_index: None,
    };
    Scene { from, place_m: Vector2::new(some(2e4), some(2e4)) }
}

fn later(from: &Platform, dt_s: f64) -> Platform {
    Platform { position_m: from.position_m + from.velocity_m_per_s * dt_s, ..*from }
}

#[test]
fn the_law_of_cosines_is_the_triangle_of_sensor_sensor_and_target() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for _ in 0..TRIAL_COUNT {
        let Scene { from, place_m } = scene(&mut rng, 30.0);
        let dt_s = rng.random_range(0.1..30.0);
        let radial_m_per_s = rng.random_range(-30.0..30.0);
        let to = later(&from, dt_s);
        // The target goes away from the sensor's first place, along the line of sight.
        let start = Vector3::new(place_m.x, place_m.y, 0.0);
        let sight_line = start - from.position_m;
        let end = start + sight_line.normalize() * radial_m_per_s * dt_s;
        let range_m = (end - to.position_m).norm();
        let cone_rad = from.velocity_m_per_s.angle(&(end - to.position_m));

        let way = Way::between(&from, &to, place_m);
        let before = Sight::new(&line(&from, place_m), &way.along);
        let after = before.predicted(radial_m_per_s * dt_s, way.length_m);
        assert!((after.range_m - range_m).abs() < SAME_M, "{} {range_m}", after.range_m);
        // The angle of nalgebra is an arc cosine: it loses half of its digits near 0.
        assert!((after.cone_rad - cone_rad).abs() < 1e-7, "{} {cone_rad}", after.cone_rad);
    }
}

#[test]
fn the_formulas_are_those_of_the_paper() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for _ in 0..TRIAL_COUNT {
        let r: f64 = rng.random_range(5e3..3e4);
        let theta: f64 = rng.random_range(0.2..2.9);
        let (v_r, t, v_a): (f64, f64, f64) = (rng.random_range(-30.0..30.0), 4.0, 120.0);
        let r_prime = r + v_r * t;
        let r_hat =
            (r_prime.powi(2) + (v_a * t).powi(2) - 2.0 * r_prime * v_a * t * theta.cos()).sqrt();
        let theta_hat = ((r_prime * theta.cos() - v_a * t) / r_hat).acos();
        let before = Sight { range_m: r, cone_rad: theta, side: 1.0 };
        let after = before.predicted(v_r * t, v_a * t);
        assert!((after.range_m - r_hat).abs() < SAME_M);
        assert!((after.cone_rad - theta_hat).abs() < SAME_RAD);
    }
}

#[test]
fn a_place_is_found_again_from_range_angle_and_side() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for trial in 0..TRIAL_COUNT {
        let Scene { from, place_m } = scene(&mut rng, [0.0, 30.0][trial % 2]);
        let along = from.velocity_m_per_s.normalize();
        let sight = Sight::new(&line(&from, place_m), &along);
        let found_m = sight.place_m(&from.position_m, &along).unwrap();
        // Near the way of flight the side hardly changes the range: the root loses digits.
        assert!((found_m - place_m).norm() < 1e-3, "{trial}: {found_m} {place_m}");
    }
}

#[test]
fn a_place_by_hand() {
    // 3-4-5 on the ground from 12 m below: r = 13, and the flight is towards north-east.
    let along = Vector3::new(0.6, 0.8, 0.0);
    let from_m = Vector3::new(100.0, 200.0, 12.0);
    // 3 ahead, 4 to the left: E = 3·0.6 − 4·0.8, N = 3·0.8 + 4·0.6.
    let sight = Sight { range_m: 13.0, cone_rad: (3.0_f64 / 13.0).acos(), side: 1.0 };
    let place_m = sight.place_m(&from_m, &along).unwrap();
    assert!((place_m - Vector2::new(98.6, 204.8)).norm() < SAME_M, "{place_m}");
    let right = Sight { side: -1.0, ..sight }.place_m(&from_m, &along).unwrap();
    assert!((right - Vector2::new(105.0, 200.0)).norm() < SAME_M, "{right}");
    let above = Sight { range_m: 11.0, ..sight };
    assert_eq!(above.place_m(&from_m, &along), None);
}

#[test]
fn gradients_are_differences_of_neighbours() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let step_m = 1.0;
    for _ in 0..TRIAL_COUNT {
        let Scene { from, place_m } = scene(&mut rng, 30.0);
        let along = from.velocity_m_per_s.normalize();
        let sight = |at_m| Sight::new(&line(&from, at_m), &along);
        if sight(place_m).cone_rad.sin() < 0.2 {
            continue;
        }
        let gradients = Gradients::new(&line(&from, place_m), &along);
        for (axis, off_m) in
            [Vector2::new(step_m, 0.0), Vector2::new(0.0, step_m)].iter().enumerate()
        {
            let (more, less) = (sight(place_m + off_m), sight(place_m - off_m));
            let range = (more.range_m - less.range_m) / (2.0 * step_m);
            let cone = (more.cone_rad - less.cone_rad) / (2.0 * step_m);
            // Third derivatives over some kilometres.
            assert!((range - gradients.range[axis]).abs() < 1e-6);
            assert!((cone - gradients.cone[axis]).abs() < 1e-9);
        }
    }
}

#[test]
fn a_sensor_that_stands_counts_from_across_the_line_of_sight() {
    let from = Platform {
        position_m: Vector3::new(0.0, 0.0, 3000.0),
        velocity_m_per_s: Vector3::zeros(),
        beam_index: None,
    };
    let place_m = Vector2::new(0.0, 4000.0);
    let way = Way::between(&from, &from, place_m);
    let sight = Sight::new(&line(&from, place_m), &way.along);
    assert!((sight.cone_rad - std::f64::consts::FRAC_PI_2).abs() < SAME_RAD);
    assert!((sight.range_m - 5000.0).abs() < SAME_M);
    let after = sight.predicted(10.0, way.length_m);
    assert!((after.range_m - 5010.0).abs() < SAME_M);
    assert!((after.cone_rad - sight.cone_rad).abs() < SAME_RAD);
    assert!(Sight::new(&line(&from, Vector2::new(1.0, 4000.0)), &way.along).side > 0.0);
}

#[test]
fn over_a_short_way_the_stated_velocity_tells_the_direction() {
    let from = Platform {
        position_m: Vector3::new(0.0, 0.0, 3000.0),
        velocity_m_per_s: Vector3::new(0.0, 80.0, 0.0),
        beam_index: None,
    };
    let to = Platform { position_m: from.position_m + Vector3::new(0.3, 0.4, 0.0), ..from };
    let way = Way::between(&from, &to, Vector2::new(5000.0, 0.0));
    assert!((way.along - Vector3::y()).norm() < 1e-12);
    assert!((way.length_m - 0.4).abs() < 1e-12);
}
