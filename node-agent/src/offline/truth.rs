//! The truth beside a recording of a simulated scene, one JSON line per period.

use std::io;
use std::path::{Path, PathBuf};

use proto::geom::Point;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::simulate::Truth;

/// Why the truth beside a recording cannot be used.
#[derive(Debug, Error)]
pub enum TruthError {
    /// It cannot be read.
    #[error("reading the truth {path:?}: {reason}")]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        reason: io::Error,
    },
    /// A line is no truth.
    #[error("the truth {path:?}, line {line}: {reason}; repair it or move it away")]
    Line {
        /// The file.
        path: PathBuf,
        /// Number of the line, from 1.
        line: usize,
        /// What is wrong.
        reason: serde_json::Error,
    },
}

/// Where the truth of `recording` is: `NAME.truth.jsonl`.
pub(super) fn truth_path(recording: &Path) -> PathBuf {
    recording.with_extension("truth.jsonl")
}

/// The true ways of everybody in a recording, `[x, y]` in metres in the node's frame, one way for
/// each target while it shows; none where no truth is beside the recording.
///
/// # Errors
/// If a truth is there that cannot be read.
pub fn true_ways(recording: &Path) -> Result<Vec<Vec<[f64; 2]>>, TruthError> {
    let path = truth_path(recording);
    let text = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(reason) => return Err(TruthError::Read { path, reason }),
    };
    let mut ways: Vec<Vec<[f64; 2]>> = Vec::new();
    for (index, written) in text.lines().enumerate() {
        let read = serde_json::from_str::<TruthLine>(written);
        let line = index + 1;
        let truth = read.map_err(|reason| TruthError::Line { path: path.clone(), line, reason })?;
        if ways.len() < truth.targets.len() {
            ways.resize(truth.targets.len(), Vec::new());
        }
        for (way, target) in ways.iter_mut().zip(&truth.targets).filter(|(_, one)| one.visible) {
            way.push([target.x_m, target.y_m]);
        }
    }
    ways.retain(|way| !way.is_empty());
    Ok(ways)
}

/// One period's truth, in the node's frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct TruthLine {
    period: u64,
    pub(super) time_s: f64,
    pub(super) targets: Vec<TrueTarget>,
    false_target: Option<Place>,
    ghosts: Vec<TrueGhost>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct TrueTarget {
    pub(super) x_m: f64,
    pub(super) y_m: f64,
    pub(super) visible: bool,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct TrueGhost {
    cause: String,
    target: usize,
    x_m: f64,
    y_m: f64,
    over_target_db: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Place {
    x_m: f64,
    y_m: f64,
}

impl TruthLine {
    pub(super) fn of(period: u64, time_s: f64, truth: &Truth) -> Self {
        let place = |point: &Point<_>| Place { x_m: point.coords_m.x, y_m: point.coords_m.y };
        let targets = truth.targets_in_node.iter().zip(&truth.visible).map(|(point, visible)| {
            let Place { x_m, y_m } = place(point);
            TrueTarget { x_m, y_m, visible: *visible }
        });
        let ghosts = truth.ghosts.iter().map(|ghost| {
            let Place { x_m, y_m } = place(&ghost.place);
            let (target, over_target_db) = (ghost.target_index, ghost.over_target_db);
            TrueGhost { cause: format!("{:?}", ghost.cause), target, x_m, y_m, over_target_db }
        });
        Self {
            period,
            time_s,
            targets: targets.collect(),
            false_target: truth.false_target.as_ref().map(place),
            ghosts: ghosts.collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn true_ways_are_read_where_they_are_and_damage_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let recording = folder.path().join("walk.npz");
        assert_eq!(true_ways(&recording).unwrap(), Vec::<Vec<[f64; 2]>>::new());
        let truth = |x_m: f64| Truth {
            targets_in_node: vec![Point::new(x_m, 2.0), Point::new(9.0, 9.0)],
            visible: vec![true, false],
            false_target: None,
            ghosts: Vec::new(),
        };
        let lines = [1.0, 1.5]
            .map(|x_m| serde_json::to_string(&TruthLine::of(0, 0.0, &truth(x_m))).unwrap() + "\n");
        let path = folder.path().join("walk.truth.jsonl");
        std::fs::write(&path, lines.concat()).unwrap();
        assert_eq!(true_ways(&recording).unwrap(), [[[1.0, 2.0], [1.5, 2.0]]]);
        std::fs::write(&path, lines.concat() + "{\"period\": 2").unwrap();
        let said = true_ways(&recording).unwrap_err().to_string();
        assert!(said.contains("walk.truth.jsonl") && said.contains("line 3"), "{said}");
        std::fs::remove_file(&path).unwrap();
        std::fs::create_dir(&path).unwrap();
        assert!(matches!(true_ways(&recording), Err(TruthError::Read { .. })));
    }
}
