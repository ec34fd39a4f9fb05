//! An agent of a wide-area radar: dwells played in their own time, or as they come in, and sent up.

use std::time::Duration;

use anyhow::Context;
use proto::plots::{Format, Ingest, Naming, Scan};
use proto::refusals::Refusals;
use proto::time::NodeTime;
use proto::wire::{Dwell, Message, SourceState};
use tokio::net::{TcpListener, TcpStream, UdpSocket};
use tokio::sync::{broadcast, watch};
use tokio_util::sync::CancellationToken;
use tracing::{info, warn};

use super::clock::Clock;
use super::measure::Progress;
use super::senders::{Intake, Senders};
use crate::config::AgentConfig;
use crate::gmti::{GmtiSource, Next, Played, taken};

/// A dwell is sent late rather than not at all, up to this much: an agent that starts in mid-scenario
/// goes straight to the present.
const LATE_LIMIT: Duration = Duration::from_secs(5);
/// Longest datagram.
const DATAGRAM_BYTES: usize = 1 << 16;
/// Pause between attempts to dial.
const DIAL_PAUSE: Duration = Duration::from_secs(1);
/// A sender that was dialled and says nothing for this long is dialled again: if it lost its power, its
/// connection never ends.
const SILENCE_LIMIT: Duration = Duration::from_secs(60);

/// Takes dwells from the source to the network's queue.
pub(super) struct Gmti {
    pub(super) config: AgentConfig,
    pub(super) clock: Clock,
    pub(super) dwells: broadcast::Sender<(u64, Dwell)>,
    pub(super) progress: watch::Sender<Progress>,
    pub(super) dropped: watch::Receiver<u64>,
    pub(super) refusals: Refusals,
}

/// A source that is open.
pub(super) enum Opened {
    Played(Box<Played>),
    Udp(UdpSocket),
    Listen(TcpListener),
    Dial(std::net::SocketAddr),
}

impl Opened {
    /// Opens the configured source.
    ///
    /// # Errors
    /// If it cannot be opened.
    pub(super) async fn open(config: &AgentConfig) -> anyhow::Result<Self> {
        let gmti = &config.gmti;
        let named = || format!("gmti.address = {:?}", gmti.address);
        let address = gmti.socket_address().with_context(named);
        match gmti.source {
            GmtiSource::Simulated | GmtiSource::File => {
                Ok(Self::Played(Box::new(Played::open(gmti, &config.node)?)))
            }
            GmtiSource::Udp => Ok(Self::Udp(UdpSocket::bind(address?).await.with_context(named)?)),
            GmtiSource::Tcp if gmti.dial => Ok(Self::Dial(address?)),
            GmtiSource::Tcp => {
                Ok(Self::Listen(TcpListener::bind(address?).await.with_context(named)?))
            }
        }
    }
}

impl Gmti {
    /// Sends dwells until the source ends or `stop`.
    pub(super) async fn run(mut self, opened: Opened, stop: CancellationToken) {
        let address = self.config.gmti.address.clone();
        let work = async {
            match opened {
                Opened::Played(played) => self.play(*played).await,
                Opened::Udp(socket) => self.take_datagrams(&socket, &address).await,
                Opened::Listen(listener) => self.take_connections(&listener, &address).await,
                Opened::Dial(to) => self.dial(to, &address).await,
            }
        };
        tokio::select! {
            () = stop.cancelled() => return,
            () = work => {}
        }
        info!(node = %self.config.node, "the source has ended");
        self.progress.send_modify(|progress| progress.source = SourceState::Finished);
    }

    /// Plays dwells in their own time over `play.speed`.
    async fn play(&mut self, mut played: Played) {
        let start_ns = match self.config.play.start_unix_s {
            Some(unix_s) => self.clock.at_unix_s(unix_s),
            None => i64::try_from(self.clock.now().0).unwrap_or(i64::MAX),
        };
        let name = self.config.gmti.path.display().to_string();
        let mut first_s = None;
        loop {
            let next = tokio::task::block_in_place(|| played.advance());
            let dwell = match next {
                Ok(Next::Dwell(dwell)) => *dwell,
                Ok(Next::Damage(label, reason)) => {
                    self.damaged(&name, label, &reason);
                    continue;
                }
                Ok(Next::End) => return,
                Err(failure) => {
                    warn!(%failure, "the source ends early");
                    return;
                }
            };
            let from_first_s = dwell.time_unix_s - *first_s.get_or_insert(dwell.time_unix_s);
            let Some(due) = self.due(start_ns, from_first_s) else {
                self.progress.send_modify(|progress| progress.counters.skipped_period_count += 1);
                continue;
            };
            tokio::time::sleep_until(self.clock.instant(due)).await;
            self.send(dwell);
        }
    }

