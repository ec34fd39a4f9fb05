//! Tracks as KML 2.2 with `gx:Track`, for globes that show time.
//!
//! A folder for each track holds its way (`gx:Track`: a `when` and a `gx:coord` for each place,
//! clamped to the ground, styled by status) and the outline that holds 95 % of the probability at
//! its last place. The numbers are under `ExtendedData` with the names of the GeoJSON properties.

use proto::geodesy::GeoPosition;

use super::meridian::{LonLat, cut_ring};
use super::xml::Xml;
use super::{ExportError, GeoFix, GeoTrack, TrackStatus, ellipse, iso8601};

/// Nearer to a pole outlines are left out, degrees.
const POLE_MARGIN_DEG: f64 = 0.1;

/// The document as text.
///
/// # Errors
/// If a track says something that is not possible.
pub fn document(title: &str, tracks: &[GeoTrack]) -> Result<String, ExportError> {
    let mut xml = Xml::new(Some(1))?;
    let spaces = [
        ("xmlns", "http://www.opengis.net/kml/2.2"),
        ("xmlns:gx", "http://www.google.com/kml/ext/2.2"),
    ];
    xml.open("kml", &spaces)?;
    xml.open("Document", &[])?;
    xml.text("name", title)?;
    for status in TrackStatus::ALL {
        style(&mut xml, status)?;
    }
    for track in tracks {
        folder(&mut xml, track)?;
    }
    xml.close("Document")?;
    xml.close("kml")?;
    Ok(xml.finish() + "\n")
}

/// Colours are alpha, blue, green, red.
fn style(xml: &mut Xml, status: TrackStatus) -> Result<(), ExportError> {
    let (color, width) = match status {
        TrackStatus::Tentative => ("ff9f9f9f", "1"),
        TrackStatus::Confirmed => ("ffb27200", "3"),
        TrackStatus::Coasting => ("ff005ed5", "2"),
        TrackStatus::Stopped => ("ff739e00", "2"),
    };
    xml.open("Style", &[("id", status.word())])?;
    xml.open("IconStyle", &[])?;
    xml.text("color", color)?;
    xml.close("IconStyle")?;
    xml.open("LineStyle", &[])?;
    xml.text("color", color)?;
    xml.text("width", width)?;
    xml.close("LineStyle")?;
    xml.open("PolyStyle", &[])?;
    xml.text("fill", "0")?;
    xml.close("PolyStyle")?;
    xml.close("Style")
}

fn folder(xml: &mut Xml, track: &GeoTrack) -> Result<(), ExportError> {
    track.check()?;
    xml.open("Folder", &[])?;
    xml.text("name", &format!("{} {}", track.id, track.status.word()))?;
    way(xml, track)?;
    let at_pole = track.position.lat_deg().abs() > 90.0 - POLE_MARGIN_DEG;
    if !at_pole && track.covariance_m2.trace() > 0.0 {
        outline(xml, track)?;
    }
    xml.close("Folder")
}

fn way(xml: &mut Xml, track: &GeoTrack) -> Result<(), ExportError> {
    xml.open("Placemark", &[])?;
    xml.text("name", &track.name)?;
    xml.text("styleUrl", &format!("#{}", track.status.word()))?;
    data(xml, track)?;
    xml.open("gx:Track", &[])?;
    xml.text("altitudeMode", "clampToGround")?;
    let fixes: Vec<GeoFix> = track.fixes().collect();
    for fix in &fixes {
        xml.text("when", &iso8601(fix.time_unix_s)?)?;
    }
    for GeoFix { position, .. } in &fixes {
        let [lon, lat] = [position.lon_deg(), position.lat_deg()];
        xml.text("gx:coord", &format!("{lon:.8} {lat:.8} {:.2}", position.height_m()))?;
    }
    xml.close("gx:Track")?;
    xml.close("Placemark")
}

fn data(xml: &mut Xml, track: &GeoTrack) -> Result<(), ExportError> {
    let cov = &track.covariance_m2;
    let rows = [
        ("track", track.id.to_string()),
        ("status", track.status.word().to_owned()),
        ("time_utc", iso8601(track.time_unix_s)?),
        ("course_deg", format!("{:.2}", track.course_deg())),
        ("speed_m_per_s", format!("{:.3}", track.speed_m_per_s())),
        ("cov_m2", format!("{} {} {}", cov.m11, cov.m12, cov.m22)),
        ("sensors", track.sensors.join(" ")),
        ("report", track.report.map(|report| report.to_string()).unwrap_or_default()),
    ];
    xml.open("ExtendedData", &[])?;
    for (name, value) in rows {
        xml.open("Data", &[("name", name)])?;
        xml.text("value", &value)?;
        xml.close("Data")?;
    }
    xml.close("ExtendedData")
}

fn outline(xml: &mut Xml, track: &GeoTrack) -> Result<(), ExportError> {
    let corners: Vec<GeoPosition> = ellipse::corners(track)?;
    xml.open("Placemark", &[])?;
    xml.text("name", &format!("{} 95 %", track.id))?;
    xml.open("TimeStamp", &[])?;
    xml.text("when", &iso8601(track.time_unix_s)?)?;
    xml.close("TimeStamp")?;
    xml.text("styleUrl", &format!("#{}", track.status.word()))?;
    xml.open("MultiGeometry", &[])?;
    for ring in cut_ring(&corners) {
        polygon(xml, &ring)?;
    }
    xml.close("MultiGeometry")?;
    xml.close("Placemark")
}

fn polygon(xml: &mut Xml, ring: &[LonLat]) -> Result<(), ExportError> {
    let corners = ring.iter().map(|[lon_deg, lat_deg]| format!("{lon_deg:.8},{lat_deg:.8}"));
    xml.open("Polygon", &[])?;
    xml.open("outerBoundaryIs", &[])?;
    xml.open("LinearRing", &[])?;
    xml.text("coordinates", &corners.collect::<Vec<_>>().join(" "))?;
    xml.close("LinearRing")?;
    xml.close("outerBoundaryIs")?;
    xml.close("Polygon")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::sample;

    #[test]
    fn every_place_has_its_time() {
        let text = document("one", &[sample::confirmed()]).unwrap();
        assert_eq!(text.matches("<gx:coord>").count(), 11);
        // One more for the ellipse.
        assert_eq!(text.matches("<when>").count(), 12);
    }

    #[test]
    fn an_impossible_track_is_refused() {
        let track = GeoTrack { time_unix_s: -1.0, ..sample::confirmed() };
        assert!(matches!(document("none", &[track]), Err(ExportError::Time { .. })));
    }
}
