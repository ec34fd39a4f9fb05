//! Time per registration: the paper's scene, an office, many periods, each from nothing and from
//! what the last solution found, and the particle swarm.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use fusion_center::registration::{
    DecisionConfig, Pairwise, Period, Problem, Solver, Swarm, SwarmConfig,
};
use nalgebra::{Matrix2, Vector2};
use proto::geom::{Frame, Gaussian, Node, Point, Ref, Se2};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

/// Points per period, how many periods, standard deviation per axis, chance of a false point.
struct Size {
    period_count: usize,
    target_count: usize,
    sigma_m: f64,
    false_probability: f64,
}

fn noisy<F: Frame>(at: Point<F>, size: &Size, rng: &mut ChaCha8Rng) -> Gaussian<F> {
    // The sum of twelve uniform numbers less six is close enough to a normal one here.
    let mut normal = || (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
    let noise = Vector2::new(normal(), normal()) * size.sigma_m;
    let cov_m2 = Matrix2::identity() * size.sigma_m.powi(2);
    Gaussian { mean: Point::from_coords(at.coords_m + noise), cov_m2 }
}

fn problem(size: &Size) -> Problem {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let pose_node_from_ref = Se2::<Ref, Node>::new(-5.0, 5.0, -1.3).inverse();
    let mut periods = vec![Period::default(); size.period_count];
    for (k, period) in periods.iter_mut().enumerate() {
        (period.ref_time_s, period.node_time_s) = (k as f64, k as f64);
        for index in 0..=size.target_count {
            let mut draw =
                || Point::<Ref>::new(rng.random_range(-4.0..4.0), rng.random_range(1.0..9.0));
            let (here, elsewhere) = (draw(), draw());
            let is_false = index == size.target_count;
            if is_false && rng.random::<f64>() > size.false_probability {
                continue;
            }
            let there = if is_false { elsewhere } else { here };
            period.in_ref.push(noisy(here, size, &mut rng));
            period.in_node.push(noisy(pose_node_from_ref * there, size, &mut rng));
        }
    }
    Problem { periods, ..Problem::default() }
}

fn benches(criterion: &mut Criterion) {
    let sizes = [
        (
            "paper_8x2",
            Size { period_count: 8, target_count: 2, sigma_m: 0.02, false_probability: 0.1 },
        ),
        (
            "office_30x3",
            Size { period_count: 30, target_count: 3, sigma_m: 0.1, false_probability: 0.3 },
        ),
        (
            "room_300x5",
            Size { period_count: 300, target_count: 5, sigma_m: 0.1, false_probability: 0.3 },
        ),
    ];
    let mut group = criterion.benchmark_group("registration");
    group.sample_size(20);
    for (name, size) in &sizes {
        let input = problem(size);
        let solver = Pairwise::default();
        group.bench_function(format!("default/{name}"), |b| {
            b.iter(|| solver.solve(black_box(&input), None));
        });
        let known = solver.solve(&input, None).known;
        group.bench_function(format!("default_known/{name}"), |b| {
            b.iter(|| solver.solve(black_box(&input), Some(black_box(&known))));
        });
    }
    let input = problem(&sizes[0].1);
    let swarm = Swarm::new(SwarmConfig::default(), DecisionConfig::default());
    group.sample_size(10);
    group.bench_function("swarm/paper_8x2", |b| b.iter(|| swarm.solve(black_box(&input), None)));
    group.finish();
}

criterion_group!(registration, benches);
criterion_main!(registration);
