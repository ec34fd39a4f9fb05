//! The kernels of the default tracker against slow computations of the same.

use nalgebra::{DMatrix, DVector, Matrix2, Matrix4, Vector2, Vector4};
use proto::measured::MeasuredPoint;
use proto::radar::Grid;

use super::config::{BodyModel, DefaultConfig, Gait};
use super::error::{Known, half_depth_m, lasting_m2, sight};
use super::history::{History, Record};
use super::look::{Picture, Window};
use super::motion::{Estimate, Motion, Sight};
use crate::tracking::maxima::Raster;

/// Rounding over some hundred operations.
const ROUNDING: f64 = 1e-9;
/// The limit for long memories leaves out terms of `Δt/τ = 7e-4`, of 2 (m/s)² or less.
const LIMIT: f64 = 3e-3;
const STILL: Gait = Gait { memory_s: 1e3, push_m2_per_s3: 1e-3, aside_share: 1.0, sojourn_s: 1e6 };

fn seen(x_m: f64, y_m: f64, sigma_m: f64) -> Sight {
    let cov_m2 = Matrix2::identity() * sigma_m * sigma_m;
    Sight { place_m: Vector2::new(x_m, y_m), cov_m2 }
}

#[test]
fn prediction_is_the_integral_of_small_steps() {
    // Euler's steps of the moments of one way of moving: m' = A m, P' = A P + P Aᵀ + G q Gᵀ.
    for memory_s in [0.5, 1e3] {
        let gait = Gait { memory_s, push_m2_per_s3: 2.0, aside_share: 1.0, sojourn_s: 1e6 };
        let mut motion = Motion::new(&seen(1.0, 2.0, 0.1), 1.0);
        motion.update(&seen(1.0, 2.5, 0.2));
        let mut slow = motion.merged();
        let before = slow;
        let cross = motion.predict(0.7, &[gait, gait]);
        let step_s = 0.7e-5;
        let mut flow = Matrix4::zeros();
        let mut push = Matrix4::zeros();
        for axis in 0..2 {
            flow[(axis, axis + 2)] = 1.0;
            flow[(axis + 2, axis + 2)] = -1.0 / memory_s;
            push[(axis + 2, axis + 2)] = 2.0;
        }
        let mut transition = Matrix4::identity();
        for _ in 0..100_000 {
            slow.mean += flow * slow.mean * step_s;
            slow.cov += (flow * slow.cov + slow.cov * flow.transpose() + push) * step_s;
            transition += flow * transition * step_s;
        }
        let fast = motion.merged();
        assert!((fast.mean - slow.mean).norm() < 1e-4, "{} {}", fast.mean, slow.mean);
        assert!((fast.cov - slow.cov).norm() < LIMIT, "{} {}", fast.cov, slow.cov);
        assert!((cross - before.cov * transition.transpose()).norm() < 1e-4);
    }
}

#[test]
fn pushes_aside_are_weaker_for_who_walks() {
    let gait = Gait { memory_s: 1.0, push_m2_per_s3: 1.0, aside_share: 0.1, sojourn_s: 1.0 };
    let mut motion = Motion::new(&seen(0.0, 2.0, 0.01), 0.01);
    for step in 1..40 {
        motion.predict(0.1, &[STILL, STILL]);
        motion.update(&seen(0.1 * f64::from(step), 2.0, 0.01));
    }
    let before = motion.merged().cov;
    motion.predict(0.1, &[gait, gait]);
    let grown = motion.merged().cov - before;
    assert!(grown[(3, 3)] < 0.3 * grown[(2, 2)], "{grown}");
}

#[test]
fn an_update_is_bayes_with_precisions() {
    let mut motion = Motion::new(&seen(1.0, 2.0, 0.3), 0.8);
    motion.predict(0.2, &[STILL, STILL]);
    let before = motion.merged();
    let sight =
        Sight { place_m: Vector2::new(1.2, 1.9), cov_m2: Matrix2::new(0.04, 0.01, 0.01, 0.02) };
    motion.update(&sight);
    let precision = before.cov.try_inverse().unwrap();
    let mut more = Matrix4::zeros();
    more.fixed_view_mut::<2, 2>(0, 0).copy_from(&sight.cov_m2.try_inverse().unwrap());
    let cov = (precision + more).try_inverse().unwrap();
    let place = Vector4::new(sight.place_m.x, sight.place_m.y, 0.0, 0.0);
    let mean = cov * (precision * before.mean + more * place);
    let after = motion.merged();
    assert!((after.mean - mean).norm() < ROUNDING && (after.cov - cov).norm() < ROUNDING);
}

