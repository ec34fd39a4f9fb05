//! The map of a registration: points and nodes in one frame, as SVG \[registration, figure 5\].

use plotters::chart::{ChartBuilder, ChartContext};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::{
    BLACK, Cartesian2d, Circle, Color, Cross, IntoDrawingArea, IntoFont, PathElement, RGBColor,
    SVGBackend, SeriesLabelPosition, ShapeStyle, Text, TriangleMarker, WHITE,
};
use proto::geom::{Node, Point, Ref, Se2};

const SIZE: (u32, u32) = (760, 720);
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
/// Length of the arrow along a node's boresight, metres.
const ARROW_M: f64 = 0.8;

type Chart<'a> = ChartContext<'a, SVGBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

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
    /// The way, metres.
    pub places_m: Vec<[f64; 2]>,
}

/// The picture as SVG.
///
/// # Errors
/// What the drawing library complains of.
pub fn picture(
    title: &str,
    layers: &[Layer],
) -> Result<String, Box<dyn std::error::Error + Send + Sync>> {
    let mut svg = String::new();
    draw_into(&mut svg, title, layers)?;
    Ok(svg)
}

fn draw_into(
    svg: &mut String,
    title: &str,
    layers: &[Layer],
) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    let area = SVGBackend::with_string(svg, SIZE).into_drawing_area();
    area.fill(&WHITE)?;
    let [x_range, y_range] = square_around(layers);
    let mut chart = ChartBuilder::on(&area)
        .caption(title, ("sans-serif", 18).into_font())
        .margin(12)
        .x_label_area_size(42)
        .y_label_area_size(52)
        .build_cartesian_2d(x_range, y_range)?;
    chart.configure_mesh().x_desc("x in m").y_desc("y in m").light_line_style(WHITE).draw()?;
    for (index, layer) in layers.iter().enumerate() {
        draw_layer(&mut chart, index, layer)?;
    }
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperRight)
        .background_style(WHITE.mix(0.85))
        .border_style(BLACK.mix(0.3))
        .draw()?;
    area.present()?;
    Ok(())
}

/// The first node's points are filled, the others' open, so that both show where they meet.
fn draw_layer(
    chart: &mut Chart<'_>,
    index: usize,
    layer: &Layer,
) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    let color = layer.color;
    let radius = 3 + i32::try_from(index)?;
    let style: ShapeStyle = if index == 0 { color.filled() } else { color.stroke_width(1) };
    let dots = layer.points_m.iter().map(|[x, y]| Circle::new((*x, *y), radius, style));
    chart
        .draw_series(dots)?
        .label(layer.label.clone())
        .legend(move |(x, y)| Circle::new((x + 8, y), 4, style));
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
    layer.ways.iter().try_for_each(|way| draw_way(chart, color, way))
}

fn draw_way(
    chart: &mut Chart<'_>,
    color: RGBColor,
    way: &Way,
) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
    let places = way.places_m.iter().map(|[x, y]| (*x, *y));
    chart.draw_series([PathElement::new(places.collect::<Vec<_>>(), color.stroke_width(1))])?;
    let Some([x, y]) = way.places_m.last() else { return Ok(()) };
    let font = ("sans-serif", 11).into_font().color(&color);
    chart.draw_series([Text::new(way.label.clone(), (*x, *y), font)])?;
    Ok(())
}

/// Equal scales on both axes, everything inside.
fn square_around(layers: &[Layer]) -> [std::ops::Range<f64>; 2] {
    let places = layers.iter().flat_map(|layer| {
        let poses = layer.estimated.iter().chain(&layer.truth);
        let nodes = poses.map(|pose| [pose.translation_m().x, pose.translation_m().y]);
        let ways = layer.ways.iter().flat_map(|way| way.places_m.iter().copied());
        layer.points_m.iter().copied().chain(nodes).chain(ways)
    });
    let mut ranges = [(f64::MAX, f64::MIN); 2];
    for place in places {
        for (range, value) in ranges.iter_mut().zip(place) {
            *range = (range.0.min(value), range.1.max(value));
        }
    }
    let known = ranges.map(|(least, most)| if least <= most { (least, most) } else { (0.0, 1.0) });
    let half = known.iter().map(|(least, most)| 0.5 * (most - least)).fold(0.5, f64::max) * 1.2;
    known.map(|(least, most)| {
        let middle = 0.5 * (least + most);
        middle - half..middle + half
    })
}
