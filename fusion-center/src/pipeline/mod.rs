//! READ FIRST: the centre as a pure state machine: gather, register, watch, fuse, publish.
//!
//! ```text
//! delivery ── decode, check ── gather ──┬── pair of nodes has a common period ── Solve ──┐
//!    (refused: counted, named)          │                                                │
//!                                       ├── period complete ── fuse ── publish picture   │
//!                                       └── period complete ── monitor: who moved?       │
//!                          Combine ── pair's pose accepted, or the old one kept ── Solved
//!                             │
//!     publish transforms ── accept or keep the old ones ── Combined
//! ```
//! It reads no clock and does no work of its own accord: [`Centre::step`] takes the time and one
//! event and returns what is to be done. The same events give the same effects, byte for byte.

mod belief;
mod inbox;
mod monitor;
mod network;
mod operator;
mod outbox;
mod outcomes;
mod pairs;
mod people;
mod pictures;
mod poses;
mod saved;
mod tracks;

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use proto::bus::Delivery;
use proto::ids::{BootId, NodeId};
use proto::keys::{Keys, Topic};
use proto::refusals::Refusals;
use proto::time::CentreTime;
use proto::wire::{
    ClockAnswer, ClockProbe, Message, NodeStatus, NodeTracks, Picture, PointSet, Received, Stamp,
    Suspicion,
};
use tracing::{error, info, warn};

pub use network::{Combination, Combined};
pub use pairs::{Job, Pair, Solved};
pub use saved::UnusableState;

use crate::config::CentreConfig;
use crate::gather::{Gather, Life, Offer};
use inbox::Inbound;
use monitor::{Monitor, Moved, Site};
use network::{Network, site_problem, with_pins};
use outbox::Outbox;
use pairs::Pairs;
use people::People;
use poses::Poses;
use tracks::Followed;

/// Least time between two writings of the state.
const SAVE_INTERVAL: Duration = Duration::from_secs(1);

/// What happens to the centre.
#[derive(Debug)]
pub enum Event {
    /// The bus delivered something, which arrived at this time.
    Delivered(Delivery, CentreTime),
    /// A registration asked for by [`Effect::Solve`] is done.
    Solved(Box<Solved>),
    /// A registration asked for came to nothing: the solver broke.
    SolveFailed(Pair),
    /// A combination asked for by [`Effect::Combine`] is done.
    Combined(Box<Combined>),
    /// A combination asked for came to nothing: it broke.
    CombineFailed,
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
    /// Combine this and report with [`Event::Combined`].
    Combine(Box<Combination>),
    /// Keep this text for the next life of the centre.
    Save(String),
}

