//! The antennas' direct coupling: what goes from a transmitter to a receiver past the room.
//!
//! `C_tr(f) = A_tr exp(−j 2π f τ_tr) [1 + Σ_i ρ_i exp(−j (2π f θ_i + φ_i))]`: the way between the
//! antennas plus one inside the radio, and a few weaker copies, delays `θ_i` of 1 to 10 ns, which
//! make ripples over the band. `A_tr`, `θ_i` and `φ_i` are drawn for every channel and stay.

use crate::imaging::from_db;
use std::f64::consts::TAU;

use rand::RngExt;
use rustfft::num_complex::Complex;
use serde::{Deserialize, Serialize};

use proto::radar::SPEED_OF_LIGHT_M_PER_S;

use crate::imaging::{InvalidSetting, invalid};

use super::streams::{Purpose, Streams};

/// Delays of the copies that make ripples, seconds.
const RIPPLE_DELAY_S: (f64, f64) = (1e-9, 10e-9);

/// How strongly antennas couple.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Coupling {
    /// Power over that of the strongest target's echo, middle of the channels, decibels.
    pub above_target_db: f64,
    /// Channels differ from the middle by up to this, decibels.
    pub spread_db: f64,
    /// Delay inside the radio, on top of that between the antennas, seconds.
    pub internal_delay_s: f64,
    /// Largest deviation of the amplitude over the band, decibels.
    pub ripple_db: f64,
    /// Number of weaker copies that make it.
    pub ripple_count: usize,
}

impl Default for Coupling {
    fn default() -> Self {
        Self {
            above_target_db: 60.0,
            spread_db: 5.0,
            internal_delay_s: 1e-9,
            ripple_db: 1.0,
            ripple_count: 3,
        }
    }
}

/// One wave of a channel's coupling.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wave {
    pub(super) path_m: f64,
    pub(super) gain: Complex<f64>,
}

impl Coupling {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), InvalidSetting> {
        for (field, value, range, remedy) in [
            ("above_target_db", self.above_target_db, -200.0..=200.0, "use -200 to 200 dB"),
            ("spread_db", self.spread_db, 0.0..=40.0, "use 0 to 40 dB"),
            ("internal_delay_s", self.internal_delay_s, 0.0..=1e-6, "use 0 to 1e-6 s"),
            ("ripple_db", self.ripple_db, 0.0..=5.0, "use 0 to 5 dB"),
        ] {
            if !range.contains(&value) {
                return Err(invalid(format!("coupling.{field}"), value, remedy));
            }
        }
        if 100 < self.ripple_count {
            return Err(invalid("coupling.ripple_count", self.ripple_count, "use 0 to 100"));
        }
        Ok(())
    }

    /// The waves of `channel`, whose antennas are `distance_m` apart, if the strongest target's
    /// echo has the amplitude `reference`.
    pub(super) fn waves(
        &self,
        channel: usize,
        distance_m: f64,
        reference: f64,
        streams: &Streams,
    ) -> Vec<Wave> {
        let mut rng = streams.rng(Purpose::Coupling, channel, 0);
        let level_db = self.above_target_db + self.spread_db * (2.0 * rng.random::<f64>() - 1.0);
        let amplitude = reference * from_db(level_db).sqrt();
        let direct_m = distance_m + self.internal_delay_s * SPEED_OF_LIGHT_M_PER_S;
        let copy = (from_db(self.ripple_db).sqrt() - 1.0) / self.ripple_count.max(1) as f64;
        let mut waves = vec![Wave { path_m: direct_m, gain: Complex::from(amplitude) }];
        for _ in 0..self.ripple_count {
            let delay_s = rng.random_range(RIPPLE_DELAY_S.0..RIPPLE_DELAY_S.1);
            let turn = Complex::cis(-TAU * rng.random::<f64>());
            let path_m = direct_m + delay_s * SPEED_OF_LIGHT_M_PER_S;
            waves.push(Wave { path_m, gain: turn * (amplitude * copy) });
        }
        waves
    }
}
