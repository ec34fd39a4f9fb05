//! People followed through a node's image sequence: what a tracker is given, and what it says.
//!
//! Source: \[mean-shift\]. Two trackers stand behind one trait: that of the paper, and the default.

mod config;
pub mod default;
pub mod experiments;
pub mod histogram;
pub mod maxima;
pub mod paper;
mod record;
pub mod shift;
pub mod template;

use nalgebra::{Matrix4, Vector4};
use proto::measured::MeasuredPoint;
use proto::radar::Grid;
use thiserror::Error;

pub use config::{TrackingConfig, TrackingMode};
pub use record::follow;

/// The image of one sweep with the points found in it.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// When the sweep was taken, seconds on the node's clock.
    pub time_s: f64,
    /// Where the pixels are.
    pub grid: Grid,
    /// One value per pixel, row by row, first row nearest: amplitude weighted by coherence.
    pub amplitude: &'a [f32],
    /// Root mean square of the noise in the mean of the channels, without weighting.
    pub noise_amplitude: f32,
    /// What the chain measured in it, with covariances, strongest first.
    pub points: &'a [MeasuredPoint],
}

/// How sure a tracker is that somebody is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrackStatus {
    /// Seen, not often enough to be reported as a person.
    Tentative,
    /// A person, seen in this frame.
    Confirmed,
    /// A person who was seen before and is believed to be there still.
    Coasting,
}

/// Somebody who is followed.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// Never given again by the same tracker.
    pub id: u64,
    /// How sure.
    pub status: TrackStatus,
    /// `(x_m, y_m, x_m_per_s, y_m_per_s)` in the node's frame at the frame's time.
    pub state: Vector4<f64>,
    /// Covariance of `state`.
    pub covariance: Matrix4<f64>,
    /// Second moments of what is seen of the person, `[xx, xy, yy]`, square metres.
    pub extent_m2: [f64; 3],
    /// How well the image looks like the person's template: Bhattacharyya coefficient, 0 to 1.
    pub appearance: f64,
    /// When the person was last seen, seconds on the node's clock.
    pub seen_s: f64,
}

/// Where somebody was a while ago, with all that came after.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Smoothed {
    /// That of the track.
    pub id: u64,
    /// When, seconds on the node's clock: the lag ago, or as long as the track is known.
    pub time_s: f64,
    /// `(x_m, y_m, x_m_per_s, y_m_per_s)` in the node's frame.
    pub state: Vector4<f64>,
    /// Covariance of `state`.
    pub covariance: Matrix4<f64>,
}

/// Why a frame was refused; the tracker is then as it was.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub enum FrameError {
    /// The image has not one value per pixel.
    #[error("tracking the frame at {time_s} s: {got} pixels, its grid has {want}")]
    PixelCount {
        /// When the sweep was taken.
        time_s: f64,
        /// Values given.
        got: usize,
        /// Pixels of the grid.
        want: usize,
    },
    /// A pixel, the noise or the time is no number, or a pixel is negative.
    #[error("tracking the frame at {time_s} s: {what} is not finite or negative")]
    NotFinite {
        /// When the sweep was taken.
        time_s: f64,
        /// Which number.
        what: &'static str,
    },
    /// The frame was not taken after the one before.
    #[error("tracking the frame at {time_s} s: the one before was taken at {previous_s} s")]
    TimeNotAscending {
        /// When the sweep was taken.
        time_s: f64,
        /// When the one before was taken.
        previous_s: f64,
    },
}

impl FrameError {
    /// A short label of the reason, for counting.
    #[must_use]
    pub fn label(&self) -> &'static str {
        match self {
            Self::PixelCount { .. } => "pixel_count",
            Self::NotFinite { .. } => "not_finite",
            Self::TimeNotAscending { .. } => "time_not_ascending",
        }
    }
}

/// Follows people from frame to frame.
pub trait Tracker: Send {
    /// Takes the next frame and gives everybody who is followed now, in ascending order of id; lent
    /// until the next frame.
    ///
    /// # Errors
    /// If the frame makes no sense; the tracker is then as it was.
    fn track(&mut self, frame: &Frame<'_>) -> Result<&[Track], FrameError>;

    /// Where everybody who is followed was a while ago, with all that came after, in ascending order
    /// of id; nobody for a tracker that does not smooth.
    fn smoothed(&self) -> Vec<Smoothed> {
        Vec::new()
    }
}
