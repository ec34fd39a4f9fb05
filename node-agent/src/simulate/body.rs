//! A person with torso, arms and legs, who walks, turns, sways and breathes.
//!
//! The torso's scatterers lie in an ellipse, those of the limbs hang at the sides and swing along
//! the walk: a foot by a quarter of a gait cycle's length \[walking-model\], a hand by 0.6 of that,
//! arm and leg of a side in opposite phase. The near side is brighter. All gains are independent
//! and their mean powers add up to 1.
//! Assumes that the radar sees the person from the side: nothing happens in height.

use std::f64::consts::TAU;

use nalgebra::Vector2;
use rand::{RngExt, rngs::ChaCha8Rng};
use rustfft::num_complex::Complex;
use serde::{Deserialize, Serialize};

use crate::imaging::{InvalidSetting, invalid};

use super::fading::Fading;
use super::scene::WayPoint;
use super::streams::{Moment, Purpose, Streams, gaussian};
use super::way::{Way, cycle_m, place_m};

/// Half the depth and half the width of a torso, metres.
const TORSO_HALF_AXES_M: (f64, f64) = (0.12, 0.18);
/// How far arms hang beside the middle, metres.
const ARM_ASIDE_M: f64 = 0.22;
/// The same of legs, metres.
const LEG_ASIDE_M: f64 = 0.10;
/// A hand swings this much of what a foot does.
const ARM_SWING: f64 = 0.6;
/// A scatterer this much nearer to the node is brighter by a factor e of amplitude, metres.
const SHADE_M: f64 = 0.1;
/// Mean breathing rate and how far people are from it.
const BREATHING_HZ: (f64, f64) = (0.25, 0.03);
/// Frequencies of swaying.
const SWAY_HZ: (f64, f64) = (0.1, 0.5);
/// Tones of swaying.
const SWAY_TONE_COUNT: usize = 3;

/// How the gains of a body's scatterers change.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Fluctuation {
    /// Gaussian numbers drawn anew in every period.
    PerPeriod,
    /// Smooth functions of time and way of correlation `exp(−(Δt/time_s)² − (Δs/way_m)²)`.
    Correlated {
        /// Correlation time of a body that stands, seconds.
        time_s: f64,
        /// Correlation length along the walk, metres.
        way_m: f64,
    },
}

/// A person's body.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Body {
    /// How gains change.
    pub fluctuation: Fluctuation,
    /// Scatterers of the torso.
    pub torso_count: usize,
    /// Scatterers of each arm and leg.
    pub limb_count: usize,
    /// Share of the power that arms and legs reflect.
    pub limb_share: f64,
    /// How far the chest moves from breathing out to breathing in, metres.
    pub breathing_m: f64,
    /// Root mean square of swaying forth and back, metres; aside it is half.
    pub sway_m: f64,
    /// How long a change of velocity and a turn take, seconds; 0 for sharp corners.
    pub turn_s: f64,
}

impl Default for Body {
    fn default() -> Self {
        Self {
            fluctuation: Fluctuation::Correlated { time_s: 10.0, way_m: 0.25 },
            torso_count: 6,
            limb_count: 2,
            limb_share: 0.25,
            breathing_m: 0.005,
            sway_m: 0.005,
            turn_s: 0.8,
        }
    }
}

impl Body {
    /// Checks every field; `of` is where the body is in the configuration.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self, of: &str) -> Result<(), InvalidSetting> {
        let wrong = |field: &str, value: f64, remedy| {
            Err(invalid(format!("{of}.kind.body.{field}"), value, remedy))
        };
        if let Fluctuation::Correlated { time_s, way_m } = self.fluctuation {
            if !(1e-3..=1e9).contains(&time_s) {
                return wrong("fluctuation.time_s", time_s, "use 0.001 to 1e9 s");
            }
            if !(1e-3..=1e9).contains(&way_m) {
                return wrong("fluctuation.way_m", way_m, "use 0.001 to 1e9 m");
            }
        }
        if !(1..=1000).contains(&self.torso_count) {
            return wrong("torso_count", self.torso_count as f64, "use 1 to 1000 scatterers");
        }
        if 1000 < self.limb_count {
            return wrong("limb_count", self.limb_count as f64, "use at most 1000 scatterers");
        }
        if !(0.0..=1.0).contains(&self.limb_share) {
            return wrong("limb_share", self.limb_share, "use 0 to 1");
        }
        for (field, value) in [("breathing_m", self.breathing_m), ("sway_m", self.sway_m)] {
            if !(0.0..=0.1).contains(&value) {
                return wrong(field, value, "use 0 to 0.1 m");
            }
        }
        if !(0.0..=10.0).contains(&self.turn_s) {
            return wrong("turn_s", self.turn_s, "use 0 to 10 s");
        }
        Ok(())
    }
}

