//! One trial: a simulated sequence, every tracker on it, what each is worth.

use std::collections::BTreeMap;
use std::time::Duration;

use nalgebra::Vector2;
use node_agent::tracking::experiments::{Experiment, Shown, Stage};
use node_agent::tracking::{FrameError, Tracker};
use tokio::time::Instant;

use super::entrants::{ChainKind, Entrant};
use crate::metrics::{Score, Scorer, Settings, Truth};

/// What a tracker reported, for pictures.
#[derive(Clone, Debug, Default)]
pub(super) struct Paths {
    /// Where both people were, frame by frame, metres.
    pub(super) truths_m: [Vec<[f64; 2]>; 2],
    /// Where each confirmed track was, frame by frame, metres.
    pub(super) tracks_m: BTreeMap<u64, Vec<[f64; 2]>>,
}

/// What one tracker made of one trial.
#[derive(Clone, Debug)]
pub(super) struct Outcome {
    pub(super) score: Score,
    /// What each frame adds to the score.
    pub(super) frames: Vec<Score>,
    pub(super) paths: Paths,
    /// Time that the tracker took for all frames.
    pub(super) took: Duration,
}

/// One experiment with its chains, ready to be played with any seed.
pub(super) struct Theatre {
    stages: Vec<(ChainKind, Stage)>,
    entrants: Vec<Entrant>,
    settings: Settings,
}

/// A tracker on its way through a trial.
struct Running {
    /// Its place in the list of entrants.
    index: usize,
    entrant: Entrant,
    tracker: Box<dyn Tracker>,
    scorer: Scorer<usize, u64>,
    frames: Vec<Score>,
    paths: Paths,
    took: Duration,
}

impl Theatre {
    /// # Errors
    /// If the chain cannot be built.
    pub(super) fn new(
        experiment: Experiment,
        entrants: &[Entrant],
        settings: Settings,
    ) -> anyhow::Result<Self> {
        let is_needed = |kind: &ChainKind| entrants.iter().any(|entrant| entrant.chain() == *kind);
        let kinds = ChainKind::ALL.into_iter().filter(is_needed);
        let stages = kinds.map(|kind| Ok((kind, Stage::new(experiment, &kind.config())?)));
        let stages = stages.collect::<anyhow::Result<_>>()?;
        Ok(Self { stages, entrants: entrants.to_vec(), settings })
    }

    /// The same with another signal-to-noise ratio in the images, decibels.
    pub(super) fn at_snr_db(self, snr_db: f64) -> Self {
        let stages = self.stages.into_iter().map(|(kind, stage)| (kind, stage.at_snr_db(snr_db)));
        Self { stages: stages.collect(), ..self }
    }

    /// Everybody's outcome, in the order of the entrants. All see the same people and the same noise.
    ///
    /// # Errors
    /// If a tracker refuses a frame, which no sound one does.
    pub(super) fn play(&self, seed: u64) -> anyhow::Result<Vec<Outcome>> {
        let mut all: Vec<Running> = Vec::new();
        for (kind, stage) in &self.stages {
            let mut running = self.cast(*kind)?;
            stage.play(seed, |shown| running.iter_mut().try_for_each(|one| one.watch(shown)))?;
            all.append(&mut running);
        }
        all.sort_by_key(|one| one.index);
        Ok(all.into_iter().map(Running::outcome).collect())
    }

    fn cast(&self, kind: ChainKind) -> anyhow::Result<Vec<Running>> {
        let entrants = self.entrants.iter().copied().enumerate();
        let ours = entrants.filter(|(_, entrant)| entrant.chain() == kind);
        let running = |(index, entrant): (usize, Entrant)| {
            Ok(Running {
                index,
                entrant,
                tracker: entrant.tracker()?,
                scorer: Scorer::new(self.settings)?,
                frames: Vec::new(),
                paths: Paths::default(),
                took: Duration::ZERO,
            })
        };
        ours.map(running).collect()
    }
}

impl Running {
    fn watch(&mut self, shown: &Shown<'_>) -> Result<(), FrameError> {
        let started = Instant::now();
        let tracks = self.tracker.track(&shown.frame)?;
        self.took += started.elapsed();
        let estimates = self.entrant.reports(tracks);
        let person =
            |(id, middle_m): (usize, &Vector2<f64>)| Truth { id, at_m: (*middle_m).into() };
        let truths: Vec<Truth<usize>> = shown.middles_m.iter().enumerate().map(person).collect();
        self.frames.push(self.scorer.add(shown.frame.time_s, &truths, &estimates));
        for (path_m, truth) in self.paths.truths_m.iter_mut().zip(&truths) {
            path_m.push(truth.at_m);
        }
        for estimate in &estimates {
            self.paths.tracks_m.entry(estimate.id).or_default().push(estimate.at_m);
        }
        Ok(())
    }

    fn outcome(self) -> Outcome {
        let Self { scorer, frames, paths, took, .. } = self;
        Outcome { score: scorer.score(), frames, paths, took }
    }
}
