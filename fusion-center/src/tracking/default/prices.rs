//! Prices of an assignment that show how much dearer another pair makes everything, at least.
//!
//! Prices `u_n ≤ 0` of rows and `v_m ≤ 0` of columns with `u_n + v_m ≤ c_nm`, equal for pairs of the
//! cheapest assignment, 0 for who has no partner: then with the pair `nm` all costs at least
//! `c_nm − u_n − v_m` more, and with row `n` alone at least `−u_n`. Many prices do; here columns get
//! the highest: those of shortest paths, `v_m = min(0, min_n c_nm − u_n)`, from all 0 downwards. So
//! a row whose plot nobody else wants has all of the price.

use crate::tracking::assign::Edges;

use super::work::NONE;

/// Rounds over all rows after which prices are left as they are: as many rows can hand a price on.
/// Prices that are then too high make more of the assignment look unclear than is.
const MAX_ROUNDS: usize = 50;

/// Prices, nats.
#[derive(Clone, Debug, Default)]
pub(super) struct Prices {
    pub(super) of_rows: Vec<f64>,
    pub(super) of_columns: Vec<f64>,
}

impl Prices {
    /// Those of the cheapest assignment, which gives row `n` the column `own[n]`.
    pub(super) fn raise(&mut self, edges: &Edges, own: &[u32]) {
        self.of_columns.clear();
        self.of_columns.resize(edges.column_count(), 0.0);
        self.of_rows.clear();
        self.of_rows.extend(own.iter().enumerate().map(|(row, own)| {
            if *own == NONE { 0.0 } else { edges.cost(row, *own as usize).unwrap_or(0.0) }
        }));
        for _ in 0..MAX_ROUNDS {
            if !self.round(edges, own) {
                return;
            }
        }
    }

    /// Lowers each price that is too high; whether any was.
    fn round(&mut self, edges: &Edges, own: &[u32]) -> bool {
        let mut changed = false;
        for (row, taken) in own.iter().enumerate() {
            let taken = *taken as usize;
            let tight = edges.cost(row, taken).map(|cost| cost - self.of_columns[taken]);
            let price = tight.unwrap_or(0.0);
            self.of_rows[row] = price;
            for (column, cost) in edges.row(row).filter(|(column, _)| *column != taken) {
                let high = self.of_columns[column];
                let low = high.min(cost - price);
                changed |= low < high - ROUNDING;
                self.of_columns[column] = low;
            }
        }
        changed
    }
}

/// Differences of sums of costs are not told apart below this, nats.
const ROUNDING: f64 = 1e-9;

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};

    use super::*;
    use crate::tracking::assign::{Edge, Solver};

    /// Sums of a handful of doubles.
    const TOLERANCE: f64 = 1e-8;

    /// The least cost with some pair given, or some row alone, by trying all.
    fn least(costs: &[[f64; 3]; 3], fits: impl Fn(&[usize; 3]) -> bool) -> f64 {
        let mut best = f64::INFINITY;
        for code in 0..64_usize {
            let of = [code % 4, code / 4 % 4, code / 16];
            let taken = [0, 1, 2].map(|column| of.iter().filter(|other| **other == column).count());
            if taken.iter().all(|count| *count <= 1) && fits(&of) {
                let cost = |row: usize| costs[row].get(of[row]).copied().unwrap_or(0.0);
                best = best.min((0..3).map(cost).sum());
            }
        }
        best
    }

    /// How many of a problem's bounds are met.
    fn met(costs: &[[f64; 3]; 3], prices: &Prices) -> usize {
        let best = least(costs, |_| true);
        let mut exact = 0;
        for row in 0..3 {
            let alone = least(costs, |of| of[row] == 3) - best;
            assert!(-prices.of_rows[row] <= alone + TOLERANCE);
            for column in 0..3 {
                let more = least(costs, |of| of[row] == column) - best;
                let bound = costs[row][column] - prices.of_rows[row] - prices.of_columns[column];
                assert!(-TOLERANCE <= bound && bound <= more + TOLERANCE);
                exact += usize::from(more - bound < TOLERANCE);
            }
        }
        exact
    }

    #[test]
    fn prices_bound_what_another_pair_costs() {
        let mut exact = 0;
        for seed in 0..200 {
            let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(seed);
            let costs: [[f64; 3]; 3] =
                std::array::from_fn(|_| std::array::from_fn(|_| rng.random_range(-5.0..2.0)));
            let mut edges = Edges::default();
            let all: Vec<Edge> = (0..9)
                .map(|at| Edge { row: at / 3, column: at % 3, cost: costs[at / 3][at % 3] })
                .collect();
            edges.fill(3, 3, &all).unwrap();
            let mut solver = Solver::default();
            let solved = solver.solve(&edges);
            let own: Vec<u32> = (0..3)
                .map(|row| solved.column_of(row).map_or(NONE, super::super::work::short))
                .collect();
            let mut prices = Prices::default();
            prices.raise(&edges, &own);
            exact += met(&costs, &prices);
        }
        assert!(800 < exact, "near half of the bounds are met: {exact} of 1800");
    }
}
