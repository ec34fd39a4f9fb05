//! One run: launch, watch, kill what is to be killed, wait for the end, score.

use std::path::Path;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use anyhow::{Context, bail};
use proto::bus::{Bus, Delivery, ZenohBus};
use proto::ids::NodeId;
use proto::keys::Keys;
use tokio::sync::mpsc;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use crate::launch::{Incident, Processes};
use crate::observe::{Observer, join};
use crate::plan::{Plan, plan};
use crate::progress::Progress;
use crate::report::Report;
use crate::resources::Sampler;
use crate::scenario::Scenario;

/// The centre must listen within this time.
pub(crate) const CENTRE_LIMIT: Duration = Duration::from_secs(15);
/// From the launch of the agents to the first period, and more for each agent: all must be up.
const LEAD: Duration = Duration::from_millis(600);
const LEAD_PER_AGENT: Duration = Duration::from_millis(100);
/// After the last period, all sets must have been taken within this time.
const SETTLE_LIMIT: Duration = Duration::from_secs(10);
/// What has died is started again after this time, as a service manager would.
pub(crate) const RESTART_DELAY: Duration = Duration::from_millis(500);
pub(crate) const STEP: Duration = Duration::from_millis(100);
pub(crate) const SAMPLE_INTERVAL: Duration = Duration::from_secs(1);

/// How to run.
pub(crate) struct Options<'a> {
    /// Where the run's files go.
    pub(crate) folder: &'a Path,
    /// Where the programs are, if not this one under their names.
    pub(crate) programs: Option<&'a Path>,
    /// What the children log.
    pub(crate) log_filter: &'a str,
}

/// Runs a scenario to its end.
///
/// # Errors
/// If it cannot be launched, or was told to stop.
pub(crate) async fn run(
    scenario: Scenario,
    options: &Options<'_>,
    stop: &CancellationToken,
) -> anyhow::Result<Report> {
    for part in ["config", "logs", "points", "images"] {
        let folder = options.folder.join(part);
        std::fs::create_dir_all(&folder)
            .with_context(|| format!("creating {}", folder.display()))?;
    }
    let endpoint = format!("tcp/127.0.0.1:{}", free_port()?);
    let plan = plan(scenario, options.folder, &endpoint)?;
    std::fs::write(options.folder.join("scenario.toml"), toml::to_string(&plan.scenario)?)?;
    let mut processes = Processes::new(options.folder, options.programs, options.log_filter)?;
    let progress = Progress::new(&plan.scenario);
    let result = tokio::select! {
        () = stop.cancelled() => Err(anyhow::anyhow!("stopped before the end")),
        result = play(&plan, &mut processes, progress) => result,
    };
    let not_well = processes.stop().await;
    let (observer, sampler, incidents) = result?;
    let mut report = Report::new(&plan, &observer, sampler.finish(), incidents);
    report.incidents.extend(not_well);
    Ok(report)
}

type Played = (Observer, Sampler, Vec<Incident>);

async fn play(
    plan: &Plan,
    processes: &mut Processes,
    progress: Progress,
) -> anyhow::Result<Played> {
    let keys = Keys::new("sim".parse()?);
    processes.start("centre", "fusion-center", &plan.centre)?;
    let (bus, deliveries) = wait_for_centre(plan, processes, &keys).await?;
    let lead = LEAD + LEAD_PER_AGENT * u32::try_from(plan.agents.len())?;
    let start_unix_s = unix_now_s() + lead.as_secs_f64();
    for agent in &plan.agents {
        let mut agent = agent.clone();
        agent.play.start_unix_s = Some(start_unix_s);
        processes.start(agent.node.as_str(), "node-agent", &agent)?;
    }
    let mut stage = Stage {
        plan,
        processes,
        progress,
        keys,
        start: Instant::now() + lead,
        observer: Observer::default(),
        sampler: Sampler::new()?,
        incidents: Vec::new(),
        restart_at: None,
        next_kill: 0,
        last_heard: Instant::now(),
    };
    stage.watch(deliveries).await?;
    stage.progress.finish();
    bus.close().await;
    Ok((stage.observer, stage.sampler, stage.incidents))
}

async fn wait_for_centre(
    plan: &Plan,
    processes: &mut Processes,
    keys: &Keys,
) -> anyhow::Result<(ZenohBus, mpsc::Receiver<Delivery>)> {
    let deadline = Instant::now() + CENTRE_LIMIT;
    loop {
        let failure = match join(&plan.endpoint, keys).await {
            Ok(joined) => return Ok(joined),
            Err(failure) => failure,
        };
        if let Some(Incident { who, how, .. }) = processes.ended().into_iter().next() {
            bail!("{who} ended at once ({how}):\n{}", processes.log_tail(&who));
        }
        if deadline < Instant::now() {
            return Err(failure).context("the centre does not answer");
        }
        tokio::time::sleep(STEP).await;
    }
}

