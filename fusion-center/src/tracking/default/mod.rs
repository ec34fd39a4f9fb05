//! The default tracker: two ways of moving, likelihood ratios, decisions that wait where they are close.
//!
//! Each look moves the targets it concerns to its time, finds the plots in their gates, and takes the
//! cheapest joint assignment where that is clear; elsewhere a cluster of targets carries its best
//! joint hypotheses for some scans. What is left starts tentative tracks. A target is neither seen
//! nor missed where the sensor did not look; one that may have become too slow to be detected is kept
//! where it stopped. The same for people and for wide areas, with other settings.

mod branch;
pub mod config;
mod coverage;
mod decide;
mod expand;
mod gauss;
mod hypotheses;
mod imm;
mod life;
mod open;
mod prices;
mod row;
mod settle;
mod smooth;
mod stand;
mod target;
mod work;

#[cfg(test)]
mod tests;

use super::{Look, LookError, Settled, Track, Tracker};

pub use config::{ConfigError, DefaultConfig, Way};

use expand::Search;
use hypotheses::Hypotheses;
use target::{Ended, Target};
use work::Work;

/// The default tracker.
#[derive(Debug)]
pub struct DefaultTracker {
    config: DefaultConfig,
    /// In ascending order of id.
    targets: Vec<Target>,
    /// What is shown of each.
    shown: Vec<Track>,
    clusters: Vec<Hypotheses>,
    ended: Ended,
    /// Memory of targets that are gone.
    spare: Vec<Target>,
    next_id: u64,
    now_s: Option<f64>,
    work: Work,
    search: Search,
    /// Branches of a target while it gets new ones: which one each comes of, and its choice.
    made: Vec<(u16, u32)>,
    /// Members of each group, while a look is at work.
    sizes: Vec<u32>,
}

impl DefaultTracker {
    /// One that follows nothing yet.
    ///
    /// # Errors
    /// If a setting is out of its range.
    pub fn new(config: DefaultConfig) -> Result<Self, ConfigError> {
        config.check()?;
        Ok(Self {
            config,
            targets: Vec::new(),
            shown: Vec::new(),
            clusters: Vec::new(),
            ended: Ended::default(),
            spare: Vec::new(),
            next_id: 1,
            now_s: None,
            work: Work::default(),
            search: Search::default(),
            made: Vec::new(),
            sizes: Vec::new(),
        })
    }
}

impl Tracker for DefaultTracker {
    fn look(&mut self, look: &Look<'_>) -> Result<(), LookError> {
        look.check(self.now_s)?;
        self.now_s = Some(look.time_s);
        self.work.expect(&self.targets, look, &self.config);
        self.decide(look);
        self.begin(look);
        self.close(look.time_s);
        Ok(())
    }

    fn tracks(&self) -> &[Track] {
        &self.shown
    }

    fn take_settled(&mut self, into: &mut Vec<Settled>) {
        self.ended.take(&self.config, into);
        let mut known = None;
        for target in &mut self.targets {
            target.take_settled(&self.config, &mut known, into);
        }
    }

    fn forget_settled(&mut self) {
        self.ended.clear();
        self.targets.iter_mut().for_each(Target::forget_all);
    }

    fn finish(&mut self) {
        self.clusters.clear();
        for target in self.targets.drain(..) {
            self.ended.push(target, self.config.max_step_count);
        }
        self.shown.clear();
        self.now_s = None;
    }
}
