//! Settings of the default tracker, for people and for wide areas.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// A way of moving: the velocity lasts, and is pushed by white noise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Way {
    /// How strongly the velocity is pushed on each axis, m²/s³.
    pub push_m2_per_s3: f64,
    /// How long a push lasts, seconds: over a step `Δt` the intensity counts `1 − exp(−Δt/push_s)`
    /// of itself, for turns take seconds; 0 if pushes are white.
    pub push_s: f64,
    /// How long the velocity lasts, seconds; `inf` if it does not fade.
    pub memory_s: f64,
    /// How long a target moves that way, seconds.
    pub sojourn_s: f64,
}

/// Settings of the default tracker; [`DefaultConfig::wide_area`] are the defaults.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DefaultConfig {
    /// Straight on.
    pub steady: Way,
    /// Turning, starting and stopping.
    pub lively: Way,
    /// Standard deviation of a new target's velocity on each axis, metres per second.
    pub new_speed_m_per_s: f64,
    /// A plot whose place is farther from what is expected is no candidate: squared Mahalanobis
    /// distance of two dimensions.
    pub gate_distance2: f64,
    /// False plots per square metre are never thought fewer than this.
    pub min_clutter_per_m2: f64,
    /// False plots have radial velocities spread over so much, metres per second.
    pub clutter_radial_span_m_per_s: f64,
    /// False plots have strengths spread over so much, decibels.
    pub clutter_strength_span_db: f64,
    /// How much a target's strength varies from plot to plot, before its own is known, decibels.
    pub strength_sigma_db: f64,
    /// That counts as much as so many plots.
    pub strength_prior_count: f64,
    /// A target's strength is remembered over so many plots.
    pub strength_memory_count: f64,
    /// What a track pays for a plot beyond its likelihood, nats: one taken wrongly makes two links
    /// wrong and misleads the track, one left wrongly makes one link less. At most `ln` of how many
    /// times [`DefaultConfig::min_clutter_per_m2`] the false plots are.
    pub plot_bias_nats: f64,
    /// What a tentative track pays more for a plot than a confirmed one, nats.
    pub tentative_bias_nats: f64,
    /// Logarithm of the odds of a track with one plot.
    pub new_log_odds: f64,
    /// A track is confirmed when so many ...
    pub confirm_hit_count: u32,
    /// ... of so many looks at it had a plot, at most 32, ...
    pub confirm_look_count: u32,
    /// ... and its odds have this logarithm.
    pub confirm_log_odds: f64,
    /// A tentative track ends when its log odds are so far below their best.
    pub tentative_drop_nats: f64,
    /// A confirmed one.
    pub confirmed_drop_nats: f64,
    /// A confirmed track that has not been seen for so long ends, seconds; a tentative one after a
    /// quarter of it.
    pub unseen_s: f64,
    /// How often a moving target stops, per second; 0 for never. Only counts for sensors that do not
    /// see standing targets.
    pub stop_per_s: f64,
    /// How often a stopped target moves on, per second.
    pub restart_per_s: f64,
    /// Standard deviation of its velocity then on each axis, metres per second.
    pub restart_speed_m_per_s: f64,
    /// A stopped target is remembered for so long, seconds.
    pub stopped_s: f64,
    /// Where the best association is better than the next by less than this, the decision waits, nats.
    pub ambiguous_nats: f64,
    /// Hypotheses worse than the best by more are dropped, nats.
    pub keep_nats: f64,
    /// Hypotheses of a cluster of tracks at most.
    pub max_hypothesis_count: usize,
    /// Tracks of a cluster at most; larger ones decide at once.
    pub max_cluster_count: usize,
    /// Decisions wait for so many scans at most: looks at the target at different times.
    pub lag_scans: usize,
    /// Smoothed states use at least so many later looks.
    pub smoothing_looks: usize,
    /// Targets followed at most.
    pub max_track_count: usize,
    /// Steps of all tracks remembered for [`crate::tracking::Tracker::take_settled`] at most.
    pub max_step_count: usize,
}

/// A setting of the default tracker is out of its range.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("set `{key}` of the default tracker to {expected}: it is {value}")]
pub struct ConfigError {
    /// Which setting.
    pub key: &'static str,
    /// What it was.
    pub value: f64,
    /// What it must be.
    pub expected: &'static str,
}

impl Way {
    /// The intensity of pushes over a step, m²/s³.
    pub(super) fn push_over(&self, dt_s: f64) -> f64 {
        let lasts = self.push_s.max(f64::MIN_POSITIVE);
        -self.push_m2_per_s3 * (-dt_s / lasts).exp_m1()
    }
}

