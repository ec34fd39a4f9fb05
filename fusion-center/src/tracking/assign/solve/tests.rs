//! The best assignment against all others, a library, and its own proof.

use pathfinding::kuhn_munkres::kuhn_munkres_min;
use pathfinding::matrix::Matrix;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use super::super::tests::*;
use super::*;

fn columns(solved: Solved<'_>) -> Vec<Option<usize>> {
    (0..solved.edges().row_count()).map(|row| solved.column_of(row)).collect()
}

/// Checks that the assignment is allowed, that rows and columns agree, and that prices prove it.
fn assert_proven(solved: Solved<'_>) {
    let edges = solved.edges();
    assert_allowed(edges, &columns(solved));
    let (mut cost, mut bound) = (0.0, 0.0);
    for row in 0..edges.row_count() {
        assert!(solved.row_price(row) <= 0.0);
        bound += solved.row_price(row);
        let column = solved.column_of(row);
        cost += column.map_or(0.0, |column| edges.cost(row, column).unwrap());
        assert!(column.is_none_or(|column| solved.row_of(column) == Some(row)));
        for (other, reduced) in solved.reduced(row) {
            assert!(-SAME_SUM < reduced, "row {row}, column {other}: {reduced}");
            assert!(column != Some(other) || reduced < SAME_SUM, "row {row}: {reduced}");
        }
    }
    for column in 0..edges.column_count() {
        assert!(solved.column_price(column) <= 0.0);
        bound += solved.column_price(column);
        let row = solved.row_of(column);
        assert!(row.is_none_or(|row| solved.column_of(row) == Some(column)));
    }
    assert!((cost - solved.cost()).abs() < SAME_SUM, "{cost} {}", solved.cost());
    let gap = cost - bound;
    assert!(gap.abs() < SAME_SUM * (1.0 + edges.row_count() as f64), "{cost} {bound}");
}

#[test]
fn no_other_assignment_is_cheaper() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (mut edges, mut solver) = (Edges::default(), Solver::default());
    for trial in 0..6000 {
        let shape = Shape::small(&mut rng, 5);
        random_edges(&mut rng, shape, KINDS[trial % 3], &mut edges);
        let solved = solver.solve(&edges);
        assert_proven(solved);
        let best = &all_ways(&edges)[0];
        assert!((solved.cost() - best.cost).abs() < SAME_SUM, "{edges:?} {best:?}");
    }
}

#[test]
fn prices_prove_it_at_any_size() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let (mut edges, mut solver) = (Edges::default(), Solver::default());
    for trial in 0..120 {
        let [row_count, column_count] = [0, 1].map(|_| rng.random_range(1..300));
        let shape =
            Shape { row_count, column_count, share: rng.random_range(0.0_f64..1.0).powi(3) };
        random_edges(&mut rng, shape, KINDS[trial % 3], &mut edges);
        assert_proven(solver.solve(&edges));
    }
    for (row_count, density) in [(2000, 0.1), (2000, 0.5), (2000, 2.0), (1000, 10.0), (300, 40.0)] {
        gated_edges(&mut rng, row_count, density, &mut edges);
        assert_proven(solver.solve(&edges));
    }
}

/// Least cost by a library, in thousandths of a nat: a column of its own for every row to go
/// without, and a cost that is never paid where there is no edge.
#[expect(clippy::cast_possible_truncation, reason = "whole numbers far below a million")]
fn by_library(edges: &Edges) -> i64 {
    let (rows, columns) = (edges.row_count(), edges.column_count());
    let mut costs = Matrix::new(rows, columns + rows, 1_000_000_i64);
    for row in 0..rows {
        edges
            .row(row)
            .for_each(|(column, cost)| costs[(row, column)] = (cost * 1000.0).round() as i64);
        (0..rows).for_each(|without| costs[(row, columns + without)] = 0);
    }
    kuhn_munkres_min(&costs).0
}

#[test]
fn a_library_finds_the_same_cost() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let (mut edges, mut solver, mut rounded) = <(Edges, Solver, Edges)>::default();
    for (row_count, density) in [(20, 1.0), (60, 0.5), (100, 3.0), (100, 10.0), (60, 30.0)] {
        for _ in 0..4 {
            gated_edges(&mut rng, row_count, density, &mut edges);
            round(&edges, &mut rounded);
            let solved = solver.solve(&rounded);
            let wanted = by_library(&rounded) as f64 / 1000.0;
            assert!((solved.cost() - wanted).abs() < SAME_SUM, "{} {wanted}", solved.cost());
        }
    }
}

/// Costs as whole multiples of 1/1000 nat.
fn round(edges: &Edges, rounded: &mut Edges) {
    rounded.begin(edges.column_count()).unwrap();
    for row in 0..edges.row_count() {
        let near = |cost: f64| (cost * 1000.0).round() / 1000.0;
        edges.row(row).for_each(|(column, cost)| rounded.push(column, near(cost)).unwrap());
        rounded.end_row().unwrap();
    }
}

#[test]
fn many_rows_for_few_columns_end_the_price_war() {
    let mut edges = Edges::default();
    let mut solver = Solver::default();
    for tie in [0.0, 1e-3] {
        edges.begin(3).unwrap();
        for row in 0..400 {
            (0..3).for_each(|column| edges.push(column, -5.0 - tie * f64::from(row)).unwrap());
            edges.end_row().unwrap();
        }
        let solved = solver.solve(&edges);
        assert_proven(solved);
        let wanted = -15.0 - tie * f64::from(399 + 398 + 397);
        assert!((solved.cost() - wanted).abs() < SAME_SUM, "{}", solved.cost());
    }
}

#[test]
fn the_nearest_first_is_not_taken_where_it_is_dear() {
    // By hand: -10 and -1 for the nearest first, -9 and -9 in all; the third is better apart.
    let mut edges = Edges::default();
    edges.begin(2).unwrap();
    for costs in [[-10.0, -9.0], [-9.0, -1.0], [0.0, 3.0]] {
        edges.push(0, costs[0]).unwrap();
        edges.push(1, costs[1]).unwrap();
        edges.end_row().unwrap();
    }
    let mut solver = Solver::default();
    let solved = solver.solve(&edges);
    assert_eq!(columns(solved), [Some(1), Some(0), None]);
    assert_eq!((solved.row_of(1), solved.row_of(2), solved.column_of(3)), (Some(0), None, None));
    assert!((solved.cost() + 18.0).abs() < SAME_SUM);
}

#[test]
fn the_same_problem_has_the_same_answer() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let (mut edges, mut used) = (Edges::default(), Solver::default());
    for trial in 0..200 {
        let shape = Shape::small(&mut rng, 30);
        random_edges(&mut rng, shape, KINDS[trial % 3], &mut edges);
        assert_eq!(columns(used.solve(&edges)), columns(Solver::default().solve(&edges)));
    }
}
