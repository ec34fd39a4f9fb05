//! Walls from their own echoes, against echoes traced ray by ray.

use std::f64::consts::{FRAC_1_SQRT_2, TAU};

use rand::{SeedableRng, rngs::ChaCha8Rng};
use rand_distr::{Distribution, StandardNormal};

use super::*;
use crate::imaging::single;

/// A slab before the array, and what else is static.
#[derive(Clone, Copy, Debug)]
struct World {
    standoff_m: f64,
    wall: Wall,
    /// Amplitude left after the slab, one way.
    transmission: f64,
    /// Compressed power of the back face at Δx = 0 over noise, decibels.
    snr_db: f64,
    /// Amplitude of the leakage, the back face at Δx = 0 being 1.
    direct: f64,
    /// A reflector this far away, metres, as strong as the back face.
    clutter_m: Option<f64>,
}

const FLUSH: World = World {
    standoff_m: 0.05,
    wall: Wall { thickness_m: 0.24, permittivity: 5.0 },
    transmission: 0.8,
    snr_db: 40.0,
    direct: 0.0,
    clutter_m: Some(4.2),
};

/// The ray through air and slab, there and back `m` times, that arrives `lateral_m` away: its
/// sine by bisection of Snell's law, then its length piece by piece.
fn traced(world: &World, lateral_m: f64, crossings: f64) -> (f64, f64) {
    let (mut low, mut high) = (0.0, 1.0);
    let sides = |sine: f64| {
        let air_m = 2.0 * world.standoff_m / (1.0 - sine * sine).sqrt();
        let root = (world.wall.permittivity - sine * sine).sqrt();
        let slab_m = 2.0 * crossings * world.wall.thickness_m;
        let reached_m = air_m * sine + slab_m * sine / root;
        (reached_m, air_m + slab_m * world.wall.permittivity / root)
    };
    for _ in 0..80 {
        let sine = 0.5 * (low + high);
        if sides(sine).0 < lateral_m { low = sine } else { high = sine }
    }
    (low, sides(low).1)
}

/// Amplitude of face echo `m` (0 front, 1 back, ...) for a field across the plane of incidence,
/// with the spreading of its path.
fn face_amplitude(world: &World, sine: f64, path_m: f64, crossings: i32) -> f64 {
    let cosine = (1.0 - sine * sine).sqrt();
    let root = (world.wall.permittivity - sine * sine).sqrt();
    let reflection = (cosine - root) / (cosine + root);
    let spreading = 2.0 * world.standoff_m / path_m;
    let by_faces = if crossings == 0 {
        reflection
    } else {
        -(1.0 - reflection * reflection) * reflection.powi(2 * crossings - 1)
    };
    by_faces * world.transmission.powi(2 * crossings) * spreading
}

fn background(world: &World, array: &Array, seed: u64) -> Vec<Complex<f32>> {
    let band = Band::default();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let back_path_m = traced(world, 0.0, 1.0).1;
    let back = face_amplitude(world, 0.0, back_path_m, 1);
    let noise = (band.step_count as f64 * 10_f64.powf(-0.1 * world.snr_db)).sqrt();
    let mut samples = Vec::new();
    for (tx, rx) in array.tx_m.iter().flat_map(|tx| array.rx_m.iter().map(move |rx| (tx, rx))) {
        let lateral_m = (tx[0] - rx[0]).abs();
        let mut echoes: Vec<(f64, f64)> = (0..4)
            .map(|crossings| {
                let (sine, path_m) = traced(world, lateral_m, f64::from(crossings));
                (path_m, face_amplitude(world, sine, path_m, crossings) / back)
            })
            .collect();
        echoes.push((lateral_m, world.direct));
        if let Some(clutter_m) = world.clutter_m {
            echoes.push((tx[0].hypot(clutter_m) + rx[0].hypot(clutter_m), 1.0));
        }
        for k in 0..band.step_count {
            let mut sum = Complex::new(0.0, 0.0);
            for (path_m, amplitude) in &echoes {
                let turns = band.frequency_hz(k) * path_m / SPEED_OF_LIGHT_M_PER_S;
                sum += Complex::cis(-TAU * turns) * *amplitude;
            }
            let mut draw = || -> f64 { StandardNormal.sample(&mut rng) };
            sum += Complex::new(draw(), draw()) * (FRAC_1_SQRT_2 * noise);
            samples.push(Complex::new(single(sum.re), single(sum.im)));
        }
    }
    samples
}

fn estimator(search: &WallSearch) -> WallEstimator {
    WallEstimator::new(&Band::default(), &Array::default(), search).unwrap()
}

fn estimated(outcome: WallOutcome) -> EstimatedWall {
    match outcome {
        WallOutcome::Estimated(wall) => wall,
        WallOutcome::NotObservable { why, .. } => panic!("{why:?}"),
    }
}

/// Trials of a world: errors over their covariance, of the excess path, and its standard deviation.
struct Trials {
    mean_nees: f64,
    excess_rms_m: f64,
    excess_sigma_m: f64,
    worst_sigmas: f64,
    count: usize,
}

