//! Targets followed from look to look, of many sensors: what a tracker is given, and what it says.
//!
//! One core for people seen by registered nodes (flat frame `Ref`) and for moving-target plots of an
//! airborne radar (local east, north). A look is what one sensor saw in one dwell or period; looks
//! come in order of time, several may have the same time. Trackers stand behind one trait: the
//! default, the association of \[wide-area\], and its two rivals.

pub mod assign;
mod check;
mod config;
pub mod default;
pub mod gate;
pub mod links;
pub mod paper;
pub mod smooth;

use nalgebra::{Matrix2, Matrix4, Vector2, Vector3, Vector4};
use thiserror::Error;

pub use config::{InvalidSetting, TrackerKind, TrackingConfig};

/// What one sensor saw in one dwell or period.
#[derive(Clone, Debug)]
pub struct Look<'a> {
    /// When, seconds on the clock of all looks.
    pub time_s: f64,
    /// Which sensor, counted from zero.
    pub sensor_index: u32,
    /// Which of its looks, for provenance: ascends for each sensor.
    pub look_index: u64,
    /// Where the sensor was, if it moves or sees under a slant.
    pub platform: Option<Platform>,
    /// What it could see; also when it saw nothing.
    pub coverage: Coverage,
    /// False plots expected per square metre of what it could see.
    pub clutter_per_m2: f64,
    /// The plots, in no particular order.
    pub plots: &'a [Plot],
}

/// Where an airborne sensor was and how it flew.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Platform {
    /// `(east, north, up)` over the plane of the targets, metres.
    pub position_m: Vector3<f64>,
    /// Its velocity, metres per second.
    pub velocity_m_per_s: Vector3<f64>,
    /// Which beam position, where beams are counted.
    pub beam_index: Option<u32>,
}

/// Where and what a sensor detects.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coverage {
    /// Where it looked.
    pub area: Area,
    /// Probability that a target in it gives a plot.
    pub detection_probability: f64,
    /// Slower targets give none, metres per second of radial velocity.
    pub minimum_detectable_m_per_s: Option<f64>,
}

/// An area of the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Area {
    /// All of it.
    Everywhere,
    /// A sector of a ring.
    Sector {
        /// Its corner, metres.
        origin_m: Vector2<f64>,
        /// Direction of its middle, counter-clockwise from the first axis.
        direction_rad: f64,
        /// To either side of the middle.
        half_width_rad: f64,
        /// Nearest distance from the corner.
        min_range_m: f64,
        /// Farthest distance from the corner.
        max_range_m: f64,
    },
}

/// One target as one look measured it.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot {
    /// Where, metres.
    pub position_m: Vector2<f64>,
    /// Covariance of its error.
    pub covariance_m2: Matrix2<f64>,
    /// How fast it goes away from the sensor, where that is measured.
    pub radial: Option<Radial>,
    /// Power over noise, decibels of power, where it tells targets apart.
    pub strength_db: Option<f64>,
    /// Which report of the look, for provenance.
    pub report_index: u32,
}

/// A measured radial velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Radial {
    /// Away from the sensor, freed of the sensor's own motion, metres per second.
    pub velocity_m_per_s: f64,
    /// Its standard deviation.
    pub sigma_m_per_s: f64,
    /// Horizontal part of the unit vector from the sensor to the target: a target with velocity `v`
    /// has the radial velocity `direction · v`.
    pub direction: Vector2<f64>,
    /// It is known up to multiples of this, if given.
    pub wrap_m_per_s: Option<f64>,
}

/// How sure a tracker is that a target is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// Seen, not often enough to be reported.
    Tentative,
    /// A target, seen when it was last looked at.
    Confirmed,
    /// A target not seen when it was last looked at, believed to go on.
    Coasting,
    /// A target believed to stand, too slow to be detected.
    Stopped,
}

