//! How rightly tracks were put together: links, identities, switches and purity, with their
//! denominators, from what trackers settled and from which target each report is of.
//!
//! An *update* is a step of a track that took a report, a *link* a pair of consecutive updates of
//! one track, however many steps without report lie between them. A report may be of no target
//! (clutter): an update with it is never right. Which tracks count is the caller's choice: see
//! [`of_confirmed`].

use std::collections::{BTreeMap, BTreeSet};

use super::{ReportId, Settled, Status};

#[cfg(test)]
mod tests;

/// Counts of one run; counts of several runs add up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Links {
    /// Tracks with at least one update.
    pub track_count: usize,
    /// Updates.
    pub update_count: usize,
    /// Updates with a report of no target.
    pub clutter_count: usize,
    /// Pairs of consecutive updates of one track.
    pub link_count: usize,
    /// Those whose both reports are of the same target.
    pub right_link_count: usize,
    /// Updates with a report of the target to which the track belonged at its origin.
    pub identity_count: usize,
    /// Updates with a report of the target that the track has most of.
    pub pure_count: usize,
    /// Targets with at least one update.
    pub target_count: usize,
    /// Times that a target passed from one track to another: for each target, neighbours in the
    /// sequence of its updates that are of different tracks.
    pub switch_count: usize,
}

/// When a track's origin is decided.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// By its first update.
    First,
    /// By the majority of so many first updates; the earlier one of equals.
    MajorityOf(usize),
}

/// The steps of those tracks that were confirmed at some time, in the same order.
#[must_use]
pub fn of_confirmed(steps: &[Settled]) -> Vec<Settled> {
    let is_confirmed = |step: &&Settled| step.status != Status::Tentative;
    let confirmed: BTreeSet<u64> = steps.iter().filter(is_confirmed).map(|s| s.track).collect();
    steps.iter().filter(|step| confirmed.contains(&step.track)).cloned().collect()
}

/// Counts what was put together rightly.
///
/// `steps` hold each track's in order of time, tracks mixed in any way; `target_of` says which
/// target a report is of, `None` for clutter.
pub fn links<Target: Copy + Ord>(
    steps: &[Settled],
    origin: Origin,
    target_of: impl Fn(ReportId) -> Option<Target>,
) -> Links {
    let mut tracks: BTreeMap<u64, Vec<Option<Target>>> = BTreeMap::new();
    let mut targets: BTreeMap<Target, Vec<(f64, ReportId, u64)>> = BTreeMap::new();
    for (step, report) in steps.iter().filter_map(|step| Some((step, step.report?))) {
        let target = target_of(report);
        tracks.entry(step.track).or_default().push(target);
        if let Some(target) = target {
            targets.entry(target).or_default().push((step.time_s, report, step.track));
        }
    }
    let mut counts: Links = tracks.values().map(|updates| of_track(updates, origin)).sum();
    counts.target_count = targets.len();
    counts.switch_count = targets.into_values().map(switches).sum();
    counts
}

/// What one track's updates add.
fn of_track<Target: Copy + Ord>(updates: &[Option<Target>], origin: Origin) -> Links {
    let first_count = match origin {
        Origin::First => 1,
        Origin::MajorityOf(count) => count.max(1),
    };
    let first = majority(&updates[..first_count.min(updates.len())]).map(|(target, _)| target);
    let is_original = |update: &&Option<Target>| update.is_some() && **update == first;
    Links {
        track_count: 1,
        update_count: updates.len(),
        clutter_count: updates.iter().filter(|update| update.is_none()).count(),
        link_count: updates.len().saturating_sub(1),
        right_link_count: updates.windows(2).filter(|w| w[0].is_some() && w[0] == w[1]).count(),
        identity_count: updates.iter().filter(is_original).count(),
        pure_count: majority(updates).map_or(0, |(_, count)| count),
        target_count: 0,
        switch_count: 0,
    }
}

/// The target that most of the updates are of, and how many; the earlier one of equals.
fn majority<Target: Copy + Ord>(updates: &[Option<Target>]) -> Option<(Target, usize)> {
    let mut counts: BTreeMap<Target, usize> = BTreeMap::new();
    for target in updates.iter().flatten() {
        *counts.entry(*target).or_default() += 1;
    }
    let most = *counts.values().max()?;
    let target = updates.iter().flatten().find(|target| counts.get(target) == Some(&most))?;
    Some((*target, most))
}

/// Times that a target passed from one track to another. While several tracks share its reports, it
/// stays with the one that had it.
fn switches(mut updates: Vec<(f64, ReportId, u64)>) -> usize {
    updates.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
    let mut holder = None;
    let mut count = 0;
    for same in updates.chunk_by(|a, b| a.1 == b.1) {
        if holder.is_some_and(|track| same.iter().any(|update| update.2 == track)) {
            continue;
        }
        count += usize::from(holder.is_some());
        holder = same.first().map(|update| update.2);
    }
    count
}

impl Links {
    /// Share of links that are right; `None` without links.
    #[must_use]
    pub fn right_link_rate(&self) -> Option<f64> {
        share(self.right_link_count, self.link_count)
    }

    /// Share of updates on the target to which the track belonged at its origin; `None` without
    /// updates.
    #[must_use]
    pub fn identity_rate(&self) -> Option<f64> {
        share(self.identity_count, self.update_count)
    }

    /// Share of updates on the target that the track has most of; `None` without updates.
    #[must_use]
    pub fn purity(&self) -> Option<f64> {
        share(self.pure_count, self.update_count)
    }
}

fn share(part: usize, whole: usize) -> Option<f64> {
    (0 < whole).then(|| part as f64 / whole as f64)
}

impl std::ops::AddAssign for Links {
    fn add_assign(&mut self, other: Self) {
        self.track_count += other.track_count;
        self.update_count += other.update_count;
        self.clutter_count += other.clutter_count;
        self.link_count += other.link_count;
        self.right_link_count += other.right_link_count;
        self.identity_count += other.identity_count;
        self.pure_count += other.pure_count;
        self.target_count += other.target_count;
        self.switch_count += other.switch_count;
    }
}

impl std::iter::Sum for Links {
    fn sum<I: Iterator<Item = Self>>(parts: I) -> Self {
        parts.fold(Self::default(), |mut sum, part| {
            sum += part;
            sum
        })
    }
}
