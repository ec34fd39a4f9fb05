//! A registration problem laid out for fast evaluation: usable points only, in flat arrays.

use std::ops::Range;

use nalgebra::{Matrix2, Vector2, Vector3};
use proto::geom::{Frame, Gaussian, Node, Ref, Se2};
use proto::measured::line_of_sight;

use super::Problem;

/// Points farther out are no radar measurement; their squares would cost digits.
const MAX_COORDINATE_M: f64 = 1e5;

/// Smallest determinant of a usable covariance, m⁴: (0.1 mm)⁴. Below it weights would overflow.
const MIN_DETERMINANT_M4: f64 = 1e-16;

/// A uniform rectangle's area over the root of its covariance's determinant.
const AREA_OF_RECTANGLE: f64 = 12.0;

/// Added to the spread of points, so that points on a line still cover an area.
const MIN_SPREAD_M: f64 = 0.5;

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
        let (mean, cov) = (point.mean.coords_m, &widened(point, half_depth_sigma_m));
        let xy = 0.5 * (cov[(0, 1)] + cov[(1, 0)]);
        let blob = Self { x: mean.x, y: mean.y, xx: cov[(0, 0)], xy, yy: cov[(1, 1)] };
        let near = mean.x.abs() < MAX_COORDINATE_M && mean.y.abs() < MAX_COORDINATE_M;
        let trace = blob.xx + blob.yy;
        let definite = blob.xx > 0.0 && blob.xx * blob.yy - xy * xy > MIN_DETERMINANT_M4;
        (near && definite && trace < MAX_COORDINATE_M).then_some(blob)
    }
}

fn usable<F: Frame>(points: &[Gaussian<F>], half_depth_sigma_m: f64) -> Vec<Blob> {
    points.iter().filter_map(|point| Blob::usable(point, half_depth_sigma_m)).collect()
}

/// The covariance with `σ²` added along the line of sight.
fn widened<F: Frame>(point: &Gaussian<F>, half_depth_sigma_m: f64) -> Matrix2<f64> {
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
}

/// All periods with usable points on both sides.
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
}

impl Prepared {
    pub(super) fn new(problem: &Problem) -> Self {
        let mut prepared = Self::empty();
        for (period_index, period) in problem.periods.iter().enumerate() {
            let refs = usable(&period.in_ref, problem.ref_half_depth_sigma_m);
            let nodes = usable(&period.in_node, problem.node_half_depth_sigma_m);
            prepared.ignored_count += period.in_ref.len() - refs.len();
            prepared.ignored_count += period.in_node.len() - nodes.len();
            if refs.is_empty() || nodes.is_empty() {
                continue;
            }
            let (ref_start, node_start) = (prepared.refs.len(), prepared.nodes.len());
            prepared.refs.extend(refs);
            prepared.nodes.extend(nodes);
            let span = Span {
                period_index,
                refs: ref_start..prepared.refs.len(),
                nodes: node_start..prepared.nodes.len(),
            };
            prepared.spans.push(span);
        }
        prepared.measure();
        prepared
    }

    fn empty() -> Self {
        Self {
            refs: Vec::new(),
            nodes: Vec::new(),
            spans: Vec::new(),
            ignored_count: 0,
            area_m2: 1.0,
            node_center_m: Vector2::zeros(),
            node_spread_m: 0.0,
            typical_sigma_m: 0.0,
        }
    }

    fn measure(&mut self) {
        if self.spans.is_empty() {
            return;
        }
        let (_, ref_spread) = spread(&self.refs);
        let (center, node_spread) = spread(&self.nodes);
        self.area_m2 = (covered_area_m2(&ref_spread) * covered_area_m2(&node_spread)).sqrt();
        self.node_center_m = center;
        self.node_spread_m = node_spread.trace().sqrt();
        self.typical_sigma_m = (mean_variance(&self.refs) + mean_variance(&self.nodes)).sqrt();
    }

    /// How far two motions carry the node's points apart, metres.
    pub(super) fn displacement_m(&self, a: &Motion, b: &Motion) -> f64 {
        let (ax, ay) = a.turned(self.node_center_m.x, self.node_center_m.y);
        let (bx, by) = b.turned(self.node_center_m.x, self.node_center_m.y);
        let shift = (ax + a.x - bx - b.x).hypot(ay + a.y - by - b.y);
        let chord = (a.cos - b.cos).hypot(a.sin - b.sin);
        shift + chord * self.node_spread_m
    }
}

fn spread(blobs: &[Blob]) -> (Vector2<f64>, Matrix2<f64>) {
    let count = blobs.len() as f64;
    let mean = blobs.iter().map(|b| Vector2::new(b.x, b.y)).sum::<Vector2<f64>>() / count;
    let scatter = blobs.iter().map(|b| {
        let offset = Vector2::new(b.x, b.y) - mean;
        offset * offset.transpose()
    });
    (mean, scatter.sum::<Matrix2<f64>>() / count)
}

fn covered_area_m2(scatter: &Matrix2<f64>) -> f64 {
    let padded = scatter + Matrix2::identity() * MIN_SPREAD_M.powi(2);
    AREA_OF_RECTANGLE * padded.determinant().max(0.0).sqrt()
}

fn mean_variance(blobs: &[Blob]) -> f64 {
    blobs.iter().map(|b| 0.5 * (b.xx + b.yy)).sum::<f64>() / blobs.len() as f64
}

#[cfg(test)]
mod tests {
    use proto::geom::Point;

    use super::super::Period;
    use super::*;

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
}
