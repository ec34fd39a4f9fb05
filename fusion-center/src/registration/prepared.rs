//! A registration problem laid out for fast evaluation: usable points only, in flat arrays.

use std::ops::Range;

use nalgebra::{Matrix2, Vector2, Vector3};
use proto::geom::{Frame, Gaussian, Node, Ref, Se2, wrap_angle};
use proto::measured::line_of_sight;

use super::{Period, Problem};
use crate::statistics::spread;
use crate::usable::usable_cov_m2;

/// Points of a period that are looked at one by one.
const FEW_POINTS: usize = 8;

/// A point with covariance, in whichever frame the array that holds it has.
#[derive(Clone, Copy, Debug)]
pub(super) struct Blob {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) xx: f64,
    pub(super) xy: f64,
    pub(super) yy: f64,
}

impl Blob {
    /// The point with the variance of a lasting offset along its line of sight, if it is usable.
    fn usable<F: Frame>(point: &Gaussian<F>, half_depth_sigma_m: f64) -> Option<Self> {
        Self::of(&point.mean.coords_m, &widened(point, half_depth_sigma_m))
    }

    /// The point, if it is usable.
    pub(super) fn of(at_m: &Vector2<f64>, cov_m2: &Matrix2<f64>) -> Option<Self> {
        let cov = usable_cov_m2(at_m, cov_m2)?;
        Some(Self { x: at_m.x, y: at_m.y, xx: cov[(0, 0)], xy: cov[(0, 1)], yy: cov[(1, 1)] })
    }
}

/// Appends the usable points; returns how many were left out.
fn append<F: Frame>(to: &mut Vec<Blob>, points: &[Gaussian<F>], half_depth_sigma_m: f64) -> usize {
    let before = to.len();
    to.extend(points.iter().filter_map(|point| Blob::usable(point, half_depth_sigma_m)));
    points.len() - (to.len() - before)
}

/// The covariance with `σ²` added along the line of sight.
fn widened<F: Frame>(point: &Gaussian<F>, half_depth_sigma_m: f64) -> Matrix2<f64> {
    if half_depth_sigma_m <= 0.0 {
        return point.cov_m2;
    }
    let outward = line_of_sight(&point.mean.coords_m);
    point.cov_m2 + outward * outward.transpose() * half_depth_sigma_m.powi(2)
}

/// A rigid motion from node to reference coordinates with its rotation ready to use.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Motion {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) cos: f64,
    pub(super) sin: f64,
}

impl Motion {
    pub(super) fn new(x: f64, y: f64, heading_rad: f64) -> Self {
        let (sin, cos) = heading_rad.sin_cos();
        Self { x, y, cos, sin }
    }

    pub(super) fn heading_rad(&self) -> f64 {
        self.sin.atan2(self.cos)
    }

    pub(super) fn pose(&self) -> Se2<Ref, Node> {
        Se2::new(self.x, self.y, self.heading_rad())
    }

    /// The motion with the step `(x, y, heading)` added.
    pub(super) fn plus(&self, step: &Vector3<f64>) -> Self {
        Self::new(self.x + step.x, self.y + step.y, self.heading_rad() + step.z)
    }

    /// This motion less `other`, `(x, y, heading)` with the heading in (−π, π].
    pub(super) fn minus(&self, other: &Self) -> Vector3<f64> {
        let turn = wrap_angle(self.heading_rad() - other.heading_rad());
        Vector3::new(self.x - other.x, self.y - other.y, turn)
    }

    pub(super) fn turned(&self, x: f64, y: f64) -> (f64, f64) {
        (self.cos * x - self.sin * y, self.sin * x + self.cos * y)
    }

    /// The node's point in the reference frame, its covariance as `Φ R Φᵀ`.
    pub(super) fn apply(&self, blob: &Blob) -> Blob {
        let (cos, sin) = (self.cos, self.sin);
        let (x, y) = self.turned(blob.x, blob.y);
        let (cc, cs, ss) = (cos * cos, cos * sin, sin * sin);
        Blob {
            x: x + self.x,
            y: y + self.y,
            xx: cc * blob.xx - 2.0 * cs * blob.xy + ss * blob.yy,
            xy: cs * (blob.xx - blob.yy) + (cc - ss) * blob.xy,
            yy: ss * blob.xx + 2.0 * cs * blob.xy + cc * blob.yy,
        }
    }
}

/// The points of one period, as ranges of the flat arrays.
#[derive(Clone, Debug)]
pub(super) struct Span {
    /// Which of the given periods.
    pub(super) period_index: usize,
    pub(super) refs: Range<usize>,
    pub(super) nodes: Range<usize>,
}

