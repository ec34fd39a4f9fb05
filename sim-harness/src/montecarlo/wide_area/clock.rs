//! Processor time of the thread that asks.

use std::time::Duration;

use rustix::time::{ClockId, clock_gettime};

/// Since the thread began; other threads and processes do not count.
pub(super) fn thread_time() -> Duration {
    // It cannot be before the thread began.
    Duration::try_from(clock_gettime(ClockId::ThreadCPUTime)).unwrap_or_default()
}
