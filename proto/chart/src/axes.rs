//! Axes with titles and grid, and what is drawn on them alike everywhere.

use std::ops::Range;

use plotters::chart::{ChartBuilder, SeriesLabelPosition};
use plotters::coord::Shift;
use plotters::drawing::DrawingArea;
use plotters::prelude::{
    BLACK, Circle, Color, IntoFont, LineSeries, PathElement, ShapeStyle, WHITE,
};
use plotters_backend::DrawingBackend;

use super::{Chart, Drawn, Failure, LIGHT_GREY};

/// Pixels of a chart beside what its axes enclose, to the left and right and above and below together.
pub const AROUND: (u32, u32) = (2 * MARGIN + Y_LABELS, 2 * MARGIN + X_LABELS + CAPTION);
const MARGIN: u32 = 12;
/// Numbers and title of the axis below, and of the one to the left, pixels.
const X_LABELS: u32 = 42;
const Y_LABELS: u32 = 56;
/// What the library gives a caption of this size in SVG, pixels.
const CAPTION: u32 = 22;
const CAPTION_SIZE: u32 = 16;
/// At this size the library's guess of a text's width holds the widest letters of the raster.
const LEGEND_SIZE: u32 = 16;
/// A number on an axis has at least this room, width and height, pixels.
const LABEL_PIXELS: (u32, u32) = (56, 32);
/// More numbers than this help nobody.
const MAX_LABEL_COUNT: u32 = 12;

/// Size of a picture of one chart whose axes enclose a square, pixels.
#[must_use]
pub const fn square_size(side: u32) -> (u32, u32) {
    (AROUND.0 + side, AROUND.1 + side)
}

/// What stands around a chart, and what its axes reach.
#[derive(Clone, Debug)]
pub struct Axes<'a> {
    /// Above it.
    pub title: &'a str,
    /// Below it, with the unit.
    pub x_title: &'a str,
    /// To its left, with the unit.
    pub y_title: &'a str,
    /// From where to where, `x` and `y`.
    pub ranges: [Range<f64>; 2],
}

impl Axes<'_> {
    /// The empty chart.
    ///
    /// # Errors
    /// If the backend fails.
    pub fn on<'b, B: DrawingBackend>(
        &self,
        area: &'b DrawingArea<B, Shift>,
    ) -> Result<Chart<'b, B>, Failure<B>> {
        self.labelled(area, &tick)
    }

    /// The empty chart, with the numbers below it as `x_label` writes them.
    ///
    /// # Errors
    /// If the backend fails.
    pub fn labelled<'b, B: DrawingBackend>(
        &self,
        area: &'b DrawingArea<B, Shift>,
        x_label: &dyn Fn(&f64) -> String,
    ) -> Result<Chart<'b, B>, Failure<B>> {
        let [x_range, y_range] = self.ranges.clone();
        let mut chart = ChartBuilder::on(area)
            .caption(self.title, ("sans-serif", CAPTION_SIZE).into_font())
            .margin(MARGIN)
            .x_label_area_size(X_LABELS)
            .y_label_area_size(Y_LABELS)
            .build_cartesian_2d(x_range, y_range)?;
        let (width, height) = chart.plotting_area().dim_in_pixel();
        let count = |pixels: u32, one: u32| (pixels / one).clamp(2, MAX_LABEL_COUNT) as usize;
        chart
            .configure_mesh()
            .x_desc(self.x_title)
            .y_desc(self.y_title)
            .x_labels(count(width, LABEL_PIXELS.0))
            .y_labels(count(height, LABEL_PIXELS.1))
            .x_label_formatter(&x_label)
            .y_label_formatter(&tick)
            .light_line_style(WHITE)
            .bold_line_style(LIGHT_GREY)
            .draw()?;
        Ok(chart)
    }
}

/// A number on an axis, without more digits than it needs and never as minus zero.
#[must_use]
pub fn tick(value: &f64) -> String {
    // Steps of the axes are multiples of powers of ten, apart from rounding.
    let rounded = (value * 1e6).round() / 1e6;
    format!("{}", rounded + 0.0)
}

/// A line through places.
///
/// # Errors
/// If the backend fails.
pub fn way<B: DrawingBackend>(
    chart: &mut Chart<'_, B>,
    places: impl IntoIterator<Item = [f64; 2]>,
    style: impl Into<ShapeStyle>,
) -> Drawn<B> {
    let points = places.into_iter().map(|[x, y]| (x, y));
    chart.draw_series(LineSeries::new(points, style))?;
    Ok(())
}

/// An entry of the legend that shows a piece of a line.
pub fn stroke(at: (i32, i32), style: impl Into<ShapeStyle>) -> PathElement<(i32, i32)> {
    PathElement::new(vec![(at.0, at.1), (at.0 + 16, at.1)], style)
}

/// A series of nothing, for an entry in the legend.
#[must_use]
pub fn nothing() -> [Circle<(f64, f64), i32>; 0] {
    []
}

/// The legend of everything that has a label, in a corner.
///
/// # Errors
/// If the backend fails.
pub fn legend<'a, B: DrawingBackend + 'a>(
    chart: &mut Chart<'a, B>,
    corner: SeriesLabelPosition,
) -> Drawn<B> {
    chart
        .configure_series_labels()
        .position(corner)
        .background_style(WHITE.mix(0.85))
        .border_style(BLACK.mix(0.3))
        .label_font(("sans-serif", LEGEND_SIZE).into_font())
        .draw()
}

#[cfg(test)]
mod tests {
    use plotters::prelude::{IntoDrawingArea, SVGBackend};

    use super::*;

    #[test]
    fn numbers_have_the_digits_that_they_need() {
        let written = [-0.0, -1e-9, 0.1 + 0.2, -2.0, 1e4, 0.05].map(|value| tick(&value));
        assert_eq!(written, ["0", "0", "0.3", "-2", "10000", "0.05"]);
    }

    /// What is left of the picture is what the axes enclose.
    #[test]
    fn the_room_around_the_axes_is_as_stated() {
        let mut svg = String::new();
        let size = (AROUND.0 + 300, AROUND.1 + 200);
        let area = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        let axes = Axes {
            title: "title",
            x_title: "x in m",
            y_title: "y in m",
            ranges: [0.0..3.0, 0.0..2.0],
        };
        let chart = axes.on(&area).unwrap();
        let (width, height) = chart.plotting_area().dim_in_pixel();
        assert!(width.abs_diff(300) <= 1 && height.abs_diff(200) <= 1, "{width} {height}");
        drop(chart);
        drop(area);
        for text in ["title", "x in m", "y in m", ">\n0\n", ">\n2\n"] {
            assert!(svg.contains(text), "{text:?}: {svg}");
        }
    }
}
