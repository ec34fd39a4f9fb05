//! From deliveries to checked messages; what is refused is counted and named.

use std::collections::BTreeMap;

use proto::bus::{BusEvent, Delivery};
use proto::ids::NodeId;
use proto::keys::{Keys, Topic};
use proto::wire::{ClockProbe, Command, Message, NodeStatus, PointSet, Received, Refusal, decode};
use tracing::warn;

/// A delivery that makes sense.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Inbound {
    /// A node's points.
    Points(Received<PointSet>),
    /// A node's status.
    Status(Received<NodeStatus>),
    /// A node asks for the time.
    Probe(Received<ClockProbe>),
    /// An operator's command.
    Command(Received<Command>),
    /// A node's liveliness token appeared or vanished.
    Life {
        /// Which node.
        node: NodeId,
        /// Whether it appeared.
        alive: bool,
    },
    /// Nothing that concerns the centre.
    Nothing,
}

/// A delivery that does not.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Refused {
    /// The key it came under.
    pub(super) key: String,
    /// The node that the key names.
    pub(super) node: Option<NodeId>,
    /// Short label of the reason.
    pub(super) label: &'static str,
    /// The reason in full.
    pub(super) reason: String,
}

/// Keys for which refusals are counted apart; beyond them, all count as one.
const MAX_COUNTED_KEYS: usize = 256;

/// Messages refused so far.
#[derive(Clone, Debug, Default)]
pub struct Refusals {
    counts: BTreeMap<(String, &'static str), u64>,
}

impl Refusals {
    /// Counts a refusal, and names it in the log when its count reaches a power of two: a flood
    /// of garbage must not become a flood of log lines.
    pub(super) fn count(&mut self, refused: &Refused) {
        let crowded = MAX_COUNTED_KEYS <= self.counts.len();
        let entry = (refused.key.clone(), refused.label);
        let other = ("(other keys)".to_owned(), refused.label);
        let place = if crowded && !self.counts.contains_key(&entry) { other } else { entry };
        let count = self.counts.entry(place).or_default();
        *count += 1;
        if count.is_power_of_two() {
            let Refused { key, label, reason, .. } = refused;
            warn!(%key, label, count, %reason, "message refused");
        }
    }

    /// How many messages were refused, by key and label.
    #[must_use]
    pub fn counts(&self) -> &BTreeMap<(String, &'static str), u64> {
        &self.counts
    }

    /// How many messages were refused for one reason.
    #[must_use]
    pub fn total(&self, label: &str) -> u64 {
        self.counts.iter().filter(|((_, l), _)| *l == label).map(|(_, count)| count).sum()
    }
}

/// Reads a delivery.
pub(super) fn read(keys: &Keys, delivery: &Delivery) -> Result<Inbound, Refused> {
    let refused = |node: Option<&NodeId>, label, reason| Refused {
        key: delivery.key.clone(),
        node: node.cloned(),
        label,
        reason,
    };
    let topic =
        keys.parse(&delivery.key).map_err(|error| refused(None, "key", error.to_string()))?;
    let bytes = match (&delivery.event, &topic) {
        (BusEvent::Message(bytes), _) => bytes,
        (event, Topic::NodeLive(node, _)) => {
            let alive = *event == BusEvent::Appeared;
            return Ok(Inbound::Life { node: node.clone(), alive });
        }
        _ => return Ok(Inbound::Nothing),
    };
    let result = match &topic {
        Topic::Points(node) => {
            of_node(bytes, node, |set: &PointSet| &set.node).map(Inbound::Points)
        }
        Topic::Status(node) => {
            of_node(bytes, node, |status: &NodeStatus| &status.node).map(Inbound::Status)
        }
        Topic::ClockProbe(node) => {
            of_node(bytes, node, |probe: &ClockProbe| &probe.node).map(Inbound::Probe)
        }
        Topic::Command => decode(bytes).map(Inbound::Command).map_err(Unusable::from),
        _ => return Ok(Inbound::Nothing),
    };
    let node = match &topic {
        Topic::Points(node) | Topic::Status(node) | Topic::ClockProbe(node) => Some(node),
        _ => None,
    };
    result.map_err(|unusable| refused(node, unusable.label, unusable.reason))
}

struct Unusable {
    label: &'static str,
    reason: String,
}

impl From<Refusal> for Unusable {
    fn from(refusal: Refusal) -> Self {
        Self { label: refusal.label(), reason: refusal.to_string() }
    }
}

/// A message that must speak of the node that its key names.
fn of_node<M: Message>(
    bytes: &[u8],
    node: &NodeId,
    speaks_of: impl Fn(&M) -> &NodeId,
) -> Result<Received<M>, Unusable> {
    let received: Received<M> = decode(bytes)?;
    let claimed = speaks_of(&received.body);
    if claimed == node {
        return Ok(received);
    }
    let reason = format!("it speaks of node {claimed} under the key of node {node}");
    Err(Unusable { label: "impostor", reason })
}
