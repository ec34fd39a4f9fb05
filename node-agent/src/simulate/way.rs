//! Where a target is on its way, how it is turned, and how far its steps have come.
//!
//! Between way points it moves evenly. Corners are rounded by averaging over `turn_s`: place and
//! heading are the means of the unrounded ones from `t − turn_s/2` to `t + turn_s/2`, so that a
//! change of velocity `Δv` takes `turn_s` at the acceleration `Δv / turn_s`, and a turn happens at
//! an even rate the shorter way round.
//!
//! A gait cycle is two steps. Its length at speed `v` is `1.346 sqrt(H v)` with the hip's height
//! `H` in metres \[walking-model\]; below 0.5 m/s it is taken proportional to `v`, so that slow
//! steps shrink and their frequency stays.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::Vector2;

use super::scene::WayPoint;

/// Height of the hip above the ground, metres.
const HIP_M: f64 = 0.86;
/// Length of a gait cycle over `sqrt(H v)`.
const CYCLE_FACTOR: f64 = 1.346;
/// Below this speed, metres per second, steps shrink in proportion.
const SLOW_M_PER_S: f64 = 0.5;
/// Way points closer than this are one place, metres.
const STANDING_M: f64 = 1e-9;

/// How far a person comes in two steps at `speed_m_per_s`, metres.
pub(super) fn cycle_m(speed_m_per_s: f64) -> f64 {
    let shrink = (speed_m_per_s / SLOW_M_PER_S).clamp(0.0, 1.0).sqrt();
    CYCLE_FACTOR * (HIP_M * speed_m_per_s.max(0.0)).sqrt() * shrink
}

/// Gait cycles per second.
fn cycle_hz(speed_m_per_s: f64) -> f64 {
    let speed_m_per_s = speed_m_per_s.max(SLOW_M_PER_S);
    speed_m_per_s / cycle_m(speed_m_per_s)
}

/// The place on the way with sharp corners. Assumes at least one way point.
pub(super) fn sharp_place_m(points: &[WayPoint], time_s: f64) -> Vector2<f64> {
    let (from, to) = leg(points, time_s);
    let duration_s = to.time_s - from.time_s;
    let share = if 0.0 < duration_s { (time_s - from.time_s) / duration_s } else { 0.0 };
    let share = share.clamp(0.0, 1.0);
    Vector2::new(from.x_m + share * (to.x_m - from.x_m), from.y_m + share * (to.y_m - from.y_m))
}

/// The way points before and after `time_s`.
pub(super) fn leg(points: &[WayPoint], time_s: f64) -> (&WayPoint, &WayPoint) {
    let after = points.partition_point(|way_point| way_point.time_s <= time_s);
    (&points[after.saturating_sub(1)], &points[after.min(points.len() - 1)])
}

/// The place on the way with rounded corners; sharp ones if `turn_s` is 0.
pub(super) fn place_m(points: &[WayPoint], turn_s: f64, time_s: f64) -> Vector2<f64> {
    if turn_s <= 0.0 {
        return sharp_place_m(points, time_s);
    }
    // The way is straight in every piece, and the mean of a straight piece is its middle.
    let middles = pieces_s(points, turn_s, time_s)
        .map(|(from_s, to_s)| sharp_place_m(points, 0.5 * (from_s + to_s)) * (to_s - from_s));
    middles.sum::<Vector2<f64>>() / turn_s
}

/// The times around `time_s` that count, cut at the way points.
fn pieces_s(
    points: &[WayPoint],
    turn_s: f64,
    time_s: f64,
) -> impl Iterator<Item = (f64, f64)> + '_ {
    let (from_s, to_s) = (time_s - 0.5 * turn_s, time_s + 0.5 * turn_s);
    let first = points.partition_point(|p| p.time_s <= from_s);
    let end = points.partition_point(|p| p.time_s < to_s);
    (first..=end.max(first)).map(move |index| {
        let before_s = if index == first { from_s } else { points[index - 1].time_s };
        let after_s = if index < end { points[index].time_s } else { to_s };
        (before_s, after_s)
    })
}

