//! Random problems and slow, plain answers to them.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use super::*;

/// Sums of up to some thousand costs of some tens of nats each, added in another order.
pub(super) const SAME_SUM: f64 = 1e-9;

/// The same sum, or both infinite.
pub(super) fn is_same(one: f64, other: f64) -> bool {
    (one.min(f64::MAX) - other.min(f64::MAX)).abs() < SAME_SUM
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Shape {
    pub(super) row_count: usize,
    pub(super) column_count: usize,
    /// Of the pairs, that are edges.
    pub(super) share: f64,
}

impl Shape {
    /// At most `most` rows and columns, from nearly empty to full.
    pub(super) fn small(rng: &mut ChaCha8Rng, most: usize) -> Self {
        Self {
            row_count: rng.random_range(0..=most),
            column_count: rng.random_range(0..=most),
            share: rng.random_range(0.1..1.1),
        }
    }
}

/// What costs look like.
#[derive(Clone, Copy, Debug)]
pub(super) enum Kind {
    Any,
    /// Whole numbers, so that many assignments cost the same.
    Ties,
    /// Every column costs what the one before it does, in pairs.
    Twins,
}

impl Kind {
    fn shaped(self, cost: f64) -> f64 {
        if matches!(self, Self::Ties) { (cost / 2.0).round() } else { cost }
    }
}

pub(super) const KINDS: [Kind; 3] = [Kind::Any, Kind::Ties, Kind::Twins];

/// Edges between random pairs, of -8 to 2 nats.
pub(super) fn random_edges(rng: &mut ChaCha8Rng, shape: Shape, kind: Kind, edges: &mut Edges) {
    edges.begin(shape.column_count).unwrap();
    for _ in 0..shape.row_count {
        let mut drawn = None;
        for column in 0..shape.column_count {
            let repeats = matches!(kind, Kind::Twins) && column % 2 == 1;
            if !repeats {
                let cost = kind.shaped(rng.random_range(-8.0..2.0));
                drawn = (rng.random::<f64>() < shape.share).then_some(cost);
            }
            drawn.iter().for_each(|cost| edges.push(column, *cost).unwrap());
        }
        edges.end_row().unwrap();
    }
}

/// Tracks in a square and plots of nine in ten of them, with as many false ones as make
/// `density` foreign plots per gate: chi-square gate 9.21, and as much for leaving apart. Half of
/// chi-square, as a cost in nats has it.
pub(super) fn gated_edges(rng: &mut ChaCha8Rng, row_count: usize, density: f64, edges: &mut Edges) {
    const GATE: f64 = 9.21;
    // Density of plots is 1 per unit of area: π GATE sigma² of area is `density` units.
    let sigma = (density / (std::f64::consts::PI * GATE)).sqrt();
    let side = (row_count as f64).sqrt();
    let tracks: Vec<[f64; 2]> = (0..row_count)
        .map(|_| [rng.random_range(0.0..side), rng.random_range(0.0..side)])
        .collect();
    let seen: Vec<[f64; 2]> = tracks
        .iter()
        .map(|[x, y]| {
            // The sum of twelve uniform numbers less six is close enough to a normal one here.
            let mut normal = || (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
            [x + sigma * normal(), y + sigma * normal()]
        })
        .enumerate()
        .map(|(index, place)| if index % 10 == 0 { [side - place[0], place[1]] } else { place })
        .collect();
    let mut grid = crate::tracking::gate::Grid::default();
    grid.fill(&seen, sigma * GATE.sqrt()).unwrap();
    edges.begin(seen.len()).unwrap();
    for track in &tracks {
        let mut push = |column: usize, distance_2: f64| {
            edges.push(column, 0.5 * (distance_2 / sigma.powi(2) - GATE)).unwrap();
        };
        grid.for_each_within(*track, sigma * GATE.sqrt(), &mut push).unwrap();
        edges.end_row().unwrap();
    }
}

/// An assignment and its cost.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Way {
    pub(super) cost: f64,
    pub(super) columns: Vec<Option<usize>>,
}

/// All assignments, cheapest first.
pub(super) fn all_ways(edges: &Edges) -> Vec<Way> {
    let mut ways = vec![Way { cost: 0.0, columns: Vec::new() }];
    for row in 0..edges.row_count() {
        let longer = |way: &Way| -> Vec<Way> {
            let free = edges.row(row).filter(|(column, _)| !way.columns.contains(&Some(*column)));
            let taken = free.map(|(column, cost)| (Some(column), cost));
            let choices = std::iter::once((None, 0.0)).chain(taken);
            let with = |column| way.columns.iter().copied().chain([column]).collect();
            choices
                .map(|(column, cost)| Way { cost: way.cost + cost, columns: with(column) })
                .collect()
        };
        ways = ways.iter().flat_map(longer).collect();
    }
    ways.sort_by(|one, other| one.cost.total_cmp(&other.cost));
    ways
}

/// All as one component, whether connected or not: nothing needs them connected.
pub(super) fn whole(edges: &Edges) -> (Vec<u32>, Vec<u32>) {
    ((0..short(edges.row_count())).collect(), (0..short(edges.column_count())).collect())
}

/// Every column once, and only edges.
pub(super) fn assert_allowed(edges: &Edges, columns: &[Option<usize>]) {
    let mut taken = vec![false; edges.column_count()];
    for (row, column) in columns.iter().enumerate() {
        let Some(column) = *column else { continue };
        assert!(edges.cost(row, column).is_some(), "row {row}, column {column} is no edge");
        assert!(!std::mem::replace(&mut taken[column], true), "column {column} twice");
    }
}

/// Everything that is asked of a scan, in memory that is there.
#[derive(Default)]
struct All {
    solver: Solver,
    components: Components,
    second: Second,
    k_best: KBest,
    marginals: Marginals,
}

impl All {
    fn ask(&mut self, edges: &Edges) -> f64 {
        let solved = self.solver.solve(edges);
        self.components.find(edges);
        let limits = BestLimits { count: 16, extra: 12.0 };
        let of_best = MarginalLimits { state_count: 8, beyond: Beyond::Best(limits) };
        let mut sum = solved.cost();
        for one in self.components.iter() {
            sum += self.second.margin(solved, one, 6.0);
            sum += self.second.row_margin(solved, one, 0, 6.0);
            sum += self.k_best.find(solved, one, limits).rest_from();
            sum += self.marginals.find(solved, one, MarginalLimits::default()).without(0);
            sum += self.marginals.find(solved, one, of_best).without(0);
        }
        sum
    }
}

#[test]
fn nothing_is_allocated_once_the_memory_is_there() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut scans = vec![Edges::default(); 4];
    for (edges, density) in scans.iter_mut().zip([0.5, 2.0, 6.0, 1.0]) {
        gated_edges(&mut rng, 120, density, edges);
    }
    let mut all = All::default();
    scans.iter().for_each(|edges| assert!(all.ask(edges) < f64::INFINITY));
    let used = allocation_counter::measure(|| {
        scans.iter().for_each(|edges| assert!(all.ask(edges) < f64::INFINITY));
    });
    assert_eq!(used.count_total, 0, "{used:?}");
}

#[test]
fn edges_are_filled_in_memory_that_is_there() {
    let given: Vec<Edge> =
        (0..500).map(|index| Edge { row: index * 7 % 100, column: index, cost: -1.0 }).collect();
    let mut edges = Edges::default();
    edges.fill(100, 500, &given).unwrap();
    let used = allocation_counter::measure(|| edges.fill(100, 500, &given).unwrap());
    assert_eq!(used.count_total, 0, "{used:?}");
}
