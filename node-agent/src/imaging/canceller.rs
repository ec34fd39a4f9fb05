//! Removal of what does not move, on compressed profiles.
//!
//! Compression is linear, so that all of this means the same on raw samples; on profiles a
//! background can also learn in some range gates and rest in others.
//! `two_pulse`: `y_k = x_k − x_{k−1}` \[registration, section 3\]; blind at the radial speed
//! `λ / (2 Δt)`, and it shows every mover a second time at its old place.
//! `exponential`: `y_k = x_k − b_{k−1}`, `b_k = a_k b_{k−1} + (1 − a_k) x_k`,
//! `a_k = min(exp(−Δt / T), k/(k+1))` with the time constant `T` and the time `Δt` since the sweep
//! before, seconds. While `k/(k+1)` rules, `b` is the plain mean.
//! `slow_fast`: see [`SlowFast`].
//! `background`: `y_k = x_k − b`, with a `b` that was given.

use rustfft::num_complex::Complex;
use serde::{Deserialize, Serialize};

use super::compress::Profiles;
use super::{InvalidSetting, invalid, single};

use slow_fast::SlowFast;

pub mod drift;
pub mod slow_fast;

/// The mean of fewer sweeps holds so much of the target itself that it is no background.
const MIN_BACKGROUND_SWEEPS: usize = 3;
/// A walker moves by about one range cell in this time.
const MIN_BACKGROUND_S: f64 = 0.5;
/// A pause this many times the usual time between sweeps is a gap: a slow radar has none.
const GAP_INTERVALS: f64 = 8.0;
/// After this many sweeps in a row that are not of the known scene, it is another scene.
const NEW_SCENE_SWEEPS: usize = 3;
/// Share of the newest interval in the usual one.
const INTERVAL_SHARE: f64 = 0.1;

/// Which canceller.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum CancellerConfig {
    /// None: for scenes without static echoes.
    None,
    /// Difference of neighbouring sweeps.
    TwoPulse,
    /// Difference from an exponentially forgetting background.
    Exponential {
        /// How long the background remembers, seconds.
        time_constant_s: f64,
    },
    /// Difference from a slow background that learns only where a fast one finds nothing moving;
    /// points at places where nothing moves are left out.
    SlowFast {
        /// How long the fast background remembers, seconds.
        #[serde(default = "default_fast_s")]
        fast_s: f64,
        /// How long the slow background remembers, seconds.
        #[serde(default = "default_slow_s")]
        slow_s: f64,
    },
    /// Difference from the background that comes with a recording; it never learns.
    Background,
}

impl Default for CancellerConfig {
    /// `slow_fast` with 1 and 10 s: the only one that loses nothing of a walker, keeps one who
    /// stands, and leaves nothing behind.
    fn default() -> Self {
        Self::SlowFast { fast_s: default_fast_s(), slow_s: default_slow_s() }
    }
}

fn default_fast_s() -> f64 {
    1.0
}

fn default_slow_s() -> f64 {
    10.0
}

impl CancellerConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), InvalidSetting> {
        let memory = f64::MIN_POSITIVE..=3600.0;
        match self {
            Self::Exponential { time_constant_s } if !memory.contains(time_constant_s) => {
                let field = "canceller.exponential.time_constant_s";
                Err(invalid(field, time_constant_s, "use up to 3600 s, for walkers 1 to 2 s"))
            }
            Self::SlowFast { fast_s, .. } if !memory.contains(fast_s) => {
                let field = "canceller.slow_fast.fast_s";
                Err(invalid(field, fast_s, "use up to 3600 s, about 1 s"))
            }
            Self::SlowFast { fast_s, slow_s } if !(*fast_s..=3600.0).contains(slow_s) => {
                let field = "canceller.slow_fast.slow_s";
                Err(invalid(field, slow_s, "use fast_s to 3600 s, about 10 s"))
            }
            _ => Ok(()),
        }
    }

    /// Two backgrounds that have seen nothing, if that is the mode.
    fn slow_fast(&self, gates: Gates) -> Option<SlowFast> {
        match *self {
            Self::SlowFast { fast_s, slow_s } => Some(SlowFast::new(fast_s, slow_s, gates)),
            _ => None,
        }
    }

    /// How long a pause may be until the background is out of date, seconds.
    fn memory_s(&self) -> f64 {
        match self {
            Self::None | Self::TwoPulse | Self::Background => f64::INFINITY,
            Self::Exponential { time_constant_s } => *time_constant_s,
            Self::SlowFast { slow_s, .. } => *slow_s,
        }
    }
}

