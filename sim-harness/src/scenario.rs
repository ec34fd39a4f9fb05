//! What is to be run: nodes with their true poses, what they see, and how good the result must be.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use node_agent::source::recorded::read_recording;
use proto::geom::{Node, Ref, Se2, World};
use proto::ids::NodeId;
use serde::{Deserialize, Serialize};

use crate::moves::NodeMove;

/// The scenarios that come with the program.
const SHIPPED: [(&str, &str); 7] = [
    ("paper", include_str!("../scenarios/paper.toml")),
    ("office", include_str!("../scenarios/office.toml")),
    ("moved-node", include_str!("../scenarios/moved-node.toml")),
    ("recorded", include_str!("../scenarios/recorded.toml")),
    ("load", include_str!("../scenarios/load.toml")),
    ("paper-physical", include_str!("../scenarios/paper-physical.toml")),
    ("measured-room", include_str!("../scenarios/measured-room.toml")),
];

/// Longest recording that is played, seconds: a day.
const MAX_RECORDING_S: f64 = 86_400.0;

/// A scenario file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// Short name.
    pub name: String,
    /// One line for people.
    pub title: String,
    /// The node whose frame is the common frame; for recordings that of the extrinsics.
    #[serde(default = "first_node")]
    pub reference: NodeId,
    /// Length of a period in scene time, seconds.
    pub period_s: f64,
    /// Number of periods; for recordings all if left out.
    pub period_count: Option<u64>,
    /// Seconds of the scene per second.
    #[serde(default = "real_time")]
    pub speed: f64,
    /// Seed of everything random.
    #[serde(default)]
    pub seed: u64,
    /// How good the result must be.
    pub bounds: Bounds,
    /// The nodes; none for recordings.
    #[serde(default)]
    pub nodes: Vec<NodePlan>,
    /// A recording to play instead of simulating.
    pub recording: Option<RecordingPlan>,
    /// Keys of every agent's configuration.
    #[serde(default)]
    pub agent: toml::Table,
    /// More keys of single nodes' agents; names that a recording lacks are passed over.
    #[serde(default)]
    pub agent_of: BTreeMap<NodeId, toml::Table>,
    /// Keys of the centre's configuration.
    #[serde(default)]
    pub centre: toml::Table,
    /// Processes to kill on the way.
    #[serde(default)]
    pub kills: Vec<Kill>,
    /// Nodes to move on the way; the result is held against the last pose.
    #[serde(default)]
    pub moves: Vec<NodeMove>,
}

fn first_node() -> NodeId {
    NodeId::try_from("n1".to_owned()).unwrap_or_else(|_| unreachable!("a valid name"))
}

fn real_time() -> f64 {
    1.0
}

/// How good the result must be.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bounds {
    /// Largest position error, metres.
    pub position_m: f64,
    /// Largest angle error, degrees.
    pub angle_deg: f64,
    /// Share of the seeds that must succeed where many are run.
    #[serde(default = "all")]
    pub seed_share: f64,
    /// Nodes with bounds of their own.
    #[serde(default)]
    pub node: BTreeMap<NodeId, NodeBounds>,
}

fn all() -> f64 {
    1.0
}

/// One node's own bounds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NodeBounds {
    /// Largest position error, metres.
    pub position_m: f64,
    /// Largest angle error, degrees.
    pub angle_deg: f64,
    /// The node need not be registered; if it is, the bounds hold.
    #[serde(default)]
    pub is_optional: bool,
}

impl Bounds {
    /// Checks that every bound can be kept and can be missed.
    fn check(&self) -> anyhow::Result<()> {
        let own = self.node.values().map(|bounds| (bounds.position_m, bounds.angle_deg));
        for (position_m, angle_deg) in own.chain([(self.position_m, self.angle_deg)]) {
            ensure!((0.0..=1e3).contains(&position_m), "position_m is {position_m}: use 0 to 1000");
            ensure!((0.0..=180.0).contains(&angle_deg), "angle_deg is {angle_deg}: use 0 to 180");
        }
        let share = self.seed_share;
        ensure!((0.0..=1.0).contains(&share), "seed_share is {share}: use 0 to 1");
        Ok(())
    }

