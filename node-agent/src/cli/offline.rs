//! The commands that work on recordings.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use clap::ValueEnum;
use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use proto::config::load;
use proto::ids::NodeId;
use proto::process;
use proto::radar::Wall;
use rayon::prelude::*;
use tokio_util::sync::CancellationToken;

use super::Flags;
use crate::config::{AgentConfig, TargetConfig};
use crate::detect::DetectionConfig;
use crate::imaging::wall::WallModel;
use crate::offline::{
    self, Job, LinesFile, LinesOutput, LinesText, Options, PeriodSink, PointsTable, Processed,
    WallFound, WallSource,
};
use crate::pipeline::ChainConfig;
use crate::recording::Recording;
use crate::source::EchoesConfig;

#[derive(Debug, clap::Args)]
pub(super) struct ProcessFlags {
    /// Recordings of echoes (NPZ or SigMF, see docs/recordings.md), processed side by side.
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// The chain: the best one, or exactly the paper's choices.
    #[arg(long, value_enum, default_value = "default", conflicts_with = "config")]
    preset: Preset,
    /// Take [chain] and [target] from an agent's configuration file instead.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Set any key of [chain] and [target], such as chain.canceller=none or
    /// 'chain.canceller={exponential={time_constant_s=2.0}}'; band and array are the recording's; may
    /// be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<String>,
    /// Thickness of the wall before the array.
    #[arg(long, value_name = "D", requires = "wall_permittivity")]
    wall_thickness_m: Option<f64>,
    /// Relative permittivity of that wall.
    #[arg(long, value_name = "E", requires = "wall_thickness_m")]
    wall_permittivity: Option<f64>,
    /// Estimate the wall from its own echoes in the recording, where they tell it.
    #[arg(long, conflicts_with = "wall_thickness_m")]
    estimate_wall: bool,
    /// What targets are like: extended people (the default), or points.
    #[arg(long, value_enum)]
    target: Option<TargetFlag>,
    /// The recordings have the phase convention exp(+j 2 pi f tau).
    #[arg(long)]
    conjugate: bool,
    /// Read only this many periods.
    #[arg(long, value_name = "N")]
    periods: Option<u64>,
    /// Name of the node in the output; by default the recording's own, or its file's name.
    #[arg(long)]
    node: Option<NodeId>,
    /// Points as JSON Lines: a file, or with several recordings a folder for one file each.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Images as PNG, one per period, into this folder.
    #[arg(long, value_name = "DIR")]
    images: Option<PathBuf>,
    /// Print JSON: the points as JSON Lines, or with --out one object of what was done.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Preset {
    Default,
    Paper,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum TargetFlag {
    People,
    Points,
}

#[derive(Debug, clap::Args)]
pub(super) struct RecordFlags {
    /// The recording to write: NAME.npz or NAME.sigmf-meta. The truth of a simulated scene goes to
    /// NAME.truth.jsonl.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Number of periods; all of the source if left out.
    #[arg(long, value_name = "N")]
    periods: Option<u64>,
    #[command(flatten)]
    flags: Flags,
}

/// Records the configured source.
pub(super) fn record(flags: &RecordFlags, stop: &CancellationToken) -> anyhow::Result<()> {
    let opened = flags.flags.configuration()?.open_source()?;
    let bar = bars().add(bar());
    let count = offline::record(opened, &flags.out, flags.periods, &bar, stop)?;
    process::print(&format!("{count} periods in {}\n", flags.out.display()))
}

/// Processes recordings side by side.
pub(super) fn process(flags: &ProcessFlags, stop: &CancellationToken) -> anyhow::Result<()> {
    let options = flags.options()?;
    let jobs = flags.jobs()?;
    let bars = bars();
    let run = |job: &Job| flags.run(job, &options, &bars.add(bar()), stop);
    let outcomes: Vec<Outcome> = jobs.par_iter().map(run).collect();
    let mut done = Vec::new();
    let mut failed = Vec::new();
    for (job, Outcome { text, result }) in jobs.iter().zip(outcomes) {
        process::print(&text)?;
        let recording = job.echoes.path.clone();
        match result {
            Ok(processed) => done.push(processed),
            Err(error) => failed.push(Failed { recording, error: process::explained(&error) }),
        }
    }
    flags.print_summary(&done, &failed)?;
    let Some(Failed { error, .. }) = failed.first() else { return Ok(()) };
    bail!("{} of {} recordings failed: {error}", failed.len(), jobs.len())
}

/// What one recording gave.
struct Outcome {
    /// For standard output, also of a recording that broke off.
    text: String,
    result: anyhow::Result<Processed>,
}

/// A recording that was not processed to its end.
#[derive(serde::Serialize)]
struct Failed {
    recording: PathBuf,
    error: String,
}

impl ProcessFlags {
    /// How all recordings are processed.
    fn options(&self) -> anyhow::Result<Options> {
        let mut base: AgentConfig = match &self.config {
            Some(path) => load(path)?,
            None => self.preset.config(),
        };
        if let Some(target) = self.target {
            self.expect(target, &mut base);
        }
        let AgentConfig { mut chain, target, .. } =
            proto::config::with_settings(base, &self.settings)?;
        if let (Some(thickness_m), Some(permittivity)) =
            (self.wall_thickness_m, self.wall_permittivity)
        {
            let wall = Wall { thickness_m, permittivity };
            chain.wall = match self.preset {
                Preset::Default => WallModel::Refraction(wall),
                Preset::Paper => WallModel::FixedDelay(wall),
            };
        }
        let TargetConfig { half_depth_m, half_depth_sigma_m } = target;
        let wall = if self.estimate_wall { WallSource::Estimated } else { WallSource::Configured };
        Ok(Options { chain, half_depth_m, half_depth_sigma_m, wall, images: self.images.clone() })
    }

