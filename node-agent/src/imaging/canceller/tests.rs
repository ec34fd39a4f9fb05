//! Each canceller against its definition, at any rate and after pauses.

use super::*;

/// Rounding of single-precision sums of numbers near one.
const TOLERANCE: f32 = 1e-5;
const GATES: Gates = Gates { kept_count: 2, per_cell: 1.0 };

/// One channel of three samples of which two are kept.
fn profiles(value: f64) -> Profiles {
    let sample = |n: u8| Complex::new(single(value * f64::from(n)), 0.0);
    Profiles { sample_count: 3, sample_rate_hz: 1e9, samples: [1, 2, 3].map(sample).to_vec() }
}

/// The first sample of what moves.
fn moving(canceller: &mut Canceller, time_s: f64, value: f64) -> Option<f32> {
    match canceller.cancel(time_s, &profiles(value)) {
        Cancelled::WarmingUp => None,
        Cancelled::Moving(moving) => {
            assert!((moving.samples[1].re - 2.0 * moving.samples[0].re).abs() < TOLERANCE);
            Some(moving.samples[0].re)
        }
    }
}

fn exponential(time_constant_s: f64) -> Canceller {
    Canceller::new(CancellerConfig::Exponential { time_constant_s }, GATES)
}

/// The background as the weighted sum it stands for, from all sweeps before.
fn background_by_definition(times_s: &[f64], values: &[f64], time_constant_s: f64) -> f64 {
    let mut weights = vec![0.0; values.len()];
    for k in 0..values.len() {
        let elapsed_s = if k == 0 { 0.0 } else { times_s[k] - times_s[k - 1] };
        let a = (-elapsed_s / time_constant_s).exp().min(k as f64 / (k + 1) as f64);
        for w in &mut weights[..k] {
            *w *= a;
        }
        weights[k] = 1.0 - a;
    }
    weights.iter().zip(values).map(|(w, v)| w * v).sum()
}

#[test]
fn the_exponential_background_is_its_weighted_sum_at_irregular_times() {
    let times_s: Vec<f64> = (0..40).map(|k| 0.1 * f64::from(k) + 0.03 * f64::from(k % 3)).collect();
    let values: Vec<f64> = (0..40).map(|k| 3.0 + (0.7 * f64::from(k)).sin()).collect();
    let mut canceller = exponential(1.0);
    for k in 0..40 {
        let got = moving(&mut canceller, times_s[k], values[k]);
        assert_eq!(got.is_some(), 5 <= k, "sweep {k}");
        let want = values[k] - background_by_definition(&times_s[..k], &values[..k], 1.0);
        assert!(got.is_none_or(|y| (y - single(want)).abs() < TOLERANCE), "sweep {k}");
    }
}

#[test]
fn a_step_fades_with_the_time_constant_at_any_rate() {
    for rate_hz in [5.0, 10.0, 40.0] {
        let mut canceller = exponential(1.5);
        let mut last = None;
        // Ten seconds of nothing, then a step that is 3 s old.
        for time_s in (0..).map(|k| f64::from(k) / rate_hz).take_while(|t| *t < 13.0 + 1e-9) {
            last = moving(&mut canceller, time_s, if time_s < 10.0 { 0.0 } else { 1.0 });
        }
        // The step shows in full at its first sweep, and fades from there.
        assert!((last.unwrap() - (-2.0_f32).exp()).abs() < 1e-3, "{rate_hz} Hz: {last:?}");
    }
}

#[test]
fn a_pause_beyond_the_memory_begins_anew_and_a_slow_radar_does_not_pause() {
    let mut canceller = exponential(1.5);
    for k in 0..20 {
        assert_eq!(moving(&mut canceller, 0.1 * f64::from(k), 1.0).is_some(), 5 <= k);
    }
    // A pause of 1.2 s is remembered through, one of 5 s is not.
    assert!(moving(&mut canceller, 3.1, 1.0).is_some_and(|y| y.abs() < TOLERANCE));
    for k in 0..8 {
        let again = moving(&mut canceller, 8.1 + 0.1 * f64::from(k), 7.0);
        assert_eq!(again.is_some(), 5 <= k, "sweep {k} after the pause");
        assert!(again.is_none_or(|y| y.abs() < TOLERANCE));
    }
    let mut slow = exponential(0.5);
    let known = (0..6).map(|k| moving(&mut slow, f64::from(k), 1.0).is_some());
    assert_eq!(known.collect::<Vec<_>>(), [false, false, false, true, true, true]);
    let mut both = Canceller::new(CancellerConfig::default(), GATES);
    for k in 0..30 {
        assert_eq!(moving(&mut both, 0.1 * f64::from(k), 1.0).is_some(), 5 <= k);
    }
    assert!(moving(&mut both, 9.0, 1.0).is_some(), "6 s are within 10 s");
    assert!(moving(&mut both, 20.0, 1.0).is_none(), "11 s are not");
}

#[test]
fn two_pulse_is_a_difference_none_changes_nothing_and_background_never_learns() {
    let mut two_pulse = Canceller::new(CancellerConfig::TwoPulse, GATES);
    assert_eq!(moving(&mut two_pulse, 0.0, 3.0), None);
    assert_eq!(moving(&mut two_pulse, 0.1, 2.0), Some(-1.0));
    let mut none = Canceller::new(CancellerConfig::None, GATES);
    let same = profiles(3.0);
    assert_eq!(none.cancel(0.0, &same), Cancelled::Moving(&same));
    assert_eq!(none.cancel(0.1, &same), Cancelled::Moving(&same));
    let unknown = Canceller::new(CancellerConfig::Background, GATES);
    assert_eq!(moving(&mut unknown.clone(), 0.0, 3.0), None);
    let mut background = unknown;
    background.use_background(&profiles(1.0));
    for k in 0..50 {
        assert_eq!(moving(&mut background, 60.0 * f64::from(k), 3.0), Some(2.0));
    }
    assert_eq!(background.last_s(), Some(49.0 * 60.0));
}

#[test]
fn slow_fast_is_ready_at_once_with_a_given_background() {
    let mut fresh = Canceller::new(CancellerConfig::default(), GATES);
    assert_eq!(moving(&mut fresh.clone(), 0.0, 3.0), None);
    fresh.use_background(&profiles(1.0));
    assert_eq!(moving(&mut fresh, 0.0, 3.0), Some(2.0));
}

#[test]
fn memories_of_nonsense_are_named() {
    let named = |config: CancellerConfig| config.check().unwrap_err().field;
    for bad_s in [-1.0, 0.0, f64::NAN, 1e9] {
        let exponential = CancellerConfig::Exponential { time_constant_s: bad_s };
        assert_eq!(named(exponential), "canceller.exponential.time_constant_s");
        let bad_fast = CancellerConfig::SlowFast { fast_s: bad_s, slow_s: 10.0 };
        assert_eq!(named(bad_fast), "canceller.slow_fast.fast_s");
        let bad_slow = CancellerConfig::SlowFast { fast_s: 1.0, slow_s: bad_s };
        assert_eq!(named(bad_slow), "canceller.slow_fast.slow_s");
    }
    assert_eq!(CancellerConfig::default().check(), Ok(()));
    let reversed = CancellerConfig::SlowFast { fast_s: 10.0, slow_s: 1.0 };
    assert_eq!(named(reversed), "canceller.slow_fast.slow_s");
}
