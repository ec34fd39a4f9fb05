//! Two backgrounds: the slow one is subtracted, the fast one says where it may learn.
//!
//! With the profiles `x_k` of `C` channels and the drift `δ` of each (see [`super::drift`]):
//! fast: `f_k = (1 + δ) f_{k−1} + (1 − a) r_k`, `r_k = x_k − (1 + δ) f_{k−1}`,
//! `a = min(exp(−Δt / T_fast), k/(k+1))`.
//! Activity of range gate `n`: `A_n`, the clipped mean of `Σ_c |r_cn|² / (C σ²)` over `2 T_fast`, 1
//! where nothing moves; `C σ²` is the median over all gates, over that of the gamma distribution,
//! `C − 1/3 + 8/(405 C)` for noise power 1. A gate is live while `A` exceeds its threshold within
//! 0.3 m of it, and for `2 T_fast` more; while `Σ_c |r_cn|² / (C σ²) > 3` it is live at once.
//! slow: `y_k = x_k − (1 + δ) b_{k−1}`, `b_k = (1 + δ) b_{k−1} + g_n y_k`, with `g_n = 0` in live
//! gates, else `Δt / min(t_n, T_slow)`, where `t_n` is how long the gate has learned, seconds.
//!
//! A person who walks, or stands and breathes, keeps his gates live, so that the slow background
//! under him remains that of the empty room: he loses nothing, leaves no trail, and no negative
//! image remains where he stood. A person already there at the start is in the background
//! until he leaves: what a gate learned in less than a second before it became live is then
//! forgotten, so that it learns afresh at once. One who does not even breathe is taken in with `T_slow`.
//!
//! A step of a channel's gain or phase (`x ≈ g f` over all gates) scales its backgrounds; a sweep
//! whose power is far off, and that no step explains, teaches nothing.

use crate::imaging::single_complex;
use rustfft::num_complex::Complex;

use proto::radar::SPEED_OF_LIGHT_M_PER_S;

use super::drift::{self, Backgrounds};
use super::{Gates, MIN_BACKGROUND_S};
use crate::imaging::compress::Profiles;
use crate::imaging::single;

/// Standard deviations of the averaged activity that noise alone does not reach.
const LIVE_SIGMAS: f64 = 5.0;
/// What a gate learned in less than this many times the shortest background, before it became live,
/// may have been the one who makes it live.
const PROVISIONAL_TIMES: f64 = 2.0;
/// A sweep this many times stronger or weaker than what is known is no sweep of this scene.
const OUTLIER_POWER_RATIO: f64 = 1000.0;
/// Time over which activity is averaged, in `T_fast`.
const ACTIVITY_FAST_TIMES: f64 = 2.0;
/// A gate stays live for this long, in `T_fast`: one may hold his breath.
const HOLD_FAST_TIMES: f64 = 2.0;
/// What is live reaches this far into gates that seem quiet, metres of range: half of the main lobe
/// of a point and half of a person.
const LIVE_MARGIN_M: f64 = 0.3;
/// History for the ghost test reaches back this far, in `T_fast`.
const HISTORY_FAST_TIMES: f64 = 2.0;
/// Frames in the history, at most.
const MAX_HISTORY_FRAMES: usize = 32;

/// The two backgrounds and what was seen lately.
#[derive(Clone, Debug)]
pub struct SlowFast {
    fast_s: f64,
    slow_s: f64,
    gates: Gates,
    fast: Vec<Complex<f32>>,
    slow: Vec<Complex<f32>>,
    sweep_count: usize,
    age_s: f64,
    was_given: bool,
    noise_power: f64,
    of_gate: PerGate,
    /// The change of each channel's gain since the start.
    gains: Vec<Complex<f64>>,
    changes: Vec<Complex<f32>>,
    history: History,
}

/// What is kept for each range gate.
#[derive(Clone, Debug, Default)]
struct PerGate {
    energy: Vec<f32>,
    sorted: Vec<f32>,
    activity: Vec<f32>,
    quiet_from_s: Vec<f64>,
    learned_s: Vec<f32>,
    /// How much live gates tell of drift; 0 for quiet ones.
    live_weight: Vec<f32>,
    rate: Vec<f32>,
}

/// The newest profiles, their drift undone.
#[derive(Clone, Debug, Default)]
pub struct History {
    frames: Vec<(f64, Vec<Complex<f32>>)>,
    newest: usize,
    window_s: f64,
}

impl SlowFast {
    pub(super) fn new(fast_s: f64, slow_s: f64, gates: Gates) -> Self {
        Self {
            fast_s,
            slow_s,
            gates,
            fast: Vec::new(),
            slow: Vec::new(),
            sweep_count: 0,
            age_s: 0.0,
            was_given: false,
            noise_power: 0.0,
            of_gate: PerGate::default(),
            gains: Vec::new(),
            changes: Vec::new(),
            history: History { window_s: HISTORY_FAST_TIMES * fast_s, ..History::default() },
        }
    }

