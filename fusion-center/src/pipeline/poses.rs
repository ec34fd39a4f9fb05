//! Every node's transform: which is in force, whether it is doubted, and who may replace it.

use std::collections::{BTreeMap, VecDeque};

use nalgebra::{Matrix3, Vector3};
use proto::geom::{Node, Ref, Se2};
use proto::ids::NodeId;
use proto::time::CentreTime;
use proto::wire::{PoseRecord, StatedPose, Suspicion, Transform};
use tracing::{info, warn};

use self::situation::Situation;
use super::belief::{Belief, Judgement};
use super::monitor::Placement;
use super::pairs::Pairs;
use crate::network::{Edge, Group, Placed};
use crate::registration::{self, Known, PoseEstimate, Solution};

mod situation;

/// Transforms kept beside the one in force, to go back to.
const HISTORY_COUNT: usize = 4;
/// Agents cannot raise an epoch beyond this: nobody ever counts so far.
const MAX_EPOCH: u64 = 1 << 53;
/// Fresh data confirm a doubted pose if it lies within them by chance of all but one in a hundred,
/// and the suspected one explains them worse by a factor of e^4.5.
const CONFIRMATION_GATE: f64 = 11.3;
const CONFIRMATION_LEAD: f64 = 9.0;

/// A transform and the odds that it rests on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Kept {
    pub(super) transform: Transform,
    pub(super) log_odds: f64,
}

/// One node's standing.
#[derive(Clone, Debug, Default)]
pub(super) struct Standing {
    pub(super) in_force: Option<Kept>,
    /// Earlier ones that differ by more than their uncertainty, the newest last.
    pub(super) history: VecDeque<Kept>,
    pub(super) next_epoch: u64,
    pub(super) is_pinned: bool,
    /// It was pinned before the reference was registered anew: the pose is in no frame of now.
    pub(super) is_outdated: bool,
    suspicion: Option<Suspicion>,
    situation: Situation,
    /// Results that contradicted the pose in force and were not accepted.
    contradiction_count: u64,
}

/// What fresh data say about a doubted pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fresh {
    /// They contradict it, or know better in any case.
    Replace,
    /// They are vaguer, but speak for it and against the suspected one.
    Confirm,
    /// They are vaguer and fit both.
    Undecided,
}

/// The poses of all nodes.
#[derive(Debug)]
pub(super) struct Poses {
    reference: NodeId,
    standings: BTreeMap<NodeId, Standing>,
}

impl Kept {
    fn belief(&self) -> Belief {
        Belief {
            pose: self.transform.pose_ref_from_node.into(),
            covariance: self.transform.covariance_matrix(),
            log_odds: self.log_odds,
        }
    }
}

impl Standing {
    /// Puts a pose in force, under the next epoch.
    fn enforce(&mut self, now: CentreTime, new: &Belief) {
        let accepted = now;
        let covariance =
            std::array::from_fn(|row| std::array::from_fn(|column| new.covariance[(row, column)]));
        let pose_ref_from_node = PoseRecord::from(new.pose);
        let epoch = self.next_epoch;
        let transform = Transform { epoch, accepted, pose_ref_from_node, covariance };
        let log_odds = new.log_odds;
        if let Some(old) = self.in_force.replace(Kept { transform, log_odds })
            && !old.belief().is_refined_by(new)
        {
            self.history.push_back(old);
            while HISTORY_COUNT < self.history.len() {
                self.history.pop_front();
            }
        }
        self.next_epoch = self.next_epoch.saturating_add(1);
    }

    /// Takes in a result about a node that is not suspect. True if another pose is in force now.
    fn follow(&mut self, now: CentreTime, (node, new): (&NodeId, &Belief)) -> bool {
        let Some(kept) = self.in_force else { return self.register(now, (node, new)) };
        let old = kept.belief();
        if old.is_same_as(new) {
            // What new data have found again is not doubted any longer.
            let log_odds = if old.is_doubted() { new.log_odds } else { kept.log_odds };
            self.in_force = Some(Kept { log_odds, ..kept });
            return false;
        }
        match old.judge(new) {
            Judgement::Accept => self.enforce(now, new),
            Judgement::Vaguer => return false,
            Judgement::Contradicts => {
                self.count_contradiction(node);
                return false;
            }
        }
        true
    }

    /// Puts a pose in force whatever was before. True: that is news.
    fn register(&mut self, now: CentreTime, (node, new): (&NodeId, &Belief)) -> bool {
        self.enforce(now, new);
        info!(%node, pose = ?new.pose, epoch = self.next_epoch - 1, "registered");
        true
    }

