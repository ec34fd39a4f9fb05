//! What an agent tells the centre.

use serde::{Deserialize, Serialize};

use super::check::{self, Invalid, at_most, half_depth, not_negative};
use super::codec::Message;
use super::header::Kind;
use crate::ids::NodeId;
use crate::measured::MeasuredPoint;
use crate::time::{ClockEstimate, NodeTime};

/// Most points in one set.
const MAX_POINT_COUNT: usize = 1024;
/// Longest text a status may carry, bytes.
const MAX_TEXT_LENGTH: usize = 256;

/// What a node has done so far in this life.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counters {
    /// Sweeps or batches of detections that the source delivered.
    pub frame_count: u64,
    /// Of these, how many were refused as damaged.
    pub refused_frame_count: u64,
    /// Periods whose time had passed before the chain got to them.
    pub skipped_period_count: u64,
    /// Points measured.
    pub point_count: u64,
    /// Sets that gave way to newer ones in the full queue to the network.
    pub dropped_set_count: u64,
}

/// What a node measured in one period.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PointSet {
    /// Who measured; must be the node of the key.
    pub node: NodeId,
    /// The node's own count of periods.
    pub period: u64,
    /// Middle of the acquisition.
    pub time: NodeTime,
    /// What the node knew of the centre's clock when it sent.
    pub clock: Option<ClockEstimate>,
    /// How far behind the measured surface the middle of a target lies.
    pub half_depth_m: f64,
    /// Standard deviation of `half_depth_m` from target to target.
    pub half_depth_sigma_m: f64,
    /// The points, possibly none.
    pub points: Vec<MeasuredPoint>,
    /// The node's counters when it sent.
    pub counters: Counters,
}

impl Message for PointSet {
    const KIND: Kind = Kind::PointSet;
    const SCHEMA: u16 = 1;
    const MAX_BYTES: usize = 128 << 10;

    fn check(&self) -> Result<(), Invalid> {
        at_most("points", self.points.len(), MAX_POINT_COUNT)?;
        half_depth("half_depth_m", self.half_depth_m)?;
        half_depth("half_depth_sigma_m", self.half_depth_sigma_m)?;
        self.points.iter().try_for_each(check::point)
    }
}

/// Where a node's source of sweeps stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum SourceState {
    /// The first period has not begun.
    Waiting,
    /// Periods are being measured.
    Running,
    /// The recording or the scenario is over.
    Finished,
}

/// How long transforms took from the last set's arrival at the centre to this node.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LatencyReport {
    /// Transforms timed.
    pub count: u64,
    /// Median.
    pub p50_ms: f64,
    /// Exceeded by one in a hundred.
    pub p99_ms: f64,
    /// The longest.
    pub max_ms: f64,
}

/// How a node is, once a second.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NodeStatus {
    /// Who; must be the node of the key.
    pub node: NodeId,
    /// When, by its own clock.
    pub time: NodeTime,
    /// Version of the agent.
    pub software: String,
    /// Where its source stands.
    pub source: SourceState,
    /// What it knows of the centre's clock.
    pub clock: Option<ClockEstimate>,
    /// Sequence number that its next point set will have.
    pub next_sequence: u64,
    /// Sets waiting for the network.
    pub queue_length: u32,
    /// Epoch of the transform that it works with, if it has received one.
    pub transform_epoch: Option<u64>,
    /// How long transforms took.
    pub latency: Option<LatencyReport>,
    /// Its counters.
    pub counters: Counters,
}

impl Message for NodeStatus {
    const KIND: Kind = Kind::NodeStatus;
    const SCHEMA: u16 = 1;
    const MAX_BYTES: usize = 4 << 10;

    fn check(&self) -> Result<(), Invalid> {
        at_most("software", self.software.len(), MAX_TEXT_LENGTH)?;
        let Some(latency) = &self.latency else { return Ok(()) };
        not_negative("latency.p50_ms", latency.p50_ms)?;
        not_negative("latency.p99_ms", latency.p99_ms)?;
        not_negative("latency.max_ms", latency.max_ms)
    }
}

/// "What time is it there?"
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ClockProbe {
    /// Who asks; must be the node of the key.
    pub node: NodeId,
    /// The asking clock.
    pub asked: NodeTime,
}

impl Message for ClockProbe {
    const KIND: Kind = Kind::ClockProbe;
    const SCHEMA: u16 = 1;
    const MAX_BYTES: usize = 128;

    fn check(&self) -> Result<(), Invalid> {
        Ok(())
    }
}
