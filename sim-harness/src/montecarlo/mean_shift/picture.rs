//! One experiment as a picture: paths of the first trial, true and estimated, as figure 4 of
//! \[mean-shift\] shows them, and how errors go over time. SVG and PNG by one routine.

use fusion_center::offline::COLORS;
use node_agent::tracking::experiments::{DURATION_S, FRAME_S, room};
use plotters::chart::{ChartBuilder, SeriesLabelPosition};
use plotters::coord::Shift;
use plotters::drawing::DrawingArea;
use plotters::prelude::{BLACK, Color, IntoFont, LineSeries, PathElement, RGBColor, WHITE};
use plotters_backend::DrawingBackend;

use super::super::sheet::{Drawn, Sheet};
use super::report::Report;
use super::summary::MomentFigures;
use super::{SceneResult, TrackerResult};

/// A panel of paths has the room's shape.
const PATHS_SIZE: (u32, u32) = (330, 480);
const CURVES_HEIGHT: u32 = 260;
const HEADING_PIXELS: u32 = 34;
const GREY: RGBColor = RGBColor(120, 120, 120);
const LIGHT_GREY: RGBColor = RGBColor(228, 228, 228);
/// At this size the library's guess of a text's width holds the widest letters of the raster.
const LEGEND_SIZE: u32 = 16;
/// Up to where errors are drawn, metres: the gate is 0.5 m if not set otherwise.
const ERROR_REACH_M: f64 = 0.6;

/// All that is drawn of one experiment.
pub(super) struct Page<'a> {
    heading: String,
    trackers: &'a [TrackerResult],
}

impl<'a> Page<'a> {
    pub(super) fn of(report: &Report, result: &'a SceneResult) -> Self {
        let Report { trial_count, seed, .. } = report;
        let heading = format!(
            "{}: paths of the first trial, errors of {trial_count} trials, seed {seed}",
            result.label
        );
        Self { heading, trackers: &result.trackers }
    }
}

impl Sheet for Page<'_> {
    fn size(&self) -> anyhow::Result<(u32, u32)> {
        // The heading needs the width of two panels.
        let panel_count = u32::try_from(self.trackers.len())?.max(2);
        Ok((panel_count * PATHS_SIZE.0, HEADING_PIXELS + PATHS_SIZE.1 + 2 * CURVES_HEIGHT))
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Drawn<B> {
        area.fill(&WHITE)?;
        let (heading, rest) = area.split_vertically(HEADING_PIXELS);
        heading.titled(&self.heading, ("sans-serif", 22).into_font())?;
        let (paths, curves) = rest.split_vertically(PATHS_SIZE.1);
        let places = paths.split_evenly((1, self.trackers.len().max(2)));
        for (tracker, place) in self.trackers.iter().zip(&places) {
            draw_paths(tracker, place)?;
        }
        let (errors, unfound) = curves.split_vertically(CURVES_HEIGHT);
        let title = "RMS error of those followed, m, over time, s";
        self.draw_curves(&errors, (title, ERROR_REACH_M), |moment| moment.rmse_m)?;
        let other_title = "share of people not followed, over time, s";
        self.draw_curves(&unfound, (other_title, 1.02), |moment| Some(moment.unfound_share))?;
        area.present()
    }
}

impl Page<'_> {
    fn draw_curves<B: DrawingBackend>(
        &self,
        place: &DrawingArea<B, Shift>,
        (title, reach): (&str, f64),
        of: impl Fn(&MomentFigures) -> Option<f64>,
    ) -> Drawn<B> {
        let mut chart = ChartBuilder::on(place)
            .caption(title, ("sans-serif", 16).into_font())
            .margin(10)
            .x_label_area_size(30)
            .y_label_area_size(38)
            .build_cartesian_2d(0.0..DURATION_S, 0.0..reach)?;
        chart.configure_mesh().light_line_style(WHITE).bold_line_style(LIGHT_GREY).draw()?;
        for (tracker, color) in self.trackers.iter().zip(COLORS.iter().cycle()) {
            let moments = tracker.summary.over_time.iter().enumerate();
            let points = moments.filter_map(|(index, moment)| {
                Some((FRAME_S * index as f64, of(moment)?.min(reach)))
            });
            let style = color.stroke_width(2);
            chart
                .draw_series(LineSeries::new(points, style))?
                .label(tracker.summary.tracker)
                .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 16, y)], style));
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperRight)
            .background_style(WHITE.mix(0.9))
            .border_style(GREY)
            .label_font(("sans-serif", LEGEND_SIZE).into_font())
            .draw()
    }
}

/// True paths as thin black lines, every confirmed track in a colour of its own.
fn draw_paths<B: DrawingBackend>(
    tracker: &TrackerResult,
    place: &DrawingArea<B, Shift>,
) -> Drawn<B> {
    let grid = room();
    let (left_m, near_m) = (grid.x_min_m, 0.0);
    let right_m = grid.x_m(grid.column_count - 1);
    let far_m = grid.y_m(grid.row_count - 1);
    let mut chart = ChartBuilder::on(place)
        .caption(tracker.summary.tracker, ("sans-serif", 16).into_font())
        .margin(8)
        .x_label_area_size(38)
        .y_label_area_size(30)
        .build_cartesian_2d(left_m..right_m, near_m..far_m)?;
    chart
        .configure_mesh()
        .x_desc("m")
        .light_line_style(WHITE)
        .bold_line_style(LIGHT_GREY)
        .draw()?;
    let line = |path_m: &[[f64; 2]]| path_m.iter().map(|[x_m, y_m]| (*x_m, *y_m)).collect();
    for path_m in &tracker.first.truths_m {
        let points: Vec<(f64, f64)> = line(path_m);
        chart.draw_series(LineSeries::new(points, BLACK.stroke_width(1)))?;
    }
    for (path_m, color) in tracker.first.tracks_m.values().zip(COLORS.iter().cycle()) {
        let points: Vec<(f64, f64)> = line(path_m);
        chart.draw_series(LineSeries::new(points, color.stroke_width(2)))?;
    }
    Ok(())
}
