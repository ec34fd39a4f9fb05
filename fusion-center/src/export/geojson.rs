//! Tracks as a GeoJSON feature collection (RFC 7946), for GIS programs and web maps.
//!
//! Each track gives up to three features with the same `track` and `name`, told apart by `kind`:
//! - `position`, a Point with its height, and with all properties;
//! - `history`, a LineString of where it was (a MultiLineString where it crosses the
//!   antimeridian), with `start_utc` and `end_utc`; only where there are two places;
//! - `ellipse`, a Polygon (or MultiPolygon) that holds 95 % of the probability, `share` 0.95;
//!   left out where it is a point or within 0.1 degrees of a pole.
//!
//! Properties of a position: `track` (number), `name`, `status` (`tentative`, `confirmed`,
//! `coasting`, `stopped`), `time_utc` (ISO 8601), `time_unix_s`, `course_deg` (clockwise from true
//! north), `speed_m_per_s`, `velocity_m_per_s` (east, north), `cov_m2` (ee, en, nn),
//! `height_sigma_m` (or null), `first_seen_utc`, `last_seen_utc`, `sensors`, `report` (or null).

use proto::geodesy::GeoPosition;
use serde_json::{Value, json};

use super::meridian::{LonLat, cut_line, cut_ring};
use super::{ELLIPSE_SHARE, ExportError, GeoFix, GeoTrack, ellipse, iso8601};

/// Coordinates are written to this many parts of a degree: a millimetre.
const PARTS_PER_DEGREE: f64 = 1e8;
/// Nearer to a pole outlines are not cut, degrees.
const POLE_MARGIN_DEG: f64 = 0.1;

/// The collection as text, one feature on each line.
///
/// # Errors
/// If a track says something that is not possible.
pub fn collection(tracks: &[GeoTrack]) -> Result<String, ExportError> {
    let mut lines = Vec::new();
    for track in tracks {
        for feature in features(track)? {
            lines.push(serde_json::to_string(&feature)?);
        }
    }
    let features = lines.join(",\n");
    Ok(format!("{{\"type\":\"FeatureCollection\",\"features\":[\n{features}\n]}}\n"))
}

/// The features of one track.
///
/// # Errors
/// If it says something that is not possible.
pub fn features(track: &GeoTrack) -> Result<Vec<Value>, ExportError> {
    track.check()?;
    let found = [Some(position(track)?), history(track)?, outline(track)?];
    Ok(found.into_iter().flatten().collect())
}

fn position(track: &GeoTrack) -> Result<Value, ExportError> {
    let at = &track.position;
    let [lon_deg, lat_deg] = rounded([at.lon_deg(), at.lat_deg()]);
    let (velocity, cov) = (&track.velocity_m_per_s, &track.covariance_m2);
    let properties = json!({
        "kind": "position",
        "track": track.id,
        "name": track.name,
        "status": track.status.word(),
        "time_utc": iso8601(track.time_unix_s)?,
        "time_unix_s": track.time_unix_s,
        "course_deg": to_millionths(track.course_deg()),
        "speed_m_per_s": to_millionths(track.speed_m_per_s()),
        "velocity_m_per_s": [velocity.x, velocity.y],
        "cov_m2": [cov.m11, cov.m12, cov.m22],
        "height_sigma_m": track.height_sigma_m,
        "first_seen_utc": iso8601(track.first_seen_unix_s)?,
        "last_seen_utc": iso8601(track.last_seen_unix_s)?,
        "sensors": track.sensors,
        "report": track.report,
    });
    let height_m = (at.height_m() * 1e3).round() / 1e3;
    let geometry = json!({ "type": "Point", "coordinates": [lon_deg, lat_deg, height_m] });
    Ok(feature(geometry, properties))
}

fn history(track: &GeoTrack) -> Result<Option<Value>, ExportError> {
    let fixes: Vec<GeoFix> = track.fixes().collect();
    let [first, .., last] = fixes.as_slice() else { return Ok(None) };
    let properties = json!({
        "kind": "history",
        "track": track.id,
        "name": track.name,
        "status": track.status.word(),
        "start_utc": iso8601(first.time_unix_s)?,
        "end_utc": iso8601(last.time_unix_s)?,
    });
    let places: Vec<GeoPosition> = fixes.iter().map(|fix| fix.position).collect();
    let pieces = cut_line(&places).into_iter().map(all_rounded);
    Ok(Some(feature(one_or_many("LineString", pieces.collect()), properties)))
}

