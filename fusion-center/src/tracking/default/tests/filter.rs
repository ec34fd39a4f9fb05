//! The filter and the smoother against plain matrices.

use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Matrix3x4, Matrix4, Vector2, Vector3, Vector4};

use super::super::DefaultConfig;
use super::super::branch::Moment;
use super::super::config::Way;
use super::super::gauss::{Gauss, Step};
use super::super::imm::{Imm, Steps};
use super::super::smooth::smoothed;
use super::scenes::{normal, rng};
use crate::tracking::{Plot, Radial, Status};

/// Relative, of some tens of products of doubles.
const TOLERANCE: f64 = 1e-9;
/// Relative, of a sum of 20,000 steps of Euler's kind.
const INTEGRAL_TOLERANCE: f64 = 1e-3;

fn plot(seed: u64) -> Plot {
    let mut rng = rng(seed, 0);
    let mut value = |scale: f64| scale * normal(&mut rng);
    let root = Matrix2::new(value(20.0), value(5.0), value(5.0), value(20.0));
    let direction = Vector2::new(value(0.5), value(0.5));
    Plot {
        position_m: Vector2::new(value(50.0), value(50.0)),
        covariance_m2: root * root.transpose() + Matrix2::identity(),
        radial: Some(Radial {
            velocity_m_per_s: value(10.0),
            sigma_m_per_s: 1.5,
            direction,
            wrap_m_per_s: None,
        }),
        strength_db: None,
        report_index: 0,
    }
}

fn start() -> Gauss {
    let mut start = Gauss::at(&plot(1), 7.0);
    start.mean = [3.0, -4.0, 5.0, 6.0];
    start.stepped(&Step::new(2.0, 30.0, 0.4))
}

fn assert_near(a: &Matrix4<f64>, b: &Matrix4<f64>, relative: f64) {
    assert!((a - b).norm() <= relative * b.norm(), "{a} {b}");
}

#[test]
fn a_step_is_the_integral_of_its_noise() {
    let (dt_s, memory_s, push) = (3.0, 2.0, 0.7);
    let parts = 20_000;
    let h = dt_s / f64::from(parts);
    let mut small = Matrix4::identity();
    for axis in 0..2 {
        small[(axis, axis + 2)] = h;
        small[(axis + 2, axis + 2)] = 1.0 - h / memory_s;
    }
    let (mut mean, mut cov) = (start().state(), start().covariance());
    for _ in 0..parts {
        mean = small * mean;
        cov = small * cov * small.transpose();
        cov[(2, 2)] += push * h;
        cov[(3, 3)] += push * h;
    }
    let after = start().stepped(&Step::new(dt_s, memory_s, push));
    assert!((after.state() - mean).norm() < INTEGRAL_TOLERANCE * mean.norm());
    assert_near(&after.covariance(), &cov, INTEGRAL_TOLERANCE);
    let long = start().stepped(&Step::new(dt_s, f64::INFINITY, push));
    let longer = start().stepped(&Step::new(dt_s, 1e4, push));
    assert_near(&long.covariance(), &longer.covariance(), INTEGRAL_TOLERANCE);
}

#[test]
fn an_update_is_that_of_the_three_measured_numbers_together() {
    for seed in 2..20 {
        let (before, plot) = (start(), plot(seed));
        let radial = plot.radial.unwrap();
        let mut h = Matrix3x4::zeros();
        (h[(0, 0)], h[(1, 1)]) = (1.0, 1.0);
        (h[(2, 2)], h[(2, 3)]) = (radial.direction.x, radial.direction.y);
        let mut noise = Matrix3::zeros();
        noise.fixed_view_mut::<2, 2>(0, 0).copy_from(&plot.covariance_m2);
        noise[(2, 2)] = radial.sigma_m_per_s.powi(2);
        let p = before.covariance();
        let spread = h * p * h.transpose() + noise;
        let inverse = spread.try_inverse().unwrap();
        let measured = Vector3::new(plot.position_m.x, plot.position_m.y, radial.velocity_m_per_s);
        let off = measured - h * before.state();
        let gain = p * h.transpose() * inverse;
        let volume = (std::f64::consts::TAU.powi(3) * spread.determinant()).ln();
        let fit = before.fit(&plot);
        let distance2 = off.dot(&(inverse * off));
        assert!((fit.distance2 - distance2).abs() < TOLERANCE * (1.0 + distance2));
        assert!((fit.log_density() + 0.5 * (distance2 + volume)).abs() < TOLERANCE * 100.0);
        let mut after = before;
        after.update(&plot);
        let expected: Vector4<f64> = before.state() + gain * off;
        assert!((after.state() - expected).norm() < TOLERANCE * expected.norm());
        assert_near(&after.covariance(), &(p - gain * spread * gain.transpose()), TOLERANCE);
    }
}

