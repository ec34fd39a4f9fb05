//! The default tracker: points to Kalman filters, with mean shift where the image shows less than a point.
//!
//! Each frame: predict everybody (`motion`); give each at most one point, by the cheapest assignment
//! (`assign`) with the price
//! `½ (d² + ln |2π S|) + ln λ − ln (P_D / (1 − P_D))`, `λ` new points per square metre and frame; who
//! has none is looked for in the image (`look`); a point of nobody begins a track. Tracks
//! are confirmed by the sum of these log likelihood ratios, by points, and by looking like themselves;
//! they end when they were not seen for as long as suits the way they were last seen (`person`).
//! Source: \[mean-shift\] for the localiser.

use nalgebra::{Matrix2, Vector2};

use proto::measured::{MeasuredPoint, symmetric};

use super::maxima::Raster;
use super::paper::check_frame;
use super::{Frame, FrameError, Smoothed, Track, Tracker};
use crate::imaging::InvalidSetting;

pub use config::{BodyModel, DefaultConfig, Door, Gait, HALF_DEPTH_M};

use assign::Assignment;
use error::{Known, Usual};
use history::History;
use look::{Picture, Window};
use motion::Sight;
use person::Person;

pub mod assign;
mod config;
mod error;
mod history;
mod look;
mod motion;
mod person;

/// Price of what must not be.
const FORBIDDEN: f64 = 1e6;
/// Points taken of a frame, at most, strongest first.
const MAX_POINT_COUNT: usize = 64;
/// Tentative tracks do not take points from confirmed ones unless they are closer by this price.
const TENTATIVE_PRICE: f64 = 2.0;
/// A point this near to somebody who has one is theirs too, metres: the width of a person.
const BODY_M: f64 = 0.55;
/// Who was not seen for longer may turn up as somebody new, seconds.
const LOST_S: f64 = 0.25;
/// Standard deviations of a prediction that a look at the image reaches, and its bounds in range,
/// metres, and sine.
const LOOK_SIGMAS: f64 = 3.0;
const LOOK_RANGE_M: [f64; 2] = [0.25, 0.8];
const LOOK_SINE: [f64; 2] = [0.08, 0.2];

/// Follows people by points, and by the image where there are none.
#[derive(Clone, Debug)]
pub struct DefaultTracker {
    config: DefaultConfig,
    body: BodyModel,
    gaits: [Gait; 2],
    last_s: Option<f64>,
    next_id: u64,
    people: Vec<Person>,
    tracks: Vec<Track>,
    usual: Usual,
    assignment: Assignment,
    chosen: Vec<Option<usize>>,
    is_taken: Vec<bool>,
    surfaces_m: Vec<Vector2<f64>>,
    others_m: Vec<Vector2<f64>>,
    spare: Vec<History>,
}

impl DefaultTracker {
    /// Nobody is followed yet; points will be of that `body`.
    ///
    /// # Errors
    /// Names the first setting that makes no sense.
    pub fn new(config: &DefaultConfig, body: BodyModel) -> Result<Self, InvalidSetting> {
        config.check()?;
        let count = config.max_track_count;
        Ok(Self {
            config: config.clone(),
            body,
            gaits: [config.steady, config.turning],
            last_s: None,
            next_id: 1,
            people: Vec::with_capacity(count),
            tracks: Vec::with_capacity(count),
            usual: Usual::default(),
            assignment: Assignment::default(),
            chosen: Vec::with_capacity(count),
            is_taken: Vec::with_capacity(MAX_POINT_COUNT),
            surfaces_m: Vec::with_capacity(count),
            others_m: Vec::with_capacity(count),
            spare: (0..count).map(|_| History::new()).collect(),
        })
    }

    /// What `point` says of where `person` is.
    fn sight(&self, person: &Person, point: &MeasuredPoint, time_s: f64) -> Sight {
        let known = self.known(person, person.fade(point), time_s);
        error::sight(point, &known, &self.config)
    }

