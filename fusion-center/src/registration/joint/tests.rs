//! Tests of the joint fit against dense least squares, and of when it must not answer.

use nalgebra::{DMatrix, DVector, Matrix2, SMatrix};
use proto::geom::{Gaussian, Node, Point, Ref};

use super::super::modes::refine;
use super::super::prepared::Motion;
use super::passes::{Pass, filtered};
use super::scans::{ACROSS_RATIO, Offsets, Side};
use super::tracks::{Member, Way};
use super::*;
use crate::simulate::{Conditions, Trial, large_room, trial};

/// Relative difference that rounding may cause in sums of some 20 terms.
const SAME: f64 = 1e-8;

fn point<F: proto::geom::Frame>(x: f64, y: f64, cov: [f64; 3]) -> Gaussian<F> {
    let cov_m2 = Matrix2::new(cov[0], cov[1], cov[1], cov[2]);
    Gaussian { mean: Point::new(x, y), cov_m2 }
}

/// One target seen at uneven times, the sides not at once, with one-sided periods.
fn one_target() -> Problem {
    let mut problem = Problem {
        periods: Vec::new(),
        ref_half_depth_sigma_m: 0.05,
        node_half_depth_sigma_m: 0.08,
    };
    for k in 0..6 {
        let (at, bend) = (f64::from(k), 0.03 * f64::from(k * k % 5));
        let mut period =
            Period { ref_time_s: at * 0.7, node_time_s: at * 0.7 + 0.2, ..Period::default() };
        if k != 2 {
            period.in_ref.push(point::<Ref>(1.0 + 0.5 * at, 4.0 + bend, [0.02, 0.004, 0.01]));
        }
        if k != 4 {
            period.in_node.push(point::<Node>(-2.0 + bend, 3.0 + 0.4 * at, [0.01, -0.003, 0.03]));
        }
        problem.periods.push(period);
    }
    problem
}

fn members(scans: &Scans) -> Vec<Member> {
    (0..scans.points.len()).map(|point| Member { point, way: Way::Straight }).collect()
}

/// Covariance of a double integrator's positions at `a` and `b` seconds after its start.
fn walk_covariance(a: f64, b: f64, noise_m2ps3: f64) -> f64 {
    let (early, late) = (a.min(b), a.max(b));
    VELOCITY_SIGMA_MPS.powi(2) * a * b
        + noise_m2ps3 * (early.powi(3) / 3.0 + early.powi(2) * (late - early) / 2.0)
}

/// `[y V]ᵀ Σ⁻¹ [y V]` with the unknown start eliminated, from the covariance of all points at once.
fn dense(setting: &Setting<'_>, offsets: &Offsets, noise_m2ps3: f64) -> SMatrix<f64, 8, 8> {
    let seen: Vec<_> = setting
        .points
        .iter()
        .map(|p| p.observed::<8>(&setting.motion, offsets, setting.covariance_scale))
        .collect();
    let start_s = seen[0].time_s;
    let count = 2 * seen.len();
    let cov = DMatrix::from_fn(count, count, |r, c| {
        let (one, other) = (&seen[r / 2], &seen[c / 2]);
        let same_axis = f64::from(u8::from(r % 2 == c % 2));
        let own = if r / 2 == c / 2 { one.cov_m2[(r % 2, c % 2)] } else { 0.0 };
        let walk = walk_covariance(one.time_s - start_s, other.time_s - start_s, noise_m2ps3);
        own + same_axis * walk
    });
    let columns = DMatrix::from_fn(count, 8, |r, c| seen[r / 2].columns[c][r % 2]);
    let start = DMatrix::from_fn(count, 2, |r, c| f64::from(u8::from(r % 2 == c)));
    let precision = cov.try_inverse().unwrap();
    let (ys, ss) = (&precision * &columns, &precision * &start);
    let eliminated = (start.transpose() * &ss).try_inverse().unwrap();
    let cross = columns.transpose() * &ss;
    let normal = columns.transpose() * ys - &cross * eliminated * cross.transpose();
    SMatrix::from_fn(|r, c| normal[(r, c)])
}

fn setting(scans: &Scans) -> Setting<'_> {
    Setting {
        points: &scans.points,
        motion: Motion::new(3.0, 2.0, -1.2),
        covariance_scale: 1.3,
        outlier_log_density: f64::NEG_INFINITY,
    }
}

#[test]
fn the_filter_is_dense_least_squares_over_the_whole_walk() {
    let scans = Scans::new(&one_target());
    let (setting, offsets) = (setting(&scans), [0.7, -0.4, -0.9, 0.5]);
    for noise_m2ps3 in [0.0, 0.02, 0.7] {
        let pass: Pass<8> = filtered(&setting, &members(&scans), (noise_m2ps3, &offsets));
        let expected = dense(&setting, &offsets, noise_m2ps3);
        for (r, c) in (0..8).flat_map(|c| (0..=c).map(move |r| (r, c))) {
            let scale = (expected[(r, r)] * expected[(c, c)]).sqrt();
            let apart = (pass.normal[(r, c)] - expected[(r, c)]).abs();
            assert!(apart < SAME * scale, "{noise_m2ps3} {r} {c}: {apart} of {scale}");
        }
        assert_eq!(pass.used_count, scans.points.len() - 1);
    }
}