/// One scatterer of a body, in the body's frame: ahead and aside.
#[derive(Clone, Debug)]
struct Part {
    rest_m: Vector2<f64>,
    /// How it swings, in quarters of a gait cycle's length; the sign is the phase.
    swing: f64,
    /// How much it takes part in breathing.
    chest: f64,
    /// Amplitude before shading.
    weight: f64,
    fading: Fading,
}

/// A body on its way, ready to be looked at.
#[derive(Clone, Debug)]
pub(super) struct Walker {
    body: Body,
    target_index: usize,
    points: Vec<WayPoint>,
    way: Way,
    parts: Vec<Part>,
    breathing: Tone,
    sway: [Vec<Tone>; 2],
}

/// A sine of amplitude 1.
#[derive(Clone, Copy, Debug)]
struct Tone {
    hz: f64,
    phase_rad: f64,
}

impl Tone {
    fn new(rng: &mut ChaCha8Rng, from_hz: f64, to_hz: f64) -> Self {
        let hz = rng.random_range(from_hz..to_hz);
        Self { hz, phase_rad: TAU * rng.random::<f64>() }
    }

    fn at(&self, time_s: f64) -> f64 {
        (TAU * self.hz * time_s + self.phase_rad).sin()
    }
}

impl Walker {
    /// The body of target `target_index`. Its shape and phases follow from the seed.
    pub(super) fn new(
        body: &Body,
        target_index: usize,
        points: &[WayPoint],
        streams: &Streams,
    ) -> Self {
        let mut rng = streams.rng(Purpose::Sway, target_index, 0);
        let (mean_hz, spread_hz) = BREATHING_HZ;
        let breathing = Tone::new(&mut rng, mean_hz - spread_hz, mean_hz + spread_hz);
        let mut tones =
            || (0..SWAY_TONE_COUNT).map(|_| Tone::new(&mut rng, SWAY_HZ.0, SWAY_HZ.1)).collect();
        let sway = [tones(), tones()];
        let mut shape = streams.rng(Purpose::BodyShape, target_index, 0);
        let mut parts = torso(body, &mut shape);
        parts.extend(limbs(body, &mut shape));
        for (index, part) in parts.iter_mut().enumerate() {
            let mut rates = streams.rng(Purpose::BodyFading, target_index, index as u64);
            part.fading = Fading::new(&mut rates);
        }
        let way = Way::new(points, body.turn_s);
        Self { body: *body, target_index, points: points.to_vec(), way, parts, breathing, sway }
    }

    /// Where the scatterers are in the world and their gains, for a node in the direction
    /// `towards_node` (a unit vector of the world). Their mean power is 1.
    pub(super) fn scatterers(
        &self,
        moment: Moment,
        towards_node: &Vector2<f64>,
        streams: &Streams,
    ) -> Vec<(Vector2<f64>, Complex<f64>)> {
        let mut fresh = streams.rng(Purpose::BodyGain, self.target_index, moment.period_index);
        let [way_m, _] = self.way.progress(moment.time_s);
        let parts = self.parts.iter().zip(self.places(moment.time_s, towards_node));
        let mut power = 0.0;
        let mut all = Vec::with_capacity(self.parts.len());
        for (part, (place_m, amplitude)) in parts {
            power += amplitude * amplitude;
            let gain = match self.body.fluctuation {
                Fluctuation::PerPeriod => gaussian(&mut fresh),
                Fluctuation::Correlated { time_s: corr_s, way_m: corr_m } => {
                    part.fading.at(moment.time_s / corr_s, way_m / corr_m)
                }
            };
            all.push((place_m, gain * amplitude));
        }
        for (_, gain) in &mut all {
            *gain /= power.sqrt();
        }
        all
    }

