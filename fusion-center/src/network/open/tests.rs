//! Tests of ambiguous edges beside determined ones.

use super::super::drawn_edges::{Draw, ambiguous, name, names};
use super::super::relative::Pose;
use super::super::{Placed, Standing};
use super::*;

/// The other pose of an ambiguous edge, as seen from the true one.
fn elsewhere() -> Pose {
    Pose::new(1.0, 3.0, 2.5)
}

fn placed(combined: &Combined, node: usize) -> Option<&Placed> {
    combined.groups[0].nodes.get(&name(node))
}

/// Gauge and members of every group.
fn members(combined: &Combined) -> Vec<Vec<NodeId>> {
    combined.groups.iter().map(|group| group.nodes.keys().cloned().collect()).collect()
}

#[test]
fn two_ambiguous_edges_to_two_placed_nodes_place_a_third() {
    let mut squares = Vec::new();
    for seed in 0..60 {
        let mut draw = Draw::new(seed, 3);
        let other = Pose::new(-2.0, 1.0, -1.2);
        let edges = [
            draw.edge(0, 1),
            ambiguous(draw.edge(0, 2), (elsewhere(), seed % 2 == 0)),
            ambiguous(draw.edge(1, 2), (other, seed % 3 == 0)),
        ];
        let combined = combine_judged(&name(0), &names(3), &edges);
        let found = placed(&combined, 2).unwrap();
        assert_eq!(found.standing, Standing::Confirmed { way_count: 2 }, "{seed}");
        for (edge, is_best_wrong) in [(1, seed % 2 == 0), (2, seed % 3 == 0)] {
            let Verdict::Kept { rival_index, .. } = combined.verdicts[edge] else { panic!() };
            assert_eq!(rival_index, is_best_wrong.then_some(0), "{seed} {edge}");
        }
        squares.push(draw.nees(&combined.groups[0], 2));
    }
    // The covariance of a rival is taken wider than it is; it never claims more than is known.
    let mean = squares.iter().sum::<f64>() / 60.0;
    assert!((0.8..3.6).contains(&mean), "{mean}");
}

#[test]
fn an_ambiguous_edge_with_no_right_pose_takes_nothing_away() {
    let mut draw = Draw::new(3, 4);
    let mut wrong = draw.edge(1, 2);
    draw.corrupt(&mut wrong);
    let edges =
        [draw.edge(0, 1), draw.edge(0, 2), draw.edge(0, 3), ambiguous(wrong, (elsewhere(), false))];
    // As votes among others, one against each node's only good edge, it would divide.
    assert!(combine_as_given(&name(0), &names(4), &edges).groups.len() > 1);
    let combined = combine_judged(&name(0), &names(4), &edges);
    assert_eq!(members(&combined), [names(4)]);
    assert_eq!(combined.verdicts[3], Verdict::Undecided);
    assert!(combined.verdicts[..3].iter().all(|verdict| matches!(verdict, Verdict::Kept { .. })));
}

#[test]
fn what_one_ambiguous_edge_decides_stands_where_another_divides() {
    // Node 3 hangs on two ambiguous edges that agree; the wrong one stands between 1 and 2.
    let mut draw = Draw::new(5, 4);
    let mut wrong = draw.edge(1, 2);
    draw.corrupt(&mut wrong);
    let edges = [
        draw.edge(0, 1),
        draw.edge(0, 2),
        ambiguous(wrong, (elsewhere(), false)),
        ambiguous(draw.edge(0, 3), (elsewhere(), true)),
        ambiguous(draw.edge(1, 3), (Pose::new(-2.0, 0.5, 1.0), false)),
    ];
    let combined = combine_judged(&name(0), &names(4), &edges);
    assert_eq!(members(&combined), [names(4)]);
    assert!(draw.nees(&combined.groups[0], 3) < POSE_GATE);
    assert_eq!(combined.verdicts[2], Verdict::Undecided);
}

#[test]
fn a_symmetric_scene_stays_undecided_and_is_shown() {
    // People that mirror each other for all nodes: each pair allows the pose and its mirror image,
    // so that nodes 1 and 2 may be turned about the middle together or one by one.
    let mut draw = Draw::new(8, 3);
    let half_turn = Pose::new(4.0, 2.0, PI);
    let mut mirrored = |first: usize, second: usize| {
        let edge = draw.edge(first, second);
        let (one, two) = (draw.poses[first], draw.poses[second]);
        let wrong = (one.inverse() * two).inverse() * (one.inverse() * half_turn * two);
        ambiguous(edge, (wrong, false))
    };
    let edges = [mirrored(0, 1), mirrored(0, 2), mirrored(1, 2)];
    let combined = combine_judged(&name(0), &names(3), &edges);
    assert_eq!(combined.groups.len(), 3);
    assert!(combined.verdicts.iter().all(|verdict| *verdict == Verdict::Undecided));
    for node in [1, 2] {
        let shown = &combined.groups[0].doubtful[&name(node)];
        assert!(matches!(&shown.standing, Standing::Undecided { rivals } if !rivals.is_empty()));
    }
}

#[test]
fn vague_edges_that_agree_decide_nothing() {
    let mut draw = Draw::new(9, 3);
    let vague = |mut edge: Edge| {
        if let Some(estimate) = &mut edge.solution.estimate {
            estimate.covariance *= 400.0;
        }
        edge
    };
    let mut open = |wrong: Pose| vague(ambiguous(draw.edge(0, 2), (wrong, false)));
    let (one, other) = (open(elsewhere()), open(Pose::new(-3.0, 1.0, -2.0)));
    assert!(is_telling(&ambiguous(draw.edge(0, 2), (elsewhere(), false))) && !is_telling(&one));
    let edges = [draw.edge(0, 1), one, other];
    assert!(matches!(
        combine_as_given(&name(0), &names(3), &edges).verdicts[1],
        Verdict::Kept { .. }
    ));
    let combined = combine_judged(&name(0), &names(3), &edges);
    assert_eq!(placed(&combined, 2), None);
    assert_eq!(combined.verdicts[1..], [Verdict::Undecided; 2]);
}

#[test]
fn agreement_by_chance_is_as_rare_as_stated() {
    // The oracle: poses drawn over the volume, with the gate as the combination applies it.
    use rand::{RngExt, SeedableRng};
    let mut rng = rand::rngs::ChaCha8Rng::seed_from_u64(12);
    let mut draw = Draw::new(10, 2);
    let edge = draw.edge(0, 1);
    let step = edge.solution.estimate.as_ref().and_then(Relative::usable).unwrap();
    // Wider than any real one, so that some agree.
    let wide = Relative { covariance: step.covariance * 2_000.0, ..step };
    let spread = wide.covariance.determinant().sqrt();
    let gate = 4.0 / 3.0 * PI * POSE_GATE.powf(1.5) * spread;
    let (mut hits, trials) = (0.0, 400_000);
    for _ in 0..trials {
        let mut within = |half: f64| rng.random_range(-half..half);
        let pose = Pose::new(within(HALF_WIDTH_M), within(HALF_WIDTH_M), within(PI));
        let exact = Relative { pose, covariance: nalgebra::Matrix3::zeros() };
        hits += f64::from(u8::from(wide.chi_square_to(&exact) < POSE_GATE));
    }
    let expected = gate / ((2.0 * HALF_WIDTH_M).powi(2) * TAU) * f64::from(trials);
    // Headings beyond half a turn wrap, which this width hardly reaches; four standard deviations.
    assert!(expected > 100.0, "{expected}");
    assert!((hits - expected).abs() < 4.0 * expected.sqrt() + 0.05 * expected, "{hits} {expected}");
}
