//! Ways of vehicles: straight legs, turns of a radius, pauses.

use nalgebra::{Rotation2, Vector2};
use serde::{Deserialize, Serialize};

use crate::imaging::{InvalidSetting, invalid};

/// Turns by less than this are none, radians.
const NO_TURN_RAD: f64 = 1e-9;
/// Share of a leg by which turns at its ends may overlap from rounding.
const LEG_ROUNDING: f64 = 1e-9;

/// A place on a way, in the plane.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WayPoint {
    /// Towards east, metres.
    pub east_m: f64,
    /// Towards north, metres.
    pub north_m: f64,
    /// From here to the next one, metres per second; without meaning at the last one.
    #[serde(default)]
    pub speed_m_per_s: f64,
    /// Stands here for so long first, seconds.
    #[serde(default)]
    pub pause_s: f64,
    /// Cuts the corner here by an arc of this radius, metres; 0 turns on the spot. The arc is driven
    /// at the speed of the leg before.
    #[serde(default)]
    pub turn_radius_m: f64,
}

/// Where something is and how it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// `(east, north)`, metres.
    pub position_m: Vector2<f64>,
    /// Metres per second.
    pub velocity_m_per_s: Vector2<f64>,
}

/// A way that can be asked where somebody on it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Way {
    pieces: Vec<Piece>,
}

#[derive(Clone, Debug, PartialEq)]
struct Piece {
    start_s: f64,
    end_s: f64,
    shape: Shape,
}

#[derive(Clone, Debug, PartialEq)]
enum Shape {
    /// With a velocity, which may be 0.
    Line {
        from_m: Vector2<f64>,
        velocity_m_per_s: Vector2<f64>,
    },
    Arc {
        center_m: Vector2<f64>,
        from_center_m: Vector2<f64>,
        rate_rad_per_s: f64,
    },
}

/// A corner that is cut.
#[derive(Clone, Copy, Debug)]
struct Corner {
    /// From the point to where the arc begins and ends.
    tangent_m: f64,
    /// Left positive.
    turn_rad: f64,
}

impl WayPoint {
    fn at_m(&self) -> Vector2<f64> {
        Vector2::new(self.east_m, self.north_m)
    }

    fn check(&self, field: &str) -> Result<(), InvalidSetting> {
        if !self.east_m.is_finite() || !self.north_m.is_finite() {
            return Err(invalid(field, self, "use places in metres"));
        }
        let not_negative = |value: f64| 0.0 <= value && value.is_finite();
        if !not_negative(self.pause_s) || !not_negative(self.turn_radius_m) {
            return Err(invalid(field, self, "use 0 or positive numbers"));
        }
        if 0.0 < self.pause_s && 0.0 < self.turn_radius_m {
            let remedy = "pause at a point without turn_radius_m, before or after the turn";
            return Err(invalid(field, self, remedy));
        }
        Ok(())
    }
}

impl Way {
    /// The way through `points`, begun at `from_s`.
    ///
    /// # Errors
    /// If a number makes no sense, two points are the same, or a leg is too short for the turns at
    /// its ends. `field` is the name that it is given there.
    pub fn new(points: &[WayPoint], from_s: f64, field: &str) -> Result<Self, InvalidSetting> {
        if points.is_empty() || !from_s.is_finite() {
            return Err(invalid(field, points, "list at least one point and a time to start"));
        }
        for (index, point) in points.iter().enumerate() {
            let named = format!("{field}[{index}]");
            point.check(&named)?;
            let is_last = index + 1 == points.len();
            if !is_last && !(f64::MIN_POSITIVE..=f64::MAX).contains(&point.speed_m_per_s) {
                return Err(invalid(named, point, "use a positive speed_m_per_s from here on"));
            }
        }
        let corners = corners(points, field)?;
        let mut way = Self { pieces: Vec::new() };
        let mut now_s = from_s;
        for (index, point) in points.iter().enumerate() {
            now_s = way.stand(point, now_s);
            if let Some(next) = points.get(index + 1) {
                let cut_m = (corners[index].tangent_m, corners[index + 1].tangent_m);
                now_s = way.drive(point, next, cut_m, now_s);
                now_s = way.turn(&points[index..], &corners[index + 1], now_s);
            }
        }
        Ok(way)
    }

