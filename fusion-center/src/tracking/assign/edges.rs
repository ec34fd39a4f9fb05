//! The pairs of tracks and plots that are worth a thought, and what each costs.

use thiserror::Error;

use super::{NONE, reset, short};

/// Why a pair was refused.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum AssignError {
    /// A cost must be a number above minus infinity.
    #[error(
        "give row {row} and column {column} a cost that is a number above -inf: {cost} was given"
    )]
    Cost {
        /// Row of the pair.
        row: usize,
        /// Column of the pair.
        column: usize,
        /// What was given, nats.
        cost: f64,
    },
    /// There is no such row or column.
    #[error(
        "keep to {row_count} rows and {column_count} columns: row {row} and column {column} were given"
    )]
    Outside {
        /// Row of the pair.
        row: usize,
        /// Column of the pair.
        column: usize,
        /// Rows that there are.
        row_count: usize,
        /// Columns that there are.
        column_count: usize,
    },
    /// A pair has one cost only.
    #[error("give row {row} and column {column} one cost: two were given")]
    Twice {
        /// Row of the pair.
        row: usize,
        /// Column of the pair.
        column: usize,
    },
    /// More rows, columns or pairs than indices of 32 bits tell apart.
    #[error("split the problem: {count} rows, columns or pairs are more than {limit}")]
    TooMany {
        /// How many there are.
        count: usize,
        /// How many there may be.
        limit: usize,
    },
}

/// Most rows, columns and pairs: what an index of 32 bits tells apart, and none.
const MAX_COUNT: usize = NONE as usize;

/// A pair and its cost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// The track, counted from 0.
    pub row: usize,
    /// The plot, counted from 0.
    pub column: usize,
    /// Negative log-likelihood ratio against leaving both apart, nats.
    pub cost: f64,
}

/// A sparse matrix of costs, row by row (CSR). Filled anew for every scan in the same memory.
///
/// Edges of any finite cost are kept: one that costs 0 or more is never in the best assignment, but
/// counts among the next best and the probabilities. An edge of infinite cost is no edge.
#[derive(Clone, Debug, Default)]
pub struct Edges {
    column_count: usize,
    /// Where each row starts, and the end of the last.
    starts: Vec<u32>,
    columns: Vec<u32>,
    costs: Vec<f64>,
    /// For each column, the last row that named it.
    named_by: Vec<u32>,
    /// Rows of [`Self::fill`] while they are sorted.
    next_in_row: Vec<u32>,
}

impl Edges {
    /// Forgets all rows and edges; `column_count` plots are there.
    ///
    /// # Errors
    /// [`AssignError::TooMany`].
    pub fn begin(&mut self, column_count: usize) -> Result<(), AssignError> {
        few_enough(column_count)?;
        self.column_count = column_count;
        self.starts.clear();
        self.starts.push(0);
        self.columns.clear();
        self.costs.clear();
        reset(&mut self.named_by, column_count, NONE);
        Ok(())
    }

    /// Adds an edge from the row at work to `column`. Infinite `cost` (nats) adds none.
    ///
    /// # Errors
    /// [`AssignError::Outside`], [`AssignError::Cost`], [`AssignError::Twice`],
    /// [`AssignError::TooMany`]; nothing is added then.
    #[inline]
    pub fn push(&mut self, column: usize, cost: f64) -> Result<(), AssignError> {
        let row = self.row_count();
        if self.column_count <= column {
            let (row_count, column_count) = (row + 1, self.column_count);
            return Err(AssignError::Outside { row, column, row_count, column_count });
        }
        if cost.is_nan() || cost < f64::MIN {
            return Err(AssignError::Cost { row, column, cost });
        }
        if cost > f64::MAX {
            return Ok(());
        }
        if self.named_by[column] == short(row) {
            return Err(AssignError::Twice { row, column });
        }
        few_enough(self.columns.len() + 1)?;
        self.named_by[column] = short(row);
        self.columns.push(short(column));
        self.costs.push(cost);
        Ok(())
    }

    /// Ends the row at work; the next edges are those of the next row.
    ///
    /// # Errors
    /// [`AssignError::TooMany`].
    pub fn end_row(&mut self) -> Result<(), AssignError> {
        few_enough(self.row_count() + 1)?;
        if self.starts.is_empty() {
            self.starts.push(0);
        }
        self.starts.push(short(self.columns.len()));
        Ok(())
    }

    /// Takes `edges` in any order; those of a row stay in the order given.
    ///
    /// # Errors
    /// As [`Self::push`]; what the matrix holds then is of no use.
    pub fn fill(
        &mut self,
        row_count: usize,
        column_count: usize,
        edges: &[Edge],
    ) -> Result<(), AssignError> {
        few_enough(row_count)?;
        self.begin(column_count)?;
        let mut order = std::mem::take(&mut self.next_in_row);
        let sorted = by_row(row_count, column_count, edges, &mut order)
            .and_then(|()| self.push_sorted(row_count, edges, &order));
        self.next_in_row = order;
        sorted
    }

