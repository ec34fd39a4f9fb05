//! The filter against small steps, against the sum of informations, and against a density by hand.

use nalgebra::{Matrix2, Matrix4, Vector2, Vector4};

use crate::tracking::Plot;
use crate::tracking::paper::filter::{coasted, first, updated};

/// Rounding of sums of a thousand terms of at most some 1000.
const SAME: f64 = 1e-8;

fn plot(x_m: f64, y_m: f64) -> Plot {
    Plot {
        position_m: Vector2::new(x_m, y_m),
        covariance_m2: Matrix2::new(100.0, 30.0, 30.0, 60.0),
        radial: None,
        strength_db: None,
        report_index: 0,
    }
}

#[test]
fn one_long_step_is_many_short_ones() {
    let start = first(&plot(10.0, 20.0), 15.0);
    let at_once = coasted(&start, 4.0, 0.7).predicted;
    let in_steps = (0..1000).fold(start, |before, _| coasted(&before, 0.004, 0.7).predicted);
    assert!((at_once.mean - in_steps.mean).amax() < SAME);
    assert!((at_once.covariance - in_steps.covariance).amax() < SAME);
    // What the noise adds to a velocity is its intensity times the time.
    let gained = at_once.covariance[(2, 2)] - start.covariance[(2, 2)];
    assert!((gained - 2.8).abs() < SAME);
}

#[test]
fn an_update_adds_informations() {
    let before = coasted(&first(&plot(10.0, 20.0), 15.0), 4.0, 0.7).predicted;
    let seen = plot(31.0, -8.0);
    let (after, _) = updated(&before, &seen).unwrap();
    let mut of_plot = Matrix4::zeros();
    let weight = seen.covariance_m2.try_inverse().unwrap();
    of_plot.fixed_view_mut::<2, 2>(0, 0).copy_from(&weight);
    let of_before = before.covariance.try_inverse().unwrap();
    let covariance = (of_before + of_plot).try_inverse().unwrap();
    let place = Vector4::new(31.0, -8.0, 0.0, 0.0);
    let mean = covariance * (of_before * before.mean + of_plot * place);
    assert!((after.covariance - covariance).amax() < SAME);
    assert!((after.mean - mean).amax() < SAME);
}

#[test]
fn the_density_of_a_plot_by_hand() {
    let mut before = first(&plot(0.0, 0.0), 15.0);
    before.covariance.fixed_view_mut::<2, 2>(0, 0).copy_from(&Matrix2::new(9.0, 0.0, 0.0, 16.0));
    let seen = Plot { covariance_m2: Matrix2::new(16.0, 0.0, 0.0, 9.0), ..plot(5.0, 10.0) };
    let (_, log_density) = updated(&before, &seen).unwrap();
    // 5 m is one and 10 m are two of √25 m: exp(−(1 + 4)/2) / (2π · 25).
    let by_hand = -2.5 - (std::f64::consts::TAU * 25.0).ln();
    assert!((log_density - by_hand).abs() < SAME, "{log_density} {by_hand}");
}

/// Pauses of ten seconds to thirty years: what is known of the place is at most what the plot says.
#[test]
fn a_covariance_stays_one_after_any_pause() {
    let start = first(&plot(10.0, 20.0), 40.0);
    for power in 1..=9 {
        let before = coasted(&start, 10.0_f64.powi(power), 1.0);
        let seen = plot(31.0, -8.0);
        let Some((after, log_density)) = updated(&before.predicted, &seen) else { continue };
        assert!(after.is_sound() && log_density.is_finite(), "10^{power} s: {after:?}");
        let less = seen.covariance_m2 - after.covariance.fixed_view::<2, 2>(0, 0);
        let least = less.symmetric_eigenvalues().min();
        assert!(-1e-3 < least, "10^{power} s: {after:?}");
    }
    // A year is a pause that occurs: nothing of it may be given up.
    assert!(updated(&coasted(&start, 3.2e7, 1.0).predicted, &plot(31.0, -8.0)).is_some());
}