    /// Settles what targets are like; how the paper detects does not depend on it.
    fn expect(&self, target: TargetFlag, config: &mut AgentConfig) {
        let (half_depth, detection) = match target {
            TargetFlag::People => (TargetConfig::default(), DetectionConfig::people()),
            TargetFlag::Points => {
                let half_depth = TargetConfig { half_depth_m: 0.0, half_depth_sigma_m: 0.0 };
                (half_depth, DetectionConfig::points())
            }
        };
        config.target = half_depth;
        if matches!(self.preset, Preset::Default) {
            config.chain.detection = detection;
        }
    }

    /// The recordings with their nodes' names, which must differ.
    fn jobs(&self) -> anyhow::Result<Vec<Job>> {
        let several = 1 < self.recordings.len();
        ensure!(!several || self.node.is_none(), "--node names one node: give one recording");
        let is_file = |out: &PathBuf| out.extension().is_some_and(|ending| ending == "jsonl");
        ensure!(
            !several || !self.out.as_ref().is_some_and(is_file),
            "--out names a file: with several recordings name a folder"
        );
        let mut jobs: Vec<Job> = Vec::new();
        for path in &self.recordings {
            self.check_not_input(path)?;
            let is_free = |node: &NodeId| jobs.iter().all(|job| job.node != *node);
            let names = [self.node.clone(), own_name(path), file_name(path)];
            let node = names.into_iter().flatten().find(is_free);
            let numbered = (1..).filter_map(|number: usize| format!("node-{number}").parse().ok());
            let node = node.or_else(|| numbered.into_iter().find(is_free)).context("a name")?;
            let (conjugate, period_count) = (self.conjugate, self.periods);
            let echoes = EchoesConfig { path: path.clone(), conjugate, period_count };
            jobs.push(Job { echoes, node });
        }
        Ok(jobs)
    }

    /// Refuses to write over a recording.
    fn check_not_input(&self, recording: &Path) -> anyhow::Result<()> {
        let Some(out) = &self.out else { return Ok(()) };
        let same = out.canonicalize().ok().zip(recording.canonicalize().ok());
        ensure!(
            same.is_none_or(|(a, b)| a != b),
            "--out {} is a recording to be read: name another file",
            out.display()
        );
        Ok(())
    }

