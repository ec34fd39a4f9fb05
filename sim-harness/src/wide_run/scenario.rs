//! What is to be run: sensors, their settings and the centre's, and how good the map must be.

use std::path::Path;

use anyhow::{Context, ensure};
use fusion_center::config::CentreConfig;
use node_agent::config::{AgentConfig, AgentKind};
use node_agent::gmti::{GmtiSource, simulate::SimulatedGmti};
use proto::config::BusConfig;
use proto::ids::NodeId;
use serde::{Deserialize, Serialize};

use crate::plan::overlaid;
use crate::scenario::Kill;

/// The scenario that comes with the program.
pub(crate) const SHIPPED: (&str, &str) =
    ("wide-area", include_str!("../../scenarios/wide-area.toml"));

/// A scenario file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct WideScenario {
    /// Short name.
    pub(crate) name: String,
    /// One line for people.
    pub(crate) title: String,
    /// Seconds of the data per second.
    pub(crate) speed: f64,
    /// Seed of everything random.
    #[serde(default)]
    pub(crate) seed: u64,
    /// How good the map must be.
    pub(crate) bounds: Bounds,
    /// Keys of every agent's configuration.
    #[serde(default)]
    pub(crate) agent: toml::Table,
    /// Keys of the centre's configuration.
    #[serde(default)]
    pub(crate) centre: toml::Table,
    /// The sensors; all see the targets of the first.
    pub(crate) sensors: Vec<Sensor>,
    /// Processes to kill on the way; agents and centre are started again.
    #[serde(default)]
    pub(crate) kills: Vec<Kill>,
}

/// One sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Sensor {
    /// Name.
    pub(crate) id: NodeId,
    /// More keys of its agent's configuration.
    #[serde(default)]
    pub(crate) agent: toml::Table,
}

/// How good the map must be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Bounds {
    /// Share of the targets that must be found.
    pub(crate) found_share: f64,
    /// Least share of moments in which a track is with the target that it is mostly with.
    pub(crate) purity: f64,
    /// Largest GOSPA, root mean square over the moments, metres.
    pub(crate) gospa_m: f64,
}

/// Everything that is launched.
pub(crate) struct WidePlan {
    pub(crate) scenario: WideScenario,
    pub(crate) centre: CentreConfig,
    pub(crate) agents: Vec<AgentConfig>,
    /// Where the centre listens.
    pub(crate) endpoint: String,
}

/// Name and title of the shipped scenario.
pub(crate) fn shipped() -> anyhow::Result<WideScenario> {
    toml::from_str(SHIPPED.1).context("scenario wide-area")
}

/// The scenario of this name, or in the file of this path, if it is one of wide-area radars.
///
/// # Errors
/// If it is one and makes no sense.
pub(crate) fn find(name: &str) -> anyhow::Result<Option<WideScenario>> {
    let text = if name == SHIPPED.0 {
        SHIPPED.1.to_owned()
    } else if Path::new(name).is_file() {
        std::fs::read_to_string(name).with_context(|| format!("reading {name}"))?
    } else {
        return Ok(None);
    };
    let is_wide = text.parse::<toml::Table>().is_ok_and(|table| table.contains_key("sensors"));
    if !is_wide {
        return Ok(None);
    }
    toml::from_str(&text).with_context(|| format!("scenario {name}")).map(Some)
}

impl WidePlan {
    /// The configuration of every process of `scenario`, with the files of the run in `folder`.
    ///
    /// # Errors
    /// If something makes no sense.
    pub(crate) fn new(scenario: WideScenario, endpoint: &str) -> anyhow::Result<Self> {
        let name = &scenario.name;
        ensure!(!scenario.sensors.is_empty(), "scenario {name}: list at least one sensor");
        let ids: std::collections::BTreeSet<&NodeId> =
            scenario.sensors.iter().map(|sensor| &sensor.id).collect();
        ensure!(ids.len() == scenario.sensors.len(), "scenario {name}: a sensor is listed twice");
        for kill in &scenario.kills {
            let known = kill.who == "centre" || ids.iter().any(|id| id.as_str() == kill.who);
            ensure!(known, "kill {}: not a sensor of scenario {name}, and not `centre`", kill.who);
        }
        let mut centre: CentreConfig = overlaid(&CentreConfig::default(), &scenario.centre)
            .with_context(|| format!("scenario {name}: [centre]"))?;
        centre.site = "sim".parse()?;
        centre.bus.listen = vec![endpoint.to_owned()];
        centre.check().with_context(|| format!("scenario {name}: [centre]"))?;
        let agents = (0_u64..)
            .zip(&scenario.sensors)
            .map(|(index, sensor)| agent(&scenario, index, sensor, endpoint))
            .collect::<anyhow::Result<Vec<_>>>()?;
        Ok(Self { centre, agents, endpoint: endpoint.to_owned(), scenario })
    }