    /// What is known of `person` when seen with their mean power over `fade`.
    fn known(&self, person: &Person, fade: f64, time_s: f64) -> Known<'_> {
        let half_depth_m = person.half_depth_m(&self.body, &self.config);
        Known { half_depth_m, fade, since_s: time_s - person.seen_s, body: &self.body }
    }

    /// The price of giving `point` to `person`.
    fn price(&self, person: &Person, point: &MeasuredPoint, time_s: f64) -> f64 {
        let Some((distance2, volume)) = person.now.misfit(&self.sight(person, point, time_s))
        else {
            return FORBIDDEN;
        };
        let DefaultConfig { detection_probability: p, new_per_m2, gate_sigmas, .. } = self.config;
        let price = 0.5 * (distance2 + volume) + new_per_m2.ln() - (p / (1.0 - p)).ln();
        let extra = if person.is_confirmed { 0.0 } else { TENTATIVE_PRICE };
        if distance2 < gate_sigmas.powi(2) && price.is_finite() { price + extra } else { FORBIDDEN }
    }

    fn assign(&mut self, points: &[MeasuredPoint], time_s: f64) {
        let mut assignment = std::mem::take(&mut self.assignment);
        let mut chosen = std::mem::take(&mut self.chosen);
        let price =
            |row: usize, column: usize| self.price(&self.people[row], &points[column], time_s);
        assignment.solve_into([self.people.len(), points.len()], price, &mut chosen);
        (self.assignment, self.chosen) = (assignment, chosen);
        self.is_taken.clear();
        self.is_taken.resize(points.len(), false);
        for column in self.chosen.iter().flatten() {
            self.is_taken[*column] = true;
        }
    }

    /// Everybody's point, or what the image shows of them, or nothing.
    fn update(&mut self, frame: &Frame<'_>, points: &[MeasuredPoint], picture: &Picture<'_>) {
        let time_s = frame.time_s;
        self.surfaces_m.clear();
        self.surfaces_m
            .extend(self.people.iter().map(|person| person.surface_m(&self.body, &self.config)));
        for index in 0..self.people.len() {
            let Some(column) = self.chosen[index] else { continue };
            let point = &points[column];
            let sight = self.sight(&self.people[index], point, time_s);
            let gain = -self.price(&self.people[index], point, time_s)
                - (1.0 - self.config.detection_probability).ln().abs();
            let person = &mut self.people[index];
            person.see_point(time_s, (&sight, point), gain, &self.config);
            let surface_m = Vector2::new(point.x_m, point.y_m);
            person.look_at(picture, &surface_m);
            self.surfaces_m[index] = surface_m;
        }
        for index in 0..self.people.len() {
            if self.chosen[index].is_none() && !self.look(index, frame, picture) {
                self.people[index].miss(&self.config);
            }
        }
    }

    /// Looks for somebody in the image; whether they were found.
    fn look(&mut self, index: usize, frame: &Frame<'_>, picture: &Picture<'_>) -> bool {
        let person = &self.people[index];
        let Some(template) = &person.template else { return false };
        self.others_m.clear();
        let others = self.surfaces_m.iter().enumerate().filter(|(other, _)| *other != index);
        self.others_m.extend(others.map(|(_, surface_m)| *surface_m));
        let window = window(person, self.surfaces_m[index]);
        let floor =
            frame.noise_amplitude * crate::imaging::single(self.config.weak_power_ratio.sqrt());
        let found = picture.peak(&window, floor, &self.others_m);
        let Some(found) = found.and_then(|peak| picture.shifted(peak, template)) else {
            return false;
        };
        let power_ratio =
            f64::from(found.peak / frame.noise_amplitude.max(f32::MIN_POSITIVE)).powi(2);
        let known = self.known(person, 1.0, frame.time_s);
        let sight = self.usual.weak_sight(found.place_m, power_ratio, &known, &self.config);
        let Some(sight) = sight else { return false };
        let fits =
            person.now.misfit(&sight).is_some_and(|(d2, _)| d2 < self.config.gate_sigmas.powi(2));
        if !fits || found.likeness < self.config.min_appearance {
            return false;
        }
        let supported = &mut self.people[index];
        supported.resemble(found.likeness);
        supported.see_weakly(frame.time_s, &sight, &self.config);
        true
    }

    /// Whether what is at `surface_m` is a limb or a sidelobe of `person`, who is seen: one more
    /// person cannot come out of a blob that does not part.
    fn is_part_of(&self, person: &Person, surface_m: &Vector2<f64>, frame: &Frame<'_>) -> bool {
        let is_seen = person.is_confirmed && frame.time_s - person.seen_s < LOST_S;
        let off_m = surface_m - person.surface_m(&self.body, &self.config);
        let pixel_m2 = Matrix2::identity() * frame.grid.pixel_m.powi(2);
        let distance2 = (symmetric(person.extent_m2) + pixel_m2)
            .try_inverse()
            .map_or(f64::INFINITY, |inverse| off_m.dot(&(inverse * off_m)));
        is_seen && distance2 < self.config.body_sigmas.powi(2)
    }

    /// Points of nobody begin tracks.
    fn begin(&mut self, frame: &Frame<'_>, points: &[MeasuredPoint], picture: &Picture<'_>) {
        for (point, is_taken) in points.iter().zip(&self.is_taken) {
            if *is_taken || self.config.max_track_count <= self.people.len() {
                continue;
            }
            let known = Known {
                half_depth_m: self.body.half_depth_m,
                fade: 1.0,
                since_s: self.config.glint_s,
                body: &self.body,
            };
            let sight = error::sight(point, &known, &self.config);
            let place_m = Vector2::new(point.x_m, point.y_m);
            let is_theirs = |person: &Person| {
                let near = (person.now.place_m() - sight.place_m).norm() < BODY_M;
                (near && frame.time_s <= person.seen_s) || self.is_part_of(person, &place_m, frame)
            };
            if self.people.iter().any(is_theirs) {
                continue;
            }
            let history = self.spare.pop().unwrap_or_else(History::new);
            let mut person = Person::new(self.next_id, frame.time_s, &sight, point, history);
            person.begin(&frame.grid, &self.config);
            person.look_at(picture, &place_m);
            self.next_id += 1;
            self.people.push(person);
        }
    }

    /// Lets go of who is not there any more.
    fn end(&mut self, frame: &Frame<'_>) {
        let mut index = 0;
        while index < self.people.len() {
            if self.people[index].is_there(frame.time_s, &frame.grid, &self.config) {
                index += 1;
            } else {
                self.spare.push(self.people.remove(index).into_history());
            }
        }
    }

    /// Gives those who turned up just now the ids of whom they are: somebody lost who could have
    /// walked there. The nearer one if there are two.
    fn relink(&mut self, time_s: f64, index: usize) {
        let (newcomer, config) = (&self.people[index], &self.config);
        let reach = |lost: &Person| {
            let gap_s = time_s - lost.seen_s;
            let way_m = (newcomer.now.place_m() - lost.seen_m).norm();
            let is_lost = lost.is_confirmed && LOST_S < gap_s && lost.seen_s <= newcomer.began_s;
            let share = way_m / (config.relink_m + config.relink_m_per_s * gap_s);
            (is_lost && share < 1.0).then_some(share)
        };
        let rated =
            self.people.iter().enumerate().filter_map(|(at, lost)| Some((at, reach(lost)?)));
        let nearest = rated.min_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((lost, _)) = nearest.filter(|(at, _)| *at != index) {
            self.people[index].id = self.people[lost].id;
            self.people[index].has_walked |= self.people[lost].has_walked;
            self.spare.push(self.people.remove(lost).into_history());
        }
    }

    /// Keeps the states of this frame, and says who is a person by now.
    fn settle(&mut self, time_s: f64) {
        let mut index = 0;
        while index < self.people.len() {
            let person_count = self.people.len();
            if self.people[index].settle(&self.config) {
                self.relink(time_s, index);
            }
            // One who was lost before it is gone: everybody moved up, and all before have settled.
            index += 1 - (person_count - self.people.len());
        }
        self.people.sort_unstable_by_key(|person| person.id);
    }

    fn tell(&mut self, time_s: f64) {
        self.tracks.clear();
        self.tracks.extend(self.people.iter().map(|person| person.track(time_s, &self.config)));
    }
}

