//! Histograms against equation (7) written out.

use super::*;
use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};

const TOLERANCE: f64 = 1e-12;
const COLUMNS: usize = 30;
const ROWS: usize = 25;

fn noise(seed: u64) -> Vec<f32> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..COLUMNS * ROWS).map(|_| 1.4 * rng.random::<f32>()).collect()
}

fn raster(amplitude: &[f32]) -> Raster<'_> {
    Raster { amplitude, column_count: COLUMNS, row_count: ROWS }
}

/// Equation (7) as it is written, over all pixels of the image.
fn written_out(amplitude: &[f32], ellipse: &Ellipse, bins: &Bins) -> Vec<BinSums> {
    let mut all = vec![BinSums::default(); bins.count];
    for (index, value) in amplitude.iter().enumerate() {
        let place_px = Vector2::new((index % COLUMNS) as f64, (index / COLUMNS) as f64);
        let kernel = 1.0 - ellipse.distance2(&place_px);
        if kernel <= 0.0 {
            continue;
        }
        let share = f64::from(*value) / f64::from(bins.top);
        let over = (0..bins.count).filter(|u| *u as f64 <= bins.count as f64 * share).count();
        let bin = if *value < bins.floor { 0 } else { over - 1 };
        all[bin].kernel += kernel;
        all[bin].count += 1.0;
        all[bin].offset_px += place_px - ellipse.centre_px;
    }
    all
}

#[test]
fn the_sums_are_those_written_out_also_at_the_border() {
    for (seed, centre, half) in [
        (1, [12.3, 11.6], [5.5, 8.0]),
        (2, [0.0, 0.0], [4.2, 3.0]),
        (3, [31.0, 20.0], [6.0, 9.5]),
        (4, [10.0, 10.0], [0.5, 0.5]),
        (5, [14.0, 12.0], [100.0, 90.0]),
    ] {
        let amplitude = noise(seed);
        let ellipse =
            Ellipse { centre_px: Vector2::from(centre), half_axes_px: Vector2::from(half) };
        for bins in
            [Bins { count: 16, top: 0.9, floor: 0.0 }, Bins { count: 5, top: 1.4, floor: 0.35 }]
        {
            let got = sums(&raster(&amplitude), &ellipse, &bins);
            let expected = written_out(&amplitude, &ellipse, &bins);
            assert_eq!(got.bins().len(), expected.len());
            let total: f64 = expected.iter().map(|bin| bin.kernel).sum();
            let histogram = got.histogram().unwrap();
            for (u, (a, b)) in got.bins().iter().zip(&expected).enumerate() {
                assert!((a.kernel - b.kernel).abs() < 1e-9, "bin {u}");
                assert!((a.count - b.count).abs() < TOLERANCE);
                assert!((a.offset_px - b.offset_px).norm() < 1e-9);
                assert!((histogram.shares()[u] - b.kernel / total).abs() < TOLERANCE);
            }
            assert!((histogram.shares().iter().sum::<f64>() - 1.0).abs() < TOLERANCE);
            assert!((histogram.likeness(&histogram) - 1.0).abs() < TOLERANCE);
        }
    }
}

#[test]
fn likeness_is_as_worked_out_by_hand() {
    let of = |shares: [f64; 3]| {
        let mut all = [0.0; MAX_BIN_COUNT];
        all[..3].copy_from_slice(&shares);
        Histogram { shares: all, count: 3 }
    };
    let (a, b) = (of([0.25, 0.75, 0.0]), of([0.25, 0.25, 0.5]));
    assert!((a.likeness(&b) - (0.25 + 0.1875_f64.sqrt())).abs() < TOLERANCE);
    assert!(of([1.0, 0.0, 0.0]).likeness(&of([0.0, 1.0, 0.0])).abs() < TOLERANCE);
}

#[test]
fn outside_the_image_there_is_no_histogram() {
    let amplitude = noise(1);
    let half_axes_px = Vector2::new(2.0, 2.0);
    let bins = Bins { count: 16, top: 1.0, floor: 0.0 };
    for centre in [[-5.0, 3.0], [3.0, 200.0], [f64::NAN, 3.0], [1e300, 1e300]] {
        let ellipse = Ellipse { centre_px: Vector2::from(centre), half_axes_px };
        assert_eq!(sums(&raster(&amplitude), &ellipse, &bins).histogram(), None);
    }
}

#[test]
fn bins_are_floors_of_sixteenths_and_the_last_holds_what_is_brighter() {
    let bins = Bins { count: 16, top: 2.0, floor: 0.0 };
    for (amplitude, index) in
        [(0.0, 0), (0.124, 0), (0.126, 1), (1.99, 15), (2.0, 15), (50.0, 15), (f32::INFINITY, 15)]
    {
        assert_eq!(bins.index(amplitude), index, "{amplitude}");
    }
    assert_eq!(Bins { floor: 1.0, ..bins }.index(0.9), 0);
}