impl Default for DefaultConfig {
    fn default() -> Self {
        Self::wide_area()
    }
}

impl DefaultConfig {
    /// For moving-target plots of an airborne radar: seconds between looks, tens of metres.
    #[must_use]
    pub fn wide_area() -> Self {
        Self {
            steady: Way {
                push_m2_per_s3: 0.003,
                push_s: 0.0,
                memory_s: f64::INFINITY,
                sojourn_s: 150.0,
            },
            lively: Way {
                push_m2_per_s3: 65.0,
                push_s: 150.0,
                memory_s: f64::INFINITY,
                sojourn_s: 12.0,
            },
            new_speed_m_per_s: 12.0,
            gate_distance2: 20.0,
            min_clutter_per_m2: 1e-9,
            // What false plots of ±20 m/s have, and those of 12 m/s standard deviation at targets' speeds.
            clutter_radial_span_m_per_s: 40.0,
            clutter_strength_span_db: 40.0,
            strength_sigma_db: 3.0,
            strength_prior_count: 30.0,
            strength_memory_count: 40.0,
            // On 1,000 uniform targets, seeds 7, 11, 23, 31 to 33: right links go on rising with it, but at
            // 3 no track begins among 10 false plots per km² any more where there is no radial velocity.
            plot_bias_nats: 2.0,
            tentative_bias_nats: 2.0,
            new_log_odds: -1.0,
            confirm_hit_count: 3,
            confirm_look_count: 5,
            confirm_log_odds: 5.0,
            tentative_drop_nats: 4.0,
            confirmed_drop_nats: 12.0,
            unseen_s: 120.0,
            stop_per_s: 1.0 / 300.0,
            restart_per_s: 1.0 / 60.0,
            restart_speed_m_per_s: 8.0,
            stopped_s: 300.0,
            ambiguous_nats: 6.0,
            // On roads with 1,000 targets, seeds 7, 11, 23: with fewer far-fetched hypotheses larger
            // clusters cost no more. Below 8 the ten-target scene breaks a track if clutter is thought
            // three times what it is.
            keep_nats: 8.0,
            max_hypothesis_count: 30,
            max_cluster_count: 20,
            lag_scans: 6,
            smoothing_looks: 8,
            max_track_count: 100_000,
            max_step_count: 400_000,
        }
    }

    /// For people seen by registered nodes: ten looks a second of each, metres.
    #[must_use]
    pub fn people() -> Self {
        Self {
            steady: Way { push_m2_per_s3: 0.02, push_s: 0.0, memory_s: 10.0, sojourn_s: 3.0 },
            lively: Way { push_m2_per_s3: 1.5, push_s: 0.0, memory_s: 1.5, sojourn_s: 1.0 },
            new_speed_m_per_s: 0.8,
            min_clutter_per_m2: 1e-4,
            clutter_radial_span_m_per_s: 60.0,
            plot_bias_nats: 0.0,
            strength_prior_count: 30.0,
            confirm_hit_count: 6,
            confirm_look_count: 12,
            confirm_log_odds: 10.0,
            tentative_drop_nats: 5.0,
            confirmed_drop_nats: 25.0,
            unseen_s: 3.0,
            stop_per_s: 0.0,
            restart_speed_m_per_s: 0.5,
            stopped_s: 30.0,
            keep_nats: 10.0,
            max_cluster_count: 10,
            lag_scans: 4,
            smoothing_looks: 20,
            max_track_count: 200,
            max_step_count: 100_000,
            ..Self::wide_area()
        }
    }

    /// Share of the time that a target moves straight on.
    pub(super) fn steady_share(&self) -> f64 {
        self.steady.sojourn_s / (self.steady.sojourn_s + self.lively.sojourn_s)
    }

    /// Both ways of moving.
    pub(super) fn ways(&self) -> [Way; 2] {
        [self.steady, self.lively]
    }

    /// Whether every setting is in its range.
    ///
    /// # Errors
    /// The first that is not.
    pub fn check(&self) -> Result<(), ConfigError> {
        self.check_reals()?;
        self.check_counts()
    }