    /// Where the scatterers are on average, each counted with its mean power.
    pub(super) fn shine_m(&self, time_s: f64, towards_node: &Vector2<f64>) -> Vector2<f64> {
        let mut sum_m = Vector2::zeros();
        let mut power = 0.0;
        for (place_m, amplitude) in self.places(time_s, towards_node) {
            sum_m += place_m * (amplitude * amplitude);
            power += amplitude * amplitude;
        }
        sum_m / power
    }

    /// Where the scatterers are in the world, and the roots of their mean powers before these are
    /// made to add up to 1.
    fn places(
        &self,
        time_s: f64,
        towards_node: &Vector2<f64>,
    ) -> impl Iterator<Item = (Vector2<f64>, f64)> {
        let ahead = self.way.ahead(time_s);
        let aside = Vector2::new(-ahead.y, ahead.x);
        let middle_m = place_m(&self.points, self.body.turn_s, time_s)
            + ahead * (self.body.sway_m * sum_of_tones(&self.sway[0], time_s))
            + aside * (0.5 * self.body.sway_m * sum_of_tones(&self.sway[1], time_s));
        let cycles = self.way.progress(time_s)[1];
        let swing_m = 0.25 * cycle_m(self.way.velocity(time_s).norm()) * (TAU * cycles).sin();
        let breath_m = 0.5 * self.body.breathing_m * self.breathing.at(time_s);
        self.parts.iter().map(move |part| {
            let rest_m = ahead * part.rest_m.x + aside * part.rest_m.y;
            // The swing is left out: a hand that swings towards the node does not shine.
            let amplitude = part.weight * (rest_m.dot(towards_node) / SHADE_M).exp();
            let moved_m = ahead * (part.swing * swing_m + part.chest * breath_m);
            (middle_m + rest_m + moved_m, amplitude)
        })
    }
}

/// Variance 1 over time.
fn sum_of_tones(tones: &[Tone], time_s: f64) -> f64 {
    (2.0 / tones.len() as f64).sqrt() * tones.iter().map(|tone| tone.at(time_s)).sum::<f64>()
}

fn torso(body: &Body, rng: &mut ChaCha8Rng) -> Vec<Part> {
    let share = if body.limb_count == 0 { 1.0 } else { 1.0 - body.limb_share };
    let weight = (share / body.torso_count as f64).sqrt();
    let (half_depth_m, half_width_m) = TORSO_HALF_AXES_M;
    let part = |_| {
        let (radius, angle) = (rng.random::<f64>().sqrt(), TAU * rng.random::<f64>());
        let (depth, width) = (radius * angle.cos(), radius * angle.sin());
        let rest_m = Vector2::new(half_depth_m * depth, half_width_m * width);
        Part { rest_m, swing: 0.0, chest: depth.max(0.0), weight, fading: Fading::none() }
    };
    (0..body.torso_count).map(part).collect()
}

fn limbs(body: &Body, rng: &mut ChaCha8Rng) -> Vec<Part> {
    let weight = (body.limb_share / (4 * body.limb_count).max(1) as f64).sqrt();
    let mut parts = Vec::new();
    for (aside_m, swing) in [
        (ARM_ASIDE_M, ARM_SWING),
        (-ARM_ASIDE_M, -ARM_SWING),
        (LEG_ASIDE_M, -1.0),
        (-LEG_ASIDE_M, 1.0),
    ] {
        for number in 0..body.limb_count {
            let lever = (number as f64 + rng.random::<f64>()) / body.limb_count as f64;
            let rest_m = Vector2::new(0.0, aside_m);
            let swing = swing * lever;
            parts.push(Part { rest_m, swing, chest: 0.0, weight, fading: Fading::none() });
        }
    }
    parts
}

#[cfg(test)]
mod tests;
