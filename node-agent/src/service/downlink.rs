//! What comes down: the centre's clock and this node's transform.

use std::collections::VecDeque;

use proto::bus::{BusEvent, Delivery};
use proto::ids::BootId;
use proto::keys::{Keys, Topic};
use proto::time::{ClockEstimate, ClockFilter, Exchange};
use proto::wire::{ClockAnswer, LatencyReport, Outcome, Received, Refusal, Registration, decode};
use tokio::sync::{mpsc, watch};
use tracing::{info, warn};

use super::clock::Clock;

/// Latencies kept for the report.
const LATENCY_COUNT: usize = 8192;

/// What the node knows from the centre about itself.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Heard {
    pub(super) transform_epoch: Option<u64>,
    pub(super) latency: Option<LatencyReport>,
}

/// Takes deliveries until the bus is gone.
pub(super) struct Downlink {
    pub(super) keys: Keys,
    pub(super) boot: BootId,
    pub(super) clock: Clock,
    pub(super) estimate: watch::Sender<Option<ClockEstimate>>,
    pub(super) heard: watch::Sender<Heard>,
}

impl Downlink {
    pub(super) async fn run(self, mut deliveries: mpsc::Receiver<Delivery>) {
        let mut filter = ClockFilter::default();
        let mut latencies = Latencies::default();
        while let Some(delivery) = deliveries.recv().await {
            let BusEvent::Message(bytes) = &delivery.event else { continue };
            let taken = match self.keys.parse(&delivery.key) {
                Ok(Topic::ClockAnswer(_)) => {
                    decode(bytes).map(|answer| self.on_answer(&mut filter, &answer))
                }
                Ok(Topic::Transform(_)) => {
                    decode(bytes).map(|transform| self.on_transform(&mut latencies, &transform))
                }
                _ => continue,
            };
            if let Err(refusal) = taken {
                let refusal: Refusal = refusal;
                warn!(key = %delivery.key, label = refusal.label(), %refusal, "message refused");
            }
        }
    }

    fn on_answer(&self, filter: &mut ClockFilter, answer: &Received<ClockAnswer>) {
        let ClockAnswer { asked, answered, .. } = answer.body;
        let received = self.clock.now();
        if received < asked {
            return;
        }
        let centre_boot = answer.stamp.boot;
        filter.add(&Exchange { asked, answered, received, centre_boot });
        let known = self.estimate.borrow().map(|estimate| estimate.centre_boot);
        if known != Some(centre_boot) {
            info!(%centre_boot, "joined the centre's clock");
        }
        self.estimate.send_replace(filter.estimate());
    }

    fn on_transform(&self, latencies: &mut Latencies, received: &Received<Registration>) {
        let Registration { transform, outcome, sets, .. } = &received.body;
        let estimate = *self.estimate.borrow();
        if let (Some(sets), Some(estimate)) = (sets, estimate)
            && sets.boot == self.boot
            && estimate.centre_boot == received.stamp.boot
            && transform.is_some()
        {
            let now = self.clock.now().to_centre(&estimate);
            latencies.add(sets.last_sequence, now.since(sets.last_arrival).as_secs_f64() * 1e3);
        }
        let epoch = transform.map(|transform| transform.epoch);
        let before = self.heard.borrow().transform_epoch;
        match transform {
            Some(transform) if before.is_none() => {
                info!(pose = ?transform.pose_ref_from_node, "own transform received");
            }
            None if before.is_none() && *outcome != Outcome::Determined => {
                tracing::debug!(?outcome, "not registered yet");
            }
            _ => {}
        }
        self.heard
            .send_replace(Heard { transform_epoch: epoch.or(before), latency: latencies.report() });
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
}
