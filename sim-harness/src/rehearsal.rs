//! A scenario without processes: every agent's simulated echoes become points, and the centre's state
//! machine takes them in, period by period.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, bail};
use fusion_center::config::CentreConfig;
use fusion_center::pipeline::{Centre, Combined, Effect, Event, Job, Solved};
use fusion_center::registration::{Solver, build};
use node_agent::config::AgentConfig;
use node_agent::pipeline::Chain;
use node_agent::source::Frame;
use proto::bus::{BusEvent, Delivery};
use proto::geom::{Node, Point};
use proto::ids::{BootId, NodeId};
use proto::keys::{Keys, Topic};
use proto::time::{CentreTime, ClockEstimate, NodeTime};
use proto::wire::{Counters, Picture, PointSet, Registration, Stamp, Suspicion, decode, encode};

use crate::plan::{Plan, plan};
use crate::scenario::Scenario;

const CENTRE: BootId = BootId(9);
/// When the first period is, on the centre's clock.
const START: CentreTime = CentreTime(10_000_000_000);
/// Where nobody listens: no process is launched.
const NO_ENDPOINT: &str = "tcp/127.0.0.1:1";

/// Everybody's point sets of a whole scenario, and the centre that is to take them in.
pub(crate) struct Rehearsal {
    /// By node, in the order of the scenario, then by period.
    of_agents: Vec<Vec<PointSet>>,
    /// Where the middles of all targets are in the reference node's frame, by period.
    truths: Vec<Vec<Point<Node>>>,
    step: Duration,
    pub(crate) site: Site,
}

impl Rehearsal {
    /// Simulates all echoes of `scenario` and images them.
    ///
    /// # Errors
    /// If a configuration makes no sense, or the scenario has no end.
    pub(crate) fn new(scenario: &Scenario) -> anyhow::Result<Self> {
        let Plan { centre, agents, .. } = plan(scenario.clone(), Path::new(""), NO_ENDPOINT)?;
        let period_count = scenario.period_count.context("the scenario has no end")?;
        let of_agents = agents.iter().map(|agent| sets(agent, period_count));
        let of_agents = of_agents.collect::<anyhow::Result<_>>()?;
        let reference = agents.iter().find(|agent| agent.node == scenario.reference);
        let reference = reference.context("the scenario has no reference node")?;
        let source = reference.clone().open_source()?.source;
        let truth = |period| source.truth(period).map(|truth| truth.targets_in_node);
        let truths = (0..period_count).map(truth).collect::<Option<_>>();
        let truths = truths.context("a recording does not say where people are")?;
        let step = Duration::from_secs_f64(centre.gather.period_s);
        Ok(Self { of_agents, truths, step, site: Site::new(centre) })
    }

    /// Where everybody's middle is in `period`, in the frame of the reference node.
    pub(crate) fn truth(&self, period: u64) -> &[Point<Node>] {
        let index = usize::try_from(period).unwrap_or(usize::MAX);
        self.truths.get(index).map_or(&[], Vec::as_slice)
    }

    /// Plays the next period.
    ///
    /// # Errors
    /// If a message cannot be written or read.
    pub(crate) fn play(&mut self, period: u64) -> anyhow::Result<()> {
        let index = usize::try_from(period)?;
        for of_agent in &self.of_agents {
            let set = of_agent.get(index).context("a period after the end")?;
            self.site.deliver(set.clone())?;
        }
        self.site.now.0 += i64::try_from(self.step.as_nanos())?;
        Ok(())
    }
}

/// The point sets of an agent, one per period.
fn sets(agent: &AgentConfig, period_count: u64) -> anyhow::Result<Vec<PointSet>> {
    let mut config = agent.clone();
    config.chain.thread_count = 1;
    let (half_depth_m, half_depth_sigma_m) = config.half_depth_m();
    let mut chain = Chain::new(&config.chain)?;
    let node = config.node.clone();
    let mut source = config.open_source()?.source;
    let mut sets = Vec::new();
    for period in 0..period_count {
        let Frame::Sweep(sweep) = source.frame(period)? else {
            bail!("node {node}: a rehearsal needs echoes, not detections");
        };
        sets.push(PointSet {
            node: node.clone(),
            period,
            time: NodeTime(0),
            clock: Some(ClockEstimate { centre_boot: CENTRE, offset_ns: 0, error_ns: 1000 }),
            half_depth_m,
            half_depth_sigma_m,
            points: chain.process_sweep(&sweep)?.points,
            counters: Counters::default(),
        });
    }
    Ok(sets)
}

/// The centre, and what it has told.
pub(crate) struct Site {
    centre: Centre,
    solver: Box<dyn Solver>,
    keys: Keys,
    now: CentreTime,
    pub(crate) told: BTreeMap<NodeId, Registration>,
    /// Suspicions that came up since they were last taken.
    pub(crate) raised: Vec<(NodeId, Suspicion)>,
    /// The newest picture.
    pub(crate) picture: Option<Picture>,
}

impl Site {
    fn new(config: CentreConfig) -> Self {
        let solver = build(&config.solver);
        let keys = Keys::new(config.site.clone());
        let centre = Centre::new(Arc::new(config), CENTRE);
        let (told, raised) = (BTreeMap::new(), Vec::new());
        Self { centre, solver, keys, now: START, told, raised, picture: None }
    }

    fn deliver(&mut self, mut set: PointSet) -> anyhow::Result<()> {
        set.time = NodeTime(u64::try_from(self.now.0)?);
        let stamp = Stamp { boot: BootId(1), sequence: set.period, sent_ns: set.time.0 };
        let event = BusEvent::Message(encode(stamp, &set)?);
        let key = self.keys.key(&Topic::Points(set.node));
        let delivery = Delivery { key, event, arrived: tokio::time::Instant::now() };
        let mut effects = self.centre.step(self.now, Event::Delivered(delivery, self.now));
        while let Some(effect) = effects.pop() {
            let done = match effect {
                Effect::Publish(topic, bytes) => {
                    self.hear(topic, &bytes)?;
                    continue;
                }
                Effect::Solve(job) => Event::Solved(Box::new(self.solve(*job))),
                Effect::Combine(combination) => {
                    let (combination, time) = (*combination, Duration::ZERO);
                    let groups = combination.groups();
                    Event::Combined(Box::new(Combined { combination, groups, time }))
                }
                Effect::Save(_) => continue,
            };
            effects.extend(self.centre.step(self.now, done));
        }
        Ok(())
    }

    fn hear(&mut self, topic: Topic, bytes: &[u8]) -> anyhow::Result<()> {
        match topic {
            Topic::Transform(node) => self.hear_of(node, decode::<Registration>(bytes)?.body),
            Topic::Picture => {
                let picture = decode::<Picture>(bytes)?.body;
                let newest = self.picture.as_ref().map(|last| last.period);
                if newest <= Some(picture.period) {
                    self.picture = Some(picture);
                }
            }
            _ => {}
        }
        Ok(())
    }

    fn hear_of(&mut self, node: NodeId, told: Registration) {
        let before = self.told.get(&node).and_then(|one| one.suspicion.clone());
        if let Some(suspicion) = told.suspicion.clone()
            && before.as_ref() != Some(&suspicion)
        {
            self.raised.push((node.clone(), suspicion));
        }
        drop(self.told.insert(node, told));
    }

    fn solve(&self, job: Job) -> Solved {
        let solution = self.solver.solve(&job.problem, job.known.as_ref());
        Solved { job, solution, solver: "default", solve_time: Duration::ZERO }
    }
}
