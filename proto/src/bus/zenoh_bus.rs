//! The bus over Zenoh: a star in which one process listens and everybody else dials.
//!
//! Multicast and gossip are off, endpoints are explicit, compression is not built in. Uplink
//! messages of class [`Class::GapFree`] block (so a dedicated task must send them) and are cached
//! for recovery; everything else is dropped where the network is slow.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{Mutex, mpsc};
use tracing::{debug, warn};
use zenoh::qos::CongestionControl;
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Config, Session};
use zenoh_ext::{
    AdvancedPublisher, AdvancedPublisherBuilderExt, AdvancedSubscriberBuilderExt, CacheConfig,
    HistoryConfig, MissDetectionConfig, RecoveryConfig,
};

use super::{Bus, BusError, BusEvent, Class, Delivery, Inbox};
use crate::config::BusConfig;
use crate::keys::{Keys, Pattern, Topic};
use crate::wire::{HEADER_BYTES, MAX_PAYLOAD_BYTES};

/// A publisher tells its last sequence number this often, so that a lost last message is noticed.
const HEARTBEAT: Duration = Duration::from_millis(500);
/// Closing may hang on a half-open link; the process ends after this in any case.
const CLOSE_LIMIT: Duration = Duration::from_secs(2);
/// Longer ones are not even copied.
const MAX_MESSAGE_BYTES: usize = HEADER_BYTES + MAX_PAYLOAD_BYTES;

/// A session of one site on the Zenoh network.
pub struct ZenohBus {
    session: Session,
    keys: Keys,
    history_count: usize,
    inbox: Arc<Inbox>,
    publishers: Mutex<HashMap<Topic, Arc<AdvancedPublisher<'static>>>>,
    tokens: Mutex<Vec<zenoh::liveliness::LivelinessToken>>,
}

impl ZenohBus {
    /// Joins the network and listens to `patterns`. What arrives comes out of the receiver, at
    /// most `config.inbox_count` waiting.
    ///
    /// # Errors
    /// If nobody answers at the endpoints within two seconds, or the port to listen on is taken.
    pub async fn open(
        config: &BusConfig,
        keys: Keys,
        patterns: &[Pattern],
    ) -> Result<(Self, mpsc::Receiver<Delivery>), BusError> {
        let endpoints = [config.listen.as_slice(), config.connect.as_slice()].concat().join(", ");
        let session = zenoh::open(settings(config)?)
            .await
            .map_err(|error| BusError::Open { endpoints, detail: reason(&error) })?;
        let (inbox, receiver) = Inbox::new(config.inbox_count);
        let bus = Self {
            session,
            keys,
            history_count: config.history_count,
            inbox: Arc::new(inbox),
            publishers: Mutex::default(),
            tokens: Mutex::default(),
        };
        for pattern in patterns {
            bus.listen(pattern).await?;
        }
        Ok((bus, receiver))
    }

    /// Shows that this process is alive, until it closes or dies.
    ///
    /// # Errors
    /// If Zenoh refuses the token.
    pub async fn declare_alive(&self, topic: &Topic) -> Result<(), BusError> {
        let key = self.keys.key(topic);
        let declared = self.session.liveliness().declare_token(key.clone()).await;
        let token = declared.map_err(|error| action("declaring alive on", &key, &error))?;
        self.tokens.lock().await.push(token);
        Ok(())
    }

    async fn listen(&self, pattern: &Pattern) -> Result<(), BusError> {
        let expression = self.keys.expression(pattern);
        let failed = |error: zenoh::Error| action("subscribing to", &expression, &error);
        if *pattern == Pattern::AllLive {
            let liveliness = self.session.liveliness();
            let subscriber = liveliness.declare_subscriber(expression.clone()).history(true);
            let inbox = Arc::clone(&self.inbox);
            let on_token = move |sample: Sample| offer_token(&inbox, &sample);
            return subscriber.callback(on_token).background().await.map_err(failed);
        }
        let inbox = Arc::clone(&self.inbox);
        let plain = self.session.declare_subscriber(expression.clone());
        let subscriber = plain.callback(move |sample: Sample| offer_message(&inbox, &sample));
        let history = |count| HistoryConfig::default().detect_late_publishers().max_samples(count);
        match pattern.class() {
            Class::GapFree => {
                let recovery = RecoveryConfig::default().heartbeat();
                let gap_free = subscriber.history(history(self.history_count)).recovery(recovery);
                gap_free.background().await.map_err(failed)
            }
            Class::State => subscriber.history(history(1)).background().await.map_err(failed),
            Class::Plain => subscriber.background().await.map_err(failed),
        }
    }

