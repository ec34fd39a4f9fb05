//! Tracks on the earth as other programs read them: GeoJSON, KML, CSV, Cursor-on-Target, CAT062.
//!
//! Everything here turns a [`GeoTrack`] into text or bytes; files and sockets are the caller's.
//! What a reader of each format finds is said in its module. Times are UTC, positions WGS 84,
//! heights above the ellipsoid, courses clockwise from true north.

pub mod cat062;
pub mod cot;
pub mod csv;
mod ellipse;
pub mod figure;
pub mod geojson;
pub mod kml;
mod meridian;
mod stamp;
mod xml;

#[cfg(test)]
mod golden_tests;
#[cfg(test)]
mod sample;

use nalgebra::{Matrix2, Vector2};
use proto::geodesy::{GeoPosition, GeodesyError};
use serde::{Deserialize, Serialize};

pub use ellipse::{CircularError, ELLIPSE_SHARE};
pub use stamp::iso8601;

/// Negative variances and correlations beyond one by no more than this share of the trace are
/// rounding of the filter that made them, not a mistake of its caller.
const COVARIANCE_ROUNDING: f64 = 1e-9;

/// What is safe in one datagram on any path of the Internet with Ethernet's 1500 bytes.
pub const DATAGRAM_BYTES_MAX: usize = 1_400;
/// Where the data of the tracks come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Origin {
    /// From sensors.
    Live,
    /// Out of a simulation.
    Simulated,
}

/// What a tracker believes of a track.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TrackStatus {
    /// Seen, not yet believed.
    Tentative,
    /// Seen often enough.
    Confirmed,
    /// Looked for and not seen of late; its place is predicted.
    Coasting,
    /// Unseen because it stands still; its place is the last one.
    Stopped,
}

impl TrackStatus {
    /// All, in the order of a track's life.
    pub const ALL: [Self; 4] = [Self::Tentative, Self::Confirmed, Self::Coasting, Self::Stopped];

    /// The word in every text format.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Tentative => "tentative",
            Self::Confirmed => "confirmed",
            Self::Coasting => "coasting",
            Self::Stopped => "stopped",
        }
    }
}

/// Where a track was.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeoFix {
    /// Seconds since 1970 UTC, leap seconds not counted.
    pub time_unix_s: f64,
    /// The place.
    pub position: GeoPosition,
}

/// A track as every format needs it, at one time.
#[derive(Clone, Debug, PartialEq)]
pub struct GeoTrack {
    /// The tracker's number, never used again within a run.
    pub id: u64,
    /// Unique in the world and the same for the track's whole life, see [`GeoTrack::name_of`].
    pub name: String,
    /// What is believed of it.
    pub status: TrackStatus,
    /// Time of the estimate, seconds since 1970 UTC.
    pub time_unix_s: f64,
    /// Where it is.
    pub position: GeoPosition,
    /// Towards true east and true north at the position, metres per second.
    pub velocity_m_per_s: Vector2<f64>,
    /// Of the horizontal position, east and north at the position, m².
    pub covariance_m2: Matrix2<f64>,
    /// Of the velocity, m²/s², where the filter has one.
    pub velocity_covariance_m2_per_s2: Option<Matrix2<f64>>,
    /// One standard deviation of the height, metres; none where the height is unknown or assumed.
    pub height_sigma_m: Option<f64>,
    /// When it was first seen, seconds since 1970 UTC.
    pub first_seen_unix_s: f64,
    /// When it was last seen, seconds since 1970 UTC.
    pub last_seen_unix_s: f64,
    /// Names of the sensors that contributed to this estimate.
    pub sensors: Vec<String>,
    /// The report that was last given to it, where reports are numbered.
    pub report: Option<u64>,
    /// Where it was, oldest first; the present place need not be among them.
    pub history: Vec<GeoFix>,
}

impl GeoTrack {
    /// A name that is unique in the world if `system` is among the recipients' systems and
    /// `session` (a start time, say) among that system's runs.
    #[must_use]
    pub fn name_of(system: &str, session: &str, id: u64) -> String {
        format!("{system}-{session}-{id}")
    }

    /// Clockwise from true north in [0, 360), degrees; 0 for what stands still.
    #[must_use]
    pub fn course_deg(&self) -> f64 {
        let course_deg =
            self.velocity_m_per_s.x.atan2(self.velocity_m_per_s.y).to_degrees().rem_euclid(360.0);
        // A tiny negative angle rounds up to a whole turn.
        if course_deg < 360.0 { course_deg } else { 0.0 }
    }

    /// Over ground, metres per second.
    #[must_use]
    pub fn speed_m_per_s(&self) -> f64 {
        self.velocity_m_per_s.norm()
    }

    /// The way so far, the present place last.
    pub fn fixes(&self) -> impl Iterator<Item = GeoFix> + '_ {
        let now = GeoFix { time_unix_s: self.time_unix_s, position: self.position };
        self.history
            .iter()
            .copied()
            .filter(move |fix| fix.time_unix_s < now.time_unix_s)
            .chain([now])
    }

    /// Refuses what no format can say.
    ///
    /// # Errors
    /// If a time, velocity or covariance is none.
    pub fn check(&self) -> Result<(), ExportError> {
        let id = self.id;
        let times_s = [self.time_unix_s, self.first_seen_unix_s, self.last_seen_unix_s];
        let passed_s = self.history.iter().map(|fix| fix.time_unix_s);
        for time_unix_s in times_s.into_iter().chain(passed_s) {
            iso8601(time_unix_s)?;
        }
        if !self.velocity_m_per_s.iter().all(|value| value.is_finite()) {
            return Err(ExportError::Velocity { id });
        }
        let covariances = [Some(self.covariance_m2), self.velocity_covariance_m2_per_s2];
        let sound = covariances.iter().flatten().all(is_covariance);
        let height_sound =
            self.height_sigma_m.is_none_or(|sigma_m| (0.0..f64::MAX).contains(&sigma_m));
        if sound && height_sound { Ok(()) } else { Err(ExportError::Covariance { id }) }
    }
}

