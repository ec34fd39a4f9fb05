//! How probable it is that a look shows a target: where the sensor looked, and how fast it must move.
//!
//! With the place `N(p, P)` along and across the line of sight taken for independent, the share of
//! it inside a sector is a product of differences of normal distribution functions; the radial
//! velocity `d · v ~ N(d · v̄, dᵀ P_v d)` is above the least detectable one with the share of it
//! outside `±v_min`. The normal distribution function is taken for `1/(1 + exp(−1.702 x))`, which is
//! within 0.01 of it.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::Vector2;

use crate::tracking::{Area, Look, Platform};

use super::gauss::Gauss;

/// Slope at which the logistic function is nearest to the normal distribution.
const LOGISTIC: f64 = 1.702;
/// Farther out than so many standard deviations nothing is expected: shares are 0 or 1.
pub(super) const FAR_SIGMAS: f64 = 6.0;

/// Whether a look could show a target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Seen {
    /// Probability that the place is where the sensor looked.
    pub(super) inside: f64,
    /// Probability that there is a plot.
    pub(super) detected: f64,
}

/// The normal distribution function.
fn below(sigmas: f64) -> f64 {
    1.0 / (1.0 + (-LOGISTIC * sigmas).exp())
}

/// Share of `N(middle, sigma²)` between two bounds.
fn between(low: f64, high: f64, middle: f64, sigma: f64) -> f64 {
    let (from, to) = ((low - middle) / sigma, (high - middle) / sigma);
    if FAR_SIGMAS < from || to < -FAR_SIGMAS {
        return 0.0;
    }
    if from < -FAR_SIGMAS && FAR_SIGMAS < to {
        return 1.0;
    }
    (below(to) - below(from)).max(0.0)
}

/// A sector with the sines that every target asks for.
#[derive(Clone, Copy, Debug)]
struct Sector {
    origin_m: Vector2<f64>,
    /// Along its middle.
    axis: Vector2<f64>,
    half_width_rad: f64,
    /// Cosine and sine of that.
    side: Vector2<f64>,
    min_range_m: f64,
    max_range_m: f64,
}

/// A look with what all targets ask of it, worked out once.
#[derive(Clone, Copy, Debug)]
pub(super) struct View<'a> {
    pub(super) look: &'a Look<'a>,
    /// None where it covers all.
    sector: Option<Sector>,
}

impl Sector {
    fn of(area: &Area) -> Option<Self> {
        let Area::Sector { origin_m, direction_rad, half_width_rad, min_range_m, max_range_m } =
            *area
        else {
            return None;
        };
        let [axis, side] = [direction_rad, half_width_rad]
            .map(|angle_rad| Vector2::new(angle_rad.cos(), angle_rad.sin()));
        Some(Self { origin_m, axis, half_width_rad, side, min_range_m, max_range_m })
    }

    /// `(along, across)` the middle, metres.
    fn turned(&self, off: Vector2<f64>) -> (f64, f64) {
        (self.axis.dot(&off), self.axis.x * off.y - self.axis.y * off.x)
    }

    /// How far a place is outside the nearer side, the line through the corner, metres.
    fn beyond_side(&self, (along, across): (f64, f64)) -> f64 {
        across.abs() * self.side.x - along * self.side.y
    }

    /// Share of a place that is inside.
    fn share_inside(&self, target: &Gauss) -> f64 {
        let off = Vector2::new(target.mean[0], target.mean[1]) - self.origin_m;
        let range = off.norm().max(f64::MIN_POSITIVE);
        let far = FAR_SIGMAS * target.widest_m2().sqrt();
        let turned = self.turned(off);
        let is_amid = self.min_range_m + far < range && range + far < self.max_range_m;
        // Lines are nearer than arcs, so that nothing at the border is taken for the middle.
        if is_amid && self.half_width_rad < FRAC_PI_2 && self.beyond_side(turned) < -far {
            return 1.0;
        }
        let along = off / range;
        let sigma = |dx: f64, dy: f64| target.place_variance(dx, dy).max(f64::MIN_POSITIVE).sqrt();
        let sigma_m = sigma(along.x, along.y);
        let in_range = between(self.min_range_m, self.max_range_m, range, sigma_m);
        if in_range <= 0.0 || PI <= self.half_width_rad {
            return in_range;
        }
        let angle = turned.1.atan2(turned.0);
        let half = self.half_width_rad * range;
        in_range * between(-half, half, angle * range, sigma(-along.y, along.x))
    }

    /// Whether a place is inside or at most `margin_m` outside; never too strict.
    fn may_hold(&self, place_m: Vector2<f64>, margin_m: f64) -> bool {
        let off = place_m - self.origin_m;
        let range = off.norm();
        if range + margin_m < self.min_range_m || self.max_range_m + margin_m < range {
            return false;
        }
        let is_near = range <= margin_m || FRAC_PI_2 <= self.half_width_rad;
        is_near || self.beyond_side(self.turned(off)) <= margin_m
    }
}

impl<'a> View<'a> {
    pub(super) fn new(look: &'a Look<'a>) -> Self {
        Self { look, sector: Sector::of(&look.coverage.area) }
    }

    /// Whether it covers all.
    pub(super) fn is_everywhere(&self) -> bool {
        self.sector.is_none()
    }

