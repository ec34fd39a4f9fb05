//! Runs: points of one side that tell the same thing, because a target stood or walked on.
//!
//! What a side sees from period to period is not new each time. A target that stands still is one
//! place; one that walks straight at constant speed is two, because the rest follows. So every side
//! is cut, by itself, into *stretches*: points, at most some periods apart, that one line
//! `x(t) = x̄ + v (t − t̄)` explains,
//! `dᵀ R⁻¹ d ≤ g (1 + 1/n + (t − t̄)² / Σ (t_i − t̄)²)` with the least-squares line through the `n`
//! points before. A stretch that does not leave its place is one run, and so are all stretches at
//! that place, however much later; one that moves is two runs, its first and its second half.
//! A place that is only passed again later is a new run.
//!
//! Assumes periods of equal length. Cost: points of one period times open stretches.

use std::ops::Range;

use super::prepared::{Blob, Span};

/// 99.7 % of the squared distances of a point from its prediction in the plane.
const GATE: f64 = 11.8;

/// Periods that a stretch may pause.
const MAX_PAUSE: f64 = 8.0;

/// Longest step, metres, between the first two points of a stretch, and its longest pause: half a
/// second of brisk walking.
const FIRST_STEP_M: f64 = 0.9;
const FIRST_PAUSE: f64 = 2.0;

/// Points from which on a stretch is a target's and no accident, and the share of the periods
/// between its first and its last in which a walk has one.
const TRACKED_COUNT: usize = 4;
const FILLED_SHARE: f64 = 0.5;

/// What a run is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RunKind {
    /// A point that follows from no other.
    Single,
    /// Points that do not leave their place.
    Place,
    /// Half of a straight walk.
    Walk,
}

/// Whether a run is one of a track's, as targets make them, or a single point, as most false ones
/// are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RunClass {
    Single,
    Tracked,
}

/// The runs of one side.
pub(super) struct Runs {
    /// The run of each point.
    pub(super) of_point: Vec<usize>,
    /// Points of each run.
    pub(super) sizes: Vec<f64>,
    /// What each run is.
    pub(super) kinds: Vec<RunKind>,
}

impl Runs {
    /// The runs of one side's points; `points_of` gives a span's range of them. Stretches shorter
    /// than `place_distance_m` do not leave their place.
    pub(super) fn new(
        blobs: &[Blob],
        spans: &[Span],
        points_of: impl Fn(&Span) -> Range<usize>,
        place_distance_m: f64,
    ) -> Self {
        let mut all = Stretches::of(blobs.len());
        for span in spans {
            all.extend(blobs, points_of(span), span.period_index as f64);
        }
        Self::of_stretches(&all.with_members(), blobs.len(), place_distance_m)
    }

    fn of_stretches(
        stretches: &[(Stretch, &[usize])],
        point_count: usize,
        place_distance_m: f64,
    ) -> Self {
        let mut runs =
            Self { of_point: vec![0; point_count], sizes: Vec::new(), kinds: Vec::new() };
        let mut places: Vec<(f64, f64, usize)> = Vec::new();
        let is_place = |s: &Stretch| s.count >= TRACKED_COUNT && s.travelled_m() < place_distance_m;
        for (stretch, members) in stretches.iter().filter(|(stretch, _)| is_place(stretch)) {
            let run = run_at(&places, stretch, place_distance_m).unwrap_or_else(|| {
                places.push((stretch.mean_x, stretch.mean_y, runs.sizes.len()));
                runs.open(RunKind::Place)
            });
            runs.put(run, members);
        }
        for (stretch, members) in stretches.iter().filter(|(stretch, _)| !is_place(stretch)) {
            if stretch.is_walk() {
                let (first, second) = members.split_at(members.len() / 2);
                runs.put_new(RunKind::Walk, first);
                runs.put_new(RunKind::Walk, second);
            } else if let Some(run) = run_at(&places, stretch, place_distance_m) {
                runs.put(run, members);
            } else {
                members.iter().for_each(|one| runs.put_new(RunKind::Single, &[*one]));
            }
        }
        runs
    }

    pub(super) fn class(&self, run: usize) -> RunClass {
        match self.kinds[run] {
            RunKind::Single => RunClass::Single,
            RunKind::Place | RunKind::Walk => RunClass::Tracked,
        }
    }