fn is_covariance(matrix: &Matrix2<f64>) -> bool {
    let margin = COVARIANCE_ROUNDING * matrix.trace();
    let axes_sound = matrix.symmetric_eigenvalues().iter().all(|value| *value >= -margin);
    let symmetric = (matrix.m12 - matrix.m21).abs() <= margin;
    matrix.iter().all(|value| value.is_finite()) && axes_sound && symmetric
}

/// What a format cannot say.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// Before 1970, after 9999, or not a number.
    #[error("{time_unix_s} s is no time between 1970 and 9999; are these seconds since 1970?")]
    Time {
        /// As given, seconds.
        time_unix_s: f64,
    },
    /// Not finite.
    #[error("the velocity of track {id} is not finite; leave the track out")]
    Velocity {
        /// Whose.
        id: u64,
    },
    /// Not symmetric, not positive semi-definite, or not finite.
    #[error("a covariance of track {id} is none (east, north, m²); leave the track out")]
    Covariance {
        /// Whose.
        id: u64,
    },
    /// A setting that means nothing.
    #[error("{name} = {value} of the track output is outside {range}; change the setting")]
    Setting {
        /// Which.
        name: &'static str,
        /// As given.
        value: f64,
        /// What it may be.
        range: &'static str,
    },
    /// Not made of letters, digits and single dashes.
    #[error("{kind:?} is no Cursor-on-Target type; write one such as a-u-G")]
    CotKind {
        /// As given.
        kind: String,
    },
    /// Longer than one datagram or one length field takes.
    #[error("track {id} takes {bytes} bytes of {limit}; shorten its name")]
    TooLong {
        /// Whose.
        id: u64,
        /// What it takes.
        bytes: usize,
        /// What there is.
        limit: usize,
    },
    /// All track numbers of CAT062 are in use.
    #[error("{in_use} tracks are alive at once and CAT062 numbers no more; release ended ones")]
    TrackNumbers {
        /// Tracks that hold a number.
        in_use: usize,
    },
    /// A place that the format's geometry leads to is none.
    #[error(transparent)]
    Geodesy(#[from] GeodesyError),
    /// The library that writes XML.
    #[error("writing XML: {0}")]
    Xml(#[from] std::io::Error),
    /// The library that writes CSV.
    #[error("writing CSV: {0}")]
    Csv(#[from] ::csv::Error),
    /// The library that writes JSON.
    #[error("writing JSON: {0}")]
    Json(#[from] serde_json::Error),
    /// The drawing library.
    #[error("drawing the map: {0}")]
    Drawing(String),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn courses_run_clockwise_from_north() {
        let mut track = sample::confirmed();
        let cases = [(0.0, 0.0, 0.0), (0.0, 3.0, 0.0), (3.0, 0.0, 90.0), (0.0, -3.0, 180.0)];
        for (east, north, course_deg) in cases.into_iter().chain([(-3.0, 0.0, 270.0)]) {
            track.velocity_m_per_s = Vector2::new(east, north);
            assert!((track.course_deg() - course_deg).abs() < 1e-12, "{east} {north}");
        }
        track.velocity_m_per_s = Vector2::new(-1e-300, 1.0);
        assert!(track.course_deg() < 360.0);
    }

    #[test]
    fn the_way_ends_at_the_present_place_once() {
        let mut track = sample::confirmed();
        let count = track.history.len();
        assert_eq!(track.fixes().count(), count + 1);
        track.history.push(GeoFix { time_unix_s: track.time_unix_s, position: track.position });
        assert_eq!(track.fixes().count(), count + 1);
        assert_eq!(track.fixes().last().unwrap().position, track.position);
    }

    #[test]
    fn tracks_that_no_format_can_say_are_refused() {
        assert!(sample::confirmed().check().is_ok());
        let spoilt = |spoil: fn(&mut GeoTrack)| {
            let mut track = sample::confirmed();
            spoil(&mut track);
            track.check().unwrap_err()
        };
        let time = spoilt(|track| track.history[0].time_unix_s = -1.0);
        assert!(matches!(time, ExportError::Time { .. }), "{time}");
        let velocity = spoilt(|track| track.velocity_m_per_s.x = f64::NAN);
        assert!(matches!(velocity, ExportError::Velocity { .. }), "{velocity}");
        let spoilers: [fn(&mut GeoTrack); 5] = [
            |track| track.covariance_m2 = Matrix2::new(1.0, 2.0, 2.0, 1.0),
            |track| track.covariance_m2 = Matrix2::new(4.0, 1.0, 0.0, 4.0),
            |track| track.covariance_m2.m11 = f64::INFINITY,
            |track| track.velocity_covariance_m2_per_s2 = Some(-Matrix2::identity()),
            |track| track.height_sigma_m = Some(-1.0),
        ];
        for spoil in spoilers {
            let error = spoilt(spoil);
            assert!(matches!(error, ExportError::Covariance { .. }), "{error}");
        }
        let unseen = spoilt(|track| track.last_seen_unix_s = f64::NAN);
        assert!(matches!(unseen, ExportError::Time { .. }), "{unseen}");
    }
}
