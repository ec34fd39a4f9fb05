//! One experiment as a picture: paths of the first trial, true and estimated, as figure 4 of
//! \[mean-shift\] shows them, and how errors go over time. SVG and PNG by one routine.

use chart::{Axes, COLORS, Drawn, Fallible, Sheet, legend, stroke, way};
use node_agent::tracking::experiments::{DURATION_S, FRAME_S, room};
use plotters::chart::SeriesLabelPosition;
use plotters::coord::Shift;
use plotters::drawing::DrawingArea;
use plotters::prelude::{BLACK, Color, DrawingBackend, LineSeries};

use super::super::sheet::{HEADING_PIXELS, headed};
use super::report::Report;
use super::summary::MomentFigures;
use super::{SceneResult, TrackerResult};

/// A panel of paths has the room's shape.
const PATHS_SIZE: (u32, u32) = (330, 480);
const CURVES_HEIGHT: u32 = 260;
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
    fn size(&self) -> Fallible<(u32, u32)> {
        // The heading needs the width of two panels.
        let panel_count = u32::try_from(self.trackers.len())?.max(2);
        Ok((panel_count * PATHS_SIZE.0, HEADING_PIXELS + PATHS_SIZE.1 + 2 * CURVES_HEIGHT))
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> Drawn<B> {
        let rest = headed(area, &self.heading)?;
        let (paths, curves) = rest.split_vertically(PATHS_SIZE.1);
        let places = paths.split_evenly((1, self.trackers.len().max(2)));
        for (tracker, place) in self.trackers.iter().zip(&places) {
            draw_paths(tracker, place)?;
        }
        let (errors, unfound) = curves.split_vertically(CURVES_HEIGHT);
        let title = "RMS error of those followed, m";
        self.draw_curves(&errors, (title, ERROR_REACH_M), |moment| moment.rmse_m)?;
        let other_title = "share of people not followed";
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
        let ranges = [0.0..DURATION_S, 0.0..reach];
        let axes = Axes { title, x_title: "time, s", y_title: "", ranges };
        let mut chart = axes.on(place)?;
        for (tracker, color) in self.trackers.iter().zip(COLORS.iter().cycle()) {
            let moments = tracker.summary.over_time.iter().enumerate();
            let points = moments.filter_map(|(index, moment)| {
                Some((FRAME_S * index as f64, of(moment)?.min(reach)))
            });
            let style = color.stroke_width(2);
            chart
                .draw_series(LineSeries::new(points, style))?
                .label(tracker.summary.tracker)
                .legend(move |at| stroke(at, style));
        }
        legend(&mut chart, SeriesLabelPosition::UpperRight)
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
    let axes = Axes {
        title: tracker.summary.tracker,
        x_title: "x in m",
        y_title: "y in m",
        ranges: [left_m..right_m, near_m..far_m],
    };
    let mut chart = axes.on(place)?;
    for path_m in &tracker.first.truths_m {
        way(&mut chart, path_m.iter().copied(), BLACK.stroke_width(1))?;
    }
    for (path_m, color) in tracker.first.tracks_m.values().zip(COLORS.iter().cycle()) {
        way(&mut chart, path_m.iter().copied(), color.stroke_width(2))?;
    }
    Ok(())
}
