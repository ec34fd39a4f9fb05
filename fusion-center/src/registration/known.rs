//! What the last solution of a node found, so that the next one need not search again.

use super::Outcome;
use super::modes::Mode;
use super::prepared::{Motion, Prepared};

/// Modes that are carried on.
const MAX_MODE_COUNT: usize = 6;

/// Growth of the data, and share of the periods renewed, after which an undecided problem is
/// searched again.
const GROWTH: f64 = 1.1;
const RENEWED_SHARE: f64 = 0.1;

/// Part of the periods that must be left for the modes to mean anything.
const SHRINKAGE: f64 = 0.5;

/// Part of its share of matched points that the best pose must keep.
const KEPT_SHARE: f64 = 0.7;

/// What the last solution of the same node found. Hand it to the next [`super::Solver::solve`];
/// the default value stands for nothing known.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Known {
    modes: Vec<KnownMode>,
    is_determined: bool,
    /// Share of the fewer side's points that matched at the last full search.
    matched_share: f64,
    searched_period_count: usize,
    /// Solutions since the last full search, which also says which hypotheses are drawn next.
    resumed_count: u32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct KnownMode {
    motion: Motion,
    share: f64,
}

impl Known {
    /// How often this was carried on without a full search.
    #[must_use]
    pub fn resumed_count(&self) -> u32 {
        self.resumed_count
    }

    /// After a full search.
    pub(super) fn searched(data: &Prepared, modes: &[Mode]) -> Self {
        Self {
            modes: carried(modes),
            is_determined: false,
            matched_share: modes.first().map_or(0.0, |best| matched_share(data, best)),
            searched_period_count: data.spans.len(),
            resumed_count: 0,
        }
    }

    /// After a solution that started from this.
    pub(super) fn resumed(&self, modes: &[Mode]) -> Self {
        let resumed_count = self.resumed_count.saturating_add(1);
        Self { modes: carried(modes), resumed_count, ..*self }
    }

    pub(super) fn with_outcome(self, outcome: &Outcome) -> Self {
        Self { is_determined: *outcome == Outcome::Determined, ..self }
    }

    /// Whether the modes are a fair start for these data.
    pub(super) fn may_resume(&self, data: &Prepared) -> bool {
        let (now, then) = (data.spans.len() as f64, self.searched_period_count as f64);
        let has_grown =
            now >= GROWTH * then || f64::from(self.resumed_count) >= RENEWED_SHARE * now;
        !self.modes.is_empty() && now >= SHRINKAGE * then && (self.is_determined || !has_grown)
    }

    /// Whether the best mode explains as much as the search's did.
    pub(super) fn still_explains(&self, data: &Prepared, modes: &[Mode]) -> bool {
        let share = modes.first().map_or(0.0, |best| matched_share(data, best));
        share >= KEPT_SHARE * self.matched_share
    }

    /// Motions and shares of the modes, likeliest first.
    pub(super) fn starts(&self) -> impl Iterator<Item = (Motion, f64)> {
        self.modes.iter().map(|mode| (mode.motion, mode.share))
    }
}

fn carried(modes: &[Mode]) -> Vec<KnownMode> {
    let known = |mode: &Mode| KnownMode { motion: mode.motion, share: mode.share };
    modes.iter().take(MAX_MODE_COUNT).map(known).collect()
}

fn matched_share(data: &Prepared, mode: &Mode) -> f64 {
    mode.fit.matched / data.refs.len().min(data.nodes.len()).max(1) as f64
}

#[cfg(test)]
mod tests {
    use proto::geom::{Node, Ref, Se2};

    use super::super::degenerate_tests::walkers;
    use super::super::{Outcome, Pairwise, Problem, Solution, Solver};
    use super::*;
    use crate::simulate::{Conditions, Sampler, Trial};

    const ROOM: Conditions = Conditions {
        detection_probability: 0.9,
        false_probability: 0.1,
        noise_scale: 2.5,
        period_s: 0.5,
    };

    fn room(seed: u64, period_s: f64, period_count: usize) -> Trial {
        let mut sampler = Sampler::new(seed);
        let paths = walkers(period_s, period_count)(&mut sampler);
        sampler.observe(&paths, &Conditions { period_s, ..ROOM })
    }

