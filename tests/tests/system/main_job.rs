//! Promise: one command finds the poses and leaves a table, a report and pictures.

use super::support::Run;

#[test]
fn the_paper_scenario_is_registered_within_its_bounds() {
    let finished = Run::new(&["paper", "--speed", "8"]).finish();
    assert!(finished.output.status.success(), "{}", finished.stderr());
    assert_eq!(finished.report["success"], true);
    let incidents = finished.report["incidents"].as_array().unwrap();
    assert!(incidents.is_empty(), "every process ends well: {incidents:?}");
    let second = finished.node("n2");
    assert_eq!(second["outcome"], "determined");
    assert!(second["position_error_m"].as_f64().unwrap() < 0.05, "{second}");
    assert!(second["angle_error_deg"].as_f64().unwrap().abs() < 1.0, "{second}");
    for key in ["x_m", "y_m", "heading_rad"] {
        assert!(second["pose_ref_from_node"][key].is_f64() && second["truth"][key].is_f64());
    }
    assert!(second["solve_ms"].is_f64() && second["sigma"]["heading_deg"].is_f64());
    assert_eq!(second["sets_received"], 8);
    for picture in ["before.svg", "after.svg"] {
        let svg = std::fs::read_to_string(finished.path(picture)).unwrap();
        assert!(svg.starts_with("<svg") && svg.contains("n2"), "{picture}");
    }
    for node in ["n1", "n2"] {
        let png = std::fs::read(finished.path(&format!("images/{node}.png"))).unwrap();
        assert!(png.starts_with(b"\x89PNG"));
        let points = std::fs::read_to_string(finished.path(&format!("points/{node}.jsonl")));
        assert_eq!(points.unwrap().lines().count(), 8);
        assert!(finished.path(&format!("config/{node}.toml")).is_file());
    }
    assert!(finished.path("logs/centre.log").is_file() && finished.path("report.json").is_file());
}

#[test]
fn the_swarm_of_the_paper_can_be_chosen() {
    let finished = Run::new(&["paper", "--speed", "8", "--solver", "swarm"]).finish();
    assert!(finished.output.status.success(), "{}", finished.stderr());
    assert_eq!(finished.report["solver"], "swarm");
}

#[test]
fn too_little_to_go_on_is_said_and_not_guessed() {
    let finished = Run::new(&["paper", "--speed", "8", "--periods", "1"]).finish();
    assert!(!finished.output.status.success());
    let second = finished.node("n2");
    assert_eq!(second["outcome"], "underdetermined", "{second}");
    assert!(second["pose_ref_from_node"].is_null());
    assert!(second["missing"].as_str().unwrap().contains("needed"), "{second}");
}

#[test]
fn a_real_recording_agrees_with_the_tape_measure() {
    let folder = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../shared/data/bristol-3radar/multiple-tracking-jun05"
    );
    if !std::path::Path::new(folder).is_dir() {
        println!("skipped: {folder} is not there");
        return;
    }
    let finished = Run::new(&["recorded", "--recording", folder, "--speed", "16"]).finish();
    assert!(finished.output.status.success(), "{}", finished.stderr());
    let side = finished.node("side");
    assert!(side["position_error_m"].as_f64().unwrap() < 0.20, "{side}");
    assert!(side["angle_error_deg"].as_f64().unwrap().abs() < 6.0, "{side}");
    assert!(finished.path("images/side.png").is_file());
}
