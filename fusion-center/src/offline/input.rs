//! Registration problems from JSON Lines and from folders of points.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufRead, BufReader};
use std::path::{Path, PathBuf};

use nalgebra::Vector2;
use proto::geom::{Gaussian, Node, principal_axes};
use proto::ids::NodeId;
use proto::measured::{MeasuredPoint, symmetric};
use serde::Deserialize;
use serde::de::IgnoredAny;
use thiserror::Error;

use crate::network::{NodeView, SeenSet, SiteProblem};
use crate::statistics::median;

/// Largest coordinate, metres: farther out is no radar measurement.
const MAX_COORDINATE_M: f64 = 1e5;

/// Standard deviations in any direction that a measured point may have, metres.
const SIGMAS_M: std::ops::RangeInclusive<f64> = 1e-4..=300.0;

/// Share of the time between periods by which the sets of one period may lie apart and still be
/// taken by one clock.
const SAME_CLOCK_SHARE: f64 = 0.5;

/// A problem with its name.
#[derive(Clone, Debug)]
pub struct Asked {
    /// As given: text or a number.
    pub id: serde_json::Value,
    /// The problem.
    pub problem: SiteProblem,
    /// What was assumed because the input left no better choice.
    pub warnings: Vec<String>,
}

/// Why an input cannot be used.
#[derive(Debug, Error)]
pub enum InputError {
    /// A file or folder cannot be read.
    #[error("reading {path}: {source}")]
    Read {
        /// Which.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A line is not what it should be.
    #[error("{place}: {source}")]
    Parse {
        /// File and line.
        place: String,
        /// What is wrong, and where in the line.
        source: serde_json::Error,
    },
    /// A file of the other kind.
    #[error("{place}: {complaint}")]
    Kind {
        /// File and line.
        place: String,
        /// What it is, and what to do.
        complaint: &'static str,
    },
    /// A value makes no sense.
    #[error("{place}: {field} {complaint}")]
    Value {
        /// File and line.
        place: String,
        /// Which field.
        field: String,
        /// What is wrong, and what would do.
        complaint: String,
    },
    /// A folder without points.
    #[error(
        "{path} holds no file NAME.jsonl of points: name a folder that `node-agent process --out` or `sim-harness run` wrote"
    )]
    Empty {
        /// The folder.
        path: PathBuf,
    },
}

#[derive(Deserialize)]
#[serde(
    deny_unknown_fields,
    expecting = "a problem: {\"id\", \"reference\", \"sets\"}, one per line"
)]
struct ProblemLine {
    id: serde_json::Value,
    reference: NodeId,
    sets: Vec<SetLine>,
}

/// One node's points of one period; the line that agents and `node-agent process` write.
#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "a set: {\"node\", \"period\", \"time_s\", \"points\"}")]
struct SetLine {
    node: NodeId,
    period: i64,
    time_s: f64,
    points: Vec<PointLine>,
    #[serde(default)]
    half_depth_m: f64,
    #[serde(default)]
    half_depth_sigma_m: f64,
    #[serde(default, rename = "counters")]
    _counters: IgnoredAny,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PointLine {
    x_m: f64,
    y_m: f64,
    cov_m2: [f64; 3],
    #[serde(default, rename = "snr_db")]
    _snr_db: IgnoredAny,
    #[serde(default, rename = "extent_m2")]
    _extent_m2: IgnoredAny,
    #[serde(default, rename = "radial_velocity_m_per_s")]
    _radial_velocity_m_per_s: IgnoredAny,
}

/// Reads one problem; `place` names file and line for messages.
///
/// # Errors
/// If the line is not a problem, with the field that is wrong.
pub fn read_problem(place: &str, line: &str) -> Result<Asked, InputError> {
    let parsed = parse(place, line);
    if parsed.is_err() && serde_json::from_str::<SetLine>(line).is_ok() {
        let complaint =
            "a set of points, not a problem: name its folder to register all nodes in it";
        return Err(InputError::Kind { place: place.to_owned(), complaint });
    }
    let ProblemLine { id, reference, sets } = parsed?;
    if !(id.is_string() || id.is_number()) {
        return Err(invalid(place, "id", "is neither text nor a number: give it a name"));
    }
    let mut views = Views::default();
    for (index, set) in sets.into_iter().enumerate() {
        views.take(place, &format!("sets[{index}]"), set)?;
    }
    views.asked(place, id, Some(reference))
}

/// Reads a folder of points: every file `*.jsonl` in it and in the folders one level below is of
/// one or several nodes. The reference is the first node by name unless given.
///
/// # Errors
/// If a file cannot be read or a line in it is not a set of points. A last line that was cut short
/// is left out with a warning: an agent that was killed leaves one.
pub fn read_folder(folder: &Path, reference: Option<NodeId>) -> Result<Asked, InputError> {
    let mut files = files_in(folder)?;
    for inner in folders_in(folder)? {
        files.extend(files_in(&inner)?);
    }
    if files.is_empty() {
        return Err(InputError::Empty { path: folder.to_owned() });
    }
    let mut views = Views::default();
    for file in &files {
        views.take_file(file)?;
    }
    let name = folder
        .canonicalize()
        .ok()
        .and_then(|path| path.file_name().map(|name| name.to_string_lossy().into_owned()));
    let id = serde_json::Value::String(name.unwrap_or_else(|| folder.display().to_string()));
    views.asked(&folder.display().to_string(), id, reference)
}

fn parse<'a, T: Deserialize<'a>>(place: &str, line: &'a str) -> Result<T, InputError> {
    if line.starts_with("\u{1f}\u{fffd}") || line.starts_with("PK\u{3}") {
        let complaint = "a compressed file: unpack it first";
        return Err(InputError::Kind { place: place.to_owned(), complaint });
    }
    serde_json::from_str(line.trim_start_matches('\u{feff}'))
        .map_err(|source| InputError::Parse { place: place.to_owned(), source })
}

fn invalid(place: &str, field: &str, complaint: &str) -> InputError {
    let (place, field, complaint) = (place.to_owned(), field.to_owned(), complaint.to_owned());
    InputError::Value { place, field, complaint }
}

fn entries(folder: &Path) -> Result<Vec<PathBuf>, InputError> {
    let failed = |source| InputError::Read { path: folder.to_owned(), source };
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        paths.push(entry.map_err(failed)?.path());
    }
    paths.sort();
    Ok(paths)
}

