//! The K best against all assignments.

use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;

use super::super::tests::*;
use super::super::{Components, Edges, Second, Solver};
use super::*;

const UNLIMITED: f64 = f64::INFINITY;

fn columns(one: RankedAssignment<'_>, row_count: usize) -> Vec<Option<usize>> {
    (0..row_count).map(|row| one.column_of(row)).collect()
}

fn check(edges: &Edges, ranked: Ranked<'_>, limits: BestLimits) {
    let ways = all_ways(edges);
    let extra = |way: &Way| way.cost - ways[0].cost;
    let within = ways.iter().filter(|way| extra(way) < limits.extra - SAME_SUM).count();
    assert!(within.min(limits.count) <= ranked.count(), "{} of {within}", ranked.count());
    assert!(ranked.count() <= limits.count.max(1));
    let mut seen = Vec::new();
    for (one, way) in ranked.iter().zip(&ways) {
        let found = columns(one, edges.row_count());
        assert_allowed(edges, &found);
        let costs =
            found.iter().enumerate().filter_map(|(row, column)| edges.cost(row, (*column)?));
        let cost: f64 = costs.sum();
        assert!((cost - way.cost).abs() < SAME_SUM, "{cost} {way:?}");
        assert!((one.extra - extra(way)).abs() < SAME_SUM, "{} {way:?}", one.extra);
        assert!(!seen.contains(&found), "{found:?} twice");
        seen.push(found);
    }
    let rest = ways.get(ranked.count()).map_or(UNLIMITED, extra);
    assert!(ranked.rest_from() <= rest + SAME_SUM, "{} {rest}", ranked.rest_from());
    let is_complete = ranked.count() == ways.len() && ways.len() < limits.count;
    assert!(!is_complete || limits.extra <= ranked.rest_from());
}

#[test]
fn they_are_the_first_of_all() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (mut edges, mut solver, mut best) = <(Edges, Solver, KBest)>::default();
    for trial in 0..4000 {
        let shape = Shape::small(&mut rng, 5);
        random_edges(&mut rng, shape, KINDS[trial % 3], &mut edges);
        let solved = solver.solve(&edges);
        let (rows, columns) = whole(&edges);
        let component = Component { rows: &rows, columns: &columns };
        for (count, extra) in [(0, UNLIMITED), (1, UNLIMITED), (8, UNLIMITED), (64, 3.0)] {
            let limits = BestLimits { count, extra };
            check(&edges, best.find(solved, component, limits), limits);
        }
    }
}

#[test]
fn all_are_found_where_all_are_asked_for() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let (mut edges, mut solver, mut best) = <(Edges, Solver, KBest)>::default();
    let limits = BestLimits { count: usize::MAX, extra: UNLIMITED };
    for trial in 0..60 {
        let shape = Shape { row_count: 4, column_count: 4, share: 0.9 };
        random_edges(&mut rng, shape, KINDS[trial % 3], &mut edges);
        let solved = solver.solve(&edges);
        let (rows, columns) = whole(&edges);
        let ranked = best.find(solved, Component { rows: &rows, columns: &columns }, limits);
        assert_eq!(ranked.count(), all_ways(&edges).len());
        assert!(ranked.rest_from() == UNLIMITED);
        check(&edges, ranked, limits);
    }
}

#[test]
fn the_second_is_as_far_as_the_margin_in_large_components() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let (mut edges, mut solver, mut best) = <(Edges, Solver, KBest)>::default();
    let (mut components, mut second) = <(Components, Second)>::default();
    for density in [0.5, 2.0, 6.0] {
        gated_edges(&mut rng, 150, density, &mut edges);
        let solved = solver.solve(&edges);
        components.find(&edges);
        for component in components.iter() {
            let limits = BestLimits { count: 20, extra: UNLIMITED };
            let ranked = best.find(solved, component, limits);
            let margin = second.margin(solved, component, UNLIMITED);
            let extra = ranked.iter().nth(1).map_or(UNLIMITED, |one| one.extra);
            assert!(is_same(extra, margin), "{extra} {margin}");
            let all: Vec<_> = ranked.iter().map(|one| columns(one, component.rows.len())).collect();
            assert!((1..all.len()).all(|index| !all[..index].contains(&all[index])));
            assert!(ranked.iter().zip(ranked.iter().skip(1)).all(|(a, b)| a.extra <= b.extra));
        }
    }
}

#[test]
fn equal_costs_come_in_the_order_of_their_columns() {
    let mut edges = Edges::default();
    edges.begin(2).unwrap();
    for _ in 0..2 {
        edges.push(0, -1.0).unwrap();
        edges.push(1, -1.0).unwrap();
        edges.end_row().unwrap();
    }
    let (mut solver, mut best) = <(Solver, KBest)>::default();
    let component = Component { rows: &[0, 1], columns: &[0, 1] };
    let limits = BestLimits { count: 10, extra: UNLIMITED };
    let ranked = best.find(solver.solve(&edges), component, limits);
    let found: Vec<_> = ranked.iter().map(|one| [one.column_of(0), one.column_of(1)]).collect();
    let [a, b] = [Some(0), Some(1)];
    assert_eq!(found, [[a, b], [b, a], [a, None], [b, None], [None, a], [None, b], [None, None]]);
}
