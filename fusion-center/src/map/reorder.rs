//! What several sensors send, late and out of order, put into the order of its times.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use proto::ids::{BootId, NodeId};
use proto::time::CentreTime;

/// Sequence numbers remembered of each sensor, to know what comes twice.
const REMEMBERED_COUNT: usize = 4096;

/// A time farther ahead of its sensor's newest than this is not believed until another of about the same
/// time comes from that sensor, seconds. One wrong date, once believed, would make all that follows late;
/// dwells follow one another in seconds, and after a longer pause the second is soon there.
const LEAP_S: f64 = 3600.0;

/// How long is waited, and for whom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Patience {
    /// Nothing waits longer for what may come before it.
    pub max_wait: Duration,
    /// A sensor not heard for this long is not waited for.
    pub silent_after: Duration,
    /// Sensors beyond this number are refused.
    pub max_sensor_count: usize,
    /// Beyond this number the oldest goes on without waiting.
    pub max_waiting_count: usize,
}

/// What became of something that came.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Offer {
    /// It waits for its turn.
    Kept,
    /// Its time is far ahead of all before: it waits for another of its sensor to agree.
    Held,
    /// Later ones have gone on already.
    Late,
    /// It came before.
    Duplicate,
    /// One sensor too many.
    Crowded,
}

/// Where something comes from: its sensor, the sensor's life, and its number there.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Origin {
    /// Which sensor.
    pub node: NodeId,
    /// Which of its lives.
    pub boot: BootId,
    /// Which of its messages in that life.
    pub sequence: u64,
}

/// Holds what came until nothing earlier is awaited.
///
/// Something goes on when every sensor that is not silent has sent something of the same time or
/// later: each sensor is taken to send in the order of its times. It also goes on when it has waited
/// for [`Patience::max_wait`], whatever is missing. At the start, while not all sensors are known,
/// the first waits for so long in any case.
///
/// A sensor's time that leaps ahead by more than an hour counts only once the next one agrees; if that
/// is back where the sensor was, the leap is dropped: see [`Reorder::take_refuted`].
#[derive(Clone, Debug)]
pub struct Reorder<T> {
    patience: Patience,
    sensors: BTreeMap<NodeId, Sensor<T>>,
    /// By the time's place in the total order of numbers.
    waiting: BTreeMap<(TotalTime, Origin), Waiting<T>>,
    first_arrival: Option<CentreTime>,
    released_s: Option<f64>,
    /// The time of a leap that was dropped and not told yet.
    refuted_s: Option<f64>,
}

#[derive(Clone, Debug)]
struct Sensor<T> {
    boot: BootId,
    heard: CentreTime,
    newest_s: f64,
    /// The newest time of its former life: what comes again was taken then.
    former_s: Option<f64>,
    sequences: BTreeSet<u64>,
    /// What has a time far ahead, until another agrees.
    held: Option<(f64, Origin, Waiting<T>)>,
}

#[derive(Clone, Debug)]
struct Waiting<T> {
    arrived: CentreTime,
    item: T,
}

/// A finite time, in order.
#[derive(Clone, Copy, Debug)]
struct TotalTime(f64);

impl PartialEq for TotalTime {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for TotalTime {}

impl PartialOrd for TotalTime {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for TotalTime {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

impl<T> Reorder<T> {
    /// Holds nothing yet.
    #[must_use]
    pub fn new(patience: Patience) -> Self {
        Self {
            patience,
            sensors: BTreeMap::new(),
            waiting: BTreeMap::new(),
            first_arrival: None,
            released_s: None,
            refuted_s: None,
        }
    }

