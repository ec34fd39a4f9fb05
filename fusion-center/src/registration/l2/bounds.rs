//! An upper bound of the paper's objective, taken positive, over a box of poses.
//!
//! A box is a square of positions of the node's centre, half side `h`, times an interval of
//! headings, half width `α`. For a pair with the offset `d₀` at the box's middle, over the box:
//! - the offset moves, along a unit vector `e`, by at most
//!   `h (|e_x| + |e_y|) + |τ·e| sin α + |m·e| (1 − cos α)`, `m` the node's point from the centre,
//!   `τ` the same after a quarter turn, `α ≤ 90°`;
//! - `S` stays below `S̄ = S₀ + s (λ₁ − λ₂) sin α · I`, `λ` the eigenvalues of the node's `R`;
//! - `det S`, a cosine of twice the heading, stays above
//!   `max(det S₀ − s² Δ Δ' α, s² (det R + det R' + (tr R tr R' − Δ Δ') / 2))`, `Δ = λ₁ − λ₂`.
//!
//! So `q ≤ exp(−½ Σ_i max(0, |d₀·e_i| − reach_i)² / λ̄_i) / (2π √det)` with the axes `e_i` of `S̄`.
//! Pairs of one point compete: of two partners a distance `D` apart one is at least `D / 2` off, so
//! that the sum over a point's pairs is below its largest bound plus a remainder that is fixed
//! beforehand. A period's bound is the smaller of those by the reference's and the node's points.
//! Cost: one pass over all pairs, without exponential for those out of reach.

use std::f64::consts::{FRAC_PI_2, TAU};

use super::super::objective::NEGLIGIBLE_CHI_SQUARE;
use super::super::prepared::{Blob, Motion, Prepared, Span};

/// A box of poses: the node's centre in the reference frame, the heading, and their half widths.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PoseBox {
    pub(super) x_m: f64,
    pub(super) y_m: f64,
    pub(super) heading_rad: f64,
    pub(super) half_x_m: f64,
    pub(super) half_y_m: f64,
    pub(super) half_heading_rad: f64,
}

/// What a box may hold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct BoxValue {
    /// No pose in the box has more, 1/m².
    pub(super) upper: f64,
    /// What its middle has, 1/m².
    pub(super) middle: f64,
}

/// A point with the eigenvalues of its covariance times the scale.
#[derive(Clone, Copy)]
struct Shape {
    /// The point, about the centre for a node's, its covariance times the scale.
    blob: Blob,
    larger_m2: f64,
    smaller_m2: f64,
    /// What all but the best of its pairs can add anywhere, 1/m².
    remainder: f64,
}

impl Shape {
    fn new(point: &Blob, scale: f64, (center_x, center_y): (f64, f64)) -> Self {
        let blob = Blob {
            x: point.x - center_x,
            y: point.y - center_y,
            xx: point.xx * scale,
            xy: point.xy * scale,
            yy: point.yy * scale,
        };
        let mean = 0.5 * (blob.xx + blob.yy);
        let radius = (0.5 * (blob.xx - blob.yy)).hypot(blob.xy);
        let smaller_m2 = (mean - radius).max(0.0);
        Self { blob, larger_m2: mean + radius, smaller_m2, remainder: 0.0 }
    }

    fn difference_m2(&self) -> f64 {
        self.larger_m2 - self.smaller_m2
    }

    /// The smallest determinant of the sum of both covariances over all headings, m⁴.
    fn least_determinant_m4(&self, other: &Self) -> f64 {
        (self.larger_m2 + other.larger_m2) * (self.smaller_m2 + other.smaller_m2)
    }

    /// The largest density of the pair with `other` at `distance_m`, 1/m².
    fn most_at(&self, other: &Self, distance_m: f64) -> f64 {
        let chi_square = distance_m.powi(2) / (self.larger_m2 + other.larger_m2);
        (-0.5 * chi_square).exp() / (TAU * self.least_determinant_m4(other).sqrt())
    }
}

