//! Image moments of a region: where the target is and how large it looks.
//!
//! `polar_power`: mean and second moments of range `r` and `u = sin θ`, each pixel weighted by its
//! squared amplitude times `cos θ / r`, the area of a pixel in `(r, u)`. A point's blob follows the
//! arc `r = const`, so that Cartesian moments are pulled towards the array by about
//! `r σ_u² / 2`; these are not.
//! `binary`: Cartesian moments with equal weights \[registration, eqs (5)-(6)\].

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use crate::imaging::pixels::Pixels;

use super::regions::Region;

/// Which moments.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Centroid {
    /// Weighted by power, in range and sine of the angle.
    #[default]
    PolarPower,
    /// Every pixel alike, in Cartesian coordinates.
    Binary,
}

/// A place in polar coordinates of the node: range in metres and sine of the angle from boresight.
pub type Polar = Vector2<f64>;

/// What the moments say of one target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blob {
    /// Centroid `[r, u]`.
    pub place: Polar,
    /// Second central moment in the node's frame, m².
    pub extent_m2: Matrix2<f64>,
}

/// The moments of `region`; `amplitude` belongs to `places`.
#[must_use]
pub fn moments(places: &Pixels, amplitude: &[f32], region: &Region, centroid: Centroid) -> Blob {
    let value = |index: &usize| f64::from(amplitude[*index]);
    match centroid {
        Centroid::PolarPower => {
            let of_pixels = region.pixels.iter().map(|index| {
                (places.polar(*index), value(index).powi(2) * places.polar_area(*index))
            });
            // Once, for each of the three passes would work out a root for every pixel.
            let weighted: Vec<(Polar, f64)> = of_pixels.collect();
            let (place, second) = mean_and_second(weighted.iter().copied());
            let jacobian = cartesian_from_polar(&place);
            Blob { place, extent_m2: jacobian * second * jacobian.transpose() }
        }
        Centroid::Binary => {
            let (mean_m, extent_m2) =
                mean_and_second(region.pixels.iter().map(|index| (places.coords_m(*index), 1.0)));
            Blob { place: to_polar(&mean_m), extent_m2 }
        }
    }
}

/// Weighted mean and second central moment.
fn mean_and_second(
    weighted: impl Iterator<Item = (Vector2<f64>, f64)> + Clone,
) -> (Vector2<f64>, Matrix2<f64>) {
    let total: f64 = weighted.clone().map(|(_, weight)| weight).sum();
    let mean = weighted.clone().map(|(z, weight)| z * weight).sum::<Vector2<f64>>() / total;
    let second = weighted.map(|(z, weight)| (z - mean) * (z - mean).transpose() * weight);
    (mean, second.sum::<Matrix2<f64>>() / total)
}

/// `[r, u]` of a place `[x, y]` in metres before the array.
#[must_use]
pub fn to_polar(coords_m: &Vector2<f64>) -> Polar {
    let range_m = coords_m.norm();
    Polar::new(range_m, coords_m.x / range_m)
}

/// `[x, y]` in metres of a place `[r, u]`; sines beyond ±1 are taken as ±1.
#[must_use]
pub fn to_cartesian(place: &Polar) -> Vector2<f64> {
    let sine = place.y.clamp(-1.0, 1.0);
    Vector2::new(place.x * sine, place.x * (1.0 - sine * sine).sqrt())
}

/// The Jacobian `∂(x, y) / ∂(r, u)`. Assumes a place before the array, `|u| < 1`.
#[must_use]
pub fn cartesian_from_polar(place: &Polar) -> Matrix2<f64> {
    let (range_m, sine) = (place.x, place.y);
    let cosine = (1.0 - sine * sine).max(f64::EPSILON).sqrt();
    Matrix2::new(sine, range_m, cosine, -range_m * sine / cosine)
}

#[cfg(test)]
mod tests {
    use super::super::threshold::Peak;
    use super::*;
    use proto::radar::Grid;