    /// How many runs are of a class, and how many points they have.
    pub(super) fn run_and_point_count(&self, class: RunClass) -> (f64, f64) {
        let of_class = (0..self.sizes.len()).filter(|run| self.class(*run) == class);
        of_class.fold((0.0, 0.0), |(runs, points), run| (runs + 1.0, points + self.sizes[run]))
    }

    fn open(&mut self, kind: RunKind) -> usize {
        self.sizes.push(0.0);
        self.kinds.push(kind);
        self.sizes.len() - 1
    }

    fn put_new(&mut self, kind: RunKind, members: &[usize]) {
        let run = self.open(kind);
        self.put(run, members);
    }

    fn put(&mut self, run: usize, members: &[usize]) {
        for member in members {
            self.of_point[*member] = run;
            self.sizes[run] += 1.0;
        }
    }
}

fn run_at(places: &[(f64, f64, usize)], of: &Stretch, reach_m: f64) -> Option<usize> {
    let is_near = |(x, y, _): &&(f64, f64, usize)| {
        let (dx, dy) = (of.mean_x - x, of.mean_y - y);
        dx * dx + dy * dy < reach_m * reach_m
    };
    places.iter().find(is_near).map(|(_, _, run)| *run)
}

/// Points on one line in time, with the running least-squares fit.
#[derive(Clone, Copy)]
struct Stretch {
    count: usize,
    first: f64,
    last: f64,
    mean_t: f64,
    mean_x: f64,
    mean_y: f64,
    /// `Σ (t − t̄)²` and `Σ (t − t̄)(x − x̄)`, `Σ (t − t̄)(y − ȳ)`.
    tt: f64,
    tx: f64,
    ty: f64,
}

impl Stretch {
    fn new(blob: &Blob, at: f64) -> Self {
        Self {
            count: 1,
            first: at,
            last: at,
            mean_t: at,
            mean_x: blob.x,
            mean_y: blob.y,
            tt: 0.0,
            tx: 0.0,
            ty: 0.0,
        }
    }

    fn add(&mut self, blob: &Blob, at: f64) {
        self.count += 1;
        self.last = at;
        let count = self.count as f64;
        let (dt, dx, dy) = (at - self.mean_t, blob.x - self.mean_x, blob.y - self.mean_y);
        self.mean_t += dt / count;
        self.mean_x += dx / count;
        self.mean_y += dy / count;
        let rest = dt * (1.0 - 1.0 / count);
        self.tt += rest * dt;
        self.tx += rest * dx;
        self.ty += rest * dy;
    }

    fn velocity(&self) -> (f64, f64) {
        if self.tt > 0.0 { (self.tx / self.tt, self.ty / self.tt) } else { (0.0, 0.0) }
    }

    /// Whether there are enough points, and close enough in time, to be one target's.
    fn is_walk(&self) -> bool {
        self.count >= TRACKED_COUNT
            && self.count as f64 >= FILLED_SHARE * (self.last - self.first + 1.0)
    }

    fn travelled_m(&self) -> f64 {
        let (vx, vy) = self.velocity();
        (vx * vx + vy * vy).sqrt() * (self.last - self.first)
    }

    fn predict(&self, at: f64) -> Prediction {
        let ahead = at - self.mean_t;
        let (vx, vy) = self.velocity();
        let lever = if self.tt > 0.0 { ahead * ahead / self.tt } else { 0.0 };
        let may_start = self.count == 1 && at - self.last <= FIRST_PAUSE;
        Prediction {
            x: self.mean_x + vx * ahead,
            y: self.mean_y + vy * ahead,
            gate: GATE * (1.0 + 1.0 / self.count as f64 + lever),
            first_step_m: if may_start { FIRST_STEP_M } else { 0.0 },
        }
    }
}

/// Where a stretch leads.
struct Prediction {
    x: f64,
    y: f64,
    /// Largest squared Mahalanobis distance of a point that belongs.
    gate: f64,
    /// How far a point may be that would be the second.
    first_step_m: f64,
}

