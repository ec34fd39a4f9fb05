//! What is written is read, and each damage has its reason.

use std::sync::Arc;

use nalgebra::Matrix3;
use proto::wire::StatedPose;

use super::*;
use crate::pipeline::poses::Poses;

fn id(name: &str) -> NodeId {
    name.parse().unwrap()
}

fn config() -> Arc<CentreConfig> {
    Arc::new(CentreConfig::default())
}

fn text() -> String {
    let mut poses = Poses::new(id("n1"));
    poses.announce_reference(CentreTime(1));
    for x_m in [1.0, 2.0] {
        let pose_ref_from_node = PoseRecord { x_m, y_m: 2.0, heading_rad: 0.5 };
        let stated = StatedPose { pose_ref_from_node, sigma_m: 0.02, sigma_rad: 0.01 };
        poses.pin(CentreTime(1), &id("n2"), Some(&stated)).unwrap();
    }
    written(&config(), poses.standings()).unwrap()
}

#[test]
fn transforms_epochs_and_pins_are_kept() {
    let standings = read(&config(), &text()).unwrap();
    let second = &standings[&id("n2")];
    assert!(second.is_pinned);
    assert_eq!((second.next_epoch, second.history.len()), (2, 1));
    let kept = second.in_force.unwrap();
    assert!((kept.transform.pose_ref_from_node.x_m - 2.0).abs() < 1e-12);
    let expected = Matrix3::from_diagonal(&nalgebra::Vector3::new(4e-4, 4e-4, 1e-4));
    assert!((kept.transform.covariance_matrix() - expected).norm() < 1e-12);
    assert_eq!(kept.transform.epoch, 1);
}

#[test]
fn a_pin_that_the_reference_has_outdated_stays_so() {
    let mut poses = Poses::new(id("n1"));
    let pose_ref_from_node = PoseRecord { x_m: 1.0, y_m: 2.0, heading_rad: 0.5 };
    let stated = StatedPose { pose_ref_from_node, sigma_m: 0.02, sigma_rad: 0.01 };
    poses.pin(CentreTime(1), &id("n2"), Some(&stated)).unwrap();
    let restored = |former: &Poses| {
        let mut restarted = Poses::new(id("n1"));
        let standings = read(&config(), &written(&config(), former.standings()).unwrap());
        restarted.restore(standings.unwrap());
        restarted
    };
    assert_eq!(restored(&poses).pins().len(), 1);
    assert_eq!(poses.outdate_pins(), [id("n2")]);
    let mut next = restored(&poses);
    assert!(next.is_pinned(&id("n2")) && next.pins().is_empty());
    next.pin(CentreTime(2), &id("n2"), None).unwrap();
    assert_eq!(restored(&next).pins().len(), 1, "the operator said again what holds");
}

#[test]
fn each_damage_has_its_reason() {
    let refusal = |from: &str, to: &str| {
        let good = text();
        assert!(good.contains(from), "{good}");
        read(&config(), &good.replacen(from, to, 1)).unwrap_err()
    };
    assert!(matches!(refusal("schema", "sch"), UnusableState::Unreadable(_)));
    assert_eq!(refusal("schema = 1", "schema = 9"), UnusableState::Schema { got: 9 });
    let foreign = refusal("site = \"site\"", "site = \"other\"");
    assert!(
        matches!(foreign, UnusableState::Foreign { .. }) && foreign.to_string().contains("other")
    );
    for (from, to, named) in [
        ("next_epoch = 2", "next_epoch = 0", "epoch"),
        ("next_epoch = 2", "next_epoch = 9007199254740993", "next_epoch"),
        ("log_odds = 1000000000.0", "log_odds = nan", "log_odds"),
        ("x_m = 1.0", "x_m = inf", "pose_ref_from_node"),
        ("0.0004", "-0.0004", "covariance"),
    ] {
        let refused = refusal(from, to);
        let UnusableState::Invalid { field, .. } = &refused else { panic!("{refused}") };
        assert_eq!(*field, named, "{refused}");
    }
}
