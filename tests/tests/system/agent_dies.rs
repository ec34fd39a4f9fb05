//! Promise: an agent that is killed leaves the others unaffected and is shown as silent.

use super::support::Run;

#[test]
fn a_run_that_registered_nobody_is_no_success() {
    let finished =
        Run::new(&["paper", "--speed", "8", "--periods", "6", "--kill", "n2@0"]).finish();
    assert!(!finished.output.status.success());
    assert_eq!(finished.report["success"], false);
}

#[test]
fn the_others_are_unaffected_and_the_picture_names_the_silent_node() {
    let arguments = ["office", "--speed", "2", "--periods", "26", "--kill", "n3@2"];
    let finished = Run::new(&arguments).finish();
    assert!(finished.output.status.success(), "{}", finished.stderr());
    assert_eq!(finished.node("n3")["state"], "silent");
    for node in ["n2", "n4"] {
        let line = finished.node(node);
        assert_eq!((&line["state"], &line["outcome"]), (&"live".into(), &"determined".into()));
        assert_eq!(line["sets_received"], 26, "{line}");
    }
    let incidents = finished.report["incidents"].as_array().unwrap();
    assert!(incidents.len() == 1 && incidents[0]["who"] == "n3", "{incidents:?}");
}