    /// Whether it covers a place or one at most `margin_m` away; never too strict.
    pub(super) fn may_cover(&self, place_m: Vector2<f64>, margin_m: f64) -> bool {
        self.sector.is_none_or(|sector| sector.may_hold(place_m, margin_m))
    }

    /// Share of a target's radial velocity that can be detected.
    fn share_fast(&self, target: &Gauss) -> f64 {
        let limit = self.look.coverage.minimum_detectable_m_per_s;
        let Some((limit, platform)) = limit.zip(self.look.platform) else { return 1.0 };
        let d = line_of_sight(&platform, Vector2::new(target.mean[0], target.mean[1]));
        let radial = d.x * target.mean[2] + d.y * target.mean[3];
        let sigma = target.velocity_variance(d.x, d.y).max(f64::MIN_POSITIVE).sqrt();
        1.0 - between(-limit, limit, radial, sigma)
    }

    /// Whether it could show a target that is expected at `target`.
    pub(super) fn seen(&self, target: impl Fn() -> Gauss) -> Seen {
        let coverage = &self.look.coverage;
        if self.is_everywhere() && coverage.minimum_detectable_m_per_s.is_none() {
            return Seen { inside: 1.0, detected: coverage.detection_probability };
        }
        let target = &target();
        let inside = self.sector.map_or(1.0, |sector| sector.share_inside(target));
        if inside <= 0.0 {
            return Seen { inside, detected: 0.0 };
        }
        let detected = inside * coverage.detection_probability * self.share_fast(target);
        Seen { inside, detected }
    }
}

/// Horizontal part of the unit vector from a platform to a place.
pub(super) fn line_of_sight(platform: &Platform, place_m: Vector2<f64>) -> Vector2<f64> {
    let off = place_m - platform.position_m.xy();
    let slant = (off.norm_squared() + platform.position_m.z * platform.position_m.z).sqrt();
    if 0.0 < slant { off / slant } else { off }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix2, Vector3};

    use super::*;
    use crate::tracking::{Coverage, Plot};

    /// What the logistic function and independence along and across cost.
    const TOLERANCE: f64 = 0.03;

    fn target(x: f64, y: f64, sigma: f64) -> Gauss {
        let plot = Plot {
            position_m: Vector2::new(x, y),
            covariance_m2: Matrix2::identity() * sigma * sigma,
            radial: None,
            strength_db: None,
            report_index: 0,
        };
        Gauss::at(&plot, 1.0)
    }

    fn sector() -> Area {
        Area::Sector {
            origin_m: Vector2::new(10.0, -5.0),
            direction_rad: 0.7,
            half_width_rad: 0.2,
            min_range_m: 50.0,
            max_range_m: 100.0,
        }
    }

    /// Counts points of a fine grid under the density.
    fn counted(area: &Area, target: &Gauss, sigma: f64) -> f64 {
        let (mut inside, mut all) = (0.0, 0.0);
        for at in 0..121 * 121 {
            let (a, b) = (f64::from(at % 121 - 60) / 12.0, f64::from(at / 121 - 60) / 12.0);
            let weight = (-0.5 * (a * a + b * b)).exp();
            let place = Vector2::new(target.mean[0] + sigma * a, target.mean[1] + sigma * b);
            all += weight;
            inside += if area.contains(place) { weight } else { 0.0 };
        }
        inside / all
    }

    #[test]
    fn the_share_inside_is_that_of_a_count() {
        let mut partial = 0;
        let places = [(70.0, 45.0), (60.0, 60.0), (90.0, 40.0), (45.0, 20.0), (85.0, 70.0)];
        for ((x, y), sigma) in places.into_iter().flat_map(|place| [(place, 2.0), (place, 5.0)]) {
            let target = target(x, y, sigma);
            let counted = counted(&sector(), &target, sigma);
            let share = Sector::of(&sector()).unwrap().share_inside(&target);
            assert!((share - counted).abs() < TOLERANCE, "{x} {y} {sigma}: {share} {counted}");
            partial += usize::from((0.1..0.9).contains(&counted));
        }
        assert!(partial >= 2, "some are at the border");
    }

    #[test]
    fn slow_targets_are_not_detected() {
        let platform = Platform {
            position_m: Vector3::new(0.0, -3000.0, 4000.0),
            velocity_m_per_s: Vector3::zeros(),
            beam_index: None,
        };
        let coverage = Coverage {
            area: Area::Everywhere,
            detection_probability: 0.9,
            minimum_detectable_m_per_s: Some(2.0),
        };
        let look = Look {
            time_s: 0.0,
            sensor_index: 0,
            look_index: 0,
            platform: Some(platform),
            coverage,
            clutter_per_m2: 1e-6,
            plots: &[],
        };
        // The line of sight is (0, 0.6) in the plane: 10 m/s along it are 6 m/s of radial velocity.
        for (v, expected) in [(10.0, 0.9), (2.0, 0.9 * 0.0912), (10.0 / 3.0, 0.9 * 0.5)] {
            let mut target = target(0.0, 0.0, 1.0);
            target.mean[3] = v;
            let detected = View::new(&look).seen(|| target).detected;
            assert!((detected - expected).abs() < TOLERANCE, "{v}: {detected}");
        }
    }
}
