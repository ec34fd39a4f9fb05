//! The command line of the harness.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail, ensure};
use clap::{Parser, Subcommand};
use proto::process;
use tokio_util::sync::CancellationToken;

use crate::montecarlo::{self, Results, Study, carry_out, indoors, mean_shift, wide_area};
use crate::moves::NodeMove;
use crate::plan::merge;
use crate::report::{Report, Summary};
use crate::run::{Options, run, unix_now_s};
use crate::scenario::{Kill, RecordingPlan, Scenario, find, shipped};
use crate::wide_run::{self, WideScenario};

/// Launches a distributed scenario on localhost and scores what comes out.
#[derive(Debug, Parser)]
#[command(name = "sim-harness", version)]
pub struct Arguments {
    #[command(subcommand)]
    action: Action,
    #[command(flatten)]
    process: process::Flags,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Run a scenario: the centre and one process per node, to the end; then score.
    Run(Box<RunFlags>),
    /// Repeat an experiment of a paper many times over: solvers beside the bound and what was
    /// published, or trackers beside what was measured before.
    #[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
    Montecarlo(Box<MonteCarloFlags>),
    /// List the scenarios that come with the program.
    List {
        #[command(flatten)]
        format: Format,
    },
}

#[derive(Debug, clap::Args)]
struct RunFlags {
    /// Name of a shipped scenario, or a scenario file.
    #[arg(default_value = "paper")]
    scenario: String,
    /// Seed of everything random.
    #[arg(long)]
    seed: Option<u64>,
    /// Run this many seeds, one after the other, counting up from the first.
    #[arg(long, default_value_t = 1)]
    seeds: u64,
    /// Seconds of the scene per second.
    #[arg(long)]
    speed: Option<f64>,
    /// Number of periods.
    #[arg(long)]
    periods: Option<u64>,
    /// Solver of the centre: default or swarm.
    #[arg(long)]
    solver: Option<String>,
    /// Folder of a recording: extrinsics.json and one file of detections per node.
    #[arg(long, value_name = "FOLDER")]
    recording: Option<PathBuf>,
    /// Kill a process without warning: WHO@SECONDS, such as centre@2.5, in seconds on the wall (not
    /// of the scene) after the first period; may be repeated.
    #[arg(long = "kill", value_name = "WHO@SECONDS")]
    kills: Vec<Kill>,
    /// Move a node of a simulated scenario: NODE@SECOND:DX,DY,TURN_DEG in scene time and the
    /// world's frame, such as n2@20:0.15,0,3, within the scene's length; may be repeated.
    #[arg(long = "move", value_name = "NODE@SECOND:DX,DY,TURN_DEG")]
    moves: Vec<NodeMove>,
    /// Where the run's files go; a new folder below runs/ if left out.
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    /// Take node-agent and fusion-center from this folder.
    #[arg(long, value_name = "FOLDER")]
    programs: Option<PathBuf>,
    #[command(flatten)]
    format: Format,
}

#[derive(Debug, clap::Args)]
struct MonteCarloFlags {
    #[command(subcommand)]
    other: Option<OtherExperiment>,
    #[command(flatten)]
    figure: Option<montecarlo::Flags>,
    #[command(flatten)]
    output: Output,
}

/// Experiments of other papers than that of the registration.
#[derive(Debug, Subcommand)]
enum OtherExperiment {
    /// The four experiments of the mean-shift paper: two people behind a wall, every tracker on the
    /// same images.
    MeanShift {
        #[command(flatten)]
        experiment: mean_shift::Flags,
        #[command(flatten)]
        output: Output,
    },
    /// A shipped scenario through the real chain and the centre's state machine, without processes:
    /// how well the centre follows the people whom its nodes see.
    Indoors {
        #[command(flatten)]
        experiment: indoors::Flags,
        #[command(flatten)]
        output: Output,
    },
    /// The experiments of the wide-area paper: a few targets on the ground seen from an aircraft, every
    /// tracker on the same flights; and the load that many targets are.
    WideArea {
        #[command(flatten)]
        experiment: wide_area::Flags,
        #[command(flatten)]
        output: Output,
    },
}

/// Where the results of an experiment go.
#[derive(Debug, clap::Args)]
struct Output {
    /// Where table data and pictures go; a new folder below runs/ if left out.
    #[arg(long = "out", value_name = "FOLDER")]
    folder: Option<PathBuf>,
    #[command(flatten)]
    format: Format,
}

/// How results are printed.
#[derive(Clone, Copy, Debug, clap::Args)]
struct Format {
    /// Print JSON instead of tables.
    #[arg(long)]
    json: bool,
}

/// Runs the program that this process was started as. Under the name of an agent or the centre it
/// is that program: so one build has everything that a run launches, and nothing that it launches
/// is ever out of date.
#[must_use]
pub fn main_by_name() -> ExitCode {
    let words: Vec<OsString> = std::env::args_os().collect();
    let name = words.first().and_then(|word| Path::new(word).file_name());
    match name.and_then(|name| name.to_str()) {
        Some("node-agent") => node_agent::cli::main(words),
        Some("fusion-center") => fusion_center::cli::main(words),
        _ => main(words),
    }
}

