//! The agent's configuration, with its defaults and checks.

use std::path::PathBuf;

use proto::config::BusConfig;
use proto::ids::{NodeId, SiteId};
use rustfft::num_complex::Complex;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::gmti::GmtiConfig;
use crate::group::GroupConfig;
use crate::imaging::canceller::CancellerConfig;
use crate::pipeline::ChainConfig;
use crate::simulate::Radar;
use crate::source::{
    Echoes, EchoesConfig, Replay, ReplayConfig, Simulated, SimulatedConfig, SourceError,
    SweepSource,
};
use crate::tracking::default::HALF_DEPTH_M;
use crate::tracking::{TrackingConfig, TrackingMode};

/// A setting that makes no sense.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("{0}")]
pub struct InvalidConfig(String);

/// Everything that can be set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AgentConfig {
    /// Name of the installation; the centre must use the same.
    pub site: SiteId,
    /// Name of this node.
    pub node: NodeId,
    /// What kind of radar it is.
    pub kind: AgentKind,
    /// Where sweeps come from.
    pub source: SourceKind,
    /// How fast and from when the source is played.
    pub play: PlayConfig,
    /// The network.
    pub bus: BusConfig,
    /// What imaged targets are like.
    pub target: TargetConfig,
    /// Files to write.
    pub output: OutputConfig,
    /// From sweeps to points.
    pub chain: ChainConfig,
    /// From images to people who are followed.
    pub tracking: TrackingConfig,
    /// From detections to points.
    pub group: GroupConfig,
    /// Settings of the simulated source.
    pub simulated: SimulatedConfig,
    /// Settings of the recorded source.
    pub recorded: ReplayConfig,
    /// Settings of the source of recorded echoes.
    pub echoes: EchoesConfig,
    /// Settings of the live source.
    pub live: LiveConfig,
    /// Settings of a wide-area radar.
    pub gmti: GmtiConfig,
}

/// What kind of radar an agent is of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AgentKind {
    /// It images people through walls.
    #[default]
    Imaging,
    /// It sees moving targets on the ground from an aircraft.
    Gmti,
}

/// Where sweeps come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SourceKind {
    /// Echoes of a known scene.
    #[default]
    Simulated,
    /// Detections from a file.
    Recorded,
    /// Raw sweeps from a file.
    Echoes,
    /// Raw sweeps from a radar's driver, over Zenoh.
    Live,
}

/// Where a radar's driver delivers raw sweeps.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LiveConfig {
    /// Endpoint at which the agent listens for its driver.
    pub listen: String,
}

impl Default for LiveConfig {
    fn default() -> Self {
        Self { listen: "tcp/127.0.0.1:7448".to_owned() }
    }
}

/// How fast and from when the source is played.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PlayConfig {
    /// Seconds of the source per second; 1 is real time.
    pub speed: f64,
    /// Calendar time (Unix, seconds) at which the source starts, so that several agents start
    /// together; at once if left out.
    pub start_unix_s: Option<f64>,
}

/// What imaged targets are like.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TargetConfig {
    /// How far behind the measured surface the middle of a target lies; 0 for points.
    pub half_depth_m: f64,
    /// Standard deviation of that from target to target.
    pub half_depth_sigma_m: f64,
}

/// Files to write.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OutputConfig {
    /// Point sets as JSON Lines, one per period.
    pub points_jsonl: Option<PathBuf>,
    /// The newest image with its points.
    pub image_png: Option<PathBuf>,
    /// Least time between two writings of the image; it is also written at the end.
    pub image_interval_s: f64,
}

impl Default for AgentConfig {
    fn default() -> Self {
        // Both names are constants that satisfy the rules of names (asserted by a test).
        let name = |text: &str| text.to_owned();
        Self {
            site: SiteId::try_from(name("site")).unwrap_or_else(|_| unreachable!("a valid name")),
            node: NodeId::try_from(name("n1")).unwrap_or_else(|_| unreachable!("a valid name")),
            kind: AgentKind::default(),
            source: SourceKind::default(),
            play: PlayConfig::default(),
            bus: BusConfig::default(),
            target: TargetConfig::default(),
            output: OutputConfig::default(),
            chain: ChainConfig::default(),
            tracking: TrackingConfig::default(),
            group: GroupConfig::default(),
            simulated: SimulatedConfig::default(),
            recorded: ReplayConfig::default(),
            echoes: EchoesConfig::default(),
            live: LiveConfig::default(),
            gmti: GmtiConfig::default(),
        }
    }
}

