//! What all commands share that run the chain over recordings: which, how, and side by side.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use clap::ValueEnum;
use indicatif::ProgressBar;
use proto::config::load;
use proto::ids::NodeId;
use proto::process;
use proto::radar::Wall;
use rayon::prelude::*;

use super::{bar, bars};
use crate::config::{AgentConfig, TargetConfig};
use crate::detect::DetectionConfig;
use crate::imaging::wall::WallModel;
use crate::offline::{Job, Options, WallFound, WallSource};
use crate::recording::Recording;
use crate::source::EchoesConfig;

#[derive(Debug, clap::Args)]
pub(super) struct RecordingsFlags {
    /// Recordings of echoes (NPZ or SigMF, see docs/recordings.md), processed side by side.
    #[arg(required = true, value_name = "RECORDING")]
    recordings: Vec<PathBuf>,
    /// Take the settings from an agent's configuration file instead.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Set any key of the settings, such as chain.canceller=none or
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
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum TargetFlag {
    People,
    Points,
}

/// What a command starts from where no configuration file is named.
pub(super) struct Base {
    pub(super) config: AgentConfig,
    pub(super) chain: ChainKind,
}

/// Whose chain a command runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ChainKind {
    /// The best one.
    Own,
    /// The paper's: the wall delays all paths alike, and detection does not depend on what targets
    /// are like.
    Paper,
}

/// What one recording gave.
pub(super) struct Outcome<T> {
    /// For standard output, also of a recording that broke off.
    pub(super) text: String,
    pub(super) result: anyhow::Result<T>,
}

/// A recording that was not processed to its end.
#[derive(serde::Serialize)]
pub(super) struct Failed {
    recording: PathBuf,
    pub(super) error: String,
}

impl RecordingsFlags {
    pub(super) fn are_several(&self) -> bool {
        1 < self.recordings.len()
    }

    /// What is to be said of the wall, if anything.
    pub(super) fn of_wall(&self, wall: Option<&WallFound>) -> String {
        let missing = if self.estimate_wall { "; no wall found" } else { "" };
        wall.map_or_else(|| missing.to_owned(), wall_sentence)
    }

    pub(super) fn has_config(&self) -> bool {
        self.config.is_some()
    }

    /// The settings: the base, or the file's, with what the flags change.
    pub(super) fn settings(&self, base: Base) -> anyhow::Result<AgentConfig> {
        let Base { config, chain } = base;
        let mut config = self.config.as_deref().map(load).transpose()?.unwrap_or(config);
        if let Some(target) = self.target {
            target.apply(&mut config, chain);
        }
        let mut config = proto::config::with_settings(config, &self.settings)?;
        if let (Some(thickness_m), Some(permittivity)) =
            (self.wall_thickness_m, self.wall_permittivity)
        {
            let wall = Wall { thickness_m, permittivity };
            config.chain.wall = match chain {
                ChainKind::Own => WallModel::Refraction(wall),
                ChainKind::Paper => WallModel::FixedDelay(wall),
            };
        }
        Ok(config)
    }

    /// How all recordings are processed with these settings.
    pub(super) fn options(&self, config: &AgentConfig, images: Option<PathBuf>) -> Options {
        let TargetConfig { half_depth_m, half_depth_sigma_m } = config.target;
        let wall = if self.estimate_wall { WallSource::Estimated } else { WallSource::Configured };
        Options { chain: config.chain.clone(), half_depth_m, half_depth_sigma_m, wall, images }
    }

    /// The recordings with their nodes' names, which must differ.
    pub(super) fn jobs(&self) -> anyhow::Result<Vec<Job>> {
        let several = self.are_several();
        ensure!(!several || self.node.is_none(), "--node names one node: give one recording");
        let mut jobs: Vec<Job> = Vec::new();
        for path in &self.recordings {
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

    /// Refuses to write over a recording, and several into one file.
    pub(super) fn check_out(&self, flag: &str, out: Option<&Path>) -> anyhow::Result<()> {
        let Some(out) = out else { return Ok(()) };
        let is_file = out.extension().is_some_and(|ending| ending == "jsonl" || ending == "csv");
        ensure!(
            !self.are_several() || !is_file,
            "{flag} names a file: with several recordings name a folder"
        );
        for recording in &self.recordings {
            let same = out.canonicalize().ok().zip(recording.canonicalize().ok());
            ensure!(
                same.is_none_or(|(a, b)| a != b),
                "{flag} {} is a recording to be read: name another file",
                out.display()
            );
        }
        Ok(())
    }

    /// Where a product of one recording goes: the file, or `NODE.ENDING` in the folder.
    pub(super) fn out_of(
        &self,
        flag: &str,
        out: Option<&Path>,
        name: &str,
    ) -> anyhow::Result<Option<PathBuf>> {
        let Some(out) = out else { return Ok(None) };
        if !self.are_several() && !out.is_dir() {
            return Ok(Some(out.to_owned()));
        }
        std::fs::create_dir_all(out)
            .with_context(|| format!("creating the folder {flag} {}", out.display()))?;
        Ok(Some(out.join(name)))
    }
}

/// Runs all jobs side by side, prints their texts in order, and tells what failed.
pub(super) fn side_by_side<T: Send>(
    jobs: &[Job],
    run: impl Fn(&Job, &ProgressBar) -> Outcome<T> + Sync,
) -> anyhow::Result<(Vec<T>, Vec<Failed>)> {
    let bars = bars();
    let one = |job: &Job| {
        let bar = bars.add(bar());
        bar.set_prefix(job.node.to_string());
        run(job, &bar)
    };
    let outcomes: Vec<Outcome<T>> = jobs.par_iter().map(one).collect();
    let (mut done, mut failed) = (Vec::new(), Vec::new());
    for (job, Outcome { text, result }) in jobs.iter().zip(outcomes) {
        process::print(&text)?;
        let recording = job.echoes.path.clone();
        match result {
            Ok(finished) => done.push(finished),
            Err(error) => failed.push(Failed { recording, error: process::explained(&error) }),
        }
    }
    Ok((done, failed))
}

/// The error of a command of which these recordings failed.
pub(super) fn verdict(failed: &[Failed], job_count: usize) -> anyhow::Result<()> {
    let Some(Failed { error, .. }) = failed.first() else { return Ok(()) };
    bail!("{} of {job_count} recordings failed: {error}", failed.len())
}

/// What is to be said of the wall.
fn wall_sentence(wall: &WallFound) -> String {
    let how = if wall.estimated { "estimated" } else { "assumed" };
    let WallFound { thickness_m, permittivity, .. } = wall;
    let (path_m, sigma_m) = (wall.excess_path_m, wall.excess_path_sigma_m);
    let mut text = format!("; wall {how}: {thickness_m:.3} m, permittivity {permittivity:.2}");
    text += &format!(", excess path {path_m:.3} m, one sigma {sigma_m:.3} m");
    text + &wall.why.as_ref().map_or(String::new(), |why| format!(" ({why})"))
}

impl TargetFlag {
    /// Settles what targets are like.
    fn apply(self, config: &mut AgentConfig, chain: ChainKind) {
        let (half_depth, detection) = match self {
            Self::People => (TargetConfig::default(), DetectionConfig::people()),
            Self::Points => {
                let half_depth = TargetConfig { half_depth_m: 0.0, half_depth_sigma_m: 0.0 };
                (half_depth, DetectionConfig::points())
            }
        };
        config.target = half_depth;
        if chain == ChainKind::Own {
            config.chain.detection = detection;
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
