//! A driver in software: plays the configured source to an agent's live intake.

use anyhow::bail;
use proto::bus::{Bus, ZenohBus};
use proto::config::BusConfig;
use proto::keys::{Keys, Topic};
use proto::radar::Band;
use proto::wire::RawSweep;
use tokio_util::sync::CancellationToken;
use tracing::info;

use super::clock::Clock;
use crate::config::{AgentConfig, Opened};
use crate::source::Frame;

/// Sends the sweeps of the configured source to the agent that listens at `endpoint`, in the
/// source's own time over `play.speed`, until it ends or `stop`.
///
/// # Errors
/// If the source cannot be opened or holds no sweeps, or nobody listens at `endpoint`.
pub async fn feed(
    config: AgentConfig,
    endpoint: &str,
    stop: CancellationToken,
) -> anyhow::Result<()> {
    let Opened { config, mut source, .. } = config.open_source()?;
    let link = BusConfig { connect: vec![endpoint.to_owned()], ..BusConfig::default() };
    let (bus, _deliveries) = ZenohBus::open(&link, Keys::new(config.site.clone()), &[]).await?;
    let topic = Topic::Sweeps(config.node.clone());
    let clock = Clock::start();
    let radar = Radar::of(&config)?;
    let mut sent_count = 0;
    for period in 0..source.period_count().unwrap_or(u64::MAX) {
        let due_s = source.middle_s(period) / config.play.speed;
        tokio::select! {
            () = stop.cancelled() => break,
            () = tokio::time::sleep_until(clock.after_s(due_s)) => {}
        }
        let Frame::Sweep(sweep) = source.frame(period)? else {
            bail!(
                "source {:?} holds detections, not sweeps: use simulated or echoes",
                config.source
            )
        };
        let raw = RawSweep {
            sequence: period,
            taken_ns: clock.now().0,
            tx_count: radar.tx_count,
            rx_count: radar.rx_count,
            band: radar.band,
            samples: sweep.samples,
        };
        bus.publish(&topic, raw.to_bytes()).await?;
        sent_count += 1;
    }
    info!(sent_count, %endpoint, "the source has ended");
    bus.close().await;
    Ok(())
}

/// What every sweep says of its radar.
struct Radar {
    tx_count: u16,
    rx_count: u16,
    band: Band,
}

impl Radar {
    fn of(config: &AgentConfig) -> anyhow::Result<Self> {
        let array = &config.chain.array;
        let count = |antennas: &[[f64; 2]]| u16::try_from(antennas.len());
        let (tx_count, rx_count) = (count(&array.tx_m)?, count(&array.rx_m)?);
        let sample_count = array.channel_count() * config.chain.band.step_count;
        if RawSweep::MAX_SAMPLE_COUNT < sample_count {
            let most = RawSweep::MAX_SAMPLE_COUNT;
            bail!("a sweep of {sample_count} samples is too large to send: at most {most}")
        }
        Ok(Self { tx_count, rx_count, band: config.chain.band })
    }
}
