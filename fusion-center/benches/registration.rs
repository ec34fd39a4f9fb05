//! Processor time per registration against periods, points per period and nodes, from nothing and
//! resumed, beside the particle swarm in the same run. One thread: a problem at a time.
//!
//! The swarm's time is that of its iterations: beside large problems one of its 100 is measured
//! (`swarm_1_of_100`), beside the paper's also all (`swarm`).
//!
//! `cargo bench -p fusion-center --bench registration` takes about four minutes.

mod processor_time;

use std::collections::BTreeMap;
use std::hint::black_box;
use std::time::Duration;

use criterion::{BenchmarkGroup, Criterion};
use fusion_center::network::{NodeView, SeenSet, SiteProblem, solve_site};
use fusion_center::registration::{
    DecisionConfig, Pairwise, Period, Problem, Solver, Swarm, SwarmConfig,
};
use fusion_center::simulate::{Conditions, trial};
use fusion_center::simulate_site::{SiteConditions, SiteSampler};
use nalgebra::{Matrix2, Vector2};
use proto::geom::{Frame, Gaussian, Node, Point, Ref, Se2};
use proto::ids::NodeId;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rayon::ThreadPoolBuilder;

use processor_time::{ProcessorTime, by_processor_time};

type Group<'a> = BenchmarkGroup<'a, ProcessorTime>;

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
fn room(node_count: usize) -> SiteProblem {
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

/// Columns of the grid of [`chain_and_grid`], metres between neighbours, and how far a node sees.
const COLUMN_COUNT: usize = 8;
const SPACING_M: f64 = 4.0;
const REACH_M: f64 = 5.0;

/// Two thirds of the nodes on a grid, the others in a chain that leads away from it; people scattered
/// anew in each of 30 periods, one per 20 m², a target in five missed and some points false.
fn chain_and_grid(node_count: usize) -> Option<SiteProblem> {
    let grid_count = (2 * node_count / 3).max(1);
    let rows = grid_count.div_ceil(COLUMN_COUNT);
    let cell = |column: usize, row: usize| [SPACING_M * column as f64, SPACING_M * row as f64];
    let on_grid = (0..grid_count).map(|i| cell(i % COLUMN_COUNT, i / COLUMN_COUNT));
    let in_chain = (0..node_count - grid_count).map(|i| cell(COLUMN_COUNT + i, 0));
    let positions: Vec<[f64; 2]> = on_grid.chain(in_chain).collect();
    let (hall_m, depth_m) = (SPACING_M * COLUMN_COUNT as f64, SPACING_M * rows as f64);
    let corridor_m = SPACING_M * (node_count - grid_count) as f64;
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut people = |count: usize, [from, to]: [f64; 2], wide_m: f64| -> Vec<Vector2<f64>> {
        let mut place =
            || Vector2::new(rng.random_range(from..to), rng.random_range(0.0..wide_m) - SPACING_M);
        (0..count).map(|_| place()).collect()
    };
    let paths = (0..30).map(|_| {
        let mut all = people(COLUMN_COUNT * rows * 4 / 5, [0.0, hall_m], depth_m);
        let corridor = [hall_m, hall_m + corridor_m + SPACING_M];
        all.extend(people((node_count - grid_count) * 8 / 5, corridor, 2.0 * SPACING_M));
        all
    });
    let conditions = SiteConditions {
        measuring: Conditions { noise_scale: 1.0, ..Conditions::WITH_FALSE_POINTS },
        reach_m: REACH_M,
        half_depth_sigma_m: 0.0,
    };
    let drawn = SiteSampler::new(1, &positions, conditions).observe(&paths.collect());
    drawn.ok().map(|trial| trial.problem)
}

fn swarm(iteration_count: usize) -> Swarm {
    let config = SwarmConfig { iteration_count, ..SwarmConfig::default() };
    Swarm::new(config, DecisionConfig::default())
}

/// From nothing and resumed, and a step of the swarm. The place for further settings of the default solver, such as the
/// certificate: one more line each.
fn bench_default(group: &mut Group<'_>, name: &str, input: &Problem) {
    let (solver, one_step) = (Pairwise::default(), swarm(1));
    group.bench_function(format!("{name}/default"), |b| {
        b.iter(|| solver.solve(black_box(input), None));
    });
    let known = solver.solve(input, None).known;
    group.bench_function(format!("{name}/resumed"), |b| {
        b.iter(|| solver.solve(black_box(input), Some(black_box(&known))));
    });
    group.bench_function(format!("{name}/swarm_1_of_100"), |b| {
        b.iter(|| one_step.solve(black_box(input), None));
    });
}

fn short<'a>(criterion: &'a mut Criterion<ProcessorTime>, name: &str) -> Group<'a> {
    let mut group = criterion.benchmark_group(name);
    group.sample_size(10);
    group.warm_up_time(Duration::from_millis(200));
    group.measurement_time(Duration::from_millis(800));
    group
}