impl Default for PlayConfig {
    fn default() -> Self {
        Self { speed: 1.0, start_unix_s: None }
    }
}

impl Default for TargetConfig {
    /// People: 0.1 m, give or take 0.05 m, as fitted with the glint of `DetectionConfig::people`; 0.06 m
    /// seen from the front and 0.14 m from the side.
    fn default() -> Self {
        Self { half_depth_m: HALF_DEPTH_M, half_depth_sigma_m: 0.05 }
    }
}

impl Default for OutputConfig {
    fn default() -> Self {
        Self { points_jsonl: None, image_png: None, image_interval_s: 5.0 }
    }
}

impl AgentConfig {
    /// Checks every field that does not depend on files.
    ///
    /// # Errors
    /// Names the first field that makes no sense, its value and what would do.
    pub fn check(&self) -> Result<(), InvalidConfig> {
        if let Some(complaint) = self.bus.complaint() {
            return Err(InvalidConfig(complaint));
        }
        if !self.bus.listen.is_empty() {
            let listen = &self.bus.listen;
            let remedy = "leave it empty: only the centre listens, agents dial";
            return Err(InvalidConfig(format!("bus.listen is {listen:?}: {remedy}")));
        }
        let start = self.play.start_unix_s.unwrap_or(0.0);
        for (name, value, least, most) in [
            ("play.speed", self.play.speed, 1e-3, 1e3),
            ("play.start_unix_s", start, 0.0, 1e11),
            ("target.half_depth_m", self.target.half_depth_m, 0.0, 2.0),
            ("target.half_depth_sigma_m", self.target.half_depth_sigma_m, 0.0, 2.0),
            ("output.image_interval_s", self.output.image_interval_s, 0.1, 1e6),
            ("simulated.period_s", self.simulated.period_s, 1e-3, 60.0),
            ("simulated.heading_deg", self.simulated.heading_deg, -360.0, 360.0),
            ("simulated.x_m", self.simulated.x_m, -1e5, 1e5),
            ("simulated.y_m", self.simulated.y_m, -1e5, 1e5),
            ("simulated.first_s", self.simulated.first_s, -1e9, 1e9),
            ("recorded.first_s", self.recorded.first_s.unwrap_or(0.0), 0.0, 1e11),
        ] {
            if !(least..=most).contains(&value) {
                return Err(InvalidConfig(format!("{name} is {value}: use {least} to {most}")));
            }
        }
        if let Some(complaint) = self.gmti.complaint() {
            return Err(InvalidConfig(complaint));
        }
        // Recorded echoes bring their own radar, with which the chain is checked when it is built.
        if self.source != SourceKind::Echoes {
            self.chain.check().map_err(|error| InvalidConfig(format!("chain.{error}")))?;
            if self.chain.canceller == CancellerConfig::Background {
                let remedy = "only recorded echoes have one: use another canceller";
                return Err(InvalidConfig(format!("chain.canceller is background: {remedy}")));
            }
        }
        self.group.check().map_err(|error| InvalidConfig(error.to_string()))?;
        let simulated = |error| InvalidConfig(format!("simulated.{error}"));
        self.simulated.scene.check().map_err(simulated)?;
        self.simulated.disturbance.check().map_err(simulated)?;
        self.check_tracking()?;
        self.check_files()
    }

    fn check_tracking(&self) -> Result<(), InvalidConfig> {
        let tracking = &self.tracking;
        tracking.check().map_err(|error| InvalidConfig(error.to_string()))?;
        if tracking.mode != TrackingMode::Off && self.source == SourceKind::Recorded {
            let remedy = "recorded detections have no images to follow people in: use \"off\"";
            return Err(InvalidConfig(format!("tracking.mode is {:?}: {remedy}", tracking.mode)));
        }
        Ok(())
    }

    fn check_files(&self) -> Result<(), InvalidConfig> {
        if !self.live.listen.starts_with("tcp/") {
            let listen = &self.live.listen;
            return Err(InvalidConfig(format!("live.listen is {listen:?}: use tcp/HOST:PORT")));
        }
        if self.source == SourceKind::Echoes && self.echoes.path.as_os_str().is_empty() {
            let remedy = "echoes.path is empty: name an .npz or .sigmf-meta file";
            return Err(InvalidConfig(remedy.to_owned()));
        }
        if self.source == SourceKind::Recorded && self.recorded.path.as_os_str().is_empty() {
            let remedy = "recorded.path is empty: name a .csv or .jsonl file";
            return Err(InvalidConfig(remedy.to_owned()));
        }
        Ok(())
    }

