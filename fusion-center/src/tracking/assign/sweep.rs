//! The exact sum over all assignments of a component, row after row.

use super::local::{Local, Placement};
use super::{NONE, reset, short};

/// Columns that may be open at a time: one bit each.
const MAX_OPEN: u32 = u64::BITS;

/// Memory of [`Sweep`].
#[derive(Clone, Debug, Default)]
pub(super) struct SweepMemory {
    /// Rows in the order in which they are summed.
    order: Vec<u32>,
    is_ordered: Vec<bool>,
    /// Rows that want an open column.
    near: Vec<u32>,
    /// Rows of each column, column after column.
    row_starts: Vec<u32>,
    rows: Vec<u32>,
    /// Rows to come that want each column.
    to_come: Vec<u32>,
    /// Bit of each open column, [`NONE`] of others.
    bits: Vec<u32>,
    steps: Vec<Step>,
    choices: Vec<Choice>,
    closings: Vec<Closing>,
    /// Before each row and after the last: sets of taken columns, ascending, with the summed
    /// weights of all ways to and from there.
    states: Vec<State>,
    reached: Vec<State>,
}

/// One row's part of the sum: ranges of [`SweepMemory::choices`], `closings` and `states`.
#[derive(Clone, Debug, Default)]
struct Step {
    row: usize,
    without_weight: f64,
    choices: std::ops::Range<usize>,
    closings: std::ops::Range<usize>,
    states: std::ops::Range<usize>,
}

/// An edge of the row.
#[derive(Clone, Copy, Debug)]
struct Choice {
    edge: usize,
    bit: u64,
    weight: f64,
}

/// A column that no later row wants, and its weight if nobody took it.
#[derive(Clone, Copy, Debug)]
struct Closing {
    bit: u64,
    unclaimed_weight: f64,
}

#[derive(Clone, Copy, Debug)]
struct State {
    taken: u64,
    /// Sum over the ways to here, and over those on from here.
    to_here: f64,
    from_here: f64,
}

impl SweepMemory {
    /// Gives a column a bit; false if there is none left.
    fn open_column(&mut self, column: usize, free_bits: &mut u64) -> bool {
        let bit = free_bits.trailing_zeros();
        if bit == MAX_OPEN {
            return false;
        }
        *free_bits &= !(1 << bit);
        self.bits[column] = bit;
        let range = self.row_starts[column] as usize..self.row_starts[column + 1] as usize;
        self.near.extend_from_slice(&self.rows[range]);
        true
    }

    /// The states after `step`, from `first` on in `states`.
    fn add_states(&mut self, step: &Step, first: usize) {
        let closings = &self.closings[step.closings.clone()];
        self.reached.clear();
        for state in &self.states[step.states.clone()] {
            self.reached.push(state.onward(state.taken, step.without_weight, closings));
            for choice in free(&self.choices[step.choices.clone()], state.taken) {
                let chosen = state.taken | choice.bit;
                self.reached.push(state.onward(chosen, choice.weight, closings));
            }
        }
        self.reached.sort_unstable_by_key(|state| state.taken);
        for state in &self.reached {
            match self.states[first..].last_mut() {
                Some(last) if last.taken == state.taken => last.to_here += state.to_here,
                _ => self.states.push(*state),
            }
        }
    }
}

impl State {
    /// Where a choice of weight `weight` leads that leaves the columns `chosen` taken.
    fn onward(&self, chosen: u64, weight: f64, closings: &[Closing]) -> Self {
        let (taken, unclaimed_weight) = close(closings, chosen);
        Self { taken, to_here: self.to_here * weight * unclaimed_weight, from_here: 0.0 }
    }

    /// Adds the probability of each of `choices`, with the weight of all ways on from there, to
    /// that of its edge; gives their weights together.
    fn share<'a>(
        &self,
        choices: impl Iterator<Item = (&'a Choice, f64)>,
        total: f64,
        of_edges: &mut [f64],
    ) -> f64 {
        let mut sum = 0.0;
        for (choice, onward) in choices {
            let weight = choice.weight * onward;
            of_edges[choice.edge] += self.to_here * weight / total;
            sum += weight;
        }
        sum
    }
}

/// The sum at work.
pub(super) struct Sweep<'a> {
    memory: &'a mut SweepMemory,
    local: &'a Local,
    prices: &'a Placement,
}

impl<'a> Sweep<'a> {
    pub(super) fn new(
        memory: &'a mut SweepMemory,
        local: &'a Local,
        prices: &'a Placement,
    ) -> Self {
        Self { memory, local, prices }
    }

    /// Adds the probability of each edge and of each row to be without; false, with nothing added,
    /// if more than `state_count` sets would be needed between two rows.
    pub(super) fn run(
        &mut self,
        state_count: usize,
        of_edges: &mut [f64],
        of_without: &mut [f64],
    ) -> bool {
        self.list_rows_of_columns();
        if !self.plan() || !self.forward(state_count) {
            return false;
        }
        let total = self.memory.states.last().map_or(1.0, |state| state.to_here);
        self.backward(total, of_edges, of_without);
        true
    }

    fn list_rows_of_columns(&mut self) {
        let memory = &mut *self.memory;
        reset(&mut memory.row_starts, self.local.column_count() + 1, 0);
        for row in 0..self.local.row_count() {
            for (column, _) in self.local.row(row) {
                memory.row_starts[column as usize] += 1;
            }
        }
        memory.to_come.clear();
        memory.to_come.extend_from_slice(&memory.row_starts[..self.local.column_count()]);
        let mut end = 0;
        for start in &mut memory.row_starts {
            end += *start;
            *start = end;
        }
        reset(&mut memory.rows, end as usize, 0);
        for row in (0..self.local.row_count()).rev() {
            for (column, _) in self.local.row(row) {
                let start = &mut memory.row_starts[column as usize];
                *start -= 1;
                memory.rows[*start as usize] = short(row);
            }
        }
    }

