//! The centre as a whole on a network in memory: registration through faults, refusals, silence.

use std::sync::Arc;
use std::time::Duration;

use nalgebra::Matrix2;
use proto::bus::{Bus, BusEvent, Faults, MemoryBus, MemoryNetwork};
use proto::geom::{Node, Point, Ref, Se2};
use proto::keys::Pattern;
use proto::measured::{MeasuredPoint, packed};
use proto::time::{ClockEstimate, NodeTime};
use proto::wire::{Command, Counters, NodeState, Outcome, PointSet, Registration, decode, encode};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

use super::pictures::MAX_SIGHTING_COUNT;
use super::*;
use crate::service::serve;

const CENTRE: BootId = BootId(9);
const SIGMA_M: f64 = 0.02;
const PERIOD: Duration = Duration::from_millis(100);

fn id(name: &str) -> NodeId {
    name.parse().unwrap()
}

fn truth() -> Se2<Ref, Node> {
    Se2::new(-5.0, 5.0, -1.5)
}

/// Two people on curved ways, in `Ref`.
fn people(time_s: f64) -> [Point<Ref>; 2] {
    let turn = 0.8 * time_s;
    [
        Point::new(-1.0 + 2.0 * turn.sin(), 4.0 + 1.5 * (0.7 * turn).cos()),
        Point::new(1.0 + 1.2 * (1.3 * turn).cos(), 5.0 - 2.0 * (0.5 * turn).sin()),
    ]
}

/// An agent that needs no radar.
struct Agent {
    node: NodeId,
    pose_ref_from_node: Se2<Ref, Node>,
    bus: MemoryBus,
    random: ChaCha8Rng,
}

impl Agent {
    fn new(network: &MemoryNetwork, node: &str, pose_ref_from_node: Se2<Ref, Node>) -> Self {
        let random = ChaCha8Rng::seed_from_u64(u64::from(node.as_bytes()[1]));
        let (bus, _) = network.join(&[], 1);
        Self { node: id(node), pose_ref_from_node, bus, random }
    }

    fn set(&mut self, period: u64) -> Vec<u8> {
        let time = NodeTime(u64::try_from(PERIOD.as_nanos()).unwrap() * (period + 1));
        let seen = people(time.0 as f64 * 1e-9).map(|point_in_ref| {
            let point_in_node = self.pose_ref_from_node.inverse() * point_in_ref;
            let mut error = || SIGMA_M * self.random.sample::<f64, _>(StandardNormal);
            MeasuredPoint {
                x_m: point_in_node.x_m() + error(),
                y_m: point_in_node.y_m() + error(),
                cov_m2: packed(&(Matrix2::identity() * SIGMA_M.powi(2))),
                snr_db: 12.0,
                extent_m2: [0.0; 3],
                radial_velocity_m_per_s: None,
            }
        });
        let set = PointSet {
            node: self.node.clone(),
            period,
            time,
            clock: Some(ClockEstimate { centre_boot: CENTRE, offset_ns: 0, error_ns: 1000 }),
            half_depth_m: 0.0,
            half_depth_sigma_m: 0.0,
            points: seen.to_vec(),
            counters: Counters::default(),
        };
        encode(Stamp { boot: BootId(1), sequence: period, sent_ns: time.0 }, &set).unwrap()
    }

    async fn publish(&mut self, period: u64) {
        let bytes = self.set(period);
        self.bus.publish(&Topic::Points(self.node.clone()), bytes).await.unwrap();
    }
}

/// A centre on a network in memory, and everything that it says.
struct World {
    network: MemoryNetwork,
    said: mpsc::Receiver<Delivery>,
    stop: CancellationToken,
    running: tokio::task::JoinHandle<()>,
}

fn config() -> Arc<CentreConfig> {
    Arc::new(CentreConfig::default())
}

fn world(faults: Faults) -> World {
    let keys = Keys::new(config().site.clone());
    let network = MemoryNetwork::new(keys.clone(), faults, 3);
    let quiet = MemoryNetwork::new(keys, Faults::default(), 3);
    let inbound = [Pattern::AllPoints, Pattern::AllStatus, Pattern::AllClockProbes];
    let (_, deliveries) = network.join(&inbound, 10_000);
    let (_, said) = quiet.join(&[Pattern::AllTransforms, Pattern::Picture], 10_000);
    let (outbound, _) = quiet.join(&[], 1);
    let stop = CancellationToken::new();
    let token = stop.clone();
    let running = tokio::spawn(async move {
        let centre = Centre::new(config(), CENTRE);
        serve((*config()).clone(), centre, &outbound, deliveries, token).await;
    });
    World { network, said, stop, running }
}

/// The newest registration of n2 and the newest picture.
async fn last_words(mut world: World) -> (Registration, Picture) {
    tokio::time::sleep(Duration::from_millis(600)).await;
    world.stop.cancel();
    world.running.await.unwrap();
    let (mut registration, mut picture) = (None, None);
    while let Ok(Delivery { key, event: BusEvent::Message(bytes), .. }) = world.said.try_recv() {
        if key.ends_with("tf/n2") {
            registration = Some(decode::<Registration>(&bytes).unwrap().body);
        } else if key.ends_with("picture") {
            picture = Some(decode::<Picture>(&bytes).unwrap().body);
        }
    }
    (registration.unwrap(), picture.unwrap())
}

