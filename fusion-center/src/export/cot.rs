//! A track as a Cursor-on-Target event of version 2.0, for TAK clients; one event, one datagram.
//!
//! Written after MITRE's public base-event, track, contact and remarks schemas \[cot-event\].
//! `uid` is the track's name, the same for its whole life. `how` says where the place comes from:
//! `m-f` fused by a machine, `m-p` predicted while the track coasts, `m-s` simulated (then `opex`
//! is `s` as well). `time` is when the event is written, `start` the time of the estimate, `stale`
//! some revisits later. `hae` is above the ellipsoid. `ce` is by default one standard deviation
//! along the larger axis, as the schema asks; clients that draw it as a circle of 90 % (ATAK's
//! documentation speaks of CE90) are served by [`CircularError::Share`]. `le` is one standard
//! deviation, 9999999 where the height is not measured.

use serde::{Deserialize, Serialize};

use super::xml::Xml;
use super::{
    CircularError, DATAGRAM_BYTES_MAX, ExportError, GeoTrack, Origin, TrackStatus, iso8601,
};

/// Stands for an error that is not known.
const UNKNOWN_M: f64 = 9_999_999.0;

/// How events are written.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CotSettings {
    /// What the thing is, in the words of MIL-STD-2525: unknown on the ground.
    pub kind: String,
    /// Whether the tracks come out of a simulation.
    pub origin: Origin,
    /// Time between two looks at a target, seconds.
    pub revisit_s: f64,
    /// An event is out of date after this many revisits.
    pub stale_after_revisits: f64,
    /// What `ce` means.
    pub circular_error: CircularError,
}

impl Default for CotSettings {
    fn default() -> Self {
        Self {
            kind: "a-u-G".to_owned(),
            origin: Origin::Live,
            revisit_s: 5.0,
            stale_after_revisits: 3.0,
            circular_error: CircularError::Sigma,
        }
    }
}

impl CotSettings {
    /// Refuses settings that mean nothing.
    ///
    /// # Errors
    /// If a number is outside its range.
    pub fn check(&self) -> Result<(), ExportError> {
        let is_field = |field: &str| field.chars().all(|c| c.is_ascii_alphanumeric());
        if !self.kind.split('-').all(|field| !field.is_empty() && is_field(field)) {
            return Err(ExportError::CotKind { kind: self.kind.clone() });
        }
        let times =
            [("revisit_s", self.revisit_s), ("stale_after_revisits", self.stale_after_revisits)];
        for (name, value) in times {
            if !(1e-3..=1e5).contains(&value) {
                return Err(ExportError::Setting { name, value, range: "[0.001, 100000]" });
            }
        }
        match self.circular_error {
            CircularError::Share(value) if !(1e-3..=0.999).contains(&value) => {
                Err(ExportError::Setting { name: "circular_error", value, range: "[0.001, 0.999]" })
            }
            _ => Ok(()),
        }
    }
}

/// The event of a track, written at `now_unix_s`, seconds since 1970 UTC.
///
/// # Errors
/// If the track says something that is not possible or takes more than a datagram.
pub fn event(
    track: &GeoTrack,
    now_unix_s: f64,
    settings: &CotSettings,
) -> Result<String, ExportError> {
    track.check()?;
    settings.check()?;
    let sensors = if track.sensors.is_empty() { "none" } else { &track.sensors.join(", ") };
    let named = written(track, now_unix_s, settings, sensors)?;
    if named.len() <= DATAGRAM_BYTES_MAX {
        return Ok(named);
    }
    let count = format!("{} sensors", track.sensors.len());
    let counted = written(track, now_unix_s, settings, &count)?;
    let (id, bytes, limit) = (track.id, counted.len(), DATAGRAM_BYTES_MAX);
    if bytes <= limit { Ok(counted) } else { Err(ExportError::TooLong { id, bytes, limit }) }
}

fn written(
    track: &GeoTrack,
    now_unix_s: f64,
    settings: &CotSettings,
    sensors: &str,
) -> Result<String, ExportError> {
    let stale_s = settings.revisit_s * settings.stale_after_revisits;
    let (time, start) = (iso8601(now_unix_s)?, iso8601(track.time_unix_s)?);
    let stale = iso8601(track.time_unix_s + stale_s)?;
    let (how, opex) = match (settings.origin, track.status) {
        (Origin::Simulated, _) => ("m-s", "s"),
        (Origin::Live, TrackStatus::Coasting) => ("m-p", "o"),
        (Origin::Live, _) => ("m-f", "o"),
    };
    let mut xml = Xml::new(None)?;
    let attributes = [
        ("version", "2.0"),
        ("uid", track.name.as_str()),
        ("type", settings.kind.as_str()),
        ("how", how),
        ("opex", opex),
        ("time", &time),
        ("start", &start),
        ("stale", &stale),
    ];
    xml.open("event", &attributes)?;
    point(&mut xml, track, settings)?;
    xml.open("detail", &[])?;
    let callsign = format!("T{}", track.id);
    xml.empty("contact", &[("callsign", &callsign)])?;
    let (course, speed) = course_and_speed(track);
    xml.empty("track", &[("course", &course), ("speed", &speed)])?;
    xml.text("remarks", &format!("{}; seen by {sensors}", track.status.word()))?;
    xml.close("detail")?;
    xml.close("event")?;
    Ok(xml.finish())
}

