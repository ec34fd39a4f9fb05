//! Images against the exact matched filter, and kernels against each other.

use std::f64::consts::{PI, TAU};

use proto::radar::{Grid, Wall};
use rand::{SeedableRng, rngs::ChaCha8Rng};
use rand_distr::{Distribution, StandardNormal};
use rustfft::num_complex::Complex;

use super::*;
use crate::imaging::compress::Compressor;
use crate::imaging::oracle::{MatchedFilter, textbook_image};
use crate::imaging::pixels::PolarGrid;
use crate::imaging::window::Window;

/// Rounding of single-precision sums: largest difference of two kernels over the root mean square.
const KERNEL_TOLERANCE: f32 = 1e-5;

/// A coarse grid off the symmetry axis whose last pixels are far away. The pixels are so large that
/// no lookup inside a register fits.
fn coarse() -> Pixels {
    Pixels::Cartesian(Grid {
        x_min_m: -1.93,
        y_min_m: 0.45,
        pixel_m: 0.71,
        column_count: 7,
        row_count: 11,
    })
}

/// Three strips of a fine grid, across the axis and in the corner; no multiple of 8 or 16 columns.
fn fine() -> Vec<Pixels> {
    [[-0.91, 0.4], [3.1, 9.3], [-5.0, 0.4]]
        .map(|[x_min_m, y_min_m]| {
            let (column_count, row_count) = (61, 3);
            Pixels::Cartesian(Grid { x_min_m, y_min_m, pixel_m: 0.03, column_count, row_count })
        })
        .into()
}

fn polar() -> Pixels {
    Pixels::Polar(PolarGrid { sine_count: 4, sine_step: 0.47, ..PolarGrid::default() })
}

fn lopsided() -> Array {
    Array {
        tx_m: vec![[-0.15, 0.0], [0.2, 0.05]],
        rx_m: vec![[-0.1125, 0.0], [0.0, 0.02], [0.1, -0.01]],
    }
}

fn brick() -> WallModel {
    WallModel::Refraction(Wall { thickness_m: 0.24, permittivity: 5.0 })
}

/// Data that fill the band: the hardest case for interpolation.
fn noise(count: usize) -> Vec<Complex<f32>> {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    (0..count)
        .map(|_| Complex::new(StandardNormal.sample(&mut rng), StandardNormal.sample(&mut rng)))
        .collect()
}

/// A case: who looks where through what.
struct Case {
    array: Array,
    pixels: Pixels,
    wall: WallModel,
    fft_length: usize,
}

impl Case {
    fn new(array: Array, pixels: Pixels, wall: WallModel) -> Self {
        Self { array, pixels, wall, fft_length: 2048 }
    }

    fn weights(&self) -> Vec<f64> {
        Window::Rectangular.weights(Band::default().step_count)
    }

    fn samples(&self) -> Vec<Complex<f32>> {
        noise(self.array.channel_count() * Band::default().step_count)
    }

    fn projector(&self, means: &Means) -> Backprojector {
        let Self { array, pixels, wall, fft_length } = self;
        let band = &Band::default();
        let geometry = Geometry { band, array, pixels, wall, fft_length: *fft_length };
        Backprojector::with_means(&geometry, means).unwrap()
    }

    fn image(&self, means: &Means) -> CoherentImage {
        let compressor = Compressor::new(&Band::default(), &self.weights(), self.fft_length);
        self.projector(means).image(&compressor.compress(&self.samples()))
    }

    /// The focused samples of every pixel, exactly.
    fn exact(&self) -> Vec<Vec<Complex<f64>>> {
        let (band, weights, samples) = (&Band::default(), &self.weights(), self.samples());
        let filter = MatchedFilter { band, array: &self.array, wall: &self.wall, weights };
        let place = |index| filter.focused(&samples, self.pixels.coords_m(index));
        (0..self.pixels.pixel_count()).map(place).collect()
    }

    /// Root mean square error of `|I|` and of `sqrt E`, decibels.
    fn errors_db(&self, means: &Means) -> [f64; 2] {
        let image = self.image(means);
        let (mut wrong, mut total) = ([0.0; 2], [0.0; 2]);
        for (index, focused) in self.exact().iter().enumerate() {
            let energy: f64 = focused.iter().map(|z| z.norm_sqr()).sum();
            let want = [focused.iter().sum::<Complex<f64>>().norm(), energy.sqrt()];
            let got = [image.power[index], image.energy[index]].map(|v| f64::from(v).sqrt());
            for i in [0, 1] {
                wrong[i] += (got[i] - want[i]).powi(2);
                total[i] += want[i].powi(2);
            }
        }
        [0, 1].map(|i| 10.0 * (wrong[i] / total[i]).log10())
    }
}

fn by(kernel: Kernel) -> Means {
    Means { kernel, ..Means::default() }
}

