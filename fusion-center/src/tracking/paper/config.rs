//! The settings of the published association and its rivals.

use serde::{Deserialize, Serialize};

use crate::tracking::InvalidSetting;

/// Longest memory of a track, looks: bits of a word.
const MAX_WINDOW_COUNT: u32 = 64;
/// Looks after which a track ends, at most.
const MAX_END_COUNT: u32 = 1_000_000;

/// One number for each attribute of a plot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PerAttribute {
    /// Of the slant range.
    pub range: f64,
    /// Of the cone angle.
    pub angle: f64,
    /// Of the radial velocity.
    pub radial: f64,
    /// Of the strength.
    pub strength: f64,
}

/// Where tracks begin.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Start {
    /// With every plot that no track takes.
    #[default]
    EveryLook,
    /// With the plots of the first look only, as in experiments whose targets are all there then.
    FirstLook,
}

/// What a target's way across the line of sight is bounded by.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AcrossGate {
    /// By beam positions, as published; by nothing where they are not counted.
    Beams,
    /// Also by the cone angle, with `v_max` and `k` as in range: what beams bound, continuously.
    #[default]
    BeamsAndAngle,
}

/// What becomes of tracks that take the same plot, as they may where each decides for itself.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Sharing {
    /// The oldest goes on, the others end with the plot: without memory they would be the same from
    /// then on.
    #[default]
    OldestGoesOn,
    /// All go on, as in the published experiments.
    AllGoOn,
}

/// How the belief function method decides.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BeliefDecision {
    /// Each track takes the plot of largest pignistic probability; several may take the same.
    #[default]
    Row,
    /// The same, or none if that is more probable.
    RowOrNone,
    /// No plot is taken twice; the product of pignistic probabilities is largest, of as many pairs
    /// as can be.
    Exclusive,
    /// The same, with no plot for those tracks for which that is more probable.
    ExclusiveOrNone,
}

/// What only the belief function method needs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BeliefConfig {
    /// `α`: how much an attribute is believed, 0 to less than 1.
    pub trust: PerAttribute,
    /// How it decides.
    pub decision: BeliefDecision,
}

/// Settings of the published association and its rivals.
///
/// The publication states that the range weighs most, and none of the figures. Weights and `trust`
/// are those of the reconstruction \[wide-area\] and were not tuned here. The rest was set by reason:
/// `max_speed_m_per_s` is that of road traffic (144 km/h); `max_beam_step` is 1 for the way of target
/// and platform between two looks, 1 for a target between two beams and 1 to spare, for the
/// systems of \[wide-area\]; `push_m2_per_s3` is the process noise with which a constant-velocity
/// filter follows the turning targets of \[wide-area\] without being too stiff (variances 8 and
/// 20 m²).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PaperConfig {
    /// `w`: weights of the association degrees. They need not sum to 1.
    pub weight: PerAttribute,
    /// `r_e`: error of the slant range, metres; 0 takes it from each plot's covariance.
    pub range_error_m: f64,
    /// `θ_e`: error of the cone angle, radians; 0 takes it from each plot's covariance.
    pub angle_error_rad: f64,
    /// `v_e`: error of the radial velocity, metres per second; 0 takes it from each plot.
    pub radial_error_m_per_s: f64,
    /// `s_e`: spread of a target's strength from look to look, decibels.
    pub strength_error_db: f64,
    /// `v_max`: nobody is faster, metres per second.
    pub max_speed_m_per_s: f64,
    /// `k`: how many errors of the range the gate is wider than a target's way.
    pub gate_sigma_count: f64,
    /// `B_max`: beam positions that a target is seen farther on, at most.
    pub max_beam_step: u32,
    /// What else bounds a target's way.
    pub across: AcrossGate,
    /// A pair of larger degree is none. By default it forbids nothing, as published; among 1000
    /// targets with false plots 8 raises the right links from 93 to 99 %, but where seconds between
    /// looks are many it loses those that turn.
    pub max_degree: f64,
    /// Where tracks begin.
    pub start: Start,
    /// What becomes of tracks that take the same plot.
    pub sharing: Sharing,
    /// A track is confirmed with so many plots ...
    pub confirm_count: u32,
    /// ... of the last so many looks that could have seen it.
    pub window_count: u32,
    /// A track ends after so many looks that could have seen it and did not: the target has stopped
    /// or disappeared.
    pub end_count: u32,
    /// Tracks at most.
    pub max_track_count: usize,
    /// Process noise of the smoothing filter, m²/s³.
    pub push_m2_per_s3: f64,
    /// Steps that smoothing waits for at least; it waits for twice as many at most.
    pub lag_count: usize,
    /// What only the belief function method needs.
    pub belief: BeliefConfig,
}

impl Default for BeliefConfig {
    fn default() -> Self {
        let trust = PerAttribute { range: 0.9, angle: 0.6, radial: 0.6, strength: 0.3 };
        Self { trust, decision: BeliefDecision::default() }
    }
}

