//! Watches a run from the network: what the agents say of themselves and what the centre says.

use std::collections::BTreeMap;

use proto::bus::{BusEvent, Delivery, ZenohBus};
use proto::config::BusConfig;
use proto::ids::{BootId, NodeId};
use proto::keys::{Keys, Pattern, Topic};
use proto::wire::{
    NodeInPicture, NodeState, NodeStatus, Outcome, PersonInPicture, Picture, Registration,
    SourceState, TrackInPicture, decode,
};
use serde::Serialize;
use tokio::sync::mpsc;
use tracing::warn;

/// What is known of one node.
#[derive(Clone, Debug, Default)]
pub(crate) struct Seen {
    pub(crate) status: Option<NodeStatus>,
    pub(crate) registration: Option<Registration>,
    pub(crate) line: Option<NodeInPicture>,
}

/// Places kept of all tracks together: an hour of ten people at ten periods a second.
const MAX_PLACE_COUNT: usize = 400_000;

/// Somebody whom a node followed, as the pictures showed it.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Person {
    /// The newest track.
    pub(crate) last: TrackInPicture,
    /// Where the person was, one place for each message of the node, `[x, y]` in `Ref`.
    pub(crate) places_m: Vec<[f64; 2]>,
}

/// Somebody whom the centre followed by all nodes together.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Fused {
    /// As last shown.
    pub(crate) last: PersonInPicture,
    /// Where the person was, one place for each picture, `[x, y]` in `Ref`.
    pub(crate) places_m: Vec<[f64; 2]>,
}

/// What is known of a run.
#[derive(Debug, Default)]
pub(crate) struct Observer {
    pub(crate) nodes: BTreeMap<NodeId, Seen>,
    pub(crate) picture: Option<Picture>,
    /// Pictures seen so far.
    pub(crate) picture_count: u64,
    /// Everybody who was followed, by node, the node's life and id.
    pub(crate) people: BTreeMap<(NodeId, BootId, u64), Person>,
    /// Everybody whom the centre followed, by the centre's life and id.
    pub(crate) fused: BTreeMap<(BootId, u64), Fused>,
    place_count: usize,
}

/// Joins the run's network to watch.
pub(crate) async fn join(
    endpoint: &str,
    keys: &Keys,
) -> Result<(ZenohBus, mpsc::Receiver<Delivery>), proto::bus::BusError> {
    let config = BusConfig { connect: vec![endpoint.to_owned()], ..BusConfig::default() };
    let patterns = [Pattern::AllStatus, Pattern::AllTransforms, Pattern::Picture];
    ZenohBus::open(&config, keys.clone(), &patterns).await
}

impl Observer {
    pub(crate) fn take(&mut self, keys: &Keys, delivery: &Delivery) {
        let BusEvent::Message(bytes) = &delivery.event else { return };
        let taken = match keys.parse(&delivery.key) {
            Ok(Topic::Status(node)) => decode::<NodeStatus>(bytes).map(|status| {
                self.nodes.entry(node).or_default().status = Some(status.body);
            }),
            Ok(Topic::Transform(node)) => decode::<Registration>(bytes).map(|registration| {
                self.nodes.entry(node).or_default().registration = Some(registration.body);
            }),
            Ok(Topic::Picture) => decode::<Picture>(bytes)
                .map(|picture| self.take_picture(picture.stamp.boot, picture.body)),
            _ => return,
        };
        if let Err(refusal) = taken {
            warn!(key = %delivery.key, %refusal, "message refused");
        }
    }

    fn take_picture(&mut self, centre: BootId, picture: Picture) {
        for line in &picture.nodes {
            self.nodes.entry(line.node.clone()).or_default().line = Some(line.clone());
        }
        self.picture_count += 1;
        picture.tracks.iter().for_each(|shown| self.take_track(shown));
        picture.people.iter().for_each(|shown| self.take_person(centre, shown));
        self.picture = Some(picture);
    }

    fn take_person(&mut self, centre: BootId, shown: &PersonInPicture) {
        let new = || Fused { last: shown.clone(), places_m: Vec::new() };
        let person = self.fused.entry((centre, shown.id)).or_insert_with(new);
        let is_news = person.places_m.is_empty() || person.last.time < shown.time;
        if is_news && self.place_count < MAX_PLACE_COUNT {
            let [x_m, y_m, ..] = shown.state;
            person.places_m.push([x_m, y_m]);
            self.place_count += 1;
        }
        if is_news {
            person.last = shown.clone();
        }
    }

    fn take_track(&mut self, shown: &TrackInPicture) {
        let line = self.nodes.get(&shown.node).and_then(|seen| seen.line.as_ref());
        let Some(boot) = line.map(|line| line.boot) else { return };
        let key = (shown.node.clone(), boot, shown.track.id);
        let new = || Person { last: shown.clone(), places_m: Vec::new() };
        let person = self.people.entry(key).or_insert_with(new);
        // A picture that is said again says nothing new of where people were.
        let is_news = person.places_m.is_empty() || person.last.time < shown.time;
        if is_news && self.place_count < MAX_PLACE_COUNT {
            let [x_m, y_m, ..] = shown.track.state;
            person.places_m.push([x_m, y_m]);
            self.place_count += 1;
        }
        if is_news {
            person.last = shown.clone();
        }
    }
}

impl Seen {
    /// Whether its source has ended, well or badly.
    pub(crate) fn has_finished(&self) -> bool {
        let source = self.status.as_ref().map(|status| &status.source);
        source == Some(&SourceState::Finished)
    }

    /// Whether the centre has taken its last set, and solved with it where that can be.
    pub(crate) fn is_settled(&self) -> bool {
        let (Some(status), Some(line)) = (&self.status, &self.line) else { return false };
        let Some(registration) = &self.registration else { return false };
        let solved = match (&registration.outcome, &registration.sets) {
            (Outcome::Reference, _) => true,
            (_, Some(sets)) => status.next_sequence <= sets.last_sequence + 1,
            (_, None) => false,
        };
        // The picture's lines come up to a second later.
        let in_force = registration.transform.map(|transform| transform.epoch);
        let is_doubted = line.state == NodeState::Suspect;
        let is_told = line.state != NodeState::ClockUnknown
            && line.epoch == in_force
            && is_doubted == registration.suspicion.is_some();
        status.next_sequence <= line.next_sequence && line.missing_count == 0 && solved && is_told
    }

    pub(crate) fn is_silent(&self) -> bool {
        self.line.as_ref().is_some_and(|line| line.state == NodeState::Silent)
    }
}
