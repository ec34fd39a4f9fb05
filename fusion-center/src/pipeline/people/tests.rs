//! Which looks the tracker gets, and what is shown of its tracks: with a tracker that only listens.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use nalgebra::{Matrix2, Matrix3, Matrix4, Vector2, Vector4};
use proto::geom::Se2;
use proto::ids::BootId;
use proto::measured::MeasuredPoint;
use proto::time::{ClockEstimate, NodeTime};
use proto::wire::{Counters, PointSet, Received, Stamp};

use super::*;
use crate::config::GatherConfig;
use crate::pipeline::drawn::id;
use crate::tracking::{LookError, ReportId, Settled};

const CENTRE: BootId = BootId(9);
const SECOND_NS: i64 = 1_000_000_000;

/// Time, sensor, look index and places of a look.
type Heard = (f64, u32, u64, Vec<Plot>);

/// Follows the first plot of every look, under an id that grows from one listener to the next.
struct Listener {
    heard: Arc<Mutex<Vec<Heard>>>,
    id: u64,
    tracks: Vec<Track>,
}

impl Tracker for Listener {
    fn look(&mut self, look: &Look<'_>) -> Result<(), LookError> {
        let Look { time_s, sensor_index, look_index, plots, .. } = *look;
        self.heard.lock().unwrap().push((time_s, sensor_index, look_index, plots.to_vec()));
        if let Some(plot) = plots.first() {
            let report_index = plot.report_index;
            self.tracks = vec![Track {
                id: self.id,
                status: Status::Confirmed,
                time_s,
                state: Vector4::new(plot.position_m.x, plot.position_m.y, 0.0, 0.0),
                covariance: Matrix4::identity(),
                log_odds: 20.0,
                plot_count: 3,
                seen_s: time_s,
                last_report: ReportId { sensor_index, look_index, report_index },
                last_share: 0.75,
            }];
        }
        Ok(())
    }

    fn tracks(&self) -> &[Track] {
        &self.tracks
    }

    fn take_settled(&mut self, _: &mut Vec<Settled>) {}

    fn finish(&mut self) {}
}

fn point(x_m: f64, y_m: f64, snr_db: f64) -> MeasuredPoint {
    MeasuredPoint {
        x_m,
        y_m,
        cov_m2: [0.01, 0.0, 0.04],
        snr_db,
        extent_m2: [0.0; 3],
        radial_velocity_m_per_s: None,
    }
}

/// A set measured `after_ms` into the period that begins at second 6 of the centre.
fn set(name: &str, after_ms: u64, error_ns: u64, points: Vec<MeasuredPoint>) -> Received<PointSet> {
    let clock = ClockEstimate { centre_boot: CENTRE, offset_ns: 6 * SECOND_NS, error_ns };
    let body = PointSet {
        node: id(name),
        period: 0,
        time: NodeTime(after_ms * 1_000_000),
        clock: Some(clock),
        half_depth_m: 0.0,
        half_depth_sigma_m: 0.1,
        points,
        counters: Counters::default(),
    };
    Received { stamp: Stamp { boot: BootId(1), sequence: 11, sent_ns: 0 }, body }
}

/// `n1`, the reference, and `n2`, turned by a quarter at (10, 0) with an uncertain heading, both
/// placed; `n3` is not, and `n4` has no good clock.
struct Stage {
    gather: Gather,
    period: i64,
    placements: BTreeMap<NodeId, Placement>,
    people: People,
    heard: Arc<Mutex<Vec<Heard>>>,
}

fn stage() -> Stage {
    let mut gather = Gather::new(GatherConfig::default(), id("n1"), CENTRE);
    let now = CentreTime(7 * SECOND_NS);
    let seen = || vec![point(1.0, 2.0, 5.0), point(0.0, 5.0, 20.0)];
    for (name, after_ms, error_ns) in
        [("n1", 30, 1000), ("n2", 10, 1000), ("n3", 20, 1000), ("n4", 20, 1_000_000_000)]
    {
        gather.offer(now, set(name, after_ms, error_ns, seen()));
    }
    let placement = |x_m, turn, variance| Placement {
        pose: Se2::new(x_m, 0.0, turn),
        covariance: Matrix3::from_diagonal(&nalgebra::Vector3::new(0.0, 0.0, variance)),
    };
    let quarter = std::f64::consts::FRAC_PI_2;
    let placements = BTreeMap::from([
        (id("n1"), placement(0.0, 0.0, 0.0)),
        (id("n2"), placement(10.0, quarter, 1e-2)),
        (id("n4"), placement(0.0, 0.0, 0.0)),
    ]);
    let heard: Arc<Mutex<Vec<Heard>>> = Arc::default();
    let (told, made) = (heard.clone(), AtomicU64::new(4));
    let make = move || -> Option<Box<dyn Tracker>> {
        let id = made.fetch_add(1, Ordering::Relaxed);
        Some(Box::new(Listener { heard: told.clone(), id, tracks: Vec::new() }))
    };
    let people = People::with(&PeopleConfig::default(), Box::new(make));
    let period = gather.period_at(CentreTime(6 * SECOND_NS + 30_000_000));
    Stage { gather, period, placements, people, heard }
}