/// What of the profiles is kept, and how finely they are sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gates {
    /// Samples kept of each profile, from delay zero on.
    pub kept_count: usize,
    /// Samples in a resolution cell, `1 / (K Δf)`.
    pub per_cell: f64,
}

/// What a canceller gives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cancelled<'a> {
    /// What moves, the kept samples of each channel.
    Moving(&'a Profiles),
    /// The background is not known yet.
    WarmingUp,
}

/// The canceller with its background.
#[derive(Clone, Debug)]
pub struct Canceller {
    config: CancellerConfig,
    gates: Gates,
    clock: Clock,
    /// Of the two-pulse, exponential and given background.
    background: Vec<Complex<f32>>,
    slow_fast: Option<SlowFast>,
    /// The background that `slow_fast` was given.
    given: Option<Profiles>,
    /// Sweeps in a row that were not of the known scene.
    outlier_count: usize,
    moving: Profiles,
}

/// When sweeps came.
#[derive(Clone, Copy, Debug, Default)]
struct Clock {
    /// Since the background began.
    sweep_count: usize,
    first_s: f64,
    last_s: Option<f64>,
    usual_interval_s: Option<f64>,
}

impl Canceller {
    /// A canceller that has seen nothing.
    #[must_use]
    pub fn new(config: CancellerConfig, gates: Gates) -> Self {
        Self {
            config,
            gates,
            clock: Clock::default(),
            background: Vec::new(),
            slow_fast: config.slow_fast(gates),
            given: None,
            outlier_count: 0,
            moving: Profiles { sample_count: 0, sample_rate_hz: 0.0, samples: Vec::new() },
        }
    }

    /// Starts from the profiles of an empty room. `background` stays with them, `slow_fast` goes on
    /// learning from them; the other modes make their own.
    pub fn use_background(&mut self, empty: &Profiles) {
        self.keep(empty);
        match (&self.config, &mut self.slow_fast) {
            (CancellerConfig::Background, _) => self.background.clone_from(&self.moving.samples),
            (_, Some(slow_fast)) => {
                slow_fast.start_from(&self.moving);
                self.given = Some(self.moving.clone());
            }
            _ => {}
        }
    }

    /// When the last sweep was taken, if there was one.
    #[must_use]
    pub fn last_s(&self) -> Option<f64> {
        self.clock.last_s
    }

    /// The backgrounds of `slow_fast`, if that is the mode.
    #[must_use]
    pub fn slow_fast_mut(&mut self) -> Option<&mut SlowFast> {
        self.slow_fast.as_mut()
    }

    /// Takes the profiles of the sweep at `time_s` in and gives what moves. Times ascend. A pause
    /// longer than the memory begins a new background.
    pub fn cancel<'a>(&'a mut self, time_s: f64, profiles: &'a Profiles) -> Cancelled<'a> {
        let since_last_s = self.clock.elapsed_s(time_s);
        if self.clock.is_gap(since_last_s) && self.config.memory_s() < since_last_s {
            self.forget();
        }
        if self.config != CancellerConfig::None {
            self.keep(profiles);
        }
        if self.is_passing_outlier() {
            self.clock.last_s = Some(time_s);
            return Cancelled::WarmingUp;
        }
        // A new background has not learned through the pause before it.
        let elapsed_s = if self.clock.sweep_count == 0 { 0.0 } else { since_last_s };
        let known = self.background_is_known(time_s);
        match (&self.config, &mut self.slow_fast) {
            (CancellerConfig::None, _) => {}
            (CancellerConfig::Background, _) => subtract(&mut self.moving, &self.background),
            (_, Some(slow_fast)) => slow_fast.cancel(time_s, elapsed_s, &mut self.moving),
            _ => self.subtract_and_learn(elapsed_s),
        }
        self.clock.tick(time_s, since_last_s);
        match (known, self.config) {
            (false, _) => Cancelled::WarmingUp,
            (true, CancellerConfig::None) => Cancelled::Moving(profiles),
            (true, _) => Cancelled::Moving(&self.moving),
        }
    }

