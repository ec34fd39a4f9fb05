//! One component with indices of its own, and how one of its rows moves elsewhere at least cost.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::{Component, NONE, Solved, reset, short};

/// The edges of a component. Rows and columns are counted as the component lists them; the column
/// after the last is "without": any number of rows may be there, at no cost.
#[derive(Clone, Debug, Default)]
pub(super) struct Local {
    column_count: usize,
    starts: Vec<u32>,
    columns: Vec<u32>,
    costs: Vec<f64>,
    /// What each column of all is called here; only those of the component are up to date.
    name: Vec<u32>,
}

impl Local {
    pub(super) fn take(&mut self, solved: Solved<'_>, component: Component<'_>) {
        let edges = solved.edges();
        self.column_count = component.columns.len();
        if self.name.len() < edges.column_count() {
            self.name.resize(edges.column_count(), NONE);
        }
        for (index, column) in component.columns.iter().enumerate() {
            self.name[*column as usize] = short(index);
        }
        self.starts.clear();
        self.starts.push(0);
        self.columns.clear();
        self.costs.clear();
        for row in component.rows {
            let (columns, costs) = edges.row_slices(*row as usize);
            self.columns.extend(columns.iter().map(|column| self.name[*column as usize]));
            self.costs.extend_from_slice(costs);
            self.starts.push(short(self.columns.len()));
        }
    }

    pub(super) fn row_count(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    pub(super) fn column_count(&self) -> usize {
        self.column_count
    }

    pub(super) fn edge_count(&self) -> usize {
        self.columns.len()
    }

    /// Where rows that go without are.
    pub(super) fn without(&self) -> u32 {
        short(self.column_count)
    }

    /// Index of the first edge of a row.
    pub(super) fn first_edge(&self, row: usize) -> usize {
        self.starts[row] as usize
    }

    /// Columns and costs of a row.
    pub(super) fn row(&self, row: usize) -> impl Iterator<Item = (u32, f64)> + '_ {
        let range = self.starts[row] as usize..self.starts[row + 1] as usize;
        self.columns[range.clone()].iter().copied().zip(self.costs[range].iter().copied())
    }

    /// Index of an edge.
    pub(super) fn edge(&self, row: usize, column: u32) -> Option<usize> {
        let offset = self.row(row).position(|(other, _)| other == column)?;
        Some(self.first_edge(row) + offset)
    }

    pub(super) fn cost(&self, row: usize, column: u32) -> f64 {
        self.edge(row, column).map_or(0.0, |edge| self.costs[edge])
    }
}

/// Where every row of a component is, with prices `u`, `v` and `w` of rows, columns and of going
/// without: `u_n + v_m ≤ c_nm` and `u_n + w ≤ 0`, equal where a row is; `v_m ≤ w`, equal for columns
/// that nobody has.
#[derive(Clone, Debug, Default)]
pub(super) struct Placement {
    pub(super) place_of: Vec<u32>,
    pub(super) row_of: Vec<u32>,
    pub(super) of_rows: Vec<f64>,
    pub(super) of_columns: Vec<f64>,
    of_without: f64,
}

impl Placement {
    pub(super) fn take(&mut self, solved: Solved<'_>, component: Component<'_>, local: &Local) {
        self.place_of.clear();
        self.of_rows.clear();
        reset(&mut self.row_of, component.columns.len(), NONE);
        for (index, row) in component.rows.iter().enumerate() {
            let column = solved.column_of(*row as usize);
            let place = column.map_or(local.without(), |column| local.name[column]);
            if let Some(row_of) = self.row_of.get_mut(place as usize) {
                *row_of = short(index);
            }
            self.place_of.push(place);
            self.of_rows.push(solved.row_price(*row as usize));
        }
        self.of_columns.clear();
        let prices = component.columns.iter().map(|column| solved.column_price(*column as usize));
        self.of_columns.extend(prices);
        self.of_without = 0.0;
    }

    /// Becomes `other`, in memory that is there.
    pub(super) fn copy(&mut self, other: &Self) {
        self.place_of.clone_from(&other.place_of);
        self.row_of.clone_from(&other.row_of);
        self.of_rows.clone_from(&other.of_rows);
        self.of_columns.clone_from(&other.of_columns);
        self.of_without = other.of_without;
    }

    /// Sum of costs, nats, row after row.
    pub(super) fn cost(&self, local: &Local) -> f64 {
        let places = self.place_of.iter().enumerate();
        places.map(|(row, place)| local.cost(row, *place)).sum()
    }
}

/// Finds the cheapest way for one row to leave its place, as the rows after it give way and those
/// before it stay.
///
/// Dijkstra's search in the residual graph of the assignment as a flow: a row goes to another
/// column, whose row goes on from there, or goes without; from "without" a column may be given up,
/// whose row goes on, or a row that goes without may join. It ends where the row has come from.
/// Reduced costs are lengths, none below 0.
#[derive(Clone, Debug, Default)]
pub(super) struct Reroute {
    row: usize,
    fixed_count: usize,
    limit: f64,
    is_without_closed: bool,
    /// Places that the row may not go to, besides its own.
    forbidden: Vec<u32>,
    distance: Vec<f64>,
    over: Vec<Over>,
    touched: Vec<u32>,
    open: BinaryHeap<Reverse<(u64, u32)>>,
}

/// How a place is reached.
#[derive(Clone, Copy, Debug)]
enum Over {
    /// This row goes there.
    Row(u32),
    /// To "without": nobody has had this column until now.
    Column(u32),
    /// To a column, from "without": nobody has it from now.
    GivenUp,
}

