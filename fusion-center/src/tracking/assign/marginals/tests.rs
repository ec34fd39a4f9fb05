//! Probabilities against all assignments.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use super::super::tests::*;
use super::super::{Components, Edges, Solver};
use super::*;

/// Some hundred terms of at most 1, added in another order.
const SAME_PROBABILITY: f64 = 1e-11;

const ONLY_BEST: MarginalLimits = MarginalLimits {
    state_count: 0,
    beyond: Beyond::Best(BestLimits { count: 20_000, extra: f64::INFINITY }),
};

const ONLY_PASSES: MarginalLimits = MarginalLimits {
    state_count: 0,
    beyond: Beyond::Propagate { pass_count: 1000, change: 1e-13 },
};

/// Probability of a row's column, or of none, by summing over `ways`.
fn summed(ways: &[Way], row: usize, column: Option<usize>) -> f64 {
    let weight = |way: &Way| (ways[0].cost - way.cost).exp();
    let with: f64 = ways.iter().filter(|way| way.columns[row] == column).map(weight).sum();
    with / ways.iter().map(weight).sum::<f64>()
}

fn check(edges: &Edges, found: Probabilities<'_>) {
    let ways = all_ways(edges);
    let mut unclaimed = vec![1.0; edges.column_count()];
    for row in 0..edges.row_count() {
        let without = summed(&ways, row, None);
        assert!((found.without(row) - without).abs() < SAME_PROBABILITY, "{row}: {without}");
        assert!(found.of_row(row).map(|(column, _)| column).eq(edges.row(row).map(|edge| edge.0)));
        for (column, probability) in found.of_row(row) {
            let wanted = summed(&ways, row, Some(column));
            assert!((probability - wanted).abs() < SAME_PROBABILITY, "{probability} {wanted}");
            unclaimed[column] -= wanted;
        }
    }
    for (column, wanted) in unclaimed.iter().enumerate() {
        assert!((found.unclaimed(column) - wanted).abs() < SAME_PROBABILITY);
    }
}

#[test]
fn they_are_those_of_all_assignments() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (mut edges, mut solver, mut marginals) = <(Edges, Solver, Marginals)>::default();
    for trial in 0..1500 {
        let shape = Shape::small(&mut rng, 5);
        random_edges(&mut rng, shape, KINDS[trial % 3], &mut edges);
        let solved = solver.solve(&edges);
        let (rows, columns) = whole(&edges);
        let component = Component { rows: &rows, columns: &columns };
        let exact = marginals.find(solved, component, MarginalLimits::default());
        assert_eq!(exact.basis(), Basis::All);
        check(&edges, exact);
        let best = marginals.find(solved, component, ONLY_BEST);
        let count = all_ways(&edges).len();
        let wanted = Basis::Best { count, rest_from: f64::INFINITY };
        assert_eq!(best.basis(), if rows.is_empty() { Basis::All } else { wanted });
        check(&edges, best);
    }
}

#[test]
fn weights_that_underflow_on_their_own_do_no_harm() {
    // The second row must have column 0: the first, for which 0 is much better than none, goes
    // without or takes column 1.
    let mut edges = Edges::default();
    edges.begin(2).unwrap();
    edges.push(0, -900.0).unwrap();
    edges.push(1, 0.5).unwrap();
    edges.end_row().unwrap();
    edges.push(0, -3000.0).unwrap();
    edges.end_row().unwrap();
    let (mut solver, mut marginals) = <(Solver, Marginals)>::default();
    let component = Component { rows: &[0, 1], columns: &[0, 1] };
    let found = marginals.find(solver.solve(&edges), component, MarginalLimits::default());
    check(&edges, found);
    assert!((found.without(0) - 1.0 / (1.0 + (-0.5_f64).exp())).abs() < SAME_PROBABILITY);
}

/// Rows in a chain, each with its column and the next; summed from one end with two numbers only.
#[test]
fn long_chains_are_summed_exactly() {
    const ROW_COUNT: usize = 300;
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let costs: Vec<[f64; 2]> = (0..ROW_COUNT)
        .map(|_| [rng.random_range(-4.0..1.0), rng.random_range(-4.0..1.0)])
        .collect();
    let mut edges = Edges::default();
    edges.begin(ROW_COUNT + 1).unwrap();
    for (row, [own, next]) in costs.iter().enumerate() {
        edges.push(row, *own).unwrap();
        edges.push(row + 1, *next).unwrap();
        edges.end_row().unwrap();
    }
    // Log of the sum over rows `range` where the first column is taken already or is not.
    let log_sum = |range: std::ops::Range<usize>, is_taken: bool| {
        let mut logs = if is_taken { [f64::NEG_INFINITY, 0.0] } else { [0.0, f64::NEG_INFINITY] };
        for [own, next] in &costs[range] {
            let log_add = |a: f64, b: f64| a.max(b) + (-(a - b).abs()).exp().ln_1p();
            let either = log_add(logs[0], logs[1]);
            logs = [log_add(either, logs[0] - own), either - next];
        }
        logs
    };
    let (mut solver, mut marginals) = <(Solver, Marginals)>::default();
    let (rows, columns) = whole(&edges);
    let component = Component { rows: &rows, columns: &columns };
    let found = marginals.find(solver.solve(&edges), component, MarginalLimits::default());
    assert_eq!(found.basis(), Basis::All);
    let total = log_sum(0..ROW_COUNT, false).map(f64::exp).iter().sum::<f64>().ln();
    for (row, [own, _]) in costs.iter().enumerate() {
        // Its column: free before, taken for nobody after.
        let (before, after) = (log_sum(0..row, false)[0], log_sum(row + 1..ROW_COUNT, false));
        let after = after.map(f64::exp).iter().sum::<f64>().ln();
        let wanted = (before - own + after - total).exp();
        let (_, probability) = found.of_row(row).next().unwrap();
        assert!((probability - wanted).abs() < 1e-9, "{row}: {probability} {wanted}");
    }
}

