//! The experiments of \[wide-area\] as a command: every tracker on the same simulated flights, and the
//! load that many targets are.
//!
//! ```text
//! seed ─ SimulatedGmti ─► dwells ─► looks ─ every tracker ─► Tally ─► figures, duels ─► table, JSON, pictures
//! ```

use anyhow::{bail, ensure};
use clap::ValueEnum;
use node_agent::gmti::simulate::{
    NoiseConfig, PlaceNoise, Preset, SimulatedGmtiConfig, four_targets, three_targets,
};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::Serialize;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;

use super::{Study, Work};
use crate::metrics::{OspaScale, Settings};

mod case;
mod clock;
mod entrants;
mod load;
mod picture;
mod report;
mod summary;
#[cfg(test)]
mod tests;
mod trial;

use case::Case;
use entrants::{Entrant, Rules};
use load::Spread;
use picture::Sample;
pub(crate) use report::Report;
use summary::{Duel, EntrantResult, duels};
use trial::{Outcome, play};

/// More trials than anyone waits for.
const MAX_TRIAL_COUNT: usize = 100_000;
/// Variances that \[wide-area\] shows, square metres.
const VARIANCES_M2: [u32; 4] = [100, 400, 900, 3300];
/// Largest variance that makes any sense, square metres.
const MAX_VARIANCE_M2: u32 = 1_000_000;
/// Targets of the load, if not stated.
const LOAD_COUNTS: [usize; 3] = [1000, 5000, 20_000];
/// More targets than a simulation holds.
const MAX_LOAD_COUNT: usize = 200_000;
/// What is scored at once: `c` of GOSPA is five standard deviations of the usual variance, and nobody
/// needs to have been found within three scans.
const SETTINGS: Settings = Settings {
    gate_m: 100.0,
    allowance_s: 12.0,
    gospa_cutoff_m: 100.0,
    ospa: OspaScale { order: 2.0, cutoff_m: 100.0 },
};

/// Which experiment.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Scenario {
    /// Two that turn, one that pauses.
    ThreeTargets,
    /// Two side by side, two that cross.
    FourTargets,
    /// Many, for the time it takes.
    Load,
}

/// The experiments of the wide-area paper.
#[derive(Debug, clap::Args)]
pub(crate) struct Flags {
    /// Which experiment.
    #[arg(long, value_enum, default_value = "four-targets")]
    scenario: Scenario,
    /// Variances of the place on both axes, square metres; if left out 100, 400, 900 and 3300 for
    /// four-targets, and 8 along and 20 across the line of sight for three-targets.
    #[arg(long = "variance", value_delimiter = ',')]
    variances_m2: Vec<u32>,
    /// Turn the ways by 90 degrees: targets then differ in cross range, not in range.
    #[arg(long)]
    rotated: bool,
    /// Number of trials: 500, for load 3, if left out.
    #[arg(long)]
    trials: Option<usize>,
    /// Seed of everything random.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Trackers to compare; all if left out, for load the default one.
    #[arg(long, value_enum, value_delimiter = ',')]
    modes: Vec<Entrant>,
    /// Numbers of targets, for load; 1000, 5000 and 20000 if left out.
    #[arg(long, value_delimiter = ',')]
    targets: Vec<usize>,
    /// How they are spread, for load; both if left out.
    #[arg(long, value_enum, value_delimiter = ',')]
    spread: Vec<Spread>,
}

/// What is to be done.
pub(crate) struct Experiment {
    scenario: Scenario,
    conditions: Vec<Condition>,
    loads: Vec<(Spread, usize)>,
    trial_count: usize,
    seed: u64,
    entrants: Vec<Entrant>,
}

/// Under what trials are flown.
#[derive(Clone, Debug)]
struct Condition {
    label: String,
    variance_m2: Option<u32>,
    config: SimulatedGmtiConfig,
    rules: Rules,
}

impl Study for Experiment {
    type Flags = Flags;
    type Report = Report;

