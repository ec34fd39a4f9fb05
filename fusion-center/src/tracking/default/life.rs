//! Beginnings and ends of tracks, and what is shown and remembered of them.

use crate::tracking::Look;

use super::DefaultTracker;
use super::branch::Branch;
use super::target::Target;
use super::work::NONE;

impl DefaultTracker {
    /// Plots that nobody takes start tracks.
    pub(super) fn begin(&mut self, look: &Look<'_>) {
        for (plot, used) in look.plots.iter().zip(&self.work.used) {
            if *used || self.config.max_track_count <= self.targets.len() {
                continue;
            }
            let branch = Branch::new(look, plot, &self.config);
            let target = Target::new(self.next_id, branch);
            self.next_id += 1;
            self.shown.push(target.track());
            self.targets.push(target);
        }
    }

    /// Ends the tracks that are not believed any more.
    pub(super) fn end(&mut self, now_s: f64) {
        let config = &self.config;
        if !self.targets.iter().any(|target| target.leaf().is_over(now_s, config)) {
            return;
        }
        let mut names: Vec<u32> = Vec::with_capacity(self.targets.len());
        let mut kept = 0;
        for target in &self.targets {
            let is_over = target.leaf().is_over(now_s, config);
            names.push(if is_over { NONE } else { kept });
            kept += u32::from(!is_over);
        }
        self.leave_clusters(&names);
        let mut at = 0;
        self.shown.retain(|_| {
            at += 1;
            names[at - 1] != NONE
        });
        let (ended, limit) = (&mut self.ended, self.config.max_step_count);
        let mut index = 0;
        for target in self.targets.extract_if(.., |_| {
            index += 1;
            names[index - 1] == NONE
        }) {
            ended.push(target, limit);
        }
        self.renumber_clusters();
    }

    /// Takes targets without a new name out of their clusters, and renames the others.
    fn leave_clusters(&mut self, names: &[u32]) {
        for index in 0..self.clusters.len() {
            let mut rest = std::mem::take(&mut self.clusters[index]);
            let places: Vec<usize> = (0..rest.members.len())
                .filter(|place| names[rest.members[*place] as usize] != NONE)
                .collect();
            if places.len() < rest.members.len() {
                rest = rest.about(&places);
            }
            for member in &mut rest.members {
                *member = names[*member as usize];
            }
            self.clusters[index] = rest;
        }
    }

    /// Shows what the look has changed.
    pub(super) fn show(&mut self) {
        for (index, target) in self.targets.iter().enumerate() {
            if self.work.place_of.get(index).is_none_or(|place| *place != NONE) {
                self.shown[index] = target.track();
            }
        }
    }

    /// Forgets what nobody has taken, oldest first, beyond what is remembered.
    pub(super) fn forget(&mut self) {
        let fair = self.config.max_step_count / self.targets.len().max(1);
        let limit = fair.max(self.config.smoothing_looks + 1);
        for target in &mut self.targets {
            target.forget(target.trunk.len().saturating_sub(limit));
        }
    }
}
