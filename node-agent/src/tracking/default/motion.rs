//! Where a person is and how fast, by two ways of moving that take turns.
//!
//! State `(p, v)`, metres and metres per second. In either way of moving, the velocity fades with a
//! time `τ` and is pushed by white noise of intensity `q` (m²/s³): with `a = exp(−Δt/τ)`
//! `p' = p + τ (1 − a) v`, `v' = a v`, and per axis
//! `Q_pp = q τ² [Δt − 2τ(1 − a) + τ(1 − a²)/2]`, `Q_pv = q τ² (1 − a)²/2`, `Q_vv = q τ (1 − a²)/2`.
//! `steady` walks straight on (`τ` long, `q` small), `turning` starts, stops and turns (`τ` short, its
//! velocity has the variance `q τ / 2`). A way lasts for a mean sojourn `T`, and is left within `Δt`
//! with the probability `1 − exp(−Δt/T)`. Both are mixed before each prediction (interacting
//! multiple model \[imm\]); mean and covariance of the mixture are kept by that.
//! Assumes that the wander of a body's echo is white after the inflation of [`super::error`].

use nalgebra::{Matrix2, Matrix2x4, Matrix4, Vector2, Vector4};

use super::config::Gait;

/// Ways of moving.
const COUNT: usize = 2;
/// Below this `Δt/τ` the formulas of `Q` lose their digits, and their limits for long `τ` serve.
const SHORT: f64 = 1e-2;
/// Slower people are pushed about alike in all directions, metres per second.
const WALKING_M_PER_S: f64 = 0.3;
/// No way of moving is ruled out: it could not come back.
const MIN_WEIGHT: f64 = 1e-6;

/// Mean and covariance of a state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Estimate {
    pub(super) mean: Vector4<f64>,
    pub(super) cov: Matrix4<f64>,
}

/// A measured place and its covariance, m².
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sight {
    pub(super) place_m: Vector2<f64>,
    pub(super) cov_m2: Matrix2<f64>,
}

/// The state under each way of moving, and how likely each is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Motion {
    modes: [Estimate; COUNT],
    weights: [f64; COUNT],
}

impl Estimate {
    pub(super) fn place_m(&self) -> Vector2<f64> {
        self.mean.fixed_rows::<2>(0).into_owned()
    }

    pub(super) fn velocity(&self) -> Vector2<f64> {
        self.mean.fixed_rows::<2>(2).into_owned()
    }

    pub(super) fn place_cov_m2(&self) -> Matrix2<f64> {
        self.cov.fixed_view::<2, 2>(0, 0).into_owned()
    }

    /// Mahalanobis distance squared of `sight`, and `ln |2π S|` of the innovation.
    pub(super) fn misfit(&self, sight: &Sight) -> Option<(f64, f64)> {
        let spread = self.place_cov_m2() + sight.cov_m2;
        let off_m = sight.place_m - self.place_m();
        let inverse = spread.try_inverse()?;
        let volume = (std::f64::consts::TAU.powi(2) * spread.determinant()).ln();
        Some((off_m.dot(&(inverse * off_m)), volume))
    }

    /// Kalman's update, and the logarithm of the likelihood of `sight`; nothing happens if the
    /// innovation's covariance is singular.
    fn update(&mut self, sight: &Sight) -> Option<f64> {
        let (distance2, volume) = self.misfit(sight)?;
        let spread = self.place_cov_m2() + sight.cov_m2;
        let rows: Matrix2x4<f64> = self.cov.fixed_view::<2, 4>(0, 0).into_owned();
        let gain = rows.transpose() * spread.try_inverse()?;
        self.mean += gain * (sight.place_m - self.place_m());
        let less = self.cov - gain * spread * gain.transpose();
        self.cov = 0.5 * (less + less.transpose());
        Some(-0.5 * (distance2 + volume))
    }
}