    /// Whether the kept sweep is not of the known scene; one too many of these begins a new scene.
    fn is_passing_outlier(&mut self) -> bool {
        let Some(slow_fast) = &self.slow_fast else { return false };
        if !slow_fast.is_outlier(&self.moving) {
            self.outlier_count = 0;
            return false;
        }
        // A receiver that is silent is no other scene.
        let is_silent = self.moving.samples.iter().all(|x| x.norm_sqr() <= f32::MIN_POSITIVE);
        self.outlier_count += usize::from(!is_silent);
        if is_silent || self.outlier_count < NEW_SCENE_SWEEPS {
            return true;
        }
        self.outlier_count = 0;
        self.forget();
        false
    }

    fn forget(&mut self) {
        self.clock.sweep_count = 0;
        self.background.clear();
        self.slow_fast = self.config.slow_fast(self.gates);
        if let (Some(slow_fast), Some(given)) = (&mut self.slow_fast, &self.given) {
            slow_fast.start_from(given);
        }
    }

    fn background_is_known(&self, time_s: f64) -> bool {
        let learned = MIN_BACKGROUND_SWEEPS <= self.clock.sweep_count
            && MIN_BACKGROUND_S <= time_s - self.clock.first_s;
        match self.config {
            CancellerConfig::None => true,
            CancellerConfig::TwoPulse => 0 < self.clock.sweep_count,
            CancellerConfig::Exponential { .. } => learned,
            CancellerConfig::SlowFast { .. } => {
                learned || self.slow_fast.as_ref().is_some_and(SlowFast::was_given)
            }
            CancellerConfig::Background => !self.background.is_empty(),
        }
    }

    /// Copies the kept samples of each channel to `moving`.
    fn keep(&mut self, profiles: &Profiles) {
        let kept_count = self.gates.kept_count.min(profiles.sample_count);
        self.moving.sample_count = kept_count;
        self.moving.sample_rate_hz = profiles.sample_rate_hz;
        self.moving.samples.clear();
        for channel in profiles.channels() {
            self.moving.samples.extend_from_slice(&channel[..kept_count]);
        }
    }

    /// `y = x − b`, then `b + (1 − a) y`, for one background.
    fn subtract_and_learn(&mut self, elapsed_s: f64) {
        let keep = match self.config {
            CancellerConfig::Exponential { time_constant_s } => {
                (-elapsed_s / time_constant_s).exp().min(self.clock.mean_weight())
            }
            _ => 0.0,
        };
        let learn = single(1.0 - keep);
        self.background.resize(self.moving.samples.len(), Complex::default());
        for (x, b) in self.moving.samples.iter_mut().zip(&mut self.background) {
            *x -= *b;
            *b += *x * learn;
        }
    }
}

impl Clock {
    fn elapsed_s(&self, time_s: f64) -> f64 {
        self.last_s.map_or(0.0, |last_s| time_s - last_s)
    }

    fn is_gap(&self, elapsed_s: f64) -> bool {
        self.usual_interval_s.is_some_and(|usual_s| GAP_INTERVALS * usual_s < elapsed_s)
    }

    /// `k/(k+1)`: what the mean of `k` sweeps weighs in that of one more.
    fn mean_weight(&self) -> f64 {
        self.sweep_count as f64 / (self.sweep_count + 1) as f64
    }

    fn tick(&mut self, time_s: f64, elapsed_s: f64) {
        if self.sweep_count == 0 {
            self.first_s = time_s;
        }
        if self.last_s.is_some() && !self.is_gap(elapsed_s) {
            let usual_s = self.usual_interval_s.unwrap_or(elapsed_s);
            self.usual_interval_s = Some(usual_s + INTERVAL_SHARE * (elapsed_s - usual_s));
        }
        self.last_s = Some(time_s);
        self.sweep_count += 1;
    }
}

/// `samples − background`; without a background nothing changes.
fn subtract(profiles: &mut Profiles, background: &[Complex<f32>]) {
    for (x, b) in profiles.samples.iter_mut().zip(background) {
        *x -= *b;
    }
}

#[cfg(test)]
mod tests;
