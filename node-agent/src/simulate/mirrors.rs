//! Walls of the room that mirror: images of targets, the walls' own echoes, and people's shadows.
//!
//! A leg over a mirror is the straight leg to the mirror image of its end; the wall before the
//! array refracts it as any other. A mirror's own echo goes over the point `q` of the mirror where
//! the optical path `tx → q → rx` is shortest (Fermat); the path is convex along the mirror.
//! A person at the distance `ρ` from a straight ray leaves of its amplitude
//! `1 − (1 − 10^(−loss_db/20)) exp(−ρ²/(2 w²))`, a smooth stand-in for diffraction.
//! Assumes flat mirrors of one reflection coefficient and opposite phase, whatever the angle.

use crate::imaging::from_db;
use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use crate::imaging::{InvalidSetting, invalid};

use super::slab::Slab;

/// An echo's place is inside a mirror, and not at its end, by this, metres.
const EDGE_M: f64 = 1e-5;
/// Golden-section steps: they narrow 100 m down to 1e-10 m.
const SEARCH_STEPS: usize = 58;
/// The part kept in a golden-section step.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// A flat thing that mirrors: a side wall, a back wall, a cupboard.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reflector {
    /// One end `[x, y]`, in the world's frame.
    pub from_m: [f64; 2],
    /// The other end `[x, y]`, in the world's frame.
    pub to_m: [f64; 2],
    /// Power that it reflects, decibels: -6 is usual, 0 is metal.
    pub reflection_db: f64,
}

/// How people shade what stands behind them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Shadow {
    /// Loss of a ray through a person's middle, decibels.
    pub loss_db: f64,
    /// How far beside the middle the loss has faded, metres.
    pub half_width_m: f64,
}

impl Default for Shadow {
    fn default() -> Self {
        Self { loss_db: 6.0, half_width_m: 0.25 }
    }
}

impl Reflector {
    /// Checks every field; `of` is where the reflector is in the configuration.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self, of: &str) -> Result<(), InvalidSetting> {
        for (field, place) in [("from_m", self.from_m), ("to_m", self.to_m)] {
            if !place.iter().all(|m| m.is_finite() && m.abs() <= 1e4) {
                return Err(invalid(format!("{of}.{field}"), place, "use [x, y] within 10 km"));
            }
        }
        if (Vector2::from(self.to_m) - Vector2::from(self.from_m)).norm() < 0.01 {
            return Err(invalid(format!("{of}.to_m"), self.to_m, "use an end 0.01 m away or more"));
        }
        if !(-200.0..=0.0).contains(&self.reflection_db) {
            let field = format!("{of}.reflection_db");
            return Err(invalid(field, self.reflection_db, "use -200 to 0 dB"));
        }
        Ok(())
    }
}

impl Shadow {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), InvalidSetting> {
        if !(0.0..=100.0).contains(&self.loss_db) {
            return Err(invalid("scene.shadow.loss_db", self.loss_db, "use 0 to 100 dB"));
        }
        if !(0.01..=10.0).contains(&self.half_width_m) {
            let field = "scene.shadow.half_width_m";
            return Err(invalid(field, self.half_width_m, "use 0.01 to 10 m"));
        }
        Ok(())
    }

    /// The amplitude left of the straight ray between two places when people stand at `people_m`.
    pub(super) fn left_of(
        &self,
        from_m: &Vector2<f64>,
        to_m: &Vector2<f64>,
        people_m: &[Vector2<f64>],
    ) -> f64 {
        let along = to_m - from_m;
        let depth = 1.0 - from_db(-self.loss_db).sqrt();
        let left = |person_m: &Vector2<f64>| {
            let share =
                (person_m - from_m).dot(&along) / along.norm_squared().max(f64::MIN_POSITIVE);
            let nearest_m = from_m + along * share.clamp(0.0, 1.0);
            let off = (person_m - nearest_m).norm() / self.half_width_m;
            1.0 - depth * (-0.5 * off * off).exp()
        };
        people_m.iter().map(left).product()
    }
}

/// A reflector in the node's frame.
#[derive(Clone, Debug)]
pub(super) struct Mirror {
    from_m: Vector2<f64>,
    along: Vector2<f64>,
    length_m: f64,
    /// Reflection coefficient, negative.
    pub(super) coefficient: f64,
}

