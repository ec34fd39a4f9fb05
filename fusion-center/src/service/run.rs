//! The event loop: one task owns the pipeline; solving runs on worker threads beside it.

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

use super::Clock;
use crate::config::CentreConfig;
use crate::pipeline::{Centre, Effect, Event, Job, Solved};
use crate::registration::{Solver, build};

/// How often the pipeline looks at the time when nothing comes.
const TICK: Duration = Duration::from_millis(50);

/// Pause between attempts to reach a router.
const DIAL_PAUSE: Duration = Duration::from_secs(1);

/// What the centre listens to.
fn patterns() -> [Pattern; 5] {
    [
        Pattern::AllPoints,
        Pattern::AllStatus,
        Pattern::AllClockProbes,
        Pattern::Command,
        Pattern::AllLive,
    ]
}

/// Runs the centre on the network until `stop`.
///
/// # Errors
/// If the network cannot be joined.
pub async fn run(config: CentreConfig, stop: CancellationToken) -> anyhow::Result<()> {
    let boot = BootId::random();
    let keys = Keys::new(config.site.clone());
    let (bus, deliveries) = tokio::select! {
        () = stop.cancelled() => return Ok(()),
        joined = join(&config.bus, &keys) => joined?,
    };
    bus.declare_alive(&Topic::CentreLive(boot)).await?;
    let CentreConfig { site, reference, bus: bus_config, .. } = &config;
    info!(%site, %reference, %boot, listen = ?bus_config.listen, "centre is up");
    serve(Arc::new(config), boot, &bus, deliveries, stop).await;
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

/// Serves deliveries until `stop` or until the bus is gone.
pub async fn serve(
    config: Arc<CentreConfig>,
    boot: BootId,
    bus: &impl Bus,
    mut deliveries: mpsc::Receiver<Delivery>,
    stop: CancellationToken,
) {
    let clock = Clock::start();
    let solver: Arc<dyn Solver> = Arc::from(build(&config.solver));
    // Never full: at most one solution per node is under way, and a node has one place.
    let (solved_sender, mut solved) = mpsc::channel(config.gather.max_node_count);
    let mut centre = Centre::new(config, boot);
    let mut ticks = tokio::time::interval(TICK);
    ticks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    let mut dropped_before = 0;
    loop {
        let event = tokio::select! {
            () = stop.cancelled() => break,
            Some(done) = solved.recv() => done,
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
                Effect::Solve(job) => start(Arc::clone(&solver), *job, solved_sender.clone()),
            }
        }
        let dropped = bus.dropped_count();
        if dropped_before < dropped {
            warn!(dropped, "deliveries dropped: the centre does not keep up");
            dropped_before = dropped;
        }
    }
    info!("centre stops");
}

async fn publish(bus: &impl Bus, topic: &Topic, bytes: Vec<u8>) {
    if let Err(failure) = bus.publish(topic, bytes).await {
        warn!(%failure, "not published");
    }
}

fn start(solver: Arc<dyn Solver>, job: Job, done: mpsc::Sender<Event>) {
    tokio::spawn(async move {
        let node = job.node.clone();
        let work = tokio::task::spawn_blocking(move || {
            let clock = Clock::start();
            let solution = solver.solve(&job.problem, job.known.as_ref());
            let solve_time = clock.now().since(proto::time::CentreTime(0));
            Box::new(Solved { job, solution, solver: solver.name(), solve_time })
        });
        let event = match work.await {
            Ok(solved) => Event::Solved(solved),
            Err(failure) => {
                error!(%node, %failure, "solving failed");
                Event::SolveFailed(node)
            }
        };
        // The loop has ended if nobody takes it: there is nothing left to tell.
        drop(done.send(event).await);
    });
}
