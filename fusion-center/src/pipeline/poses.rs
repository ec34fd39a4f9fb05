//! Every node's transform: which is in force, whether it is doubted, and who may replace it.

use std::collections::{BTreeMap, VecDeque};

use nalgebra::{Matrix3, Vector3};
use proto::geom::{Node, Ref, Se2};
use proto::ids::NodeId;
use proto::time::CentreTime;
use proto::wire::{Evidence, Outcome, PoseRecord, Registration, StatedPose, Suspicion, Transform};
use tracing::{info, warn};

use super::belief::{Belief, Judgement};
use super::monitor::Placement;
use super::pairs::Pairs;
use crate::network::{Edge, Group, Placed};
use crate::registration::{self, Known, PoseEstimate, Solution};

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
    suspicion: Option<Suspicion>,
    /// The nodes through which the newest combination reached it, the reference first.
    via: Vec<NodeId>,
    /// The others of its group, where the reference is not among them.
    detached: Vec<NodeId>,
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
        let undoubted = self.standings.iter().filter(|(_, one)| one.suspicion.is_none());
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
    pub(super) fn take<'a>(
        &mut self,
        now: CentreTime,
        groups: &'a [Group],
        pairs: &Pairs,
    ) -> Vec<NodeId> {
        let reference = self.reference.clone();
        let members = |group: &'a Group| group.nodes.iter().map(move |entry| (group, entry));
        let all = groups.iter().flat_map(members);
        let mut news = Vec::new();
        for (group, (node, placed)) in all.filter(|(_, (node, _))| **node != reference) {
            let has_regrouped = self.regroup(node, placed, group);
            let is_attached = group.gauge == reference;
            if (is_attached && self.propose(now, node, placed, pairs)) || has_regrouped {
                news.push(node.clone());
            }
        }
        news
    }

    /// Notes with whom a node hangs together. True if that is news.
    fn regroup(&mut self, node: &NodeId, placed: &Placed, group: &Group) -> bool {
        let standing = self.standings.entry(node.clone()).or_default();
        let (mut via, mut detached) = (placed.via.clone(), Vec::new());
        if group.gauge != self.reference {
            via.clear();
            detached.extend(group.nodes.keys().filter(|other| *other != node).cloned());
        }
        standing.via = via;
        let has_changed = standing.detached != detached;
        standing.detached = detached;
        if has_changed && !standing.detached.is_empty() {
            info!(%node, with = ?standing.detached, "hangs together with others only");
        }
        has_changed
    }

    /// True if the transform in force or its standing is another now.
    fn propose(&mut self, now: CentreTime, node: &NodeId, placed: &Placed, pairs: &Pairs) -> bool {
        let Some(standing) = self.standings.get_mut(node) else { return false };
        if standing.is_pinned {
            return false;
        }
        let PoseEstimate { pose_ref_from_node: pose, covariance } = placed.estimate;
        let new = Belief { pose, covariance, log_odds: pairs.log_odds(&placed.via) };
        let fresh = standing.in_force.map(|kept| standing.weigh(&kept.belief(), &new));
        let because_of = standing.suspicion.as_ref().map(|why| why.moved.clone());
        match (standing.in_force, fresh) {
            (Some(kept), _) if because_of.is_none() => {
                let old = kept.belief();
                if old.is_same_as(&new) || old.judge(&new) != Judgement::Accept {
                    return false;
                }
                standing.enforce(now, &new);
            }
            (Some(_), Some(Fresh::Undecided)) => return false,
            (Some(kept), Some(Fresh::Confirm)) => {
                info!(%node, "fresh data confirm the pose: suspicion ends");
                standing.in_force = Some(Kept { log_odds: new.log_odds, ..kept });
            }
            _ => {
                standing.enforce(now, &new);
                info!(%node, pose = ?new.pose, epoch = standing.next_epoch - 1, "registered");
            }
        }
        standing.suspicion = None;
        // With the first pose from fresh data of the reference, `Ref` is sound again.
        if because_of.as_ref() == Some(&self.reference)
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

    /// The transform stays in force, but any determined pose may replace it.
    pub(super) fn doubt(&mut self, node: &NodeId) {
        let standing = self.standings.get_mut(node).filter(|_| *node != self.reference);
        if let Some(kept) = standing.and_then(|standing| standing.in_force.as_mut()) {
            kept.log_odds = f64::NEG_INFINITY;
        }
    }

    /// The solutions that stand for pinned poses.
    pub(super) fn pins(&self) -> Vec<Edge> {
        let pinned = self.standings.iter().filter(|(_, standing)| standing.is_pinned);
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
        standing.is_pinned = false;
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
        standing.is_pinned = true;
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

    /// What to tell of a node.
    pub(super) fn registration(
        &self,
        now: CentreTime,
        node: &NodeId,
        pairs: &Pairs,
    ) -> Option<Registration> {
        let standing = self.standings.get(node)?;
        let group = standing.detached.iter().take(1).chain([node]).cloned();
        let group: Vec<NodeId> = group.collect();
        let via = if standing.detached.is_empty() { &standing.via } else { &group };
        let newest = pairs.newest(node, via);
        let (outcome, evidence, sets, solver) = match newest {
            _ if *node == self.reference => (Outcome::Reference, Evidence::default(), None, ""),
            Some((one, sets)) => (one.outcome.clone(), one.evidence, Some(sets), one.solver),
            None => {
                standing.in_force?;
                let missing = "nothing was solved yet in this life of the centre".to_owned();
                (Outcome::Underdetermined { missing }, Evidence::default(), None, "")
            }
        };
        let outcome = match outcome {
            Outcome::Reference => Outcome::Reference,
            _ if !standing.detached.is_empty() => {
                Outcome::Detached { with: standing.detached.clone() }
            }
            other => other,
        };
        Some(Registration {
            node: node.clone(),
            reference: self.reference.clone(),
            published: now,
            transform: standing.in_force.map(|kept| kept.transform),
            outcome,
            evidence,
            sets,
            solver: solver.to_owned(),
            via: standing.via.clone(),
            suspicion: standing.suspicion.clone(),
            is_pinned: standing.is_pinned,
        })
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
