//! One trial: a simulated sequence, every tracker on it, what each is worth.

use std::collections::BTreeMap;
use std::time::Duration;

use nalgebra::{Matrix2, Vector2};
use node_agent::tracking::default::DefaultConfig;
use node_agent::tracking::experiments::{Experiment, FRAME_S, Shown, Stage};
use node_agent::tracking::{FrameError, Smoothed, Tracker};
use tokio::time::Instant;

use super::entrants::{ChainKind, Entrant};
use crate::metrics::{Estimate, Score, Scorer, Settings, Truth};

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
    /// The same of near sides against where what people reflect comes from on average.
    pub(super) near_side: Score,
    /// The same of smoothed places against where people were at their times; nothing is scored for a
    /// tracker that does not smooth.
    pub(super) smoothed: Score,
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
    near_side: Scorer<usize, u64>,
    smoothed: Scorer<usize, u64>,
    /// When, and where both people were, frame by frame.
    past: Vec<(f64, Vec<Truth<usize>>)>,
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
                near_side: Scorer::new(self.settings)?,
                smoothed: Scorer::new(self.settings)?,
                past: Vec::new(),
                frames: Vec::new(),
                paths: Paths::default(),
                took: Duration::ZERO,
            })
        };
        ours.map(running).collect()
    }
}

/// Both people, at these places in metres.
fn of_people(places_m: &[Vector2<f64>; 2]) -> Vec<Truth<usize>> {
    let person = |(id, at_m): (usize, &Vector2<f64>)| Truth { id, at_m: (*at_m).into() };
    places_m.iter().enumerate().map(person).collect()
}

impl Running {
    fn watch(&mut self, shown: &Shown<'_>) -> Result<(), FrameError> {
        let started = Instant::now();
        let tracks = self.tracker.track(&shown.frame)?;
        self.took += started.elapsed();
        let estimates = self.entrant.reports(tracks);
        let near_sides = self.entrant.near_sides(tracks);
        let confirmed: Vec<u64> = estimates.iter().map(|estimate| estimate.id).collect();
        let truths = of_people(&shown.middles_m);
        self.near_side.add(shown.frame.time_s, &of_people(&shown.shining_m), &near_sides);
        self.past.push((shown.frame.time_s, truths.clone()));
        self.score_smoothed(shown.frame.time_s, &confirmed);
        self.frames.push(self.scorer.add(shown.frame.time_s, &truths, &estimates));
        for (path_m, truth) in self.paths.truths_m.iter_mut().zip(&truths) {
            path_m.push(truth.at_m);
        }
        for estimate in &estimates {
            self.paths.tracks_m.entry(estimate.id).or_default().push(estimate.at_m);
        }
        Ok(())
    }

    /// Scores who is smoothed over the whole lag by now.
    fn score_smoothed(&mut self, time_s: f64, confirmed: &[u64]) {
        let then_s = time_s - DefaultConfig::default().smoothing_lag_s;
        let is_then = |at_s: f64| (at_s - then_s).abs() < 0.5 * FRAME_S;
        let Some((_, truths)) = self.past.iter().find(|(at_s, _)| is_then(*at_s)) else { return };
        let mut smoothed = self.tracker.smoothed();
        smoothed.retain(|one| is_then(one.time_s) && confirmed.contains(&one.id));
        let estimate = |one: &Smoothed| {
            let covariance_m2: Matrix2<f64> = one.covariance.fixed_view::<2, 2>(0, 0).into_owned();
            let at_m = [one.state[0], one.state[1]];
            Estimate { id: one.id, at_m, covariance_m2: Some(covariance_m2) }
        };
        let estimates: Vec<Estimate<u64>> = smoothed.iter().map(estimate).collect();
        self.smoothed.add(then_s, truths, &estimates);
    }

    fn outcome(self) -> Outcome {
        let Self { scorer, near_side, smoothed, frames, paths, took, .. } = self;
        let [score, near_side, smoothed] = [&scorer, &near_side, &smoothed].map(Scorer::score);
        Outcome { score, near_side, smoothed, frames, paths, took }
    }
}