fn outline(track: &GeoTrack) -> Result<Option<Value>, ExportError> {
    let at_pole = track.position.lat_deg().abs() > 90.0 - POLE_MARGIN_DEG;
    let is_point = track.covariance_m2.trace() <= 0.0;
    if at_pole || is_point {
        return Ok(None);
    }
    let properties = json!({
        "kind": "ellipse",
        "track": track.id,
        "name": track.name,
        "status": track.status.word(),
        "share": ELLIPSE_SHARE,
    });
    let rings = cut_ring(&ellipse::corners(track)?).into_iter().map(all_rounded);
    // A polygon is a list of rings, the first of them its border.
    let polygons = rings.map(|ring| [ring]).collect();
    Ok(Some(feature(one_or_many("Polygon", polygons), properties)))
}

fn one_or_many<T: serde::Serialize>(kind: &str, mut parts: Vec<T>) -> Value {
    match parts.pop() {
        Some(only) if parts.is_empty() => json!({ "type": kind, "coordinates": only }),
        last => {
            parts.extend(last);
            json!({ "type": format!("Multi{kind}"), "coordinates": parts })
        }
    }
}

fn feature(geometry: Value, properties: Value) -> Value {
    json!({ "type": "Feature", "geometry": geometry, "properties": properties })
}

fn all_rounded(corners: Vec<LonLat>) -> Vec<LonLat> {
    corners.into_iter().map(rounded).collect()
}

/// Digits beyond are of the arithmetic, and not the same on every machine.
fn to_millionths(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

fn rounded(place_deg: LonLat) -> LonLat {
    place_deg.map(|value| (value * PARTS_PER_DEGREE).round() / PARTS_PER_DEGREE)
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix2;

    use super::*;
    use crate::export::sample;

    #[test]
    fn longitude_comes_first_and_a_degree_is_kept_to_a_millimetre() {
        let features = features(&sample::confirmed()).unwrap();
        let at = sample::confirmed().position;
        let point = &features[0]["geometry"]["coordinates"];
        assert!((point[0].as_f64().unwrap() - at.lon_deg()).abs() < 6e-9, "{point}");
        assert!((point[1].as_f64().unwrap() - at.lat_deg()).abs() < 6e-9, "{point}");
        assert!((point[2].as_f64().unwrap() - 1_050.0).abs() < 1e-3, "{point}");
        assert_eq!(features[1]["geometry"]["coordinates"].as_array().unwrap().len(), 11);
    }

    #[test]
    fn what_crosses_the_antimeridian_comes_in_two_pieces() {
        let features = features(&sample::across_the_antimeridian()).unwrap();
        assert_eq!(features[1]["geometry"]["type"], "MultiLineString");
        assert_eq!(features[2]["geometry"]["type"], "MultiPolygon");
        let rings = features[2]["geometry"]["coordinates"].as_array().unwrap();
        assert!(rings.iter().all(|rings| rings[0][0]
            == rings[0].as_array().unwrap()[rings[0].as_array().unwrap().len() - 1]));
    }

    #[test]
    fn a_new_track_has_no_history_and_an_exact_one_no_ellipse() {
        let mut track = sample::confirmed();
        track.history.clear();
        track.covariance_m2 = Matrix2::zeros();
        let kinds: Vec<Value> =
            features(&track).unwrap().iter().map(|one| one["properties"]["kind"].clone()).collect();
        assert_eq!(kinds, ["position"]);
        track.covariance_m2 = Matrix2::identity();
        track.position = sample::position(89.95, 0.0, 0.0);
        assert_eq!(features(&track).unwrap().len(), 1);
    }

    #[test]
    fn an_impossible_track_is_refused() {
        let track = GeoTrack { time_unix_s: f64::NAN, ..sample::confirmed() };
        assert!(matches!(collection(&[track]), Err(ExportError::Time { .. })));
    }
}
