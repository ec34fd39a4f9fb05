//! What is told of nodes whose pairs disagree, who rests on whom, and which pose stays.

use proto::wire::Outcome;

use super::*;
use crate::network::AGREEMENT_LOG_ODDS;
use crate::pipeline::drawn::{SIGMA, Step, ambiguous, chained, groups, id, off_m, pairs, solved};

const N2: Step = (3.0, 1.0, 0.4);
const N2_TO_N3: Step = (1.0, 2.0, -0.3);
/// Rivals are poses of pairs, adjusted among each other: within this, metres.
const RIVAL_TOLERANCE_M: f64 = 0.02;

fn now() -> CentreTime {
    CentreTime(1)
}

fn wrong(step: Step) -> Step {
    (step.0 + 0.3, step.1, step.2)
}

#[test]
fn a_node_in_a_tie_is_ambiguous_whatever_its_newest_pair_says() {
    let n3 = chained(N2, N2_TO_N3);
    let good = pairs(&[(("n1", "n2"), N2), (("n1", "n3"), n3), (("n2", "n3"), N2_TO_N3)]);
    let bad = pairs(&[(("n1", "n2"), wrong(N2)), (("n1", "n3"), n3), (("n2", "n3"), N2_TO_N3)]);
    for is_known_before in [false, true] {
        let mut poses = Poses::new(id("n1"));
        if is_known_before {
            poses.take(now(), &groups(&good.edges()), &good);
            let told = poses.registration(now(), &id("n3"), &good).unwrap();
            assert_eq!(told.outcome, Outcome::Determined);
        }
        poses.take(now(), &groups(&bad.edges()), &bad);
        for (node, places) in [("n2", [wrong(N2), N2]), ("n3", [n3, chained(wrong(N2), N2_TO_N3)])]
        {
            let told = poses.registration(now(), &id(node), &bad).unwrap();
            let Outcome::Ambiguous { rivals } = &told.outcome else { panic!("{told:?}") };
            assert_eq!((told.transform.is_some(), told.via.len()), (is_known_before, 0));
            assert!(!rivals.is_empty());
            for rival in rivals {
                let pose: Se2<Ref, Node> = rival.pose_ref_from_node.into();
                let nearest_m = places.map(|place| off_m(&pose, place)).into_iter();
                let nearest_m = nearest_m.fold(f64::INFINITY, f64::min);
                assert!(nearest_m < RIVAL_TOLERANCE_M, "{node}: {nearest_m} m, {rival:?}");
            }
        }
    }
}

#[test]
fn a_lone_node_says_how_many_of_its_pairs_contradict_each_other() {
    let n4 = chained(N2, N2_TO_N3);
    let pairs = pairs(&[(("n2", "n3"), wrong(N2)), (("n2", "n4"), n4), (("n3", "n4"), N2_TO_N3)]);
    let mut poses = Poses::new(id("n1"));
    poses.take(now(), &groups(&pairs.edges()), &pairs);
    for node in ["n2", "n3", "n4"] {
        let told = poses.registration(now(), &id(node), &pairs).unwrap();
        let missing = "2 of 2 pairs contradict each other".to_owned();
        assert_eq!(told.outcome, Outcome::Underdetermined { missing }, "{node}");
    }
}

#[test]
fn what_is_solved_but_not_combined_is_not_determined() {
    let pairs = pairs(&[(("n1", "n2"), N2)]);
    let mut poses = Poses::new(id("n1"));
    poses.note(&id("n2"));
    let told = poses.registration(now(), &id("n2"), &pairs).unwrap();
    assert!(matches!(told.outcome, Outcome::Underdetermined { .. }), "{told:?}");
    poses.take(now(), &groups(&pairs.edges()), &pairs);
    let placed = poses.registration(now(), &id("n2"), &pairs).unwrap();
    assert_eq!(placed.outcome, Outcome::Determined);
    poses.doubt(&id("n2"));
    let doubted = poses.registration(now(), &id("n2"), &pairs).unwrap();
    assert!(matches!(doubted.outcome, Outcome::Underdetermined { .. }), "{doubted:?}");
    assert_eq!(doubted.transform, placed.transform);
}

#[test]
fn poses_rest_on_the_nodes_that_they_come_in_through() {
    let pairs =
        pairs(&[(("n1", "n2"), N2), (("n2", "n3"), N2_TO_N3), (("n1", "n4"), (-4.0, 1.0, 0.0))]);
    let mut poses = Poses::new(id("n1"));
    poses.announce_reference(now());
    poses.take(now(), &groups(&pairs.edges()), &pairs);
    assert_eq!(poses.resting_on(&id("n1")), ["n2", "n3", "n4"].map(id));
    assert_eq!(poses.resting_on(&id("n2")), ["n2", "n3"].map(id));
    assert_eq!(poses.resting_on(&id("n3")), ["n3"].map(id));
    poses.pin(now(), &id("n3"), None).unwrap();
    assert_eq!(poses.resting_on(&id("n2")), ["n2"].map(id));
}

