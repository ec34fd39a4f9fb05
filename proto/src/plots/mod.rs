//! Plots of wide-area radars as others write them: files, pipes and datagrams to dwells.
//!
//! ```text
//! bytes, in pieces of any size ── Ingest ──┬── STANAG 4607 packets ──────┬── Scan, or Damage that
//!                                          └── CSV or JSON Lines: rows ──┘   names its place
//! ```
//! Nothing here opens a file or a socket: the agent and the offline tools feed bytes.

mod fault;
mod group;
mod ingest;
mod input;
mod lines;
mod row;
mod stanag;
#[cfg(test)]
mod stanag_tests;
#[cfg(test)]
mod tests;

pub use fault::RowFault;
pub use group::Group;
pub use ingest::{Damage, Format, Ingest};
pub use input::{Input, InputError};
pub use lines::{BadLine, LineKind, RowLines};
pub use row::{COLUMNS, PlotRow};
pub use stanag::{Naming, PacketScans};

use crate::ids::NodeId;
use crate::wire::Dwell;

/// What one sensor saw in one dwell.
#[derive(Clone, Debug, PartialEq)]
pub enum Scan {
    /// On the earth.
    Geographic(Box<Dwell>),
    /// On a plane of its own.
    Local(LocalScan),
}

impl Scan {
    /// When, seconds on the data's clock (Unix seconds on the earth).
    #[must_use]
    pub fn time_s(&self) -> f64 {
        match self {
            Self::Geographic(dwell) => dwell.time_unix_s,
            Self::Local(scan) => scan.time_s,
        }
    }

    /// How many plots it has.
    #[must_use]
    pub fn plot_count(&self) -> usize {
        match self {
            Self::Geographic(dwell) => dwell.reports.len(),
            Self::Local(scan) => scan.plots.len(),
        }
    }
}

/// A dwell on a plane that lies nowhere on the earth.
#[derive(Clone, Debug, PartialEq)]
pub struct LocalScan {
    /// When, seconds on the data's clock.
    pub time_s: f64,
    /// Whose.
    pub node: NodeId,
    /// The sensor's count of sweeps over its area.
    pub revisit_index: u32,
    /// The dwell's number in its revisit.
    pub dwell_index: u32,
    /// `(x, y, up)` of the sensor, metres, if stated.
    pub sensor_m: Option<[f64; 3]>,
    /// Probability that a target is seen, if stated.
    pub detection_probability: Option<f64>,
    /// Slower targets are not seen, metres per second of radial velocity, if stated.
    pub minimum_detectable_m_per_s: Option<f64>,
    /// The plots.
    pub plots: Vec<LocalPlot>,
}

/// One target as a dwell on a plane measured it.
#[derive(Clone, Debug, PartialEq)]
pub struct LocalPlot {
    /// Its number in the dwell.
    pub index: u32,
    /// `(x, y)`, metres.
    pub at_m: [f64; 2],
    /// Standard deviation along the line of sight (slant), metres, if stated.
    pub slant_sigma_m: Option<f64>,
    /// Standard deviation across the line of sight, metres, if stated.
    pub cross_sigma_m: Option<f64>,
    /// Radial velocity, away from the sensor, metres per second.
    pub radial_m_per_s: Option<f64>,
    /// Its standard deviation, metres per second, if stated.
    pub radial_sigma_m_per_s: Option<f64>,
    /// It is known up to multiples of this, metres per second, if given.
    pub wrap_m_per_s: Option<f64>,
    /// Power over noise, decibels of power.
    pub snr_db: Option<f64>,
    /// Which target it really is, where that is known.
    pub truth: Option<u32>,
}
