//! The event loop: one task owns the pipeline; solving and combining run on worker threads.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use proto::bus::{Bus, Delivery, ZenohBus};
use proto::config::BusConfig;
use proto::ids::BootId;
use proto::keys::{Keys, Pattern, Topic};
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;
use tracing::{error, info, warn};

use super::map::{Outputs, part, serve_map};
use super::{Clock, state};
use crate::config::CentreConfig;
use crate::map::MapCentre;
use crate::pipeline::{Centre, Combination, Combined, Effect, Event, Job, Solved};
use crate::registration::{Solver, build};
use crate::replace;

/// How often the pipeline looks at the time when nothing comes.
const TICK: Duration = Duration::from_millis(50);

/// Pause between attempts to reach a router.
const DIAL_PAUSE: Duration = Duration::from_secs(1);

/// Deliveries between the inbox, which counts what it cannot hold, and the loop.
const PASSING_COUNT: usize = 64;

/// What the centre listens to.
fn patterns() -> [Pattern; 7] {
    [
        Pattern::AllDwells,
        Pattern::AllPoints,
        Pattern::AllTracks,
        Pattern::AllStatus,
        Pattern::AllClockProbes,
        Pattern::Command,
        Pattern::AllLive,
    ]
}

/// Runs the centre on the network until `stop`.
///
/// # Errors
/// If the network cannot be joined, or the state file cannot be used.
pub async fn run(config: CentreConfig, stop: CancellationToken) -> anyhow::Result<()> {
    let boot = BootId::random();
    let mut centre = Centre::new(Arc::new(with_workers(config.clone())), boot);
    restore(&config, &mut centre)?;
    let map = MapCentre::new(config.wide.clone(), config.site.clone(), boot);
    let map = map.context("configuration: wide")?;
    let outputs = Outputs::open(&config.wide.output).await?;
    let keys = Keys::new(config.site.clone());
    let (bus, deliveries) = tokio::select! {
        () = stop.cancelled() => return Ok(()),
        joined = join(&config.bus, &keys) => joined?,
    };
    bus.declare_alive(&Topic::CentreLive(boot)).await?;
    let (site, reference, listen) = (&config.site, &config.reference, &config.bus.listen);
    info!(%site, %reference, %boot, ?listen, "centre is up");
    let bus = Arc::new(bus);
    let (other_sender, others) = mpsc::channel(PASSING_COUNT);
    let (dwell_sender, dwells) = mpsc::channel(config.bus.inbox_count);
    let parting = tokio::spawn(part(keys, deliveries, other_sender, dwell_sender));
    let mapping = tokio::spawn(serve_map(map, outputs, Arc::clone(&bus), dwells, stop.clone()));
    serve(config, centre, bus.as_ref(), others, stop).await;
    parting.abort();
    mapping.await.context("the map's task")?;
    bus.close().await;
    Ok(())
}

/// Opens the port, or dials the router until it answers.
async fn join(
    config: &BusConfig,
    keys: &Keys,
) -> anyhow::Result<(ZenohBus, mpsc::Receiver<Delivery>)> {
    loop {
        let opened = ZenohBus::open(config, keys.clone(), &patterns()).await;
        if !config.listen.is_empty() {
            let remedy = "is another centre running there? choose another port with --listen";
            return opened.context(remedy);
        }
        match opened {
            Ok(joined) => return Ok(joined),
            Err(error) => warn!(%error, retry_in = ?DIAL_PAUSE, "the router is not there yet"),
        }
        tokio::time::sleep(DIAL_PAUSE).await;
    }
}

/// The configuration with the number of cores where it leaves the number of workers open.
fn with_workers(mut config: CentreConfig) -> CentreConfig {
    if config.work.worker_count == 0 {
        config.work.worker_count = std::thread::available_parallelism().map_or(1, usize::from);
    }
    config
}

fn restore(config: &CentreConfig, centre: &mut Centre) -> anyhow::Result<()> {
    let path = Path::new(&config.state.path);
    if config.state.path.is_empty() {
        return Ok(());
    }
    replace::check_writable("state.path", path)?;
    let Some(text) = state::read(path)? else { return Ok(()) };
    centre.restore(&text).with_context(|| format!("state file {}", path.display()))
}

