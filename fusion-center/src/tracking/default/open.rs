//! What has not been decided of a target: a tree of moments, one level for each look.
//!
//! Branches that come of the same one share what lies before: a branch only names its newest moment,
//! its tip, in the newest level, and the one in the oldest level that it comes of, its root.

use std::collections::VecDeque;

use crate::tracking::ReportId;

use super::branch::Moment;

/// A moment, and where in the level before the one that it follows is.
#[derive(Clone, Debug)]
struct Node {
    moment: Moment,
    before: u16,
    /// A branch still comes of it.
    is_alive: bool,
}

/// Open moments, the oldest level first.
#[derive(Clone, Debug, Default)]
pub(super) struct Open {
    levels: VecDeque<Vec<Node>>,
}

impl Open {
    /// How many looks are open.
    pub(super) fn look_count(&self) -> usize {
        self.levels.len()
    }

    /// Whether nothing is open.
    pub(super) fn is_empty(&self) -> bool {
        self.levels.is_empty()
    }

    /// Begins the level of a look, of so many moments.
    pub(super) fn begin(&mut self, moment_count: usize) {
        self.levels.push_back(Vec::with_capacity(moment_count));
    }

    /// Adds a moment after the one of the tip `before`; `(tip, root)` of the branch that ends there,
    /// whose root was `root`.
    pub(super) fn push(&mut self, moment: Moment, (before, root): (u16, u16)) -> (u16, u16) {
        let is_oldest = self.levels.len() == 1;
        let Some(level) = self.levels.back_mut() else { return (0, 0) };
        // Far fewer: at most one for each hypothesis.
        let tip = u16::try_from(level.len()).unwrap_or(u16::MAX);
        level.push(Node { moment, before, is_alive: true });
        (tip, if is_oldest { tip } else { root })
    }

    /// How many times later than that of the oldest level there are.
    pub(super) fn scan_count(&self) -> usize {
        let times = self.levels.iter().filter_map(|level| level.first());
        let later = times.clone().skip(1);
        times.zip(later).filter(|(a, b)| a.moment.time_s < b.moment.time_s).count()
    }

    /// Every moment of the branch with `tip`, the newest first.
    pub(super) fn back_from(&self, tip: u16) -> impl Iterator<Item = &Moment> {
        self.levels.iter().rev().scan(tip, |at, level| {
            let node = level.get(usize::from(*at))?;
            *at = node.before;
            Some(&node.moment)
        })
    }

    /// Where the branch with `tip` is in the oldest level.
    pub(super) fn root_of(&self, tip: u16) -> u16 {
        let later = self.levels.iter().skip(1).rev();
        later.fold(tip, |at, level| level.get(usize::from(at)).map_or(0, |node| node.before))
    }

    /// Takes the moment at `root` out, and the oldest level with it.
    pub(super) fn take_first(&mut self, root: u16) -> Option<Moment> {
        Some(self.levels.pop_front()?.get(usize::from(root))?.moment)
    }

    /// Forgets all.
    pub(super) fn clear(&mut self) {
        self.levels.clear();
    }

    /// Only branches with these tips are left.
    pub(super) fn keep(&mut self, tips: impl Iterator<Item = u16>) {
        for level in &mut self.levels {
            level.iter_mut().for_each(|node| node.is_alive = false);
        }
        let Some(newest) = self.levels.back_mut() else { return };
        for tip in tips {
            if let Some(node) = newest.get_mut(usize::from(tip)) {
                node.is_alive = true;
            }
        }
        let levels = self.levels.make_contiguous();
        for index in (1..levels.len()).rev() {
            let (older, newer) = levels.split_at_mut(index);
            for node in newer[0].iter().filter(|node| node.is_alive) {
                older[index - 1][usize::from(node.before)].is_alive = true;
            }
        }
    }

    /// Every report that a branch took.
    pub(super) fn reports(&self) -> impl Iterator<Item = ReportId> {
        let nodes = self.levels.iter().flatten().filter(|node| node.is_alive);
        nodes.filter_map(|node| node.moment.report)
    }
}
