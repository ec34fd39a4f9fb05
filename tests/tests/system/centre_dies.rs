//! Promise: a centre that is killed in mid-run and started again ends with everything registered.

use super::support::Run;

#[test]
fn agents_go_on_and_the_new_centre_is_told_what_it_missed() {
    let finished = Run::new(&["paper", "--speed", "2", "--kill", "centre@2"]).finish();
    assert!(finished.output.status.success(), "{}", finished.stderr());
    let incidents = finished.report["incidents"].as_array().unwrap();
    assert!(incidents.len() == 1 && incidents[0]["who"] == "centre", "{incidents:?}");
    for node in ["n1", "n2"] {
        let line = finished.node(node);
        assert_eq!(line["sets_received"], 8, "the new centre has all periods: {line}");
        assert_eq!(line["sets_missing"], 0, "{line}");
    }
    assert_eq!(finished.node("n2")["periods_used"], 8);
}
