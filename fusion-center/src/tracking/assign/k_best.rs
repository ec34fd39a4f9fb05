//! The cheapest assignments of a component, one after another.

use super::local::{Local, Placement, Reroute};
use super::{Component, Solved};

#[cfg(test)]
mod tests;

/// How many assignments are asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BestLimits {
    /// How many at most, the best included; at least one is given.
    pub count: usize,
    /// Those that cost this much more than the best (nats) and beyond are left out.
    pub extra: f64,
}

/// Finds the cheapest assignments of a component and keeps the memory for it.
#[derive(Clone, Debug, Default)]
pub struct KBest {
    local: Local,
    search: Reroute,
    /// Assignments found, of which the first `found_count` count; the others are memory.
    found: Vec<Found>,
    found_count: usize,
    /// What may come next, the next last.
    candidates: Vec<Candidate>,
    /// Indices of what was found, cheapest first.
    order: Vec<u32>,
}

/// An assignment, and which others are its to lead to: those with its first rows as they are and
/// the row after them at none of some places.
#[derive(Clone, Debug, Default)]
struct Found {
    /// Against the best, nats: as searched, and as the costs add up.
    extra: f64,
    cost: f64,
    placement: Placement,
    fixed_count: usize,
    forbidden: Vec<u32>,
}

/// The cheapest assignment that has the rows before `row` as in `from`, and `row` elsewhere.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    extra: f64,
    from: usize,
    row: usize,
}

impl KBest {
    /// The `limits.count` cheapest assignments of the component among those that use any of its
    /// edges, those of cost 0 and more included: Murty's algorithm \[murty\].
    ///
    /// All others are split among the rows: those that first differ in the first row, in the
    /// second, and so on; one search gives the cheapest of each part, and the part that the next
    /// best is taken from is split again. Equal costs come in the order of their columns, row by
    /// row, none last; which of them are the last of the `count` is the same for the same edges.
    /// `component` must be of the same edges.
    pub fn find<'a>(
        &'a mut self,
        solved: Solved<'_>,
        component: Component<'a>,
        limits: BestLimits,
    ) -> Ranked<'a> {
        self.local.take(solved, component);
        self.candidates.clear();
        self.found_count = 0;
        let first = next_found(&mut self.found, &mut self.found_count);
        first.placement.take(solved, component, &self.local);
        first.cost = first.placement.cost(&self.local);
        (first.extra, first.fixed_count) = (0.0, 0);
        first.forbidden.clear();
        while self.found_count < limits.count {
            self.split(self.found_count - 1, limits);
            let Some(candidate) = self.candidates.pop() else { break };
            self.realise(candidate);
        }
        let is_full = limits.count <= self.found_count;
        let rest_from =
            if is_full { self.sort_found() } else { self.sort_found().max(limits.extra) };
        Ranked { best: self, component, rest_from }
    }

    /// The best of every part of what only the assignment at `from` leads to.
    fn split(&mut self, from: usize, limits: BestLimits) {
        let wanted_count = limits.count - self.found_count;
        let found = &self.found[from];
        for row in found.fixed_count..self.local.row_count() {
            let worst = match self.candidates.first() {
                Some(worst) if self.candidates.len() == wanted_count => worst.extra,
                _ => limits.extra,
            };
            self.search.begin(row, row, worst - found.extra);
            if row == found.fixed_count {
                self.search.forbid(&found.forbidden);
            }
            let Some(more) = self.search.find(&self.local, &found.placement) else { continue };
            let extra = found.extra + more;
            // Later ones of equal cost come later, so nearer to the front.
            let at = self.candidates.partition_point(|other| extra < other.extra);
            self.candidates.insert(at, Candidate { extra, from, row });
            let too_many = self.candidates.len().saturating_sub(wanted_count);
            self.candidates.drain(..too_many);
        }
    }

    /// Turns a candidate into an assignment.
    fn realise(&mut self, candidate: Candidate) {
        let Candidate { extra, from, row } = candidate;
        let mut found = std::mem::take(next_found(&mut self.found, &mut self.found_count));
        let parent = &self.found[from];
        found.placement.copy(&parent.placement);
        found.forbidden.clear();
        if row == parent.fixed_count {
            found.forbidden.extend_from_slice(&parent.forbidden);
        }
        self.search.begin(row, row, f64::INFINITY);
        self.search.forbid(&found.forbidden);
        found.forbidden.push(parent.placement.place_of[row]);
        if let Some(length) = self.search.find(&self.local, &parent.placement) {
            self.search.follow(&self.local, &mut found.placement, length);
        }
        (found.extra, found.fixed_count) = (extra, row);
        found.cost = found.placement.cost(&self.local);
        self.found[self.found_count - 1] = found;
    }

    /// Orders what was found; gives how much more the last costs than the first, nats.
    fn sort_found(&mut self) -> f64 {
        let found = &self.found[..self.found_count];
        self.order.clear();
        self.order.extend(0..super::short(found.len()));
        self.order.sort_unstable_by(|one, other| {
            let (one, other) = (&found[*one as usize], &found[*other as usize]);
            let by_cost = one.cost.total_cmp(&other.cost);
            by_cost.then_with(|| one.placement.place_of.cmp(&other.placement.place_of))
        });
        found.last().map_or(0.0, |last| last.extra)
    }
}

/// The memory for one more assignment.
fn next_found<'a>(found: &'a mut Vec<Found>, found_count: &mut usize) -> &'a mut Found {
    if found.len() == *found_count {
        found.push(Found::default());
    }
    *found_count += 1;
    &mut found[*found_count - 1]
}

/// The cheapest assignments of a component, cheapest first.
#[derive(Clone, Copy, Debug)]
pub struct Ranked<'a> {
    best: &'a KBest,
    component: Component<'a>,
    rest_from: f64,
}

/// One of [`Ranked`].
#[derive(Clone, Copy, Debug)]
pub struct RankedAssignment<'a> {
    /// What it costs more than the best, nats.
    pub extra: f64,
    places: &'a [u32],
    component: Component<'a>,
}

impl<'a> Ranked<'a> {
    /// How many there are: as many as asked for, fewer if there are no more below the limit.
    #[must_use]
    pub fn count(&self) -> usize {
        self.best.found_count
    }

    /// Every assignment that is not here costs at least this much more than the best, nats, up to
    /// rounding; infinite if all there are are here.
    #[must_use]
    pub fn rest_from(&self) -> f64 {
        self.rest_from
    }

    /// All of them; the first is the best, of extra cost 0 but for rounding.
    pub fn iter(&self) -> impl Iterator<Item = RankedAssignment<'a>> + use<'a> {
        let Self { best, component, .. } = *self;
        best.order.iter().map(move |index| {
            let found = &best.found[*index as usize];
            let extra = (found.cost - best.found[0].cost).max(0.0);
            RankedAssignment { extra, places: &found.placement.place_of, component }
        })
    }
}

impl RankedAssignment<'_> {
    /// The column of row `component.rows[row_index]`.
    #[must_use]
    pub fn column_of(&self, row_index: usize) -> Option<usize> {
        let place = *self.places.get(row_index)?;
        self.component.columns.get(place as usize).map(|column| *column as usize)
    }

    /// Where each row of the component is: an index into `component.columns`, or its length.
    pub(super) fn places(&self) -> &[u32] {
        self.places
    }
}