/// A tree has no way round, so what is told is exact.
#[test]
fn propagation_is_exact_in_trees() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let (mut edges, mut solver, mut marginals) = <(Edges, Solver, Marginals)>::default();
    for _ in 0..500 {
        // Every row has one column of those before it and new ones of its own.
        edges.begin(9).unwrap();
        let mut known = 1;
        for _ in 0..4 {
            let mut cost = || rng.random_range(-6.0..2.0);
            edges.push(known - 1, cost()).unwrap();
            (known..known + 2).for_each(|column| edges.push(column, cost()).unwrap());
            edges.end_row().unwrap();
            known += 2;
        }
        let (rows, columns) = whole(&edges);
        let component = Component { rows: &rows, columns: &columns };
        let found = marginals.find(solver.solve(&edges), component, ONLY_PASSES);
        assert!(matches!(found.basis(), Basis::Propagated { change, .. } if change < 1e-12));
        check(&edges, found);
    }
}

#[test]
fn propagation_stands_weights_that_underflow() {
    for most in [-3000.0, -40.0, -700.0] {
        let mut edges = Edges::default();
        edges.begin(2).unwrap();
        for costs in [[-900.0, 0.5], [most, -1.0], [most - 5.0, most]] {
            (0..2).for_each(|column| edges.push(column, costs[column]).unwrap());
            edges.end_row().unwrap();
        }
        let (mut solver, mut marginals) = <(Solver, Marginals)>::default();
        let (rows, columns) = whole(&edges);
        let component = Component { rows: &rows, columns: &columns };
        let found = marginals.find(solver.solve(&edges), component, ONLY_PASSES);
        let ways = all_ways(&edges);
        for row in 0..3 {
            for (column, probability) in found.of_row(row) {
                let wanted = summed(&ways, row, Some(column));
                assert!((probability - wanted).abs() < 0.2, "{most} {row} {column} {probability}");
            }
        }
    }
}

/// Against the exact sum in scenes of many plots; the bounds have a margin of two on what was
/// measured with other seeds.
#[test]
fn what_is_too_wide_is_propagated() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let (mut edges, mut solver, mut marginals) = <(Edges, Solver, Marginals)>::default();
    let (mut exact, mut components) = <(Marginals, Components)>::default();
    let wide = MarginalLimits { state_count: 1 << 16, ..MarginalLimits::default() };
    let (mut sum, mut most, mut count) = (0.0, 0.0_f64, 0.0);
    for density in [1.0, 2.0, 2.5] {
        gated_edges(&mut rng, 300, density, &mut edges);
        let solved = solver.solve(&edges);
        components.find(&edges);
        for component in components.iter().filter(|one| 8 <= one.rows.len()) {
            let wanted = exact.find(solved, component, wide);
            let found = marginals.find(solved, component, ONLY_PASSES);
            if wanted.basis() != Basis::All {
                continue;
            }
            let rows = 0..component.rows.len();
            for (a, b) in rows.flat_map(|row| found.of_row(row).zip(wanted.of_row(row))) {
                let error = (a.1 - b.1).abs();
                (sum, most, count) = (sum + error, most.max(error), count + 1.0);
            }
        }
    }
    assert!(500.0 < count);
    assert!(sum / count < 0.04 && most < 0.4, "mean {} most {most} of {count}", sum / count);
}

#[test]
fn probabilities_of_a_row_sum_to_one() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let (mut edges, mut solver, mut marginals) = <(Edges, Solver, Marginals)>::default();
    gated_edges(&mut rng, 100, 12.0, &mut edges);
    let (rows, columns) = whole(&edges);
    let component = Component { rows: &rows, columns: &columns };
    let solved = solver.solve(&edges);
    let best = Beyond::Best(BestLimits { count: 64, extra: 20.0 });
    let of_best = MarginalLimits { beyond: best, ..MarginalLimits::default() };
    for limits in [MarginalLimits::default(), of_best] {
        let found = marginals.find(solved, component, limits);
        assert!(found.basis() != Basis::All);
        for row in 0..rows.len() {
            let sum: f64 = found.of_row(row).map(|(_, probability)| probability).sum();
            assert!((sum + found.without(row) - 1.0).abs() < SAME_PROBABILITY);
        }
    }
    let found = marginals.find(solved, component, of_best);
    assert!(matches!(found.basis(), Basis::Best { count: 64, rest_from } if rest_from < 20.0));
}
