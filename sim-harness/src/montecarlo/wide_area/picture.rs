//! The experiments as pictures, like figures 4 to 8 of \[wide-area\]: true ways with plots, the ways that
//! each tracker puts together, and how trackers compare over variances and trial by trial.

use std::ops::Range;

use chart::{
    AROUND, Axes, COLORS, Chart, Drawn, Failure, Fallible, GREY, LIGHT_GREY, Sheet, around, legend,
    stroke, way,
};
use plotters::chart::SeriesLabelPosition;
use plotters::coord::Shift;
use plotters::drawing::DrawingArea;
use plotters::prelude::{Circle, Color, DrawingBackend, LineSeries, RGBColor};

use super::super::sheet::{HEADING_PIXELS, headed};
use super::case::Case;
use super::entrants::Entrant;
use super::report::Report;
use super::summary::{EntrantResult, Figures};
use super::trial::{Outcome, Tally, TrackWay};
use super::{ConditionResult, Scenario};

/// What the axes of a panel of ways enclose from left to right, pixels.
const WAYS_WIDTH: u32 = 320;
const CURVES_SIZE: (u32, u32) = (480, 330);
const RED: RGBColor = RGBColor(220, 30, 30);
/// Share of the conditions' width that the legend stands in, beside them.
const LEGEND_SHARE: f64 = 0.45;
/// Room on either side of the conditions, which are 1 apart.
const BESIDE: f64 = 0.3;
/// Trials drawn one by one, as figure 8 has them.
const SHOWN_TRIAL_COUNT: usize = 100;
/// Room around true ways, as a share of each axis, and what counts as an axis at least, metres.
const MARGIN: f64 = 0.08;
const LEAST_SPAN_M: f64 = 100.0;

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
        around(self.truths_m.iter().flatten().copied()).map(|range| {
            let margin = MARGIN * (range.end - range.start).max(LEAST_SPAN_M);
            range.start - margin..range.end + margin
        })
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
            heading: format!(
                "{title}: the first trial; true ways are grey, thin lines join plots, wrong links are \
                 circled"
            ),
            rows: report.conditions.iter().map(row).collect(),
        }
    }

    fn columns(&self) -> usize {
        1 + self.rows.first().map_or(0, |(_, sample)| sample.tracks.len())
    }

    /// Of a panel, so that both axes have one scale.
    fn panel_size(&self) -> (u32, u32) {
        let first = self.rows.first().map(|(_, sample)| sample.extent_m());
        let [east_m, north_m] = first.unwrap_or([0.0..1.0, 0.0..1.0]);
        let ratio = (north_m.end - north_m.start) / (east_m.end - east_m.start);
        (AROUND.0 + WAYS_WIDTH, AROUND.1 + pixels(f64::from(WAYS_WIDTH) * ratio))
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
    fn size(&self) -> Fallible<(u32, u32)> {
        let (columns, rows) = (u32::try_from(self.columns())?, u32::try_from(self.rows.len())?);
        let (width, height) = self.panel_size();
        Ok((columns.max(2) * width, HEADING_PIXELS + rows * height))
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Drawn<B> {
        let rest = headed(area, &self.heading)?;
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
) -> Result<Chart<'a, B>, Failure<B>> {
    Axes { title, x_title: "east, m", y_title: "north, m", ranges: sample.extent_m() }.on(place)
}

fn draw_truths<B: DrawingBackend>(
    place: &DrawingArea<B, Shift>,
    label: &str,
    sample: &Sample,
) -> Drawn<B> {
    let mut chart = panel(place, &format!("true ways and plots, {label}"), sample)?;
    for (way_m, color) in sample.truths_m.iter().zip(COLORS.iter().cycle()) {
        way(&mut chart, way_m.iter().copied(), color.stroke_width(2))?;
    }
    let dots = sample.plots_m.iter().map(|[east_m, north_m]| (*east_m, *north_m));
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
        way(&mut chart, way_m.iter().copied(), LIGHT_GREY.stroke_width(3))?;
    }
    for (track, color) in ways.iter().zip(COLORS.iter().cycle()) {
        let joined = track.plots_m.iter().map(|(at_m, _)| *at_m);
        way(&mut chart, joined, color.mix(0.45).stroke_width(1))?;
        way(&mut chart, track.smoothed_m.iter().copied(), color.stroke_width(2))?;
    }
    let wrong = ways.iter().flat_map(|track| track.plots_m.windows(2)).filter_map(|link| {
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
        self.curves(&halves[0], "right links, %", of_links)?;
        let of_errors = |figures: &Figures| figures.rmse_m.map(|f| 2.0 * f.value.log10());
        self.curves(&halves[1], "log10 of mean square error, m2", of_errors)
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
        let width = self.conditions.len() as f64 - 1.0 + 2.0 * BESIDE;
        let x_range = -BESIDE..(1.0 + LEGEND_SHARE) * width - BESIDE;
        let axes = Axes {
            title,
            x_title: "variance on both axes, m2",
            y_title: "",
            ranges: [x_range, reach(all.collect())],
        };
        let mut chart = axes.labelled(place, &|x| self.variance(*x))?;
        for (index, mode) in modes.iter().enumerate() {
            let style = COLORS[index % COLORS.len()].stroke_width(2);
            let points: Vec<(f64, f64)> = (0..)
                .zip(self.conditions)
                .filter_map(|(at, one)| Some((f64::from(at), value(index, one)?)))
                .collect();
            chart
                .draw_series(LineSeries::new(points.clone(), style))?
                .label(mode.mode.name())
                .legend(move |at| stroke(at, style));
            let dots = points.into_iter();
            chart.draw_series(dots.map(|at| Circle::new(at, 3, style.filled())))?;
        }
        legend(&mut chart, SeriesLabelPosition::UpperRight)
    }

    /// What stands below a condition, and nothing anywhere else.
    fn variance(&self, x: f64) -> String {
        let mut places = self.conditions.iter().zip(0..);
        let found = places.find(|(_, at)| (x - f64::from(*at)).abs() < 1e-6);
        let variance = found.and_then(|(condition, _)| condition.variance_m2);
        variance.map_or_else(String::new, |variance_m2| variance_m2.to_string())
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

impl Sheet for Comparison<'_> {
    fn size(&self) -> Fallible<(u32, u32)> {
        let rows = 1 + u32::try_from(self.conditions.len())?;
        Ok((2 * CURVES_SIZE.0, HEADING_PIXELS + rows * CURVES_SIZE.1))
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Drawn<B> {
        let rest = headed(area, &self.heading)?;
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
    let ranges = [0.0..(count as f64).max(1.0), reach];
    let mut chart = Axes { title, x_title: "trial", y_title: "", ranges }.on(place)?;
    for (points, color) in curves.into_iter().zip(COLORS.iter().cycle()) {
        chart.draw_series(LineSeries::new(points, color.stroke_width(1)))?;
    }
    Ok(())
}
