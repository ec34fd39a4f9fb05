//! Best-first branch and bound for the global optimum of the paper's objective.
//!
//! Boxes with the highest bounds are halved, a batch at a time; the best middle of a batch that
//! comes near the best pose so far starts a Newton descent. A box whose bound does not exceed the
//! best by more than the gap is dropped. The bounds of a batch are taken in parallel and used in
//! order, so that the result does not depend on the number of threads.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use rayon::iter::{IntoParallelRefIterator, ParallelIterator};

use super::super::prepared::{Motion, Prepared};
use super::L2Config;
use super::bounds::{Bounder, BoxValue, PoseBox};
use super::descent::descend;

/// Intervals of the heading with which the search starts.
const ROOT_COUNT: usize = 36;

/// Boxes halved at a time: enough for the threads to pay, few against all boxes.
const BATCH_COUNT: usize = 128;

/// A middle with this share of the best value starts a descent, unless it is the best pose's box.
const PROMISING_SHARE: f64 = 0.5;

/// What a search found: values are those of the objective, taken positive, 1/m².
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Found {
    pub(super) value: f64,
    pub(super) bound: f64,
    pub(super) box_count: usize,
}

/// A box that may hold the optimum; the order is that of bounds, then of age.
struct Open {
    pose_box: PoseBox,
    upper: f64,
    index: usize,
}

impl Ord for Open {
    fn cmp(&self, other: &Self) -> Ordering {
        self.upper.total_cmp(&other.upper).then(other.index.cmp(&self.index))
    }
}

impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Open {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Open {}

struct Search<'a> {
    data: &'a Prepared,
    config: &'a L2Config,
    bounder: Bounder<'a>,
    best: Option<(Motion, f64)>,
    open: BinaryHeap<Open>,
    box_count: usize,
}

/// The optimum over all poses, starting from what `starts` lead to; `None` where no pair of points
/// shares a period.
pub(super) fn search(
    data: &Prepared,
    starts: &[Motion],
    config: &L2Config,
) -> Option<(Motion, Found)> {
    if data.spans.is_empty() {
        return None;
    }
    let bounder = Bounder::new(data, config.covariance_scale);
    let roots = bounder.roots(ROOT_COUNT);
    let open = BinaryHeap::new();
    let mut search = Search { data, config, bounder, best: None, open, box_count: 0 };
    for start in starts {
        search.descend_from(start);
    }
    search.look_at(&roots);
    while search.box_count < config.max_box_count {
        let batch = search.next_batch();
        if batch.is_empty() {
            break;
        }
        search.look_at(&batch);
    }
    search.result()
}

impl Search<'_> {
    /// The value that a box must exceed to matter.
    fn needed(&self) -> f64 {
        self.best.map_or(0.0, |(_, value)| value * (1.0 + self.config.relative_gap))
    }

    fn descend_from(&mut self, start: &Motion) {
        let (motion, at) = descend(self.data, start, self.config.covariance_scale);
        let value = -at.value_per_m2;
        if self.best.is_none_or(|(_, best)| value > best) && value > 0.0 {
            self.best = Some((motion, value));
        }
    }

    /// Halves of the boxes with the highest bounds.
    fn next_batch(&mut self) -> Vec<PoseBox> {
        let needed = self.needed();
        let mut batch = Vec::with_capacity(2 * BATCH_COUNT);
        while batch.len() < 2 * BATCH_COUNT {
            let Some(next) = self.open.pop() else { break };
            if next.upper <= needed {
                self.open.clear();
                break;
            }
            batch.extend(Bounder::halves(&next.pose_box, self.data.node_spread_m));
        }
        batch
    }

    fn look_at(&mut self, boxes: &[PoseBox]) {
        let values: Vec<BoxValue> = boxes.par_iter().map(|b| self.bounder.value(b)).collect();
        let rated = || boxes.iter().zip(&values);
        if let Some((of, value)) = rated().max_by(|a, b| a.1.middle.total_cmp(&b.1.middle)) {
            let is_promising =
                self.best.is_none_or(|(_, best)| value.middle > PROMISING_SHARE * best);
            let middle = self.bounder.middle(of);
            if is_promising && !self.is_known(&middle) {
                self.descend_from(&middle);
            }
        }
        let needed = self.needed();
        for (pose_box, value) in boxes.iter().zip(&values) {
            self.box_count += 1;
            if value.upper > needed {
                let index = self.box_count;
                self.open.push(Open { pose_box: *pose_box, upper: value.upper, index });
            }
        }
    }

    /// Whether a pose lies beside the best one, where a descent would end there again.
    fn is_known(&self, motion: &Motion) -> bool {
        let radius_m = self.data.typical_sigma_m * self.config.covariance_scale.sqrt();
        self.best.is_some_and(|(best, _)| self.data.displacement_m(&best, motion) < radius_m)
    }

    fn result(&self) -> Option<(Motion, Found)> {
        let (motion, value) = self.best?;
        let left = self.open.peek().map_or(0.0, |open| open.upper);
        let bound = left.max(value * (1.0 + self.config.relative_gap));
        Some((motion, Found { value, bound, box_count: self.box_count }))
    }
}
