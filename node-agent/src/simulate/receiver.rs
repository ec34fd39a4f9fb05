//! What a receiver does to a whole sweep: its phase wanders and its gain drifts.
//!
//! Every sample of a channel is multiplied by
//! `10^(G(t)/20) exp(j (common n_k + channel n_kc + walk W(t)))`: `n` normal numbers of the period
//! and of the channel, `W` Brownian motion, `G(t) = trend t/60 + rms F(t/correlation)` in decibels
//! with a smooth `F` of variance 1.

use crate::imaging::from_db;
use rustfft::num_complex::Complex;
use serde::{Deserialize, Serialize};

use crate::imaging::{InvalidSetting, invalid};

use super::fading::{Fading, brownian};
use super::streams::{Moment, Purpose, Streams};

/// How the phase wanders.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PhaseNoise {
    /// From sweep to sweep, all channels together: standard deviation, radians.
    pub common_rad: f64,
    /// From sweep to sweep, every channel on its own: standard deviation, radians.
    pub channel_rad: f64,
    /// Slowly, all channels together: standard deviation after one second, radians.
    pub walk_rad_per_sqrt_s: f64,
}

/// How the gain drifts, all channels together.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GainDrift {
    /// Steady change, decibels per minute.
    pub trend_db_per_min: f64,
    /// Standard deviation of the rest, decibels.
    pub rms_db: f64,
    /// Time over which the rest changes, seconds.
    pub correlation_s: f64,
}

impl Default for GainDrift {
    fn default() -> Self {
        Self { trend_db_per_min: 0.0, rms_db: 0.0, correlation_s: 60.0 }
    }
}

impl PhaseNoise {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), InvalidSetting> {
        for (field, value) in [
            ("phase_noise.common_rad", self.common_rad),
            ("phase_noise.channel_rad", self.channel_rad),
            ("phase_noise.walk_rad_per_sqrt_s", self.walk_rad_per_sqrt_s),
        ] {
            if !(0.0..=100.0).contains(&value) {
                return Err(invalid(field, value, "use 0 to 100 radians"));
            }
        }
        Ok(())
    }
}

impl GainDrift {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), InvalidSetting> {
        if !(-60.0..=60.0).contains(&self.trend_db_per_min) {
            let field = "gain_drift.trend_db_per_min";
            return Err(invalid(field, self.trend_db_per_min, "use -60 to 60 dB per minute"));
        }
        if !(0.0..=20.0).contains(&self.rms_db) {
            return Err(invalid("gain_drift.rms_db", self.rms_db, "use 0 to 20 dB"));
        }
        if !(1e-3..=1e9).contains(&self.correlation_s) {
            let field = "gain_drift.correlation_s";
            return Err(invalid(field, self.correlation_s, "use 0.001 to 1e9 s"));
        }
        Ok(())
    }
}

