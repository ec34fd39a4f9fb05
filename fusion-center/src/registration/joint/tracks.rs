//! Tracks: the points of both sides, in one frame, that one moving target explains.
//!
//! Scan after scan, every open track predicts where its target is (see `filter`) and takes the point
//! that fits it best, established tracks first; what is left starts new tracks. A point counts
//! `ln N(ν; 0, F) − ln λ` for its track, `λ` the points per m² and scan: the logarithm of its odds
//! against a point that has nothing to do with the target. The pose under which the sides are put
//! together is uncertain by `C`, so that points of the node get the covariance `J C Jᵀ` on top.
//!
//! A point that a straight walk excludes may still belong to a target that turned: then the velocity
//! has jumped by `N(0, J²)` at some time since the last point, which over `τ` seconds is acceleration
//! noise of `J²/τ`, at the price of the rarity of turns. The track notes where.
//!
//! Cost: points of a scan times open tracks.

use nalgebra::{Matrix2, Matrix3, Vector2};
use proto::geom::point_by_pose;

use super::super::prepared::Motion;
use super::filter::{Observation, State};
use super::scans::{Scan, Scans, Seen, Side};

/// Standard deviation per axis of a target's velocity before two points are known, m/s: a person
/// who runs at 4 m/s is within three of them.
pub(super) const VELOCITY_SIGMA_MPS: f64 = 1.5;

/// Acceleration noise that a track may show while it is formed, m²/s³: a person who turns gently is
/// followed, one who turns at a corner is not. The fit decides how straight a track really is.
const FORMING_NOISE_M2PS3: f64 = 0.02;

/// J, m/s per axis, and the price of a turn: one point in 20.
const TURN_SIGMA_MPS: f64 = 1.0;
const LOG_TURN_CHANCE: f64 = -3.0;

/// Squared Mahalanobis distance within which a point may continue a track: 99.97 %.
const GATE: f64 = 16.0;

/// Margin for rounding where a bound of that distance excludes a point.
const ROUNDING: f64 = 1.0 + 1e-9;

/// Periods that a track may pause; one that has just begun has proven less.
const MAX_PAUSE: usize = 4;
const FIRST_PAUSE: usize = 2;

/// Periods with points from which on a track is established.
const ESTABLISHED_COUNT: usize = 3;

/// Smallest score of a track: odds of 400 against points that meet by chance.
const MIN_TRACK_SCORE: f64 = 6.0;

/// Smallest score of a pair or of points of two periods: odds of 10, as they prove little anyway.
const MIN_PAIR_SCORE: f64 = 2.3;

/// A point of a track.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Member {
    pub(super) point: usize,
    /// How the target came from the point before.
    pub(super) way: Way,
}

/// How a target came from one point to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Way {
    Straight,
    Turned,
}

impl Way {
    /// Acceleration noise on this way of `step_s` seconds, m²/s³, in a track that otherwise has
    /// `noise_m2ps3`.
    pub(super) fn noise(self, step_s: f64, noise_m2ps3: f64) -> f64 {
        match self {
            Self::Turned if step_s > 0.0 => noise_m2ps3.max(TURN_SIGMA_MPS.powi(2) / step_s),
            Self::Turned | Self::Straight => noise_m2ps3,
        }
    }
}

/// A target's points.
#[derive(Clone, Debug)]
pub(super) struct Track {
    /// Its points in order of time.
    pub(super) members: Vec<Member>,
    /// Whether its motion is known: points of at least three periods that fit one.
    pub(super) is_established: bool,
}

/// Under which pose, and how sure of it, tracks are formed.
#[derive(Clone)]
pub(super) struct Ground {
    pub(super) motion: Motion,
    pub(super) pose_covariance: Matrix3<f64>,
    pub(super) covariance_scale: f64,
    /// Natural logarithm of λ.
    pub(super) log_density: f64,
}

impl Ground {
    /// The point with all that is uncertain about it.
    fn observed(&self, point: &Seen) -> Observation<1> {
        let mut seen = point.observed::<1>(&self.motion, &[0.0; 4], self.covariance_scale);
        seen.cov_m2 += point.offset_cov_m2(&self.motion);
        if point.side == Side::Node {
            let (x, y) = (seen.columns[0].x - self.motion.x, seen.columns[0].y - self.motion.y);
            let jacobian = point_by_pose(&Vector2::new(x, y));
            let added: Matrix2<f64> = jacobian * self.pose_covariance * jacobian.transpose();
            seen.cov_m2 += added;
        }
        seen
    }
}

