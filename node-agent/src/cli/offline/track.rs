//! `track`: people followed through recorded echoes.

use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::ValueEnum;
use indicatif::ProgressBar;
use proto::process;
use tokio_util::sync::CancellationToken;

use super::recordings::{Base, ChainKind, Failed, Outcome, RecordingsFlags, side_by_side, verdict};
use crate::config::AgentConfig;
use crate::imaging::backproject::Coherence;
use crate::offline::{
    self, Follower, Job, LinesTo, Options, Outputs, Processed, Tracked, WayOfTrack, true_ways,
};
use crate::tracking::default::BodyModel;
use crate::tracking::{TrackingConfig, TrackingMode};

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct TrackFlags {
    #[command(flatten)]
    recordings: RecordingsFlags,
    /// The tracker: the best one, or the paper's, whose images are weighted by phase coherence; by
    /// default the configuration's, if that has one.
    #[arg(long, value_enum)]
    mode: Option<ModeFlag>,
    /// Tracks as JSON Lines, one per period: a file, or with several recordings a folder.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Tracks as comma-separated values, one row for each: a file, or with several recordings a
    /// folder.
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Where people were, known with what came up to `tracking.default.smoothing_lag_s` after, as
    /// comma-separated values, one row for each person and period: a file, or with several
    /// recordings a folder. Only of the default tracker.
    #[arg(long, value_name = "FILE")]
    smoothed: Option<PathBuf>,
    /// Figures of everybody's ways, smoothed by the default tracker, into this folder:
    /// NODE-ways.svg and NODE-ways.png, with the true ways where
    /// NAME.truth.jsonl is beside the recording.
    #[arg(long, value_name = "DIR")]
    figures: Option<PathBuf>,
    /// The images with templates and ids as an animation: FILE.png (animated PNG) or FILE.gif; with
    /// several recordings FILE-NODE.
    #[arg(long, value_name = "FILE")]
    video: Option<PathBuf>,
    /// Print JSON: the tracks as JSON Lines, or with --out one object of what was done.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum ModeFlag {
    Default,
    Paper,
}

/// One recording and how it is worked on.
struct Plan<'a> {
    job: &'a Job,
    options: &'a Options,
    tracking: &'a TrackingConfig,
}

/// Follows people through recordings side by side.
pub(in crate::cli) fn track(flags: &TrackFlags, stop: &CancellationToken) -> anyhow::Result<()> {
    let recordings = &flags.recordings;
    let config = flags.settings()?;
    let options = recordings.options(&config, None);
    for (flag, out) in [
        ("--out", &flags.out),
        ("--csv", &flags.csv),
        ("--smoothed", &flags.smoothed),
        ("--video", &flags.video),
    ] {
        recordings.check_out(flag, out.as_deref())?;
    }
    let jobs = recordings.jobs()?;
    let run = |job: &Job, bar: &ProgressBar| {
        flags.run(&Plan { job, options: &options, tracking: &config.tracking }, bar, stop)
    };
    let (done, failed) = side_by_side(&jobs, run)?;
    flags.print_summary(&done, &failed)?;
    verdict(&failed, jobs.len())
}

impl TrackFlags {
    /// The settings with a tracker chosen.
    fn settings(&self) -> anyhow::Result<AgentConfig> {
        let mut base = AgentConfig::default();
        if matches!(self.mode, Some(ModeFlag::Paper)) && !self.recordings.has_config() {
            base.chain.coherence = Coherence::Phase;
        }
        let mut config = self.recordings.settings(Base { config: base, chain: ChainKind::Own })?;
        config.tracking.mode = match (self.mode, config.tracking.mode) {
            (Some(ModeFlag::Default), _) | (None, TrackingMode::Off) => TrackingMode::Default,
            (Some(ModeFlag::Paper), _) => TrackingMode::Paper,
            (None, configured) => configured,
        };
        config.tracking.check().context("configuration")?;
        Ok(config)
    }

    fn run(
        &self,
        plan: &Plan<'_>,
        bar: &ProgressBar,
        stop: &CancellationToken,
    ) -> Outcome<Tracked> {
        let mut follower = match self.follower(plan) {
            Ok(follower) => follower,
            Err(error) => return Outcome { text: String::new(), result: Err(error) },
        };
        let Plan { job, options, tracking } = plan;
        let processed = offline::process(job, options, &mut follower, bar, stop);
        let text = String::from_utf8_lossy(follower.text()).into_owned();
        let result = processed.map_err(anyhow::Error::from);
        Outcome { text, result: result.map(|done| follower.tracked(done, tracking.mode)) }
    }

