//! Association probabilities by messages between rows and columns, for components too wide to sum.

use super::local::{Local, Placement};
use super::reset;

/// Messages stay below this, so that sums and products of them stay finite.
const MOST: f64 = 1e150;

/// Loopy belief propagation for one-to-one association \[williams-lau\], by weights of reduced
/// costs: `w_nm = exp(-(c_nm - u_n - v_m))`, `a_n = exp(u_n)` of a row without, `b_m = exp(v_m)` of
/// a column that nobody takes.
///
/// ```text
/// to column m from row n:   s_nm = w_nm / (a_n + Σ_{k≠m} w_nk t_kn)
/// to row n from column m:   t_mn = 1 / (b_m + Σ_{l≠n} s_lm)
/// p_nm = w_nm t_mn / (a_n + Σ_k w_nk t_kn)
/// ```
///
/// Passes converge always; the limit is exact where rows and columns make a tree.
#[derive(Clone, Debug, Default)]
pub(super) struct Messages {
    weights: Vec<f64>,
    without_weights: Vec<f64>,
    unclaimed_weights: Vec<f64>,
    to_columns: Vec<f64>,
    to_rows: Vec<f64>,
    of_columns: Vec<Others>,
}

/// A sum of numbers of at least 0 that any one of them can be left out of without cancellation: the
/// largest is kept apart, and no other is more than half of what it is subtracted from.
#[derive(Clone, Copy, Debug)]
struct Others {
    largest: f64,
    largest_edge: usize,
    rest: f64,
}

impl Others {
    fn new(first: f64) -> Self {
        Self { largest: 0.0, largest_edge: usize::MAX, rest: first }
    }

    fn add(&mut self, edge: usize, value: f64) {
        if self.largest < value {
            self.rest += self.largest;
            (self.largest, self.largest_edge) = (value, edge);
        } else {
            self.rest += value;
        }
    }

    fn without(&self, edge: usize, value: f64) -> f64 {
        if edge == self.largest_edge { self.rest } else { self.largest + self.rest - value }
    }

    fn all(&self) -> f64 {
        self.largest + self.rest
    }
}

impl Messages {
    /// Columns want every row alike.
    pub(super) fn begin(&mut self, local: &Local, prices: &Placement) {
        self.weights.clear();
        self.without_weights.clear();
        for row in 0..local.row_count() {
            let of_row = prices.of_rows[row];
            self.without_weights.push(of_row.min(0.0).exp());
            self.weights.extend(local.row(row).map(|(column, cost)| {
                let reduced = cost - of_row - prices.of_columns[column as usize];
                (-reduced.max(0.0)).exp()
            }));
        }
        self.unclaimed_weights.clear();
        self.unclaimed_weights.extend(prices.of_columns.iter().map(|price| price.min(0.0).exp()));
        reset(&mut self.to_columns, self.weights.len(), 0.0);
        reset(&mut self.to_rows, self.weights.len(), 1.0);
    }

    /// Rows tell columns, columns tell rows; gives the largest change of a probability, of which
    /// there is one per edge and one per row to be without.
    pub(super) fn pass(
        &mut self,
        local: &Local,
        of_edges: &mut [f64],
        of_without: &mut [f64],
    ) -> f64 {
        self.of_columns.clear();
        self.of_columns.extend(self.unclaimed_weights.iter().map(|weight| Others::new(*weight)));
        let mut change: f64 = 0.0;
        for (row, without) in of_without.iter_mut().enumerate() {
            let mut wanted = Others::new(self.without_weights[row]);
            for (edge, _) in edges_of(local, row) {
                wanted.add(edge, self.weights[edge] * self.to_rows[edge]);
            }
            *without = self.without_weights[row] / wanted.all();
            for (edge, column) in edges_of(local, row) {
                let own = self.weights[edge] * self.to_rows[edge];
                let probability = own / wanted.all();
                change = change.max((probability - of_edges[edge]).abs());
                of_edges[edge] = probability;
                let others = wanted.without(edge, own).max(f64::MIN_POSITIVE);
                self.to_columns[edge] = (self.weights[edge] / others).min(MOST);
                self.of_columns[column].add(edge, self.to_columns[edge]);
            }
        }
        for row in 0..local.row_count() {
            for (edge, column) in edges_of(local, row) {
                let others = self.of_columns[column].without(edge, self.to_columns[edge]);
                self.to_rows[edge] = others.max(f64::MIN_POSITIVE).recip().min(MOST);
            }
        }
        change
    }
}

/// Index and column of every edge of a row.
fn edges_of(local: &Local, row: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
    (local.first_edge(row)..).zip(local.row(row).map(|(column, _)| column as usize))
}
