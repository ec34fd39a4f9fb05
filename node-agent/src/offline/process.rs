//! Recorded echoes to points and pictures: the node's chain, run over a file.

use std::io;
use std::path::PathBuf;

use indicatif::ProgressBar;
use proto::ids::NodeId;
use proto::wire::Counters;
use serde::Serialize;
use thiserror::Error;
use tokio_util::sync::CancellationToken;

use super::pictures::Pictures;
use super::sink::{Beginning, PeriodSink, Seen};
use super::wall::{WallFound, WallSource, find_wall};
use crate::imaging::canceller::CancellerConfig;
use crate::imaging::{InvalidSetting, Sweep};
use crate::lines::PointsLine;
use crate::pipeline::{Chain, ChainConfig, ChainError, ChainState};
use crate::recording::{ASSUMED_PERIOD_S, Recording, RecordingError};
use crate::source::EchoesConfig;

/// How recordings are processed; the radar is the recording's.
#[derive(Clone, Debug)]
pub struct Options {
    /// From sweeps to points.
    pub chain: ChainConfig,
    /// How far behind a point the middle of its target lies, metres.
    pub half_depth_m: f64,
    /// Standard deviation of that.
    pub half_depth_sigma_m: f64,
    /// Where the wall's numbers come from.
    pub wall: WallSource,
    /// Folder for the images, if they are wanted.
    pub images: Option<PathBuf>,
}

/// One recording to process.
#[derive(Clone, Debug)]
pub struct Job {
    /// The file, and how it is read.
    pub echoes: EchoesConfig,
    /// The node's name in lines and pictures.
    pub node: NodeId,
}

/// What came out of one recording.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Processed {
    /// The file.
    pub recording: PathBuf,
    /// The node.
    pub node: NodeId,
    /// Periods read.
    pub period_count: u64,
    /// Of these, periods in which the background was not known yet.
    pub warming_up_count: u64,
    /// Points measured.
    pub point_count: u64,
    /// Whether the recording has a background of its own, which was used.
    pub own_background: bool,
    /// Whether the times of the periods are assumed.
    pub times_assumed: bool,
    /// What was found of the wall, where it was looked for.
    pub wall: Option<WallFound>,
}

/// Why a recording was not processed to its end.
#[derive(Debug, Error)]
pub enum ProcessError {
    /// It cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The chain does not take it.
    #[error("recording {path:?}: {reason}")]
    Chain {
        /// The file.
        path: PathBuf,
        /// What the chain says.
        reason: ChainError,
    },
    /// A result cannot be written.
    #[error("writing {what}: {reason}")]
    Write {
        /// What was to be written.
        what: String,
        /// What the system says.
        reason: io::Error,
    },
    /// The user did not wait.
    #[error("stopped after {period_count} periods of {path:?}")]
    Stopped {
        /// The file.
        path: PathBuf,
        /// Periods done.
        period_count: u64,
    },
}

/// Runs the chain over one recording; `sink` gets the points of every period. After an error it
/// holds the periods before.
///
/// # Errors
/// If the recording is damaged, the chain does not take it, a file cannot be written, or `stop`.
pub fn process(
    job: &Job,
    options: &Options,
    sink: &mut dyn PeriodSink,
    progress: &ProgressBar,
    stop: &CancellationToken,
) -> Result<Processed, ProcessError> {
    let outcome = Run::begin(job, options, progress)
        .and_then(|(mut run, recording)| run.through(recording, sink, progress, stop));
    progress.finish_and_clear();
    let sealed = if outcome.is_ok() { sink.finish() } else { sink.abandon() };
    let done = outcome?;
    sealed.map_err(|error| writing(sink.product(), &error))?;
    Ok(done)
}

/// The settings of the chain for `recording`. What was chosen stays; the default canceller gives way
/// to a background that was recorded.
fn config_of(
    recording: &Recording,
    options: &Options,
    wall: Option<&WallFound>,
) -> Result<ChainConfig, InvalidSetting> {
    let mut config = options.chain.clone();
    if let Some(wall) = wall {
        config.wall = wall.model();
    }
    let header = recording.header();
    if header.background.is_some() && config.canceller == CancellerConfig::default() {
        config.canceller = CancellerConfig::Background;
    }
    header.fitted(config)
}

fn writing(what: &str, error: &io::Error) -> ProcessError {
    let reason = io::Error::new(error.kind(), error.to_string());
    ProcessError::Write { what: what.to_owned(), reason }
}

/// A recording on its way through the chain.
struct Run<'a> {
    job: &'a Job,
    options: &'a Options,
    chain: Chain,
    pictures: Option<Pictures>,
    done: Processed,
}

