//! The centre's clock: nanoseconds since the process started, from a monotonic source.

use proto::time::CentreTime;
use tokio::time::Instant;

/// The only place of this program that reads a clock. It follows tokio's, so that a test can
/// pause it.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    origin: Instant,
}

impl Clock {
    /// A clock that starts now.
    #[must_use]
    pub fn start() -> Self {
        Self { origin: Instant::now() }
    }

    /// What it showed at `instant`.
    #[must_use]
    pub fn at(&self, instant: Instant) -> CentreTime {
        let since = instant.saturating_duration_since(self.origin);
        CentreTime(i64::try_from(since.as_nanos()).unwrap_or(i64::MAX))
    }

    /// What it shows.
    #[must_use]
    pub fn now(&self) -> CentreTime {
        self.at(Instant::now())
    }
}
