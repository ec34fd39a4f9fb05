//! Removal of what does not move, on raw frequency samples.
//!
//! Exponential background: `b_k = a_k b_{k−1} + (1 − a_k) x_k`, `y_k = x_k − b_{k−1}`,
//! `a_k = min(a, k/(k+1))`, `a = 1 − Δt / T`, with the time constant `T` and the time `Δt` since the
//! sweep before, seconds. While `k/(k+1)` rules, `b` is the plain mean.
//! Two-pulse canceller: `y_k = x_k − x_{k−1}` \[registration, section 3\]; it is blind at the radial
//! speed `λ / (2 Δt)` and shows every mover a second time at its old place.

use rustfft::num_complex::Complex;
use serde::{Deserialize, Serialize};

use super::{InvalidSetting, Sweep, invalid, single};

/// The mean of fewer sweeps holds so much of the target itself that it is no background.
const MIN_BACKGROUND_SWEEPS: usize = 3;
/// A walker moves by about one range cell in this time.
const MIN_BACKGROUND_S: f64 = 0.5;

/// Which canceller.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum CancellerConfig {
    /// None: for scenes without static echoes.
    #[default]
    None,
    /// Difference of neighbouring sweeps.
    TwoPulse,
    /// Difference from an exponentially forgetting background.
    Exponential {
        /// How long the background remembers, seconds.
        time_constant_s: f64,
    },
}

impl CancellerConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), InvalidSetting> {
        match self {
            Self::Exponential { time_constant_s } if !(0.0..=3600.0).contains(time_constant_s) => {
                let field = "canceller.exponential.time_constant_s";
                Err(invalid(field, time_constant_s, "use 0 to 3600 s, for walkers 1 to 2 s"))
            }
            _ => Ok(()),
        }
    }
}

/// What a canceller gives.
#[derive(Clone, Debug, PartialEq)]
pub enum Cancelled {
    /// What moves, same layout as the sweep.
    Moving(Vec<Complex<f32>>),
    /// The background is not known yet.
    WarmingUp,
}

/// The canceller with its background.
#[derive(Clone, Debug)]
pub struct Canceller {
    config: CancellerConfig,
    background: Vec<Complex<f32>>,
    sweep_count: usize,
    first_s: f64,
    last_s: f64,
}

impl Canceller {
    /// A canceller that has seen nothing.
    #[must_use]
    pub fn new(config: CancellerConfig) -> Self {
        Self { config, background: Vec::new(), sweep_count: 0, first_s: 0.0, last_s: 0.0 }
    }

    /// When the last sweep was taken, if there was one.
    #[must_use]
    pub fn last_s(&self) -> Option<f64> {
        (0 < self.sweep_count).then_some(self.last_s)
    }

    /// Takes one sweep in and gives what moves. All sweeps have the same length, and their times
    /// ascend.
    pub fn cancel(&mut self, sweep: &Sweep) -> Cancelled {
        let known = self.background_is_known(sweep.time_s);
        let moving = known.then(|| subtract(&sweep.samples, &self.background));
        self.learn(sweep);
        moving.map_or(Cancelled::WarmingUp, Cancelled::Moving)
    }

    fn background_is_known(&self, time_s: f64) -> bool {
        match self.config {
            CancellerConfig::None => true,
            CancellerConfig::TwoPulse => 0 < self.sweep_count,
            CancellerConfig::Exponential { .. } => {
                MIN_BACKGROUND_SWEEPS <= self.sweep_count
                    && MIN_BACKGROUND_S <= time_s - self.first_s
            }
        }
    }

    fn learn(&mut self, sweep: &Sweep) {
        let keep = match self.config {
            CancellerConfig::None | CancellerConfig::TwoPulse => 0.0,
            CancellerConfig::Exponential { time_constant_s } => {
                let elapsed_s = sweep.time_s - self.last_s;
                let mean = self.sweep_count as f64 / (self.sweep_count + 1) as f64;
                mean.min((1.0 - elapsed_s / time_constant_s).max(0.0))
            }
        };
        if self.sweep_count == 0 {
            self.first_s = sweep.time_s;
        }
        self.last_s = sweep.time_s;
        self.sweep_count += 1;
        if self.config == CancellerConfig::None {
            return;
        }
        self.background.resize(sweep.samples.len(), Complex::default());
        for (background, sample) in self.background.iter_mut().zip(&sweep.samples) {
            *background = *background * single(keep) + *sample * single(1.0 - keep);
        }
    }
}

/// `samples − background`; an empty background counts as zero.
fn subtract(samples: &[Complex<f32>], background: &[Complex<f32>]) -> Vec<Complex<f32>> {
    if background.is_empty() {
        return samples.to_vec();
    }
    samples.iter().zip(background).map(|(sample, b)| sample - b).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding of single-precision sums of numbers near one.
    const TOLERANCE: f32 = 1e-5;

    fn sweep(k: usize, value: f64) -> Sweep {
        Sweep { time_s: 0.1 * k as f64, samples: vec![Complex::new(single(value), 0.0)] }
    }

    /// The background as the weighted sum it stands for, from all sweeps before.
    fn background_by_definition(values: &[f64], forget: f64) -> f64 {
        let mut weights = vec![0.0; values.len()];
        for k in 0..values.len() {
            let a = forget.min(k as f64 / (k + 1) as f64);
            for w in &mut weights[..k] {
                *w *= a;
            }
            weights[k] = 1.0 - a;
        }
        weights.iter().zip(values).map(|(w, v)| w * v).sum()
    }

    #[test]
    fn the_exponential_background_is_its_weighted_sum() {
        let values: Vec<f64> = (0..40).map(|k| 3.0 + (0.7 * f64::from(k)).sin()).collect();
        let mut canceller = Canceller::new(CancellerConfig::Exponential { time_constant_s: 1.0 });
        for (k, value) in values.iter().enumerate() {
            match canceller.cancel(&sweep(k, *value)) {
                Cancelled::WarmingUp => assert!(k < 5, "still warming up at sweep {k}"),
                Cancelled::Moving(moving) => {
                    assert!(5 <= k, "an answer at sweep {k} already");
                    let want = single(value - background_by_definition(&values[..k], 0.9));
                    assert!((moving[0].re - want).abs() < TOLERANCE, "sweep {k}");
                }
            }
        }
    }

    #[test]
    fn the_two_pulse_canceller_is_a_difference_and_none_changes_nothing() {
        let mut two_pulse = Canceller::new(CancellerConfig::TwoPulse);
        assert_eq!(two_pulse.cancel(&sweep(0, 3.0)), Cancelled::WarmingUp);
        let want = vec![Complex::new(-1.0, 0.0)];
        assert_eq!(two_pulse.cancel(&sweep(1, 2.0)), Cancelled::Moving(want));
        let mut none = Canceller::new(CancellerConfig::None);
        let first = sweep(0, 3.0);
        assert_eq!(none.cancel(&first), Cancelled::Moving(first.samples.clone()));
        assert_eq!(none.cancel(&first), Cancelled::Moving(first.samples));
    }

    #[test]
    fn a_time_constant_of_nonsense_is_named() {
        for time_constant_s in [-1.0, f64::NAN] {
            let error = CancellerConfig::Exponential { time_constant_s }.check().unwrap_err();
            assert_eq!(error.field, "canceller.exponential.time_constant_s");
        }
    }
}
