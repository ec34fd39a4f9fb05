//! Every node's transform: what to solve next, and whether to believe what came out.

use std::collections::BTreeMap;
use std::time::Duration;

use nalgebra::{Matrix3, Vector3};
use proto::geom::{Node, Point, Ref, Se2, wrap_angle};
use proto::ids::NodeId;
use proto::time::CentreTime;
use proto::wire::{
    Evidence, NodeInPicture, NodeState, Outcome, PoseRecord, Registration, Rival, SetsUsed,
    Transform,
};
use tracing::warn;

use crate::gather::{Gather, KeptSet, NodeHistory};
use crate::registration::{self, Known, Period, PoseEstimate, Problem, Solution};

/// A new pose within this many standard deviations (squared, three dimensions) of the old one
/// refines it; chance exceeds it once in ten thousand.
const REFINEMENT_GATE: f64 = 21.1;
/// A pose whose covariance has this many times the determinant of another's is much vaguer: one and
/// a half times the standard deviation in each of three dimensions.
const VAGUER: f64 = 11.4;
/// Most rival poses that are published.
const MAX_RIVAL_COUNT: usize = 8;

/// One node's registration problem, ready to be solved.
#[derive(Clone, Debug)]
pub struct Job {
    /// Which node.
    pub node: NodeId,
    /// What is to be solved.
    pub problem: Problem,
    /// Which sets went in.
    pub sets: SetsUsed,
    /// What the node's last solve found, to go on from.
    pub known: Option<Known>,
    /// The node's generation when the job was made.
    generation: u64,
}

/// A solved [`Job`].
#[derive(Clone, Debug)]
pub struct Solved {
    /// The problem.
    pub job: Job,
    /// The solver's answer.
    pub solution: Solution,
    /// Name of the solver.
    pub solver: &'static str,
    /// How long it took.
    pub solve_time: Duration,
}

/// One node's standing.
#[derive(Debug, Default)]
struct Standing {
    transform: Option<Transform>,
    /// Evidence for the transform when it was last confirmed.
    transform_log_odds: f64,
    newest: Option<(Outcome, Evidence, SetsUsed, &'static str)>,
    known: Option<Known>,
    /// Counts the operator's wishes to start over: solutions of earlier data are not believed.
    generation: u64,
    contradiction_count: u64,
    next_epoch: u64,
    in_flight: bool,
    is_due: bool,
}

/// The poses of all nodes.
#[derive(Debug)]
pub struct Poses {
    reference: NodeId,
    standings: BTreeMap<NodeId, Standing>,
}

impl Poses {
    pub(super) fn new(reference: NodeId) -> Self {
        Self { reference, standings: BTreeMap::new() }
    }

    /// The transform in force.
    #[must_use]
    pub fn transform(&self, node: &NodeId) -> Option<&Transform> {
        self.standings.get(node)?.transform.as_ref()
    }

    /// The pose in force and its covariance.
    #[must_use]
    pub fn pose(&self, node: &NodeId) -> Option<(Se2<Ref, Node>, Matrix3<f64>)> {
        let transform = self.transform(node)?;
        Some((transform.pose_ref_from_node.into(), transform.covariance_matrix()))
    }

    /// The reference node defines `Ref`: its transform is the identity, exactly. True if that is
    /// news.
    pub(super) fn announce_reference(&mut self, now: CentreTime) -> bool {
        let standing = self.standings.entry(self.reference.clone()).or_default();
        if standing.transform.is_some() {
            return false;
        }
        let pose_ref_from_node = PoseRecord::from(Se2::identity());
        let covariance = [[0.0; 3]; 3];
        standing.transform =
            Some(Transform { epoch: 0, accepted: now, pose_ref_from_node, covariance });
        true
    }

    /// What to solve now that `node` has sets in `periods`: each pair with the reference node that
    /// this completed. A node whose last job is still being solved is solved again afterwards.
    pub(super) fn jobs(&mut self, gather: &Gather, node: &NodeId, periods: &[i64]) -> Vec<Job> {
        let has_any = |one: &NodeId| {
            let sets = gather.node(one).map(NodeHistory::sets);
            sets.is_some_and(|sets| periods.iter().any(|period| sets.contains_key(period)))
        };
        let others: Vec<NodeId> = if *node == self.reference {
            gather.nodes().map(|(other, _)| other.clone()).filter(|other| other != node).collect()
        } else if has_any(&self.reference) {
            vec![node.clone()]
        } else {
            Vec::new()
        };
        let mut jobs = Vec::new();
        for other in others.iter().filter(|other| has_any(other)) {
            self.standings.entry(other.clone()).or_default().is_due = true;
            jobs.extend(self.start(gather, other));
        }
        jobs
    }