/// Runs the harness with these arguments, the first of which is its name.
pub fn main(words: impl IntoIterator<Item = OsString>) -> ExitCode {
    process::main(words, async |arguments: Arguments, stop| match &arguments.action {
        Action::List { format } => list(*format),
        Action::Montecarlo(flags) => montecarlo(flags, &stop),
        Action::Run(flags) => run_all(flags, arguments.process.log_filter(), &stop).await,
    })
}

impl process::HasFlags for Arguments {
    fn process_flags(&self) -> &process::Flags {
        &self.process
    }
}

fn list(format: Format) -> anyhow::Result<()> {
    let (scenarios, wide) = (shipped()?, wide_run::shipped()?);
    if format.json {
        let mut all = serde_json::to_value(&scenarios)?;
        if let Some(list) = all.as_array_mut() {
            list.push(serde_json::to_value(&wide)?);
        }
        return process::print(&format!("{}\n", serde_json::to_string_pretty(&all)?));
    }
    let names = scenarios.iter().map(|s| (&s.name, &s.title)).chain([(&wide.name, &wide.title)]);
    process::print(&names.map(|(name, title)| format!("{name:14} {title}\n")).collect::<String>())
}

async fn run_all(
    flags: &RunFlags,
    log_filter: &str,
    stop: &CancellationToken,
) -> anyhow::Result<()> {
    ensure!(0 < flags.seeds, "--seeds is 0: use 1 or more");
    if let Some(scenario) = wide_run::find(&flags.scenario)? {
        return run_wide(flags, scenario, log_filter, stop).await;
    }
    let scenario = flags.scenario()?;
    let folder = new_folder(flags.out.as_deref(), &scenario.name)?;
    let mut reports: Vec<Report> = Vec::new();
    let mut failed_seeds = Vec::new();
    let last_seed =
        scenario.seed.checked_add(flags.seeds - 1).context("--seed plus --seeds is too large")?;
    for seed in scenario.seed..=last_seed {
        let several = 1 < flags.seeds;
        let folder = if several { folder.join(format!("seed-{seed}")) } else { folder.clone() };
        let options = Options { folder: &folder, programs: flags.programs.as_deref(), log_filter };
        let played = run(Scenario { seed, ..scenario.clone() }, &options, stop).await;
        let report = match played {
            Err(error) if several && !stop.is_cancelled() => {
                tracing::error!(seed, "{error:#}");
                failed_seeds.push(seed);
                continue;
            }
            played => played?,
        };
        report.write()?;
        if !flags.format.json {
            process::print(&report.table())?;
        }
        reports.push(report);
    }
    let needed_share = scenario.bounds.seed_share;
    let success = if flags.seeds == 1 {
        reports.first().map(|report| print_one(report, flags.format)).transpose()?.unwrap_or(false)
    } else {
        print_many(Summary::new(reports, failed_seeds, needed_share), &folder, flags.format)?
    };
    ensure!(success, "not every node that can be registered was registered within the bounds");
    Ok(())
}

/// Runs a scenario of wide-area radars once.
async fn run_wide(
    flags: &RunFlags,
    mut scenario: WideScenario,
    log_filter: &str,
    stop: &CancellationToken,
) -> anyhow::Result<()> {
    let useless = [
        ("--seeds", 1 < flags.seeds),
        ("--periods", flags.periods.is_some()),
        ("--solver", flags.solver.is_some()),
        ("--recording", flags.recording.is_some()),
        ("--move", !flags.moves.is_empty()),
    ];
    let given = useless.iter().find(|(_, is_given)| *is_given);
    if let Some((flag, _)) = given {
        bail!("{flag} has no effect on {}, a scenario of wide-area radars", scenario.name);
    }
    scenario.seed = flags.seed.unwrap_or(scenario.seed);
    scenario.speed = flags.speed.unwrap_or(scenario.speed);
    scenario.kills.extend(flags.kills.iter().cloned());
    scenario.kills.sort_by_key(|kill| kill.after_ms);
    let folder = new_folder(flags.out.as_deref(), &scenario.name)?;
    let options = Options { folder: &folder, programs: flags.programs.as_deref(), log_filter };
    let report = wide_run::run(scenario, &options, stop).await?;
    let json = || Ok::<_, serde_json::Error>(serde_json::to_string(&report)? + "\n");
    process::print(&if flags.format.json { json()? } else { report.table() })?;
    ensure!(report.success, "the map is not within the bounds");
    Ok(())
}

fn montecarlo(flags: &MonteCarloFlags, stop: &CancellationToken) -> anyhow::Result<()> {
    match &flags.other {
        Some(OtherExperiment::MeanShift { experiment, output }) => {
            output.fill::<mean_shift::Experiment>(experiment, stop)
        }
        Some(OtherExperiment::Indoors { experiment, output }) => {
            output.fill::<indoors::Experiment>(experiment, stop)
        }
        Some(OtherExperiment::WideArea { experiment, output }) => {
            output.fill::<wide_area::Experiment>(experiment, stop)
        }
        None => {
            let missing = "name a figure, such as fig6, or mean-shift, indoors or wide-area";
            let figure = flags.figure.as_ref().context(missing)?;
            flags.output.fill::<montecarlo::Experiment>(figure, stop)
        }
    }
}

