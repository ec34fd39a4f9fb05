//! A polar image on a Cartesian grid, to look at.
//!
//! `P = |I|²` and `E` are band-limited in range and sine, their ratio is not: both are interpolated
//! by cubic convolution \[keys1981\] with `a = −1/2`, and the coherence follows from them. The weight
//! of a neighbour at distance `d` pixels is `1 − 5/2 d² + 3/2 d³` for `d ≤ 1` and
//! `2 − 4 d + 5/2 d² − 1/2 d³` for `1 ≤ d ≤ 2`, along each axis.
//! On the default polar grid that leaves −48 dB of the direct Cartesian image. What lies outside the
//! polar grid is zero.

use proto::radar::Grid;

use super::backproject::CoherentImage;
use super::pixels::{Pixels, PolarGrid};
use super::single;

/// `image` on `grid` if it is polar; a copy if it is not.
#[must_use]
pub fn resample(image: &CoherentImage, grid: &Grid) -> CoherentImage {
    let Pixels::Polar(polar) = &image.pixels else { return image.clone() };
    let pixels = Pixels::Cartesian(*grid);
    let zeros = || vec![0.0; pixels.pixel_count()];
    let is_kept = !image.phase_coherence.is_empty();
    let mut on_grid = CoherentImage {
        pixels,
        channel_count: image.channel_count,
        power: zeros(),
        energy: zeros(),
        phase_coherence: if is_kept { zeros() } else { Vec::new() },
    };
    let power = Plane::new(&image.power, polar);
    let energy = Plane::new(&image.energy, polar);
    let coherence = is_kept.then(|| Plane::new(&image.phase_coherence, polar));
    let per_channel = 1.0 / image.channel_count as f32;
    let xs_m: Vec<f32> = (0..grid.column_count).map(|column| single(grid.x_m(column))).collect();
    let mut places = [vec![0.0; xs_m.len()], vec![0.0; xs_m.len()]];
    for row in 0..grid.row_count {
        locate(&mut places, &xs_m, single(grid.y_m(row)), polar);
        for (column, place) in places[0].iter().zip(&places[1]).enumerate() {
            let Some(stencil) = Stencil::new(polar, place) else { continue };
            let index = row * grid.column_count + column;
            on_grid.power[index] = power.value(&stencil);
            // Between pixels the interpolation may overshoot; coherence stays at most 1.
            let least_energy = on_grid.power[index] * per_channel;
            on_grid.energy[index] = energy.value(&stencil).max(least_energy);
            if let Some(plane) = &coherence {
                on_grid.phase_coherence[index] = plane.value(&stencil).min(1.0);
            }
        }
    }
    on_grid
}

/// Sets `places` to where the pixels at `xs_m` and `y_m` are on the polar grid, in its columns and
/// rows; apart from the look-up, so that roots and quotients are taken in lanes. Single precision
/// errs by 1e-5 of a pixel.
fn locate(places: &mut [Vec<f32>; 2], xs_m: &[f32], y_m: f32, polar: &PolarGrid) {
    let (first_m, per_range) = (single(polar.range_min_m), single(1.0 / polar.range_step_m));
    let (first_sine, per_sine) = (single(polar.sine_min), single(1.0 / polar.sine_step));
    let [columns, rows] = places;
    for ((x_m, column), row) in xs_m.iter().zip(columns).zip(rows) {
        let range_m = (x_m * x_m + y_m * y_m).sqrt();
        *column = (range_m - first_m) * per_range;
        *row = (x_m / range_m.max(f32::MIN_POSITIVE) - first_sine) * per_sine;
    }
}

/// A plane of a polar image with its border repeated once before and twice behind.
struct Plane {
    values: Vec<f32>,
    column_count: usize,
}

impl Plane {
    fn new(values: &[f32], polar: &PolarGrid) -> Self {
        let inside = |index: usize, count: usize| index.saturating_sub(1).min(count - 1);
        let of_row = |row: usize| {
            let first = inside(row, polar.sine_count) * polar.range_count;
            (0..polar.range_count + 3).map(move |c| values[first + inside(c, polar.range_count)])
        };
        Self {
            values: (0..polar.sine_count + 3).flat_map(of_row).collect(),
            column_count: polar.range_count + 3,
        }
    }

    /// The interpolated value, not below zero.
    #[inline(always)]
    fn value(&self, stencil: &Stencil) -> f32 {
        let start = stencil.row * self.column_count + stencil.column;
        let near = |row: usize| -> [f32; 4] {
            let values = &self.values[start + row * self.column_count..][..4];
            [values[0], values[1], values[2], values[3]]
        };
        let (rows, weights) = ([near(0), near(1), near(2), near(3)], stencil.row_weights);
        let mut columns = [0.0; 4];
        for (lane, sum) in columns.iter_mut().enumerate() {
            *sum = (rows[0][lane] * weights[0] + rows[1][lane] * weights[1])
                + (rows[2][lane] * weights[2] + rows[3][lane] * weights[3]);
        }
        let [a, b, c, d] = stencil.column_weights;
        ((columns[0] * a + columns[1] * b) + (columns[2] * c + columns[3] * d)).max(0.0)
    }
}

/// Four rows and four columns around a place, with their weights.
struct Stencil {
    /// The first of the rows, on a [`Plane`].
    row: usize,
    /// The first of the columns.
    column: usize,
    row_weights: [f32; 4],
    column_weights: [f32; 4],
}