    fn count_contradiction(&mut self, node: &NodeId) {
        self.contradiction_count += 1;
        if self.contradiction_count.is_power_of_two() {
            warn!(%node, count = self.contradiction_count,
                "the pairs contradict the transform in force without clearly more to rest on: kept");
        }
    }

    /// What fresh data say about a doubted pose.
    fn weigh(&self, old: &Belief, new: &Belief) -> Fresh {
        let Some(suspicion) = &self.suspicion else { return Fresh::Replace };
        let Suspicion { shift_x_m, shift_y_m, turn_rad, .. } = *suspicion;
        let at_m = old.pose.translation_m();
        let heading_rad = old.pose.heading_rad() + turn_rad;
        let suspected = Se2::new(at_m.x + shift_x_m, at_m.y + shift_y_m, heading_rad);
        let to_old = new.distance(&old.pose, &old.covariance);
        let to_suspected = new.distance(&suspected, &old.covariance);
        // Points that had lost their partners do not tell where to; fresh ones that agree suffice.
        let is_unknown = shift_x_m.abs() + shift_y_m.abs() + turn_rad.abs() <= 0.0;
        if CONFIRMATION_GATE < to_old || !old.is_clearer_than(new) {
            Fresh::Replace
        } else if is_unknown || to_old + CONFIRMATION_LEAD <= to_suspected {
            Fresh::Confirm
        } else {
            Fresh::Undecided
        }
    }
}

impl Poses {
    pub(super) fn new(reference: NodeId) -> Self {
        Self { reference, standings: BTreeMap::new() }
    }

    /// What a former life of the centre knew.
    pub(super) fn restore(&mut self, standings: BTreeMap<NodeId, Standing>) {
        self.standings = standings;
    }

    pub(super) fn standings(&self) -> &BTreeMap<NodeId, Standing> {
        &self.standings
    }

    /// The transform in force.
    pub(super) fn transform(&self, node: &NodeId) -> Option<&Transform> {
        self.standings.get(node)?.in_force.as_ref().map(|kept| &kept.transform)
    }

    /// The pose in force and its covariance.
    pub(super) fn pose(&self, node: &NodeId) -> Option<(Se2<Ref, Node>, Matrix3<f64>)> {
        let transform = self.transform(node)?;
        Some((transform.pose_ref_from_node.into(), transform.covariance_matrix()))
    }

    pub(super) fn suspicion(&self, node: &NodeId) -> Option<&Suspicion> {
        self.standings.get(node)?.suspicion.as_ref()
    }

    pub(super) fn is_pinned(&self, node: &NodeId) -> bool {
        self.standings.get(node).is_some_and(|standing| standing.is_pinned)
    }

    /// The nodes that have a pose nobody doubts.
    pub(super) fn placements(&self) -> BTreeMap<NodeId, Placement> {
        let rests_on_nothing = |kept: &Kept| kept.belief().is_doubted();
        let is_sound = |one: &Standing| {
            let is_doubted = !one.is_pinned && one.in_force.as_ref().is_some_and(rests_on_nothing);
            one.suspicion.is_none() && !one.is_outdated && !is_doubted
        };
        let undoubted = self.standings.iter().filter(|(_, one)| is_sound(one));
        let placement = |(node, _): (&NodeId, &Standing)| {
            let (pose, covariance) = self.pose(node)?;
            Some((node.clone(), Placement { pose, covariance }))
        };
        undoubted.filter_map(placement).collect()
    }

    /// The reference node defines `Ref`: its transform is the identity, exactly. True if that is
    /// news.
    pub(super) fn announce_reference(&mut self, now: CentreTime) -> bool {
        let standing = self.standings.entry(self.reference.clone()).or_default();
        if standing.in_force.is_some() {
            return false;
        }
        let (pose, covariance) = (Se2::identity(), Matrix3::zeros());
        standing.enforce(now, &Belief { pose, covariance, log_odds: f64::INFINITY });
        true
    }

    /// Takes the poses of all groups in; returns the nodes of whom there is news.
    pub(super) fn take(&mut self, now: CentreTime, groups: &[Group], pairs: &Pairs) -> Vec<NodeId> {
        let mut news = Vec::new();
        let reference = self.reference.clone();
        for (node, placed, situation) in situation::situations(&reference, groups) {
            let is_attached = matches!(situation, Situation::Placed { .. });
            let has_regrouped = self.regroup(node, situation);
            if (is_attached && self.propose(now, (node, placed), pairs)) || has_regrouped {
                news.push(node.clone());
            }
        }
        news
    }

    /// Notes how a node hangs together with others. True if that is news.
    fn regroup(&mut self, node: &NodeId, situation: Situation) -> bool {
        let standing = self.standings.entry(node.clone()).or_default();
        let has_changed = !standing.situation.is_like(&situation);
        standing.situation = situation;
        if has_changed && !matches!(standing.situation, Situation::Placed { .. }) {
            info!(%node, situation = ?standing.situation, "does not hang together with the reference");
        }
        has_changed
    }

