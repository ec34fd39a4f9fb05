//! Pins beside what was solved.

use proto::geom::Se2;

use super::*;
use crate::network::{Placed, Standing};
use crate::pipeline::drawn::{SIGMA, Step, ambiguous, chained, groups, id, off_m, pairs, solved};

const N2: Step = (3.0, 1.0, 0.4);
const N2_TO_N3: Step = (1.0, 2.0, -0.3);
const N2_TO_N4: Step = (0.5, 4.0, 1.0);

fn pin(step: Step) -> Vec<Edge> {
    let solved = solved(("n1", "n2"), step);
    vec![Edge { first: id("n1"), second: id("n2"), solution: solved.solution }]
}

fn placed<'a>(groups: &'a [Group], node: &str) -> &'a Placed {
    &groups[0].nodes[&id(node)]
}

#[test]
fn a_wrong_pin_unregisters_nobody() {
    let n3 = chained(N2, N2_TO_N3);
    let all = pairs(&[
        (("n1", "n2"), N2),
        (("n1", "n3"), n3),
        (("n2", "n3"), N2_TO_N3),
        (("n2", "n4"), N2_TO_N4),
    ]);
    let wrong = (N2.0 + 0.3, N2.1, N2.2);
    let found = groups(&with_pins(&id("n1"), all.edges(), pin(wrong)));
    assert!(off_m(&placed(&found, "n2").estimate.pose_ref_from_node, wrong) < 1e-9);
    assert!(off_m(&placed(&found, "n3").estimate.pose_ref_from_node, n3) < SIGMA);
    assert_eq!(placed(&found, "n3").via, ["n1", "n3"].map(id));
    // Nothing else joins n4 to the reference.
    let behind: Se2<_, _> = placed(&found, "n4").estimate.pose_ref_from_node;
    assert!(off_m(&behind, chained(wrong, N2_TO_N4)) < 1e-9);
    assert!(found[0].doubtful.is_empty() && found.len() == 1);
    // As a vote among others it would.
    let mut votes = all.edges();
    votes.retain(|edge| (&edge.first, &edge.second) != (&id("n1"), &id("n2")));
    votes.extend(pin(wrong));
    let torn = groups(&votes);
    assert!(matches!(torn[0].doubtful[&id("n3")].standing, Standing::Undecided { .. }));
}

#[test]
fn a_node_that_others_join_to_the_reference_does_not_come_in_through_a_pin() {
    let n3 = chained(N2, N2_TO_N3);
    let n3_to_n4 = (1.0, 1.0, 0.2);
    let all = pairs(&[(("n1", "n3"), n3), (("n3", "n4"), n3_to_n4), (("n2", "n4"), N2_TO_N4)]);
    let found = groups(&with_pins(&id("n1"), all.edges(), pin((9.0, 0.0, 0.0))));
    assert_eq!(placed(&found, "n4").via, ["n1", "n3", "n4"].map(id));
    assert!(
        off_m(&placed(&found, "n4").estimate.pose_ref_from_node, chained(n3, n3_to_n4)) < SIGMA
    );
}

#[test]
fn without_pins_every_edge_counts() {
    let all = pairs(&[(("n1", "n2"), N2), (("n2", "n3"), N2_TO_N3)]);
    assert_eq!(with_pins(&id("n1"), all.edges(), Vec::new()), all.edges());
}

#[test]
fn an_ambiguous_pair_keeps_no_node_from_coming_in_through_a_pin() {
    let n3 = chained(N2, N2_TO_N3);
    let mut all = pairs(&[(("n2", "n3"), N2_TO_N3)]);
    all.take(&ambiguous(("n1", "n3"), (9.0, 9.0, 2.0), (-8.0, 1.0, -1.0)));
    let found = groups(&with_pins(&id("n1"), all.edges(), pin(N2)));
    assert!(off_m(&placed(&found, "n3").estimate.pose_ref_from_node, n3) < 1e-9);
}
