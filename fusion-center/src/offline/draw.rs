//! The map of a registration: points and nodes in one frame, as SVG \[registration, figure 5\].

use chart::{
    Axes, Chart, Drawn, Fallible, Sheet, around, legend, quiet_corner, square_size, squared,
    stroke, way,
};
use plotters::coord::Shift;
use plotters::drawing::DrawingArea;
use plotters::prelude::{
    BLACK, Circle, Color, Cross, DrawingBackend, IntoFont, PathElement, RGBColor, ShapeStyle, Text,
    TriangleMarker, WHITE,
};
use proto::geom::{Node, Point, Ref, Se2};

/// What the axes enclose, pixels.
const SIDE: u32 = 640;
/// Space around what is shown, as a share of its size.
const MARGIN: f64 = 0.1;
/// Half of what is shown at least, metres.
const LEAST_HALF_M: f64 = 0.5;
/// Of the first node's points, pixels; each further node's are larger.
const FIRST_RADIUS: i32 = 3;
/// Length of the arrow along a node's boresight, metres.
const ARROW_M: f64 = 0.8;

/// One node's share of a picture.
#[derive(Clone, Debug)]
pub struct Layer {
    /// Name in the legend.
    pub label: String,
    /// Of points and node.
    pub color: RGBColor,
    /// In the picture's frame, metres.
    pub points_m: Vec<[f64; 2]>,
    /// Where the node is found to stand; an arrow along its boresight.
    pub estimated: Option<Se2<Ref, Node>>,
    /// Where it stands; a cross.
    pub truth: Option<Se2<Ref, Node>>,
    /// The ways of people whom the node follows; thin lines with their labels.
    pub ways: Vec<Way>,
}

/// One person's way in the picture's frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Way {
    /// What stands at its end.
    pub label: String,
    /// Its colour.
    pub color: RGBColor,
    /// The way, metres.
    pub places_m: Vec<[f64; 2]>,
}

/// Points, nodes and ways in one frame; equal scales on both axes, everything inside.
#[derive(Clone, Debug)]
pub struct Site {
    /// Above it.
    pub title: String,
    /// In the order of the legend.
    pub layers: Vec<Layer>,
}

impl Sheet for Site {
    fn size(&self) -> Fallible<(u32, u32)> {
        Ok(square_size(SIDE))
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Drawn<B> {
        area.fill(&WHITE)?;
        let ranges = squared(around(self.layers.iter().flat_map(places)), LEAST_HALF_M, MARGIN);
        let corner = quiet_corner(self.layers.iter().flat_map(places), &ranges);
        let axes = Axes { title: &self.title, x_title: "x in m", y_title: "y in m", ranges };
        let mut chart = axes.on(area)?;
        for (radius, layer) in (FIRST_RADIUS..).zip(&self.layers) {
            draw_layer(&mut chart, radius, layer)?;
        }
        legend(&mut chart, corner)?;
        area.present()
    }
}

/// The first node's points are filled, the others' open, so that both show where they meet.
fn draw_layer<B: DrawingBackend>(chart: &mut Chart<'_, B>, radius: i32, layer: &Layer) -> Drawn<B> {
    let color = layer.color;
    let is_first = radius == FIRST_RADIUS;
    let style: ShapeStyle = if is_first { color.filled() } else { color.stroke_width(1) };
    let dots = layer.points_m.iter().map(|[x, y]| Circle::new((*x, *y), radius, style));
    let series = chart.draw_series(dots)?.label(layer.label.clone());
    if layer.points_m.is_empty() && !layer.ways.is_empty() {
        series.legend(move |at| stroke(at, color.stroke_width(1)));
    } else {
        series.legend(move |(x, y)| Circle::new((x + 8, y), 4, style));
    }
    if let Some(pose) = layer.truth {
        let at = pose.translation_m();
        chart.draw_series([Cross::new((at.x, at.y), 7, BLACK.stroke_width(2))])?;
    }
    if let Some(pose) = layer.estimated {
        let (at, ahead) = (pose.translation_m(), pose * Point::<Node>::new(0.0, ARROW_M));
        let arrow = vec![(at.x, at.y), (ahead.x_m(), ahead.y_m())];
        chart.draw_series([PathElement::new(arrow, color.stroke_width(2))])?;
        chart.draw_series([TriangleMarker::new((at.x, at.y), 7, color.filled())])?;
    }
    layer.ways.iter().try_for_each(|way| draw_way(chart, way))
}

fn draw_way<B: DrawingBackend>(chart: &mut Chart<'_, B>, line: &Way) -> Drawn<B> {
    way(chart, line.places_m.iter().copied(), line.color.stroke_width(1))?;
    let Some([x, y]) = line.places_m.last() else { return Ok(()) };
    let font = ("sans-serif", 12).into_font().color(&line.color);
    chart.draw_series([Text::new(line.label.clone(), (*x, *y), font)])?;
    Ok(())
}

/// Everything that is to be inside, metres.
fn places(layer: &Layer) -> impl Iterator<Item = [f64; 2]> {
    let poses = layer.estimated.iter().chain(&layer.truth);
    let nodes = poses.map(|pose| pose.translation_m().into());
    let ways = layer.ways.iter().flat_map(|way| way.places_m.iter().copied());
    layer.points_m.iter().copied().chain(nodes).chain(ways)
}
