//! Time per registration against periods, points per period and nodes, from nothing and resumed,
//! beside the particle swarm where that is bearable. One thread each: a problem at a time.
//!
//! `cargo bench --bench registration` takes about two minutes.

use std::collections::BTreeMap;
use std::hint::black_box;
use std::time::Duration;

use criterion::measurement::WallTime;
use criterion::{BenchmarkGroup, Criterion, criterion_group, criterion_main};
use fusion_center::network::{NodeView, SeenSet, SiteProblem, solve_site};
use fusion_center::registration::{
    DecisionConfig, Pairwise, Period, Problem, Solver, Swarm, SwarmConfig,
};
use fusion_center::simulate::{Conditions, trial};
use nalgebra::{Matrix2, Vector2};
use proto::geom::{Frame, Gaussian, Node, Point, Ref, Se2};
use proto::ids::NodeId;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rayon::ThreadPoolBuilder;

/// How many periods, targets and false points per period and side, standard deviation per axis.
#[derive(Clone, Copy)]
struct Size {
    period_count: usize,
    target_count: usize,
    false_count: usize,
    sigma_m: f64,
}

/// A scene with targets at new places in every period, each seen with a chance of 0.9.
struct Scene {
    rng: ChaCha8Rng,
    size: Size,
}

impl Scene {
    fn new(size: Size) -> Self {
        Self { rng: ChaCha8Rng::seed_from_u64(1), size }
    }

    fn place(&mut self) -> Point<Ref> {
        Point::new(self.rng.random_range(-4.0..4.0), self.rng.random_range(1.0..9.0))
    }

    /// What a side at `pose_ref_from_side` measures of `targets`, with its false points.
    fn seen<F: Frame>(
        &mut self,
        pose_side_from_ref: Se2<F, Ref>,
        targets: &[Point<Ref>],
    ) -> Vec<Gaussian<F>> {
        let mut places: Vec<Point<Ref>> =
            targets.iter().filter(|_| self.rng.random::<f64>() < 0.9).copied().collect();
        for _ in 0..self.size.false_count {
            places.push(self.place());
        }
        places.iter().map(|place| self.noisy(pose_side_from_ref * *place)).collect()
    }

    fn noisy<F: Frame>(&mut self, at: Point<F>) -> Gaussian<F> {
        let sigma_m = self.size.sigma_m;
        // The sum of twelve uniform numbers less six is close enough to a normal one here.
        let mut normal = || (0..12).map(|_| self.rng.random::<f64>()).sum::<f64>() - 6.0;
        let noise = Vector2::new(normal(), normal()) * sigma_m;
        let cov_m2 = Matrix2::identity() * sigma_m.powi(2);
        Gaussian { mean: Point::from_coords(at.coords_m + noise), cov_m2 }
    }

    fn targets(&mut self) -> Vec<Point<Ref>> {
        (0..self.size.target_count).map(|_| self.place()).collect()
    }
}

fn problem(size: Size) -> Problem {
    let mut scene = Scene::new(size);
    let pose_ref_from_node = Se2::<Ref, Node>::new(-5.0, 5.0, -1.3);
    let mut periods = vec![Period::default(); size.period_count];
    for (k, period) in periods.iter_mut().enumerate() {
        (period.ref_time_s, period.node_time_s) = (k as f64, k as f64);
        let targets = scene.targets();
        period.in_ref = scene.seen(Se2::identity(), &targets);
        period.in_node = scene.seen(pose_ref_from_node.inverse(), &targets);
    }
    Problem { periods, ..Problem::default() }
}

/// Nodes around a room that all see the same two targets over eight periods.
fn site(node_count: usize) -> SiteProblem {
    let size = Size { period_count: 8, target_count: 2, false_count: 0, sigma_m: 0.02 };
    let mut scene = Scene::new(size);
    let names: Vec<NodeId> =
        (0..node_count).filter_map(|index| format!("n{index:03}").parse().ok()).collect();
    let mut views: BTreeMap<NodeId, NodeView> =
        names.iter().map(|name| (name.clone(), NodeView::default())).collect();
    for k in 0..size.period_count {
        let targets = scene.targets();
        for (index, view) in views.values_mut().enumerate() {
            let turn = index as f64 * 0.7;
            let pose = Se2::<Ref, Node>::new(5.0 * turn.sin(), 5.0 - 5.0 * turn.cos(), turn);
            let points = scene.seen(pose.inverse(), &targets);
            view.sets.insert(k as i64, SeenSet { time_s: k as f64, points });
        }
    }
    SiteProblem { reference: names[0].clone(), views }
}

