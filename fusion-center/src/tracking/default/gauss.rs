//! A place and a velocity in the plane with their covariance, predicted and updated.
//!
//! State `(x, y, u, v)`, metres and metres per second. Over `Δt` the velocity fades with a time `τ`
//! and is pushed by white noise of intensity `q` (m²/s³): with `a = exp(−Δt/τ)`, `b = τ (1 − a)`
//! `p' = p + b v`, `v' = a v`, and per axis `Q_pp = q τ² [Δt − 2b + τ(1 − a²)/2]`,
//! `Q_pv = q b²/2`, `Q_vv = q τ (1 − a²)/2`; for `τ → ∞` these are `Δt`, `1`, `q Δt³/3`, `q Δt²/2` and
//! `q Δt`. A plot measures `p` with covariance `R` and, where it has one, the radial velocity `d · v`;
//! both errors are Gaussian and independent, so that one is taken in after the other.
//! The covariance is kept as its upper triangle: it is symmetric by construction.

use nalgebra::{Matrix4, Vector4};

use crate::tracking::{Plot, Radial};

/// `(2π)²`, of the volume of an ellipse of probability: densities are `exp(−d²/2) / √((2π)^k det S)`.
const TAU2: f64 = std::f64::consts::TAU * std::f64::consts::TAU;
/// Below this `Δt/τ` the formulas of `Q` lose their digits, and their limits for long `τ` serve.
const SHORT: f64 = 1e-3;
/// A radial velocity that is known up to multiples of `W` says something if the standard deviation of
/// what is expected is below `W` times this: farther out, the wrong multiple would be believed.
const WRAP_SHARE: f64 = 0.25;

/// Variance of a standing target's velocity on each axis, m²/s²: a covariance must not be singular.
const STANDING_M2_PER_S2: f64 = 1e-4;

/// Where an element of the upper triangle stands.
const XX: usize = 0;
const XY: usize = 1;
const XU: usize = 2;
const XV: usize = 3;
const YY: usize = 4;
const YU: usize = 5;
const YV: usize = 6;
const UU: usize = 7;
const UV: usize = 8;
const VV: usize = 9;

/// Mean and covariance of a state; the covariance is its upper triangle, row by row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Gauss {
    pub(super) mean: [f64; 4],
    pub(super) cov: [f64; 10],
}

/// The difference of two states.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Apart {
    mean: [f64; 4],
    cov: [f64; 10],
    /// The mean's difference times itself.
    square: [f64; 10],
}

/// What a step in time does, alike for both axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Step {
    pub(super) fade: f64,
    pub(super) reach_s: f64,
    pub(super) noise_pp: f64,
    pub(super) noise_pv: f64,
    pub(super) noise_vv: f64,
}

/// How well a plot fits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fit {
    /// Mahalanobis distance squared, of the place and of the radial velocity.
    pub(super) distance2: f64,
    /// Of the place alone.
    pub(super) place_distance2: f64,
    /// `(2π)^k det S`, m⁴ and, if the radial velocity counts, m²/s²: the density of the plot is
    /// `exp(−distance2/2) / √volume2`.
    pub(super) volume2: f64,
}

impl Fit {
    /// Logarithm of the density of the plot.
    pub(super) fn log_density(&self) -> f64 {
        -0.5 * (self.distance2 + self.volume2.ln())
    }
}

impl Step {
    /// Over `dt_s`, of a velocity that lasts `memory_s` and is pushed by `push_m2_per_s3`.
    pub(super) fn new(dt_s: f64, memory_s: f64, push_m2_per_s3: f64) -> Self {
        let (q, ratio) = (push_m2_per_s3, dt_s / memory_s);
        let fade = (-ratio).exp();
        if ratio < SHORT {
            let [noise_pp, noise_pv] = [q * dt_s.powi(3) / 3.0, q * dt_s * dt_s / 2.0];
            return Self { fade, reach_s: dt_s, noise_pp, noise_pv, noise_vv: q * dt_s };
        }
        let reach_s = -memory_s * (-ratio).exp_m1();
        let left = 0.5 * memory_s * (1.0 - fade * fade);
        let noise_pp = q * memory_s * memory_s * (dt_s - 2.0 * reach_s + left);
        Self { fade, reach_s, noise_pp, noise_pv: 0.5 * q * reach_s * reach_s, noise_vv: q * left }
    }
}