#[test]
fn a_point_beyond_a_gate_is_beyond_it_by_its_mahalanobis_distance() {
    /// As in the tracks.
    const GATE: f64 = 16.0;
    let scans = Scans::new(&one_target());
    let motion = Motion::new(3.0, 2.0, -1.2);
    let seen: Vec<_> =
        scans.points.iter().map(|p| p.observed::<1>(&motion, &[0.0; 4], 1.0)).collect();
    let mut beyond_count = 0;
    for (first, added_m2) in seen.iter().flat_map(|first| [(first, 0.0), (first, 0.2)]) {
        let state = filter::State::starting(first, VELOCITY_SIGMA_MPS);
        for point in seen.iter().filter(|point| state.is_beyond(point, (GATE, added_m2))) {
            let cov = first.cov_m2 + point.cov_m2 + Matrix2::identity() * added_m2;
            let apart = point.columns[0] - first.columns[0];
            let chi_square = apart.dot(&(cov.try_inverse().unwrap() * apart));
            assert!(chi_square > GATE, "{chi_square}");
            beyond_count += 1;
        }
    }
    assert!(beyond_count > 10, "{beyond_count}");
}

#[test]
fn columns_are_the_derivatives_of_the_value() {
    /// Second order of a step of 1e-6 at 5 m, and rounding over it.
    const SLOPE_ERROR: f64 = 1e-5;
    const STEP: f64 = 1e-6;
    let scans = Scans::new(&one_target());
    let motion = Motion::new(3.0, 2.0, -1.2);
    for seen in &scans.points {
        let offsets = [0.3, 0.6, -0.8, 0.4];
        let at = seen.observed::<8>(&motion, &offsets, 1.0);
        for unknown in 0..7 {
            let mut step = SMatrix::<f64, 7, 1>::zeros();
            step[unknown] = STEP;
            let moved = motion.plus(&step.fixed_rows::<3>(0).into_owned());
            let shifted = std::array::from_fn(|k| offsets[k] + step[3 + k]);
            let there = seen.observed::<1>(&moved, &shifted, 1.0);
            let slope = (there.columns[0] - at.columns[0]) / STEP;
            assert!((slope - at.columns[unknown + 1]).norm() < SLOPE_ERROR, "{unknown}");
        }
    }
    for (side, sigma_m) in [(Side::Ref, 0.05), (Side::Node, 0.08)] {
        let seen = scans.points.iter().find(|p| p.side == side).unwrap();
        let columns = seen.observed::<8>(&motion, &[0.0; 4], 1.0).columns;
        let [along, across] = [columns[4 + side as usize], columns[6 + side as usize]];
        assert!((along.norm() - sigma_m).abs() < 1e-12);
        assert!((across.norm() - sigma_m * ACROSS_RATIO).abs() < 1e-12);
        assert!(along.dot(&across).abs() < 1e-15 && along.perp(&across) > 0.0);
        let cov_m2 = along * along.transpose() + across * across.transpose();
        assert!((seen.offset_cov_m2(&motion) - cov_m2).norm() < 1e-15);
    }
}

/// The pose covariance from all unknowns at once: pose, shared offsets, own offsets of each track.
fn dense_covariance(normals: &[SMatrix<f64, 8, 8>]) -> DMatrix<f64> {
    let count = 5 + 4 * normals.len();
    let mut information = DMatrix::zeros(count, count);
    for (index, normal) in normals.iter().enumerate() {
        let place = DMatrix::from_fn(7, count, |r, c| {
            let own = r >= 3 && c == 5 + 4 * index + r - 3;
            f64::from(u8::from(r < 5 && r == c || own))
        });
        let part = DMatrix::from_fn(7, 7, |r, c| normal[(r.min(c) + 1, r.max(c) + 1)]);
        information += place.transpose() * part * place;
    }
    let prior = DVector::from_fn(count, |r, _| match r {
        0..3 => 0.0,
        3..5 => 1.0 / fit::COMMON_SHARE,
        _ if (r - 5) % 4 < 2 => 1.0 / (1.0 - fit::COMMON_SHARE),
        _ => 1.0,
    });
    (information + DMatrix::from_diagonal(&prior)).try_inverse().unwrap()
}

#[test]
fn offsets_cost_what_they_cost_when_all_are_unknowns() {
    let mut case = trial(&Conditions::CLEAN, 5);
    case.problem.ref_half_depth_sigma_m = 0.04;
    case.problem.node_half_depth_sigma_m = 0.02;
    let scans = Scans::new(&case.problem);
    let all = members(&scans);
    // Two tracks that stand for two targets; straight walks, as the points of one alternate.
    let of = |rest: usize| all.iter().filter(|m| m.point % 2 == rest).copied().collect();
    let tracks: Vec<Track> =
        (0..2).map(|rest| Track { members: of(rest), is_established: true }).collect();
    let truth = case.truth();
    let setting = Setting {
        motion: Motion::new(truth.x, truth.y, truth.z),
        covariance_scale: 1.0,
        ..setting(&scans)
    };
    let joint = fit::<8>(&setting, &tracks).unwrap();
    let at = Setting { motion: joint.motion, ..setting };
    let normals: Vec<_> = tracks
        .iter()
        .map(|track| filtered::<8>(&at, &track.members, (0.0, &[0.0; 4])).normal)
        .collect();
    let expected = dense_covariance(&normals);
    for index in 0..5 {
        let ratio = joint.covariance[(index, index)] / expected[(index, index)];
        // The fit's columns were taken one small step and its offsets before.
        assert!((ratio - 1.0).abs() < 0.03, "{index}: {ratio}");
    }
}

