//! Which pair is solved next, and which result is believed.

use nalgebra::Matrix3;
use proto::geom::Se2;

use super::*;
use crate::registration::{Certificate, PoseEstimate, Uncertified};

fn id(name: &str) -> NodeId {
    name.parse().unwrap()
}

fn pairs(worker_count: usize) -> Pairs {
    let config = WorkConfig { worker_count, ..WorkConfig::default() };
    Pairs::new(id("n1"), config)
}

fn pair() -> Pair {
    Pair::new(&id("n1"), &id("n2"), &id("n1"))
}

fn solved(x_m: f64, sigma_m: f64, log_odds: f64) -> Solved {
    let boot = BootId(1);
    let last_arrival = CentreTime(0);
    let sets = SetsUsed { boot, first_sequence: 0, last_sequence: 0, count: 2, last_arrival };
    let estimate = PoseEstimate {
        pose_ref_from_node: Se2::new(x_m, 0.0, 0.0),
        covariance: Matrix3::identity() * sigma_m.powi(2),
    };
    let solution = Solution {
        estimate: Some(estimate),
        outcome: registration::Outcome::Determined,
        evidence: registration::Evidence { log_odds, ..registration::Evidence::default() },
        known: Known::default(),
    };
    let job = Job {
        pair: pair(),
        problem: Problem::default(),
        sets: [sets; 2],
        known: None,
        generation: 0,
    };
    Solved { job, solution, solver: "default", solve_time: Duration::from_millis(1) }
}

fn x_m(pairs: &Pairs) -> f64 {
    pairs.edges()[0].solution.estimate.unwrap().pose_ref_from_node.translation_m().x
}

#[test]
fn a_poorer_pose_never_replaces_a_better_one() {
    let mut pairs = pairs(1);
    for (proposed, in_force_m, why) in [
        (solved(0.0, 0.01, 200.0), 0.0, "the first determined pose is taken"),
        (solved(0.8, 0.45, 10.0), 0.0, "it fits, but is far vaguer"),
        (solved(0.02, 0.012, 190.0), 0.02, "it refines"),
        (solved(3.0, 0.01, 100.0), 0.02, "it contradicts and rests on less"),
        (solved(0.8, 0.45, 500.0), 0.02, "far vaguer, on whatever it rests"),
        (solved(3.0, 0.05, 500.0), 0.02, "it contradicts and is far vaguer"),
        (solved(3.0, 0.01, 196.0), 0.02, "it contradicts and rests on hardly more"),
        (solved(3.0, 0.01, 300.0), 3.0, "it contradicts and rests on more"),
    ] {
        pairs.take(&proposed);
        assert!((x_m(&pairs) - in_force_m).abs() < 1e-12, "{why}");
    }
}

#[test]
fn two_modes_that_are_nearly_as_likely_do_not_take_turns() {
    let mut pairs = pairs(1);
    pairs.take(&solved(0.0, 0.01, 100.0));
    for round in 0..20 {
        let lead = 0.3 * f64::from(round);
        assert!(!pairs.take(&solved(2.0, 0.01, 100.0 + lead)), "{lead}");
    }
    assert!(pairs.take(&solved(2.0, 0.01, 107.0)), "a thousand times as likely");
}

#[test]
fn after_a_doubt_only_new_data_count() {
    let mut pairs = pairs(1);
    pairs.take(&solved(0.0, 0.01, 200.0));
    pairs.doubt(&id("n2"));
    assert!(pairs.edges().is_empty());
    assert!(!pairs.take(&solved(1.0, 0.01, 500.0)), "a job made before is not believed");
    let mut fresh = solved(2.0, 0.01, 20.0);
    fresh.job.generation = 1;
    assert!(pairs.take(&fresh));
    assert!((x_m(&pairs) - 2.0).abs() < 1e-12);
}

#[test]
fn the_reference_comes_first_in_a_pair() {
    assert_eq!((pair().first, pair().second), (id("n1"), id("n2")));
    let other = Pair::new(&id("n9"), &id("n2"), &id("n1"));
    assert_eq!((other.first, other.second), (id("n1"), id("n2")));
    let last = Pair::new(&id("n9"), &id("n2"), &id("n9"));
    assert_eq!((last.first, last.second), (id("n9"), id("n2")));
}

#[test]
fn those_with_the_reference_go_first_and_nobody_waits_for_ever() {
    let mut pairs = pairs(1);
    let others = Pair::new(&id("n1"), &id("n2"), &id("n3"));
    for pair in [pair(), others.clone()] {
        let standing = pairs.standings.entry(pair).or_default();
        standing.believed = Some({
            let Solved { solution, .. } = solved(0.0, 0.01, 1.0);
            let covariance = Matrix3::identity();
            (solution, Belief { pose: Se2::identity(), covariance, log_odds: 1.0 })
        });
        standing.is_due = true;
    }
    let mut order = Vec::new();
    for _ in 0..=2 * LONGEST_WAIT {
        let next = pairs.next().unwrap();
        pairs.start_count += 1;
        pairs.standings.get_mut(&next).unwrap().last_start = pairs.start_count;
        order.push(next);
    }
    assert_eq!(order[0], pair());
    let others_count = order.iter().filter(|next| **next == others).count();
    assert!((1..=3).contains(&others_count), "{others_count}");
    // Without a result it goes as often as those with the reference.
    pairs.standings.get_mut(&others).unwrap().believed = None;
    let next = pairs.next().unwrap();
    assert!(next == pair() || next == others);
}

#[test]
fn what_was_spent_must_be_earned_first() {
    let mut pairs = pairs(2);
    let savings_s = pairs.budget_s;
    assert!((savings_s - 2.0).abs() < 1e-12, "two workers, one half, two seconds");
    let gather = Gather::new(crate::config::GatherConfig::default(), id("n1"), BootId(1));
    pairs.start(CentreTime(0), &gather);
    let mut dear = solved(0.0, 0.01, 1.0);
    dear.solve_time = Duration::from_secs(3);
    pairs.take(&dear);
    assert!((pairs.budget_s + 1.0).abs() < 1e-12);
    pairs.start(CentreTime(500_000_000), &gather);
    assert!((pairs.budget_s + 0.5).abs() < 1e-12);
    pairs.start(CentreTime(60_000_000_000), &gather);
    assert!((pairs.budget_s - savings_s).abs() < 1e-12, "savings are bounded");
}

#[test]
fn the_certificate_goes_out_and_a_bound_that_says_nothing_does_not() {
    let proven = |rival_share: f64| Certificate::Proven { rival_share };
    for (certificate, told) in [
        (proven(0.4), Some(0.4)),
        (proven(1.2), None),
        (proven(-0.1), Some(0.0)),
        (Certificate::Lacking { reason: Uncertified::Resumed }, None),
    ] {
        let evidence = registration::Evidence {
            distinct_point_count: 7,
            covariance_inflation: 1.5,
            certificate,
            ..registration::Evidence::default()
        };
        let sent = outcomes::evidence(&evidence, Duration::ZERO);
        let Evidence { distinct_point_count, covariance_inflation, .. } = sent;
        assert_eq!((distinct_point_count, sent.certified_rival_share), (7, told));
        assert!((covariance_inflation - 1.5).abs() < 1e-12);
    }
}
