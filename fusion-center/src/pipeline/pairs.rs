//! Every pair of nodes that share periods: what to solve next, and which result to believe.
//!
//! A pair is solved again when both of its nodes have a set in the same period. At most one solve
//! per pair and as many as there are workers are under way, and together they take no more than
//! their share of the workers' time: what they took is paid from a budget that grows with time.
//! Among the pairs that wait, those with the reference and those without a result go first, and of
//! equals the one that has waited longest; a pair that has waited long enough goes before all.

use std::collections::BTreeMap;
use std::time::Duration;

use proto::geom::{Gaussian, Node};
use proto::ids::{BootId, NodeId};
use proto::time::CentreTime;
use proto::wire::{Evidence, Outcome, SetsUsed};
use tracing::warn;

use super::belief::{Belief, Judgement};
use super::outcomes;
use crate::config::WorkConfig;
use crate::gather::{Gather, KeptSet, NodeHistory};
use crate::network::{AGREEMENT_LOG_ODDS, Edge};
use crate::registration::{self, Known, Problem, Seen, Solution};

/// Solves started since, after which a waiting pair goes before those of higher rank.
const LONGEST_WAIT: u64 = 64;
/// The budget never holds more than the share of this time.
const SAVINGS: Duration = Duration::from_secs(2);

/// Two nodes, the reference first if it is one of them, else by name.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Pair {
    /// The node in whose frame the pose is.
    pub first: NodeId,
    /// The node whose pose it is.
    pub second: NodeId,
}

impl Pair {
    /// The pair of two different nodes.
    #[must_use]
    pub fn new(reference: &NodeId, one: &NodeId, other: &NodeId) -> Self {
        let rank = |node: &NodeId| (node != reference, node.clone());
        let (first, second) = if rank(one) < rank(other) { (one, other) } else { (other, one) };
        Self { first: first.clone(), second: second.clone() }
    }

    /// Whether `node` is one of the two.
    #[must_use]
    pub fn has(&self, node: &NodeId) -> bool {
        self.first == *node || self.second == *node
    }
}

/// One pair's registration problem, ready to be solved.
#[derive(Clone, Debug)]
pub struct Job {
    /// Which pair.
    pub pair: Pair,
    /// What is to be solved.
    pub problem: Problem,
    /// Which sets of the first and of the second node went in.
    pub sets: [SetsUsed; 2],
    /// What the pair's last solve found, to go on from.
    pub known: Option<Known>,
    /// The pair's generation when the job was made.
    pub(super) generation: u64,
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

/// What the newest solve of a pair says.
#[derive(Clone, Debug)]
pub(super) struct Newest {
    pub(super) outcome: Outcome,
    pub(super) evidence: Evidence,
    pub(super) sets: [SetsUsed; 2],
    pub(super) solver: &'static str,
}

#[derive(Debug, Default)]
struct Standing {
    /// The solution in force, and the odds that it rests on.
    believed: Option<(Solution, Belief)>,
    /// The newest ambiguous solution of a pair without a solution in force: loops through other
    /// nodes may decide it.
    open: Option<Solution>,
    newest: Option<Newest>,
    known: Option<Known>,
    /// Counts the wishes to start over: solutions of earlier data are not believed.
    generation: u64,
    contradiction_count: u64,
    /// The count of solves when this pair was last started.
    last_start: u64,
    in_flight: bool,
    is_due: bool,
}

/// All pairs.
#[derive(Debug)]
pub(super) struct Pairs {
    reference: NodeId,
    config: WorkConfig,
    standings: BTreeMap<Pair, Standing>,
    start_count: u64,
    budget_s: f64,
    paid_at: Option<CentreTime>,
}

impl Pairs {
    pub(super) fn new(reference: NodeId, config: WorkConfig) -> Self {
        let standings = BTreeMap::new();
        let mut pairs =
            Self { reference, config, standings, start_count: 0, budget_s: 0.0, paid_at: None };
        pairs.budget_s = pairs.earned_s(SAVINGS);
        pairs
    }

    fn earned_s(&self, time: Duration) -> f64 {
        let worker_count = self.config.worker_count.max(1) as f64;
        self.config.time_share * worker_count * time.as_secs_f64()
    }

    /// Notes that `node` has sets in `periods`: every pair that this completed is due.
    pub(super) fn note(&mut self, gather: &Gather, node: &NodeId, periods: &[i64]) {
        let has_any = |history: &NodeHistory| {
            periods.iter().any(|period| history.sets().contains_key(period))
        };
        if !gather.node(node).is_some_and(has_any) {
            return;
        }
        let others = gather.nodes().filter(|(other, history)| *other != node && has_any(history));
        for (other, _) in others {
            let pair = Pair::new(&self.reference, node, other);
            self.standings.entry(pair).or_default().is_due = true;
        }
    }

