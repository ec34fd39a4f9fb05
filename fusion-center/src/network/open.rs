//! Edges that their pair alone leaves open: loops through other nodes decide them, or they are left
//! out.
//!
//! An ambiguous edge brings a vote for each of its poses. Where another way round agrees with one
//! of them, that one is it: that a wrong pose agrees by chance has odds of at most
//! `k V_g / V`, `V = (2 W)² 2π` the volume in which a pose may lie, `V_g = (4π/3) g^(3/2) √det S` that
//! of the gate `g`, `S` the covariance of the agreement, `k` the poses of the edge. A loop whose
//! agreement means less than [`AGREEMENT_LOG_ODDS`] decides nothing.
//!
//! The pair alone did not determine anything, so it must not take anything away either: an ambiguous
//! edge with none of its poses right would tie with a node's only good one. Groups that determined
//! edges join stay together, whatever ambiguous ones say.

use std::f64::consts::{PI, TAU};

use proto::ids::NodeId;

use super::combine::combine_as_given;
use super::relative::Relative;
use super::{Combined, Edge, Group, Verdict};
use crate::registration::Outcome;
use crate::statistics::POSE_GATE;

/// Least odds against agreement by chance at which a loop decides an ambiguous edge, and so the odds
/// that a pose found through one rests on at least: ln 1000, as a single pair needs against another
/// pose.
pub const AGREEMENT_LOG_ODDS: f64 = 6.9;

/// Half the side of the square, metres, in which a pose agrees by chance: that of single pairs.
const HALF_WIDTH_M: f64 = 20.0;

/// Covariance of the agreement of an edge with all others, in units of its own: a loop of two edges
/// more, each as unsure.
const LOOP_FACTOR: f64 = 3.0;

/// The groups that the edges join, each node in exactly one, and what became of every edge.
/// `nodes` that no edge reaches are groups of their own; edges to other nodes are unusable.
/// Ambiguous edges join what no determined edge does where loops decide them, and divide nothing.
#[must_use]
pub fn combine_judged(reference: &NodeId, nodes: &[NodeId], edges: &[Edge]) -> Combined {
    let site = Site { reference, nodes, edges };
    let all = combine_as_given(reference, nodes, edges);
    if !edges.iter().any(is_open) {
        return all;
    }
    let firm = site.combined(|index| !is_open(&edges[index]));
    let is_decided = |index: usize| {
        let is_kept = matches!(all.verdicts[index], Verdict::Kept { .. });
        !is_open(&edges[index]) || is_kept && is_telling(&edges[index])
    };
    let are_kept_telling = (0..edges.len())
        .all(|index| is_decided(index) || !matches!(all.verdicts[index], Verdict::Kept { .. }));
    if are_kept_telling && keeps_together(&firm.groups, &all.groups) {
        return all;
    }
    let decided = site.combined(is_decided);
    let mut chosen = if keeps_together(&firm.groups, &decided.groups) { decided } else { firm };
    show_doubtful(&mut chosen.groups, &all.groups);
    chosen
}

struct Site<'a> {
    reference: &'a NodeId,
    nodes: &'a [NodeId],
    edges: &'a [Edge],
}

impl Site<'_> {
    /// The combination of some of the edges; the others stay undecided.
    fn combined(&self, is_used: impl Fn(usize) -> bool) -> Combined {
        let used: Vec<usize> = (0..self.edges.len()).filter(|index| is_used(*index)).collect();
        let edges: Vec<Edge> = used.iter().map(|index| self.edges[*index].clone()).collect();
        let mut combined = combine_as_given(self.reference, self.nodes, &edges);
        let mut verdicts = vec![Verdict::Undecided; self.edges.len()];
        for (index, verdict) in used.into_iter().zip(combined.verdicts) {
            verdicts[index] = verdict;
        }
        combined.verdicts = verdicts;
        combined
    }
}

fn is_open(edge: &Edge) -> bool {
    matches!(edge.solution.outcome, Outcome::Ambiguous { .. })
}

/// Whether that a loop agrees with one of the edge's poses is no chance.
fn is_telling(edge: &Edge) -> bool {
    let Outcome::Ambiguous { rivals } = &edge.solution.outcome else { return true };
    let Some(step) = edge.solution.estimate.as_ref().and_then(Relative::usable) else {
        return false;
    };
    let spread = (step.covariance * LOOP_FACTOR).determinant().max(0.0).sqrt();
    let gate = 4.0 / 3.0 * PI * POSE_GATE.powf(1.5) * spread;
    let volume = (2.0 * HALF_WIDTH_M).powi(2) * TAU;
    let pose_count = (1 + rivals.len()) as f64;
    (volume / (pose_count * gate)).ln() >= AGREEMENT_LOG_ODDS
}

/// Whether all nodes of each group are in one group afterwards, too.
fn keeps_together(before: &[Group], after: &[Group]) -> bool {
    let is_within = |group: &Group, other: &Group| {
        group.nodes.keys().all(|node| other.nodes.contains_key(node))
    };
    before.iter().all(|group| after.iter().any(|other| is_within(group, other)))
}

/// Shows where nodes may lie that ambiguous edges join to a group without placing them.
fn show_doubtful(groups: &mut [Group], of_all: &[Group]) {
    for group in groups {
        let same = of_all.iter().find(|other| other.gauge == group.gauge);
        for (node, placed) in same.iter().flat_map(|other| &other.doubtful) {
            if !group.nodes.contains_key(node) {
                group.doubtful.entry(node.clone()).or_insert_with(|| placed.clone());
            }
        }
    }
}

#[cfg(test)]
mod scene_tests;
#[cfg(test)]
mod tests;
