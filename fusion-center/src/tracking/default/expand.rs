//! The best ways in which hypotheses go on with a look: which branch takes which plot.
//!
//! Depth-first over the members of a hypothesis, each with its options in ascending order of cost,
//! cut where the cost so far and the least cost of the rest exceed what is worth keeping (branch and
//! bound): exact, up to a bound of its work.

use super::hypotheses::Hypotheses;

/// One branch's option.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Choice {
    pub(super) cost: f64,
    /// Which plot it takes.
    pub(super) plot: Option<u32>,
    /// What it means to who asked.
    pub(super) tag: u32,
}

/// How many ways are kept, and how much may be done to find them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Limits {
    pub(super) count: usize,
    /// Worse than the best by more is dropped, nats.
    pub(super) margin: f64,
    /// Partial ways looked at, over all hypotheses.
    pub(super) visits: usize,
}

/// How a hypothesis goes on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Way {
    pub(super) cost: f64,
    pub(super) hypothesis: usize,
    /// Where its tags begin.
    from: usize,
}

/// What each member of a group may do under each of its branches, ascending in cost and never none.
#[derive(Clone, Debug, Default)]
pub(super) struct Options {
    choices: Vec<Choice>,
    /// Where the choices of each branch of each member end; 0 first.
    ends: Vec<usize>,
    /// The first branch of each member.
    first_of: Vec<usize>,
}

impl Options {
    pub(super) fn clear(&mut self) {
        self.choices.clear();
        self.ends.clear();
        self.ends.push(0);
        self.first_of.clear();
    }

    /// The branches that follow are of another member.
    pub(super) fn begin_member(&mut self) {
        self.first_of.push(self.ends.len() - 1);
    }

    /// Adds a choice of the branch at work.
    pub(super) fn push(&mut self, choice: Choice) {
        self.choices.push(choice);
    }

    /// The branch has no more choices.
    pub(super) fn end_branch(&mut self) {
        let from = self.ends.last().copied().unwrap_or(0);
        self.choices[from..].sort_by(|a, b| a.cost.total_cmp(&b.cost));
        self.ends.push(self.choices.len());
    }

    fn of(&self, member: usize, leaf: u16) -> &[Choice] {
        let at = self.first_of[member] + usize::from(leaf);
        &self.choices[self.ends[at]..self.ends[at + 1]]
    }
}

/// Ways on, ascending in cost.
#[derive(Clone, Debug, Default)]
pub(super) struct Ways {
    pub(super) ways: Vec<Way>,
    /// The tag of each member's choice, way after way, in no particular order of ways.
    tags: Vec<u32>,
    member_count: usize,
}

impl Ways {
    /// The tag of each member's choice.
    pub(super) fn tags_of(&self, way: &Way) -> &[u32] {
        &self.tags[way.from..way.from + self.member_count]
    }
}

/// The search, and the best ways so far; it keeps its memory.
#[derive(Clone, Debug, Default)]
pub(super) struct Search {
    pub(super) options: Options,
    pub(super) found: Ways,
    /// Least cost of each member and those after it, under the hypothesis at work.
    rest: Vec<f64>,
    /// Hypotheses, the best first.
    order: Vec<usize>,
    hypothesis: usize,
    tags: Vec<u32>,
    plots: Vec<u32>,
    visits_left: usize,
    best: f64,
    bound: f64,
}

impl Search {
    /// Finds the best ways on of hypotheses with `options`.
    pub(super) fn run(&mut self, joint: &Hypotheses, limits: &Limits) {
        let (costs, member_count) = (&joint.costs, joint.members.len());
        self.order.clear();
        self.order.extend(0..costs.len());
        self.order.sort_by(|a, b| costs[*a].total_cmp(&costs[*b]).then(a.cmp(b)));
        self.found.ways.clear();
        self.found.tags.clear();
        self.found.member_count = member_count;
        self.visits_left = limits.visits;
        (self.best, self.bound) = (f64::INFINITY, f64::INFINITY);
        for index in 0..costs.len() {
            let hypothesis = self.order[index];
            let leaves = joint.leaves_of(hypothesis);
            self.hypothesis = hypothesis;
            self.rest.clear();
            self.rest.resize(member_count + 1, 0.0);
            for member in (0..member_count).rev() {
                let least = self.options.of(member, leaves[member])[0].cost;
                self.rest[member] = self.rest[member + 1] + least;
            }
            // The first way of each hypothesis is found even if the work is used up.
            self.visits_left = self.visits_left.max(2 * member_count + 1);
            self.descend(leaves, costs[hypothesis], limits);
        }
        self.trim(limits);
    }