impl Stencil {
    /// The neighbours of `[column, row]`; `None` outside the grid.
    #[inline(always)]
    fn new(polar: &PolarGrid, (column_place, row_place): (&f32, &f32)) -> Option<Self> {
        let (column, column_weights) = neighbours(*column_place, polar.range_count)?;
        let (row, row_weights) = neighbours(*row_place, polar.sine_count)?;
        Some(Self { row, column, row_weights, column_weights })
    }
}

/// The whole part of `place` on an axis of `count` pixels, and the weights of the four pixels from
/// one before it on.
#[expect(clippy::cast_possible_truncation, reason = "within an axis of at most 2^24 pixels")]
#[inline(always)]
fn neighbours(place: f32, count: usize) -> Option<(usize, [f32; 4])> {
    if !(0.0..=(count - 1) as f32).contains(&place) {
        return None;
    }
    let before = place as u32;
    let d = place - before as f32;
    let weights = [
        ((-0.5 * d + 1.0) * d - 0.5) * d,
        (1.5 * d - 2.5) * d * d + 1.0,
        ((-1.5 * d + 2.0) * d + 0.5) * d,
        (0.5 * d - 0.5) * d * d,
    ];
    Some((before as usize, weights))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::backproject::{Backprojector, Coherence, Geometry, Means};
    use crate::imaging::compress::Compressor;
    use crate::imaging::wall::WallModel;
    use crate::imaging::window::Window;
    use proto::radar::{Array, Band};
    use rand::{SeedableRng, rngs::ChaCha8Rng};
    use rand_distr::{Distribution, StandardNormal};
    use rustfft::num_complex::Complex;

    const GRID: Grid =
        Grid { x_min_m: -3.0, y_min_m: 1.5, pixel_m: 0.07, column_count: 90, row_count: 90 };

    /// The direct image and the interpolated one, of data that fill the band.
    fn both(coherence: Coherence) -> [CoherentImage; 2] {
        let (band, array) = (&Band::default(), &Array::default());
        let mut rng = ChaCha8Rng::seed_from_u64(8);
        let mut draw = || -> f32 { StandardNormal.sample(&mut rng) };
        let samples: Vec<Complex<f32>> =
            (0..8 * 301).map(|_| Complex::new(draw(), draw())).collect();
        let compressor = Compressor::new(band, &Window::Taylor.weights(301), 4096);
        let profiles = compressor.compress(&samples);
        let image = |pixels: &Pixels| {
            let geometry =
                Geometry { band, array, pixels, wall: &WallModel::None, fft_length: 4096 };
            let means = Means { coherence, ..Means::default() };
            Backprojector::with_means(&geometry, &means).unwrap().image(&profiles)
        };
        let polar = image(&Pixels::Polar(PolarGrid::default()));
        [image(&Pixels::Cartesian(GRID)), resample(&polar, &GRID)]
    }

    /// Root mean square error of a function of the pixel, decibels.
    fn error_db(
        [want, got]: &[CoherentImage; 2],
        of: impl Fn(&CoherentImage, usize) -> f32,
    ) -> f64 {
        let (mut wrong, mut total) = (0.0, 0.0);
        for index in 0..GRID.pixel_count() {
            let (want, got) = (f64::from(of(want, index)), f64::from(of(got, index)));
            wrong += (got - want).powi(2);
            total += want.powi(2);
        }
        10.0 * (wrong / total).log10()
    }

    #[test]
    fn a_resampled_image_is_the_direct_one() {
        let images = both(Coherence::Power);
        for (name, db, bound_db) in [
            ("amplitude", error_db(&images, |image, i| image.power[i].sqrt()), -40.0),
            ("energy", error_db(&images, |image, i| image.energy[i]), -40.0),
            ("coherence", error_db(&images, CoherentImage::coherence), -30.0),
        ] {
            assert!(db < bound_db, "{name}: {db} dB");
        }
        let weighted = images.each_ref().map(CoherentImage::weighted_amplitude);
        let squares = |values: &mut dyn Iterator<Item = f32>| values.map(|v| v * v).sum::<f32>();
        let wrong = squares(&mut weighted[0].iter().zip(&weighted[1]).map(|(a, b)| a - b));
        assert!(wrong < 1e-4 * squares(&mut weighted[0].iter().copied()));
    }

    #[test]
    fn other_kinds_of_coherence_are_interpolated_themselves() {
        let images = both(Coherence::Circular);
        let db = error_db(&images, CoherentImage::coherence);
        assert!(db < -25.0, "{db} dB");
    }

    #[test]
    fn pixels_outside_the_polar_grid_are_zero_and_cartesian_images_stay() {
        let polar = PolarGrid { range_count: 10, sine_count: 5, ..PolarGrid::default() };
        let image = CoherentImage {
            pixels: Pixels::Polar(polar),
            channel_count: 2,
            power: vec![3.0; 50],
            energy: vec![2.0; 50],
            phase_coherence: vec![],
        };
        let grid =
            Grid { x_min_m: -0.6, y_min_m: 0.2, pixel_m: 0.4, column_count: 2, row_count: 2 };
        let got = resample(&image, &grid);
        // (−0.6, 0.2) has range 0.63 and sine −0.95; the other three lie to the right of it.
        let want = [3.0, 0.0, 0.0, 0.0];
        assert!(got.power.iter().zip(want).all(|(a, b): (&f32, f32)| (a - b).abs() < 1e-5));
        assert!((got.coherence(0) - 0.75).abs() < 1e-5 && got.coherence(1).abs() < 1e-9);
        assert_eq!(resample(&got, &grid), got);
    }
}
