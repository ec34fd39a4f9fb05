//! READ FIRST: the centre as a pure state machine: gather, register, fuse, publish.
//!
//! ```text
//! delivery ── decode, check ── gather ──┬── pair of nodes has a common period ── Solve ──┐
//!    (refused: counted, named)          │                                                │
//!                                       └── period complete ── fuse ── publish picture   │
//!                 publish transform ── accept or keep the old one ── Solved ─────────────┘
//! ```
//! It reads no clock and does no work of its own accord: [`Centre::step`] takes the time and one
//! event and returns what is to be done. The same events give the same effects, byte for byte.

mod inbox;
mod outbox;
mod poses;

use std::sync::Arc;
use std::time::Duration;

use proto::bus::Delivery;
use proto::ids::{BootId, NodeId};
use proto::keys::{Keys, Topic};
use proto::time::CentreTime;
use proto::wire::{
    ClockAnswer, ClockProbe, Command, Message, NodeStatus, Picture, PointSet, Received, Stamp,
};
use tracing::{info, warn};

pub use inbox::Refusals;
pub use poses::{Job, Poses, Solved};

use crate::config::CentreConfig;
use crate::fuse::{Sighting, fuse, place};
use crate::gather::{Gather, Offer};
use inbox::Inbound;
use outbox::Outbox;

/// The picture is published at least this often, so that silence shows.
const PICTURE_INTERVAL: Duration = Duration::from_secs(1);

/// What happens to the centre.
#[derive(Debug)]
pub enum Event {
    /// The bus delivered something.
    Delivered(Delivery),
    /// A registration asked for by [`Effect::Solve`] is done.
    Solved(Box<Solved>),
    /// Time has passed.
    Tick,
}

/// What the centre wants done.
#[derive(Debug)]
pub enum Effect {
    /// Send these bytes.
    Publish(Topic, Vec<u8>),
    /// Solve this and report with [`Event::Solved`].
    Solve(Box<Job>),
}

/// The centre's state.
pub struct Centre {
    config: Arc<CentreConfig>,
    keys: Keys,
    gather: Gather,
    poses: Poses,
    refusals: Refusals,
    outbox: Outbox,
    last_picture: Option<Picture>,
    last_picture_sent: Option<CentreTime>,
}

impl Centre {
    /// A centre that knows nothing yet.
    #[must_use]
    pub fn new(config: Arc<CentreConfig>, boot: BootId) -> Self {
        Self {
            keys: Keys::new(config.site.clone()),
            gather: Gather::new(config.gather, config.reference.clone(), boot),
            poses: Poses::new(config.reference.clone()),
            refusals: Refusals::default(),
            outbox: Outbox::new(boot),
            last_picture: None,
            last_picture_sent: None,
            config,
        }
    }

    /// Messages refused so far, by key and reason.
    #[must_use]
    pub fn refusals(&self) -> &Refusals {
        &self.refusals
    }

    /// Takes one event in at `now` and says what is to be done.
    pub fn step(&mut self, now: CentreTime, event: Event) -> Vec<Effect> {
        match event {
            Event::Delivered(delivery) => self.on_delivery(now, &delivery),
            Event::Solved(solved) => self.on_solved(now, &solved),
            Event::Tick => {}
        }
        self.close_periods(now);
        self.refresh_picture(now);
        self.outbox.take()
    }

    fn on_delivery(&mut self, now: CentreTime, delivery: &Delivery) {
        match inbox::read(&self.keys, delivery) {
            Ok(Inbound::Points(set)) => self.on_points(now, set),
            Ok(Inbound::Status(status)) => self.on_status(now, &status),
            Ok(Inbound::Probe(probe)) => self.on_probe(now, &probe),
            Ok(Inbound::Command(command)) => self.on_command(now, &command.body),
            Ok(Inbound::Life { node, alive }) => info!(%node, alive, "liveliness"),
            Ok(Inbound::Nothing) => {}
            Err(refused) => {
                self.refusals.count(&refused);
                let node = refused.node.as_ref();
                if let Some(history) = node.and_then(|node| self.gather.node_mut(node)) {
                    history.refused_count += 1;
                }
            }
        }
    }

    fn on_points(&mut self, now: CentreTime, set: Received<PointSet>) {
        let node = set.body.node.clone();
        let (boot, sequence) = (set.stamp.boot, set.stamp.sequence);
        let (offer, mut periods) = self.gather.offer(now, set);
        match offer {
            Offer::Kept(period) => periods.push(period),
            Offer::AwaitsClock | Offer::Duplicate => {}
            Offer::Late | Offer::FromTheFuture => warn!(%node, sequence, ?offer, "set not used"),
            Offer::FormerLife => {
                warn!(%node, %boot, "set of a former life: are there two agents of this name?");
            }
            Offer::TooManyNodes => warn!(%node, "refused: gather.max_node_count nodes are known"),
        }
        self.register(&node, &periods);
    }

