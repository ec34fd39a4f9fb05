//! Tracks as comma-separated values, one row for each track and time.
//!
//! Columns: `time_unix_s` (seconds since 1970 UTC), `time_utc` (ISO 8601), `track` (number),
//! `name`, `status` (`tentative`, `confirmed`, `coasting`, `stopped`), `lat_deg`, `lon_deg`,
//! `height_m` (above the ellipsoid), `course_deg` (clockwise from true north), `speed_m_per_s`,
//! `v_east_m_per_s`, `v_north_m_per_s`, `cov_ee_m2`, `cov_en_m2`, `cov_nn_m2` (east and north at
//! the position), `height_sigma_m` (empty where unknown), `sensors` (separated by blanks),
//! `report` (empty where reports have no numbers). Quoted as RFC 4180 says.

use super::{ExportError, GeoTrack, iso8601};

/// The names of the columns.
pub const COLUMNS: [&str; 18] = [
    "time_unix_s",
    "time_utc",
    "track",
    "name",
    "status",
    "lat_deg",
    "lon_deg",
    "height_m",
    "course_deg",
    "speed_m_per_s",
    "v_east_m_per_s",
    "v_north_m_per_s",
    "cov_ee_m2",
    "cov_en_m2",
    "cov_nn_m2",
    "height_sigma_m",
    "sensors",
    "report",
];

/// The line of names.
#[must_use]
pub fn header() -> String {
    COLUMNS.join(",") + "\n"
}

/// One line for each track, without the line of names, so that a file can grow.
///
/// # Errors
/// If a track says something that is not possible.
pub fn rows(tracks: &[GeoTrack]) -> Result<String, ExportError> {
    let mut writer = ::csv::Writer::from_writer(Vec::new());
    for track in tracks {
        writer.write_record(row(track)?)?;
    }
    let bytes = writer.into_inner().map_err(|error| ExportError::Csv(error.into_error().into()))?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

fn row(track: &GeoTrack) -> Result<[String; 18], ExportError> {
    track.check()?;
    let (at, velocity, cov) = (&track.position, &track.velocity_m_per_s, &track.covariance_m2);
    Ok([
        format!("{:.3}", track.time_unix_s),
        iso8601(track.time_unix_s)?,
        track.id.to_string(),
        track.name.clone(),
        track.status.word().to_owned(),
        format!("{:.8}", at.lat_deg()),
        format!("{:.8}", at.lon_deg()),
        format!("{:.3}", at.height_m()),
        format!("{:.3}", track.course_deg()),
        format!("{:.4}", track.speed_m_per_s()),
        format!("{:.4}", velocity.x),
        format!("{:.4}", velocity.y),
        cov.m11.to_string(),
        cov.m12.to_string(),
        cov.m22.to_string(),
        track.height_sigma_m.map(|sigma_m| sigma_m.to_string()).unwrap_or_default(),
        track.sensors.join(" "),
        track.report.map(|report| report.to_string()).unwrap_or_default(),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::sample;

    #[test]
    fn names_are_quoted_and_every_row_has_all_columns() {
        let text = header() + &rows(&sample::all()).unwrap();
        let mut reader = ::csv::Reader::from_reader(text.as_bytes());
        let rows: Vec<::csv::StringRecord> = reader.records().map(Result::unwrap).collect();
        assert_eq!(rows.len(), 4);
        let last = sample::across_the_antimeridian();
        assert_eq!(&rows[3][3], last.name.as_str());
        assert_eq!(&rows[3][6], "-179.99800000");
        assert_eq!(&rows[1][15], "");
    }

    #[test]
    fn an_impossible_track_is_refused() {
        let track = GeoTrack { time_unix_s: 1e30, ..sample::confirmed() };
        assert!(matches!(rows(&[track]), Err(ExportError::Time { .. })));
    }
}
