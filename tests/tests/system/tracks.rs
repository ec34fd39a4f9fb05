//! Promise: people are followed where that is switched on, over the network and offline, and nothing
//! else changes.

use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

use serde_json::Value;

use super::recordings::{agent, lines, run, succeeds};
use super::support::{Run, eventually};

/// Two nodes around two people who walk for six seconds and then stand still; the reference stands
/// at the world's origin and looks along y, so that places in `Ref` are those of the world.
const WALK: &str = r#"
name = "walk"
title = "two nodes, two people who are followed"
reference = "n1"
period_s = 0.1
period_count = 80
seed = 1

[bounds]
position_m = 0.5
angle_deg = 6.0
seed_share = 1.0

[[nodes]]
id = "n1"
x_m = 0.0
y_m = 0.0
heading_deg = 0.0

[[nodes]]
id = "n2"
x_m = -4.0
y_m = 4.0
heading_deg = -90.0

[agent.tracking]
mode = "default"

[agent.chain]
canceller = "none"
measure_on = "polar"

[agent.chain.grid]
pixel_m = 0.06
column_count = 167
row_count = 167

[agent.simulated.disturbance.noise.in_band]
snr_db = 15.0

[[agent.simulated.scene.targets]]
kind = "person"
way_points = [{ time_s = 0.0, x_m = -1.5, y_m = 2.5 }, { time_s = 6.0, x_m = 1.0, y_m = 5.5 }, { time_s = 8.0, x_m = 1.0, y_m = 5.5 }]

[[agent.simulated.scene.targets]]
kind = "person"
way_points = [{ time_s = 0.0, x_m = 1.5, y_m = 2.0 }, { time_s = 3.0, x_m = 2.0, y_m = 3.0 }, { time_s = 6.0, x_m = -1.5, y_m = 3.5 }, { time_s = 8.0, x_m = -1.5, y_m = 3.5 }]
"#;

/// Where the two end up.
const ENDS_M: [[f64; 2]; 2] = [[1.0, 5.5], [-1.5, 3.5]];

/// A standing person's track wanders with the glint, 0.12 m across, and in `Ref` with the error of
/// the node's pose: some 0.1 m.
const END_TOLERANCE_M: f64 = 0.5;

#[test]
fn people_who_walk_are_in_the_picture_with_their_tracks() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = folder.path().join("walk.toml");
    std::fs::write(&scenario, WALK).unwrap();
    let finished = Run::new(&[scenario.to_str().unwrap()]).finish();
    assert!(finished.output.status.success(), "{}", finished.stderr());
    let people = finished.report["people"].as_array().unwrap();
    for node in ["n1", "n2"] {
        let own: Vec<&Value> = people.iter().filter(|one| one["last"]["node"] == node).collect();
        for end_m in ENDS_M {
            let ends_there = |person: &&&Value| {
                let state = &person["last"]["track"]["state"];
                let [x_m, y_m] = [0, 1].map(|axis| state[axis].as_f64().unwrap());
                (x_m - end_m[0]).hypot(y_m - end_m[1]) < END_TOLERANCE_M
            };
            let found = own.iter().find(ends_there);
            let person = found.unwrap_or_else(|| panic!("{node} has nobody at {end_m:?}: {own:?}"));
            let place_count = person["places_m"].as_array().unwrap().len();
            // Of eighty periods; confirming takes some, and pictures may skip a message.
            assert!(30 < place_count, "{node} at {end_m:?}: {place_count} places");
        }
    }
    let svg = std::fs::read_to_string(finished.path("after.svg")).unwrap();
    let id = people[0]["last"]["track"]["id"].as_u64().unwrap();
    assert!(svg.contains(&format!(">\n{id}\n")), "the id is not drawn");
}

/// A scene as in `recordings`, with people.
const SCENE: &str = r#"
[chain]
canceller = "none"
[chain.grid]
pixel_m = 0.06
column_count = 167
row_count = 167
[simulated]
period_s = 0.1
period_count = 40
[simulated.disturbance.noise.in_band]
snr_db = 15.0
[[simulated.scene.targets]]
kind = "person"
way_points = [{ time_s = 0.0, x_m = -1.5, y_m = 3.0 }, { time_s = 4.0, x_m = -0.5, y_m = 5.5 }]
[[simulated.scene.targets]]
kind = "person"
way_points = [{ time_s = 0.0, x_m = 1.0, y_m = 6.0 }, { time_s = 4.0, x_m = 2.5, y_m = 4.0 }]
"#;

/// What an agent measures of the scene in this mode, as it writes it.
fn points(folder: &Path, mode: &str) -> Vec<u8> {
    let name = format!("points-{mode}.jsonl");
    let mut running = agent(folder)
        .args(["--config", "scene.toml", "--stop-with-stdin", "--points", &name, "--speed", "2"])
        .args(["--set", &format!("tracking.mode={mode}")])
        .stdin(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let path = folder.join(name);
    let written = || std::fs::read_to_string(&path).unwrap_or_default().lines().count();
    eventually("all periods are measured", Duration::from_secs(60), || written() == 40);
    drop(running.stdin.take());
    assert!(running.wait().unwrap().success());
    std::fs::read(&path).unwrap()
}

#[test]
fn points_are_the_same_whether_people_are_followed_or_not() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("scene.toml"), SCENE).unwrap();
    let off = points(folder.path(), "off");
    assert!(off.windows(4).any(|bytes| bytes == b"x_m\""), "nothing was measured");
    for mode in ["default", "paper"] {
        assert!(points(folder.path(), mode) == off, "{mode} changes the points");
    }
}

