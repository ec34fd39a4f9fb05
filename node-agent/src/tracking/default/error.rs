//! How wrong a point is as a measurement of a person's middle, frame after frame.
//!
//! A point lies on the near side: the middle is half a depth farther out on the line of sight. Its
//! covariance `R` holds noise, new in every frame, and the chain's variance `G²` for what a body
//! reflects, which the chain cannot know better for one frame alone. A tracker can: scatterers that
//! cancel each other make a body dark and its point wander, so that a point of power `P` of somebody
//! with the mean power `P̄` wanders with `g² P̄ / P` about what shines on average. That wander lasts,
//! `ρ = exp(−Δt/T)` from one sight to the next, and the mean of many sights is as sure as if each had
//! `(1 + ρ)/(1 − ρ)` times its variance. In range and across alike,
//! `R' = s (R − G²) + g² (P̄ / P) (1 + ρ)/(1 − ρ)`, `g² = q (G² − L²)`. What lasts as long as the person walks
//! the same way, the spread of half depths and the shape of the body, `L²`, is no noise: it is added
//! to what a track says, never averaged. The chain's own noise term covers blobs that two people
//! widen, and is too large by `1 / s` for most; where `G = 0`, of points, it is right.

use nalgebra::{Matrix2, Vector2};

use proto::measured::{MeasuredPoint, line_of_sight};

use super::config::{BodyModel, DefaultConfig};
use super::motion::Sight;
use crate::imaging::from_db;

/// Sights closer in time than this, seconds, count as this far apart.
const LEAST_S: f64 = 1e-3;
/// A running mean of errors is taken over this many points.
const MEAN_COUNT: f64 = 100.0;
/// No sight is surer than by this share of its variance.
const LEAST_SHARE: f64 = 0.02;
/// Whoever is slower than this may face anywhere, metres per second.
const WALKING_M_PER_S: f64 = 0.3;
/// `P̄ / P` is taken as no less and no more: the brightest points are no surer, and of the darkest,
/// where the ratio is said of few sidelobes, no more is believed. Tuned with the other settings.
const FADES: [f64; 2] = [0.35, 3.2];
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

/// How far behind its near side the middle of somebody at `place_m` who walks with `velocity` lies,
/// metres: `d (1 − a s² cos 2ψ)`, `ψ` between the line of sight and the way. A body is wider than
/// deep, so that one who walks across shows more of it; whoever stands may face anywhere, and `s²`
/// is the share of walking in the speed.
pub(super) fn half_depth_m(
    place_m: &Vector2<f64>,
    velocity: &Vector2<f64>,
    body: &BodyModel,
    config: &DefaultConfig,
) -> f64 {
    let speed2 = velocity.norm_squared();
    let along = line_of_sight(place_m).dot(velocity);
    let turned2 = (2.0 * along * along - speed2) / (speed2 + WALKING_M_PER_S.powi(2));
    body.half_depth_m * (1.0 - config.aspect_share * turned2)
}

/// What is known of who is seen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Known<'a> {
    /// See [`half_depth_m`].
    pub(super) half_depth_m: f64,
    /// `P̄ / P`.
    pub(super) fade: f64,
    /// Since the sight before.
    pub(super) since_s: f64,
    pub(super) body: &'a BodyModel,
}

/// The middle of the person whose near side `point` is, as sure as many of its kind are.
pub(super) fn sight(point: &MeasuredPoint, known: &Known<'_>, config: &DefaultConfig) -> Sight {
    let middle = point.middle(known.half_depth_m, 0.0);
    inflated(Sight { place_m: middle.mean.coords_m, cov_m2: middle.cov_m2 }, known, config)
}

fn inflated(sight: Sight, known: &Known<'_>, config: &DefaultConfig) -> Sight {
    let rho = (-known.since_s.max(LEAST_S) / config.glint_s).exp();
    let fade = known.fade.clamp(FADES[0], FADES[1]);
    let longer = config.glint_share * fade * (1.0 + rho) / (1.0 - rho);
    let out = line_of_sight(&sight.place_m);
    let axes = [out, Vector2::new(out.y, -out.x)];
    let scale = |axis: usize| {
        let whole_m2 = axes[axis].dot(&(sight.cov_m2 * axes[axis])).max(LEAST_M2);
        let glint_m2 = known.body.glint_m[axis].powi(2).min(whole_m2);
        let wanders_m2 = (glint_m2 - config.lasting_sigmas_m[axis].powi(2)).max(0.0);
        let noise_share = if 0.0 < glint_m2 { config.noise_share } else { 1.0 };
        let own_m2 = noise_share * (whole_m2 - glint_m2) + longer * wanders_m2;
        (own_m2 / whole_m2).max(LEAST_SHARE).sqrt()
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
        known: &Known<'_>,
        config: &DefaultConfig,
    ) -> Option<Sight> {
        if self.count < 1.0 {
            return None;
        }
        let worse = (self.snr / power_ratio.max(1.0)).max(1.0);
        let across_m2 = self.sine2 * surface_m.norm_squared();
        let cov_m2 =
            turned(&surface_m, [self.along_m2, across_m2].map(|m2| worse * m2.max(LEAST_M2)));
        let place_m = surface_m + line_of_sight(&surface_m) * known.half_depth_m;
        Some(inflated(Sight { place_m, cov_m2 }, known, config))
    }
}
