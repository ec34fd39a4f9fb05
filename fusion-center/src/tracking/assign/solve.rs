//! The cheapest assignment: bids first, shortest augmenting paths for who is left.
//!
//! With prices `u_n ≤ 0` of rows and `v_m ≤ 0` of columns that keep `u_n + v_m ≤ c_nm` for every
//! edge, `Σ u_n + Σ v_m` is a lower bound of the cost of any assignment; it is met where given
//! edges are tight and rows and columns without a partner have price 0. So "nobody" needs no
//! column of its own, and edges that cost 0 or more are never taken.
//!
//! Rows bid for columns (augmenting row reduction \[jonker-volgenant\]): a row takes its best column
//! at the price at which its second best is as good, and whoever had it bids again. That settles
//! almost all; each row that is left takes the path of least reduced cost to a free column or to a
//! row that does better without \[kuhn\]. Prices are never raised, so a column once taken stays so.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

#[cfg(test)]
mod tests;

use super::{Edges, NONE, long, reset, short};

/// Bids per row, on average, after which the rest is left to paths. With 10 foreign plots per gate
/// (1,000 to 20,000 tracks, one component) 2 and 8 take the same time, 30 half as long again; with
/// fewer plots nothing is left over.
const BIDS_PER_ROW: usize = 8;

/// Assigns rows to columns and keeps the memory for it.
#[derive(Clone, Debug, Default)]
pub struct Solver {
    prices: Prices,
    /// Rows that the bids left.
    left: Vec<u32>,
    search: Search,
}

/// An assignment and the prices that prove it.
#[derive(Clone, Debug, Default)]
struct Prices {
    column_of: Vec<u32>,
    row_of: Vec<u32>,
    of_rows: Vec<f64>,
    of_columns: Vec<f64>,
    cost: f64,
}

/// Edges and their cheapest assignment.
#[derive(Clone, Copy, Debug)]
pub struct Solved<'a> {
    edges: &'a Edges,
    prices: &'a Prices,
}

impl Solver {
    /// The assignment of least cost, exact up to rounding; the same for the same `edges`.
    pub fn solve<'a>(&'a mut self, edges: &'a Edges) -> Solved<'a> {
        let (row_count, column_count) = (edges.row_count(), edges.column_count());
        let prices = &mut self.prices;
        reset(&mut prices.column_of, row_count, NONE);
        reset(&mut prices.row_of, column_count, NONE);
        reset(&mut prices.of_rows, row_count, 0.0);
        reset(&mut prices.of_columns, column_count, 0.0);
        self.left.clear();
        let mut bids_left = row_count.saturating_mul(BIDS_PER_ROW);
        for row in 0..row_count {
            bids_left = prices.bid_in_turn(edges, row, bids_left, &mut self.left);
        }
        self.search.fit(row_count, column_count);
        for row in &self.left {
            self.search.augment(edges, prices, *row);
        }
        let taken = |(row, column): (usize, &u32)| {
            let (columns, costs) = edges.row_slices(row);
            columns.iter().position(|other| other == column).map_or(0.0, |index| costs[index])
        };
        let given = prices.column_of.iter().enumerate().filter(|(_, column)| **column != NONE);
        prices.cost = given.map(taken).sum();
        Solved { edges, prices: &self.prices }
    }
}

impl<'a> Solved<'a> {
    /// What was assigned.
    #[must_use]
    pub fn edges(&self) -> &'a Edges {
        self.edges
    }

    /// Sum of the costs of all given edges, nats.
    #[must_use]
    pub fn cost(&self) -> f64 {
        self.prices.cost
    }

    /// The plot of a track.
    #[must_use]
    pub fn column_of(&self, row: usize) -> Option<usize> {
        self.prices.column_of.get(row).and_then(|column| long(*column))
    }

    /// The track of a plot.
    #[must_use]
    pub fn row_of(&self, column: usize) -> Option<usize> {
        self.prices.row_of.get(column).and_then(|row| long(*row))
    }

    /// `u_n ≤ 0`, nats: how much dearer everything is without this track, at most.
    #[must_use]
    pub fn row_price(&self, row: usize) -> f64 {
        self.prices.of_rows[row]
    }

    /// `v_m ≤ 0`, nats: how much dearer everything is without this plot, at most.
    #[must_use]
    pub fn column_price(&self, column: usize) -> f64 {
        self.prices.of_columns[column]
    }

    /// Columns of a row and `c_nm - u_n - v_m ≥ 0` (nats, up to rounding): how much dearer, at
    /// least, everything is with that edge. It is 0 for a given one.
    pub fn reduced(&self, row: usize) -> impl Iterator<Item = (usize, f64)> + 'a {
        let (prices, of_row) = (self.prices, self.prices.of_rows[row]);
        let reduced = move |column: usize, cost: f64| cost - of_row - prices.of_columns[column];
        self.edges.row(row).map(move |(column, cost)| (column, reduced(column, cost)))
    }
}

/// Best and second best of a row's offers; not to take any is one of 0.
struct Offers {
    best: f64,
    best_column: u32,
    second: f64,
    second_column: u32,
}

impl Prices {
    fn offers(&self, edges: &Edges, row: u32) -> Offers {
        let mut offers = Offers { best: 0.0, best_column: NONE, second: 0.0, second_column: NONE };
        let (columns, costs) = edges.row_slices(row as usize);
        for (column, cost) in columns.iter().zip(costs) {
            let value = cost - self.of_columns[*column as usize];
            if value < offers.best {
                (offers.second, offers.second_column) = (offers.best, offers.best_column);
                (offers.best, offers.best_column) = (value, *column);
            } else if value < offers.second {
                (offers.second, offers.second_column) = (value, *column);
            }
        }
        offers
    }

