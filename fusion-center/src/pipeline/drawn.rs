//! Solved pairs with given poses, for tests.

use nalgebra::Matrix3;
use proto::geom::{Node, Ref, Se2};
use proto::wire::SetsUsed;

use super::*;
use crate::network::{Edge, Group, combine};
use crate::registration::{self, Known, PoseEstimate, Problem, Solution};

/// Standard deviation of every pose, metres and radians.
pub(super) const SIGMA: f64 = 0.01;

/// `(x_m, y_m, heading_rad)` of the second node in the frame of the first.
pub(super) type Step = (f64, f64, f64);

pub(super) fn id(name: &str) -> NodeId {
    name.parse().unwrap()
}

pub(super) fn solved((first, second): (&str, &str), step: Step) -> Solved {
    let sets = SetsUsed {
        boot: BootId(1),
        first_sequence: 0,
        last_sequence: 0,
        count: 2,
        last_arrival: CentreTime(0),
    };
    let estimate = PoseEstimate {
        pose_ref_from_node: Se2::new(step.0, step.1, step.2),
        covariance: Matrix3::identity() * SIGMA.powi(2),
    };
    let solution = Solution {
        estimate: Some(estimate),
        outcome: registration::Outcome::Determined,
        evidence: registration::Evidence { log_odds: 50.0, ..registration::Evidence::default() },
        known: Known::default(),
    };
    let job = Job {
        pair: Pair { first: id(first), second: id(second) },
        problem: Problem::default(),
        sets: [sets; 2],
        known: None,
        generation: 0,
    };
    Solved { job, solution, solver: "default", solve_time: Duration::from_millis(1) }
}

/// A pair whose node may be at `best` or at `rival`.
pub(super) fn ambiguous(names: (&str, &str), best: Step, rival: Step) -> Solved {
    let mut open = solved(names, best);
    let pose_ref_from_node = Se2::new(rival.0, rival.1, rival.2);
    let rivals = vec![registration::Rival { pose_ref_from_node, log_odds: 2.0 }];
    open.solution.outcome = registration::Outcome::Ambiguous { rivals };
    open
}

/// All pairs with these solutions in force, `n1` the reference.
pub(super) fn pairs(all: &[((&str, &str), Step)]) -> Pairs {
    let mut pairs = Pairs::new(id("n1"), crate::config::WorkConfig::default());
    for (names, step) in all {
        pairs.take(&solved(*names, *step));
    }
    pairs
}

/// The groups of `n1` to `n4`.
pub(super) fn groups(edges: &[Edge]) -> Vec<Group> {
    combine(&id("n1"), &["n1", "n2", "n3", "n4"].map(id), edges)
}

/// One step after another, by hand.
pub(super) fn chained(one: Step, next: Step) -> Step {
    let (sin, cos) = one.2.sin_cos();
    (one.0 + cos * next.0 - sin * next.1, one.1 + sin * next.0 + cos * next.1, one.2 + next.2)
}

pub(super) fn off_m(pose: &Se2<Ref, Node>, step: Step) -> f64 {
    let at_m = pose.translation_m();
    (at_m.x - step.0).hypot(at_m.y - step.1)
}
