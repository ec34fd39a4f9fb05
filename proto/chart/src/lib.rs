//! Charts as all programs draw them: the same axes, colours, ways and legends, as SVG and as PNG.

mod axes;
pub mod canvas;
mod raster;
mod sheet;
mod span;

pub use axes::{AROUND, Axes, legend, nothing, square_size, stroke, tick, way};
pub use sheet::{Fallible, Sheet};
pub use span::{around, quiet_corner, squared};

use plotters::chart::ChartContext;
use plotters::coord::types::RangedCoordf64;
use plotters::drawing::DrawingAreaErrorKind;
use plotters::prelude::{Cartesian2d, RGBColor};
use plotters_backend::DrawingBackend;

/// Told apart by most eyes, in print too (Okabe and Ito).
pub const COLORS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(120, 94, 240),
];
/// What is true, or has no colour of its own.
pub const GREY: RGBColor = RGBColor(120, 120, 120);
/// Grids, and what only stands behind something.
pub const LIGHT_GREY: RGBColor = RGBColor(228, 228, 228);

/// Two axes of numbers on any backend.
pub type Chart<'a, B> = ChartContext<'a, B, Cartesian2d<RangedCoordf64, RangedCoordf64>>;
/// Why something could not be drawn.
pub type Failure<B> = DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>;
/// Whether something could be drawn.
pub type Drawn<B> = Result<(), Failure<B>>;

/// The colour of one of several: after the last the first comes again.
#[must_use]
pub fn color(index: usize) -> RGBColor {
    COLORS[index % COLORS.len()]
}