/// A mirror's own echo between two antennas.
#[derive(Clone, Copy, Debug)]
pub(super) struct Glare {
    /// Where it is reflected.
    pub(super) place_m: Vector2<f64>,
    /// Optical path, metres.
    pub(super) path_m: f64,
    /// What the wall before the array leaves.
    pub(super) amplitude: f64,
}

impl Mirror {
    pub(super) fn new(from_m: Vector2<f64>, to_m: Vector2<f64>, reflection_db: f64) -> Self {
        let across_m = to_m - from_m;
        let length_m = across_m.norm();
        let coefficient = -from_db(reflection_db).sqrt();
        Self { from_m, along: across_m / length_m, length_m, coefficient }
    }

    /// How far `place_m` is to the left of the mirror.
    fn side_m(&self, place_m: &Vector2<f64>) -> f64 {
        self.along.perp(&(place_m - self.from_m))
    }

    /// The image of `place_m`, if the array's centre sees it in the mirror.
    pub(super) fn image(&self, place_m: &Vector2<f64>) -> Option<Vector2<f64>> {
        let (centre_side_m, side_m) = (self.side_m(&Vector2::zeros()), self.side_m(place_m));
        if centre_side_m * side_m <= 0.0 {
            return None;
        }
        let normal = Vector2::new(-self.along.y, self.along.x);
        let image_m = place_m - normal * (2.0 * side_m);
        let seen_m = image_m * (centre_side_m / (centre_side_m + side_m));
        let at_m = (seen_m - self.from_m).dot(&self.along);
        (0.0..=self.length_m).contains(&at_m).then_some(image_m)
    }

    /// The part of the mirror, in metres from its first end, that lies beyond `depth_m`.
    fn part_beyond(&self, depth_m: f64) -> Option<(f64, f64)> {
        let (start_m, end_m) = (self.from_m.y, self.from_m.y + self.along.y * self.length_m);
        let limit_m = depth_m + EDGE_M;
        let cut_m = (limit_m - start_m) / self.along.y;
        match (limit_m < start_m, limit_m < end_m) {
            (true, true) => Some((0.0, self.length_m)),
            (true, false) => Some((0.0, cut_m)),
            (false, true) => Some((cut_m, self.length_m)),
            (false, false) => None,
        }
    }

    /// The mirror's own echoes between two antennas: straight, and with passes inside the wall
    /// before the array; empty if the mirror does not face both.
    pub(super) fn glares(
        &self,
        slab: &Slab,
        tx_m: &Vector2<f64>,
        rx_m: &Vector2<f64>,
    ) -> Vec<Glare> {
        let Some((low_m, high_m)) = self.part_beyond(slab.end_m()) else { return Vec::new() };
        if self.side_m(tx_m) * self.side_m(rx_m) <= 0.0 {
            return Vec::new();
        }
        let point = |at_m: f64| self.from_m + self.along * at_m;
        let middle_m = point(0.5 * (low_m + high_m));
        let pass_count = slab.pass_count(&middle_m) + 1;
        let mut all = Vec::new();
        for (tx_passes, rx_passes) in
            (0..pass_count * pass_count).map(|k| (k / pass_count, k % pass_count))
        {
            let glare = |at_m: f64| {
                let place_m = point(at_m);
                let (there, back) =
                    (slab.leg(tx_m, &place_m, tx_passes), slab.leg(rx_m, &place_m, rx_passes));
                let path_m = there.path_m + back.path_m;
                Glare { place_m, path_m, amplitude: there.amplitude * back.amplitude }
            };
            let at_m = lowest(low_m, high_m, |at_m| glare(at_m).path_m);
            if low_m + EDGE_M < at_m && at_m < high_m - EDGE_M {
                all.push(glare(at_m));
            }
        }
        all
    }
}

/// Where the convex `f` is least between two numbers, by golden section.
fn lowest(mut low: f64, mut high: f64, f: impl Fn(f64) -> f64) -> f64 {
    let (mut left, mut right) = (high - GOLDEN * (high - low), low + GOLDEN * (high - low));
    let (mut f_left, mut f_right) = (f(left), f(right));
    for _ in 0..SEARCH_STEPS {
        if f_left < f_right {
            (high, right, f_right) = (right, left, f_left);
            left = high - GOLDEN * (high - low);
            f_left = f(left);
        } else {
            (low, left, f_left) = (left, right, f_right);
            right = low + GOLDEN * (high - low);
            f_right = f(right);
        }
    }
    0.5 * (low + high)
}