    fn new(flags: &Flags) -> anyhow::Result<Self> {
        let Flags { scenario, rotated, seed, .. } = *flags;
        let is_load = scenario == Scenario::Load;
        let trial_count = flags.trials.unwrap_or(if is_load { 3 } else { 500 });
        let is_count = (1..=MAX_TRIAL_COUNT).contains(&trial_count);
        ensure!(is_count, "--trials is {trial_count}: use 1 to {MAX_TRIAL_COUNT}");
        let is_four = scenario == Scenario::FourTargets;
        let has_variances = !flags.variances_m2.is_empty();
        ensure!(!is_load || !has_variances, "--variance: leave it out with --scenario load");
        ensure!(is_four || !rotated, "--rotated: only four-targets can be turned");
        let has_load_flags = !flags.targets.is_empty() || !flags.spread.is_empty();
        ensure!(is_load || !has_load_flags, "--targets and --spread: add --scenario load");
        let mut entrants = flags.modes.clone();
        if entrants.is_empty() {
            let all = Entrant::value_variants();
            entrants = if is_load { vec![Entrant::Default] } else { all.to_vec() };
        }
        entrants.dedup();
        let conditions = match scenario {
            Scenario::Load => Vec::new(),
            Scenario::ThreeTargets => three(flags)?,
            Scenario::FourTargets => four(flags)?,
        };
        let loads = if is_load { loads(&flags.targets, &flags.spread)? } else { Vec::new() };
        Ok(Self { scenario, conditions, loads, trial_count, seed, entrants })
    }

    fn name(&self) -> String {
        let scenario = match self.scenario {
            Scenario::ThreeTargets => "three-targets",
            Scenario::FourTargets => "four-targets",
            Scenario::Load => "load",
        };
        format!("wide-area-{scenario}")
    }

    fn run(&self, stop: &CancellationToken) -> anyhow::Result<Report> {
        let started = Instant::now();
        let conditions = self.conditions.iter().map(|condition| self.fly(condition, stop));
        let conditions = conditions.collect::<anyhow::Result<_>>()?;
        let mut loads = Vec::new();
        for (spread, target_count) in &self.loads {
            for entrant in &self.entrants {
                let (count, seed) = (self.trial_count, self.seed);
                let seeds: Vec<u64> = (0..count).map(|trial| trial_seed(seed, trial)).collect();
                loads.push(load::run(*entrant, (*spread, *target_count), &seeds, stop)?);
            }
        }
        Ok(Report {
            scenario: self.scenario,
            seed: self.seed,
            trial_count: self.trial_count,
            settings: SETTINGS,
            conditions,
            loads,
            elapsed_s: started.elapsed().as_secs_f64(),
        })
    }
}

impl Experiment {
    fn fly(
        &self,
        condition: &Condition,
        stop: &CancellationToken,
    ) -> anyhow::Result<ConditionResult> {
        let work = Work { count: self.trial_count, label: "wide area", stop };
        let (trials, took) = work.each(&condition.label, |trial| {
            let case = Case::new(&self.config(condition, trial))?;
            let follow_one = |entrant: &Entrant| follow(&case, *entrant, condition.rules);
            self.entrants.iter().map(follow_one).collect::<anyhow::Result<Vec<Outcome>>>()
        })?;
        let first = Case::new(&self.config(condition, 0))?;
        let of = |index: usize| -> Vec<&Outcome> { trials.iter().map(|all| &all[index]).collect() };
        let results = self.entrants.iter().enumerate();
        let entrants: Vec<EntrantResult> = results
            .map(|(index, entrant)| EntrantResult::new(*entrant, &of(index), self.seed))
            .collect();
        Ok(ConditionResult {
            label: condition.label.clone(),
            variance_m2: condition.variance_m2,
            took_s: took.as_secs_f64(),
            duels: duels(&entrants),
            sample: Sample::new(&first, &self.entrants, trials.first()),
            entrants,
        })
    }

    /// The trial's own seed, which conditions share: what differs between them is not luck.
    fn config(&self, condition: &Condition, trial: usize) -> SimulatedGmtiConfig {
        let seed = trial_seed(self.seed, trial);
        SimulatedGmtiConfig { seed, ..condition.config.clone() }
    }
}

