//! Rooms with walkers who turn, offsets, asynchronous nodes and clutter: how true the covariance is.

use nalgebra::Vector2;
use rand::RngExt;

use super::super::degenerate_tests::{walkers, wanderers};
use super::super::{Outcome, Pairwise, Problem, Solver};
use super::scans::ACROSS_RATIO;
use crate::simulate::{Conditions, Paths, Sampler, Trial, paper_paths};

/// How a room is drawn.
#[derive(Clone, Copy)]
struct Room {
    name: &'static str,
    conditions: Conditions,
    period_count: usize,
    walk: Walk,
    /// Seconds by which the node measures later.
    late_s: f64,
    /// Standard deviations, metres, of the offset along the line of sight common to a side and of
    /// that of each target. Each target is also off across it.
    offset_sigmas_m: [f64; 2],
}

#[derive(Clone, Copy, PartialEq)]
enum Walk {
    Paper,
    Corners,
    Smooth,
}

/// Where a path of equal steps is at a fraction of a step later.
fn shifted(paths: &Paths, part: f64) -> Paths {
    let at = |k: usize| {
        let next = &paths[(k + 1).min(paths.len() - 1)];
        paths[k].iter().zip(next).map(|(a, b)| a.lerp(b, part)).collect()
    };
    (0..paths.len()).map(at).collect()
}

/// Every target off by its `[along, across]` of the line of sight.
fn displaced(paths: &Paths, from: Vector2<f64>, offsets_m: &[[f64; 2]]) -> Paths {
    let moved = |targets: &Vec<Vector2<f64>>| {
        let one = |(p, [along_m, across_m]): (&Vector2<f64>, &[f64; 2])| {
            let sight = (p - from).normalize();
            p + sight * *along_m + Vector2::new(-sight.y, sight.x) * *across_m
        };
        targets.iter().zip(offsets_m).map(one).collect()
    };
    paths.iter().map(moved).collect()
}

impl Room {
    fn draw(&self, seed: u64) -> Trial {
        let mut sampler = Sampler::new(seed);
        let period_s = self.conditions.period_s;
        let paths: Paths = match self.walk {
            Walk::Paper => paper_paths(),
            Walk::Corners => walkers(period_s, self.period_count)(&mut sampler),
            Walk::Smooth => wanderers(&mut sampler)[..self.period_count].to_vec(),
        };
        let [side, own] = self.offset_sigmas_m;
        let mut offsets = || {
            let common = side * sampler.normal();
            let across = ACROSS_RATIO * side.hypot(own);
            let mut one = || [common + own * sampler.normal(), across * sampler.normal()];
            (0..paths[0].len()).map(|_| one()).collect::<Vec<_>>()
        };
        let (of_ref, of_node) = (offsets(), offsets());
        let noise_seed = sampler.rng.random::<u64>();
        let late = shifted(&paths, self.late_s / period_s);
        let in_ref = displaced(&paths, Vector2::new(5.0, 0.0), &of_ref);
        let in_node = displaced(&late, Vector2::new(0.0, 5.0), &of_node);
        let mut case = Sampler::new(noise_seed).observe(&in_ref, &self.conditions);
        let other = Sampler::new(noise_seed).observe(&in_node, &self.conditions);
        for (period, late_one) in case.problem.periods.iter_mut().zip(other.problem.periods) {
            period.in_node = late_one.in_node;
            period.node_time_s += self.late_s;
        }
        let sigma_m = side.hypot(own);
        case.problem.ref_half_depth_sigma_m = sigma_m;
        case.problem.node_half_depth_sigma_m = sigma_m;
        case
    }
}

/// The same problem without times, in which the joint fit does not run.
fn timeless(problem: &Problem) -> Problem {
    let mut problem = problem.clone();
    for period in &mut problem.periods {
        (period.ref_time_s, period.node_time_s) = (0.0, 0.0);
    }
    problem
}

#[derive(Debug, Default)]
struct Figures {
    determined: usize,
    joined: usize,
    gross: usize,
    /// RMSE over the bound of the true pairs.
    ratio: f64,
    pairwise_ratio: f64,
    nees: f64,
    pairwise_nees: f64,
    /// Trials in which the joint pose is off by a fifth more than the pairwise one.
    worse_count: usize,
    mean_inflation: f64,
}