/// A track that is being formed.
struct Draft {
    /// At the time of the last point.
    state: State<1>,
    /// At the time of the scan.
    straight: State<1>,
    last_point: usize,
    last_period: usize,
    period_count: usize,
    sides: [bool; 2],
    score: f64,
}

impl Draft {
    fn is_established(&self) -> bool {
        self.period_count >= ESTABLISHED_COUNT
    }

    /// What a turn adds to the variance of the position at the time of a scan, per axis, m².
    fn turn_variance_m2(&self, time_s: f64) -> f64 {
        let step_s = (time_s - self.state.time_s()).max(0.0);
        let noise_m2ps3 = Way::Turned.noise(step_s, FORMING_NOISE_M2PS3) - FORMING_NOISE_M2PS3;
        noise_m2ps3 * step_s.powi(3) / 3.0
    }

    /// The state at the time of a scan if the target has turned since the last point.
    fn after_turn(&self, time_s: f64) -> State<1> {
        let mut state = self.state;
        let step_s = time_s - state.time_s();
        state.predict(time_s, Way::Turned.noise(step_s, FORMING_NOISE_M2PS3));
        state
    }

    /// What a point of the scan adds to the score, and how the target came there; `None` where it
    /// does not belong. The turned state is made once, for the first point that asks for it.
    fn fits(
        &self,
        (scan, log_density): (&Scan, f64),
    ) -> impl FnMut(&Observation<1>) -> Option<(f64, Way)> {
        let may_turn = self.is_established() && self.state.time_s() < scan.time_s;
        let added_m2 = if may_turn { self.turn_variance_m2(scan.time_s) } else { 0.0 };
        let mut turned = None;
        move |point| {
            if self.straight.is_beyond(point, (GATE * ROUNDING, added_m2)) {
                return None;
            }
            gain(self, point, (scan, log_density)).or_else(|| {
                let after = || self.after_turn(scan.time_s);
                let state = may_turn.then(|| turned.get_or_insert_with(after))?;
                gain_of_turn(state, point, log_density)
            })
        }
    }

    fn is_alive(&self, period_index: usize) -> bool {
        let pause = if self.is_established() { MAX_PAUSE } else { FIRST_PAUSE };
        period_index.saturating_sub(self.last_period) <= pause
    }

    fn is_worth_keeping(&self) -> bool {
        let needed = if self.is_established() { MIN_TRACK_SCORE } else { MIN_PAIR_SCORE };
        self.sides == [true; 2] && self.score >= needed
    }
}

/// A point that may continue an open track.
struct Candidate {
    open_index: usize,
    point: usize,
    is_established: bool,
    way: Way,
    gain: f64,
}

/// Tracks in the making.
struct Forming<'a> {
    scans: &'a Scans,
    ground: &'a Ground,
    open: Vec<Draft>,
    done: Vec<Draft>,
    /// The point before, in the same track.
    predecessors: Vec<Option<usize>>,
    ways: Vec<Way>,
    is_taken: Vec<bool>,
}

/// The tracks with points of both sides.
pub(super) fn form_tracks(scans: &Scans, ground: &Ground) -> Vec<Track> {
    let point_count = scans.points.len();
    let mut forming = Forming {
        scans,
        ground,
        open: Vec::with_capacity(16),
        done: Vec::with_capacity(16),
        predecessors: vec![None; point_count],
        ways: vec![Way::Straight; point_count],
        is_taken: vec![false; point_count],
    };
    let (mut candidates, mut seen) = (Vec::with_capacity(32), Vec::with_capacity(16));
    for scan in &scans.scans {
        forming.take(scan, &mut candidates, &mut seen);
    }
    let last = std::mem::take(&mut forming.open);
    forming.done.extend(last.into_iter().filter(Draft::is_worth_keeping));
    forming.done.iter().map(|draft| forming.track_of(draft)).collect()
}

