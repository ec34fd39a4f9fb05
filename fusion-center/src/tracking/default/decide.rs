//! Which target takes which plot: at once where that is clear, later where it is not.
//!
//! Where the best assignment is better than any other by [`DefaultConfig::ambiguous_nats`], it
//! stands. Targets for which it is not form groups by the plots that they contest; a group's joint
//! hypotheses are followed until all agree or the lag has passed.

use crate::tracking::{Look, ReportId, Status};

use super::DefaultTracker;
use super::branch::{Branch, Origin};
use super::config::DefaultConfig;
use super::expand::{Choice, Limits, Search, Way, Ways};
use super::hypotheses::Hypotheses;
use super::row::Row;
use super::settle::{settle, split};
use super::target::Target;
use super::work::{NONE, Work, short};

/// A branch goes without a plot.
const MISS: u32 = NONE;
/// A branch was not looked at.
const STAY: u32 = NONE - 1;
/// A plot that is taken with so much probability starts no new track.
const TAKEN_SHARE: f64 = 0.1;
/// Partial ways looked at for a group: what a cluster of ten with three options each needs at most.
const MAX_VISITS: usize = 60_000;

/// Applies the choice with `tag` to a branch: what it took, and where its state comes from.
fn apply(
    branch: &mut Branch,
    (row, tag): (&Row, u32),
    work: &Work,
    look: &Look<'_>,
    config: &DefaultConfig,
) -> (Option<ReportId>, Origin) {
    match work.edges.get(tag as usize) {
        Some(edge) => {
            let origin = branch.take(row, edge, look, config);
            (Some(branch.last_report), origin)
        }
        None => (None, branch.miss(row, look, config)),
    }
}

impl DefaultTracker {
    /// Decides what a look's plots are, and takes them in.
    pub(super) fn decide(&mut self, look: &Look<'_>) {
        let margin = self.config.ambiguous_nats;
        self.work.contest(0..self.work.touched.len(), margin);
        self.join_clusters();
        let groups = self.take_clear(look, 0..self.work.touched.len());
        let mut large = Vec::new();
        for group in groups.chunk_by(|a, b| a.0 == b.0) {
            if self.config.max_cluster_count < group.len() {
                large.extend(group.iter().map(|(_, target)| *target));
            } else {
                self.take_group(group, look);
            }
        }
        if !large.is_empty() {
            self.take_large(large, look);
        }
        self.renumber_clusters();
    }

    /// Members of a cluster are of one group.
    fn join_clusters(&mut self) {
        for cluster in &self.clusters {
            for pair in cluster.members.windows(2) {
                self.work.join(pair[0], pair[1]);
            }
        }
    }

    /// Takes in what is clear; the rest as `(group, target)`, ascending.
    fn take_clear(&mut self, look: &Look<'_>, places: std::ops::Range<usize>) -> Vec<(u32, u32)> {
        let mut in_groups: Vec<(u32, u32)> = Vec::new();
        self.sizes.clear();
        self.sizes.resize(self.targets.len(), 0);
        for place in places.clone() {
            let group = self.work.group_of(self.work.touched[place].target);
            self.sizes[group as usize] += 1;
        }
        for place in places {
            let touched = self.work.touched[place];
            let group = self.work.group_of(touched.target);
            let is_alone = self.sizes[group as usize] == 1;
            let target = &self.targets[touched.target as usize];
            // One that is not believed yet is not worth a wait.
            let is_clear = !touched.unclear || target.leaf().status == Status::Tentative;
            if is_alone && is_clear && target.cluster.is_none() {
                self.take_own(place, look);
            } else {
                in_groups.push((group, touched.target));
            }
        }
        in_groups.sort_unstable();
        in_groups
    }

    /// A target with one branch takes its plot of the best assignment.
    fn take_own(&mut self, place: usize, look: &Look<'_>) {
        let touched = self.work.touched[place];
        let row = &self.work.rows[touched.first_row as usize];
        let edges = self.work.edges_of(row);
        let at = edges.iter().position(|edge| edge.plot == touched.own);
        let tag = at.map_or(MISS, |at| row.first_edge + short(at));
        let target = &mut self.targets[touched.target as usize];
        let leaf = &mut target.leaves[0];
        let (report, origin) = apply(leaf, (row, tag), &self.work, look, &self.config);
        target.trunk.push_back(leaf.moment(report, origin));
        if touched.own != NONE {
            self.work.used[touched.own as usize] = true;
        }
    }

