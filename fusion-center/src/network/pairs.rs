//! Which pairs of nodes are worth solving, and their solution on all cores.
//!
//! Two nodes that see the same targets measure the same distances between them: between two points
//! of one period, and between points of two periods some way apart. Each agreement of two lengths
//! is a vote for a pose. Votes of a true pose fall into one cell of heading and position, others
//! scatter. In a large site each node is solved with the partners whose fullest cells stand out
//! most; further edges would add little, because the joint refinement takes the points of all nodes
//! whether or not an edge joins them.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::TAU;

use nalgebra::Vector2;
use proto::ids::NodeId;
use rayon::prelude::*;

use super::{Edge, NodeView, SiteProblem};
use crate::registration::Solver;

/// Sites of up to so many nodes have all their pairs solved.
const MAX_UNSCREENED_NODES: usize = 10;

/// Partners that each node of a larger site picks; a pair is solved if either picks the other.
const PARTNER_COUNT: usize = 6;

/// Cells of heading per turn, and their side in metres: errors of a vote are some degrees, and
/// some degrees times the distance of the points.
const HEADING_CELLS: usize = 48;
const CELL_SIDE_M: f64 = 1.0;

/// Shortest length that votes, metres.
const MIN_LENGTH_M: f64 = 1.0;

/// How many standard deviations two lengths may differ.
const LENGTH_GATE_SIGMAS: f64 = 2.5;

/// Comparisons of lengths per pair of nodes: periods are left out evenly beyond it.
const MAX_COMPARISON_COUNT: usize = 6_000;

/// Points of a set that are compared: what they cost grows with their fourth power.
const MAX_POINT_COUNT: usize = 20;

/// Standard deviations of a Poisson count by which a pair's fullest cell must exceed what its votes
/// give on average near that heading. Pairs without common targets reach 2 to 4 of them.
const MIN_PROMISE: f64 = 2.5;

/// Cells that votes of chance near one heading spread over: a room of some ten metres.
const CHANCE_CELL_COUNT: f64 = 60.0;

/// A node's points of one period: place and variance.
type Points = Vec<(Vector2<f64>, f64)>;

/// Two points of a node, from the first to the second.
#[derive(Clone, Copy)]
struct Segment {
    start_m: Vector2<f64>,
    step_m: Vector2<f64>,
    length_m: f64,
    variance_m2: f64,
}

/// The edges of all pairs that may share targets, in order of names, whatever the thread count.
pub(super) fn solve_pairs(problem: &SiteProblem, solver: &dyn Solver) -> Vec<Edge> {
    let pairs = promising(problem);
    let solve = |(first, second): &(&NodeId, &NodeId)| {
        let pair = problem.pair(first, second);
        let solution = solver.solve(&pair, None);
        Edge { first: (*first).clone(), second: (*second).clone(), solution }
    };
    pairs.par_iter().map(solve).collect()
}

/// The pairs worth solving.
pub(super) fn promising(problem: &SiteProblem) -> Vec<(&NodeId, &NodeId)> {
    let names: Vec<&NodeId> = problem.views.keys().collect();
    let points: Vec<BTreeMap<i64, Points>> = problem.views.values().map(points_of).collect();
    let common = |first: usize, second: usize| common_periods(&points[first], &points[second]);
    let scored = |first: usize| -> Vec<(usize, f64)> {
        let score = |second: usize| (second, promise(&common(first, second)));
        (first + 1..names.len()).map(score).collect()
    };
    let kept: Vec<(usize, usize)> = if names.len() > MAX_UNSCREENED_NODES {
        picked(&(0..names.len()).into_par_iter().map(scored).collect::<Vec<_>>())
    } else {
        let pairs = (0..names.len()).flat_map(|a| (a + 1..names.len()).map(move |b| (a, b)));
        pairs.filter(|(first, second)| !common(*first, *second).is_empty()).collect()
    };
    kept.into_iter().map(|(first, second)| (names[first], names[second])).collect()
}

/// Pairs that stand among the best partners of either node, ascending. `scored[a]` holds `(b,
/// promise)` of all `b > a`.
fn picked(scored: &[Vec<(usize, f64)>]) -> Vec<(usize, usize)> {
    let mut partners: Vec<Vec<(f64, usize)>> = vec![Vec::new(); scored.len()];
    for (first, scores) in scored.iter().enumerate() {
        for (second, promise) in scores.iter().filter(|(_, promise)| *promise > MIN_PROMISE) {
            partners[first].push((*promise, *second));
            partners[*second].push((*promise, first));
        }
    }
    let mut pairs = BTreeSet::new();
    for (node, others) in partners.iter_mut().enumerate() {
        others.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        for (_, other) in others.iter().take(PARTNER_COUNT) {
            pairs.insert((node.min(*other), node.max(*other)));
        }
    }
    pairs.into_iter().collect()
}

fn points_of(view: &NodeView) -> BTreeMap<i64, Points> {
    let depth_m2 = view.half_depth_sigma_m.powi(2);
    let of_set = |set: &super::SeenSet| -> Points {
        let variance = |point: &proto::geom::Gaussian<_>| 0.5 * point.cov_m2.trace() + depth_m2;
        let some = set.points.iter().take(MAX_POINT_COUNT);
        some.map(|point| (point.mean.coords_m, variance(point))).collect()
    };
    let by_period = view.sets.iter().map(|(period, set)| (*period, of_set(set)));
    by_period.filter(|(_, points)| !points.is_empty()).collect()
}