#[test]
fn images_are_the_matched_filter_to_the_error_of_interpolation() {
    let walls = [WallModel::None, brick()];
    let places = fine().into_iter().chain([coarse(), polar()]);
    for (pixels, wall) in places.flat_map(|pixels| walls.map(|wall| (pixels, wall))) {
        for array in [Array::default(), lopsided()] {
            for (fft_length, bound_db) in [(2048, -55.0), (4096, -72.0)] {
                let case = Case { fft_length, ..Case::new(array.clone(), pixels, wall) };
                let worst_db = case.errors_db(&Means::default()).into_iter().fold(-99.0, f64::max);
                assert!(worst_db < bound_db, "{pixels:?} {fft_length}: {worst_db} dB");
            }
        }
    }
}

/// The largest difference over the root mean square.
fn difference(a: &[f32], b: &[f32]) -> f32 {
    let mean_square = a.iter().map(|v| v * v).sum::<f32>() / a.len() as f32;
    let largest = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    largest / mean_square.sqrt()
}

#[test]
fn all_kernels_give_the_same_image() {
    for pixels in fine().into_iter().chain([polar()]) {
        for array in [Array::default(), lopsided()] {
            let case = Case::new(array, pixels, brick());
            let want = case.image(&by(Kernel::Portable));
            for kernel in [Kernel::Avx2, Kernel::Fastest] {
                let got = case.image(&by(kernel));
                assert!(difference(&want.power, &got.power) < KERNEL_TOLERANCE);
                assert!(difference(&want.energy, &got.energy) < KERNEL_TOLERANCE);
            }
        }
    }
}

#[test]
#[cfg(target_arch = "x86_64")]
fn the_kernel_is_the_one_that_fits() {
    let name = |pixels, kernel| {
        Case::new(Array::default(), pixels, WallModel::None).projector(&by(kernel)).kernel_name()
    };
    assert_eq!(name(fine()[0], Kernel::Portable), "portable");
    assert_eq!(name(coarse(), Kernel::Fastest), "portable");
    if pulp::x86::V3::is_available() {
        assert_eq!(name(fine()[0], Kernel::Avx2), "avx2");
        assert_eq!(name(Pixels::Polar(PolarGrid::default()), Kernel::Avx2), "avx2");
    }
    if pulp::x86::V4::is_available() {
        assert_eq!(name(fine()[0], Kernel::Fastest), "avx512");
    }
}

#[test]
fn the_image_does_not_depend_on_the_number_of_threads() {
    for coherence in [Coherence::Power, Coherence::Phase] {
        let case = Case::new(Array::default(), fine()[0], WallModel::None);
        let with =
            |thread_count| case.image(&Means { thread_count, coherence, ..Means::default() });
        let one = with(1);
        for thread_count in [2, 3, 5] {
            assert_eq!(with(thread_count), one, "{thread_count} threads");
        }
    }
}

#[test]
fn a_workspace_forgets_the_frame_before() {
    let case = Case::new(lopsided(), fine()[0], WallModel::None);
    let compressor = Compressor::new(&Band::default(), &case.weights(), 2048);
    let profiles = compressor.compress(&case.samples());
    for kernel in [Kernel::Fastest, Kernel::Portable] {
        for coherence in [Coherence::Power, Coherence::Circular, Coherence::Phase] {
            let projector = case.projector(&Means { coherence, kernel, ..Means::default() });
            let mut workspace = projector.workspace();
            projector.project(&compressor.compress(&noise(6 * 301 + 301)[301..]), &mut workspace);
            projector.project(&profiles, &mut workspace);
            assert_eq!(workspace.image, projector.image(&profiles), "{coherence:?}");
        }
    }
}

/// The coherence of one pixel's focused samples, as it is defined.
fn coherence_by_definition(focused: &[Complex<f64>], kind: Coherence) -> f64 {
    let count = focused.len() as f64;
    let sum = |values: &[Complex<f64>]| values.iter().sum::<Complex<f64>>().norm();
    let spread = |phases_rad: &[f64]| {
        let mean = phases_rad.iter().sum::<f64>() / count;
        (phases_rad.iter().map(|phase| (phase - mean).powi(2)).sum::<f64>() / count).sqrt()
    };
    match kind {
        Coherence::Power => {
            let energy: f64 = focused.iter().map(|z| z.norm_sqr()).sum();
            sum(focused).powi(2) / (count * energy)
        }
        Coherence::Circular => {
            sum(&focused.iter().map(|z| z / z.norm()).collect::<Vec<_>>()) / count
        }
        Coherence::Phase => {
            let phases_rad: Vec<f64> = focused.iter().map(|z| z.arg()).collect();
            let other_rad: Vec<f64> =
                phases_rad.iter().map(|phase| phase - PI * phase.signum()).collect();
            let least_rad = spread(&phases_rad).min(spread(&other_rad));
            (1.0 - least_rad * 3.0_f64.sqrt() / PI).max(0.0)
        }
    }
}