    /// The follower of one recording with its files.
    fn follower(&self, plan: &Plan<'_>) -> anyhow::Result<Follower> {
        let Plan { job, options, tracking } = plan;
        let node = &job.node;
        let out = |flag, out: &Option<PathBuf>, ending: &str| {
            self.recordings.out_of(flag, out.as_deref(), &format!("{node}.{ending}"))
        };
        let lines = match out("--out", &self.out, "jsonl")? {
            Some(path) => LinesTo::File(path),
            None if !self.json => LinesTo::Nowhere,
            None if self.recordings.are_several() => LinesTo::Text,
            None => LinesTo::Output,
        };
        let figure = self.figures.as_ref().map(|folder| folder.join(format!("{node}-ways.svg")));
        let truth = figure.is_some().then(|| true_ways(&job.echoes.path)).transpose()?;
        let outputs = Outputs {
            lines,
            csv: out("--csv", &self.csv, "csv")?,
            smoothed: out("--smoothed", &self.smoothed, "smoothed.csv")?,
            figure,
            video: self.video_of(node.as_str())?,
            true_ways_m: truth.unwrap_or_default(),
        };
        let body = BodyModel::new(options.half_depth_m, &options.chain.detection);
        let tracker = tracking.tracker(body)?.context("no tracker is chosen")?;
        let of_points_m = (options.half_depth_m, options.half_depth_sigma_m);
        let half_depth_m = tracking.half_depth_m(of_points_m);
        Follower::create(node, tracker, half_depth_m, outputs).context("creating a file")
    }

    /// The animation of one recording: the file, or of several `FILE-NODE`.
    fn video_of(&self, node: &str) -> anyhow::Result<Option<PathBuf>> {
        let Some(path) = &self.video else { return Ok(None) };
        if !self.recordings.are_several() {
            return Ok(Some(path.clone()));
        }
        let (stem, ending) = (path.file_stem(), path.extension());
        let (Some(stem), Some(ending)) = (stem, ending) else {
            bail!("--video {}: name a file FILE.png or FILE.gif", path.display());
        };
        let name = format!("{}-{node}.{}", stem.to_string_lossy(), ending.to_string_lossy());
        Ok(Some(path.with_file_name(name)))
    }

    fn print_summary(&self, done: &[Tracked], failed: &[Failed]) -> anyhow::Result<()> {
        if self.json {
            // The lines are the output, and errors go to standard error.
            if self.out.is_none() {
                return Ok(());
            }
            let summary = serde_json::json!({ "recordings": done, "failed": failed });
            return process::print(&format!("{summary}\n"));
        }
        let done = done.iter().map(|one| self.table(one));
        let failed = failed.iter().map(|one| format!("failed: {}\n", one.error));
        process::print(&done.chain(failed).collect::<String>())
    }

    /// What was done with one recording, in words and a row for each person.
    fn table(&self, one: &Tracked) -> String {
        let Tracked { processed, tracks, refused_frames, .. } = one;
        let Processed { node, period_count, warming_up_count, .. } = processed;
        let mut text = format!("{node}: {} people in {period_count} periods", tracks.len());
        if 0 < *warming_up_count {
            text += &format!(", {warming_up_count} of them to learn the background");
        }
        for (reason, count) in refused_frames {
            text += &format!("; {count} frames refused ({reason})");
        }
        text += &self.recordings.of_wall(processed.wall.as_ref());
        text += "\n";
        if !tracks.is_empty() {
            text += "    id    from_s      to_s    seen coasted  begins at x, y    ends at x, y\n";
        }
        for way in tracks {
            text += &row(way);
        }
        text
    }
}

fn row(way: &WayOfTrack) -> String {
    let WayOfTrack { id, first_s, last_s, confirmed_count, coasting_count, .. } = way;
    let [[from_x, from_y], [to_x, to_y]] = [way.first_m, way.last_m];
    format!(
        "{id:>6} {first_s:>9.2} {last_s:>9.2} {confirmed_count:>7} {coasting_count:>7} \
         {from_x:>7.2} {from_y:>7.2} {to_x:>7.2} {to_y:>7.2}\n"
    )
}
