//! The grid against looking at every pair.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use super::*;

fn within(grid: &Grid, place_m: [f64; 2], radius_m: f64) -> Vec<usize> {
    let mut found = Vec::new();
    grid.for_each_within(place_m, radius_m, |index, _| found.push(index)).unwrap();
    found.sort_unstable();
    found
}

/// Those of all points that are near.
fn of_all(points_m: &[[f64; 2]], place_m: [f64; 2], radius_m: f64) -> Vec<usize> {
    let near =
        |point_m: &[f64; 2]| (point_m[0] - place_m[0]).hypot(point_m[1] - place_m[1]) <= radius_m;
    (0..points_m.len()).filter(|index| near(&points_m[*index])).collect()
}

#[test]
fn it_finds_what_looking_at_all_finds() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut grid = Grid::default();
    for trial in 0..600 {
        let count = rng.random_range(0..60);
        let size_m = [1000.0, if trial % 5 == 0 { 0.0 } else { 300.0 }];
        let mut points_m: Vec<[f64; 2]> =
            (0..count).map(|_| size_m.map(|size_m| rng.random::<f64>() * size_m - 400.0)).collect();
        if trial % 3 == 0 {
            // Far ones, on either side.
            points_m.extend([[1e9, 0.0], [-3e7, 5e8]]);
        }
        if trial % 7 == 0 {
            points_m.iter_mut().for_each(|point_m| *point_m = [12.0, -7.0]);
        }
        let cell_m = 10.0_f64.powf(rng.random_range(-6.0..6.0));
        grid.fill(&points_m, cell_m).unwrap();
        assert_eq!(grid.count(), points_m.len());
        assert!(grid.starts.len() <= CELLS_PER_POINT * points_m.len() + 3);
        for _ in 0..20 {
            let place_m = [0, 1].map(|_| rng.random_range(-700.0..800.0));
            let radius_m = 10.0_f64.powf(rng.random_range(-2.0..10.0));
            let wanted = of_all(&points_m, place_m, radius_m);
            assert_eq!(within(&grid, place_m, radius_m), wanted, "{place_m:?} {radius_m}");
        }
        let beside_m = [1e9 - 3.0, 4.0];
        assert_eq!(within(&grid, beside_m, 5.5), of_all(&points_m, beside_m, 5.5));
    }
}

#[test]
fn a_few_far_points_leave_the_cells_small() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut place = || [0, 1].map(|_| rng.random_range(0.0..1000.0));
    let mut points_m: Vec<[f64; 2]> = (0..1000).map(|_| place()).collect();
    points_m.extend([[1e8, 1e8], [-1e8, 0.0]]);
    let mut grid = Grid::default();
    grid.fill(&points_m, 20.0).unwrap();
    let fullest = grid.starts.windows(2).map(|ends| ends[1] - ends[0]).max();
    // Of 20 m, 0.4 points are expected in a cell, and up to a strip of 2 % along the borders.
    assert!(fullest < Some(20), "{fullest:?}");
}

#[test]
fn the_distance_is_that_of_the_point() {
    let mut grid = Grid::default();
    grid.fill(&[[3.0, 4.0]], 1.0).unwrap();
    let mut named = Vec::new();
    grid.for_each_within([0.0, 0.0], 5.0, |index, at_m2| named.push((index, at_m2))).unwrap();
    assert_eq!(named, [(0, 25.0)]);
    assert_eq!(within(&grid, [0.0, 0.0], 4.99), Vec::<usize>::new());
}

#[test]
fn wrong_points_and_questions_are_refused() {
    let mut grid = Grid::default();
    grid.fill(&[[0.0, 0.0]], 1.0).unwrap();
    let wrong = grid.fill(&[[0.0, 0.0], [1.0, f64::INFINITY]], 1.0);
    assert_eq!(wrong, Err(GateError::Point { index: 1, x_m: 1.0, y_m: f64::INFINITY }));
    assert_eq!((grid.count(), within(&grid, [0.0, 0.0], 1e9)), (0, Vec::<usize>::new()));
    for length_m in [0.0, -1.0, f64::INFINITY] {
        let wanted = GateError::Length { what: "the side of a cell", length_m };
        assert_eq!(grid.fill(&[], length_m), Err(wanted));
    }
    assert!(matches!(grid.fill(&[], f64::NAN), Err(GateError::Length { .. })));
    let asked = |place_m, radius_m| grid.for_each_within(place_m, radius_m, |_, _| ());
    let nowhere = GateError::Point { index: ASKED, x_m: f64::INFINITY, y_m: 0.0 };
    assert_eq!(asked([f64::INFINITY, 0.0], 1.0), Err(nowhere));
    let negative = GateError::Length { what: "the radius", length_m: -1.0 };
    assert_eq!(asked([0.0, 0.0], -1.0), Err(negative));
    assert!(asked([0.0, 0.0], f64::NAN).is_err());
}

#[test]
fn more_points_than_can_be_counted_are_refused() {
    let count = MAX_COUNT + 1;
    assert_eq!(few_enough(count), Err(GateError::TooMany { count, limit: MAX_COUNT }));
    assert_eq!(few_enough(MAX_COUNT), Ok(()));
}

#[test]
fn a_cell_is_as_long_as_the_middle_distance() {
    assert_eq!(cell_size_m(&mut []), None);
    assert_eq!(cell_size_m(&mut [0.0, 0.0]), None);
    assert_eq!(cell_size_m(&mut [1e9, 3.0, 2.0, 0.0, 4.0]), Some(3.0));
    assert_eq!(cell_size_m(&mut [0.0, 5.0, 0.0, 0.0, 4.0]), Some(4.0));
}

#[test]
fn the_grid_is_filled_in_memory_that_is_there() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut place = || [0, 1].map(|_| rng.random_range(0.0..1000.0));
    let points_m: Vec<[f64; 2]> = (0..500).map(|_| place()).collect();
    let mut grid = Grid::default();
    // A cell so small that the core is looked for too.
    grid.fill(&points_m, 0.1).unwrap();
    let used = allocation_counter::measure(|| {
        grid.fill(&points_m, 0.1).unwrap();
        grid.for_each_within([500.0, 500.0], 70.0, |_, _| ()).unwrap();
    });
    assert_eq!(used.count_total, 0, "{used:?}");
}
