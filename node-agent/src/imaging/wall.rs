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
//!
//! A ray that leaves the array's centre at the angle `θ` in the air and has the optical path `L`
//! ends, by Snell's law and without approximation, at
//! `(L − Δ) e_r − Δ' e_c`, `Δ(θ) = d (sqrt(ε − sin²θ) − cos θ)`, `e_r = (sin θ, cos θ)`,
//! `e_c = de_r/dθ = (cos θ, −sin θ)`; with the fixed delay `Δ = d (sqrt ε − 1)`, `Δ' = 0`.
//! An image determines `L` and `θ` and no more, so a detection follows a change of the wall's
//! parameters in closed form ([`WallModel::moved`]). Assumes that the array is small beside the
//! range: `L` and its slope agree at the centre, the curvature over the array is neglected.

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use proto::measured::{MeasuredPoint, packed, symmetric};
use proto::radar::{Array, Wall};

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
            Self::FixedDelay(wall) => leg_path_m(dx_m, depth_m, None) + excess_path_m(wall),
        }
    }

    /// How the array's centre sees the point at `[x, y]` in the node's frame, metres.
    #[must_use]
    pub fn seen(&self, place_m: &Vector2<f64>) -> Seen {
        let path_m = self.leg_path_m(place_m.x, place_m.y);
        let straight = place_m.x / place_m.norm().max(f64::MIN_POSITIVE);
        let sine = match self {
            Self::None | Self::FixedDelay(_) => straight,
            Self::Refraction(wall) if place_m.y <= wall.thickness_m => straight,
            Self::Refraction(wall) => {
                refracted_sine(place_m.x.abs(), place_m.y - wall.thickness_m, wall)
                    .copysign(place_m.x)
            }
        };
        Seen { path_m, sine }
    }

    /// Where a point seen so is, `[x, y]` in the node's frame in metres; `None` if that is not
    /// beyond the wall.
    #[must_use]
    pub fn place_m(&self, seen: &Seen) -> Option<Vector2<f64>> {
        let excess = self.excess(seen.sine);
        let (along, across) = seen.axes();
        let place_m = along * (seen.path_m - excess.path_m) - across * excess.slope_m;
        (self.thickness_m() < place_m.y).then_some(place_m)
    }

    /// The point that an image through `self` shows as `point`, as an image through `other` would
    /// show it; `None` if it is not beyond either wall.
    ///
    /// Covariance and extent stay as they are in range and keep their angle across, so that with
    /// `q = L − Δ − Δ''` they stretch by `q_other / q_self` along `e_c`.
    #[must_use]
    pub fn moved(&self, point: &MeasuredPoint, other: &Self) -> Option<MeasuredPoint> {
        let place_m = Vector2::new(point.x_m, point.y_m);
        if place_m.y <= self.thickness_m() {
            return None;
        }
        let seen = self.seen(&place_m);
        let new_m = other.place_m(&seen)?;
        let (along, across) = seen.axes();
        let lever_m = |model: &Self| {
            let excess = model.excess(seen.sine);
            seen.path_m - excess.path_m - excess.bend_m
        };
        let stretch = lever_m(other) / lever_m(self);
        let jacobian = along * along.transpose() + across * across.transpose() * stretch;
        let stretched = |packed_m2: [f64; 3]| {
            let new_m2: Matrix2<f64> = jacobian * symmetric(packed_m2) * jacobian.transpose();
            packed(&new_m2)
        };
        Some(MeasuredPoint {
            x_m: new_m.x,
            y_m: new_m.y,
            cov_m2: stretched(point.cov_m2),
            extent_m2: stretched(point.extent_m2),
            ..point.clone()
        })
    }

    /// How much longer than air the wall makes the path, with its derivatives by the angle.
    fn excess(&self, sine: f64) -> Excess {
        match self {
            Self::None => Excess::default(),
            Self::FixedDelay(wall) => Excess { path_m: excess_path_m(wall), ..Excess::default() },
            Self::Refraction(wall) => Excess::refracted(wall, sine),
        }
    }

    fn thickness_m(&self) -> f64 {
        match self {
            Self::None => 0.0,
            Self::Refraction(wall) | Self::FixedDelay(wall) => wall.thickness_m,
        }
    }

    /// Optical paths in metres there and back by each channel, `t · rx_count + r`, of a place in the
    /// node's frame.
    #[must_use]
    pub fn channel_paths_m(&self, array: &Array, place_m: &Vector2<f64>) -> Vec<f64> {
        let leg =
            |antenna: &[f64; 2]| self.leg_path_m(place_m.x - antenna[0], place_m.y - antenna[1]);
        let rx_m: Vec<f64> = array.rx_m.iter().map(leg).collect();
        array.tx_m.iter().map(leg).flat_map(|tx| rx_m.iter().map(move |rx| tx + rx)).collect()
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

/// A point as the array's centre sees it: all that an image knows of its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seen {
    /// Optical path of one leg `L`, metres.
    pub path_m: f64,
    /// Sine of the ray's angle from boresight in the air, positive along `x`.
    pub sine: f64,
}

impl Seen {
    /// Unit vectors along the ray in the air and across it, towards larger angles.
    fn axes(&self) -> (Vector2<f64>, Vector2<f64>) {
        let cosine = cosine(self.sine);
        (Vector2::new(self.sine, cosine), Vector2::new(cosine, -self.sine))
    }
}