    /// True if the transform in force or its standing is another now.
    fn propose(
        &mut self,
        now: CentreTime,
        (node, placed): (&NodeId, &Placed),
        pairs: &Pairs,
    ) -> bool {
        let Some(standing) = self.standings.get_mut(node) else { return false };
        if standing.is_pinned {
            return false;
        }
        let PoseEstimate { pose_ref_from_node: pose, covariance } = placed.estimate;
        let new = Belief { pose, covariance, log_odds: pairs.log_odds(&placed.via) };
        let Some(because_of) = standing.suspicion.as_ref().map(|why| why.moved.clone()) else {
            return standing.follow(now, (node, &new));
        };
        match standing.in_force.map(|kept| (kept, standing.weigh(&kept.belief(), &new))) {
            Some((_, Fresh::Undecided)) => return false,
            Some((kept, Fresh::Confirm)) => {
                info!(%node, "fresh data confirm the pose: suspicion ends");
                standing.in_force = Some(Kept { log_odds: new.log_odds, ..kept });
            }
            Some((_, Fresh::Replace)) | None => {
                standing.register(now, (node, &new));
            }
        }
        standing.suspicion = None;
        // With the first pose from fresh data of the reference, `Ref` is sound again.
        if because_of == self.reference
            && let Some(of_reference) = self.standings.get_mut(&self.reference)
        {
            of_reference.suspicion = None;
        }
        true
    }

    /// Notes that a node seems to have moved. Returns who is suspect because of it: everybody, if
    /// it is the reference.
    pub(super) fn suspect(&mut self, node: &NodeId, why: &Suspicion) -> Vec<NodeId> {
        let is_reference = *node == self.reference;
        let is_meant = |(other, standing): &(&NodeId, &mut Standing)| {
            (is_reference || *other == node) && standing.in_force.is_some()
        };
        let mut suspects = Vec::new();
        for (other, standing) in self.standings.iter_mut().filter(is_meant) {
            let own = if other == node {
                why.clone()
            } else {
                // Who did not move needs the opposite of the reference's correction.
                let seen = opposite(why, standing.in_force.as_ref());
                Suspicion { shift_x_m: seen.x, shift_y_m: seen.y, turn_rad: seen.z, ..why.clone() }
            };
            standing.suspicion = Some(own);
            suspects.push(other.clone());
        }
        suspects
    }

    /// Whose pose rests on a node: its own, and those that come in through it; everybody's, if it
    /// is the reference. A pinned pose rests on the operator's word.
    pub(super) fn resting_on(&self, node: &NodeId) -> Vec<NodeId> {
        let rests = |(other, standing): &(&NodeId, &Standing)| {
            let is_meant = *node == self.reference || *other == node;
            **other != self.reference
                && !standing.is_pinned
                && (is_meant || standing.situation.via().contains(node))
        };
        self.standings.iter().filter(rests).map(|(other, _)| other.clone()).collect()
    }

    /// The transform stays in force, but any determined pose may replace it.
    pub(super) fn doubt(&mut self, node: &NodeId) {
        let standing = self.standings.get_mut(node).filter(|_| *node != self.reference);
        let Some(standing) = standing else { return };
        standing.situation = Situation::Unknown;
        if let Some(kept) = standing.in_force.as_mut() {
            kept.log_odds = f64::NEG_INFINITY;
        }
    }

    /// The reference is registered anew: pins go on, but nobody comes in through them until the
    /// operator says again what holds. Returns who is pinned.
    pub(super) fn outdate_pins(&mut self) -> Vec<NodeId> {
        let pinned = self.standings.iter_mut().filter(|(_, standing)| standing.is_pinned);
        let outdate = |(node, standing): (&NodeId, &mut Standing)| {
            standing.is_outdated = true;
            node.clone()
        };
        pinned.map(outdate).collect()
    }

    /// The nodes that the operator has pinned.
    pub(super) fn pinned(&self) -> Vec<NodeId> {
        let pinned = self.standings.iter().filter(|(_, standing)| standing.is_pinned);
        pinned.map(|(node, _)| node.clone()).collect()
    }

