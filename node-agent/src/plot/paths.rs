//! The ways of people in a node's plane as SVG or PNG, estimated and true \[mean-shift, figure 4\].

use std::ops::Range;

use chart::{
    AROUND, Axes, Chart, Drawn, Fallible, GREY, Sheet, around, color, legend, nothing,
    quiet_corner, stroke, way,
};
use plotters::coord::Shift;
use plotters::drawing::DrawingArea;
use plotters::prelude::{Circle, Color, DrawingBackend, IntoFont, RGBColor, Text, WHITE};

/// Pixels of a metre.
const PIXELS_PER_M: f64 = 60.0;
/// Width and height of the axes at most, pixels.
const MAX_PIXELS: f64 = 1000.0;
/// Least width, pixels: the title must have room.
const MIN_WIDTH: u32 = 360;
/// Room around the lines, metres.
const BORDER_M: f64 = 0.5;
/// How wide true ways are drawn, pixels: estimated ones lie on them.
const TRUTH_WIDTH: u32 = 5;

/// One person's way.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// What stands at its beginning; nothing if empty.
    pub label: String,
    /// The way, `[x, y]` in metres, at least one place.
    pub places_m: Vec<[f64; 2]>,
}

/// The figure: estimated ways in colour with their labels, true ones in grey below them.
#[derive(Clone, Debug, PartialEq)]
pub struct PathsFigure {
    /// Its title.
    pub title: String,
    /// The ways as they were found.
    pub estimated: Vec<Line>,
    /// The ways as they were.
    pub truth: Vec<Line>,
}

impl PathsFigure {
    fn places_m(&self) -> impl Iterator<Item = [f64; 2]> {
        let lines = self.estimated.iter().chain(&self.truth);
        lines.flat_map(|line| line.places_m.iter().copied())
    }

    /// Everything inside, and as wide as the least picture is; a square metre where there is nothing.
    fn ranges_m(&self) -> [Range<f64>; 2] {
        let [x, y] =
            around(self.places_m()).map(|range| range.start - BORDER_M..range.end + BORDER_M);
        let least_m = f64::from(MIN_WIDTH - AROUND.0) / pixels_per_m(&x, &y);
        let more_m = 0.5 * (least_m - (x.end - x.start)).max(0.0);
        [x.start - more_m..x.end + more_m, y]
    }
}

/// The scale of both axes.
fn pixels_per_m(x_m: &Range<f64>, y_m: &Range<f64>) -> f64 {
    let longest_m = (x_m.end - x_m.start).max(y_m.end - y_m.start);
    PIXELS_PER_M.min(MAX_PIXELS / longest_m)
}

impl Sheet for PathsFigure {
    /// So that both axes have one scale.
    fn size(&self) -> Fallible<(u32, u32)> {
        let [x, y] = self.ranges_m();
        let scale = pixels_per_m(&x, &y);
        let pixels =
            |range: &Range<f64>| super::to_u32(((range.end - range.start) * scale).round());
        Ok((pixels(&x) + AROUND.0, pixels(&y) + AROUND.1))
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Drawn<B> {
        let Self { title, estimated, truth } = self;
        area.fill(&WHITE)?;
        let axes = Axes { title, x_title: "x in m", y_title: "y in m", ranges: self.ranges_m() };
        let mut chart = axes.on(area)?;
        for line in truth {
            way(&mut chart, line.places_m.iter().copied(), GREY.stroke_width(TRUTH_WIDTH))?;
        }
        for (index, line) in estimated.iter().enumerate() {
            draw_estimated(&mut chart, color(index), line)?;
        }
        if !truth.is_empty() {
            let entry = |at| stroke(at, GREY.stroke_width(TRUTH_WIDTH));
            chart.draw_series(nothing())?.label("true").legend(entry);
            legend(&mut chart, quiet_corner(self.places_m(), &self.ranges_m()))?;
        }
        area.present()
    }
}

/// A way with a dot and the label where it begins.
fn draw_estimated<B: DrawingBackend>(
    chart: &mut Chart<'_, B>,
    color: RGBColor,
    line: &Line,
) -> Drawn<B> {
    way(chart, line.places_m.iter().copied(), color.stroke_width(2))?;
    let Some([x, y]) = line.places_m.first() else { return Ok(()) };
    chart.draw_series([Circle::new((*x, *y), 4, color.filled())])?;
    let font = ("sans-serif", 14).into_font().color(&color);
    chart.draw_series([Text::new(line.label.clone(), (*x + 0.1, *y + 0.1), font)])?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn true_and_estimated_ways_are_drawn_to_one_scale() {
        let line = |label: &str, places_m: &[[f64; 2]]| Line {
            label: label.to_owned(),
            places_m: places_m.to_vec(),
        };
        let truth = [line("", &[[-1.0, 4.0], [-1.0, 10.0]])];
        let estimated = [line("7", &[[-1.1, 4.1], [-0.9, 9.9]]), line("12", &[[1.0, 2.0]])];
        let figure = PathsFigure {
            title: "n1: ways".to_owned(),
            estimated: estimated.to_vec(),
            truth: truth.to_vec(),
        };
        let svg = figure.svg().unwrap();
        for text in ["n1: ways", "true", ">\n7\n", ">\n12\n", "x in m"] {
            assert!(svg.contains(text), "{text}: {svg}");
        }
        // The least width, and 9 m at 60 pixels each with what stands around.
        assert!(svg.contains("width=\"360\" height=\"628\""), "{}", &svg[..200]);
        let polylines = svg.matches("<polyline").count();
        assert!(2 <= polylines, "{polylines}");
        // The same in pixels: of that size, and neither blank nor grey alone.
        let [x, y] = figure.ranges_m();
        let scales = [280.0 / (x.end - x.start), 540.0 / (y.end - y.start)];
        assert!(scales.iter().all(|scale| (scale - 60.0).abs() < 1e-9), "{scales:?}");
        let png = figure.png().unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
        let mut rgb = vec![0; reader.output_buffer_size().unwrap()];
        let shape = reader.next_frame(&mut rgb).unwrap();
        assert_eq!((shape.width, shape.height), (360, 628));
        let RGBColor(r, g, b) = color(0);
        let colored = rgb.chunks(3).filter(|pixel| *pixel == [r, g, b]).count();
        assert!(300 < colored, "{colored}");
        let title = "nobody".to_owned();
        let nobody = PathsFigure { title, estimated: Vec::new(), truth: Vec::new() };
        assert!(nobody.svg().unwrap().contains("nobody"));
    }
}