fn start(case: &Trial) -> (Prepared, Mode, PoseEstimate) {
    let data = Prepared::new(&case.problem);
    let truth = case.truth();
    let mode = refine(&data, Motion::new(truth.x, truth.y, truth.z)).unwrap();
    let estimate =
        PoseEstimate { pose_ref_from_node: mode.motion.pose(), covariance: mode.covariance };
    (data, mode, estimate)
}

#[test]
fn tracks_are_the_targets_of_the_scene() {
    let case = trial(&Conditions::CLEAN, 3);
    let (data, mode, estimate) = start(&case);
    let scans = Scans::new(&case.problem);
    let ground = Ground {
        motion: mode.motion,
        pose_covariance: estimate.covariance,
        covariance_scale: 1.0,
        log_density: (2.0 / data.area_m2).ln(),
    };
    let tracks = form_tracks(&scans, &ground);
    // Every scan lists the two targets in the same order.
    let parities: Vec<Vec<usize>> =
        tracks.iter().map(|t| t.members.iter().map(|m| m.point % 2).collect()).collect();
    assert_eq!(parities.len(), 2);
    assert!(parities.iter().all(|p| p.len() == 16 && p.iter().all(|rest| *rest == p[0])));
    assert!(tracks.iter().all(|track| track.is_established));
}

#[test]
fn points_scattered_anew_or_without_time_have_no_joint_fit() {
    let scattered = large_room(2, 60);
    let (data, mode, estimate) = start(&scattered);
    assert!(joined(&scattered.problem, &data, (&mode, &estimate, 1.0)).is_none());
    let mut case = trial(&Conditions::MISSES, 4);
    let (paper_data, paper_mode, paper_estimate) = start(&case);
    assert!(joined(&case.problem, &paper_data, (&paper_mode, &paper_estimate, 1.0)).is_some());
    for period in &mut case.problem.periods {
        (period.ref_time_s, period.node_time_s) = (3.0, 3.0);
    }
    assert!(joined(&case.problem, &paper_data, (&paper_mode, &paper_estimate, 1.0)).is_none());
}

#[test]
fn a_pose_that_the_pairwise_one_excludes_is_no_answer() {
    let case = trial(&Conditions::CLEAN, 6);
    let (data, mode, estimate) = start(&case);
    let good = joined(&case.problem, &data, (&mode, &estimate, 1.0)).unwrap();
    let pose = &estimate.pose_ref_from_node;
    let shift = pose.translation_m();
    let elsewhere = PoseEstimate {
        pose_ref_from_node: Motion::new(shift.x + 1.0, shift.y, pose.heading_rad()).pose(),
        ..estimate
    };
    assert!(joined(&case.problem, &data, (&mode, &elsewhere, 1.0)).is_none());
    assert!((good.covariance_inflation - 1.0).abs() < f64::EPSILON);
}

#[test]
fn points_of_periods_that_one_side_missed_sharpen_the_pose() {
    let mut case = trial(&Conditions::CLEAN, 7);
    for (index, period) in case.problem.periods.iter_mut().enumerate() {
        match index {
            1 | 4 => period.in_ref.clear(),
            2 | 6 => period.in_node.clear(),
            _ => {}
        }
    }
    let (data, mode, estimate) = start(&case);
    let spread = |problem: &Problem| {
        let joint = joined(problem, &data, (&mode, &estimate, 1.0)).unwrap();
        joint.estimate.covariance.determinant()
    };
    let all = spread(&case.problem);
    let mut shared = case.problem.clone();
    shared.periods.retain(|p| !p.in_ref.is_empty() && !p.in_node.is_empty());
    assert!(all < 0.7 * spread(&shared), "{all} {}", spread(&shared));
}

#[test]
fn periods_that_lie_minutes_apart_are_no_neighbours() {
    let at = |time_s: f64| Period { ref_time_s: time_s, node_time_s: time_s, ..Period::default() };
    let times_s = [0.0, 1.0, 2.0, 3.0, 63.0, 64.0, 1e9];
    let mut problem = Problem { periods: times_s.map(at).to_vec(), ..Problem::default() };
    for period in &mut problem.periods {
        let cov_m2 = Matrix2::identity() * 0.01;
        period.in_ref.push(Gaussian { mean: Point::new(1.0, 2.0), cov_m2 });
    }
    let found: Vec<usize> = Scans::new(&problem).scans.iter().map(|s| s.period_index).collect();
    assert_eq!(found, [0, 1, 2, 3, 63, 64, 164]);
}