impl Span {
    pub(super) fn pair_count(&self) -> usize {
        self.refs.len() * self.nodes.len()
    }

    pub(super) fn refs_and_nodes(&self) -> (Range<usize>, Range<usize>) {
        (self.refs.clone(), self.nodes.clone())
    }

    pub(super) fn nodes_and_refs(&self) -> (Range<usize>, Range<usize>) {
        (self.nodes.clone(), self.refs.clone())
    }
}

/// Where a motion carries the node's points: their middle, then the heading's direction times
/// their spread. The distance of two such places is that of the points, up to a factor `√2`.
pub(super) type Place = [f64; 4];

/// Squared distance of two places, m².
pub(super) fn apart_m2(a: &Place, b: &Place) -> f64 {
    let square = |index: usize| (a[index] - b[index]) * (a[index] - b[index]);
    square(0) + square(1) + square(2) + square(3)
}

/// All periods with usable points on both sides. The reference's points of a period are in order
/// of their first coordinate, so that those near a place are found fast.
#[derive(Clone, Debug)]
pub(super) struct Prepared {
    pub(super) refs: Vec<Blob>,
    pub(super) nodes: Vec<Blob>,
    pub(super) spans: Vec<Span>,
    pub(super) ignored_count: usize,
    /// The area over which points spread, m²: geometric mean of both sides.
    pub(super) area_m2: f64,
    /// Mean of the node's points, in its frame.
    pub(super) node_center_m: Vector2<f64>,
    /// Root mean square distance of the node's points from their mean.
    pub(super) node_spread_m: f64,
    /// Root mean square standard deviation per axis of the difference of two points.
    pub(super) typical_sigma_m: f64,
    /// Standard deviations of the lasting offsets of the reference's side and of the node's.
    pub(super) half_depth_sigma_m: [f64; 2],
    /// A lower bound of the root of the determinant of any pair's covariance, m².
    pub(super) smallest_root_det_m2: f64,
    /// An upper bound of the variance of any pair in any direction, m².
    pub(super) largest_variance_m2: f64,
}

impl Prepared {
    pub(super) fn new(problem: &Problem) -> Self {
        let count =
            |of: fn(&Period) -> usize| -> usize { problem.periods.iter().map(of).sum::<usize>() };
        let counts = [count(|one| one.in_ref.len()), count(|one| one.in_node.len())];
        let mut prepared = Self::empty(counts, problem.periods.len());
        for (period_index, period) in problem.periods.iter().enumerate() {
            prepared.add(period_index, period, problem);
        }
        prepared.half_depth_sigma_m =
            [problem.ref_half_depth_sigma_m, problem.node_half_depth_sigma_m];
        prepared.measure();
        prepared
    }

    fn add(&mut self, period_index: usize, period: &Period, problem: &Problem) {
        let (ref_start, node_start) = (self.refs.len(), self.nodes.len());
        self.ignored_count +=
            append(&mut self.refs, &period.in_ref, problem.ref_half_depth_sigma_m)
                + append(&mut self.nodes, &period.in_node, problem.node_half_depth_sigma_m);
        let (refs, nodes) = (ref_start..self.refs.len(), node_start..self.nodes.len());
        if refs.is_empty() || nodes.is_empty() {
            self.refs.truncate(ref_start);
            self.nodes.truncate(node_start);
            return;
        }
        self.refs[refs.clone()].sort_by(|a, b| a.x.total_cmp(&b.x));
        self.spans.push(Span { period_index, refs, nodes });
    }

    /// As [`Self::new`] for a problem in which both sides list the same targets in the same order:
    /// the points with equal index are one target's.
    #[cfg(test)]
    pub(super) fn aligned(problem: &Problem) -> Self {
        let mut prepared = Self::new(problem);
        for span in &prepared.spans {
            let mut order: Vec<usize> = (0..span.nodes.len()).collect();
            let x_m = |target: usize| problem.periods[span.period_index].in_ref[target].mean.x_m();
            order.sort_by(|a, b| x_m(*a).total_cmp(&x_m(*b)));
            let given = prepared.nodes[span.nodes.clone()].to_vec();
            for (node, target) in prepared.nodes[span.nodes.clone()].iter_mut().zip(order) {
                *node = given[target];
            }
        }
        prepared
    }

