//! Promise: a run leaves no process behind, however it ends.

use std::process::Child;
use std::time::Duration;

use rustix::process::{Pid, Signal, kill_process};

use super::support::{Run, eventually, processes_of};

/// Starts a run, waits until centre and agents are up, and sends it a signal.
fn interrupted(signal: Signal) {
    let (mut harness, folder, _turn) = Run::new(&["paper", "--speed", "0.2"]).start();
    let own = harness.id().cast_signed();
    let children =
        || processes_of(folder.path()).into_iter().filter(|pid| *pid != own).collect::<Vec<_>>();
    eventually("three children run", Duration::from_secs(20), || children().len() == 3);
    kill_process(pid_of(&harness), signal).unwrap();
    harness.wait().unwrap();
    eventually("no child is left", Duration::from_secs(8), || children().is_empty());
}

fn pid_of(child: &Child) -> Pid {
    Pid::from_raw(child.id().cast_signed()).unwrap()
}

#[test]
fn after_ctrl_c() {
    interrupted(Signal::INT);
}

#[test]
fn after_sigterm() {
    interrupted(Signal::TERM);
}

#[test]
fn after_the_harness_itself_was_killed() {
    interrupted(Signal::KILL);
}