    /// When a dwell is due; `None` if that is too long ago.
    fn due(&self, start_ns: i64, from_first_s: f64) -> Option<NodeTime> {
        #[expect(clippy::cast_possible_truncation, reason = "saturates, which is far enough")]
        let from_start_ns = (from_first_s / self.config.play.speed * 1e9) as i64;
        let due_ns = start_ns.saturating_add(from_start_ns);
        let now_ns = i64::try_from(self.clock.now().0).unwrap_or(i64::MAX);
        let late_ns = i64::try_from(LATE_LIMIT.as_nanos()).unwrap_or(i64::MAX);
        let is_late = late_ns < now_ns.saturating_sub(due_ns);
        (!is_late).then(|| NodeTime(u64::try_from(due_ns).unwrap_or(0)))
    }

    async fn take_datagrams(&mut self, socket: &UdpSocket, address: &str) {
        info!(%address, "waiting for datagrams");
        let (mut ingest, mut buffer) = (self.ingest(), vec![0; DATAGRAM_BYTES]);
        let mut found = Vec::new();
        loop {
            match socket.recv_from(&mut buffer).await {
                Ok((count, _)) => ingest.datagram(&buffer[..count], &mut found),
                Err(failure) => self.damaged(address, "receive", &failure.to_string()),
            }
            self.take(address, &mut found);
        }
    }

    /// All senders that connect.
    async fn take_connections(&mut self, listener: &TcpListener, address: &str) {
        info!(%address, "waiting for a sender");
        let (mut senders, mut heard) = Senders::new();
        loop {
            let accepted = tokio::select! {
                Some(said) = heard.recv() => {
                    match said {
                        Ok(mut found) => self.take(address, &mut found),
                        Err(failure) => self.damaged(address, "read", &failure.to_string()),
                    }
                    continue;
                }
                accepted = listener.accept() => accepted,
            };
            match accepted {
                Ok((stream, from)) => {
                    info!(%from, "a sender has connected");
                    senders.add(stream, || self.ingest());
                }
                Err(failure) => {
                    self.damaged(address, "accept", &failure.to_string());
                    tokio::time::sleep(DIAL_PAUSE).await;
                }
            }
        }
    }

    async fn dial(&mut self, to: std::net::SocketAddr, address: &str) {
        let mut ingest = self.ingest();
        loop {
            match TcpStream::connect(to).await {
                Ok(stream) => {
                    info!(%to, "connected to the sender");
                    ingest = self.take_stream(Intake::new(stream, ingest), address).await;
                }
                Err(failure) => warn!(%to, %failure, retry_in = ?DIAL_PAUSE, "no sender there"),
            }
            tokio::time::sleep(DIAL_PAUSE).await;
        }
    }

    /// Reads a connection to its end, and gives what is known of dates and jobs.
    async fn take_stream(&mut self, mut intake: Intake, address: &str) -> Ingest {
        let mut found = Vec::new();
        loop {
            let advanced = tokio::time::timeout(SILENCE_LIMIT, intake.advance(&mut found)).await;
            self.take(address, &mut found);
            match advanced {
                Ok(Ok(true)) => continue,
                Ok(Ok(false)) => info!(%address, "the sender has left"),
                Ok(Err(failure)) => self.damaged(address, "read", &failure.to_string()),
                Err(_) => warn!(%address, after = ?SILENCE_LIMIT, "the sender is silent"),
            }
            let ingest = intake.end(&mut found);
            self.take(address, &mut found);
            return ingest;
        }
    }

    fn ingest(&self) -> Ingest {
        let format = self.config.gmti.format.unwrap_or(Format::Stanag4607);
        Ingest::new(format, Naming::Fixed(self.config.node.clone()))
    }

    fn take(&mut self, address: &str, found: &mut Vec<Result<Scan, proto::plots::Damage>>) {
        for one in found.drain(..) {
            match taken(one) {
                Next::Dwell(dwell) => self.send(*dwell),
                Next::Damage(label, reason) => self.damaged(address, label, &reason),
                Next::End => {}
            }
        }
    }

    fn damaged(&mut self, place: &str, label: &'static str, reason: &str) {
        self.refusals.count(place, label, reason);
        self.progress.send_modify(|progress| progress.counters.refused_frame_count += 1);
    }

    fn send(&mut self, dwell: Dwell) {
        if let Err(invalid) = dwell.check() {
            return self.damaged("dwell", "invalid", &invalid.to_string());
        }
        let report_count = dwell.reports.len() as u64;
        let sequence = self.progress.borrow().next_sequence;
        // No receiver means no network yet.
        drop(self.dwells.send((sequence, dwell)));
        let queue_length = u32::try_from(self.dwells.len()).unwrap_or(u32::MAX);
        let dropped_set_count = *self.dropped.borrow();
        self.progress.send_modify(|progress| {
            progress.source = SourceState::Running;
            progress.next_sequence += 1;
            progress.queue_length = queue_length;
            progress.counters.frame_count += 1;
            progress.counters.point_count += report_count;
            progress.counters.dropped_set_count = dropped_set_count;
        });
    }
}
