//! Moved nodes through the real chain without processes: every agent's simulated echoes become
//! points, and the centre's state machine takes them in, period by period.

use std::collections::BTreeMap;

use proto::geom::{Node, Ref, Se2, wrap_angle};
use proto::ids::NodeId;
use proto::wire::Registration;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;

use crate::rehearsal::Rehearsal;
use crate::scenario::{Scenario, find};

/// Periods from the move within which it should be noticed, and everybody be right again.
const SUSPECT_WITHIN: u64 = 20;
const RIGHT_WITHIN: u64 = 60;

/// The shipped scenario with two or three people's ways, the period and all noise by `seed`, and this
/// move of this node, or none.
fn scenario(seed: u64, moved: Option<&str>) -> Scenario {
    let mut scenario = find("moved-node").unwrap();
    scenario.seed = seed;
    scenario.moves = moved.map(|text| text.parse().unwrap()).into_iter().collect();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    scenario.speed = 1.0;
    // Moves are given for the shipped period; they come as many periods after the start.
    let stretch = [1.0, 0.4, 2.0][usize::try_from(seed % 3).unwrap()];
    scenario.period_s *= stretch;
    scenario.moves.iter_mut().for_each(|shove| shove.at_s *= stretch);
    let end_s = scenario.period_s * scenario.period_count.unwrap() as f64;
    let targets = &mut scenario.agent["simulated"]["scene"]["targets"];
    let people = targets.as_array_mut().unwrap();
    people.truncate(2 + usize::try_from(seed / 3 % 2).unwrap());
    for person in people {
        person["way_points"] = way(&mut random, end_s);
    }
    scenario.resolve().unwrap()
}

/// From place to place in the room, at 0.5 to 1 m/s.
fn way(random: &mut ChaCha8Rng, end_s: f64) -> toml::Value {
    let (mut time_s, mut at, mut points) = (0.0, None::<(f64, f64)>, Vec::new());
    while time_s < end_s {
        let to: (f64, f64) = (random.random_range(1.5..6.5), random.random_range(1.5..6.5));
        let way_m = at.map_or(0.0, |(x_m, y_m)| (to.0 - x_m).hypot(to.1 - y_m));
        if at.is_some() && way_m < 1.0 {
            continue;
        }
        time_s += way_m / random.random_range(0.5..1.0);
        let keys = [("time_s", time_s), ("x_m", to.0), ("y_m", to.1)];
        let point = keys.map(|(key, value)| (key.to_owned(), toml::Value::Float(value)));
        points.push(toml::Value::Table(toml::Table::from_iter(point)));
        at = Some(to);
    }
    toml::Value::Array(points)
}

/// What became of a run.
#[derive(Debug, Default)]
struct Course {
    /// Periods from the move until the node was suspect.
    suspect_after: Option<u64>,
    /// Periods from the move until all were right and unsuspected, after the move was noticed.
    right_after: Option<u64>,
    /// Suspicions of nodes that did not move, and of any before the move.
    false_count: usize,
    /// Nodes that were not within bounds when the move came.
    wrong_before: usize,
}

fn is_right(scenario: &Scenario, told: &BTreeMap<NodeId, Registration>) -> bool {
    let mut others = scenario.nodes.iter().filter(|node| node.id != scenario.reference);
    others.all(|node| {
        let transform = told.get(&node.id).filter(|one| one.suspicion.is_none());
        transform.and_then(|one| one.transform).is_some_and(|transform| {
            let truth: Se2<Ref, Node> = scenario.truth(node);
            let pose: Se2<Ref, Node> = transform.pose_ref_from_node.into();
            let away_m = (pose.translation_m() - truth.translation_m()).norm();
            let turned = wrap_angle(pose.heading_rad() - truth.heading_rad()).to_degrees().abs();
            let bounds = scenario.bounds.of(&node.id);
            away_m <= bounds.position_m && turned <= bounds.angle_deg
        })
    })
}

