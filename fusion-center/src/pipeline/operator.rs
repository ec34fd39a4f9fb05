//! What operators ask for, and what they are told.

use std::collections::BTreeSet;
use std::fmt::Display;

use proto::ids::{BootId, NodeId};
use proto::keys::Topic;
use proto::time::CentreTime;
use proto::wire::{Answer, Command, Received};
use tracing::{info, warn};

use super::Centre;

impl Centre {
    /// Does what an operator asks, or says why not.
    pub(super) fn on_command(&mut self, now: CentreTime, command: &Received<Command>) {
        let result = match &command.body {
            Command::Recalibrate { node } => self.recalibrate(now, node.as_ref()),
            Command::Pin { node, pose } => self
                .known(node)
                .and_then(|()| self.poses.pin(now, node, pose.as_ref()))
                .inspect(|_| self.on_operator(node)),
            Command::Unpin { node } => self
                .known(node)
                .and_then(|()| self.poses.unpin(node))
                .inspect(|_| self.on_operator(node)),
            Command::Rollback { node } => self
                .known(node)
                .and_then(|()| self.poses.rollback(now, node))
                .inspect(|_| self.on_operator(node)),
        };
        match &result {
            Ok(text) => info!(command = ?command.body, text, "operator"),
            Err(text) => warn!(command = ?command.body, text, "operator: not done"),
        }
        let is_done = result.is_ok();
        self.answer(now, command.stamp.boot, (is_done, result.unwrap_or_else(|text| text)));
    }

    fn answer(&mut self, now: CentreTime, to: BootId, (is_done, text): (bool, String)) {
        let answer = Answer { to, is_done, text };
        self.outbox.publish(now, Topic::Answer(to), &answer);
    }

    /// Names may be misspelt: only nodes that were heard, or of which the state file tells, are
    /// known.
    fn known(&self, node: &NodeId) -> Result<(), String> {
        if self.gather.node(node).is_some() || self.poses.transform(node).is_some() {
            return Ok(());
        }
        let restored = self.poses.standings().keys();
        let known: BTreeSet<&NodeId> =
            self.gather.nodes().map(|(id, _)| id).chain(restored).collect();
        Err(format!("there is no node {node}; known are: {}", joined(known.into_iter())))
    }

    /// An operator changed a node's transform.
    fn on_operator(&mut self, node: &NodeId) {
        self.monitor.forget(node);
        self.told.insert(node.clone());
        self.network.is_stale = true;
        self.is_saved = false;
    }

    fn recalibrate(&mut self, now: CentreTime, node: Option<&NodeId>) -> Result<String, String> {
        if let Some(one) = node {
            self.known(one)?;
            if self.poses.is_pinned(one) {
                return Err(format!("{one} is pinned: unpin it first"));
            }
        }
        let pinned = self.poses.pinned();
        let named: Vec<NodeId> = match node {
            Some(one) => vec![one.clone()],
            None => {
                let all = self.gather.nodes().map(|(each, _)| each.clone());
                all.filter(|each| !pinned.contains(each)).collect()
            }
        };
        let mut doubted: BTreeSet<NodeId> = named.iter().cloned().collect();
        for each in &named {
            self.gather.forget(each);
            doubted.extend(self.start_over(each));
        }
        let doubted: Vec<NodeId> = doubted.into_iter().collect();
        self.publish_transforms(now, &doubted);
        let mut text = format!("registering anew: {}", joined(doubted.iter()));
        if !pinned.is_empty() && named.contains(&self.config.reference) {
            text.push_str("; pinned, in the frame of before: ");
            text.push_str(&joined(pinned.iter()));
        }
        Ok(text)
    }
}

/// Cut so that it fits an answer.
fn joined<T: Display>(names: impl Iterator<Item = T>) -> String {
    const MOST: usize = 12;
    let mut names: Vec<String> = names.map(|name| name.to_string()).collect();
    let more = names.len().saturating_sub(MOST);
    names.truncate(MOST);
    let listed = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
    if more == 0 { listed } else { format!("{listed} and {more} more") }
}
