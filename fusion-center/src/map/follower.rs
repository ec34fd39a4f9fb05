//! From scans in order of time to tracks, on the earth or on a plane of the data's own.

use std::collections::VecDeque;

use nalgebra::{Matrix4, Vector4};
use proto::geodesy::GeodesyError;
use proto::ids::NodeId;
use proto::plots::Scan;
use proto::wire::{MapReport, MapStatus, MapTrack, packed_covariance};
use thiserror::Error;
use tracing::{info, warn};

use super::ground::Ground;
use super::settings::MapConfig;
use crate::tracking::{InvalidSetting, LookError, ReportId, Settled, Status, Track, Tracker};
use crate::wide::{
    LookName, MAX_REACH_M, PlacedTrack, RadialConvention, SignWatch, Verdict, WideConfig,
};

/// Looks of each sensor of which it is remembered what their reports were: longer than any lag.
const REMEMBERED_LOOK_COUNT: usize = 20_000;
/// The same in reports.
const REMEMBERED_REPORT_COUNT: usize = 500_000;

/// Why a scan was left out; what is followed is then as it was.
#[derive(Debug, Error)]
pub enum FollowError {
    /// The tracker does not take it.
    #[error(transparent)]
    Look(#[from] LookError),
    /// It says a place that is none.
    #[error(transparent)]
    Place(#[from] GeodesyError),
    /// Plots on the earth and on a plane cannot be followed together.
    #[error(
        "the input has plots with latitude and longitude and plots with x and y: split it in two"
    )]
    Mixed,
    /// It is of another region of the earth.
    #[error(
        "its sensor or area is {:.0} km from where the map began, of which {:.0} km are followed: \
         follow each region by itself, in an input or with a centre of its own",
        off_m / 1e3,
        MAX_REACH_M / 1e3
    )]
    Elsewhere {
        /// How far, metres.
        off_m: f64,
    },
}

/// Follows targets through scans.
pub struct Follower {
    tracker: Box<dyn Tracker>,
    assumed: WideConfig,
    ground: Option<Ground>,
    sensors: Vec<Sensor>,
}

struct Sensor {
    node: NodeId,
    next_look: u64,
    /// The newest looks, up to that before `next_look`.
    looks: VecDeque<Remembered>,
    report_count: usize,
    sign: SignWatch,
}

/// What provenance needs of a look.
struct Remembered {
    revisit_index: u32,
    dwell_index: u32,
    /// Number, height and truth of each report.
    reports: Vec<(u32, f64, Option<u32>)>,
}

/// A report that a track took.
#[derive(Clone, Debug, PartialEq)]
pub struct Source {
    /// Whose, and which.
    pub report: MapReport,
    /// Height above the ellipsoid, metres; 0 on a plane.
    pub height_m: f64,
    /// Which target it really is, where the data say it.
    pub truth: Option<u32>,
}

impl Follower {
    /// Follows nobody yet.
    ///
    /// # Errors
    /// If a setting of the tracker makes no sense.
    pub fn new(config: &MapConfig) -> Result<Self, InvalidSetting> {
        Ok(Self {
            tracker: config.tracking.tracker()?,
            assumed: config.assumed.clone(),
            ground: None,
            sensors: Vec::new(),
        })
    }

    /// Takes the next scan; times never descend. Gives how many of its plots could not be used: those
    /// from right under the sensor, or from another region.
    ///
    /// # Errors
    /// If it cannot be used; what is followed is then as it was.
    pub fn take(&mut self, scan: &Scan) -> Result<usize, FollowError> {
        let ground = match self.ground {
            Some(ground) => ground,
            None => Ground::of(scan)?,
        };
        let off_m = ground.off_m(scan)?;
        if MAX_REACH_M < off_m {
            return Err(FollowError::Elsewhere { off_m });
        }
        let sensor_index = self.sensor_index(node_of(scan));
        let sensor = sensor_index as usize;
        let name = LookName { sensor_index, look_index: self.sensors[sensor].next_look };
        let look = ground.look(scan, &self.assumed, name)?.ok_or(FollowError::Mixed)?;
        self.tracker.look(&look.look())?;
        self.ground = Some(ground);
        self.sensors[sensor].remember(Remembered::of(scan));
        match self.sensors[sensor].sign.take(look.time_s, &look.plots) {
            Some(Verdict::Reversed) => warn!("{}", self.against(&self.sensors[sensor])),
            Some(_) => info!(node = %node_of(scan), "targets go as their radial velocities say"),
            None => {}
        }
        Ok(scan.plot_count() - look.plots.len())
    }

    /// Ends all tracks; the next scan says where the map lies, and may be older than those before. What
    /// was settled and not taken is forgotten, since its plane is. Ids go on.
    pub fn begin_anew(&mut self) {
        self.tracker.finish();
        self.tracker.forget_settled();
        self.ground = None;
        self.sensors.iter_mut().for_each(|sensor| sensor.sign = SignWatch::default());
    }

    /// What is wrong with sensors whose targets go against their radial velocities.
    #[cfg(test)]
    pub(super) fn complaints(&self) -> Vec<String> {
        let is_reversed = |sensor: &&Sensor| sensor.sign.sign().verdict() == Verdict::Reversed;
        self.sensors.iter().filter(is_reversed).map(|sensor| self.against(sensor)).collect()
    }

