//! Margins against all assignments.

use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;

use super::super::tests::*;
use super::super::{Components, Edges, Solver};
use super::*;

#[test]
fn the_margin_is_that_of_the_second_of_all() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (mut edges, mut solver, mut second) = <(Edges, Solver, Second)>::default();
    for trial in 0..6000 {
        let shape = Shape::small(&mut rng, 5);
        random_edges(&mut rng, shape, KINDS[trial % 3], &mut edges);
        let solved = solver.solve(&edges);
        let (rows, columns) = whole(&edges);
        let component = Component { rows: &rows, columns: &columns };
        let ways = all_ways(&edges);
        let wanted = ways.get(1).map_or(f64::INFINITY, |way| way.cost - ways[0].cost);
        let margin = second.margin(solved, component, f64::INFINITY);
        assert!(is_same(wanted, margin), "{wanted} {margin}");
        let limited = second.margin(solved, component, 1.5);
        assert!((limited - wanted.min(1.5)).abs() < SAME_SUM, "{limited} {wanted}");
    }
}

#[test]
fn the_margin_of_a_row_is_that_of_the_first_other_place() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let (mut edges, mut solver, mut second) = <(Edges, Solver, Second)>::default();
    for trial in 0..3000 {
        let shape = Shape::small(&mut rng, 5);
        random_edges(&mut rng, shape, KINDS[trial % 3], &mut edges);
        let solved = solver.solve(&edges);
        let (rows, columns) = whole(&edges);
        let component = Component { rows: &rows, columns: &columns };
        let ways = all_ways(&edges);
        for row in 0..rows.len() {
            let other = ways.iter().find(|way| way.columns[row] != solved.column_of(row));
            let wanted = other.map_or(f64::INFINITY, |way| way.cost - ways[0].cost);
            let margin = second.row_margin(solved, component, row, f64::INFINITY);
            assert!(is_same(wanted, margin), "{wanted} {margin}");
        }
        let beyond = second.row_margin(solved, component, rows.len(), 3.0);
        assert!((beyond - 3.0).abs() < SAME_SUM);
    }
}

#[test]
fn the_least_margin_of_the_rows_is_that_of_the_component() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let (mut edges, mut solver, mut second) = <(Edges, Solver, Second)>::default();
    let mut components = Components::default();
    for density in [0.5, 1.0, 2.0] {
        gated_edges(&mut rng, 400, density, &mut edges);
        let solved = solver.solve(&edges);
        components.find(&edges);
        for component in components.iter() {
            let of_rows = (0..component.rows.len())
                .map(|row| second.row_margin(solved, component, row, f64::INFINITY))
                .fold(f64::INFINITY, f64::min);
            let margin = second.margin(solved, component, f64::INFINITY);
            assert!(is_same(of_rows, margin));
        }
    }
}
