//! What every experiment leaves in its folder: a document with its bars, and pictures as SVG and as
//! PNG by one drawing routine.

use std::path::Path;

use anyhow::{Context, anyhow};
use chart::Sheet;
use plotters::coord::Shift;
use plotters::drawing::DrawingArea;
use plotters::prelude::{DrawingBackend, IntoFont, WHITE};
use serde::Serialize;

/// Height of what stands above a sheet of several charts, pixels.
pub(super) const HEADING_PIXELS: u32 = 34;

/// Writes what stands above a sheet of several charts; the rest of the area.
///
/// # Errors
/// If the backend fails.
pub(super) fn headed<B: DrawingBackend>(
    area: &DrawingArea<B, Shift>,
    heading: &str,
) -> Result<DrawingArea<B, Shift>, chart::Failure<B>> {
    area.fill(&WHITE)?;
    let (above, rest) = area.split_vertically(HEADING_PIXELS);
    above.titled(heading, ("sans-serif", 22).into_font())?;
    Ok(rest)
}

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

/// Writes a picture as `NAME.svg` and `NAME.png`.
///
/// # Errors
/// If it cannot be drawn or written.
pub(super) fn draw(sheet: &impl Sheet, folder: &Path, name: &str) -> anyhow::Result<()> {
    let svg = sheet.svg().map_err(|error| anyhow!("drawing {name}.svg: {error}"))?;
    let png = sheet.png().map_err(|error| anyhow!("drawing {name}.png: {error}"))?;
    write(folder, &format!("{name}.svg"), svg.as_bytes())?;
    write(folder, &format!("{name}.png"), &png)
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