    /// How many tracks: rows that have ended.
    #[must_use]
    pub fn row_count(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// How many plots.
    #[must_use]
    pub fn column_count(&self) -> usize {
        self.column_count
    }

    /// How many edges in rows that have ended.
    #[must_use]
    pub fn edge_count(&self) -> usize {
        self.starts.last().map_or(0, |end| *end as usize)
    }

    /// Columns and costs (nats) of a row, in the order given; empty for a row that is not there.
    pub fn row(&self, row: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
        let (columns, costs) = self.row_slices(row);
        columns.iter().map(|column| *column as usize).zip(costs.iter().copied())
    }

    /// Cost of a pair, nats, if it is an edge.
    #[must_use]
    pub fn cost(&self, row: usize, column: usize) -> Option<f64> {
        self.row(row).find(|(other, _)| *other == column).map(|(_, cost)| cost)
    }

    #[inline]
    pub(super) fn row_slices(&self, row: usize) -> (&[u32], &[f64]) {
        if self.row_count() <= row {
            return (&[], &[]);
        }
        let range = self.starts[row] as usize..self.starts[row + 1] as usize;
        (&self.columns[range.clone()], &self.costs[range])
    }

    /// Pushes the edges of row after row; `order` is that of [`by_row`].
    fn push_sorted(
        &mut self,
        row_count: usize,
        edges: &[Edge],
        order: &[u32],
    ) -> Result<(), AssignError> {
        let mut rest = order.iter().map(|index| edges[*index as usize]).peekable();
        for row in 0..row_count {
            while let Some(edge) = rest.next_if(|edge| edge.row == row) {
                self.push(edge.column, edge.cost)?;
            }
            self.end_row()?;
        }
        Ok(())
    }
}

/// Indices of `edges` in the order of their rows, into `order`.
fn by_row(
    row_count: usize,
    column_count: usize,
    edges: &[Edge],
    order: &mut Vec<u32>,
) -> Result<(), AssignError> {
    few_enough(edges.len())?;
    if let Some(Edge { row, column, .. }) = edges.iter().find(|edge| row_count <= edge.row) {
        let (row, column) = (*row, *column);
        return Err(AssignError::Outside { row, column, row_count, column_count });
    }
    order.clear();
    order.extend(0..short(edges.len()));
    // The index too, as this sort needs no memory but does not keep the order of equals.
    order.sort_unstable_by_key(|index| (edges[*index as usize].row, *index));
    Ok(())
}

fn few_enough(count: usize) -> Result<(), AssignError> {
    if MAX_COUNT <= count {
        return Err(AssignError::TooMany { count, limit: MAX_COUNT - 1 });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_hold_what_was_pushed() {
        let mut edges = Edges::default();
        assert_eq!((edges.row_count(), edges.row(0).count()), (0, 0));
        for _ in 0..2 {
            edges.begin(4).unwrap();
            edges.push(3, -1.0).unwrap();
            edges.push(0, 2.0).unwrap();
            edges.end_row().unwrap();
            edges.end_row().unwrap();
            edges.push(3, f64::INFINITY).unwrap();
            edges.push(3, -2.0).unwrap();
            edges.end_row().unwrap();
            assert_eq!((edges.row_count(), edges.column_count(), edges.edge_count()), (3, 4, 3));
            assert_eq!(edges.row(0).collect::<Vec<_>>(), [(3, -1.0), (0, 2.0)]);
            assert_eq!(edges.row(1).count() + edges.row(3).count(), 0);
            assert_eq!((edges.cost(2, 3), edges.cost(2, 0)), (Some(-2.0), None));
        }
    }

    #[test]
    fn pairs_in_any_order_make_the_same_rows() {
        let pair = |row, column, cost| Edge { row, column, cost };
        let mut edges = Edges::default();
        let given = [pair(2, 0, -1.0), pair(0, 1, -2.0), pair(2, 1, -3.0), pair(0, 0, -4.0)];
        edges.fill(4, 2, &given).unwrap();
        assert_eq!(edges.row(0).collect::<Vec<_>>(), [(1, -2.0), (0, -4.0)]);
        assert_eq!(edges.row(2).collect::<Vec<_>>(), [(0, -1.0), (1, -3.0)]);
        assert_eq!((edges.row_count(), edges.edge_count()), (4, 4));
    }

    #[test]
    fn wrong_pairs_are_refused() {
        let mut edges = Edges::default();
        edges.begin(2).unwrap();
        edges.push(1, -1.0).unwrap();
        assert_eq!(edges.push(1, -2.0), Err(AssignError::Twice { row: 0, column: 1 }));
        let outside = AssignError::Outside { row: 0, column: 2, row_count: 1, column_count: 2 };
        assert_eq!(edges.push(2, -2.0), Err(outside));
        let cost = f64::NEG_INFINITY;
        assert_eq!(edges.push(0, cost), Err(AssignError::Cost { row: 0, column: 0, cost }));
        assert!(matches!(edges.push(0, f64::NAN), Err(AssignError::Cost { .. })));
        edges.end_row().unwrap();
        edges.push(1, -2.0).unwrap();
        let too_far = Edge { row: 3, column: 0, cost: -1.0 };
        assert!(matches!(edges.fill(3, 1, &[too_far]), Err(AssignError::Outside { row: 3, .. })));
        let many = AssignError::TooMany { count: MAX_COUNT, limit: MAX_COUNT - 1 };
        assert_eq!(edges.begin(MAX_COUNT), Err(many));
    }
}
