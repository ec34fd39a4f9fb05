//! What a run leaves: a table, `report.json`, pictures.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::Context;
use comfy_table::presets::UTF8_HORIZONTAL_ONLY;
use comfy_table::{CellAlignment, Table};
use proto::ids::NodeId;
use proto::wire::FusedTarget;
use serde::Serialize;

use crate::draw;
use crate::launch::Incident;
use crate::observe::{Fused, Observer, Person, Seen};
use crate::plan::Plan;
use crate::resources::Usage;
use crate::score::{NodeScore, score};

/// Everything a run has shown.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Report {
    pub(crate) scenario: String,
    pub(crate) seed: u64,
    pub(crate) reference: NodeId,
    /// Every node that can be registered was registered within the bounds, and at least one was.
    pub(crate) success: bool,
    pub(crate) solver: String,
    pub(crate) nodes: Vec<NodeScore>,
    pub(crate) last_picture: Vec<FusedTarget>,
    pub(crate) picture_count: u64,
    /// Everybody whom a node followed, in `Ref`, by node and id.
    pub(crate) people: Vec<Person>,
    /// Everybody whom the centre followed by all nodes together, in `Ref`, by id.
    pub(crate) fused: Vec<Fused>,
    /// Processes that ended on the way.
    pub(crate) incidents: Vec<Incident>,
    pub(crate) resources: BTreeMap<String, Usage>,
    pub(crate) folder: PathBuf,
}

impl Report {
    pub(crate) fn new(
        plan: &Plan,
        observer: &Observer,
        resources: BTreeMap<String, Usage>,
        incidents: Vec<Incident>,
    ) -> Self {
        let unseen = Seen::default();
        let nodes: Vec<NodeScore> = plan
            .scenario
            .nodes
            .iter()
            .map(|node| {
                let seen = observer.nodes.get(&node.id).unwrap_or(&unseen);
                let was_lost = incidents.iter().any(|lost| lost.who == node.id.as_str());
                NodeScore { was_lost, ..score(&plan.scenario, node, seen) }.judged()
            })
            .collect();
        let solver = observer.nodes.values().filter_map(|seen| seen.registration.as_ref());
        let solver = solver.map(|r| r.solver.clone()).find(|name| !name.is_empty());
        Self {
            scenario: plan.scenario.name.clone(),
            seed: plan.scenario.seed,
            reference: plan.scenario.reference.clone(),
            success: nodes.iter().all(|node| node.within_bounds)
                && nodes.iter().any(NodeScore::is_registered),
            solver: solver.unwrap_or_default(),
            nodes,
            last_picture: observer.picture.as_ref().map_or(Vec::new(), |p| p.targets.clone()),
            picture_count: observer.picture_count,
            people: observer.people.values().cloned().collect(),
            fused: observer.fused.values().cloned().collect(),
            incidents,
            resources,
            folder: plan.folder.clone(),
        }
    }

    /// Writes `report.json` and the pictures into the run's folder.
    pub(crate) fn write(&self) -> anyhow::Result<()> {
        let write = |name: &str, text: String| {
            let path = self.folder.join(name);
            std::fs::write(&path, text).with_context(|| format!("writing {}", path.display()))
        };
        write("report.json", serde_json::to_string_pretty(self)?)?;
        let points = read_points(&self.folder, &self.nodes)?;
        write("before.svg", draw::before(self, &points)?)?;
        write("after.svg", draw::after(self, &points)?)
    }

    /// The table, node by node.
    pub(crate) fn table(&self) -> String {
        let mut table = Table::new();
        table.load_style(UTF8_HORIZONTAL_ONLY).set_header([
            "node",
            "pose in reference frame",
            "truth",
            "error",
            "one sigma",
            "periods",
            "solve",
            "outcome",
        ]);
        for node in &self.nodes {
            table.add_row(row(node));
        }
        for column in 1..7 {
            if let Some(column) = table.column_mut(column) {
                column.set_cell_alignment(CellAlignment::Right);
            }
        }
        let verdict = if self.success { "all within bounds" } else { "NOT all within bounds" };
        let Self { scenario, seed, solver, folder, .. } = self;
        let (folder, followed) = (folder.display(), self.followed());
        format!(
            "{scenario}, seed {seed}, solver {solver}: {verdict}\n{table}\n{followed}files in {folder}\n"
        )
    }
}

impl Report {
    /// Whom each node followed, a line for each; nothing where nobody was followed.
    fn followed(&self) -> String {
        let of = |node: &NodeId| -> Vec<String> {
            let own = self.people.iter().filter(|person| person.last.node == *node);
            let told = own.map(|person| {
                let [x_m, y_m, ..] = person.last.track.state;
                let count = person.places_m.len();
                format!("{} to ({x_m:.2}, {y_m:.2}) m in {count} places", person.last.track.id)
            });
            told.collect()
        };
        let told = self.nodes.iter().map(|node| (&node.node, of(&node.node)));
        let lines = told.filter(|(_, people)| !people.is_empty());
        let own = lines.map(|(node, people)| format!("{node} followed {}\n", people.join(", ")));
        own.chain(self.followed_together()).collect()
    }
}