/// A way with what a walking body needs to know of it.
#[derive(Clone, Debug)]
pub(super) struct Way {
    points: Vec<WayPoint>,
    turn_s: f64,
    /// Heading of every leg, without jumps of a full turn.
    headings_rad: Vec<f64>,
    /// Way and gait cycles up to every way point.
    reached: Vec<[f64; 2]>,
}

impl Way {
    /// Assumes at least one way point and ascending times.
    pub(super) fn new(points: &[WayPoint], turn_s: f64) -> Self {
        let moves: Vec<Vector2<f64>> = points
            .windows(2)
            .map(|p| Vector2::new(p[1].x_m - p[0].x_m, p[1].y_m - p[0].y_m))
            .collect();
        let mut reached = vec![[0.0, 0.0]];
        for (pair, moved_m) in points.windows(2).zip(&moves) {
            let [way_m, cycles] = reached[reached.len() - 1];
            let duration_s = pair[1].time_s - pair[0].time_s;
            let hz = cycle_hz(moved_m.norm() / duration_s);
            reached.push([way_m + moved_m.norm(), cycles + hz * duration_s]);
        }
        Self { points: points.to_vec(), turn_s, headings_rad: headings_rad(&moves), reached }
    }

    /// Velocity, metres per second.
    pub(super) fn velocity(&self, time_s: f64) -> Vector2<f64> {
        if self.turn_s <= 0.0 {
            let (from, to) = leg(&self.points, time_s);
            let duration_s = (to.time_s - from.time_s).max(f64::MIN_POSITIVE);
            return Vector2::new(to.x_m - from.x_m, to.y_m - from.y_m) / duration_s;
        }
        let at = |offset_s: f64| sharp_place_m(&self.points, time_s + offset_s);
        (at(0.5 * self.turn_s) - at(-0.5 * self.turn_s)) / self.turn_s
    }

    /// The unit vector ahead; where it last walked to if it stands.
    pub(super) fn ahead(&self, time_s: f64) -> Vector2<f64> {
        let sharp = |at_s: f64| {
            let after = self.points.partition_point(|p| p.time_s <= at_s);
            self.headings_rad[after.saturating_sub(1).min(self.headings_rad.len() - 1)]
        };
        let heading_rad = if self.turn_s <= 0.0 {
            sharp(time_s)
        } else {
            let turns = pieces_s(&self.points, self.turn_s, time_s)
                .map(|(from_s, to_s)| sharp(0.5 * (from_s + to_s)) * (to_s - from_s));
            turns.sum::<f64>() / self.turn_s
        };
        Vector2::new(heading_rad.cos(), heading_rad.sin())
    }

    /// Metres walked and gait cycles made since the first way point, both continuous.
    pub(super) fn progress(&self, time_s: f64) -> [f64; 2] {
        let after = self.points.partition_point(|p| p.time_s <= time_s);
        let from = after.saturating_sub(1);
        let [way_m, cycles] = self.reached[from];
        let since_s = time_s - self.points[from].time_s;
        if after == 0 || after == self.points.len() {
            return [way_m, cycles + since_s * cycle_hz(0.0)];
        }
        let share = since_s / (self.points[after].time_s - self.points[from].time_s);
        let [way_then_m, cycles_then] = self.reached[after];
        [way_m + share * (way_then_m - way_m), cycles + share * (cycles_then - cycles)]
    }
}

