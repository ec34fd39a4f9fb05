//! The best ways in which hypotheses go on with a look: which branch takes which plot.
//!
//! Depth-first over the members of a hypothesis, each with its options in ascending order of cost,
//! cut where the cost so far and the least cost of the rest exceed what is worth keeping (branch and
//! bound): exact, up to a bound of its work.

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

/// The search, and the best ways so far.
struct Search<'a> {
    /// Options of each member, ascending in cost.
    options: Vec<&'a [Choice]>,
    /// Least cost of each member and those after it.
    rest: Vec<f64>,
    limits: Limits,
    hypothesis: usize,
    tags: Vec<u32>,
    plots: Vec<u32>,
    best: f64,
    bound: f64,
    found: Ways,
}

/// The best ways on, ascending in cost. `costs` are those of the hypotheses; `options(hypothesis,
/// member)` are in ascending order and never none.
pub(super) fn best_ways<'a>(
    costs: &[f64],
    member_count: usize,
    limits: Limits,
    options: impl Fn(usize, usize) -> &'a [Choice],
) -> Ways {
    let mut order: Vec<usize> = (0..costs.len()).collect();
    order.sort_by(|a, b| costs[*a].total_cmp(&costs[*b]).then(a.cmp(b)));
    let mut search = Search {
        options: Vec::new(),
        rest: Vec::new(),
        limits,
        hypothesis: 0,
        tags: Vec::new(),
        plots: Vec::new(),
        best: f64::INFINITY,
        bound: f64::INFINITY,
        found: Ways { member_count, ..Ways::default() },
    };
    for hypothesis in order {
        search.hypothesis = hypothesis;
        search.options.clear();
        search.options.extend((0..member_count).map(|member| options(hypothesis, member)));
        search.rest.clear();
        search.rest.resize(member_count + 1, 0.0);
        for member in (0..member_count).rev() {
            search.rest[member] = search.rest[member + 1] + search.options[member][0].cost;
        }
        // The first way of each hypothesis is found even if the work is used up.
        search.limits.visits = search.limits.visits.max(2 * member_count + 1);
        search.descend(0, costs[hypothesis]);
    }
    search.trim();
    search.found
}

impl Search<'_> {
    fn descend(&mut self, member: usize, cost: f64) {
        if self.bound < cost + self.rest[member] || self.limits.visits == 0 {
            return;
        }
        self.limits.visits -= 1;
        if member == self.options.len() {
            self.take(cost);
            return;
        }
        for choice in self.options[member] {
            if self.bound < cost + choice.cost + self.rest[member + 1] {
                break;
            }
            if choice.plot.is_some_and(|plot| self.plots.contains(&plot)) {
                continue;
            }
            self.tags.push(choice.tag);
            self.plots.extend(choice.plot);
            self.descend(member + 1, cost + choice.cost);
            self.tags.pop();
            if choice.plot.is_some() {
                self.plots.pop();
            }
        }
    }

    fn take(&mut self, cost: f64) {
        let (hypothesis, from) = (self.hypothesis, self.found.tags.len());
        self.found.ways.push(Way { cost, hypothesis, from });
        self.found.tags.extend_from_slice(&self.tags);
        self.best = self.best.min(cost);
        self.bound = self.bound.min(self.best + self.limits.margin);
        if 2 * self.limits.count <= self.found.ways.len() {
            self.trim();
        }
    }

    /// Keeps the best.
    fn trim(&mut self) {
        let bound = self.best + self.limits.margin;
        let found = &mut self.found.ways;
        found.retain(|way| way.cost <= bound);
        found.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        found.truncate(self.limits.count);
        if let Some(last) = found.last().filter(|_| found.len() == self.limits.count) {
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

    fn random(seed: u64) -> (Vec<f64>, Vec<Vec<Vec<Choice>>>) {
        let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(seed);
        let costs = (0..3).map(|_| rng.random_range(0.0..3.0)).collect();
        let mut member = || {
            let mut of: Vec<Choice> = (0..4)
                .map(|plot| Choice {
                    cost: rng.random_range(-4.0..4.0),
                    plot: (plot < 3).then_some(plot),
                    tag: plot,
                })
                .collect();
            of.sort_by(|a, b| a.cost.total_cmp(&b.cost));
            of
        };
        (costs, (0..3).map(|_| (0..4).map(|_| member()).collect()).collect())
    }

    /// The cost of a hypothesis with the option at digit `code` for each member, if no plot is taken
    /// twice.
    fn cost_of(cost: f64, of: &[Vec<Choice>], code: usize) -> Option<f64> {
        let digits = [code % 4, code / 4 % 4, code / 16 % 4, code / 64];
        let chosen = || of.iter().zip(digits).map(|(options, digit)| options[digit]);
        let mut plots: Vec<u32> = chosen().filter_map(|choice| choice.plot).collect();
        let count = plots.len();
        plots.sort_unstable();
        plots.dedup();
        (plots.len() == count).then(|| cost + chosen().map(|choice| choice.cost).sum::<f64>())
    }

    /// Every combination, one after the other.
    fn all(costs: &[f64], options: &[Vec<Vec<Choice>>]) -> Vec<f64> {
        let of = |index: usize| {
            (0..256).filter_map(move |code| cost_of(costs[index], &options[index], code))
        };
        let mut sums: Vec<f64> = (0..costs.len()).flat_map(of).collect();
        sums.sort_by(f64::total_cmp);
        sums
    }

    #[test]
    fn the_best_ways_are_those_of_trying_all() {
        for seed in 0..50 {
            let (costs, options) = random(seed);
            let limits = Limits { count: 20, margin: 5.0, visits: 100_000 };
            let ways =
                best_ways(&costs, 4, limits, |hypothesis, member| &options[hypothesis][member]);
            let mut expected = all(&costs, &options);
            expected.retain(|cost| *cost <= expected_best(&costs, &options) + 5.0);
            expected.truncate(20);
            assert_eq!(ways.ways.len(), expected.len());
            for (way, cost) in ways.ways.iter().zip(expected) {
                assert!((way.cost - cost).abs() < TOLERANCE);
            }
        }
    }

    fn expected_best(costs: &[f64], options: &[Vec<Vec<Choice>>]) -> f64 {
        all(costs, options)[0]
    }

    #[test]
    fn some_way_is_found_with_little_work() {
        let (costs, options) = random(3);
        let limits = Limits { count: 20, margin: 5.0, visits: 1 };
        let ways = best_ways(&costs, 4, limits, |hypothesis, member| &options[hypothesis][member]);
        assert!(!ways.ways.is_empty());
    }
}
