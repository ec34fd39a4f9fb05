//! One who is followed: what is known of them, and when that is enough or no more.

use nalgebra::Vector2;

use proto::measured::{MeasuredPoint, line_of_sight};
use proto::radar::Grid;

use super::super::shift::Template;
use super::super::{Track, TrackStatus};
use super::config::{BodyModel, DefaultConfig, Gait};
use super::error::{half_depth_m, lasting_m2};
use super::history::{History, Record};
use super::look::Picture;
use super::motion::{Estimate, Motion, Sight};
use crate::imaging::from_db;

/// Speed of somebody who turns up, standard deviation per axis, metres per second.
const START_SPEED_M_PER_S: f64 = 0.8;
/// Share of a new extent or likeness in the mean.
const BLEND: f64 = 0.2;
/// Share of a new point's power in the mean, after the first ones: of 17 frames, or four independent
/// fades of one who walks.
const POWER_BLEND: f64 = 0.06;
/// Whoever came this far has walked, metres: farther than a shadow's points wander.
const WALKED_M: f64 = 0.8;
/// Largest change of the score by one frame without a point.
const WEAK_SCORE: f64 = 1.0;
/// A score does not grow beyond this: one who was seen for hours is not believed in for hours.
const MAX_SCORE: f64 = 40.0;

/// Somebody.
#[derive(Clone, Debug)]
pub(super) struct Person {
    pub(super) id: u64,
    pub(super) motion: Motion,
    /// `motion` whatever the way of moving.
    pub(super) now: Estimate,
    predicted: Record,
    pub(super) extent_m2: [f64; 3],
    pub(super) template: Option<Template>,
    appearance: f64,
    pub(super) began_s: f64,
    began_m: Vector2<f64>,
    /// Whether they ever left the place where they turned up: shadows do not.
    pub(super) has_walked: bool,
    /// When last seen.
    pub(super) seen_s: f64,
    /// Where.
    pub(super) seen_m: Vector2<f64>,
    point_count: u32,
    mean_power: f64,
    score: f64,
    needed_score: f64,
    pub(super) is_confirmed: bool,
    stands: bool,
    history: History,
}

impl Person {
    /// Somebody seen for the first time.
    pub(super) fn new(
        id: u64,
        time_s: f64,
        sight: &Sight,
        point: &MeasuredPoint,
        mut history: History,
    ) -> Self {
        history.clear();
        let motion = Motion::new(sight, START_SPEED_M_PER_S);
        let now = motion.merged();
        let predicted = Record { time_s, predicted: now, cross: now.cov, filtered: now };
        Self {
            id,
            motion,
            now,
            predicted,
            extent_m2: point.extent_m2,
            template: None,
            appearance: 1.0,
            began_s: time_s,
            began_m: sight.place_m,
            has_walked: false,
            seen_s: time_s,
            seen_m: sight.place_m,
            point_count: 1,
            mean_power: from_db(point.snr_db),
            score: 0.0,
            needed_score: f64::INFINITY,
            is_confirmed: false,
            stands: false,
            history,
        }
    }

    /// Says how sure one must be of somebody who began here.
    pub(super) fn begin(&mut self, grid: &Grid, config: &DefaultConfig) {
        let is_entry = is_at_door(&self.now.place_m(), config)
            || inside_m(&self.now.place_m(), grid) < config.border_m;
        self.needed_score =
            if is_entry { config.confirm_score_at_doors } else { config.confirm_score };
    }

    pub(super) fn into_history(self) -> History {
        self.history
    }

    /// Where the near side is.
    pub(super) fn surface_m(&self, body: &BodyModel, config: &DefaultConfig) -> Vector2<f64> {
        let place_m = self.now.place_m();
        place_m - line_of_sight(&place_m) * self.half_depth_m(body, config)
    }

    /// How far their near side is before their middle, metres.
    pub(super) fn half_depth_m(&self, body: &BodyModel, config: &DefaultConfig) -> f64 {
        half_depth_m(&self.now.place_m(), &self.now.velocity(), body, config)
    }

    /// Goes on to `time_s`. Who stands and is not seen is held where they are: they breathe too
    /// little to be seen, and did not leave.
    pub(super) fn predict(&mut self, time_s: f64, dt_s: f64, gaits: &[Gait; 2]) {
        let is_held = self.stands && self.predicted.time_s - self.seen_s > HOLD_AFTER_S;
        let cross = if is_held {
            self.motion.stand();
            self.now.cov
        } else {
            self.motion.predict(dt_s, gaits)
        };
        self.now = self.motion.merged();
        self.predicted = Record { time_s, predicted: self.now, cross, filtered: self.now };
    }

    /// Mean power of their points over that of `point`.
    pub(super) fn fade(&self, point: &MeasuredPoint) -> f64 {
        self.mean_power / from_db(point.snr_db).max(f64::MIN_POSITIVE)
    }

    /// Takes a sight of them in.
    fn see(&mut self, time_s: f64, sight: &Sight, config: &DefaultConfig) {
        self.motion.update(sight);
        self.now = self.motion.merged();
        self.seen_s = time_s;
        self.seen_m = self.now.place_m();
        self.has_walked |= WALKED_M < (self.seen_m - self.began_m).norm();
        self.stands = self.now.velocity().norm() < config.standing_m_per_s;
    }

