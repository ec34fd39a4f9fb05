//! Against the solution of all steps at once by least squares.

use nalgebra::{DMatrix, DVector, Matrix2, Matrix2x4, Vector2};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use super::*;

/// Rounding of sums of a few hundred terms of at most some 1000 (metres, square metres) in a system
/// whose condition is about 1e5.
const SAME: f64 = 1e-6;

struct Chain {
    passes: Vec<Pass>,
    prior: Belief,
    noises: Vec<Matrix4<f64>>,
    measured: Vec<Option<(Vector2<f64>, Matrix2<f64>)>>,
}

fn transition(dt_s: f64) -> Matrix4<f64> {
    let mut transition = Matrix4::identity();
    transition[(0, 2)] = dt_s;
    transition[(1, 3)] = dt_s;
    transition
}

fn rows() -> Matrix2x4<f64> {
    Matrix2x4::new(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0)
}

fn updated(predicted: &Belief, measured: Option<&(Vector2<f64>, Matrix2<f64>)>) -> Belief {
    let Some((place, noise)) = measured else { return *predicted };
    let spread = rows() * predicted.covariance * rows().transpose() + noise;
    let gain = predicted.covariance * rows().transpose() * spread.try_inverse().unwrap();
    Belief {
        mean: predicted.mean + gain * (place - rows() * predicted.mean),
        covariance: (Matrix4::identity() - gain * rows()) * predicted.covariance,
    }
}

/// A random chain; every third step has no measurement, and two steps are at the same time.
fn chain(seed: u64) -> Chain {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut some = |half: f64| rng.random_range(-half..half);
    let prior = Belief {
        mean: Vector4::new(some(100.0), some(100.0), some(10.0), some(10.0)),
        covariance: Matrix4::from_diagonal(&Vector4::new(400.0, 300.0, 50.0, 70.0)),
    };
    let (mut passes, mut noises, mut measured) = (Vec::new(), Vec::new(), Vec::new());
    let mut filtered = prior;
    for step in 0..7 {
        let transition = transition([0.0, 4.0, 4.0, 1e-9, 2.5, 5.0, 4.0][step]);
        let noise = Matrix4::from_diagonal(&Vector4::new(2.0, 1.0, 0.5, 0.3));
        let noise = if step == 0 { Matrix4::zeros() } else { noise };
        let predicted = Belief {
            mean: transition * filtered.mean,
            covariance: transition * filtered.covariance * transition.transpose() + noise,
        };
        let plot = (
            predicted.mean.fixed_rows::<2>(0) + Vector2::new(some(30.0), some(30.0)),
            Matrix2::new(200.0, 30.0, 30.0, 90.0),
        );
        let plot = (step % 3 != 2).then_some(plot);
        filtered = updated(&predicted, plot.as_ref());
        passes.push(Pass { transition, predicted, filtered });
        noises.push(noise);
        measured.push(plot);
    }
    Chain { passes, prior, noises, measured }
}

/// Means and covariances of all steps from the information of the whole chain at once.
fn all_at_once(chain: &Chain) -> (DVector<f64>, DMatrix<f64>) {
    let count = chain.passes.len();
    let mut information = DMatrix::<f64>::zeros(4 * count, 4 * count);
    let mut pull = DVector::<f64>::zeros(4 * count);
    let mut add =
        |places: &[(usize, DMatrix<f64>)], weight: &DMatrix<f64>, value: &DVector<f64>| {
            let mut rows = DMatrix::<f64>::zeros(weight.nrows(), 4 * count);
            for (step, block) in places {
                rows.view_mut((0, 4 * step), (block.nrows(), 4)).copy_from(block);
            }
            information += rows.transpose() * weight * &rows;
            pull += rows.transpose() * weight * value;
        };
    let dynamic = |matrix: &Matrix4<f64>| DMatrix::from_column_slice(4, 4, matrix.as_slice());
    let inverse = |matrix: &Matrix4<f64>| dynamic(&matrix.try_inverse().unwrap());
    let mean = DVector::from_column_slice(chain.prior.mean.as_slice());
    add(&[(0, DMatrix::identity(4, 4))], &inverse(&chain.prior.covariance), &mean);
    for step in 0..count {
        if 0 < step {
            let places = [
                (step - 1, -dynamic(&chain.passes[step].transition)),
                (step, DMatrix::identity(4, 4)),
            ];
            add(&places, &inverse(&chain.noises[step]), &DVector::zeros(4));
        }
        if let Some((place, noise)) = &chain.measured[step] {
            let weight = DMatrix::from_column_slice(2, 2, noise.try_inverse().unwrap().as_slice());
            let rows = DMatrix::from_column_slice(2, 4, rows().as_slice());
            add(&[(step, rows)], &weight, &DVector::from_column_slice(place.as_slice()));
        }
    }
    let covariance = information.try_inverse().unwrap();
    (&covariance * pull, covariance)
}

