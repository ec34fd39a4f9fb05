//! Sets that come late, twice, never, out of order, and by clocks that are wrong.

use proto::measured::MeasuredPoint;
use proto::time::NodeTime;
use proto::wire::{Counters, Stamp};

use super::*;

const CENTRE: BootId = BootId(77);
/// Every node's clock shows this much less than the centre's.
const OFFSET_NS: i64 = 5_000_000_000;

fn gather() -> Gather {
    let config = GatherConfig { window_count: 10, max_node_count: 3, ..GatherConfig::default() };
    Gather::new(config, id("n1"), CENTRE)
}

fn id(name: &str) -> NodeId {
    name.parse().unwrap()
}

fn clock() -> ClockEstimate {
    ClockEstimate { centre_boot: CENTRE, offset_ns: OFFSET_NS, error_ns: 1000 }
}

fn ms(value: i64) -> CentreTime {
    CentreTime(value * 1_000_000)
}

/// The set number `sequence` of a node, measured at `middle_ms` of the centre's clock.
fn set(node: &str, sequence: u64, middle_ms: i64) -> Received<PointSet> {
    let point = MeasuredPoint {
        x_m: 0.0,
        y_m: 2.0,
        cov_m2: [0.01, 0.0, 0.01],
        snr_db: 10.0,
        extent_m2: [0.0; 3],
        radial_velocity_m_per_s: None,
    };
    let time = NodeTime(u64::try_from(ms(middle_ms).0 - OFFSET_NS).unwrap());
    let body = PointSet {
        node: id(node),
        period: sequence,
        time,
        clock: Some(clock()),
        half_depth_m: 0.5,
        half_depth_sigma_m: 0.1,
        points: vec![point],
        counters: Counters::default(),
    };
    Received { stamp: Stamp { boot: BootId(1), sequence, sent_ns: 0 }, body }
}

/// Offers set `k` of a node, measured in period `k` and arriving a little later.
fn offer(gather: &mut Gather, node: &str, k: i64) -> Offer {
    let middle_ms = 10_000 + 100 * k;
    gather.offer(ms(middle_ms + 20), set(node, u64::try_from(k).unwrap(), middle_ms)).0
}

#[test]
fn order_and_repetition_do_not_matter() {
    let (mut straight, mut shuffled) = (gather(), gather());
    for k in 0..8 {
        for node in ["n1", "n2"] {
            assert_eq!(offer(&mut straight, node, k), Offer::Kept(k));
        }
    }
    for k in [3, 0, 2, 1, 7, 5, 4, 6] {
        for node in ["n2", "n1", "n2"] {
            offer(&mut shuffled, node, k);
        }
    }
    for node in ["n1", "n2"] {
        let sets = |gather: &Gather| -> Vec<u64> {
            gather.node(&id(node)).unwrap().sets().values().map(|set| set.sequence).collect()
        };
        assert_eq!(sets(&straight), sets(&shuffled));
        assert_eq!(sets(&straight), (0..8).collect::<Vec<u64>>());
    }
    let second = shuffled.node(&id("n2")).unwrap();
    assert_eq!((second.received_count, second.duplicate_count), (8, 8));
}

#[test]
fn what_never_came_is_counted_until_it_comes() {
    let mut gather = gather();
    for k in [0, 1, 4] {
        offer(&mut gather, "n2", k);
    }
    assert_eq!(gather.node(&id("n2")).unwrap().missing_count(), 2);
    offer(&mut gather, "n2", 2);
    assert_eq!(gather.node(&id("n2")).unwrap().missing_count(), 1);
}

#[test]
fn memory_is_bounded_and_what_is_too_old_is_counted() {
    let mut gather = gather();
    for k in 1..200 {
        offer(&mut gather, "n1", k);
    }
    let history = gather.node(&id("n1")).unwrap();
    assert_eq!(history.sets().len(), 10);
    assert_eq!(history.newest_period(), Some(198), "the first set is period 0");
    assert_eq!(offer(&mut gather, "n1", 0), Offer::Late);
    assert_eq!(gather.node(&id("n1")).unwrap().late_count, 1);
    for node in ["n2", "n3"] {
        assert!(matches!(offer(&mut gather, node, 199), Offer::Kept(_)));
    }
    assert_eq!(offer(&mut gather, "n4", 199), Offer::TooManyNodes);
    assert_eq!(gather.nodes().count(), 3);
}

#[test]
fn sets_wait_for_the_clock_and_only_for_this_centres() {
    let mut gather = gather();
    let mut unknown = set("n1", 0, 10_000);
    unknown.body.clock = None;
    assert_eq!(gather.offer(ms(10_020), unknown).0, Offer::AwaitsClock);
    let foreign = ClockEstimate { centre_boot: BootId(3), ..clock() };
    assert!(gather.learn_clock(&id("n1"), foreign).is_empty());
    assert_eq!(gather.learn_clock(&id("n1"), clock()), vec![0]);
    assert_eq!(gather.node(&id("n1")).unwrap().sets().len(), 1);
}

#[test]
fn a_vague_clock_is_shown_but_not_registered_with() {
    let mut gather = gather();
    let mut vague = set("n1", 0, 10_000);
    vague.body.clock = Some(ClockEstimate { error_ns: 30_000_000, ..clock() });
    gather.offer(ms(10_020), vague);
    let history = gather.node(&id("n1")).unwrap();
    assert!(history.sets().len() == 1 && !gather.is_clock_good(history));
    gather.learn_clock(&id("n1"), clock());
    assert!(gather.is_clock_good(gather.node(&id("n1")).unwrap()));
}