impl Gait {
    /// `F` and `Q` over `dt_s` for somebody with `velocity`.
    fn step(&self, dt_s: f64, velocity: Vector2<f64>) -> (Matrix4<f64>, Matrix4<f64>) {
        let (tau, q, h) = (self.memory_s, self.push_m2_per_s3, dt_s / self.memory_s);
        let a = (-h).exp();
        let reach = -tau * (-h).exp_m1();
        let [pp, pv, vv] = if h < SHORT {
            [q * dt_s.powi(3) / 3.0, q * dt_s * dt_s / 2.0, q * dt_s]
        } else {
            let left = 0.5 * tau * (1.0 - a * a);
            [q * tau * tau * (dt_s - 2.0 * reach + left), 0.5 * q * reach * reach, q * left]
        };
        let mut transition = Matrix4::identity();
        let mut noise = Matrix4::zeros();
        let pushes = self.pushes(velocity);
        for (row, column) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let push = pushes[(row, column)];
            noise[(row, column)] = pp * push;
            noise[(row, column + 2)] = pv * push;
            noise[(row + 2, column)] = pv * push;
            noise[(row + 2, column + 2)] = vv * push;
        }
        for axis in 0..2 {
            transition[(axis, axis + 2)] = reach;
            transition[(axis + 2, axis + 2)] = a;
        }
        (transition, noise)
    }

    /// How strong pushes are, over `q`: all of it along the way and a share aside, for people stop
    /// and turn round more than they swerve; the faster, the more so.
    fn pushes(&self, velocity: Vector2<f64>) -> Matrix2<f64> {
        let speed2 = velocity.norm_squared();
        let less = (1.0 - self.aside_share) / (speed2 + WALKING_M_PER_S.powi(2));
        let aside = Vector2::new(velocity.y, -velocity.x);
        Matrix2::identity() - aside * aside.transpose() * less
    }
}

/// The one Gaussian with the mean and covariance of a mixture.
fn mixed(modes: &[Estimate; COUNT], weights: &[f64; COUNT]) -> Estimate {
    let total: f64 = weights.iter().sum();
    let pairs = || modes.iter().zip(weights.iter().map(|weight| weight / total));
    let mean: Vector4<f64> = pairs().map(|(mode, weight)| mode.mean * weight).sum();
    let about = |mode: &Estimate| mode.cov + (mode.mean - mean) * (mode.mean - mean).transpose();
    let cov = pairs().map(|(mode, weight)| about(mode) * weight).sum();
    Estimate { mean, cov }
}

impl Motion {
    /// Somebody seen for the first time, whose speed has the standard deviation `speed_m_per_s` per
    /// axis.
    pub(super) fn new(sight: &Sight, speed_m_per_s: f64) -> Self {
        let mut mean = Vector4::zeros();
        mean.fixed_rows_mut::<2>(0).copy_from(&sight.place_m);
        let mut cov = Matrix4::identity() * speed_m_per_s.powi(2);
        cov.fixed_view_mut::<2, 2>(0, 0).copy_from(&sight.cov_m2);
        Self { modes: [Estimate { mean, cov }; COUNT], weights: [1.0 / COUNT as f64; COUNT] }
    }

    /// The state whatever the way of moving.
    pub(super) fn merged(&self) -> Estimate {
        mixed(&self.modes, &self.weights)
    }

    /// Goes on by `dt_s`; gives the covariance of the state before with that after.
    pub(super) fn predict(&mut self, dt_s: f64, gaits: &[Gait; COUNT]) -> Matrix4<f64> {
        let before = self.merged();
        let stay = gaits.map(|gait| (-dt_s / gait.sojourn_s).exp());
        let came = |from: usize, to: usize| {
            self.weights[from] * if from == to { stay[from] } else { 1.0 - stay[from] }
        };
        let shares = [0, 1].map(|to| [0, 1].map(|from| came(from, to).max(MIN_WEIGHT)));
        let starts = shares.map(|of| mixed(&self.modes, &of));
        let weights = shares.map(|of| of.iter().sum::<f64>());
        let total: f64 = weights.iter().sum();
        self.weights = weights.map(|weight| weight / total);
        let mut cross = Matrix4::zeros();
        for (index, start) in starts.iter().enumerate() {
            let (transition, noise) = gaits[index].step(dt_s, start.velocity());
            let mean = transition * start.mean;
            let cov = transition * start.cov * transition.transpose() + noise;
            let off = start.mean - before.mean;
            cross += (start.cov + off * start.mean.transpose())
                * transition.transpose()
                * self.weights[index];
            self.modes[index] = Estimate { mean, cov: 0.5 * (cov + cov.transpose()) };
        }
        cross
    }

    /// Whoever it is does not move.
    pub(super) fn stand(&mut self) {
        self.modes.iter_mut().for_each(|mode| mode.mean.fixed_rows_mut::<2>(2).fill(0.0));
    }

    /// Takes `sight` into account; a way of moving that foresaw it gains weight.
    pub(super) fn update(&mut self, sight: &Sight) {
        let mut fits = [f64::NEG_INFINITY; COUNT];
        for (mode, fit) in self.modes.iter_mut().zip(&mut fits) {
            *fit = mode.update(sight).unwrap_or(*fit);
        }
        let best = fits.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if best.is_finite() {
            let raw = [0, 1].map(|i| (self.weights[i] * (fits[i] - best).exp()).max(MIN_WEIGHT));
            self.weights = raw.map(|weight| weight / raw.iter().sum::<f64>());
        }
    }
}
