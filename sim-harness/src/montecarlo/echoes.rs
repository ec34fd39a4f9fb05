//! Trials through the real chain: an agent's simulated source, its chain, the centre's problem.

use std::path::Path;

use anyhow::{Context, bail, ensure};
use fusion_center::registration::{Period, Problem};
use fusion_center::simulate::pair_information;
use nalgebra::{Cholesky, Matrix3};
use node_agent::config::AgentConfig;
use node_agent::imaging::Sweep;
use node_agent::imaging::canceller::CancellerConfig;
use node_agent::pipeline::Chain;
use node_agent::simulate::{Disturbance, Truth};
use node_agent::source::Frame;
use proto::geom::{Gaussian, Node, Point, Ref, Se2};

use super::Condition;
use super::bound::PointBound;
use super::trials::{Case, Seeds};
use crate::plan::plan;
use crate::scenario::Scenario;

/// The agents of a scenario under one condition, ready to be played with any seed.
pub(super) struct Stage {
    /// The reference node first.
    nodes: [StageNode; 2],
    truth: Se2<Ref, Node>,
    /// The first period that solvers get.
    first_period: u64,
    period_count: u64,
}

struct StageNode {
    agent: AgentConfig,
    /// A chain that has seen nothing.
    chain: Chain,
    bound: Option<PointBound>,
}

impl StageNode {
    /// The targets of a period, measured as well as can be; none where no bound is known.
    fn best(&self, truth: &Truth) -> Vec<Option<Gaussian<Node>>> {
        let Some(bound) = &self.bound else { return Vec::new() };
        let places = truth.targets_in_node.iter().zip(&truth.visible);
        places.map(|(place, shows)| bound.measured(*place).filter(|_| *shows)).collect()
    }
}

/// One period as a node saw it and as it was.
struct Seen {
    time_s: f64,
    /// The targets' middles.
    points: Vec<Gaussian<Node>>,
    /// The true places, measured as well as can be; `None` for targets that do not show.
    best: Vec<Option<Gaussian<Node>>>,
}

impl Stage {
    /// The two nodes of `scenario`. Solvers get the last `counted` periods, or all.
    ///
    /// # Errors
    /// If the scenario is not a simulation of two nodes with an end, or makes no sense.
    pub(super) fn new(
        scenario: &Scenario,
        condition: &Condition,
        counted: Option<u64>,
    ) -> anyhow::Result<Self> {
        let name = &scenario.name;
        ensure!(scenario.recording.is_none(), "scenario {name}: it plays a recording; simulate");
        let count = scenario.nodes.len();
        ensure!(count == 2, "scenario {name}: it has {count} nodes; the experiment needs 2");
        let Some(period_count) = scenario.period_count else {
            bail!("scenario {name}: it has no end; give it a period_count");
        };
        // Nothing is written or launched: folder and endpoint are not used.
        let plan = plan(scenario.clone(), Path::new(""), "tcp/127.0.0.1:1")?;
        let is_reference = |agent: &AgentConfig| agent.node == scenario.reference;
        let (reference, others): (Vec<_>, Vec<_>) = plan.agents.into_iter().partition(is_reference);
        let mut nodes = reference.into_iter().chain(others).map(|agent| stage(agent, condition));
        let (Some(first), Some(second)) = (nodes.next(), nodes.next()) else {
            bail!("scenario {name}: a node is missing");
        };
        let other = scenario.nodes.iter().find(|node| node.id != scenario.reference);
        let truth = other.map_or_else(Se2::identity, |node| scenario.truth(node));
        let first_period = counted.map_or(0, |counted| period_count.saturating_sub(counted));
        Ok(Self { nodes: [first?, second?], truth, first_period, period_count })
    }

