//! The experiments as pictures, like figures 4 to 8 of \[wide-area\]: true ways with plots, the ways that
//! each tracker puts together, and how trackers compare over variances and trial by trial.

use std::ops::Range;

use fusion_center::offline::COLORS;
use plotters::chart::{ChartBuilder, ChartContext, SeriesLabelPosition};
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::drawing::DrawingArea;
use plotters::prelude::{
    BLACK, Cartesian2d, Circle, Color, IntoFont, LineSeries, PathElement, RGBColor, WHITE,
};
use plotters_backend::DrawingBackend;

use super::super::sheet::{Drawn, Sheet};
use super::case::Case;
use super::entrants::Entrant;
use super::report::Report;
use super::summary::{EntrantResult, Figures};
use super::trial::{Outcome, Tally, TrackWay};
use super::{ConditionResult, Scenario};

const HEADING_PIXELS: u32 = 34;
const PANEL_WIDTH: u32 = 400;
/// What axes and captions take of a panel, pixels.
const PANEL_MARGIN: u32 = 84;
const CURVES_SIZE: (u32, u32) = (480, 330);
const GREY: RGBColor = RGBColor(120, 120, 120);
const LIGHT_GREY: RGBColor = RGBColor(228, 228, 228);
const RED: RGBColor = RGBColor(220, 30, 30);
/// At this size the library's guess of a text's width holds the widest letters of the raster.
const LEGEND_SIZE: u32 = 16;
/// Share of the curves' height that the legend needs more.
const LEGEND_SHARE: f64 = 0.7;
/// Trials drawn one by one, as figure 8 has them.
const SHOWN_TRIAL_COUNT: usize = 100;

type Chart<'a, B> = ChartContext<'a, B, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// The first trial of a condition.
#[derive(Clone, Debug, Default)]
pub(super) struct Sample {
    /// Where each target was at every look, metres.
    truths_m: Vec<Vec<[f64; 2]>>,
    plots_m: Vec<[f64; 2]>,
    tracks: Vec<(&'static str, Vec<TrackWay>)>,
}

impl Sample {
    pub(super) fn new(case: &Case, entrants: &[Entrant], outcomes: Option<&Vec<Outcome>>) -> Self {
        let targets = 0..u32::try_from(case.target_count()).unwrap_or(u32::MAX);
        let way = |target: u32| {
            let places = case.looks.iter().filter_map(|look| case.place_m(target, look.time_s));
            places.map(Into::into).collect()
        };
        let plots = case.looks.iter().flat_map(|look| &look.plots);
        let outcomes = outcomes.into_iter().flatten();
        let tracks = entrants.iter().zip(outcomes);
        Self {
            truths_m: targets.map(way).collect(),
            plots_m: plots.map(|plot| plot.position_m.into()).collect(),
            tracks: tracks.map(|(mode, outcome)| (mode.name(), outcome.ways.clone())).collect(),
        }
    }

    /// What holds all true ways, with a margin.
    fn extent_m(&self) -> [Range<f64>; 2] {
        let span = |axis: usize| {
            let values = || self.truths_m.iter().flatten().map(|at_m| at_m[axis]);
            let (low, high) = (
                values().fold(f64::INFINITY, f64::min),
                values().fold(f64::NEG_INFINITY, f64::max),
            );
            let margin = 0.08 * (high - low).max(100.0);
            low - margin..high + margin
        };
        [span(0), span(1)]
    }
}

/// True ways and plots, and beside them what every tracker made of them; a row for every condition.
pub(super) struct WaysPage<'a> {
    heading: String,
    rows: Vec<(&'a str, &'a Sample)>,
}

impl<'a> WaysPage<'a> {
    pub(super) fn of(report: &'a Report) -> Self {
        let title = match report.scenario {
            Scenario::ThreeTargets => "three targets, two turning, one pausing",
            _ => "four targets, two side by side, two crossing",
        };
        let row = |result: &'a ConditionResult| (result.label.as_str(), &result.sample);
        Self {
            heading: format!("{title}: the first trial, wrong links circled"),
            rows: report.conditions.iter().map(row).collect(),
        }
    }