fn files_in(folder: &Path) -> Result<Vec<PathBuf>, InputError> {
    let is_points = |path: &PathBuf| {
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned());
        let name = name.unwrap_or_default();
        path.is_file() && name.ends_with(".jsonl") && !name.ends_with(".truth.jsonl")
    };
    Ok(entries(folder)?.into_iter().filter(is_points).collect())
}

fn folders_in(folder: &Path) -> Result<Vec<PathBuf>, InputError> {
    Ok(entries(folder)?.into_iter().filter(|path| path.is_dir()).collect())
}

#[derive(Default)]
struct Views {
    views: BTreeMap<NodeId, NodeView>,
    warnings: Vec<String>,
}

impl Views {
    fn take_file(&mut self, path: &Path) -> Result<(), InputError> {
        let failed = |source| InputError::Read { path: path.to_owned(), source };
        let mut input = BufReader::new(File::open(path).map_err(failed)?);
        let mut bytes = Vec::new();
        for number in 1_u64.. {
            bytes.clear();
            if input.read_until(b'\n', &mut bytes).map_err(failed)? == 0 {
                break;
            }
            let line = String::from_utf8_lossy(&bytes);
            if line.trim().is_empty() {
                continue;
            }
            let place = format!("{}, line {number}", path.display());
            match parse(&place, &line) {
                Ok(set) => self.take(&place, "set", set)?,
                Err(InputError::Parse { source, .. })
                    if source.is_eof() && !line.ends_with('\n') =>
                {
                    self.warnings.push(format!("{place}: cut short, left out"));
                }
                Err(_) if serde_json::from_str::<ProblemLine>(&line).is_ok() => {
                    let complaint = "a problem, not a set of points: name the file, not its folder";
                    return Err(InputError::Kind { place, complaint });
                }
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    fn take(&mut self, place: &str, field: &str, set: SetLine) -> Result<(), InputError> {
        let complain = |part: &str, complaint: &str| {
            Err(invalid(place, &format!("{field}.{part}"), complaint))
        };
        if !set.time_s.is_finite() {
            return complain("time_s", "is not finite");
        }
        let depths =
            [("half_depth_m", set.half_depth_m), ("half_depth_sigma_m", set.half_depth_sigma_m)];
        for (name, value) in depths {
            if !(0.0..=2.0).contains(&value) {
                return complain(name, &format!("is {value}: use 0 to 2"));
            }
        }
        let mut points = Vec::with_capacity(set.points.len());
        for (index, point) in set.points.iter().enumerate() {
            match placed(point, set.half_depth_m) {
                Ok(point) => points.push(point),
                Err((name, complaint)) => {
                    return complain(&format!("points[{index}].{name}"), &complaint);
                }
            }
        }
        let view = self.views.entry(set.node.clone()).or_default();
        view.half_depth_sigma_m = view.half_depth_sigma_m.max(set.half_depth_sigma_m);
        if view.sets.insert(set.period, SeenSet { time_s: set.time_s, points }).is_some() {
            let (node, period) = (set.node, set.period);
            let complaint = format!("is {period}, which node {node} already had: give each once");
            return complain("period", &complaint);
        }
        Ok(())
    }

    fn asked(
        mut self,
        place: &str,
        id: serde_json::Value,
        reference: Option<NodeId>,
    ) -> Result<Asked, InputError> {
        let known: Vec<String> = self.views.keys().map(ToString::to_string).collect();
        let first = self.views.keys().next().cloned();
        let Some(reference) = reference.or(first).filter(|node| self.views.contains_key(node))
        else {
            let with_sets = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
            let complaint = format!("has no sets; nodes with sets: {with_sets}");
            return Err(invalid(place, "reference", &complaint));
        };
        if known.len() == 1 {
            self.warnings.push(format!("only {reference} has sets: nothing to register"));
        }
        self.warnings.extend(on_one_clock(&reference, &mut self.views));
        let problem = SiteProblem { reference, views: self.views };
        Ok(Asked { id, problem, warnings: self.warnings })
    }
}

/// The point with its covariance, moved to the target's middle; else the field that is wrong.
fn placed(line: &PointLine, half_depth_m: f64) -> Result<Gaussian<Node>, (&'static str, String)> {
    for (name, value) in [("x_m", line.x_m), ("y_m", line.y_m)] {
        if value.abs() > MAX_COORDINATE_M {
            return Err((name, format!("is {value:e}: no radar sees that far")));
        }
    }
    let [xx, xy, yy] = line.cov_m2;
    if !(xx > 0.0 && yy > 0.0 && xx * yy > xy * xy) {
        let complaint = format!("[{xx:e}, {xy:e}, {yy:e}] is no positive definite [xx, xy, yy]");
        return Err(("cov_m2", complaint));
    }
    let (major_m, minor_m, _) = principal_axes(&symmetric(line.cov_m2));
    if !(SIGMAS_M.contains(&minor_m) && SIGMAS_M.contains(&major_m)) {
        let complaint = format!(
            "means standard deviations of {minor_m:.1e} and {major_m:.1e} m: 1e-4 to 300 m are usable"
        );
        return Err(("cov_m2", complaint));
    }
    let point = MeasuredPoint {
        x_m: line.x_m,
        y_m: line.y_m,
        cov_m2: line.cov_m2,
        snr_db: 0.0,
        extent_m2: [0.0; 3],
        radial_velocity_m_per_s: None,
    };
    Ok(point.middle(half_depth_m, 0.0))
}

/// Nodes whose sets lie too far from the reference's of the same period are taken as simultaneous:
/// their times are another clock's. Returns what was assumed.
fn on_one_clock(reference: &NodeId, views: &mut BTreeMap<NodeId, NodeView>) -> Vec<String> {
    let mut common: BTreeMap<i64, f64> = BTreeMap::new();
    let others = views.iter().filter(|(node, _)| *node != reference).map(|(_, view)| view);
    for view in views.get(reference).into_iter().chain(others) {
        for (period, set) in &view.sets {
            common.entry(*period).or_insert(set.time_s);
        }
    }
    let mut steps: Vec<f64> = common
        .iter()
        .zip(common.iter().skip(1))
        .map(|((before, from), (after, to))| (to - from).abs() / (*after as f64 - *before as f64))
        .collect();
    let tolerance_s = SAME_CLOCK_SHARE * median(&mut steps);
    let mut assumed = Vec::new();
    for (node, view) in views {
        let mut apart: Vec<f64> =
            view.sets.iter().map(|(period, set)| (set.time_s - common[period]).abs()).collect();
        let apart_s = median(&mut apart);
        if apart_s > tolerance_s {
            view.sets.iter_mut().for_each(|(period, set)| set.time_s = common[period]);
            assumed.push(format!(
                "{node}: its times lie {apart_s:.3} s from the other nodes' in the same periods: \
                 another clock's; taken as simultaneous"
            ));
        }
    }
    assumed
}

/// All points of a node.
pub(super) fn points_of(view: &NodeView) -> impl Iterator<Item = Vector2<f64>> {
    view.sets.values().flat_map(|set| set.points.iter().map(|point| point.mean.coords_m))
}

#[cfg(test)]
mod tests {
    use super::*;

    const LINE: &str = r#"{"id":"a","reference":"n1","sets":[
        {"node":"n1","period":0,"time_s":0.0,"points":[{"x_m":3.0,"y_m":4.0,"cov_m2":[0.01,0.0,0.02]}]},
        {"node":"n2","period":0,"time_s":0.1,"points":[],"half_depth_m":0.1,"half_depth_sigma_m":0.05},
        {"node":"n1","period":1,"time_s":1.0,"points":[]}]}"#;

    #[test]
    fn a_problem_is_read_with_its_middles_and_spreads() {
        let deep = LINE.replace("\"points\":[{", "\"half_depth_m\":0.5,\"points\":[{");
        let asked = read_problem("here", &deep).unwrap();
        assert_eq!(asked.id, "a");
        assert!(asked.warnings.is_empty(), "{:?}", asked.warnings);
        let view = &asked.problem.views[&"n1".parse().unwrap()];
        let point = view.sets[&0].points[0];
        assert!((point.mean.coords_m - Vector2::new(3.3, 4.4)).norm() < 1e-12);
        assert!((point.cov_m2[(1, 1)] - 0.02).abs() < 1e-15);
        let other = &asked.problem.views[&"n2".parse().unwrap()];
        assert!((other.half_depth_sigma_m - 0.05).abs() < 1e-15);
    }

    #[test]
    fn every_fault_names_its_field_and_a_remedy() {
        for (from, to, expected) in [
            ("\"id\":\"a\"", "\"id\":[]", "id is neither"),
            (
                "\"reference\":\"n1\"",
                "\"reference\":\"n7\"",
                "reference has no sets; nodes with sets: n1, n2",
            ),
            ("\"period\":1", "\"period\":0", "sets[2].period is 0, which node n1 already had"),
            ("[0.01,0.0,0.02]", "[0.01,0.1,0.02]", "sets[0].points[0].cov_m2 [1e-2, 1e-1, 2e-2]"),
            ("\"x_m\":3.0", "\"x_m\":3e7", "sets[0].points[0].x_m is 3e7"),
            (
                "\"half_depth_m\":0.1",
                "\"half_depth_m\":-1",
                "sets[1].half_depth_m is -1: use 0 to 2",
            ),
            ("\"x_m\":3.0", "\"z_m\":3.0", "unknown field `z_m`"),
            ("\"node\":\"n2\"", "\"node\":\"N 2\"", "N 2"),
            ("\"time_s\":1.0", "\"time_s\":1e999", "number out of range"),
        ] {
            let broken = LINE.replace(from, to);
            assert_ne!(broken, LINE);
            let complaint = read_problem("p.jsonl, line 3", &broken).unwrap_err().to_string();
            assert!(complaint.contains(expected), "{complaint}");
            assert!(complaint.starts_with("p.jsonl, line 3: "), "{complaint}");
        }
    }

    #[test]
    fn times_of_another_clock_are_taken_as_simultaneous_and_said() {
        let asked =
            read_problem("here", &LINE.replace("\"time_s\":0.1", "\"time_s\":77.0")).unwrap();
        let other = &asked.problem.views[&"n2".parse().unwrap()];
        assert!(other.sets[&0].time_s.abs() < 1e-12);
        assert!(
            asked.warnings[0].starts_with("n2: its times lie 77.000 s"),
            "{:?}",
            asked.warnings
        );
    }

    #[test]
    fn a_folder_is_one_problem_and_a_line_cut_short_is_left_out() {
        let folder = tempfile::tempdir().unwrap();
        let line = |node: &str, period: i64| {
            format!(
                "{{\"node\":\"{node}\",\"period\":{period},\"time_s\":{period}.0,\"points\":[],\
                 \"counters\":{{\"frame_count\":1}}}}\n"
            )
        };
        let write = |name: &str, text: String| std::fs::write(folder.path().join(name), text);
        assert!(matches!(read_folder(folder.path(), None), Err(InputError::Empty { .. })));
        write("b.jsonl", line("n2", 0) + &line("n2", 1)).unwrap();
        std::fs::create_dir(folder.path().join("n1")).unwrap();
        write("n1/points.jsonl", line("n1", 0) + "{\"node\":\"n1\",\"per").unwrap();
        write("walk.truth.jsonl", "nothing".to_owned()).unwrap();
        let asked = read_folder(folder.path(), None).unwrap();
        assert_eq!(asked.problem.reference.to_string(), "n1");
        assert_eq!(asked.problem.views.len(), 2);
        assert!(asked.warnings[0].contains("line 2: cut short"), "{:?}", asked.warnings);
        write("c.jsonl", "{}\n".to_owned()).unwrap();
        let complaint = read_folder(folder.path(), None).unwrap_err().to_string();
        assert!(complaint.contains("c.jsonl, line 1: missing field `node`"), "{complaint}");
        let nowhere = read_folder(&folder.path().join("nowhere"), None);
        assert!(matches!(nowhere, Err(InputError::Read { .. })));
    }
}