    /// Where one on the way is; `None` before its start and after its end.
    #[must_use]
    pub fn at(&self, time_s: f64) -> Option<Motion> {
        let next = self.pieces.partition_point(|piece| piece.end_s < time_s);
        let piece = self.pieces.get(next).filter(|piece| piece.start_s <= time_s)?;
        let passed_s = time_s - piece.start_s;
        Some(match &piece.shape {
            Shape::Line { from_m, velocity_m_per_s } => Motion {
                position_m: from_m + velocity_m_per_s * passed_s,
                velocity_m_per_s: *velocity_m_per_s,
            },
            Shape::Arc { center_m, from_center_m, rate_rad_per_s } => {
                let spoke_m = Rotation2::new(rate_rad_per_s * passed_s) * from_center_m;
                Motion {
                    position_m: center_m + spoke_m,
                    velocity_m_per_s: *rate_rad_per_s * left_of(&spoke_m),
                }
            }
        })
    }

    /// When it ends, seconds.
    #[must_use]
    pub fn end_s(&self) -> f64 {
        self.pieces.last().map_or(f64::NEG_INFINITY, |piece| piece.end_s)
    }

    fn push(&mut self, shape: Shape, start_s: f64, duration_s: f64) -> f64 {
        let end_s = start_s + duration_s;
        self.pieces.push(Piece { start_s, end_s, shape });
        end_s
    }

    fn stand(&mut self, point: &WayPoint, now_s: f64) -> f64 {
        let shape = Shape::Line { from_m: point.at_m(), velocity_m_per_s: Vector2::zeros() };
        if 0.0 < point.pause_s { self.push(shape, now_s, point.pause_s) } else { now_s }
    }

    /// Straight on, without what the corners at both ends cut off.
    fn drive(&mut self, from: &WayPoint, to: &WayPoint, cut_m: (f64, f64), now_s: f64) -> f64 {
        let leg_m = to.at_m() - from.at_m();
        let direction = leg_m.normalize();
        let length_m = (leg_m.norm() - cut_m.0 - cut_m.1).max(0.0);
        let velocity_m_per_s = direction * from.speed_m_per_s;
        let from_m = from.at_m() + direction * cut_m.0;
        let shape = Shape::Line { from_m, velocity_m_per_s };
        self.push(shape, now_s, length_m / from.speed_m_per_s)
    }

    /// The arc at the second of the points, at the speed of the first.
    fn turn(&mut self, points: &[WayPoint], corner: &Corner, now_s: f64) -> f64 {
        let (before, at) = (&points[0], &points[1]);
        if corner.turn_rad.abs() < NO_TURN_RAD || corner.tangent_m <= 0.0 {
            return now_s;
        }
        let direction = (at.at_m() - before.at_m()).normalize();
        let side = corner.turn_rad.signum();
        let begin_m = at.at_m() - direction * corner.tangent_m;
        let center_m = begin_m + side * at.turn_radius_m * left_of(&direction);
        let rate_rad_per_s = side * before.speed_m_per_s / at.turn_radius_m;
        let from_center_m = begin_m - center_m;
        let shape = Shape::Arc { center_m, from_center_m, rate_rad_per_s };
        self.push(shape, now_s, corner.turn_rad / rate_rad_per_s)
    }
}

/// The same vector, turned a quarter to the left.
fn left_of(vector: &Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-vector.y, vector.x)
}