/// Which plot: its sensor, look and report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ReportId {
    /// [`Look::sensor_index`]
    pub sensor_index: u32,
    /// [`Look::look_index`]
    pub look_index: u64,
    /// [`Plot::report_index`]
    pub report_index: u32,
}

/// A target that is followed.
#[derive(Clone, Debug, PartialEq)]
pub struct Track {
    /// Never given again by the same tracker.
    pub id: u64,
    /// How sure.
    pub status: Status,
    /// The time of `state`, seconds: that of the last look that could have seen it.
    pub time_s: f64,
    /// `(x_m, y_m, x_m_per_s, y_m_per_s)`.
    pub state: Vector4<f64>,
    /// Covariance of `state`.
    pub covariance: Matrix4<f64>,
    /// Log likelihood ratio of the target against chance plots.
    pub log_odds: f64,
    /// How many plots it is made of.
    pub plot_count: u32,
    /// When it was last seen, seconds.
    pub seen_s: f64,
    /// Its newest plot.
    pub last_report: ReportId,
    /// How probable it is that `last_report` is of this target, 0 to 1.
    pub last_share: f64,
}

/// One step of a track, after all that could still change it has been heard.
#[derive(Clone, Debug, PartialEq)]
pub struct Settled {
    /// Which track.
    pub track: u64,
    /// How sure the tracker was.
    pub status: Status,
    /// When, seconds.
    pub time_s: f64,
    /// The state from what was known then.
    pub state: Vector4<f64>,
    /// Covariance of `state`.
    pub covariance: Matrix4<f64>,
    /// The state from what was known a fixed lag later (or at the track's end).
    pub smoothed_state: Vector4<f64>,
    /// Covariance of `smoothed_state`.
    pub smoothed_covariance: Matrix4<f64>,
    /// The plot that it took, if any.
    pub report: Option<ReportId>,
    /// How probable it is that the plot is of this target, 0 to 1.
    pub share: f64,
}

/// Why a look was refused; the tracker is then as it was.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum LookError {
    /// A number of the look or of a plot is not finite, or out of its range.
    #[error("tracking look {look_index} of sensor {sensor_index}: {what} is {value}")]
    Unusable {
        /// Which sensor.
        sensor_index: u32,
        /// Which look.
        look_index: u64,
        /// Which number.
        what: &'static str,
        /// What it was, as text.
        value: String,
    },
    /// The tracker needs to know where the sensor was, and is not told.
    #[error(
        "tracking look {look_index} of sensor {sensor_index}: it has no platform, and this tracker works with range and angle of a flying sensor; use the default tracker"
    )]
    NoPlatform {
        /// Which sensor.
        sensor_index: u32,
        /// Which look.
        look_index: u64,
    },
    /// The look is older than one before.
    #[error(
        "tracking look {look_index} of sensor {sensor_index}: taken at {time_s} s, after one of {previous_s} s was heard"
    )]
    TooLate {
        /// Which sensor.
        sensor_index: u32,
        /// Which look.
        look_index: u64,
        /// When it was taken.
        time_s: f64,
        /// The time of the newest look before.
        previous_s: f64,
    },
}

/// Follows targets from look to look.
pub trait Tracker: Send {
    /// Takes the next look.
    ///
    /// # Errors
    /// If the look makes no sense; the tracker is then as it was.
    fn look(&mut self, look: &Look<'_>) -> Result<(), LookError>;

    /// Everything that is followed now, in ascending order of id.
    fn tracks(&self) -> &[Track];

    /// Moves what has been settled since the last call to the end of `into`, for each track in order
    /// of time. What nobody takes is forgotten, oldest first, beyond a bound.
    fn take_settled(&mut self, into: &mut Vec<Settled>);

    /// Forgets what has been settled, for users of the present alone.
    fn forget_settled(&mut self) {
        self.take_settled(&mut Vec::new());
    }

    /// Settles everything and follows nobody any more. A look that follows may be of any time.
    fn finish(&mut self);
}
