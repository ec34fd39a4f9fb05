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
    let Pixels::Polar(polar) = image.pixels else { return image.clone() };
    let pixels = Pixels::Cartesian(*grid);
    let stencils: Vec<Option<Stencil>> = (0..pixels.pixel_count())
        .map(|index| {
            let place = pixels.polar(index);
            Stencil::new(&polar, place.x, place.y)
        })
        .collect();
    let interpolated = |plane: &[f32]| -> Vec<f32> {
        let value = |stencil: &Option<Stencil>| stencil.as_ref().map_or(0.0, |s| s.value(plane));
        stencils.iter().map(value).collect()
    };
    let power = interpolated(&image.power);
    let mut energy = interpolated(&image.energy);
    // Between pixels the interpolation may overshoot; coherence stays at most 1.
    for (sum, coherent) in energy.iter_mut().zip(&power) {
        *sum = sum.max(coherent / image.channel_count as f32);
    }
    let mut phase_coherence = Vec::new();
    if !image.phase_coherence.is_empty() {
        phase_coherence = interpolated(&image.phase_coherence);
        phase_coherence.iter_mut().for_each(|coherence| *coherence = coherence.min(1.0));
    }
    CoherentImage { pixels, channel_count: image.channel_count, power, energy, phase_coherence }
}

/// Four rows and four columns around a place, with their weights.
struct Stencil {
    rows: [usize; 4],
    columns: [usize; 4],
    row_weights: [f32; 4],
    column_weights: [f32; 4],
    column_count: usize,
}

impl Stencil {
    /// The neighbours of `[range_m, sine]`; `None` outside the grid.
    fn new(polar: &PolarGrid, range_m: f64, sine: f64) -> Option<Self> {
        let column = (range_m - polar.range_min_m) / polar.range_step_m;
        let row = (sine - polar.sine_min) / polar.sine_step;
        let (columns, column_weights) = neighbours(column, polar.range_count)?;
        let (rows, row_weights) = neighbours(row, polar.sine_count)?;
        let column_count = polar.range_count;
        Some(Self { rows, columns, row_weights, column_weights, column_count })
    }

    /// The interpolated value, not below zero.
    fn value(&self, plane: &[f32]) -> f32 {
        let along_row = |row: &usize| -> f32 {
            let at = |column: &usize| plane[row * self.column_count + column];
            self.columns.iter().zip(self.column_weights).map(|(c, weight)| at(c) * weight).sum()
        };
        let sum: f32 =
            self.rows.iter().zip(self.row_weights).map(|(r, weight)| along_row(r) * weight).sum();
        sum.max(0.0)
    }
}

/// The four pixels around `place` on an axis of `count` pixels, the border repeated, and their
/// weights.
#[expect(clippy::cast_possible_truncation, reason = "within an axis of at most 2^24 pixels")]
fn neighbours(place: f64, count: usize) -> Option<([usize; 4], [f32; 4])> {
    if !(0.0..=(count - 1) as f64).contains(&place) {
        return None;
    }
    let before = place as usize;
    let d = place - before as f64;
    let indices = [0, 1, 2, 3].map(|i: usize| (before + i).saturating_sub(1).min(count - 1));
    let weights = [
        ((-0.5 * d + 1.0) * d - 0.5) * d,
        (1.5 * d - 2.5) * d * d + 1.0,
        ((-1.5 * d + 2.0) * d + 0.5) * d,
        (0.5 * d - 0.5) * d * d,
    ];
    Some((indices, weights.map(single)))
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
