//! What comes down: the centre's clock and this node's transform.

use std::collections::VecDeque;
use std::time::Duration;

use proto::bus::{BusEvent, Delivery};
use proto::ids::NodeId;
use proto::keys::{Keys, Topic};
use proto::refusals::Refusals;
use proto::time::{ClockEstimate, ClockFilter, Exchange};
use proto::wire::{ClockAnswer, LatencyReport, Received, Refusal, Registration, decode};
use tokio::sync::{mpsc, watch};
use tracing::info;

use super::uplink::Sender;

/// Latencies kept for the report.
const LATENCY_COUNT: usize = 8192;

/// What the node knows from the centre about itself.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Heard {
    pub(super) transform_epoch: Option<u64>,
    pub(super) latency: Option<LatencyReport>,
}

/// Longest way of a question and its answer that is believed.
const ANSWER_LIMIT: Duration = Duration::from_secs(5);

/// Takes deliveries until the bus is gone.
pub(super) struct Downlink {
    keys: Keys,
    sender: Sender,
    estimate: watch::Sender<Option<ClockEstimate>>,
    heard: watch::Sender<Heard>,
    filter: ClockFilter,
    latencies: Latencies,
    refusals: Refusals,
}

impl Downlink {
    pub(super) fn new(
        keys: Keys,
        sender: Sender,
        estimate: watch::Sender<Option<ClockEstimate>>,
        heard: watch::Sender<Heard>,
    ) -> Self {
        let (filter, latencies) = (ClockFilter::default(), Latencies::default());
        let refusals = Refusals::default();
        Self { keys, sender, estimate, heard, filter, latencies, refusals }
    }

    pub(super) async fn run(mut self, mut deliveries: mpsc::Receiver<Delivery>) {
        while let Some(delivery) = deliveries.recv().await {
            if let Err((label, reason)) = self.take(&delivery) {
                self.refusals.count(&delivery.key, label, &reason);
            }
        }
    }

    /// Takes one delivery, or says with a label and in full why not.
    fn take(&mut self, delivery: &Delivery) -> Result<(), (&'static str, String)> {
        let bytes = match &delivery.event {
            BusEvent::Message(bytes) => bytes,
            BusEvent::Oversized(length) => {
                return Err(("oversized", format!("{length} bytes, more than any message has")));
            }
            BusEvent::Appeared | BusEvent::Vanished => return Ok(()),
        };
        let refused = |refusal: Refusal| (refusal.label(), refusal.to_string());
        match self.keys.parse(&delivery.key) {
            Ok(Topic::ClockAnswer(_)) => self.on_answer(&decode(bytes).map_err(refused)?),
            Ok(Topic::Transform(_)) => self.on_transform(&decode(bytes).map_err(refused)?),
            _ => Ok(()),
        }
    }

    fn check_addressee(&self, node: &NodeId) -> Result<(), (&'static str, String)> {
        if *node == self.sender.node {
            return Ok(());
        }
        Err(("impostor", format!("it speaks of node {node} under the key of {}", self.sender.node)))
    }

    fn on_answer(&mut self, answer: &Received<ClockAnswer>) -> Result<(), (&'static str, String)> {
        let ClockAnswer { node, asked, answered } = &answer.body;
        self.check_addressee(node)?;
        let received = self.sender.clock.now();
        let away = received.0.checked_sub(asked.0).map(Duration::from_nanos);
        if away.is_none_or(|away| ANSWER_LIMIT < away) {
            return Err((
                "unasked",
                format!("answers a question of {asked:?}, now is {received:?}"),
            ));
        }
        let centre_boot = answer.stamp.boot;
        self.filter.add(&Exchange { asked: *asked, answered: *answered, received, centre_boot });
        let known = self.estimate.borrow().map(|estimate| estimate.centre_boot);
        if known != Some(centre_boot) {
            info!(%centre_boot, "joined the centre's clock");
        }
        self.estimate.send_replace(self.filter.estimate(received));
        Ok(())
    }

