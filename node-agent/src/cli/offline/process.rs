//! `process`: recorded echoes to points and pictures.

use std::path::PathBuf;

use anyhow::Context;
use clap::ValueEnum;
use indicatif::ProgressBar;
use proto::process;
use tokio_util::sync::CancellationToken;

use super::recordings::{Base, ChainKind, Failed, Outcome, RecordingsFlags, side_by_side, verdict};
use crate::config::{AgentConfig, TargetConfig};
use crate::offline::{
    self, Job, LinesFile, LinesOutput, LinesText, Options, PeriodSink, PointsTable, Processed,
};
use crate::pipeline::ChainConfig;

#[derive(Debug, clap::Args)]
pub(in crate::cli) struct ProcessFlags {
    #[command(flatten)]
    recordings: RecordingsFlags,
    /// The chain: the best one, or exactly the paper's choices.
    #[arg(long, value_enum, default_value = "default", conflicts_with = "config")]
    preset: Preset,
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

/// Processes recordings side by side.
pub(in crate::cli) fn process(
    flags: &ProcessFlags,
    stop: &CancellationToken,
) -> anyhow::Result<()> {
    let ProcessFlags { recordings, images, .. } = flags;
    let options = recordings.options(&recordings.settings(flags.preset.base())?, images.clone());
    recordings.check_out("--out", flags.out.as_deref())?;
    let jobs = recordings.jobs()?;
    let (done, failed) = side_by_side(&jobs, |job, bar| flags.run(job, &options, bar, stop))?;
    flags.print_summary(&done, &failed)?;
    verdict(&failed, jobs.len())
}

impl ProcessFlags {
    fn run(
        &self,
        job: &Job,
        options: &Options,
        bar: &ProgressBar,
        stop: &CancellationToken,
    ) -> Outcome<Processed> {
        let run = |sink: &mut dyn PeriodSink| {
            offline::process(job, options, sink, bar, stop).map_err(anyhow::Error::from)
        };
        let name = format!("{}.jsonl", job.node);
        let out = match self.recordings.out_of("--out", self.out.as_deref(), &name) {
            Ok(out) => out,
            Err(error) => return Outcome { text: String::new(), result: Err(error) },
        };
        if let Some(out) = out {
            let file = LinesFile::create(&out);
            let file = file.with_context(|| format!("creating --out {}", out.display()));
            let result = file.and_then(|mut file| run(&mut file));
            return Outcome { text: String::new(), result };
        }
        if self.json && !self.recordings.are_several() {
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
        text + &self.recordings.of_wall(one.wall.as_ref()) + "\n"
    }
}

impl Preset {
    fn base(self) -> Base {
        match self {
            Self::Default => Base { config: AgentConfig::default(), chain: ChainKind::Own },
            Self::Paper => {
                let config = AgentConfig {
                    chain: ChainConfig::paper(),
                    target: TargetConfig { half_depth_m: 0.0, half_depth_sigma_m: 0.0 },
                    ..AgentConfig::default()
                };
                Base { config, chain: ChainKind::Paper }
            }
        }
    }
}
