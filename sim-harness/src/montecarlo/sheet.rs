//! What every experiment leaves in its folder: a document with its bars, and pictures as SVG and as
//! PNG by one drawing routine.

use std::path::Path;

use anyhow::{Context, anyhow};
use node_agent::plot::canvas::Canvas;
use node_agent::plot::raster::Raster;
use plotters::coord::Shift;
use plotters::drawing::{DrawingArea, DrawingAreaErrorKind};
use plotters::prelude::{IntoDrawingArea, SVGBackend};
use plotters_backend::DrawingBackend;
use serde::Serialize;

pub(super) type Drawn<B> = Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

/// What a solver or a tracker of our own must reach.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Bar {
    pub(super) text: String,
    pub(super) is_met: bool,
}

impl Bar {
    /// As people read it.
    pub(super) fn line(&self) -> String {
        let Self { text, is_met } = self;
        format!("bar: {text}: {}\n", if *is_met { "met" } else { "NOT met" })
    }
}

/// A picture that knows its size, pixels, and draws itself on anything.
pub(super) trait Sheet {
    /// # Errors
    /// If it is too large.
    fn size(&self) -> anyhow::Result<(u32, u32)>;

    /// # Errors
    /// If the backend fails.
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Drawn<B>;

    /// The picture as SVG.
    ///
    /// # Errors
    /// If it cannot be drawn.
    fn svg(&self) -> anyhow::Result<String> {
        let mut svg = String::new();
        let area = SVGBackend::with_string(&mut svg, self.size()?).into_drawing_area();
        self.draw(&area).map_err(|error| anyhow!("drawing the picture as SVG: {error}"))?;
        drop(area);
        Ok(svg)
    }

    /// The picture as PNG.
    ///
    /// # Errors
    /// If it cannot be drawn or written.
    fn png(&self) -> anyhow::Result<Vec<u8>> {
        let size = self.size()?;
        let mut canvas = Canvas::new(size.0, size.1);
        let area = Raster::new(&mut canvas, size).into_drawing_area();
        self.draw(&area).map_err(|error| anyhow!("drawing the picture as PNG: {error}"))?;
        drop(area);
        let mut png = Vec::new();
        canvas.write_png(&mut png)?;
        Ok(png)
    }

    /// Writes both as `NAME.svg` and `NAME.png`.
    ///
    /// # Errors
    /// If they cannot be drawn or written.
    fn write(&self, folder: &Path, name: &str) -> anyhow::Result<()> {
        write(folder, &format!("{name}.svg"), self.svg()?.as_bytes())?;
        write(folder, &format!("{name}.png"), &self.png()?)
    }
}

/// A report and its bars as one JSON object.
///
/// # Errors
/// If a number cannot be written as JSON.
pub(super) fn document<R: Serialize, B: Serialize>(
    report: &R,
    bars: Vec<B>,
) -> anyhow::Result<String> {
    #[derive(Serialize)]
    struct Document<'a, R, B> {
        #[serde(flatten)]
        report: &'a R,
        bars: Vec<B>,
    }
    Ok(serde_json::to_string(&Document { report, bars })?)
}

/// Writes a file of an experiment.
///
/// # Errors
/// Names the file that cannot be written.
pub(super) fn write(folder: &Path, name: &str, bytes: &[u8]) -> anyhow::Result<()> {
    let path = folder.join(name);
    std::fs::write(&path, bytes).with_context(|| format!("writing {}", path.display()))
}