fn swarm() -> Swarm {
    Swarm::new(SwarmConfig::default(), DecisionConfig::default())
}

/// From nothing and resumed. The place for further settings of the default solver, such as the
/// certificate: one more line each.
fn bench_default(group: &mut BenchmarkGroup<'_, WallTime>, name: &str, input: &Problem) {
    let solver = Pairwise::default();
    group.bench_function(format!("{name}/default"), |b| {
        b.iter(|| solver.solve(black_box(input), None));
    });
    let known = solver.solve(input, None).known;
    group.bench_function(format!("{name}/resumed"), |b| {
        b.iter(|| solver.solve(black_box(input), Some(black_box(&known))));
    });
}

fn bench_swarm(group: &mut BenchmarkGroup<'_, WallTime>, name: &str, input: &Problem) {
    let solver = swarm();
    let Ok(pool) = ThreadPoolBuilder::new().num_threads(1).build() else { return };
    group.bench_function(format!("{name}/swarm"), |b| {
        b.iter(|| pool.install(|| solver.solve(black_box(input), None)));
    });
}

fn short<'a>(criterion: &'a mut Criterion, name: &str) -> BenchmarkGroup<'a, WallTime> {
    let mut group = criterion.benchmark_group(name);
    group.sample_size(10);
    group.warm_up_time(Duration::from_millis(200));
    group.measurement_time(Duration::from_millis(800));
    group
}

fn paper(criterion: &mut Criterion) {
    let mut group = short(criterion, "paper");
    for (name, conditions) in [
        ("clean", Conditions::CLEAN),
        ("misses", Conditions::MISSES),
        ("false_points", Conditions::WITH_FALSE_POINTS),
    ] {
        bench_default(&mut group, name, &trial(&conditions, 1).problem);
    }
    bench_swarm(&mut group, "clean", &trial(&Conditions::CLEAN, 1).problem);
    group.finish();
}

fn periods(criterion: &mut Criterion) {
    let mut group = short(criterion, "periods");
    for period_count in [8, 32, 125, 500, 1000] {
        let size = Size { period_count, target_count: 5, false_count: 0, sigma_m: 0.1 };
        bench_default(&mut group, &format!("{period_count}x5"), &problem(size));
    }
    let office = Size { period_count: 30, target_count: 3, false_count: 0, sigma_m: 0.1 };
    bench_default(&mut group, "office_30x3", &problem(office));
    group.finish();
}

fn points(criterion: &mut Criterion) {
    let mut group = short(criterion, "points");
    for target_count in [2, 5, 10, 20, 50] {
        let size = Size { period_count: 8, target_count, false_count: 0, sigma_m: 0.05 };
        bench_default(&mut group, &format!("8x{target_count}"), &problem(size));
    }
    let clutter = Size { period_count: 30, target_count: 2, false_count: 4, sigma_m: 0.05 };
    bench_default(&mut group, "30x2_and_4_false", &problem(clutter));
    group.finish();
}

fn nodes(criterion: &mut Criterion) {
    let mut group = short(criterion, "nodes");
    let solver = Pairwise::default();
    for node_count in [2, 8, 32, 100] {
        let input = site(node_count);
        group.bench_function(format!("{node_count}/default"), |b| {
            b.iter(|| solve_site(black_box(&input), &solver));
        });
    }
    let pair = site(2);
    if let Ok(pool) = ThreadPoolBuilder::new().num_threads(1).build() {
        group.bench_function("2/swarm", |b| {
            b.iter(|| pool.install(|| solve_site(black_box(&pair), &swarm())));
        });
    }
    group.finish();
}

criterion_group!(registration, paper, periods, points, nodes);
criterion_main!(registration);
