//! The point response against a plain sum, and its slopes against difference quotients.

use super::*;
use crate::detect::moments::to_polar;
use crate::imaging::backproject::CoherentImage;
use crate::imaging::compress::{Compressor, Profiles};
use crate::imaging::pixels::Pixels;
use crate::imaging::single;
use crate::imaging::window::Window;
use proto::radar::Grid;

/// The profiles of one point, by the plain sum over legs and frequencies.
fn profiles_of(place_m: [f64; 2], weights: &[f64]) -> Profiles {
    let (band, array) = (Band::default(), Array::default());
    let echo = |(tx, rx): (&[f64; 2], &[f64; 2])| -> Vec<Complex<f32>> {
        let path_m =
            (place_m[0] - tx[0]).hypot(place_m[1]) + (place_m[0] - rx[0]).hypot(place_m[1]);
        let turns = |k| band.frequency_hz(k) * path_m / SPEED_OF_LIGHT_M_PER_S;
        let sample = |z: Complex<f64>| Complex::new(single(z.re), single(z.im));
        (0..band.step_count).map(|k| sample(Complex::cis(-TAU * turns(k)))).collect()
    };
    let pairs = array.tx_m.iter().flat_map(|tx| array.rx_m.iter().map(move |rx| (tx, rx)));
    let samples: Vec<Complex<f32>> = pairs.flat_map(echo).collect();
    Compressor::new(&band, weights, 2048).compress(&samples)
}

#[test]
fn the_model_is_what_compression_makes_of_an_echo() {
    let (band, array) = (Band::default(), Array::default());
    for window in [Window::Rectangular, Window::Taylor] {
        let weights = window.weights(band.step_count);
        let model = PointModel::new(&band, &array, &WallModel::None, &weights);
        let profiles = profiles_of([1.2, 3.9], &weights);
        let image = CoherentImage {
            pixels: Pixels::Cartesian(Grid::default()),
            channel_count: 8,
            power: vec![],
            energy: vec![],
            phase_coherence: vec![],
        };
        let scan = Scan { profiles: &profiles, image: &image, amplitude: &[], noise_power: 1.0 };
        let place = to_polar(&nalgebra::Vector2::new(1.2, 3.9));
        // The patch lies around a place nearby: the tails of the response count, too.
        let patch = model.patch(&scan, &[place + Polar::new(0.1, 0.03)]).unwrap();
        assert!(24 <= patch.samples.len());
        let error =
            (&model.response(&patch, &place)[0] - &patch.samples).norm() / patch.samples.norm();
        assert!(error < 1e-3, "{window:?}: {error}");
    }
}

#[test]
fn whitened_noise_is_white() {
    let band = Band::default();
    let weights = Window::Hann.weights(band.step_count);
    let model = PointModel::new(&band, &Array::default(), &WallModel::None, &weights);
    let delays_s: Vec<f64> = (0..5).map(|n| 1.5e-9 * f64::from(n)).collect();
    let inverse = model.whitening(&delays_s).unwrap();
    let root = inverse.try_inverse().unwrap();
    let power: f64 = weights.iter().map(|w| w * w).sum();
    let covariance = &root * root.adjoint();
    for (row, column) in [(0, 0), (1, 0), (4, 2), (0, 3)] {
        let lag_s = delays_s[row] - delays_s[column];
        let want: Complex<f64> = (0..band.step_count)
            .map(|k| {
                Complex::cis(TAU * (band.frequency_hz(k) - 1.9e9) * lag_s) * weights[k].powi(2)
            })
            .sum();
        assert!((covariance[(row, column)] - want / power).norm() < 1e-3, "{row} {column}");
    }
}

#[test]
fn slopes_are_difference_quotients() {
    let (band, array) = (Band::default(), Array::default());
    let weights = Window::Taylor.weights(band.step_count);
    let wall = WallModel::Refraction(proto::radar::Wall { thickness_m: 0.24, permittivity: 5.0 });
    let model = PointModel::new(&band, &array, &wall, &weights);
    let profiles = profiles_of([1.2, 3.9], &weights);
    let image = CoherentImage {
        pixels: Pixels::Cartesian(Grid::default()),
        channel_count: 8,
        power: vec![],
        energy: vec![],
        phase_coherence: vec![],
    };
    let scan = Scan { profiles: &profiles, image: &image, amplitude: &[], noise_power: 1.0 };
    let place = to_polar(&nalgebra::Vector2::new(1.2, 3.9));
    let patch = model.patch(&scan, &[place]).unwrap();
    for (axis, step) in [(0, Polar::new(1e-5, 0.0)), (1, Polar::new(0.0, 1e-5))] {
        let at = |shifted: Polar| model.response(&patch, &shifted)[0].clone();
        let quotient = (at(place + step) - at(place - step)) / Complex::new(2e-5, 0.0);
        let error = (&model.response(&patch, &place)[1 + axis] - &quotient).norm();
        // The table's chords differ from its slopes by a hundredth.
        assert!(error < 0.01 * quotient.norm(), "axis {axis}: {}", error / quotient.norm());
    }
}