    /// The bounds of one node.
    #[must_use]
    pub fn of(&self, node: &NodeId) -> NodeBounds {
        let common = NodeBounds {
            position_m: self.position_m,
            angle_deg: self.angle_deg,
            is_optional: false,
        };
        self.node.get(node).copied().unwrap_or(common)
    }
}

/// One node's true place.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NodePlan {
    /// Name.
    pub id: NodeId,
    /// Where the array's centre is in the world, metres.
    pub x_m: f64,
    /// Where the array's centre is in the world, metres.
    pub y_m: f64,
    /// How far it is turned: 0 looks along the world's `y`, counter-clockwise.
    pub heading_deg: f64,
    /// Height above the floor, where a recording states it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub height_m: Option<f64>,
}

impl NodePlan {
    /// The true pose in the world.
    #[must_use]
    pub fn pose_world_from_node(&self) -> Se2<World, Node> {
        Se2::new(self.x_m, self.y_m, self.heading_deg.to_radians())
    }
}

/// A folder with one file of detections per node and an `extrinsics.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordingPlan {
    /// The folder.
    pub folder: PathBuf,
    /// Time in the recording at which to start; that of the earliest detection if left out.
    pub first_s: Option<f64>,
}

/// A process to kill without warning.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Kill {
    /// A node's name, or `centre`.
    pub who: String,
    /// Milliseconds after the start of the first period.
    pub after_ms: u64,
}

impl TryFrom<String> for Kill {
    type Error = anyhow::Error;

    fn try_from(text: String) -> anyhow::Result<Self> {
        text.parse()
    }
}

impl From<Kill> for String {
    fn from(kill: Kill) -> Self {
        format!("{}@{}ms", kill.who, kill.after_ms)
    }
}

impl std::str::FromStr for Kill {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> anyhow::Result<Self> {
        let form = "write WHO@SECONDS, such as centre@2.5 or n2@3";
        let (who, when) = text.split_once('@').context(form)?;
        let after_ms = match when.strip_suffix("ms") {
            Some(ms) => ms.parse().context(form)?,
            None => {
                let seconds: f64 = when.parse().context(form)?;
                let after = std::time::Duration::try_from_secs_f64(seconds).context(form)?;
                u64::try_from(after.as_millis()).context(form)?
            }
        };
        Ok(Self { who: who.to_owned(), after_ms })
    }
}

/// The extrinsics of a recording, as its folder states them.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Extrinsics {
    reference: NodeId,
    pose_ref_from_node: BTreeMap<NodeId, SurveyedPose>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct SurveyedPose {
    x_m: f64,
    y_m: f64,
    heading_deg: f64,
    height_m: Option<f64>,
}

/// Names and titles of the shipped scenarios.
///
/// # Errors
/// Never for a released program: a test reads them all.
pub fn shipped() -> anyhow::Result<Vec<Scenario>> {
    SHIPPED.iter().map(|(name, text)| parse(text, name)).collect()
}

/// The scenario of this name, or in the file of this path.
///
/// # Errors
/// If there is none, or it makes no sense.
pub fn find(name: &str) -> anyhow::Result<Scenario> {
    if let Some((name, text)) = SHIPPED.iter().find(|(known, _)| *known == name) {
        return parse(text, name);
    }
    let known: Vec<&str> =
        SHIPPED.iter().map(|(known, _)| *known).chain([crate::wide_run::SHIPPED.0]).collect();
    let text = std::fs::read_to_string(name).with_context(|| {
        format!("{name:?} is neither a shipped scenario ({}) nor a readable file", known.join(", "))
    })?;
    parse(&text, name)
}

fn parse(text: &str, name: &str) -> anyhow::Result<Scenario> {
    toml::from_str(text).with_context(|| format!("scenario {name}"))
}

