//! Whether the phase of recorded samples turns as documented.
//!
//! An echo of delay `τ` turns as `exp(−j 2π f τ)`. An inverse FFT over frequency puts it at `τ`; of
//! conjugated samples it puts it at `−τ`, which is `1/Δf − τ`. Delays of rooms are short against
//! `1/Δf`, so that moving echoes lie in the first half of that interval, and in the second half if
//! the sign is the opposite one. Noise lies in both.

use crate::imaging::double;
use proto::radar::Band;
use rustfft::FftPlanner;
use rustfft::num_complex::Complex;

use crate::imaging::Sweep;
use crate::imaging::window::Window;

/// Longest delay of interest: 15 m there and back. Half the interval must hold it.
const LONGEST_DELAY_S: f64 = 100e-9;
/// Fewest independent profiles averaged: below, noise alone may rise far over its floor.
const MIN_PROFILE_COUNT: usize = 16;
/// Fewest delay cells, so that each half holds some beyond the guard.
const MIN_CELL_COUNT: usize = 32;
/// Cells left out on both sides of delay 0 and of half the interval: the width of the main lobe.
const GUARD_CELL_COUNT: usize = 3;
/// How far over the floor the mean power of `M` profiles counts as an echo, in standard deviations
/// `1/√M` of noise: no cell reaches it by chance, below 1e-5 for all of them with `M = 16`.
const ECHO_SIGMA: f64 = 10.0;
/// Least excess over the floor that counts, a ratio: noise is not white to less.
const LEAST_EXCESS: f64 = 0.5;
/// How far one half must exceed the other, a ratio: 10 dB.
const CLEAR_RATIO: f64 = 10.0;

/// How the phase of a recording turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PhaseSign {
    /// As `exp(−j 2π f τ)`.
    AsDocumented,
    /// As `exp(+j 2π f τ)`: every sample is conjugated.
    Opposite,
    /// Cannot tell: nothing moves clearly, too few sweeps, or steps too wide (above 5 MHz).
    Undecided,
}

/// Tells the sign of the phase from what changes between `sweeps` (`[channel][frequency]` each), or
/// from what differs from `background` where that is known.
#[must_use]
pub fn phase_sign(sweeps: &[Sweep], band: &Band, background: Option<&[Complex<f32>]>) -> PhaseSign {
    let cell_count = band.step_count;
    if 1.0 / band.step_hz < 2.0 * LONGEST_DELAY_S || cell_count < MIN_CELL_COUNT {
        return PhaseSign::Undecided;
    }
    let independent_count = sweeps.len().saturating_sub(usize::from(background.is_none()));
    let channel_count = sweeps.first().map_or(0, |sweep| sweep.samples.len() / cell_count);
    let profile_count = independent_count * channel_count;
    if profile_count < MIN_PROFILE_COUNT {
        return PhaseSign::Undecided;
    }
    let still = background.map_or_else(|| mean(sweeps), <[Complex<f32>]>::to_vec);
    let power = power_over_delay(sweeps, &still, cell_count);
    let excess = (ECHO_SIGMA / (profile_count as f64).sqrt()).max(LEAST_EXCESS);
    let (early, late) = echo_power(&power, 1.0 + excess);
    if CLEAR_RATIO * late < early {
        PhaseSign::AsDocumented
    } else if CLEAR_RATIO * early < late {
        PhaseSign::Opposite
    } else {
        PhaseSign::Undecided
    }
}

/// The mean sweep: what stands still.
fn mean(sweeps: &[Sweep]) -> Vec<Complex<f32>> {
    let share = 1.0 / sweeps.len() as f32;
    let mut mean = vec![Complex::default(); sweeps.first().map_or(0, |sweep| sweep.samples.len())];
    for sweep in sweeps {
        mean.iter_mut().zip(&sweep.samples).for_each(|(sum, sample)| *sum += sample * share);
    }
    mean
}

