//! Who belongs to what: the cheapest one-to-one assignment, exact.
//!
//! Minimises `Σ c_ij z_ij` with `z_ij ∈ {0, 1}`, `Σ_j z_ij = 1`, `Σ_i z_ij ≤ 1` for `rows ≤ columns`, by
//! shortest augmenting paths with potentials (Hungarian method \[kuhn\]): `O(rows² · columns)`.
//! Leaving a row out is a column of its own with the price of that.

/// Prices row by row and what is needed to work on them; kept from frame to frame.
#[derive(Clone, Debug, Default)]
pub struct Assignment {
    row_count: usize,
    column_count: usize,
    prices: Vec<f64>,
    row_potential: Vec<f64>,
    potential: Vec<f64>,
    row_of: Vec<usize>,
    slack: Vec<f64>,
    before: Vec<usize>,
    is_done: Vec<bool>,
}

/// No row.
const FREE: usize = usize::MAX;

impl Assignment {
    /// The column of each row into `chosen`: the cheapest assignment of `row_count` rows to
    /// `column_count` columns with the finite prices `price(row, column)`; `None` where leaving the
    /// row out, at no price, is cheaper.
    pub fn solve_into(
        &mut self,
        [row_count, column_count]: [usize; 2],
        price: impl Fn(usize, usize) -> f64,
        chosen: &mut Vec<Option<usize>>,
    ) {
        self.fill([row_count, column_count], price);
        for row in 0..row_count {
            self.augment(row);
        }
        chosen.clear();
        chosen.resize(row_count, None);
        for (column, row) in self.row_of[..column_count].iter().enumerate() {
            if *row != FREE && self.price(*row, column) < 0.0 {
                chosen[*row] = Some(column);
            }
        }
    }

    /// One column more for each row: that of leaving it out, at no price.
    fn fill(&mut self, [row_count, column_count]: [usize; 2], price: impl Fn(usize, usize) -> f64) {
        self.row_count = row_count;
        self.column_count = column_count + row_count;
        self.prices.clear();
        for row in 0..row_count {
            self.prices.extend((0..column_count).map(|column| price(row, column)));
            self.prices.extend((0..row_count).map(|_| 0.0));
        }
        reset(&mut self.row_potential, row_count, 0.0);
        reset(&mut self.potential, self.column_count, 0.0);
        reset(&mut self.row_of, self.column_count, FREE);
    }

    fn price(&self, row: usize, column: usize) -> f64 {
        self.prices[row * self.column_count + column]
    }

    /// Finds a column for `row`, moving others along the cheapest path.
    fn augment(&mut self, row: usize) {
        reset(&mut self.slack, self.column_count, f64::INFINITY);
        reset(&mut self.before, self.column_count, FREE);
        reset(&mut self.is_done, self.column_count, false);
        let (mut at_row, mut from, mut reached) = (row, FREE, 0.0);
        let end = loop {
            let (next, least) = self.nearest(at_row, from, reached);
            reached = least;
            self.is_done[next] = true;
            if self.row_of[next] == FREE {
                break next;
            }
            (at_row, from) = (self.row_of[next], next);
        };
        self.row_potential[row] += reached;
        for column in 0..self.column_count {
            if self.is_done[column] && self.row_of[column] != FREE {
                self.row_potential[self.row_of[column]] += reached - self.slack[column];
            }
            if self.is_done[column] {
                self.potential[column] -= reached - self.slack[column];
            }
        }
        let mut column = end;
        while self.before[column] != FREE {
            let earlier = self.before[column];
            self.row_of[column] = self.row_of[earlier];
            column = earlier;
        }
        self.row_of[column] = row;
    }

    /// Looks at all columns from `row`, reached over column `from`; the nearest that is not done.
    fn nearest(&mut self, row: usize, from: usize, reached: f64) -> (usize, f64) {
        let (mut next, mut least) = (0, f64::INFINITY);
        for column in 0..self.column_count {
            if self.is_done[column] {
                continue;
            }
            let reduced =
                self.price(row, column) - self.row_potential[row] - self.potential[column];
            if reached + reduced < self.slack[column] {
                self.slack[column] = reached + reduced;
                self.before[column] = from;
            }
            if self.slack[column] < least {
                (next, least) = (column, self.slack[column]);
            }
        }
        (next, least)
    }
}

fn reset<T: Clone>(values: &mut Vec<T>, count: usize, value: T) {
    values.clear();
    values.resize(count, value);
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};

    /// The least total price over all ways, by trying them.
    fn cheapest(prices: &[Vec<f64>], row: usize, taken: &mut Vec<bool>) -> f64 {
        let Some(of_row) = prices.get(row) else { return 0.0 };
        let mut least = cheapest(prices, row + 1, taken);
        for (column, price) in of_row.iter().enumerate() {
            if !taken[column] {
                taken[column] = true;
                least = least.min(price + cheapest(prices, row + 1, taken));
                taken[column] = false;
            }
        }
        least
    }

    #[test]
    fn it_is_the_cheapest_of_all() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let (mut solver, mut chosen) = (Assignment::default(), Vec::new());
        for _ in 0..2000 {
            let (rows, columns) = (rng.random_range(0..6), rng.random_range(0..6));
            let mut of_row = || (0..columns).map(|_| rng.random_range(-3.0..2.0)).collect();
            let prices: Vec<Vec<f64>> = (0..rows).map(|_| of_row()).collect();
            solver.solve_into([rows, columns], |row, column| prices[row][column], &mut chosen);
            let mut taken = vec![false; columns];
            let mut total = 0.0;
            for (row, column) in chosen.iter().enumerate() {
                let again = column.is_some_and(|at| std::mem::replace(&mut taken[at], true));
                assert!(!again, "{prices:?} {chosen:?}");
                total += column.map_or(0.0, |at| prices[row][at]);
            }
            let want = cheapest(&prices, 0, &mut vec![false; columns]);
            assert!((total - want).abs() < 1e-9, "{total} {want} {prices:?} {chosen:?}");
        }
    }

    #[test]
    fn a_greedy_choice_is_not_enough() {
        let prices = [[-10.0, -9.0], [-9.0, -1.0]];
        let mut chosen = Vec::new();
        Assignment::default().solve_into([2, 2], |row, column| prices[row][column], &mut chosen);
        assert_eq!(chosen, [Some(1), Some(0)]);
    }
}