    /// `row` bids, then whoever it drives out, and so on; gives the bids left after that.
    fn bid_in_turn(
        &mut self,
        edges: &Edges,
        row: usize,
        mut bids_left: usize,
        left: &mut Vec<u32>,
    ) -> usize {
        let mut next = short(row);
        while next != NONE {
            if bids_left == 0 {
                left.push(next);
                return 0;
            }
            bids_left -= 1;
            next = self.bid(edges, next, left);
        }
        bids_left
    }

    /// One bid of `row`; gives the row that lost its column by it.
    fn bid(&mut self, edges: &Edges, row: u32, left: &mut Vec<u32>) -> u32 {
        let offers = self.offers(edges, row);
        self.of_rows[row as usize] = offers.second;
        if offers.best_column == NONE {
            return NONE;
        }
        let mut column = offers.best_column;
        let mut before = self.row_of[column as usize];
        if before != NONE && offers.second <= offers.best {
            // A tie: the price stays, so driving out could go round in circles.
            column = offers.second_column;
            if column == NONE || self.row_of[column as usize] != NONE {
                left.push(row);
                return NONE;
            }
            before = NONE;
        }
        self.of_columns[column as usize] -= offers.second - offers.best;
        self.row_of[column as usize] = row;
        self.column_of[row as usize] = column;
        if before != NONE {
            self.column_of[before as usize] = NONE;
        }
        before
    }
}

/// Where a path ends.
#[derive(Clone, Copy)]
enum End {
    /// At a column that nobody has.
    Free(u32),
    /// At a row that goes without.
    Without(u32),
}

/// Dijkstra's search over columns; all vectors are as they were after every search.
#[derive(Clone, Debug, Default)]
struct Search {
    distance: Vec<f64>,
    /// The row over which a column is reached.
    over: Vec<u32>,
    touched: Vec<u32>,
    /// Distances as bits, which for numbers of at least 0 sort alike, and columns.
    open: BinaryHeap<Reverse<(u64, u32)>>,
    /// Columns whose rows were looked at.
    done: Vec<u32>,
}

impl Search {
    fn fit(&mut self, row_count: usize, column_count: usize) {
        reset(&mut self.distance, column_count, f64::INFINITY);
        reset(&mut self.over, column_count, NONE);
        self.touched.reserve(row_count.min(column_count));
    }

    /// Gives `start`, which has no column, one, or finds that it is best without.
    fn augment(&mut self, edges: &Edges, prices: &mut Prices, start: u32) {
        prices.of_rows[start as usize] = prices.offers(edges, start).best;
        let mut best = f64::INFINITY;
        let mut end = End::Without(start);
        let (mut row, mut reached) = (start, 0.0);
        loop {
            (best, end) = self.look(edges, prices, (row, reached), (best, end));
            let Some((distance, column)) = self.nearest() else { break };
            if best <= distance {
                break;
            }
            self.done.push(column);
            (row, reached) = (prices.row_of[column as usize], distance);
        }
        self.pay(prices, start, best);
        self.flip(prices, start, end);
        self.forget();
    }

    /// Looks from a row at its distance to all its columns; gives the nearest end known then.
    fn look(
        &mut self,
        edges: &Edges,
        prices: &Prices,
        (row, reached): (u32, f64),
        (mut best, mut end): (f64, End),
    ) -> (f64, End) {
        let of_row = prices.of_rows[row as usize];
        if reached - of_row < best {
            (best, end) = (reached - of_row, End::Without(row));
        }
        let (columns, costs) = edges.row_slices(row as usize);
        for (column, cost) in columns.iter().zip(costs) {
            let index = *column as usize;
            let distance = reached + (cost - of_row - prices.of_columns[index]).max(0.0);
            if best <= distance || self.distance[index] <= distance {
                continue;
            }
            self.distance[index] = distance;
            self.over[index] = row;
            self.touched.push(*column);
            if prices.row_of[index] == NONE {
                (best, end) = (distance, End::Free(*column));
            } else {
                self.open.push(Reverse((distance.to_bits(), *column)));
            }
        }
        (best, end)
    }

    fn nearest(&mut self) -> Option<(f64, u32)> {
        loop {
            let Reverse((bits, column)) = self.open.pop()?;
            let distance = f64::from_bits(bits);
            // One that was found nearer later is here twice.
            if distance <= self.distance[column as usize] {
                return Some((distance, column));
            }
        }
    }

    /// Moves the prices so that the path to the end, `best` away, is tight.
    fn pay(&self, prices: &mut Prices, start: u32, best: f64) {
        prices.of_rows[start as usize] += best;
        for column in &self.done {
            let step = best - self.distance[*column as usize];
            prices.of_rows[prices.row_of[*column as usize] as usize] += step;
            prices.of_columns[*column as usize] -= step;
        }
    }

    fn flip(&self, prices: &mut Prices, start: u32, end: End) {
        let mut column = match end {
            End::Free(column) => column,
            End::Without(row) => {
                prices.of_rows[row as usize] = 0.0;
                std::mem::replace(&mut prices.column_of[row as usize], NONE)
            }
        };
        while column != NONE {
            let row = self.over[column as usize];
            prices.row_of[column as usize] = row;
            column = std::mem::replace(&mut prices.column_of[row as usize], column);
            debug_assert!(column != NONE || row == start, "a path starts where it started");
        }
    }

    fn forget(&mut self) {
        for column in self.touched.drain(..) {
            self.distance[column as usize] = f64::INFINITY;
        }
        self.open.clear();
        self.done.clear();
    }
}
