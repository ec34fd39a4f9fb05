//! Promise: a node that is moved in a running site is noticed and registered anew by itself.

use super::support::Run;

/// The office with people who walk on: the shipped scenario's stand still after 15 s.
fn office_that_goes_on() -> String {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../sim-harness/scenarios/office.toml");
    let mut text = std::fs::read_to_string(path).unwrap();
    for (last, more) in [
        ("x_m = 2.5, y_m = 6.0 }]", [(6.0, 2.5), (2.0, 4.0), (5.0, 6.0), (6.5, 2.0), (2.0, 2.5)]),
        ("x_m = 6.0, y_m = 2.0 }]", [(2.0, 6.0), (6.0, 5.5), (3.0, 2.0), (2.0, 6.5), (6.0, 4.0)]),
        ("x_m = 3.0, y_m = 4.0 }]", [(5.5, 2.0), (4.0, 6.5), (2.0, 3.0), (6.0, 6.0), (4.0, 2.0)]),
    ] {
        let mut longer = last.trim_end_matches(']').to_owned();
        for (index, (x_m, y_m)) in more.into_iter().enumerate() {
            let time_s = 20 + 5 * index;
            longer += &format!(", {{ time_s = {time_s}.0, x_m = {x_m:.1}, y_m = {y_m:.1} }}");
        }
        assert!(text.contains(last), "{last}");
        text = text.replacen(last, &(longer + "]"), 1);
    }
    text.replace("period_s = 0.5", "period_s = 0.25").replace("speed = 2.0", "speed = 1.0")
}

#[test]
fn a_node_moved_in_mid_run_ends_registered_where_it_is() {
    let folder = tempfile::TempDir::new().unwrap();
    let scenario = folder.path().join("office.toml");
    std::fs::write(&scenario, office_that_goes_on()).unwrap();
    let arguments = [scenario.to_str().unwrap(), "--periods", "150", "--move", "n3@18:0.3,0.2,6"];
    let finished = Run::new(&arguments).finish();
    assert!(finished.output.status.success(), "{}", finished.stderr());
    let moved = finished.node("n3");
    assert_eq!((&moved["state"], &moved["outcome"]), (&"live".into(), &"determined".into()));
    let log = std::fs::read_to_string(finished.path("logs/centre.log")).unwrap();
    let noticed: Vec<&str> =
        log.lines().filter(|line| line.contains("to have been moved")).collect();
    assert!(noticed.iter().any(|line| line.contains("n3")), "{noticed:?}");
}
