//! The shell around the pipeline: the clock, the network, the files.
//!
//! One task owns each state and shows its newest value to the others: the measuring loop its
//! progress, the downlink the clock and the transform. Sets wait for the network in a ring that
//! drops the oldest.

mod clock;
mod downlink;
mod feed;
mod follow;
mod gmti;
mod live;
mod measure;
mod output;
mod run;
mod senders;
mod uplink;

pub use feed::feed;
pub use run::run;
