//! One trial: the data that every solver gets, with the truth and the bound.

use fusion_center::registration::Problem;
use fusion_center::simulate::{self, Conditions};
use nalgebra::Matrix3;
use proto::geom::{Node, Ref, Se2};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use super::Condition;

/// What the solvers get, and what they should find.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Case {
    pub(super) problem: Problem,
    pub(super) truth: Se2<Ref, Node>,
    /// Covariance of the Cramér-Rao bound of the true pairs, `(x_m, y_m, heading_rad)`; `None` where
    /// these allow no pose or their precision is not known.
    pub(super) bound: Option<Matrix3<f64>>,
}

/// The seeds of one trial. Conditions share them: what differs between conditions is not luck.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Seeds {
    /// Of the points.
    pub(super) points: u64,
    /// Of each node's echoes.
    pub(super) nodes: [u64; 2],
    /// Of the errors that the bound would allow.
    pub(super) bound: u64,
}

impl Seeds {
    /// Of trial number `trial` of an experiment.
    pub(super) fn new(seed: u64, trial: usize) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(trial as u64);
        let mut draw = || rng.random::<u64>();
        Self { points: draw(), nodes: [draw(), draw()], bound: draw() }
    }
}

/// The paper's scene at the level of points.
pub(super) fn of_points(condition: &Condition, seeds: &Seeds) -> Case {
    let conditions = Conditions {
        detection_probability: condition.detection_probability,
        false_probability: condition.false_probability,
        ..Conditions::CLEAN
    };
    let trial = simulate::trial(&conditions, seeds.points);
    let (bound, truth) = (trial.bound(), trial.pose_ref_from_node);
    Case { problem: trial.problem, truth, bound }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::montecarlo::CONDITIONS;

    #[test]
    fn seeds_differ_between_trials_and_experiments_and_repeat() {
        let all = [Seeds::new(1, 0), Seeds::new(1, 1), Seeds::new(2, 0)];
        assert_eq!(Seeds::new(1, 1), all[1]);
        let numbers: std::collections::BTreeSet<u64> =
            all.iter().flat_map(|s| [s.points, s.nodes[0], s.nodes[1], s.bound]).collect();
        assert_eq!(numbers.len(), 12);
    }

    #[test]
    fn conditions_show_in_the_points() {
        let count = |index: usize| -> f64 {
            let counts = (0..200).map(|trial| {
                let case = of_points(&CONDITIONS[index], &Seeds::new(5, trial));
                case.problem.periods.iter().map(|p| p.in_ref.len() + p.in_node.len()).sum::<usize>()
            });
            counts.sum::<usize>() as f64 / 200.0
        };
        // 32 points if none is missed; of 200 trials the mean is known to 0.16 and 0.18.
        assert!((count(0) - 32.0).abs() < 1e-9);
        assert!((count(1) - 25.6).abs() < 0.7);
        assert!((count(2) - 27.2).abs() < 0.7);
    }
}