impl Default for PaperConfig {
    fn default() -> Self {
        Self {
            weight: PerAttribute { range: 0.5, angle: 0.2, radial: 0.2, strength: 0.1 },
            range_error_m: 0.0,
            angle_error_rad: 0.0,
            radial_error_m_per_s: 0.0,
            strength_error_db: 3.0,
            max_speed_m_per_s: 40.0,
            gate_sigma_count: 3.0,
            max_beam_step: 3,
            across: AcrossGate::default(),
            max_degree: 1e4,
            start: Start::default(),
            sharing: Sharing::default(),
            confirm_count: 3,
            window_count: 5,
            end_count: 3,
            max_track_count: 20_000,
            push_m2_per_s3: 1.0,
            lag_count: 16,
            belief: BeliefConfig::default(),
        }
    }
}

impl PerAttribute {
    /// In the order of the fields.
    #[must_use]
    pub fn array(&self) -> [f64; 4] {
        [self.range, self.angle, self.radial, self.strength]
    }
}

impl PaperConfig {
    /// For the identities and errors of the published comparison: all targets are there from the
    /// first look on, one track of each is followed to the last look, and no other begins.
    #[must_use]
    pub fn published_tracks() -> Self {
        Self { start: Start::FirstLook, sharing: Sharing::AllGoOn, ..Self::published_links() }
    }

    /// For the right links of the published comparison: the rows of the association are all plots
    /// of the look before, each once; what is done with each counts from the first look on.
    #[must_use]
    pub fn published_links() -> Self {
        Self {
            across: AcrossGate::Beams,
            confirm_count: 1,
            window_count: 1,
            end_count: MAX_END_COUNT,
            ..Self::default()
        }
    }

    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense, from the table of these settings on.
    pub fn check(&self) -> Result<(), InvalidSetting> {
        let Self { weight, belief: BeliefConfig { trust, .. }, .. } = self;
        for (field, value, [least, most], remedy) in [
            ("weight.range", weight.range, [1e-6, 1e3], "use 1e-6 to 1000: it weighs most"),
            ("weight.angle", weight.angle, [0.0, 1e3], "use 0 to 1000"),
            ("weight.radial", weight.radial, [0.0, 1e3], "use 0 to 1000"),
            ("weight.strength", weight.strength, [0.0, 1e3], "use 0 to 1000"),
            ("belief.trust.range", trust.range, [0.01, 0.999], "use 0.01 to 0.999"),
            ("belief.trust.angle", trust.angle, [0.0, 0.999], "use 0 to 0.999"),
            ("belief.trust.radial", trust.radial, [0.0, 0.999], "use 0 to 0.999"),
            ("belief.trust.strength", trust.strength, [0.0, 0.999], "use 0 to 0.999"),
            ("range_error_m", self.range_error_m, [0.0, 1e5], "use 0 to 100000 m"),
            ("angle_error_rad", self.angle_error_rad, [0.0, 3.0], "use 0 to 3 rad"),
            ("radial_error_m_per_s", self.radial_error_m_per_s, [0.0, 1e3], "use 0 to 1000 m/s"),
            ("strength_error_db", self.strength_error_db, [0.01, 100.0], "use 0.01 to 100 dB"),
            ("max_speed_m_per_s", self.max_speed_m_per_s, [0.1, 1e4], "use 0.1 to 10000 m/s"),
            ("gate_sigma_count", self.gate_sigma_count, [0.0, 100.0], "use 0 to 100"),
            ("max_degree", self.max_degree, [1e-3, 1e6], "use 0.001 to 1000000"),
            ("push_m2_per_s3", self.push_m2_per_s3, [1e-6, 1e6], "use 1e-6 to 1e6 m²/s³"),
        ] {
            if !(least..=most).contains(&value) {
                return Err(InvalidSetting::new(field, value, remedy));
            }
        }
        self.check_counts()
    }

    fn check_counts(&self) -> Result<(), InvalidSetting> {
        let most_confirm = self.window_count.clamp(1, MAX_WINDOW_COUNT) as usize;
        for (field, value, [least, most], remedy) in [
            ("max_beam_step", self.max_beam_step as usize, [0, 100_000], "use 0 to 100000"),
            ("window_count", self.window_count as usize, [1, 64], "use 1 to 64 looks"),
            (
                "confirm_count",
                self.confirm_count as usize,
                [1, most_confirm],
                "use 1 to the window",
            ),
            (
                "end_count",
                self.end_count as usize,
                [1, MAX_END_COUNT as usize],
                "use 1 to 1000000 looks",
            ),
            ("max_track_count", self.max_track_count, [1, 1_000_000], "use 1 to 1000000"),
            ("lag_count", self.lag_count, [1, 1000], "use 1 to 1000 steps"),
        ] {
            if !(least..=most).contains(&value) {
                return Err(InvalidSetting::new(field, value, remedy));
            }
        }
        Ok(())
    }
}
