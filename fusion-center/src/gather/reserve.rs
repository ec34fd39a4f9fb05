//! Which periods older than the window stay: those whose points lie where few others do.
//!
//! Every period carries the cells of each node's frame in which its points lie. Where too many
//! periods are kept, the one goes whose cells the others cover best: the smallest
//! `Σ w / count(cell)` over its cells, `w` = 1 for a point that another node saw too, less for a
//! point of a node whose pose is not known yet. Cost: cells of all periods in reserve per period
//! that leaves the window.

use std::collections::{BTreeMap, BTreeSet};

use proto::ids::NodeId;

use super::NodeHistory;

/// Weight of a point of which nobody knows yet whether another node saw it too: it counts only
/// against periods that hold no common point.
const UNCERTAIN_WEIGHT: f64 = 0.01;

/// A cell of a node's frame in which a period has a point.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Place {
    /// Whose frame.
    pub node: NodeId,
    /// Column and row of the cell.
    pub cell: (i64, i64),
    /// Another node saw the same.
    pub is_common: bool,
}

/// The places of all periods, and how many periods may stay.
#[derive(Debug)]
pub(super) struct Reserve {
    capacity: usize,
    places: BTreeMap<i64, Vec<Place>>,
}

impl Reserve {
    pub(super) fn new(capacity: usize) -> Self {
        Self { capacity, places: BTreeMap::new() }
    }

    pub(super) fn note(&mut self, period: i64, mut places: Vec<Place>) {
        places.sort();
        places.dedup();
        self.places.insert(period, places);
    }

    pub(super) fn forget(&mut self, node: &NodeId) {
        self.forget_before(node, i64::MAX);
    }

    pub(super) fn forget_before(&mut self, node: &NodeId, first: i64) {
        for (_, places) in self.places.range_mut(..first) {
            places.retain(|place| place.node != *node);
        }
    }

    /// Drops periods until no more than the capacity are in reserve.
    pub(super) fn thin(&mut self, nodes: &mut BTreeMap<NodeId, NodeHistory>) {
        let of_node = |history: &NodeHistory| history.reserve().keys().copied().collect::<Vec<_>>();
        let mut kept: BTreeSet<i64> = nodes.values().flat_map(of_node).collect();
        if kept.len() <= self.capacity {
            return;
        }
        let oldest = nodes.values().filter_map(|one| one.sets().keys().next()).min().copied();
        self.places.retain(|period, _| kept.contains(period) || oldest <= Some(*period));
        while self.capacity < kept.len() {
            let Some(least) = self.least_worth(&kept) else { break };
            kept.remove(&least);
        }
        nodes.values_mut().for_each(|history| history.keep_reserve(&kept));
    }

    /// The period that adds least, the oldest of equals.
    fn least_worth(&self, kept: &BTreeSet<i64>) -> Option<i64> {
        let places = |period: &i64| self.places.get(period).into_iter().flatten();
        let mut counts: BTreeMap<(&NodeId, (i64, i64)), f64> = BTreeMap::new();
        for place in kept.iter().flat_map(places) {
            *counts.entry((&place.node, place.cell)).or_default() += weight(place);
        }
        let worth = |period: &i64| -> f64 {
            let share = |place: &Place| {
                let covered = counts.get(&(&place.node, place.cell)).copied().unwrap_or(1.0);
                weight(place).powi(2) / covered
            };
            places(period).map(share).sum()
        };
        let ranked = kept.iter().map(|period| (worth(period), *period));
        ranked.min_by(|one, other| one.0.total_cmp(&other.0)).map(|(_, period)| period)
    }
}

fn weight(place: &Place) -> f64 {
    if place.is_common { 1.0 } else { UNCERTAIN_WEIGHT }
}