fn figures(room: &Room, seeds: std::ops::Range<u64>) -> Figures {
    let solver = Pairwise::default();
    let mut f = Figures::default();
    let (mut squares, mut old_squares, mut bounds) = (0.0, 0.0, 0.0);
    for seed in seeds {
        let case = room.draw(seed);
        let solution = solver.solve(&case.problem, None);
        let old = solver.solve(&timeless(&case.problem), None);
        let (Some(estimate), Some(before), Some(bound)) =
            (solution.estimate, old.estimate, case.bound())
        else {
            continue;
        };
        if solution.outcome != Outcome::Determined {
            continue;
        }
        f.determined += 1;
        f.joined += usize::from(estimate != before);
        let (e, o) = (case.error(&estimate), case.error(&before));
        f.gross += usize::from(e.xy().norm() > 0.5);
        squares += e.xy().norm_squared();
        old_squares += o.xy().norm_squared();
        bounds += bound[(0, 0)] + bound[(1, 1)];
        f.nees += case.nees(&estimate);
        f.pairwise_nees += case.nees(&before);
        f.mean_inflation += solution.evidence.covariance_inflation;
        f.worse_count += usize::from(e.xy().norm() > 1.2 * o.xy().norm());
    }
    let n = f.determined as f64;
    f.ratio = (squares / bounds).sqrt();
    f.pairwise_ratio = (old_squares / bounds).sqrt();
    f.nees /= n;
    f.pairwise_nees /= n;
    f.mean_inflation /= n;
    f
}

const CLEAR: Conditions = Conditions {
    detection_probability: 0.9,
    false_probability: 0.1,
    noise_scale: 1.0,
    period_s: 0.5,
};
const ROUGH: Conditions = Conditions {
    detection_probability: 0.6,
    false_probability: 0.5,
    noise_scale: 2.5,
    period_s: 0.5,
};

fn rooms() -> Vec<Room> {
    let base = Room {
        name: "corners",
        conditions: CLEAR,
        period_count: 40,
        walk: Walk::Corners,
        late_s: 0.0,
        offset_sigmas_m: [0.0; 2],
    };
    let fast = Conditions { period_s: 0.1, ..CLEAR };
    let smooth = Conditions { period_s: 0.2, ..CLEAR };
    let paper = Room {
        name: "paper",
        walk: Walk::Paper,
        conditions: Conditions::WITH_FALSE_POINTS,
        period_count: 8,
        ..base
    };
    vec![
        base,
        Room { name: "corners fast", conditions: fast, period_count: 150, ..base },
        Room { name: "corners rough", conditions: ROUGH, ..base },
        Room { name: "smooth", conditions: smooth, period_count: 100, walk: Walk::Smooth, ..base },
        Room {
            name: "smooth rough",
            conditions: Conditions { period_s: 0.2, ..ROUGH },
            period_count: 200,
            walk: Walk::Smooth,
            ..base
        },
        Room { name: "late 50 ms", late_s: 0.05, ..base },
        Room { name: "late 250 ms", late_s: 0.25, ..base },
        Room { name: "paper late .3", late_s: 0.3, ..paper },
        Room {
            name: "smooth late",
            conditions: smooth,
            period_count: 100,
            walk: Walk::Smooth,
            late_s: 0.1,
            ..base
        },
        Room { name: "paper side", offset_sigmas_m: [0.04, 0.0], ..paper },
        Room { name: "paper own", offset_sigmas_m: [0.0, 0.04], ..paper },
        Room { name: "paper half", offset_sigmas_m: [0.0283, 0.0283], ..paper },
        Room { name: "corners side", offset_sigmas_m: [0.04, 0.0], ..base },
        Room { name: "corners own", offset_sigmas_m: [0.0, 0.04], ..base },
        Room { name: "corners half", offset_sigmas_m: [0.0283, 0.0283], ..base },
        Room {
            name: "corners rough own late",
            offset_sigmas_m: [0.0, 0.04],
            conditions: ROUGH,
            late_s: 0.05,
            ..base
        },
    ]
}

fn room(name: &str) -> Room {
    rooms().into_iter().find(|room| room.name == name).unwrap()
}

#[test]
fn covariances_are_true_where_walkers_turn_and_offsets_last() {
    // Means of a chi-square of 3 over so many trials: outside with chance 1e-3 each.
    for (name, count, bounds) in [
        ("corners", 30, (1.7, 4.7)),
        ("smooth", 20, (1.5, 5.2)),
        ("late 250 ms", 20, (1.5, 5.2)),
        ("corners half", 20, (1.5, 5.2)),
        ("paper half", 200, (2.5, 3.65)),
        ("paper side", 200, (2.5, 3.65)),
        ("paper own", 200, (2.5, 3.65)),
    ] {
        let f = figures(&room(name), 2000..2000 + count);
        println!("{name}: {f:?}");
        // Pairs know nothing of offsets across the line of sight, and so exclude some right poses: of
        // 150 rooms with corners and offsets on other seeds 141 were joined.
        let has_offsets = room(name).offset_sigmas_m.iter().any(|sigma_m| *sigma_m > 0.0);
        let least = if has_offsets { 17 } else { 19 };
        assert!(f.joined * 20 >= f.determined * least && f.gross == 0, "{name} {f:?}");
        assert!((bounds.0..bounds.1).contains(&f.nees), "{name} {f:?}");
        assert!(f.ratio < 1.1 * f.pairwise_ratio, "{name} {f:?}");
    }
}

#[test]
#[ignore = "minutes: figures of many rooms"]
fn study_rooms() {
    for room in rooms() {
        println!("{}: {:?}", room.name, figures(&room, 3000..3150));
    }
}