/// The problem laid out for bounds.
pub(super) struct Bounder<'a> {
    spans: &'a [Span],
    refs: Vec<Shape>,
    nodes: Vec<Shape>,
    center: (f64, f64),
}

impl<'a> Bounder<'a> {
    pub(super) fn new(data: &'a Prepared, scale: f64) -> Self {
        let center = (data.node_center_m.x, data.node_center_m.y);
        let mut refs: Vec<Shape> =
            data.refs.iter().map(|point| Shape::new(point, scale, (0.0, 0.0))).collect();
        let mut nodes: Vec<Shape> =
            data.nodes.iter().map(|point| Shape::new(point, scale, center)).collect();
        for span in &data.spans {
            let (here, there) = (&mut refs[span.refs.clone()], &mut nodes[span.nodes.clone()]);
            set_remainders(here, there);
            set_remainders(there, here);
        }
        Self { spans: &data.spans, refs, nodes, center }
    }

    /// The boxes outside of which no pair is near, in `count` intervals of the heading.
    pub(super) fn roots(&self, count: usize) -> Vec<PoseBox> {
        let radius = self.nodes.iter().map(|n| n.blob.x.hypot(n.blob.y)).fold(0.0, f64::max);
        let widest = |shapes: &[Shape]| shapes.iter().map(|s| s.larger_m2).fold(0.0, f64::max);
        let reach = (NEGLIGIBLE_CHI_SQUARE * (widest(&self.refs) + widest(&self.nodes))).sqrt();
        let range = |of: fn(&Blob) -> f64| {
            let values = || self.refs.iter().map(|r| of(&r.blob));
            let (low, high) =
                (values().fold(f64::INFINITY, f64::min), values().fold(-f64::INFINITY, f64::max));
            (0.5 * (low + high), 0.5 * (high - low) + radius + reach)
        };
        let ((x_m, half_x_m), (y_m, half_y_m)) = (range(|b| b.x), range(|b| b.y));
        let half_heading_rad = 0.5 * TAU / count as f64;
        (0..count)
            .map(|index| {
                let heading_rad = (2.0 * index as f64 + 1.0) * half_heading_rad;
                PoseBox { x_m, y_m, heading_rad, half_x_m, half_y_m, half_heading_rad }
            })
            .collect()
    }

    /// The pose at a box's middle.
    pub(super) fn middle(&self, of: &PoseBox) -> Motion {
        let turn = Motion::new(0.0, 0.0, of.heading_rad);
        let (x, y) = turn.turned(self.center.0, self.center.1);
        Motion { x: of.x_m - x, y: of.y_m - y, ..turn }
    }

    /// Both halves of a box across the side along which the points move most; `arm_m` is a typical
    /// distance of a node's point from the centre.
    pub(super) fn halves(of: &PoseBox, arm_m: f64) -> [PoseBox; 2] {
        let (mut low, mut high) = (*of, *of);
        let across = of.half_x_m.max(of.half_y_m);
        if of.half_heading_rad * arm_m > across {
            let half = 0.5 * of.half_heading_rad;
            (low.half_heading_rad, high.half_heading_rad) = (half, half);
            low.heading_rad -= half;
            high.heading_rad += half;
        } else if of.half_x_m >= of.half_y_m {
            let half = 0.5 * of.half_x_m;
            (low.half_x_m, high.half_x_m) = (half, half);
            low.x_m -= half;
            high.x_m += half;
        } else {
            let half = 0.5 * of.half_y_m;
            (low.half_y_m, high.half_y_m) = (half, half);
            low.y_m -= half;
            high.y_m += half;
        }
        [low, high]
    }

    /// The bound of a box and the value at its middle.
    pub(super) fn value(&self, of: &PoseBox) -> BoxValue {
        let frame = Frame::new(of);
        let mut sum = BoxValue { upper: 0.0, middle: 0.0 };
        let mut by_ref: Vec<PointSum> = Vec::with_capacity(16);
        for span in self.spans {
            let period = self.period_value(&frame, span, &mut by_ref);
            sum.upper += period.upper;
            sum.middle += period.middle;
        }
        sum
    }

