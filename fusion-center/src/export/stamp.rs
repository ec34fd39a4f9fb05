//! Seconds since 1970 as ISO 8601.

use std::time::{Duration, UNIX_EPOCH};

use super::ExportError;

/// The first second of the year 10000, seconds since 1970.
const YEAR_10000_UNIX_S: f64 = 253_402_300_800.0;

/// A time as `2026-11-22T12:00:00.000Z`, to the nearest millisecond.
///
/// # Errors
/// Before 1970, after 9999, or if it is not a number.
pub fn iso8601(time_unix_s: f64) -> Result<String, ExportError> {
    // Half a millisecond short of the end: rounding must not reach it.
    if !(0.0..YEAR_10000_UNIX_S - 5e-4).contains(&time_unix_s) {
        return Err(ExportError::Time { time_unix_s });
    }
    let rounded = Duration::from_secs_f64(time_unix_s) + Duration::from_micros(500);
    Ok(humantime::format_rfc3339_millis(UNIX_EPOCH + rounded).to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_those_of_the_calendar() {
        let cases = [
            (0.0, "1970-01-01T00:00:00.000Z"),
            (951_782_400.0, "2000-02-29T00:00:00.000Z"),
            (1_795_348_800.123, "2026-11-22T12:00:00.123Z"),
            (1_795_348_799.999_6, "2026-11-22T12:00:00.000Z"),
            (253_402_300_799.0, "9999-12-31T23:59:59.000Z"),
        ];
        for (time_unix_s, written) in cases {
            assert_eq!(iso8601(time_unix_s).unwrap(), written);
        }
    }

    #[test]
    fn what_is_no_time_is_refused() {
        for time_unix_s in [-1.0, f64::NAN, f64::INFINITY, YEAR_10000_UNIX_S, 1.8e12] {
            let error = iso8601(time_unix_s).unwrap_err();
            assert!(matches!(error, ExportError::Time { .. }), "{error}");
        }
    }
}
