//! Starting the program under test, and waiting for what it does.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tempfile::TempDir;

/// Each run is several processes: side by side they would slow each other down on small machines.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// The harness with these arguments; its run's files go into a folder of their own.
pub(crate) struct Run {
    folder: TempDir,
    command: Command,
    turn: MutexGuard<'static, ()>,
}

/// What a run left.
pub(crate) struct Finished {
    pub(crate) output: Output,
    pub(crate) report: serde_json::Value,
    pub(crate) folder: TempDir,
}

impl Run {
    pub(crate) fn new(arguments: &[&str]) -> Self {
        let turn = ONE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner);
        let folder = TempDir::new().unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_transmural-under-test"));
        command.arg("run").args(arguments).arg("--json").arg("--out").arg(folder.path());
        Self { folder, command, turn }
    }

    /// Runs to the end.
    pub(crate) fn finish(mut self) -> Finished {
        let output = self.command.output().unwrap();
        let report = serde_json::from_slice(&output.stdout).unwrap_or_else(|error| {
            panic!("no report ({error}): {}", String::from_utf8_lossy(&output.stderr))
        });
        drop(self.turn);
        Finished { output, report, folder: self.folder }
    }

    /// Starts and does not wait.
    pub(crate) fn start(mut self) -> (Child, TempDir, MutexGuard<'static, ()>) {
        let child = self.command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        (child, self.folder, self.turn)
    }
}

impl Finished {
    /// One node's part of the report.
    pub(crate) fn node(&self, name: &str) -> &serde_json::Value {
        let nodes = self.report["nodes"].as_array().unwrap();
        nodes.iter().find(|node| node["node"] == name).unwrap()
    }

    /// One file of the run's folder.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn stderr(&self) -> String {
        String::from_utf8_lossy(&self.output.stderr).into_owned()
    }
}

/// Waits until `condition` holds.
pub(crate) fn eventually(what: &str, limit: Duration, mut condition: impl FnMut() -> bool) {
    let start = Instant::now();
    while !condition() {
        assert!(start.elapsed() < limit, "not within {limit:?}: {what}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// Numbers of the processes whose command line names `folder`.
pub(crate) fn processes_of(folder: &Path) -> Vec<i32> {
    let folder = folder.to_str().unwrap();
    let entries = std::fs::read_dir("/proc").unwrap().filter_map(Result::ok);
    entries
        .filter(|entry| {
            let command_line = std::fs::read(entry.path().join("cmdline")).unwrap_or_default();
            String::from_utf8_lossy(&command_line).contains(folder)
        })
        .filter_map(|entry| entry.file_name().to_str()?.parse().ok())
        .collect()
}
