//! The agent's clock: nanoseconds since the process started, from a monotonic source.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use proto::time::NodeTime;
use tokio::time::Instant;

/// The only place of this program that reads a clock. It follows tokio's, so that a test can
/// pause it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Clock {
    origin: Instant,
}

impl Clock {
    pub(super) fn start() -> Self {
        Self { origin: Instant::now() }
    }

    pub(super) fn now(&self) -> NodeTime {
        NodeTime(u64::try_from(self.origin.elapsed().as_nanos()).unwrap_or(u64::MAX))
    }

    /// The instant at which this clock shows `time`.
    pub(super) fn instant(&self, time: NodeTime) -> Instant {
        self.origin + Duration::from_nanos(time.0)
    }

    /// The instant `after_s` seconds after the start; the start if that is no time.
    pub(super) fn after_s(&self, after_s: f64) -> Instant {
        self.origin + Duration::try_from_secs_f64(after_s).unwrap_or_default()
    }

    /// What this clock showed at `instant`; 0 before it started.
    pub(super) fn of_instant(&self, instant: Instant) -> NodeTime {
        let since = instant.saturating_duration_since(self.origin);
        NodeTime(u64::try_from(since.as_nanos()).unwrap_or(u64::MAX))
    }

    /// What this clock shows, or would have shown, at a time of the calendar: nanoseconds,
    /// negative before the process started. A common start on machines whose calendars agree.
    #[expect(
        clippy::disallowed_methods,
        reason = "a common start is given as calendar time; it is turned into node time here, once"
    )]
    pub(super) fn at_unix_s(&self, unix_s: f64) -> i64 {
        let now_unix_s =
            SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |since| since.as_secs_f64());
        let from_now_ns = ((unix_s - now_unix_s) * 1e9).round();
        #[expect(clippy::cast_possible_truncation, reason = "saturates, which is far enough")]
        let from_now_ns = from_now_ns as i64;
        i64::try_from(self.now().0).unwrap_or(i64::MAX).saturating_add(from_now_ns)
    }
}