impl Tracker for DefaultTracker {
    fn track(&mut self, frame: &Frame<'_>) -> Result<&[Track], FrameError> {
        check_frame(frame, self.last_s.unwrap_or(f64::NEG_INFINITY))?;
        check_points(frame)?;
        let time_s = frame.time_s;
        let points = &frame.points[..frame.points.len().min(MAX_POINT_COUNT)];
        let raster = Raster {
            amplitude: frame.amplitude,
            column_count: frame.grid.column_count,
            row_count: frame.grid.row_count,
        };
        let picture = Picture { raster, grid: frame.grid };
        let dt_s = self.last_s.map_or(0.0, |last_s| time_s - last_s);
        self.last_s = Some(time_s);
        for person in &mut self.people {
            person.predict(time_s, dt_s, &self.gaits);
        }
        points.iter().for_each(|point| self.usual.learn(point));
        self.assign(points, time_s);
        self.update(frame, points, &picture);
        self.begin(frame, points, &picture);
        self.settle(time_s);
        self.end(frame);
        self.tell(time_s);
        Ok(&self.tracks)
    }

    /// `smoothing_lag_s` ago.
    fn smoothed(&self) -> Vec<Smoothed> {
        let of_person = |person: &Person| {
            let (time_s, state) = person.smoothed(&self.config)?;
            Some(Smoothed { id: person.id, time_s, state: state.mean, covariance: state.cov })
        };
        self.people.iter().filter_map(of_person).collect()
    }
}

