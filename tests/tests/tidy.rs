//! House rules that no compiler checks. Each complaint says how to repair what it found.

#![allow(clippy::expect_used, reason = "an unreadable checkout should stop the test")]

use std::fs;
use std::path::{Path, PathBuf};

const CRATES: [&str; 5] = ["proto", "proto/chart", "node-agent", "fusion-center", "sim-harness"];

/// Longest source file, unit tests included.
const MAX_FILE_LINES: usize = 500;

/// Folders and files of pure functions: no clock, no network, no executor, no environment, no file.
const PURE: &[&str] = &[
    "proto/chart/src/",
    "proto/src/geodesy/",
    "proto/src/geom/",
    "proto/src/wire/",
    "proto/src/ids.rs",
    "proto/src/keys.rs",
    "proto/src/measured.rs",
    "proto/src/plots/fault.rs",
    "proto/src/plots/group.rs",
    "proto/src/plots/ingest.rs",
    "proto/src/plots/lines.rs",
    "proto/src/plots/row.rs",
    "proto/src/plots/stanag.rs",
    "proto/src/radar.rs",
    "proto/src/stanag4607/",
    "proto/src/time.rs",
    "node-agent/src/imaging/",
    "node-agent/src/detect/",
    "node-agent/src/group/",
    "node-agent/src/simulate/",
    "node-agent/src/gmti/simulate/",
    "node-agent/src/tracking/",
    "node-agent/src/plot/",
    "node-agent/src/pipeline.rs",
    "node-agent/src/source/simulated.rs",
    "fusion-center/src/export/",
    "fusion-center/src/gather/",
    "fusion-center/src/registration/",
    "fusion-center/src/network/",
    "fusion-center/src/simulate",
    "fusion-center/src/statistics.rs",
    "fusion-center/src/usable.rs",
    "fusion-center/src/pipeline/",
    "fusion-center/src/fuse.rs",
    "fusion-center/src/tracking/",
    "fusion-center/src/wide/",
    "fusion-center/src/map/centre.rs",
    "fusion-center/src/map/follower.rs",
    "fusion-center/src/map/geo.rs",
    "fusion-center/src/map/ground.rs",
    "fusion-center/src/map/messages.rs",
    "fusion-center/src/map/reorder.rs",
    "fusion-center/src/map/settings.rs",
    "sim-harness/src/metrics/",
];
const IMPURE_WORDS: [&str; 8] = [
    "tokio::",
    "zenoh::",
    "Instant::",
    "SystemTime",
    "std::env::var",
    "std::{env",
    "fs::",
    "std::net",
];

#[test]
fn every_source_file_says_what_it_holds() {
    expect_none(sources().filter(|source| !source.text.starts_with("//!")), |source| {
        format!("{}: begin with a `//!` sentence", source.name)
    });
}

#[test]
fn no_source_file_is_longer_than_the_limit() {
    expect_none(sources().filter(|source| MAX_FILE_LINES < source.line_count()), |source| {
        let lines = source.line_count();
        format!("{}: {lines} lines, limit {MAX_FILE_LINES}; split it by subject", source.name)
    });
}

#[test]
fn pure_folders_stay_pure() {
    let is_pure = |source: &Source| {
        let is_test = source.name.ends_with("tests.rs") || source.name.ends_with("bristol.rs");
        !is_test && PURE.iter().any(|place| source.name.contains(place))
    };
    let uses = sources().filter(is_pure).flat_map(|source| {
        let code = code_of(&source.text);
        let found = IMPURE_WORDS.into_iter().filter(|word| code.contains(word));
        found.map(|word| (source.name.clone(), word)).collect::<Vec<_>>()
    });
    expect_none(uses, |(name, word)| format!("{name}: uses {word}; pass the value in instead"));
}

#[test]
fn every_citation_is_in_the_bibliography() {
    let bibliography = fs::read_to_string(root().join("references.bib")).expect("references.bib");
    let cited = sources().flat_map(|source| {
        citation_keys(&source.text).map(|key| (source.name.clone(), key)).collect::<Vec<_>>()
    });
    let missing = cited.filter(|(_, key)| !bibliography.contains(&format!("{{{key},")));
    expect_none(missing, |(name, key)| format!("{name}: [{key}] is not in references.bib"));
}

/// The text without its comments and without the unit tests at its end.
fn code_of(text: &str) -> String {
    let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or(text);
    let lines = code.lines().filter(|line| !line.trim_start().starts_with("//"));
    lines.collect::<Vec<_>>().join("\n")
}

struct Source {
    name: String,
    text: String,
}

impl Source {
    fn line_count(&self) -> usize {
        self.text.lines().count()
    }
}

fn expect_none<T>(offences: impl Iterator<Item = T>, describe: impl Fn(T) -> String) {
    let complaints: Vec<String> = offences.map(describe).collect();
    assert!(complaints.is_empty(), "\n{}\n", complaints.join("\n"));
}

/// The keys of `\[key\]` or `\[key, eq. (7)\]` in comments.
fn citation_keys(text: &str) -> impl Iterator<Item = String> + '_ {
    let comments = text.lines().filter(|line| line.trim_start().starts_with("//"));
    let inside = comments.flat_map(|line| line.split("\\[").skip(1));
    inside.filter_map(|rest| Some(rest.split_once("\\]")?.0.split(',').next()?.to_owned()))
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn sources() -> impl Iterator<Item = Source> {
    let mut found = Vec::new();
    for name in CRATES {
        collect(&root().join(name).join("src"), &mut found);
    }
    assert!(!found.is_empty(), "no sources found: is the workspace where we think it is?");
    found.into_iter()
}

fn collect(folder: &Path, found: &mut Vec<Source>) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    for path in entries.filter_map(|entry| Some(entry.ok()?.path())) {
        if path.is_dir() {
            collect(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            let text = fs::read_to_string(&path).expect("readable source");
            let name = path.strip_prefix(root()).unwrap_or(&path).display().to_string();
            found.push(Source { name, text });
        }
    }
}
