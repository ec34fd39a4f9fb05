//! From deliveries to checked messages; what is refused is counted and named.

use proto::bus::{BusEvent, Delivery};
use proto::ids::NodeId;
use proto::keys::{Keys, Topic};
use proto::wire::{
    ClockProbe, Command, Message, NodeStatus, NodeTracks, PointSet, Received, Refusal, decode,
};

/// A delivery that makes sense.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Inbound {
    /// A node's points.
    Points(Received<PointSet>),
    /// The people whom a node follows.
    Tracks(Received<NodeTracks>),
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
        (BusEvent::Oversized(length), _) => {
            let reason = format!("{length} bytes, more than any message has");
            return Err(refused(None, "oversized", reason));
        }
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
        Topic::Tracks(node) => {
            of_node(bytes, node, |tracks: &NodeTracks| &tracks.node).map(Inbound::Tracks)
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
        Topic::Points(node)
        | Topic::Tracks(node)
        | Topic::Status(node)
        | Topic::ClockProbe(node) => Some(node),
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