impl Scenario {
    /// Reads the recording's extrinsics, if there is a recording, and checks the whole.
    ///
    /// # Errors
    /// If a file is missing, or something makes no sense.
    pub fn resolve(mut self) -> anyhow::Result<Self> {
        if let Some(mut recording) = self.recording.take() {
            self.take_extrinsics(&recording.folder)?;
            if recording.first_s.is_none() {
                recording.first_s = self.earliest_s(&recording.folder)?;
            }
            self.recording = Some(recording);
        }
        ensure!(2 <= self.nodes.len(), "scenario {}: list at least two nodes", self.name);
        let ids: std::collections::BTreeSet<&NodeId> = self.nodes.iter().map(|n| &n.id).collect();
        ensure!(ids.len() == self.nodes.len(), "scenario {}: a node is listed twice", self.name);
        let (reference, name) = (&self.reference, &self.name);
        ensure!(ids.contains(reference), "scenario {name}: reference {reference} is not a node");
        let playable = 0.001 <= self.speed && self.speed <= 1000.0;
        ensure!(playable, "scenario {name}: speed is {}: use 0.001 to 1000", self.speed);
        let period_s = self.period_s;
        ensure!(
            (1e-3..=60.0).contains(&period_s),
            "scenario {name}: period_s is {period_s}: use 0.001 to 60"
        );
        ensure!(self.period_count != Some(0), "scenario {name}: period_count is 0: use 1 or more");
        self.bounds.check().with_context(|| format!("scenario {name}"))?;
        for Kill { who, .. } in &self.kills {
            let known = who == "centre" || ids.iter().any(|id| id.as_str() == who);
            ensure!(known, "kill {who}: not a node of scenario {name}, and not `centre`");
        }
        self.moves.sort_by(|one, other| one.at_s.total_cmp(&other.at_s));
        for one in &self.moves {
            ensure!(self.recording.is_none(), "scenario {name}: a recording has no moves");
            let is_node = self.nodes.iter().any(|plan| plan.id == one.node);
            ensure!(is_node, "move {}: not a node of scenario {name}", one.node);
            let end_s = self.period_count.map(|count| count as f64 * period_s);
            one.check_time(end_s).with_context(|| format!("scenario {name}"))?;
        }
        Ok(self)
    }

    fn take_extrinsics(&mut self, folder: &Path) -> anyhow::Result<()> {
        let path = folder.join("extrinsics.json");
        let text = std::fs::read_to_string(&path).with_context(|| {
            format!(
                "reading {}: give --recording FOLDER, a folder with extrinsics.json and one CSV \
                 or JSON Lines file per node",
                path.display()
            )
        })?;
        let extrinsics: Extrinsics =
            serde_json::from_str(&text).with_context(|| path.display().to_string())?;
        self.reference = extrinsics.reference;
        self.nodes = extrinsics
            .pose_ref_from_node
            .into_iter()
            .map(|(id, SurveyedPose { x_m, y_m, heading_deg, height_m })| NodePlan {
                id,
                x_m,
                y_m,
                heading_deg,
                height_m,
            })
            .collect();
        Ok(())
    }

    /// The file of one node's detections.
    ///
    /// # Errors
    /// If there is none.
    pub fn recording_of(&self, folder: &Path, node: &NodeId) -> anyhow::Result<PathBuf> {
        let candidates = ["csv", "jsonl"].map(|ending| folder.join(format!("{node}.{ending}")));
        let Some(found) = candidates.into_iter().find(|path| path.is_file()) else {
            bail!("{}: neither {node}.csv nor {node}.jsonl is there", folder.display());
        };
        // Agents may be started elsewhere.
        found.canonicalize().with_context(|| found.display().to_string())
    }

    /// When the earliest detection of any node was: agents must cut the recording alike. Files whose
    /// times do not meet are not of one recording.
    fn earliest_s(&self, folder: &Path) -> anyhow::Result<Option<f64>> {
        let mut ranges_s = Vec::new();
        for node in &self.nodes {
            let detections = read_recording(&self.recording_of(folder, &node.id)?)?.detections;
            if let [first, .., last] = detections.as_slice() {
                ranges_s.push((&node.id, first.time_s, last.time_s));
            }
        }
        let earliest_s = ranges_s.iter().map(|(_, first_s, _)| *first_s).reduce(f64::min);
        let latest_start_s = ranges_s.iter().map(|(_, first_s, _)| *first_s).reduce(f64::max);
        let earliest_end_s = ranges_s.iter().map(|(_, _, last_s)| *last_s).reduce(f64::min);
        let longest_s = ranges_s.iter().map(|(_, first_s, last_s)| last_s - first_s);
        let longest_s = longest_s.fold(0.0, f64::max);
        ensure!(
            latest_start_s <= earliest_end_s && longest_s <= MAX_RECORDING_S,
            "{}: the files' times (node, first, last) do not fit: {ranges_s:?} s; they must overlap \
             and span no more than a day",
            folder.display()
        );
        Ok(earliest_s)
    }