    /// What to solve now.
    pub(super) fn start(&mut self, now: CentreTime, gather: &Gather) -> Vec<Job> {
        let since = self.paid_at.map_or(Duration::ZERO, |paid_at| now.since(paid_at));
        self.paid_at = Some(now);
        self.budget_s = (self.budget_s + self.earned_s(since)).min(self.earned_s(SAVINGS));
        let mut jobs = Vec::new();
        let mut running = self.standings.values().filter(|standing| standing.in_flight).count();
        while running < self.config.worker_count.max(1) && 0.0 < self.budget_s {
            let Some(pair) = self.next() else { break };
            if let Some(job) = self.job(gather, &pair) {
                jobs.push(job);
                running += 1;
            }
        }
        jobs
    }

    fn next(&self) -> Option<Pair> {
        let waiting = self.standings.iter().filter(|(_, one)| one.is_due && !one.in_flight);
        let rank = |(pair, standing): &(&Pair, &Standing)| {
            let waited = self.start_count - standing.last_start;
            let is_first = pair.first == self.reference || standing.believed.is_none();
            (!is_first && waited < LONGEST_WAIT, standing.last_start)
        };
        waiting.min_by_key(rank).map(|(pair, _)| pair.clone())
    }

    fn job(&mut self, gather: &Gather, pair: &Pair) -> Option<Job> {
        let standing = self.standings.get_mut(pair)?;
        standing.is_due = false;
        let (known, generation) = (standing.known.clone(), standing.generation);
        let job = Job { known, generation, ..job(gather, pair)? };
        standing.in_flight = true;
        self.start_count += 1;
        standing.last_start = self.start_count;
        Some(job)
    }

    /// Takes a solution in. True if the solution in force is another now.
    pub(super) fn take(&mut self, solved: &Solved) -> bool {
        self.budget_s -= solved.solve_time.as_secs_f64();
        let standing = self.standings.entry(solved.job.pair.clone()).or_default();
        standing.in_flight = false;
        if solved.job.generation != standing.generation {
            return false;
        }
        let evidence = outcomes::evidence(&solved.solution.evidence, solved.solve_time);
        let outcome = outcomes::outcome(&solved.solution.outcome);
        let (sets, solver) = (solved.job.sets, solved.solver);
        standing.newest = Some(Newest { outcome, evidence, sets, solver });
        standing.known = Some(solved.solution.known.clone());
        let Some(estimate) = &solved.solution.estimate else { return false };
        let kept = Solution { known: Known::default(), ..solved.solution.clone() };
        if solved.solution.outcome != registration::Outcome::Determined {
            return standing.take_open(kept);
        }
        let new = Belief {
            pose: estimate.pose_ref_from_node,
            covariance: estimate.covariance,
            log_odds: evidence.log_odds,
        };
        let judged = standing.believed.as_ref().map(|(_, old)| old.judge(&new));
        match judged {
            Some(Judgement::Vaguer) => return false,
            Some(Judgement::Contradicts) => {
                standing.count_contradiction(&solved.job.pair);
                return false;
            }
            Some(Judgement::Accept) | None => {}
        }
        (standing.believed, standing.open) = (Some((kept, new)), None);
        true
    }

    /// A solve that broke will not report: the pair may be solved again.
    pub(super) fn give_up(&mut self, pair: &Pair) {
        if let Some(standing) = self.standings.get_mut(pair) {
            standing.in_flight = false;
            standing.known = None;
        }
    }

    /// Nothing that was found with this node is believed any longer.
    pub(super) fn doubt(&mut self, node: &NodeId) {
        for (_, standing) in self.standings.iter_mut().filter(|(pair, _)| pair.has(node)) {
            (standing.believed, standing.open) = (None, None);
            standing.known = None;
            standing.generation += 1;
        }
    }

    /// The solutions in force, and the ambiguous ones of pairs that have none.
    pub(super) fn edges(&self) -> Vec<Edge> {
        let edge = |(pair, standing): (&Pair, &Standing)| {
            let believed = standing.believed.as_ref().map(|(solution, _)| solution);
            let Pair { first, second } = pair.clone();
            Some(Edge { first, second, solution: believed.or(standing.open.as_ref())?.clone() })
        };
        self.standings.iter().filter_map(edge).collect()
    }

    /// Whether all that is known of a pair is ambiguous.
    pub(super) fn is_open(&self, one: &NodeId, other: &NodeId) -> bool {
        let standing = self.standings.get(&Pair::new(&self.reference, one, other));
        standing.is_some_and(|standing| standing.open.is_some())
    }