impl Forming<'_> {
    fn track_of(&self, draft: &Draft) -> Track {
        let before = |index: &usize| self.predecessors[*index];
        let member = |point: usize| Member { point, way: self.ways[point] };
        let mut members: Vec<Member> =
            std::iter::successors(Some(draft.last_point), before).map(member).collect();
        members.reverse();
        Track { members, is_established: draft.is_established() }
    }

    fn take(
        &mut self,
        scan: &Scan,
        candidates: &mut Vec<Candidate>,
        seen: &mut Vec<Observation<1>>,
    ) {
        self.close(scan.period_index);
        candidates.clear();
        seen.clear();
        let points = &self.scans.points[scan.points.clone()];
        seen.extend(points.iter().map(|point| self.ground.observed(point)));
        for (open_index, draft) in self.open.iter_mut().enumerate() {
            draft.straight = draft.state;
            draft.straight.predict(scan.time_s, FORMING_NOISE_M2PS3);
            let fits = draft.fits((scan, self.ground.log_density));
            let is_established = draft.is_established();
            let gains = scan.points.clone().zip(seen.iter().map(fits));
            let fitting = gains.filter_map(|(point, fit)| {
                let (gain, way) = fit?;
                Some(Candidate { open_index, point, is_established, way, gain })
            });
            candidates.extend(fitting);
        }
        candidates.sort_by(|a, b| {
            b.is_established.cmp(&a.is_established).then(b.gain.total_cmp(&a.gain))
        });
        for candidate in candidates.iter() {
            self.continue_track(candidate, scan, &seen[candidate.point - scan.points.start]);
        }
        for (index, first) in seen.iter().enumerate() {
            self.start_track(scan.points.start + index, scan, first);
        }
    }

    /// Puts aside what has paused too long.
    fn close(&mut self, period_index: usize) {
        let mut index = 0;
        while index < self.open.len() {
            if self.open[index].is_alive(period_index) {
                index += 1;
                continue;
            }
            let draft = self.open.swap_remove(index);
            if draft.is_worth_keeping() {
                self.done.push(draft);
            }
        }
    }

    fn continue_track(&mut self, candidate: &Candidate, scan: &Scan, point: &Observation<1>) {
        let draft = &mut self.open[candidate.open_index];
        let is_free = !self.is_taken[candidate.point] && draft.last_point < scan.points.start;
        if !is_free {
            return;
        }
        self.is_taken[candidate.point] = true;
        self.predecessors[candidate.point] = Some(draft.last_point);
        self.ways[candidate.point] = candidate.way;
        let mut state = match candidate.way {
            Way::Straight => draft.straight,
            Way::Turned => draft.after_turn(scan.time_s),
        };
        let innovation = state.innovation(point);
        state.absorb(&innovation);
        draft.state = state;
        draft.last_point = candidate.point;
        draft.period_count += usize::from(draft.last_period != scan.period_index);
        draft.last_period = scan.period_index;
        draft.sides[self.scans.points[candidate.point].side as usize] = true;
        draft.score += candidate.gain;
    }

    fn start_track(&mut self, point: usize, scan: &Scan, first: &Observation<1>) {
        if self.is_taken[point] {
            return;
        }
        let mut sides = [false; 2];
        sides[self.scans.points[point].side as usize] = true;
        let state = State::starting(first, VELOCITY_SIGMA_MPS);
        self.open.push(Draft {
            state,
            straight: state,
            last_point: point,
            last_period: scan.period_index,
            period_count: 1,
            sides,
            score: 0.0,
        });
    }
}

/// What the point adds to the score of a target that went straight; `None` where it does not belong.
/// The second period of a track tells its velocity and need not speak for it.
fn gain(
    draft: &Draft,
    point: &Observation<1>,
    (scan, log_density): (&Scan, f64),
) -> Option<(f64, Way)> {
    let innovation = draft.straight.innovation(point);
    if innovation.chi_square >= GATE {
        return None;
    }
    let gain = innovation.log_density() - log_density;
    let tells_velocity = draft.period_count == 1 && draft.last_period != scan.period_index;
    (gain > 0.0 || tells_velocity).then_some((gain, Way::Straight))
}

/// The same for one whose state `after_turn` holds if it has turned.
fn gain_of_turn(
    after_turn: &State<1>,
    point: &Observation<1>,
    log_density: f64,
) -> Option<(f64, Way)> {
    let innovation = after_turn.innovation(point);
    if innovation.chi_square >= GATE {
        return None;
    }
    let gain = innovation.log_density() - log_density + LOG_TURN_CHANCE;
    (gain > 0.0).then_some((gain, Way::Turned))
}
