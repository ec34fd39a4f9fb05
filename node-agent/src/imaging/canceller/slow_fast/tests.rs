//! The two backgrounds on synthetic profiles: noise, echoes that stand, move, step and drift.

use super::*;
use rand::{SeedableRng, rngs::ChaCha8Rng};
use rand_distr::{Distribution, StandardNormal};
use std::f64::consts::TAU;

const GATE_COUNT: usize = 600;
/// Samples of a resolution cell.
const CELL: usize = 7;
/// A gate every 3.7 cm, as at an FFT of 2048.
const RATE_HZ: f64 = 4.096e9;

/// Profiles of `channel_count` channels at 10 Hz: noise of power `noise²` plus echoes
/// `(gate, amplitude)`, the same in all channels.
struct Source {
    rng: ChaCha8Rng,
    channel_count: usize,
    noise: f32,
}

impl Source {
    fn new(channel_count: usize, noise: f32) -> Self {
        Self { rng: ChaCha8Rng::seed_from_u64(7), channel_count, noise }
    }

    fn profiles(&mut self, echoes: &[(usize, Complex<f32>)]) -> Profiles {
        let mut draw = || -> f32 { StandardNormal.sample(&mut self.rng) };
        let scale = self.noise * std::f32::consts::FRAC_1_SQRT_2;
        let white: Vec<Complex<f32>> = (0..self.channel_count * GATE_COUNT + CELL)
            .map(|_| Complex::new(draw(), draw()) * scale)
            .collect();
        // Neighbours share their noise as they do in an oversampled profile.
        let mut samples: Vec<Complex<f32>> = white
            .windows(CELL + 1)
            .map(|near| near[1..].iter().sum::<Complex<f32>>() / (CELL as f32).sqrt())
            .collect();
        for channel in samples.chunks_exact_mut(GATE_COUNT) {
            for (gate, echo) in echoes {
                channel[*gate] += echo;
            }
        }
        Profiles { sample_count: GATE_COUNT, sample_rate_hz: RATE_HZ, samples }
    }
}

fn fresh() -> SlowFast {
    SlowFast::new(1.0, 10.0, Gates { kept_count: GATE_COUNT, per_cell: 6.8 })
}

/// Runs sweeps `k` in `from..to` at 10 Hz and gives the last of what moves.
fn run(
    tested: &mut SlowFast,
    source: &mut Source,
    sweeps: std::ops::Range<usize>,
    echoes: impl Fn(f64) -> Vec<(usize, Complex<f32>)>,
) -> Profiles {
    let mut last = source.profiles(&[]);
    for k in sweeps {
        let time_s = 0.1 * k as f64;
        last = source.profiles(&echoes(time_s));
        tested.cancel(time_s, if k == 0 { 0.0 } else { 0.1 }, &mut last);
    }
    last
}

fn is_live(tested: &SlowFast, gate: usize) -> bool {
    0.0 < tested.of_gate.live_weight[gate]
}

fn real(value: f64) -> Complex<f32> {
    Complex::new(single(value), 0.0)
}

/// A unit echo whose phase turns by 1 rad at 0.25 Hz to either side.
fn breathing(time_s: f64) -> Complex<f32> {
    Complex::from_polar(1.0, single((TAU * 0.25 * time_s).sin()))
}

#[test]
fn the_slow_background_of_a_quiet_room_is_its_mean() {
    let (mut tested, mut source) = (fresh(), Source::new(8, 0.1));
    run(&mut tested, &mut source, 0..90, |_| vec![(100, real(50.0))]);
    // The mean of 90 sweeps errs by 0.1 / sqrt(90) = 0.011 in each channel; over 8 by 0.004.
    let mean = (0..8).map(|c| tested.slow[c * GATE_COUNT + 100]).sum::<Complex<f32>>() / 8.0;
    assert!((mean - real(50.0)).norm() < 0.015, "{mean}");
    let power = tested.slow[200..].iter().take(300).map(Complex::norm_sqr).sum::<f32>() / 300.0;
    // The mean of 90 sweeps; 300 samples in 43 cells err by 15 %: no gate forgot.
    assert!((power / (0.01 / 90.0) - 1.0).abs() < 0.4, "{power}");
    assert!((0..GATE_COUNT).all(|n| !is_live(&tested, n)));
    assert!((tested.learned_s(100) - 8.9).abs() < 0.05);
}

#[test]
fn the_noise_power_is_that_of_the_noise_for_any_number_of_channels() {
    for channel_count in [1, 2, 8] {
        let (mut tested, mut source) = (fresh(), Source::new(channel_count, 0.1));
        run(&mut tested, &mut source, 0..60, |t| {
            vec![(100, breathing(t) * 30.0), (400, real(9.0))]
        });
        // The fast background of 1 s at 10 Hz adds (1 − a)/(1 + a) = 5 % of its own noise.
        let want = 0.01 * 1.05;
        let got = tested.noise_power();
        // The median of 86 cells over 20 sweeps errs by 3 % with one channel.
        assert!((got / want - 1.0).abs() < 0.12, "{channel_count}: {got}");
    }
}

#[test]
fn what_breathes_is_never_learned_and_leaves_nothing() {
    let (mut tested, mut source) = (fresh(), Source::new(8, 0.2));
    run(&mut tested, &mut source, 0..50, |_| vec![(300, real(20.0))]);
    let there = |t: f64| vec![(300, real(20.0)), (105, breathing(t))];
    let last = run(&mut tested, &mut source, 50..450, there);
    let expected = breathing(44.9);
    let seen = (0..8).map(|c| last.samples[c * GATE_COUNT + 105]).sum::<Complex<f32>>() / 8.0;
    // Noise of 0.2 / sqrt(8) = 0.07, three of them.
    assert!((seen - expected).norm() < 0.22, "{seen} for {expected}");
    assert!(is_live(&tested, 105) && is_live(&tested, 98) && !is_live(&tested, 90));
    let gone = run(&mut tested, &mut source, 450..452, |_| vec![(300, real(20.0))]);
    let left = (0..8).map(|c| gone.samples[c * GATE_COUNT + 105]).sum::<Complex<f32>>() / 8.0;
    assert!(left.norm() < 0.22, "{left}");
}