/// `Δ(θ)` of a wall and its derivatives by `θ`, metres.
#[derive(Clone, Copy, Default)]
struct Excess {
    path_m: f64,
    slope_m: f64,
    bend_m: f64,
}

impl Excess {
    fn refracted(wall: &Wall, sine: f64) -> Self {
        let cosine = cosine(sine);
        let root = (wall.permittivity - sine * sine).max(1.0 - MAX_SINE).sqrt();
        let both = sine * cosine / root;
        let double_angle = (cosine * cosine - sine * sine) / root;
        Self {
            path_m: wall.thickness_m * (root - cosine),
            slope_m: wall.thickness_m * (sine - both),
            bend_m: wall.thickness_m * (cosine - double_angle - both * both / root),
        }
    }
}

/// `sqrt(1 − sine²)`.
fn cosine(sine: f64) -> f64 {
    (1.0 - sine * sine).max(0.0).sqrt()
}

/// The path straight ahead through `wall` over that through air, `d (sqrt ε − 1)`, metres.
#[must_use]
pub fn excess_path_m(wall: &Wall) -> f64 {
    wall.thickness_m * (wall.permittivity.sqrt() - 1.0)
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
pub(crate) fn refracted_sine(lateral_m: f64, air_m: f64, wall: &Wall) -> f64 {
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
mod chain_tests;

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

    /// Rounding, and the steps of difference quotients.
    const MOVED_TOLERANCE_M: f64 = 1e-9;

    fn models() -> [WallModel; 4] {
        [
            WallModel::None,
            WallModel::FixedDelay(Wall { thickness_m: 0.24, permittivity: 5.0 }),
            WallModel::Refraction(Wall { thickness_m: 0.24, permittivity: 5.0 }),
            WallModel::Refraction(Wall { thickness_m: 0.1, permittivity: 7.5 }),
        ]
    }

    /// Path from the array's centre and its slope, by difference, over the antenna's place.
    fn path_and_slope(model: &WallModel, place_m: &Vector2<f64>) -> [f64; 2] {
        let path_m = |antenna_x_m: f64| model.leg_path_m(place_m.x - antenna_x_m, place_m.y);
        let slope = (path_m(-1e-5) - path_m(1e-5)) / 2e-5;
        [path_m(0.0), slope]
    }

    #[test]
    fn a_moved_point_has_the_same_path_and_slope_at_the_array() {
        for (from, to) in models().iter().flat_map(|a| models().map(|b| (*a, b))) {
            for (x_m, y_m) in [(0.0, 1.5), (-1.7, 1.0), (4.0, 3.0), (2.0, 8.0)] {
                let point = point(x_m, y_m);
                let moved = from.moved(&point, &to).unwrap();
                let want = path_and_slope(&from, &Vector2::new(x_m, y_m));
                let got = path_and_slope(&to, &Vector2::new(moved.x_m, moved.y_m));
                assert!((got[0] - want[0]).abs() < MOVED_TOLERANCE_M, "{from:?} {to:?} {x_m}");
                assert!((got[1] - want[1]).abs() < 1e-7, "{from:?} {to:?} {x_m}: {got:?} {want:?}");
            }
        }
    }

    #[test]
    fn the_covariance_moves_as_the_place_does() {
        for (from, to) in models().iter().flat_map(|a| models().map(|b| (*a, b))) {
            let before = point(-2.5, 2.0);
            let step_m = 1e-5;
            let place = |dx_m: f64, dy_m: f64| {
                let moved = from.moved(&point(-2.5 + dx_m, 2.0 + dy_m), &to).unwrap();
                Vector2::new(moved.x_m, moved.y_m)
            };
            let column =
                |dx_m: f64, dy_m: f64| (place(dx_m, dy_m) - place(-dx_m, -dy_m)) / (2.0 * step_m);
            let jacobian = Matrix2::from_columns(&[column(step_m, 0.0), column(0.0, step_m)]);
            let want_m2 = jacobian * symmetric(before.cov_m2) * jacobian.transpose();
            let got = from.moved(&before, &to).unwrap();
            assert!(
                (symmetric(got.cov_m2) - want_m2).norm() < MOVED_TOLERANCE_M,
                "{from:?} {to:?}"
            );
            let extent_m2 = jacobian * symmetric(before.extent_m2) * jacobian.transpose();
            assert!((symmetric(got.extent_m2) - extent_m2).norm() < MOVED_TOLERANCE_M);
        }
    }

    #[test]
    fn a_point_that_would_not_be_beyond_the_wall_is_not_moved() {
        let thick = WallModel::Refraction(Wall { thickness_m: 0.5, permittivity: 9.0 });
        assert!(WallModel::None.moved(&point(0.0, 1.2), &thick).is_none());
        assert!(thick.moved(&point(0.0, 0.4), &WallModel::None).is_none());
        assert!(WallModel::None.moved(&point(0.0, 2.2), &thick).is_some());
    }

    fn point(x_m: f64, y_m: f64) -> MeasuredPoint {
        MeasuredPoint {
            x_m,
            y_m,
            cov_m2: [0.04, 0.01, 0.02],
            snr_db: 20.0,
            extent_m2: [0.3, -0.1, 0.2],
            radial_velocity_m_per_s: None,
        }
    }
}
