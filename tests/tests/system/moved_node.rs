//! Promise: a node that is moved in a running site is noticed and registered anew by itself.

use super::support::Run;

/// The shipped scenario with the move of its node n3 replaced by a larger one, which no seed and no
/// load of the machine may hide.
fn larger_move() -> String {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../sim-harness/scenarios/moved-node.toml");
    let text = std::fs::read_to_string(path).unwrap();
    let own = "moves = [\"n3@36:0.12,0.09,3\"]";
    assert!(text.contains(own), "the scenario moves n3");
    text.replace(own, "moves = [\"n3@36:0.3,0.2,6\"]")
}

#[test]
fn a_node_moved_in_mid_run_ends_registered_where_it_is() {
    let folder = tempfile::TempDir::new().unwrap();
    let scenario = folder.path().join("moved.toml");
    std::fs::write(&scenario, larger_move()).unwrap();
    let finished = Run::new(&[scenario.to_str().unwrap(), "--speed", "2.5"]).finish();
    assert!(finished.output.status.success(), "{}", finished.stderr());
    let moved = finished.node("n3");
    assert_eq!((&moved["state"], &moved["outcome"]), (&"live".into(), &"determined".into()));
    let log = std::fs::read_to_string(finished.path("logs/centre.log")).unwrap();
    let noticed: Vec<&str> =
        log.lines().filter(|line| line.contains("seems to have been moved")).collect();
    assert!(noticed.first().is_some_and(|line| line.contains("node=n3")), "{noticed:?}");
}

#[test]
fn a_move_that_the_scene_does_not_reach_is_refused() {
    for (second, periods) in [("-1", "10"), ("900", "10")] {
        let shove = format!("--move=n2@{second}:0.1,0,3");
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_transmural-under-test"))
            .args(["run", "office", "--periods", periods, &shove])
            .output()
            .unwrap();
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && stderr.contains("scene time"), "{stderr}");
    }
}