    fn columns(&self) -> usize {
        1 + self.rows.first().map_or(0, |(_, sample)| sample.tracks.len())
    }

    /// As high as equal scales on both axes ask for.
    fn row_height(&self) -> u32 {
        let Some((_, sample)) = self.rows.first() else { return PANEL_WIDTH };
        let [east_m, north_m] = sample.extent_m();
        let ratio = (north_m.end - north_m.start) / (east_m.end - east_m.start);
        pixels(f64::from(PANEL_WIDTH - PANEL_MARGIN) * ratio) + PANEL_MARGIN
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "kept between 100 and 1200"
)]
fn pixels(length: f64) -> u32 {
    length.clamp(100.0, 1200.0) as u32
}

impl Sheet for WaysPage<'_> {
    fn size(&self) -> anyhow::Result<(u32, u32)> {
        let (columns, rows) = (u32::try_from(self.columns())?, u32::try_from(self.rows.len())?);
        Ok((columns.max(2) * PANEL_WIDTH, HEADING_PIXELS + rows * self.row_height()))
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Drawn<B> {
        area.fill(&WHITE)?;
        let (heading, rest) = area.split_vertically(HEADING_PIXELS);
        heading.titled(&self.heading, ("sans-serif", 22).into_font())?;
        let panels = rest.split_evenly((self.rows.len(), self.columns().max(2)));
        for ((label, sample), places) in self.rows.iter().zip(panels.chunks(self.columns().max(2)))
        {
            draw_truths(&places[0], label, sample)?;
            for ((name, ways), place) in sample.tracks.iter().zip(&places[1..]) {
                draw_tracks(place, &format!("{name}, {label}"), (sample, ways))?;
            }
        }
        area.present()
    }
}

fn panel<'a, B: DrawingBackend>(
    place: &'a DrawingArea<B, Shift>,
    title: &str,
    sample: &Sample,
) -> Result<Chart<'a, B>, plotters::drawing::DrawingAreaErrorKind<B::ErrorType>> {
    let [east_m, north_m] = sample.extent_m();
    let mut chart = ChartBuilder::on(place)
        .caption(title, ("sans-serif", 16).into_font())
        .margin(8)
        .x_label_area_size(38)
        .y_label_area_size(46)
        .build_cartesian_2d(east_m, north_m)?;
    chart
        .configure_mesh()
        .x_desc("east, m")
        .x_labels(5)
        .y_labels(5)
        .x_label_formatter(&whole)
        .y_label_formatter(&whole)
        .light_line_style(WHITE)
        .bold_line_style(LIGHT_GREY)
        .draw()?;
    Ok(chart)
}

/// Without digits behind the point.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "the library asks for it")]
fn whole(value: &f64) -> String {
    format!("{value:.0}")
}

fn line(way_m: &[[f64; 2]]) -> Vec<(f64, f64)> {
    way_m.iter().map(|[east_m, north_m]| (*east_m, *north_m)).collect()
}

fn draw_truths<B: DrawingBackend>(
    place: &DrawingArea<B, Shift>,
    label: &str,
    sample: &Sample,
) -> Drawn<B> {
    let mut chart = panel(place, &format!("true ways and plots, {label}"), sample)?;
    for (way_m, color) in sample.truths_m.iter().zip(COLORS.iter().cycle()) {
        chart.draw_series(LineSeries::new(line(way_m), color.stroke_width(2)))?;
    }
    let dots = line(&sample.plots_m).into_iter();
    chart.draw_series(dots.map(|at| Circle::new(at, 2, GREY.filled())))?;
    Ok(())
}