#[test]
fn what_is_put_down_is_learned_with_the_slow_memory() {
    let (mut tested, mut source) = (fresh(), Source::new(8, 0.1));
    run(&mut tested, &mut source, 0..150, |_| vec![]);
    let chair = |_| vec![(105, real(2.0))];
    let early = run(&mut tested, &mut source, 150..160, chair);
    assert!((early.samples[105] - real(2.0)).norm() < 0.4, "held for at least a second");
    // About 5 s until it is quiet, then exp(−20 / 10).
    let late = run(&mut tested, &mut source, 160..400, chair);
    let seen = (0..8).map(|c| late.samples[c * GATE_COUNT + 105].re).sum::<f32>() / 8.0;
    assert!((0.12..0.6).contains(&seen), "{seen}");
}

#[test]
fn strong_echoes_that_drift_are_followed() {
    let noise = 0.16;
    let (mut tested, mut source) = (fresh(), Source::new(8, noise));
    let strong = |t: f64| {
        let drift = Complex::from_polar(single(5e-4 * t), 0.9) + 1.0;
        (200..207).map(|gate| (gate, drift * 1000.0)).collect()
    };
    let last = run(&mut tested, &mut source, 0..300, strong);
    let power = (0..8).map(|c| last.samples[c * GATE_COUNT + 203].norm_sqr()).sum::<f32>() / 8.0;
    // A background of 10 s without correction would be 5 off; noise of power 0.026 remains, with
    // that of the background and of the drift below it as much again at most.
    assert!(power < 3.0 * noise * noise, "{power}");
    assert!(!is_live(&tested, 203));
}

#[test]
fn a_hold_keeps_gates_from_learning_until_it_ends() {
    let (mut tested, mut source) = (fresh(), Source::new(8, 0.1));
    run(&mut tested, &mut source, 0..20, |_| vec![]);
    let before_s = tested.learned_s(105);
    tested.hold(105, 4.0, RATE_HZ);
    tested.hold(GATE_COUNT + 50, 4.0, RATE_HZ);
    run(&mut tested, &mut source, 20..40, |_| vec![]);
    assert!((tested.learned_s(105) - before_s).abs() < 1e-6);
    assert!((tested.learned_s(130) - before_s - 2.0).abs() < 1e-3);
    assert!(tested.learned_s(GATE_COUNT).abs() < f64::MIN_POSITIVE);
    run(&mut tested, &mut source, 40..60, |_| vec![]);
    assert!((tested.learned_s(105) - before_s - 2.0).abs() < 0.11);
}

#[test]
fn the_history_is_the_last_two_seconds_without_drift() {
    let (mut tested, mut source) = (fresh(), Source::new(1, 0.01));
    let strong = |t: f64| (200..207).map(|gate| (gate, real(1000.0 * (1.0 + 5e-4 * t)))).collect();
    run(&mut tested, &mut source, 0..100, strong);
    let times_s: Vec<f64> = tested.history().frames().map(|(time_s, _)| time_s).collect();
    assert!((20..=21).contains(&times_s.len()) && times_s.iter().all(|t| 7.89 < *t));
    for (time_s, samples) in tested.history().frames() {
        // Without correction 0.5 a second; the first sweep began at 1000.
        let off = (samples[200] - real(1000.0)).norm();
        assert!(off < 0.6, "{off} at {time_s} s");
    }
    let spread = |i: usize| {
        let values: Vec<f32> = tested.history().frames().map(|frame| frame.1[i].re).collect();
        values.iter().fold(f32::MIN, |a, b| a.max(*b))
            - values.iter().fold(f32::MAX, |a, b| a.min(*b))
    };
    assert!(spread(200) < 0.1, "{}", spread(200));
}

#[test]
fn at_high_rates_the_history_is_thinned_out() {
    let (mut quick, mut source) =
        (History { window_s: 2.0, ..History::default() }, Source::new(1, 0.01));
    for k in 0..1000 {
        quick.push(0.01 * f64::from(k), &source.profiles(&[]), &[Complex::new(1.0, 0.0)]);
    }
    let times_s: Vec<f64> = quick.frames().map(|(time_s, _)| time_s).collect();
    let oldest_s = times_s.iter().fold(f64::MAX, |a, b| a.min(*b));
    assert!((25..=32).contains(&times_s.len()), "{} frames", times_s.len());
    assert!((7.9..8.4).contains(&oldest_s) && times_s.iter().any(|t| (t - 9.99).abs() < 1e-9));
}

#[test]
fn one_who_appears_at_once_is_not_learned() {
    let mut source = Source::new(8, 1.0);
    let mut tested = fresh();
    run(&mut tested, &mut source, 0..30, |_| Vec::new());
    // 35 dB over noise, from one sweep to the next, turning as a walker does; then he is gone.
    let appears = |time_s: f64| vec![(300, Complex::from_polar(56.0, 7.0 * single(time_s)))];
    run(&mut tested, &mut source, 30..33, appears);
    let left = run(&mut tested, &mut source, 33..34, |_| Vec::new());
    let power = (0..8).map(|c| left.samples[c * GATE_COUNT + 300].norm_sqr()).sum::<f32>() / 8.0;
    // Noise of power 1 alone; three sweeps learned would leave 20 or more.
    assert!(power < 4.0, "{power}");
}