    /// The job that became due while the last one was being solved.
    pub(super) fn next_job(&mut self, gather: &Gather, node: &NodeId) -> Option<Job> {
        self.start(gather, node)
    }

    fn start(&mut self, gather: &Gather, node: &NodeId) -> Option<Job> {
        let standing = self.standings.get_mut(node)?;
        if standing.in_flight || !standing.is_due {
            return None;
        }
        standing.is_due = false;
        let (known, generation) = (standing.known.clone(), standing.generation);
        let job = Job { known, generation, ..job(gather, &self.reference, node)? };
        standing.in_flight = true;
        Some(job)
    }

    /// Takes a solution in: a determined pose is believed unless it contradicts one that rests on
    /// more.
    pub(super) fn take(&mut self, now: CentreTime, solved: &Solved) {
        let standing = self.standings.entry(solved.job.node.clone()).or_default();
        standing.in_flight = false;
        if solved.job.generation != standing.generation {
            return;
        }
        let evidence = evidence(&solved.solution.evidence, solved.solve_time);
        let outcome = outcome(&solved.solution.outcome);
        standing.newest = Some((outcome, evidence, solved.job.sets, solved.solver));
        standing.known = Some(solved.solution.known.clone());
        let Some(estimate) = &solved.solution.estimate else { return };
        if solved.solution.outcome != registration::Outcome::Determined {
            return;
        }
        if let Some(old) = standing.transform
            && evidence.log_odds <= standing.transform_log_odds
        {
            if !refines(&old, estimate) {
                standing.count_contradiction(&solved.job.node, estimate);
                return;
            }
            if is_much_vaguer(&old, estimate) {
                return;
            }
        }
        standing.transform = Some(transform(standing.next_epoch, now, estimate));
        standing.transform_log_odds = evidence.log_odds;
        standing.next_epoch += 1;
    }

    /// The transform stays in force, but any determined pose may replace it.
    pub(super) fn doubt(&mut self, node: &NodeId) {
        if let Some(standing) = self.standings.get_mut(node) {
            standing.transform_log_odds = f64::NEG_INFINITY;
            standing.known = None;
            standing.generation += 1;
        }
    }

    /// A solve that broke will not report: the node may be solved again.
    pub(super) fn give_up(&mut self, node: &NodeId) {
        if let Some(standing) = self.standings.get_mut(node) {
            standing.in_flight = false;
            standing.known = None;
        }
    }

