//! Sparse gated assignment of tracks to plots: the best, the next best, and how likely each pair is.
//!
//! Rows are tracks, columns are plots. An edge costs a negative log-likelihood ratio in nats: that
//! the two belong together against that they don't, so leaving both apart costs nothing. Of the
//! ways `z_nm ∈ {0, 1}` with at most one edge per row and per column the cheapest is sought:
//! `min Σ z_nm c_nm` \[wide-area, eqs. (10)-(12)\].
//!
//! From scan to scan: fill [`Edges`], [`Solver::solve`] them, split them with [`Components::find`],
//! and where a component's [`Second::margin`] is small, ask [`KBest::find`] or [`Marginals::find`].
//! All of these keep their memory, so that after a few scans nothing is allocated.

mod components;
mod edges;
mod k_best;
mod local;
mod marginals;
mod propagate;
mod second;
mod solve;
mod sweep;
#[cfg(test)]
mod tests;

pub use components::{Component, Components};
pub use edges::{AssignError, Edge, Edges};
pub use k_best::{BestLimits, KBest, Ranked, RankedAssignment};
pub use marginals::{Basis, Beyond, MarginalLimits, Marginals, Probabilities};
pub use second::Second;
pub use solve::{Solved, Solver};

/// No row or no column, where they are kept as short numbers.
const NONE: u32 = u32::MAX;

/// `index` as it is kept; every index is below a count that [`Edges`] has checked.
fn short(index: usize) -> u32 {
    u32::try_from(index).unwrap_or(NONE)
}

fn long(index: u32) -> Option<usize> {
    (index != NONE).then_some(index as usize)
}

/// `count` times `value`, in memory that is there already if it suffices.
fn reset<T: Clone>(values: &mut Vec<T>, count: usize, value: T) {
    values.clear();
    values.resize(count, value);
}