#[test]
fn smoothing_is_the_least_squares_of_all_sights_at_once() {
    let places_m = [[0.0, 2.0], [0.15, 2.2], [0.1, 2.5], [0.4, 2.4], [0.5, 2.9]];
    let mut history = History::new();
    let mut motion = Motion::new(&seen(places_m[0][0], places_m[0][1], 0.1), 0.8);
    let start = motion.merged();
    let record = |time_s: f64, predicted: Estimate, cross, filtered: Estimate| Record {
        time_s,
        predicted,
        cross,
        filtered,
    };
    history.push(record(0.0, start, start.cov, start), 1.0);
    // All states in one vector: precision of the start, of the steps and of the sights.
    let mut information = DMatrix::<f64>::zeros(20, 20);
    let mut right = DVector::<f64>::zeros(20);
    let first = start.cov.try_inverse().unwrap();
    information.view_mut((0, 0), (4, 4)).copy_from(&first);
    right.rows_mut(0, 4).copy_from(&(first * start.mean));
    for (index, [x_m, y_m]) in places_m.iter().enumerate().skip(1) {
        let cross = motion.predict(0.1, &[STILL, STILL]);
        let predicted = motion.merged();
        let sight = seen(*x_m, *y_m, 0.1);
        motion.update(&sight);
        let mut transition = Matrix4::identity();
        (transition[(0, 2)], transition[(1, 3)]) = (0.1 - 5e-6, 0.1 - 5e-6);
        (transition[(2, 2)], transition[(3, 3)]) = (1.0 - 1e-4, 1.0 - 1e-4);
        let (pp, pv, vv) = (1e-6 / 3.0, 5e-6, 1e-4);
        let mut noise = Matrix4::from_diagonal(&Vector4::new(pp, pp, vv, vv));
        for axis in 0..2 {
            (noise[(axis, axis + 2)], noise[(axis + 2, axis)]) = (pv, pv);
        }
        let precision = noise.try_inverse().unwrap();
        let at = 4 * (index - 1);
        let mut add = |row: usize, column: usize, block: Matrix4<f64>| {
            let mut part = information.view_mut((row, column), (4, 4));
            part += block;
        };
        add(at, at, transition.transpose() * precision * transition);
        add(at, at + 4, -transition.transpose() * precision);
        add(at + 4, at, -precision * transition);
        add(at + 4, at + 4, precision);
        for axis in 0..2 {
            information[(at + 4 + axis, at + 4 + axis)] += 100.0;
            right[at + 4 + axis] += 100.0 * sight.place_m[axis];
        }
        history.push(record(0.1 * index as f64, predicted, cross, motion.merged()), 1.0);
    }
    let cov = information.try_inverse().unwrap();
    let all = &cov * right;
    let (time_s, smoothed) = history.smoothed().unwrap();
    assert!(time_s.abs() < ROUNDING);
    assert!((smoothed.mean - all.rows(0, 4)).norm() < 1e-3, "{} {all}", smoothed.mean);
    assert!((smoothed.cov - cov.view((0, 0), (4, 4))).norm() < 1e-3, "{}", smoothed.cov);
}

