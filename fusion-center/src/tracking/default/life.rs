//! Beginnings and ends of tracks, and what is shown and remembered of them.

use crate::tracking::Look;

use super::DefaultTracker;
use super::branch::Branch;
use super::target::Target;
use super::work::NONE;

/// Targets whose memory is kept for others.
const MAX_SPARE_COUNT: usize = 4096;

impl DefaultTracker {
    /// Plots that nobody takes start tracks.
    pub(super) fn begin(&mut self, look: &Look<'_>) {
        for (plot, used) in look.plots.iter().zip(&self.work.used) {
            if *used || self.config.max_track_count <= self.targets.len() {
                continue;
            }
            let branch = Branch::new(look, plot, &self.config);
            let target = match self.spare.pop() {
                None => Target::new(self.next_id, branch),
                Some(mut target) => {
                    target.begin_again(self.next_id, branch);
                    target
                }
            };
            self.next_id += 1;
            self.shown.push(target.track());
            self.targets.push(target);
        }
    }

    /// Shows what the look has changed, forgets what nobody has taken, oldest first, beyond what is
    /// remembered, and ends the tracks that are not believed any more.
    pub(super) fn close(&mut self, now_s: f64) {
        let config = &self.config;
        let fair = config.max_step_count / self.targets.len().max(1);
        let limit = fair.max(config.smoothing_looks + 1);
        let mut over_count = 0;
        for (index, target) in self.targets.iter_mut().enumerate() {
            if self.work.place_of.get(index).is_some_and(|place| *place != NONE) {
                self.shown[index] = target.track();
            }
            target.forget(target.trunk.len().saturating_sub(limit));
            over_count += usize::from(target.leaf().is_over(now_s, config));
        }
        if 0 < over_count {
            self.end(now_s);
        }
    }

    /// Ends the tracks that are not believed any more.
    fn end(&mut self, now_s: f64) {
        let (config, limit) = (&self.config, self.config.max_step_count);
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
        let mut index = 0;
        for target in self.targets.extract_if(.., |_| {
            index += 1;
            names[index - 1] == NONE
        }) {
            // Most were never more than tentative, and their memory serves again.
            if target.is_small() && self.spare.len() < MAX_SPARE_COUNT {
                self.spare.push(target);
            } else {
                self.ended.push(target, limit);
            }
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
}
