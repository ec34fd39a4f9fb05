//! One run: launch, watch the map, kill and start again what is to be killed, wait for the end.

use std::collections::BTreeMap;
use std::time::Duration;

use anyhow::{Context, bail};
use proto::bus::{Bus, BusEvent, Delivery, ZenohBus};
use proto::config::BusConfig;
use proto::ids::NodeId;
use proto::keys::{Keys, Pattern, Topic};
use proto::wire::{MapTracks, NodeStatus, SourceState, decode};
use tokio::sync::mpsc;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tracing::warn;

use super::report::{Report, Scored};
use super::scenario::{WidePlan, WideScenario};
use crate::launch::{Incident, Processes};
use crate::resources::Sampler;
use crate::run::{
    CENTRE_LIMIT, Options, RESTART_DELAY, SAMPLE_INTERVAL, STEP, free_port, unix_now_s,
};

/// From the launch of the agents to the first dwell.
const LEAD: Duration = Duration::from_millis(1200);
/// The map is complete when it was silent for this long after the last agent has ended: longer than
/// any dwell waits at the centre.
const QUIET: Duration = Duration::from_secs(3);

/// Runs a scenario to its end and scores the map.
///
/// # Errors
/// If it cannot be launched, or was told to stop.
pub(crate) async fn run(
    scenario: WideScenario,
    options: &Options<'_>,
    stop: &CancellationToken,
) -> anyhow::Result<Report> {
    for part in ["config", "logs"] {
        let folder = options.folder.join(part);
        std::fs::create_dir_all(&folder)
            .with_context(|| format!("creating {}", folder.display()))?;
    }
    let plan = WidePlan::new(scenario, &format!("tcp/127.0.0.1:{}", free_port()?))?;
    std::fs::write(options.folder.join("scenario.toml"), toml::to_string(&plan.scenario)?)?;
    let mut processes = Processes::new(options.folder, options.programs, options.log_filter)?;
    let mut stage = Stage {
        scored: Scored::new(plan.scene()?)?,
        plan: &plan,
        processes: &mut processes,
        statuses: BTreeMap::new(),
        sampler: Sampler::new()?,
        incidents: Vec::new(),
        restarts: Vec::new(),
        next_kill: 0,
        start: Instant::now(),
        last_news: Instant::now(),
    };
    let played = tokio::select! {
        () = stop.cancelled() => Err(anyhow::anyhow!("stopped before the end")),
        played = stage.play() => played,
    };
    let Stage { scored, sampler, mut incidents, .. } = stage;
    incidents.extend(processes.stop().await);
    played?;
    Report::new(&plan, scored, sampler.finish(), incidents, options.folder)
}

/// A run while it goes on.
struct Stage<'a> {
    plan: &'a WidePlan,
    processes: &'a mut Processes,
    scored: Scored,
    statuses: BTreeMap<NodeId, NodeStatus>,
    sampler: Sampler,
    incidents: Vec<Incident>,
    /// Who is to be started again, and when.
    restarts: Vec<(String, Instant)>,
    next_kill: usize,
    start: Instant,
    last_news: Instant,
}

