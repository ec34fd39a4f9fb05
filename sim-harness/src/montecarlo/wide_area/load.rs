//! Many targets: what a scan costs on one thread, and how rightly tracks are put together then.

use std::time::Duration;

use anyhow::{Context, ensure};
use clap::ValueEnum;
use node_agent::gmti::simulate::{Preset, SimulatedGmtiConfig};
use serde::Serialize;
use tokio_util::sync::CancellationToken;

use super::case::Case;
use super::entrants::{Entrant, Rules};
use super::trial::{Tally, follow, play};
use crate::resources::Sampler;

/// Scans at the beginning, in which there are no tracks yet: their time does not count.
const FIRST_SCAN_COUNT: usize = 5;

/// How targets are spread.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Spread {
    /// Anywhere, in any direction.
    Uniform,
    /// In convoys on roads of two lanes.
    Roads,
}

/// One tracker under one load.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct LoadResult {
    pub(super) mode: Entrant,
    pub(super) spread: Spread,
    pub(super) target_count: usize,
    /// Plots of a scan.
    pub(super) plot_count: f64,
    /// Processor time of scans that are followed for the present alone. Differs from run to run.
    pub(super) scan_ms: ScanTimes,
    /// Processor time that smoothing the past takes beside that, for a scan on average.
    pub(super) smoothing_ms: f64,
    pub(super) right_links: Option<f64>,
    pub(super) identity: Option<f64>,
    pub(super) purity: Option<f64>,
    /// Confirmed tracks per flight.
    pub(super) track_count: f64,
    /// What the process holds more at the end than before the first flight, MiB: the tracker with
    /// everything that it has settled. What loads before have left to the allocator is used again and
    /// not counted: only the first load of a process shows all of it.
    pub(super) memory_mib: f64,
}

/// Processor times, milliseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub(super) struct ScanTimes {
    pub(super) mean: f64,
    pub(super) median: f64,
    pub(super) longest: f64,
}

impl ScanTimes {
    /// Of these scans; zero of none.
    fn new(times: &[Duration]) -> Self {
        let mut ascending_ms: Vec<f64> =
            times.iter().map(|time| time.as_secs_f64() * 1e3).collect();
        ascending_ms.sort_by(f64::total_cmp);
        let count = ascending_ms.len();
        let at = |index: usize| ascending_ms.get(index).copied().unwrap_or(0.0);
        Self {
            mean: ascending_ms.iter().sum::<f64>() / (count as f64).max(1.0),
            median: at(count / 2),
            longest: at(count.saturating_sub(1)),
        }
    }
}

impl Spread {
    /// The scene of so many targets.
    pub(super) fn config(self, target_count: usize, seed: u64) -> SimulatedGmtiConfig {
        let preset = match self {
            Self::Uniform => Preset::LoadUniform,
            Self::Roads => Preset::LoadRoads,
        };
        SimulatedGmtiConfig { preset, target_count, seed, ..SimulatedGmtiConfig::default() }
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Uniform => "uniform",
            Self::Roads => "roads",
        }
    }
}

/// One flight after the other on this thread, so that nothing of ours disturbs the measured times.
///
/// # Errors
/// If a scene cannot be simulated, or `stop` was called.
pub(super) fn run(
    mode: Entrant,
    (spread, target_count): (Spread, usize),
    seeds: &[u64],
    stop: &CancellationToken,
) -> anyhow::Result<LoadResult> {
    let mut sampler = Sampler::new()?;
    let this = [("harness", std::process::id())];
    let (mut tally, mut took, mut smoothing) = (Tally::default(), Vec::new(), Duration::ZERO);
    let (mut plot_count, mut scan_count) = (0, 0);
    for (index, seed) in seeds.iter().enumerate() {
        ensure!(!stop.is_cancelled(), "stopped before the end");
        let case = Case::new(&spread.config(target_count, *seed))?;
        plot_count += case.looks.iter().map(|look| look.plots.len()).sum::<usize>();
        scan_count += case.looks.len();
        if index == 0 {
            sampler.sample(this.into_iter());
        }
        let looks = follow(&case, mode.tracker(Rules::Own)?.as_mut())?;
        took.extend(looks.into_iter().skip(FIRST_SCAN_COUNT));
        let outcome = play(&case, mode.tracker(Rules::Own)?.as_mut(), None)?;
        tally = tally + outcome.tally;
        smoothing += outcome.settling;
        if index == 0 {
            sampler.sample(this.into_iter());
        }
        tracing::info!(mode = mode.name(), spread = spread.name(), target_count, index, "followed");
    }
    let scans = f64::from(u32::try_from(scan_count)?.max(1));
    let usage = sampler.finish().remove("harness").context("reading the memory of this process")?;
    Ok(LoadResult {
        mode,
        spread,
        target_count,
        plot_count: plot_count as f64 / scans,
        scan_ms: ScanTimes::new(&took),
        smoothing_ms: smoothing.as_secs_f64() * 1e3 / scans,
        right_links: tally.links.right_link_rate(),
        identity: tally.links.identity_rate(),
        purity: tally.links.purity(),
        track_count: tally.links.track_count as f64 / (seeds.len() as f64).max(1.0),
        memory_mib: (usage.memory_end_mib - usage.memory_early_mib).max(0.0),
    })
}