    /// Half-depth of a target and its standard deviation, metres, for this kind of source.
    #[must_use]
    pub fn half_depth_m(&self) -> (f64, f64) {
        match self.source {
            SourceKind::Recorded => (self.group.half_depth_m, self.group.half_depth_sigma_m),
            _ => (self.target.half_depth_m, self.target.half_depth_sigma_m),
        }
    }

    /// Opens the source. Band and array of a recording replace those of the configuration.
    ///
    /// # Errors
    /// If the scene makes no sense or the recording cannot be read.
    pub fn open_source(mut self) -> Result<Opened, SourceError> {
        let mut background = None;
        let source: Box<dyn SweepSource> = match self.source {
            SourceKind::Simulated => {
                let ChainConfig { band, array, grid, .. } = self.chain.clone();
                Box::new(Simulated::new(&self.simulated, &Radar { band, array, grid })?)
            }
            SourceKind::Recorded => Box::new(Replay::new(&self.recorded, &self.group)?),
            SourceKind::Echoes => {
                let echoes = Echoes::new(&self.echoes)?;
                let header = echoes.recording().header();
                self.chain = header.fitted(self.chain).map_err(SourceError::Chain)?;
                background.clone_from(&header.background);
                Box::new(echoes)
            }
            SourceKind::Live => return Err(SourceError::Live),
        };
        Ok(Opened { config: self, source, background })
    }
}

/// A source, ready to be played.
pub struct Opened {
    /// The configuration with the source's radar.
    pub config: AgentConfig,
    /// The source.
    pub source: Box<dyn SweepSource>,
    /// The scene without targets, `[channel][frequency]`, where a recording has it.
    pub background: Option<Vec<Complex<f32>>>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_make_sense() {
        assert_eq!(AgentConfig::default().check(), Ok(()));
    }

    #[test]
    fn the_shipped_file_spells_the_defaults() {
        let shipped = include_str!("../../deploy/node.toml");
        let config: AgentConfig = toml::from_str(shipped).unwrap();
        assert_eq!(config, AgentConfig::default());
        let every_key = toml::Table::try_from(AgentConfig::default()).unwrap();
        let spelled: toml::Table = shipped.parse().unwrap();
        assert_eq!(spelled, every_key, "deploy/node.toml leaves keys out");
    }

    #[test]
    fn the_shipped_file_of_a_wide_area_radar_spells_all_its_keys() {
        let shipped = include_str!("../../deploy/gmti.toml");
        let config: AgentConfig = toml::from_str(shipped).unwrap();
        assert_eq!(config.check(), Ok(()));
        assert_eq!(config, AgentConfig { kind: AgentKind::Gmti, ..AgentConfig::default() });
        let every_key = toml::Table::try_from(AgentConfig::default()).unwrap();
        let spelled: toml::Table = shipped.parse().unwrap();
        assert_eq!(spelled["gmti"], every_key["gmti"], "deploy/gmti.toml leaves keys out");
    }

    #[test]
    fn nonsense_names_key_value_and_remedy() {
        let mut config = AgentConfig::default();
        config.play.speed = f64::NAN;
        assert!(config.check().unwrap_err().to_string().starts_with("play.speed is NaN: use"));
        let no_file = AgentConfig { source: SourceKind::Recorded, ..AgentConfig::default() };
        assert!(no_file.check().unwrap_err().to_string().contains("recorded.path"));
        let listens = AgentConfig { bus: BusConfig::router(), ..AgentConfig::default() };
        assert!(listens.check().unwrap_err().to_string().contains("agents dial"));
        let mut follows = no_file.clone();
        follows.tracking.mode = TrackingMode::Paper;
        follows.recorded.path = PathBuf::from("x.csv");
        let said = follows.check().unwrap_err().to_string();
        assert!(said.contains("tracking.mode is Paper") && said.contains("\"off\""), "{said}");
        assert!(toml::from_str::<AgentConfig>("[chain.band]\nstart_ghz = 1.6").is_err());
    }
}
