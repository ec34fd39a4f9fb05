//! How long a leg between an antenna and a point is, through air and through a wall.
//!
//! A slab of thickness `d` and relative permittivity `ε` stands parallel to the array; only the
//! total depth of air `h = depth − d` matters, so that a stand-off of the wall is included. With
//! `p = sin θ` in the air and the lateral distance `Δx`, the optical path of a leg is
//! `c τ = max_p [p Δx + h sqrt(1 − p²) + d sqrt(ε − p²)]` in metres; the maximum is where Snell's
//! law holds, `h p / sqrt(1 − p²) + d p / sqrt(ε − p²) = Δx`
//! (Fermat; the seed adds a fixed delay instead, see [`WallModel::FixedDelay`]).
//! Assumes one homogeneous slab without loss; a point inside the slab is reached through its
//! material alone.

use serde::{Deserialize, Serialize};

use proto::radar::Wall;

use super::InvalidSetting;

/// Newton's steps at most; near the array it takes three, at grazing incidence some thirty.
const MAX_NEWTON_STEPS: usize = 60;
/// A step in `p` too small to change the path: the path is stationary in `p`.
const STEP_FLOOR: f64 = 1e-13;
/// Largest `p`: at 1 the ray runs along the wall and the equation divides by zero.
const MAX_SINE: f64 = 1.0 - 1e-12;

/// How the wall enters the delays of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum WallModel {
    /// There is only air.
    #[default]
    None,
    /// Every leg is refracted as Snell's law says.
    Refraction(Wall),
    /// Every leg is longer by `d (sqrt ε − 1)`, whatever its direction
    /// \[registration, section 4\]: points far from boresight appear shifted across.
    FixedDelay(Wall),
}

impl WallModel {
    /// Optical path in metres of the leg over `dx_m` across and `depth_m` along boresight.
    #[must_use]
    pub fn leg_path_m(&self, dx_m: f64, depth_m: f64) -> f64 {
        match self {
            Self::None => leg_path_m(dx_m, depth_m, None),
            Self::Refraction(wall) => leg_path_m(dx_m, depth_m, Some(wall)),
            Self::FixedDelay(wall) => {
                let delay_m = wall.thickness_m * (wall.permittivity.sqrt() - 1.0);
                leg_path_m(dx_m, depth_m, None) + delay_m
            }
        }
    }

    /// Checks the wall's numbers.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), InvalidSetting> {
        match self {
            Self::None => Ok(()),
            Self::Refraction(wall) | Self::FixedDelay(wall) => Ok(wall.check()?),
        }
    }
}

/// Optical path in metres of the leg over `dx_m` across and `depth_m` along boresight, through
/// `wall` if there is one.
#[must_use]
pub fn leg_path_m(dx_m: f64, depth_m: f64, wall: Option<&Wall>) -> f64 {
    let Some(wall) = wall else { return dx_m.hypot(depth_m) };
    let air_m = depth_m - wall.thickness_m;
    if air_m <= 0.0 {
        return wall.permittivity.sqrt() * dx_m.hypot(depth_m);
    }
    let sine = refracted_sine(dx_m.abs(), air_m, wall);
    let slab_m = wall.thickness_m * (wall.permittivity - sine * sine).max(0.0).sqrt();
    sine * dx_m.abs() + air_m * (1.0 - sine * sine).sqrt() + slab_m
}

/// The sine of the angle in the air, by Newton from the straight line.
///
/// The straight line's sine is right of the root and the function is convex, so the steps go
/// down to the root without overshooting.
fn refracted_sine(lateral_m: f64, air_m: f64, wall: &Wall) -> f64 {
    let mut sine = (lateral_m / lateral_m.hypot(air_m)).min(MAX_SINE);
    for _ in 0..MAX_NEWTON_STEPS {
        let in_air = 1.0 - sine * sine;
        let in_wall = (wall.permittivity - sine * sine).max(1.0 - MAX_SINE);
        let excess_m =
            air_m * sine / in_air.sqrt() + wall.thickness_m * sine / in_wall.sqrt() - lateral_m;
        let slope_m = air_m / (in_air * in_air.sqrt())
            + wall.thickness_m * wall.permittivity / (in_wall * in_wall.sqrt());
        let next = (sine - excess_m / slope_m).clamp(0.0, MAX_SINE);
        let step = (sine - next).abs();
        sine = next;
        if step < STEP_FLOOR {
            break;
        }
    }
    sine
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding of paths of some ten metres.
    const PATH_TOLERANCE_M: f64 = 1e-11;

    /// Fermat by trial: the shortest optical path over all points where the ray may leave the wall.
    fn brute_force_path_m(dx_m: f64, depth_m: f64, wall: &Wall) -> f64 {
        let path = |exit_m: f64| {
            wall.permittivity.sqrt() * exit_m.hypot(wall.thickness_m)
                + (dx_m - exit_m).hypot(depth_m - wall.thickness_m)
        };
        let (mut low, mut high) = (0.0, dx_m);
        for _ in 0..200 {
            let (left, right) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
            if path(left) < path(right) { high = right } else { low = left }
        }
        path(0.5 * (low + high))
    }

    #[test]
    fn the_path_is_the_shortest_one_of_fermat() {
        let slabs = [1.0, 4.0, 6.5].map(|permittivity| {
            [0.0, 0.02, 0.24].map(|thickness_m| Wall { thickness_m, permittivity })
        });
        let lengths_m =
            [0.26, 0.4, 2.0, 10.0].map(|y_m| [0.0, 0.1, 0.9, 5.2].map(|x_m| (x_m, y_m)));
        for wall in slabs.as_flattened() {
            for (dx_m, depth_m) in lengths_m.as_flattened().iter().copied() {
                let want_m = brute_force_path_m(dx_m, depth_m, wall);
                let got_m = leg_path_m(dx_m, depth_m, Some(wall));
                let mirrored_m = leg_path_m(-dx_m, depth_m, Some(wall));
                assert!((got_m - want_m).abs() < PATH_TOLERANCE_M, "{wall:?} {dx_m} {depth_m}");
                assert!(
                    (mirrored_m - want_m).abs() < PATH_TOLERANCE_M,
                    "{wall:?} {dx_m} {depth_m}"
                );
            }
        }
    }

    #[test]
    fn the_fixed_delay_shifts_a_point_at_30_degrees_as_measured() {
        let wall = Wall { thickness_m: 0.24, permittivity: 5.0 };
        let delay_m = 0.24 * (5.0_f64.sqrt() - 1.0);
        let ahead = WallModel::Refraction(wall).leg_path_m(0.0, 5.0);
        assert!(
            (ahead - WallModel::FixedDelay(wall).leg_path_m(0.0, 5.0)).abs() < PATH_TOLERANCE_M
        );
        assert!((ahead - 5.0 - delay_m).abs() < PATH_TOLERANCE_M);
        // spec 4: a point at 30 degrees appears 1.9 cm farther.
        let (dx_m, depth_m) = (2.5, 2.5 * 3.0_f64.sqrt());
        let true_path = leg_path_m(dx_m, depth_m, Some(&wall));
        let fixed_path = WallModel::FixedDelay(wall).leg_path_m(dx_m, depth_m);
        assert!((true_path - fixed_path - 0.019).abs() < 0.002);
    }

    #[test]
    fn a_wall_of_nonsense_is_named() {
        let model = WallModel::Refraction(Wall { thickness_m: -1.0, permittivity: 4.0 });
        assert_eq!(model.check().unwrap_err().field, "wall.thickness_m");
        assert_eq!(WallModel::None.check(), Ok(()));
    }
}