    /// Goes on with the member after those that have their tags; `leaves` are those of the hypothesis.
    fn descend(&mut self, leaves: &[u16], cost: f64, limits: &Limits) {
        let member = self.tags.len();
        if self.bound < cost + self.rest[member] || self.visits_left == 0 {
            return;
        }
        self.visits_left -= 1;
        let Some(leaf) = leaves.get(member) else {
            self.take(cost, limits);
            return;
        };
        for index in 0..self.options.of(member, *leaf).len() {
            let choice = self.options.of(member, *leaf)[index];
            if self.bound < cost + choice.cost + self.rest[member + 1] {
                break;
            }
            if choice.plot.is_some_and(|plot| self.plots.contains(&plot)) {
                continue;
            }
            self.tags.push(choice.tag);
            self.plots.extend(choice.plot);
            self.descend(leaves, cost + choice.cost, limits);
            self.tags.pop();
            if choice.plot.is_some() {
                self.plots.pop();
            }
        }
    }

    fn take(&mut self, cost: f64, limits: &Limits) {
        let (hypothesis, from) = (self.hypothesis, self.found.tags.len());
        self.found.ways.push(Way { cost, hypothesis, from });
        self.found.tags.extend_from_slice(&self.tags);
        self.best = self.best.min(cost);
        self.bound = self.bound.min(self.best + limits.margin);
        if 2 * limits.count <= self.found.ways.len() {
            self.trim(limits);
        }
    }

    /// Keeps the best.
    fn trim(&mut self, limits: &Limits) {
        let bound = self.best + limits.margin;
        let found = &mut self.found.ways;
        found.retain(|way| way.cost <= bound);
        found.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        found.truncate(limits.count);
        if let Some(last) = found.last().filter(|_| found.len() == limits.count) {
            self.bound = self.bound.min(last.cost);
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};

    use super::*;

    /// Sums of a handful of doubles in another order.
    const TOLERANCE: f64 = 1e-12;

    /// Three hypotheses about four members, each with a branch of its own; four options of each.
    fn random(seed: u64) -> (Hypotheses, Search) {
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(seed);
        let costs = (0..3).map(|_| rng.random_range(0.0..3.0)).collect();
        let leaves = (0..12).map(|at| at / 4).collect();
        let mut search = Search::default();
        search.options.clear();
        for branch in 0..12 {
            if branch % 3 == 0 {
                search.options.begin_member();
            }
            for plot in 0..4 {
                let cost = rng.random_range(-4.0..4.0);
                search.options.push(Choice { cost, plot: (plot < 3).then_some(plot), tag: plot });
            }
            search.options.end_branch();
        }
        (Hypotheses { members: vec![0, 1, 2, 3], costs, leaves }, search)
    }

    /// The cost of a hypothesis with the option at digit `code` for each member, if no plot is taken
    /// twice.
    fn cost_of(
        joint: &Hypotheses,
        options: &Options,
        (index, code): (usize, usize),
    ) -> Option<f64> {
        let digits = [code % 4, code / 4 % 4, code / 16 % 4, code / 64];
        let of = |member: usize| options.of(member, joint.leaves_of(index)[member]);
        let chosen = || digits.into_iter().enumerate().map(|(member, digit)| of(member)[digit]);
        let mut plots: Vec<u32> = chosen().filter_map(|choice| choice.plot).collect();
        let count = plots.len();
        plots.sort_unstable();
        plots.dedup();
        let sum: f64 = chosen().map(|choice| choice.cost).sum();
        (plots.len() == count).then(|| joint.costs[index] + sum)
    }

    /// Every combination, one after the other.
    fn all(joint: &Hypotheses, options: &Options) -> Vec<f64> {
        let codes = (0..3).flat_map(|index| (0..256).map(move |code| (index, code)));
        let mut sums: Vec<f64> = codes.filter_map(|code| cost_of(joint, options, code)).collect();
        sums.sort_by(f64::total_cmp);
        sums
    }

    #[test]
    fn the_best_ways_are_those_of_trying_all() {
        for seed in 0..50 {
            let (joint, mut search) = random(seed);
            search.run(&joint, &Limits { count: 20, margin: 5.0, visits: 100_000 });
            let mut expected = all(&joint, &search.options);
            let best = expected[0];
            expected.retain(|cost| *cost <= best + 5.0);
            expected.truncate(20);
            assert_eq!(search.found.ways.len(), expected.len());
            for (way, cost) in search.found.ways.iter().zip(expected) {
                assert!((way.cost - cost).abs() < TOLERANCE);
            }
        }
    }

    #[test]
    fn some_way_is_found_with_little_work() {
        let (joint, mut search) = random(3);
        search.run(&joint, &Limits { count: 20, margin: 5.0, visits: 1 });
        assert!(!search.found.ways.is_empty());
    }
}
