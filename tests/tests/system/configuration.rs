//! Promise: bad input gets an error that names the file, the key and the remedy.

use std::os::unix::process::CommandExt;
use std::process::Command;

/// Runs the program under another's name with these arguments; it must fail.
fn complaint(name: &str, arguments: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_transmural-under-test"));
    let output = command.arg0(name).args(arguments).output().unwrap();
    assert!(!output.status.success(), "{arguments:?} was taken");
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn a_bad_file_is_named_with_key_and_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bad.toml");
    let path_text = path.to_str().unwrap();
    for (text, expected) in [
        ("sit = \"lab\"", "sit"),
        ("node = \"N 1\"", "a-z"),
        ("[play]\nspeed = -1.0", "play.speed is -1: use 0.001 to 1000"),
        ("[bus]\nconnect = [\"udp/x\"]", "tcp/HOST:PORT"),
        ("source = \"recorded\"", "recorded.path"),
    ] {
        std::fs::write(&path, text).unwrap();
        let said = complaint("node-agent", &["--config", path_text]);
        assert!(said.contains(expected) && said.contains("bad.toml"), "{text}: {said}");
    }
    std::fs::write(&path, "[gather]\nperiod_s = 0.0").unwrap();
    let said = complaint("fusion-center", &["--config", path_text]);
    assert!(said.contains("gather.period_s is 0") && said.contains("bad.toml"), "{said}");
}

#[test]
fn missing_files_and_unknown_names_are_named() {
    for (name, arguments, expected) in [
        ("node-agent", &["--config", "no-such.toml"][..], "no-such.toml"),
        ("node-agent", &["--recording", "no-such.csv"], "no-such.csv"),
        ("node-agent", &["--echoes", "no-such.npz"], "no-such.npz"),
        ("node-agent", &["process", "no-such.npz"], "no-such.npz"),
        ("node-agent", &["record", "--out", "echoes.wav", "--periods", "1"], "echoes.wav"),
        ("node-agent", &["record", "--out", "echoes.npz"], "--periods"),
        ("node-agent", &["--set", "chain.fft_lenght=1"], "fft_lenght"),
        ("sim-harness", &["run", "atlantis"], "neither a shipped scenario (paper"),
        ("sim-harness", &["run", "recorded", "--recording", "nowhere"], "nowhere/extrinsics.json"),
        ("sim-harness", &["run", "paper", "--kill", "n7@1"], "n7"),
        ("sim-harness", &["run", "paper", "--periods", "0"], "period_count is 0"),
    ] {
        let said = complaint(name, arguments);
        assert!(said.contains(expected), "{arguments:?}: {said}");
    }
}

#[test]
fn a_port_that_is_taken_is_named() {
    let taken = std::net::TcpListener::bind(("127.0.0.1", 0)).unwrap();
    let endpoint = format!("tcp/127.0.0.1:{}", taken.local_addr().unwrap().port());
    let said = complaint("fusion-center", &["--listen", &endpoint]);
    assert!(said.contains(&endpoint) && said.contains("--listen"), "{said}");
}
