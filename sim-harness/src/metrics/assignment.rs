//! Optimal assignment of rows to columns, exact, for costs that fit in memory.

use std::iter::successors;

/// What it costs to give a column to a row: finite, of any sign, less is better.
#[derive(Clone, Debug, PartialEq)]
pub struct Costs {
    row_count: usize,
    column_count: usize,
    /// Row by row.
    values: Vec<f64>,
}

impl Costs {
    /// The costs `of(row, column)`.
    pub fn new(row_count: usize, column_count: usize, of: impl Fn(usize, usize) -> f64) -> Self {
        let of = &of;
        let row = |r| (0..column_count).map(move |c| of(r, c));
        Self { row_count, column_count, values: (0..row_count).flat_map(row).collect() }
    }

    fn at(&self, row: usize, column: usize) -> f64 {
        self.values[row * self.column_count + column]
    }

    fn transposed(&self) -> Self {
        Self::new(self.column_count, self.row_count, |row, column| self.at(column, row))
    }
}

/// The column of every row, so that no column is given twice, all rows or all columns are used, and
/// the sum of the costs is least.
///
/// Shortest augmenting paths: with prices `u` of rows and `v` of columns that keep every reduced
/// cost `cost − u − v ≥ 0` and that of every given pair at 0, one row after another takes the path
/// of least reduced cost to a free column, and prices follow. `O(rows² columns)`.
#[must_use]
pub fn assignment(costs: &Costs) -> Vec<Option<usize>> {
    if costs.row_count <= costs.column_count {
        return wide(costs).into_iter().map(Some).collect();
    }
    let mut columns = vec![None; costs.row_count];
    for (column, row) in wide(&costs.transposed()).into_iter().enumerate() {
        columns[row] = Some(column);
    }
    columns
}

/// State of the search for at most as many rows as columns. Column `column_count` is no column: the
/// row that looks for one stands there.
struct Search<'a> {
    costs: &'a Costs,
    row_prices: Vec<f64>,
    column_prices: Vec<f64>,
    /// The row that has the column.
    row_of: Vec<Option<usize>>,
}

fn wide(costs: &Costs) -> Vec<usize> {
    let root = costs.column_count;
    let mut search = Search {
        costs,
        row_prices: vec![0.0; costs.row_count],
        column_prices: vec![0.0; root + 1],
        row_of: vec![None; root + 1],
    };
    (0..costs.row_count).for_each(|row| search.place(row));
    let mut columns = vec![0; costs.row_count];
    for (column, row) in search.row_of[..root].iter().enumerate() {
        row.iter().for_each(|row| columns[*row] = column);
    }
    columns
}

impl Search<'_> {
    /// Gives `row` a column; rows placed before may move to others.
    fn place(&mut self, row: usize) {
        let root = self.costs.column_count;
        self.row_of[root] = Some(row);
        let mut distances = vec![f64::INFINITY; root];
        let mut before = vec![root; root];
        let mut is_reached = vec![false; root + 1];
        let mut column = root;
        while let Some(from) = self.row_of[column] {
            is_reached[column] = true;
            self.look(from, column, &is_reached, (&mut distances, &mut before));
            let open = (0..root).filter(|next| !is_reached[*next]);
            let Some(nearest) = open.min_by(|a, b| distances[*a].total_cmp(&distances[*b])) else {
                return;
            };
            self.pay(distances[nearest], &is_reached, &mut distances);
            column = nearest;
        }
        let path: Vec<usize> =
            successors(Some(column), |at| (*at != root).then(|| before[*at])).collect();
        for step in path.windows(2) {
            self.row_of[step[0]] = self.row_of[step[1]];
        }
    }

    /// Notes which columns are nearer over the one that row `from` has.
    fn look(
        &self,
        from: usize,
        column: usize,
        is_reached: &[bool],
        (distances, before): (&mut [f64], &mut [usize]),
    ) {
        for next in (0..distances.len()).filter(|next| !is_reached[*next]) {
            let through = self.reduced(from, next);
            if through < distances[next] {
                (distances[next], before[next]) = (through, column);
            }
        }
    }

    fn reduced(&self, row: usize, column: usize) -> f64 {
        self.costs.at(row, column) - self.row_prices[row] - self.column_prices[column]
    }

    /// Moves the prices by `step`, so that the nearest column is reached at no cost.
    fn pay(&mut self, step: f64, is_reached: &[bool], distances: &mut [f64]) {
        for (column, is_paid) in is_reached.iter().enumerate() {
            if *is_paid {
                self.row_of[column].iter().for_each(|row| self.row_prices[*row] += step);
                self.column_prices[column] -= step;
            } else {
                distances[column] -= step;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    use super::*;

    /// Sums of a few numbers below 10 that are added in another order.
    const SAME_SUM: f64 = 1e-9;

    /// The least sum over all ways to use every row, or every column if these are fewer.
    fn least(costs: &Costs, row: usize, taken: &mut Vec<usize>, skips_left: usize) -> f64 {
        if row == costs.row_count {
            return 0.0;
        }
        let mut best = f64::INFINITY;
        if 0 < skips_left {
            best = least(costs, row + 1, taken, skips_left - 1);
        }
        for column in 0..costs.column_count {
            if taken.contains(&column) {
                continue;
            }
            taken.push(column);
            best = best.min(costs.at(row, column) + least(costs, row + 1, taken, skips_left));
            taken.pop();
        }
        best
    }

    fn check(costs: &Costs) {
        let columns = assignment(costs);
        let given: Vec<usize> = columns.iter().copied().flatten().collect();
        let distinct: std::collections::BTreeSet<_> = given.iter().collect();
        assert_eq!(distinct.len(), given.len(), "{costs:?} {columns:?}");
        assert_eq!(given.len(), costs.row_count.min(costs.column_count), "{costs:?}");
        let pairs = columns.iter().enumerate().filter_map(|(row, column)| Some((row, (*column)?)));
        let sum: f64 = pairs.map(|(row, column)| costs.at(row, column)).sum();
        let skips = costs.row_count.saturating_sub(costs.column_count);
        let best = least(costs, 0, &mut Vec::new(), skips);
        assert!((sum - best).abs() < SAME_SUM, "{costs:?}: {sum} {best}");
    }

    #[test]
    fn no_other_assignment_is_cheaper() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        for _ in 0..2000 {
            let (rows, columns) = (rng.random_range(0..6), rng.random_range(0..6));
            let values: Vec<f64> =
                (0..rows * columns).map(|_| rng.random_range(-3.0..10.0)).collect();
            check(&Costs::new(rows, columns, |row, column| values[row * columns + column]));
        }
    }

    #[test]
    fn ties_are_solved_too() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        for _ in 0..2000 {
            let (rows, columns) = (rng.random_range(1..6), rng.random_range(1..6));
            let values: Vec<f64> =
                (0..rows * columns).map(|_| f64::from(rng.random_range(0..3))).collect();
            check(&Costs::new(rows, columns, |row, column| values[row * columns + column]));
        }
    }

    #[test]
    fn the_nearest_first_is_not_taken_where_it_is_dear() {
        // By hand: 1 + 9 for the nearest first, 2 + 3 in all.
        let costs = Costs::new(2, 2, |row, column| [[1.0, 2.0], [3.0, 9.0]][row][column]);
        assert_eq!(assignment(&costs), [Some(1), Some(0)]);
    }
}