/// True ways in grey, plots joined as the tracker joined them, wrong links circled.
fn draw_tracks<B: DrawingBackend>(
    place: &DrawingArea<B, Shift>,
    title: &str,
    (sample, ways): (&Sample, &[TrackWay]),
) -> Drawn<B> {
    let mut chart = panel(place, title, sample)?;
    for way_m in &sample.truths_m {
        chart.draw_series(LineSeries::new(line(way_m), LIGHT_GREY.stroke_width(3)))?;
    }
    for (way, color) in ways.iter().zip(COLORS.iter().cycle()) {
        let joined = way.plots_m.iter().map(|(at_m, _)| (at_m[0], at_m[1]));
        chart.draw_series(LineSeries::new(joined, color.mix(0.45).stroke_width(1)))?;
        chart.draw_series(LineSeries::new(line(&way.smoothed_m), color.stroke_width(2)))?;
    }
    let wrong = ways.iter().flat_map(|way| way.plots_m.windows(2)).filter_map(|link| {
        let [(from_m, before), (to_m, after)] = link else { return None };
        let is_right = before.is_some() && before == after;
        let middle = (0.5 * (from_m[0] + to_m[0]), 0.5 * (from_m[1] + to_m[1]));
        (!is_right).then_some(middle)
    });
    chart.draw_series(wrong.map(|at| Circle::new(at, 7, RED.stroke_width(1))))?;
    Ok(())
}

/// Right links and errors over the variances, and trial by trial.
pub(super) struct Comparison<'a> {
    heading: String,
    conditions: &'a [ConditionResult],
}

impl<'a> Comparison<'a> {
    pub(super) fn of(report: &'a Report) -> Self {
        let Report { trial_count, seed, .. } = report;
        let heading = format!("methods compared: {trial_count} trials, seed {seed}");
        Self { heading, conditions: &report.conditions }
    }

    fn mean_panels<B: DrawingBackend>(&self, place: &DrawingArea<B, Shift>) -> Drawn<B> {
        let halves = place.split_evenly((1, 2));
        let of_links = |figures: &Figures| figures.right_links.map(|f| 100.0 * f.value);
        self.curves(&halves[0], "right links, %, by variance, m2", of_links)?;
        let of_errors = |figures: &Figures| figures.rmse_m.map(|f| f.value * f.value);
        self.curves(&halves[1], "mean square error, m2, by variance, m2", of_errors)
    }

    /// One curve for every tracker over the conditions, which are as far apart as each other.
    fn curves<B: DrawingBackend>(
        &self,
        place: &DrawingArea<B, Shift>,
        title: &str,
        of: impl Fn(&Figures) -> Option<f64>,
    ) -> Drawn<B> {
        let modes = self.conditions.first().map_or(&[][..], |first| &first.entrants);
        let value = |index: usize, condition: &ConditionResult| {
            of(&condition.entrants.get(index)?.figures).filter(|value| value.is_finite())
        };
        let all = (0..modes.len())
            .flat_map(|index| self.conditions.iter().filter_map(move |one| value(index, one)));
        let mut reach = reach(all.collect());
        // The legend stands above the curves.
        reach.end += LEGEND_SHARE * (reach.end - reach.start);
        let last = (self.conditions.len() as f64 - 1.0).max(0.0);
        let mut chart = ChartBuilder::on(place)
            .caption(title, ("sans-serif", 16).into_font())
            .margin(10)
            .x_label_area_size(30)
            .y_label_area_size(60)
            .build_cartesian_2d(-0.3..last + 0.3, reach)?;
        let label = |x: &f64| {
            let nearest =
                self.conditions.iter().zip(0..).find(|(_, at)| (x - f64::from(*at)).abs() < 0.05);
            let variance = nearest.and_then(|(condition, _)| condition.variance_m2);
            variance.map_or_else(String::new, |variance_m2| variance_m2.to_string())
        };
        chart
            .configure_mesh()
            .x_labels(12)
            .x_label_formatter(&label)
            .light_line_style(WHITE)
            .bold_line_style(LIGHT_GREY)
            .draw()?;
        for (index, mode) in modes.iter().enumerate() {
            let style = COLORS[index % COLORS.len()].stroke_width(2);
            let points: Vec<(f64, f64)> = (0..)
                .zip(self.conditions)
                .filter_map(|(at, one)| Some((f64::from(at), value(index, one)?)))
                .collect();
            chart
                .draw_series(LineSeries::new(points.clone(), style))?
                .label(mode.mode.name())
                .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 16, y)], style));
            let dots = points.into_iter();
            chart.draw_series(dots.map(|at| Circle::new(at, 3, style.filled())))?;
        }
        legend(&mut chart)
    }
}

