//! A look at the image where somebody is expected: what is there, and does it look like them.
//!
//! Around the expected place, in range and sine, the largest local maximum that is nearer to them
//! than to anybody else is where mean shift starts; it ends in the middle of what looks like the
//! template ([`super::super::shift`]). A flank of somebody else's echo is no maximum, so valleys
//! part two people. Brightness is relative to that maximum: people fade, and keep their shape.

use nalgebra::Vector2;
use proto::radar::Grid;

use super::super::histogram::{Bins, sums};
use super::super::maxima::Raster;
use super::super::shift::{ShiftRule, Template, Weighting, shift};
use super::super::template::Ellipse;

/// Bins of a histogram \[mean-shift, section 2.1\].
const BIN_COUNT: usize = 16;
/// Half axes of a template over the standard deviations of what is seen: at 2, an even ellipse.
const HALF_AXES_SIGMAS: f64 = 2.0;
/// Least and largest half axes, pixels: below there is nothing to compare, above it takes too long.
const HALF_AXES_PX: [f64; 2] = [1.5, 24.0];
/// The shift ends so, pixels and steps.
const RULE: ShiftRule = ShiftRule {
    weighting: Weighting::Bright,
    epsilon_px: 0.1,
    max_iteration_count: 8,
    bandwidth: 1.0,
};
/// The peak of somebody measured at a place is no farther from it, pixels.
const PEAK_REACH_PX: usize = 3;

/// The image and where its pixels are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Picture<'a> {
    pub(super) raster: Raster<'a>,
    pub(super) grid: Grid,
}

/// Where somebody is looked for: half widths in range, metres, and sine.
#[derive(Clone, Copy, Debug)]
pub(super) struct Window {
    pub(super) middle_m: Vector2<f64>,
    pub(super) range_m: f64,
    pub(super) sine: f64,
}

/// What was found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Found {
    pub(super) place_m: Vector2<f64>,
    pub(super) peak: f32,
    pub(super) likeness: f64,
}

impl Window {
    /// How far `place_m` is from the middle, 1 at the edge.
    fn distance2(&self, place_m: &Vector2<f64>) -> f64 {
        let (here, there) = (self.middle_m.norm().max(1e-3), place_m.norm().max(1e-3));
        let sine = self.middle_m.x / here - place_m.x / there;
        ((there - here) / self.range_m).powi(2) + (sine / self.sine).powi(2)
    }

    /// Whether `place_m` is inside, and nearer than to the middles of `others_m`.
    fn is_nearest(&self, place_m: &Vector2<f64>, others_m: &[Vector2<f64>]) -> bool {
        let own = self.distance2(place_m);
        let of = |middle_m: &Vector2<f64>| Self { middle_m: *middle_m, ..*self }.distance2(place_m);
        own < 1.0 && others_m.iter().all(|other| own < of(other))
    }
}

impl Picture<'_> {
    fn to_px(self, place_m: &Vector2<f64>) -> Vector2<f64> {
        (place_m - Vector2::new(self.grid.x_min_m, self.grid.y_min_m)) / self.grid.pixel_m
    }

    fn to_m(self, place_px: &Vector2<f64>) -> Vector2<f64> {
        place_px * self.grid.pixel_m + Vector2::new(self.grid.x_min_m, self.grid.y_min_m)
    }

    /// Columns or rows within `half_px` of `middle_px`, of `count`.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "clamped to the image"
    )]
    fn span(middle_px: f64, half_px: f64, count: usize) -> std::ops::Range<usize> {
        let last = count as f64;
        let (from, to) = ((middle_px - half_px).ceil(), (middle_px + half_px).floor() + 1.0);
        from.clamp(0.0, last) as usize..to.clamp(0.0, last) as usize
    }

    /// Whether no neighbour is larger.
    fn is_maximum(&self, column: usize, row: usize) -> bool {
        let value = self.raster.at(column, row);
        let rows = row.saturating_sub(1)..(row + 2).min(self.raster.row_count);
        let columns = column.saturating_sub(1)..=(column + 1).min(self.raster.column_count - 1);
        rows.map(|near| self.raster.part(near, *columns.start(), *columns.end()))
            .all(|part| part.iter().all(|other| *other <= value))
    }

    /// The largest local maximum above `floor` in `window` that is not nearer to one of `others`.
    pub(super) fn peak(
        &self,
        window: &Window,
        floor: f32,
        others_m: &[Vector2<f64>],
    ) -> Option<(Vector2<f64>, f32)> {
        let middle_px = self.to_px(&window.middle_m);
        let reach_m = window.range_m.hypot(window.sine * window.middle_m.norm() * 1.5);
        let half_px = reach_m / self.grid.pixel_m;
        let columns = || Self::span(middle_px.x, half_px, self.raster.column_count);
        let rows = Self::span(middle_px.y, half_px, self.raster.row_count);
        let (mut best, mut least) = (None, floor);
        for (row, column) in rows.flat_map(|row| columns().map(move |column| (row, column))) {
            let value = self.raster.at(column, row);
            if value <= least || !self.is_maximum(column, row) {
                continue;
            }
            let place_m = self.to_m(&Vector2::new(column as f64, row as f64));
            if window.is_nearest(&place_m, others_m) {
                (best, least) = (Some((place_m, value)), value);
            }
        }
        best
    }

    /// Half axes of the template of what has the second moments `extent_m2`.
    fn half_axes_px(&self, extent_m2: &[f64; 3]) -> Vector2<f64> {
        // A moment below zero has no root: such a template would have no size.
        let half = |m2: f64| HALF_AXES_SIGMAS * m2.max(0.0).sqrt() / self.grid.pixel_m;
        let [least, most] = HALF_AXES_PX;
        Vector2::new(half(extent_m2[0]).clamp(least, most), half(extent_m2[2]).clamp(least, most))
    }

    /// The template of somebody measured at `place_m`; `None` outside the image or where it is dark.
    pub(super) fn template(
        &self,
        place_m: &Vector2<f64>,
        extent_m2: &[f64; 3],
    ) -> Option<Template> {
        let centre_px = self.to_px(place_m);
        let half = PEAK_REACH_PX as f64;
        let rows = Self::span(centre_px.y, half, self.raster.row_count);
        let columns = Self::span(centre_px.x, half, self.raster.column_count);
        let last = columns.end.checked_sub(1).filter(|last| columns.start <= *last)?;
        let parts = rows.flat_map(|row| self.raster.part(row, columns.start, last));
        let top = parts.copied().fold(0.0, f32::max);
        let bins = Bins { count: BIN_COUNT, top, floor: 0.0 };
        let ellipse = Ellipse { centre_px, half_axes_px: self.half_axes_px(extent_m2) };
        if 0.0 < top { Template::new(&self.raster, &ellipse, bins) } else { None }
    }

    /// From the maximum `peak` at `place_m` by mean shift to what looks like `template`.
    pub(super) fn shifted(
        &self,
        (place_m, peak): (Vector2<f64>, f32),
        template: &Template,
    ) -> Option<Found> {
        let bins = Bins { top: peak, ..template.bins };
        let known = Template { bins, ..template.clone() };
        let end = shift(&self.raster, &known, self.to_px(&place_m), &RULE)?;
        let ellipse = Ellipse { centre_px: end.centre_px, half_axes_px: known.half_axes_px };
        let likeness = sums(&self.raster, &ellipse, &bins).histogram()?.likeness(&known.histogram);
        Some(Found { place_m: self.to_m(&end.centre_px), peak, likeness })
    }
}
