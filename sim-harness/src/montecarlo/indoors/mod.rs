//! People followed by several registered nodes: a shipped scenario many times over, through the real
//! chain and the centre's state machine, scored against where everybody is.
//!
//! ```text
//! seed ─ echoes ─ every node's chain ─► centre ─► pictures ─► Scorer ─► Outcome ─► table, JSON
//! ```

use anyhow::ensure;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use super::mean_shift::summary::figures;
use super::statistics::Proportion;
use super::{Study, Work};
use crate::metrics::{OspaScale, Score, Settings};
use crate::scenario::{Scenario, find};

mod report;
#[cfg(test)]
mod tests;
mod trial;

pub(crate) use report::Report;
use trial::Outcome;

/// More trials than anyone waits for.
const MAX_TRIAL_COUNT: usize = 10_000;
/// Nobody needs to be followed for this long after the first of all is, seconds of the scene.
const ALLOWANCE_S: f64 = 2.0;
/// Cut-off of GOSPA and OSPA, metres: an estimate this far from everybody is of nobody.
const CUTOFF_M: f64 = 1.0;
/// A false track that lasts longer than this is one too many, seconds of the scene.
const LONGEST_FALSE_S: f64 = 1.0;

/// The scenario and how often it is played.
#[derive(Debug, clap::Args)]
pub(crate) struct Flags {
    /// Name of a shipped scenario, or a scenario file; one with simulated echoes.
    #[arg(default_value = "office")]
    scenario: String,
    /// Number of trials; each has a seed of its own.
    #[arg(long, default_value_t = 100)]
    trials: usize,
    /// Seed of the first trial.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// A track farther from somebody than this does not follow them, metres.
    #[arg(long, default_value_t = 0.75)]
    gate_m: f64,
    /// Number of periods; the scenario's own if left out.
    #[arg(long)]
    periods: Option<u64>,
}

/// What is to be done.
pub(crate) struct Experiment {
    scenario: Scenario,
    trial_count: usize,
    seed: u64,
    settings: Settings,
}

impl Study for Experiment {
    type Flags = Flags;
    type Report = Report;

    fn new(flags: &Flags) -> anyhow::Result<Self> {
        let Flags { trials, seed, gate_m, .. } = *flags;
        let is_count = (1..=MAX_TRIAL_COUNT).contains(&trials);
        ensure!(is_count, "--trials is {trials}: use 1 to {MAX_TRIAL_COUNT}");
        let settings = Settings {
            gate_m,
            allowance_s: ALLOWANCE_S,
            gospa_cutoff_m: CUTOFF_M,
            ospa: OspaScale { order: 2.0, cutoff_m: CUTOFF_M },
        };
        settings.check()?;
        let mut scenario = find(&flags.scenario)?;
        ensure!(
            scenario.recording.is_none(),
            "scenario {}: it plays a recording, in which nobody says where people are; name one with \
             simulated echoes, such as office",
            scenario.name
        );
        // Time of the scene and time of the centre are one here.
        scenario.speed = 1.0;
        scenario.period_count = flags.periods.or(scenario.period_count);
        let scenario = scenario.resolve()?;
        Ok(Self { scenario, trial_count: trials, seed, settings })
    }

    fn name(&self) -> String {
        format!("indoors-{}", self.scenario.name)
    }

    fn run(&self, stop: &CancellationToken) -> anyhow::Result<Report> {
        let started = Instant::now();
        let work = Work { count: self.trial_count, label: "indoors", stop };
        let play = |trial: usize| {
            let seed = self.seed.wrapping_add(trial as u64);
            trial::play(&Scenario { seed, ..self.scenario.clone() }, self.settings)
        };
        let (outcomes, _) = work.each("people", play)?;
        let scores: Vec<Score> = outcomes.iter().map(|one| one.score).collect();
        let is_steady = |one: &Outcome| one.score.switch_count == 0;
        let is_clean = |one: &Outcome| one.longest_false_s <= LONGEST_FALSE_S;
        Ok(Report {
            scenario: self.scenario.name.clone(),
            seed: self.seed,
            trial_count: self.trial_count,
            settings: self.settings,
            figures: figures(&scores, self.seed),
            without_switch: Proportion::count_of(&outcomes, is_steady),
            without_long_false: Proportion::count_of(&outcomes, is_clean),
            outcomes,
            elapsed_s: started.elapsed().as_secs_f64(),
        })
    }
}