    fn against(&self, sensor: &Sensor) -> String {
        let (node, sign) = (&sensor.node, sensor.sign.sign());
        let remedy = match self.assumed.radial_convention {
            RadialConvention::Away => "towards",
            RadialConvention::Towards => "away",
        };
        format!(
            "targets of sensor {node} go against their radial velocities ({} plots say so, {} the \
             opposite), which spoils the tracks: set wide.assumed.radial_convention = \"{remedy}\"",
            sign.reversed_count, sign.as_stated_count
        )
    }

    /// Nothing follows: everything that is open is settled.
    pub fn finish(&mut self) {
        self.tracker.finish();
    }

    /// The plane; `None` before the first scan.
    #[must_use]
    pub fn ground(&self) -> Option<&Ground> {
        self.ground.as_ref()
    }

    /// Everything that is followed, in ascending order of id.
    #[must_use]
    pub fn tracks(&self) -> &[Track] {
        self.tracker.tracks()
    }

    /// See [`Tracker::take_settled`].
    pub fn take_settled(&mut self, into: &mut Vec<Settled>) {
        self.tracker.take_settled(into);
    }

    /// See [`Tracker::forget_settled`].
    pub fn forget_settled(&mut self) {
        self.tracker.forget_settled();
    }

    /// The report that a tracker names, as long as it is remembered.
    #[must_use]
    pub fn source(&self, id: ReportId) -> Option<Source> {
        let sensor = self.sensors.get(id.sensor_index as usize)?;
        let age = usize::try_from(sensor.next_look.checked_sub(id.look_index)?).ok()?;
        let look = sensor.looks.get(sensor.looks.len().checked_sub(age)?)?;
        // Reports stand in the order of their numbers as a rule, and those begin at 0.
        let at_place = look.reports.get(id.report_index as usize);
        let is_it = |report: &&(u32, f64, Option<u32>)| report.0 == id.report_index;
        let found = at_place.filter(is_it).or_else(|| look.reports.iter().find(is_it));
        let (report_index, height_m, truth) = *found?;
        let report = MapReport {
            node: sensor.node.clone(),
            revisit_index: look.revisit_index,
            dwell_index: look.dwell_index,
            report_index,
        };
        Some(Source { report, height_m, truth })
    }

    /// A track on the map; `None` on a plane, or where the state has left the earth.
    #[must_use]
    pub fn map_track(&self, track: &Track) -> Option<MapTrack> {
        let source = self.source(track.last_report);
        let height_m = source.as_ref().map_or_else(|| self.height_m(), |source| source.height_m);
        let found = self.ground?.placed(&track.state, &track.covariance, height_m)?;
        Some(MapTrack {
            id: track.id,
            status: map_status(track.status),
            time_unix_s: track.time_s,
            place: found.place,
            velocity_m_per_s: found.velocity_m_per_s.into(),
            covariance: packed_covariance(&found.covariance),
            report_count: track.plot_count,
            seen_unix_s: track.seen_s,
            report: source.map(|source| source.report),
            report_share: track.last_share,
        })
    }

    /// A state on the earth; `None` on a plane, or where it has left the earth.
    #[must_use]
    pub fn placed(
        &self,
        state: &Vector4<f64>,
        covariance: &Matrix4<f64>,
        height_m: f64,
    ) -> Option<PlacedTrack> {
        self.ground?.placed(state, covariance, height_m)
    }

    /// Height of the plane above the ellipsoid, metres.
    #[must_use]
    pub fn height_m(&self) -> f64 {
        self.ground.map_or(0.0, |ground| ground.height_m())
    }

    fn sensor_index(&mut self, node: &NodeId) -> u32 {
        let known = self.sensors.iter().position(|sensor| sensor.node == *node);
        let index = known.unwrap_or_else(|| {
            let (node, looks) = (node.clone(), VecDeque::new());
            let sign = SignWatch::default();
            self.sensors.push(Sensor { node, next_look: 0, looks, report_count: 0, sign });
            self.sensors.len() - 1
        });
        u32::try_from(index).unwrap_or(u32::MAX)
    }
}

/// Whose a scan is.
pub(crate) fn node_of(scan: &Scan) -> &NodeId {
    match scan {
        Scan::Geographic(dwell) => &dwell.node,
        Scan::Local(local) => &local.node,
    }
}

impl Remembered {
    fn of(scan: &Scan) -> Self {
        match scan {
            Scan::Geographic(dwell) => Self {
                revisit_index: dwell.revisit_index,
                dwell_index: dwell.dwell_index,
                reports: (dwell.reports.iter())
                    .map(|report| (report.index, report.place.height_m, report.truth))
                    .collect(),
            },
            Scan::Local(local) => Self {
                revisit_index: local.revisit_index,
                dwell_index: local.dwell_index,
                reports: local.plots.iter().map(|plot| (plot.index, 0.0, plot.truth)).collect(),
            },
        }
    }
}

impl Sensor {
    fn remember(&mut self, look: Remembered) {
        self.next_look += 1;
        self.report_count += look.reports.len();
        self.looks.push_back(look);
        while REMEMBERED_LOOK_COUNT < self.looks.len()
            || REMEMBERED_REPORT_COUNT < self.report_count
        {
            let Some(first) = self.looks.pop_front() else { break };
            self.report_count -= first.reports.len();
        }
    }
}

/// As it travels.
#[must_use]
pub fn map_status(status: Status) -> MapStatus {
    match status {
        Status::Tentative => MapStatus::Tentative,
        Status::Confirmed => MapStatus::Confirmed,
        Status::Coasting => MapStatus::Coasting,
        Status::Stopped => MapStatus::Stopped,
    }
}
