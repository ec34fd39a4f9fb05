//! From a scenario to the configuration of every process.

use std::path::{Path, PathBuf};

use anyhow::Context;
use fusion_center::config::CentreConfig;
use node_agent::config::{AgentConfig, SourceKind};
use node_agent::source::Move;
use proto::config::BusConfig;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::moves::NodeMove;
use crate::scenario::{NodePlan, Scenario};

/// Everything that is launched, and where.
pub(crate) struct Plan {
    pub(crate) scenario: Scenario,
    pub(crate) centre: CentreConfig,
    pub(crate) agents: Vec<AgentConfig>,
    pub(crate) folder: PathBuf,
    /// Where the centre listens.
    pub(crate) endpoint: String,
}

/// The configuration of the centre and of every agent of `scenario`, with all their files in
/// `folder`.
pub(crate) fn plan(scenario: Scenario, folder: &Path, endpoint: &str) -> anyhow::Result<Plan> {
    let mut centre: CentreConfig = overlaid(&CentreConfig::default(), &scenario.centre)
        .with_context(|| format!("scenario {}: [centre]", scenario.name))?;
    centre.site = "sim".parse()?;
    centre.reference = scenario.reference.clone();
    centre.bus.listen = vec![endpoint.to_owned()];
    centre.gather.period_s = scenario.period_s / scenario.speed;
    centre.gather.max_node_count = centre.gather.max_node_count.max(scenario.nodes.len());
    centre.check().with_context(|| format!("scenario {}: [centre]", scenario.name))?;
    let agents = scenario
        .nodes
        .iter()
        .enumerate()
        .map(|(index, node)| agent(&scenario, index, node, folder, endpoint))
        .collect::<anyhow::Result<Vec<_>>>()?;
    let (folder, endpoint) = (folder.to_owned(), endpoint.to_owned());
    Ok(Plan { scenario, centre, agents, folder, endpoint })
}

fn agent(
    scenario: &Scenario,
    index: usize,
    node: &NodePlan,
    folder: &Path,
    endpoint: &str,
) -> anyhow::Result<AgentConfig> {
    let name = &scenario.name;
    let mut config: AgentConfig = overlaid(&AgentConfig::default(), &scenario.agent)
        .with_context(|| format!("scenario {name}: [agent]"))?;
    if let Some(own) = scenario.agent_of.get(&node.id) {
        config = overlaid(&config, own)
            .with_context(|| format!("scenario {name}: [agent_of.{}]", node.id))?;
    }
    config.site = "sim".parse()?;
    config.node = node.id.clone();
    config.bus = BusConfig { connect: vec![endpoint.to_owned()], ..config.bus };
    config.play.speed = scenario.speed;
    config.output.points_jsonl = Some(folder.join("points").join(format!("{}.jsonl", node.id)));
    config.output.image_png = Some(folder.join("images").join(format!("{}.png", node.id)));
    match &scenario.recording {
        Some(recording) => {
            config.source = SourceKind::Recorded;
            config.recorded.path = scenario.recording_of(&recording.folder, &node.id)?;
            config.recorded.first_s = recording.first_s;
            config.recorded.period_count = scenario.period_count;
            config.group.period_s = scenario.period_s;
            config.group.sensor_height_m = node.height_m;
        }
        None => {
            config.source = SourceKind::Simulated;
            let simulated = &mut config.simulated;
            (simulated.x_m, simulated.y_m) = (node.x_m, node.y_m);
            simulated.heading_deg = node.heading_deg;
            simulated.period_s = scenario.period_s;
            simulated.period_count = scenario.period_count;
            let shove = |one: &NodeMove| {
                let NodeMove { at_s, dx_m, dy_m, turn_deg, .. } = *one;
                Move { at_s, dx_m, dy_m, turn_deg }
            };
            simulated.moves = scenario.moves_of(&node.id).map(shove).collect();
            // Far apart, so that no node of one seed shares its noise with one of another.
            simulated.seed = scenario.seed.wrapping_mul(1000).wrapping_add(index as u64);
        }
    }
    config.check().with_context(|| format!("scenario {name}: node {}", node.id))?;
    Ok(config)
}

/// `base` with the keys of `table` put over it, however deep they lie.
pub(crate) fn overlaid<T: Serialize + DeserializeOwned>(
    base: &T,
    table: &toml::Table,
) -> anyhow::Result<T> {
    let mut merged = toml::Table::try_from(base)?;
    merge(&mut merged, table);
    Ok(merged.try_into()?)
}

/// Puts the keys of `from` over those of `into`, however deep they lie.
pub(crate) fn merge(into: &mut toml::Table, from: &toml::Table) {
    for (key, value) in from {
        match (into.get_mut(key), value) {
            (Some(toml::Value::Table(inner)), toml::Value::Table(values)) => merge(inner, values),
            _ => drop(into.insert(key.clone(), value.clone())),
        }
    }
}

impl Plan {
    /// How long the scenario plays.
    pub(crate) fn play_s(&self) -> Option<f64> {
        let periods = self.scenario.period_count? as f64;
        Some(periods * self.scenario.period_s / self.scenario.speed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::{find, shipped};

    #[test]
    fn every_shipped_simulation_gives_sound_configurations() {
        for scenario in shipped().unwrap().into_iter().filter(|s| s.recording.is_none()) {
            let scenario = scenario.resolve().unwrap();
            let count = scenario.nodes.len();
            let plan = plan(scenario, Path::new("run"), "tcp/127.0.0.1:1").unwrap();
            assert_eq!(plan.agents.len(), count);
            assert!(plan.agents.iter().all(|agent| !agent.simulated.scene.targets.is_empty()));
        }
    }

    #[test]
    fn keys_of_one_node_reach_its_agent_alone() {
        let mut scenario = find("paper").unwrap().resolve().unwrap();
        let own: toml::Table = "[group]\ntilt_deg = 90.0".parse().unwrap();
        scenario.agent_of.insert(scenario.nodes[1].id.clone(), own);
        let tilts_deg = plan(scenario.clone(), Path::new("run"), "tcp/127.0.0.1:1")
            .unwrap()
            .agents
            .iter()
            .map(|agent| agent.group.tilt_deg)
            .collect::<Vec<_>>();
        assert!(tilts_deg[0].abs() < 1e-12 && (tilts_deg[1] - 90.0).abs() < 1e-12);
        let wrong: toml::Table = "tilt = 1".parse().unwrap();
        scenario.agent_of.insert(scenario.nodes[0].id.clone(), wrong);
        let error = plan(scenario, Path::new("run"), "tcp/127.0.0.1:1").err().unwrap();
        assert!(format!("{error:#}").contains("agent_of"), "{error:#}");
    }

    #[test]
    fn unknown_keys_of_an_agent_are_named() {
        let mut scenario = find("paper").unwrap().resolve().unwrap();
        scenario.agent.insert("sped".to_owned(), toml::Value::Integer(1));
        let error = plan(scenario, Path::new("run"), "tcp/127.0.0.1:1").err().unwrap();
        assert!(format!("{error:#}").contains("sped"), "{error:#}");
    }
}