    /// The solutions that stand for pinned poses. Others must not come in through one that is
    /// suspect or outdated.
    pub(super) fn pins(&self) -> Vec<Edge> {
        let is_pin = |standing: &Standing| {
            standing.is_pinned && !standing.is_outdated && standing.suspicion.is_none()
        };
        let pinned = self.standings.iter().filter(|(_, standing)| is_pin(standing));
        let edge = |(node, standing): (&NodeId, &Standing)| {
            let belief = standing.in_force.as_ref()?.belief();
            let pose_ref_from_node = belief.pose;
            let estimate = PoseEstimate { pose_ref_from_node, covariance: belief.covariance };
            let solution = Solution {
                estimate: Some(estimate),
                outcome: registration::Outcome::Determined,
                evidence: registration::Evidence::default(),
                known: Known::default(),
            };
            Some(Edge { first: self.reference.clone(), second: node.clone(), solution })
        };
        pinned.filter_map(edge).collect()
    }

    /// Pins a node, or says why not.
    pub(super) fn pin(
        &mut self,
        now: CentreTime,
        node: &NodeId,
        stated: Option<&StatedPose>,
    ) -> Result<String, String> {
        if *node == self.reference {
            return Err(format!("{node} is the reference: its pose defines the common frame"));
        }
        let standing = self.standings.entry(node.clone()).or_default();
        if let Some(StatedPose { pose_ref_from_node, sigma_m, sigma_rad }) = stated {
            let sigmas = Vector3::new(*sigma_m, *sigma_m, *sigma_rad);
            let covariance = Matrix3::from_diagonal(&sigmas.map(|sigma| sigma * sigma));
            let pose = (*pose_ref_from_node).into();
            standing.enforce(now, &Belief { pose, covariance, log_odds: f64::INFINITY });
            standing.suspicion = None;
        }
        standing.is_outdated = false;
        let Some(kept) = &standing.in_force else {
            return Err(format!(
                "{node} has no transform yet: state one with --x-m, --y-m, --heading-deg"
            ));
        };
        standing.is_pinned = true;
        Ok(format!("{node} keeps its transform of epoch {} until unpin", kept.transform.epoch))
    }

    /// Lets results replace a node's transform again, or says why not.
    pub(super) fn unpin(&mut self, node: &NodeId) -> Result<String, String> {
        let standing = self.standings.get_mut(node).filter(|standing| standing.is_pinned);
        let Some(standing) = standing else { return Err(format!("{node} is not pinned")) };
        (standing.is_pinned, standing.is_outdated) = (false, false);
        standing.suspicion = None;
        self.doubt(node);
        Ok(format!("{node} follows the results again"))
    }

    /// Puts a node's transform of before in force again and pins it, or says why not.
    pub(super) fn rollback(&mut self, now: CentreTime, node: &NodeId) -> Result<String, String> {
        let Some(standing) = self.standings.get_mut(node) else {
            return Err(format!("{node} has no transform"));
        };
        let Some(earlier) = standing.history.pop_back() else {
            return Err(format!(
                "{node} has no earlier transform that differs by more than its uncertainty"
            ));
        };
        let replaced = standing.in_force;
        standing.enforce(now, &earlier.belief());
        // What was rolled back is not what to go back to.
        standing.history.retain(|kept| Some(*kept) != replaced);
        (standing.is_pinned, standing.is_outdated) = (true, false);
        standing.suspicion = None;
        let (of, epoch) = (earlier.transform.epoch, standing.next_epoch - 1);
        Ok(format!(
            "{node} is back at the pose of epoch {of}, now epoch {epoch}, pinned until unpin"
        ))
    }

    /// Takes in which epoch a node's agent holds: one that this centre has not given yet is of a
    /// former life, so that epochs go on from there. True if the transform in force has another
    /// epoch now.
    pub(super) fn hear_epoch(&mut self, node: &NodeId, held: u64) -> bool {
        let standing = self.standings.entry(node.clone()).or_default();
        if held < standing.next_epoch || MAX_EPOCH <= held {
            return false;
        }
        warn!(%node, held, "the agent holds an epoch of a former centre: going on from there");
        standing.next_epoch = held + 1;
        let Some(kept) = standing.in_force.as_mut() else { return false };
        kept.transform.epoch = standing.next_epoch;
        standing.next_epoch += 1;
        true
    }

    /// A node of which something was solved is spoken of from now on.
    pub(super) fn note(&mut self, node: &NodeId) {
        self.standings.entry(node.clone()).or_default();
    }
}

/// The correction of a node that did not move, where the reference needs `why`'s: `Ref` itself
/// turns and shifts the other way.
fn opposite(why: &Suspicion, kept: Option<&Kept>) -> Vector3<f64> {
    let at = kept.map_or((0.0, 0.0), |kept| {
        let pose = kept.transform.pose_ref_from_node;
        (pose.x_m, pose.y_m)
    });
    let turn = -why.turn_rad;
    Vector3::new(-why.shift_x_m - turn * at.1, -why.shift_y_m + turn * at.0, turn)
}

#[cfg(test)]
mod tests;
