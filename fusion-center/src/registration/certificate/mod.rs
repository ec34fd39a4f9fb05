//! The certificate: proof that no pose apart from the best one comes near its likelihood ratio.
//!
//! Branch and bound over all poses, best bound first. Every cell of poses has an upper bound of Λ
//! (see `bound`) over all its poses and all shares of common points; cells whose bound does not
//! exceed the goal are done, the others are halved. What remains when no cell is left is proven.
//! Poses are not apart from the best one where they carry the points less than a reach apart or lie
//! within its own peak, `(θ − θ_b)ᵀ C⁻¹ (θ − θ_b) ≤ q`; such cells are left out.
//!
//! Everywhere Λ is that of the likelihood under the covariance scale of the best mode, with the
//! share free: what is proven holds for any mode that a climb could find. The node may stand
//! anywhere; poses at which no pair meets have Λ ≤ 0.
//!
//! Cost: visits of pairs, at most the given number. A cell visits the pairs that reach its parent.

use std::cmp::Ordering;
use std::collections::BinaryHeap;
use std::f64::consts::PI;
use std::ops::Range;

use nalgebra::{Cholesky, Matrix3, Vector2, Vector3};
use proto::geom::{carried_by_pose, wrap_angle};

use super::likelihood::{Model, evaluate};
use super::modes::{Mode, refine_from};
use super::prepared::{Blob, Motion, Prepared, Span};
use super::{Outcome, Solution};
use bound::{Bounds, Cell, Room};

mod bound;
mod exponential;
mod stated;
mod sums;

pub use stated::{Certificate, Uncertified};

#[cfg(test)]
mod tests;

/// Sectors of the heading at the start; from 4 to 16 make no difference to the time.
const SECTOR_COUNT: usize = 8;

/// Where Λ, were it a parabola, would have fallen to the goal, times this, ends the peak. Peaks
/// have longer tails than parabolas, and bounds slack.
const PEAK_MARGIN: f64 = 6.0;

/// The peak ends no nearer than this, squared and in units of the covariance, as modes merge there.
const LEAST_PEAK_CHI_SQUARE: f64 = 25.0;

/// Cells whose poses move points less than this share of their typical deviation are not halved
/// for a proof before a climb has looked for a mode there.
const SUSPECT_SHARE: f64 = 0.5;

/// Cells that a proof needs at least, if every one visits all pairs: with fewer it is not begun.
/// The paper's scene and an office of three people took 300 to 1000.
const LEAST_CELL_COUNT: usize = 200;

/// Suspects that are looked into per solution.
const SUSPECT_COUNT: usize = 4;

/// What is to be proven, and for how much.
#[derive(Clone, Copy, Debug)]
pub(super) struct Goal {
    /// Share of the best mode's Λ.
    pub(super) share: f64,
    /// Poses that carry the node's points less than this apart, metres, are the same.
    pub(super) reach_m: f64,
    /// Most visits of pairs.
    pub(super) visit_count: usize,
}

/// What the search came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Verdict {
    /// No pose apart from the best one has more than this share of its Λ. At most the goal's
    /// share where the budget sufficed, below 1 always.
    Proven {
        /// The share.
        share: f64,
    },
    /// Nothing was proven.
    Open {
        /// Why.
        reason: Uncertified,
    },
    /// There may be a pose near this one that has more than the goal's share.
    Suspect {
        /// The pose.
        motion: Motion,
    },
}

/// The verdict, and how many pairs were visited for it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Attempt {
    pub(super) verdict: Verdict,
    pub(super) visit_count: usize,
}

/// The modes and the solution that `conclude` draws from them, with the share that is proven. A
/// pose that the search finds becomes a mode. Only a determined pose is worth a proof.
pub(super) fn confirmed(
    data: &Prepared,
    modes: Vec<Mode>,
    goal: &Goal,
    conclude: impl Fn(&[Mode]) -> Solution,
) -> (Vec<Mode>, Solution) {
    let mut modes = modes;
    let mut solution = conclude(&modes);
    let mut cleared: Vec<Motion> = Vec::new();
    let mut left = *goal;
    let unfinished = Uncertified::Unfinished { visit_count: goal.visit_count };
    let mut certificate = Certificate::lacking(unfinished);
    for _ in 0..=SUSPECT_COUNT {
        let best = match decided(&modes, &solution, goal) {
            Ok(best) => best,
            Err(reason) => {
                certificate = Certificate::lacking(reason);
                break;
            }
        };
        let attempt = certify(data, best, &cleared, &left);
        left.visit_count -= attempt.visit_count.min(left.visit_count);
        match attempt.verdict {
            Verdict::Open { reason } => {
                certificate = Certificate::lacking(reason);
                break;
            }
            Verdict::Proven { share } => {
                certificate = Certificate::Proven { rival_share: share };
                break;
            }
            Verdict::Suspect { motion } => {
                cleared.push(motion);
                let found = refine_from(data, (motion, best.share), best.covariance_scale);
                let is_new = |mode: &Mode| {
                    let apart_m = |known: &Mode| data.displacement_m(&known.motion, &mode.motion);
                    modes.iter().all(|known| apart_m(known) > goal.reach_m)
                };
                if let Some(mode) = found.filter(is_new) {
                    modes.push(mode);
                    modes.sort_by(|a, b| b.fit.log_ratio.total_cmp(&a.fit.log_ratio));
                    solution = conclude(&modes);
                }
            }
        }
    }
    solution.evidence.certificate = certificate;
    (modes, solution)
}

