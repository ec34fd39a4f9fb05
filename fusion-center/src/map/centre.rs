//! The wide-area side of the centre as a pure state machine: dwells in, tracks on the map out.
//!
//! Like the centre of the point sets it reads no clock: [`MapCentre::step`] takes the time and one
//! event and says what is to be done; the same events give the same effects.

use std::collections::BTreeMap;
use std::time::Duration;

use proto::bus::{BusEvent, Delivery};
use proto::ids::{BootId, NodeId, SiteId};
use proto::keys::{Keys, Topic};
use proto::plots::Scan;
use proto::refusals::Refusals;
use proto::time::CentreTime;
use proto::wire::{Dwell, MapCounts, MapTrack, MapTracks, Received, Stamp, decode, encode};
use tracing::{error, info};

use super::follower::FollowError;
use super::geo::{Past, fix, geo_track};
use super::reorder::{Offer, Origin, Reorder};
use super::{Follower, MapConfig};
use crate::export::GeoTrack;
use crate::tracking::{InvalidSetting, Status};
use crate::wide::MAX_REACH_M;

/// The map moves to another region of the earth when nothing has come from its own for so long, seconds
/// of the data: as long as the default tracker remembers a target that stands. Otherwise a single dwell
/// of a wrong place, heard first, would keep all others out for ever.
const QUIET_REGION_S: f64 = 300.0;

/// The map begins anew, at the times that come, when for so long nothing came but what was late, ...
const LATE_FOR: Duration = Duration::from_secs(60);
/// ... at least so often: clocks are set back, and recordings are played again.
const MIN_LATE_COUNT: u32 = 10;

/// What happens.
#[derive(Debug)]
pub enum MapEvent {
    /// The bus delivered something, which arrived at this time.
    Delivered(Delivery, CentreTime),
    /// Time has passed.
    Tick,
}

/// What is to be done.
#[derive(Debug)]
pub enum MapEffect {
    /// Send these bytes.
    Publish(Topic, Vec<u8>),
    /// Renew what goes elsewhere than to the network.
    Show(Box<Shown>),
}

/// What goes elsewhere than to the network.
#[derive(Clone, Debug, PartialEq)]
pub struct Shown {
    /// The time of the newest dwell, Unix seconds.
    pub time_unix_s: f64,
    /// All sensors that contributed are simulated.
    pub is_simulated: bool,
    /// The tracks with their ways.
    pub tracks: Vec<GeoTrack>,
}

/// The state.
pub struct MapCentre {
    config: MapConfig,
    keys: Keys,
    boot: BootId,
    follower: Follower,
    order: Reorder<Dwell>,
    refusals: Refusals,
    counts: MapCounts,
    pasts: BTreeMap<u64, Past>,
    newest_unix_s: Option<f64>,
    /// Since when nothing came but what was late, and how often.
    late: Option<(CentreTime, u32)>,
    is_simulated: bool,
    sequence: u64,
    published: Option<CentreTime>,
    shown: Option<CentreTime>,
    is_news: [bool; 2],
}