    fn on_transform(
        &mut self,
        received: &Received<Registration>,
    ) -> Result<(), (&'static str, String)> {
        let Registration { node, transform, sets, .. } = &received.body;
        self.check_addressee(node)?;
        let estimate = *self.estimate.borrow();
        if let (Some(sets), Some(estimate), Some(_)) = (sets, estimate, transform)
            && sets.boot == self.sender.boot
            && estimate.centre_boot == received.stamp.boot
        {
            let now = self.sender.clock.now().to_centre(&estimate);
            let waited_ms = now.since(sets.last_arrival).as_secs_f64() * 1e3;
            self.latencies.add(sets.last_sequence, waited_ms);
        }
        let before = self.heard.borrow().transform_epoch;
        if let (Some(transform), None) = (transform, before) {
            info!(pose = ?transform.pose_ref_from_node, "own transform received");
        }
        let transform_epoch = transform.map(|transform| transform.epoch).or(before);
        let latency = self.latencies.report();
        self.heard.send_replace(Heard { transform_epoch, latency });
        Ok(())
    }
}

#[derive(Debug, Default)]
struct Latencies {
    recent_ms: VecDeque<f64>,
    count: u64,
    timed_through: Option<u64>,
}

impl Latencies {
    /// Times the transform that first rests on set number `sequence`; the same one told again,
    /// for example after a reconnection, is not timed.
    fn add(&mut self, sequence: u64, latency_ms: f64) {
        if self.timed_through.is_some_and(|through| sequence <= through) {
            return;
        }
        self.timed_through = Some(sequence);
        self.count += 1;
        self.recent_ms.push_back(latency_ms);
        if LATENCY_COUNT < self.recent_ms.len() {
            self.recent_ms.pop_front();
        }
    }

    fn report(&self) -> Option<LatencyReport> {
        let mut sorted: Vec<f64> = self.recent_ms.iter().copied().collect();
        sorted.sort_by(f64::total_cmp);
        let last = sorted.len().checked_sub(1)?;
        let at = |hundredths: usize| sorted[(last * hundredths).div_ceil(100)];
        Some(LatencyReport {
            count: self.count,
            p50_ms: at(50),
            p99_ms: at(99),
            max_ms: sorted[last],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn latencies_are_ranked() {
        let mut latencies = Latencies::default();
        assert!(latencies.report().is_none());
        for sequence in 0..200 {
            latencies.add(sequence, 200.0 - sequence as f64);
            latencies.add(sequence, 1e6);
        }
        let report = latencies.report().unwrap();
        assert!((report.p50_ms - 101.0).abs() < 1.5 && (report.p99_ms - 199.0).abs() < 1.5);
        assert!((report.max_ms - 200.0).abs() < 1e-9 && report.count == 200);
    }

    #[tokio::test]
    async fn garbage_and_words_for_others_are_counted_and_change_nothing() {
        let clock = super::super::clock::Clock::start();
        let (boot, node) = (proto::ids::BootId(1), "n1".parse().unwrap());
        let (estimate, estimate_shown) = watch::channel(None);
        let (heard, heard_shown) = watch::channel(Heard::default());
        let keys = Keys::new("lab".parse().unwrap());
        let mut downlink = Downlink::new(keys, Sender { node, boot, clock }, estimate, heard);
        let answer = ClockAnswer {
            node: "n2".parse().unwrap(),
            asked: clock.now(),
            answered: proto::time::CentreTime(5),
        };
        let stamp = proto::wire::Stamp { boot, sequence: 0, sent_ns: 0 };
        let for_another = proto::wire::encode(stamp, &answer).unwrap();
        let mut refused = |key: &str, event: BusEvent| {
            let arrived = tokio::time::Instant::now();
            let delivery = Delivery { key: key.to_owned(), event, arrived };
            downlink.take(&delivery).unwrap_err().0
        };
        for key in ["transmural/1/lab/down/clock/n1", "transmural/1/lab/down/tf/n1"] {
            assert_eq!(refused(key, BusEvent::Message(b"garbage".to_vec())), "too_short");
            assert_eq!(refused(key, BusEvent::Message(vec![7; 900])), "foreign");
            assert_eq!(refused(key, BusEvent::Oversized(9_000_000)), "oversized");
        }
        let key = "transmural/1/lab/down/clock/n1";
        assert_eq!(refused(key, BusEvent::Message(for_another)), "impostor");
        assert!(estimate_shown.borrow().is_none() && heard_shown.borrow().latency.is_none());
    }
}
