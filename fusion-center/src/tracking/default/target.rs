//! A target: what has been decided about it, and the branches that are still open.

use std::collections::VecDeque;

use crate::tracking::{Settled, Status, Track};

use super::branch::{Branch, Moment, Origin};
use super::config::{DefaultConfig, Way};
use super::gauss::Gauss;
use super::imm::Steps;
use super::open::Open;
use super::smooth::{Pass, smoothed};

/// A track that no target is behind has no more moments, as a rule.
const BEGINNING: usize = 4;

/// A target and its branches.
#[derive(Clone, Debug)]
pub(super) struct Target {
    pub(super) id: u64,
    /// Looks that are decided and have not been taken by the user, oldest first.
    pub(super) trunk: VecDeque<Moment>,
    /// Between moments of `trunk`, from the oldest on, as far as they were needed.
    passes: VecDeque<Pass>,
    /// Looks that are not decided.
    pub(super) open: Open,
    /// Never none.
    pub(super) leaves: Vec<Branch>,
    /// Which branch is the best.
    pub(super) best: u16,
    /// Which cluster it is in; in none, it has one branch.
    pub(super) cluster: Option<u32>,
}

impl Target {
    /// One that begins with a branch.
    pub(super) fn new(id: u64, branch: Branch) -> Self {
        let first = branch.moment(Some(branch.last_report), Origin::Anew);
        let mut trunk = VecDeque::with_capacity(BEGINNING);
        trunk.push_back(first);
        Self {
            id,
            trunk,
            passes: VecDeque::new(),
            open: Open::default(),
            leaves: vec![branch],
            best: 0,
            cluster: None,
        }
    }

    /// Whether it never was more than tentative, and holds no more memory than that takes.
    pub(super) fn is_small(&self) -> bool {
        let is_short = self.trunk.capacity() <= BEGINNING && self.leaves.capacity() == 1;
        is_short && self.leaf().status == Status::Tentative
    }

    /// Another that begins with a branch, in the memory of this one.
    pub(super) fn begin_again(&mut self, id: u64, branch: Branch) {
        self.trunk.clear();
        self.passes.clear();
        self.open.clear();
        self.leaves.clear();
        self.trunk.push_back(branch.moment(Some(branch.last_report), Origin::Anew));
        self.leaves.push(branch);
        (self.id, self.best, self.cluster) = (id, 0, None);
    }

    /// The best branch.
    #[inline]
    pub(super) fn leaf(&self) -> &Branch {
        &self.leaves[usize::from(self.best)]
    }

    /// Decides for the best branch.
    pub(super) fn collapse(&mut self) {
        let best = self.leaves.swap_remove(usize::from(self.best));
        let from = self.trunk.len();
        self.trunk.extend(self.open.back_from(best.tip));
        self.trunk.make_contiguous()[from..].reverse();
        self.open.clear();
        self.leaves.clear();
        self.leaves.push(best);
        (self.best, self.cluster) = (0, None);
    }

    /// Decides for the oldest open moment at `root`, that of all branches.
    pub(super) fn commit_first(&mut self, root: u16, share: f64) {
        if let Some(first) = self.open.take_first(root) {
            self.trunk.push_back(Moment { share, ..first });
        }
        for leaf in &mut self.leaves {
            leaf.root = self.open.root_of(leaf.tip);
        }
    }

    /// What is shown of it.
    #[inline]
    pub(super) fn track(&self) -> Track {
        let leaf = self.leaf();
        let state = leaf.shown();
        Track {
            id: self.id,
            status: leaf.status,
            time_s: leaf.time_s,
            state: state.state(),
            covariance: state.covariance(),
            log_odds: leaf.log_odds,
            plot_count: leaf.plot_count,
            seen_s: leaf.seen_s,
            last_report: leaf.last_report,
            last_share: leaf.last_share,
        }
    }

