//! Promise: recorded points are registered from a file, from standard input and from a folder, in
//! order, with poses that are right; a broken line is named and costs only itself.

use std::io::Write;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use fusion_center::registration::{Period, Problem};
use fusion_center::simulate::{Conditions, Trial, trial};
use proto::geom::{Frame, Gaussian, wrap_angle};
use serde_json::{Value, json};

/// Ten standard deviations of the scene's worst pose.
const NEAR_M: f64 = 0.3;

fn run(arguments: &[&str], input: &str, folder: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_transmural-under-test"));
    command.arg0("fusion-center").current_dir(folder).arg("register").args(arguments);
    command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    let mut stdin = child.stdin.take().unwrap();
    // A program that does not read its input may end first.
    drop(stdin.write_all(input.as_bytes()));
    drop(stdin);
    child.wait_with_output().unwrap()
}

fn points<F: Frame>(points: &[Gaussian<F>]) -> Vec<Value> {
    let point = |point: &Gaussian<F>| {
        let cov = &point.cov_m2;
        json!({ "x_m": point.mean.x_m(), "y_m": point.mean.y_m(),
            "cov_m2": [cov[(0, 0)], cov[(0, 1)], cov[(1, 1)]] })
    };
    points.iter().map(point).collect()
}

fn sets(problem: &Problem, node: &str, of: impl Fn(&Period) -> Vec<Value>) -> Vec<Value> {
    let set = |(period, at): (usize, &Period)| json!({ "node": node, "period": period, "time_s": at.ref_time_s, "points": of(at) });
    problem.periods.iter().enumerate().map(set).collect()
}

fn both_sets(case: &Trial) -> [Vec<Value>; 2] {
    [
        sets(&case.problem, "n1", |period| points(&period.in_ref)),
        sets(&case.problem, "n2", |period| points(&period.in_node)),
    ]
}

fn problem_line(id: &str, case: &Trial) -> String {
    let sets = both_sets(case).concat();
    json!({ "id": id, "reference": "n1", "sets": sets }).to_string()
}

fn assert_right(answer: &Value, case: &Trial) {
    let node = &answer["nodes"]["n2"];
    assert_eq!(node["outcome"], "determined", "{answer}");
    let number = |name: &str| node["pose_ref_from_node"][name].as_f64().unwrap();
    let truth = case.truth();
    let off_m = (number("x_m") - truth.x).hypot(number("y_m") - truth.y);
    let turned = wrap_angle(number("heading_rad") - truth.z);
    assert!(off_m < NEAR_M && turned.abs() < 0.1, "{off_m} {turned}: {answer}");
    assert!(node["covariance"][2][2].as_f64().unwrap() > 0.0);
}

fn lines(output: &Output) -> Vec<Value> {
    let text = String::from_utf8_lossy(&output.stdout);
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[test]
fn problems_are_answered_in_order_and_a_broken_line_costs_only_itself() {
    let folder = tempfile::tempdir().unwrap();
    let cases: Vec<Trial> = (0..5).map(|seed| trial(&Conditions::CLEAN, seed)).collect();
    let mut text: Vec<String> =
        cases.iter().enumerate().map(|(id, case)| problem_line(&id.to_string(), case)).collect();
    text.insert(2, text[0].replace("\"reference\":\"n1\"", "\"reference\":\"n9\""));
    let text = text.join("\n");
    std::fs::write(folder.path().join("problems.jsonl"), &text).unwrap();
    let from_file = run(&["problems.jsonl", "--json", "--figures", "maps"], "", folder.path());
    let answers = lines(&from_file);
    assert_eq!(answers.len(), 6);
    assert!(answers[2]["error"].as_str().unwrap().contains("line 3: reference has no sets"));
    let good: Vec<&Value> = answers.iter().filter(|answer| answer["error"].is_null()).collect();
    for (id, (answer, case)) in good.into_iter().zip(&cases).enumerate() {
        assert_eq!(answer["id"], id.to_string());
        assert_right(answer, case);
    }
    assert!(!from_file.status.success());
    let said = String::from_utf8_lossy(&from_file.stderr);
    assert!(said.contains("1 of 6 problems could not be read"), "{said}");
    for part in ["before", "after"] {
        let map = std::fs::read_to_string(folder.path().join(format!("maps/4.{part}.svg")));
        assert!(map.unwrap().contains("registration"));
    }
    let table = run(&["-"], &text, folder.path());
    let shown = String::from_utf8_lossy(&table.stdout).into_owned();
    assert!(shown.contains("determined") && shown.contains("n2"), "{shown}");
}

#[test]
fn a_folder_of_points_is_one_problem() {
    let folder = tempfile::tempdir().unwrap();
    let case = trial(&Conditions::CLEAN, 9);
    for (node, sets) in ["n1", "n2"].into_iter().zip(both_sets(&case)) {
        let text: Vec<String> = sets.iter().map(ToString::to_string).collect();
        std::fs::write(folder.path().join(format!("{node}.jsonl")), text.join("\n")).unwrap();
    }
    let output = run(&[".", "--json"], "", folder.path());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_right(&lines(&output)[0], &case);
    let refused = run(&[".", "--json", "--reference", "n3"], "", folder.path());
    let said = String::from_utf8_lossy(&refused.stderr);
    assert!(said.contains("reference has no sets; nodes with sets: n1, n2"), "{said}");
}