    /// Orders the rows so that few columns are open at a time, and gives these their bits; false if
    /// there are too few bits.
    fn plan(&mut self) -> bool {
        let row_count = self.local.row_count();
        self.memory.order.clear();
        self.memory.near.clear();
        self.memory.steps.clear();
        self.memory.choices.clear();
        self.memory.closings.clear();
        reset(&mut self.memory.is_ordered, row_count, false);
        reset(&mut self.memory.bits, self.local.column_count(), NONE);
        let mut free_bits = u64::MAX;
        for _ in 0..row_count {
            let row = self.next_row();
            if !self.open(row, &mut free_bits) {
                return false;
            }
            self.close(row, &mut free_bits);
        }
        true
    }

    /// The row that opens the fewest columns, of those that want an open one if there are any; of
    /// equals that with the fewest edges, then the first.
    fn next_row(&mut self) -> usize {
        let memory = &mut *self.memory;
        memory.near.retain(|row| !memory.is_ordered[*row as usize]);
        let opens = |row: usize| {
            let columns = self.local.row(row);
            let new = columns.filter(|(column, _)| memory.bits[*column as usize] == NONE);
            (new.count(), self.local.row(row).count(), row)
        };
        let near = memory.near.iter().map(|row| *row as usize).min_by_key(|row| opens(*row));
        near.unwrap_or_else(|| {
            let others = (0..self.local.row_count()).filter(|row| !memory.is_ordered[*row]);
            others.min_by_key(|row| opens(*row)).unwrap_or_default()
        })
    }

    fn open(&mut self, row: usize, free_bits: &mut u64) -> bool {
        let memory = &mut *self.memory;
        memory.is_ordered[row] = true;
        memory.order.push(short(row));
        let first_choice = memory.choices.len();
        let of_row = self.prices.of_rows[row];
        for (offset, (column, cost)) in self.local.row(row).enumerate() {
            let index = column as usize;
            if memory.bits[index] == NONE && !memory.open_column(index, free_bits) {
                return false;
            }
            let reduced = (cost - of_row - self.prices.of_columns[index]).max(0.0);
            memory.choices.push(Choice {
                edge: self.local.first_edge(row) + offset,
                bit: 1 << memory.bits[index],
                weight: (-reduced).exp(),
            });
        }
        memory.steps.push(Step {
            row,
            without_weight: of_row.min(0.0).exp(),
            choices: first_choice..memory.choices.len(),
            ..Step::default()
        });
        true
    }

    fn close(&mut self, row: usize, free_bits: &mut u64) {
        let memory = &mut *self.memory;
        let first_closing = memory.closings.len();
        for (column, _) in self.local.row(row) {
            let index = column as usize;
            memory.to_come[index] -= 1;
            if memory.to_come[index] == 0 {
                let bit = 1 << memory.bits[index];
                *free_bits |= bit;
                let unclaimed_weight = self.prices.of_columns[index].min(0.0).exp();
                memory.closings.push(Closing { bit, unclaimed_weight });
            }
        }
        if let Some(step) = memory.steps.last_mut() {
            step.closings = first_closing..memory.closings.len();
        }
    }

    /// Sums the ways to every state; false if there are too many states.
    fn forward(&mut self, state_count: usize) -> bool {
        let memory = &mut *self.memory;
        memory.states.clear();
        memory.states.push(State { taken: 0, to_here: 1.0, from_here: 0.0 });
        let mut first = 0;
        for index in 0..memory.steps.len() {
            let step = Step { states: first..memory.states.len(), ..memory.steps[index].clone() };
            first = memory.states.len();
            memory.add_states(&step, first);
            memory.steps[index] = step;
            if state_count < memory.states.len() - first {
                return false;
            }
        }
        true
    }

    /// Sums the ways from every state, and with them the probabilities.
    fn backward(&mut self, total: f64, of_edges: &mut [f64], of_without: &mut [f64]) {
        let memory = &mut *self.memory;
        // After the last row all columns are closed, so one state is left.
        memory.states.iter_mut().for_each(|state| state.from_here = 1.0);
        let mut end = memory.states.len();
        for step in memory.steps.iter().rev() {
            let (before, after) = memory.states[..end].split_at_mut(step.states.end);
            end = step.states.end;
            let choices = &memory.choices[step.choices.clone()];
            let closings = &memory.closings[step.closings.clone()];
            for state in &mut before[step.states.start..] {
                let without = step.without_weight * onward(after, closings, state.taken);
                of_without[step.row] += state.to_here * without / total;
                let with = free(choices, state.taken)
                    .map(|choice| (choice, onward(after, closings, state.taken | choice.bit)));
                state.from_here = without + state.share(with, total, of_edges);
            }
        }
    }
}

/// Weight of all ways on from a row after which the columns `chosen` are taken.
fn onward(after: &[State], closings: &[Closing], chosen: u64) -> f64 {
    let (taken, weight) = close(closings, chosen);
    let next = after.partition_point(|state| state.taken < taken);
    weight * after[next].from_here
}

/// Choices whose column is not taken.
fn free(choices: &[Choice], taken: u64) -> impl Iterator<Item = &Choice> {
    choices.iter().filter(move |choice| taken & choice.bit == 0)
}

/// Forgets the columns that close, and gives the weight of those of them that nobody took.
fn close(closings: &[Closing], mut taken: u64) -> (u64, f64) {
    let mut weight = 1.0;
    for closing in closings {
        if taken & closing.bit == 0 {
            weight *= closing.unclaimed_weight;
        }
        taken &= !closing.bit;
    }
    (taken, weight)
}