    /// Evenly spread ones of the node's points, about `node_count`, with the periods that hold them;
    /// `None` where that would be more than half of all.
    pub(super) fn thinned(&self, node_count: usize) -> Option<Self> {
        let stride = self.nodes.len() / node_count.max(1);
        if stride < 2 {
            return None;
        }
        let mut thin = Self::empty([0; 2], 0);
        let mut next = stride / 2;
        for span in self.spans.iter() {
            let (ref_start, node_start) = (thin.refs.len(), thin.nodes.len());
            while next < span.nodes.end {
                thin.nodes.push(self.nodes[next]);
                next += stride;
            }
            let nodes = node_start..thin.nodes.len();
            if !nodes.is_empty() {
                thin.refs.extend_from_slice(&self.refs[span.refs.clone()]);
                let refs = ref_start..thin.refs.len();
                thin.spans.push(Span { period_index: span.period_index, refs, nodes });
            }
        }
        Some(Self {
            area_m2: self.area_m2,
            node_center_m: self.node_center_m,
            node_spread_m: self.node_spread_m,
            typical_sigma_m: self.typical_sigma_m,
            half_depth_sigma_m: self.half_depth_sigma_m,
            smallest_root_det_m2: self.smallest_root_det_m2,
            largest_variance_m2: self.largest_variance_m2,
            ..thin
        })
    }

    fn empty([ref_count, node_count]: [usize; 2], period_count: usize) -> Self {
        Self {
            refs: Vec::with_capacity(ref_count),
            nodes: Vec::with_capacity(node_count),
            spans: Vec::with_capacity(period_count),
            ignored_count: 0,
            area_m2: 1.0,
            node_center_m: Vector2::zeros(),
            node_spread_m: 0.0,
            typical_sigma_m: 0.0,
            half_depth_sigma_m: [0.0; 2],
            smallest_root_det_m2: 0.0,
            largest_variance_m2: 0.0,
        }
    }

    fn measure(&mut self) {
        if self.spans.is_empty() {
            return;
        }
        let [of_refs, of_nodes] = [&self.refs, &self.nodes]
            .map(|blobs| spread(blobs.iter().map(|blob| Vector2::new(blob.x, blob.y))));
        self.area_m2 = (of_refs.covered_area_m2() * of_nodes.covered_area_m2()).sqrt();
        self.node_center_m = of_nodes.mean_m;
        self.node_spread_m = of_nodes.cov_m2.trace().sqrt();
        self.typical_sigma_m = (mean_variance(&self.refs) + mean_variance(&self.nodes)).sqrt();
        // Minkowski: the root of the determinant is superadditive.
        let (ref_least, ref_most) = extremes(&self.refs);
        let (node_least, node_most) = extremes(&self.nodes);
        self.smallest_root_det_m2 = ref_least.sqrt() + node_least.sqrt();
        self.largest_variance_m2 = ref_most + node_most;
    }

    /// The reference's points of a period from the first on that is within `reach_m` of `x`; from
    /// the first of all where they are few.
    pub(super) fn refs_from(&self, span: &Span, x: f64, reach_m: f64) -> Range<usize> {
        let refs = &self.refs[span.refs.clone()];
        let passed =
            if refs.len() <= FEW_POINTS { 0 } else { refs.partition_point(|p| p.x < x - reach_m) };
        span.refs.start + passed..span.refs.end
    }

    /// Where `motion` carries the node's points.
    pub(super) fn place(&self, motion: &Motion) -> Place {
        let (x, y) = motion.turned(self.node_center_m.x, self.node_center_m.y);
        let spread = self.node_spread_m;
        [x + motion.x, y + motion.y, spread * motion.cos, spread * motion.sin]
    }

    /// How far two motions carry the node's points apart, metres.
    pub(super) fn displacement_m(&self, a: &Motion, b: &Motion) -> f64 {
        let (ax, ay) = a.turned(self.node_center_m.x, self.node_center_m.y);
        let (bx, by) = b.turned(self.node_center_m.x, self.node_center_m.y);
        let (dx, dy) = (ax + a.x - bx - b.x, ay + a.y - by - b.y);
        let (dc, ds) = (a.cos - b.cos, a.sin - b.sin);
        (dx * dx + dy * dy).sqrt() + (dc * dc + ds * ds).sqrt() * self.node_spread_m
    }
}

/// Smallest determinant, m⁴, and largest trace, m².
fn extremes(blobs: &[Blob]) -> (f64, f64) {
    blobs.iter().fold((f64::INFINITY, 0.0_f64), |(least, most), b| {
        (least.min(b.xx * b.yy - b.xy * b.xy), most.max(b.xx + b.yy))
    })
}

fn mean_variance(blobs: &[Blob]) -> f64 {
    blobs.iter().map(|b| 0.5 * (b.xx + b.yy)).sum::<f64>() / blobs.len() as f64
}