    /// The publisher of a topic that is kept for late joiners, declared when first needed.
    async fn publisher(&self, topic: &Topic) -> Result<Arc<AdvancedPublisher<'static>>, BusError> {
        let mut publishers = self.publishers.lock().await;
        if let Some(publisher) = publishers.get(topic) {
            return Ok(Arc::clone(publisher));
        }
        let key = self.keys.key(topic);
        let builder = self.session.declare_publisher(key.clone());
        let builder = match topic.class() {
            Class::GapFree => builder
                .congestion_control(CongestionControl::Block)
                .cache(CacheConfig::default().max_samples(self.history_count))
                .sample_miss_detection(MissDetectionConfig::default().heartbeat(HEARTBEAT)),
            Class::State | Class::Plain => builder
                .congestion_control(CongestionControl::Drop)
                .cache(CacheConfig::default().max_samples(1)),
        };
        let declared = builder.publisher_detection().await;
        let publisher = Arc::new(declared.map_err(|error| action("declaring", &key, &error))?);
        publishers.insert(topic.clone(), Arc::clone(&publisher));
        Ok(publisher)
    }
}

impl Bus for ZenohBus {
    async fn publish(&self, topic: &Topic, bytes: Vec<u8>) -> Result<(), BusError> {
        let failed = |error| action("publishing on", &self.keys.key(topic), &error);
        if topic.class() == Class::Plain {
            let put = self.session.put(self.keys.key(topic), bytes);
            return put.congestion_control(CongestionControl::Drop).await.map_err(failed);
        }
        self.publisher(topic).await?.put(bytes).await.map_err(failed)
    }

    fn dropped_count(&self) -> u64 {
        self.inbox.dropped_count()
    }

    async fn close(&self) {
        for token in self.tokens.lock().await.drain(..) {
            if let Err(error) = token.undeclare().await {
                debug!(%error, "withdrawing a liveliness token");
            }
        }
        match tokio::time::timeout(CLOSE_LIMIT, self.session.close()).await {
            Ok(Ok(())) => {}
            Ok(Err(error)) => warn!(%error, "closing the network session"),
            Err(_) => warn!(limit = ?CLOSE_LIMIT, "closing the network session timed out"),
        }
    }
}

fn offer_message(inbox: &Inbox, sample: &Sample) {
    if sample.kind() != SampleKind::Put {
        return;
    }
    let length = sample.payload().len();
    let event = if MAX_MESSAGE_BYTES < length {
        BusEvent::Oversized(length)
    } else {
        BusEvent::Message(sample.payload().to_bytes().into_owned())
    };
    inbox.offer(sample.key_expr().as_str(), event);
}

fn offer_token(inbox: &Inbox, sample: &Sample) {
    let event = match sample.kind() {
        SampleKind::Put => BusEvent::Appeared,
        SampleKind::Delete => BusEvent::Vanished,
    };
    inbox.offer(sample.key_expr().as_str(), event);
}

fn action(action: &'static str, key: &str, error: &zenoh::Error) -> BusError {
    BusError::Action { action, key: key.to_owned(), detail: reason(error) }
}

/// What Zenoh says went wrong, without the place in its sources where it noticed.
fn reason(error: &zenoh::Error) -> String {
    let text = error.to_string();
    text.split(" at /").next().unwrap_or(&text).to_owned()
}

/// Zenoh's configuration: every key on which documentation and behaviour are known to differ, or
/// whose default opens the process to the network, is set here.
fn settings(config: &BusConfig) -> Result<Config, BusError> {
    let is_router = !config.listen.is_empty();
    let mode = if is_router { "router" } else { "client" };
    let BusConfig { listen, connect, .. } = config;
    // A client gives up after two seconds and its caller tries again; a router dials others, if
    // any, in the background.
    let must_connect = !is_router;
    let text = format!(
        r#"{{
        mode: "{mode}",
        listen: {{ endpoints: {listen:?}, exit_on_failure: true }},
        connect: {{
            endpoints: {connect:?}, timeout_ms: 2000, exit_on_failure: {must_connect},
            retry: {{ period_init_ms: 200, period_max_ms: 1000, period_increase_factor: 2 }},
        }},
        scouting: {{ multicast: {{ enabled: false }}, gossip: {{ enabled: false }} }},
        timestamping: {{ enabled: true }},
        adminspace: {{ enabled: false }},
        transport: {{
            unicast: {{ open_timeout: 2000, accept_timeout: 2000, max_sessions: 256 }},
            link: {{
                protocols: ["tcp"],
                tx: {{ lease: 2000, keep_alive: 4 }},
                rx: {{ max_message_size: 8388608 }},
            }},
        }},
    }}"#
    );
    Config::from_json5(&text).map_err(|error| BusError::Settings { detail: reason(&error) })
}