    fn grid() -> Grid {
        Grid { x_min_m: -1.0, y_min_m: 2.0, pixel_m: 0.02, column_count: 300, row_count: 200 }
    }

    /// All pixels of a blob that is Gaussian in `(r, u)` around `place`.
    fn blob(place: Polar, sigma: Polar) -> (Vec<f32>, Region) {
        let grid = grid();
        let amplitude: Vec<f32> = (0..grid.pixel_count())
            .map(|index| {
                let coords = Vector2::new(grid.x_m(index % 300), grid.y_m(index / 300));
                let d = (to_polar(&coords) - place).component_div(&sigma);
                crate::imaging::single((-0.25 * d.norm_squared()).exp())
            })
            .collect();
        let pixels = (0..amplitude.len()).filter(|i| 0.01 < amplitude[*i]).collect();
        let peak = Peak { index: 0, power: 1.0, range_m: 0.0, sine: 0.0 };
        (amplitude, Region { peak, pixels })
    }

    #[test]
    fn polar_moments_of_a_polar_gaussian_are_its_parameters() {
        let (place, sigma) = (Polar::new(4.0, 0.35), Polar::new(0.08, 0.05));
        let (amplitude, region) = blob(place, sigma);
        let got = moments(&Pixels::Cartesian(grid()), &amplitude, &region, Centroid::PolarPower);
        assert!((got.place - place).abs().x < 1e-3 && (got.place - place).abs().y < 1e-4);
        let across_m = 4.0 * 0.05 / (1.0_f64 - 0.35 * 0.35).sqrt();
        let along = Vector2::new(0.35, (1.0_f64 - 0.35 * 0.35).sqrt());
        let across = Vector2::new(along.y, -along.x);
        assert!((along.dot(&(got.extent_m2 * along)).sqrt() - 0.08).abs() < 2e-3);
        assert!((across.dot(&(got.extent_m2 * across)).sqrt() - across_m).abs() < 4e-3);
        // The Cartesian centroid of the same arc lies nearer.
        let binary = moments(&Pixels::Cartesian(grid()), &amplitude, &region, Centroid::Binary);
        assert!(binary.place.x < 4.0 - 0.005, "{}", binary.place.x);
    }

    #[test]
    fn binary_moments_are_those_of_a_rectangle() {
        let grid = grid();
        let pixels: Vec<usize> =
            (0..20 * 10).map(|i| (50 + i / 10) * grid.column_count + 60 + i % 10).collect();
        let peak = Peak { index: pixels[0], power: 1.0, range_m: 0.0, sine: 0.0 };
        let amplitude = vec![1.0; grid.pixel_count()];
        let got = moments(
            &Pixels::Cartesian(grid),
            &amplitude,
            &Region { peak, pixels },
            Centroid::Binary,
        );
        let want = Vector2::new(-1.0 + 0.02 * 64.5, 2.0 + 0.02 * 59.5);
        assert!((to_cartesian(&got.place) - want).norm() < 1e-9);
        let variance = |count: f64| 0.02_f64.powi(2) * (count * count - 1.0) / 12.0;
        assert!((got.extent_m2[(0, 0)] - variance(10.0)).abs() < 1e-9);
        assert!((got.extent_m2[(1, 1)] - variance(20.0)).abs() < 1e-9);
        assert!(got.extent_m2[(0, 1)].abs() < 1e-9);
    }

    #[test]
    fn the_jacobian_is_the_difference_quotient() {
        let place = Polar::new(3.0, -0.4);
        let jacobian = cartesian_from_polar(&place);
        for (i, step) in [Polar::new(1e-6, 0.0), Polar::new(0.0, 1e-6)].into_iter().enumerate() {
            let quotient = (to_cartesian(&(place + step)) - to_cartesian(&(place - step))) / 2e-6;
            assert!((jacobian.column(i) - quotient).norm() < 1e-7);
        }
    }
}
