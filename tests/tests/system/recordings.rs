//! Promise: a simulated scene is recorded in either format, processed offline and played live, with
//! the same points; damaged recordings are named and do not hold up the others.

use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use serde_json::Value;

use super::support::eventually;

/// Two points on their ways behind nothing, seen by one node, noise at 8 dB.
const SCENE: &str = r#"
[chain]
canceller = "none"
[target]
half_depth_m = 0.0
half_depth_sigma_m = 0.0
[simulated]
period_s = 0.1
period_count = 12
[simulated.disturbance.noise.in_band]
snr_db = 14.0
[[simulated.scene.targets]]
way_points = [{ time_s = 0.0, x_m = -1.5, y_m = 3.0 }, { time_s = 1.2, x_m = -0.5, y_m = 4.0 }]
[[simulated.scene.targets]]
way_points = [{ time_s = 0.0, x_m = 1.0, y_m = 6.0 }, { time_s = 1.2, x_m = 2.0, y_m = 5.0 }]
"#;

pub(super) fn agent(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_transmural-under-test"));
    command.arg0("node-agent").current_dir(folder);
    command
}

pub(super) fn run(folder: &Path, arguments: &[&str]) -> Output {
    agent(folder).args(arguments).output().unwrap()
}

pub(super) fn succeeds(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {said}");
    String::from_utf8(output.stdout).unwrap()
}

pub(super) fn lines(text: &str) -> Vec<Value> {
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// A folder with the scene's configuration and its recording in both formats.
fn recorded() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("scene.toml"), SCENE).unwrap();
    for out in ["echoes.npz", "echoes.sigmf-meta"] {
        let said = succeeds(folder.path(), &["record", "--config", "scene.toml", "--out", out]);
        assert!(said.contains("12 periods"), "{said}");
    }
    folder
}

/// The points of all periods as places.
fn places(lines: &[Value]) -> Vec<Vec<(f64, f64)>> {
    let place = |point: &Value| (point["x_m"].as_f64().unwrap(), point["y_m"].as_f64().unwrap());
    lines
        .iter()
        .map(|line| line["points"].as_array().unwrap().iter().map(place).collect())
        .collect()
}

#[test]
fn what_is_recorded_is_measured_where_it_truly_is() {
    let folder = recorded();
    let options = ["--target", "points", "--set", "chain.canceller=none", "--json"];
    let process = |recording: &str| {
        lines(&succeeds(folder.path(), &[&["process", recording][..], &options].concat()))
    };
    let (npz, sigmf) = (process("echoes.npz"), process("echoes.sigmf-meta"));
    assert_eq!(npz.len(), 12);
    assert_eq!(places(&npz), places(&sigmf), "the formats differ");
    let truth_text = std::fs::read_to_string(folder.path().join("echoes.truth.jsonl")).unwrap();
    for (line, truth) in npz.iter().zip(lines(&truth_text)) {
        let points = places(std::slice::from_ref(line)).remove(0);
        assert_eq!(points.len(), 2, "{line}");
        for target in truth["targets"].as_array().unwrap() {
            let (x_m, y_m) = (target["x_m"].as_f64().unwrap(), target["y_m"].as_f64().unwrap());
            let nearest = points.iter().map(|(x, y)| (x - x_m).hypot(y - y_m));
            // Five standard deviations across at 14 dB and 6 m.
            assert!(nearest.fold(f64::INFINITY, f64::min) < 0.25, "{line} {truth}");
        }
    }
}

#[test]
fn damage_is_named_and_the_other_recordings_are_processed() {
    let folder = recorded();
    let whole = std::fs::read(folder.path().join("echoes.npz")).unwrap();
    std::fs::write(folder.path().join("cut.npz"), &whole[..whole.len() / 2]).unwrap();
    std::fs::write(folder.path().join("text.npz"), b"no archive at all").unwrap();
    std::fs::copy(folder.path().join("echoes.npz"), folder.path().join("good.npz")).unwrap();
    let arguments = ["process", "cut.npz", "text.npz", "good.npz", "missing.npz"];
    let options = ["--out", "points", "--images", "images", "--json"];
    let output = run(folder.path(), &[&arguments[..], &options].concat());
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && said.contains("3 of 4 recordings failed"), "{said}");
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
    for (failed, name) in
        summary["failed"].as_array().unwrap().iter().zip(["cut.npz", "text.npz", "missing.npz"])
    {
        assert!(failed["error"].as_str().unwrap().contains(name), "{failed}");
    }
    assert_eq!(summary["recordings"][0]["period_count"], 12);
    let node = summary["recordings"][0]["node"].as_str().unwrap();
    let points = folder.path().join("points").join(format!("{node}.jsonl"));
    assert_eq!(lines(&std::fs::read_to_string(points).unwrap()).len(), 12);
    let images = std::fs::read_dir(folder.path().join("images")).unwrap();
    assert_eq!(images.count(), 12);
}

#[test]
fn a_drivers_sweeps_are_measured_live() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("scene.toml"), SCENE).unwrap();
    let port = std::net::TcpListener::bind(("127.0.0.1", 0)).unwrap().local_addr().unwrap().port();
    let endpoint = format!("tcp/127.0.0.1:{port}");
    let log = folder.path().join("agent.log");
    let mut live = agent(folder.path())
        .args(["--config", "scene.toml", "--source", "live", "--stop-with-stdin"])
        .args(["--set", &format!("live.listen={endpoint}"), "--points", "points.jsonl"])
        .stdin(Stdio::piped())
        .stderr(std::fs::File::create(&log).unwrap())
        .spawn()
        .unwrap();
    let logged = |text: &str| std::fs::read_to_string(&log).is_ok_and(|log| log.contains(text));
    eventually("the agent listens", Duration::from_secs(15), || logged("waiting for sweeps"));
    let feed = ["feed", "--config", "scene.toml", "--to", &endpoint, "--speed", "2"];
    succeeds(folder.path(), &feed);
    // Another radar's sweeps are refused by name.
    succeeds(folder.path(), &[&feed[..], &["--set", "chain.band.step_count=201"]].concat());
    let measured = || {
        let text = std::fs::read_to_string(folder.path().join("points.jsonl"));
        text.unwrap_or_default().lines().count()
    };
    eventually("all sweeps are measured", Duration::from_secs(10), || measured() == 12);
    eventually("the other radar is named", Duration::from_secs(10), || {
        logged("step count is 201, the configuration says 301")
    });
    drop(live.stdin.take());
    assert!(live.wait().unwrap().success());
    let text = std::fs::read_to_string(folder.path().join("points.jsonl")).unwrap();
    assert!(places(&lines(&text)).iter().all(|points| points.len() == 2));
}