    /// Begins with the background of an empty room, as if learned for `T_slow`.
    pub(super) fn start_from(&mut self, empty: &Profiles) {
        self.reserve(empty);
        self.slow.clone_from(&empty.samples);
        self.of_gate.learned_s.fill(single(self.slow_s));
        self.was_given = true;
    }

    /// Whether the background was given and not learned.
    #[must_use]
    pub fn was_given(&self) -> bool {
        self.was_given
    }

    /// The newest profiles, their drift undone.
    #[must_use]
    pub fn history(&self) -> &History {
        &self.history
    }

    /// Noise power of a sample of the profiles.
    #[must_use]
    pub fn noise_power(&self) -> f64 {
        self.noise_power
    }

    /// Noise power of the sum of all channels of a frame of the history, whose drift is undone.
    #[must_use]
    pub fn history_noise_power(&self) -> f64 {
        let undone = |gain: &Complex<f64>| self.noise_power / gain.norm_sqr();
        self.gains.iter().map(undone).sum()
    }

    /// `T_fast`, seconds.
    #[must_use]
    pub fn fast_s(&self) -> f64 {
        self.fast_s
    }

    /// How long the gate at `delay` samples has learned, seconds; 0 beyond the kept ones.
    #[must_use]
    pub fn learned_s(&self, delay: usize) -> f64 {
        self.of_gate.learned_s.get(delay).map_or(0.0, |learned_s| f64::from(*learned_s))
    }

    /// Keeps the gates within 0.3 m of the one at `delay` samples from learning until `until_s`.
    pub fn hold(&mut self, delay: usize, until_s: f64, sample_rate_hz: f64) {
        self.of_gate.hold(delay, until_s, samples_in(LIVE_MARGIN_M, sample_rate_hz));
    }

    /// Whether a sweep is so much stronger or weaker than what is known that it cannot be of the same
    /// scene, and is not merely scaled either.
    pub(super) fn is_outlier(&self, profiles: &Profiles) -> bool {
        if self.sweep_count < 2 || self.fast.len() != profiles.samples.len() {
            return false;
        }
        let power = |samples: &[Complex<f32>]| -> f64 {
            samples.iter().map(|x| f64::from(x.norm_sqr())).sum()
        };
        let known = power(&self.fast) + self.noise_power * self.fast.len() as f64;
        let now = power(&profiles.samples);
        let is_far = known * OUTLIER_POWER_RATIO < now || now * OUTLIER_POWER_RATIO < known;
        let fasts = self.fast.chunks_exact(profiles.sample_count);
        let grain = self.grain();
        let mut pairs = profiles.channels().zip(fasts);
        let mut is_step = || pairs.all(|(x, f)| drift::step(x, f, &grain).is_some());
        is_far && !is_step()
    }

    /// Subtracts the slow background from `profiles` and learns.
    pub(super) fn cancel(&mut self, time_s: f64, elapsed_s: f64, profiles: &mut Profiles) {
        self.reserve(profiles);
        if self.sweep_count == 0 {
            self.fast.clone_from(&profiles.samples);
            if !self.was_given {
                self.slow.clone_from(&profiles.samples);
            }
        }
        self.follow_steps(profiles);
        self.follow_drift(profiles);
        self.history.push(time_s, profiles, &self.gains);
        self.update_fast(elapsed_s, profiles);
        self.measure_noise(elapsed_s, profiles);
        self.age_s += elapsed_s;
        self.update_gates(time_s, elapsed_s, profiles.sample_rate_hz);
        self.update_slow(profiles);
        self.sweep_count += 1;
    }

    fn reserve(&mut self, profiles: &Profiles) {
        let (gate_count, count) = (profiles.sample_count, profiles.samples.len());
        let channel_count = count / gate_count.max(1);
        if self.slow.len() == count {
            return;
        }
        self.fast.resize(count, Complex::default());
        self.slow.resize(count, Complex::default());
        self.gains = vec![Complex::new(1.0, 0.0); channel_count];
        self.changes = vec![Complex::default(); channel_count];
        self.of_gate = PerGate {
            energy: vec![0.0; gate_count],
            sorted: vec![0.0; gate_count],
            activity: vec![1.0; gate_count],
            quiet_from_s: vec![f64::NEG_INFINITY; gate_count],
            learned_s: vec![0.0; gate_count],
            live_weight: vec![0.0; gate_count],
            rate: vec![0.0; gate_count],
        };
    }

    fn grain(&self) -> drift::Grain {
        drift::Grain { noise_power: self.noise_power, per_cell: self.gates.per_cell }
    }