impl<'a> Run<'a> {
    /// Opens the recording and builds its chain.
    fn begin(
        job: &'a Job,
        options: &'a Options,
        progress: &ProgressBar,
    ) -> Result<(Self, Recording), ProcessError> {
        let path = &job.echoes.path;
        let mut recording = job.echoes.open()?;
        let wanted = job.echoes.period_count.unwrap_or(u64::MAX);
        progress.set_length(recording.period_count().min(wanted));
        let wall = match options.wall {
            WallSource::Configured => None,
            WallSource::Estimated => find_wall(&mut recording, path)?,
        };
        let refused = |reason| ProcessError::Chain { path: path.clone(), reason };
        let config = config_of(&recording, options, wall.as_ref());
        let config = config.map_err(|error| refused(error.into()))?;
        let mut chain = Chain::new(&config).map_err(refused)?;
        if let Some(background) = &recording.header().background {
            chain.use_background(background).map_err(refused)?;
        }
        let pictures = options.images.as_deref().map(Pictures::create).transpose();
        let done = Processed {
            recording: path.clone(),
            node: job.node.clone(),
            period_count: 0,
            warming_up_count: 0,
            point_count: 0,
            own_background: config.canceller == CancellerConfig::Background,
            times_assumed: recording.times().are_assumed(),
            wall,
        };
        let pictures = pictures.map_err(|error| writing("images", &error))?;
        Ok((Self { job, options, chain, pictures, done }, recording))
    }

    /// Processes period after period. Images are written also of a recording that breaks off.
    fn through(
        &mut self,
        mut recording: Recording,
        sink: &mut dyn PeriodSink,
        progress: &ProgressBar,
        stop: &CancellationToken,
    ) -> Result<Processed, ProcessError> {
        let outcome = self.periods(&mut recording, sink, progress, stop);
        let written = self.pictures.as_mut().map_or(Ok(()), Pictures::finish);
        outcome?;
        written.map_err(|error| writing("images", &error))?;
        Ok(self.done.clone())
    }

    fn periods(
        &mut self,
        recording: &mut Recording,
        sink: &mut dyn PeriodSink,
        progress: &ProgressBar,
        stop: &CancellationToken,
    ) -> Result<(), ProcessError> {
        let wanted = self.job.echoes.period_count.unwrap_or(u64::MAX);
        let times = recording.times();
        let beginning = Beginning {
            period_count: recording.period_count().min(wanted),
            period_s: match recording.period_count() {
                1 => ASSUMED_PERIOD_S,
                _ => times.time_s(1) - times.time_s(0),
            },
        };
        sink.begin(&beginning).map_err(|error| writing(sink.product(), &error))?;
        while self.done.period_count < wanted {
            if stop.is_cancelled() {
                let path = self.done.recording.clone();
                return Err(ProcessError::Stopped { path, period_count: self.done.period_count });
            }
            let Some(sweep) = recording.next_sweep()? else { break };
            self.period(&sweep, sink)?;
            progress.inc(1);
        }
        Ok(())
    }

    fn period(&mut self, sweep: &Sweep, sink: &mut dyn PeriodSink) -> Result<(), ProcessError> {
        let refused = |reason| ProcessError::Chain { path: self.job.echoes.path.clone(), reason };
        let measured = self.chain.process_sweep(sweep).map_err(refused)?;
        let period = self.done.period_count;
        self.done.period_count += 1;
        self.done.point_count += measured.points.len() as u64;
        self.done.warming_up_count += u64::from(measured.state == ChainState::WarmingUp);
        let seen = Seen { period, time_s: sweep.time_s, measured: &measured };
        sink.see(&seen).map_err(|error| writing(sink.product(), &error))?;
        let counters = Counters {
            frame_count: self.done.period_count,
            point_count: self.done.point_count,
            ..Counters::default()
        };
        let line = PointsLine {
            node: &self.job.node,
            period,
            time_s: sweep.time_s,
            points: &measured.points,
            counters: &counters,
            half_depth_m: self.options.half_depth_m,
            half_depth_sigma_m: self.options.half_depth_sigma_m,
        };
        sink.take(&line).map_err(|error| writing(sink.product(), &error))?;
        let Some(pictures) = &mut self.pictures else { return Ok(()) };
        let node = &self.job.node;
        let title = format!("{node}, period {period}, {:.2} s", sweep.time_s);
        let name = format!("{node}-{period:05}");
        let written = pictures.take(&name, title, measured.image.to_image(), &measured.points);
        written.map_err(|error| writing("images", &error))
    }
}