#[tokio::test(start_paused = true)]
async fn registers_through_delay_loss_duplication_and_reordering() {
    let faults = Faults {
        delay_min: Duration::from_millis(1),
        delay_max: Duration::from_millis(400),
        loss_probability: 0.2,
        duplicate_probability: 0.2,
    };
    let world = world(faults);
    let mut agents = [
        Agent::new(&world.network, "n1", Se2::identity()),
        Agent::new(&world.network, "n2", truth()),
    ];
    for period in 0..60 {
        tokio::time::sleep(PERIOD).await;
        for agent in &mut agents {
            agent.publish(period).await;
        }
    }
    let (registration, picture) = last_words(world).await;
    assert_eq!(registration.outcome, Outcome::Determined);
    let transform = registration.transform.unwrap();
    let pose: Se2<Ref, Node> = transform.pose_ref_from_node.into();
    // Some 40 common periods of two points with 2 cm: the pose is good to 4 mm and 0.1 degrees.
    assert!((pose.translation_m() - truth().translation_m()).norm() < 0.03, "{pose:?}");
    assert!((pose.heading_rad() - truth().heading_rad()).abs() < 0.01, "{pose:?}");
    assert!(picture.nodes.iter().all(|line| line.state == NodeState::Live));
    let second = &picture.nodes[1];
    assert!(0 < second.duplicate_count && 0 < second.missing_count, "{second:?}");
    assert_eq!(second.received_count + second.missing_count, second.next_sequence);
}

#[tokio::test(start_paused = true)]
async fn says_underdetermined_instead_of_guessing_and_shows_the_silent() {
    let world = world(Faults::default());
    let mut agents = [
        Agent::new(&world.network, "n1", Se2::identity()),
        Agent::new(&world.network, "n2", truth()),
    ];
    for agent in &mut agents {
        agent.publish(0).await;
    }
    for period in 1..50 {
        tokio::time::sleep(PERIOD).await;
        agents[0].publish(period).await;
    }
    let (registration, picture) = last_words(world).await;
    assert!(matches!(registration.outcome, Outcome::Underdetermined { .. }), "{registration:?}");
    assert_eq!(registration.transform, None);
    let state = |node: &str| picture.nodes.iter().find(|line| line.node == id(node)).unwrap().state;
    assert_eq!((state("n1"), state("n2")), (NodeState::Live, NodeState::Silent));
    assert!(picture.targets.iter().all(|target| target.nodes == [id("n1")]));
}

/// Steps a centre by hand through deliveries that come later than they were measured.
fn stepped(deliveries: &[Delivery]) -> (Centre, Vec<u8>) {
    let mut centre = Centre::new(config(), CENTRE);
    let mut said = Vec::new();
    for (index, delivery) in deliveries.iter().enumerate() {
        let now = CentreTime(3_000_000_000 + 10_000_000 * i64::try_from(index).unwrap());
        let mut effects = centre.step(now, Event::Delivered(delivery.clone(), now));
        while let Some(effect) = effects.pop() {
            match effect {
                Effect::Publish(topic, bytes) => {
                    said.extend(format!("{topic:?}").bytes());
                    said.extend(bytes);
                }
                Effect::Solve(job) => {
                    let solution = crate::registration::build(&config().solver)
                        .solve(&job.problem, job.known.as_ref());
                    let solve_time = Duration::ZERO;
                    let solved = Solved { job: *job, solution, solver: "default", solve_time };
                    effects.extend(centre.step(now, Event::Solved(Box::new(solved))));
                }
                Effect::Combine(combination) => {
                    let groups = combination.groups();
                    let combination = *combination;
                    let combined = Combined { combination, groups, time: Duration::ZERO };
                    effects.extend(centre.step(now, Event::Combined(Box::new(combined))));
                }
                Effect::Save(text) => said.extend(text.bytes()),
            }
        }
    }
    (centre, said)
}

fn message(key: &str, bytes: Vec<u8>) -> Delivery {
    let event = BusEvent::Message(bytes);
    Delivery { key: key.to_owned(), event, arrived: tokio::time::Instant::now() }
}

fn good_traffic() -> Vec<Delivery> {
    let network = MemoryNetwork::new(Keys::new(config().site.clone()), Faults::default(), 1);
    let mut agents =
        [Agent::new(&network, "n1", Se2::identity()), Agent::new(&network, "n2", truth())];
    let mut deliveries = Vec::new();
    for period in 0..20 {
        for agent in &mut agents {
            let key = format!("transmural/1/site/up/{}/points", agent.node);
            deliveries.push(message(&key, agent.set(period)));
        }
    }
    deliveries
}

#[test]
fn the_same_input_gives_the_same_bytes() {
    let traffic = good_traffic();
    let (_, first) = stepped(&traffic);
    let (_, second) = stepped(&traffic);
    assert!(10_000 < first.len());
    assert!(first == second);
}

