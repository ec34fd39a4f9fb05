//! What is in the room: moving targets, things that stand, and the wall before them.

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use proto::geom::{Point, World};
use proto::radar::Wall;

use crate::imaging::{InvalidSetting, invalid};

/// Nearer than this to an array, metres, amplitudes grow no more.
const MIN_RANGE_M: f64 = 0.1;

/// A target is at a place at a time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WayPoint {
    /// When, seconds of the scene.
    pub time_s: f64,
    /// Where, in the world's frame.
    pub x_m: f64,
    /// Where, in the world's frame.
    pub y_m: f64,
}

/// What a target reflects like.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TargetKind {
    /// One scatterer of constant reflectivity.
    #[default]
    Point,
    /// Six scatterers in an ellipse of 0.5 m × 0.28 m, wide across the direction of walking; gains
    /// are drawn anew in every period, and the near side is brighter.
    Person,
}

/// One moving target.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Target {
    /// Where it is when, ascending in time. Between way points it moves evenly; before the first
    /// and after the last it stands.
    pub way_points: Vec<WayPoint>,
    /// What it reflects like.
    #[serde(default)]
    pub kind: TargetKind,
    /// Amplitude over that of the amplitude law, decibels of power.
    #[serde(default)]
    pub amplitude_db: f64,
}

/// One thing that stands and is no target.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Clutter {
    /// Where, in the world's frame.
    pub x_m: f64,
    /// Where, in the world's frame.
    pub y_m: f64,
    /// Amplitude over that of the amplitude law, decibels of power.
    pub amplitude_db: f64,
}

/// How the echo's amplitude depends on the distance to the array's centre.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AmplitudeLaw {
    /// Not at all \[registration, section 4\].
    #[default]
    Equal,
    /// As `(1 m / R)²`.
    InverseSquare,
}

impl AmplitudeLaw {
    /// The amplitude at `range_m`.
    #[must_use]
    pub fn amplitude(self, range_m: f64) -> f64 {
        match self {
            Self::Equal => 1.0,
            Self::InverseSquare => range_m.max(MIN_RANGE_M).powi(-2),
        }
    }
}

/// All that a node could see.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Scene {
    /// What moves.
    pub targets: Vec<Target>,
    /// What stands.
    pub clutter: Vec<Clutter>,
    /// How amplitudes depend on distance.
    pub amplitude_law: AmplitudeLaw,
    /// The wall before every node, parallel to its array.
    pub wall: Option<Wall>,
}

impl Target {
    /// Where the target's middle is at `time_s`. Assumes at least one way point.
    #[must_use]
    pub fn position(&self, time_s: f64) -> Point<World> {
        let (from, to) = self.leg(time_s);
        let duration_s = to.time_s - from.time_s;
        let share = if 0.0 < duration_s { (time_s - from.time_s) / duration_s } else { 0.0 };
        let share = share.clamp(0.0, 1.0);
        Point::new(from.x_m + share * (to.x_m - from.x_m), from.y_m + share * (to.y_m - from.y_m))
    }

    /// The unit vector of the motion at `time_s`; the world's `y` if the target stands.
    #[must_use]
    pub fn direction(&self, time_s: f64) -> Vector2<f64> {
        let (from, to) = self.leg(time_s);
        let moved_m = Vector2::new(to.x_m - from.x_m, to.y_m - from.y_m);
        moved_m.try_normalize(1e-9).unwrap_or_else(Vector2::y)
    }

    /// The way points before and after `time_s`.
    fn leg(&self, time_s: f64) -> (&WayPoint, &WayPoint) {
        let after = self.way_points.partition_point(|way_point| way_point.time_s <= time_s);
        let last = self.way_points.len() - 1;
        (&self.way_points[after.saturating_sub(1)], &self.way_points[after.min(last)])
    }

    fn check(&self, index: usize) -> Result<(), InvalidSetting> {
        let field = format!("scene.targets[{index}].way_points");
        let finite = |p: &WayPoint| [p.time_s, p.x_m, p.y_m].iter().all(|value| value.is_finite());
        if self.way_points.is_empty() || !self.way_points.iter().all(finite) {
            return Err(invalid(field, &self.way_points, "list at least one time and place"));
        }
        let ascending = |p: &[WayPoint]| p[0].time_s < p[1].time_s;
        if !self.way_points.windows(2).all(ascending) {
            return Err(invalid(field, &self.way_points, "let the times ascend"));
        }
        check_amplitude(&format!("scene.targets[{index}]"), self.amplitude_db)
    }
}

