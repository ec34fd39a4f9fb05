//! What every program of the project does the same way: logging, signals, the end of its parent.

use std::ffi::OsString;
use std::io::{IsTerminal, Read, Write};
use std::process::ExitCode;
use std::time::Duration;

use anyhow::Context;
use clap::Parser;
use tokio_util::sync::CancellationToken;
use tracing::{info, warn};
use tracing_subscriber::EnvFilter;

/// From the wish to stop to the end of the process, whatever hangs.
const STOP_LIMIT: Duration = Duration::from_millis(4800);
/// Time for the message that says so.
const LAST_WORDS: Duration = Duration::from_millis(100);

/// Flags of every long-running program.
#[derive(Clone, Debug, clap::Args)]
pub struct Flags {
    /// What to log, such as debug or fusion_center=debug,zenoh=warn.
    #[arg(long, env = "TRANSMURAL_LOG", default_value = "info,zenoh=error", global = true)]
    log: String,
    /// Log as JSON Lines.
    #[arg(long, global = true)]
    log_json: bool,
    /// Stop when standard input ends: for a launcher, so that nothing outlives it.
    #[arg(long, global = true)]
    stop_with_stdin: bool,
}

/// Arguments that hold [`Flags`].
pub trait HasFlags: Parser {
    /// The flags.
    fn process_flags(&self) -> &Flags;
}

/// Parses the arguments, sets logging up, and runs `body` until it ends; SIGINT, SIGTERM or the
/// end of the parent cancel its token, and five seconds later the process ends in any case.
pub fn main<A: HasFlags>(
    arguments: impl IntoIterator<Item = OsString>,
    body: impl AsyncFnOnce(A, CancellationToken) -> anyhow::Result<()>,
) -> ExitCode {
    let parsed = match A::try_parse_from(arguments) {
        Ok(parsed) => parsed,
        Err(error) => {
            drop(error.print());
            return ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(2));
        }
    };
    match try_main(parsed, body) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            drop(writeln!(std::io::stderr(), "error: {}", explained(&error)));
            ExitCode::FAILURE
        }
    }
}

fn try_main<A: HasFlags>(
    arguments: A,
    body: impl AsyncFnOnce(A, CancellationToken) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let flags = arguments.process_flags().clone();
    start_logging(&flags)?;
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(4)
        .enable_all()
        .build()
        .context("starting the runtime")?;
    let stop = CancellationToken::new();
    if flags.stop_with_stdin {
        let token = stop.clone();
        std::thread::spawn(move || cancel_at_end_of_stdin(&token));
    }
    watch_signals_beside(stop.clone())?;
    let result = runtime.block_on(body(arguments, stop));
    runtime.shutdown_timeout(Duration::from_millis(200));
    result
}

fn start_logging(flags: &Flags) -> anyhow::Result<()> {
    let filter = EnvFilter::try_new(&flags.log)
        .with_context(|| format!("--log {:?}: use for example info,zenoh=error", flags.log))?;
    let subscriber = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_ansi(std::io::stderr().is_terminal())
        .with_writer(std::io::stderr);
    let started = if flags.log_json { subscriber.json().try_init() } else { subscriber.try_init() };
    started.map_err(|error| anyhow::anyhow!("starting the log: {error}"))
}

fn cancel_at_end_of_stdin(stop: &CancellationToken) {
    let mut buffer = [0_u8; 256];
    while std::io::stdin().read(&mut buffer).is_ok_and(|count| 0 < count) {}
    stop.cancel();
    end_after_limit();
}

/// Watches signals on a thread with a runtime of its own: whatever blocks the program, a log that
/// nobody reads among them, must not keep it from ending.
fn watch_signals_beside(stop: CancellationToken) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let runtime = runtime.context("starting the signals' runtime")?;
    std::thread::spawn(move || runtime.block_on(watch_signals(stop)));
    Ok(())
}

async fn watch_signals(stop: CancellationToken) {
    use tokio::signal::unix::{SignalKind, signal};
    let (Ok(mut interrupt), Ok(mut terminate)) =
        (signal(SignalKind::interrupt()), signal(SignalKind::terminate()))
    else {
        warn!("signals cannot be watched: stop this process by force");
        return;
    };
    tokio::select! {
        _ = interrupt.recv() => {}
        _ = terminate.recv() => {}
        () = stop.cancelled() => {}
    }
    stop.cancel();
    std::thread::spawn(end_after_limit);
    info!("stopping");
    tokio::select! {
        _ = interrupt.recv() => std::process::exit(130),
        _ = terminate.recv() => std::process::exit(143),
    }
}

fn end_after_limit() {
    std::thread::sleep(STOP_LIMIT);
    // On a thread, because standard error may be what hangs.
    std::thread::spawn(|| {
        drop(writeln!(std::io::stderr(), "error: stopping took longer than {STOP_LIMIT:?}; ended"));
    });
    std::thread::sleep(LAST_WORDS);
    std::process::exit(1);
}

/// Writes text to standard output.
///
/// # Errors
/// If it cannot be written; that a pipe was closed is no error.
pub fn print(text: &str) -> anyhow::Result<()> {
    print_on(text).map(|_| ())
}

/// Writes text to standard output, and says whether anybody reads on: after `head -1` nobody does.
///
/// # Errors
/// If it cannot be written, for another reason than a pipe that was closed.
pub fn print_on(text: &str) -> anyhow::Result<bool> {
    let mut output = std::io::stdout().lock();
    match output.write_all(text.as_bytes()).and_then(|()| output.flush()) {
        // Whoever reads has seen enough.
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => Ok(false),
        written => written.map(|()| true).context("writing the output"),
    }
}

/// An error with its causes, each said once: many errors say their cause themselves.
#[must_use]
pub fn explained(error: &anyhow::Error) -> String {
    let mut text = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if !text.contains(&cause) {
            let gap = if text.is_empty() { "" } else { ": " };
            text = format!("{text}{gap}{cause}");
        }
    }
    text
}

impl Flags {
    /// What is logged, to hand it on to child processes.
    #[must_use]
    pub fn log_filter(&self) -> &str {
        &self.log
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn causes_are_said_once() {
        let inner = std::io::Error::other("no disk");
        let outer = anyhow::Error::new(inner).context("writing x: no disk").context("saving");
        assert_eq!(explained(&outer), "saving: writing x: no disk");
    }
}