impl Stage<'_> {
    async fn play(&mut self) -> anyhow::Result<()> {
        let keys = Keys::new("sim".parse()?);
        self.processes.start("centre", "fusion-center", &self.plan.centre)?;
        let (bus, mut deliveries) = self.join(&keys).await?;
        self.start = Instant::now() + LEAD;
        let start_unix_s = unix_now_s() + LEAD.as_secs_f64();
        for agent in &self.plan.agents {
            let mut agent = agent.clone();
            agent.play.start_unix_s = Some(start_unix_s);
            self.processes.start(agent.node.as_str(), "node-agent", &agent)?;
        }
        self.last_news = self.start;
        let mut steps = tokio::time::interval(STEP);
        let mut next_sample = Instant::now();
        loop {
            tokio::select! {
                Some(delivery) = deliveries.recv() => {
                    self.take(&keys, &delivery);
                    continue;
                }
                _ = steps.tick() => {}
            }
            self.mind_processes().await?;
            if next_sample <= Instant::now() {
                self.sampler.sample(self.processes.pids());
                next_sample += SAMPLE_INTERVAL;
            }
            if self.has_ended() {
                break;
            }
            self.check_deadline()?;
        }
        bus.close().await;
        if let Some(kill) = self.plan.scenario.kills.get(self.next_kill) {
            bail!("the run ended before {} was to be killed", String::from(kill.clone()));
        }
        Ok(())
    }

    async fn join(&self, keys: &Keys) -> anyhow::Result<(ZenohBus, mpsc::Receiver<Delivery>)> {
        let connect = vec![self.plan.endpoint.clone()];
        let config = BusConfig { connect, ..BusConfig::default() };
        let patterns = [Pattern::AllStatus, Pattern::MapTracks];
        let deadline = Instant::now() + CENTRE_LIMIT;
        loop {
            match ZenohBus::open(&config, keys.clone(), &patterns).await {
                Ok(joined) => return Ok(joined),
                Err(failure) if deadline < Instant::now() => {
                    let tail = self.processes.log_tail("centre");
                    return Err(failure).context(format!("the centre does not answer:\n{tail}"));
                }
                Err(_) => tokio::time::sleep(STEP).await,
            }
        }
    }

    fn take(&mut self, keys: &Keys, delivery: &Delivery) {
        let BusEvent::Message(bytes) = &delivery.event else { return };
        let taken = match keys.parse(&delivery.key) {
            Ok(Topic::Status(node)) => decode::<NodeStatus>(bytes).map(|status| {
                self.statuses.insert(node, status.body);
            }),
            Ok(Topic::MapTracks) => decode::<MapTracks>(bytes).map(|map| {
                self.last_news = Instant::now();
                self.scored.take(&map.body);
            }),
            _ => return,
        };
        if let Err(refusal) = taken {
            warn!(key = %delivery.key, %refusal, "message refused");
        }
    }

    /// Kills what is due, notices what has died, starts it again.
    async fn mind_processes(&mut self) -> anyhow::Result<()> {
        while let Some(kill) = self.plan.scenario.kills.get(self.next_kill)
            && self.start + Duration::from_millis(kill.after_ms) <= Instant::now()
        {
            self.processes.kill(&kill.who).await?;
            self.next_kill += 1;
        }
        for Incident { who, how, by_itself } in self.processes.ended() {
            if by_itself {
                bail!("{who} ended ({how}):\n{}", self.processes.log_tail(&who));
            }
            self.restarts.push((who.clone(), Instant::now() + RESTART_DELAY));
            let how = format!("{how} after {:.1} s", self.start.elapsed().as_secs_f64());
            self.incidents.push(Incident { who, how, by_itself });
        }
        let now = Instant::now();
        for (who, _) in self.restarts.extract_if(.., |(_, at)| *at <= now) {
            self.processes.start_again(&who)?;
        }
        Ok(())
    }

    fn has_ended(&self) -> bool {
        let is_over = |agent: &node_agent::config::AgentConfig| {
            let status = self.statuses.get(&agent.node);
            status.is_some_and(|status| status.source == SourceState::Finished)
        };
        self.plan.agents.iter().all(is_over) && QUIET < self.last_news.elapsed()
    }

    fn check_deadline(&self) -> anyhow::Result<()> {
        let Some(play_s) = self.plan.play_s() else { return Ok(()) };
        let limit = Duration::from_secs_f64(1.5 * play_s) + 2 * CENTRE_LIMIT;
        if self.start.elapsed() < limit {
            return Ok(());
        }
        let names = std::iter::once("centre")
            .chain(self.plan.agents.iter().map(|agent| agent.node.as_str()));
        let tails: Vec<String> = names.map(|who| self.processes.log_tail(who)).collect();
        bail!("not done within {limit:?}:\n{}", tails.join("\n"))
    }
}
