//! A network inside one process, with seeded delay, loss, duplication and hence reordering.
//!
//! It runs on tokio's clock: with that paused, a test of minutes takes milliseconds and repeats
//! exactly.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use tokio::sync::mpsc;

use super::{Bus, BusError, BusEvent, Delivery, Inbox};
use crate::keys::{Keys, Pattern, Topic, covers};

/// What the network does to messages.
#[derive(Clone, Copy, Debug, Default)]
pub struct Faults {
    /// Shortest time on the way.
    pub delay_min: Duration,
    /// Longest time on the way; messages overtake each other where this exceeds their spacing.
    pub delay_max: Duration,
    /// Chance that a message never arrives.
    pub loss_probability: f64,
    /// Chance that a message arrives twice.
    pub duplicate_probability: f64,
}

/// A network in memory.
#[derive(Clone)]
pub struct MemoryNetwork {
    keys: Keys,
    faults: Faults,
    state: Arc<Mutex<State>>,
}

struct State {
    random: ChaCha8Rng,
    listeners: Vec<(String, Arc<Inbox>)>,
}

/// One process's place on a [`MemoryNetwork`].
pub struct MemoryBus {
    network: MemoryNetwork,
    inbox: Arc<Inbox>,
}

impl MemoryNetwork {
    /// A network of one site; the same `seed` gives the same faults to the same messages.
    #[must_use]
    pub fn new(keys: Keys, faults: Faults, seed: u64) -> Self {
        let random = ChaCha8Rng::seed_from_u64(seed);
        let state = Arc::new(Mutex::new(State { random, listeners: Vec::new() }));
        Self { keys, faults, state }
    }

    /// Joins the network and listens to `patterns`; at most `capacity` deliveries wait.
    #[must_use]
    pub fn join(
        &self,
        patterns: &[Pattern],
        capacity: usize,
    ) -> (MemoryBus, mpsc::Receiver<Delivery>) {
        let (inbox, receiver) = Inbox::new(capacity);
        let inbox = Arc::new(inbox);
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        for pattern in patterns {
            state.listeners.push((self.keys.expression(pattern), Arc::clone(&inbox)));
        }
        drop(state);
        (MemoryBus { network: self.clone(), inbox }, receiver)
    }

    /// Sends bytes under any key, as a stranger on the network could.
    pub fn inject(&self, key: &str, bytes: &[u8]) {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let State { random, listeners } = &mut *state;
        for (_, inbox) in listeners.iter().filter(|(expression, _)| covers(expression, key)) {
            for delay in self.faults.draw_deliveries(random) {
                deliver_later(Arc::clone(inbox), key.to_owned(), bytes.to_vec(), delay);
            }
        }
    }
}

impl Faults {
    /// When each copy of a message arrives: none if it is lost.
    fn draw_deliveries(&self, random: &mut ChaCha8Rng) -> Vec<Duration> {
        let span = self.delay_max.saturating_sub(self.delay_min);
        let copies = 1 + usize::from(random.random_bool(self.duplicate_probability));
        let drawn: Vec<(bool, Duration)> = (0..copies)
            .map(|_| {
                let is_lost = random.random_bool(self.loss_probability);
                (is_lost, self.delay_min + span.mul_f64(random.random::<f64>()))
            })
            .collect();
        drawn.into_iter().filter(|(is_lost, _)| !is_lost).map(|(_, delay)| delay).collect()
    }
}

fn deliver_later(inbox: Arc<Inbox>, key: String, bytes: Vec<u8>, delay: Duration) {
    tokio::spawn(async move {
        tokio::time::sleep(delay).await;
        inbox.offer(&key, BusEvent::Message(bytes));
    });
}

impl Bus for MemoryBus {
    async fn publish(&self, topic: &Topic, bytes: Vec<u8>) -> Result<(), BusError> {
        self.network.inject(&self.network.keys.key(topic), &bytes);
        Ok(())
    }

    fn dropped_count(&self) -> u64 {
        self.inbox.dropped_count()
    }

    async fn close(&self) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    async fn received(seed: u64, faults: Faults) -> Vec<u8> {
        let keys = Keys::new("lab".parse().unwrap());
        let network = MemoryNetwork::new(keys, faults, seed);
        let (_centre, mut inbox) = network.join(&[Pattern::AllPoints], 1000);
        let (agent, _) = network.join(&[], 1);
        for number in 0..100 {
            agent.publish(&Topic::Points("n1".parse().unwrap()), vec![number]).await.unwrap();
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        tokio::time::sleep(Duration::from_secs(5)).await;
        let mut numbers = Vec::new();
        while let Ok(Delivery { event: BusEvent::Message(bytes), .. }) = inbox.try_recv() {
            numbers.extend(bytes);
        }
        numbers
    }

    #[tokio::test(start_paused = true)]
    async fn a_faultless_network_keeps_everything_in_order() {
        assert_eq!(received(1, Faults::default()).await, (0..100).collect::<Vec<u8>>());
    }

    #[tokio::test(start_paused = true)]
    async fn faults_happen_and_repeat_with_the_seed() {
        let faults = Faults {
            delay_min: Duration::ZERO,
            delay_max: Duration::from_millis(100),
            loss_probability: 0.2,
            duplicate_probability: 0.2,
        };
        let first = received(7, faults).await;
        assert_eq!(first, received(7, faults).await);
        assert_ne!(first, received(8, faults).await);
        let mut sorted = first.clone();
        sorted.sort_unstable();
        assert_ne!(first, sorted, "nothing was reordered");
        sorted.dedup();
        assert!(sorted.len() < first.len(), "nothing was duplicated");
        assert!((60..100).contains(&sorted.len()), "{} of 100 arrived", sorted.len());
    }

    #[tokio::test(start_paused = true)]
    async fn a_full_inbox_drops_and_counts() {
        let keys = Keys::new("lab".parse().unwrap());
        let network = MemoryNetwork::new(keys, Faults::default(), 1);
        let (slow, _inbox) = network.join(&[Pattern::Picture], 3);
        for _ in 0..10 {
            slow.publish(&Topic::Picture, vec![0]).await.unwrap();
        }
        tokio::time::sleep(Duration::from_millis(1)).await;
        assert_eq!(slow.dropped_count(), 7);
    }
}