/// `value` brought into ± half of `period` by multiples of it.
fn wrapped(value: f64, period: Option<f64>) -> f64 {
    period.map_or(value, |period| value - period * (value / period).round())
}

impl Gauss {
    /// Somebody at a plot whose velocity has the standard deviation `speed_m_per_s` on each axis,
    /// before its radial velocity is taken in.
    pub(super) fn at(plot: &Plot, speed_m_per_s: f64) -> Self {
        let (p, r) = (plot.position_m, plot.covariance_m2);
        let mut cov = [0.0; 10];
        [cov[XX], cov[XY], cov[YY]] = [r[(0, 0)], r[(0, 1)], r[(1, 1)]];
        [cov[UU], cov[VV]] = [speed_m_per_s * speed_m_per_s; 2];
        Self { mean: [p.x, p.y, 0.0, 0.0], cov }
    }

    /// The state after a step.
    #[inline]
    pub(super) fn stepped(&self, step: &Step) -> Self {
        let (a, b, m, c) = (step.fade, step.reach_s, &self.mean, &self.cov);
        let mean = [m[0] + b * m[2], m[1] + b * m[3], a * m[2], a * m[3]];
        let (fu, fw, fv) = (c[XU] + b * c[UU], c[XV] + b * c[UV], c[YV] + b * c[VV]);
        let fz = c[YU] + b * c[UV];
        let mut cov = [0.0; 10];
        cov[XX] = c[XX] + b * (c[XU] + fu) + step.noise_pp;
        cov[XY] = c[XY] + b * (c[XV] + fz);
        cov[XU] = a * fu + step.noise_pv;
        cov[XV] = a * fw;
        cov[YY] = c[YY] + b * (c[YV] + fv) + step.noise_pp;
        cov[YU] = a * fz;
        cov[YV] = a * fv + step.noise_pv;
        cov[UU] = a * a * c[UU] + step.noise_vv;
        cov[UV] = a * a * c[UV];
        cov[VV] = a * a * c[VV] + step.noise_vv;
        Self { mean, cov }
    }

    /// `cov(before, after)` of a step: `P Fᵀ`, the noise does not count.
    pub(super) fn cross(&self, step: &Step) -> Matrix4<f64> {
        let (before, mut cross) = (self.covariance(), Matrix4::zeros());
        for row in 0..4 {
            for axis in 0..2 {
                let with_velocity = before[(row, axis + 2)];
                cross[(row, axis)] = before[(row, axis)] + step.reach_s * with_velocity;
                cross[(row, axis + 2)] = step.fade * with_velocity;
            }
        }
        cross
    }

    /// `(S⁻¹ as xx, xy, yy; det S)` of a plot's place.
    #[inline]
    fn place_spread(&self, plot: &Plot) -> ([f64; 3], f64) {
        let r = &plot.covariance_m2;
        let (sxx, sxy, syy) =
            (self.cov[XX] + r[(0, 0)], self.cov[XY] + r[(0, 1)], self.cov[YY] + r[(1, 1)]);
        let det = sxx * syy - sxy * sxy;
        let over = 1.0 / det;
        ([syy * over, -sxy * over, sxx * over], det)
    }

    /// Mahalanobis distance squared of a plot's place.
    #[inline]
    pub(super) fn place_distance2(&self, plot: &Plot) -> f64 {
        let (inverse, _) = self.place_spread(plot);
        let (dx, dy) = (plot.position_m.x - self.mean[0], plot.position_m.y - self.mean[1]);
        dx * (inverse[0] * dx + 2.0 * inverse[1] * dy) + inverse[2] * dy * dy
    }

