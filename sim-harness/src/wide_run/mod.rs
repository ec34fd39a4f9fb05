//! Wide-area radars as a distributed scenario: agents and centre as processes, the map scored against
//! the truth of the simulated scene.

mod report;
mod run;
mod scenario;

pub(crate) use run::run;
pub(crate) use scenario::{SHIPPED, WideScenario, find, shipped};