    /// Takes something of the time `time_s` that arrived at `arrived`.
    pub fn offer(&mut self, arrived: CentreTime, origin: Origin, time_s: f64, item: T) -> Offer {
        let is_known = self.sensors.contains_key(&origin.node);
        if !is_known && self.patience.max_sensor_count <= self.sensors.len() {
            return Offer::Crowded;
        }
        let new = || Sensor {
            boot: origin.boot,
            heard: arrived,
            newest_s: time_s,
            former_s: None,
            sequences: BTreeSet::new(),
            held: None,
        };
        let sensor = self.sensors.entry(origin.node.clone()).or_insert_with(new);
        if sensor.boot != origin.boot {
            let former_s = sensor.former_s.map_or(sensor.newest_s, |s| s.max(sensor.newest_s));
            *sensor = Sensor { former_s: Some(former_s), ..new() };
        }
        sensor.heard = sensor.heard.max(arrived);
        if !sensor.remember(origin.sequence) {
            return Offer::Duplicate;
        }
        let waiting = Waiting { arrived, item };
        let held = sensor.held.take();
        let is_leap = sensor.newest_s + LEAP_S < time_s;
        let (agreed, refuted) = match held {
            Some(one) if is_leap && (one.0 - time_s).abs() <= LEAP_S => (Some(one), None),
            other => (None, other),
        };
        self.refuted_s = refuted.map(|(refuted_s, ..)| refuted_s).or(self.refuted_s);
        if is_leap && agreed.is_none() {
            sensor.held = Some((time_s, origin, waiting));
            return Offer::Held;
        }
        if let Some((before_s, its_origin, its_waiting)) = agreed {
            self.admit(before_s, its_origin, its_waiting);
        }
        self.admit(time_s, origin, waiting)
    }

    /// Lets something wait for its turn, unless it is late.
    fn admit(&mut self, time_s: f64, origin: Origin, waiting: Waiting<T>) -> Offer {
        let Some(sensor) = self.sensors.get_mut(&origin.node) else { return Offer::Crowded };
        sensor.newest_s = sensor.newest_s.max(time_s);
        let is_again = sensor.former_s.is_some_and(|former_s| time_s <= former_s);
        if is_again || self.released_s.is_some_and(|released_s| time_s < released_s) {
            return Offer::Late;
        }
        self.first_arrival.get_or_insert(waiting.arrived);
        self.waiting.insert((TotalTime(time_s), origin), waiting);
        Offer::Kept
    }

    /// The time of something that was held and then dropped, since the next of its sensor was back at
    /// the time before; once for each.
    pub fn take_refuted(&mut self) -> Option<f64> {
        self.refuted_s.take()
    }

    /// What goes on at `now`, in the order of its times.
    pub fn release(&mut self, now: CentreTime) -> Vec<T> {
        let limit_s = self.limit_s(now);
        let mut released = Vec::new();
        while let Some(((time, origin), waiting)) = self.waiting.pop_first() {
            let is_due = limit_s.is_some_and(|limit_s| time.0 <= limit_s);
            if !is_due && self.waiting.len() < self.patience.max_waiting_count {
                self.waiting.insert((time, origin), waiting);
                break;
            }
            self.released_s = Some(time.0);
            released.push(waiting.item);
        }
        released
    }

    /// Everything that still waits, in the order of its times: nothing else comes, and what was held is
    /// as good as any.
    pub fn finish(&mut self) -> Vec<T> {
        let held = self.sensors.values_mut().filter_map(|sensor| sensor.held.take());
        for (time_s, origin, waiting) in held.collect::<Vec<_>>() {
            self.admit(time_s, origin, waiting);
        }
        let rest = std::mem::take(&mut self.waiting);
        if let Some(((time, _), _)) = rest.last_key_value() {
            self.released_s = Some(time.0);
        }
        rest.into_values().map(|waiting| waiting.item).collect()
    }

    /// How many wait.
    #[must_use]
    pub fn waiting_count(&self) -> usize {
        self.waiting.len()
    }

