//! From milliseconds of a mission to Unix time, over midnight.

use super::segment::Mission;

const DAY_MS: i64 = 86_400_000;
const HALF_DAY_MS: i64 = DAY_MS / 2;

/// A reference date that is in no calendar.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the mission's reference date {year}-{month}-{day} is in no calendar; times stay unknown")]
pub struct NoSuchDate {
    /// M5.
    pub year: u16,
    /// M6.
    pub month: u8,
    /// M7.
    pub day: u8,
}

impl Mission {
    /// 00:00 UTC of the reference date, milliseconds of Unix time (no leap seconds).
    ///
    /// # Errors
    /// If there is no such day in the Gregorian calendar.
    pub fn midnight_unix_ms(&self) -> Result<i64, NoSuchDate> {
        let (year, month, day) = (self.year, self.month, self.day);
        let valid = (1..=12).contains(&month) && 1 <= day && day <= days_of(year, month);
        let midnight = || days_since_1970(year.into(), month.into(), day.into()) * DAY_MS;
        valid.then(midnight).ok_or(NoSuchDate { year, month, day })
    }
}

fn is_leap(year: u16) -> bool {
    year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400))
}

fn days_of(year: u16, month: u8) -> u8 {
    match month {
        2 if is_leap(year) => 29,
        2 => 28,
        4 | 6 | 9 | 11 => 30,
        _ => 31,
    }
}

/// Days of a Gregorian date since 1970-01-01.
///
/// Years are counted from March, so that the leap day is their last; then the months before month
/// `m` (March is 0) have `(153 m + 2) / 5` days, and 1970-01-01 is day 719,468 since 0000-03-01.
fn days_since_1970(year: i64, month: i64, day: i64) -> i64 {
    let (year, month) = if 3 <= month { (year, month - 3) } else { (year - 1, month + 9) };
    let leap_days = year.div_euclid(4) - year.div_euclid(100) + year.div_euclid(400);
    365 * year + leap_days + (153 * month + 2) / 5 + day - 1 - 719_468
}

/// Turns the times of one mission into Unix time.
///
/// Times count on past midnight (86,400,001 is on the next day). Senders that begin again at zero
/// without a new reference date are understood, too: a step back by more than half a day is the
/// next day, and a step forward by as much undoes it, for dwells that come late.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MissionClock {
    midnight_unix_ms: Option<i64>,
    last_ms: Option<i64>,
    days: i64,
}

impl MissionClock {
    /// Counts from the mission's reference date from now on; repeats of the same date change
    /// nothing.
    ///
    /// # Errors
    /// If there is no such day; the clock stays as it was.
    pub fn set(&mut self, mission: &Mission) -> Result<(), NoSuchDate> {
        let midnight_unix_ms = Some(mission.midnight_unix_ms()?);
        if self.midnight_unix_ms != midnight_unix_ms {
            *self = Self { midnight_unix_ms, ..Self::default() };
        }
        Ok(())
    }

    /// The Unix time of D6, L1 or T4, milliseconds; none before the first mission segment.
    pub fn unix_ms(&mut self, time_ms: u32) -> Option<i64> {
        let midnight_unix_ms = self.midnight_unix_ms?;
        let time_ms = i64::from(time_ms);
        let last_ms = self.last_ms.replace(time_ms).unwrap_or(time_ms);
        // Who ever counted past the end of a day does not begin again at zero.
        if time_ms < DAY_MS && last_ms < DAY_MS {
            let step_ms = time_ms - last_ms;
            self.days += i64::from(step_ms < -HALF_DAY_MS);
            self.days -= i64::from(HALF_DAY_MS < step_ms && 0 < self.days);
        }
        Some(midnight_unix_ms + self.days * DAY_MS + time_ms)
    }

    /// The same in seconds; exact to a quarter of a microsecond until the year 2106.
    #[expect(clippy::cast_precision_loss, reason = "below 2^53 for 280,000 years")]
    pub fn unix_s(&mut self, time_ms: u32) -> Option<f64> {
        Some(self.unix_ms(time_ms)? as f64 / 1000.0)
    }

    /// D6 of a moment, rounded down to a millisecond; none before the mission's date, before the
    /// first mission segment, or more than 49 days after.
    #[must_use]
    pub fn time_ms(&self, unix_ms: i64) -> Option<u32> {
        u32::try_from(unix_ms - self.midnight_unix_ms?).ok()
    }
}