    fn check_reals(&self) -> Result<(), ConfigError> {
        for way in [&self.steady, &self.lively] {
            positive("push_m2_per_s3", way.push_m2_per_s3)?;
            positive("sojourn_s", way.sojourn_s)?;
            not_negative("push_s", way.push_s)?;
            if way.memory_s.is_nan() || way.memory_s <= 0.0 {
                let expected = "a number above 0, or inf";
                return Err(ConfigError { key: "memory_s", value: way.memory_s, expected });
            }
        }
        positive("new_speed_m_per_s", self.new_speed_m_per_s)?;
        positive("gate_distance2", self.gate_distance2)?;
        positive("min_clutter_per_m2", self.min_clutter_per_m2)?;
        positive("clutter_radial_span_m_per_s", self.clutter_radial_span_m_per_s)?;
        positive("clutter_strength_span_db", self.clutter_strength_span_db)?;
        positive("strength_sigma_db", self.strength_sigma_db)?;
        positive("strength_prior_count", self.strength_prior_count)?;
        positive("strength_memory_count", self.strength_memory_count)?;
        not_negative("plot_bias_nats", self.plot_bias_nats)?;
        not_negative("tentative_bias_nats", self.tentative_bias_nats)?;
        finite("new_log_odds", self.new_log_odds)?;
        finite("confirm_log_odds", self.confirm_log_odds)?;
        positive("tentative_drop_nats", self.tentative_drop_nats)?;
        positive("confirmed_drop_nats", self.confirmed_drop_nats)?;
        positive("unseen_s", self.unseen_s)?;
        not_negative("stop_per_s", self.stop_per_s)?;
        positive("restart_per_s", self.restart_per_s)?;
        positive("restart_speed_m_per_s", self.restart_speed_m_per_s)?;
        positive("stopped_s", self.stopped_s)?;
        not_negative("ambiguous_nats", self.ambiguous_nats)?;
        not_negative("keep_nats", self.keep_nats)
    }

    fn check_counts(&self) -> Result<(), ConfigError> {
        within("confirm_look_count", self.confirm_look_count as usize, 1..=32, "from 1 to 32")?;
        let looks = self.confirm_look_count as usize;
        let hits = self.confirm_hit_count as usize;
        within("confirm_hit_count", hits, 1..=looks, "from 1 to `confirm_look_count`")?;
        within("max_hypothesis_count", self.max_hypothesis_count, 1..=10_000, "from 1 to 10000")?;
        within("max_cluster_count", self.max_cluster_count, 1..=50, "from 1 to 50")?;
        within("lag_scans", self.lag_scans, 0..=50, "from 0 to 50")?;
        within("smoothing_looks", self.smoothing_looks, 0..=1000, "from 0 to 1000")?;
        within("max_track_count", self.max_track_count, 1..=10_000_000, "from 1 to 10000000")?;
        within("max_step_count", self.max_step_count, 1..=100_000_000, "from 1 to 100000000")
    }
}

fn finite(key: &'static str, value: f64) -> Result<(), ConfigError> {
    if value.is_finite() {
        return Ok(());
    }
    Err(ConfigError { key, value, expected: "a finite number" })
}

fn positive(key: &'static str, value: f64) -> Result<(), ConfigError> {
    if value.is_finite() && 0.0 < value {
        return Ok(());
    }
    Err(ConfigError { key, value, expected: "a finite number above 0" })
}

fn not_negative(key: &'static str, value: f64) -> Result<(), ConfigError> {
    if value.is_finite() && 0.0 <= value {
        return Ok(());
    }
    Err(ConfigError { key, value, expected: "a finite number of at least 0" })
}

fn within(
    key: &'static str,
    value: usize,
    range: std::ops::RangeInclusive<usize>,
    expected: &'static str,
) -> Result<(), ConfigError> {
    if range.contains(&value) {
        return Ok(());
    }
    Err(ConfigError { key, value: value as f64, expected })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_sets_pass() {
        for config in [DefaultConfig::people(), DefaultConfig::wide_area()] {
            assert_eq!(config.check(), Ok(()));
            let text = toml::to_string(&config).unwrap();
            assert_eq!(toml::from_str::<DefaultConfig>(&text).unwrap(), config);
        }
    }

    #[test]
    fn settings_out_of_range_are_named() {
        type Change = fn(&mut DefaultConfig);
        let break_one: [(&str, Change); 6] = [
            ("push_m2_per_s3", |config| config.lively.push_m2_per_s3 = 0.0),
            ("memory_s", |config| config.steady.memory_s = f64::NAN),
            ("stop_per_s", |config| config.stop_per_s = -1.0),
            ("new_log_odds", |config| config.new_log_odds = f64::INFINITY),
            ("confirm_look_count", |config| config.confirm_look_count = 33),
            ("confirm_hit_count", |config| config.confirm_hit_count = 6),
        ];
        for (key, change) in break_one {
            let mut config = DefaultConfig::default();
            change(&mut config);
            assert_eq!(config.check().unwrap_err().key, key);
        }
    }
}
