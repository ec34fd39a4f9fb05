//! One settled step of a track, as a line of JSON and for files.

use std::collections::BTreeMap;

use nalgebra::{Matrix4, Vector4};
use proto::ids::NodeId;
use proto::wire::{GeoRecord, MapReport, MapStatus, MapTrack, packed_covariance};
use serde::Serialize;

use crate::export::iso8601;
use crate::map::{Follower, map_status};
use crate::tracking::Settled;

/// A state on the earth or on a plane.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct StateJson {
    #[serde(flatten)]
    at: PlaceJson,
    /// To the east, or along `x`.
    vx_m_per_s: f64,
    /// To the north, or along `y`.
    vy_m_per_s: f64,
    /// Of the place, `[xx, xy, yy]`.
    cov_m2: [f64; 3],
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(untagged)]
enum PlaceJson {
    Earth { lat_deg: f64, lon_deg: f64, height_m: f64 },
    Plane { x_m: f64, y_m: f64 },
}

/// The plot that a step took.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct ReportJson {
    sensor: NodeId,
    revisit: u32,
    dwell: u32,
    report: u32,
    /// How probable it is that the plot is of this track.
    share: f64,
    /// Which target it really is, where the data say it.
    #[serde(skip_serializing_if = "Option::is_none")]
    truth: Option<u32>,
}

/// One line: a track at one of the times at which it could have been seen.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct StepJson {
    time_s: f64,
    track: u64,
    status: &'static str,
    #[serde(flatten)]
    state: StateJson,
    /// The plot that it took, if any.
    report: Option<ReportJson>,
    /// With what was known a fixed lag later.
    smoothed: StateJson,
}

/// A step with what the summary and files need of it.
pub(crate) struct Step {
    pub(crate) line: StepJson,
    /// On the earth, smoothed; `None` on a plane, and where too little is known to show it.
    pub(crate) on_map: Option<MapTrack>,
    /// `(x, y)` of the plane, smoothed, metres.
    pub(crate) at_m: [f64; 2],
    status: MapStatus,
}

impl Step {
    /// The step that `settled` is; `heights_m` remembers the height of each track's newest plot.
    pub(crate) fn new(
        settled: &Settled,
        follower: &Follower,
        heights_m: &mut BTreeMap<u64, f64>,
    ) -> Self {
        let source = settled.report.and_then(|report| follower.source(report));
        let height_m = heights_m.entry(settled.track).or_insert_with(|| follower.height_m());
        if let Some(source) = &source {
            *height_m = source.height_m;
        }
        let height_m = *height_m;
        let json = |state: &Vector4<f64>, covariance: &Matrix4<f64>| {
            state_json(follower, state, covariance, height_m)
        };
        let status = map_status(settled.status);
        let smoothed = (&settled.smoothed_state, &settled.smoothed_covariance);
        let on_earth = follower.placed(smoothed.0, smoothed.1, height_m);
        let taken = source.as_ref().map(|source| source.report.clone());
        let on_map = on_earth.map(|geo| MapTrack {
            id: settled.track,
            status,
            time_unix_s: settled.time_s,
            place: geo.place,
            velocity_m_per_s: geo.velocity_m_per_s.into(),
            covariance: packed_covariance(&geo.covariance),
            report_count: 0,
            seen_unix_s: settled.time_s,
            report: taken,
            report_share: settled.share,
        });
        // The same as the centre on the network shows.
        let on_map = on_map.filter(|track| track.check().is_ok());
        let line = StepJson {
            time_s: settled.time_s,
            track: settled.track,
            status: status.name(),
            state: json(&settled.state, &settled.covariance),
            report: source
                .map(|source| ReportJson::new(source.report, settled.share, source.truth)),
            smoothed: json(smoothed.0, smoothed.1),
        };
        let at_m = [settled.smoothed_state.x, settled.smoothed_state.y];
        Self { line, on_map, at_m, status }
    }

    pub(crate) fn is_tentative(&self) -> bool {
        self.status == MapStatus::Tentative
    }

    pub(crate) fn id(&self) -> u64 {
        self.line.track
    }

    pub(crate) fn time_s(&self) -> f64 {
        self.line.time_s
    }

    pub(crate) fn status(&self) -> MapStatus {
        self.status
    }

    /// Which target its plot really is; the outer `None` if it took none.
    pub(crate) fn truth(&self) -> Option<Option<u32>> {
        self.line.report.as_ref().map(|report| report.truth)
    }

    pub(crate) fn sensor(&self) -> Option<&NodeId> {
        self.line.report.as_ref().map(|report| &report.sensor)
    }

    /// Time, place and speed for the table.
    pub(crate) fn shown(&self) -> (String, String, f64) {
        let StateJson { at, vx_m_per_s, vy_m_per_s, .. } = &self.line.smoothed;
        let place = match at {
            PlaceJson::Earth { lat_deg, lon_deg, .. } => format!("{lat_deg:.5} {lon_deg:.5}"),
            PlaceJson::Plane { x_m, y_m } => format!("{x_m:.1} {y_m:.1}"),
        };
        let time_s = self.time_s();
        let calendar = self.on_map.as_ref().and_then(|_| iso8601(time_s).ok());
        let time = calendar.unwrap_or_else(|| format!("{time_s:.1} s"));
        (time, place, vx_m_per_s.hypot(*vy_m_per_s))
    }
}

impl ReportJson {
    fn new(report: MapReport, share: f64, truth: Option<u32>) -> Self {
        let MapReport { node, revisit_index, dwell_index, report_index } = report;
        Self {
            sensor: node,
            revisit: revisit_index,
            dwell: dwell_index,
            report: report_index,
            share,
            truth,
        }
    }
}

fn state_json(
    follower: &Follower,
    state: &Vector4<f64>,
    covariance: &Matrix4<f64>,
    height_m: f64,
) -> StateJson {
    let packed = |matrix: &Matrix4<f64>| [matrix[(0, 0)], matrix[(0, 1)], matrix[(1, 1)]];
    if let Some(geo) = follower.placed(state, covariance, height_m) {
        let GeoRecord { lat_deg, lon_deg, .. } = geo.place;
        return StateJson {
            at: PlaceJson::Earth { lat_deg, lon_deg, height_m },
            vx_m_per_s: geo.velocity_m_per_s.x,
            vy_m_per_s: geo.velocity_m_per_s.y,
            cov_m2: packed(&geo.covariance),
        };
    }
    StateJson {
        at: PlaceJson::Plane { x_m: state.x, y_m: state.y },
        vx_m_per_s: state.z,
        vy_m_per_s: state.w,
        cov_m2: packed(covariance),
    }
}