/// The centre's state.
pub struct Centre {
    config: Arc<CentreConfig>,
    keys: Keys,
    gather: Gather,
    pairs: Pairs,
    network: Network,
    poses: Poses,
    monitor: Monitor,
    followed: Followed,
    people: People,
    refusals: Refusals,
    outbox: Outbox,
    /// Nodes of whom there is news to publish.
    told: BTreeSet<NodeId>,
    is_saved: bool,
    last_saved: Option<CentreTime>,
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
            pairs: Pairs::new(config.reference.clone(), config.work),
            network: Network::new(),
            poses: Poses::new(config.reference.clone()),
            monitor: Monitor::new(config.monitor),
            followed: Followed::default(),
            people: People::new(&config.people),
            refusals: Refusals::default(),
            outbox: Outbox::new(boot),
            told: BTreeSet::new(),
            is_saved: true,
            last_saved: None,
            last_picture: None,
            last_picture_sent: None,
            config,
        }
    }

    /// Goes on from what a former life of the centre has saved.
    ///
    /// # Errors
    /// If the text is damaged, or of another installation.
    pub fn restore(&mut self, text: &str) -> Result<(), UnusableState> {
        let standings = saved::read(&self.config, text)?;
        self.told.extend(standings.keys().cloned());
        info!(node_count = standings.len(), "transforms of a former life are in force");
        self.poses.restore(standings);
        self.network.is_stale = true;
        Ok(())
    }

    /// What the next life of the centre should know.
    #[must_use]
    pub fn state(&self) -> Option<String> {
        let written = saved::written(&self.config, self.poses.standings());
        written.inspect_err(|failure| error!(%failure, "the state cannot be written")).ok()
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
            Event::Solved(solved) => self.on_solved(&solved),
            Event::SolveFailed(pair) => self.pairs.give_up(&pair),
            Event::Combined(combined) => self.on_combined(now, &combined),
            Event::CombineFailed => self.network.give_up(),
            Event::Tick => {}
        }
        self.close_periods(now);
        self.refresh_picture(now);
        self.work(now);
        self.outbox.take()
    }

    /// Starts what is due and says what is new.
    fn work(&mut self, now: CentreTime) {
        for job in self.pairs.start(now, &self.gather) {
            self.outbox.push(Effect::Solve(Box::new(job)));
        }
        if self.network.is_due(now) {
            let combination = self.combination();
            self.outbox.push(Effect::Combine(Box::new(combination)));
        }
        // What is told of a pose that is about to change would be old at once.
        if self.network.is_quiet() {
            let told: Vec<NodeId> = std::mem::take(&mut self.told).into_iter().collect();
            self.publish_transforms(now, &told);
        }
        let is_due = self.last_saved.is_none_or(|saved| SAVE_INTERVAL <= now.since(saved));
        if !self.is_saved && is_due && !self.config.state.path.is_empty() {
            (self.is_saved, self.last_saved) = (true, Some(now));
            self.outbox.extend(self.state().map(Effect::Save));
        }
    }

    fn combination(&mut self) -> Combination {
        let reference = self.config.reference.clone();
        let pins = self.poses.pins();
        let problem = pins.is_empty().then(|| site_problem(&self.gather, &reference));
        let edges = with_pins(&reference, self.pairs.edges(), pins);
        let nodes = self.gather.nodes().map(|(node, _)| node.clone()).collect();
        Combination { reference, nodes, edges, problem, generation: self.network.start() }
    }

    fn on_delivery(&mut self, now: CentreTime, arrived: CentreTime, delivery: &Delivery) {
        match inbox::read(&self.keys, delivery) {
            Ok(Inbound::Points(set)) => self.on_points(now, arrived, set),
            Ok(Inbound::Tracks(tracks)) => self.on_tracks(now, tracks),
            Ok(Inbound::Status(status)) => self.on_status(now, &status),
            Ok(Inbound::Probe(probe)) => self.on_probe(arrived, &probe),
            Ok(Inbound::Command(command)) => self.on_command(now, &command),
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
        self.pairs.note(&self.gather, &node, &periods);
        self.complete_pictures(now, &periods);
    }

    fn on_tracks(&mut self, now: CentreTime, tracks: Received<NodeTracks>) {
        let key = self.keys.key(&Topic::Tracks(tracks.body.node.clone()));
        if let Err(unused) = self.followed.take(now, &mut self.gather, tracks) {
            self.refusals.count(&key, unused.label(), unused.reason());
        }
    }

    fn on_status(&mut self, now: CentreTime, status: &Received<NodeStatus>) {
        let node = &status.body.node;
        let Some(history) = self.gather.node_mut(node) else { return };
        if history.hear(now, status.stamp.boot) == Life::Former {
            return;
        }
        if let Some(held) = status.body.transform_epoch
            && self.poses.hear_epoch(node, held)
        {
            self.is_saved = false;
            self.told.insert(node.clone());
        }
        if let Some(clock) = status.body.clock {
            let periods = self.gather.learn_clock(node, clock);
            self.pairs.note(&self.gather, node, &periods);
            self.complete_pictures(now, &periods);
        }
    }

    fn on_probe(&mut self, arrived: CentreTime, probe: &Received<ClockProbe>) {
        let ClockProbe { node, asked } = probe.body.clone();
        let answer = ClockAnswer { node: node.clone(), asked, answered: arrived };
        self.outbox.publish(arrived, Topic::ClockAnswer(node), &answer);
    }

    fn on_solved(&mut self, solved: &Solved) {
        if self.pairs.take(solved) {
            self.network.is_stale = true;
        }
        let Pair { first, second } = &solved.job.pair;
        for node in [first, second].into_iter().filter(|node| **node != self.config.reference) {
            self.poses.note(node);
            self.told.insert(node.clone());
        }
    }

    fn on_combined(&mut self, now: CentreTime, combined: &Combined) {
        if !self.network.end(now, combined) {
            return;
        }
        let news = self.poses.take(now, &combined.groups, &self.pairs);
        self.is_saved &= news.is_empty();
        self.told.extend(news);
    }

    /// What was found with a node's earlier sets is not believed any longer. Returns whose poses
    /// rested on it: any determined pose may replace them.
    fn start_over(&mut self, node: &NodeId) -> Vec<NodeId> {
        self.pairs.doubt(node);
        self.monitor.forget(node);
        let resting = self.poses.resting_on(node);
        for one in &resting {
            self.poses.doubt(one);
            self.monitor.forget(one);
        }
        self.network.start_over();
        self.is_saved = false;
        if *node == self.config.reference {
            self.people.start_over();
            let pinned = self.poses.outdate_pins();
            if !pinned.is_empty() {
                warn!(
                    ?pinned,
                    "the reference is registered anew: these pins are of its frame of before, \
                    and nobody comes in through them until they are pinned again or unpinned"
                );
            }
        }
        resting
    }

    fn publish_transforms(&mut self, now: CentreTime, nodes: &[NodeId]) {
        for node in nodes {
            if let Some(registration) = self.poses.registration(now, node, &self.pairs) {
                self.outbox.publish(now, Topic::Transform(node.clone()), &registration);
            }
        }
    }

    fn close_periods(&mut self, now: CentreTime) {
        self.announce_reference(now);
        while let Some(period) = self.gather.close_next(now) {
            self.people.take(period, &self.gather, &self.poses.placements());
            let picture = self.picture(period);
            self.send_picture(now, picture);
            self.note_places(period);
            self.watch(now, period);
        }
    }

    /// Looks whether a node was moved; what was seen before it was is forgotten.
    fn watch(&mut self, now: CentreTime, period: i64) {
        let mut placements = self.poses.placements();
        placements.retain(|node, _| {
            let history = self.gather.node(node);
            history.is_some_and(|history| self.gather.is_heard(now, history))
        });
        let site = Site { gather: &self.gather, reference: &self.config.reference, placements };
        let Some(moved) = self.monitor.look(&site, period) else { return };
        let Moved { node, began, correction, chi_square } = moved;
        let suspicion = Suspicion {
            moved: node.clone(),
            began: self.gather.middle(began),
            shift_x_m: correction.x,
            shift_y_m: correction.y,
            turn_rad: correction.z,
            chi_square,
        };
        warn!(%node, ?suspicion, "seems to have been moved: registering anew");
        self.gather.forget_before(&node, began);
        self.followed.forget(&node);
        let resting = self.start_over(&node);
        self.told.extend(resting);
        let suspects = self.poses.suspect(&node, &suspicion);
        suspects.iter().for_each(|suspect| self.monitor.forget(suspect));
        // At once: the data after the move may register it anew within this very step.
        self.publish_transforms(now, &suspects);
        if let Some(picture) = self.last_picture.clone() {
            self.send_picture(now, picture);
        }
    }

    fn announce_reference(&mut self, now: CentreTime) {
        let reference = self.config.reference.clone();
        if self.gather.node(&reference).is_some() && self.poses.announce_reference(now) {
            self.publish_transforms(now, &[reference]);
        }
    }
}

/// The stamp of the centre's next message of one kind.
fn stamp(boot: BootId, sequence: u64, now: CentreTime) -> Stamp {
    Stamp { boot, sequence, sent_ns: u64::try_from(now.0).unwrap_or(0) }
}

#[cfg(test)]
mod drawn;
#[cfg(test)]
mod moved_tests;
#[cfg(test)]
mod tests;
