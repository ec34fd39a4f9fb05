//! The ways of people in a node's plane as SVG or PNG, estimated and true \[mean-shift, figure 4\].

use std::ops::Range;

use plotters::chart::{ChartBuilder, ChartContext, SeriesLabelPosition};
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::drawing::{DrawingArea, DrawingAreaErrorKind};
use plotters::prelude::{
    BLACK, Cartesian2d, Circle, Color, IntoDrawingArea, IntoFont, LineSeries, PathElement,
    RGBColor, SVGBackend, Text, WHITE,
};
use plotters_backend::DrawingBackend;

use super::canvas::Canvas;
use super::raster::Raster;

/// Pixels of a metre, and of what stands around the axes.
const PIXELS_PER_M: f64 = 60.0;
const AROUND: (f64, f64) = (94.0, 100.0);
/// Width and height of the axes at most, pixels.
const MAX_PIXELS: f64 = 1000.0;
/// Least width, pixels: the title must have room.
const MIN_WIDTH: u32 = 360;
/// Room around the lines, metres.
const BORDER_M: f64 = 0.5;
/// The same in every figure, told apart by most eyes, in print too (Okabe and Ito).
const COLORS: [RGBColor; 6] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
];
const TRUTH_COLOR: RGBColor = RGBColor(120, 120, 120);

type Fallible<T> = Result<T, Box<dyn std::error::Error + Send + Sync>>;
type Chart<'a, B> = ChartContext<'a, B, Cartesian2d<RangedCoordf64, RangedCoordf64>>;
type Drawn<B> = Result<(), DrawingAreaErrorKind<<B as DrawingBackend>::ErrorType>>;

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
    /// As SVG.
    ///
    /// # Errors
    /// What the drawing library complains of.
    pub fn svg(&self) -> Fallible<String> {
        let mut svg = String::new();
        let area = SVGBackend::with_string(&mut svg, self.size()).into_drawing_area();
        self.draw(&area)?;
        drop(area);
        Ok(svg)
    }

    /// As PNG.
    ///
    /// # Errors
    /// What the drawing or the PNG library complains of.
    pub fn png(&self) -> Fallible<Vec<u8>> {
        let size = self.size();
        let mut canvas = Canvas::new(size.0, size.1);
        let area = Raster::new(&mut canvas, size).into_drawing_area();
        self.draw(&area)?;
        drop(area);
        let mut png = Vec::new();
        canvas.write_png(&mut png)?;
        Ok(png)
    }

    fn ranges_m(&self) -> [Range<f64>; 2] {
        around(self.estimated.iter().chain(&self.truth))
    }

    /// Width and height, pixels.
    fn size(&self) -> (u32, u32) {
        let [width_m, height_m] = self.ranges_m().map(|range| range.end - range.start);
        let scale = PIXELS_PER_M.min(MAX_PIXELS / width_m.max(height_m));
        let pixels = |side_m: f64, more: f64| super::to_u32((side_m * scale + more).round());
        (pixels(width_m, AROUND.0).max(MIN_WIDTH), pixels(height_m, AROUND.1))
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Drawn<B> {
        let Self { title, estimated, truth } = self;
        let [x_range, y_range] = self.ranges_m();
        area.fill(&WHITE)?;
        let mut chart = ChartBuilder::on(area)
            .caption(title.as_str(), ("sans-serif", 16).into_font())
            .margin(12)
            .margin_left(22)
            .x_label_area_size(40)
            .y_label_area_size(48)
            .build_cartesian_2d(x_range, y_range)?;
        chart.configure_mesh().x_desc("x in m").y_desc("y in m").light_line_style(WHITE).draw()?;
        for line in truth {
            let places = line.places_m.iter().map(|[x, y]| (*x, *y));
            chart.draw_series(LineSeries::new(places, TRUTH_COLOR.stroke_width(5)))?;
        }
        if !truth.is_empty() {
            let nothing = LineSeries::new([(0.0, 0.0); 0], TRUTH_COLOR);
            chart.draw_series(nothing)?.label("true").legend(|(x, y)| {
                PathElement::new(vec![(x, y), (x + 16, y)], TRUTH_COLOR.stroke_width(5))
            });
        }
        for (index, line) in estimated.iter().enumerate() {
            draw_estimated(&mut chart, COLORS[index % COLORS.len()], line)?;
        }
        if !truth.is_empty() {
            chart
                .configure_series_labels()
                .position(SeriesLabelPosition::UpperRight)
                .background_style(WHITE.mix(0.85))
                .border_style(BLACK.mix(0.3))
                .draw()?;
        }
        area.present()?;
        Ok(())
    }
}

/// A way with a dot and the label where it begins.
fn draw_estimated<B: DrawingBackend>(
    chart: &mut Chart<'_, B>,
    color: RGBColor,
    line: &Line,
) -> Drawn<B> {
    let places = line.places_m.iter().map(|[x, y]| (*x, *y));
    chart.draw_series(LineSeries::new(places, color.stroke_width(2)))?;
    let Some([x, y]) = line.places_m.first() else { return Ok(()) };
    chart.draw_series([Circle::new((*x, *y), 4, color.filled())])?;
    let font = ("sans-serif", 14).into_font().color(&color);
    chart.draw_series([Text::new(line.label.clone(), (*x + 0.1, *y + 0.1), font)])?;
    Ok(())
}

/// Everything inside; a square metre where there is nothing.
fn around<'a>(lines: impl Iterator<Item = &'a Line>) -> [Range<f64>; 2] {
    let mut ranges = [(f64::MAX, f64::MIN); 2];
    for place in lines.flat_map(|line| &line.places_m) {
        for (range, value) in ranges.iter_mut().zip(place) {
            *range = (range.0.min(*value), range.1.max(*value));
        }
    }
    ranges.map(|(least, most)| {
        let (least, most) = if least <= most { (least, most) } else { (0.0, 0.0) };
        least - BORDER_M..most + BORDER_M
    })
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
        // 3.1 m by 9 m at 60 pixels each.
        assert!(svg.contains("width=\"360\" height=\"640\""), "{}", &svg[..200]);
        let polylines = svg.matches("<polyline").count();
        assert!(2 <= polylines, "{polylines}");
        // The same in pixels: of that size, and neither blank nor grey alone.
        let png = figure.png().unwrap();
        let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
        let mut rgb = vec![0; reader.output_buffer_size().unwrap()];
        let shape = reader.next_frame(&mut rgb).unwrap();
        assert_eq!((shape.width, shape.height), (360, 640));
        let RGBColor(r, g, b) = COLORS[0];
        let colored = rgb.chunks(3).filter(|pixel| *pixel == [r, g, b]).count();
        assert!(300 < colored, "{colored}");
        let title = "nobody".to_owned();
        let nobody = PathsFigure { title, estimated: Vec::new(), truth: Vec::new() };
        assert!(nobody.svg().unwrap().contains("nobody"));
    }
}