fn point(xml: &mut Xml, track: &GeoTrack, settings: &CotSettings) -> Result<(), ExportError> {
    let at = &track.position;
    // Longitudes of −180 to 180 are allowed here, both ends included.
    let (lat, lon) = (format!("{:.8}", at.lat_deg()), format!("{:.8}", at.lon_deg()));
    let hae = format!("{:.2}", at.height_m());
    let ce = format!("{:.2}", settings.circular_error.radius_m(track)?);
    let le = format!("{:.2}", track.height_sigma_m.unwrap_or(UNKNOWN_M));
    let attributes =
        [("lat", lat.as_str()), ("lon", &lon), ("hae", &hae), ("ce", &ce), ("le", &le)];
    xml.empty("point", &attributes)
}

/// The course is less than 360 when written, too.
fn course_and_speed(track: &GeoTrack) -> (String, String) {
    let course = format!("{:.2}", track.course_deg());
    let course = if course == "360.00" { "0.00".to_owned() } else { course };
    (course, format!("{:.2}", track.speed_m_per_s()))
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;
    use crate::export::sample;

    fn simulated() -> CotSettings {
        CotSettings {
            origin: Origin::Simulated,
            revisit_s: sample::REVISIT_S,
            ..Default::default()
        }
    }

    #[test]
    fn the_event_is_stale_after_some_revisits_of_the_estimate() {
        let text = event(&sample::confirmed(), sample::NOON_UNIX_S + 99.0, &simulated()).unwrap();
        for part in [
            "time=\"2026-11-22T12:01:39.000Z\"",
            "start=\"2026-11-22T12:00:40.000Z\"",
            "stale=\"2026-11-22T12:00:52.000Z\"",
            "how=\"m-s\"",
            "uid=\"transmural-20261122T1200-7\"",
            "course=\"53.13\" speed=\"12.50\"",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
    }

    #[test]
    fn the_circular_error_is_what_the_settings_say() {
        let track = sample::confirmed();
        let ce = |circular_error| {
            let settings = CotSettings { circular_error, ..simulated() };
            let text = event(&track, track.time_unix_s, &settings).unwrap();
            let after = text.split("ce=\"").nth(1).unwrap();
            after.split('"').next().unwrap().parse::<f64>().unwrap()
        };
        // The larger eigenvalue of [900 420; 420 400] is 650 + √(250² + 420²).
        let sigma_m = (650.0 + 250.0_f64.hypot(420.0)).sqrt();
        assert!((ce(CircularError::Sigma) - sigma_m).abs() < 0.01);
        assert!(ce(CircularError::Share(0.9)) > 1.6 * sigma_m);
    }

    #[test]
    fn a_course_just_short_of_north_is_written_as_north() {
        let track = GeoTrack { velocity_m_per_s: Vector2::new(-1e-6, 10.0), ..sample::confirmed() };
        let text = event(&track, track.time_unix_s, &simulated()).unwrap();
        assert!(text.contains("course=\"0.00\""), "{text}");
    }

    #[test]
    fn an_event_fits_a_datagram_or_is_refused() {
        let mut track = sample::confirmed();
        track.sensors = (0..500).map(|index| format!("sensor-{index}")).collect();
        let text = event(&track, track.time_unix_s, &simulated()).unwrap();
        assert!(text.len() <= DATAGRAM_BYTES_MAX && text.contains("500 sensors"), "{text}");
        track.name = "n".repeat(2_000);
        let error = event(&track, track.time_unix_s, &simulated()).unwrap_err();
        assert!(matches!(error, ExportError::TooLong { id: 7, .. }), "{error}");
    }

    #[test]
    fn a_kind_that_no_client_knows_is_refused() {
        for kind in ["", "a-", "a--G", "a-u G", "a-<"] {
            let settings = CotSettings { kind: kind.to_owned(), ..simulated() };
            let error = settings.check().unwrap_err();
            assert!(matches!(error, ExportError::CotKind { .. }), "{error}");
        }
    }

    #[test]
    fn settings_that_mean_nothing_are_refused() {
        for settings in [
            CotSettings { revisit_s: 0.0, ..simulated() },
            CotSettings { stale_after_revisits: f64::NAN, ..simulated() },
            CotSettings { circular_error: CircularError::Share(90.0), ..simulated() },
        ] {
            let error = event(&sample::confirmed(), 0.0, &settings).unwrap_err();
            assert!(matches!(error, ExportError::Setting { .. }), "{error}");
        }
        assert!(event(&sample::confirmed(), f64::NAN, &simulated()).is_err());
    }
}
