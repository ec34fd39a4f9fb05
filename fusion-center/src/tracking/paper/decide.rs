//! Which plot each track takes, from the degrees of the pairs that passed the gates.

use crate::tracking::assign::{AssignError, Edge, Edges, Solver};

use super::Mode;
use super::belief::{self, Masses, Workspace};
use super::config::{BeliefDecision, PaperConfig};
use super::degree::{Degrees, weighted};

/// What a pair is worth above all probabilities, nats: as many pairs as can be are made first.
const PAIR_NATS: f64 = 1e5;

/// A track and a plot that may be of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Candidate {
    /// The track's place in the list.
    pub(super) row: usize,
    /// The plot's.
    pub(super) column: usize,
    pub(super) degrees: Degrees,
}

/// The plot that a track takes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Choice {
    pub(super) column: usize,
    /// How probable it is that the plot is of the track's target; 1 where that is not weighed.
    pub(super) share: f64,
}

/// Decides, in memory that is kept.
#[derive(Clone, Debug, Default)]
pub(super) struct Decider {
    costs: Vec<Edge>,
    edges: Edges,
    solver: Solver,
    space: Workspace,
    masses: Vec<Masses>,
    probabilities: Vec<f64>,
    /// Of the candidate that is the edge of the same place.
    shares: Vec<f64>,
}

impl Decider {
    /// Puts the choice of every row into `into`. Candidates are in ascending order of rows.
    ///
    /// # Errors
    /// If there are more pairs than can be counted.
    pub(super) fn decide(
        &mut self,
        (mode, config): (Mode, &PaperConfig),
        candidates: &[Candidate],
        (row_count, column_count): (usize, usize),
        into: &mut Vec<Option<Choice>>,
    ) -> Result<(), AssignError> {
        into.clear();
        into.resize(row_count, None);
        self.costs.clear();
        self.shares.clear();
        match mode {
            Mode::Paper => {
                self.weigh(config, candidates);
                // No pair costs more than the largest degree, so that each is better than none.
                self.costs.iter_mut().for_each(|edge| edge.cost -= config.max_degree);
                self.solve(row_count, column_count, into)?;
            }
            Mode::Nearest => {
                self.weigh(config, candidates);
                nearest(&self.costs, &self.shares, into);
            }
            Mode::Belief => {
                self.believe(config, candidates);
                match config.belief.decision {
                    BeliefDecision::Row | BeliefDecision::RowOrNone => {
                        nearest(&self.costs, &self.shares, into);
                    }
                    BeliefDecision::Exclusive | BeliefDecision::ExclusiveOrNone => {
                        self.solve(row_count, column_count, into)?;
                    }
                }
            }
        }
        Ok(())
    }

    /// Weighted sums as costs of all pairs.
    fn weigh(&mut self, config: &PaperConfig, candidates: &[Candidate]) {
        for Candidate { row, column, degrees } in candidates {
            let cost = weighted(degrees, &config.weight);
            if cost < config.max_degree {
                self.costs.push(Edge { row: *row, column: *column, cost });
                self.shares.push(1.0);
            }
        }
    }

    /// Negative logarithms of pignistic probabilities as costs, against that of none where it is
    /// asked for.
    fn believe(&mut self, config: &PaperConfig, candidates: &[Candidate]) {
        for of_row in candidates.chunk_by(|a, b| a.row == b.row) {
            let trust = &config.belief.trust;
            self.masses.clear();
            self.masses.extend(of_row.iter().map(|pair| belief::pair(&pair.degrees, trust)));
            let none = belief::pignistic(&self.masses, &mut self.space, &mut self.probabilities);
            let base = match config.belief.decision {
                BeliefDecision::RowOrNone | BeliefDecision::ExclusiveOrNone => none.ln(),
                BeliefDecision::Row | BeliefDecision::Exclusive => -PAIR_NATS,
            };
            let cost = |share: f64| base - share.max(f64::MIN_POSITIVE).ln();
            let pairs = of_row.iter().zip(&self.probabilities);
            for (pair, share) in pairs.filter(|(_, share)| cost(**share) < 0.0) {
                let (row, column) = (pair.row, pair.column);
                self.costs.push(Edge { row, column, cost: cost(*share) });
                self.shares.push(*share);
            }
        }
    }

    /// The least sum with no plot taken twice.
    fn solve(
        &mut self,
        row_count: usize,
        column_count: usize,
        into: &mut [Option<Choice>],
    ) -> Result<(), AssignError> {
        self.edges.fill(row_count, column_count, &self.costs)?;
        let solved = self.solver.solve(&self.edges);
        for (edge, share) in self.costs.iter().zip(&self.shares) {
            if solved.column_of(edge.row) == Some(edge.column) {
                into[edge.row] = Some(Choice { column: edge.column, share: *share });
            }
        }
        Ok(())
    }
}

/// The least cost of each row; of equals that of the plot that came first.
fn nearest(costs: &[Edge], shares: &[f64], into: &mut [Option<Choice>]) {
    let mut pairs = costs.iter().zip(shares).peekable();
    while let Some((first, share)) = pairs.next() {
        let mut best = (first, share);
        while let Some(next) = pairs.next_if(|(edge, _)| edge.row == first.row) {
            let order = next.0.cost.total_cmp(&best.0.cost);
            if order.then(next.0.column.cmp(&best.0.column)).is_lt() {
                best = next;
            }
        }
        into[first.row] = Some(Choice { column: best.0.column, share: *best.1 });
    }
}