fn recorded() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("scene.toml"), SCENE).unwrap();
    succeeds(folder.path(), &["record", "--config", "scene.toml", "--out", "walk.npz"]);
    folder
}

#[test]
fn a_recording_gives_lines_rows_figures_and_animations() {
    let folder = recorded();
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    let text = |name: &str| String::from_utf8(read(name)).unwrap();
    for (mode, video) in [("default", "walk.png"), ("paper", "walk.gif")] {
        let outputs = ["--out", "tracks.jsonl", "--csv", "tracks.csv", "--figures", "figures"];
        let options = ["track", "walk.npz", "--mode", mode, "--config", "scene.toml", "--json"];
        let said = succeeds(folder.path(), &[&options[..], &outputs, &["--video", video]].concat());
        let summary: Value = serde_json::from_str(&said).unwrap();
        let recording = &summary["recordings"][0];
        assert_eq!((&recording["mode"], &recording["period_count"]), (&mode.into(), &40.into()));
        assert!(2 <= recording["tracks"].as_array().unwrap().len(), "{mode}: {said}");
        let lines = lines(&text("tracks.jsonl"));
        assert_eq!(lines.len(), 40);
        let last = lines.last().unwrap()["tracks"].as_array().unwrap();
        for end_m in [[-0.5, 5.5], [2.5, 4.0]] {
            let off_m = |track: &Value| {
                let [x_m, y_m] = [0, 1].map(|axis| track["state"][axis].as_f64().unwrap());
                (x_m - end_m[0]).hypot(y_m - end_m[1])
            };
            let nearest = last.iter().map(off_m).fold(f64::INFINITY, f64::min);
            assert!(nearest < END_TOLERANCE_M, "{mode}: nobody at {end_m:?}, {last:?}");
        }
        let row_count: usize =
            lines.iter().map(|line| line["tracks"].as_array().unwrap().len()).sum();
        assert_eq!(text("tracks.csv").lines().count(), 1 + row_count);
        let node = recording["node"].as_str().unwrap();
        let svg = text(&format!("figures/{node}-ways.svg"));
        assert!(svg.starts_with("<svg") && svg.contains(">\ntrue\n"), "{mode}: no true ways");
    }
    let png = read("walk.png");
    let control = png.windows(4).position(|bytes| bytes == b"acTL").unwrap();
    assert_eq!(png[control + 4..control + 8], [0, 0, 0, 40], "frames of the animated PNG");
    assert!(read("walk.gif").starts_with(b"GIF89a"));
}

#[test]
fn damage_is_named_and_the_other_recordings_are_followed() {
    let folder = recorded();
    let whole = std::fs::read(folder.path().join("walk.npz")).unwrap();
    std::fs::write(folder.path().join("cut.npz"), &whole[..whole.len() / 2]).unwrap();
    std::fs::write(folder.path().join("text.npz"), b"no archive at all").unwrap();
    let arguments = ["track", "cut.npz", "text.npz", "walk.npz", "missing.npz"];
    let outputs = ["--out", "tracks", "--csv", "tracks", "--config", "scene.toml", "--json"];
    let output = run(folder.path(), &[&arguments[..], &outputs].concat());
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(!output.status.success() && said.contains("3 of 4 recordings failed"), "{said}");
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
    let failed = summary["failed"].as_array().unwrap();
    for (one, name) in failed.iter().zip(["cut.npz", "text.npz", "missing.npz"]) {
        assert!(one["error"].as_str().unwrap().contains(name), "{one}");
    }
    assert_eq!(summary["recordings"][0]["period_count"], 40);
    let node = summary["recordings"][0]["node"].as_str().unwrap();
    for ending in ["jsonl", "csv"] {
        assert!(folder.path().join("tracks").join(format!("{node}.{ending}")).is_file());
    }
}

#[test]
fn bad_files_and_settings_are_named() {
    let folder = recorded();
    std::fs::write(folder.path().join("walk.truth.jsonl"), "{\"period\": 1").unwrap();
    for (arguments, expected) in [
        (&["--figures", "figures"][..], "walk.truth.jsonl"),
        (&["--video", "walk.mp4"], ".gif"),
        (&["--out", "walk.npz"], "a recording to be read"),
        (&["--set", "tracking.mod=paper"], "tracking"),
        (&["--set", "tracking.paper.bin_count=1"], "tracking.paper.bin_count"),
    ] {
        let output = run(folder.path(), &[&["track", "walk.npz"][..], arguments].concat());
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(!output.status.success() && said.contains(expected), "{arguments:?}: {said}");
    }
}
