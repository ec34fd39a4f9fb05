//! Registration of recorded points and tracks of recorded plots, without a network.
//!
//! ```text
//! file of JSON Lines, or folder of points ── input ── solve_site, in parallel ── answer ── output
//! ```
//! Answers come in the order of the problems, and a line that cannot be read costs that line only.

mod answer;
mod clocks;
mod draw;
mod input;
mod lag;
mod lines;
mod output;
mod run;
mod track;

pub use answer::Answer;
pub use clocks::ClockJson;
pub use draw::{Layer, Site, Way};
pub use input::{Asked, InputError, read_folder, read_problem};
pub use run::{Options, register};
pub use track::{Files, TrackOptions, track};
