//! The experiments of \[registration\] as commands: many seeded trials, every solver on the same
//! data, the bound, and what was published.
//!
//! ```text
//! seeds ─ points drawn | echoes ─ chain ─► Case ─ every solver ─► TrialScore ─► MethodScore ─► table, JSON, curves
//! ```

use std::time::Duration;

use anyhow::{bail, ensure};
use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressStyle};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use serde::Serialize;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tracing::info;

use crate::scenario::{Scenario, find};

mod bound;
mod echoes;
pub(crate) mod indoors;
pub(crate) mod mean_shift;
mod picture;
mod report;
mod score;
mod sheet;
mod solvers;
mod statistics;
mod study;
#[cfg(test)]
mod tests;
mod trials;
pub(crate) mod wide_area;

use echoes::Stage;
pub(crate) use report::Report;
use score::{MethodScore, PoseError, Reach, TrialScore};
use solvers::Entrant;
pub(crate) use study::{Results, Study, carry_out};
use trials::{Case, Seeds};

/// Trials of a simulated figure \[registration, section 3\].
const SIMULATED_TRIAL_COUNT: usize = 500;
/// Runs of the measured figure \[registration, section 4\].
const MEASURED_TRIAL_COUNT: usize = 20;
/// Periods of the measured figure.
const MEASURED_PERIOD_COUNT: u64 = 18;
/// Errors drawn from the bound for each trial: the bound's curve is then surer than any solver's.
const BOUND_DRAW_COUNT: usize = 10;
/// More trials than anyone waits for.
const MAX_TRIAL_COUNT: usize = 1_000_000;

/// Which figure of the paper.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Figure {
    /// Errors without and with misses and false points.
    Fig6,
    /// Errors beside those of graph matching.
    Fig7,
    /// The measured room, simulated.
    Fig10,
}

/// At what level trials are simulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Level {
    /// Points with errors of known covariance.
    Points,
    /// Echoes with noise, through an agent's whole chain.
    Echoes,
}

/// An experiment of the paper.
#[derive(Debug, clap::Args)]
pub(crate) struct Flags {
    /// Which figure.
    #[arg(value_enum)]
    pub(crate) figure: Figure,
    /// Number of trials per condition: 500, for fig10 20, if left out.
    #[arg(long)]
    pub(crate) trials: Option<usize>,
    /// What is simulated: points, or echoes through the whole chain; fig10 only has echoes.
    #[arg(long, value_enum)]
    pub(crate) level: Option<Level>,
    /// Scenario of the echoes: paper, paper-physical, or a file; for fig10 measured-room.
    #[arg(long)]
    pub(crate) scenario: Option<String>,
    /// Seed of everything random.
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Solvers to compare, by the names of the centre's configuration; swarm:100 for 100 particles.
    #[arg(long, value_delimiter = ',')]
    pub(crate) solvers: Vec<String>,
}

/// Under what trials are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Condition {
    label: &'static str,
    /// Chance that a node sees a target in a period.
    detection_probability: f64,
    /// Chance of a false point per node and period.
    false_probability: f64,
    /// The scenario's own values hold instead of these.
    #[serde(skip)]
    is_of_scenario: bool,
    /// What the paper states.
    published: &'static str,
}

/// The three conditions of figure 6.
const CONDITIONS: [Condition; 3] = [
    Condition {
        label: "none missed",
        detection_probability: 1.0,
        false_probability: 0.0,
        is_of_scenario: false,
        published: "swarm J = 500: box > 0.90; J = 100 worse",
    },
    Condition {
        label: "PD 0.8",
        detection_probability: 0.8,
        false_probability: 0.0,
        is_of_scenario: false,
        published: "swarm J = 500: box > 0.90; J = 100 worse",
    },
    Condition {
        label: "PD 0.8, 10 % false",
        detection_probability: 0.8,
        false_probability: 0.1,
        is_of_scenario: false,
        published: "swarm J = 500: box > 0.90; J = 100 worse",
    },
];
const GRAPH_CONDITION: Condition = Condition {
    published: "swarm J = 500 better than graph matching, J = 100 slightly worse",
    ..CONDITIONS[0]
};
const ROOM_CONDITION: Condition = Condition {
    label: "measured room",
    is_of_scenario: true,
    published: "swarm: mean 0.19 m and 3.15 deg; graph matching cannot run",
    ..CONDITIONS[0]
};