/// Power of what moves in each delay cell, summed over sweeps and channels.
fn power_over_delay(sweeps: &[Sweep], still: &[Complex<f32>], cell_count: usize) -> Vec<f64> {
    let weights = Window::Hann.weights(cell_count);
    let transform = FftPlanner::new().plan_fft_inverse(cell_count);
    let mut power = vec![0.0; cell_count];
    let mut profile = vec![Complex::<f64>::default(); cell_count];
    for sweep in sweeps {
        let channels = sweep.samples.chunks_exact(cell_count).zip(still.chunks_exact(cell_count));
        for (samples, still_samples) in channels {
            for (k, cell) in profile.iter_mut().enumerate() {
                let moving = samples[k] - still_samples[k];
                *cell = double(moving) * weights[k];
            }
            transform.process(&mut profile);
            power.iter_mut().zip(&profile).for_each(|(sum, cell)| *sum += cell.norm_sqr());
        }
    }
    power
}

/// Power over `least_ratio` times the floor in the first and in the second half of the delays. The
/// floor is the lower quartile, which echoes in one half cannot lift.
fn echo_power(power: &[f64], least_ratio: f64) -> (f64, f64) {
    let mut sorted = power.to_vec();
    sorted.sort_by(f64::total_cmp);
    let echo_least = least_ratio * sorted[sorted.len() / 4];
    let half = power.len() / 2;
    let of = |cells: &[f64]| -> f64 {
        let guarded = &cells[GUARD_CELL_COUNT..cells.len() - GUARD_CELL_COUNT];
        guarded.iter().map(|cell| (cell - echo_least).max(0.0)).sum()
    };
    (of(&power[..half]), of(&power[half..]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::single;
    use rand::{SeedableRng, rngs::ChaCha8Rng};
    use rand_distr::{Distribution, StandardNormal};
    use std::f64::consts::TAU;

    const CHANNEL_COUNT: usize = 4;

    /// What is in a scene of single echoes.
    #[derive(Clone, Copy)]
    struct Made {
        walker: f64,
        clutter: f64,
        noise: f64,
        sign: f64,
        seed: u64,
    }

    const CLEAR: Made = Made { walker: 1.0, clutter: 30.0, noise: 1.0, sign: -1.0, seed: 1 };

    /// Sweeps of a walker from 3 to 6 m, clutter that stands, and noise, phase by phase.
    fn sweeps(made: Made, band: &Band, sweep_count: usize) -> Vec<Sweep> {
        let mut rng = ChaCha8Rng::seed_from_u64(made.seed);
        let mut normal = move || -> f64 { StandardNormal.sample(&mut rng) };
        let turn = |delay_s: f64, hz: f64| Complex::cis(made.sign * TAU * hz * delay_s);
        let mut sample = |walker_s: f64, channel: usize, hz: f64| {
            let offset_s = 0.3e-9 * channel as f64;
            let sum = turn(walker_s + offset_s, hz) * made.walker
                + turn(6e-9 + offset_s, hz) * made.clutter
                + turn(55e-9, hz) * made.clutter
                + Complex::new(normal(), normal()) * made.noise;
            Complex::new(single(sum.re), single(sum.im))
        };
        let mut sweeps = Vec::new();
        for m in 0..sweep_count {
            let walker_s = 20e-9 + 20e-9 * m as f64 / sweep_count as f64;
            let samples = (0..CHANNEL_COUNT * band.step_count)
                .map(|n| (n / band.step_count, band.frequency_hz(n % band.step_count)))
                .map(|(channel, hz)| sample(walker_s, channel, hz))
                .collect();
            sweeps.push(Sweep { time_s: 0.1 * m as f64, samples });
        }
        sweeps
    }

    #[test]
    fn a_walker_before_clutter_tells_the_sign() {
        let band = Band::default();
        for seed in 0..10 {
            for (sign, expected) in [(-1.0, PhaseSign::AsDocumented), (1.0, PhaseSign::Opposite)] {
                let made = Made { sign, seed, ..CLEAR };
                assert_eq!(phase_sign(&sweeps(made, &band, 32), &band, None), expected);
            }
        }
    }

    #[test]
    fn the_simulated_radar_turns_as_documented() {
        use crate::simulate::{
            AmplitudeLaw, Clutter, Disturbance, EchoSimulator, Radar, Scene, Target, TargetKind,
            WayPoint,
        };
        let at = |time_s, x_m, y_m| WayPoint { time_s, x_m, y_m };
        let way_points = vec![at(0.0, -1.0, 3.0), at(6.4, 1.0, 6.0)];
        let scene = Scene {
            targets: vec![Target { way_points, kind: TargetKind::Point, amplitude_db: 0.0 }],
            clutter: vec![Clutter { x_m: 0.5, y_m: 4.0, amplitude_db: 30.0 }],
            amplitude_law: AmplitudeLaw::InverseSquare,
            wall: Some(proto::radar::Wall { thickness_m: 0.2, permittivity: 6.0 }),
            ..Scene::default()
        };
        let (pose, radar) = (proto::geom::Se2::new(0.0, 0.0, 0.0), Radar::default());
        let simulator =
            EchoSimulator::new(&scene, pose, &radar, &Disturbance::default(), 3).unwrap();
        let mut sweeps: Vec<Sweep> =
            (0..64_u32).map(|m| simulator.sweep(u64::from(m), 0.1 * f64::from(m))).collect();
        assert_eq!(phase_sign(&sweeps, &radar.band, None), PhaseSign::AsDocumented);
        sweeps.iter_mut().flat_map(|sweep| &mut sweep.samples).for_each(|s| *s = s.conj());
        assert_eq!(phase_sign(&sweeps, &radar.band, None), PhaseSign::Opposite);
    }

    #[test]
    fn a_walker_far_below_the_noise_of_a_sample_tells_it_too() {
        let band = Band::default();
        for seed in 0..10 {
            // 9 dB below in each sample, 14 dB above in a delay cell, spread over twelve cells.
            let made = Made { walker: 0.5, sign: 1.0, seed, ..CLEAR };
            assert_eq!(phase_sign(&sweeps(made, &band, 32), &band, None), PhaseSign::Opposite);
        }
    }

    #[test]
    fn a_background_tells_it_of_someone_who_stands() {
        let band = Band::default();
        for (sign, expected) in [(-1.0, PhaseSign::AsDocumented), (1.0, PhaseSign::Opposite)] {
            let made = Made { sign, noise: 0.1, ..CLEAR };
            let empty = sweeps(Made { walker: 0.0, seed: 2, ..made }, &band, 1);
            let standing = vec![sweeps(made, &band, 1)[0].clone(); 4];
            assert_eq!(phase_sign(&standing, &band, None), PhaseSign::Undecided);
            assert_eq!(phase_sign(&standing, &band, Some(&empty[0].samples)), expected);
        }
    }

    #[test]
    fn noise_and_what_stands_tell_nothing() {
        let band = Band { step_count: 64, ..Band::default() };
        for seed in 0..1000 {
            let clutter = if seed % 2 == 0 { 0.0 } else { 30.0 };
            let made = Made { walker: 0.0, clutter, seed, ..CLEAR };
            for sweep_count in [5, 16] {
                let sign = phase_sign(&sweeps(made, &band, sweep_count), &band, None);
                assert_eq!(sign, PhaseSign::Undecided, "{seed}");
            }
        }
    }

    #[test]
    fn too_little_to_go_by_tells_nothing() {
        let band = Band::default();
        let clear = sweeps(CLEAR, &band, 4);
        assert_eq!(phase_sign(&clear, &band, None), PhaseSign::Undecided);
        assert_eq!(phase_sign(&[], &band, None), PhaseSign::Undecided);
        // 6 MHz repeat after 167 ns: 83 ns are 12.5 m, less than a room may need.
        let coarse = Band { step_hz: 6e6, step_count: 101, ..band };
        assert_eq!(phase_sign(&sweeps(CLEAR, &coarse, 32), &coarse, None), PhaseSign::Undecided);
        let short = Band { step_count: 20, ..band };
        assert_eq!(phase_sign(&sweeps(CLEAR, &short, 32), &short, None), PhaseSign::Undecided);
    }

    #[test]
    fn echoes_on_both_sides_tell_nothing() {
        let band = Band::default();
        let mut both = sweeps(CLEAR, &band, 32);
        for (sweep, other) in both.iter_mut().zip(sweeps(Made { sign: 1.0, ..CLEAR }, &band, 32)) {
            sweep.samples.iter_mut().zip(&other.samples).for_each(|(sum, add)| *sum += add);
        }
        assert_eq!(phase_sign(&both, &band, None), PhaseSign::Undecided);
    }
}
