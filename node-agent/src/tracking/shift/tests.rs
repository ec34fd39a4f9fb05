//! Steps against the weighted mean written out and the gradient of likeness.

use super::*;
use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};

const COLUMNS: usize = 60;
const ROWS: usize = 50;
const RULE: ShiftRule = ShiftRule {
    weighting: Weighting::Bright,
    epsilon_px: 0.01,
    max_iteration_count: 100,
    bandwidth: 1.0,
};

fn raster(amplitude: &[f32]) -> Raster<'_> {
    Raster { amplitude, column_count: COLUMNS, row_count: ROWS }
}

/// A round hill of height 1 over an even background.
fn hill(centre: [f64; 2], background: f64) -> Vec<f32> {
    let value = |index: usize| {
        let place = Vector2::new((index % COLUMNS) as f64, (index / COLUMNS) as f64);
        let distance = (place - Vector2::from(centre)).component_div(&Vector2::new(6.0, 4.0));
        crate::imaging::single(background + (-distance.norm_squared()).exp())
    };
    (0..COLUMNS * ROWS).map(value).collect()
}

fn template(amplitude: &[f32], centre: [f64; 2]) -> Template {
    let ellipse =
        Ellipse { centre_px: Vector2::from(centre), half_axes_px: Vector2::new(10.0, 7.0) };
    let bins = Bins { count: 16, top: 1.0, floor: 0.0 };
    Template::new(&raster(amplitude), &ellipse, bins).unwrap()
}

/// `W_u`, bins from 1.
fn emphasis(weighting: Weighting, u: usize) -> f64 {
    match weighting {
        Weighting::Bright => u as f64 - 1.0,
        Weighting::Even => 1.0,
    }
}

#[test]
fn a_step_is_the_weighted_mean_written_out() {
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let mut noise = || -> Vec<f32> { (0..COLUMNS * ROWS).map(|_| rng.random()).collect() };
    let (before, after) = (noise(), hill([33.0, 22.0], 0.1));
    let known = template(&before, [30.0, 25.0]);
    let centre_px = Vector2::new(30.0, 25.0);
    let ellipse = Ellipse { centre_px, half_axes_px: known.half_axes_px };
    let all = sums(&raster(&after), &ellipse, &known.bins);
    let candidate = all.histogram().unwrap();
    for weighting in [Weighting::Bright, Weighting::Even] {
        let (mut sum, mut total) = (Vector2::zeros(), 0.0);
        for (index, value) in after.iter().enumerate() {
            let place = Vector2::new((index % COLUMNS) as f64, (index / COLUMNS) as f64);
            if ellipse.distance2(&place) < 1.0 {
                // Bins from 1, as in the paper.
                let u = known.bins.index(*value) + 1;
                let (q, p) = (known.histogram.shares()[u - 1], candidate.shares()[u - 1]);
                let weight = emphasis(weighting, u) * (q / p).sqrt();
                sum += place * weight;
                total += weight;
            }
        }
        let (offset_px, likeness) = step(&all, &known.histogram, weighting).unwrap();
        assert!((centre_px + offset_px - sum / total).norm() < 1e-9);
        assert!((likeness - candidate.likeness(&known.histogram)).abs() < 1e-12);
    }
}

#[test]
fn a_step_goes_up_the_gradient_of_likeness() {
    // Amplitudes change so that bins follow places: a slope instead of a symmetric hill.
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut same_way = 0;
    let trial_count = 200;
    for _ in 0..trial_count {
        let centre = [rng.random_range(25.0..35.0), rng.random_range(20.0..30.0)];
        let amplitude = hill([30.0, 25.0], 0.02);
        let known = template(&amplitude, [30.0, 25.0]);
        let likeness = |dx: f64, dy: f64| {
            let centre_px = Vector2::new(centre[0] + dx, centre[1] + dy);
            let ellipse = Ellipse { centre_px, half_axes_px: known.half_axes_px };
            let all = sums(&raster(&amplitude), &ellipse, &known.bins);
            all.histogram().unwrap().likeness(&known.histogram)
        };
        // Differences over a pixel: bins make the coefficient smooth only in k.
        let slope = Vector2::new(
            likeness(0.5, 0.0) - likeness(-0.5, 0.0),
            likeness(0.0, 0.5) - likeness(0.0, -0.5),
        );
        let half = known.half_axes_px;
        let expected = slope.component_mul(&half).component_mul(&half);
        let ellipse = Ellipse { centre_px: Vector2::from(centre), half_axes_px: half };
        let all = sums(&raster(&amplitude), &ellipse, &known.bins);
        let (offset_px, _) = step(&all, &known.histogram, Weighting::Even).unwrap();
        let cosine = offset_px.dot(&expected) / (offset_px.norm() * expected.norm());
        same_way += u32::from(0.9 < cosine);
    }
    assert!(trial_count * 9 / 10 < same_way, "{same_way} of {trial_count}");
}

#[test]
fn the_iteration_finds_the_hill_and_without_weights_stays_behind() {
    let known = template(&hill([25.0, 20.0], 0.05), [25.0, 20.0]);
    let moved = hill([28.0, 22.0], 0.05);
    let truth = Vector2::new(28.0, 22.0);
    let found = shift(&raster(&moved), &known, Vector2::new(25.0, 20.0), &RULE).unwrap();
    assert!(found.converged && found.iteration_count < 15, "{found:?}");
    assert!((found.centre_px - truth).norm() < 0.1, "{found:?}");
    assert!(0.99 < found.likeness && found.likeness <= 1.0 + 1e-12);
    let one = ShiftRule { max_iteration_count: 1, ..RULE };
    let bright = shift(&raster(&moved), &known, Vector2::new(25.0, 20.0), &one).unwrap();
    let even = ShiftRule { weighting: Weighting::Even, ..one };
    let even = shift(&raster(&moved), &known, Vector2::new(25.0, 20.0), &even).unwrap();
    let left = |shifted: &Shifted| (shifted.centre_px - truth).norm();
    assert!(!bright.converged && bright.iteration_count == 1);
    assert!(2.0 * left(&bright) < left(&even), "{} and {} px", left(&bright), left(&even));
}

#[test]
fn where_nothing_is_there_is_no_shift() {
    let known = template(&hill([25.0, 20.0], 0.0), [25.0, 20.0]);
    let start_px = Vector2::new(25.0, 20.0);
    let dark = vec![0.0; COLUMNS * ROWS];
    assert_eq!(shift(&raster(&dark), &known, start_px, &RULE), None);
    let none = ShiftRule { max_iteration_count: 0, ..RULE };
    let bright = hill([25.0, 20.0], 0.0);
    assert_eq!(shift(&raster(&bright), &known, start_px, &none).unwrap().iteration_count, 1);
    let away_px = Vector2::new(-100.0, 20.0);
    assert_eq!(shift(&raster(&bright), &known, away_px, &RULE), None);
}