impl Reroute {
    /// Sets what [`Self::find`] looks for: ways of less than `limit` nats for `row`, with the first
    /// `fixed_count` rows as they are.
    pub(super) fn begin(&mut self, row: usize, fixed_count: usize, limit: f64) {
        (self.row, self.fixed_count, self.limit) = (row, fixed_count, limit);
        self.is_without_closed = false;
        self.forbidden.clear();
    }

    /// The same for ways on which no other row goes without or stops to, and no column is given up
    /// or new.
    pub(super) fn begin_within(&mut self, row: usize, fixed_count: usize, limit: f64) {
        self.begin(row, fixed_count, limit);
        self.is_without_closed = true;
    }

    /// The row may not go to these places either.
    pub(super) fn forbid(&mut self, places: &[u32]) {
        self.forbidden.extend_from_slice(places);
    }

    /// What the cheapest way costs, nats.
    pub(super) fn find(&mut self, local: &Local, placement: &Placement) -> Option<f64> {
        self.prepare(local);
        self.look_from_row(local, placement, self.row, 0.0);
        self.search(local, placement, placement.place_of[self.row])
    }

    /// What the cheapest way from "without" back to it costs, if less than `limit` nats: at least
    /// one row goes without or stops to, or a column is given up or new.
    pub(super) fn find_over_without(
        &mut self,
        local: &Local,
        placement: &Placement,
        limit: f64,
    ) -> Option<f64> {
        self.begin(usize::MAX, 0, limit);
        self.prepare(local);
        self.look_from_without(local, placement, 0.0);
        self.search(local, placement, local.without())
    }

    fn prepare(&mut self, local: &Local) {
        let place_count = local.column_count() + 1;
        for place in self.touched.drain(..) {
            self.distance[place as usize] = f64::INFINITY;
        }
        self.open.clear();
        if self.distance.len() < place_count {
            self.distance.resize(place_count, f64::INFINITY);
            self.over.resize(place_count, Over::GivenUp);
        }
        if self.is_without_closed {
            // Nothing is nearer, so nothing gets there.
            self.distance[place_count - 1] = f64::NEG_INFINITY;
            self.touched.push(local.without());
        }
    }

    fn search(&mut self, local: &Local, placement: &Placement, target: u32) -> Option<f64> {
        while let Some(Reverse((bits, place))) = self.open.pop() {
            let reached = f64::from_bits(bits);
            if self.distance[place as usize] < reached {
                continue;
            }
            if place == target {
                return Some(reached);
            }
            if place == local.without() {
                self.look_from_without(local, placement, reached);
                continue;
            }
            match placement.row_of[place as usize] {
                NONE => {
                    let length = placement.of_columns[place as usize] - placement.of_without;
                    self.reach(local.without(), reached + length.max(0.0), Over::Column(place));
                }
                row => self.look_from_row(local, placement, row as usize, reached),
            }
        }
        None
    }

    /// Goes the way of `length` nats that was just found.
    pub(super) fn follow(&self, local: &Local, placement: &mut Placement, length: f64) {
        self.pay(local, placement, length);
        let mut place = placement.place_of[self.row];
        loop {
            let row = match self.over[place as usize] {
                Over::Row(row) => row,
                Over::Column(column) => {
                    place = column;
                    continue;
                }
                Over::GivenUp => {
                    placement.row_of[place as usize] = NONE;
                    place = local.without();
                    continue;
                }
            };
            if place != local.without() {
                placement.row_of[place as usize] = row;
            }
            place = std::mem::replace(&mut placement.place_of[row as usize], place);
            if row as usize == self.row {
                return;
            }
        }
    }

    fn look_from_row(&mut self, local: &Local, placement: &Placement, row: usize, reached: f64) {
        let of_row = placement.of_rows[row];
        let place = placement.place_of[row];
        let is_barred = |this: &Self, to: u32| row == this.row && this.forbidden.contains(&to);
        for (column, cost) in local.row(row) {
            let owner = placement.row_of[column as usize];
            let is_fixed = owner != NONE && (owner as usize) < self.fixed_count;
            if column == place || is_fixed || is_barred(self, column) {
                continue;
            }
            let length = cost - of_row - placement.of_columns[column as usize];
            self.reach(column, reached + length.max(0.0), Over::Row(short(row)));
        }
        if place != local.without() && !is_barred(self, local.without()) {
            let length = (-of_row - placement.of_without).max(0.0);
            self.reach(local.without(), reached + length, Over::Row(short(row)));
        }
    }

    fn look_from_without(&mut self, local: &Local, placement: &Placement, reached: f64) {
        for row in self.fixed_count..local.row_count() {
            let place = placement.place_of[row];
            if place == local.without() {
                self.look_from_row(local, placement, row, reached);
            } else {
                let length = placement.of_without - placement.of_columns[place as usize];
                self.reach(place, reached + length.max(0.0), Over::GivenUp);
            }
        }
    }

    fn reach(&mut self, place: u32, distance: f64, over: Over) {
        if distance < self.limit && distance < self.distance[place as usize] {
            self.distance[place as usize] = distance;
            self.over[place as usize] = over;
            self.touched.push(place);
            self.open.push(Reverse((distance.to_bits(), place)));
        }
    }

    /// Moves the prices so that the way found is tight.
    fn pay(&self, local: &Local, placement: &mut Placement, length: f64) {
        for row in self.fixed_count..local.row_count() {
            let reached = self.distance[placement.place_of[row] as usize];
            let reached = if row == self.row { 0.0 } else { reached };
            placement.of_rows[row] += (length - reached).max(0.0);
        }
        for (price, reached) in placement.of_columns.iter_mut().zip(&self.distance) {
            *price -= (length - reached).max(0.0);
        }
        placement.of_without -= (length - self.distance[local.column_count()]).max(0.0);
    }
}