    /// Up to which time everything goes on.
    fn limit_s(&self, now: CentreTime) -> Option<f64> {
        let Patience { max_wait, silent_after, .. } = self.patience;
        let has_waited = |since: CentreTime| max_wait <= now.since(since);
        let overdue = self.waiting.iter().rev().find(|(_, one)| has_waited(one.arrived));
        let overdue_s = overdue.map(|((time, _), _)| time.0);
        let is_awaited = |sensor: &&Sensor<T>| now.since(sensor.heard) < silent_after;
        let awaited = self.sensors.values().filter(is_awaited);
        let complete_s = awaited.map(|sensor| sensor.newest_s).reduce(f64::min);
        let complete_s = complete_s.filter(|_| self.first_arrival.is_some_and(has_waited));
        match (overdue_s, complete_s) {
            (Some(one_s), Some(other_s)) => Some(one_s.max(other_s)),
            (one_s, other_s) => one_s.or(other_s),
        }
    }
}

impl<T> Sensor<T> {
    /// False if it is known already, or so old that it may be.
    fn remember(&mut self, sequence: u64) -> bool {
        let is_full = REMEMBERED_COUNT <= self.sequences.len();
        if is_full && self.sequences.first().is_some_and(|oldest| sequence < *oldest) {
            return false;
        }
        let is_new = self.sequences.insert(sequence);
        if is_new && is_full {
            self.sequences.pop_first();
        }
        is_new
    }
}

#[cfg(test)]
mod tests {
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    use super::*;

    const PATIENCE: Patience = Patience {
        max_wait: Duration::from_secs(2),
        silent_after: Duration::from_secs(10),
        max_sensor_count: 4,
        max_waiting_count: 100,
    };

    fn at(seconds: f64) -> CentreTime {
        #[expect(clippy::cast_possible_truncation, reason = "small whole nanoseconds")]
        let ns = (seconds * 1e9).round() as i64;
        CentreTime(ns)
    }

    fn origin(name: &str, sequence: u64) -> Origin {
        Origin { node: name.parse().unwrap(), boot: BootId(1), sequence }
    }

    #[test]
    fn one_sensor_is_not_kept_waiting_after_the_start() {
        let mut order = Reorder::new(PATIENCE);
        assert_eq!(order.offer(at(0.0), origin("a", 0), 100.0, 0), Offer::Kept);
        assert!(order.release(at(1.9)).is_empty(), "others may be about to speak");
        assert_eq!(order.release(at(2.0)), [0]);
        assert_eq!(order.offer(at(3.0), origin("a", 1), 101.0, 1), Offer::Kept);
        assert_eq!(order.release(at(3.0)), [1]);
        assert_eq!(order.waiting_count(), 0);
    }

    #[test]
    fn nothing_goes_on_before_the_slowest_sensor_and_nobody_waits_for_the_silent() {
        let mut order = Reorder::new(PATIENCE);
        order.offer(at(0.0), origin("a", 0), 10.0, "a10");
        order.offer(at(0.0), origin("b", 0), 9.0, "b9");
        assert_eq!(order.release(at(2.0)), ["b9", "a10"]);
        order.offer(at(3.0), origin("a", 1), 12.0, "a12");
        assert!(order.release(at(4.9)).is_empty());
        order.offer(at(4.9), origin("b", 1), 11.0, "b11");
        assert_eq!(order.release(at(4.9)), ["b11"]);
        assert_eq!(order.release(at(5.0)), ["a12"], "it has waited for two seconds");
        // b is silent now: a alone sets the pace.
        order.offer(at(16.0), origin("a", 2), 20.0, "a20");
        assert_eq!(order.release(at(16.0)), ["a20"]);
    }

    #[test]
    fn what_comes_too_late_or_twice_is_told_apart() {
        let mut order = Reorder::new(PATIENCE);
        order.offer(at(0.0), origin("a", 0), 10.0, ());
        order.offer(at(0.0), origin("a", 1), 11.0, ());
        assert_eq!(order.offer(at(0.5), origin("a", 0), 10.0, ()), Offer::Duplicate);
        assert_eq!(order.release(at(2.0)).len(), 2);
        assert_eq!(order.offer(at(2.1), origin("b", 0), 10.5, ()), Offer::Late);
        assert_eq!(order.offer(at(2.1), origin("b", 0), 10.5, ()), Offer::Duplicate);
        // The same time as the newest is not late: several sensors may look at once.
        assert_eq!(order.offer(at(2.2), origin("b", 1), 11.0, ()), Offer::Kept);
        // A new life counts from zero, and does not say again what the former one has said.
        let reborn = |sequence| Origin { boot: BootId(2), ..origin("a", sequence) };
        assert_eq!(order.offer(at(2.3), reborn(0), 11.0, ()), Offer::Late);
        assert_eq!(order.offer(at(2.3), reborn(1), 12.0, ()), Offer::Kept);
        for name in ["c", "d"] {
            assert_eq!(order.offer(at(2.4), origin(name, 0), 12.0, ()), Offer::Kept);
        }
        assert_eq!(order.offer(at(2.4), origin("e", 0), 12.0, ()), Offer::Crowded);
    }