/// From the least to the largest value, with a margin.
fn reach(values: Vec<f64>) -> Range<f64> {
    let low = values.iter().copied().fold(f64::INFINITY, f64::min);
    let high = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if high < low {
        return 0.0..1.0;
    }
    let margin = 0.05 * (high - low).max(1e-3 * high.abs()).max(1e-9);
    low - margin..high + margin
}

fn legend<'a, B: DrawingBackend + 'a>(chart: &mut Chart<'a, B>) -> Drawn<B> {
    chart
        .configure_series_labels()
        .position(SeriesLabelPosition::UpperLeft)
        .background_style(WHITE.mix(0.9))
        .border_style(GREY)
        .label_font(("sans-serif", LEGEND_SIZE).into_font())
        .draw()
}

impl Sheet for Comparison<'_> {
    fn size(&self) -> anyhow::Result<(u32, u32)> {
        let rows = 1 + u32::try_from(self.conditions.len())?;
        Ok((2 * CURVES_SIZE.0, HEADING_PIXELS + rows * CURVES_SIZE.1))
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Drawn<B> {
        area.fill(&WHITE)?;
        let (heading, rest) = area.split_vertically(HEADING_PIXELS);
        heading.titled(&self.heading, ("sans-serif", 22).into_font())?;
        let (means, singles) = rest.split_vertically(CURVES_SIZE.1);
        self.mean_panels(&means)?;
        let places = singles.split_evenly((self.conditions.len(), 2));
        for (condition, place) in self.conditions.iter().zip(places.chunks(2)) {
            let label = &condition.label;
            let links =
                |tally: &Tally| tally.plot_links.right_link_rate().map(|share| 100.0 * share);
            draw_trials(&place[0], &format!("right links, %, {label}"), condition, links)?;
            let squares = |tally: &Tally| tally.mean_square_m2().map(f64::log10);
            let title = format!("log10 of mean square error, m2, {label}");
            draw_trials(&place[1], &title, condition, squares)?;
        }
        area.present()
    }
}

/// One curve for every tracker over its trials.
fn draw_trials<B: DrawingBackend>(
    place: &DrawingArea<B, Shift>,
    title: &str,
    condition: &ConditionResult,
    of: impl Fn(&Tally) -> Option<f64>,
) -> Drawn<B> {
    let shown = |one: &EntrantResult| -> Vec<(f64, f64)> {
        let trials = (0..).zip(one.trials.iter().take(SHOWN_TRIAL_COUNT));
        let points = trials.filter_map(|(index, tally)| Some((f64::from(index), of(tally)?)));
        points.filter(|(_, value)| value.is_finite()).collect()
    };
    let curves: Vec<Vec<(f64, f64)>> = condition.entrants.iter().map(shown).collect();
    let count = curves.iter().map(Vec::len).max().unwrap_or(0);
    let reach = reach(curves.iter().flatten().map(|(_, value)| *value).collect());
    let mut chart = ChartBuilder::on(place)
        .caption(title, ("sans-serif", 16).into_font())
        .margin(10)
        .x_label_area_size(34)
        .y_label_area_size(60)
        .build_cartesian_2d(0.0..(count as f64).max(1.0), reach)?;
    chart
        .configure_mesh()
        .x_desc("trial")
        .axis_style(BLACK)
        .light_line_style(WHITE)
        .bold_line_style(LIGHT_GREY)
        .draw()?;
    for (points, color) in curves.into_iter().zip(COLORS.iter().cycle()) {
        chart.draw_series(LineSeries::new(points, color.stroke_width(1)))?;
    }
    Ok(())
}
