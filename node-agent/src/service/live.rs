//! The live source: raw sweeps that a radar's driver sends over a Zenoh link of its own.
//!
//! The agent listens, the driver dials and puts sweeps ([`RawSweep`]) on the node's key. The link is
//! apart from the one to the centre, so that raw data stay on this machine (or this wire).

use anyhow::Context;
use proto::bus::{Bus, BusEvent, Delivery, ZenohBus};
use proto::config::BusConfig;
use proto::keys::{Keys, Pattern};
use proto::refusals::Refusals;
use proto::time::NodeTime;
use proto::wire::RawSweep;
use tokio::sync::mpsc;
use tracing::{info, warn};

use super::clock::Clock;
use crate::config::AgentConfig;
use crate::imaging::Sweep;

/// Sweeps that may wait to be measured; a chain that is slower than its radar loses the newest.
const WAITING_COUNT: usize = 64;

/// So many sweeps can be lost; more are not believed.
const MAX_GAP: u64 = 100_000;

/// A sweep with its place in time.
pub(super) struct LiveSweep {
    /// The sweep, its time in seconds of this node's clock.
    pub(super) sweep: Sweep,
    /// When it was taken.
    pub(super) taken: NodeTime,
    /// Sweeps lost since the one before.
    pub(super) lost_count: u64,
}

/// Takes sweeps in.
pub(super) struct Live {
    config: AgentConfig,
    clock: Clock,
    driver: DriverClock,
    last_sequence: Option<u64>,
    refusals: Refusals,
    bus: ZenohBus,
    deliveries: mpsc::Receiver<Delivery>,
}

impl Live {
    /// Opens the port that the driver dials.
    pub(super) async fn open(config: &AgentConfig, clock: Clock) -> anyhow::Result<Self> {
        let listen = vec![config.live.listen.clone()];
        let link = BusConfig {
            listen,
            connect: Vec::new(),
            inbox_count: WAITING_COUNT,
            history_count: WAITING_COUNT,
        };
        let patterns = [Pattern::Sweeps(config.node.clone())];
        let keys = Keys::new(config.site.clone());
        let key = keys.expression(&patterns[0]);
        let opened = ZenohBus::open(&link, keys, &patterns).await;
        let (bus, deliveries) = opened.context("configuration: live.listen")?;
        info!(listen = %config.live.listen, %key, "waiting for sweeps");
        let (driver, refusals) = (DriverClock::default(), Refusals::default());
        let config = config.clone();
        Ok(Self { config, clock, driver, last_sequence: None, refusals, bus, deliveries })
    }

    /// The next sweep, or `None` for one that was refused. Waits; never ends by itself.
    pub(super) async fn next(&mut self) -> Option<LiveSweep> {
        let Some(delivery) = self.deliveries.recv().await else {
            return std::future::pending().await;
        };
        let taken = self.take(&delivery);
        taken
            .map_err(|(label, reason)| self.refusals.count(&delivery.key, label, &reason))
            .ok()
            .flatten()
    }

    pub(super) async fn close(&self) {
        self.bus.close().await;
    }

    fn take(&mut self, delivery: &Delivery) -> Result<Option<LiveSweep>, (&'static str, String)> {
        let bytes = match &delivery.event {
            BusEvent::Message(bytes) => bytes,
            BusEvent::Oversized(length) => {
                let most = RawSweep::MAX_SAMPLE_COUNT;
                return Err(("oversized", format!("{length} bytes; at most {most} samples")));
            }
            BusEvent::Appeared | BusEvent::Vanished => return Ok(None),
        };
        let chain = &self.config.chain;
        let raw = RawSweep::from_bytes(bytes)
            .and_then(|raw| raw.check_radar(&chain.band, &chain.array).map(|()| raw))
            .map_err(|refusal| (refusal.label(), refusal.to_string()))?;
        let arrived = self.clock.of_instant(delivery.arrived);
        let taken = self.driver.node_time(raw.taken_ns, arrived);
        let expected = self.last_sequence.map(|last| last.saturating_add(1));
        let gap = expected.map_or(0, |expected| raw.sequence.saturating_sub(expected));
        // A greater leap is a driver that counts anew.
        let lost_count = if gap < MAX_GAP { gap } else { 0 };
        if 0 < lost_count {
            warn!(lost_count, sequence = raw.sequence, "sweeps were lost on the way");
        }
        self.last_sequence = Some(raw.sequence);
        let sweep = Sweep { time_s: taken.0 as f64 * 1e-9, samples: raw.samples };
        Ok(Some(LiveSweep { sweep, taken, lost_count }))
    }
}

/// The driver's clock on the node's: a sweep was taken no later than it arrived, and the quickest
/// one so far tells the offset best.
#[derive(Debug, Default)]
struct DriverClock {
    last: Option<Mapped>,
}

#[derive(Clone, Copy, Debug)]
struct Mapped {
    driver_ns: u64,
    node_ns: u64,
    offset_ns: i128,
}

/// A driver's clock that is this far off what it was has been started anew.
const JUMP_NS: i128 = 5_000_000_000;

/// Clocks run apart by less than one part in this many: 200 ppm.
const MAX_SKEW: i128 = 5_000;

impl DriverClock {
    /// When a sweep was taken; later than the one before, whatever the driver says.
    fn node_time(&mut self, driver_ns: u64, arrived: NodeTime) -> NodeTime {
        let now_offset_ns = i128::from(arrived.0) - i128::from(driver_ns);
        let known = self.last.filter(|last| {
            last.driver_ns < driver_ns && (now_offset_ns - last.offset_ns).abs() < JUMP_NS
        });
        let offset_ns = known.map_or(now_offset_ns, |last| {
            let slack_ns = i128::from(driver_ns - last.driver_ns) / MAX_SKEW;
            now_offset_ns.min(last.offset_ns + slack_ns)
        });
        let mapped_ns = u64::try_from(i128::from(driver_ns) + offset_ns).unwrap_or(0);
        let node_ns = self.last.map_or(mapped_ns, |last| mapped_ns.max(last.node_ns + 1000));
        self.last = Some(Mapped { driver_ns, node_ns, offset_ns });
        NodeTime(node_ns)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drivers_clock_is_known_from_its_quickest_sweep_and_a_new_driver_starts_afresh() {
        let mut clock = DriverClock::default();
        let mut taken = |driver_ns, arrived_ns| clock.node_time(driver_ns, NodeTime(arrived_ns)).0;
        assert_eq!(taken(1_000_000, 51_000_000), 51_000_000);
        // This one was on its way for 3 ms less than the first ...
        assert_eq!(taken(101_000_000, 148_000_000), 148_000_000);
        // ... and that one 20 ms longer: it was taken 100 ms after the one before, or 20 us more, if
        // the driver's clock is slow.
        assert_eq!(taken(201_000_000, 268_000_000), 248_020_000);
        // A driver that starts again counts from zero.
        assert_eq!(taken(5_000, 900_000_000), 900_000_000);
        // Time never stands or goes back.
        assert_eq!(taken(6_000, 900_000_100), 900_001_000);
        assert!(900_001_000 < taken(5_000, 900_000_200));
    }
}
