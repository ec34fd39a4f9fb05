//! Maxima against dilation as it is defined.

use super::*;
use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};

const COLUMNS: usize = 41;
const ROWS: usize = 37;

fn raster(amplitude: &[f32]) -> Raster<'_> {
    Raster { amplitude, column_count: COLUMNS, row_count: ROWS }
}

fn found(amplitude: &[f32], half_axes_px: [f64; 2], keep: Keep) -> Vec<Peak> {
    let mut peaks = Vec::new();
    maxima_into(&raster(amplitude), &Disc::new(half_axes_px), keep, &mut peaks);
    peaks
}

/// Dilation written down as it is defined, for every pixel.
fn dilated(amplitude: &[f32], [a, b]: [f64; 2]) -> Vec<f32> {
    let inside = |dx: f64, dy: f64| (dx / a).powi(2) + (dy / b).powi(2) <= 1.0;
    let mut all = Vec::new();
    for (row, column) in (0..ROWS).flat_map(|row| (0..COLUMNS).map(move |c| (row, c))) {
        let mut most = f32::NEG_INFINITY;
        for (index, value) in amplitude.iter().enumerate() {
            let dx = (index % COLUMNS) as f64 - column as f64;
            let dy = (index / COLUMNS) as f64 - row as f64;
            if inside(dx, dy) {
                most = most.max(*value);
            }
        }
        all.push(most);
    }
    all
}

#[test]
fn maxima_are_where_dilation_changes_nothing() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for half_axes_px in [[1.0, 1.0], [3.2, 2.1], [2.0, 6.5], [9.0, 4.0]] {
        let amplitude: Vec<f32> = (0..COLUMNS * ROWS).map(|_| rng.random()).collect();
        let flat = dilated(&amplitude, half_axes_px);
        let above = 0.4;
        let mut expected: Vec<Peak> = (0..amplitude.len())
            .filter(|i| flat[*i].total_cmp(&amplitude[*i]).is_eq() && above < amplitude[*i])
            .map(|i| Peak { column: i % COLUMNS, row: i / COLUMNS, amplitude: amplitude[i] })
            .collect();
        expected.sort_by(|p, q| q.amplitude.total_cmp(&p.amplitude));
        assert!(5 < expected.len());
        let all = found(&amplitude, half_axes_px, Keep { above, max_count: 10_000 });
        assert_eq!(all, expected);
        let few = found(&amplitude, half_axes_px, Keep { above, max_count: 4 });
        assert_eq!(few, expected[..4]);
    }
}

#[test]
fn a_plateau_counts_once_and_nothing_has_no_maximum() {
    let mut amplitude = vec![0.0; COLUMNS * ROWS];
    let keep = Keep { above: 0.0, max_count: 10 };
    assert_eq!(found(&amplitude, [2.0, 2.0], keep), []);
    for row in 10..15 {
        amplitude[row * COLUMNS + 8..row * COLUMNS + 20].fill(2.0);
    }
    let first = Peak { column: 8, row: 10, amplitude: 2.0 };
    assert_eq!(found(&amplitude, [2.0, 2.0], keep), [first]);
    assert_eq!(found(&amplitude, [2.0, 2.0], Keep { above: 2.0, ..keep }), []);
    assert_eq!(found(&amplitude, [2.0, 2.0], Keep { max_count: 0, ..keep }), []);
    amplitude.fill(1.0);
    assert_eq!(found(&amplitude, [2.0, 2.0], keep).len(), 1);
}

#[test]
fn the_largest_is_found_in_any_length() {
    for count in 0..40 {
        let values: Vec<f32> = (0..count).map(|k| ((k * 7) % 11) as f32).collect();
        let plain = values.iter().copied().fold(0.0, f32::max);
        assert_eq!(largest(&values).to_bits(), plain.to_bits());
    }
}