    fn run(
        &self,
        job: &Job,
        options: &Options,
        bar: &ProgressBar,
        stop: &CancellationToken,
    ) -> Outcome {
        bar.set_prefix(job.node.to_string());
        let run = |sink: &mut dyn PeriodSink| {
            offline::process(job, options, sink, bar, stop).map_err(anyhow::Error::from)
        };
        let out = match self.out_of(job) {
            Ok(out) => out,
            Err(error) => return Outcome { text: String::new(), result: Err(error) },
        };
        if let Some(out) = out {
            let file = LinesFile::create(&out);
            let file = file.with_context(|| format!("creating --out {}", out.display()));
            let result = file.and_then(|mut file| run(&mut file));
            return Outcome { text: String::new(), result };
        }
        if self.json && self.recordings.len() == 1 {
            return Outcome { text: String::new(), result: run(&mut LinesOutput) };
        }
        if self.json {
            let mut lines = LinesText::default();
            let result = run(&mut lines);
            return Outcome { text: String::from_utf8_lossy(&lines.text).into_owned(), result };
        }
        let mut table = PointsTable::default();
        let result = run(&mut table);
        Outcome { text: table.text, result }
    }

    /// Where the lines of a recording go.
    fn out_of(&self, job: &Job) -> anyhow::Result<Option<PathBuf>> {
        let Some(out) = &self.out else { return Ok(None) };
        if self.recordings.len() == 1 && !out.is_dir() {
            return Ok(Some(out.clone()));
        }
        std::fs::create_dir_all(out)
            .with_context(|| format!("creating the folder --out {}", out.display()))?;
        Ok(Some(out.join(format!("{}.jsonl", job.node))))
    }

    fn print_summary(&self, done: &[Processed], failed: &[Failed]) -> anyhow::Result<()> {
        if self.json {
            // The lines are the output, and errors go to standard error.
            if self.out.is_none() {
                return Ok(());
            }
            let summary = serde_json::json!({ "recordings": done, "failed": failed });
            return process::print(&format!("{summary}\n"));
        }
        let done = done.iter().map(|one| self.sentence(one));
        let failed = failed.iter().map(|one| format!("failed: {}\n", one.error));
        process::print(&done.chain(failed).collect::<String>())
    }

    /// What was done with one recording, in words.
    fn sentence(&self, one: &Processed) -> String {
        let Processed { node, period_count, point_count, warming_up_count, .. } = one;
        let mut text = format!("{node}: {point_count} points in {period_count} periods");
        if 0 < *warming_up_count {
            text += &format!(", {warming_up_count} of them to learn the background");
        }
        if warming_up_count == period_count {
            text += ": give the recording a background array, or set chain.canceller=none";
        }
        if one.own_background {
            text += ", with the recording's own background";
        }
        if one.times_assumed {
            text += "; it states no times, 0.1 s per period assumed";
        }
        match &one.wall {
            None if self.estimate_wall => text += "; no wall found",
            None => {}
            Some(wall) => {
                let how = if wall.estimated { "estimated" } else { "assumed" };
                let WallFound { thickness_m, permittivity, .. } = wall;
                let (path_m, sigma_m) = (wall.excess_path_m, wall.excess_path_sigma_m);
                text +=
                    &format!("; wall {how}: {thickness_m:.3} m, permittivity {permittivity:.2}");
                text += &format!(", excess path {path_m:.3} m, one sigma {sigma_m:.3} m");
                text += &wall.why.as_ref().map_or(String::new(), |why| format!(" ({why})"));
            }
        }
        text + "\n"
    }
}

impl Preset {
    fn config(self) -> AgentConfig {
        match self {
            Self::Default => AgentConfig::default(),
            Self::Paper => AgentConfig {
                chain: ChainConfig::paper(),
                target: TargetConfig { half_depth_m: 0.0, half_depth_sigma_m: 0.0 },
                ..AgentConfig::default()
            },
        }
    }
}

/// The name that a recording has for its node. A recording that cannot be opened is named when it is
/// processed; the others go on.
fn own_name(path: &Path) -> Option<NodeId> {
    Recording::open(path).ok()?.header().node.clone()?.parse().ok()
}

/// A node's name made of a file's.
fn file_name(path: &Path) -> Option<NodeId> {
    let stem = path.file_stem()?.to_string_lossy().to_lowercase();
    let name: String =
        stem.chars().map(|c| if c.is_ascii_alphanumeric() { c } else { '-' }).take(32).collect();
    name.trim_matches('-').parse().ok()
}

fn bars() -> MultiProgress {
    MultiProgress::new()
}

fn bar() -> ProgressBar {
    let template = "{prefix:>8} {bar:24} {pos:>6}/{len} periods, {eta} left";
    let style = ProgressStyle::with_template(template);
    ProgressBar::no_length().with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}
