//! Cumulative curves of the errors, as SVG and as PNG by one routine.

use chart::{Axes, COLORS, Chart, Drawn, Fallible, GREY, Sheet, legend, stroke};
use plotters::chart::SeriesLabelPosition;
use plotters::coord::Shift;
use plotters::drawing::DrawingArea;
use plotters::prelude::{
    BLACK, Color, Cross, DashedLineSeries, DrawingBackend, LineSeries, PathElement, Polygon,
    RGBColor,
};

use super::Figure;
use super::report::Report;
use super::score::{BOX_ANGLE_DEG, BOX_POSITION_M, CurvePoint, MethodScore};
use super::sheet::{HEADING_PIXELS, headed};

const PANEL_SIZE: (u32, u32) = (560, 330);
/// Length and gap of the dashes of the bound's curve, pixels.
const DASH: (i32, i32) = (6, 4);
/// How much of a curve's colour its confidence band has.
const BAND_SHARE: f64 = 0.12;

/// A cumulative curve with its confidence band.
struct Curve {
    label: String,
    color: RGBColor,
    is_bound: bool,
    points: Vec<CurvePoint>,
}

/// What the paper states, at a limit; without a share a line across all shares.
struct Mark {
    label: &'static str,
    limit: f64,
    share: Option<f64>,
}

/// One pair of axes.
struct Panel {
    title: String,
    unit: &'static str,
    reach: f64,
    curves: Vec<Curve>,
    mark: Option<Mark>,
}

/// All that is drawn.
pub(super) struct Page {
    heading: String,
    /// Left position, right angle, a row for each condition.
    panels: Vec<Panel>,
}

impl Page {
    /// The curves of all methods under all conditions.
    pub(super) fn of(report: &Report) -> Self {
        let mut panels = Vec::new();
        for result in &report.conditions {
            let label = result.condition.label;
            let [position, angle] = marks(report.figure);
            panels.push(Panel {
                title: format!("{label}: share of trials with position error up to"),
                unit: "m",
                reach: report.reach.position_m,
                curves: curves(&result.methods, |method| &method.position_m.curve),
                mark: position,
            });
            panels.push(Panel {
                title: format!("{label}: share of trials with angle error up to"),
                unit: "deg",
                reach: report.reach.angle_deg,
                curves: curves(&result.methods, |method| &method.angle_deg.curve),
                mark: angle,
            });
        }
        Self { heading: report.heading(), panels }
    }

    fn row_count(&self) -> usize {
        self.panels.len() / 2
    }
}

impl Sheet for Page {
    fn size(&self) -> Fallible<(u32, u32)> {
        let rows = u32::try_from(self.row_count())?;
        Ok((2 * PANEL_SIZE.0, rows * PANEL_SIZE.1 + HEADING_PIXELS))
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Drawn<B> {
        let rest = headed(area, &self.heading)?;
        for (panel, place) in self.panels.iter().zip(rest.split_evenly((self.row_count(), 2))) {
            draw_panel(panel, &place)?;
        }
        area.present()
    }
}

/// The published figures as far as they can be drawn: in all three conditions of figure 6 more than
/// 90 % in the box, and the means of figure 10.
fn marks(figure: Figure) -> [Option<Mark>; 2] {
    let boxed = |limit| {
        let label = "published (J = 500)";
        Some(Mark { label, limit, share: Some(0.9) })
    };
    let mean = |limit| Some(Mark { label: "published mean", limit, share: None });
    match figure {
        Figure::Fig6 => [boxed(BOX_POSITION_M), boxed(BOX_ANGLE_DEG)],
        Figure::Fig7 => [None, None],
        Figure::Fig10 => [mean(0.19), mean(3.15)],
    }
}

fn curves(methods: &[MethodScore], of: impl Fn(&MethodScore) -> &Vec<CurvePoint>) -> Vec<Curve> {
    let colors = COLORS.iter().cycle();
    let is_bound = |method: &MethodScore| method.trials.is_empty();
    let solvers = methods.iter().filter(|method| !is_bound(method)).zip(colors);
    let bound = methods.iter().filter(|method| is_bound(method)).map(|method| (method, &BLACK));
    let curve = |(method, color): (&MethodScore, &RGBColor)| {
        let label = if is_bound(method) { "Cramer-Rao bound" } else { method.method.as_str() };
        Curve {
            label: label.to_owned(),
            color: *color,
            is_bound: is_bound(method),
            points: of(method).clone(),
        }
    };
    solvers.chain(bound).map(curve).collect()
}

fn draw_panel<B: DrawingBackend>(panel: &Panel, place: &DrawingArea<B, Shift>) -> Drawn<B> {
    let axes = Axes {
        title: &panel.title,
        x_title: panel.unit,
        y_title: "share of trials",
        ranges: [0.0..panel.reach, 0.0..1.02],
    };
    let mut chart = axes.on(place)?;
    for curve in panel.curves.iter().filter(|curve| !curve.is_bound) {
        chart.draw_series([band(curve)])?;
    }
    for curve in &panel.curves {
        draw_curve(&mut chart, curve)?;
    }
    if let Some(mark) = &panel.mark {
        draw_mark(&mut chart, mark)?;
    }
    legend(&mut chart, SeriesLabelPosition::LowerRight)
}

/// The confidence band of every share on the curve.
fn band(curve: &Curve) -> Polygon<(f64, f64)> {
    let lower = curve.points.iter().map(|point| (point.limit, point.at_most.low));
    let upper = curve.points.iter().rev().map(|point| (point.limit, point.at_most.high));
    Polygon::new(lower.chain(upper).collect::<Vec<_>>(), curve.color.mix(BAND_SHARE))
}

fn draw_curve<B: DrawingBackend>(chart: &mut Chart<'_, B>, curve: &Curve) -> Drawn<B> {
    let points: Vec<(f64, f64)> =
        curve.points.iter().map(|point| (point.limit, point.at_most.share)).collect();
    let style = curve.color.stroke_width(if curve.is_bound { 1 } else { 2 });
    let series = if curve.is_bound {
        chart.draw_series(DashedLineSeries::new(points, DASH.0, DASH.1, style))?
    } else {
        chart.draw_series(LineSeries::new(points, style))?
    };
    series.label(curve.label.clone()).legend(move |at| stroke(at, style));
    Ok(())
}

fn draw_mark<B: DrawingBackend>(chart: &mut Chart<'_, B>, mark: &Mark) -> Drawn<B> {
    let series = match mark.share {
        Some(share) => {
            chart.draw_series([Cross::new((mark.limit, share), 6, BLACK.stroke_width(2))])?
        }
        None => {
            let ends = vec![(mark.limit, 0.0), (mark.limit, 1.0)];
            chart.draw_series([PathElement::new(ends, GREY.stroke_width(1))])?
        }
    };
    series.label(mark.label).legend(move |(x, y)| {
        let style = BLACK.stroke_width(2);
        PathElement::new(vec![(x + 4, y - 4), (x + 12, y + 4)], style)
    });
    Ok(())
}