#[test]
fn a_doubted_pose_gives_way_to_any_and_others_count_what_contradicts_them() {
    let before = pairs(&[(("n1", "n2"), N2)]);
    let after = pairs(&[(("n1", "n2"), wrong(N2))]);
    let mut poses = Poses::new(id("n1"));
    poses.take(now(), &groups(&before.edges()), &before);
    poses.take(now(), &groups(&after.edges()), &after);
    assert!(off_m(&poses.pose(&id("n2")).unwrap().0, N2) < SIGMA, "even odds: the old one stays");
    assert_eq!(poses.standings()[&id("n2")].contradiction_count, 1);
    poses.doubt(&id("n2"));
    assert!(poses.placements().is_empty(), "the monitor has nothing to hold it to");
    poses.take(now(), &groups(&after.edges()), &after);
    assert!(off_m(&poses.pose(&id("n2")).unwrap().0, wrong(N2)) < SIGMA);
    poses.doubt(&id("n2"));
    poses.take(now(), &groups(&after.edges()), &after);
    assert_eq!(poses.placements().len(), 1, "found again, it is not doubted any longer");
}

#[test]
fn nobody_comes_in_through_a_pin_that_is_suspect_or_outdated() {
    let mut poses = Poses::new(id("n1"));
    let pose_ref_from_node = PoseRecord { x_m: 1.0, y_m: 2.0, heading_rad: 0.5 };
    let stated = StatedPose { pose_ref_from_node, sigma_m: 0.02, sigma_rad: 0.01 };
    poses.pin(now(), &id("n2"), Some(&stated)).unwrap();
    assert_eq!(poses.pins().len(), 1);
    let suspicion = Suspicion {
        moved: id("n2"),
        began: now(),
        shift_x_m: 0.2,
        shift_y_m: 0.0,
        turn_rad: 0.0,
        chi_square: 50.0,
    };
    poses.suspect(&id("n2"), &suspicion);
    assert!(poses.pins().is_empty());
    poses.pin(now(), &id("n2"), Some(&stated)).unwrap();
    assert_eq!(poses.pins().len(), 1);
    assert_eq!(poses.outdate_pins(), ["n2"].map(id));
    assert!(poses.pins().is_empty() && poses.is_pinned(&id("n2")));
    assert!(poses.placements().is_empty(), "the monitor has nothing to hold it to");
    poses.pin(now(), &id("n2"), None).unwrap();
    assert_eq!(poses.pins().len(), 1, "the operator says that it holds");
}

#[test]
fn two_ambiguous_pairs_that_agree_determine_a_node_until_something_better_comes() {
    let (n3, elsewhere) = (chained(N2, N2_TO_N3), (9.0, 2.0, 2.0));
    let mut pairs = pairs(&[(("n1", "n2"), N2)]);
    let mut poses = Poses::new(id("n1"));
    assert!(pairs.take(&ambiguous(("n1", "n3"), elsewhere, n3)), "it is an edge now");
    poses.take(now(), &groups(&pairs.edges()), &pairs);
    let told = poses.registration(now(), &id("n3"), &pairs).unwrap();
    let Outcome::Ambiguous { rivals } = &told.outcome else { panic!("{told:?}") };
    assert!((rivals[0].log_odds - 2.0).abs() < 1e-12, "the odds are those of the pair");
    assert_eq!(told.transform, None);
    // The pair with n2 allows the same place, and another one.
    assert!(pairs.take(&ambiguous(("n2", "n3"), N2_TO_N3, (4.0, 4.0, 1.0))));
    poses.take(now(), &groups(&pairs.edges()), &pairs);
    let decided = poses.registration(now(), &id("n3"), &pairs).unwrap();
    assert_eq!(decided.outcome, Outcome::Determined);
    let (pose, covariance) = poses.pose(&id("n3")).unwrap();
    // Rivals are taken with a wider covariance than SIGMA.
    assert!(off_m(&pose, n3) < 3.0 * SIGMA, "{pose:?}");
    assert!(covariance[(0, 0)].sqrt() < 3.0 * SIGMA);
    let odds = pairs.log_odds(&decided.via);
    assert!((odds - AGREEMENT_LOG_ODDS).abs() < 1e-12, "{odds}");
    // A determined pair takes the place of an ambiguous one, never the other way round.
    pairs.take(&solved(("n1", "n3"), n3));
    assert!(!pairs.take(&ambiguous(("n1", "n3"), elsewhere, n3)));
    assert!(pairs.log_odds(&[id("n1"), id("n3")]) > 40.0);
    pairs.doubt(&id("n3"));
    assert_eq!(pairs.edges().len(), 1);
}