    /// As [`Self::value`] of one period; `by_ref` is room for its points' sums.
    fn period_value(&self, frame: &Frame, span: &Span, by_ref: &mut Vec<PointSum>) -> BoxValue {
        let refs = &self.refs[span.refs.clone()];
        by_ref.clear();
        by_ref.resize(refs.len(), PointSum::default());
        let (mut by_nodes, mut middle) = (0.0, 0.0);
        for node in &self.nodes[span.nodes.clone()] {
            let turned = frame.turn(node);
            let mut by_node = PointSum::default();
            for (point, of_ref) in refs.iter().zip(by_ref.iter_mut()) {
                let pair = frame.pair(point, &turned);
                by_node.add(pair.upper);
                of_ref.add(pair.upper);
                middle += pair.middle;
            }
            by_nodes += by_node.bound(node.remainder);
        }
        let by_refs: f64 = refs.iter().zip(by_ref.iter()).map(|(p, s)| s.bound(p.remainder)).sum();
        BoxValue { upper: by_refs.min(by_nodes), middle }
    }
}

/// The bounds of one point's pairs.
#[derive(Clone, Copy, Default)]
struct PointSum {
    sum: f64,
    largest: f64,
}

impl PointSum {
    fn add(&mut self, upper: f64) {
        self.sum += upper;
        self.largest = self.largest.max(upper);
    }

    fn bound(&self, remainder: f64) -> f64 {
        self.sum.min(self.largest + remainder)
    }
}

/// `Σ_l max_{l' ≠ l} (the most that the lesser of both pairs with a point of `here` can have)`.
fn set_remainders(here: &mut [Shape], there: &[Shape]) {
    for point in here {
        point.remainder = (0..there.len()).map(|index| most_beside(point, there, index)).sum();
    }
}

/// The most that the pair with `there[index]` has where another pair of `point` has more.
fn most_beside(point: &Shape, there: &[Shape], index: usize) -> f64 {
    let a = &there[index];
    let lesser = |b: &Shape| {
        let half_m = 0.5 * (a.blob.x - b.blob.x).hypot(a.blob.y - b.blob.y);
        point.most_at(a, half_m).max(point.most_at(b, half_m))
    };
    let others = there.iter().enumerate().filter(|(other, _)| *other != index);
    others.map(|(_, b)| lesser(b)).fold(0.0, f64::max)
}

/// A box with what all its pairs need.
struct Frame {
    middle: Motion,
    half_x_m: f64,
    half_y_m: f64,
    half_heading_rad: f64,
    /// `sin α` and `1 − cos α`, at their largest within the interval.
    along: f64,
    inward: f64,
}

/// A node's point at the middle of a box.
struct TurnedNode {
    /// Where it is, with its turned covariance widened for the box's headings.
    blob: Blob,
    /// From the centre.
    arm: [f64; 2],
    /// `s (λ₁ − λ₂) sin α`.
    widening_m2: f64,
    difference_m2: f64,
    /// Farthest that it moves within the box.
    reach_m: f64,
    shape: Shape,
}

impl Frame {
    fn new(of: &PoseBox) -> Self {
        let alpha = of.half_heading_rad;
        Self {
            middle: Motion::new(of.x_m, of.y_m, of.heading_rad),
            half_x_m: of.half_x_m,
            half_y_m: of.half_y_m,
            half_heading_rad: alpha,
            along: if alpha < FRAC_PI_2 { alpha.sin() } else { 1.0 },
            inward: 1.0 - alpha.cos(),
        }
    }

    fn turn(&self, node: &Shape) -> TurnedNode {
        let mut blob = self.middle.apply(&node.blob);
        let arm = [blob.x - self.middle.x, blob.y - self.middle.y];
        let widening_m2 = node.difference_m2() * self.along;
        blob.xx += widening_m2;
        blob.yy += widening_m2;
        let length = arm[0].hypot(arm[1]);
        let reach_m = self.half_x_m.hypot(self.half_y_m) + length * self.half_heading_rad;
        let difference_m2 = node.difference_m2();
        TurnedNode { blob, arm, widening_m2, difference_m2, reach_m, shape: *node }
    }