fn check_amplitude(of: &str, amplitude_db: f64) -> Result<(), InvalidSetting> {
    if (-200.0..=200.0).contains(&amplitude_db) {
        return Ok(());
    }
    Err(invalid(format!("{of}.amplitude_db"), amplitude_db, "use -200 to 200 dB"))
}

impl Scene {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), InvalidSetting> {
        for (index, target) in self.targets.iter().enumerate() {
            target.check(index)?;
        }
        for (index, clutter) in self.clutter.iter().enumerate() {
            let of = format!("scene.clutter[{index}]");
            if !clutter.x_m.is_finite() || !clutter.y_m.is_finite() {
                return Err(invalid(of, clutter, "use a place in metres"));
            }
            check_amplitude(&of, clutter.amplitude_db)?;
        }
        match &self.wall {
            Some(wall) => Ok(wall.check()?),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn walk() -> Target {
        let way_point = |time_s, x_m, y_m| WayPoint { time_s, x_m, y_m };
        let way_points =
            vec![way_point(1.0, 2.0, 3.0), way_point(3.0, 4.0, 3.0), way_point(4.0, 4.0, 0.0)];
        Target { way_points, kind: TargetKind::Point, amplitude_db: 0.0 }
    }

    #[test]
    fn targets_walk_from_way_point_to_way_point_and_stand_at_the_ends() {
        let target = walk();
        for (time_s, x_m, y_m) in [
            (-5.0, 2.0, 3.0),
            (1.0, 2.0, 3.0),
            (1.5, 2.5, 3.0),
            (3.0, 4.0, 3.0),
            (3.5, 4.0, 1.5),
            (4.0, 4.0, 0.0),
            (99.0, 4.0, 0.0),
        ] {
            let got = target.position(time_s).coords_m;
            assert!((got - Vector2::new(x_m, y_m)).norm() < 1e-12, "{time_s}: {got}");
        }
        assert!((target.direction(2.0) - Vector2::x()).norm() < 1e-12);
        assert!((target.direction(3.9) + Vector2::y()).norm() < 1e-12);
        assert!((target.direction(50.0) - Vector2::y()).norm() < 1e-12);
    }

    #[test]
    fn scenes_are_written_in_toml_and_unknown_keys_are_refused() {
        let text = "
            amplitude_law = 'inverse_square'
            wall = { thickness_m = 0.24, permittivity = 5.0 }
            [[targets]]
            kind = 'person'
            way_points = [{ time_s = 0.0, x_m = 2.0, y_m = 3.0 }, { time_s = 1.0, x_m = 8.0, y_m = 8.0 }]
            [[clutter]]
            x_m = 5.0
            y_m = 9.0
            amplitude_db = 20.0
        ";
        let scene: Scene = toml::from_str(text).unwrap();
        assert_eq!(scene.check(), Ok(()));
        assert_eq!(scene.targets[0].kind, TargetKind::Person);
        assert_eq!(toml::from_str::<Scene>(&toml::to_string(&scene).unwrap()).unwrap(), scene);
        assert!(toml::from_str::<Scene>("speed = 1.0").is_err());
    }

    #[test]
    fn scenes_of_nonsense_are_named() {
        let check = |change: fn(&mut Scene)| {
            let clutter = vec![Clutter { x_m: 0.0, y_m: 0.0, amplitude_db: 0.0 }];
            let mut scene = Scene { targets: vec![walk()], clutter, ..Scene::default() };
            change(&mut scene);
            scene.check().unwrap_err().field
        };
        assert_eq!(check(|s| s.targets[0].way_points.clear()), "scene.targets[0].way_points");
        assert_eq!(
            check(|s| s.targets[0].way_points[1].time_s = 0.5),
            "scene.targets[0].way_points"
        );
        assert_eq!(
            check(|s| s.targets[0].amplitude_db = f64::NAN),
            "scene.targets[0].amplitude_db"
        );
        assert_eq!(check(|s| s.clutter[0].x_m = f64::NAN), "scene.clutter[0]");
        assert_eq!(check(|s| s.clutter[0].amplitude_db = 1e9), "scene.clutter[0].amplitude_db");
        let thin = |s: &mut Scene| s.wall = Some(Wall { thickness_m: 9.0, permittivity: 4.0 });
        assert_eq!(check(thin), "wall.thickness_m");
    }
}
