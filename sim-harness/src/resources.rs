//! What the processes use: memory and processor time, sampled while they run.

use std::collections::BTreeMap;

use anyhow::Context;
use serde::Serialize;
use sysinfo::{Pid, ProcessRefreshKind, ProcessesToUpdate, System};

/// One process's use, over all its lives.
#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct Usage {
    /// Processor seconds of the current life at the last sample.
    pub(crate) cpu_s: f64,
    /// Processor seconds per second over the whole life so far, 1 for one core.
    pub(crate) cpu_share: f64,
    /// Resident memory after a quarter of the samples, MiB.
    pub(crate) memory_early_mib: f64,
    /// Resident memory at the end, MiB.
    pub(crate) memory_end_mib: f64,
    /// Largest resident memory, MiB.
    pub(crate) memory_max_mib: f64,
    #[serde(skip)]
    memory_mib: Vec<f64>,
}

/// Samples processes by their numbers.
pub(crate) struct Sampler {
    system: System,
    usage: BTreeMap<String, Usage>,
}

impl Sampler {
    pub(crate) fn new() -> anyhow::Result<Self> {
        let system = System::new().context("reading the processes' use of resources")?;
        Ok(Self { system, usage: BTreeMap::new() })
    }

    pub(crate) fn sample<'a>(&mut self, processes: impl Iterator<Item = (&'a str, u32)>) {
        let processes: Vec<(&str, Pid)> =
            processes.map(|(who, pid)| (who, Pid::from_u32(pid))).collect();
        let pids: Vec<Pid> = processes.iter().map(|(_, pid)| *pid).collect();
        let what = ProcessRefreshKind::nothing().with_cpu().with_memory();
        self.system.refresh_processes_specifics(ProcessesToUpdate::Some(&pids), true, what);
        for (who, pid) in processes {
            let Some(process) = self.system.process(pid) else { continue };
            let usage = self.usage.entry(who.to_owned()).or_default();
            usage.cpu_s = process.accumulated_cpu_time() as f64 * 1e-3;
            usage.cpu_share = usage.cpu_s / (process.run_time() as f64).max(1.0);
            usage.memory_mib.push(process.memory() as f64 / f64::from(1 << 20));
        }
    }

    pub(crate) fn finish(mut self) -> BTreeMap<String, Usage> {
        for usage in self.usage.values_mut() {
            let samples = &usage.memory_mib;
            usage.memory_early_mib = samples.get(samples.len() / 4).copied().unwrap_or(0.0);
            usage.memory_end_mib = samples.last().copied().unwrap_or(0.0);
            usage.memory_max_mib = samples.iter().copied().fold(0.0, f64::max);
        }
        self.usage
    }
}
