//! The association of \[wide-area\] and its two rivals as trackers.
//!
//! ```text
//! track's newest plot ─► r̂, θ̂ ─► gates: beam, range, angle ─► degrees ┬► paper: least sum of D over all
//!  (law of cosines)                                                   ├► nearest: least D of each row
//!                                                                     └► belief: BetP, row by row or over all
//! plot taken ─► Kalman filter ─► smoothed states afterwards
//! ```
//!
//! All three are without memory: of a track they know its newest plot only, the Kalman filter has no
//! say. Plots that no track takes begin tracks; a track is confirmed by M of N looks that could have
//! seen it, and ends unseen: a target that stops and one that disappears are the same to it, so the
//! status `Stopped` is never given. The publication asks for initiation, maintenance and end of
//! tracks without figures; those are settings. As everything is measured from a flying sensor, looks
//! without a platform are refused.

mod belief;
mod config;
mod decide;
mod degree;
mod filter;
mod followed;
mod gate;
mod geometry;

#[cfg(test)]
mod tests;

use std::collections::VecDeque;

use serde::{Deserialize, Serialize};

pub use config::{
    AcrossGate, BeliefConfig, BeliefDecision, PaperConfig, PerAttribute, Sharing, Start,
};

use super::{InvalidSetting, Look, LookError, Platform, Settled, Track, Tracker};
use decide::{Candidate, Choice, Decider};
use followed::{Expected, Followed};
use gate::{Columns, Gate};

/// Settled steps kept for whoever takes them, between two looks.
const MAX_SETTLED_COUNT: usize = 1 << 17;

/// Which association.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// The global optimum, as published.
    Paper,
    /// The nearest neighbour by the same cost.
    Nearest,
    /// The belief function method.
    Belief,
}

/// A tracker without memory in its association.
#[derive(Clone, Debug)]
pub struct PaperTracker {
    mode: Mode,
    config: PaperConfig,
    followed: Vec<Followed>,
    next_id: u64,
    newest_s: Option<f64>,
    tracks: Vec<Track>,
    settled: VecDeque<Settled>,
    scratch: Scratch,
}

/// Memory for one look.
#[derive(Clone, Debug, Default)]
struct Scratch {
    columns: Columns,
    expected: Vec<Expected>,
    candidates: Vec<Candidate>,
    choices: Vec<Option<Choice>>,
    is_taken: Vec<bool>,
    decider: Decider,
}

impl PaperTracker {
    /// A tracker that knows nobody.
    ///
    /// # Errors
    /// If a setting makes no sense.
    pub fn new(mode: Mode, config: &PaperConfig) -> Result<Self, InvalidSetting> {
        config.check()?;
        Ok(Self {
            mode,
            config: *config,
            followed: Vec::new(),
            next_id: 0,
            newest_s: None,
            tracks: Vec::new(),
            settled: VecDeque::new(),
            scratch: Scratch::default(),
        })
    }

    /// Which plot each track takes; nothing but `scratch` is changed.
    fn associate(&mut self, look: &Look<'_>, platform: &Platform) -> Result<(), LookError> {
        let scratch = &mut self.scratch;
        scratch.expected.clear();
        let expect = |track: &Followed| track.seen.expected(look.time_s, platform);
        scratch.expected.extend(self.followed.iter().map(expect));
        let gate = Gate { config: &self.config, look, platform };
        gate.columns(&mut scratch.columns);
        scratch.candidates.clear();
        for (row, (track, expected)) in self.followed.iter().zip(&scratch.expected).enumerate() {
            gate.candidates(
                (row, &track.seen),
                expected,
                &scratch.columns,
                &mut scratch.candidates,
            );
        }
        let counts = (self.followed.len(), look.plots.len());
        let choices = &mut scratch.choices;
        scratch
            .decider
            .decide((self.mode, &self.config), &scratch.candidates, counts, choices)
            .map_err(|error| look.unusable("number of pairs", error))
    }

    /// Gives the tracks their plots, oldest first, and ends those that are over.
    fn follow(&mut self, look: &Look<'_>, platform: &Platform) {
        let Self { config, scratch, settled, .. } = self;
        let Scratch { choices, is_taken, .. } = scratch;
        is_taken.clear();
        is_taken.resize(look.plots.len(), false);
        let mut decided = choices.iter().zip(&scratch.expected);
        self.followed.retain_mut(|track| {
            let Some((choice, expected)) = decided.next() else { return true };
            let is_over = match choice {
                Some(choice) => {
                    track.take((look, platform), *choice, config);
                    let is_second = std::mem::replace(&mut is_taken[choice.column], true);
                    is_second && config.sharing == Sharing::OldestGoesOn
                }
                None if track.is_looked_at(&look.coverage, platform, expected) => {
                    track.miss(look, config);
                    track.has_ended(config)
                }
                None => false,
            };
            if is_over {
                track.settle_all(config, settled);
            } else {
                track.settle_old(config, settled);
            }
            !is_over
        });
    }

    /// Begins tracks with the plots that nobody took.
    fn begin(&mut self, look: &Look<'_>, platform: &Platform) {
        let may_begin = self.config.start == Start::EveryLook || self.newest_s.is_none();
        let free = look.plots.iter().zip(&self.scratch.is_taken).filter(|(_, taken)| !**taken);
        let room = self.config.max_track_count.saturating_sub(self.followed.len());
        for (plot, _) in free.take(if may_begin { room } else { 0 }) {
            self.followed.push(Followed::new(self.next_id, (look, platform), plot, &self.config));
            self.next_id += 1;
        }
    }
}

impl Tracker for PaperTracker {
    fn look(&mut self, look: &Look<'_>) -> Result<(), LookError> {
        look.check(self.newest_s)?;
        let (sensor_index, look_index) = (look.sensor_index, look.look_index);
        let platform = look.platform.ok_or(LookError::NoPlatform { sensor_index, look_index })?;
        self.associate(look, &platform)?;
        let excess = self.settled.len().saturating_sub(MAX_SETTLED_COUNT);
        self.settled.drain(..excess);
        self.follow(look, &platform);
        self.begin(look, &platform);
        self.newest_s = Some(look.time_s);
        self.tracks.clear();
        self.tracks.extend(self.followed.iter().filter_map(Followed::track));
        Ok(())
    }

    fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    fn take_settled(&mut self, into: &mut Vec<Settled>) {
        into.extend(self.settled.drain(..));
    }

    fn finish(&mut self) {
        for track in &mut self.followed {
            track.settle_all(&self.config, &mut self.settled);
        }
        self.followed.clear();
        self.newest_s = None;
    }
}