/// Where the image is searched for somebody whose near side is expected at `surface_m`.
fn window(person: &Person, surface_m: Vector2<f64>) -> Window {
    let range_m = surface_m.norm().max(0.1);
    let out = surface_m / range_m;
    let aside = Vector2::new(out.y, -out.x);
    let cov_m2 = person.now.place_cov_m2();
    let sigma_m = |axis: &Vector2<f64>| LOOK_SIGMAS * axis.dot(&(cov_m2 * axis)).max(0.0).sqrt();
    Window {
        middle_m: surface_m,
        range_m: sigma_m(&out).clamp(LOOK_RANGE_M[0], LOOK_RANGE_M[1]),
        sine: (sigma_m(&aside) / range_m).clamp(LOOK_SINE[0], LOOK_SINE[1]),
    }
}

/// What must be so besides what [`check_frame`] asks for: all numbers of a point are some, and its
/// covariance is one.
fn check_points(frame: &Frame<'_>) -> Result<(), FrameError> {
    let is_good = |point: &MeasuredPoint| {
        let MeasuredPoint { x_m, y_m, cov_m2, snr_db, extent_m2, .. } = point;
        let numbers = [x_m, y_m, snr_db].into_iter().chain(cov_m2).chain(extent_m2);
        numbers.into_iter().all(|value| value.is_finite())
            && point.position().cov_m2.cholesky().is_some()
    };
    let (time_s, what) = (frame.time_s, "a point");
    let are_good = frame.points.iter().all(is_good);
    if are_good { Ok(()) } else { Err(FrameError::NotFinite { time_s, what }) }
}

#[cfg(test)]
mod kernels;
#[cfg(test)]
mod study;
#[cfg(test)]
mod tests;