    fn on_status(&mut self, now: CentreTime, status: &Received<NodeStatus>) {
        let node = &status.body.node;
        let Some(history) = self.gather.node_mut(node) else { return };
        history.hear(now, status.stamp.boot);
        if let Some(clock) = status.body.clock {
            let periods = self.gather.learn_clock(node, clock);
            self.register(node, &periods);
        }
    }

    fn on_probe(&mut self, now: CentreTime, probe: &Received<ClockProbe>) {
        let ClockProbe { node, asked } = probe.body.clone();
        let answer = ClockAnswer { node: node.clone(), asked, answered: now };
        self.outbox.publish(now, Topic::ClockAnswer(node), &answer);
    }

    fn on_command(&mut self, now: CentreTime, command: &Command) {
        info!(?command, "operator");
        let Command::Recalibrate { node } = command;
        let named: Vec<NodeId> = match node {
            Some(one) => vec![one.clone()],
            None => self.gather.nodes().map(|(each, _)| each.clone()).collect(),
        };
        for each in &named {
            self.gather.forget(each);
            self.poses.doubt(each);
        }
        self.publish_transforms(now, &named);
    }

    /// Asks for new solutions where the periods that came made a pair of nodes more complete.
    fn register(&mut self, node: &NodeId, periods: &[i64]) {
        for job in self.poses.jobs(&self.gather, node, periods) {
            self.outbox.solve(job);
        }
    }

    fn on_solved(&mut self, now: CentreTime, solved: &Solved) {
        let known_before = self.poses.transform(&solved.job.node).is_some();
        self.poses.take(now, solved);
        if !known_before && let Some(transform) = self.poses.transform(&solved.job.node) {
            info!(node = %solved.job.node, pose = ?transform.pose_ref_from_node, "registered");
        }
        self.publish_transforms(now, std::slice::from_ref(&solved.job.node));
        if let Some(job) = self.poses.next_job(&self.gather, &solved.job.node) {
            self.outbox.solve(job);
        }
    }

    fn publish_transforms(&mut self, now: CentreTime, nodes: &[NodeId]) {
        for node in nodes {
            if let Some(registration) = self.poses.registration(now, node) {
                self.outbox.publish(now, Topic::Transform(node.clone()), &registration);
            }
        }
    }

    fn close_periods(&mut self, now: CentreTime) {
        self.announce_reference(now);
        while let Some(period) = self.gather.close_next(now) {
            let picture = Picture {
                reference: self.config.reference.clone(),
                period,
                time: self.gather.middle(period),
                nodes: Vec::new(),
                targets: fuse(&self.sightings(period), self.config.fuse.gate()),
            };
            self.send_picture(now, picture);
        }
    }

    fn announce_reference(&mut self, now: CentreTime) {
        let reference = self.config.reference.clone();
        if self.gather.node(&reference).is_some() && self.poses.announce_reference(now) {
            self.publish_transforms(now, &[reference]);
        }
    }

    fn refresh_picture(&mut self, now: CentreTime) {
        let due = self.last_picture_sent.is_none_or(|sent| PICTURE_INTERVAL <= now.since(sent));
        if due && let Some(picture) = self.last_picture.clone() {
            self.send_picture(now, picture);
        }
    }

    fn send_picture(&mut self, now: CentreTime, mut picture: Picture) {
        picture.nodes = poses::node_lines(now, &self.gather, &self.poses);
        self.outbox.publish(now, Topic::Picture, &picture);
        self.last_picture_sent = Some(now);
        self.last_picture = Some(picture);
    }

    /// The points of all registered nodes in one period, in `Ref`.
    fn sightings(&self, period: i64) -> Vec<Sighting> {
        let mut sightings = Vec::new();
        for (node, history) in self.gather.nodes() {
            let Some(set) = history.sets().get(&period) else { continue };
            let Some((pose_ref_from_node, covariance)) = self.poses.pose(node) else { continue };
            sightings.extend(set.points.iter().map(|point| Sighting {
                node: node.clone(),
                position: place(pose_ref_from_node, &covariance, point.position),
                snr_db: point.snr_db,
            }));
        }
        sightings
    }
}

/// The stamp of the centre's next message of one kind.
fn stamp(boot: BootId, sequence: u64, now: CentreTime) -> Stamp {
    Stamp { boot, sequence, sent_ns: u64::try_from(now.0).unwrap_or(0) }
}

#[cfg(test)]
mod tests;