/// A run while it goes on.
struct Stage<'a> {
    plan: &'a Plan,
    processes: &'a mut Processes,
    progress: Progress,
    keys: Keys,
    start: Instant,
    observer: Observer,
    sampler: Sampler,
    incidents: Vec<Incident>,
    restart_at: Option<Instant>,
    next_kill: usize,
    last_heard: Instant,
}

impl Stage<'_> {
    /// Watches until every agent's source has ended and the centre has taken everything in.
    async fn watch(&mut self, mut deliveries: mpsc::Receiver<Delivery>) -> anyhow::Result<()> {
        let mut steps = tokio::time::interval(STEP);
        let mut next_sample = Instant::now();
        let mut finished_at = None;
        loop {
            tokio::select! {
                Some(delivery) = deliveries.recv() => {
                    self.last_heard = Instant::now();
                    self.observer.take(&self.keys, &delivery);
                    continue;
                }
                _ = steps.tick() => {}
            }
            self.mind_processes().await?;
            if next_sample <= Instant::now() {
                self.sampler.sample(self.processes.pids());
                next_sample += SAMPLE_INTERVAL;
            }
            self.progress.show(&self.plan.scenario, &self.observer);
            self.check_deadline()?;
            if !self.all(|seen| seen.has_finished() || seen.is_silent()) {
                continue;
            }
            let waited = finished_at.get_or_insert_with(Instant::now).elapsed();
            if SETTLE_LIMIT < waited || self.all(|seen| seen.is_settled() || seen.is_silent()) {
                return self.check_kills();
            }
        }
    }

    fn all(&self, mut condition: impl FnMut(&crate::observe::Seen) -> bool) -> bool {
        let is_lost = |id: &NodeId| self.incidents.iter().any(|lost| lost.who == id.as_str());
        let mut ids = self.plan.scenario.nodes.iter().map(|node| &node.id);
        ids.all(|id| is_lost(id) || self.observer.nodes.get(id).is_some_and(&mut condition))
    }

    /// Kills what is due, notices what has died, starts the centre again.
    async fn mind_processes(&mut self) -> anyhow::Result<()> {
        let kills = &self.plan.scenario.kills;
        while let Some(kill) = kills.get(self.next_kill)
            && self.start + Duration::from_millis(kill.after_ms) <= Instant::now()
        {
            self.processes.kill(&kill.who).await?;
            self.next_kill += 1;
        }
        for Incident { who, how, by_itself } in self.processes.ended() {
            if by_itself {
                bail!("{who} ended ({how}):\n{}", self.processes.log_tail(&who));
            }
            let how = format!("{how} after {:.1} s", self.start.elapsed().as_secs_f64());
            self.progress.say(&format!("{who} ended: {how}"));
            if who == "centre" {
                self.restart_at = Some(Instant::now() + RESTART_DELAY);
            }
            self.incidents.push(Incident { who, how, by_itself });
        }
        if self.restart_at.is_some_and(|at| at <= Instant::now()) {
            self.restart_at = None;
            self.processes.start_again("centre")?;
            self.progress.say("centre started again");
        }
        Ok(())
    }

    /// A kill that was asked for and never happened has proven nothing.
    fn check_kills(&self) -> anyhow::Result<()> {
        let Some(kill) = self.plan.scenario.kills.get(self.next_kill) else { return Ok(()) };
        bail!("the run ended before {} was to be killed", String::from(kill.clone()))
    }

    /// A run whose agents never finish, or whose centre hangs, must end too.
    fn check_deadline(&self) -> anyhow::Result<()> {
        if CENTRE_LIMIT < self.last_heard.elapsed() {
            let tail = self.processes.log_tail("centre");
            bail!("nothing was heard of the centre for {CENTRE_LIMIT:?}:\n{tail}");
        }
        let Some(play_s) = self.plan.play_s() else { return Ok(()) };
        let limit = Duration::from_secs_f64(play_s * 1.5) + CENTRE_LIMIT + SETTLE_LIMIT;
        if self.start.elapsed() < limit {
            return Ok(());
        }
        let unfinished = |id: &&NodeId| {
            !self.observer.nodes.get(*id).is_some_and(crate::observe::Seen::has_finished)
        };
        let ids = self.plan.scenario.nodes.iter().map(|node| &node.id);
        let names: Vec<String> = ids.filter(unfinished).map(ToString::to_string).collect();
        let tails: Vec<String> = names.iter().map(|who| self.processes.log_tail(who)).collect();
        bail!("{} did not finish within {limit:?}:\n{}", names.join(", "), tails.join("\n"))
    }
}

/// A port of the loopback interface that nobody listens on.
pub(crate) fn free_port() -> anyhow::Result<u16> {
    let listener = std::net::TcpListener::bind(("127.0.0.1", 0)).context("finding a free port")?;
    Ok(listener.local_addr()?.port())
}

#[expect(
    clippy::disallowed_methods,
    reason = "agents are told their common start as calendar time; this is the harness's shell"
)]
pub(crate) fn unix_now_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64())
}