/// The heading of every leg; of one that stands, that of the leg before, or of the first that
/// moves; along the world's `y` if none does.
fn headings_rad(moves: &[Vector2<f64>]) -> Vec<f64> {
    let is_move = |moved_m: &&Vector2<f64>| STANDING_M < moved_m.norm();
    let first = moves.iter().find(is_move).map_or(FRAC_PI_2, |m| m.y.atan2(m.x));
    let mut heading = first;
    let mut all = Vec::new();
    for moved_m in moves {
        if is_move(&moved_m) {
            let turn = (moved_m.y.atan2(moved_m.x) - heading + PI).rem_euclid(TAU) - PI;
            heading += turn;
        }
        all.push(heading);
    }
    if all.is_empty() { vec![first] } else { all }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points(list: &[[f64; 3]]) -> Vec<WayPoint> {
        list.iter()
            .map(|[time_s, x_m, y_m]| WayPoint { time_s: *time_s, x_m: *x_m, y_m: *y_m })
            .collect()
    }

    /// East, a stop of 2 s, then back west and north.
    fn errand() -> Vec<WayPoint> {
        points(&[
            [1.0, 0.0, 0.0],
            [5.0, 4.0, 0.0],
            [7.0, 4.0, 0.0],
            [9.0, 2.0, 0.0],
            [10.0, 2.0, 1.5],
        ])
    }

    #[test]
    fn rounded_places_and_headings_are_means_over_the_turn() {
        let (list, turn_s) = (errand(), 0.8);
        let way = Way::new(&list, turn_s);
        let sharp = Way::new(&list, 0.0);
        for step in 0..220 {
            let time_s = 0.05 * f64::from(step);
            let mut mean = Vector2::zeros();
            let mut turned = Vector2::zeros();
            for part in 0..4000 {
                let at_s = time_s + turn_s * ((f64::from(part) + 0.5) / 4000.0 - 0.5);
                mean += sharp_place_m(&list, at_s) / 4000.0;
                turned += sharp.ahead(at_s) / 4000.0;
            }
            let got = place_m(&list, turn_s, time_s);
            assert!((got - mean).norm() < 1e-4, "{time_s}: {got} for {mean}");
            let ahead = way.ahead(time_s);
            assert!((ahead.norm() - 1.0).abs() < 1e-12);
            // Only before and after a turn is the mean of unit vectors as long as one.
            if 0.999 < turned.norm() {
                assert!((ahead - turned).norm() < 0.05, "{time_s}: {ahead} for {turned}");
            }
            let h_s = 1e-5;
            let slope = (place_m(&list, turn_s, time_s + h_s)
                - place_m(&list, turn_s, time_s - h_s))
                / (2.0 * h_s);
            assert!((way.velocity(time_s) - slope).norm() < 1e-3, "{time_s}");
            let push = (way.velocity(time_s + h_s) - way.velocity(time_s)) / h_s;
            assert!(push.norm() < (1.0 + 1.5) / turn_s + 1e-6, "{time_s}: {push} m/s²");
        }
        // Half way through an about-turn it faces across, and after it the other way.
        assert!(way.ahead(7.0).x.abs() < 1e-9);
        assert!((way.ahead(6.0) - Vector2::x()).norm() < 1e-9);
        assert!((way.ahead(8.0) + Vector2::x()).norm() < 1e-9);
        assert!((way.ahead(99.0) - Vector2::y()).norm() < 1e-9);
        assert!((Way::new(&list[..1], 0.8).ahead(3.0) - Vector2::y()).norm() < 1e-12);
    }

    #[test]
    fn steps_follow_the_speed_and_never_jump() {
        let way = Way::new(&errand(), 0.8);
        let [way_m, cycles] = way.progress(10.0);
        assert!((way_m - 7.5).abs() < 1e-12);
        // 1 m/s is 0.80 cycles a second, 1.5 m/s is 0.98 and standing 0.57 (whose steps are 0 long).
        assert!((cycles - (6.0 * 0.801 + 0.981 + 2.0 * 0.5666)).abs() < 0.01, "{cycles}");
        for step in 0..1200 {
            let time_s = 0.01 * f64::from(step);
            let ([a_m, a], [b_m, b]) = (way.progress(time_s), way.progress(time_s + 1e-4));
            assert!((0.0..=1.51e-4).contains(&(b_m - a_m)), "{time_s}");
            assert!((0.5e-4..1.0e-4).contains(&(b - a)), "{time_s}");
        }
        // A walk of 1.2 m/s makes 1.76 steps a second.
        assert!((2.0 * cycle_hz(1.2) - 1.755).abs() < 0.01);
        assert!(cycle_m(0.0) < 1e-12 && (cycle_m(0.5 + 1e-9) - cycle_m(0.5)).abs() < 1e-6);
    }
}