impl Report {
    /// Whom all nodes together showed; nothing where that was nobody.
    fn followed_together(&self) -> Option<String> {
        let told = |person: &Fused| {
            let [x_m, y_m, ..] = person.last.state;
            let (id, count) = (person.last.id, person.places_m.len());
            format!("{id} to ({x_m:.2}, {y_m:.2}) m in {count} places")
        };
        let people: Vec<String> = self.fused.iter().map(told).collect();
        let all = format!("all together followed {}\n", people.join(", "));
        (!people.is_empty()).then_some(all)
    }
}

fn row(node: &NodeScore) -> Vec<String> {
    let pose = |pose: &proto::wire::PoseRecord| {
        format!("{:.3} m, {:.3} m, {:.2}°", pose.x_m, pose.y_m, pose.heading_rad.to_degrees())
    };
    let error = match (node.position_error_m, node.angle_error_deg) {
        (Some(position_m), Some(angle_deg)) if !node.is_reference => {
            format!("{position_m:.3} m, {angle_deg:+.2}°")
        }
        _ => String::new(),
    };
    let sigma = node.sigma.map_or_else(String::new, |s| {
        format!("{:.3} m, {:.3} m, {:.2}°", s.x_m, s.y_m, s.heading_deg)
    });
    let solve = if node.is_reference { String::new() } else { format!("{:.2} ms", node.solve_ms) };
    let estimated = node.pose_ref_from_node.as_ref().map_or_else(|| "none".to_owned(), pose);
    let (periods, verdict) = (node.periods_used.to_string(), node.verdict());
    vec![node.node.to_string(), estimated, pose(&node.truth), error, sigma, periods, solve, verdict]
}

/// One node's points of all periods, in its own frame, as its agent wrote them.
pub(crate) type NodePoints = BTreeMap<NodeId, Vec<[f64; 2]>>;

#[derive(serde::Deserialize)]
struct SetLine {
    points: Vec<PointLine>,
    half_depth_m: f64,
}

#[derive(serde::Deserialize)]
struct PointLine {
    x_m: f64,
    y_m: f64,
}

fn read_points(folder: &Path, nodes: &[NodeScore]) -> anyhow::Result<NodePoints> {
    let mut all = NodePoints::new();
    for node in nodes {
        let path = folder.join("points").join(format!("{}.jsonl", node.node));
        let text = std::fs::read_to_string(&path).unwrap_or_default();
        let points = all.entry(node.node.clone()).or_default();
        for line in text.lines() {
            // The last line of an agent that was killed may be cut short.
            let Ok(set) = serde_json::from_str::<SetLine>(line) else { continue };
            points.extend(set.points.iter().map(|point| middle(point, set.half_depth_m)));
        }
    }
    Ok(all)
}

/// The target's middle, as the centre works with it.
fn middle(point: &PointLine, half_depth_m: f64) -> [f64; 2] {
    let outward = 1.0 + half_depth_m / point.x_m.hypot(point.y_m).max(half_depth_m);
    [point.x_m * outward, point.y_m * outward]
}

/// The result of many seeds.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Summary {
    pub(crate) scenario: String,
    pub(crate) run_count: usize,
    pub(crate) success_count: usize,
    /// Enough of them succeeded.
    pub(crate) success: bool,
    pub(crate) position_error_rms_m: f64,
    pub(crate) angle_error_rms_deg: f64,
    pub(crate) mean_normalised_error: f64,
    /// Seeds whose run could not be played to its end; they count as not successful.
    pub(crate) failed_seeds: Vec<u64>,
    pub(crate) runs: Vec<Report>,
}

impl Summary {
    pub(crate) fn new(runs: Vec<Report>, failed_seeds: Vec<u64>, needed_share: f64) -> Self {
        let run_count = runs.len() + failed_seeds.len();
        let success_count = runs.iter().filter(|run| run.success).count();
        let scored = || runs.iter().flat_map(|run| &run.nodes).filter(|node| !node.is_reference);
        let mean = |of: fn(&NodeScore) -> Option<f64>| {
            let values: Vec<f64> = scored().filter_map(of).collect();
            values.iter().sum::<f64>() / (values.len() as f64).max(1.0)
        };
        Self {
            scenario: runs.first().map_or_else(String::new, |run| run.scenario.clone()),
            run_count,
            success_count,
            success: needed_share * run_count as f64 <= success_count as f64,
            position_error_rms_m: mean(|node| Some(node.position_error_m?.powi(2))).sqrt(),
            angle_error_rms_deg: mean(|node| Some(node.angle_error_deg?.powi(2))).sqrt(),
            mean_normalised_error: mean(|node| node.normalised_error),
            failed_seeds,
            runs,
        }
    }

    pub(crate) fn line(&self) -> String {
        let Self { success_count, run_count, .. } = self;
        format!(
            "{}: {success_count} of {run_count} seeds within bounds; RMS error {:.3} m, {:.2}°; \
             mean squared normalised error {:.2} (3 if the covariance is true)\n",
            self.scenario,
            self.position_error_rms_m,
            self.angle_error_rms_deg,
            self.mean_normalised_error
        )
    }
}