    /// What to tell of a node.
    pub(super) fn registration(&self, now: CentreTime, node: &NodeId) -> Option<Registration> {
        let standing = self.standings.get(node)?;
        let (outcome, evidence, sets, solver) = if *node == self.reference {
            (Outcome::Reference, Evidence::default(), None, "")
        } else {
            let (outcome, evidence, sets, solver) = standing.newest.clone()?;
            (outcome, evidence, Some(sets), solver)
        };
        Some(Registration {
            node: node.clone(),
            reference: self.reference.clone(),
            published: now,
            transform: standing.transform,
            outcome,
            evidence,
            sets,
            solver: solver.to_owned(),
        })
    }
}

/// The problem of `node` against the reference node over all periods kept; `None` without any
/// period in which both were heard.
fn job(gather: &Gather, reference: &NodeId, node: &NodeId) -> Option<Job> {
    let (reference_history, history) = (gather.node(reference)?, gather.node(node)?);
    if !(gather.is_clock_good(reference_history) && gather.is_clock_good(history)) {
        return None;
    }
    let pairs: Vec<(&KeptSet, &KeptSet)> = history
        .sets()
        .iter()
        .filter_map(|(period, set)| Some((reference_history.sets().get(period)?, set)))
        .collect();
    let ours = || pairs.iter().map(|(_, set)| *set).filter(|set| set.boot == history.boot);
    let last_arrival = pairs.iter().flat_map(|(one, other)| [one.arrival, other.arrival]).max()?;
    let count = u32::try_from(2 * pairs.len()).unwrap_or(u32::MAX);
    let sets = SetsUsed {
        boot: history.boot,
        first_sequence: ours().map(|set| set.sequence).min().unwrap_or(0),
        last_sequence: ours().map(|set| set.sequence).max().unwrap_or(0),
        count,
        last_arrival,
    };
    Some(Job { node: node.clone(), problem: problem(&pairs), sets, known: None, generation: 0 })
}

fn problem(pairs: &[(&KeptSet, &KeptSet)]) -> Problem {
    let origin = pairs.first().map_or(CentreTime(0), |(in_ref, _)| in_ref.time);
    let largest = |sigmas: &mut dyn Iterator<Item = f64>| sigmas.fold(0.0, f64::max);
    Problem {
        periods: pairs.iter().map(|(in_ref, in_node)| period(origin, in_ref, in_node)).collect(),
        ref_half_depth_sigma_m: largest(&mut pairs.iter().map(|(one, _)| one.half_depth_sigma_m)),
        node_half_depth_sigma_m: largest(&mut pairs.iter().map(|(_, set)| set.half_depth_sigma_m)),
    }
}

fn period(origin: CentreTime, reference: &KeptSet, node: &KeptSet) -> Period {
    // The reference node's own frame is `Ref`: only the name of the frame changes.
    let in_ref = |position: &proto::geom::Gaussian<Node>| proto::geom::Gaussian {
        mean: Point::from_coords(position.mean.coords_m),
        cov_m2: position.cov_m2,
    };
    let since_origin_s = |set: &KeptSet| (set.time.0 - origin.0) as f64 * 1e-9;
    Period {
        ref_time_s: since_origin_s(reference),
        node_time_s: since_origin_s(node),
        in_ref: reference.points.iter().map(|point| in_ref(&point.position)).collect(),
        in_node: node.points.iter().map(|point| point.position).collect(),
    }
}

fn transform(epoch: u64, now: CentreTime, estimate: &PoseEstimate) -> Transform {
    let covariance =
        std::array::from_fn(|row| std::array::from_fn(|column| estimate.covariance[(row, column)]));
    let pose_ref_from_node = estimate.pose_ref_from_node.into();
    Transform { epoch, accepted: now, pose_ref_from_node, covariance }
}

impl Standing {
    fn count_contradiction(&mut self, node: &NodeId, estimate: &PoseEstimate) {
        self.contradiction_count += 1;
        if self.contradiction_count.is_power_of_two() {
            warn!(%node, count = self.contradiction_count, pose = ?estimate.pose_ref_from_node,
                "contradicts the transform in force and rests on less: not accepted");
        }
    }
}

/// Whether the new pose's uncertainty covers far more than the old one's: poorer data must not
/// take the place of better ones, while the fluctuation of a sliding window may.
fn is_much_vaguer(old: &Transform, new: &PoseEstimate) -> bool {
    VAGUER * old.covariance_matrix().determinant() < new.covariance.determinant()
}

/// Whether the new pose lies within the old one's and its own uncertainty.
fn refines(old: &Transform, new: &PoseEstimate) -> bool {
    let old_pose: Se2<Ref, Node> = old.pose_ref_from_node.into();
    let moved_m = new.pose_ref_from_node.translation_m() - old_pose.translation_m();
    let turned = wrap_angle(new.pose_ref_from_node.heading_rad() - old_pose.heading_rad());
    let between = Vector3::new(moved_m.x, moved_m.y, turned);
    let both = old.covariance_matrix() + new.covariance;
    let Some(information) = both.try_inverse() else { return false };
    between.dot(&(information * between)) <= REFINEMENT_GATE
}

fn outcome(outcome: &registration::Outcome) -> Outcome {
    match outcome {
        registration::Outcome::Determined => Outcome::Determined,
        registration::Outcome::Ambiguous { rivals } => Outcome::Ambiguous {
            rivals: rivals
                .iter()
                .take(MAX_RIVAL_COUNT)
                .map(|rival| Rival {
                    pose_ref_from_node: rival.pose_ref_from_node.into(),
                    log_odds: rival.log_odds,
                })
                .collect(),
        },
        registration::Outcome::Underdetermined { missing } => {
            Outcome::Underdetermined { missing: missing.to_string() }
        }
    }
}

fn evidence(evidence: &registration::Evidence, solve_time: Duration) -> Evidence {
    let count = |count: usize| u32::try_from(count).unwrap_or(u32::MAX);
    Evidence {
        matched_point_count: count(evidence.matched_point_count),
        period_count: count(evidence.period_count),
        chi_square: evidence.chi_square,
        degrees_of_freedom: evidence.degrees_of_freedom,
        log_odds: evidence.log_odds,
        rival_log_odds: evidence.rival_log_odds,
        solve_ms: solve_time.as_secs_f64() * 1e3,
    }
}

/// Every node's line in the picture.
pub(super) fn node_lines(now: CentreTime, gather: &Gather, poses: &Poses) -> Vec<NodeInPicture> {
    let line = |(node, history): (&NodeId, &NodeHistory)| {
        let transform = poses.transform(node);
        let state = if !gather.is_heard(now, history) {
            NodeState::Silent
        } else if history.clock.is_none() {
            NodeState::ClockUnknown
        } else if transform.is_none() {
            NodeState::Unregistered
        } else {
            NodeState::Live
        };
        let silent = now.since(history.last_heard);
        NodeInPicture {
            node: node.clone(),
            state,
            silent_ms: u64::try_from(silent.as_millis()).unwrap_or(u64::MAX),
            boot: history.boot,
            next_sequence: history.next_sequence,
            received_count: history.received_count,
            missing_count: history.missing_count(),
            duplicate_count: history.duplicate_count,
            late_count: history.late_count,
            refused_count: history.refused_count,
            epoch: transform.map(|transform| transform.epoch),
        }
    };
    gather.nodes().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn id(name: &str) -> NodeId {
        name.parse().unwrap()
    }

    fn solved(x_m: f64, sigma_m: f64, log_odds: f64) -> Solved {
        let boot = proto::ids::BootId(1);
        let last_arrival = CentreTime(0);
        let sets = SetsUsed { boot, first_sequence: 0, last_sequence: 0, count: 2, last_arrival };
        let estimate = PoseEstimate {
            pose_ref_from_node: Se2::new(x_m, 0.0, 0.0),
            covariance: Matrix3::identity() * sigma_m.powi(2),
        };
        let solution = Solution {
            estimate: Some(estimate),
            outcome: registration::Outcome::Determined,
            evidence: registration::Evidence { log_odds, ..registration::Evidence::default() },
            known: Known::default(),
        };
        let (node, problem) = (id("n2"), Problem::default());
        let job = Job { node, problem, sets, known: None, generation: 0 };
        Solved { job, solution, solver: "default", solve_time: Duration::ZERO }
    }

    fn x_m(poses: &Poses) -> f64 {
        poses.transform(&id("n2")).unwrap().pose_ref_from_node.x_m
    }

    #[test]
    fn a_poorer_pose_never_replaces_a_better_one() {
        let mut poses = Poses::new(id("n1"));
        for (proposed, in_force_m, why) in [
            (solved(0.0, 0.01, 200.0), 0.0, "the first determined pose is taken"),
            (solved(0.8, 0.45, 10.0), 0.0, "it fits, but is far vaguer"),
            (solved(0.02, 0.012, 190.0), 0.02, "it refines"),
            (solved(3.0, 0.01, 100.0), 0.02, "it contradicts and rests on less"),
            (solved(3.0, 0.01, 300.0), 3.0, "it contradicts and rests on more"),
        ] {
            poses.take(CentreTime(1), &proposed);
            assert!((x_m(&poses) - in_force_m).abs() < 1e-12, "{why}");
        }
        assert_eq!(poses.transform(&id("n2")).unwrap().epoch, 2);
    }

    #[test]
    fn after_a_doubt_only_new_data_count() {
        let mut poses = Poses::new(id("n1"));
        poses.take(CentreTime(1), &solved(0.0, 0.01, 200.0));
        poses.doubt(&id("n2"));
        poses.take(CentreTime(2), &solved(1.0, 0.01, 500.0));
        assert!(x_m(&poses).abs() < 1e-12, "a job made before the doubt is not believed");
        let mut fresh = solved(2.0, 0.01, 20.0);
        fresh.job.generation = 1;
        poses.take(CentreTime(3), &fresh);
        assert!((x_m(&poses) - 2.0).abs() < 1e-12);
    }
}