impl Prediction {
    /// How badly the point fits, smaller is better; `None` where it does not belong.
    fn misfit(&self, blob: &Blob) -> Option<f64> {
        let (dx, dy) = (blob.x - self.x, blob.y - self.y);
        let square_m2 = dx * dx + dy * dy;
        let start_m2 = self.first_step_m * self.first_step_m;
        // The largest variance is below the trace.
        if square_m2 > (self.gate * (blob.xx + blob.yy)).max(start_m2) {
            return None;
        }
        let det = blob.xx * blob.yy - blob.xy * blob.xy;
        let chi_square = (dx * dx * blob.yy - 2.0 * dx * dy * blob.xy + dy * dy * blob.xx) / det;
        let share = chi_square / self.gate;
        if share <= 1.0 {
            return Some(share);
        }
        (square_m2 <= start_m2).then(|| 1.0 + square_m2.sqrt())
    }
}

/// A point that may belong to a stretch.
struct Belonging {
    is_young: bool,
    misfit: f64,
    stretch: usize,
    point: usize,
}

/// The stretches of one side while its points come in.
struct Stretches {
    all: Vec<Stretch>,
    open: Vec<usize>,
    /// The stretch of each point.
    of_point: Vec<usize>,
    /// Room for the points of one period.
    fits: Vec<Belonging>,
    is_taken: Vec<bool>,
    members: Vec<usize>,
}

impl Stretches {
    fn of(point_count: usize) -> Self {
        Self {
            all: Vec::with_capacity(point_count),
            open: Vec::new(),
            of_point: vec![0; point_count],
            fits: Vec::new(),
            is_taken: Vec::new(),
            members: Vec::new(),
        }
    }

    /// Gives every point of a period to the stretch it fits best, longest stretches first, or to a
    /// new one.
    fn extend(&mut self, blobs: &[Blob], points: Range<usize>, at: f64) {
        self.open.retain(|index| at - self.all[*index].last <= MAX_PAUSE);
        self.fits.clear();
        for &stretch in &self.open {
            let is_young = self.all[stretch].count < TRACKED_COUNT;
            let ahead = self.all[stretch].predict(at);
            let belonging = |point: usize| {
                let misfit = ahead.misfit(&blobs[point])?;
                Some(Belonging { is_young, misfit, stretch, point })
            };
            self.fits.extend(points.clone().filter_map(belonging));
        }
        self.fits.sort_by(|a, b| a.is_young.cmp(&b.is_young).then(a.misfit.total_cmp(&b.misfit)));
        self.is_taken.clear();
        self.is_taken.resize(points.len(), false);
        for fit in &self.fits {
            let is_taken = &mut self.is_taken[fit.point - points.start];
            if !*is_taken && self.all[fit.stretch].last < at {
                *is_taken = true;
                self.all[fit.stretch].add(&blobs[fit.point], at);
                self.of_point[fit.point] = fit.stretch;
            }
        }
        for point in points.clone().filter(|point| !self.is_taken[point - points.start]) {
            self.of_point[point] = self.all.len();
            self.open.push(self.all.len());
            self.all.push(Stretch::new(&blobs[point], at));
        }
    }