    /// One trial.
    ///
    /// # Errors
    /// If the chain refuses a sweep, which no sound scenario makes it do.
    pub(super) fn case(&self, seeds: &Seeds) -> anyhow::Result<Case> {
        let [reference, node] = &self.nodes;
        let in_ref = self.watch(reference, seeds.nodes[0])?;
        let in_node = self.watch(node, seeds.nodes[1])?;
        let bound = self.bound(&in_ref, &in_node);
        let periods = in_ref.into_iter().zip(in_node).map(|(one, other)| Period {
            ref_time_s: one.time_s,
            node_time_s: other.time_s,
            in_ref: one.points.iter().map(as_ref).collect(),
            in_node: other.points,
        });
        let problem = Problem {
            periods: periods.collect(),
            ref_half_depth_sigma_m: reference.agent.half_depth_m().1,
            node_half_depth_sigma_m: node.agent.half_depth_m().1,
        };
        Ok(Case { problem, truth: self.truth, bound })
    }

    /// Plays one node's source through its chain.
    fn watch(&self, node: &StageNode, seed: u64) -> anyhow::Result<Vec<Seen>> {
        let mut agent = node.agent.clone();
        agent.simulated.seed = seed;
        let (half_depth_m, _) = agent.half_depth_m();
        let mut source = agent.open_source()?.source;
        let mut chain = node.chain.clone();
        let mut all = Vec::new();
        for period in 0..self.period_count {
            let Frame::Sweep(sweep) = source.frame(period)? else {
                bail!("period {period}: the source gives no sweep");
            };
            let measured = chain.process_sweep(&sweep)?;
            if period < self.first_period {
                continue;
            }
            let points = measured.points.iter().map(|point| point.middle(half_depth_m, 0.0));
            let best = source.truth(period).map_or_else(Vec::new, |truth| node.best(&truth));
            let (points, time_s) = (points.collect(), source.middle_s(period));
            all.push(Seen { time_s, points, best });
        }
        Ok(all)
    }

    /// The bound of the targets that both saw.
    fn bound(&self, in_ref: &[Seen], in_node: &[Seen]) -> Option<Matrix3<f64>> {
        let periods = in_ref.iter().zip(in_node);
        let pairs = periods.flat_map(|(one, other)| one.best.iter().zip(&other.best));
        let information = pairs
            .map(|(one, other)| pair_information(&self.truth, (&one.as_ref().map(as_ref), other)));
        Cholesky::new(information.sum::<Matrix3<f64>>()).map(|factor| factor.inverse())
    }
}

fn stage(mut agent: AgentConfig, condition: &Condition) -> anyhow::Result<StageNode> {
    if !condition.is_of_scenario {
        let disturbance = &mut agent.simulated.disturbance;
        disturbance.detection_probability = condition.detection_probability;
        disturbance.false_point_probability = condition.false_probability;
    }
    // Trials share the processors, not the pixels of one image.
    agent.chain.thread_count = 1;
    let mut chain = Chain::new(&agent.chain).with_context(|| format!("node {}", agent.node))?;
    if agent.chain.canceller != CancellerConfig::None {
        chain.use_background(&empty_room(&agent)?.samples)?;
    }
    let bound = PointBound::of_agent(&agent);
    Ok(StageNode { agent, chain, bound })
}

/// What the node receives of the scene before anybody enters it, as a long average shows it.
fn empty_room(agent: &AgentConfig) -> anyhow::Result<Sweep> {
    let mut empty = agent.clone();
    empty.simulated.scene.targets.clear();
    empty.simulated.disturbance = Disturbance::default();
    match empty.open_source()?.source.frame(0)? {
        Frame::Sweep(sweep) => Ok(sweep),
        Frame::Detections(_) => bail!("node {}: the source gives no sweep", agent.node),
    }
}

/// The reference node's own frame is `Ref`: only the name of the frame changes.
fn as_ref(point: &Gaussian<Node>) -> Gaussian<Ref> {
    Gaussian { mean: Point::from_coords(point.mean.coords_m), cov_m2: point.cov_m2 }
}
