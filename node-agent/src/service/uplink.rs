//! What goes up: point sets in order, the status once a second, and the question for the time.

use std::sync::Arc;
use std::time::Duration;

use proto::bus::Bus;
use proto::ids::{BootId, NodeId};
use proto::keys::Topic;
use proto::time::ClockEstimate;
use proto::wire::{ClockProbe, Dwell, Message, NodeStatus, PointSet, Stamp, encode};
use tokio::sync::broadcast::error::RecvError;
use tokio::sync::{broadcast, watch};
use tracing::{error, warn};

use super::clock::Clock;
use super::downlink::Heard;
use super::follow::Newest;
use super::measure::Progress;

/// Questions for the time right after joining, so that the first sets carry a good clock.
const BURST_COUNT: u32 = 8;
const BURST_INTERVAL: Duration = Duration::from_millis(20);
const PROBE_INTERVAL: Duration = Duration::from_secs(1);
const STATUS_INTERVAL: Duration = Duration::from_secs(1);

/// Who sends, and by which clock.
#[derive(Clone)]
pub(super) struct Sender {
    pub(super) node: NodeId,
    pub(super) boot: BootId,
    pub(super) clock: Clock,
}

impl Sender {
    async fn send<M: Message>(&self, bus: &impl Bus, topic: &Topic, sequence: u64, message: &M) {
        let stamp = Stamp { boot: self.boot, sequence, sent_ns: self.clock.now().0 };
        match encode(stamp, message) {
            Ok(bytes) => {
                if let Err(failure) = bus.publish(topic, bytes).await {
                    warn!(%failure, "not sent");
                }
            }
            Err(refusal) => error!(?topic, %refusal, "own message refused, not sent"),
        }
    }
}

/// What goes up in order and without gaps.
pub(super) trait Uplifted: Message + Clone + Send + Sync + 'static {
    /// Where it goes.
    fn topic(node: NodeId) -> Topic;

    /// With what is known of the centre's clock.
    fn clocked(self, clock: Option<ClockEstimate>) -> Self;
}

impl Uplifted for PointSet {
    fn topic(node: NodeId) -> Topic {
        Topic::Points(node)
    }

    fn clocked(self, clock: Option<ClockEstimate>) -> Self {
        Self { clock, ..self }
    }
}

/// Its times are those of the calendar.
impl Uplifted for Dwell {
    fn topic(node: NodeId) -> Topic {
        Topic::Dwells(node)
    }

    fn clocked(self, _clock: Option<ClockEstimate>) -> Self {
        self
    }
}

/// Sends sets as they come, with the newest clock estimate; reports how many the ring has dropped
/// because the network was slower than the radar.
pub(super) async fn send_sets<M: Uplifted>(
    sender: Sender,
    bus: Arc<impl Bus>,
    mut sets: broadcast::Receiver<(u64, M)>,
    clock: watch::Receiver<Option<ClockEstimate>>,
    dropped: watch::Sender<u64>,
) {
    let topic = M::topic(sender.node.clone());
    loop {
        match sets.recv().await {
            Ok((sequence, set)) => {
                let set = set.clocked(*clock.borrow());
                sender.send(bus.as_ref(), &topic, sequence, &set).await;
            }
            Err(RecvError::Lagged(count)) => {
                warn!(count, "sets dropped: the network is slower than the radar");
                dropped.send_modify(|total| *total += count);
            }
            Err(RecvError::Closed) => return,
        }
    }
}

/// Tells who is followed, with the newest clock estimate; what the network has no time for gives way
/// to the next. Never ends by itself.
pub(super) async fn tell_tracks(
    sender: Sender,
    bus: &impl Bus,
    mut newest: watch::Receiver<Newest>,
    clock: watch::Receiver<Option<ClockEstimate>>,
) {
    let topic = Topic::Tracks(sender.node.clone());
    while newest.changed().await.is_ok() {
        let Some((sequence, mut tracks)) = newest.borrow_and_update().clone() else { continue };
        tracks.clock = *clock.borrow();
        sender.send(bus, &topic, sequence, &tracks).await;
    }
    // Measuring has ended; the network is left when the agent is told to.
    std::future::pending().await
}

/// Asks for the time once a second, and in bursts at first and when another centre answers.
pub(super) async fn ask_for_time(
    sender: Sender,
    bus: &impl Bus,
    clock: watch::Receiver<Option<ClockEstimate>>,
) {
    let topic = Topic::ClockProbe(sender.node.clone());
    let (mut centre, mut asked_count) = (None, 0);
    for sequence in 0.. {
        let answering = clock.borrow().map(|estimate| estimate.centre_boot);
        if answering != centre {
            (centre, asked_count) = (answering, 0);
        }
        let probe = ClockProbe { node: sender.node.clone(), asked: sender.clock.now() };
        sender.send(bus, &topic, sequence, &probe).await;
        asked_count += 1;
        let pause = if asked_count < BURST_COUNT { BURST_INTERVAL } else { PROBE_INTERVAL };
        tokio::time::sleep(pause).await;
    }
}

/// Reports the status once a second, and at once when the source changes its state.
pub(super) async fn report_status(
    sender: Sender,
    bus: &impl Bus,
    mut progress: watch::Receiver<Progress>,
    heard: watch::Receiver<Heard>,
    clock: watch::Receiver<Option<ClockEstimate>>,
) {
    let topic = Topic::Status(sender.node.clone());
    for sequence in 0.. {
        let Progress { source, next_sequence, queue_length, counters } =
            progress.borrow_and_update().clone();
        let reported = source;
        let Heard { transform_epoch, latency } = *heard.borrow();
        let status = NodeStatus {
            node: sender.node.clone(),
            time: sender.clock.now(),
            software: env!("CARGO_PKG_VERSION").to_owned(),
            source,
            clock: *clock.borrow(),
            next_sequence,
            queue_length,
            transform_epoch,
            latency,
            counters,
        };
        sender.send(bus, &topic, sequence, &status).await;
        let ended = async { progress.wait_for(|now| now.source != reported).await.is_err() };
        // Measuring may have ended; the status goes on until the process does.
        if tokio::time::timeout(STATUS_INTERVAL, ended).await == Ok(true) {
            tokio::time::sleep(STATUS_INTERVAL).await;
        }
    }
}
