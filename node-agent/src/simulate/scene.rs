//! What is in the room: moving targets, things that stand, and the wall before them.

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use proto::geom::{Point, World};
use proto::radar::Wall;

use crate::imaging::{InvalidSetting, invalid};

use super::body::Body;
use super::mirrors::{Reflector, Shadow};
use super::slab::WallEffects;
use super::way::{leg, place_m};

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
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TargetKind {
    /// One scatterer of constant reflectivity.
    #[default]
    Point,
    /// Six scatterers in an ellipse of 0.5 m × 0.28 m, wide across the direction of walking; gains
    /// are drawn anew in every period, and the near side is brighter.
    Person,
    /// A person with limbs, sway and breath, whose gains change smoothly.
    Body(Body),
}

/// One moving target.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Target {
    /// Where it is when, ascending in time. Between way points it moves evenly, between two at the
    /// same place it stands; so it does before the first and after the last.
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
    /// As `(1 m / R)²`; that of mirrors, whose echo diverges once only, as `1 m / R`.
    InverseSquare,
}

impl AmplitudeLaw {
    /// The amplitude of a mirror whose echo comes `path_m` there and back, over that at 2 m.
    #[must_use]
    pub fn specular_amplitude(self, path_m: f64) -> f64 {
        match self {
            Self::Equal => 1.0,
            Self::InverseSquare => 2.0 / path_m.max(2.0 * MIN_RANGE_M),
        }
    }

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
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
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
    /// What that wall does besides delaying.
    pub wall_effects: WallEffects,
    /// Walls of the room that mirror, and echo themselves.
    pub reflectors: Vec<Reflector>,
    /// How people shade clutter and reflectors; not at all without it.
    pub shadow: Option<Shadow>,
    /// Echo of a perfect mirror 1 m away over that of a point of 0 dB 1 m away, decibels of power;
    /// `10 log10(π / area)`, if a point of 0 dB has a radar cross section of `area` in m².
    pub specular_db: f64,
}

impl Default for Scene {
    fn default() -> Self {
        Self {
            targets: Vec::new(),
            clutter: Vec::new(),
            amplitude_law: AmplitudeLaw::default(),
            wall: None,
            wall_effects: WallEffects::default(),
            reflectors: Vec::new(),
            shadow: None,
            specular_db: 5.0,
        }
    }
}

impl Target {
    /// Where the target's middle is at `time_s`. Assumes at least one way point.
    #[must_use]
    pub fn position(&self, time_s: f64) -> Point<World> {
        let turn_s = match self.kind {
            TargetKind::Body(body) => body.turn_s,
            TargetKind::Point | TargetKind::Person => 0.0,
        };
        Point::from_coords(place_m(&self.way_points, turn_s, time_s))
    }

    /// The unit vector from the way point before to the one after `time_s`; the world's `y` if the
    /// target stands.
    #[must_use]
    pub fn direction(&self, time_s: f64) -> Vector2<f64> {
        let (from, to) = leg(&self.way_points, time_s);
        let moved_m = Vector2::new(to.x_m - from.x_m, to.y_m - from.y_m);
        moved_m.try_normalize(1e-9).unwrap_or_else(Vector2::y)
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
        let of = format!("scene.targets[{index}]");
        if let TargetKind::Body(body) = &self.kind {
            body.check(&of)?;
        }
        check_amplitude(&of, self.amplitude_db)
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
        for (index, reflector) in self.reflectors.iter().enumerate() {
            reflector.check(&format!("scene.reflectors[{index}]"))?;
        }
        if let Some(shadow) = &self.shadow {
            shadow.check()?;
        }
        if !(-200.0..=200.0).contains(&self.specular_db) {
            return Err(invalid("scene.specular_db", self.specular_db, "use -200 to 200 dB"));
        }
        self.wall_effects.check()?;
        match &self.wall {
            Some(wall) => Ok(wall.check()?),
            None if self.wall_effects == WallEffects::default() => Ok(()),
            None => Err(invalid("scene.wall_effects", self.wall_effects, "also set scene.wall")),
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
            shadow = { loss_db = 9.0 }
            specular_db = 8.0
            wall = { thickness_m = 0.24, permittivity = 5.0 }
            [[targets]]
            kind = 'person'
            way_points = [{ time_s = 0.0, x_m = 2.0, y_m = 3.0 }, { time_s = 1.0, x_m = 8.0, y_m = 8.0 }]
            [[targets]]
            kind = { body = { fluctuation = 'per_period', turn_s = 0.0 } }
            way_points = [{ time_s = 0.0, x_m = 2.0, y_m = 3.0 }]
            [[targets]]
            way_points = [{ time_s = 0.0, x_m = 2.0, y_m = 3.0 }]
            [targets.kind.body.fluctuation.correlated]
            time_s = 5.0
            way_m = 0.2
            [[reflectors]]
            from_m = [0.0, 9.0]
            to_m = [8.0, 9.0]
            reflection_db = -6.0
            [wall_effects]
            stand_off_m = 0.1
            transmission = 'fresnel'
            conductivity_s_per_m = 0.03
            inner_pass_count = 1
            face_echo_count = 2
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
        let no_turn = Body { turn_s: -1.0, ..Body::default() };
        let kind = TargetKind::Body(no_turn);
        let walk = Target { kind, ..walk() };
        let turning = Scene { targets: vec![walk], ..Scene::default() };
        assert_eq!(turning.check().unwrap_err().field, "scene.targets[0].kind.body.turn_s");
        assert_eq!(check(|s| s.wall_effects.stand_off_m = 1.0), "scene.wall_effects");
        assert_eq!(check(|s| s.specular_db = f64::NAN), "scene.specular_db");
        let shadow = |s: &mut Scene| s.shadow = Some(Shadow { loss_db: -1.0, half_width_m: 0.2 });
        assert_eq!(check(shadow), "scene.shadow.loss_db");
        let thread = |s: &mut Scene| s.shadow = Some(Shadow { loss_db: 3.0, half_width_m: 0.0 });
        assert_eq!(check(thread), "scene.shadow.half_width_m");
        let reflector = |from_m, to_m, reflection_db| {
            let reflectors = vec![Reflector { from_m, to_m, reflection_db }];
            let mirrored = Scene { reflectors, ..Scene::default() };
            mirrored.check().unwrap_err().field
        };
        let ([a, b], far) = ([[0.0, 1.0], [2.0, 1.0]], [f64::NAN, 0.0]);
        assert_eq!(reflector(far, b, -6.0), "scene.reflectors[0].from_m");
        assert_eq!(reflector(a, far, -6.0), "scene.reflectors[0].to_m");
        assert_eq!(reflector(a, a, -6.0), "scene.reflectors[0].to_m");
        assert_eq!(reflector(a, b, 1.0), "scene.reflectors[0].reflection_db");
    }
}
