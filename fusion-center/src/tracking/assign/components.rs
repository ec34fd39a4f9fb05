//! Splits tracks and plots into groups that have nothing to do with each other.

use super::{Edges, NONE, reset, short};

/// Tracks that compete, directly or over others, and the plots they compete for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Component<'a> {
    /// Its rows, ascending; at least one.
    pub rows: &'a [u32],
    /// Its columns, ascending; none if the only row has no edge.
    pub columns: &'a [u32],
}

/// Connected components of [`Edges`], in the order of their first rows.
///
/// Columns without edges are in none. Union-find over rows: two rows with a column in common are
/// joined, and the lower row stands for both.
#[derive(Clone, Debug, Default)]
pub struct Components {
    rows: Grouped,
    columns: Grouped,
    /// The row that stands for each row, or one on the way to it.
    above: Vec<u32>,
    /// The first row with an edge to each column.
    first_row: Vec<u32>,
    /// Component of each row, then of each column.
    labels: Vec<u32>,
}

impl Components {
    /// Splits `edges`, those of any cost. Time: a little more than proportional to the edges.
    pub fn find(&mut self, edges: &Edges) {
        let row_count = edges.row_count();
        self.above.clear();
        self.above.extend(0..short(row_count));
        reset(&mut self.first_row, edges.column_count(), NONE);
        for row in 0..row_count {
            self.join_row(edges, row);
        }
        let mut count = 0;
        self.labels.clear();
        for row in 0..row_count {
            let first = self.top(short(row)) as usize;
            // Rows come in order, so a lower one that stands for this has its label.
            let label = if first == row { count } else { self.labels[first] };
            count += u32::from(first == row);
            self.labels.push(label);
        }
        self.rows.group(count, &self.labels);
        self.label_columns();
        self.columns.group(count, &self.labels);
    }

    /// How many components.
    #[must_use]
    pub fn count(&self) -> usize {
        self.rows.starts.len().saturating_sub(1)
    }

    /// A component; empty if there is no such one.
    #[must_use]
    pub fn component(&self, index: usize) -> Component<'_> {
        Component { rows: self.rows.of(index), columns: self.columns.of(index) }
    }

    /// All components.
    pub fn iter(&self) -> impl Iterator<Item = Component<'_>> {
        (0..self.count()).map(|index| self.component(index))
    }

    fn join_row(&mut self, edges: &Edges, row: usize) {
        let (columns, _) = edges.row_slices(row);
        for column in columns {
            let first = self.first_row[*column as usize];
            if first == NONE {
                self.first_row[*column as usize] = short(row);
                continue;
            }
            let (one, other) = (self.top(first), self.top(short(row)));
            self.above[one.max(other) as usize] = one.min(other);
        }
    }

    /// The row that stands for `row`; halves the way to it.
    fn top(&mut self, mut row: u32) -> u32 {
        loop {
            let above = self.above[row as usize];
            if above == row {
                return row;
            }
            self.above[row as usize] = self.above[above as usize];
            row = above;
        }
    }

    /// Replaces the labels of rows by those of columns.
    fn label_columns(&mut self) {
        for first in &mut self.first_row {
            *first = if *first == NONE { NONE } else { self.labels[*first as usize] };
        }
        std::mem::swap(&mut self.first_row, &mut self.labels);
    }
}

/// Members of each group, ascending, one group after another.
#[derive(Clone, Debug, Default)]
struct Grouped {
    starts: Vec<u32>,
    members: Vec<u32>,
}

impl Grouped {
    /// `labels[member]` is the group of each member, below `count`, or [`NONE`].
    fn group(&mut self, count: u32, labels: &[u32]) {
        reset(&mut self.starts, count as usize + 1, 0);
        for label in labels.iter().filter(|label| **label != NONE) {
            self.starts[*label as usize] += 1;
        }
        let mut end = 0;
        for start in &mut self.starts {
            end += *start;
            *start = end;
        }
        reset(&mut self.members, end as usize, 0);
        // From the last: every start comes down from the end of its group.
        for (member, label) in labels.iter().enumerate().rev() {
            if *label != NONE {
                let start = &mut self.starts[*label as usize];
                *start -= 1;
                self.members[*start as usize] = short(member);
            }
        }
    }

    fn of(&self, index: usize) -> &[u32] {
        match self.starts.get(index..index + 2) {
            Some([start, end]) => &self.members[*start as usize..*end as usize],
            _ => &[],
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    use super::*;
    use crate::tracking::assign::tests::{Kind, Shape, random_edges};

    fn share(edges: &Edges, one: usize, other: usize) -> bool {
        edges.row(one).any(|(column, _)| edges.cost(other, column).is_some())
    }

    /// Labels of rows by spreading the lowest along edges until nothing changes.
    fn spread(edges: &Edges) -> Vec<usize> {
        let mut labels: Vec<usize> = (0..edges.row_count()).collect();
        loop {
            let lowest = |row: usize| {
                let near = (0..labels.len()).filter(|other| share(edges, row, *other));
                near.map(|other| labels[other]).min().unwrap_or(labels[row])
            };
            let after: Vec<usize> = (0..labels.len()).map(lowest).collect();
            if after == labels {
                return after;
            }
            labels = after;
        }
    }

    #[test]
    fn they_are_those_of_spreading_labels() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let (mut edges, mut components) = (Edges::default(), Components::default());
        for _ in 0..300 {
            let shape = Shape {
                row_count: rng.random_range(0..20),
                column_count: rng.random_range(0..20),
                share: rng.random_range(0.0..0.15),
            };
            random_edges(&mut rng, shape, Kind::Any, &mut edges);
            components.find(&edges);
            let labels = spread(&edges);
            let mut wanted: Vec<Vec<u32>> = vec![Vec::new(); shape.row_count];
            labels.iter().enumerate().for_each(|(row, label)| wanted[*label].push(short(row)));
            wanted.retain(|rows| !rows.is_empty());
            let found: Vec<Vec<u32>> = components.iter().map(|one| one.rows.to_vec()).collect();
            assert_eq!(found, wanted);
            for component in components.iter() {
                let mut columns: Vec<u32> = component
                    .rows
                    .iter()
                    .flat_map(|row| edges.row(*row as usize).map(|(column, _)| short(column)))
                    .collect();
                columns.sort_unstable();
                columns.dedup();
                assert_eq!(component.columns, columns);
            }
        }
    }

    #[test]
    fn nothing_has_no_components() {
        let mut components = Components::default();
        components.find(&Edges::default());
        assert_eq!((components.count(), components.iter().count()), (0, 0));
        assert_eq!(components.component(7), Component { rows: &[], columns: &[] });
    }
}