#[test]
fn coherence_of_every_kind_is_its_definition() {
    let case = Case { fft_length: 8192, ..Case::new(Array::default(), fine()[0], WallModel::None) };
    let exact = case.exact();
    for kind in [Coherence::Power, Coherence::Circular, Coherence::Phase] {
        let image = case.image(&Means { coherence: kind, ..Means::default() });
        let amplitude = image.weighted_amplitude();
        let (mut squares, mut off_count) = (0.0, 0);
        for (index, focused) in exact.iter().enumerate() {
            let want = coherence_by_definition(focused, kind);
            let off = f64::from(image.coherence(index)) - want;
            // A phase near the cut may fall on either side of it.
            off_count += usize::from(2e-3 < off.abs());
            squares += off * off;
            let mean = focused.iter().sum::<Complex<f64>>().norm() / 8.0;
            let off_amplitude =
                f64::from(amplitude[index]) - mean * f64::from(image.coherence(index));
            assert!(off_amplitude.abs() < 1e-4 * exact[0][0].norm().max(0.1));
        }
        assert!(off_count <= 1, "{kind:?}: {off_count}");
        assert!((squares / exact.len() as f64).sqrt() < 2e-3, "{kind:?}");
    }
}

#[test]
fn an_echo_from_a_pixel_is_coherent_there_in_every_kind() {
    let case = Case::new(Array::default(), fine()[0], WallModel::None);
    let place_m = case.pixels.coords_m(100);
    let (band, array) = (Band::default(), Array::default());
    let echo = |[tx, rx]: [[f64; 2]; 2], k: usize| {
        let leg_m = |[x_m, y_m]: [f64; 2]| (place_m.x - x_m).hypot(place_m.y - y_m);
        let turns =
            band.frequency_hz(k) * (leg_m(tx) + leg_m(rx)) / proto::radar::SPEED_OF_LIGHT_M_PER_S;
        let z = Complex::cis(-TAU * turns);
        Complex::new(crate::imaging::single(z.re), crate::imaging::single(z.im))
    };
    let mut samples = Vec::new();
    for tx in &array.tx_m {
        for rx in &array.rx_m {
            samples.extend((0..band.step_count).map(|k| echo([*tx, *rx], k)));
        }
    }
    let profiles = Compressor::new(&band, &case.weights(), 2048).compress(&samples);
    for coherence in [Coherence::Power, Coherence::Circular, Coherence::Phase] {
        let image = case.projector(&Means { coherence, ..Means::default() }).image(&profiles);
        assert!((image.coherence(100) - 1.0).abs() < 3e-3, "{}", image.coherence(100));
        assert!((image.weighted_amplitude()[100] - 1.0).abs() < 5e-3);
    }
    // The textbook's loop sees the same, to its own error.
    let textbook = textbook_image(&band, &array, &case.pixels, &profiles);
    assert!((textbook.power[100] / 64.0 - 1.0).abs() < 0.02 && 0.99 < textbook.coherence(100));
}

#[test]
fn coherence_is_one_where_channels_agree_and_zero_without_energy() {
    let grid = Grid { column_count: 3, row_count: 1, ..Grid::default() };
    let mut image = CoherentImage {
        pixels: Pixels::Cartesian(grid),
        channel_count: 8,
        power: vec![64.0, 8.0, 0.0],
        energy: vec![8.0, 8.0, 0.0],
        phase_coherence: Vec::new(),
    };
    let close = |got: f32, want: f32| (got - want).abs() < 1e-6;
    assert!(close(image.coherence(0), 1.0) && close(image.coherence(1), 0.125));
    let root = 8.0_f32.sqrt();
    let amplitude = image.weighted_amplitude();
    assert!(close(amplitude[0], 1.0) && close(amplitude[1], root / 64.0));
    image.phase_coherence = vec![0.5, 0.25, 0.125];
    assert!(close(image.coherence(0), 0.5) && close(image.coherence(1), 0.25));
    assert!(close(image.weighted_amplitude()[1], root / 32.0));
    assert!(close(image.coherence(2), 0.0) && close(image.weighted_amplitude()[2], 0.0));
}

#[test]
fn an_image_beyond_the_profile_and_a_nonsense_of_threads_are_refused() {
    let (band, array) = (Band::default(), Array::default());
    let pixels = Pixels::Cartesian(Grid { pixel_m: 3.0, ..Grid::default() });
    let error = Backprojector::new(&band, &array, &pixels, &WallModel::None, 512).unwrap_err();
    assert_eq!(error.field, "grid");
    for thread_count in [0, 65] {
        let refused = Means { thread_count, ..Means::default() }.check().unwrap_err();
        assert_eq!(refused.field, "thread_count");
    }
}
