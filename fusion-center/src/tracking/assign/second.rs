//! How much dearer the second best assignment is: whether a component is ambiguous.

use super::local::{Local, Placement, Reroute};
use super::{Component, Solved};

#[cfg(test)]
mod tests;

/// Finds margins and keeps the memory for it.
#[derive(Clone, Debug, Default)]
pub struct Second {
    local: Local,
    best: Placement,
    search: Reroute,
}

impl Second {
    /// How much more than the best (nats) the cheapest other assignment of the component costs, if
    /// that is less than `limit`; `limit` otherwise.
    ///
    /// What differs between two assignments is a set of cycles in the residual graph, each of which
    /// is an assignment by itself. So it is the shortest of the cycles over "without" (one search)
    /// and of those within given columns (one for each row, as the first that moves). A search
    /// ends at the least found so far: a small margin is found fast. `component` must be of the
    /// same edges.
    pub fn margin(&mut self, solved: Solved<'_>, component: Component<'_>, limit: f64) -> f64 {
        if let [row] = component.rows {
            return alone(solved, *row as usize).min(limit);
        }
        self.local.take(solved, component);
        self.best.take(solved, component, &self.local);
        let over_without = self.search.find_over_without(&self.local, &self.best, limit);
        let mut margin = over_without.unwrap_or(limit);
        for row in 0..self.local.row_count() {
            if self.best.place_of[row] == self.local.without() {
                continue;
            }
            self.search.begin_within(row, row, margin);
            if let Some(more) = self.search.find(&self.local, &self.best) {
                margin = more;
            }
        }
        margin
    }

    /// The same for one row: how much more than the best (nats) the cheapest assignment costs that
    /// gives row `component.rows[row_index]` another column or none; `limit` if it is not less.
    pub fn row_margin(
        &mut self,
        solved: Solved<'_>,
        component: Component<'_>,
        row_index: usize,
        limit: f64,
    ) -> f64 {
        if component.rows.len() <= row_index {
            return limit;
        }
        self.local.take(solved, component);
        self.best.take(solved, component, &self.local);
        self.search.begin(row_index, 0, limit);
        self.search.find(&self.local, &self.best).unwrap_or(limit)
    }
}

/// Margin of a row that nobody competes with: between the two least of 0 and its costs.
fn alone(solved: Solved<'_>, row: usize) -> f64 {
    let (mut best, mut second) = (0.0, f64::INFINITY);
    for (_, cost) in solved.edges().row(row) {
        second = f64::max(best, cost).min(second);
        best = f64::min(best, cost);
    }
    second - best
}
