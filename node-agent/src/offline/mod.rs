//! Work on recordings without a network: turning echoes into points, and writing recordings.

mod pictures;
mod process;
mod record;
mod sink;
mod wall;

pub use process::{Job, Options, ProcessError, Processed, process};
pub use record::{RecordError, record};
pub use sink::{LinesFile, LinesOutput, LinesText, PeriodSink, PointsTable};
pub use wall::{WallFound, WallSource};
