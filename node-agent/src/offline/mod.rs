//! Work on recordings without a network: turning echoes into points and tracks, and writing
//! recordings.

mod part;
mod pictures;
mod process;
mod record;
mod sink;
mod tracks;
mod truth;
mod wall;

pub use process::{Job, Options, ProcessError, Processed, process};
pub use record::{RecordError, record};
pub use sink::{Beginning, LinesFile, LinesOutput, LinesText, PeriodSink, PointsTable, Seen};
pub use tracks::{Follower, LinesTo, Outputs, Tracked, WayOfTrack};
pub use truth::{TruthError, true_ways};
pub use wall::{WallFound, WallSource};
