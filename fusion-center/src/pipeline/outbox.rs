//! What one step of the centre wants done, collected while it runs.

use std::collections::BTreeMap;

use proto::ids::BootId;
use proto::keys::Topic;
use proto::time::CentreTime;
use proto::wire::{Kind, encode};
use tracing::error;

use super::{Effect, Message, stamp};

#[derive(Debug)]
pub(super) struct Outbox {
    boot: BootId,
    sequences: BTreeMap<Kind, u64>,
    effects: Vec<Effect>,
}

impl Outbox {
    pub(super) fn new(boot: BootId) -> Self {
        Self { boot, sequences: BTreeMap::new(), effects: Vec::new() }
    }

    pub(super) fn publish<M: Message>(&mut self, now: CentreTime, topic: Topic, message: &M) {
        let sequence = self.sequences.entry(M::KIND).or_default();
        match encode(stamp(self.boot, *sequence, now), message) {
            Ok(bytes) => {
                *sequence += 1;
                self.effects.push(Effect::Publish(topic, bytes));
            }
            Err(refusal) => error!(?topic, %refusal, "own message refused, not sent"),
        }
    }

    pub(super) fn push(&mut self, effect: Effect) {
        self.effects.push(effect);
    }

    pub(super) fn extend(&mut self, effects: impl IntoIterator<Item = Effect>) {
        self.effects.extend(effects);
    }

    pub(super) fn take(&mut self) -> Vec<Effect> {
        std::mem::take(&mut self.effects)
    }
}