/// Plays a scenario.
fn course(scenario: &Scenario) -> Course {
    let period_count = scenario.period_count.unwrap();
    let mut rehearsal = Rehearsal::new(scenario).unwrap();
    let shove = scenario.moves.first();
    let is_past =
        |period: &u64| shove.is_some_and(|one| one.at_s <= *period as f64 * scenario.period_s);
    let first_moved = (0..period_count).find(is_past).unwrap_or(period_count);
    let still = Scenario { moves: Vec::new(), ..scenario.clone() };
    let mut course = Course::default();
    let is_meant = |node: &NodeId| {
        shove.is_some_and(|one| one.node == *node || one.node == scenario.reference)
    };
    for period in 0..period_count {
        if period == first_moved {
            course.wrong_before = usize::from(!is_right(&still, &rehearsal.site.told));
        }
        rehearsal.play(period).unwrap();
        let site = &mut rehearsal.site;
        let after = (period + 1).saturating_sub(first_moved);
        for (node, suspicion) in std::mem::take(&mut site.raised) {
            if 0 < after && is_meant(&node) {
                course.suspect_after.get_or_insert(after);
            } else {
                println!("  false: {node} in period {period}: {suspicion:?}");
                course.false_count += 1;
            }
        }
        if course.suspect_after.is_some() && is_right(scenario, &site.told) {
            course.right_after.get_or_insert(after);
        }
    }
    course
}

/// By how much nodes are moved: metres in the world, and degrees.
const SHOVES: [&str; 5] = ["0,0,3", "0.12,-0.09,0", "0.12,0.09,3", "0.3,0.2,6", "2,1,60"];

#[test]
fn a_node_shoved_by_a_step_is_noticed_and_right_again_through_the_chain() {
    let mut scenario = scenario(23, Some("n3@24:0.3,0.2,6"));
    scenario.period_count = Some(170);
    let course = course(&scenario);
    assert_eq!(course.false_count, 0, "{course:?}");
    assert!(course.suspect_after.is_some_and(|after| after <= SUSPECT_WITHIN), "{course:?}");
    assert!(course.right_after.is_some_and(|after| after <= RIGHT_WITHIN), "{course:?}");
}

/// Plays this move with each of these seeds and prints what became of it; returns false alarms.
fn study(seeds: std::ops::Range<u64>, text: &str) -> usize {
    let seeds: Vec<u64> = seeds.collect();
    let play = |seed: &u64| course(&scenario(*seed, Some(text)));
    let courses: Vec<Course> = seeds.par_iter().map(play).collect();
    let within = |limit: u64, of: fn(&Course) -> Option<u64>| {
        courses.iter().filter(|one| of(one).is_some_and(|after| after <= limit)).count()
    };
    let suspected = within(SUSPECT_WITHIN, |one| one.suspect_after);
    let noticed = within(u64::MAX, |one| one.suspect_after);
    let righted = within(RIGHT_WITHIN, |one| one.right_after);
    let after: Vec<_> = courses.iter().map(|one| (one.suspect_after, one.right_after)).collect();
    let wrong_count: usize = courses.iter().map(|one| one.wrong_before).sum();
    println!(
        "{text}: suspect in time {suspected}, at all {noticed}, right in time {righted} of {}, \
         wrong before {wrong_count}: {after:?}",
        courses.len()
    );
    courses.iter().map(|one| one.false_count).sum()
}

#[test]
#[ignore = "minutes: five moves of two nodes, four seeds each"]
fn study_moves_through_the_chain() {
    let mut false_count = 0;
    for node in ["n3", "n1"] {
        for shove in SHOVES {
            false_count += study(41..45, &format!("{node}@36:{shove}"));
        }
    }
    assert_eq!(false_count, 0);
}

#[test]
#[ignore = "minutes: quiet runs of 288 periods"]
fn study_quiet_runs_through_the_chain() {
    let seeds: Vec<u64> = (2001..2036).collect();
    let courses: Vec<Course> =
        seeds.par_iter().map(|seed| course(&scenario(*seed, None))).collect();
    let false_count: usize = courses.iter().map(|one| one.false_count).sum();
    println!("{} quiet runs: {false_count} false alarms", courses.len());
    assert_eq!(false_count, 0);
}
