//! Tracks on the map as the exports take them.

use nalgebra::{Matrix2, Vector2};
use proto::geodesy::{GeoPosition, GeodesyError};
use proto::wire::{MapStatus, MapTrack};

use crate::export::{GeoFix, GeoTrack, TrackStatus};

/// What an export says of a track beside its present state.
#[derive(Clone, Debug, PartialEq)]
pub struct Past {
    /// When it was first seen, Unix seconds.
    pub first_seen_unix_s: f64,
    /// Names of the sensors that it was seen by.
    pub sensors: Vec<String>,
    /// Where it was, oldest first.
    pub fixes: Vec<GeoFix>,
}

impl Past {
    /// Adds where a track is, unless it is known, and who saw it; at most `most` places are kept.
    pub(super) fn take(&mut self, place: GeoFix, sensor: Option<String>, most: usize) {
        let is_news = self.fixes.last().is_none_or(|last| last.time_unix_s < place.time_unix_s);
        if is_news {
            self.fixes.push(place);
            let surplus = self.fixes.len().saturating_sub(most);
            self.fixes.drain(..surplus);
        }
        if let Some(sensor) = sensor.filter(|sensor| !self.sensors.contains(sensor)) {
            self.sensors.push(sensor);
        }
    }
}

/// `track` with its past, under a name that holds for one `session` of the centre.
///
/// # Errors
/// If its place is none.
pub fn geo_track(track: &MapTrack, past: &Past, session: &str) -> Result<GeoTrack, GeodesyError> {
    let covariance = track.covariance_matrix();
    let block = |at: usize| -> Matrix2<f64> { covariance.fixed_view::<2, 2>(at, at).into_owned() };
    Ok(GeoTrack {
        id: track.id,
        name: GeoTrack::name_of("transmural", session, track.id),
        status: status(track.status),
        time_unix_s: track.time_unix_s,
        position: position(track)?,
        velocity_m_per_s: Vector2::from(track.velocity_m_per_s),
        covariance_m2: block(0),
        velocity_covariance_m2_per_s2: Some(block(2)),
        height_sigma_m: None,
        first_seen_unix_s: past.first_seen_unix_s,
        last_seen_unix_s: track.seen_unix_s,
        sensors: past.sensors.clone(),
        report: track.report.as_ref().map(|report| u64::from(report.report_index)),
        history: past.fixes.clone(),
    })
}

/// Where a track is, and when.
///
/// # Errors
/// If its place is none.
pub fn fix(track: &MapTrack) -> Result<GeoFix, GeodesyError> {
    Ok(GeoFix { time_unix_s: track.time_unix_s, position: position(track)? })
}

fn position(track: &MapTrack) -> Result<GeoPosition, GeodesyError> {
    GeoPosition::new(track.place.lat_deg, track.place.lon_deg, track.place.height_m)
}

fn status(status: MapStatus) -> TrackStatus {
    match status {
        MapStatus::Tentative => TrackStatus::Tentative,
        MapStatus::Confirmed => TrackStatus::Confirmed,
        MapStatus::Coasting => TrackStatus::Coasting,
        MapStatus::Stopped => TrackStatus::Stopped,
    }
}
