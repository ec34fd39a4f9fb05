//! The picture of four radars around a walker: the way and the track, and one image of rings.

use anyhow::anyhow;
use plotters::chart::{ChartBuilder, ChartContext};
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::{
    BLACK, Cartesian2d, Circle, Color, Cross, DrawingArea, IntoDrawingArea, IntoFont, PathElement,
    RGBColor, Rectangle, SVGBackend, SeriesLabelPosition, TriangleMarker, WHITE,
};
use proto::radar::Grid;

use super::{Geometry, TrackPoint};

const SIZE: (u32, u32) = (1120, 580);
const BLUE: RGBColor = RGBColor(0, 114, 178);
const ORANGE: RGBColor = RGBColor(213, 94, 0);
/// Both panels reach so far from the middle, metres.
const HALF_WIDTH_M: f64 = 2.3;
/// Shades of the image, each this many decibels of the product wide.
const SHADE_DB: f32 = 5.0;
/// Number of shades; what is weaker stays white.
const SHADE_COUNT: u32 = 6;

type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;
type Drawn = Result<(), Box<dyn std::error::Error + Send + Sync>>;

/// The SVG of `track` beside the image `shown` of one of its points.
///
/// # Errors
/// If it cannot be drawn.
pub(crate) fn draw(
    geometry: &Geometry,
    track: &[TrackPoint],
    grid: &Grid,
    shown: (&TrackPoint, &[f32]),
) -> anyhow::Result<String> {
    let mut svg = String::new();
    let mut fill = || -> Drawn {
        let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        area.fill(&WHITE)?;
        let (left, right) = area.split_horizontally(SIZE.0 / 2);
        draw_track(&left, geometry, track)?;
        draw_rings(&right, geometry, grid, shown)?;
        area.present()?;
        Ok(())
    };
    fill().map_err(|error| anyhow!("drawing the track: {error}"))?;
    Ok(svg)
}

fn panel<'a, 'b>(
    area: &'a DrawingArea<SVGBackend<'b>, Shift>,
    title: &str,
) -> Result<Chart<'a, 'b>, Box<dyn std::error::Error + Send + Sync>> {
    let range = -HALF_WIDTH_M..HALF_WIDTH_M;
    let mut chart = ChartBuilder::on(area)
        .caption(title, ("sans-serif", 17).into_font())
        .margin(10)
        .x_label_area_size(38)
        .y_label_area_size(46)
        .build_cartesian_2d(range.clone(), range)?;
    chart
        .configure_mesh()
        .x_desc("x in m")
        .y_desc("y in m")
        .x_labels(9)
        .y_labels(9)
        .x_label_formatter(&|x| format!("{x:.1}"))
        .y_label_formatter(&|y| format!("{y:.1}"))
        .light_line_style(WHITE)
        .draw()?;
    Ok(chart)
}

fn draw_track(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    geometry: &Geometry,
    track: &[TrackPoint],
) -> Drawn {
    let mut chart = panel(area, "Track of the walker from four single-channel radars")?;
    chart
        .draw_series([true_way(geometry)])?
        .label("true way")
        .legend(|(x, y)| PathElement::new([(x, y), (x + 18, y)], BLACK.stroke_width(2)));
    let seen = track.chunk_by(|a, b| a.seen == b.seen).filter(|piece| piece[0].seen);
    let lines = seen.map(|piece| {
        let places: Vec<(f64, f64)> = piece.iter().map(|point| (point.x_m, point.y_m)).collect();
        PathElement::new(places, BLUE.stroke_width(2))
    });
    chart
        .draw_series(lines)?
        .label("track while seen")
        .legend(|(x, y)| PathElement::new([(x, y), (x + 18, y)], BLUE.stroke_width(2)));
    draw_radars(&mut chart, geometry)?;
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperMiddle)
        .background_style(WHITE.mix(0.85))
        .border_style(BLACK.mix(0.3))
        .draw()?;
    Ok(())
}

fn draw_rings(
    area: &DrawingArea<SVGBackend<'_>, Shift>,
    geometry: &Geometry,
    grid: &Grid,
    (point, image): (&TrackPoint, &[f32]),
) -> Drawn {
    let title = format!("Product of the four at {:.1} s, {SHADE_DB} dB a shade", point.time_s);
    let mut chart = panel(area, &title)?;
    let strongest = image.iter().copied().fold(f32::MIN_POSITIVE, f32::max);
    let shade = |value: f32| {
        let below_db = (strongest - value) * 10.0 / std::f32::consts::LN_10;
        (0..SHADE_COUNT).find(|shade| below_db < SHADE_DB * (shade + 1) as f32)
    };
    let half_m = 0.5 * grid.pixel_m;
    for (row, pixels) in image.chunks_exact(grid.column_count).enumerate() {
        let mut column = 0;
        // Equal neighbours make one rectangle, which keeps the file small.
        for run in pixels.chunk_by(|a, b| shade(*a) == shade(*b)) {
            let (from, to) = (column, column + run.len() - 1);
            column += run.len();
            let Some(own) = shade(run[0]) else { continue };
            let color = ORANGE.mix(1.0 - f64::from(own) / f64::from(SHADE_COUNT)).filled();
            let corners = [
                (grid.x_m(from) - half_m, grid.y_m(row) - half_m),
                (grid.x_m(to) + half_m, grid.y_m(row) + half_m),
            ];
            chart.draw_series([Rectangle::new(corners, color)])?;
        }
    }
    chart.draw_series([true_way(geometry)])?;
    chart.draw_series([Cross::new((point.x_m, point.y_m), 8, BLUE.stroke_width(3))])?;
    chart.draw_series([Circle::new((point.x_m, point.y_m), 11, BLUE.stroke_width(2))])?;
    draw_radars(&mut chart, geometry)
}

fn true_way(geometry: &Geometry) -> PathElement<(f64, f64)> {
    let corners: Vec<(f64, f64)> = geometry.path_m.iter().map(|[x, y]| (*x, *y)).collect();
    PathElement::new(corners, BLACK.mix(0.6).stroke_width(2))
}

fn draw_radars(chart: &mut Chart<'_, '_>, geometry: &Geometry) -> Drawn {
    let places = geometry.nodes_m.values().map(|[x, y]| (*x, *y));
    chart.draw_series(places.map(|place| TriangleMarker::new(place, 8, BLACK.filled())))?;
    Ok(())
}