#[test]
fn every_step_is_as_if_all_were_solved_at_once() {
    for seed in 0..20 {
        let chain = chain(seed);
        let mut smoothed = Vec::new();
        smooth(&chain.passes, &mut smoothed).unwrap();
        let (mean, covariance) = all_at_once(&chain);
        for (step, belief) in smoothed.iter().enumerate() {
            let want = mean.rows(4 * step, 4).into_owned();
            let off = (DVector::from_column_slice(belief.mean.as_slice()) - want).amax();
            assert!(off < SAME, "seed {seed} step {step}: mean off by {off}");
            let block = covariance.view((4 * step, 4 * step), (4, 4)).into_owned();
            let got = DMatrix::from_column_slice(4, 4, belief.covariance.as_slice());
            let spread_off = (got - block).amax();
            assert!(spread_off < SAME, "seed {seed} step {step}: covariance off by {spread_off}");
        }
    }
}

#[test]
fn short_chains_stay_as_they_are() {
    let mut smoothed = vec![chain(1).prior];
    smooth(&[], &mut smoothed).unwrap();
    assert!(smoothed.is_empty());
    let one = &chain(2).passes[..1];
    smooth(one, &mut smoothed).unwrap();
    assert_eq!(smoothed, [one[0].filtered]);
}

#[test]
fn a_prediction_of_no_spread_is_refused_by_its_number() {
    let mut passes = chain(3).passes;
    passes[4].predicted.covariance[(1, 1)] = -1.0;
    let refused = smooth(&passes, &mut Vec::new());
    assert_eq!(refused, Err(NotPositive { step_index: 4 }));
}

/// A prediction less certain than what follows by 24 orders of magnitude, as after years.
#[test]
fn after_years_what_was_known_stands_and_covariances_stay_such() {
    for dt_s in [1e3, 1e5, 1e7, 1e9] {
        let mut passes = chain(4).passes;
        let mut before = passes[2].filtered;
        for (step, pass) in passes.iter_mut().enumerate().skip(3) {
            let transition = transition(if step == 3 { dt_s } else { 4.0 });
            let noise = Matrix4::from_diagonal(&Vector4::new(dt_s.powi(3), dt_s.powi(3), 1.0, 1.0));
            let noise = if step == 3 { noise } else { Matrix4::identity() };
            let predicted = Belief {
                mean: transition * before.mean,
                covariance: transition * before.covariance * transition.transpose() + noise,
            };
            before = known(&predicted);
            *pass = Pass { transition, predicted, filtered: before };
        }
        let mut smoothed = Vec::new();
        smooth(&passes, &mut smoothed).unwrap();
        assert!(smoothed.iter().all(Belief::is_sound), "{dt_s} s: {smoothed:?}");
    }
}

/// A belief of known spread, whatever was predicted.
fn known(predicted: &Belief) -> Belief {
    let covariance = Matrix4::from_diagonal(&Vector4::new(100.0, 100.0, 25.0, 25.0));
    Belief { mean: predicted.mean, covariance }
}
