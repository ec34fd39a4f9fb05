//! Exact association: depth-first branch and bound over the periods.
//!
//! Every branch fixes one more period. What an association costs at least is the cost of the fixed
//! periods plus, for every other one, the least that any of its own associations costs by itself
//! and against the fixed ones.

use super::Association;
use super::agreement::{Agreement, Group};

/// Periods with more possible associations are too many for an exact search.
const MAX_OPTION_COUNT: usize = 720;

/// Smallest gain over the best association, m²: less is rounding.
const NEGLIGIBLE_GAIN_M2: f64 = 1e-12;

/// The best association found.
pub(super) struct Searched {
    pub(super) association: Association,
    /// No other association costs less.
    #[cfg_attr(not(test), expect(dead_code, reason = "tests compare proven associations only"))]
    pub(super) is_proven: bool,
}

/// One possible association of a period with its cost by itself, m².
struct Choice {
    candidates: Association,
    within_m2: f64,
}

struct Tree<'a> {
    agreement: &'a Agreement<'a>,
    choices: Vec<Vec<Choice>>,
    best: (f64, Association),
    branches_left: usize,
}

/// The best association, from `start` on; `start` itself where the choices are too many.
pub(super) fn search(
    agreement: &Agreement<'_>,
    start: Association,
    max_branch_count: usize,
) -> Searched {
    let choices: Option<Vec<Vec<Choice>>> =
        agreement.groups.iter().map(|group| choices_of(agreement, group)).collect();
    let Some(choices) = choices else {
        return Searched { association: start, is_proven: false };
    };
    let best = (agreement.total_m2(&start), start);
    let mut tree = Tree { agreement, choices, best, branches_left: max_branch_count };
    let nothing_fixed = vec![0.0; agreement.candidates.len()];
    tree.descend(0.0, (&Association::new(), &nothing_fixed), 0);
    Searched { association: tree.best.1, is_proven: tree.branches_left > 0 }
}

impl Tree<'_> {
    /// Tries all choices of period `depth`, cheapest first, given the association of those before
    /// and what it costs each candidate, m².
    fn descend(
        &mut self,
        cost_m2: f64,
        (fixed, to_fixed_m2): (&Association, &[f64]),
        depth: usize,
    ) {
        if depth == self.choices.len() {
            if cost_m2 < self.best.0 - NEGLIGIBLE_GAIN_M2 {
                self.best = (cost_m2, fixed.clone());
            }
            return;
        }
        let later_m2: f64 = self.choices[depth + 1..]
            .iter()
            .map(|of_group| {
                of_group.iter().map(|c| c.added_m2(to_fixed_m2)).fold(f64::INFINITY, f64::min)
            })
            .sum();
        let mut ranked: Vec<(f64, usize)> = self.choices[depth]
            .iter()
            .enumerate()
            .map(|(index, choice)| (cost_m2 + choice.added_m2(to_fixed_m2), index))
            .collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (next_m2, index) in ranked {
            let is_worse = next_m2 + later_m2 >= self.best.0 - NEGLIGIBLE_GAIN_M2;
            if is_worse || self.branches_left == 0 {
                return;
            }
            self.branches_left -= 1;
            let added = &self.choices[depth][index].candidates;
            let next = [&fixed[..], &added[..]].concat();
            let to_next_m2 = self.with_added(to_fixed_m2, added);
            self.descend(next_m2, (&next, &to_next_m2), depth + 1);
        }
    }

    fn with_added(&self, to_fixed_m2: &[f64], added: &[usize]) -> Vec<f64> {
        let cost_m2 = |candidate: usize| {
            added.iter().map(|a| self.agreement.cost_m2(*a, candidate)).sum::<f64>()
        };
        to_fixed_m2.iter().enumerate().map(|(c, before)| before + cost_m2(c)).collect()
    }
}

impl Choice {
    /// What the choice adds to the cost of the fixed periods.
    fn added_m2(&self, to_fixed_m2: &[f64]) -> f64 {
        self.within_m2 + self.candidates.iter().map(|c| to_fixed_m2[*c]).sum::<f64>()
    }
}

/// All associations of a period; `None` where they are too many.
fn choices_of(agreement: &Agreement<'_>, group: &Group) -> Option<Vec<Choice>> {
    let mut partial: Vec<Association> = vec![Association::new()];
    for _ in 0..group.common_count {
        partial = partial.iter().flat_map(|taken| longer(agreement, group, taken)).collect();
        if partial.len() > MAX_OPTION_COUNT {
            return None;
        }
    }
    let choice = |candidates: Association| {
        let within_m2 = agreement.total_m2(&candidates);
        Choice { candidates, within_m2 }
    };
    Some(partial.into_iter().map(choice).collect())
}

/// The associations with one more candidate, in ascending order so that each set appears once.
fn longer(agreement: &Agreement<'_>, group: &Group, taken: &Association) -> Vec<Association> {
    let from = taken.last().map_or(group.candidates.start, |last| last + 1);
    let is_free = |index: &usize| {
        let candidate = &agreement.candidates[*index];
        taken.iter().all(|t| !agreement.candidates[*t].excludes(candidate))
    };
    let with = |index: usize| taken.iter().copied().chain([index]).collect();
    (from..group.candidates.end).filter(is_free).map(with).collect()
}
