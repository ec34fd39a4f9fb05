//! Starts the processes of a run, watches them, and leaves none behind.
//!
//! Every child gets a pipe as standard input and stops when it ends: so the children notice even
//! a harness that was killed.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

use anyhow::Context;
use serde::Serialize;
use tokio::process::{Child, Command};

/// After the end of its input a child may take this long, before it is killed: less than the harness
/// itself is given when it is told to stop, so that it never leaves a child behind.
const STOP_LIMIT: Duration = Duration::from_secs(4);

/// A process that ended before it should.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Incident {
    pub(crate) who: String,
    pub(crate) how: String,
    /// It exited; it was not killed.
    #[serde(skip)]
    pub(crate) by_itself: bool,
}

/// How a child is started.
#[derive(Clone, Debug)]
struct Recipe {
    program: PathBuf,
    config: PathBuf,
    log: PathBuf,
    log_filter: String,
}

struct Running {
    recipe: Recipe,
    child: Child,
    has_ended: bool,
}

/// The processes of a run.
pub(crate) struct Processes {
    folder: PathBuf,
    programs: PathBuf,
    log_filter: String,
    running: BTreeMap<String, Running>,
}

impl Processes {
    /// Prepares to launch from `programs`, or this program itself under the others' names.
    pub(crate) fn new(
        folder: &Path,
        programs: Option<&Path>,
        log_filter: &str,
    ) -> anyhow::Result<Self> {
        let programs = match programs {
            Some(programs) => programs.to_owned(),
            None => own_programs(&folder.join("bin"))?,
        };
        let (folder, log_filter) = (folder.to_owned(), log_filter.to_owned());
        Ok(Self { folder, programs, log_filter, running: BTreeMap::new() })
    }

    /// Starts `program` under the name `who` with this configuration, which is kept in the run's
    /// folder.
    pub(crate) fn start(
        &mut self,
        who: &str,
        program: &str,
        config: &impl Serialize,
    ) -> anyhow::Result<()> {
        let path = self.folder.join("config").join(format!("{who}.toml"));
        std::fs::write(&path, toml::to_string(config)?)
            .with_context(|| format!("writing {}", path.display()))?;
        let recipe = Recipe {
            program: self.programs.join(program),
            config: path,
            log: self.folder.join("logs").join(format!("{who}.log")),
            log_filter: self.log_filter.clone(),
        };
        let child = spawn(&recipe)?;
        self.running.insert(who.to_owned(), Running { recipe, child, has_ended: false });
        Ok(())
    }

    /// Starts a process that has ended once more, as it was.
    pub(crate) fn start_again(&mut self, who: &str) -> anyhow::Result<()> {
        let running = self.running.get_mut(who).with_context(|| format!("{who} never ran"))?;
        running.child = spawn(&running.recipe)?;
        running.has_ended = false;
        Ok(())
    }

    /// Kills without warning, as a crash or a power cut would.
    pub(crate) async fn kill(&mut self, who: &str) -> anyhow::Result<()> {
        let running = self.running.get_mut(who).with_context(|| format!("{who} never ran"))?;
        running.child.kill().await.with_context(|| format!("killing {who}"))
    }

    /// Processes that have ended since the last call.
    pub(crate) fn ended(&mut self) -> Vec<Incident> {
        let mut ended = Vec::new();
        for (who, running) in &mut self.running {
            if !running.has_ended
                && let Ok(Some(status)) = running.child.try_wait()
            {
                running.has_ended = true;
                ended.push(Incident {
                    who: who.clone(),
                    how: status.to_string(),
                    by_itself: status.code().is_some(),
                });
            }
        }
        ended
    }

    /// The system's number of each running process.
    pub(crate) fn pids(&self) -> impl Iterator<Item = (&str, u32)> {
        self.running.iter().filter_map(|(who, running)| Some((who.as_str(), running.child.id()?)))
    }

    /// The end of a process's log.
    pub(crate) fn log_tail(&self, who: &str) -> String {
        let path = self.running.get(who).map(|running| running.recipe.log.clone());
        let text = path.and_then(|path| std::fs::read_to_string(path).ok()).unwrap_or_default();
        let lines: Vec<&str> = text.lines().rev().take(5).collect();
        lines.into_iter().rev().collect::<Vec<_>>().join("\n")
    }

    /// Asks every process to stop, waits, and kills what has not. Returns those that did not end
    /// well.
    pub(crate) async fn stop(&mut self) -> Vec<Incident> {
        let mut incidents = Vec::new();
        for running in self.running.values_mut() {
            drop(running.child.stdin.take());
        }
        let deadline = tokio::time::Instant::now() + STOP_LIMIT;
        for (who, running) in &mut self.running {
            let how = match tokio::time::timeout_at(deadline, running.child.wait()).await {
                Ok(Ok(status)) if running.has_ended || status.success() => continue,
                Ok(waited) => format!("{waited:?} when asked to stop"),
                Err(_) => format!("killed: {:?}", running.child.kill().await),
            };
            incidents.push(Incident { who: who.clone(), how, by_itself: true });
        }
        // The links point into this machine; the run's folder may travel.
        drop(std::fs::remove_dir_all(self.folder.join("bin")));
        incidents
    }
}

/// A folder in which this program has the names of the others: it answers to both.
fn own_programs(folder: &Path) -> anyhow::Result<PathBuf> {
    let own = std::env::current_exe().context("finding this program's file")?;
    std::fs::create_dir_all(folder)?;
    for name in ["node-agent", "fusion-center"] {
        let link = folder.join(name);
        std::os::unix::fs::symlink(&own, &link)
            .with_context(|| format!("linking {}", link.display()))?;
    }
    Ok(folder.to_owned())
}

fn spawn(recipe: &Recipe) -> anyhow::Result<Child> {
    let log = File::options().create(true).append(true).open(&recipe.log);
    let log = log.with_context(|| format!("opening {}", recipe.log.display()))?;
    Command::new(&recipe.program)
        .arg("--config")
        .arg(&recipe.config)
        .args(["--stop-with-stdin", "--log", &recipe.log_filter])
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(log)
        .kill_on_drop(true)
        .spawn()
        .with_context(|| format!("starting {}", recipe.program.display()))
}
