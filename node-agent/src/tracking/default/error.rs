//! How wrong a point is as a measurement of a person's middle, frame after frame.
//!
//! A point lies on the near side: the middle is `half_depth` farther out on the line of sight. Its
//! covariance `R` holds noise, new in every frame, and the wander of what a body reflects, which
//! lasts. With the share `s` of the variance that wanders, correlated as `ρ = exp(−Δt/T)` from one
//! sight to the next, the mean of many sights is as sure as if each had
//! `1 + s ((1 + ρ)/(1 − ρ) − 1)` times its variance. What lasts as long as the person walks the
//! same way, the spread of half depths and the shape of the body, is no noise: its variance is taken
//! off `R`, and added to what a track says, never averaged.

use nalgebra::{Matrix2, Vector2};

use proto::measured::{MeasuredPoint, line_of_sight};

use super::config::DefaultConfig;
use super::motion::Sight;
use crate::imaging::from_db;

/// Sights closer in time than this, seconds, count as this far apart.
const LEAST_S: f64 = 1e-3;
/// A running mean of errors is taken over this many points.
const MEAN_COUNT: f64 = 100.0;
/// What lasts takes no more than all but this share off a variance.
const LEAST_SHARE: f64 = 0.2;
/// A variance is no less than this, m².
const LEAST_M2: f64 = 1e-8;

/// What points of late were like: along the line of sight m², in the sine, and their SNR.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Usual {
    count: f64,
    along_m2: f64,
    sine2: f64,
    snr: f64,
}

/// `diag(along, across)` in the directions of the line of sight to `place_m`, in the node's frame.
fn turned(place_m: &Vector2<f64>, [along, across]: [f64; 2]) -> Matrix2<f64> {
    let out = line_of_sight(place_m);
    let aside = Vector2::new(out.y, -out.x);
    out * out.transpose() * along + aside * aside.transpose() * across
}

/// The middle of the person whose near side `point` is, seen `since_s` after the sight before, as
/// sure as many of its kind are.
pub(super) fn sight(point: &MeasuredPoint, since_s: f64, config: &DefaultConfig) -> Sight {
    let middle = point.middle(config.half_depth_m, 0.0);
    inflated(Sight { place_m: middle.mean.coords_m, cov_m2: middle.cov_m2 }, since_s, config)
}

fn inflated(sight: Sight, since_s: f64, config: &DefaultConfig) -> Sight {
    let rho = (-since_s.max(LEAST_S) / config.glint_s).exp();
    let longer = (1.0 + rho) / (1.0 - rho) - 1.0;
    let out = line_of_sight(&sight.place_m);
    let axes = [out, Vector2::new(out.y, -out.x)];
    let scale = |axis: usize| {
        let whole_m2 = axes[axis].dot(&(sight.cov_m2 * axes[axis])).max(LEAST_M2);
        let lasts = config.lasting_sigmas_m[axis].powi(2) / whole_m2;
        ((1.0 - lasts).max(LEAST_SHARE) * (1.0 + config.glint_shares[axis] * longer)).sqrt()
    };
    let wider = turned(&sight.place_m, [scale(0), scale(1)]);
    Sight { cov_m2: wider * sight.cov_m2 * wider, ..sight }
}

/// The covariance of what lasts, m².
pub(super) fn lasting_m2(place_m: &Vector2<f64>, config: &DefaultConfig) -> Matrix2<f64> {
    turned(place_m, config.lasting_sigmas_m.map(|sigma_m| sigma_m * sigma_m))
}

impl Usual {
    /// Takes another point into account.
    pub(super) fn learn(&mut self, point: &MeasuredPoint) {
        let at = point.position();
        let (out, range_m) = (line_of_sight(&at.mean.coords_m), at.mean.coords_m.norm());
        let aside = Vector2::new(out.y, -out.x);
        self.count = (self.count + 1.0).min(MEAN_COUNT);
        let towards = |mean: &mut f64, value: f64| *mean += (value - *mean) / self.count;
        towards(&mut self.along_m2, out.dot(&(at.cov_m2 * out)));
        towards(&mut self.sine2, aside.dot(&(at.cov_m2 * aside)) / range_m.powi(2).max(LEAST_M2));
        towards(&mut self.snr, from_db(point.snr_db));
    }

    /// What somebody seen at `surface_m` by a peak of `power_ratio`, weaker than a point, tells of
    /// their middle: less sure than points by the ratio of the powers. `None` before any point.
    pub(super) fn weak_sight(
        &self,
        surface_m: Vector2<f64>,
        power_ratio: f64,
        since_s: f64,
        config: &DefaultConfig,
    ) -> Option<Sight> {
        if self.count < 1.0 {
            return None;
        }
        let worse = (self.snr / power_ratio.max(1.0)).max(1.0);
        let across_m2 = self.sine2 * surface_m.norm_squared();
        let cov_m2 =
            turned(&surface_m, [self.along_m2, across_m2].map(|m2| worse * m2.max(LEAST_M2)));
        let place_m = surface_m + line_of_sight(&surface_m) * config.half_depth_m;
        Some(inflated(Sight { place_m, cov_m2 }, since_s, config))
    }
}
