//! People followed by all registered nodes together, from period to period.
//!
//! Every closed period gives one look for each registered node that nobody doubts and whose clock is
//! known well: its points in `Ref`, with the errors of the half depth and of the node's pose. The
//! looks of a period are taken in the order of their measurement. What comes later than
//! `gather.max_wait_s` allows is in the picture of its period, but in no track.
//!
//! When a node comes in, all periods that are still gathered are gone through again, with it: so
//! people are followed from before their nodes were registered, and those who were followed already
//! keep their ids.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use nalgebra::Vector2;
use proto::ids::NodeId;
use proto::time::CentreTime;
use proto::wire::{PersonInPicture, PointOfPerson, TrackStatus, packed_covariance};
use tracing::warn;

use super::monitor::Placement;
use crate::config::PeopleConfig;
use crate::fuse::place;
use crate::gather::{Gather, KeptPoint, KeptSet};
use crate::tracking::{Area, Coverage, Look, Plot, Status, Track, Tracker};

/// Most points of one node in one period that are looked at, the strongest: more people than a node
/// can tell apart.
const MAX_PLOT_COUNT: usize = 128;
/// Somebody who is gone through again lies at most this far from where they were followed, metres.
const SAME_PERSON_M: f64 = 0.75;

/// A tracker that has seen nothing yet, or none.
type Make = Box<dyn Fn() -> Option<Box<dyn Tracker>> + Send>;

/// Everybody who is followed.
pub(super) struct People {
    config: PeopleConfig,
    make: Make,
    tracker: Option<Box<dyn Tracker>>,
    sensors: Vec<NodeId>,
    /// When each sensor last gave a plot to a track, seconds.
    gave: BTreeMap<u64, BTreeMap<u32, f64>>,
    /// The ids under which the tracker's tracks are shown.
    names: BTreeMap<u64, u64>,
    next_name: u64,
    /// Who has been looking.
    placed: BTreeSet<NodeId>,
    newest: Option<CentreTime>,
    refused_count: u64,
}

impl People {
    pub(super) fn new(config: &PeopleConfig) -> Self {
        let own = config.clone();
        Self::with(config, Box::new(move || own.tracker()))
    }

    fn with(config: &PeopleConfig, make: Make) -> Self {
        Self {
            config: config.clone(),
            tracker: make(),
            make,
            sensors: Vec::new(),
            gave: BTreeMap::new(),
            names: BTreeMap::new(),
            next_name: 0,
            placed: BTreeSet::new(),
            newest: None,
            refused_count: 0,
        }
    }

    /// Nobody is followed any longer: the common frame is another, or nobody has looked for long.
    pub(super) fn start_over(&mut self) {
        self.tracker = (self.make)();
        self.gave.clear();
        self.names.clear();
        self.placed.clear();
        self.newest = None;
    }

    /// Takes a closed period in, as seen by the nodes with `placements`.
    pub(super) fn take(
        &mut self,
        period: i64,
        gather: &Gather,
        placements: &BTreeMap<NodeId, Placement>,
    ) {
        if self.tracker.is_none() {
            return;
        }
        let is_clock_good =
            |node: &&NodeId| gather.node(node).is_some_and(|history| gather.is_clock_good(history));
        let placed: BTreeSet<NodeId> = placements.keys().filter(is_clock_good).cloned().collect();
        let is_news = !placed.is_subset(&self.placed);
        self.placed = placed;
        if is_news {
            self.go_through_again(period, gather, placements);
        }
        self.look_at(period, gather, placements);
        self.name_the_sure();
    }

