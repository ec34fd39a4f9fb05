//! How likely each pair of a component is, over all its assignments (joint probabilistic data
//! association).

use super::local::{Local, Placement};
use super::propagate::Messages;
use super::sweep::{Sweep, SweepMemory};
use super::{BestLimits, Component, KBest, Solved, reset};

#[cfg(test)]
mod tests;

/// How much work the probabilities of one component may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MarginalLimits {
    /// Most sets of taken columns to be told apart between two rows in the exact sum.
    pub state_count: usize,
    /// What to do where that is not enough.
    pub beyond: Beyond,
}

/// How components are treated that are too wide for the exact sum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Beyond {
    /// Rows and columns tell each other how much they want each other, up to `pass_count` times or
    /// until no probability changes by more than `change`.
    Propagate {
        /// Most passes.
        pass_count: usize,
        /// Change of a probability that is not worth another pass.
        change: f64,
    },
    /// The sum over the cheapest assignments.
    Best(BestLimits),
}

impl Default for MarginalLimits {
    /// 1,024 sets: exact for 10 columns in any arrangement, and for long chains. Beyond, up to 200
    /// passes until no probability changes by more than 0.001.
    ///
    /// In random scenes of 1 to 3 foreign plots per gate, components of 8 to 149 rows differ from
    /// the exact sum by 0.02 on average and 0.23 at most after propagation, in 20 to 60 passes
    /// (change 10⁻⁶), and by 0.13 and 0.84 with the 64 cheapest assignments, in five to ten times the
    /// time.
    fn default() -> Self {
        Self { state_count: 1024, beyond: Beyond::Propagate { pass_count: 200, change: 1e-3 } }
    }
}

/// What the probabilities were summed over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Basis {
    /// All assignments: exact.
    All,
    /// All, but as if no way round led back to where it came from.
    Propagated {
        /// Passes made.
        pass_count: usize,
        /// Largest change of a probability in the last.
        change: f64,
    },
    /// The cheapest only.
    Best {
        /// How many.
        count: usize,
        /// Each of the others has at most `exp(-rest_from)` of the best one's weight, nats.
        rest_from: f64,
    },
}

/// Finds association probabilities and keeps the memory for it.
#[derive(Clone, Debug, Default)]
pub struct Marginals {
    local: Local,
    best: Placement,
    sweep: SweepMemory,
    messages: Messages,
    k_best: KBest,
    of_edges: Vec<f64>,
    of_without: Vec<f64>,
    of_unclaimed: Vec<f64>,
}

impl Marginals {
    /// Probability of every edge of the component where an assignment has weight `exp(-cost)`:
    /// `p_nm = Σ_{a with n-m} exp(-c(a)) / Σ_a exp(-c(a))` \[jpda\]. Edges of cost 0 and more count
    /// too. `component` must be of the same edges.
    ///
    /// All assignments are summed, row after row, over the sets of columns that are taken and that
    /// rows to come may want (equal sets are one: as \[ehm\] does). Weights are those of reduced
    /// costs, `exp(-(c_nm - u_n - v_m))`, `exp(u_n)` for a row without and `exp(v_m)` for a column
    /// that nobody takes: the product is 1 for the best assignment and less for all others, so what
    /// underflows is nothing. Where there are more sets than the limit, [`MarginalLimits::beyond`]
    /// says what is done.
    pub fn find<'a>(
        &'a mut self,
        solved: Solved<'_>,
        component: Component<'a>,
        limits: MarginalLimits,
    ) -> Probabilities<'a> {
        self.local.take(solved, component);
        self.best.take(solved, component, &self.local);
        reset(&mut self.of_edges, self.local.edge_count(), 0.0);
        reset(&mut self.of_without, self.local.row_count(), 0.0);
        let mut sweep = Sweep::new(&mut self.sweep, &self.local, &self.best);
        let is_summed = sweep.run(limits.state_count, &mut self.of_edges, &mut self.of_without);
        let basis = match limits.beyond {
            _ if is_summed => Basis::All,
            Beyond::Propagate { pass_count, change } => self.propagate(pass_count, change),
            Beyond::Best(best) => self.sum_best(solved, component, best),
        };
        self.sum_columns();
        Probabilities { marginals: self, component, basis }
    }

    fn propagate(&mut self, pass_limit: usize, enough: f64) -> Basis {
        self.messages.begin(&self.local, &self.best);
        let (mut pass_count, mut change) = (0, f64::INFINITY);
        while pass_count < pass_limit && enough < change {
            change = self.messages.pass(&self.local, &mut self.of_edges, &mut self.of_without);
            pass_count += 1;
        }
        Basis::Propagated { pass_count, change }
    }

    fn sum_best(
        &mut self,
        solved: Solved<'_>,
        component: Component<'_>,
        limits: BestLimits,
    ) -> Basis {
        self.of_edges.fill(0.0);
        self.of_without.fill(0.0);
        let ranked = self.k_best.find(solved, component, limits);
        let total: f64 = ranked.iter().map(|one| (-one.extra).exp()).sum();
        for one in ranked.iter() {
            let probability = (-one.extra).exp() / total;
            for (row, place) in one.places().iter().enumerate() {
                match self.local.edge(row, *place) {
                    Some(edge) => self.of_edges[edge] += probability,
                    None => self.of_without[row] += probability,
                }
            }
        }
        Basis::Best { count: ranked.count(), rest_from: ranked.rest_from() }
    }

    fn sum_columns(&mut self) {
        reset(&mut self.of_unclaimed, self.local.column_count(), 1.0);
        for row in 0..self.local.row_count() {
            let first = self.local.first_edge(row);
            for (offset, (column, _)) in self.local.row(row).enumerate() {
                self.of_unclaimed[column as usize] -= self.of_edges[first + offset];
            }
        }
        self.of_unclaimed.iter_mut().for_each(|of_column| *of_column = of_column.max(0.0));
    }
}

/// Association probabilities of a component.
#[derive(Clone, Copy, Debug)]
pub struct Probabilities<'a> {
    marginals: &'a Marginals,
    component: Component<'a>,
    basis: Basis,
}

impl<'a> Probabilities<'a> {
    /// What they were summed over.
    #[must_use]
    pub fn basis(&self) -> Basis {
        self.basis
    }

    /// Columns of row `component.rows[row_index]`, in the order of its edges, and how likely each is
    /// the row's.
    pub fn of_row(&self, row_index: usize) -> impl Iterator<Item = (usize, f64)> + use<'a> {
        let Self { marginals, component, .. } = *self;
        let first = marginals.local.first_edge(row_index);
        let columns = marginals.local.row(row_index).map(|(column, _)| column as usize);
        columns.enumerate().map(move |(offset, column)| {
            (component.columns[column] as usize, marginals.of_edges[first + offset])
        })
    }

    /// How likely row `component.rows[row_index]` has no column.
    #[must_use]
    pub fn without(&self, row_index: usize) -> f64 {
        self.marginals.of_without[row_index]
    }

    /// How likely column `component.columns[column_index]` has no row.
    #[must_use]
    pub fn unclaimed(&self, column_index: usize) -> f64 {
        self.marginals.of_unclaimed[column_index]
    }
}
