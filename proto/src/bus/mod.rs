//! How bytes travel: a small trait, its Zenoh implementation, and one in memory with faults.
//!
//! Sending is a method; what arrives comes out of one bounded channel per process. What the
//! channel cannot hold is dropped and counted, so that a slow reader never stalls the network.

mod memory;
mod zenoh_bus;

use std::future::Future;
use std::sync::atomic::{AtomicU64, Ordering};

use thiserror::Error;
use tokio::sync::mpsc;
use tokio::time::Instant;

pub use memory::{Faults, MemoryBus, MemoryNetwork};
pub use zenoh_bus::ZenohBus;

use crate::keys::{Pattern, Topic};

/// How a topic's messages are treated on the way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    /// Nothing may be lost: waits where the network is slow, is kept and sent again after an
    /// outage.
    GapFree,
    /// Only the newest counts: gives way where the network is slow, and late joiners get the last.
    State,
    /// Gives way where the network is slow.
    Plain,
}

impl Topic {
    /// How this topic's messages are treated.
    #[must_use]
    pub fn class(&self) -> Class {
        match self {
            Self::Points(_) | Self::Dwells(_) => Class::GapFree,
            Self::Tracks(_) | Self::Transform(_) | Self::Picture | Self::MapTracks => Class::State,
            _ => Class::Plain,
        }
    }
}

impl Pattern {
    /// How the messages of these topics are treated.
    #[must_use]
    pub fn class(&self) -> Class {
        match self {
            Self::AllPoints | Self::AllDwells => Class::GapFree,
            Self::AllTracks
            | Self::Transform(_)
            | Self::AllTransforms
            | Self::Picture
            | Self::MapTracks => Class::State,
            _ => Class::Plain,
        }
    }
}

/// What came in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Delivery {
    /// The key it came under.
    pub key: String,
    /// What it is.
    pub event: BusEvent,
    /// When it arrived, before it waited in the inbox.
    pub arrived: Instant,
}

/// What can come in.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum BusEvent {
    /// A message's bytes, unchecked.
    Message(Vec<u8>),
    /// A message of this many bytes, more than any message has; it was not kept.
    Oversized(usize),
    /// A liveliness token appeared.
    Appeared,
    /// A liveliness token vanished: the process ended or cannot be reached.
    Vanished,
}

/// Why the bus did not do what was asked.
#[derive(Debug, Error)]
pub enum BusError {
    /// The session could not be opened.
    #[error("joining the network ({endpoints}): {detail}")]
    Open {
        /// Where it tried.
        endpoints: String,
        /// What Zenoh said.
        detail: String,
    },
    /// An endpoint that Zenoh does not take.
    #[error("settings of the bus: {detail}; check the endpoints")]
    Settings {
        /// What Zenoh said.
        detail: String,
    },
    /// A publisher, subscriber or token could not be declared, or a message not be handed over.
    #[error("{action} {key}: {detail}")]
    Action {
        /// What was tried.
        action: &'static str,
        /// On which key.
        key: String,
        /// What Zenoh said.
        detail: String,
    },
}

/// The sending side of the network.
pub trait Bus: Send + Sync + 'static {
    /// Hands a message over. `Ok` means accepted here, not arrived there. Waits only for topics of
    /// class [`Class::GapFree`].
    ///
    /// # Errors
    /// If it was not accepted.
    fn publish(
        &self,
        topic: &Topic,
        bytes: Vec<u8>,
    ) -> impl Future<Output = Result<(), BusError>> + Send;

    /// Deliveries dropped so far because this process did not take them fast enough.
    fn dropped_count(&self) -> u64;

    /// Leaves the network, within a bounded time.
    fn close(&self) -> impl Future<Output = ()> + Send;
}

/// The bounded way in: never blocks, counts what it cannot hold.
#[derive(Debug)]
struct Inbox {
    sender: mpsc::Sender<Delivery>,
    dropped_count: AtomicU64,
}

impl Inbox {
    fn new(capacity: usize) -> (Self, mpsc::Receiver<Delivery>) {
        let (sender, receiver) = mpsc::channel(capacity);
        (Self { sender, dropped_count: AtomicU64::new(0) }, receiver)
    }

    fn offer(&self, key: &str, event: BusEvent) {
        let delivery = Delivery { key: key.to_owned(), event, arrived: Instant::now() };
        if self.sender.try_send(delivery).is_err() {
            self.dropped_count.fetch_add(1, Ordering::Relaxed);
        }
    }

    fn dropped_count(&self) -> u64 {
        self.dropped_count.load(Ordering::Relaxed)
    }
}