    /// Follows everybody anew through what is gathered from before `period`.
    fn go_through_again(
        &mut self,
        period: i64,
        gather: &Gather,
        placements: &BTreeMap<NodeId, Placement>,
    ) {
        let before: Vec<(u64, Vector2<f64>)> = self
            .tracks()
            .iter()
            .filter_map(|track| Some((*self.names.get(&track.id)?, place_m(track))))
            .collect();
        self.tracker = (self.make)();
        self.gave.clear();
        self.names.clear();
        let histories = gather.nodes().filter(|(node, _)| self.placed.contains(*node));
        let periods: BTreeSet<i64> = histories
            .flat_map(|(_, history)| history.sets().range(..period))
            .map(|(at, _)| *at)
            .collect();
        for earlier in periods {
            self.look_at(earlier, gather, placements);
        }
        self.names = same_people(&before, self.tracks());
    }

    fn tracks(&self) -> &[Track] {
        self.tracker.as_ref().map_or(&[], |tracker| tracker.tracks())
    }

    fn name_the_sure(&mut self) {
        let tracks = self.tracker.as_ref().map_or(&[][..], |tracker| tracker.tracks());
        for track in tracks.iter().filter(|track| track.status != Status::Tentative) {
            let next = self.next_name;
            let name = *self.names.entry(track.id).or_insert(next);
            self.next_name = next.max(name + 1);
        }
        self.names.retain(|id, _| lives(tracks, *id));
    }

    fn look_at(&mut self, period: i64, gather: &Gather, placements: &BTreeMap<NodeId, Placement>) {
        let mut sets: Vec<(&NodeId, &KeptSet, &Placement)> = gather
            .sets_in(period)
            .filter(|(node, _)| self.placed.contains(*node))
            .filter_map(|(node, set)| Some((node, set, placements.get(node)?)))
            .collect();
        sets.sort_by_key(|(_, set, _)| set.time);
        for (node, set, placement) in sets {
            self.look(node, set, placement);
        }
    }

    fn look(&mut self, node: &NodeId, set: &KeptSet, placement: &Placement) {
        let sensor_index = self.sensor_index(node);
        let plots = plots(set, placement);
        let time_s = seconds(set.time);
        let look = Look {
            time_s,
            sensor_index,
            look_index: set.sequence,
            platform: None,
            coverage: Coverage {
                area: Area::Everywhere,
                detection_probability: self.config.detection_probability,
                minimum_detectable_m_per_s: None,
            },
            clutter_per_m2: self.config.false_points_per_m2,
            plots: &plots,
        };
        let Some(tracker) = &mut self.tracker else { return };
        if let Err(refused) = tracker.look(&look) {
            self.refused_count += 1;
            if self.refused_count.is_power_of_two() {
                warn!(%node, %refused, count = self.refused_count, "a set is in no track");
            }
            return;
        }
        tracker.forget_settled();
        self.newest = Some(set.time);
        self.note_givers(sensor_index, set.sequence, time_s);
    }

    /// Notes to whom the newest look gave a plot, and forgets who is followed no longer.
    fn note_givers(&mut self, sensor_index: u32, look_index: u64, time_s: f64) {
        let tracks = self.tracker.as_ref().map_or(&[][..], |tracker| tracker.tracks());
        for track in tracks {
            let last = track.last_report;
            if (last.sensor_index, last.look_index) == (sensor_index, look_index) {
                self.gave.entry(track.id).or_default().insert(sensor_index, time_s);
            }
        }
        self.gave.retain(|id, _| lives(tracks, *id));
    }

    fn sensor_index(&mut self, node: &NodeId) -> u32 {
        let known = self.sensors.iter().position(|one| one == node);
        let index = known.unwrap_or_else(|| {
            self.sensors.push(node.clone());
            self.sensors.len() - 1
        });
        u32::try_from(index).unwrap_or(u32::MAX)
    }

    /// Starts over if no set was taken in for longer than `limit`.
    pub(super) fn forget_old(&mut self, now: CentreTime, limit: Duration) {
        if self.newest.is_some_and(|newest| limit < now.since(newest)) {
            self.start_over();
        }
    }

