//! Deciding what is ripe: where all hypotheses agree, or the lag has passed.

use super::decide::show_best;
use super::hypotheses::Hypotheses;
use super::target::Target;

/// Decides the open moments of a cluster's targets that all hypotheses agree on, or that more than
/// `lag_scans` later times were waited for: then the most probable choice stands, and hypotheses that
/// say otherwise are dropped. Branches that no hypothesis names are forgotten.
pub(super) fn settle(targets: &mut [Target], joint: &mut Hypotheses, lag_scans: usize) {
    for place in 0..joint.members.len() {
        let index = joint.members[place] as usize;
        while let Some((root, share)) = ripe(&targets[index], joint, place, lag_scans) {
            let leaves = &targets[index].leaves;
            if joint.retain(|of| leaves[usize::from(of[place])].root == root) {
                forget_unnamed(targets, joint);
            }
            targets[index].commit_first(root, share);
        }
    }
    forget_unnamed(targets, joint);
    show_best(targets, joint);
}

/// What a target's oldest open moment is decided to be, by its place, and how probable that is; none
/// if it waits.
fn ripe(target: &Target, joint: &Hypotheses, place: usize, lag_scans: usize) -> Option<(u16, f64)> {
    if target.open.is_empty() {
        return None;
    }
    let root = |leaf: u16| target.leaves[usize::from(leaf)].root;
    if target.open.scan_count() < lag_scans {
        let only = root(joint.leaves[place]);
        let others = joint.leaves.iter().skip(place).step_by(joint.members.len());
        return others.into_iter().all(|leaf| root(*leaf) == only).then_some((only, 1.0));
    }
    // The first of equals, whatever the order of hypotheses after it.
    let shares = joint.shares_by(place, root);
    shares.into_iter().reduce(|best, other| if best.1 < other.1 { other } else { best })
}

/// Forgets branches that no hypothesis names.
fn forget_unnamed(targets: &mut [Target], joint: &mut Hypotheses) {
    let width = joint.members.len();
    let mut names: Vec<u16> = Vec::new();
    for place in 0..width {
        let target = &mut targets[joint.members[place] as usize];
        names.clear();
        names.resize(target.leaves.len(), u16::MAX);
        for leaf in joint.leaves.iter().skip(place).step_by(width) {
            names[usize::from(*leaf)] = 0;
        }
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
        target.open.keep(target.leaves.iter().map(|leaf| leaf.tip));
        for leaf in joint.leaves.iter_mut().skip(place).step_by(width) {
            *leaf = names[usize::from(*leaf)];
        }
    }
}

/// Puts the clusters that are left after a decision at the end of `into`: targets with one branch
/// leave, and those that contest no report with each other go separate ways.
pub(super) fn split(targets: &[Target], mut joint: Hypotheses, into: &mut Vec<Hypotheses>) {
    let target_at = |place: usize| &targets[joint.members[place] as usize];
    let is_open = |place: &usize| 1 < target_at(*place).leaves.len();
    let open: Vec<usize> = (0..joint.members.len()).filter(is_open).collect();
    if open.len() == 1 && joint.members.len() == 1 {
        joint.relate();
        into.push(joint);
        return;
    }
    let mut taken: Vec<_> = Vec::new();
    for place in &open {
        taken.extend(target_at(*place).open.reports().map(|report| (report, *place)));
    }
    taken.sort_unstable();
    // A member of the same part for each place; the smallest stands for all.
    let mut part_of: Vec<usize> = (0..joint.members.len()).collect();
    for same in taken.chunk_by(|a, b| a.0 == b.0) {
        for (_, place) in &same[1..] {
            merge(&mut part_of, same[0].1, *place);
        }
    }
    let mut parts: Vec<(usize, usize)> =
        open.iter().map(|place| (part_of[*place], *place)).collect();
    parts.sort_unstable();
    into.extend(
        parts
            .chunk_by(|a, b| a.0 == b.0)
            .map(|part| joint.about(&part.iter().map(|(_, place)| *place).collect::<Vec<_>>())),
    );
}

/// Joins the parts of two places.
fn merge(part_of: &mut [usize], one: usize, other: usize) {
    let (a, b) = (part_of[one], part_of[other]);
    let (low, high) = (a.min(b), a.max(b));
    part_of.iter_mut().filter(|part| **part == high).for_each(|part| *part = low);
}