    /// The moves of one node, ascending in time.
    pub fn moves_of(&self, node: &NodeId) -> impl Iterator<Item = &NodeMove> {
        self.moves.iter().filter(move |one| one.node == *node)
    }

    /// The true pose of a node in the reference node's frame, after all moves.
    #[must_use]
    pub fn truth(&self, node: &NodePlan) -> Se2<Ref, Node> {
        let last = |start: &NodePlan| {
            let mut plan = start.clone();
            for NodeMove { dx_m, dy_m, turn_deg, .. } in self.moves_of(&start.id) {
                plan.x_m += dx_m;
                plan.y_m += dy_m;
                plan.heading_deg += turn_deg;
            }
            plan.pose_world_from_node()
        };
        let reference = self.nodes.iter().find(|other| other.id == self.reference);
        let pose_world_from_ref = reference.map_or(Se2::identity(), last);
        // The reference node's own frame is `Ref`: only the name of the frame changes.
        let relative: Se2<Node, Node> = pose_world_from_ref.inverse() * last(node);
        let at = relative.translation_m();
        Se2::new(at.x, at.y, relative.heading_rad())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moves_are_read_and_change_the_truth() {
        let mut scenario = find("paper").unwrap();
        scenario.moves = vec!["n2@3:0.5,-1,90".parse().unwrap()];
        assert_eq!(String::from(scenario.moves[0].clone()), "n2@3:0.5,-1,90");
        let scenario = scenario.resolve().unwrap();
        let second = scenario.nodes.iter().find(|node| node.id.as_str() == "n2").unwrap();
        let truth = scenario.truth(second);
        assert!((truth.translation_m() - nalgebra::Vector2::new(-4.5, 4.0)).norm() < 1e-9);
        assert!(truth.heading_rad().abs() < 1e-9);
        for bad in ["n2@3", "n2@3:1,2", "n2@x:1,2,3", "n2@3:1,2,inf"] {
            let refused = bad.parse::<NodeMove>().unwrap_err().to_string();
            assert!(refused.contains("NODE@SECOND:DX,DY,TURN_DEG"), "{bad}: {refused}");
        }
        let mut strange = find("paper").unwrap();
        strange.moves = vec!["n9@3:0,0,1".parse().unwrap()];
        assert!(strange.resolve().unwrap_err().to_string().contains("n9"));
    }

    #[test]
    fn every_shipped_scenario_is_read_and_named_after_its_file() {
        let names: Vec<String> = shipped().unwrap().into_iter().map(|s| s.name).collect();
        assert_eq!(names, SHIPPED.map(|(name, _)| name));
    }

    #[test]
    fn the_papers_truth_is_the_specified_pose() {
        let scenario = find("paper").unwrap().resolve().unwrap();
        let second = scenario.nodes.iter().find(|node| node.id.as_str() == "n2").unwrap();
        let truth = scenario.truth(second);
        assert!((truth.translation_m() - nalgebra::Vector2::new(-5.0, 5.0)).norm() < 1e-9);
        assert!((truth.heading_rad() + std::f64::consts::FRAC_PI_2).abs() < 1e-9);
    }

    #[test]
    fn kills_are_read_and_nonsense_is_named() {
        assert_eq!("n2@1.5".parse::<Kill>().unwrap().after_ms, 1500);
        assert_eq!(String::from("centre@2".parse::<Kill>().unwrap()), "centre@2000ms");
        assert!("centre".parse::<Kill>().unwrap_err().to_string().contains("WHO@SECONDS"));
        let mut scenario = find("paper").unwrap();
        scenario.kills = vec!["n9@1".parse().unwrap()];
        assert!(scenario.resolve().unwrap_err().to_string().contains("n9"));
    }

    #[test]
    fn an_unknown_scenario_names_the_known_ones() {
        assert!(find("atlantis").unwrap_err().to_string().contains("paper, office"));
    }
}