    /// The odds that a chain of nodes rests on: those of its weakest pair. A pair that only a loop
    /// decided counts with what its agreement means at least.
    pub(super) fn log_odds(&self, via: &[NodeId]) -> f64 {
        let of_pair = |ends: &[NodeId]| {
            let pair = Pair::new(&self.reference, &ends[0], &ends[1]);
            let standing = self.standings.get(&pair)?;
            let believed = standing.believed.as_ref().map(|(_, belief)| belief.log_odds);
            believed.or_else(|| standing.open.as_ref().map(|_| AGREEMENT_LOG_ODDS))
        };
        via.windows(2).filter_map(of_pair).fold(f64::INFINITY, f64::min)
    }

    /// What the newest solve says that a node's pose rests on: that of the last pair on its way,
    /// else that with the reference, else the likeliest of its pairs.
    pub(super) fn newest(&self, node: &NodeId, via: &[NodeId]) -> Option<(&Newest, SetsUsed)> {
        let of = |pair: &Pair| {
            let newest = self.standings.get(pair)?.newest.as_ref()?;
            Some((newest, newest.sets[usize::from(pair.second == *node)]))
        };
        let parent = via.iter().rev().nth(1).unwrap_or(&self.reference);
        let known = (parent != node).then(|| Pair::new(&self.reference, parent, node));
        known.as_ref().and_then(of).or_else(|| {
            let all = self.standings.iter().filter(|(pair, _)| pair.has(node));
            let newest = all.filter_map(|(pair, _)| of(pair));
            newest.max_by(|a, b| a.0.evidence.log_odds.total_cmp(&b.0.evidence.log_odds))
        })
    }
}

impl Standing {
    /// Takes an ambiguous solution in where nothing better is known. True if it is an edge now.
    fn take_open(&mut self, kept: Solution) -> bool {
        let is_open = matches!(kept.outcome, registration::Outcome::Ambiguous { .. });
        let is_edge = is_open && self.believed.is_none();
        if is_edge {
            self.open = Some(kept);
        }
        is_edge
    }

    fn count_contradiction(&mut self, pair: &Pair) {
        self.contradiction_count += 1;
        if self.contradiction_count.is_power_of_two() {
            let Pair { first, second } = pair;
            warn!(%first, %second, count = self.contradiction_count,
                "contradicts the pose in force and rests on less: not accepted");
        }
    }
}

/// The problem of a pair over all periods kept; `None` without any period in which both were heard.
fn job(gather: &Gather, pair: &Pair) -> Option<Job> {
    let (first, second) = (gather.node(&pair.first)?, gather.node(&pair.second)?);
    if !(gather.is_clock_good(first) && gather.is_clock_good(second)) {
        return None;
    }
    let common: Vec<(&KeptSet, &KeptSet)> =
        second.all_sets().filter_map(|(period, set)| Some((first.set_in(period)?, set))).collect();
    let last_arrival = common.iter().flat_map(|(one, other)| [one.arrival, other.arrival]).max()?;
    let count = u32::try_from(2 * common.len()).unwrap_or(u32::MAX);
    let used = |history: &NodeHistory, of_side: fn(&(&KeptSet, &KeptSet)) -> (BootId, u64)| {
        let boot = history.boot;
        let sequences = || common.iter().map(of_side).filter(|one| one.0 == boot).map(|one| one.1);
        let first_sequence = sequences().min().unwrap_or(0);
        let last_sequence = sequences().max().unwrap_or(0);
        SetsUsed { boot, first_sequence, last_sequence, count, last_arrival }
    };
    let sets = [
        used(first, |(set, _)| (set.boot, set.sequence)),
        used(second, |(_, set)| (set.boot, set.sequence)),
    ];
    Some(Job { pair: pair.clone(), problem: problem(&common), sets, known: None, generation: 0 })
}

fn problem(pairs: &[(&KeptSet, &KeptSet)]) -> Problem {
    let origin = pairs.first().map_or(CentreTime(0), |(in_ref, _)| in_ref.time);
    Problem::of_nodes(
        pairs.iter().map(|(first, second)| (seen(origin, first), seen(origin, second))),
    )
}

fn seen(origin: CentreTime, set: &KeptSet) -> Seen<impl Iterator<Item = Gaussian<Node>>> {
    Seen {
        time_s: (set.time.0 - origin.0) as f64 * 1e-9,
        half_depth_sigma_m: set.half_depth_sigma_m,
        points: set.points.iter().map(|point| point.position),
    }
}

#[cfg(test)]
mod tests;