/// What is to be done.
pub(crate) struct Experiment {
    figure: Figure,
    level: Level,
    trial_count: usize,
    seed: u64,
    conditions: Vec<Condition>,
    entrants: Vec<Entrant>,
    /// Of the echoes.
    scenario: Option<Scenario>,
}

impl Study for Experiment {
    type Flags = Flags;
    type Report = Report;

    fn new(flags: &Flags) -> anyhow::Result<Self> {
        let Flags { figure, seed, .. } = *flags;
        let is_room = figure == Figure::Fig10;
        let level = flags.level.unwrap_or(if is_room { Level::Echoes } else { Level::Points });
        if is_room && level == Level::Points {
            bail!("--level points: fig10 is people behind walls; use --level echoes");
        }
        let usual_count = if is_room { MEASURED_TRIAL_COUNT } else { SIMULATED_TRIAL_COUNT };
        let trial_count = flags.trials.unwrap_or(usual_count);
        ensure!(
            (1..=MAX_TRIAL_COUNT).contains(&trial_count),
            "--trials is {trial_count}: use 1 to {MAX_TRIAL_COUNT}"
        );
        let usual_scenario = if is_room { "measured-room" } else { "paper" };
        let scenario = match (level, flags.scenario.as_deref()) {
            (Level::Points, Some(name)) => {
                bail!("--scenario {name}: points have no scenario; add --level echoes")
            }
            (Level::Points, None) => None,
            (Level::Echoes, name) => Some(find(name.unwrap_or(usual_scenario))?.resolve()?),
        };
        let usual = solvers::usual(figure);
        let names = if flags.solvers.is_empty() { &usual } else { &flags.solvers };
        let conditions = match figure {
            Figure::Fig6 => CONDITIONS.to_vec(),
            Figure::Fig7 => vec![GRAPH_CONDITION],
            Figure::Fig10 => vec![ROOM_CONDITION],
        };
        let entrants = names.iter().map(|name| Entrant::of(name)).collect::<anyhow::Result<_>>()?;
        Ok(Self { figure, level, trial_count, seed, conditions, entrants, scenario })
    }

    fn name(&self) -> String {
        let figure = match self.figure {
            Figure::Fig6 => "fig6",
            Figure::Fig7 => "fig7",
            Figure::Fig10 => "fig10",
        };
        let kind = self.scenario.as_ref().map_or("points", |scenario| scenario.name.as_str());
        format!("{figure}-{kind}")
    }

    fn run(&self, stop: &CancellationToken) -> anyhow::Result<Report> {
        let started = Instant::now();
        let results = self.conditions.iter().map(|condition| self.run_condition(condition, stop));
        let results = results.collect::<anyhow::Result<_>>()?;
        Ok(Report {
            figure: self.figure,
            level: self.level,
            scenario: self.scenario.as_ref().map(|scenario| scenario.name.clone()),
            seed: self.seed,
            trial_count: self.trial_count,
            reach: self.reach(),
            conditions: results,
            elapsed_s: started.elapsed().as_secs_f64(),
        })
    }
}

impl Experiment {
    /// Up to where curves are drawn: the box lies well inside.
    fn reach(&self) -> Reach {
        let name = self.scenario.as_ref().map_or("paper", |scenario| scenario.name.as_str());
        match name {
            "paper" => Reach { position_m: 0.15, angle_deg: 2.0 },
            _ => Reach { position_m: 0.5, angle_deg: 6.0 },
        }
    }