    /// How well a plot fits.
    #[inline]
    pub(super) fn fit(&self, plot: &Plot) -> Fit {
        let (inverse, det) = self.place_spread(plot);
        let (dx, dy) = (plot.position_m.x - self.mean[0], plot.position_m.y - self.mean[1]);
        let [wx, wy] = [inverse[0] * dx + inverse[1] * dy, inverse[1] * dx + inverse[2] * dy];
        let place_distance2 = dx * wx + dy * wy;
        let place = |more_distance2: f64, volume2: f64| Fit {
            distance2: place_distance2 + more_distance2,
            place_distance2,
            volume2,
        };
        let place_volume = TAU2 * det;
        let Some(radial) = plot.radial else { return place(0.0, place_volume) };
        let (a, c) = (radial.direction, &self.cov);
        let [tx, ty] = [a.x * c[XU] + a.y * c[XV], a.x * c[YU] + a.y * c[YV]];
        let known = tx * (inverse[0] * tx + 2.0 * inverse[1] * ty) + ty * inverse[2] * ty;
        let variance = self.radial_variance(&radial) - known;
        let expected = a.x * self.mean[2] + a.y * self.mean[3] + tx * wx + ty * wy;
        if let Some(period) = unclear(variance, &radial) {
            return place(0.0, place_volume * period * period);
        }
        let off = wrapped(radial.velocity_m_per_s - expected, radial.wrap_m_per_s);
        let distance2 = off * off / variance;
        place(distance2, place_volume * std::f64::consts::TAU * variance)
    }

    #[inline]
    fn radial_variance(&self, radial: &Radial) -> f64 {
        let (d, c) = (radial.direction, &self.cov);
        let own = d.x * d.x * c[UU] + 2.0 * d.x * d.y * c[UV] + d.y * d.y * c[VV];
        own + radial.sigma_m_per_s * radial.sigma_m_per_s
    }

    /// Takes in a plot: its place, then its radial velocity.
    #[inline]
    pub(super) fn update(&mut self, plot: &Plot) {
        let (inverse, _) = self.place_spread(plot);
        let (dx, dy) = (plot.position_m.x - self.mean[0], plot.position_m.y - self.mean[1]);
        let c = self.cov;
        let rows = [[c[XX], c[XY]], [c[XY], c[YY]], [c[XU], c[YU]], [c[XV], c[YV]]];
        let gain =
            rows.map(|[x, y]| [x * inverse[0] + y * inverse[1], x * inverse[1] + y * inverse[2]]);
        let mut at = 0;
        for (row, [gain_x, gain_y]) in gain.into_iter().enumerate() {
            self.mean[row] += gain_x * dx + gain_y * dy;
            for [x, y] in &rows[row..] {
                self.cov[at] -= gain_x * x + gain_y * y;
                at += 1;
            }
        }
        if let Some(radial) = &plot.radial {
            self.update_radial(radial);
        }
    }

    /// Takes in a radial velocity, unless it could be one of several.
    #[inline]
    pub(super) fn update_radial(&mut self, radial: &Radial) {
        let (d, c) = (radial.direction, self.cov);
        let variance = self.radial_variance(radial);
        if unclear(variance, radial).is_some() {
            return;
        }
        let expected = d.x * self.mean[2] + d.y * self.mean[3];
        let off = wrapped(radial.velocity_m_per_s - expected, radial.wrap_m_per_s);
        let rows = [
            c[XU] * d.x + c[XV] * d.y,
            c[YU] * d.x + c[YV] * d.y,
            c[UU] * d.x + c[UV] * d.y,
            c[UV] * d.x + c[VV] * d.y,
        ];
        let mut at = 0;
        for row in 0..4 {
            let gain = rows[row] / variance;
            self.mean[row] += gain * off;
            for value in &rows[row..] {
                self.cov[at] -= gain * value;
                at += 1;
            }
        }
    }

    /// The mixture's mean and covariance, `share` of it being `self`.
    #[inline]
    pub(super) fn mixed(&self, other: &Self, share: f64) -> Self {
        other.towards(&self.apart(other), share)
    }

    /// How far it is from `other`.
    #[inline]
    pub(super) fn apart(&self, other: &Self) -> Apart {
        let mean: [f64; 4] = std::array::from_fn(|i| self.mean[i] - other.mean[i]);
        let [x, y, u, v] = mean;
        let square = [x * x, x * y, x * u, x * v, y * y, y * u, y * v, u * u, u * v, v * v];
        Apart { mean, cov: std::array::from_fn(|i| self.cov[i] - other.cov[i]), square }
    }

    /// The mixture's mean and covariance, `share` of it being what is so far `apart`.
    #[inline]
    pub(super) fn towards(&self, apart: &Apart, share: f64) -> Self {
        let rest = 1.0 - share;
        let mean = std::array::from_fn(|i| self.mean[i] + share * apart.mean[i]);
        let cov =
            std::array::from_fn(|i| self.cov[i] + share * (apart.cov[i] + rest * apart.square[i]));
        Self { mean, cov }
    }