fn common_periods<'a>(
    one: &'a BTreeMap<i64, Points>,
    other: &'a BTreeMap<i64, Points>,
) -> Vec<(&'a Points, &'a Points)> {
    one.iter().filter_map(|(period, points)| Some((points, other.get(period)?))).collect()
}

/// All segments from points of `from` to points of `to`, both ways round where `is_same`.
fn segments(from: &Points, to: &Points) -> Vec<Segment> {
    let is_same = std::ptr::eq(from, to);
    let mut found = Vec::with_capacity(from.len() * to.len());
    for (index, (start, start_variance)) in from.iter().enumerate() {
        for (other, (end, end_variance)) in to.iter().enumerate() {
            let step_m = end - start;
            let length_m = step_m.norm();
            if length_m >= MIN_LENGTH_M && !(is_same && index == other) {
                let variance_m2 = start_variance + end_variance;
                found.push(Segment { start_m: *start, step_m, length_m, variance_m2 });
            }
        }
    }
    found
}

/// By how many standard deviations the fullest cell of votes exceeds chance; 0 without votes.
fn promise(common: &[(&Points, &Points)]) -> f64 {
    let (fullest, heading_count) = fullest_cell(&votes(common));
    let chance = heading_count / CHANCE_CELL_COUNT;
    ((fullest - chance) / (chance + 1.0).sqrt()).max(0.0)
}

/// Poses `(heading_rad, x_m, y_m)` of the second node in the first's frame at which two lengths
/// agree.
fn votes(common: &[(&Points, &Points)]) -> Vec<[f64; 3]> {
    let gap = (common.len() / 3).max(1);
    let cost: usize = common.iter().map(|(a, b)| 2 * (a.len() * b.len()).pow(2)).sum();
    let stride = cost.div_ceil(MAX_COMPARISON_COUNT).max(1);
    let mut votes = Vec::new();
    for index in (0..common.len()).step_by(stride) {
        let (in_first, in_second) = common[index];
        vote(&segments(in_first, in_first), &segments(in_second, in_second), &mut votes);
        if let Some((later_first, later_second)) = common.get(index + gap) {
            let of_first = segments(in_first, later_first);
            vote(&of_first, &segments(in_second, later_second), &mut votes);
        }
    }
    votes
}

fn vote(in_first: &[Segment], in_second: &[Segment], votes: &mut Vec<[f64; 3]>) {
    for one in in_first {
        for other in in_second {
            let off = one.length_m - other.length_m;
            let variance = one.variance_m2 + other.variance_m2;
            if off * off < LENGTH_GATE_SIGMAS.powi(2) * variance {
                votes.push(pose(one, other));
            }
        }
    }
}

/// The pose that carries the second segment onto the first.
fn pose(one: &Segment, other: &Segment) -> [f64; 3] {
    let (a, b) = (&one.step_m, &other.step_m);
    let heading = (a.y * b.x - a.x * b.y).atan2(a.x * b.x + a.y * b.y);
    let (sin, cos) = heading.sin_cos();
    let start = &other.start_m;
    let turned = Vector2::new(cos * start.x - sin * start.y, sin * start.x + cos * start.y);
    let shift = one.start_m - turned;
    [heading.rem_euclid(TAU), shift.x, shift.y]
}

/// The cell of a heading in [0, 2π].
#[expect(clippy::cast_possible_truncation, reason = "at most 48")]
fn heading_cell(heading_rad: f64) -> usize {
    ((heading_rad / TAU * HEADING_CELLS as f64) as usize).min(HEADING_CELLS - 1)
}

/// Votes in the fullest cell of position near the two fullest headings, and votes of that heading.
fn fullest_cell(votes: &[[f64; 3]]) -> (f64, f64) {
    let mut by_heading: Vec<Vec<[f64; 2]>> = vec![Vec::new(); HEADING_CELLS];
    for [heading, x, y] in votes {
        by_heading[heading_cell(*heading)].push([*x, *y]);
    }
    // Neighbours are taken together, so that no heading lies at an edge.
    let pooled = |cell: usize| {
        let next = (cell + 1) % HEADING_CELLS;
        (by_heading[cell].len() + by_heading[next].len(), cell)
    };
    let mut ranked: Vec<(usize, usize)> = (0..HEADING_CELLS).map(pooled).collect();
    ranked.sort_by(|a, b| b.cmp(a));
    let fullest = |&(count, cell): &(usize, usize)| {
        let places = [&by_heading[cell][..], &by_heading[(cell + 1) % HEADING_CELLS][..]].concat();
        (fullest_square(&places), count as f64)
    };
    let best = ranked.iter().take(3).map(fullest).max_by(|a, b| a.0.total_cmp(&b.0));
    best.unwrap_or((0.0, 0.0))
}

/// Most places in one of the overlapping squares.
fn fullest_square(places: &[[f64; 2]]) -> f64 {
    let mut most = 0;
    for (shift_x, shift_y) in [(0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.5, 0.5)] {
        let cell = |[x, y]: &[f64; 2]| {
            let index = |value: f64, shift: f64| (value / CELL_SIDE_M + shift).floor();
            (index(*x, shift_x), index(*y, shift_y))
        };
        let mut cells: Vec<(f64, f64)> = places.iter().map(cell).collect();
        cells.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let same = |a: &(f64, f64), b: &(f64, f64)| {
            a.0.total_cmp(&b.0).is_eq() && a.1.total_cmp(&b.1).is_eq()
        };
        most = cells.chunk_by(same).map(<[_]>::len).fold(most, usize::max);
    }
    most as f64
}

#[cfg(test)]
#[path = "pairs_tests.rs"]
mod tests;
