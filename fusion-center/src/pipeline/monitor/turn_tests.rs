//! Which pairs are looked at where there are more than one period has room for.

use super::*;

fn node(index: usize) -> NodeId {
    format!("n{index}").parse().unwrap()
}

fn crowd(count: usize) -> Monitor {
    let mut monitor = Monitor::new(MonitorConfig::default());
    let gather =
        Gather::new(crate::config::GatherConfig::default(), node(0), proto::ids::BootId(1));
    let reference = node(0);
    let placement = Placement { pose: Se2::identity(), covariance: Matrix3::identity() };
    let placements = (0..count).map(|index| (node(index), placement)).collect();
    monitor.regroup(&Site { gather: &gather, reference: &reference, placements });
    monitor
}

fn alarmed_watch() -> Watch {
    Watch { loss: Some(99.0), ..Watch::new(0) }
}

#[test]
fn pairs_in_alarm_are_looked_at_in_every_period_and_all_in_turns() {
    let mut monitor = crowd(40);
    let pair_count = 40 * 39 / 2;
    assert_eq!(monitor.pairs.len(), pair_count);
    let alarmed = Pair { first: node(0), second: node(7) };
    monitor.watches.insert(alarmed.clone(), alarmed_watch());
    let mut seen = BTreeSet::new();
    let period_count = pair_count.div_ceil(PAIRS_PER_PERIOD - 1);
    for _ in 0..period_count {
        let due = monitor.due();
        assert!(due.contains(&alarmed) && due.len() <= PAIRS_PER_PERIOD);
        assert_eq!(due.iter().collect::<BTreeSet<_>>().len(), due.len(), "none of them twice");
        seen.extend(due);
    }
    assert_eq!(seen.len(), pair_count, "everybody had a turn");
}

#[test]
fn many_alarms_leave_room_for_the_others_and_take_turns_too() {
    let mut monitor = crowd(40);
    let alarmed: Vec<Pair> = monitor.pairs.iter().take(70).cloned().collect();
    for pair in &alarmed {
        monitor.watches.insert(pair.clone(), alarmed_watch());
    }
    let mut seen = BTreeSet::new();
    for _ in 0..70_usize.div_ceil(ALARMS_PER_PERIOD) {
        let due = monitor.due();
        let alarm_count = due.iter().filter(|pair| alarmed.contains(pair)).count();
        assert!(ALARMS_PER_PERIOD <= alarm_count && due.len() == PAIRS_PER_PERIOD);
        seen.extend(due.into_iter().filter(|pair| alarmed.contains(pair)));
    }
    assert_eq!(seen.len(), alarmed.len());
}

#[test]
fn what_is_known_of_nodes_without_a_place_is_forgotten() {
    let mut monitor = crowd(5);
    for pair in monitor.pairs.clone() {
        monitor.watches.insert(pair, Watch::new(0));
    }
    let gather =
        Gather::new(crate::config::GatherConfig::default(), node(0), proto::ids::BootId(1));
    let reference = node(0);
    let placement = Placement { pose: Se2::identity(), covariance: Matrix3::identity() };
    let placements = [0, 1, 3].map(|index| (node(index), placement)).into();
    monitor.regroup(&Site { gather: &gather, reference: &reference, placements });
    let left: Vec<&Pair> = monitor.watches.keys().collect();
    assert_eq!(left.len(), 3);
    assert!(!left.iter().any(|pair| pair.has(&node(2)) || pair.has(&node(4))));
}