#[test]
fn a_radial_velocity_counts_up_to_its_wrap_and_not_where_that_is_unclear() {
    let mut clear = plot(3);
    let radial = clear.radial.as_mut().unwrap();
    radial.wrap_m_per_s = Some(60.0);
    let mut shifted = clear.clone();
    shifted.radial.as_mut().unwrap().velocity_m_per_s += 120.0;
    let (mut one, mut other) = (start(), start());
    one.update(&clear);
    other.update(&shifted);
    assert!((one.state() - other.state()).norm() < TOLERANCE * 100.0);
    assert!(
        (start().fit(&clear).log_density() - start().fit(&shifted).log_density()).abs() < TOLERANCE
    );
    // What is expected spreads over about 5 m/s: with a wrap of 8 m/s, it says nothing.
    clear.radial.as_mut().unwrap().wrap_m_per_s = Some(8.0);
    let place_only = Plot { radial: None, ..clear.clone() };
    let [with, without] = [&clear, &place_only].map(|plot| {
        let mut state = start();
        state.update(plot);
        (state, start().fit(plot).log_density())
    });
    assert_eq!(with.0, without.0);
    assert!((with.1 - (without.1 - 8.0_f64.ln())).abs() < TOLERANCE);
}

#[test]
fn mixing_keeps_mean_and_covariance_of_the_mixture() {
    let (one, other) = (start(), start().stepped(&Step::new(1.0, 5.0, 2.0)));
    let [p, q] = [0.3, 0.7];
    let mean = p * one.state() + q * other.state();
    let second = |of: &Gauss| of.covariance() + of.state() * of.state().transpose();
    let cov = p * second(&one) + q * second(&other) - mean * mean.transpose();
    let mixed = one.mixed(&other, p);
    assert!((mixed.state() - mean).norm() < TOLERANCE * mean.norm());
    assert_near(&mixed.covariance(), &cov, TOLERANCE * 100.0);
}

/// Ways of moving that are alike: then all follows from one linear problem.
const WAY: Way = Way { push_m2_per_s3: 0.5, push_s: 0.0, memory_s: f64::INFINITY, sojourn_s: 10.0 };
const TIMES_S: [f64; 5] = [0.0, 2.0, 2.5, 5.0, 9.0];

/// States at all times and their covariance by least squares over all plots and steps at once.
fn least_squares(plots: &[Plot]) -> (DVector<f64>, DMatrix<f64>) {
    let size = 4 * TIMES_S.len();
    let (mut information, mut vector) = (DMatrix::zeros(size, size), DVector::zeros(size));
    let first = start().covariance().try_inverse().unwrap();
    information.fixed_view_mut::<4, 4>(0, 0).copy_from(&first);
    vector.rows_mut(0, 4).copy_from(&(first * start().state()));
    let mut add = |row: usize, column: usize, block: Matrix4<f64>| {
        let mut view = information.fixed_view_mut::<4, 4>(4 * row, 4 * column);
        view += block;
    };
    for (index, pair) in TIMES_S.windows(2).enumerate() {
        let h = pair[1] - pair[0];
        let mut f = Matrix4::identity();
        (f[(0, 2)], f[(1, 3)]) = (h, h);
        let noise = Matrix2::new(h.powi(3) / 3.0, h * h / 2.0, h * h / 2.0, h);
        let q = (noise * WAY.push_m2_per_s3).kronecker(&Matrix2::identity());
        let q = q.try_inverse().unwrap();
        add(index, index, f.transpose() * q * f);
        add(index, index + 1, -f.transpose() * q);
        add(index + 1, index, -q * f);
        add(index + 1, index + 1, q);
    }
    for (index, plot) in plots.iter().enumerate() {
        let radial = plot.radial.unwrap();
        let d = Vector4::new(0.0, 0.0, radial.direction.x, radial.direction.y);
        let mut place = Matrix4::zeros();
        let inverse = plot.covariance_m2.try_inverse().unwrap();
        place.fixed_view_mut::<2, 2>(0, 0).copy_from(&inverse);
        let weight = radial.sigma_m_per_s.powi(-2);
        add(index, index, place + d * d.transpose() * weight);
        let at = Vector4::new(plot.position_m.x, plot.position_m.y, 0.0, 0.0);
        let mut rows = vector.rows_mut(4 * index, 4);
        rows += place * at + d * (radial.velocity_m_per_s * weight);
    }
    let covariance = information.try_inverse().unwrap();
    (&covariance * vector, covariance)
}

#[test]
fn smoothing_is_least_squares_over_everything() {
    let config = DefaultConfig { steady: WAY, lively: WAY, ..DefaultConfig::wide_area() };
    let plots: Vec<Plot> = (0..5).map(|seed| plot(30 + seed)).collect();
    let mut imm = Imm::new(start(), 0.5);
    let mut moments: Vec<Moment> = Vec::new();
    for (plot, time_s) in plots.iter().zip(TIMES_S) {
        if let Some(last) = moments.last() {
            imm = imm.stepped(&Steps::new(time_s - last.time_s, &config.ways()));
        }
        let first_share = imm.weighed(&imm.fits(plot)).1;
        imm.update(plot, first_share);
        let (status, report, share) = (Status::Confirmed, None, 1.0);
        moments.push(Moment { time_s, imm, status, report, share, fresh: false });
    }
    let (states, covariance) = least_squares(&plots);
    for (index, smooth) in smoothed(&moments, &config.ways()).into_iter().enumerate() {
        let (state, cov) = (smooth.state(), smooth.covariance());
        let expected = Vector4::from_iterator(states.rows(4 * index, 4).iter().copied());
        assert!((state - expected).norm() < 1e3 * TOLERANCE * expected.norm(), "{index}");
        let block = covariance.fixed_view::<4, 4>(4 * index, 4 * index).into_owned();
        assert_near(&cov, &block, 1e3 * TOLERANCE);
    }
}