#[cfg(test)]
mod tests {
    use proto::geom::Point;

    use super::*;
    use crate::simulate::{Conditions, Paths, Sampler, large_room};

    fn gaussian<F: Frame>(x: f64, y: f64, cov: [f64; 3]) -> Gaussian<F> {
        let cov_m2 = Matrix2::new(cov[0], cov[1], cov[1], cov[2]);
        Gaussian { mean: Point::new(x, y), cov_m2 }
    }

    #[test]
    fn unusable_points_and_one_sided_periods_are_left_out() {
        let good = [0.01, 0.002, 0.02];
        let problem = Problem {
            periods: vec![
                Period {
                    in_ref: vec![
                        gaussian(1.0, 2.0, good),
                        gaussian(f64::NAN, 2.0, good),
                        gaussian(1.0, f64::INFINITY, good),
                        gaussian(1.0, 2.0, [0.01, 0.02, 0.01]),
                        gaussian(1.0, 2.0, [-0.01, 0.0, -0.01]),
                    ],
                    in_node: vec![gaussian(0.0, 0.0, good), gaussian(0.0, 0.0, [0.0; 3])],
                    ..Period::default()
                },
                Period { in_ref: vec![gaussian(1.0, 2.0, good)], ..Period::default() },
                Period::default(),
            ],
            ..Problem::default()
        };
        let prepared = Prepared::new(&problem);
        assert_eq!((prepared.refs.len(), prepared.nodes.len()), (1, 1));
        assert_eq!((prepared.spans.len(), prepared.ignored_count), (1, 5));
        assert!(prepared.area_m2.is_finite() && prepared.typical_sigma_m > 0.0);
    }

    #[test]
    fn the_flat_motion_is_the_typed_one() {
        for heading in [-3.0, -0.4, 0.0, 1.1, 2.9] {
            let motion = Motion::new(1.0, -2.0, heading);
            let point = gaussian::<Node>(3.0, 0.5, [0.04, 0.01, 0.02]);
            let moved = motion.apply(&Blob::usable(&point, 0.0).unwrap());
            let expected = motion.pose() * point;
            let found = Matrix2::new(moved.xx, moved.xy, moved.xy, moved.yy);
            assert!((found - expected.cov_m2).norm() < 1e-15);
            let position = Vector2::new(moved.x, moved.y);
            assert!((position - expected.mean.coords_m).norm() < 1e-14);
        }
    }

    #[test]
    fn thinned_points_are_evenly_spread_and_keep_their_periods() {
        let data = Prepared::new(&large_room(3, 40).problem);
        let thin = data.thinned(25).unwrap();
        assert!((20..=30).contains(&thin.nodes.len()), "{}", thin.nodes.len());
        assert!(data.thinned(data.nodes.len() / 2 + 1).is_none());
        let bits = |blob: &Blob| (blob.x.to_bits(), blob.y.to_bits());
        for span in &thin.spans {
            let mut same = data.spans.iter().filter(|one| one.period_index == span.period_index);
            let whole = same.next().unwrap();
            let refs = thin.refs[span.refs.clone()].iter().map(bits);
            assert!(refs.eq(data.refs[whole.refs.clone()].iter().map(bits)));
            for node in &thin.nodes[span.nodes.clone()] {
                let mut given = data.nodes[whole.nodes.clone()].iter().map(bits);
                assert!(given.any(|one| one == bits(node)));
            }
        }
        let covered = thin.spans.last().unwrap().period_index - thin.spans[0].period_index;
        assert!(covered > 30, "{covered}");
    }

    #[test]
    fn no_point_within_reach_is_passed_over() {
        let scene = Paths::from([vec![Vector2::new(3.0, 4.0); 12]]);
        let mut case = Sampler::new(2).observe(&scene, &Conditions::CLEAN);
        for (index, point) in case.problem.periods[0].in_ref.iter_mut().enumerate() {
            point.mean.coords_m.x = (index * 5 % 12) as f64;
        }
        let data = Prepared::new(&case.problem);
        let span = &data.spans[0];
        for (x, reach_m) in [(3.2, 1.5), (-9.0, 1.0), (40.0, 3.0), (5.0, 100.0)] {
            let passed = span.refs.start..data.refs_from(span, x, reach_m).start;
            assert!(data.refs[passed.clone()].iter().all(|point| point.x < x - reach_m));
            let expected = (0..12).filter(|at| f64::from(*at) < x - reach_m).count();
            assert_eq!(passed.len(), expected, "{x}");
        }
    }
}