    fn pair(&self, point: &Shape, node: &TurnedNode) -> BoxValue {
        let (dx, dy) = (point.blob.x - node.blob.x, point.blob.y - node.blob.y);
        // (reach + k σ)² is at most 2 reach² + 2 k² σ².
        let widest_m2 = point.larger_m2 + node.shape.larger_m2 + node.widening_m2;
        let out_of_reach = 2.0 * (node.reach_m.powi(2) + NEGLIGIBLE_CHI_SQUARE * widest_m2);
        if dx * dx + dy * dy > out_of_reach {
            return BoxValue { upper: 0.0, middle: 0.0 };
        }
        let axes = Axes::of(&point.blob, &node.blob);
        let (first, second) = axes.along(dx, dy);
        let (reach_first, reach_second) = self.reaches(&axes, &node.arm);
        let near = |offset: f64, reach: f64| (offset.abs() - reach).max(0.0).powi(2);
        let nearest =
            near(first, reach_first) / axes.larger + near(second, reach_second) / axes.smaller;
        if nearest > NEGLIGIBLE_CHI_SQUARE {
            return BoxValue { upper: 0.0, middle: 0.0 };
        }
        let (larger, smaller) = (axes.larger - node.widening_m2, axes.smaller - node.widening_m2);
        let determinant = larger * smaller;
        let steepest = point.difference_m2() * node.difference_m2 * self.half_heading_rad;
        let least = (determinant - steepest).max(point.least_determinant_m4(&node.shape));
        let at_middle = first * first / larger + second * second / smaller;
        let density = |chi_square: f64, det: f64| (-0.5 * chi_square).exp() / (TAU * det.sqrt());
        let middle =
            if at_middle > NEGLIGIBLE_CHI_SQUARE { 0.0 } else { density(at_middle, determinant) };
        BoxValue { upper: density(nearest, least), middle }
    }

    /// Farthest that a node's point moves within the box along either axis.
    fn reaches(&self, axes: &Axes, arm: &[f64; 2]) -> (f64, f64) {
        let (cos, sin) = (axes.cos.abs(), axes.sin.abs());
        let (radial, tangential) =
            (arm[0] * axes.cos + arm[1] * axes.sin, arm[0] * axes.sin - arm[1] * axes.cos);
        let (radial, tangential) = (radial.abs(), tangential.abs());
        let first = self.half_x_m * cos + self.half_y_m * sin;
        let second = self.half_x_m * sin + self.half_y_m * cos;
        (
            first + tangential * self.along + radial * self.inward,
            second + radial * self.along + tangential * self.inward,
        )
    }
}

/// Eigenvalues and first axis of the sum of two covariances.
struct Axes {
    cos: f64,
    sin: f64,
    larger: f64,
    smaller: f64,
}

impl Axes {
    fn of(a: &Blob, b: &Blob) -> Self {
        let (xx, xy, yy) = (a.xx + b.xx, a.xy + b.xy, a.yy + b.yy);
        let (mean, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
        let radius = (half * half + xy * xy).sqrt();
        let cos_twice = if radius > 0.0 { half / radius } else { 1.0 };
        let cos = (0.5 * (1.0 + cos_twice)).max(0.0).sqrt();
        let sin = (0.5 * (1.0 - cos_twice)).max(0.0).sqrt().copysign(xy);
        let (larger, smaller) = (mean + radius, mean - radius);
        Self { cos, sin, larger, smaller }
    }

    fn along(&self, x: f64, y: f64) -> (f64, f64) {
        (self.cos * x + self.sin * y, self.cos * y - self.sin * x)
    }
}

#[cfg(test)]
#[path = "bounds_tests.rs"]
mod tests;