    /// Everybody who is sure enough to be shown, by id.
    pub(super) fn shown(&self) -> Vec<PersonInPicture> {
        let sure = self.tracks().iter().filter(|one| one.status != Status::Tentative);
        let mut shown: Vec<PersonInPicture> = sure.filter_map(|one| self.person(one)).collect();
        // One wild track must not cost everybody the picture.
        shown.retain(|person| person.check().is_ok());
        shown.sort_by_key(|person| person.id);
        shown.truncate(PersonInPicture::MAX_COUNT);
        shown
    }

    fn person(&self, track: &Track) -> Option<PersonInPicture> {
        let name = |index: u32| self.sensors.get(usize::try_from(index).ok()?).cloned();
        let lately = |seen_s: f64| track.time_s - seen_s <= self.config.contribution_s;
        let gave = self.gave.get(&track.id).into_iter().flatten();
        let mut nodes: Vec<NodeId> = gave
            .filter(|(_, seen_s)| lately(**seen_s))
            .filter_map(|(index, _)| name(*index))
            .collect();
        nodes.sort();
        #[expect(clippy::cast_possible_truncation, reason = "a time that came from nanoseconds")]
        let time = CentreTime((track.time_s * 1e9).round() as i64);
        Some(PersonInPicture {
            id: *self.names.get(&track.id)?,
            // Whom one node misses, another may have seen in the same period.
            status: if track.seen_s < track.time_s {
                TrackStatus::Coasting
            } else {
                TrackStatus::Confirmed
            },
            time,
            state: track.state.into(),
            covariance: packed_covariance(&track.covariance),
            log_odds: track.log_odds,
            unseen_s: (track.time_s - track.seen_s).max(0.0),
            nodes,
            last: PointOfPerson {
                node: name(track.last_report.sensor_index)?,
                sequence: track.last_report.look_index,
                point_index: track.last_report.report_index,
                share: track.last_share.clamp(0.0, 1.0),
            },
        })
    }
}

/// The strongest points of a set, in `Ref`.
fn plots(set: &KeptSet, placement: &Placement) -> Vec<Plot> {
    let plot = |(index, point): (usize, &KeptPoint)| {
        let middle = point.with_half_depth_error(set.half_depth_sigma_m);
        let placed = place(placement.pose, &placement.covariance, middle);
        Plot {
            position_m: placed.mean.coords_m,
            covariance_m2: placed.cov_m2,
            radial: None,
            strength_db: None,
            report_index: u32::try_from(index).unwrap_or(u32::MAX),
        }
    };
    let mut points: Vec<_> = set.points.iter().enumerate().collect();
    points.sort_by(|(_, one), (_, other)| other.snr_db.total_cmp(&one.snr_db));
    points.truncate(MAX_PLOT_COUNT);
    points.into_iter().map(plot).collect()
}

/// Whether `tracks`, in ascending order of id, hold this one.
fn lives(tracks: &[Track], id: u64) -> bool {
    tracks.binary_search_by_key(&id, |track| track.id).is_ok()
}

fn place_m(track: &Track) -> Vector2<f64> {
    track.state.fixed_rows::<2>(0).into_owned()
}

/// Under which of the names of `before` each of `tracks` was followed: pairs, nearest first.
fn same_people(before: &[(u64, Vector2<f64>)], tracks: &[Track]) -> BTreeMap<u64, u64> {
    let mut pairs: Vec<(f64, u64, u64)> = tracks
        .iter()
        .flat_map(|track| before.iter().map(move |(name, at_m)| (track, *name, at_m)))
        .map(|(track, name, at_m)| ((place_m(track) - at_m).norm(), track.id, name))
        .filter(|(away_m, ..)| *away_m <= SAME_PERSON_M)
        .collect();
    pairs.sort_by(|one, other| one.0.total_cmp(&other.0));
    let (mut names, mut taken) = (BTreeMap::new(), BTreeSet::new());
    for (_, track, name) in pairs {
        if !names.contains_key(&track) && taken.insert(name) {
            names.insert(track, name);
        }
    }
    names
}

fn seconds(time: CentreTime) -> f64 {
    time.0 as f64 / 1e9
}

#[cfg(test)]
mod tests;
