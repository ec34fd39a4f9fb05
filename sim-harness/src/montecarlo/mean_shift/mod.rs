//! The four experiments of \[mean-shift\] as a command: every tracker on the same simulated people,
//! trial by trial, beside what was measured before.
//!
//! ```text
//! seed ─ echoes ─ chain ─► frames ─ every tracker ─► Scorer ─► Outcome ─► Summary ─► table, JSON, pictures
//! ```

use std::ops::RangeInclusive;

use anyhow::ensure;
use clap::ValueEnum;
use node_agent::tracking::experiments::{Experiment as Scene, IMAGE_SNR_DB};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::Serialize;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use super::{Study, Work};
use crate::metrics::{OspaScale, Settings};

mod centroid;
mod entrants;
mod picture;
mod published;
mod report;
pub(super) mod summary;
#[cfg(test)]
mod tests;
mod trial;

use entrants::Entrant;
pub(crate) use report::Report;
use summary::Summary;
use trial::{Paths, Theatre};

/// More trials than anyone waits for.
const MAX_TRIAL_COUNT: usize = 100_000;
/// Signal-to-noise ratios in images that make any sense, decibels.
const SNR_RANGE_DB: RangeInclusive<f64> = -20.0..=100.0;
/// Nobody needs to be followed for this long: the 20 frames over which \[mean-shift\] decides.
const ALLOWANCE_S: f64 = 2.0;
/// Cut-offs of GOSPA and OSPA: half of what people keep between them, so that an estimate in the
/// middle belongs to neither.
const CUTOFF_M: f64 = 1.0;

/// Which of the experiments.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Number {
    /// At a constant distance.
    #[value(name = "1")]
    One,
    /// One near, one far, at the same speed.
    #[value(name = "2")]
    Two,
    /// Side by side.
    #[value(name = "3")]
    Three,
    /// Towards each other and apart.
    #[value(name = "4")]
    Four,
    /// All four.
    All,
}

impl Number {
    fn scenes(self) -> Vec<Scene> {
        let all = Scene::all();
        match self {
            Self::One => vec![all[0]],
            Self::Two => vec![all[1]],
            Self::Three => vec![all[2]],
            Self::Four => vec![all[3]],
            Self::All => all.to_vec(),
        }
    }
}

/// The experiments of the mean-shift paper.
#[derive(Debug, clap::Args)]
pub(crate) struct Flags {
    /// Which experiments; all if left out.
    #[arg(long = "experiment", value_enum, value_delimiter = ',', default_value = "all")]
    numbers: Vec<Number>,
    /// Number of trials per experiment.
    #[arg(long, default_value_t = 100)]
    trials: usize,
    /// Seed of everything random.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Trackers to compare; all if left out.
    #[arg(long, value_enum, value_delimiter = ',')]
    trackers: Vec<Entrant>,
    /// A track farther from somebody than this does not follow them, metres.
    #[arg(long, default_value_t = 0.5, allow_negative_numbers = true)]
    gate_m: f64,
    /// Signal-to-noise ratio of people in the image, mean over walk and fading, decibels.
    #[arg(long, default_value_t = IMAGE_SNR_DB, allow_negative_numbers = true)]
    snr_db: f64,
}

/// What is to be done.
pub(crate) struct Experiment {
    scenes: Vec<Scene>,
    trial_count: usize,
    seed: u64,
    entrants: Vec<Entrant>,
    settings: Settings,
    snr_db: f64,
}

impl Study for Experiment {
    type Flags = Flags;
    type Report = Report;

    fn new(flags: &Flags) -> anyhow::Result<Self> {
        let Flags { trials, seed, gate_m, snr_db, .. } = *flags;
        let is_count = (1..=MAX_TRIAL_COUNT).contains(&trials);
        ensure!(is_count, "--trials is {trials}: use 1 to {MAX_TRIAL_COUNT}");
        ensure!(SNR_RANGE_DB.contains(&snr_db), "--snr-db is {snr_db}: use -20 to 100");
        let settings = Settings {
            gate_m,
            allowance_s: ALLOWANCE_S,
            gospa_cutoff_m: CUTOFF_M,
            ospa: OspaScale { order: 2.0, cutoff_m: CUTOFF_M },
        };
        settings.check()?;
        let mut scenes: Vec<Scene> = flags.numbers.iter().flat_map(|one| one.scenes()).collect();
        scenes.sort_by_key(|scene| scene.number());
        scenes.dedup();
        let mut entrants = flags.trackers.clone();
        if entrants.is_empty() {
            entrants = Entrant::value_variants().to_vec();
        }
        entrants.dedup();
        Ok(Self { scenes, trial_count: trials, seed, entrants, settings, snr_db })
    }

    fn name(&self) -> String {
        let numbers: String = self.scenes.iter().map(|scene| scene.number().to_string()).collect();
        format!("mean-shift-{numbers}")
    }

    fn run(&self, stop: &CancellationToken) -> anyhow::Result<Report> {
        let started = Instant::now();
        let results = self.scenes.iter().map(|scene| self.run_scene(*scene, stop));
        Ok(Report {
            experiments: results.collect::<anyhow::Result<_>>()?,
            trial_count: self.trial_count,
            seed: self.seed,
            settings: self.settings,
            snr_db: self.snr_db,
            elapsed_s: started.elapsed().as_secs_f64(),
        })
    }
}

impl Experiment {
    fn run_scene(&self, scene: Scene, stop: &CancellationToken) -> anyhow::Result<SceneResult> {
        let theatre = Theatre::new(scene, &self.entrants, self.settings)?.at_snr_db(self.snr_db);
        let label = LABELS[scene.number() - 1];
        let work = Work { count: self.trial_count, label, stop };
        let (trials, took) =
            work.each("people", |trial| theatre.play(trial_seed(self.seed, scene, trial)))?;
        let mut of_entrants: Vec<Vec<_>> = self.entrants.iter().map(|_| Vec::new()).collect();
        for outcomes in trials {
            of_entrants.iter_mut().zip(outcomes).for_each(|(all, outcome)| all.push(outcome));
        }
        let mut trackers = Vec::new();
        for (entrant, outcomes) in self.entrants.iter().zip(&of_entrants) {
            let first = outcomes.first().map_or_else(Paths::default, |one| one.paths.clone());
            trackers.push(TrackerResult {
                summary: Summary::new(entrant.name(), outcomes, self.seed),
                prototype: published::prototype(scene.number(), *entrant),
                first,
            });
        }
        Ok(SceneResult { number: scene.number(), label, took_s: took.as_secs_f64(), trackers })
    }
}

const LABELS: [&str; 4] = ["experiment 1", "experiment 2", "experiment 3", "experiment 4"];

/// Every trial of every experiment has a seed of its own, whichever others are run.
fn trial_seed(seed: u64, scene: Scene, trial: usize) -> u64 {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream((scene.number() as u64) << 32 | trial as u64);
    rng.random()
}

/// What came out of one experiment.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct SceneResult {
    number: usize,
    #[serde(skip)]
    label: &'static str,
    /// How long all trials took, seconds. Differs from run to run.
    took_s: f64,
    trackers: Vec<TrackerResult>,
}

/// One tracker in one experiment.
#[derive(Clone, Debug, Serialize)]
struct TrackerResult {
    #[serde(flatten)]
    summary: Summary,
    /// RMSE in metres, missed, false per frame, switches per run, as far as measured before.
    prototype: Option<&'static str>,
    /// The first trial.
    #[serde(skip)]
    first: Paths,
}