#[test]
fn placed_nodes_with_good_clocks_give_looks_in_the_order_of_their_measurement() {
    let Stage { gather, period, placements, mut people, heard } = stage();
    people.take(period, &gather, &placements);
    let heard = heard.lock().unwrap();
    let who: Vec<(f64, &str, u64)> = heard
        .iter()
        .map(|(time_s, sensor, look, _)| {
            (*time_s, people.sensors[*sensor as usize].as_str(), *look)
        })
        .collect();
    assert_eq!(who, [(6.01, "n2", 11), (6.03, "n1", 11)]);
    // The stronger point first, under its number in the set; by hand: (0, 5) turned by a quarter is
    // (-5, 0), and a heading wrong by 0.1 rad moves it by 0.5 m across.
    let (_, _, _, plots) = &heard[0];
    assert_eq!(plots.iter().map(|plot| plot.report_index).collect::<Vec<_>>(), [1, 0]);
    assert!((plots[0].position_m - Vector2::new(5.0, 0.0)).norm() < 1e-9);
    let want = Matrix2::new(0.04 + 0.01, 0.0, 0.0, 0.01 + 25.0 * 1e-2);
    assert!((plots[0].covariance_m2 - want).norm() < 1e-9, "{}", plots[0].covariance_m2);
}

#[test]
fn a_person_is_shown_with_those_who_contribute_lately() {
    let Stage { gather, period, placements, mut people, .. } = stage();
    people.take(period, &gather, &placements);
    let shown = people.shown();
    let [person] = &shown[..] else { panic!("{shown:?}") };
    assert_eq!(person.nodes, [id("n1"), id("n2")]);
    assert_eq!((person.id, person.last.node.as_str(), person.last.sequence), (0, "n1", 11));
    assert_eq!((person.last.point_index, person.time), (1, CentreTime(6_030_000_000)));
    people.config.contribution_s = 0.01;
    assert_eq!(people.shown()[0].nodes, [id("n1")], "n2 was 20 ms earlier");
}

#[test]
fn ids_go_on_when_all_starts_over() {
    let Stage { gather, period, placements, mut people, .. } = stage();
    people.take(period, &gather, &placements);
    people.forget_old(CentreTime(8 * SECOND_NS), Duration::from_secs(3));
    assert_eq!(people.shown().len(), 1);
    people.forget_old(CentreTime(10 * SECOND_NS), Duration::from_secs(3));
    assert!(people.shown().is_empty());
    people.take(period, &gather, &placements);
    assert_eq!(people.shown()[0].id, 1);
}

/// `n2` comes in a period later: its set of the period before is looked at after all, and who was
/// followed keeps the id.
#[test]
fn a_node_that_comes_in_is_heard_from_the_beginning() {
    let Stage { mut gather, period, placements, mut people, heard } = stage();
    let alone = BTreeMap::from([(id("n1"), placements[&id("n1")])]);
    people.take(period, &gather, &alone);
    let next = |name: &str| {
        let mut later = set(name, 130, 1000, vec![point(0.0, 5.2, 20.0)]);
        later.stamp.sequence = 12;
        later
    };
    gather.offer(CentreTime(7 * SECOND_NS), next("n1"));
    heard.lock().unwrap().clear();
    people.take(period + 1, &gather, &placements);
    let looks: Vec<u64> = heard.lock().unwrap().iter().map(|(_, _, look, _)| *look).collect();
    assert_eq!(looks, [11, 11, 12], "n2, n1, then n1 again");
    assert_eq!(people.shown()[0].id, 0);
    heard.lock().unwrap().clear();
    people.take(period + 1, &gather, &alone);
    assert_eq!(heard.lock().unwrap().len(), 1, "who goes out is no reason to begin again");
}

#[test]
fn people_keep_the_names_of_those_nearest() {
    let track = |id: u64, x_m: f64| {
        let mut listener = Listener { heard: Arc::default(), id, tracks: Vec::new() };
        let plot = Plot {
            position_m: Vector2::new(x_m, 0.0),
            covariance_m2: Matrix2::identity(),
            radial: None,
            strength_db: None,
            report_index: 0,
        };
        let coverage = Coverage {
            area: Area::Everywhere,
            detection_probability: 0.9,
            minimum_detectable_m_per_s: None,
        };
        let look = Look {
            time_s: 0.0,
            sensor_index: 0,
            look_index: 0,
            platform: None,
            coverage,
            clutter_per_m2: 1.0,
            plots: &[plot],
        };
        listener.look(&look).unwrap();
        listener.tracks.remove(0)
    };
    let before = [(7, Vector2::new(0.0, 0.0)), (8, Vector2::new(1.0, 0.0))];
    let tracks = [track(1, 0.6), track(2, 0.1), track(3, 2.0)];
    let names = same_people(&before, &tracks);
    // 2 is nearest to 7, then 1 to 8; 3 is too far from everybody.
    assert_eq!(names, BTreeMap::from([(1, 8), (2, 7)]));
}

#[test]
fn nobody_is_followed_where_that_is_switched_off() {
    let Stage { gather, period, placements, .. } = stage();
    let config = PeopleConfig { follow: false, ..PeopleConfig::default() };
    let mut people = People::new(&config);
    assert!(people.tracker.is_none());
    people.take(period, &gather, &placements);
    people.start_over();
    assert!(people.shown().is_empty());
}