    /// Follows the hypotheses of a group, given as `(group, target)`.
    fn take_group(&mut self, group: &[(u32, u32)], look: &Look<'_>) {
        let is_single = |target: u32| self.targets[target as usize].cluster.is_none();
        let is_new = group.iter().all(|(_, target)| is_single(*target));
        let (joint, margin) = if is_new {
            let members = group.iter().map(|(_, target)| *target).collect();
            (Hypotheses::of_singles(members), self.config.ambiguous_nats)
        } else {
            (self.joined(group), self.config.keep_nats)
        };
        let search = self.ways_on(&joint, margin);
        match search.found.ways.as_slice() {
            [only] if is_new => self.take_only(&joint, search.found.tags_of(only), look),
            _ => self.take_ways(&joint, &search.found, look),
        }
        self.search = search;
    }

    /// Joint hypotheses of a group.
    fn joined(&mut self, group: &[(u32, u32)]) -> Hypotheses {
        let mut joint = Hypotheses::of_singles(Vec::new());
        for (_, target) in group {
            let part = match self.targets[*target as usize].cluster {
                None => Hypotheses::of_singles(vec![*target]),
                Some(index) => std::mem::take(&mut self.clusters[index as usize]),
            };
            // A cluster is taken with the first of its members.
            if joint.members.is_empty() {
                joint = part;
            } else if !part.members.is_empty() {
                joint = joint.product(&part, self.config.max_hypothesis_count);
            }
        }
        for target in &joint.members {
            self.targets[*target as usize].cluster = None;
        }
        joint
    }

    /// A group of targets with one branch each takes the only way on.
    fn take_only(&mut self, joint: &Hypotheses, tags: &[u32], look: &Look<'_>) {
        for (member, tag) in joint.members.iter().zip(tags) {
            let place = self.work.place_of[*member as usize];
            let Some(touched) = self.work.touched.get(place as usize) else { continue };
            let row = &self.work.rows[touched.first_row as usize];
            let target = &mut self.targets[*member as usize];
            let leaf = &mut target.leaves[0];
            let (report, origin) = apply(leaf, (row, *tag), &self.work, look, &self.config);
            target.trunk.push_back(leaf.moment(report, origin));
            if let Some(edge) = self.work.edges.get(*tag as usize) {
                self.work.used[edge.plot as usize] = true;
            }
        }
    }

    /// How the hypotheses of a group may go on.
    fn ways_on(&mut self, joint: &Hypotheses, margin: f64) -> Search {
        let mut search = std::mem::take(&mut self.search);
        search.options.clear();
        for target in &joint.members {
            search.options.begin_member();
            for leaf in 0..self.targets[*target as usize].leaves.len() {
                self.add_options((*target, leaf), |choice| search.options.push(choice));
                search.options.end_branch();
            }
        }
        let count = self.config.max_hypothesis_count;
        search.run(joint, &Limits { count, margin, visits: MAX_VISITS });
        search
    }

    /// What a branch of a target may do, in no particular order.
    fn add_options(&self, (target, leaf): (u32, usize), mut add: impl FnMut(Choice)) {
        let place = self.work.place_of[target as usize];
        let Some(touched) = self.work.touched.get(place as usize) else {
            add(Choice { cost: 0.0, plot: None, tag: STAY });
            return;
        };
        let row = &self.work.rows_of(touched)[leaf];
        add(Choice { cost: row.miss_cost, plot: None, tag: MISS });
        for (edge, tag) in self.work.edges_of(row).iter().zip(row.first_edge..) {
            if !self.work.used[edge.plot as usize] {
                add(Choice { cost: edge.cost, plot: Some(edge.plot), tag });
            }
        }
    }

    /// Makes the branches of the ways that are kept, and decides what is ripe.
    fn take_ways(&mut self, joint: &Hypotheses, found: &Ways, look: &Look<'_>) {
        let (width, ways) = (joint.members.len(), &found.ways);
        let mut next = Hypotheses {
            members: joint.members.clone(),
            costs: ways.iter().map(|way| way.cost).collect(),
            leaves: vec![0; width * ways.len()],
        };
        let mut made = std::mem::take(&mut self.made);
        for member in 0..width {
            let key =
                |way: &Way| (joint.leaves_of(way.hypothesis)[member], found.tags_of(way)[member]);
            made.clear();
            for (index, way) in ways.iter().enumerate() {
                next.leaves[index * width + member] = place_in(&mut made, key(way));
            }
            self.branch(joint.members[member], &made, look);
        }
        self.made = made;
        self.mark_used(found, &next.shares());
        settle(&mut self.targets, &mut next, self.config.lag_scans);
        split(&self.targets, next, &mut self.clusters);
    }

