//! Deciding what is ripe: where all hypotheses agree, or the lag has passed.

use crate::tracking::ReportId;

use super::decide::show_best;
use super::hypotheses::Hypotheses;
use super::target::Target;

/// Decides the open moments of a cluster's targets that all hypotheses agree on, or that more than
/// `lag_scans` later times were waited for: then the most probable choice stands, and hypotheses that
/// say otherwise are dropped. Branches that no hypothesis names are forgotten.
pub(super) fn settle(targets: &mut [Target], joint: &mut Hypotheses, lag_scans: usize) {
    for place in 0..joint.members.len() {
        let index = joint.members[place] as usize;
        while let Some(best) = ripe(&targets[index], joint, place, lag_scans) {
            joint.retain(|leaves| targets[index].first_open(leaves[place]) == best.0);
            forget_unnamed(targets, joint);
            targets[index].commit_first(best.1);
        }
    }
    forget_unnamed(targets, joint);
    show_best(targets, joint);
}

/// What a target's oldest open moment is decided to be, and how probable that is; none if it waits.
fn ripe(
    target: &Target,
    joint: &Hypotheses,
    place: usize,
    lag_scans: usize,
) -> Option<(Option<ReportId>, f64)> {
    if target.leaves[0].open.is_empty() {
        return None;
    }
    let shares = joint.shares_by(place, |leaf| target.first_open(leaf));
    if 1 < shares.len() && target.open_scans() < lag_scans {
        return None;
    }
    // The first of equals, whatever the order of hypotheses after it.
    shares.into_iter().reduce(|best, other| if best.1 < other.1 { other } else { best })
}

/// Forgets branches that no hypothesis names.
fn forget_unnamed(targets: &mut [Target], joint: &mut Hypotheses) {
    let width = joint.members.len();
    for place in 0..width {
        let target = &mut targets[joint.members[place] as usize];
        let mut names = vec![u16::MAX; target.leaves.len()];
        joint.leaves.iter().skip(place).step_by(width).for_each(|leaf| {
            names[usize::from(*leaf)] = 0;
        });
        let mut count = 0;
        for name in names.iter_mut().filter(|name| **name == 0) {
            *name = count;
            count += 1;
        }
        if usize::from(count) == target.leaves.len() {
            continue;
        }
        let mut at = 0;
        target.leaves.retain(|_| {
            at += 1;
            names[at - 1] != u16::MAX
        });
        for leaf in joint.leaves.iter_mut().skip(place).step_by(width) {
            *leaf = names[usize::from(*leaf)];
        }
    }
}

/// Clusters that are left after a decision: targets with one branch leave, and those that contest no
/// report with each other go separate ways.
pub(super) fn split(targets: &[Target], joint: &Hypotheses) -> Vec<Hypotheses> {
    let open: Vec<usize> = (0..joint.members.len())
        .filter(|place| 1 < targets[joint.members[*place] as usize].leaves.len())
        .collect();
    let mut parts: Vec<Vec<usize>> = Vec::new();
    for place in open {
        let (mut with, apart): (Vec<_>, Vec<_>) = parts.into_iter().partition(|part| {
            part.iter().any(|other| share_report(targets, joint, [*other, place]))
        });
        with.push(vec![place]);
        let mut merged: Vec<usize> = with.into_iter().flatten().collect();
        merged.sort_unstable();
        parts = apart;
        parts.push(merged);
    }
    parts.into_iter().map(|part| joint.about(&part)).collect()
}

/// Whether branches of both members at `places` took the same report.
fn share_report(targets: &[Target], joint: &Hypotheses, places: [usize; 2]) -> bool {
    let reports = |place: usize| {
        let leaves = &targets[joint.members[place] as usize].leaves;
        leaves.iter().flat_map(|leaf| leaf.open.iter().filter_map(|moment| moment.report))
    };
    reports(places[0]).any(|report| reports(places[1]).any(|other| other == report))
}
