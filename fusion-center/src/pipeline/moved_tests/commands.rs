//! What operators ask for, and restarts.

use super::*;

#[test]
fn a_pinned_node_keeps_its_transform_and_says_so() {
    let mut site = Site::new(6, 3, around());
    let unknown = site.command(&Command::Pin { node: id("n7"), pose: None });
    assert!(!unknown.is_done && unknown.text.contains("no node n7"), "{unknown:?}");
    for command in [Command::Unpin { node: id("n7") }, Command::Rollback { node: id("n7") }] {
        let answer = site.command(&command);
        assert!(!answer.is_done && answer.text.contains("no node n7; known are: "), "{answer:?}");
    }
    site.steps(40);
    let pose_ref_from_node = PoseRecord { x_m: 1.0, y_m: 2.0, heading_rad: 0.5 };
    let stated = StatedPose { pose_ref_from_node, sigma_m: 0.02, sigma_rad: 0.01 };
    let answer = site.command(&Command::Pin { node: name(1), pose: Some(stated) });
    assert!(answer.is_done && answer.text.contains("n2"), "{answer:?}");
    let epoch = site.epoch(1);
    site.steps(20);
    assert_eq!(site.epoch(1), epoch);
    let told = &site.registrations[&name(1)];
    assert!(told.is_pinned && told.transform.unwrap().pose_ref_from_node == pose_ref_from_node);
    assert!(site.command(&Command::Unpin { node: name(1) }).is_done);
    site.steps(10);
    assert!(site.is_right(1) && epoch < site.epoch(1));
    assert!(!site.command(&Command::Unpin { node: name(1) }).is_done, "it is not pinned");
    let reference = site.command(&Command::Pin { node: name(0), pose: None });
    assert!(!reference.is_done && reference.text.contains("reference"), "{reference:?}");
}

#[test]
fn a_rollback_brings_the_former_pose_under_a_new_epoch() {
    let mut site = Site::new(7, 3, around());
    site.steps(60);
    let nothing = site.command(&Command::Rollback { node: name(1) });
    assert!(!nothing.is_done && nothing.text.contains("no earlier"), "{nothing:?}");
    let (before, epoch) = (site.centre.poses.pose(&name(1)).unwrap().0, site.epoch(1));
    let pose_ref_from_node = PoseRecord { x_m: 1.0, y_m: 2.0, heading_rad: 0.5 };
    let stated = StatedPose { pose_ref_from_node, sigma_m: 0.02, sigma_rad: 0.01 };
    site.command(&Command::Pin { node: name(1), pose: Some(stated) });
    let answer = site.command(&Command::Rollback { node: name(1) });
    assert!(answer.is_done, "{answer:?}");
    let after = site.centre.poses.pose(&name(1)).unwrap().0;
    assert!((before.translation_m() - after.translation_m()).norm() < 1e-9);
    assert!(epoch.unwrap() + 1 < site.epoch(1).unwrap());
    assert!(site.centre.poses.is_pinned(&name(1)));
}

#[test]
fn transforms_epochs_and_pins_survive_a_restart() {
    let mut site = Site::new(8, 3, around());
    site.steps(60);
    site.command(&Command::Pin { node: name(2), pose: None });
    site.steps(20);
    let text = site.saved.clone().unwrap();
    let pose = site.centre.poses.pose(&name(1)).unwrap().0;
    let (mut next, epoch) = (Centre::new(config(), CENTRE), site.epoch(1));
    next.restore(&text).unwrap();
    assert!(next.poses.is_pinned(&name(2)));
    let restored = next.poses.transform(&name(1)).unwrap();
    // The file is at most a second old.
    assert!(epoch.unwrap() <= restored.epoch + 10);
    let off_m = pose.translation_m() - next.poses.pose(&name(1)).unwrap().0.translation_m();
    assert!(off_m.norm() < 0.03, "{off_m:?}");
    site.centre = next;
    site.steps(40);
    assert!(epoch <= site.epoch(1) && site.is_right(1) && site.is_right(2));
}

#[test]
fn an_agent_that_holds_a_former_centres_epoch_is_told_a_higher_one() {
    let mut poses = Poses::new(id("n1"));
    assert!(!poses.hear_epoch(&id("n2"), 41), "nothing is in force yet");
    assert!(!poses.hear_epoch(&id("n2"), u64::MAX), "nobody counts so far");
    let stated = StatedPose {
        pose_ref_from_node: PoseRecord { x_m: 1.0, y_m: 2.0, heading_rad: 0.5 },
        sigma_m: 0.02,
        sigma_rad: 0.01,
    };
    poses.pin(CentreTime(1), &id("n2"), Some(&stated)).unwrap();
    assert_eq!(poses.transform(&id("n2")).unwrap().epoch, 42);
    assert!(poses.hear_epoch(&id("n2"), 99));
    assert_eq!(poses.transform(&id("n2")).unwrap().epoch, 100);
    assert!(!poses.hear_epoch(&id("n2"), 100));
}

#[test]
fn recalibrating_the_reference_registers_everybody_anew() {
    let mut site = Site::new(12, 3, around());
    site.steps(60);
    assert!(site.is_right(1) && site.is_right(2));
    site.command(&Command::Pin { node: name(2), pose: None });
    let refused = site.command(&Command::Recalibrate { node: Some(name(2)) });
    assert!(!refused.is_done && refused.text.contains("unpin"), "{refused:?}");
    site.poses[0] = site.poses[0] * Se2::<Node, Node>::new(0.6, -0.3, 0.2);
    let answer = site.command(&Command::Recalibrate { node: Some(name(0)) });
    assert!(answer.is_done && answer.text.contains("n1, n2; pinned"), "{answer:?}");
    site.command(&Command::Unpin { node: name(2) });
    site.steps(40);
    // Nobody had to find out by the monitor.
    assert!(site.suspects.is_empty(), "{:?}", site.suspects);
    assert!(site.is_right(1) && site.is_right(2), "{:?} {:?}", site.error(1), site.error(2));
    let outcome = &site.registrations[&name(1)].outcome;
    assert_eq!(*outcome, Outcome::Determined);
}