/// The corner at each point; its arc of radius `R` touches both legs `R tan(turn / 2)` from it.
fn corners(points: &[WayPoint], field: &str) -> Result<Vec<Corner>, InvalidSetting> {
    let legs_m: Vec<Vector2<f64>> =
        points.windows(2).map(|pair| pair[1].at_m() - pair[0].at_m()).collect();
    if let Some(index) = legs_m.iter().position(|leg_m| leg_m.norm() <= 0.0) {
        return Err(invalid(format!("{field}[{index}]"), points[index], "is the same as the next"));
    }
    let corner = |index: usize| {
        let around = index.checked_sub(1).and_then(|before| Some((before, legs_m.get(index)?)));
        around.map_or(Corner { tangent_m: 0.0, turn_rad: 0.0 }, |(before, after_m)| {
            let turn_rad = legs_m[before].perp(after_m).atan2(legs_m[before].dot(after_m));
            let tangent_m = points[index].turn_radius_m * (0.5 * turn_rad).tan().abs();
            Corner { tangent_m, turn_rad }
        })
    };
    let corners: Vec<Corner> = (0..points.len()).map(corner).collect();
    for (index, leg_m) in legs_m.iter().enumerate() {
        let cut_m = corners[index].tangent_m + corners[index + 1].tangent_m;
        if leg_m.norm() * (1.0 + LEG_ROUNDING) < cut_m {
            let remedy =
                "the leg from here is too short for the turns at its ends; use smaller radii";
            return Err(invalid(format!("{field}[{index}]"), points[index], remedy));
        }
    }
    Ok(corners)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding of places of kilometres, metres.
    const SAME_M: f64 = 1e-6;

    fn point(east_m: f64, north_m: f64, pause_s: f64, turn_radius_m: f64) -> WayPoint {
        WayPoint { east_m, north_m, speed_m_per_s: 10.0, pause_s, turn_radius_m }
    }

    fn at(way: &Way, time_s: f64) -> [f64; 2] {
        way.at(time_s).unwrap().position_m.into()
    }

    fn same(one: [f64; 2], other: [f64; 2]) {
        let apart_m = (one[0] - other[0]).hypot(one[1] - other[1]);
        assert!(apart_m < SAME_M, "{one:?} {other:?}");
    }

    #[test]
    fn a_turn_to_the_left_by_hand() {
        // 100 m east, a quarter circle of 20 m, then north.
        let points =
            [point(0.0, 0.0, 0.0, 0.0), point(100.0, 0.0, 0.0, 20.0), point(100.0, 50.0, 3.0, 0.0)];
        let way = Way::new(&points, 5.0, "w").unwrap();
        assert_eq!(way.at(4.999), None);
        same(at(&way, 5.0), [0.0, 0.0]);
        same(at(&way, 13.0), [80.0, 0.0]);
        let arc_s = 0.5 * std::f64::consts::PI * 20.0 / 10.0;
        let diagonal_m = 20.0 * std::f64::consts::FRAC_1_SQRT_2;
        same(at(&way, 13.0 + 0.5 * arc_s), [80.0 + diagonal_m, 20.0 - diagonal_m]);
        same(at(&way, 13.0 + arc_s + 1.0), [100.0, 30.0]);
        same(at(&way, 13.0 + arc_s + 3.0 + 2.9), [100.0, 50.0]);
        assert!((way.end_s() - (13.0 + arc_s + 6.0)).abs() < SAME_M);
        assert_eq!(way.at(way.end_s() + 0.001), None);
    }

    /// On any way: the velocity is what the places change by, and its size is the speed.
    #[test]
    fn velocities_are_the_change_of_places() {
        let points = [
            point(0.0, 0.0, 2.0, 0.0),
            point(300.0, 10.0, 0.0, 60.0),
            point(200.0, -400.0, 0.0, 90.0),
            point(-150.0, -420.0, 4.0, 0.0),
            point(-100.0, 200.0, 0.0, 0.0),
        ];
        let way = Way::new(&points, 0.0, "w").unwrap();
        let step_s = 1e-4;
        let mut time_s = 0.05;
        let mut moving_count = 0;
        while time_s < way.end_s() - 0.1 {
            let Motion { velocity_m_per_s, .. } = way.at(time_s).unwrap();
            let there = |at_s: f64| way.at(at_s).unwrap().position_m;
            let change = (there(time_s + step_s) - there(time_s - step_s)) / (2.0 * step_s);
            let is_corner = (way.at(time_s + step_s).unwrap().velocity_m_per_s
                - way.at(time_s - step_s).unwrap().velocity_m_per_s)
                .norm()
                > 0.1;
            if !is_corner {
                assert!((change - velocity_m_per_s).norm() < 1e-3, "{time_s}");
                let speed = velocity_m_per_s.norm();
                assert!(speed < 1e-9 || (speed - 10.0).abs() < 1e-9, "{time_s} {speed}");
                moving_count += usize::from(speed > 1.0);
            }
            time_s += 0.37;
        }
        assert!(moving_count > 200);
    }

    #[test]
    fn ways_that_cannot_be_driven_are_named() {
        let complaint = |points: &[WayPoint]| Way::new(points, 0.0, "way").unwrap_err();
        assert!(complaint(&[]).remedy.contains("at least one"));
        let still = WayPoint { speed_m_per_s: 0.0, ..point(0.0, 0.0, 0.0, 0.0) };
        assert!(complaint(&[still, point(1.0, 0.0, 0.0, 0.0)]).remedy.contains("speed_m_per_s"));
        assert!(Way::new(&[still], 0.0, "way").is_ok());
        let (a, b) = (point(0.0, 0.0, 0.0, 0.0), point(100.0, 0.0, 0.0, 200.0));
        let tight = complaint(&[a, b, point(100.0, 90.0, 0.0, 0.0)]);
        assert_eq!((tight.field.as_str(), tight.remedy.contains("too short")), ("way[0]", true));
        assert!(complaint(&[a, a]).remedy.contains("same as the next"));
        let both = point(0.0, 50.0, 1.0, 5.0);
        assert!(complaint(&[a, both]).remedy.contains("pause"));
        assert!(complaint(&[point(f64::NAN, 0.0, 0.0, 0.0)]).remedy.contains("metres"));
        assert!(complaint(&[point(0.0, 0.0, -1.0, 0.0)]).remedy.contains("positive"));
    }
}
