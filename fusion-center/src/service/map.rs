//! The wide-area side of the centre on the network: a loop of its own, sockets and files.

use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use proto::bus::{Bus, Delivery};
use proto::keys::Keys;
use tokio::net::UdpSocket;
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;
use tracing::{info, warn};

use super::{Clock, state};
use crate::map::{MapCentre, MapEffect, MapEvent, Messages, OutputConfig, Shown, udp_address};

/// How often the map looks at the time when nothing comes.
const TICK: Duration = Duration::from_millis(50);

/// Parts dwells from everything else, so that following many targets never makes nodes wait. What one
/// of the two does not take in time is dropped and counted.
pub(super) async fn part(
    keys: Keys,
    mut from: mpsc::Receiver<Delivery>,
    others: mpsc::Sender<Delivery>,
    dwells: mpsc::Sender<Delivery>,
) {
    let mut dropped_count: u64 = 0;
    while let Some(delivery) = from.recv().await {
        let is_dwell = matches!(keys.parse(&delivery.key), Ok(proto::keys::Topic::Dwells(_)));
        if !is_dwell {
            // The inbox before counts what this loop does not take in time.
            if others.send(delivery).await.is_err() {
                return;
            }
            continue;
        }
        if dwells.try_send(delivery).is_err() {
            dropped_count += 1;
            if dropped_count.is_power_of_two() {
                warn!(dropped_count, "dwells dropped: the tracker does not keep up");
            }
        }
    }
}

/// Serves dwells until `stop` or until nobody delivers.
pub(super) async fn serve_map(
    mut centre: MapCentre,
    mut outputs: Outputs,
    bus: Arc<impl Bus>,
    mut deliveries: mpsc::Receiver<Delivery>,
    stop: CancellationToken,
) {
    let clock = Clock::start();
    let mut ticks = tokio::time::interval(TICK);
    ticks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    loop {
        let event = tokio::select! {
            () = stop.cancelled() => break,
            delivery = deliveries.recv() => match delivery {
                Some(delivery) => {
                    let arrived = clock.at(delivery.arrived);
                    MapEvent::Delivered(delivery, arrived)
                }
                None => break,
            },
            _ = ticks.tick() => MapEvent::Tick,
        };
        let effects = tokio::task::block_in_place(|| centre.step(clock.now(), event));
        carry_out(effects, bus.as_ref(), &mut outputs).await;
    }
    carry_out(centre.finish(clock.now()), bus.as_ref(), &mut outputs).await;
}

async fn carry_out(effects: Vec<MapEffect>, bus: &impl Bus, outputs: &mut Outputs) {
    for effect in effects {
        match effect {
            MapEffect::Publish(topic, bytes) => {
                if let Err(failure) = bus.publish(&topic, bytes).await {
                    warn!(%failure, "not published");
                }
            }
            MapEffect::Show(shown) => outputs.show(&shown).await,
        }
    }
}

/// Where tracks go besides the network.
pub(super) struct Outputs {
    messages: Messages,
    cot: Option<Sink>,
    cat062: Option<Sink>,
    failure_count: u64,
}

struct Sink {
    socket: UdpSocket,
    to: SocketAddr,
}

impl Outputs {
    /// Opens the sockets.
    ///
    /// # Errors
    /// If one cannot be opened, or a file not be written where it is configured.
    pub(super) async fn open(config: &OutputConfig) -> anyhow::Result<Self> {
        for (key, path) in
            [("geojson", &config.geojson), ("kml", &config.kml), ("csv", &config.csv)]
        {
            let Some(path) = path else { continue };
            state::check_writable(path).with_context(|| format!("wide.output.{key}"))?;
        }
        Ok(Self {
            messages: Messages::new(config.clone()),
            cot: Sink::open("wide.output.cot", &config.cot).await?,
            cat062: Sink::open("wide.output.cat062", &config.cat062).await?,
            failure_count: 0,
        })
    }

    /// Sends and writes what is shown; what fails is told and tried again the next time.
    async fn show(&mut self, shown: &Shown) {
        if let Err(failure) = self.try_show(shown).await {
            self.failure_count += 1;
            if self.failure_count.is_power_of_two() {
                let count = self.failure_count;
                warn!(count, "tracks not shown: {failure:#}");
            }
        }
    }

    async fn try_show(&mut self, shown: &Shown) -> anyhow::Result<()> {
        if let Some(sink) = &self.cot {
            sink.send(&self.messages.cot(shown)?).await.context("wide.output.cot")?;
        }
        if let Some(sink) = &self.cat062 {
            let blocks = self.messages.cat062(shown)?;
            sink.send(&blocks).await.context("wide.output.cat062")?;
        }
        let files = self.messages.files(shown)?;
        let written = tokio::task::spawn_blocking(move || {
            files.iter().try_for_each(|(path, text)| {
                state::write(path, text).with_context(|| format!("writing {}", path.display()))
            })
        });
        written.await.context("writing tracks")?
    }
}

impl Sink {
    async fn open(key: &str, text: &str) -> anyhow::Result<Option<Self>> {
        let Some(to) = udp_address(text) else { return Ok(None) };
        let own: SocketAddr = match to {
            SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
            SocketAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
        };
        let socket = UdpSocket::bind(own).await.with_context(|| format!("{key} = {text:?}"))?;
        info!(%key, %to, "tracks are sent");
        Ok(Some(Self { socket, to }))
    }

    async fn send(&self, datagrams: &[Vec<u8>]) -> std::io::Result<()> {
        for datagram in datagrams {
            self.socket.send_to(datagram, self.to).await?;
        }
        Ok(())
    }
}
