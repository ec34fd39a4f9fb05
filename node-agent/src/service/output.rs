//! The agent's files: point sets as JSON Lines, and the newest image as PNG.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::time::Duration;

use anyhow::Context;
use proto::measured::MeasuredPoint;
use proto::time::NodeTime;
use proto::wire::PointSet;
use tracing::warn;

use crate::config::OutputConfig;
use crate::lines::PointsLine;
use crate::pipeline::{Image, ImageView};
use crate::plot::{Density, Picture};

/// The newest thing that can be shown.
enum Shown {
    Image { title: String, image: Image, points: Vec<MeasuredPoint> },
    Density { title: String },
}

pub(super) struct Output {
    config: OutputConfig,
    points: Option<BufWriter<File>>,
    newest: Option<Shown>,
    density: Density,
    image_written: Option<NodeTime>,
}

impl Output {
    pub(super) fn open(config: &OutputConfig) -> anyhow::Result<Self> {
        let create = |path: &Path| {
            let file = File::create(path);
            file.with_context(|| format!("creating output.points_jsonl {}", path.display()))
        };
        let points = config.points_jsonl.as_deref().map(create).transpose()?.map(BufWriter::new);
        let density = Density::default();
        Ok(Self { config: config.clone(), points, newest: None, density, image_written: None })
    }

    /// One line. A file that cannot be written is given up with a warning; measuring goes on.
    pub(super) fn write_set(&mut self, set: &PointSet, time_s: f64) {
        let Some(file) = &mut self.points else { return };
        let line = PointsLine {
            node: &set.node,
            period: set.period,
            time_s,
            points: &set.points,
            counters: &set.counters,
            half_depth_m: set.half_depth_m,
            half_depth_sigma_m: set.half_depth_sigma_m,
        };
        if let Err(error) = line.write(&mut *file).and_then(|()| file.flush()) {
            warn!(%error, "point sets are no longer written to output.points_jsonl");
            self.points = None;
        }
    }

    /// Takes an imaged sweep to be shown.
    pub(super) fn show_image(
        &mut self,
        now: NodeTime,
        title: impl FnOnce() -> String,
        image: &ImageView<'_>,
        points: &[MeasuredPoint],
    ) {
        if self.config.image_png.is_none() {
            return;
        }
        let (title, image, points) = (title(), image.to_image(), points.to_vec());
        self.newest = Some(Shown::Image { title, image, points });
        self.write_image_if_due(now);
    }

    /// Takes the points of a period that was not imaged here.
    pub(super) fn show_points(&mut self, now: NodeTime, title: String, points: &[MeasuredPoint]) {
        self.density.add(points);
        self.newest = Some(Shown::Density { title });
        self.write_image_if_due(now);
    }

    /// Writes what is pending.
    pub(super) fn finish(&mut self) {
        self.write_image();
    }

    fn write_image_if_due(&mut self, now: NodeTime) {
        let interval = Duration::from_secs_f64(self.config.image_interval_s).as_nanos();
        let written = self.image_written.get_or_insert(now);
        if interval <= u128::from(now.0.saturating_sub(written.0)) {
            self.image_written = Some(now);
            self.write_image();
        }
    }

    fn write_image(&mut self) {
        let (Some(path), Some(newest)) = (&self.config.image_png, &self.newest) else { return };
        if let Err(error) = write_atomically(path, |file| self.picture(newest, file)) {
            warn!(path = %path.display(), %error, "image not written");
        }
    }

    fn picture(&self, shown: &Shown, file: &mut BufWriter<File>) -> anyhow::Result<()> {
        match shown {
            Shown::Image { title, image, points } => {
                Ok(Picture::of_image(title.clone(), image, points).write_png(file)?)
            }
            Shown::Density { title } => {
                let Some((grid, amplitude)) = self.density.image() else { return Ok(()) };
                let (title, amplitude) = (title.clone(), amplitude.as_slice());
                Ok(Picture { title, grid, amplitude, points: &[] }.write_png(file)?)
            }
        }
    }
}

/// Writes beside the file and renames, so that a reader never sees half of it.
fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let beside = path.with_extension("part");
    let mut file = BufWriter::new(File::create(&beside)?);
    write(&mut file)?;
    file.flush()?;
    Ok(std::fs::rename(&beside, path)?)
}