#[test]
fn a_clock_from_the_future_moves_nobody() {
    let mut gather = gather();
    offer(&mut gather, "n1", 0);
    let (offer_made, _) = gather.offer(ms(10_020), set("n2", 0, 9_000_000));
    assert_eq!(offer_made, Offer::FromTheFuture);
    assert_eq!(gather.close_next(ms(10_020)), None, "n2 is alive and has nothing yet");
    assert_eq!(gather.close_next(ms(10_400)), Some(0));
    assert_eq!(gather.close_next(ms(10_400)), None);
}

#[test]
fn a_restarted_agent_is_a_new_life_and_a_namesake_is_noticed() {
    let mut gather = gather();
    for k in 0..3 {
        offer(&mut gather, "n2", k);
    }
    let mut reborn = set("n2", 0, 10_300);
    reborn.stamp.boot = BootId(2);
    assert_eq!(gather.offer(ms(10_320), reborn).0, Offer::Kept(3));
    let history = gather.node(&id("n2")).unwrap();
    assert_eq!((history.received_count, history.sets().len()), (1, 4), "the sets stay");
    assert_eq!(offer(&mut gather, "n2", 4), Offer::FormerLife);
}

#[test]
fn the_newest_of_many_former_lives_is_remembered() {
    let mut gather = gather();
    for life in 1..=20 {
        let mut reborn = set("n2", 0, 10_000 + 100 * i64::try_from(life).unwrap());
        reborn.stamp.boot = BootId(life);
        assert!(matches!(gather.offer(ms(13_000), reborn).0, Offer::Kept(_)));
    }
    let mut straggler = set("n2", 1, 12_000);
    straggler.stamp.boot = BootId(19);
    assert_eq!(gather.offer(ms(13_000), straggler).0, Offer::FormerLife);
}

#[test]
fn the_reference_always_finds_a_place() {
    let mut gather = gather();
    for node in ["x1", "x2", "x3"] {
        offer(&mut gather, node, 0);
    }
    assert_eq!(offer(&mut gather, "x4", 0), Offer::TooManyNodes);
    assert!(matches!(offer(&mut gather, "n1", 0), Offer::Kept(_)));
}

#[test]
fn a_period_closes_when_complete_and_waits_no_longer_than_allowed() {
    let mut gather = gather();
    offer(&mut gather, "n1", 0);
    offer(&mut gather, "n2", 0);
    assert_eq!(gather.close_next(ms(10_020)), Some(0));
    offer(&mut gather, "n1", 1);
    assert_eq!(gather.close_next(ms(10_120)), None, "n2 is awaited");
    assert_eq!(gather.close_next(ms(10_449)), None);
    assert_eq!(gather.close_next(ms(10_450)), Some(1), "half a period and max_wait_s later");
    // Three seconds without a word: nobody waits for n2 any more.
    offer(&mut gather, "n1", 33);
    assert_eq!(gather.close_next(ms(13_320)), Some(33));
}

#[test]
fn the_half_depth_moves_points_outward_once() {
    let mut gather = gather();
    offer(&mut gather, "n1", 0);
    let set = &gather.node(&id("n1")).unwrap().sets()[&0];
    let kept = set.points[0].position;
    assert!((kept.mean.y_m() - 2.5).abs() < 1e-12);
    assert!((kept.cov_m2[(1, 1)] - 0.01).abs() < 1e-12);
    let widened = set.points[0].with_half_depth_error(set.half_depth_sigma_m);
    assert!((widened.cov_m2[(1, 1)] - 0.02).abs() < 1e-12);
}

#[test]
fn the_reserve_keeps_places_once_seen_and_is_bounded() {
    let config = GatherConfig {
        window_count: 10,
        reserve_count: 4,
        max_node_count: 3,
        ..GatherConfig::default()
    };
    let mut gather = Gather::new(config, id("n1"), CENTRE);
    // Cell 7 is seen in period 3 only, cell 8 by nobody else in period 5, all else in cell 1.
    for k in 0..200 {
        for node in ["n1", "n2"] {
            assert_eq!(offer(&mut gather, node, k), Offer::Kept(k));
        }
        let (column, is_common) = match k {
            3 => (7, true),
            5 => (8, false),
            _ => (1, true),
        };
        let place = |node: &str| Place { node: id(node), cell: (column, 0), is_common };
        gather.note_places(k, vec![place("n1"), place("n2")]);
        let kept = |node: &str| gather.node(&id(node)).unwrap().reserve().len();
        assert!(kept("n1") <= 4 && kept("n2") <= 4);
    }
    let reserve = gather.node(&id("n2")).unwrap().reserve();
    assert!(reserve.contains_key(&3), "{:?}", reserve.keys());
    assert!(!reserve.contains_key(&5), "what nobody else saw tells nothing");
    assert_eq!(gather.node(&id("n2")).unwrap().all_sets().count(), 14);
    gather.forget_before(&id("n2"), 195);
    assert_eq!(gather.node(&id("n2")).unwrap().all_sets().count(), 5);
    gather.forget(&id("n2"));
    assert_eq!(gather.node(&id("n2")).unwrap().all_sets().count(), 0);
    assert_eq!(gather.node(&id("n1")).unwrap().all_sets().count(), 14, "nobody else forgets");
}