/// The mode that the solution determines, if no other one has the goal's share already.
fn decided<'a>(
    modes: &'a [Mode],
    solution: &Solution,
    goal: &Goal,
) -> Result<&'a Mode, Uncertified> {
    let pose = solution.estimate.filter(|_| solution.outcome == Outcome::Determined);
    let is_best = |mode: &&Mode| pose.is_some_and(|p| mode.motion.pose() == p.pose_ref_from_node);
    let best = modes.iter().find(is_best).ok_or(Uncertified::NotDetermined)?;
    let level = goal.share * best.fit.log_ratio;
    let is_open = |mode: &Mode| mode.fit.log_ratio > level && mode.motion != best.motion;
    if modes.iter().any(is_open) { Err(Uncertified::Contested) } else { Ok(best) }
}

/// Searches all poses apart from `best` for one with more than the goal's share of its Λ; suspects
/// near one of `cleared` were looked into already.
pub(super) fn certify(data: &Prepared, best: &Mode, cleared: &[Motion], goal: &Goal) -> Attempt {
    let open = |reason| Attempt { verdict: Verdict::Open { reason }, visit_count: 0 };
    let pair_count: usize = data.spans.iter().map(Span::pair_count).sum();
    let most = goal.visit_count / LEAST_CELL_COUNT;
    if goal.visit_count == 0 {
        return open(Uncertified::Unasked);
    }
    if pair_count > most {
        return open(Uncertified::TooManyPairs { pair_count, most });
    }
    let peak = Peak::new(data, best, goal).filter(|_| best.fit.log_ratio > 0.0);
    let Some(peak) = peak else { return open(Uncertified::Shapeless) };
    let mut search = Search::new(data, best, goal, peak);
    let verdict = search.run(cleared);
    Attempt { verdict, visit_count: search.visit_count }
}

/// The poses that are not apart from the best one.
struct Peak {
    middle_x: f64,
    middle_y: f64,
    heading_rad: f64,
    reach_m: f64,
    spread_m: f64,
    precision: Matrix3<f64>,
    most_chi_square: f64,
}

impl Peak {
    fn new(data: &Prepared, best: &Mode, goal: &Goal) -> Option<Self> {
        let motion = &best.motion;
        let (arm_x, arm_y) = motion.turned(data.node_center_m.x, data.node_center_m.y);
        // From errors of the node's place to errors of the middle of its points.
        let to_middle = carried_by_pose(&Vector2::new(arm_x, arm_y));
        let covariance = to_middle * best.covariance * to_middle.transpose();
        let drop = 2.0 * (1.0 - goal.share) * best.fit.log_ratio;
        Some(Self {
            middle_x: motion.x + arm_x,
            middle_y: motion.y + arm_y,
            heading_rad: motion.heading_rad(),
            reach_m: goal.reach_m,
            spread_m: data.node_spread_m,
            precision: Cholesky::new(covariance)?.inverse(),
            most_chi_square: (PEAK_MARGIN * drop).max(LEAST_PEAK_CHI_SQUARE),
        })
    }

    /// Whether no pose of the cell is apart from the best one.
    fn holds(&self, cell: &Cell) -> bool {
        let (dx, dy) = (cell.x - self.middle_x, cell.y - self.middle_y);
        let turn = wrap_angle(cell.heading_rad - self.heading_rad);
        let far_m2 = (dx.abs() + cell.half_x).powi(2) + (dy.abs() + cell.half_y).powi(2);
        // A chord is no longer than its arc.
        let turned_m = (turn.abs() + cell.half_turn_rad).min(2.0) * self.spread_m;
        if turned_m <= self.reach_m && far_m2 <= (self.reach_m - turned_m).powi(2) {
            return true;
        }
        let step = Vector3::new(dx, dy, turn);
        if step.dot(&(self.precision * step)) > self.most_chi_square {
            return false;
        }
        // A convex function is largest at a corner.
        let half = [cell.half_x, cell.half_y, cell.half_turn_rad];
        (0..8_usize).all(|corner| {
            let sign = |axis: usize| if corner >> axis & 1 == 1 { 1.0 } else { -1.0 };
            let at = step + Vector3::from_fn(|axis, _| sign(axis) * half[axis]);
            at.dot(&(self.precision * at)) <= self.most_chi_square
        })
    }
}