    /// Takes the point that is theirs in; `gain` is what it says for there being somebody.
    pub(super) fn see_point(
        &mut self,
        time_s: f64,
        (sight, point): (&Sight, &MeasuredPoint),
        gain: f64,
        config: &DefaultConfig,
    ) {
        self.see(time_s, sight, config);
        self.point_count = self.point_count.saturating_add(1);
        let share = (1.0 / f64::from(self.point_count)).max(POWER_BLEND);
        self.mean_power += share * (from_db(point.snr_db) - self.mean_power);
        self.score = (self.score + gain).min(MAX_SCORE);
        for (own, seen) in self.extent_m2.iter_mut().zip(point.extent_m2) {
            *own += BLEND * (seen - *own);
        }
    }

    /// Takes in what the image shows of them without a point.
    pub(super) fn see_weakly(&mut self, time_s: f64, sight: &Sight, config: &DefaultConfig) {
        self.see(time_s, sight, config);
        self.score = (self.score + WEAK_SCORE).min(MAX_SCORE);
    }

    pub(super) fn miss(&mut self, config: &DefaultConfig) {
        self.score += (1.0 - config.detection_probability).ln();
    }

    /// Compares what is at `place_m` with the template, and keeps the new one.
    pub(super) fn look_at(&mut self, picture: &Picture<'_>, place_m: &Vector2<f64>) {
        let Some(newest) = picture.template(place_m, &self.extent_m2) else { return };
        if let Some(known) = &self.template {
            self.resemble(newest.histogram.likeness(&known.histogram));
        }
        self.template = Some(newest);
    }

    pub(super) fn resemble(&mut self, likeness: f64) {
        self.appearance += BLEND * (likeness - self.appearance);
    }

    /// Ends the frame: keeps the state; whether they have been seen enough since just now.
    pub(super) fn settle(&mut self, config: &DefaultConfig) -> bool {
        self.history.push(Record { filtered: self.now, ..self.predicted }, config.smoothing_lag_s);
        let was_confirmed = self.is_confirmed;
        self.is_confirmed |= self.needed_score <= self.score
            && config.confirm_point_count <= self.point_count
            && config.min_appearance <= self.appearance;
        self.is_confirmed && !was_confirmed
    }

    /// Whether they are to be followed on.
    pub(super) fn is_there(&self, time_s: f64, grid: &Grid, config: &DefaultConfig) -> bool {
        let place_m = self.now.place_m();
        let is_leaving = inside_m(&place_m, grid) < 0.0 || is_at_door(&place_m, config);
        let limit_s = match (self.is_confirmed, is_leaving, self.stands) {
            (false, ..) => config.tentative_coast_s,
            (true, true, _) => config.exit_coast_s,
            (true, false, true) if self.has_walked => config.standing_coast_s,
            (true, false, true) => config.still_coast_s,
            (true, false, false) => config.walking_coast_s,
        };
        let is_finite = self.now.mean.iter().chain(self.now.cov.iter()).all(|v| v.is_finite());
        is_finite && time_s - self.seen_s <= limit_s
    }

    /// What is said of them.
    pub(super) fn track(&self, time_s: f64, config: &DefaultConfig) -> Track {
        let status = match (self.is_confirmed, self.seen_s < time_s) {
            (false, _) => TrackStatus::Tentative,
            (true, false) => TrackStatus::Confirmed,
            (true, true) => TrackStatus::Coasting,
        };
        let told = said(&self.now, config);
        Track {
            id: self.id,
            status,
            state: told.mean,
            covariance: told.cov,
            extent_m2: self.extent_m2,
            appearance: self.appearance.clamp(0.0, 1.0),
            seen_s: self.seen_s,
        }
    }

    /// When, and where they were then.
    pub(super) fn smoothed(&self, config: &DefaultConfig) -> Option<(f64, Estimate)> {
        self.history.smoothed().map(|(time_s, state)| (time_s, said(&state, config)))
    }
}

/// Who stood is held where they are after so long without a sight, seconds.
const HOLD_AFTER_S: f64 = 0.2;

/// The state with the error that lasts.
fn said(state: &Estimate, config: &DefaultConfig) -> Estimate {
    let mut told = *state;
    let mut place = told.cov.fixed_view_mut::<2, 2>(0, 0);
    place += lasting_m2(&state.place_m(), config);
    told
}

/// How far inside the image a place is, metres; negative outside.
fn inside_m(place_m: &Vector2<f64>, grid: &Grid) -> f64 {
    let x_max_m = grid.x_m(grid.column_count.saturating_sub(1));
    let y_max_m = grid.y_m(grid.row_count.saturating_sub(1));
    let left = (place_m.x - grid.x_min_m).min(x_max_m - place_m.x);
    left.min((place_m.y - grid.y_min_m).min(y_max_m - place_m.y))
}

fn is_at_door(place_m: &Vector2<f64>, config: &DefaultConfig) -> bool {
    let is_near =
        |x_m: f64, y_m: f64, radius_m: f64| (place_m - Vector2::new(x_m, y_m)).norm() < radius_m;
    config.doors.iter().any(|door| is_near(door.x_m, door.y_m, door.radius_m))
}