#[test]
fn garbage_on_every_key_is_counted_named_and_changes_nothing() {
    let good = good_traffic();
    let set = match &good[2].event {
        BusEvent::Message(bytes) => bytes.clone(),
        _ => unreachable!(),
    };
    let mut other_version = set.clone();
    other_version[4] = 9;
    let bad = [b"garbage".to_vec(), set[..set.len() - 3].to_vec(), vec![0; 300_000], other_version];
    let keys = ["up/n1/points", "up/n2/status", "up/n1/clock", "ops/command"];
    let mut traffic = Vec::new();
    for delivery in &good {
        traffic.push(delivery.clone());
        for key in keys {
            let key = format!("transmural/1/site/{key}");
            traffic.extend(bad.iter().map(|bytes| message(&key, bytes.clone())));
        }
        // A valid set of n1 under the key of n2, and a key of nobody.
        traffic.push(message("transmural/1/site/up/n2/points", set_of_n1(&good)));
        traffic.push(message("transmural/1/site/up/N2/points", set.clone()));
    }
    let (attacked, _) = stepped(&traffic);
    let (calm, _) = stepped(&good);
    let refusals = attacked.refusals();
    for (label, expected) in [
        ("too_short", 40 * 4),
        ("length", 40),
        ("foreign", 40 * 4),
        ("header_version", 40 * 4),
        ("impostor", 40),
        ("key", 40),
    ] {
        assert_eq!(refusals.total(label), expected, "{label}: {:?}", refusals.counts());
    }
    // A cut set is of the wrong kind where no set is expected.
    assert_eq!(refusals.total("kind"), 40 * 3);
    let pose = |centre: &Centre| centre.poses.transform(&id("n2")).unwrap().pose_ref_from_node;
    assert_eq!(pose(&attacked), pose(&calm));
}

fn set_of_n1(traffic: &[Delivery]) -> Vec<u8> {
    match &traffic[0].event {
        BusEvent::Message(bytes) => bytes.clone(),
        _ => unreachable!(),
    }
}

#[test]
fn a_wild_but_valid_set_does_not_cost_the_picture() {
    let mut traffic = good_traffic();
    let mut wild = decode::<PointSet>(&set_of_n1(&traffic)).unwrap();
    wild.body.points = vec![wild.body.points[0].clone(); 1024];
    wild.body.points[0].x_m = 99_999.999;
    wild.body.period = 20;
    wild.body.time = NodeTime(2_100_000_000);
    wild.stamp.sequence = 20;
    let bytes = encode(wild.stamp, &wild.body).unwrap();
    traffic.push(message("transmural/1/site/up/n1/points", bytes));
    let (centre, _) = stepped(&traffic);
    let picture = centre.last_picture.unwrap();
    assert_eq!(picture.period, 20, "the period with the wild set has a picture");
    assert!(picture.targets.len() <= MAX_SIGHTING_COUNT);
}

#[test]
fn a_solver_that_breaks_does_not_disable_its_node() {
    let mut centre = Centre::new(config(), CENTRE);
    let mut job_count = 0;
    for (index, delivery) in good_traffic().into_iter().enumerate() {
        let now = CentreTime(3_000_000_000 + i64::try_from(index).unwrap());
        for effect in centre.step(now, Event::Delivered(delivery, now)) {
            if let Effect::Solve(job) = effect {
                job_count += 1;
                centre.step(now, Event::SolveFailed(job.pair));
            }
        }
    }
    assert_eq!(job_count, 20);
}

#[test]
fn recalibration_forgets_the_past_but_keeps_the_transform() {
    let mut traffic = good_traffic();
    let stamp = Stamp { boot: BootId(4), sequence: 0, sent_ns: 0 };
    let command = encode(stamp, &Command::Recalibrate { node: Some(id("n2")) }).unwrap();
    traffic.push(message("transmural/1/site/ops/command", command));
    let (centre, _) = stepped(&traffic);
    assert!(centre.gather.node(&id("n2")).unwrap().sets().is_empty());
    assert!(centre.poses.transform(&id("n2")).is_some());
}

#[test]
fn the_clock_is_told_to_whoever_asks() {
    let probe = ClockProbe { node: id("n1"), asked: NodeTime(5) };
    let bytes = encode(Stamp { boot: BootId(1), sequence: 0, sent_ns: 5 }, &probe).unwrap();
    let mut centre = Centre::new(config(), CENTRE);
    let delivery = message("transmural/1/site/up/n1/clock", bytes);
    let effects = centre.step(CentreTime(1300), Event::Delivered(delivery, CentreTime(1234)));
    let answers: Vec<ClockAnswer> = effects
        .iter()
        .filter_map(|effect| match effect {
            Effect::Publish(Topic::ClockAnswer(_), told) => Some(decode(told).unwrap().body),
            _ => None,
        })
        .collect();
    let expected = ClockAnswer { node: id("n1"), asked: NodeTime(5), answered: CentreTime(1234) };
    assert_eq!(answers, [expected]);
}