/// A cell that is not done.
struct Open {
    bound: f64,
    cell: Cell,
    /// Its pairs in the arena.
    pairs: Range<usize>,
}

impl PartialEq for Open {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Open {}

impl PartialOrd for Open {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Open {
    fn cmp(&self, other: &Self) -> Ordering {
        self.bound.total_cmp(&other.bound)
    }
}

struct Search<'a> {
    data: &'a Prepared,
    bounds: Bounds,
    peak: Peak,
    model: Model<'a>,
    best_log_ratio: f64,
    level: f64,
    most_visits: usize,
    visit_count: usize,
    /// Indices of the pairs of all cells, one range after the other.
    arena: Vec<u32>,
    room: Room,
    open: BinaryHeap<Open>,
    /// Largest bound of a cell that is done.
    done_bound: f64,
}

impl<'a> Search<'a> {
    fn new(data: &'a Prepared, best: &Mode, goal: &Goal, peak: Peak) -> Self {
        let bounds = Bounds::new(data, best.covariance_scale);
        let room = bounds.room();
        Self {
            data,
            bounds,
            peak,
            model: best.model(data),
            best_log_ratio: best.fit.log_ratio,
            level: goal.share * best.fit.log_ratio,
            most_visits: goal.visit_count,
            visit_count: 0,
            arena: Vec::new(),
            room,
            open: BinaryHeap::new(),
            done_bound: 0.0,
        }
    }

    fn run(&mut self, cleared: &[Motion]) -> Verdict {
        self.start();
        while let Some(top) = self.open.pop() {
            if self.visit_count >= self.most_visits {
                return self.proven(top.bound);
            }
            if self.is_suspect(&top, cleared) {
                return Verdict::Suspect { motion: top.cell.motion(self.data) };
            }
            for half in top.cell.halves(self.data.node_spread_m) {
                self.look_at(half, top.pairs.clone());
            }
        }
        self.proven(self.done_bound)
    }

    fn proven(&self, bound: f64) -> Verdict {
        let share = bound.max(self.done_bound) / self.best_log_ratio;
        if share < 1.0 {
            Verdict::Proven { share }
        } else {
            Verdict::Open { reason: Uncertified::Unfinished { visit_count: self.visit_count } }
        }
    }

    /// All poses at which a pair can meet, in sectors of the heading.
    fn start(&mut self) {
        let refs = &self.data.refs;
        let ends = |of: fn(&Blob) -> f64| {
            let low = refs.iter().map(of).fold(f64::INFINITY, f64::min);
            (low, refs.iter().map(of).fold(f64::NEG_INFINITY, f64::max))
        };
        let ((low_x, high_x), (low_y, high_y)) = (ends(|blob| blob.x), ends(|blob| blob.y));
        let margin_m = self.bounds.margin_m();
        self.arena = (0..self.bounds.pair_count()).filter_map(|i| u32::try_from(i).ok()).collect();
        let half_turn_rad = PI / SECTOR_COUNT as f64;
        for sector in 0..SECTOR_COUNT {
            let cell = Cell {
                x: 0.5 * (low_x + high_x),
                y: 0.5 * (low_y + high_y),
                heading_rad: (2 * sector + 1) as f64 * half_turn_rad,
                half_x: 0.5 * (high_x - low_x) + margin_m,
                half_y: 0.5 * (high_y - low_y) + margin_m,
                half_turn_rad,
            };
            let pairs = 0..self.bounds.pair_count();
            self.open.push(Open { bound: f64::INFINITY, cell, pairs });
        }
    }

    fn look_at(&mut self, cell: Cell, given: Range<usize>) {
        self.visit_count += given.len();
        let start = self.arena.len();
        let bound = self.bounds.over(&cell, (&mut self.arena, given), &mut self.room);
        let is_done = bound <= self.level;
        if is_done {
            self.done_bound = self.done_bound.max(bound);
        }
        if is_done || self.peak.holds(&cell) {
            self.arena.truncate(start);
        } else {
            self.open.push(Open { bound, cell, pairs: start..self.arena.len() });
        }
    }

    fn log_ratio_at(&self, motion: &Motion) -> f64 {
        evaluate(&self.model, motion).log_ratio
    }

    /// Whether the cell is so small that a pose above the level is likely in it, and new.
    fn is_suspect(&self, open: &Open, cleared: &[Motion]) -> bool {
        let cell = &open.cell;
        let size_m = cell.half_x.hypot(cell.half_y) + cell.chord() * self.data.node_spread_m;
        if size_m > SUSPECT_SHARE * self.data.typical_sigma_m {
            return false;
        }
        let motion = cell.motion(self.data);
        let point = Cell { half_x: 0.0, half_y: 0.0, half_turn_rad: 0.0, ..*cell };
        if self.peak.holds(&point) || self.log_ratio_at(&motion) <= self.level {
            return false;
        }
        let is_new = |other: &Motion| self.data.displacement_m(other, &motion) > self.peak.reach_m;
        cleared.iter().all(is_new)
    }
}
