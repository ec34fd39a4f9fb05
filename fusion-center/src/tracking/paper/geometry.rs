//! Slant range and cone angle of targets as a flying sensor sees them, and where they will be.
//!
//! The sensor is at `a` over the plane of the targets, the unit vector `e` points along its flight,
//! the target is at `p` on the plane. With `l = p − a`, \[wide-area, eqs. (1)-(4), (6)\]:
//!
//! ```text
//!         r = |l|,  θ = ∠(e, l)                               slant range, cone angle
//! (1),(2) x_P = r cos θ,  y_P = ± sqrt(r² sin²θ − H²)
//! (3)     E = E_a + x_P cos α − y_P sin α,  N = N_a + x_P sin α + y_P cos α
//! (4)     r' = r + v_r T,  r̂ = sqrt(r'² + b² − 2 r' b cos θ)  law of cosines, b = v_a T
//! (6)     θ̂ = arccos((r' cos θ − b) / r̂)
//! ```
//!
//! `H` is the sensor's height over the plane, `α` the angle from east to `e`, `T` the time between
//! the two looks at the target. The formulas hold for a level, straight flight; here `b e` is the
//! way from one place of the sensor to the other, which is the same there and exact for any flight,
//! and (1)-(3) are solved for an `e` that may climb. Metres, seconds, radians.

use nalgebra::{Vector2, Vector3};

use crate::tracking::Platform;

/// Over a shorter way, metres, errors of the sensor's place are in its direction, and the stated
/// velocity tells it better.
const MIN_WAY_M: f64 = 1.0;
/// A slower sensor has no direction of flight, metres per second.
const MIN_SPEED_M_PER_S: f64 = 1e-3;

/// The way of the sensor between two looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Way {
    /// `b`, metres.
    pub(super) length_m: f64,
    /// `e`, a unit vector.
    pub(super) along: Vector3<f64>,
}

/// A target as the sensor sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sight {
    /// `r`, metres.
    pub(super) range_m: f64,
    /// `θ`, 0 to π.
    pub(super) cone_rad: f64,
    /// Sign of `y_P`: whether the target is to the left of the way (+1) or to its right (−1).
    pub(super) side: f64,
}

/// How much range and cone angle change with the place: by `gradient · δp`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Gradients {
    /// Of the range, metres per metre.
    pub(super) range: Vector2<f64>,
    /// Of the cone angle, radians per metre.
    pub(super) cone: Vector2<f64>,
}

/// From the sensor to a place of the plane.
pub(super) fn line(platform: &Platform, place_m: Vector2<f64>) -> Vector3<f64> {
    Vector3::new(place_m.x, place_m.y, 0.0) - platform.position_m
}

impl Way {
    /// The way from where the sensor was to where it is. A sensor that stands has none; then the
    /// angle is counted from the level direction across the line of sight to `place_m`, about which
    /// it tells most.
    pub(super) fn between(from: &Platform, to: &Platform, place_m: Vector2<f64>) -> Self {
        let way = to.position_m - from.position_m;
        let length_m = way.norm();
        if MIN_WAY_M < length_m {
            return Self { length_m, along: way / length_m };
        }
        let speed_m_per_s = from.velocity_m_per_s.norm();
        let along = if MIN_SPEED_M_PER_S < speed_m_per_s {
            from.velocity_m_per_s / speed_m_per_s
        } else {
            across(&line(from, place_m))
        };
        Self { length_m: way.dot(&along), along }
    }
}

/// The level direction across `line`, which is then to the left.
fn across(line: &Vector3<f64>) -> Vector3<f64> {
    let across = Vector3::new(line.y, -line.x, 0.0);
    across.try_normalize(f64::MIN_POSITIVE).unwrap_or_else(Vector3::x)
}

impl Sight {
    /// How a target is seen over `line` against the flight direction `along`.
    pub(super) fn new(line: &Vector3<f64>, along: &Vector3<f64>) -> Self {
        Self {
            range_m: line.norm(),
            cone_rad: along.cross(line).norm().atan2(along.dot(line)),
            side: (along.x * line.y - along.y * line.x).signum(),
        }
    }

    /// Where the target is seen after the sensor has gone `length_m` along the direction from which
    /// the angle is counted, if it has gone away by `away_m` (`v_r T`): \[wide-area, eqs. (4), (6)\].
    pub(super) fn predicted(&self, away_m: f64, length_m: f64) -> Self {
        let range_m = (self.range_m + away_m).max(0.0);
        let (sin, cos) = self.cone_rad.sin_cos();
        let square = range_m * range_m + length_m * length_m - 2.0 * range_m * length_m * cos;
        Self {
            range_m: square.max(0.0).sqrt(),
            // The arc cosine of eq. (6), which loses its digits ahead and behind.
            cone_rad: (range_m * sin).atan2(range_m * cos - length_m),
            side: self.side,
        }
    }

    /// The place on the plane, seen from `from_m` along `along`: \[wide-area, eqs. (1)-(3)\]; `None`
    /// where no place of the plane is seen so, as over the horizon of a range below the height.
    pub(super) fn place_m(
        &self,
        from_m: &Vector3<f64>,
        along: &Vector3<f64>,
    ) -> Option<Vector2<f64>> {
        let level = along.xy();
        let share = level.norm();
        let height_m = from_m.z;
        let x_m = (self.range_m * self.cone_rad.cos() + height_m * along.z) / share;
        let y_m = (self.range_m * self.range_m - height_m * height_m - x_m * x_m).sqrt();
        let level = level / share;
        let left = Vector2::new(-level.y, level.x);
        let place_m = from_m.xy() + level * x_m + left * (self.side * y_m);
        place_m.iter().all(|value| value.is_finite()).then_some(place_m)
    }
}

impl Gradients {
    /// At the end of `line`, against the flight direction `along`. With `g = l/r` they are the level
    /// parts of `g` and of `−(e − g cos θ) / (r sin θ)`.
    pub(super) fn new(line: &Vector3<f64>, along: &Vector3<f64>) -> Self {
        let sight = Sight::new(line, along);
        let range = line / sight.range_m.max(f64::MIN_POSITIVE);
        let (sin, cos) = sight.cone_rad.sin_cos();
        let cone = (range * cos - along) / (sight.range_m * sin).max(f64::MIN_POSITIVE);
        Self { range: range.xy(), cone: cone.xy() }
    }
}