/// The factors of the channels at `moment`; none if the receiver is steady.
pub(super) fn factors(
    phase: &PhaseNoise,
    gain: &GainDrift,
    streams: &Streams,
    moment: Moment,
    channel_count: usize,
) -> Option<Vec<Complex<f64>>> {
    let settings = [
        phase.common_rad,
        phase.channel_rad,
        phase.walk_rad_per_sqrt_s,
        gain.trend_db_per_min.abs(),
        gain.rms_db,
    ];
    if settings.iter().all(|value| *value <= 0.0) {
        return None;
    }
    let Moment { period_index, time_s } = moment;
    let walk = brownian(time_s, |index| streams.normal(Purpose::PhaseWalk, 0, index));
    let fading = Fading::new(&mut streams.rng(Purpose::GainDrift, 0, 0));
    let gain_db = gain.trend_db_per_min * time_s / 60.0
        + gain.rms_db * fading.real_at(time_s / gain.correlation_s);
    let common = phase.common_rad * streams.normal(Purpose::CommonPhase, 0, period_index)
        + phase.walk_rad_per_sqrt_s * walk;
    let of_channel = |channel| {
        let own = streams.normal(Purpose::ChannelPhase, channel, period_index);
        Complex::from_polar(from_db(gain_db).sqrt(), common + phase.channel_rad * own)
    };
    Some((0..channel_count).map(of_channel).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(phase: &PhaseNoise, gain: &GainDrift, seed: u64, moment: Moment) -> Vec<Complex<f64>> {
        factors(phase, gain, &Streams::new(seed), moment, 8).unwrap()
    }

    #[test]
    fn phases_and_gains_have_the_spreads_asked_for() {
        let phase = PhaseNoise { common_rad: 0.02, channel_rad: 0.01, walk_rad_per_sqrt_s: 0.03 };
        let gain = GainDrift { trend_db_per_min: 0.6, rms_db: 0.2, correlation_s: 30.0 };
        let (mut own, mut mean, mut drift) = (0.0, 0.0, 0.0);
        let count = 2000_u32;
        for seed in 0..u64::from(count) {
            let moment = Moment { period_index: 7, time_s: 4.0 };
            let all = at(&phase, &gain, seed, moment);
            let middle = all.iter().map(|f| f.arg()).sum::<f64>() / 8.0;
            mean += middle * middle;
            own += all.iter().map(|f| (f.arg() - middle).powi(2)).sum::<f64>() / 7.0;
            drift += (20.0 * all[0].norm().log10() - 0.04).powi(2);
        }
        let rms = |sum: f64| (sum / f64::from(count)).sqrt();
        // 2000 squares: 5 σ of a root are 8 %.
        assert!((rms(own) / 0.01 - 1.0).abs() < 0.03, "{}", rms(own));
        // 0.02, 0.03 sqrt(4 s) and 0.01 sqrt(1/8).
        assert!((rms(mean) / 0.0633 - 1.0).abs() < 0.08, "{}", rms(mean));
        assert!((rms(drift) / 0.2 - 1.0).abs() < 0.08, "{}", rms(drift));
    }

    #[test]
    fn the_trend_is_per_minute_and_a_steady_receiver_leaves_sweeps_alone() {
        let trend = GainDrift { trend_db_per_min: -0.5, ..GainDrift::default() };
        let late = Moment { period_index: 0, time_s: 120.0 };
        let factor = at(&PhaseNoise::default(), &trend, 1, late)[3];
        assert!((20.0 * factor.norm().log10() + 1.0).abs() < 1e-9 && factor.arg().abs() < 1e-12);
        let steady = (PhaseNoise::default(), GainDrift::default());
        assert!(factors(&steady.0, &steady.1, &Streams::new(1), late, 8).is_none());
    }

    #[test]
    fn nonsense_is_named() {
        let phase = PhaseNoise::default();
        let field = |bad: PhaseNoise| bad.check().unwrap_err().field;
        assert_eq!(field(PhaseNoise { common_rad: -1.0, ..phase }), "phase_noise.common_rad");
        let wild = PhaseNoise { channel_rad: f64::NAN, ..phase };
        assert_eq!(field(wild), "phase_noise.channel_rad");
        let lost = PhaseNoise { walk_rad_per_sqrt_s: 1e9, ..phase };
        assert_eq!(field(lost), "phase_noise.walk_rad_per_sqrt_s");
        let drift = GainDrift::default();
        let drift_field = |bad: GainDrift| bad.check().unwrap_err().field;
        let steep = GainDrift { trend_db_per_min: f64::INFINITY, ..drift };
        assert_eq!(drift_field(steep), "gain_drift.trend_db_per_min");
        assert_eq!(drift_field(GainDrift { rms_db: -0.1, ..drift }), "gain_drift.rms_db");
        let sudden = GainDrift { correlation_s: 0.0, ..drift };
        assert_eq!(drift_field(sudden), "gain_drift.correlation_s");
    }
}