    /// The state with this mean and covariance, of which the upper triangle counts.
    pub(super) fn new(mean: Vector4<f64>, covariance: Matrix4<f64>) -> Self {
        let mut cov = [0.0; 10];
        let upper = (0..4).flat_map(|row| (row..4).map(move |column| (row, column)));
        for (value, place) in cov.iter_mut().zip(upper) {
            *value = covariance[place];
        }
        Self { mean: mean.into(), cov }
    }

    /// The mean as a vector.
    pub(super) fn state(&self) -> Vector4<f64> {
        Vector4::from(self.mean)
    }

    /// The covariance as a matrix.
    pub(super) fn covariance(&self) -> Matrix4<f64> {
        let c = &self.cov;
        Matrix4::new(
            c[XX], c[XY], c[XU], c[XV], c[XY], c[YY], c[YU], c[YV], c[XU], c[YU], c[UU], c[UV],
            c[XV], c[YV], c[UV], c[VV],
        )
    }

    /// Variance of the place in the direction in which it is largest, m².
    #[inline]
    pub(super) fn widest_m2(&self) -> f64 {
        let [half, off] = [0.5 * (self.cov[XX] - self.cov[YY]), self.cov[XY]];
        0.5 * (self.cov[XX] + self.cov[YY]) + (half * half + off * off).sqrt()
    }

    /// Variance of the place in the direction `(dx, dy)`, m².
    pub(super) fn place_variance(&self, dx: f64, dy: f64) -> f64 {
        dx * dx * self.cov[XX] + 2.0 * dx * dy * self.cov[XY] + dy * dy * self.cov[YY]
    }

    /// Variance of the velocity in the direction `(dx, dy)`, m²/s².
    pub(super) fn velocity_variance(&self, dx: f64, dy: f64) -> f64 {
        dx * dx * self.cov[UU] + 2.0 * dx * dy * self.cov[UV] + dy * dy * self.cov[VV]
    }

    /// Where a target stands that stopped at any moment of the next `dt_s`: its place, metres, and
    /// the covariance xx, xy, yy of that.
    pub(super) fn stopped_within(&self, dt_s: f64) -> ([f64; 2], [f64; 3]) {
        let [x, y, u, v] = self.mean;
        let (c, h2) = (&self.cov, dt_s * dt_s / 12.0);
        let cov_m2 = [
            c[XX] + h2 * (u * u + c[UU]),
            c[XY] + h2 * (u * v + c[UV]),
            c[YY] + h2 * (v * v + c[VV]),
        ];
        ([x + 0.5 * dt_s * u, y + 0.5 * dt_s * v], cov_m2)
    }

    /// A target that stands there.
    pub(super) fn standing(place_m: [f64; 2], cov_m2: [f64; 3]) -> Self {
        let mut cov = [0.0; 10];
        [cov[XX], cov[XY], cov[YY]] = cov_m2;
        [cov[UU], cov[VV]] = [STANDING_M2_PER_S2; 2];
        Self { mean: [place_m[0], place_m[1], 0.0, 0.0], cov }
    }

    /// The place, metres, and the covariance xx, xy, yy of that.
    pub(super) fn place(&self) -> ([f64; 2], [f64; 3]) {
        ([self.mean[0], self.mean[1]], [self.cov[XX], self.cov[XY], self.cov[YY]])
    }

    /// Where a standing target is that moved on some time ago, the mean of which is `ago_s` and the mean
    /// square `ago_s2`, with a velocity of the standard deviation `speed_m_per_s` on each axis.
    pub(super) fn started(&self, (ago_s, ago_s2): (f64, f64), speed_m_per_s: f64) -> Self {
        let variance = speed_m_per_s * speed_m_per_s;
        let mut moved = *self;
        [moved.cov[XX], moved.cov[YY]] =
            [self.cov[XX] + variance * ago_s2, self.cov[YY] + variance * ago_s2];
        [moved.cov[XU], moved.cov[YV]] = [variance * ago_s; 2];
        [moved.cov[UU], moved.cov[VV]] = [variance; 2];
        moved
    }
}

/// The period of a radial velocity whose expected value spreads over too much of it.
fn unclear(variance: f64, radial: &Radial) -> Option<f64> {
    radial.wrap_m_per_s.filter(|period| variance.sqrt() > WRAP_SHARE * period)
}