#[test]
fn what_lasts_is_no_noise_and_the_middle_lies_behind() {
    let config = DefaultConfig {
        lasting_sigmas_m: [0.03, 0.04],
        glint_share: 0.5,
        noise_share: 0.8,
        glint_s: 0.2,
        ..DefaultConfig::default()
    };
    let body = BodyModel { half_depth_m: 0.2, glint_m: [0.06, 0.15] };
    let known = |fade: f64| Known { half_depth_m: 0.1, fade, since_s: 0.2, body: &body };
    let point = MeasuredPoint {
        x_m: 0.0,
        y_m: 4.0,
        cov_m2: [0.04, 0.0, 0.01],
        snr_db: 15.0,
        extent_m2: [0.0; 3],
        radial_velocity_m_per_s: None,
    };
    let got = sight(&point, &known(2.0), &config);
    assert!((got.place_m - Vector2::new(0.0, 4.1)).norm() < ROUNDING);
    // The mean of N values of a first-order process, summed up: N var(mean) over the variance.
    let rho = (-1.0_f64).exp();
    let longer = 1.0 + 2.0 * (1..200).map(|lag| rho.powi(lag)).sum::<f64>();
    // Half the mean power: the wander has twice its variance, the noise has not.
    let along_m2 = 0.8 * (0.01 - 0.0036) + 0.5 * 2.0 * longer * (0.0036 - 0.0009);
    let across_m2 = 0.8 * (0.04 - 0.0225) + 0.5 * 2.0 * longer * (0.0225 - 0.0016);
    assert!((got.cov_m2[(1, 1)] - along_m2).abs() < 1e-9, "{}", got.cov_m2);
    assert!((got.cov_m2[(0, 0)] - across_m2).abs() < 1e-9, "{}", got.cov_m2);
    // Beyond the bounds nothing changes any more.
    assert_eq!(sight(&point, &known(10.0), &config), sight(&point, &known(1e9), &config));
    let lasts = lasting_m2(&got.place_m, &config);
    assert!((lasts - Matrix2::new(0.0016, 0.0, 0.0, 0.0009)).norm() < ROUNDING);
}

#[test]
fn a_body_is_deeper_for_one_who_walks_across() {
    let config = DefaultConfig { aspect_share: 0.4, ..DefaultConfig::default() };
    let body = BodyModel { half_depth_m: 0.1, glint_m: [0.0; 2] };
    let place_m = Vector2::new(3.0, 4.0);
    let deep = |x: f64, y: f64| half_depth_m(&place_m, &Vector2::new(x, y), &body, &config);
    // Fast, along the line of sight both ways, and across it: 0.1 ∓ 0.04 but for 0.3² / 100².
    for (sign, along) in [(1.0, -1.0), (-1.0, 1.0)] {
        assert!((deep(sign * 60.0, sign * 80.0) - 0.06).abs() < 1e-6);
        assert!((deep(along * 80.0, -along * 60.0) - 0.14).abs() < 1e-6);
    }
    assert!((deep(0.0, 0.0) - 0.1).abs() < ROUNDING);
    // At 45 degrees to it, and half of it at the speed that counts as half walking.
    assert!((deep(-10.0, 70.0) - 0.1).abs() < ROUNDING);
    assert!((deep(0.18, 0.24) - 0.08).abs() < ROUNDING);
}

#[test]
fn a_look_finds_the_hill_and_not_a_flank_or_somebody_else() {
    let grid = Grid { x_min_m: -3.0, y_min_m: 1.0, pixel_m: 0.1, column_count: 61, row_count: 61 };
    let hill = |x_m: f64, y_m: f64, height: f64, index: usize| {
        let off =
            Vector2::new((grid.x_m(index % 61) - x_m) / 0.4, (grid.y_m(index / 61) - y_m) / 0.2);
        height * (-off.norm_squared()).exp()
    };
    let value =
        |index| crate::imaging::single(hill(-0.63, 4.04, 1.0, index) + hill(1.0, 4.0, 3.0, index));
    let amplitude: Vec<f32> = (0..grid.pixel_count()).map(value).collect();
    let raster = Raster { amplitude: &amplitude, column_count: 61, row_count: 61 };
    let picture = Picture { raster, grid };
    let window = |x_m: f64| Window { middle_m: Vector2::new(x_m, 4.0), range_m: 0.4, sine: 0.2 };
    let template = picture.template(&Vector2::new(1.0, 4.0), &[0.06, 0.0, 0.02]).unwrap();
    let peak = picture.peak(&window(-0.5), 0.2, &[]).unwrap();
    assert!((peak.0 - Vector2::new(-0.6, 4.0)).norm() < 0.06);
    let found = picture.shifted(peak, &template).unwrap();
    assert!((found.place_m - Vector2::new(-0.63, 4.04)).norm() < 0.06, "{found:?}");
    assert!(0.6 < found.likeness, "{found:?}");
    // Too dark, somebody else's, and the flank of a higher hill.
    assert_eq!(picture.peak(&window(-0.5), 1.5, &[]), None);
    assert_eq!(picture.peak(&window(-0.5), 0.2, &[Vector2::new(-0.62, 4.0)]), None);
    assert_eq!(picture.peak(&Window { sine: 0.05, ..window(0.6) }, 0.2, &[]), None);
}