    fn window(case: &Trial, end: usize, count: usize) -> Problem {
        let periods = case.problem.periods[end.saturating_sub(count)..end].to_vec();
        Problem { periods, ..Problem::default() }
    }

    fn pose(solution: &Solution) -> Se2<Ref, Node> {
        solution.estimate.unwrap().pose_ref_from_node
    }

    fn assert_same(warm: &Solution, cold: &Solution, context: &str) {
        /// Both climb to the same maximum and stop within a tenth of a standard deviation of it.
        const SAME_M: f64 = 1e-2;
        let kind = |solution: &Solution| std::mem::discriminant(&solution.outcome);
        assert_eq!(kind(warm), kind(cold), "{context}: {:?} {:?}", warm.outcome, cold.outcome);
        if warm.outcome == Outcome::Determined {
            let apart_m = pose(warm).translation_m() - pose(cold).translation_m();
            assert!(apart_m.norm() < SAME_M, "{context}: {apart_m:?}");
        }
    }

    #[test]
    fn solutions_with_and_without_knowledge_agree_in_a_sliding_window() {
        let solver = Pairwise::default();
        for (seed, period_s, window_count) in [(1, 0.5, 30), (2, 0.5, 30), (3, 0.1, 60)] {
            let case = room(seed, period_s, 80);
            let mut known = None;
            let mut search_count = 0;
            for end in 10..=80 {
                let problem = window(&case, end, window_count);
                let warm = solver.solve(&problem, known.as_ref());
                assert_same(&warm, &solver.solve(&problem, None), &format!("{seed} {end}"));
                search_count += usize::from(warm.known.resumed_count() == 0);
                known = Some(warm.known);
            }
            assert!(search_count < 36, "{seed}: {search_count}");
        }
    }

    #[test]
    fn a_node_that_moved_is_found_again() {
        let solver = Pairwise::default();
        let (before, after) = (room(4, 0.5, 40), room(5, 0.5, 40));
        let known = solver.solve(&before.problem, None).known;
        let warm = solver.solve(&after.problem, Some(&known));
        assert_same(&warm, &solver.solve(&after.problem, None), "moved");
        assert!(after.error(&warm.estimate.unwrap()).xy().norm() < 0.3);
    }

    #[test]
    fn an_undecided_problem_is_searched_again_when_it_has_grown() {
        let solver = Pairwise::default();
        let (mut case, stranger) = (room(6, 0.5, 20), room(7, 0.5, 20));
        for (period, strange) in case.problem.periods.iter_mut().zip(&stranger.problem.periods) {
            period.in_node.clone_from(&strange.in_node);
        }
        let first = solver.solve(&window(&case, 12, 12), None);
        assert_ne!(first.outcome, Outcome::Determined);
        let little = solver.solve(&window(&case, 13, 13), Some(&first.known));
        assert_eq!(little.known.resumed_count(), 1);
        let much = solver.solve(&window(&case, 14, 14), Some(&little.known));
        assert_eq!(much.known.resumed_count(), 0);
        // Nor without growth for ever: a window that slides is renewed.
        let mut known = first.known;
        for end in 13..15 {
            known = solver.solve(&window(&case, end, 12), Some(&known)).known;
        }
        assert_eq!(solver.solve(&window(&case, 15, 12), Some(&known)).known.resumed_count(), 0);
    }

    #[test]
    fn fresh_hypotheses_find_what_the_known_modes_lack() {
        let solver = Pairwise::default();
        let (case, cold) = (8..100)
            .map(|seed| room(seed, 0.5, 30))
            .map(|case| (solver.solve(&case.problem, None), case))
            .find(|(cold, _)| cold.outcome == Outcome::Determined && cold.known.modes.len() > 1)
            .map(|(cold, case)| (case, cold))
            .unwrap();
        // A search that missed the best mode.
        let wrong = cold.known.modes[1..].to_vec();
        let mut known = Known { modes: wrong, matched_share: 0.0, ..cold.known.clone() };
        let mut resumed_count = 0;
        let warm = loop {
            let solution = solver.solve(&case.problem, Some(&known));
            resumed_count += 1;
            assert_eq!(solution.known.resumed_count(), resumed_count);
            if solution.outcome == cold.outcome || resumed_count == 20 {
                break solution;
            }
            known = Known { is_determined: true, ..solution.known };
        };
        assert_same(&warm, &cold, "fresh");
    }
}
