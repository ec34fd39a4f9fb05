//! Which tracker follows targets at the centre, and its settings.

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::Tracker;
use super::default::{ConfigError, DefaultConfig, DefaultTracker};
use super::paper::{Mode, PaperConfig, PaperTracker};

/// A setting of a tracker that makes no sense.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("{field} is {value}: {remedy}")]
pub struct InvalidSetting {
    /// Which, from the table on that was checked.
    pub field: String,
    /// What it is, as text.
    pub value: String,
    /// What would do.
    pub remedy: String,
}

impl InvalidSetting {
    pub(super) fn new(field: &str, value: impl ToString, remedy: &str) -> Self {
        Self { field: field.to_owned(), value: value.to_string(), remedy: remedy.to_owned() }
    }

    /// The same, named from the table `table` on.
    fn within(self, table: &str) -> Self {
        Self { field: format!("{table}.{}", self.field), ..self }
    }
}

/// Which tracker follows targets.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TrackerKind {
    /// The best one.
    #[default]
    Default,
    /// The global optimum of \[wide-area\].
    Paper,
    /// Its first rival: each track takes the nearest plot, by the same cost.
    Nn,
    /// Its second rival: belief functions.
    Belief,
}

/// How targets are followed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrackingConfig {
    /// Which tracker.
    pub kind: TrackerKind,
    /// Settings of the default tracker: those for wide areas by default.
    pub default: DefaultConfig,
    /// Settings of the published association and of both its rivals, which share them so that they
    /// can be compared.
    pub paper: PaperConfig,
}

impl TrackingConfig {
    /// Checks every field, also those of trackers that are not chosen.
    ///
    /// # Errors
    /// Names the first field that makes no sense, from `tracking` on, and what would do.
    pub fn check(&self) -> Result<(), InvalidSetting> {
        self.default.check().map_err(of_default)?;
        self.paper.check().map_err(|error| error.within("tracking.paper"))
    }

    /// A tracker that knows nobody yet.
    ///
    /// # Errors
    /// If a setting makes no sense.
    pub fn tracker(&self) -> Result<Box<dyn Tracker>, InvalidSetting> {
        self.check()?;
        let mode = match self.kind {
            TrackerKind::Default => {
                let tracker = DefaultTracker::new(self.default.clone()).map_err(of_default)?;
                return Ok(Box::new(tracker));
            }
            TrackerKind::Paper => Mode::Paper,
            TrackerKind::Nn => Mode::Nearest,
            TrackerKind::Belief => Mode::Belief,
        };
        Ok(Box::new(PaperTracker::new(mode, &self.paper)?))
    }
}

fn of_default(error: ConfigError) -> InvalidSetting {
    let remedy = format!("use {}", error.expected);
    InvalidSetting::new(error.key, error.value, &remedy).within("tracking.default")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_chosen_tracker_is_built() {
        for kind in [TrackerKind::Default, TrackerKind::Paper, TrackerKind::Nn, TrackerKind::Belief]
        {
            let config = TrackingConfig { kind, ..TrackingConfig::default() };
            assert!(config.tracker().unwrap().tracks().is_empty());
        }
    }

    #[test]
    fn nonsense_is_named_from_the_root_on() {
        let mut config = TrackingConfig { kind: TrackerKind::Nn, ..TrackingConfig::default() };
        config.paper.belief.trust.radial = -0.1;
        let complaint = config.check().unwrap_err();
        assert_eq!(
            complaint.to_string(),
            "tracking.paper.belief.trust.radial is -0.1: use 0 to 0.999"
        );
        assert_eq!(config.tracker().map(|_| ()), Err(complaint));
    }

    #[test]
    fn nonsense_of_the_default_tracker_is_named_so_too() {
        let mut config = TrackingConfig::default();
        config.default.unseen_s = -1.0;
        let complaint = config.check().unwrap_err().to_string();
        assert!(complaint.starts_with("tracking.default.unseen_s is -1: use "), "{complaint}");
    }

    #[test]
    fn settings_are_read_and_unknown_ones_refused() {
        let text = "kind = \"nn\"\n[paper]\nmax_beam_step = 1\nstart = \"first_look\"\n";
        let config: TrackingConfig = toml::from_str(text).unwrap();
        assert_eq!((config.kind, config.paper.max_beam_step), (TrackerKind::Nn, 1));
        let written = toml::to_string(&config).unwrap();
        assert_eq!(toml::from_str::<TrackingConfig>(&written).unwrap(), config);
        assert!(toml::from_str::<TrackingConfig>("[paper]\nmax_beams = 1\n").is_err());
    }
}
