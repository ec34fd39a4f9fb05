//! Position and velocity of a target that moves nearly straight, filtered with its derivatives.
//!
//! The state is the position `p` and the velocity `v`; `v` is a random walk of intensity `q` in
//! m²/s³, `q = 0` a straight walk at constant speed. Over `τ` seconds
//! `p ← p + τ v`, `A ← A + τ (B + Bᵀ) + τ² D + q τ³/3 I`, `B ← B + τ D + q τ²/2 I`, `D ← D + q τ I`,
//! with the covariances `A` of `p`, `B` of `p` with `v` and `D` of `v`. A point with covariance `R`
//! gives `F = A + R`, `p ← p + A F⁻¹ ν`, `v ← v + Bᵀ F⁻¹ ν`, `A ← A − A F⁻¹ A` and so on.
//!
//! Everything is linear, so the derivatives of the measured positions by unknowns of all targets
//! pass through the same gains as further columns. Column 0 is the value.

use std::f64::consts::TAU;

use nalgebra::{Matrix2, Vector2};

/// A measured position in the reference frame with its derivatives.
pub(super) struct Observation<const C: usize> {
    pub(super) columns: [Vector2<f64>; C],
    pub(super) cov_m2: Matrix2<f64>,
    pub(super) time_s: f64,
}

/// What is known of a target at a time.
#[derive(Clone, Copy)]
pub(super) struct State<const C: usize> {
    position: [Vector2<f64>; C],
    velocity: [Vector2<f64>; C],
    position_cov: Matrix2<f64>,
    cross_cov: Matrix2<f64>,
    velocity_cov: Matrix2<f64>,
    time_s: f64,
}

/// Difference of a point from its prediction.
pub(super) struct Innovation<const C: usize> {
    pub(super) columns: [Vector2<f64>; C],
    /// `F⁻¹` in 1/m².
    pub(super) precision: Matrix2<f64>,
    /// Squared Mahalanobis distance of column 0.
    pub(super) chi_square: f64,
    /// Determinant of `F`, m⁴.
    determinant_m4: f64,
}

impl<const C: usize> Innovation<C> {
    /// Natural logarithm of the density of column 0 in 1/m².
    pub(super) fn log_density(&self) -> f64 {
        -0.5 * (self.chi_square + self.determinant_m4.ln()) - TAU.ln()
    }
}

impl<const C: usize> State<C> {
    /// After the first point: its position, and a velocity of zero mean and `velocity_sigma_mps`
    /// per axis.
    pub(super) fn starting(first: &Observation<C>, velocity_sigma_mps: f64) -> Self {
        Self {
            position: first.columns,
            velocity: [Vector2::zeros(); C],
            position_cov: first.cov_m2,
            cross_cov: Matrix2::zeros(),
            velocity_cov: Matrix2::from_diagonal_element(velocity_sigma_mps.powi(2)),
            time_s: first.time_s,
        }
    }

    /// The time that the state holds for, seconds.
    pub(super) fn time_s(&self) -> f64 {
        self.time_s
    }

    /// Moves on to `time_s` under acceleration noise of `noise_m2ps3`.
    pub(super) fn predict(&mut self, time_s: f64, noise_m2ps3: f64) {
        let step_s = time_s - self.time_s;
        if step_s <= 0.0 {
            return;
        }
        for (position, velocity) in self.position.iter_mut().zip(&self.velocity) {
            *position += velocity * step_s;
        }
        let noise = Matrix2::from_diagonal_element(noise_m2ps3 * step_s);
        self.position_cov += (self.cross_cov + self.cross_cov.transpose()) * step_s
            + self.velocity_cov * step_s.powi(2)
            + noise * (step_s * step_s / 3.0);
        self.cross_cov += self.velocity_cov * step_s + noise * (0.5 * step_s);
        self.velocity_cov += noise;
        self.time_s = time_s;
    }

    /// Whether `point` is so far from column 0 that its squared Mahalanobis distance exceeds `gate`
    /// for certain, also with `added_m2` on top of the variance of each axis: no eigenvalue of a
    /// covariance exceeds its trace.
    pub(super) fn is_beyond(&self, point: &Observation<C>, (gate, added_m2): (f64, f64)) -> bool {
        let distance_m2 = (point.columns[0] - self.position[0]).norm_squared();
        let trace_m2 = self.position_cov.trace() + point.cov_m2.trace() + 2.0 * added_m2;
        distance_m2 > gate * trace_m2
    }

    /// Difference of `point`, taken at the time of this state.
    pub(super) fn innovation(&self, point: &Observation<C>) -> Innovation<C> {
        let cov = self.position_cov + point.cov_m2;
        let (xx, xy, yy) = (cov.m11, 0.5 * (cov.m12 + cov.m21), cov.m22);
        let determinant = xx * yy - xy * xy;
        let precision = Matrix2::new(yy, -xy, -xy, xx) / determinant;
        let columns = std::array::from_fn(|c| point.columns[c] - self.position[c]);
        let chi_square = columns[0].dot(&(precision * columns[0]));
        Innovation { columns, precision, chi_square, determinant_m4: determinant }
    }

    /// Takes a point in.
    pub(super) fn absorb(&mut self, innovation: &Innovation<C>) {
        let gain = self.position_cov * innovation.precision;
        let velocity_gain = self.cross_cov.transpose() * innovation.precision;
        for (c, difference) in innovation.columns.iter().enumerate() {
            self.position[c] += gain * difference;
            self.velocity[c] += velocity_gain * difference;
        }
        self.velocity_cov -= velocity_gain * self.cross_cov;
        self.cross_cov -= gain * self.cross_cov;
        self.position_cov -= gain * self.position_cov;
    }
}
