//! People followed through a recording: lines, rows, a figure of their ways, an animation.

mod smooth;
mod video;
mod ways;

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use chart::Sheet;
use proto::ids::NodeId;
use proto::wire::TrackRecord;
use serde::Serialize;

use super::part::PartFile;
use super::process::Processed;
use super::sink::{Beginning, PeriodSink, Seen};
use crate::lines::{PointsLine, TracksLine};
use crate::plot::{Line, PathsFigure};
use crate::tracking::{Tracker, TrackingMode, follow};
use smooth::Smoothing;
use video::Video;
pub use ways::WayOfTrack;
use ways::Ways;

/// What is made of the tracks of one recording.
#[derive(Clone, Debug, Default)]
pub struct Outputs {
    /// JSON Lines, one per period.
    pub lines: LinesTo,
    /// A row for each track and period.
    pub csv: Option<PathBuf>,
    /// A row for each person and period as they are known with all that came up to the lag after.
    pub smoothed: Option<PathBuf>,
    /// A figure of everybody's ways: an SVG, with a PNG of the same name beside it.
    pub figure: Option<PathBuf>,
    /// An animation, `.png` or `.gif`.
    pub video: Option<PathBuf>,
    /// The true ways for the figure, `[x, y]` in metres in the node's frame.
    pub true_ways_m: Vec<Vec<[f64; 2]>>,
}

/// Where JSON Lines go.
#[derive(Clone, Debug, Default)]
pub enum LinesTo {
    /// Nowhere.
    #[default]
    Nowhere,
    /// Into a file.
    File(PathBuf),
    /// To standard output as they arise.
    Output,
    /// Into [`Follower::text`].
    Text,
}

/// What came out of one recording.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Tracked {
    /// What the chain made of it.
    #[serde(flatten)]
    pub processed: Processed,
    /// Which tracker.
    pub mode: TrackingMode,
    /// Frames that the tracker refused, by reason.
    pub refused_frames: BTreeMap<&'static str, u64>,
    /// Everybody who was taken for a person.
    pub tracks: Vec<WayOfTrack>,
}

enum Lines {
    Nowhere,
    File(PartFile),
    Output,
    Text(Vec<u8>),
}

/// Follows people through the periods of a recording.
pub struct Follower {
    node: NodeId,
    tracker: Box<dyn Tracker>,
    half_depth_m: (f64, f64),
    lines: Lines,
    csv: Option<PartFile>,
    smoothed: Option<PartFile>,
    smoothing: Smoothing,
    figure: Option<PathBuf>,
    video: Option<Video>,
    true_ways_m: Vec<Vec<[f64; 2]>>,
    ways: Ways,
    refused_frames: BTreeMap<&'static str, u64>,
}

impl Follower {
    /// Follows with `tracker`; `half_depth_m` is how far behind what is seen of a person the middle
    /// lies, and the standard deviation of that.
    ///
    /// # Errors
    /// Names the file that cannot be created.
    pub fn create(
        node: &NodeId,
        tracker: Box<dyn Tracker>,
        half_depth_m: (f64, f64),
        outputs: Outputs,
    ) -> io::Result<Self> {
        let Outputs { lines, csv, smoothed, figure, video, true_ways_m } = outputs;
        let lines = match lines {
            LinesTo::Nowhere => Lines::Nowhere,
            LinesTo::File(path) => Lines::File(created(&path)?),
            LinesTo::Output => Lines::Output,
            LinesTo::Text => Lines::Text(Vec::new()),
        };
        let mut csv = csv.as_deref().map(created).transpose()?;
        if let Some(file) = &mut csv {
            file.write_all(TracksLine::COLUMNS.as_bytes())?;
        }
        let mut smoothed = smoothed.as_deref().map(created).transpose()?;
        if let Some(file) = &mut smoothed {
            Smoothing::begin(file)?;
        }
        if let Some(folder) = figure.as_deref().and_then(Path::parent) {
            std::fs::create_dir_all(folder).map_err(|error| named(folder, &error))?;
        }
        let video = video.map(|path| Video::new(&path, node.to_string())).transpose()?;
        Ok(Self {
            node: node.clone(),
            tracker,
            half_depth_m,
            lines,
            csv,
            smoothed,
            smoothing: Smoothing::default(),
            figure,
            video,
            true_ways_m,
            ways: Ways::new(half_depth_m.0),
            refused_frames: BTreeMap::new(),
        })
    }

    /// What came of a recording.
    #[must_use]
    pub fn tracked(&self, processed: Processed, mode: TrackingMode) -> Tracked {
        let refused_frames = self.refused_frames.clone();
        Tracked { processed, mode, refused_frames, tracks: self.ways.people() }
    }

