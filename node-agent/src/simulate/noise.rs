//! What spoils the sweeps of a simulated node: noise, coupling, missed targets and false ones.
//!
//! A profile is the mean over the `K` frequencies, so that white noise of power `v` per frequency
//! leaves `v / K` in it; with the amplitude `A` of the strongest target:
//! `in_band`: `v = K A² / SNR`, the SNR of the compressed profile of each channel.
//! `per_profile_sample`: white noise of power `A² / SNR` on each of the `N` samples of a profile
//! padded with zeros \[registration, section 3\]. Only the share `K/N` of it lies in the band and
//! can be in a sweep: `v = K² A² / (N SNR)`, an SNR in the band that is `N/K` times higher.

use crate::imaging::from_db;
use serde::{Deserialize, Serialize};

use crate::imaging::{InvalidSetting, invalid};

use super::coupling::Coupling;
use super::receiver::{GainDrift, PhaseNoise};

/// How much noise.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Noise {
    /// None.
    #[default]
    None,
    /// White noise in the band.
    InBand {
        /// Peak power of the strongest target's profile over the noise power in it, each channel.
        snr_db: f64,
    },
    /// White noise on the padded profile, the literal reading of the seed.
    PerProfileSample {
        /// The same ratio, with the noise of all `fft_length` samples.
        snr_db: f64,
        /// Samples of the padded profile.
        fft_length: usize,
    },
}

impl Noise {
    /// Noise power of one frequency sample, if the strongest target has `amplitude`.
    #[must_use]
    pub fn power_per_frequency(&self, amplitude: f64, step_count: usize) -> f64 {
        let count = step_count as f64;
        match self {
            Self::None => 0.0,
            Self::InBand { snr_db } => count * amplitude.powi(2) * from_db(-snr_db),
            Self::PerProfileSample { snr_db, fft_length } => {
                count.powi(2) / *fft_length as f64 * amplitude.powi(2) * from_db(-snr_db)
            }
        }
    }
}

/// What spoils the sweeps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Disturbance {
    /// The receivers' noise.
    pub noise: Noise,
    /// Chance that a node sees a target in a period, drawn for each on its own.
    pub detection_probability: f64,
    /// Chance that a node sees something in a period that is not there.
    pub false_point_probability: f64,
    /// What the antennas couple directly; nothing without it.
    pub coupling: Option<Coupling>,
    /// How the phase wanders.
    pub phase_noise: PhaseNoise,
    /// How the gain drifts.
    pub gain_drift: GainDrift,
}

impl Default for Disturbance {
    fn default() -> Self {
        Self {
            noise: Noise::None,
            detection_probability: 1.0,
            false_point_probability: 0.0,
            coupling: None,
            phase_noise: PhaseNoise::default(),
            gain_drift: GainDrift::default(),
        }
    }
}

impl Disturbance {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), InvalidSetting> {
        for (field, value) in [
            ("detection_probability", self.detection_probability),
            ("false_point_probability", self.false_point_probability),
        ] {
            if !(0.0..=1.0).contains(&value) {
                return Err(invalid(field, value, "use 0 to 1"));
            }
        }
        self.phase_noise.check()?;
        self.gain_drift.check()?;
        if let Some(coupling) = &self.coupling {
            coupling.check()?;
        }
        match self.noise {
            Noise::InBand { snr_db } | Noise::PerProfileSample { snr_db, .. }
                if !(-100.0..=200.0).contains(&snr_db) =>
            {
                Err(invalid("noise.snr_db", snr_db, "use -100 to 200 dB"))
            }
            Noise::PerProfileSample { fft_length: 0, .. } => {
                Err(invalid("noise.fft_length", 0, "use the length of the padded profile, 2048"))
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_literal_reading_has_more_snr_in_the_band_by_the_padding() {
        let in_band = Noise::InBand { snr_db: 10.0 }.power_per_frequency(2.0, 301);
        assert!((in_band - 301.0 * 4.0 / 10.0).abs() < 1e-9);
        let literal = Noise::PerProfileSample { snr_db: 10.0, fft_length: 3010 }
            .power_per_frequency(2.0, 301);
        assert!((in_band / literal - 10.0).abs() < 1e-9);
        assert!(Noise::None.power_per_frequency(2.0, 301).abs() < f64::MIN_POSITIVE);
    }

    #[test]
    fn disturbances_of_nonsense_are_named_and_unknown_keys_refused() {
        let text = "noise = { per_profile_sample = { snr_db = 8.0, fft_length = 2048 } }";
        let good: Disturbance = toml::from_str(text).unwrap();
        assert_eq!(good.check(), Ok(()));
        assert!(
            toml::from_str::<Disturbance>("noise = { in_band = { snr_db = 8.0, x = 1 } }").is_err()
        );
        let field = |bad: Disturbance| bad.check().unwrap_err().field;
        assert_eq!(
            field(Disturbance { detection_probability: 1.5, ..good }),
            "detection_probability"
        );
        let false_point = Disturbance { false_point_probability: f64::NAN, ..good };
        assert_eq!(field(false_point), "false_point_probability");
        let silent = Noise::InBand { snr_db: f64::INFINITY };
        assert_eq!(field(Disturbance { noise: silent, ..good }), "noise.snr_db");
        let empty = Noise::PerProfileSample { snr_db: 8.0, fft_length: 0 };
        assert_eq!(field(Disturbance { noise: empty, ..good }), "noise.fft_length");
        let coupled = |coupling| field(Disturbance { coupling: Some(coupling), ..good });
        let usual = Coupling::default();
        let loud = Coupling { above_target_db: 1e3, ..usual };
        assert_eq!(coupled(loud), "coupling.above_target_db");
        assert_eq!(coupled(Coupling { spread_db: -1.0, ..usual }), "coupling.spread_db");
        let early = Coupling { internal_delay_s: -1e-9, ..usual };
        assert_eq!(coupled(early), "coupling.internal_delay_s");
        assert_eq!(coupled(Coupling { ripple_db: f64::NAN, ..usual }), "coupling.ripple_db");
        assert_eq!(coupled(Coupling { ripple_count: 101, ..usual }), "coupling.ripple_count");
        let wild = PhaseNoise { common_rad: -1.0, ..PhaseNoise::default() };
        assert_eq!(field(Disturbance { phase_noise: wild, ..good }), "phase_noise.common_rad");
        let sudden = GainDrift { correlation_s: 0.0, ..GainDrift::default() };
        assert_eq!(field(Disturbance { gain_drift: sudden, ..good }), "gain_drift.correlation_s");
    }
}