    /// Scales the backgrounds of channels whose gain or phase made a step.
    fn follow_steps(&mut self, profiles: &Profiles) {
        let gate_count = profiles.sample_count.max(1);
        let grain = self.grain();
        let mut power_change = 0.0;
        let channel_count = self.gains.len() as f64;
        let backgrounds =
            self.fast.chunks_exact_mut(gate_count).zip(self.slow.chunks_exact_mut(gate_count));
        for ((samples, (fast, slow)), gain) in
            profiles.channels().zip(backgrounds).zip(&mut self.gains)
        {
            let step = drift::step(samples, fast, &grain);
            power_change += step.map_or(1.0, |step| step.norm_sqr()) / channel_count;
            let Some(step) = step else { continue };
            *gain *= step;
            let scale = single_complex(step);
            fast.iter_mut().chain(slow).for_each(|b| *b *= scale);
        }
        self.noise_power *= power_change;
    }

    fn follow_drift(&mut self, profiles: &Profiles) {
        self.changes.fill(Complex::default());
        // Without noise power nothing is known of how sure a change would be.
        if self.noise_power <= 0.0 {
            return;
        }
        let doubt = drift::doubt(self.noise_power, self.gates.per_cell);
        let gate_count = profiles.sample_count;
        for (channel, samples) in profiles.channels().enumerate() {
            let part = channel * gate_count..(channel + 1) * gate_count;
            let known = Backgrounds {
                slow: &self.slow[part.clone()],
                fast: &self.fast[part],
                live_weight: &self.of_gate.live_weight,
            };
            let change = drift::gain_change(samples, &known, doubt);
            self.gains[channel] *= change + 1.0;
            self.changes[channel] = single_complex(change);
        }
    }

    /// Updates the fast background and the energy of what differs from it in each gate.
    fn update_fast(&mut self, elapsed_s: f64, profiles: &Profiles) {
        let mean = self.sweep_count as f64 / (self.sweep_count + 1) as f64;
        let learn = single(1.0 - (-elapsed_s / self.fast_s).exp().min(mean));
        self.of_gate.energy.fill(0.0);
        let fasts = self.fast.chunks_exact_mut(profiles.sample_count).zip(&self.changes);
        for (samples, (fast, change)) in profiles.channels().zip(fasts) {
            for ((x, f), energy) in samples.iter().zip(fast).zip(&mut self.of_gate.energy) {
                let expected = *f + *f * change;
                let rest = x - expected;
                *energy += rest.norm_sqr();
                *f = expected + rest * learn;
            }
        }
    }

    /// The noise power by the median over the gates, averaged over `T_fast`.
    fn measure_noise(&mut self, elapsed_s: f64, profiles: &Profiles) {
        let sorted = &mut self.of_gate.sorted;
        sorted.copy_from_slice(&self.of_gate.energy);
        if sorted.is_empty() || self.sweep_count == 0 {
            return;
        }
        let middle = sorted.len() / 2;
        let (_, median, _) = sorted.select_nth_unstable_by(middle, f32::total_cmp);
        let channels = (profiles.samples.len() / profiles.sample_count) as f64;
        let newest = f64::from(*median) / (channels - 1.0 / 3.0 + 8.0 / (405.0 * channels));
        let count = (self.sweep_count - 1) as f64;
        let keep = (-elapsed_s / self.fast_s).exp().min(count / (count + 1.0));
        self.noise_power += (1.0 - keep) * (newest - self.noise_power);
    }

    /// Which gates are live, and how much each may learn.
    fn update_gates(&mut self, time_s: f64, elapsed_s: f64, sample_rate_hz: f64) {
        let channel_noise = self.noise_power * self.gains.len() as f64;
        let per_noise = single(channel_noise).max(f32::MIN_POSITIVE).recip();
        let newest = 1.0 - (-elapsed_s / (ACTIVITY_FAST_TIMES * self.fast_s)).exp();
        let Limits { live_activity, max_activity } = Limits::of(self.gains.len(), newest);
        let newest = single(newest);
        let quiet_from_s = time_s + HOLD_FAST_TIMES * self.fast_s;
        let margin = samples_in(LIVE_MARGIN_M, sample_rate_hz);
        let young = self.age_s < MIN_BACKGROUND_S && !self.was_given;
        let gates = &mut self.of_gate;
        for n in 0..gates.energy.len() {
            let seen = gates.energy[n] * per_noise;
            gates.activity[n] += newest * (seen.min(max_activity) - gates.activity[n]);
            // One who comes through a door at once is not learned until his gates are live.
            if max_activity < seen {
                gates.hold(n, time_s + elapsed_s, margin);
            }
            if live_activity < gates.activity[n] {
                gates.hold(n, quiet_from_s, margin);
            }
        }
        let (elapsed, slow) = (single(elapsed_s), single(self.slow_s));
        let provisional = single(PROVISIONAL_TIMES * MIN_BACKGROUND_S);
        for n in 0..gates.energy.len() {
            let is_live = time_s < gates.quiet_from_s[n];
            let doubt = (gates.energy[n] * per_noise).max(1.0);
            if is_live && gates.learned_s[n] < provisional && !self.was_given {
                gates.learned_s[n] = 0.0;
            }
            gates.live_weight[n] = if is_live { (doubt * doubt).recip() } else { 0.0 };
            let learns = young || !is_live;
            gates.learned_s[n] += if learns { elapsed } else { 0.0 };
            let memory_s = (gates.learned_s[n] + elapsed).min(slow).max(elapsed);
            gates.rate[n] = if learns && 0.0 < elapsed { elapsed / memory_s } else { 0.0 };
        }
    }