    /// Gives a target the branches that come of `(branch, choice)`.
    fn branch(&mut self, index: u32, made: &[(u16, u32)], look: &Look<'_>) {
        let place = self.work.place_of[index as usize];
        let touched = self.work.touched.get(place as usize).copied();
        let target = &mut self.targets[index as usize];
        let mut leaves: Vec<Branch> = Vec::with_capacity(made.len());
        leaves.extend(made.iter().map(|(from, _)| target.leaves[usize::from(*from)]));
        std::mem::swap(&mut target.leaves, &mut leaves);
        // All stay or none.
        let Some(touched) = touched.filter(|_| made.iter().all(|(_, tag)| *tag != STAY)) else {
            return;
        };
        target.open.begin(made.len());
        for (leaf, (from, tag)) in target.leaves.iter_mut().zip(made) {
            let row = &self.work.rows[touched.first_row as usize + usize::from(*from)];
            let (report, origin) = apply(leaf, (row, *tag), &self.work, look, &self.config);
            let moment = leaf.moment(report, origin);
            (leaf.tip, leaf.root) = target.open.push(moment, (leaf.tip, leaf.root));
        }
    }

    /// Marks the plots that are probably taken.
    fn mark_used(&mut self, found: &Ways, shares: &[f64]) {
        let mut sums: Vec<(u32, f64)> = Vec::new();
        for (way, share) in found.ways.iter().zip(shares) {
            let edges =
                found.tags_of(way).iter().filter_map(|tag| self.work.edges.get(*tag as usize));
            sums.extend(edges.map(|edge| (edge.plot, *share)));
        }
        sums.sort_by_key(|(plot, _)| *plot);
        for same in sums.chunk_by(|a, b| a.0 == b.0) {
            let share: f64 = same.iter().map(|(_, share)| share).sum();
            self.work.used[same[0].0 as usize] |= TAKEN_SHARE <= share;
        }
    }

    /// Groups that are too large to wait: their best branches stand, and what is still contested then
    /// is followed in smaller groups or decided at once.
    fn take_large(&mut self, mut members: Vec<u32>, look: &Look<'_>) {
        members.sort_unstable();
        let from = self.work.touched.len();
        for index in &members {
            let target = &mut self.targets[*index as usize];
            let best = u32::from(target.best);
            if let Some(cluster) = target.cluster {
                self.clusters[cluster as usize] = Hypotheses::default();
            }
            target.collapse();
            let place = self.work.place_of[*index as usize];
            if let Some(mut touched) = self.work.touched.get(place as usize).copied() {
                touched.first_row += best;
                touched.end_row = touched.first_row + 1;
                self.work.place_of[*index as usize] = short(self.work.touched.len());
                self.work.touched.push(touched);
            }
        }
        let places = from..self.work.touched.len();
        self.work.contest(places.clone(), self.config.ambiguous_nats);
        let groups = self.take_clear(look, places);
        for group in groups.chunk_by(|a, b| a.0 == b.0) {
            if group.len() <= self.config.max_cluster_count {
                self.take_group(group, look);
                continue;
            }
            for (_, target) in group {
                self.take_own(self.work.place_of[*target as usize] as usize, look);
            }
        }
    }

    /// Forgets clusters without members and tells targets where theirs is.
    pub(super) fn renumber_clusters(&mut self) {
        self.clusters.retain(|cluster| !cluster.members.is_empty());
        for (index, cluster) in self.clusters.iter().enumerate() {
            for member in &cluster.members {
                self.targets[*member as usize].cluster = Some(short(index));
            }
        }
    }
}

/// Where `key` is in `made`; it is put there if it is not yet.
fn place_in(made: &mut Vec<(u16, u32)>, key: (u16, u32)) -> u16 {
    let known = made.iter().position(|other| *other == key);
    let at = known.unwrap_or(made.len());
    if known.is_none() {
        made.push(key);
    }
    // Far fewer: at most one for each hypothesis.
    u16::try_from(at).unwrap_or(u16::MAX)
}

/// Sets what is shown of the targets of a cluster: the branch of the best hypothesis.
pub(super) fn show_best(targets: &mut [Target], joint: &Hypotheses) {
    let (best, shares) = (joint.leaves_of(joint.best()), joint.shares());
    let width = joint.members.len();
    for (place, (member, leaf)) in joint.members.iter().zip(best).enumerate() {
        let target = &mut targets[*member as usize];
        target.best = *leaf;
        target.leaves.iter_mut().for_each(|branch| branch.last_share = 0.0);
        for (named, share) in joint.leaves.iter().skip(place).step_by(width).zip(&shares) {
            target.leaves[usize::from(*named)].last_share += share;
        }
        share_among_alike(&mut target.leaves);
    }
}

/// Branches with the same newest report have the sum of their shares.
fn share_among_alike(branches: &mut [Branch]) {
    let sum = |one: &Branch| {
        let alike = branches.iter().filter(|other| other.last_report == one.last_report);
        alike.map(|other| other.last_share).sum()
    };
    let sums: Vec<f64> = branches.iter().map(sum).collect();
    for (branch, share) in branches.iter_mut().zip(sums) {
        branch.last_share = share;
    }
}
