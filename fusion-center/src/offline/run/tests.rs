//! Answers in order, and an end at once when told to stop.

use std::time::Duration;

use super::*;

const LINE: &str = r#"{"id":"a","reference":"n1","sets":[
    {"node":"n1","period":0,"time_s":0.0,"points":[{"x_m":3.0,"y_m":4.0,"cov_m2":[0.01,0.0,0.02]}]},
    {"node":"n2","period":0,"time_s":0.0,"points":[{"x_m":3.0,"y_m":4.0,"cov_m2":[0.01,0.0,0.02]}]}]}"#;
/// Longer than a stop may take, and short enough for other tests that wait for the same threads.
const SLOW: Duration = Duration::from_secs(3);
/// From the wish to stop to the end, seconds: a tenth of it on an idle machine.
const STOP_LIMIT_S: f64 = 2.0;

/// A solver that takes its time.
struct Sleeper;

impl Solver for Sleeper {
    fn name(&self) -> &'static str {
        "sleeper"
    }

    fn solve(&self, problem: &Problem, known: Option<&Known>) -> Solution {
        std::thread::sleep(SLOW);
        crate::registration::Pairwise::default().solve(problem, known)
    }
}

/// What `register` says of an input when it is told to stop at once, and after how long.
fn stopped(input: PathBuf) -> (String, f64) {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build().unwrap();
    let options = Options { input, reference: None, json: true, figures: None };
    let stop = CancellationToken::new();
    let clock = Clock::start();
    let result = runtime.block_on(async {
        let told = stop.clone();
        tokio::spawn(async move {
            tokio::time::sleep(Duration::from_millis(100)).await;
            told.cancel();
        });
        register(options, Arc::new(Sleeper), &stop).await
    });
    let taken_s = clock.now().since(proto::time::CentreTime(0)).as_secs_f64();
    // As the program does at its end: what still runs is left behind.
    runtime.shutdown_background();
    (result.unwrap_err().to_string(), taken_s)
}

#[test]
fn a_slow_solver_keeps_nobody_who_wants_to_stop() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("problems.jsonl");
    std::fs::write(&file, LINE.replace('\n', "") + "\n").unwrap();
    let (said, taken_s) = stopped(file);
    assert!(said.contains("stopped before the end of"), "{said}");
    assert!(taken_s < STOP_LIMIT_S, "{taken_s}");
    let line = |node: &str| {
        format!(
            "{{\"node\":\"{node}\",\"period\":0,\"time_s\":0.0,\
             \"points\":[{{\"x_m\":3.0,\"y_m\":4.0,\"cov_m2\":[0.01,0.0,0.02]}}]}}\n"
        )
    };
    let points = tempfile::tempdir().unwrap();
    std::fs::write(points.path().join("points.jsonl"), line("n1") + &line("n2")).unwrap();
    let (said_of_folder, taken_folder_s) = stopped(points.path().to_owned());
    assert!(said_of_folder.contains("stopped before the answer"), "{said_of_folder}");
    assert!(taken_folder_s < STOP_LIMIT_S, "{taken_folder_s}");
}

#[test]
fn answers_wait_for_those_before_them() {
    let rooms = Arc::new(Semaphore::new(4));
    let done = |index: u64| Done {
        index,
        byte_count: 10 + index,
        answered: Err(Failed { line: index, error: index.to_string() }),
        _room: Arc::clone(&rooms).try_acquire_owned().unwrap(),
    };
    let lines = |answers: &[Answered]| -> Vec<u64> {
        answers.iter().filter_map(|one| one.as_ref().err()).map(|failed| failed.line).collect()
    };
    let mut order = InOrder::default();
    order.take([done(2), done(1)].into_iter());
    let (none, no_bytes) = order.ready();
    assert!(none.is_empty() && no_bytes == 0);
    assert_eq!(rooms.available_permits(), 2, "what waits takes room");
    order.take([done(0), done(3)].into_iter());
    let (all, byte_count) = order.ready();
    assert_eq!((lines(&all), byte_count), (vec![0, 1, 2, 3], 46));
    assert_eq!(rooms.available_permits(), 4);
}