    /// Every stretch with its points in order of time.
    fn with_members(&mut self) -> Vec<(Stretch, &[usize])> {
        let mut next: Vec<usize> = Vec::with_capacity(self.all.len());
        let mut start = 0;
        for stretch in &self.all {
            next.push(start);
            start += stretch.count;
        }
        self.members.resize(start, 0);
        for (point, stretch) in self.of_point.iter().enumerate() {
            self.members[next[*stretch]] = point;
            next[*stretch] += 1;
        }
        let with =
            |(stretch, end): (&Stretch, usize)| (*stretch, &self.members[end - stretch.count..end]);
        self.all.iter().zip(next).map(with).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEADY_M: f64 = 0.5;

    /// The runs of one target that is seen at `path(k)` in period `k`, with σ of 3 cm and errors of
    /// up to 2 cm that alternate.
    fn runs_of(path: &[(usize, f64, f64)]) -> Runs {
        let blob = |(index, (_, x, y)): (usize, &(usize, f64, f64))| {
            let error = 0.01 * ((index * 7 % 5) as f64 - 2.0);
            Blob { x: x + error, y: y - error, xx: 9e-4, xy: 0.0, yy: 9e-4 }
        };
        let blobs: Vec<Blob> = path.iter().enumerate().map(blob).collect();
        let span = |(index, at): (usize, &(usize, f64, f64))| Span {
            period_index: at.0,
            refs: index..index + 1,
            nodes: 0..0,
        };
        let spans: Vec<Span> = path.iter().enumerate().map(span).collect();
        Runs::new(&blobs, &spans, |one| one.refs.clone(), STEADY_M)
    }

    fn walk(from: usize, count: usize, step: (f64, f64)) -> Vec<(usize, f64, f64)> {
        let at = |k: usize| (from + k, 1.0 + step.0 * k as f64, 2.0 + step.1 * k as f64);
        (0..count).map(at).collect()
    }

    fn sizes(runs: &Runs, kind: RunKind) -> Vec<f64> {
        (0..runs.sizes.len()).filter(|i| runs.kinds[*i] == kind).map(|i| runs.sizes[i]).collect()
    }

    #[test]
    fn a_straight_walk_is_two_runs_and_a_stop_is_one() {
        let runs = runs_of(&walk(0, 20, (0.1, 0.05)));
        assert_eq!((sizes(&runs, RunKind::Walk), runs.sizes.len()), (vec![10.0, 10.0], 2));
        assert!((0..10).all(|k| runs.of_point[k] == 0) && runs.of_point[10] == 1);
        let stop = runs_of(&walk(0, 20, (0.0, 0.0)));
        assert_eq!((sizes(&stop, RunKind::Place), stop.sizes.len()), (vec![20.0], 1));
    }

    #[test]
    fn a_turn_starts_new_runs() {
        let mut path = walk(0, 12, (0.2, 0.0));
        path.extend((1..12).map(|k| (11 + k, 3.2, 2.0 + 0.2 * k as f64)));
        let runs = runs_of(&path);
        assert_eq!(sizes(&runs, RunKind::Walk).len(), 4, "{:?}", runs.sizes);
        assert_ne!(runs.of_point[8], runs.of_point[14]);
    }

    #[test]
    fn a_fixed_place_stays_one_run_but_a_place_passed_again_is_new() {
        let mut fixed = walk(0, 6, (0.0, 0.0));
        fixed.extend(walk(40, 6, (0.0, 0.0)));
        fixed.extend(walk(60, 1, (0.0, 0.0)));
        assert_eq!(runs_of(&fixed).sizes, vec![13.0]);
        let mut passed = walk(0, 10, (0.1, 0.0));
        passed.extend(walk(40, 10, (0.1, 0.0)));
        assert_eq!(runs_of(&passed).sizes, vec![5.0; 4]);
    }

    #[test]
    fn scattered_points_stay_single() {
        let path: Vec<(usize, f64, f64)> =
            (0..30).map(|k| (k, (k * 37 % 11) as f64, (k * 53 % 13) as f64)).collect();
        let runs = runs_of(&path);
        assert_eq!(sizes(&runs, RunKind::Single).len(), 30);
        assert_eq!(runs.run_and_point_count(RunClass::Single), (30.0, 30.0));
    }

    #[test]
    fn the_prediction_is_that_of_the_normal_equations() {
        let blob = |x: f64, y: f64| Blob { x, y, xx: 0.02, xy: 0.005, yy: 0.03 };
        let seen = [(2.0, 0.1, 1.0), (3.0, 0.3, 0.8), (5.0, 0.55, 0.3), (6.0, 0.75, 0.2)];
        let mut stretch = Stretch::new(&blob(seen[0].1, seen[0].2), seen[0].0);
        for (at, x, y) in seen.iter().skip(1) {
            stretch.add(&blob(*x, *y), *at);
        }
        let design = nalgebra::Matrix4x2::from_fn(|row, c| if c == 0 { 1.0 } else { seen[row].0 });
        let values =
            nalgebra::Matrix4x2::from_fn(|row, c| if c == 0 { seen[row].1 } else { seen[row].2 });
        let inverse = (design.transpose() * design).try_inverse().unwrap();
        let line = inverse * design.transpose() * values;
        let ahead = nalgebra::Vector2::new(1.0, 9.0);
        let factor = 1.0 + ahead.dot(&(inverse * ahead));
        let point = blob(1.5, -0.6);
        let d = nalgebra::Vector2::new(point.x, point.y) - line.transpose() * ahead;
        let cov = nalgebra::Matrix2::new(point.xx, point.xy, point.xy, point.yy);
        let expected = d.dot(&(cov.try_inverse().unwrap() * d)) / (GATE * factor);
        let found = stretch.predict(9.0).misfit(&point).unwrap();
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    }
}