/// One tracker on one flight; a second time where its right links are those of all plots.
fn follow(case: &Case, entrant: Entrant, rules: Rules) -> anyhow::Result<Outcome> {
    let mut outcome = play(case, entrant.tracker(rules)?.as_mut(), Some(SETTINGS))?;
    if let Some(mut linker) = entrant.linker(rules)? {
        outcome.tally.plot_links = play(case, linker.as_mut(), None)?.tally.links;
    }
    Ok(outcome)
}

fn three(flags: &Flags) -> anyhow::Result<Vec<Condition>> {
    let as_published = Condition {
        label: "variances 8 and 20".to_owned(),
        variance_m2: None,
        config: SimulatedGmtiConfig { preset: Preset::ThreeTargets, ..Default::default() },
        rules: Rules::Own,
    };
    if flags.variances_m2.is_empty() {
        return Ok(vec![as_published]);
    }
    let noise = three_targets().noise;
    flags.variances_m2.iter().map(|stated| with_variance(*stated, &as_published, noise)).collect()
}

fn four(flags: &Flags) -> anyhow::Result<Vec<Condition>> {
    let (rotated, stated) = (flags.rotated, &flags.variances_m2[..]);
    let chosen = if stated.is_empty() { &VARIANCES_M2[..] } else { stated };
    let any = Condition {
        label: String::new(),
        variance_m2: None,
        config: SimulatedGmtiConfig { rotated, ..SimulatedGmtiConfig::default() },
        rules: Rules::Published,
    };
    let noise = four_targets().noise;
    chosen.iter().map(|variance_m2| with_variance(*variance_m2, &any, noise)).collect()
}

/// The condition with this variance of the place on both axes.
///
/// # Errors
/// If the variance makes no sense.
fn with_variance(
    variance_m2: u32,
    condition: &Condition,
    noise: NoiseConfig,
) -> anyhow::Result<Condition> {
    if !(1..=MAX_VARIANCE_M2).contains(&variance_m2) {
        bail!("--variance is {variance_m2}: use 1 to {MAX_VARIANCE_M2} square metres");
    }
    let on_axis_m2 = f64::from(variance_m2);
    let place = PlaceNoise::Ground { along_m2: on_axis_m2, across_m2: on_axis_m2 };
    let noise = Some(NoiseConfig { place, ..noise });
    let turned = if condition.config.rotated { ", rotated" } else { "" };
    Ok(Condition {
        label: format!("variance {variance_m2}{turned}"),
        variance_m2: Some(variance_m2),
        config: SimulatedGmtiConfig { noise, ..condition.config.clone() },
        rules: condition.rules,
    })
}

fn loads(counts: &[usize], spreads: &[Spread]) -> anyhow::Result<Vec<(Spread, usize)>> {
    let chosen = if counts.is_empty() { &LOAD_COUNTS[..] } else { counts };
    let spreads = if spreads.is_empty() { Spread::value_variants() } else { spreads };
    for count in chosen {
        let is_count = (1..=MAX_LOAD_COUNT).contains(count);
        ensure!(is_count, "--targets is {count}: use 1 to {MAX_LOAD_COUNT}");
    }
    let each = |spread: &Spread| chosen.iter().map(|count| (*spread, *count)).collect::<Vec<_>>();
    Ok(spreads.iter().flat_map(each).collect())
}

/// Every trial has a seed of its own.
fn trial_seed(seed: u64, trial: usize) -> u64 {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(trial as u64);
    rng.random()
}

/// What came out under one condition.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct ConditionResult {
    label: String,
    /// On both axes, where the condition is one of several, square metres.
    variance_m2: Option<u32>,
    /// How long all trials took, seconds. Differs from run to run.
    took_s: f64,
    entrants: Vec<EntrantResult>,
    /// Every pair of trackers, trial by trial.
    duels: Vec<Duel>,
    /// The first trial.
    #[serde(skip)]
    sample: Sample,
}