    fn run_condition(
        &self,
        condition: &Condition,
        stop: &CancellationToken,
    ) -> anyhow::Result<ConditionResult> {
        let work = Work { count: self.trial_count, label: condition.label, stop };
        let (cases, simulated) = self.cases(condition, &work)?;
        let mut methods = vec![self.bound_score(&cases)];
        for Entrant { name, solver } in &self.entrants {
            let (trials, took) = work.each(name, |trial| {
                let case = &cases[trial];
                Ok(TrialScore::new(case, &solver.solve(&case.problem, None)))
            })?;
            let solve_ms = processor_time(took).as_secs_f64() * 1e3 / self.trial_count as f64;
            info!(condition = condition.label, method = name.as_str(), solve_ms, "solved");
            methods.push(MethodScore::of_solver(name, trials, solve_ms, self.reach()));
        }
        if cases.iter().all(|case| case.bound.is_none()) {
            methods.remove(0);
        }
        let point_count = |of: fn(&fusion_center::registration::Period) -> usize| {
            let periods = || cases.iter().flat_map(|case| &case.problem.periods);
            periods().map(of).sum::<usize>() as f64 / (periods().count() as f64).max(1.0)
        };
        Ok(ConditionResult {
            condition: *condition,
            points_per_period: [point_count(|p| p.in_ref.len()), point_count(|p| p.in_node.len())],
            simulate_s: simulated.as_secs_f64(),
            methods,
        })
    }

    /// The data of all trials, the same for every solver.
    fn cases(
        &self,
        condition: &Condition,
        work: &Work<'_>,
    ) -> anyhow::Result<(Vec<Case>, Duration)> {
        let seeds = |trial| Seeds::new(self.seed, trial);
        let Some(scenario) = &self.scenario else {
            return work.each("points", |trial| Ok(trials::of_points(condition, &seeds(trial))));
        };
        let counted = (self.figure == Figure::Fig10).then_some(MEASURED_PERIOD_COUNT);
        let stage = Stage::new(scenario, condition, counted)?;
        work.each("echoes", |trial| stage.case(&seeds(trial)))
    }

    fn bound_score(&self, cases: &[Case]) -> MethodScore {
        let of_case = |(trial, case): (usize, &Case)| -> Vec<Option<PoseError>> {
            let drawn = case.bound.map(|bound| {
                let seed = Seeds::new(self.seed, trial).bound;
                bound::efficient_errors(&bound, seed, BOUND_DRAW_COUNT)
            });
            let drawn: Vec<_> = drawn.unwrap_or_default().into_iter().map(Some).collect();
            if drawn.is_empty() { vec![None; BOUND_DRAW_COUNT] } else { drawn }
        };
        let errors: Vec<Option<PoseError>> = cases.iter().enumerate().flat_map(of_case).collect();
        MethodScore::of_errors("bound", &errors, self.reach())
    }
}

/// What came out under one condition.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct ConditionResult {
    condition: Condition,
    /// Points of the reference side and of the node, on average.
    points_per_period: [f64; 2],
    /// How long it took to simulate all trials, seconds. Differs from run to run.
    simulate_s: f64,
    /// The bound, where it is known, then the solvers.
    methods: Vec<MethodScore>,
}

/// Trials to be done, shared by all processors.
struct Work<'a> {
    count: usize,
    label: &'static str,
    stop: &'a CancellationToken,
}

impl Work<'_> {
    /// The results of all trials in their order, whatever thread did them, and how long it took.
    fn each<T: Send>(
        &self,
        what: &str,
        one: impl Fn(usize) -> anyhow::Result<T> + Sync,
    ) -> anyhow::Result<(Vec<T>, Duration)> {
        let bar = ProgressBar::new(self.count as u64);
        let template = "{prefix:>32} {bar:24} {pos:>5}/{len} trials  {eta} left";
        if let Ok(style) = ProgressStyle::with_template(template) {
            bar.set_style(style);
        }
        bar.set_prefix(format!("{}: {what}", self.label));
        let started = Instant::now();
        let results = (0..self.count).into_par_iter().map(|trial| {
            ensure!(!self.stop.is_cancelled(), "stopped before the end");
            let result = one(trial);
            bar.inc(1);
            result
        });
        let results: anyhow::Result<Vec<T>> = results.collect();
        bar.finish_and_clear();
        Ok((results?, started.elapsed()))
    }
}

/// The time of all processors while `wall` went by.
fn processor_time(wall: Duration) -> Duration {
    wall * u32::try_from(rayon::current_num_threads()).unwrap_or(1)
}