    #[test]
    fn a_leap_counts_once_another_agrees() {
        let mut order = Reorder::new(PATIENCE);
        let mut offer = |number: u64, time_s: f64| {
            let now = at(10.0 + number as f64);
            let offered = order.offer(now, origin("a", number), time_s, number);
            (offered, order.release(now), order.take_refuted())
        };
        assert_eq!(offer(0, 1000.0), (Offer::Kept, vec![], None));
        assert_eq!(offer(2, 1004.0), (Offer::Kept, vec![0, 2], None));
        // A year ahead, alone: what follows is not late for it.
        let year_s = 1000.0 + 3.2e7;
        assert_eq!(offer(3, year_s), (Offer::Held, vec![], None));
        assert_eq!(offer(4, 1008.0), (Offer::Kept, vec![4], Some(year_s)));
        // A day later, twice: there was a pause.
        assert_eq!(offer(5, 87_400.0), (Offer::Held, vec![], None));
        assert_eq!(offer(6, 87_404.0), (Offer::Kept, vec![5, 6], None));
        // At the end of the input nothing can speak against it.
        assert_eq!(offer(7, year_s), (Offer::Held, vec![], None));
        assert_eq!(order.finish(), [7]);
    }

    #[test]
    fn memory_is_bounded() {
        let patience = Patience { max_waiting_count: 10, ..PATIENCE };
        let mut order = Reorder::new(patience);
        for number in 0..20_000_u64 {
            order.offer(at(0.0), origin("a", number), 1.0 + number as f64, number);
            order.release(at(0.0));
            assert!(order.waiting_count() <= 10);
        }
        assert_eq!(order.sensors["a".parse::<NodeId>().as_ref().unwrap()].sequences.len(), 4096);
        assert_eq!(order.offer(at(0.0), origin("a", 3), 1e6, 0), Offer::Duplicate);
        let rest = order.finish();
        assert!(rest.len() == 10 && rest.is_sorted());
        assert_eq!(order.waiting_count(), 0);
    }

    /// Three sensors with delays of up to 1.5 s: less than the patience, so that sorting all times is
    /// the answer.
    #[test]
    fn late_and_out_of_order_comes_out_as_sorting_would_have_it() {
        let sent = |name: &str, random: &mut ChaCha8Rng| {
            let mut arrived_s: f64 = 0.0;
            let mut one = |number: u64| {
                let time_s = 50.0 + 0.1 * number as f64 + random.random_range(0.0..0.09);
                // One link keeps the order of what it carries.
                arrived_s = arrived_s.max(time_s - 50.0 + random.random_range(0.0..1.5));
                (arrived_s, origin(name, number), time_s)
            };
            (0..200).map(&mut one).collect::<Vec<_>>()
        };
        for seed in 0..20 {
            let mut random = ChaCha8Rng::seed_from_u64(seed);
            let mut arrivals = Vec::new();
            for name in ["a", "b", "c"] {
                arrivals.extend(sent(name, &mut random));
            }
            arrivals.sort_by(|one, other| one.0.total_cmp(&other.0));
            let mut order = Reorder::new(PATIENCE);
            let mut released = Vec::new();
            for (arrived_s, from, time_s) in &arrivals {
                let now = at(*arrived_s);
                assert_eq!(order.offer(now, from.clone(), *time_s, *time_s), Offer::Kept);
                released.extend(order.release(now));
            }
            released.extend(order.finish());
            let mut expected: Vec<f64> = arrivals.iter().map(|(_, _, time_s)| *time_s).collect();
            expected.sort_by(f64::total_cmp);
            assert!(released == expected, "seed {seed}");
        }
    }
}
