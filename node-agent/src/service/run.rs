//! One agent: measures from the first moment, joins the network as soon as it is there.

use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use proto::bus::{Bus, BusError, Delivery, ZenohBus};
use proto::config::BusConfig;
use proto::ids::BootId;
use proto::keys::{Keys, Pattern, Topic};
use proto::refusals::Refusals;
use proto::time::ClockEstimate;
use tokio::sync::{broadcast, mpsc, watch};
use tokio_util::sync::CancellationToken;
use tracing::{info, warn};

use super::clock::Clock;
use super::downlink::{Downlink, Heard};
use super::follow::{Follow, Newest};
use super::gmti::{self, Gmti};
use super::live::Live;
use super::measure::{Measure, Progress, Source};
use super::output::Output;
use super::uplink::{self, Sender, Uplifted};
use crate::config::{AgentConfig, AgentKind, Opened, SourceKind};
use crate::pipeline::Chain;

/// Pauses between attempts to join the network, growing.
const FIRST_PAUSE: Duration = Duration::from_millis(200);
const LONGEST_PAUSE: Duration = Duration::from_secs(3);
/// After the source has ended the last sets are given this long to leave.
const DRAIN_LIMIT: Duration = Duration::from_secs(1);

/// Runs the agent until its source ends and it is told to stop, or `stop`.
///
/// # Errors
/// If the source cannot be opened or a file not be created. A network that is away is no error.
pub async fn run(config: AgentConfig, stop: CancellationToken) -> anyhow::Result<()> {
    if config.kind == AgentKind::Gmti {
        return run_gmti(config, stop).await;
    }
    let clock = Clock::start();
    let sender = Sender { node: config.node.clone(), boot: BootId::random(), clock };
    let (config, source, background) = match config.source {
        SourceKind::Live => {
            let live = Live::open(&config, clock).await?;
            (config, Source::Live(Box::new(live)), None)
        }
        _ => {
            let Opened { config, source, background } = config.open_source()?;
            (config, Source::Played(source), background)
        }
    };
    let mut chain = Chain::new(&config.chain).context("configuration: chain")?;
    if let Some(background) = background {
        chain.use_background(&background)?;
    }
    let output = Output::open(&config.output)?;
    let (sets, set_receiver) = broadcast::channel(config.bus.history_count);
    let (progress, progress_shown) = watch::channel(Progress::default());
    let (dropped, dropped_shown) = watch::channel(0);
    let (newest, newest_shown) = watch::channel(None);
    let follow = Follow::new(&config, newest).context("configuration")?;
    info!(node = %config.node, boot = %sender.boot, source = ?config.source, "agent is up");

    let network = Network {
        keys: Keys::new(config.site.clone()),
        bus: config.bus.clone(),
        sender,
        progress: progress_shown,
        tracks: newest_shown,
        dropped,
    };
    let network = tokio::spawn(network.run(set_receiver, stop.clone()));
    let measure =
        Measure { config, clock, chain, output, follow, sets, progress, dropped: dropped_shown };
    measure.run(source, stop.clone()).await;
    network.await.context("the network task")?;
    Ok(())
}

/// Runs the agent of a wide-area radar until it is told to stop.
async fn run_gmti(config: AgentConfig, stop: CancellationToken) -> anyhow::Result<()> {
    let clock = Clock::start();
    let sender = Sender { node: config.node.clone(), boot: BootId::random(), clock };
    let opened = gmti::Opened::open(&config).await?;
    let (dwells, dwell_receiver) = broadcast::channel(config.bus.history_count);
    let (progress, progress_shown) = watch::channel(Progress::default());
    let (dropped, dropped_shown) = watch::channel(0);
    let (_nobody, nobody_shown) = watch::channel(None);
    info!(node = %config.node, boot = %sender.boot, source = ?config.gmti.source, "agent is up");
    let network = Network {
        keys: Keys::new(config.site.clone()),
        bus: config.bus.clone(),
        sender,
        progress: progress_shown,
        tracks: nobody_shown,
        dropped,
    };
    let network = tokio::spawn(network.run(dwell_receiver, stop.clone()));
    let refusals = Refusals::default();
    let gmti = Gmti { config, clock, dwells, progress, dropped: dropped_shown, refusals };
    gmti.run(opened, stop.clone()).await;
    network.await.context("the network task")?;
    Ok(())
}

/// The agent's side of the network.
struct Network {
    keys: Keys,
    bus: BusConfig,
    sender: Sender,
    progress: watch::Receiver<Progress>,
    tracks: watch::Receiver<Newest>,
    dropped: watch::Sender<u64>,
}

impl Network {
    /// Joins, serves until `stop`, leaves.
    async fn run<M: Uplifted>(self, sets: broadcast::Receiver<(u64, M)>, stop: CancellationToken) {
        let joined = tokio::select! {
            () = stop.cancelled() => return,
            joined = self.join() => joined,
        };
        let (bus, deliveries) = joined;
        let bus = Arc::new(bus);
        let (estimate, estimate_shown) = watch::channel(None::<ClockEstimate>);
        let (heard, heard_shown) = watch::channel(Heard::default());
        let Self { keys, sender, progress, tracks, dropped, .. } = self;
        let downlink = Downlink::new(keys, sender.clone(), estimate, heard);
        // On a task of its own: sending sets may have to wait, and nothing else may wait with it.
        let mut sending = tokio::spawn(uplink::send_sets(
            sender.clone(),
            Arc::clone(&bus),
            sets,
            estimate_shown.clone(),
            dropped,
        ));
        let asking = uplink::ask_for_time(sender.clone(), bus.as_ref(), estimate_shown.clone());
        let telling =
            uplink::tell_tracks(sender.clone(), bus.as_ref(), tracks, estimate_shown.clone());
        let reporting =
            uplink::report_status(sender, bus.as_ref(), progress, heard_shown, estimate_shown);
        tokio::select! {
            () = stop.cancelled() => {}
            () = downlink.run(deliveries) => {}
            () = asking => {}
            () = reporting => {}
            () = telling => {}
        }
        // The measuring loop has stopped too, so the queue ends.
        if tokio::time::timeout(DRAIN_LIMIT, &mut sending).await.is_err() {
            warn!(limit = ?DRAIN_LIMIT, "the last sets could not be sent");
            sending.abort();
        }
        bus.close().await;
    }

    /// Tries until it works.
    async fn join(&self) -> (ZenohBus, mpsc::Receiver<Delivery>) {
        let mut pause = FIRST_PAUSE;
        loop {
            match self.try_join().await {
                Ok(joined) => {
                    info!(endpoints = ?self.bus.connect, "joined the network");
                    return joined;
                }
                Err(error) => warn!(%error, retry_in = ?pause, "the centre is not there yet"),
            }
            // Agents that start together must not all knock at the same moment.
            tokio::time::sleep(pause.mul_f64(0.5 + 0.5 * rand::random::<f64>())).await;
            pause = (2 * pause).min(LONGEST_PAUSE);
        }
    }

    async fn try_join(&self) -> Result<(ZenohBus, mpsc::Receiver<Delivery>), BusError> {
        let node = self.sender.node.clone();
        let patterns = [Pattern::ClockAnswer(node.clone()), Pattern::Transform(node.clone())];
        let (bus, deliveries) = ZenohBus::open(&self.bus, self.keys.clone(), &patterns).await?;
        bus.declare_alive(&Topic::NodeLive(node, self.sender.boot)).await?;
        Ok((bus, deliveries))
    }
}
