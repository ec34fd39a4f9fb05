//! `fusion-center track`: plots of wide-area radars from a file or pipe to tracks, without a network.
//!
//! ```text
//! file, capture or pipe ── Input ── Reorder ── Follower ── Step ──┬── JSON Lines as they settle
//!                                                                 └── table, files, map at the end
//! ```

mod files;
mod step;
mod summary;
#[cfg(test)]
mod tests;

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use indicatif::{ProgressBar, ProgressStyle};
use proto::ids::{BootId, NodeId};
use proto::plots::{Damage, Format, Input, Naming, Scan};
use proto::process;
use proto::refusals::Refusals;
use proto::time::CentreTime;
use tokio_util::sync::CancellationToken;

pub use files::Files;

use crate::map::reorder::{Offer, Origin, Reorder};
use crate::map::{Follower, Ground, MapConfig, leapt, node_of, unplaced};
use files::Kept;
use step::Step;
use summary::Summary;

/// What is asked for.
#[derive(Clone, Debug, Default)]
pub struct TrackOptions {
    /// STANAG 4607, a capture of it, CSV or JSON Lines; `-` for standard input.
    pub input: PathBuf,
    /// What the input is, if its content does not say it.
    pub format: Option<Format>,
    /// Print JSON Lines instead of a table.
    pub json: bool,
    /// Steps of tentative tracks count too.
    pub tentative: bool,
    /// Files to write.
    pub files: Files,
}

/// Follows the plots of the input and prints the tracks.
///
/// # Errors
/// If the input cannot be read, if `stop` was called before its end, or in the end if any part of it
/// had to be left out. What was settled by then is printed.
pub async fn track(
    options: TrackOptions,
    config: MapConfig,
    stop: &CancellationToken,
) -> anyhow::Result<()> {
    let name = name_of(&options.input);
    let token = stop.clone();
    let work = tokio::task::spawn_blocking(move || work(&options, &config, &token));
    tokio::select! {
        biased;
        done = work => done.context("following the plots")?,
        () = stop.cancelled() => {
            bail!("stopped before the end of {name}: what was printed is complete")
        }
    }
}

fn work(
    options: &TrackOptions,
    config: &MapConfig,
    stop: &CancellationToken,
) -> anyhow::Result<()> {
    options.files.prepare(&options.input)?;
    let (from, bar) = open(&options.input)?;
    let name = name_of(&options.input);
    let fallback = NodeId::try_from("sensor".to_owned())?;
    let mut input = Input::open(from, &name, options.format, Naming::Own(fallback))?;
    let mut run = Run::new(options, config, name)?;
    let mut found = Vec::new();
    let ended = loop {
        if stop.is_cancelled() {
            bail!("stopped before the end of {}", run.name);
        }
        let advanced = input.advance(&mut found);
        run.take(&mut found)?;
        if !run.is_read && !options.files.is_any() {
            return Ok(());
        }
        bar.set_message(format!("{} dwells", run.summary.dwell_count));
        match advanced {
            Ok(true) => {}
            Ok(false) => break Ok(()),
            Err(fault) => break Err(fault),
        }
    };
    bar.finish_and_clear();
    run.finish()?;
    Ok(ended?)
}

/// The input in messages.
fn name_of(path: &Path) -> String {
    if path == Path::new("-") { "standard input".to_owned() } else { path.display().to_string() }
}

/// The input with a bar that follows what was read of it.
fn open(path: &Path) -> anyhow::Result<(Box<dyn Read + Send>, ProgressBar)> {
    if path == Path::new("-") {
        return Ok((Box::new(std::io::stdin()), ProgressBar::no_length()));
    }
    let file = File::open(path).with_context(|| format!("reading {}", path.display()))?;
    let about = file.metadata().with_context(|| format!("reading {}", path.display()))?;
    if about.is_dir() {
        bail!("{} is a folder: name a file of plots", path.display());
    }
    let style = ProgressStyle::with_template("{bar:24} {bytes}/{total_bytes}, {eta} left, {msg}");
    let bar = ProgressBar::new(about.len());
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    Ok((Box::new(bar.wrap_read(file)), bar))
}

/// Following one input.
struct Run<'a> {
    options: &'a TrackOptions,
    name: String,
    follower: Follower,
    order: Reorder<Scan>,
    first_s: Option<f64>,
    newest_s: f64,
    sequence: u64,
    refusals: Refusals,
    summary: Summary,
    kept: Kept,
    /// Whether anybody reads what is printed.
    is_read: bool,
}