    fn update_slow(&mut self, profiles: &mut Profiles) {
        let gate_count = profiles.sample_count;
        let slows = self.slow.chunks_exact_mut(gate_count).zip(&self.changes);
        for (samples, (slow, change)) in profiles.samples.chunks_exact_mut(gate_count).zip(slows) {
            for ((x, b), rate) in samples.iter_mut().zip(slow).zip(&self.of_gate.rate) {
                let expected = *b + *b * change;
                *x -= expected;
                *b = expected + *x * rate;
            }
        }
    }
}

/// What activity noise alone does not reach.
struct Limits {
    /// Of the average.
    live_activity: f32,
    /// Of one sweep; more adds no more, or it would keep a gate live long after its walker.
    max_activity: f32,
}

impl Limits {
    /// For the mean energy of `channel_count` channels, of which each sweep enters the average with
    /// the share `newest`.
    fn of(channel_count: usize, newest: f64) -> Self {
        let channels = channel_count.max(1) as f64;
        let sigma = (newest / (2.0 - newest) / channels).sqrt();
        Self {
            live_activity: single(1.0 + LIVE_SIGMAS * sigma),
            // The tail of the gamma distribution at some 1e-4 for 1 to 8 channels.
            max_activity: single(1.0 + 4.0 / channels.sqrt() + 4.7 / channels),
        }
    }
}

impl PerGate {
    /// Keeps the gates within `margin` of `n` from learning until `until_s` at least.
    fn hold(&mut self, n: usize, until_s: f64, margin: usize) {
        let to = (n + margin + 1).min(self.quiet_from_s.len());
        let from = n.saturating_sub(margin).min(to);
        for quiet_from_s in &mut self.quiet_from_s[from..to] {
            *quiet_from_s = quiet_from_s.max(until_s);
        }
    }
}

impl History {
    /// The frames of the last `2 T_fast` in no particular order: time in seconds and the samples of
    /// all channels.
    pub fn frames(&self) -> impl Iterator<Item = (f64, &[Complex<f32>])> {
        let newest_s = self.frames.get(self.newest).map_or(0.0, |frame| frame.0);
        let window_s = self.window_s;
        let is_new = move |frame: &&(f64, Vec<Complex<f32>>)| newest_s - frame.0 <= window_s;
        self.frames.iter().filter(is_new).map(|(time_s, samples)| (*time_s, samples.as_slice()))
    }

    /// Takes `profiles` in, each channel divided by its gain, in place of the oldest frame.
    fn push(&mut self, time_s: f64, profiles: &Profiles, gains: &[Complex<f64>]) {
        let spacing_s = self.window_s / (MAX_HISTORY_FRAMES - 1) as f64;
        let before = (self.newest + MAX_HISTORY_FRAMES - 1) % MAX_HISTORY_FRAMES;
        // At high rates the newest frame is replaced until the one before it is old enough.
        let crowded = self.frames.get(before).is_some_and(|frame| {
            let since_s = time_s - frame.0;
            (0.0..spacing_s).contains(&since_s)
        });
        if !self.frames.is_empty() && !crowded {
            self.newest = (self.newest + 1) % MAX_HISTORY_FRAMES;
        }
        if self.frames.len() <= self.newest {
            self.frames.push((time_s, Vec::new()));
        }
        let (frame_s, samples) = &mut self.frames[self.newest];
        *frame_s = time_s;
        samples.clear();
        for (channel, gain) in profiles.channels().zip(gains) {
            let undo = single_complex(gain.inv());
            samples.extend(channel.iter().map(|x| x * undo));
        }
    }
}

/// Whole samples of `range_m` metres of range, there and back.
#[expect(clippy::cast_possible_truncation, reason = "some ten samples")]
fn samples_in(range_m: f64, sample_rate_hz: f64) -> usize {
    (2.0 * range_m / SPEED_OF_LIGHT_M_PER_S * sample_rate_hz).ceil().clamp(0.0, 1e6) as usize
}

#[cfg(test)]
mod tests;
