//! What an airborne radar measures of a place on the ground, and the place of what it measured.

use nalgebra::{Vector2, Vector3};

/// An aircraft that flies level, in the local frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Carrier {
    /// `(east, north, up)`, metres.
    pub position_m: Vector3<f64>,
    /// `α`: direction of flight, counter-clockwise from east, radians.
    pub direction_rad: f64,
    /// Metres per second.
    pub speed_m_per_s: f64,
}

/// On which side of the flight.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Positive `y` of the platform's frame.
    Left,
    /// Negative `y`.
    Right,
}

/// A place as a radar sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sight {
    /// `r`: length of the line of sight, metres.
    pub slant_m: f64,
    /// `θ`: angle between the flight and the line of sight (a cone, not a ground azimuth), radians.
    pub cone_rad: f64,
    /// Which of the two places on the ground that have both.
    pub side: Side,
    /// Unit vector from the radar to the place.
    pub direction: Vector3<f64>,
}

impl Side {
    fn sign(self) -> f64 {
        match self {
            Self::Left => 1.0,
            Self::Right => -1.0,
        }
    }
}

impl Carrier {
    fn along(&self) -> Vector2<f64> {
        Vector2::new(self.direction_rad.cos(), self.direction_rad.sin())
    }

    /// Velocity, `(east, north, up)`, metres per second.
    #[must_use]
    pub fn velocity_m_per_s(&self) -> Vector3<f64> {
        (self.along() * self.speed_m_per_s).push(0.0)
    }

    /// How a place `(east, north, up)` is seen; `None` from that place itself.
    #[must_use]
    pub fn sight(&self, place_m: &Vector3<f64>) -> Option<Sight> {
        let line_m = place_m - self.position_m;
        let slant_m = line_m.norm();
        let direction = line_m.try_normalize(f64::MIN_POSITIVE)?;
        let along = self.along();
        let cone_rad = along.dot(&direction.xy()).clamp(-1.0, 1.0).acos();
        let side = if 0.0 <= along.perp(&direction.xy()) { Side::Left } else { Side::Right };
        Some(Sight { slant_m, cone_rad, side, direction })
    }

    /// The place with a sight's range, cone angle and side at the height `up_m` (`h_t`):
    /// `x = r cos θ`, `y = ± sqrt(r² sin²θ − (H − h_t)²)`, turned by `α` and moved by the aircraft's
    /// place \[wide-area, eq. (1) to (3)\]. `None` if the line of sight does not come down so far.
    #[must_use]
    pub fn place(&self, sight: &Sight, up_m: f64) -> Option<Vector2<f64>> {
        let (sin_cone, cos_cone) = sight.cone_rad.sin_cos();
        let drop_m = self.position_m.z - up_m;
        let squared = (sight.slant_m * sin_cone).powi(2) - drop_m * drop_m;
        let (x_m, y_m) = (sight.slant_m * cos_cone, sight.side.sign() * squared.max(0.0).sqrt());
        let (sin, cos) = self.direction_rad.sin_cos();
        let turned_m = Vector2::new(x_m * cos - y_m * sin, x_m * sin + y_m * cos);
        (0.0 <= squared).then(|| self.position_m.xy() + turned_m)
    }

    /// How far a change of the cone angle moves the place at constant range, metres per radian, for
    /// a place `(east, north, up)`: it moves on a circle around the point under the aircraft, along
    /// which `x = r cos θ` changes by the sine of the ground angle `φ` between flight and place, so
    /// that `ds = r sin θ / sin φ dθ`.
    #[must_use]
    pub fn cross_m_per_rad(&self, place_m: &Vector3<f64>) -> Option<f64> {
        let sight = self.sight(place_m)?;
        let ground_m = (place_m - self.position_m).xy();
        let sin_ground = self.along().perp(&ground_m).abs() / ground_m.norm();
        let moved_m = sight.slant_m * sight.cone_rad.sin() / sin_ground;
        moved_m.is_finite().then_some(moved_m)
    }
}