fn trials(world: &World, search: &WallSearch, trial_count: u64) -> Trials {
    let estimator = estimator(search);
    let Wall { thickness_m, permittivity } = world.wall;
    let truth = Vector3::new(world.standoff_m, thickness_m * permittivity.sqrt(), permittivity);
    let truth_excess_m = excess_path_m(&world.wall);
    let mut sums = Trials {
        mean_nees: 0.0,
        excess_rms_m: 0.0,
        excess_sigma_m: 0.0,
        worst_sigmas: 0.0,
        count: 0,
    };
    for seed in 0..trial_count {
        let samples = background(world, &Array::default(), seed);
        let WallOutcome::Estimated(found) = estimator.estimate(&samples).unwrap() else { continue };
        let error =
            Vector3::new(found.standoff_m, found.optical_thickness_m, found.wall.permittivity)
                - truth;
        sums.mean_nees += error.dot(&(found.covariance.try_inverse().unwrap() * error));
        let off_m = found.excess_path_m - truth_excess_m;
        sums.excess_rms_m += off_m * off_m;
        sums.excess_sigma_m += found.excess_path_sigma_m;
        sums.worst_sigmas = sums.worst_sigmas.max((off_m / found.excess_path_sigma_m).abs());
        sums.count += 1;
    }
    let count = sums.count as f64;
    Trials {
        mean_nees: sums.mean_nees / count,
        excess_rms_m: (sums.excess_rms_m / count).sqrt(),
        excess_sigma_m: sums.excess_sigma_m / count,
        ..sums
    }
}

/// The mean of 200 values of 3 degrees of freedom errs by 0.17; the noise is estimated from what is
/// left, which holds leakage and weak multiples too.
const NEES_RANGE: std::ops::Range<f64> = 2.0..3.9;

#[test]
fn errors_are_as_claimed_before_a_flush_wall() {
    // 7 ps and 22 ps of delay give 4 and 13 mm.
    for (snr_db, trial_count, excess_bar_m) in [(40.0, 200, 0.005), (30.0, 200, 0.015)] {
        let trials = trials(&World { snr_db, ..FLUSH }, &WallSearch::default(), trial_count);
        assert!(NEES_RANGE.contains(&trials.mean_nees), "{snr_db} dB: NEES {}", trials.mean_nees);
        assert!(trials.excess_rms_m < excess_bar_m, "{snr_db} dB: {} m", trials.excess_rms_m);
        assert!((0.6..1.2).contains(&(trials.excess_rms_m / trials.excess_sigma_m)));
        assert!(trials.worst_sigmas < 4.5, "{snr_db} dB: {} sigmas", trials.worst_sigmas);
        assert!(0.95 * trial_count as f64 <= trials.count as f64, "{snr_db} dB: {}", trials.count);
    }
}

#[test]
fn errors_are_as_claimed_at_a_distance_without_other_echoes() {
    let world = World { standoff_m: 0.3, clutter_m: None, ..FLUSH };
    let search = WallSearch { max_excess_sigma_m: 0.1, ..WallSearch::default() };
    let trials = trials(&world, &search, 100);
    assert!(NEES_RANGE.contains(&trials.mean_nees), "NEES {}", trials.mean_nees);
    assert!(trials.excess_rms_m < 0.03 && trials.count == 100, "{} m", trials.excess_rms_m);
}

#[test]
fn walls_of_all_kinds_are_found_where_noise_is_weak() {
    let kinds = [
        (0.02, 0.1, 8.0, 0.9),
        (0.05, 0.4, 3.0, 0.9),
        (0.1, 0.2, 6.0, 0.5),
        // Without multiples that show, half the thickness explains both faces.
        (0.05, 0.24, 5.0, 0.1),
        (0.3, 0.15, 10.0, 0.8),
    ];
    let trials = kinds.iter().flat_map(|kind| (0..5).map(move |seed| (*kind, seed)));
    for ((standoff_m, thickness_m, permittivity, transmission), seed) in trials {
        let wall = Wall { thickness_m, permittivity };
        let world =
            World { standoff_m, wall, transmission, snr_db: 60.0, clutter_m: None, ..FLUSH };
        let samples = background(&world, &Array::default(), seed);
        let found = estimated(estimator(&WallSearch::default()).estimate(&samples).unwrap());
        assert!((found.standoff_m - standoff_m).abs() < 0.001, "{world:?}: {found:?}");
        let off_m = (found.excess_path_m - excess_path_m(&wall)).abs();
        assert!(off_m < 4.0 * found.excess_path_sigma_m + 0.001, "{world:?}: {found:?}");
        let thickness_error_m = (found.wall.thickness_m - thickness_m).abs();
        assert!(thickness_error_m < 4.0 * found.thickness_sigma_m + 0.001, "{world:?}: {found:?}");
    }
}