    /// The scene that the first sensor sees, for its truth.
    ///
    /// # Errors
    /// If the scene makes no sense.
    pub(crate) fn scene(&self) -> anyhow::Result<SimulatedGmti> {
        let first = self.agents.first().context("no sensor")?;
        Ok(SimulatedGmti::new(&first.gmti.simulated, first.node.clone())?)
    }

    /// How long the longest sensor plays, seconds on the wall; `None` without end.
    pub(crate) fn play_s(&self) -> Option<f64> {
        let of = |agent: &AgentConfig| {
            let scan = agent.gmti.simulated.scene().scan;
            Some(scan.period_s * f64::from(scan.count?) / agent.play.speed)
        };
        self.agents.iter().map(of).try_fold(0.0, |most: f64, one| Some(most.max(one?)))
    }
}

fn agent(
    scenario: &WideScenario,
    index: u64,
    sensor: &Sensor,
    endpoint: &str,
) -> anyhow::Result<AgentConfig> {
    let named = || format!("scenario {}: sensor {}", scenario.name, sensor.id);
    let common: AgentConfig =
        overlaid(&AgentConfig::default(), &scenario.agent).with_context(named)?;
    let mut config: AgentConfig = overlaid(&common, &sensor.agent).with_context(named)?;
    config.kind = AgentKind::Gmti;
    config.site = "sim".parse()?;
    config.node = sensor.id.clone();
    config.bus = BusConfig { connect: vec![endpoint.to_owned()], ..config.bus };
    config.play.speed = scenario.speed;
    ensure!(
        config.gmti.source == GmtiSource::Simulated,
        "{}: only simulated sensors can be scored",
        named()
    );
    // Far apart, so that no sensor of one seed shares its noise with one of another.
    config.gmti.simulated.seed = scenario.seed.wrapping_mul(1000).wrapping_add(index);
    config.check().with_context(named)?;
    Ok(config)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_scenario_gives_sound_configurations() {
        let scenario = find("wide-area").unwrap().unwrap();
        assert_eq!(scenario.name, "wide-area");
        let plan = WidePlan::new(scenario, "tcp/127.0.0.1:1").unwrap();
        assert_eq!(plan.agents.len(), 2);
        assert_ne!(plan.agents[0].gmti.simulated.seed, plan.agents[1].gmti.simulated.seed);
        assert_eq!(plan.scene().unwrap().scene().targets.len(), 4);
        let play_s = plan.play_s().unwrap();
        assert!((5.0..60.0).contains(&play_s), "{play_s}");
        let one = plan.agents[0].gmti.simulated.scene();
        let other = plan.agents[1].gmti.simulated.scene();
        assert!(one.targets == other.targets && one.platform != other.platform);
    }

    #[test]
    fn other_scenarios_are_left_to_others_and_nonsense_is_named() {
        assert!(find("office").unwrap().is_none());
        let said = |change: fn(&mut WideScenario)| {
            let mut scenario = shipped().unwrap();
            change(&mut scenario);
            let refused = WidePlan::new(scenario, "tcp/127.0.0.1:1").map(drop).unwrap_err();
            format!("{refused:#}")
        };
        assert!(said(|one| one.sensors.clear()).contains("at least one sensor"));
        assert!(said(|one| one.sensors[1].id = "west".parse().unwrap()).contains("twice"));
        assert!(said(|one| one.kills = vec!["n9@1".parse().unwrap()]).contains("n9"));
        assert!(
            said(|one| drop(one.agent.insert("sped".into(), 1.into()))).contains("sped"),
            "unknown keys are named"
        );
    }
}