    /// Moves what is decided, and followed by enough later looks, to the end of `into`; forgets it.
    /// `known` holds the step in time that was last needed.
    pub(super) fn take_settled(
        &mut self,
        config: &DefaultConfig,
        known: &mut Option<Steps>,
        into: &mut Vec<Settled>,
    ) {
        let later = self.open.look_count() + self.trunk.len();
        let ready = later.saturating_sub(config.smoothing_looks).min(self.trunk.len());
        if ready < self.batch(config) || self.leaf().status == Status::Tentative {
            return;
        }
        let ways = config.ways();
        for index in self.passes.len() + 1..self.trunk.len() {
            let pair = [&self.trunk[index - 1], &self.trunk[index]];
            self.passes.push_back(Pass::new(pair[0], pair[1], &ways, known));
        }
        let mut smooth = self.smoothed_last(&ways, known);
        let from = into.len();
        for index in (0..self.trunk.len()).rev() {
            if let Some(pass) = self.passes.get(index) {
                smooth = pass.back(&smooth);
            }
            if index < ready {
                into.push(settled(self.id, &self.trunk[index], &smooth));
            }
        }
        into[from..].reverse();
        self.forget(ready);
    }

    /// How many moments are settled at once: going back over the later ones costs as much for many as
    /// for one. The first time it differs from target to target, lest all be due at the same look.
    fn batch(&self, config: &DefaultConfig) -> usize {
        let all = config.smoothing_looks.max(1);
        if self.passes.is_empty() { 1 + remainder(self.id, all) } else { all }
    }

    /// The smoothed state of the newest moment that is decided.
    fn smoothed_last(&self, ways: &[Way; 2], known: &mut Option<Steps>) -> Gauss {
        let back = self.open.back_from(self.leaf().tip).chain(self.trunk.back());
        let mut later: Option<(&Moment, Gauss)> = None;
        for moment in back {
            let smooth = match &later {
                Some((next, smooth)) => Pass::new(moment, next, ways, known).back(smooth),
                None => moment.imm.merged(),
            };
            later = Some((moment, smooth));
        }
        later.map_or_else(|| self.leaf().imm.merged(), |(_, smooth)| smooth)
    }

    /// Forgets the oldest `count` moments of those that are decided.
    #[inline]
    pub(super) fn forget(&mut self, count: usize) {
        self.trunk.drain(..count.min(self.trunk.len()));
        self.passes.drain(..count.min(self.passes.len()));
    }

    /// Forgets all that is decided.
    pub(super) fn forget_all(&mut self) {
        self.trunk.clear();
        self.passes.clear();
    }

    /// All that is remembered of it, decided for the best branch.
    pub(super) fn into_moments(mut self) -> (u64, Vec<Moment>) {
        self.collapse();
        (self.id, self.trunk.into())
    }
}

/// `id` modulo `count`.
fn remainder(id: u64, count: usize) -> usize {
    usize::try_from(id % count as u64).unwrap_or(0)
}

fn settled(track: u64, moment: &Moment, smooth: &Gauss) -> Settled {
    let state = moment.imm.merged();
    // Where rounding has made smoothing lose its numbers, what was known then stands.
    let is_sound = smooth.state().iter().chain(smooth.covariance().iter()).all(|v| v.is_finite());
    let smooth = if is_sound { smooth } else { &state };
    Settled {
        track,
        status: moment.status,
        time_s: moment.time_s,
        state: state.state(),
        covariance: state.covariance(),
        smoothed_state: smooth.state(),
        smoothed_covariance: smooth.covariance(),
        report: moment.report,
        share: moment.share,
    }
}

/// Moments of tracks that have ended, until they are taken.
#[derive(Clone, Debug, Default)]
pub(super) struct Ended {
    tracks: VecDeque<(u64, Vec<Moment>)>,
    count: usize,
}

impl Ended {
    /// Remembers a track that was ever confirmed; forgets the oldest beyond `limit` moments.
    pub(super) fn push(&mut self, target: Target, limit: usize) {
        // One that was confirmed is never tentative again.
        if target.leaf().status == Status::Tentative {
            return;
        }
        let (id, moments) = target.into_moments();
        self.count += moments.len();
        self.tracks.push_back((id, moments));
        while limit < self.count {
            let Some((_, oldest)) = self.tracks.pop_front() else { return };
            self.count -= oldest.len();
        }
    }

    /// Forgets all.
    pub(super) fn clear(&mut self) {
        self.tracks.clear();
        self.count = 0;
    }

    /// Moves all to the end of `into`, smoothed.
    pub(super) fn take(&mut self, config: &DefaultConfig, into: &mut Vec<Settled>) {
        for (id, moments) in self.tracks.drain(..) {
            let smooth = smoothed(&moments, &config.ways());
            let steps = moments.iter().zip(&smooth);
            into.extend(steps.map(|(moment, better)| settled(id, moment, better)));
        }
        self.count = 0;
    }
}