#[test]
fn at_a_metre_the_optical_thickness_is_all_that_is_seen() {
    let world = World { standoff_m: 1.0, ..FLUSH };
    for seed in 0..10 {
        let samples = background(&world, &Array::default(), seed);
        let outcome = estimator(&WallSearch::default()).estimate(&samples).unwrap();
        let WallOutcome::NotObservable { why, assumed } = outcome else { panic!("{outcome:?}") };
        assert!(
            matches!(why, WhyNot::OffsetsTooSmall { standoff_m, .. } if (standoff_m - 1.0).abs() < 0.01),
            "{why:?}"
        );
        // The prior's permittivity is right here: what is left is its claimed error.
        assert!(assumed.excess_path_sigma_m < 0.03, "{assumed:?}");
        let off_m = (assumed.excess_path_m - excess_path_m(&world.wall)).abs();
        assert!(off_m < assumed.excess_path_sigma_m, "{assumed:?}");
    }
}

#[test]
fn without_a_wall_the_prior_is_named_as_assumed() {
    let estimator = estimator(&WallSearch::default());
    let loud = World { snr_db: -300.0, clutter_m: None, ..FLUSH };
    let no_back = World { snr_db: 5.0, clutter_m: None, ..FLUSH };
    for world in [loud, no_back] {
        for seed in 0..20 {
            let samples = background(&world, &Array::default(), seed);
            // Noise of power 1 whatever the level of the faces.
            let scale = single(10_f64.powf(0.05 * world.snr_db));
            let samples: Vec<Complex<f32>> = samples.iter().map(|s| s * scale).collect();
            let outcome = estimator.estimate(&samples).unwrap();
            let WallOutcome::NotObservable { why, assumed } = outcome else {
                panic!("{outcome:?}")
            };
            assert!(matches!(why, WhyNot::NoFaces { .. }), "{why:?}");
            assert!((assumed.wall.thickness_m - 0.24).abs() < 1e-12);
            assert!((assumed.excess_path_sigma_m - 0.092).abs() < 0.001, "{assumed:?}");
        }
    }
    let silence = vec![Complex::default(); 8 * 301];
    let outcome = estimator.estimate(&silence).unwrap();
    assert!(matches!(outcome, WallOutcome::NotObservable { why: WhyNot::NoFaces { .. }, .. }));
}

#[test]
fn leakage_between_the_antennas_is_fitted_with_the_rest() {
    for standoff_m in [0.05, 0.1] {
        let world = World { direct: 1.0, standoff_m, ..FLUSH };
        let samples = background(&world, &Array::default(), 7);
        let search = WallSearch { direct: DirectCoupling::Present, ..WallSearch::default() };
        let found = estimated(estimator(&search).estimate(&samples).unwrap());
        let off_m = (found.excess_path_m - excess_path_m(&world.wall)).abs();
        assert!(off_m < 3.0 * found.excess_path_sigma_m && off_m < 0.02, "{found:?}");
        assert!((found.standoff_m - standoff_m).abs() < 0.003, "{found:?}");
    }
}

#[test]
fn antennas_before_the_arrays_line_are_nearer_to_the_wall() {
    let ahead = |antenna: &[f64; 2]| [antenna[0], 0.04];
    let plain = Array::default();
    let array = Array {
        tx_m: plain.tx_m.iter().map(ahead).collect(),
        rx_m: plain.rx_m.iter().map(ahead).collect(),
    };
    let estimator = WallEstimator::new(&Band::default(), &array, &WallSearch::default()).unwrap();
    let found = estimated(estimator.estimate(&background(&FLUSH, &array, 1)).unwrap());
    assert!((found.standoff_m - 0.09).abs() < 0.001, "{found:?}");
}

#[test]
fn samples_and_settings_of_nonsense_are_refused() {
    let estimator = estimator(&WallSearch::default());
    let short = vec![Complex::default(); 5];
    let error = estimator.estimate(&short).unwrap_err();
    assert_eq!(error, WallEstimateError::SampleCount { got: 5, want: 2408 });
    let mut broken = vec![Complex::default(); 2408];
    broken[77].im = f32::NAN;
    assert_eq!(
        estimator.estimate(&broken).unwrap_err(),
        WallEstimateError::NotFinite { index: 77 }
    );
    let good = WallSearch::default();
    let refused = |search: WallSearch| {
        WallEstimator::new(&Band::default(), &Array::default(), &search).unwrap_err().field
    };
    let far = WallSearch { max_standoff_m: 11.0, ..good };
    assert_eq!(refused(far), "wall_search.max_standoff_m");
    let prior = WallPrior { permittivity: 0.5, ..good.prior };
    assert_eq!(refused(WallSearch { prior, ..good }), "wall_search.prior.permittivity");
    let coarse = Band { step_hz: 1e8, step_count: 7, ..Band::default() };
    let refusal = WallEstimator::new(&coarse, &Array::default(), &good).unwrap_err();
    assert_eq!(refusal.field, "wall_search.max_standoff_m");
}

#[test]
fn leakage_that_was_not_removed_does_not_look_like_a_wall() {
    for direct in [1.0, 10.0] {
        let world = World { direct, standoff_m: 0.3, ..FLUSH };
        let samples = background(&world, &Array::default(), 7);
        let outcome = estimator(&WallSearch::default()).estimate(&samples).unwrap();
        let none =
            matches!(outcome, WallOutcome::NotObservable { why: WhyNot::NoFaces { .. }, .. });
        assert!(none, "{outcome:?}");
    }
}