impl Output {
    /// Carries an experiment out, leaves its results in the folder and prints them.
    fn fill<S: Study>(&self, flags: &S::Flags, stop: &CancellationToken) -> anyhow::Result<()> {
        let study = S::new(flags)?;
        let folder = new_folder(self.folder.as_deref(), &study.name())?;
        // Signals come on a thread of their own: nothing else waits for this one.
        let report = carry_out(&study, &folder, stop)?;
        let tables = || format!("{}files in {}\n", report.table(), folder.display());
        process::print(&if self.format.json { report.json()? + "\n" } else { tables() })
    }
}

fn print_one(report: &Report, format: Format) -> anyhow::Result<bool> {
    if format.json {
        process::print(&format!("{}\n", serde_json::to_string(report)?))?;
    }
    Ok(report.success)
}

fn print_many(summary: Summary, folder: &Path, format: Format) -> anyhow::Result<bool> {
    std::fs::write(folder.join("summary.json"), serde_json::to_string_pretty(&summary)?)?;
    let text = if format.json { serde_json::to_string(&summary)? + "\n" } else { summary.line() };
    process::print(&text)?;
    Ok(summary.success)
}

impl RunFlags {
    /// The scenario with the flags put over it.
    fn scenario(&self) -> anyhow::Result<Scenario> {
        let mut scenario = find(&self.scenario)?;
        scenario.seed = self.seed.unwrap_or(scenario.seed);
        scenario.speed = self.speed.unwrap_or(scenario.speed);
        scenario.period_count = self.periods.or(scenario.period_count);
        if let Some(folder) = &self.recording {
            scenario.recording = Some(RecordingPlan { folder: folder.clone(), first_s: None });
        }
        if let Some(solver) = &self.solver {
            let kind = toml::Table::from_iter([("kind".to_owned(), solver.clone().into())]);
            let centre = toml::Table::from_iter([("solver".to_owned(), kind.into())]);
            merge(&mut scenario.centre, &centre);
        }
        scenario.kills.extend(self.kills.iter().cloned());
        scenario.moves.extend(self.moves.iter().cloned());
        scenario.kills.sort_by_key(|kill| kill.after_ms);
        scenario.resolve()
    }
}

/// The folder that was named, or a new one below `runs/`; it must be empty.
fn new_folder(named: Option<&Path>, what: &str) -> anyhow::Result<PathBuf> {
    let folder = named.map_or_else(
        || Path::new("runs").join(format!("{what}-{:.0}", unix_now_s() * 1e3)),
        Path::to_owned,
    );
    ensure!(!folder.is_file(), "--out {}: it is a file; name a folder", folder.display());
    let fresh = !folder.exists()
        || std::fs::read_dir(&folder).is_ok_and(|mut entries| entries.next().is_none());
    ensure!(fresh, "--out {}: the folder is not empty; choose a new one", folder.display());
    std::fs::create_dir_all(&folder).with_context(|| format!("creating {}", folder.display()))?;
    let path = folder.canonicalize();
    path.with_context(|| folder.display().to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(words: &str) -> Result<MonteCarloFlags, String> {
        let words = ["sim-harness", "montecarlo"].into_iter().chain(words.split_whitespace());
        let arguments = Arguments::try_parse_from(words).map_err(|error| error.to_string())?;
        match arguments.action {
            Action::Montecarlo(flags) => Ok(*flags),
            other => Err(format!("{other:?}")),
        }
    }

    #[test]
    fn figures_and_experiments_have_flags_of_their_own() {
        let figure = parsed("fig6 --trials 3 --json --out f").unwrap();
        assert!(figure.other.is_none() && figure.figure.is_some() && figure.output.format.json);
        assert_eq!(figure.output.folder, Some(PathBuf::from("f")));
        let flags = parsed("mean-shift --experiment 1,3 --trackers paper --json --out f").unwrap();
        let Some(OtherExperiment::MeanShift { output, .. }) = flags.other else { panic!("no") };
        assert!(output.format.json && flags.figure.is_none());
        assert_eq!(output.folder, Some(PathBuf::from("f")));
        let wide =
            "wide-area --scenario four-targets --variance 100,400 --rotated --modes nn --json";
        let Some(OtherExperiment::WideArea { output: wide_output, .. }) =
            parsed(wide).unwrap().other
        else {
            panic!("no")
        };
        assert!(wide_output.format.json);
        assert!(parsed("wide-area --variance many").unwrap_err().contains("--variance"));
        assert!(parsed("mean-shift --solvers default").unwrap_err().contains("--solvers"));
        assert!(parsed("fig6 --trackers paper").unwrap_err().contains("--trackers"));
        assert!(parsed("fig6 mean-shift").is_err());
        assert!(parsed("").is_err());
        assert!(parsed("fig8").unwrap_err().contains("fig10"));
    }
}