    /// The lines, where they were to be kept as a text.
    #[must_use]
    pub fn text(&self) -> &[u8] {
        if let Lines::Text(text) = &self.lines { text } else { &[] }
    }

    fn write(&mut self, line: &TracksLine<'_>) -> io::Result<()> {
        match &mut self.lines {
            Lines::Nowhere => {}
            Lines::File(file) => line.write(file)?,
            Lines::Text(text) => line.write(text)?,
            Lines::Output => {
                let mut output = io::stdout().lock();
                line.write(&mut output)?;
                output.flush()?;
            }
        }
        self.csv.as_mut().map_or(Ok(()), |file| line.write_rows(file))
    }

    /// Draws the ways so far, smoothed where they are.
    fn draw(&self) -> io::Result<()> {
        let Some(path) = &self.figure else { return Ok(()) };
        let line =
            |label: String, places_m: &[[f64; 2]]| Line { label, places_m: places_m.to_vec() };
        let of_person = |(id, way)| {
            let smoothed = self.smoothing.places_m(id);
            line(id.to_string(), smoothed.unwrap_or(way))
        };
        let estimated: Vec<Line> = self.ways.places_m().map(of_person).collect();
        let truth = self.true_ways_m.iter().map(|way| line(String::new(), way)).collect();
        let title = format!("{}: the ways of {} people", self.node, estimated.len());
        let figure = PathsFigure { title, estimated, truth };
        let svg = figure.svg().map_err(io::Error::other)?;
        std::fs::write(path, svg).map_err(|error| named(path, &error))?;
        let png = figure.png().map_err(io::Error::other)?;
        let beside = path.with_extension("png");
        std::fs::write(&beside, png).map_err(|error| named(&beside, &error))
    }
}

impl PeriodSink for Follower {
    fn product(&self) -> &'static str {
        "tracks"
    }

    fn begin(&mut self, beginning: &Beginning) -> io::Result<()> {
        if let Some(video) = &mut self.video {
            video.begin(beginning);
        }
        Ok(())
    }

    /// Follows people into the period. Of a frame that the tracker refuses nothing is written.
    fn see(&mut self, seen: &Seen<'_>) -> io::Result<()> {
        let followed = follow(self.tracker.as_mut(), seen.time_s, seen.measured);
        let tracks: Option<Vec<TrackRecord>> = match followed {
            Ok(tracks) => Some(tracks),
            Err(error) => {
                *self.refused_frames.entry(error.label()).or_default() += 1;
                None
            }
        };
        if let Some(tracks) = &tracks {
            self.ways.take(seen.time_s, tracks);
            let smoothed = self.tracker.smoothed();
            self.smoothing.take(&self.node, (&smoothed, tracks), self.smoothed.as_mut())?;
            let node = self.node.clone();
            let (half_depth_m, half_depth_sigma_m) = self.half_depth_m;
            let Seen { period, time_s, .. } = *seen;
            self.write(&TracksLine {
                node: &node,
                period,
                time_s,
                tracks,
                half_depth_m,
                half_depth_sigma_m,
            })?;
        }
        let Some(video) = &mut self.video else { return Ok(()) };
        video.show(seen, tracks.as_deref().unwrap_or_default())
    }

    fn take(&mut self, _line: &PointsLine<'_>) -> io::Result<()> {
        Ok(())
    }

    fn finish(&mut self) -> io::Result<()> {
        if let Lines::File(file) = &mut self.lines {
            file.finish()?;
        }
        self.csv.as_mut().map_or(Ok(()), PartFile::finish)?;
        self.smoothing.finish(&self.node, self.smoothed.as_mut())?;
        self.smoothed.as_mut().map_or(Ok(()), PartFile::finish)?;
        self.video.as_mut().map_or(Ok(()), Video::finish)?;
        self.draw()
    }

    /// Keeps lines and rows as parts and draws the ways so far.
    fn abandon(&mut self) -> io::Result<()> {
        if let Lines::File(file) = &mut self.lines {
            file.abandon()?;
        }
        self.csv.as_mut().map_or(Ok(()), PartFile::abandon)?;
        self.smoothed.as_mut().map_or(Ok(()), PartFile::abandon)?;
        self.video.as_mut().map_or(Ok(()), Video::abandon)?;
        self.draw()
    }
}

fn created(path: &Path) -> io::Result<PartFile> {
    PartFile::create(path).map_err(|error| named(path, &error))
}

fn named(path: &Path, error: &io::Error) -> io::Error {
    io::Error::new(error.kind(), format!("{}: {error}", path.display()))
}