impl<'a> Run<'a> {
    fn new(options: &'a TrackOptions, config: &MapConfig, name: String) -> anyhow::Result<Self> {
        Ok(Self {
            options,
            follower: Follower::new(config).context("configuration: wide.tracking")?,
            order: Reorder::new(config.patience()),
            first_s: None,
            newest_s: f64::MIN,
            sequence: 0,
            refusals: Refusals::default(),
            summary: Summary::default(),
            kept: Kept::new(
                &options.files,
                name.rsplit('/').next().unwrap_or(&name),
                config.output.clone(),
            ),
            name,
            is_read: true,
        })
    }

    /// Takes what was found; the data's own time is the clock by which sensors are waited for.
    fn take(&mut self, found: &mut Vec<Result<Scan, Damage>>) -> anyhow::Result<()> {
        for one in found.drain(..) {
            match one {
                Err(damage) => self.damaged(damage.label(), &damage.to_string()),
                Ok(scan) => self.take_scan(scan)?,
            }
        }
        Ok(())
    }

    fn take_scan(&mut self, scan: Scan) -> anyhow::Result<()> {
        let time_s = scan.time_s();
        let first_s = *self.first_s.get_or_insert(time_s);
        let node = node_of(&scan).clone();
        let arrived = time_of(self.newest_s.max(time_s) - first_s);
        let origin = Origin { node, boot: BootId(0), sequence: self.sequence };
        self.sequence += 1;
        let offered = self.order.offer(arrived, origin, time_s, scan);
        if offered != Offer::Held {
            self.newest_s = self.newest_s.max(time_s);
        }
        if let Some(refuted_s) = self.order.take_refuted() {
            self.damaged("leap", &leapt(refuted_s, time_s));
        }
        match offered {
            Offer::Kept | Offer::Held | Offer::Duplicate => {}
            Offer::Late => {
                let reason = format!(
                    "a dwell of {time_s} s comes more than wide.max_wait_s after later ones: \
                     sort the input by time, or wait longer"
                );
                self.damaged("late", &reason);
            }
            Offer::Crowded => {
                let reason = "dwells of more sensors than wide.max_sensor_count";
                self.damaged("crowded", reason);
            }
        }
        let released = self.order.release(time_of(self.newest_s - first_s));
        self.follow(&released)
    }

    fn follow(&mut self, scans: &[Scan]) -> anyhow::Result<()> {
        for scan in scans {
            match self.follower.take(scan) {
                Ok(left_out) => {
                    self.summary.count(scan);
                    self.note_unplaced(left_out, scan.time_s());
                }
                Err(refusal) => self.damaged("refused", &refusal.to_string()),
            }
            self.kept.note_plots(scan);
            self.settle()?;
        }
        Ok(())
    }

    fn settle(&mut self) -> anyhow::Result<()> {
        let mut settled = Vec::new();
        self.follower.take_settled(&mut settled);
        let mut text = String::new();
        for step in &settled {
            let heights_m = &mut self.summary.heights_m;
            let step = Step::new(step, &self.follower, heights_m);
            self.summary.take(&step);
            self.note_unsure(&step);
            if step.is_tentative() && !self.options.tentative {
                continue;
            }
            if self.options.json {
                text.push_str(&serde_json::to_string(&step.line)?);
                text.push('\n');
            }
            self.kept.take(step);
        }
        if !text.is_empty() && self.is_read {
            self.is_read = process::print_on(&text)?;
        }
        Ok(())
    }

    /// Tells of plots that a dwell could not be followed with.
    fn note_unplaced(&mut self, count: usize, time_s: f64) {
        if 0 < count {
            self.damaged("unplaced", &unplaced(count, time_s));
        }
    }

    /// Tells of steps that are printed but not in the files.
    fn note_unsure(&mut self, step: &Step) {
        if step.on_map.is_none() && matches!(self.follower.ground(), Some(Ground::Earth(_))) {
            let reason = format!(
                "track {} at {} s: too little is known of its place or speed to show it",
                step.id(),
                step.time_s()
            );
            self.refusals.count(&self.name, "unsure", &reason);
        }
    }

    /// Counts what could not be used, and names it in the log.
    fn damaged(&mut self, label: &'static str, reason: &str) {
        self.refusals.count(&self.name, label, reason);
        self.summary.damaged(label, reason);
    }

    fn finish(mut self) -> anyhow::Result<()> {
        let rest = self.order.finish();
        self.follow(&rest)?;
        self.follower.finish();
        self.settle()?;
        if self.summary.dwell_count == 0 && self.summary.damage_count() == 0 {
            bail!("{} holds no dwell: name another input; lines end with a line feed", self.name);
        }
        if !self.options.json {
            process::print(&self.summary.table())?;
        }
        self.kept.write(&self.options.files, self.follower.ground())?;
        self.summary.verdict(&self.name)
    }
}

/// Seconds of the data as a clock.
fn time_of(seconds: f64) -> CentreTime {
    #[expect(clippy::cast_possible_truncation, reason = "saturates after three hundred years")]
    let ns = (seconds * 1e9) as i64;
    CentreTime(ns)
}
