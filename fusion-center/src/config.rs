//! The centre's configuration, with its defaults and checks.

use proto::config::BusConfig;
use proto::ids::{NodeId, SiteId};
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};
use thiserror::Error;

use crate::map::MapConfig;
use crate::registration::SolverConfig;
use crate::tracking::Tracker;
use crate::tracking::default::{DefaultConfig, DefaultTracker};

/// A setting that makes no sense.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("{0}")]
pub struct InvalidConfig(String);

/// Everything that can be set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CentreConfig {
    /// Name of the installation; agents must use the same.
    pub site: SiteId,
    /// The node whose frame is the common frame.
    pub reference: NodeId,
    /// The network.
    pub bus: BusConfig,
    /// How point sets are brought together.
    pub gather: GatherConfig,
    /// How nodes are registered.
    pub solver: SolverConfig,
    /// How targets are fused.
    pub fuse: FuseConfig,
    /// How people are followed.
    pub people: PeopleConfig,
    /// How much solving is done.
    pub work: WorkConfig,
    /// How a moved node is noticed.
    pub monitor: MonitorConfig,
    /// What outlives the centre.
    pub state: StateConfig,
    /// How targets of wide-area radars are followed.
    pub wide: MapConfig,
}

/// How much solving is done.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct WorkConfig {
    /// Pairs of nodes solved at once; 0 for the number of cores.
    pub worker_count: usize,
    /// Share of the workers' time that solving may take; pairs beyond it wait for their turn.
    pub time_share: f64,
}

/// How a moved node is noticed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MonitorConfig {
    /// Newest periods whose points are compared; 0 switches the monitor off.
    pub window_count: usize,
    /// Smallest chi-square (three degrees of freedom) of a change for which a node is
    /// suspect.
    pub min_chi_square: f64,
    /// Points of two nodes that lie farther apart than this, metres, are not compared.
    pub gate_m: f64,
}

/// What outlives the centre.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct StateConfig {
    /// File with transforms, epochs and pins, read at the start and kept up to date; none if empty.
    pub path: String,
}

/// How point sets are brought together.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GatherConfig {
    /// Length of one detection period; the agents' period.
    pub period_s: f64,
    /// Periods kept for registration whatever they show.
    pub window_count: usize,
    /// Older periods kept beside them: those whose common points lie where few others do.
    pub reserve_count: usize,
    /// Side of the cells, metres in each node's frame, by which places are told apart.
    pub place_m: f64,
    /// How long a period waits for a node that is alive but late.
    pub max_wait_s: f64,
    /// A node not heard for this long is silent: nobody waits for it.
    pub silent_after_s: f64,
    /// Sets whose clock may be wrong by more than this are shown but not registered with.
    pub max_clock_error_s: f64,
    /// Nodes beyond this number are refused.
    pub max_node_count: usize,
}

/// How targets are fused.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FuseConfig {
    /// Chance that two sightings of one target are not joined because they lie too far apart.
    pub miss_probability: f64,
}

/// How people are followed by all registered nodes together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PeopleConfig {
    /// Whether they are.
    pub follow: bool,
    /// Probability that a node gives a point of a person in one period.
    pub detection_probability: f64,
    /// False points of one node in one period, for each square metre.
    pub false_points_per_m2: f64,
    /// A node counts as contributing to a person for this long after its point.
    pub contribution_s: f64,
    /// The tracker; what is left out is as for people, not as for wide areas.
    #[serde(deserialize_with = "over_those_for_people")]
    pub tracker: DefaultConfig,
}

/// Settings for people with those that are given put over them.
fn over_those_for_people<'de, D: Deserializer<'de>>(from: D) -> Result<DefaultConfig, D::Error> {
    let given = toml::Table::deserialize(from)?;
    let mut all = toml::Table::try_from(DefaultConfig::people()).map_err(D::Error::custom)?;
    all.extend(given);
    all.try_into().map_err(D::Error::custom)
}

impl Default for PeopleConfig {
    fn default() -> Self {
        Self {
            follow: true,
            detection_probability: 0.8,
            false_points_per_m2: 0.01,
            contribution_s: 1.0,
            tracker: DefaultConfig::people(),
        }
    }
}

impl PeopleConfig {
    /// A tracker that has seen nothing yet; none if nobody is to be followed, or with settings that
    /// [`CentreConfig::check`] refuses.
    pub(crate) fn tracker(&self) -> Option<Box<dyn Tracker>> {
        let made = self.follow.then(|| DefaultTracker::new(self.tracker.clone()))?.ok()?;
        Some(Box::new(made))
    }
}

impl Default for CentreConfig {
    fn default() -> Self {
        // Both names are constants that satisfy the rules of names (asserted by a test).
        let name = |text: &str| text.to_owned();
        Self {
            site: SiteId::try_from(name("site")).unwrap_or_else(|_| unreachable!("a valid name")),
            reference: NodeId::try_from(name("n1"))
                .unwrap_or_else(|_| unreachable!("a valid name")),
            bus: BusConfig::router(),
            gather: GatherConfig::default(),
            solver: SolverConfig::default(),
            fuse: FuseConfig::default(),
            people: PeopleConfig::default(),
            work: WorkConfig::default(),
            monitor: MonitorConfig::default(),
            state: StateConfig::default(),
            wide: MapConfig::default(),
        }
    }
}