/// `v + W k` in `[−W/2, W/2)`.
#[must_use]
pub fn wrapped(velocity_m_per_s: f64, wrap_m_per_s: f64) -> f64 {
    (velocity_m_per_s + 0.5 * wrap_m_per_s).rem_euclid(wrap_m_per_s) - 0.5 * wrap_m_per_s
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    /// Rounding at distances of tens of kilometres, metres.
    const SAME_M: f64 = 1e-6;

    fn carriers() -> Vec<(Carrier, Vector3<f64>)> {
        let mut all = Vec::new();
        // Not straight ahead, where both sides are one.
        for index in 1..40 {
            let turn = f64::from(index) * 0.37;
            let carrier = Carrier {
                position_m: Vector3::new(500.0 * turn, -300.0, 6000.0 + 10.0 * turn),
                direction_rad: turn - PI,
                speed_m_per_s: 120.0,
            };
            let ground = Vector2::new((1.9 * turn).cos(), (1.9 * turn).sin());
            let place_m = carrier.position_m.xy() + ground * (8000.0 + 700.0 * turn);
            all.push((carrier, place_m.push(40.0 * turn)));
        }
        all
    }

    #[test]
    fn the_sight_is_that_of_plain_geometry_and_leads_back_to_the_place() {
        for (carrier, place_m) in carriers() {
            let sight = carrier.sight(&place_m).unwrap();
            let line_m = place_m - carrier.position_m;
            assert!((sight.slant_m - line_m.norm()).abs() < SAME_M);
            let angle = line_m.angle(&carrier.velocity_m_per_s());
            assert!((sight.cone_rad - angle).abs() < 1e-9);
            let back_m = carrier.place(&sight, place_m.z).unwrap();
            assert!((back_m - place_m.xy()).norm() < SAME_M, "{back_m} {place_m}");
        }
    }

    #[test]
    fn the_other_side_mirrors_the_place_across_the_flight() {
        for (carrier, place_m) in carriers() {
            let sight = carrier.sight(&place_m).unwrap();
            let side = if sight.side == Side::Left { Side::Right } else { Side::Left };
            let mirrored_m = carrier.place(&Sight { side, ..sight }, place_m.z).unwrap();
            let again = carrier.sight(&mirrored_m.push(place_m.z)).unwrap();
            assert_eq!(again.side, side);
            assert!((again.cone_rad - sight.cone_rad).abs() < 1e-9);
            assert!((again.slant_m - sight.slant_m).abs() < SAME_M);
        }
    }

    #[test]
    fn the_cross_error_of_the_cone_angle_is_that_of_a_small_step() {
        let step_rad = 1e-7;
        for (carrier, place_m) in carriers() {
            let sight = carrier.sight(&place_m).unwrap();
            let at =
                |cone_rad: f64| carrier.place(&Sight { cone_rad, ..sight }, place_m.z).unwrap();
            let moved_m = (at(sight.cone_rad + step_rad) - at(sight.cone_rad - step_rad)).norm();
            let expected = moved_m / (2.0 * step_rad);
            let got = carrier.cross_m_per_rad(&place_m).unwrap();
            assert!((got / expected - 1.0).abs() < 1e-5, "{got} {expected}");
        }
    }

    #[test]
    fn a_line_that_ends_in_the_air_has_no_place() {
        let (carrier, place_m) = carriers()[0];
        let sight = carrier.sight(&place_m).unwrap();
        assert_eq!(carrier.place(&Sight { slant_m: 100.0, ..sight }, 0.0), None);
        assert_eq!(carrier.sight(&carrier.position_m), None);
        let under_m = carrier.position_m - Vector3::z() * 5000.0;
        assert_eq!(carrier.cross_m_per_rad(&under_m), None);
    }

    #[test]
    fn velocities_wrap_into_half_of_the_span_on_either_side() {
        for (velocity, expected) in
            [(3.0, 3.0), (13.0, -7.0), (-10.0, -10.0), (10.0, -10.0), (-31.0, 9.0)]
        {
            assert!((wrapped(velocity, 20.0) - expected).abs() < 1e-9, "{velocity}");
        }
    }
}
