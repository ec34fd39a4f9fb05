//! The room and the four walks of the mean-shift paper.
//!
//! A room of 7.55 m × 12 m behind a brick wall of 0.24 m; one array at the origin along `x`,
//! outside, close to the wall; two people who walk to and fro at even speed \[mean-shift\].
//! The paper does not state speed, wall constants and where the array is along the room: people
//! walk at 1 m/s, the brick is taken as in \[slab-fresnel\] (permittivity 3.91, 0.026 S/m) and
//! the array stands before the middle of the short side.

use proto::radar::Wall;

use super::body::Body;
use super::mirrors::{Reflector, Shadow};
use super::scene::{AmplitudeLaw, Scene, Target, TargetKind, WayPoint};
use super::slab::{Transmission, WallEffects};

/// Width and depth of the room, metres.
pub const ROOM_M: [f64; 2] = [7.55, 12.0];
/// The wall between array and room.
pub const BRICK: Wall = Wall { thickness_m: 0.24, permittivity: 3.91 };
/// Conductivity of the brick, siemens per metre.
pub const BRICK_S_PER_M: f64 = 0.026;
/// How far before the wall the array stands, metres.
pub const STAND_OFF_M: f64 = 0.02;
/// Speed of people, metres per second.
pub const SPEED_M_PER_S: f64 = 1.0;
/// What the room's other walls reflect, decibels.
pub const REFLECTION_DB: f64 = -8.0;

/// Between which places each of two people walks to and fro: `[person][end]`, `[x, y]` in metres.
/// Experiment 1: at a constant distance; 2: at the same speed; 3: side by side; 4: towards each
/// other and apart.
pub const WALKS_M: [[[[f64; 2]; 2]; 2]; 4] = [
    [[[-1.0, 4.0], [-1.0, 10.0]], [[1.0, 2.0], [1.0, 8.0]]],
    [[[1.0, 2.0], [1.0, 4.0]], [[-1.0, 6.0], [-1.0, 10.0]]],
    [[[1.0, 1.0], [1.0, 6.0]], [[-1.0, 1.0], [-1.0, 6.0]]],
    [[[1.0, 1.0], [1.0, 5.0]], [[-1.0, 5.0], [-1.0, 1.0]]],
];

/// Two people on the walks of one experiment, as `WALKS_M[index]` says, for `duration_s`: free
/// space behind a wall that only delays, no echo but theirs.
#[must_use]
pub fn two_walkers(walks_m: &[[[f64; 2]; 2]; 2], kind: TargetKind, duration_s: f64) -> Scene {
    let target = |[from_m, to_m]: &[[f64; 2]; 2]| {
        let way_points = to_and_fro(*from_m, *to_m, duration_s);
        Target { way_points, kind, amplitude_db: 0.0 }
    };
    let targets = walks_m.iter().map(target).collect();
    let wall_effects = WallEffects { stand_off_m: STAND_OFF_M, ..WallEffects::default() };
    Scene { targets, wall: Some(BRICK), wall_effects, ..Scene::default() }
}

/// The same with bodies in the room as it is: lossy wall with its own echoes, mirroring side and
/// back walls, shadows, amplitudes that fall with distance.
#[must_use]
pub fn furnished(walks_m: &[[[f64; 2]; 2]; 2], duration_s: f64) -> Scene {
    let free = two_walkers(walks_m, TargetKind::Body(Body::default()), duration_s);
    let near_m = STAND_OFF_M + BRICK.thickness_m;
    let (half_m, far_m) = (0.5 * ROOM_M[0], near_m + ROOM_M[1]);
    let flat = |from_m, to_m| Reflector { from_m, to_m, reflection_db: REFLECTION_DB };
    Scene {
        amplitude_law: AmplitudeLaw::InverseSquare,
        wall_effects: WallEffects {
            transmission: Transmission::Fresnel,
            conductivity_s_per_m: BRICK_S_PER_M,
            inner_pass_count: 1,
            face_echo_count: 3,
            ..free.wall_effects
        },
        reflectors: vec![
            flat([-half_m, near_m], [-half_m, far_m]),
            flat([-half_m, far_m], [half_m, far_m]),
            flat([half_m, far_m], [half_m, near_m]),
        ],
        shadow: Some(Shadow::default()),
        ..free
    }
}

/// Way points between two places at [`SPEED_M_PER_S`], as many as `duration_s` needs.
fn to_and_fro(from_m: [f64; 2], to_m: [f64; 2], duration_s: f64) -> Vec<WayPoint> {
    let leg_s = (to_m[0] - from_m[0]).hypot(to_m[1] - from_m[1]) / SPEED_M_PER_S;
    let mut way_points = Vec::new();
    let mut time_s = 0.0;
    let (mut here, mut there) = (from_m, to_m);
    while time_s < duration_s + leg_s {
        way_points.push(WayPoint { time_s, x_m: here[0], y_m: here[1] });
        (here, there) = (there, here);
        time_s += leg_s;
    }
    way_points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn people_walk_where_the_paper_says_at_an_even_speed() {
        for walks_m in &WALKS_M {
            let scene = two_walkers(walks_m, TargetKind::Point, 14.0);
            assert_eq!(scene.check(), Ok(()));
            assert_eq!(furnished(walks_m, 14.0).check(), Ok(()));
            for (target, [from_m, to_m]) in scene.targets.iter().zip(walks_m) {
                assert!(
                    (target.position(0.0).coords_m - nalgebra::Vector2::from(*from_m)).norm()
                        < 1e-12
                );
                let leg_s = (to_m[1] - from_m[1]).abs() / SPEED_M_PER_S;
                let turn_m = target.position(leg_s).coords_m;
                assert!((turn_m - nalgebra::Vector2::from(*to_m)).norm() < 1e-12);
                let moved_m = target.position(14.0).coords_m - target.position(13.9).coords_m;
                assert!((moved_m.norm() - 0.1).abs() < 1e-9 || leg_s.rem_euclid(2.0) <= 0.0);
            }
        }
        // Experiment 1 keeps its distance.
        let scene = two_walkers(&WALKS_M[0], TargetKind::Point, 14.0);
        for step in 0..140 {
            let time_s = 0.1 * f64::from(step);
            let apart_m = scene.targets[0].position(time_s).coords_m
                - scene.targets[1].position(time_s).coords_m;
            assert!((apart_m.norm() - 8.0_f64.sqrt()).abs() < 1e-9);
        }
    }
}
