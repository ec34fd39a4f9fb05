//! Processor time of gating and assignment against tracks and candidates per gate. One thread.
//!
//! Scenes: tracks uniform in a square, nine in ten seen with the gate's error, a tenth as many false
//! plots; `density` is the mean of foreign plots in a gate (chi-square 9.21). Above 3 or 4 most
//! tracks are one component. `gate` is the grid and the chi-square test with the edges, `solve` the
//! assignment, `split` the components, `margin` whether each is ambiguous within 6 nats,
//! `marginals` the probabilities where it is, `both` gate and solve.
//!
//! `cargo bench -p fusion-center --bench assignment` takes about two minutes.

mod processor_time;

use std::f64::consts::PI;
use std::hint::black_box;
use std::time::Duration;

use criterion::BenchmarkGroup;
use fusion_center::tracking::assign::{
    Components, Edges, MarginalLimits, Marginals, Second, Solver,
};
use fusion_center::tracking::gate::Grid;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use processor_time::{ProcessorTime, by_processor_time};

/// Chi-square gate, and twice what leaving a pair apart costs.
const GATE: f64 = 9.21;

/// Predicted positions and plots, one per unit of area each.
struct Scene {
    tracks: Vec<[f64; 2]>,
    plots: Vec<[f64; 2]>,
    sigma: f64,
}

impl Scene {
    fn new(track_count: usize, density: f64) -> Self {
        let sigma = (density / (PI * GATE)).sqrt();
        let side = (track_count as f64).sqrt();
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut place = || [0, 1].map(|_| rng.random_range(0.0..side));
        let tracks: Vec<[f64; 2]> = (0..track_count).map(|_| place()).collect();
        let mut plots: Vec<[f64; 2]> = (0..track_count / 10).map(|_| place()).collect();
        // The sum of twelve uniform numbers less six is close enough to a normal one here.
        let mut normal = || (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
        let seen = tracks.iter().enumerate().filter(|(index, _)| index % 10 != 0);
        plots.extend(seen.map(|(_, at)| at.map(|at| at + sigma * normal())));
        // As a scan gives them: in no order of the tracks.
        for index in 1..plots.len() {
            plots.swap(index, rng.random_range(0..=index));
        }
        Self { tracks, plots, sigma }
    }

    /// The edges of all tracks; empty if they can't be had.
    fn gate(&self, grid: &mut Grid, edges: &mut Edges) {
        let radius = self.sigma * GATE.sqrt();
        let per_variance = self.sigma.powi(2).recip();
        if grid.fill(&self.plots, radius).is_err() || edges.begin(self.plots.len()).is_err() {
            return;
        }
        let mut is_refused = false;
        for track in &self.tracks {
            let asked = grid.for_each_within(*track, radius, |plot, distance_2| {
                let cost = 0.5 * (distance_2 * per_variance - GATE);
                is_refused |= cost < 0.0 && edges.push(plot, cost).is_err();
            });
            is_refused |= asked.is_err() | edges.end_row().is_err();
        }
        assert!(!is_refused, "the scene is finite");
    }
}

/// Where a second best this close makes a component ambiguous, nats.
const CLOSE: f64 = 6.0;

fn bench(group: &mut BenchmarkGroup<'_, ProcessorTime>, name: &str, scene: &Scene) {
    let (mut grid, mut edges, mut solver) = <(Grid, Edges, Solver)>::default();
    group.bench_function(format!("{name}/both"), |b| {
        b.iter(|| {
            black_box(scene).gate(&mut grid, &mut edges);
            solver.solve(&edges).cost()
        });
    });
    group.bench_function(format!("{name}/gate"), |b| {
        b.iter(|| black_box(scene).gate(&mut grid, &mut edges));
    });
    group.bench_function(format!("{name}/solve"), |b| {
        b.iter(|| solver.solve(black_box(&edges)).cost());
    });
    let (mut components, mut second, mut marginals) = <(Components, Second, Marginals)>::default();
    group.bench_function(format!("{name}/split"), |b| {
        b.iter(|| components.find(black_box(&edges)));
    });
    let solved = solver.solve(&edges);
    group.bench_function(format!("{name}/margin"), |b| {
        b.iter(|| {
            let margins = components.iter().map(|one| second.margin(solved, one, CLOSE));
            margins.filter(|margin| *margin < CLOSE).count()
        });
    });
    group.bench_function(format!("{name}/marginals"), |b| {
        b.iter(|| {
            let close = components.iter().filter(|one| second.margin(solved, *one, CLOSE) < CLOSE);
            let find = |one| marginals.find(solved, one, MarginalLimits::default()).without(0);
            close.map(find).sum::<f64>()
        });
    });
}

fn main() {
    let mut criterion = by_processor_time();
    let mut group = criterion.benchmark_group("assignment");
    group.sample_size(20);
    group.warm_up_time(Duration::from_millis(300));
    group.measurement_time(Duration::from_millis(1000));
    for track_count in [1_000, 5_000, 20_000] {
        for density in [0.5, 1.0, 2.0, 10.0] {
            let scene = Scene::new(track_count, density);
            bench(&mut group, &format!("{track_count}_tracks_{density}_foreign"), &scene);
        }
    }
    group.finish();
    criterion.final_summary();
}
