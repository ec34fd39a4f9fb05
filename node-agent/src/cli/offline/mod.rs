//! The commands that work on recordings.

mod process;
mod recordings;
mod track;

use std::path::PathBuf;

use indicatif::{MultiProgress, ProgressBar, ProgressStyle};
use tokio_util::sync::CancellationToken;

use super::Flags;
use crate::offline;

pub(super) use process::{ProcessFlags, process};
pub(super) use track::{TrackFlags, track};

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
    proto::process::print(&format!("{count} periods in {}\n", flags.out.display()))
}

fn bars() -> MultiProgress {
    MultiProgress::new()
}

fn bar() -> ProgressBar {
    let template = "{prefix:>8} {bar:24} {pos:>6}/{len} periods, {eta} left";
    let style = ProgressStyle::with_template(template);
    ProgressBar::no_length().with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}
