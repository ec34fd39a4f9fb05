//! The wide-area side of the centre on the network: a loop of its own, sockets and files.

use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use proto::bus::{Bus, Delivery};
use proto::keys::Keys;
use tokio::net::UdpSocket;
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;
use tracing::{info, warn};

use super::Clock;
use crate::map::{MapCentre, MapEffect, MapEvent, Messages, OutputConfig, Shown, udp_address};
use crate::replace;

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
            replace::check_writable(&format!("wide.output.{key}"), path)?;
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
        // Each by itself: a network that is down keeps no file from being written.
        let done = [
            self.send_cot(shown).await.context("wide.output.cot"),
            self.send_cat062(shown).await.context("wide.output.cat062"),
            self.write(shown).await,
        ];
        for failure in done.into_iter().filter_map(Result::err) {
            self.failure_count += 1;
            if self.failure_count.is_power_of_two() {
                let count = self.failure_count;
                warn!(count, "tracks not shown: {failure:#}");
            }
        }
    }

    async fn send_cot(&self, shown: &Shown) -> anyhow::Result<()> {
        let Some(sink) = &self.cot else { return Ok(()) };
        Ok(sink.send(&self.messages.cot(shown)?).await?)
    }

    async fn send_cat062(&mut self, shown: &Shown) -> anyhow::Result<()> {
        let Some(sink) = &self.cat062 else { return Ok(()) };
        Ok(sink.send(&self.messages.cat062(shown)?).await?)
    }

    async fn write(&self, shown: &Shown) -> anyhow::Result<()> {
        let files = self.messages.files(shown)?;
        let written = tokio::task::spawn_blocking(move || {
            let write = |(path, text): &(PathBuf, String)| {
                let done = replace::show(path, text.as_bytes());
                done.with_context(|| format!("writing {}", path.display())).err()
            };
            files.iter().filter_map(write).next_back()
        });
        written.await.context("writing tracks")?.map_or(Ok(()), Err)
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
        let mut done = Ok(());
        for datagram in datagrams {
            // One that does not go keeps no other back.
            let sent = self.socket.send_to(datagram, self.to).await;
            done = sent.map(|_| ()).and(done);
        }
        done
    }
}