fn paper(criterion: &mut Criterion<ProcessorTime>) {
    let mut group = short(criterion, "paper");
    for (name, conditions) in [
        ("clean", Conditions::CLEAN),
        ("misses", Conditions::MISSES),
        ("false_points", Conditions::WITH_FALSE_POINTS),
    ] {
        bench_default(&mut group, name, &trial(&conditions, 1).problem);
    }
    let (all, clean) = (swarm(100), trial(&Conditions::CLEAN, 1).problem);
    group.bench_function("clean/swarm", |b| b.iter(|| all.solve(black_box(&clean), None)));
    group.finish();
}

fn periods(criterion: &mut Criterion<ProcessorTime>) {
    let mut group = short(criterion, "periods");
    for period_count in [8, 32, 125, 500, 1000] {
        let size = Size { period_count, target_count: 5, false_count: 0, sigma_m: 0.1 };
        bench_default(&mut group, &format!("{period_count}x5"), &problem(size));
    }
    let office = Size { period_count: 30, target_count: 3, false_count: 0, sigma_m: 0.1 };
    bench_default(&mut group, "office_30x3", &problem(office));
    group.finish();
}

fn points(criterion: &mut Criterion<ProcessorTime>) {
    let mut group = short(criterion, "points");
    for target_count in [2, 5, 10, 20, 50] {
        let size = Size { period_count: 8, target_count, false_count: 0, sigma_m: 0.05 };
        bench_default(&mut group, &format!("8x{target_count}"), &problem(size));
    }
    let clutter = Size { period_count: 30, target_count: 2, false_count: 4, sigma_m: 0.05 };
    bench_default(&mut group, "30x2_and_4_false", &problem(clutter));
    group.finish();
}

fn bench_site(group: &mut Group<'_>, name: &str, input: &SiteProblem) {
    let (solver, one_step) = (Pairwise::default(), swarm(1));
    group.bench_function(format!("{name}/default"), |b| {
        b.iter(|| solve_site(black_box(input), &solver));
    });
    group.bench_function(format!("{name}/swarm_1_of_100"), |b| {
        b.iter(|| solve_site(black_box(input), &one_step));
    });
}

fn nodes(criterion: &mut Criterion<ProcessorTime>) {
    let mut group = short(criterion, "nodes");
    for node_count in [2, 8, 32, 100] {
        bench_site(&mut group, &format!("room_{node_count}"), &room(node_count));
        if let Some(site) = chain_and_grid(node_count) {
            bench_site(&mut group, &format!("chain_and_grid_{node_count}"), &site);
        }
    }
    group.finish();
}

fn main() {
    // Whatever the solvers do in parallel is done by this thread, whose time is measured.
    drop(ThreadPoolBuilder::new().num_threads(1).use_current_thread().build_global());
    let mut criterion = by_processor_time();
    paper(&mut criterion);
    periods(&mut criterion);
    points(&mut criterion);
    nodes(&mut criterion);
    criterion.final_summary();
}
