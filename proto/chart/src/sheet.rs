//! Pictures as SVG and as PNG by one drawing routine.

use std::error::Error;

use plotters::coord::Shift;
use plotters::drawing::DrawingArea;
use plotters::prelude::{IntoDrawingArea, SVGBackend};
use plotters_backend::DrawingBackend;

use super::Drawn;
use super::canvas::Canvas;
use super::raster::Raster;

/// What may fail in a library.
pub type Fallible<T> = Result<T, Box<dyn Error + Send + Sync>>;

/// A picture that knows its size, pixels, and draws itself on anything.
pub trait Sheet {
    /// Width and height, pixels.
    ///
    /// # Errors
    /// If it is too large.
    fn size(&self) -> Fallible<(u32, u32)>;

    /// Draws it on a backend of that size.
    ///
    /// # Errors
    /// If the backend fails.
    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Drawn<B>;

    /// The picture as SVG; the same picture gives the same text.
    ///
    /// # Errors
    /// What the drawing library complains of.
    fn svg(&self) -> Fallible<String> {
        let mut svg = String::new();
        let area = SVGBackend::with_string(&mut svg, self.size()?).into_drawing_area();
        self.draw(&area)?;
        drop(area);
        Ok(svg)
    }

    /// The picture as PNG.
    ///
    /// # Errors
    /// What the drawing or the PNG library complains of.
    fn png(&self) -> Fallible<Vec<u8>> {
        let size = self.size()?;
        let mut canvas = Canvas::new(size.0, size.1);
        let area = Raster::new(&mut canvas, size).into_drawing_area();
        self.draw(&area)?;
        drop(area);
        let mut png = Vec::new();
        canvas.write_png(&mut png)?;
        Ok(png)
    }
}
