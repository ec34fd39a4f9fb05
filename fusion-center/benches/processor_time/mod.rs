//! Processor time of the measuring thread as what criterion measures: a loaded machine costs it nothing.

use std::time::Duration;

use criterion::Criterion;
use criterion::measurement::{Measurement, ValueFormatter, WallTime};

/// Time that this thread has had a processor: others on the machine cost it nothing.
pub(crate) struct ProcessorTime;

impl ProcessorTime {
    fn now() -> Duration {
        // Giving way makes the kernel count what the thread has used.
        std::thread::yield_now();
        let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
        let used_ns = text.split_whitespace().next().and_then(|word| word.parse().ok());
        Duration::from_nanos(used_ns.unwrap_or(0))
    }
}

impl Measurement for ProcessorTime {
    type Intermediate = Duration;
    type Value = Duration;

    fn start(&self) -> Duration {
        Self::now()
    }

    fn end(&self, start: Duration) -> Duration {
        // A sample of no time at all has no rate.
        Self::now().saturating_sub(start).max(Duration::from_nanos(1))
    }

    fn add(&self, one: &Duration, other: &Duration) -> Duration {
        *one + *other
    }

    fn zero(&self) -> Duration {
        Duration::ZERO
    }

    fn to_f64(&self, value: &Duration) -> f64 {
        WallTime.to_f64(value)
    }

    fn formatter(&self) -> &dyn ValueFormatter {
        WallTime.formatter()
    }
}

/// Criterion with that time, as the command line wants it.
pub(crate) fn by_processor_time() -> Criterion<ProcessorTime> {
    Criterion::default().with_measurement(ProcessorTime).configure_from_args()
}
