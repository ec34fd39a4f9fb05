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
use proto::refusals::Refusals;
use proto::time::CentreTime;
use proto::wire::{
    ClockAnswer, ClockProbe, Command, Message, NodeStatus, Picture, PointSet, Received, Stamp,
};
use tracing::{info, warn};

pub use poses::{Job, Poses, Solved};

use crate::config::CentreConfig;
use crate::fuse::{Sighting, fuse, place};
use crate::gather::{Gather, Life, Offer};
use inbox::Inbound;
use outbox::Outbox;

/// The picture is published at least this often, so that silence shows.
const PICTURE_INTERVAL: Duration = Duration::from_secs(1);

/// Most points that one picture is made of; joining them costs the square of this.
const MAX_SIGHTING_COUNT: usize = 512;

/// What happens to the centre.
#[derive(Debug)]
pub enum Event {
    /// The bus delivered something, which arrived at this time.
    Delivered(Delivery, CentreTime),
    /// A registration asked for by [`Effect::Solve`] is done.
    Solved(Box<Solved>),
    /// A registration asked for came to nothing: the solver broke.
    SolveFailed(NodeId),
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
            Event::Delivered(delivery, arrived) => self.on_delivery(now, arrived, &delivery),
            Event::Solved(solved) => self.on_solved(now, &solved),
            Event::SolveFailed(node) => self.poses.give_up(&node),
            Event::Tick => {}
        }
        self.close_periods(now);
        self.refresh_picture(now);
        self.outbox.take()
    }

    fn on_delivery(&mut self, now: CentreTime, arrived: CentreTime, delivery: &Delivery) {
        match inbox::read(&self.keys, delivery) {
            Ok(Inbound::Points(set)) => self.on_points(now, arrived, set),
            Ok(Inbound::Status(status)) => self.on_status(now, &status),
            Ok(Inbound::Probe(probe)) => self.on_probe(arrived, &probe),
            Ok(Inbound::Command(command)) => self.on_command(now, &command.body),
            Ok(Inbound::Life { node, alive }) => info!(%node, alive, "liveliness"),
            Ok(Inbound::Nothing) => {}
            Err(refused) => {
                self.refusals.count(&refused.key, refused.label, &refused.reason);
                let node = refused.node.as_ref();
                if let Some(history) = node.and_then(|node| self.gather.node_mut(node)) {
                    history.refused_count += 1;
                }
            }
        }
    }

    fn on_points(&mut self, now: CentreTime, arrived: CentreTime, set: Received<PointSet>) {
        let node = set.body.node.clone();
        let (offer, mut periods) = self.gather.offer(arrived, set);
        match offer {
            Offer::Kept(period) => periods.push(period),
            Offer::AwaitsClock | Offer::Duplicate => {}
            unused => {
                let key = self.keys.key(&Topic::Points(node.clone()));
                self.refusals.count(&key, unused.label(), unused.reason());
            }
        }
        self.register(&node, &periods);
        self.complete_pictures(now, &periods);
    }

    fn on_status(&mut self, now: CentreTime, status: &Received<NodeStatus>) {
        let node = &status.body.node;
        let Some(history) = self.gather.node_mut(node) else { return };
        if history.hear(now, status.stamp.boot) == Life::Former {
            return;
        }
        if let Some(clock) = status.body.clock {
            let periods = self.gather.learn_clock(node, clock);
            self.register(node, &periods);
            self.complete_pictures(now, &periods);
        }
    }

    fn on_probe(&mut self, arrived: CentreTime, probe: &Received<ClockProbe>) {
        let ClockProbe { node, asked } = probe.body.clone();
        let answer = ClockAnswer { node: node.clone(), asked, answered: arrived };
        self.outbox.publish(arrived, Topic::ClockAnswer(node), &answer);
    }

    fn on_command(&mut self, now: CentreTime, command: &Command) {
        info!(?command, "operator");
        let Command::Recalibrate { node } = command;
        if let Some(unknown) = node.as_ref().filter(|node| self.gather.node(node).is_none()) {
            let known: Vec<String> = self.gather.nodes().map(|(id, _)| id.to_string()).collect();
            warn!(node = %unknown, ?known, "recalibrate: no such node");
        }
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
            let picture = self.picture(period);
            self.send_picture(now, picture);
        }
    }

    /// Sets that came after their period was closed belong into its picture all the same.
    fn complete_pictures(&mut self, now: CentreTime, periods: &[i64]) {
        for period in periods {
            if self.gather.is_closed(*period) {
                let picture = self.picture(*period);
                self.send_picture(now, picture);
            }
        }
    }

    fn picture(&self, period: i64) -> Picture {
        let mut targets = fuse(&self.sightings(period), self.config.fuse.gate());
        // One node's wild point must not cost everybody the picture.
        targets.retain(|target| target.check().is_ok());
        Picture {
            reference: self.config.reference.clone(),
            period,
            time: self.gather.middle(period),
            nodes: Vec::new(),
            targets,
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
        if self.last_picture.as_ref().is_none_or(|last| last.period <= picture.period) {
            self.last_picture_sent = Some(now);
            self.last_picture = Some(picture);
        }
    }

    /// The points of all registered nodes in one period, in `Ref`: the strongest, if they are more
    /// than a picture holds.
    fn sightings(&self, period: i64) -> Vec<Sighting> {
        let mut sightings = Vec::new();
        for (node, history) in self.gather.nodes() {
            let Some(set) = history.sets().get(&period) else { continue };
            let Some((pose_ref_from_node, covariance)) = self.poses.pose(node) else { continue };
            sightings.extend(set.points.iter().map(|point| Sighting {
                node: node.clone(),
                position: place(
                    pose_ref_from_node,
                    &covariance,
                    point.with_half_depth_error(set.half_depth_sigma_m),
                ),
                snr_db: point.snr_db,
            }));
        }
        sightings.sort_by(|one, other| other.snr_db.total_cmp(&one.snr_db));
        sightings.truncate(MAX_SIGHTING_COUNT);
        sightings
    }
}

/// The stamp of the centre's next message of one kind.
fn stamp(boot: BootId, sequence: u64, now: CentreTime) -> Stamp {
    Stamp { boot, sequence, sent_ns: u64::try_from(now.0).unwrap_or(0) }
}

#[cfg(test)]
mod tests;