/// Serves deliveries until `stop` or until the bus is gone.
pub async fn serve(
    config: CentreConfig,
    mut centre: Centre,
    bus: &impl Bus,
    mut deliveries: mpsc::Receiver<Delivery>,
    stop: CancellationToken,
) {
    let clock = Clock::start();
    let solver: Arc<dyn Solver> = Arc::from(build(&config.solver));
    // Never full: as many solutions as there are workers are under way, and one combination.
    let (done_sender, mut done) = mpsc::channel(1 + with_workers(config.clone()).work.worker_count);
    let mut ticks = tokio::time::interval(TICK);
    ticks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    let mut dropped_before = 0;
    loop {
        let event = tokio::select! {
            () = stop.cancelled() => break,
            Some(event) = done.recv() => event,
            delivery = deliveries.recv() => match delivery {
                Some(delivery) => {
                    let arrived = clock.at(delivery.arrived);
                    Event::Delivered(delivery, arrived)
                }
                None => break,
            },
            _ = ticks.tick() => Event::Tick,
        };
        for effect in centre.step(clock.now(), event) {
            match effect {
                Effect::Publish(topic, bytes) => publish(bus, &topic, bytes).await,
                Effect::Solve(job) => start(Arc::clone(&solver), *job, done_sender.clone()),
                Effect::Combine(combination) => start_combining(*combination, done_sender.clone()),
                Effect::Save(text) => save(&config.state.path, text).await,
            }
        }
        let dropped = bus.dropped_count();
        if dropped_before < dropped {
            warn!(dropped, "deliveries dropped: the centre does not keep up");
            dropped_before = dropped;
        }
    }
    if let Some(text) = centre.state().filter(|_| !config.state.path.is_empty()) {
        save(&config.state.path, text).await;
    }
    info!("centre stops");
}

/// Writes the state file beside the event loop; the centre works on without it.
async fn save(path: &str, text: String) {
    let named = path.to_owned();
    let written =
        tokio::task::spawn_blocking(move || replace::write(Path::new(&named), text.as_bytes()));
    match written.await {
        Ok(Ok(())) => {}
        Ok(Err(failure)) => warn!(%path, %failure, "state not saved"),
        Err(failure) => warn!(%path, %failure, "state not saved"),
    }
}

async fn publish(bus: &impl Bus, topic: &Topic, bytes: Vec<u8>) {
    if let Err(failure) = bus.publish(topic, bytes).await {
        warn!(%failure, "not published");
    }
}

fn start(solver: Arc<dyn Solver>, job: Job, done: mpsc::Sender<Event>) {
    tokio::spawn(async move {
        let pair = job.pair.clone();
        let work = tokio::task::spawn_blocking(move || {
            let clock = Clock::start();
            let solution = solver.solve(&job.problem, job.known.as_ref());
            let solve_time = clock.now().since(proto::time::CentreTime(0));
            Box::new(Solved { job, solution, solver: solver.name(), solve_time })
        });
        let event = match work.await {
            Ok(solved) => Event::Solved(solved),
            Err(failure) => {
                error!(?pair, %failure, "solving failed");
                Event::SolveFailed(pair)
            }
        };
        // The loop has ended if nobody takes it: there is nothing left to tell.
        drop(done.send(event).await);
    });
}

fn start_combining(combination: Combination, done: mpsc::Sender<Event>) {
    tokio::spawn(async move {
        let work = tokio::task::spawn_blocking(move || {
            let clock = Clock::start();
            let groups = combination.groups();
            let time = clock.now().since(proto::time::CentreTime(0));
            Box::new(Combined { combination, groups, time })
        });
        let event = match work.await {
            Ok(combined) => Event::Combined(combined),
            Err(failure) => {
                error!(%failure, "combining failed");
                Event::CombineFailed
            }
        };
        // The loop has ended if nobody takes it: there is nothing left to tell.
        drop(done.send(event).await);
    });
}