impl Default for WorkConfig {
    fn default() -> Self {
        Self { worker_count: 0, time_share: 0.5 }
    }
}

impl Default for MonitorConfig {
    fn default() -> Self {
        Self { window_count: 20, min_chi_square: 28.0, gate_m: 1.0 }
    }
}

impl Default for GatherConfig {
    fn default() -> Self {
        Self {
            period_s: 0.1,
            window_count: 120,
            reserve_count: 60,
            place_m: 0.5,
            max_wait_s: 0.3,
            silent_after_s: 3.0,
            max_clock_error_s: 0.02,
            max_node_count: 32,
        }
    }
}

impl Default for FuseConfig {
    fn default() -> Self {
        Self { miss_probability: 0.01 }
    }
}

impl FuseConfig {
    /// Largest squared normalised distance of two sightings of one target: the quantile of
    /// chi-square with two degrees of freedom, which is `−2 ln(miss probability)`.
    #[must_use]
    pub fn gate(&self) -> f64 {
        -2.0 * self.miss_probability.ln()
    }
}

impl CentreConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense, its value and what would do.
    pub fn check(&self) -> Result<(), InvalidConfig> {
        if let Some(complaint) = self.bus.complaint() {
            return Err(InvalidConfig(complaint));
        }
        let gather = &self.gather;
        for (name, value, least, most) in [
            ("gather.period_s", gather.period_s, 1e-3, 60.0),
            ("gather.max_wait_s", gather.max_wait_s, 0.0, 60.0),
            ("gather.silent_after_s", gather.silent_after_s, 0.1, 3600.0),
            ("gather.max_clock_error_s", gather.max_clock_error_s, 1e-6, 10.0),
            ("gather.window_count", gather.window_count as f64, 2.0, 100_000.0),
            ("gather.reserve_count", gather.reserve_count as f64, 0.0, 10_000.0),
            ("gather.place_m", gather.place_m, 0.05, 100.0),
            ("gather.max_node_count", gather.max_node_count as f64, 2.0, 256.0),
            ("fuse.miss_probability", self.fuse.miss_probability, 1e-9, 0.5),
            ("people.detection_probability", self.people.detection_probability, 0.01, 0.999),
            ("people.false_points_per_m2", self.people.false_points_per_m2, 1e-9, 100.0),
            ("people.contribution_s", self.people.contribution_s, 0.0, 3600.0),
            ("work.worker_count", self.work.worker_count as f64, 0.0, 256.0),
            ("work.time_share", self.work.time_share, 0.01, 1.0),
            ("monitor.window_count", self.monitor.window_count as f64, 0.0, 1000.0),
            ("monitor.min_chi_square", self.monitor.min_chi_square, 10.0, 1e6),
            ("monitor.gate_m", self.monitor.gate_m, 0.1, 20.0),
        ] {
            if !(least..=most).contains(&value) {
                return Err(InvalidConfig(format!("{name} is {value}: use {least} to {most}")));
            }
        }
        let tracker = self.people.tracker.check();
        tracker.map_err(|error| InvalidConfig(format!("people.tracker: {error}")))?;
        if let Some(complaint) = self.wide.complaint() {
            return Err(InvalidConfig(complaint));
        }
        self.solver.check().map_err(|error| InvalidConfig(error.to_string()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_make_sense() {
        assert_eq!(CentreConfig::default().check(), Ok(()));
        assert_eq!(CentreConfig::default().reference.as_str(), "n1");
    }

    #[test]
    fn the_shipped_file_spells_the_defaults() {
        let shipped = include_str!("../../deploy/fusion.toml");
        let config: CentreConfig = toml::from_str(shipped).unwrap();
        assert_eq!(config, CentreConfig::default());
        let every_key = toml::Table::try_from(CentreConfig::default()).unwrap();
        let spelled: toml::Table = shipped.parse().unwrap();
        assert_eq!(spelled, every_key, "deploy/fusion.toml leaves keys out");
    }

    #[test]
    fn what_is_left_out_of_the_tracker_is_as_for_people() {
        let config: CentreConfig = toml::from_str("[people.tracker]\nunseen_s = 9.0").unwrap();
        let want = DefaultConfig { unseen_s: 9.0, ..DefaultConfig::people() };
        assert_eq!(config.people.tracker, want);
        let wrong = toml::from_str::<CentreConfig>("[people.tracker]\nunseen = 9.0");
        assert!(wrong.unwrap_err().to_string().contains("unseen"));
        let mut senseless = CentreConfig::default();
        senseless.people.tracker.unseen_s = -1.0;
        assert!(senseless.check().unwrap_err().to_string().contains("unseen_s"));
    }

    #[test]
    fn nonsense_names_key_value_and_remedy() {
        let mut config = CentreConfig::default();
        config.gather.period_s = 0.0;
        let complaint = config.check().unwrap_err().to_string();
        assert_eq!(complaint, "gather.period_s is 0: use 0.001 to 60");
        assert!(toml::from_str::<CentreConfig>("referense = \"n1\"").is_err());
        assert!(toml::from_str::<CentreConfig>("reference = \"N 1\"").is_err());
    }
}