/// A delivery that makes no sense: a label, and the reason in full.
type Refused = (&'static str, String);

impl MapCentre {
    /// A centre that knows nobody.
    ///
    /// # Errors
    /// If a setting of the tracker makes no sense.
    pub fn new(config: MapConfig, site: SiteId, boot: BootId) -> Result<Self, InvalidSetting> {
        Ok(Self {
            keys: Keys::new(site),
            boot,
            follower: Follower::new(&config)?,
            order: Reorder::new(config.patience()),
            refusals: Refusals::default(),
            counts: MapCounts::default(),
            pasts: BTreeMap::new(),
            newest_unix_s: None,
            late: None,
            is_simulated: true,
            sequence: 0,
            published: None,
            shown: None,
            is_news: [false; 2],
            config,
        })
    }

    /// What was done so far.
    #[must_use]
    pub fn counts(&self) -> MapCounts {
        self.counts
    }

    /// Takes one event in at `now` and says what is to be done.
    pub fn step(&mut self, now: CentreTime, event: MapEvent) -> Vec<MapEffect> {
        if let MapEvent::Delivered(delivery, arrived) = event
            && let Err((label, reason)) = self.on_delivery(arrived, &delivery)
        {
            self.counts.refused_count += 1;
            self.refusals.count(&delivery.key, label, &reason);
        }
        let released = self.order.release(now);
        self.follow(released);
        self.tell(now)
    }

    /// Everything that waits is followed and told: nothing else comes.
    pub fn finish(&mut self, now: CentreTime) -> Vec<MapEffect> {
        let rest = self.order.finish();
        self.follow(rest);
        (self.published, self.shown, self.is_news) = (None, None, [true; 2]);
        self.tell(now)
    }

    fn on_delivery(&mut self, arrived: CentreTime, delivery: &Delivery) -> Result<(), Refused> {
        let node = match self.keys.parse(&delivery.key) {
            Ok(Topic::Dwells(node)) => node,
            Ok(_) => return Ok(()),
            Err(unknown) => return Err(("key", unknown.to_string())),
        };
        let bytes = match &delivery.event {
            BusEvent::Message(bytes) => bytes,
            BusEvent::Oversized(length) => {
                return Err(("oversized", format!("{length} bytes, more than any message has")));
            }
            BusEvent::Appeared | BusEvent::Vanished => return Ok(()),
        };
        let received: Received<Dwell> =
            decode(bytes).map_err(|refusal| (refusal.label(), refusal.to_string()))?;
        self.on_dwell(arrived, &node, received)
    }

    fn on_dwell(
        &mut self,
        arrived: CentreTime,
        node: &NodeId,
        received: Received<Dwell>,
    ) -> Result<(), Refused> {
        let Received { stamp, body: dwell } = received;
        if dwell.node != *node {
            let reason = format!("it speaks of node {} under the key of node {node}", dwell.node);
            return Err(("impostor", reason));
        }
        let (boot, sequence, time_unix_s) = (stamp.boot, stamp.sequence, dwell.time_unix_s);
        let origin = Origin { node: node.clone(), boot, sequence };
        let offered = self.order.offer(arrived, origin, time_unix_s, dwell);
        if let Some(refuted_s) = self.order.take_refuted() {
            self.counts.refused_count += 1;
            let key = self.keys.key(&Topic::Dwells(node.clone()));
            self.refusals.count(&key, "leap", &leapt(refuted_s, time_unix_s));
        }
        match offered {
            Offer::Kept => self.late = None,
            Offer::Held => {}
            Offer::Duplicate => self.counts.duplicate_count += 1,
            Offer::Late => {
                self.counts.late_count += 1;
                let newest_s = self.newest_unix_s.unwrap_or(time_unix_s);
                let key = self.keys.key(&Topic::Dwells(node.clone()));
                let reason = format!(
                    "it is {:.1} s older than what was followed already: wide.max_wait_s is too \
                     short, or a clock was set back or a recording is played again; if nothing newer \
                     comes for {} s, the map begins anew",
                    newest_s - time_unix_s,
                    LATE_FOR.as_secs()
                );
                self.refusals.count(&key, "late", &reason);
                self.note_late(arrived);
            }
            Offer::Crowded => {
                let most = self.config.max_sensor_count;
                return Err((
                    "crowded",
                    format!("more than {most} sensors (wide.max_sensor_count)"),
                ));
            }
        }
        Ok(())
    }

    /// Begins anew when nothing but late dwells has come for long.
    fn note_late(&mut self, arrived: CentreTime) {
        let (since, count) = self.late.get_or_insert((arrived, 0));
        *count += 1;
        if arrived.since(*since) < LATE_FOR || *count < MIN_LATE_COUNT {
            return;
        }
        info!("all that comes is older than what was followed: the map begins anew");
        let rest = self.order.finish();
        self.follow(rest);
        self.order = Reorder::new(self.config.patience());
        self.begin_anew();
    }

    /// The next dwell says where and when the map is. Ids go on.
    fn begin_anew(&mut self) {
        self.follower.begin_anew();
        self.pasts.clear();
        (self.newest_unix_s, self.late) = (None, None);
    }

    fn follow(&mut self, dwells: Vec<Dwell>) {
        for dwell in dwells {
            let (time_unix_s, is_simulated) = (dwell.time_unix_s, dwell.is_simulated);
            let key = self.keys.key(&Topic::Dwells(dwell.node.clone()));
            let report_count = dwell.reports.len() as u64;
            match self.take(time_unix_s, &Scan::Geographic(Box::new(dwell))) {
                Ok(0) => {}
                Ok(count) => self.refusals.count(&key, "unplaced", &unplaced(count, time_unix_s)),
                Err(failure) => {
                    self.counts.refused_count += 1;
                    self.refusals.count(&key, "unusable", &failure.to_string());
                    continue;
                }
            }
            if self.newest_unix_s.is_none() {
                info!(%key, time_unix_s, "the first dwell: the map begins");
            }
            self.newest_unix_s = Some(time_unix_s);
            self.is_simulated &= is_simulated;
            self.counts.dwell_count += 1;
            self.counts.report_count += report_count;
            self.is_news = [true; 2];
            self.note_pasts();
        }
        // What is settled is for files; on the map only the present counts.
        self.follower.forget_settled();
    }

    /// Follows a dwell, in another region if nothing comes from the former any more.
    fn take(&mut self, time_unix_s: f64, scan: &Scan) -> Result<usize, FollowError> {
        let taken = self.follower.take(scan);
        let is_quiet =
            self.newest_unix_s.is_some_and(|newest| QUIET_REGION_S < time_unix_s - newest);
        match taken {
            Err(FollowError::Elsewhere { off_m }) if is_quiet => {
                info!(off_m, "another region: the map begins anew");
                self.begin_anew();
                self.follower.take(scan)
            }
            _ => taken,
        }
    }

    /// Keeps the ways of what is shown, and forgets those of what has ended.
    fn note_pasts(&mut self) {
        if !self.config.output.is_used() {
            return;
        }
        let mut pasts = std::mem::take(&mut self.pasts);
        let most = self.config.output.history_count;
        let tracks = self.follower.tracks();
        // Others are where they were.
        let newest_s = tracks.iter().map(|track| track.time_s).fold(f64::NEG_INFINITY, f64::max);
        for track in tracks {
            let past = pasts.remove(&track.id);
            if track.time_s < newest_s {
                self.pasts.extend(past.map(|past| (track.id, past)));
                continue;
            }
            let Some(on_map) = self.follower.map_track(track) else { continue };
            let Ok(place) = fix(&on_map) else { continue };
            let new =
                || Past { first_seen_unix_s: track.seen_s, sensors: Vec::new(), fixes: Vec::new() };
            let mut past = past.unwrap_or_else(new);
            past.take(place, on_map.report.map(|report| report.node.to_string()), most);
            self.pasts.insert(track.id, past);
        }
    }

    /// Publishes and shows what is new, each at most once in its interval.
    fn tell(&mut self, now: CentreTime) -> Vec<MapEffect> {
        let mut effects = Vec::new();
        let Some(time_unix_s) = self.newest_unix_s else { return effects };
        let is_due = |last: Option<CentreTime>, interval_s: f64| {
            last.is_none_or(|last| Duration::from_secs_f64(interval_s) <= now.since(last))
        };
        let publishes = self.is_news[0] && is_due(self.published, self.config.publish_interval_s);
        let shows = self.is_news[1]
            && self.config.output.is_used()
            && is_due(self.shown, self.config.output.interval_s);
        if !publishes && !shows {
            return effects;
        }
        let tracks = self.map_tracks();
        if publishes {
            (self.is_news[0], self.published) = (false, Some(now));
            effects.extend(self.publish(now, time_unix_s, &tracks));
        }
        if shows {
            (self.is_news[1], self.shown) = (false, Some(now));
            let session = self.boot.to_string();
            let geo = tracks.iter().filter_map(|track| {
                let past = self.pasts.get(&track.id)?;
                geo_track(track, past, &session).ok()
            });
            let (geo_tracks, is_simulated) = (geo.collect(), self.is_simulated);
            let shown = Shown { time_unix_s, is_simulated, tracks: geo_tracks };
            effects.push(MapEffect::Show(Box::new(shown)));
        }
        effects
    }

    /// What is to be seen of the tracks, in ascending order of id; the rest is counted as hidden.
    fn map_tracks(&mut self) -> Vec<MapTrack> {
        let followed = self.follower.tracks();
        let is_wanted = |status| self.config.publish_tentative || status != Status::Tentative;
        let wanted = followed.iter().filter(|track| is_wanted(track.status));
        let tracks: Vec<MapTrack> = wanted
            .filter_map(|track| self.follower.map_track(track))
            .filter(|track| track.check().is_ok())
            .take(MapTracks::MAX_TRACK_COUNT)
            .collect();
        self.counts.hidden_count = (followed.len() - tracks.len()) as u64;
        tracks
    }

    fn publish(
        &mut self,
        now: CentreTime,
        time_unix_s: f64,
        tracks: &[MapTrack],
    ) -> Option<MapEffect> {
        let message = MapTracks {
            time_unix_s,
            is_simulated: self.is_simulated,
            counts: self.counts,
            tracks: tracks.to_vec(),
        };
        let sent_ns = u64::try_from(now.0).unwrap_or(0);
        let stamp = Stamp { boot: self.boot, sequence: self.sequence, sent_ns };
        match encode(stamp, &message) {
            Ok(bytes) => {
                self.sequence += 1;
                Some(MapEffect::Publish(Topic::MapTracks, bytes))
            }
            Err(refusal) => {
                error!(%refusal, "own map refused, not sent");
                None
            }
        }
    }
}

/// Why a dwell of a time far ahead was left out.
pub(crate) fn leapt(refuted_s: f64, next_s: f64) -> String {
    format!(
        "a dwell of {refuted_s} s is left out: the next of its sensor is of {next_s} s, more than an \
         hour before it; is its date right?"
    )
}

/// Why plots of a dwell were left out.
pub(crate) fn unplaced(count: usize, time_s: f64) -> String {
    let reach_km = MAX_REACH_M / 1e3;
    format!(
        "{count} reports of the dwell of {time_s} s are left out: they are from right under the \
         sensor, from the other side of the earth, or more than {reach_km} km from where the map \
         began; are the places of sensor and reports right?"
    )
}

#[cfg(test)]
mod tests;
