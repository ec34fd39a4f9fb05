//! One track of the published tracker: its template, where it was, and in which frames.
//!
//! Covariance: a place errs by `σ_r` in range and `R σ_θ` across, `R_k` for both ends of the
//! difference that is the velocity, `T` apart: `P_pp = R`, `P_pv = R / T`, `P_vv = 2 R / T²`.

use nalgebra::{Matrix2, Matrix4, Vector2, Vector4};
use proto::measured::line_of_sight;
use proto::radar::Grid;

use super::config::{MAX_VELOCITY_COUNT, PaperConfig};
use crate::tracking::shift::{Shifted, Template};
use crate::tracking::template::Ellipse;
use crate::tracking::{Track, TrackStatus};

/// When and on which pixels a frame was taken, and the settings.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    pub(super) time_s: f64,
    pub(super) grid: Grid,
    pub(super) config: PaperConfig,
}

impl Place {
    fn metres(&self, place_px: &Vector2<f64>) -> Vector2<f64> {
        let Grid { x_min_m, y_min_m, pixel_m, .. } = self.grid;
        Vector2::new(x_min_m, y_min_m) + place_px * pixel_m
    }
}

/// Somebody, perhaps.
#[derive(Clone, Debug)]
pub(super) struct Followed {
    id: u64,
    pub(super) template: Template,
    pub(super) centre_px: Vector2<f64>,
    /// One bit for each frame, the newest lowest: whether the place changed in it.
    updated: u64,
    /// Frames in a row without a change.
    pub(super) missed_count: usize,
    is_confirmed: bool,
    likeness: f64,
    seen_s: f64,
    /// Times and places of the newest updates, in a ring.
    trail: [(f64, Vector2<f64>); MAX_VELOCITY_COUNT],
    trail_count: usize,
}

impl Followed {
    /// Begins where a template was found.
    pub(super) fn new(id: u64, template: Template, centre_px: Vector2<f64>, place: &Place) -> Self {
        let begin = (place.time_s, centre_px);
        Self {
            id,
            template,
            centre_px,
            updated: 0,
            missed_count: 0,
            is_confirmed: false,
            likeness: 1.0,
            seen_s: place.time_s,
            trail: [begin; MAX_VELOCITY_COUNT],
            trail_count: 1,
        }
    }

    /// Where the template lies.
    pub(super) fn ellipse(&self) -> Ellipse {
        Ellipse { centre_px: self.centre_px, half_axes_px: self.template.half_axes_px }
    }

    /// Takes where the iteration ended, if it went anywhere that is free.
    pub(super) fn take(&mut self, shifted: Option<&Shifted>, place: &Place) {
        let PaperConfig { min_move_m, confirm_count, window_count, .. } = place.config;
        let min_move_px = min_move_m / place.grid.pixel_m;
        let moved = shifted.filter(|end| min_move_px < (end.centre_px - self.centre_px).norm());
        self.updated = self.updated << 1 | u64::from(moved.is_some());
        self.likeness = shifted.map_or(0.0, |end| end.likeness.clamp(0.0, 1.0));
        match moved {
            Some(end) => {
                self.centre_px = end.centre_px;
                self.missed_count = 0;
                self.seen_s = place.time_s;
                self.trail[self.trail_count % MAX_VELOCITY_COUNT] = (place.time_s, end.centre_px);
                self.trail_count += 1;
            }
            None => self.missed_count += 1,
        }
        let window = u64::MAX >> (64 - window_count.clamp(1, 64));
        let updated_count = (self.updated & window).count_ones();
        self.is_confirmed |= confirm_count < updated_count as usize;
    }

    /// What is said of it.
    pub(super) fn seen(&self, place: &Place) -> Track {
        let place_m = place.metres(&self.centre_px);
        let (velocity, over_s) = self.velocity(place);
        let half_m = self.template.half_axes_px * place.grid.pixel_m;
        // Second moments of an ellipse that is even inside.
        let extent_m2 = [0.25 * half_m.x.powi(2), 0.0, 0.25 * half_m.y.powi(2)];
        Track {
            id: self.id,
            status: match (self.is_confirmed, self.missed_count) {
                (false, _) => TrackStatus::Tentative,
                (true, 0) => TrackStatus::Confirmed,
                (true, _) => TrackStatus::Coasting,
            },
            state: Vector4::new(place_m.x, place_m.y, velocity.x, velocity.y),
            covariance: self.covariance(&place_m, over_s, place),
            extent_m2,
            appearance: self.likeness,
            seen_s: self.seen_s,
        }
    }

    /// Metres per second, and over which time it was taken; 0 and `None` of a single place.
    fn velocity(&self, place: &Place) -> (Vector2<f64>, Option<f64>) {
        let count = place.config.velocity_count.min(self.trail_count - 1);
        let (now_s, now_px) = self.trail[(self.trail_count - 1) % MAX_VELOCITY_COUNT];
        let (then_s, then_px) = self.trail[(self.trail_count - 1 - count) % MAX_VELOCITY_COUNT];
        let over_s = now_s - then_s;
        if over_s <= 0.0 {
            return (Vector2::zeros(), None);
        }
        ((now_px - then_px) * (place.grid.pixel_m / over_s), Some(over_s))
    }

    fn covariance(
        &self,
        place_m: &Vector2<f64>,
        over_s: Option<f64>,
        place: &Place,
    ) -> Matrix4<f64> {
        let PaperConfig { range_sigma_m, bearing_sigma_rad, speed_sigma_m_per_s, .. } =
            place.config;
        let along = line_of_sight(place_m);
        let across = Vector2::new(-along.y, along.x);
        let across_m2 = (place_m.norm() * bearing_sigma_rad).max(range_sigma_m).powi(2);
        let seen_m2 = along * along.transpose() * range_sigma_m.powi(2)
            + across * across.transpose() * across_m2;
        let unseen_m = speed_sigma_m_per_s * (place.time_s - self.seen_s);
        let now_m2 = seen_m2 + Matrix2::identity() * unseen_m.powi(2);
        let unknown = Matrix2::identity() * speed_sigma_m_per_s.powi(2);
        let (cross, velocity) = match over_s {
            Some(over_s) => (seen_m2 / over_s, seen_m2 * (2.0 / over_s.powi(2))),
            None => (Matrix2::zeros(), unknown),
        };
        let mut all = Matrix4::zeros();
        all.fixed_view_mut::<2, 2>(0, 0).copy_from(&now_m2);
        all.fixed_view_mut::<2, 2>(0, 2).copy_from(&cross);
        all.fixed_view_mut::<2, 2>(2, 0).copy_from(&cross);
        all.fixed_view_mut::<2, 2>(2, 2).copy_from(&velocity);
        all
    }
}
