//! Simulated registration problems at the level of points: the two-node scene of \[registration\],
//! larger rooms, each with its truth and its Cramér-Rao bound.

use std::f64::consts::PI;

use nalgebra::{Cholesky, Matrix2, Matrix3, Vector2, Vector3};
use proto::geom::{Frame, Gaussian, Node, Point, Ref, Se2, World, point_by_pose};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;

use crate::registration::{Period, PoseEstimate, Problem};

/// Side of the square in which false points lie.
const AREA_SIDE_M: f64 = 10.0;

/// How a trial is drawn. Noise: range σ = s U(0.02, 0.04) m, cross-range σ = s max(r, 0.5 m)
/// U(0.01, 0.02).
#[derive(Clone, Copy, Debug)]
pub struct Conditions {
    /// Chance that a node sees a target in a period.
    pub detection_probability: f64,
    /// Chance of one false point per node and period.
    pub false_probability: f64,
    /// s.
    pub noise_scale: f64,
    /// Time between periods, seconds.
    pub period_s: f64,
}

impl Conditions {
    /// No misses, no false points.
    pub const CLEAN: Self = Self {
        detection_probability: 1.0,
        false_probability: 0.0,
        noise_scale: 0.35,
        period_s: 1.0,
    };
    /// One target in five missed.
    pub const MISSES: Self = Self { detection_probability: 0.8, ..Self::CLEAN };
    /// As [`Self::MISSES`], and a false point in one of ten periods.
    pub const WITH_FALSE_POINTS: Self = Self { false_probability: 0.1, ..Self::MISSES };
}

/// A problem, its truth, and the Cramér-Rao bound of its true pairs.
pub struct Trial {
    /// What the solver gets.
    pub problem: Problem,
    /// The truth.
    pub pose_ref_from_node: Se2<Ref, Node>,
    information: Matrix3<f64>,
}

impl Trial {
    /// `(x_m, y_m, heading_rad)`.
    #[must_use]
    pub fn truth(&self) -> Vector3<f64> {
        self.pose_ref_from_node.numbers()
    }

    /// Estimate less truth, `(x_m, y_m, heading_rad)`.
    #[must_use]
    pub fn error(&self, estimate: &PoseEstimate) -> Vector3<f64> {
        estimate.pose_ref_from_node.minus(&self.pose_ref_from_node)
    }

    /// Squared error in units of the stated covariance; infinite where that is singular.
    #[must_use]
    pub fn nees(&self, estimate: &PoseEstimate) -> f64 {
        let error = self.error(estimate);
        let factor = Cholesky::new(estimate.covariance);
        factor.map_or(f64::INFINITY, |factor| error.dot(&factor.solve(&error)))
    }

    /// The bound's covariance, if the true pairs allow any.
    #[must_use]
    pub fn bound(&self) -> Option<Matrix3<f64>> {
        Cholesky::new(self.information).map(|factor| factor.inverse())
    }
}

/// The scene: where the targets are in every period, in the world.
pub type Paths = Vec<Vec<Vector2<f64>>>;

/// The two targets of the paper over 8 periods.
#[must_use]
pub fn paper_paths() -> Paths {
    line_paths(&[[[2.0, 3.0], [8.0, 8.0]], [[8.0, 2.0], [3.0, 7.0]]], 8)
}

/// Targets that walk straight with constant speed, each from `[x, y]` to `[x, y]`.
#[must_use]
pub fn line_paths(ends: &[[[f64; 2]; 2]], period_count: usize) -> Paths {
    let position = |k: usize, [from, to]: &[[f64; 2]; 2]| {
        let part = k as f64 / (period_count - 1) as f64;
        Vector2::from(*from).lerp(&Vector2::from(*to), part)
    };
    (0..period_count).map(|k| ends.iter().map(|walk| position(k, walk)).collect()).collect()
}

/// Draws measurements of given targets by the nodes at (5, 0) and (0, 5).
pub struct Sampler {
    /// Where everything random comes from.
    pub rng: ChaCha8Rng,
    ref_from_world: Se2<Ref, World>,
    node_from_world: Se2<Node, World>,
}

impl Sampler {
    /// The second node's own frame is turned at random.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let heading = rng.random_range(-PI..PI);
        let world_from_node = Se2::<World, Node>::new(0.0, 5.0, heading);
        let world_from_ref = Se2::<World, Ref>::new(5.0, 0.0, 0.0);
        let (ref_from_world, node_from_world) =
            (world_from_ref.inverse(), world_from_node.inverse());
        Self { rng, ref_from_world, node_from_world }
    }

    /// A draw of the standard normal distribution.
    pub fn normal(&mut self) -> f64 {
        self.rng.sample(StandardNormal)
    }

    fn measure<F: Frame>(&mut self, at: Point<F>, noise_scale: f64) -> Gaussian<F> {
        let range_sigma = noise_scale * self.rng.random_range(0.02..0.04);
        let per_range = noise_scale * self.rng.random_range(0.01..0.02);
        let range_m = at.coords_m.norm();
        let along = at.coords_m / range_m.max(1e-9);
        let across = Vector2::new(-along.y, along.x);
        let noise = along * (range_sigma * self.normal())
            + across * (per_range * range_m.max(0.5) * self.normal());
        let mean = Point::from_coords(at.coords_m + noise);
        let seen = mean.coords_m / mean.coords_m.norm();
        let turn = Matrix2::new(seen.x, -seen.y, seen.y, seen.x);
        let cross_sigma = per_range * mean.coords_m.norm().max(0.5);
        let variances = Vector2::new(range_sigma, cross_sigma).map(|sigma| sigma * sigma);
        let cov_m2 = turn * Matrix2::from_diagonal(&variances) * turn.transpose();
        Gaussian { mean, cov_m2 }
    }

    fn false_point<F: Frame>(&mut self, from_world: Se2<F, World>, scale: f64) -> Gaussian<F> {
        let (x, y) =
            (self.rng.random_range(0.0..AREA_SIDE_M), self.rng.random_range(0.0..AREA_SIDE_M));
        self.measure(from_world * Point::<World>::new(x, y), scale)
    }

    fn maybe<F: Frame>(
        &mut self,
        from_world: Se2<F, World>,
        target: &Vector2<f64>,
        conditions: &Conditions,
    ) -> Option<Gaussian<F>> {
        let seen = self.rng.random::<f64>() < conditions.detection_probability;
        let position = from_world * Point::<World>::from_coords(*target);
        seen.then(|| self.measure(position, conditions.noise_scale))
    }

    /// One trial over the given paths.
    #[must_use]
    pub fn observe(mut self, paths: &Paths, conditions: &Conditions) -> Trial {
        let pose_ref_from_node = self.ref_from_world * self.node_from_world.inverse();
        let mut information = Matrix3::zeros();
        let mut problem = Problem::default();
        for (index, targets) in paths.iter().enumerate() {
            let time_s = conditions.period_s * index as f64;
            let mut period =
                Period { ref_time_s: time_s, node_time_s: time_s, ..Period::default() };
            for target in targets {
                let point = self.maybe(self.ref_from_world, target, conditions);
                let node = self.maybe(self.node_from_world, target, conditions);
                information += pair_information(&pose_ref_from_node, (&point, &node));
                period.in_ref.extend(point);
                period.in_node.extend(node);
            }
            if self.rng.random::<f64>() < conditions.false_probability {
                period.in_ref.push(self.false_point(self.ref_from_world, conditions.noise_scale));
            }
            if self.rng.random::<f64>() < conditions.false_probability {
                period.in_node.push(self.false_point(self.node_from_world, conditions.noise_scale));
            }
            problem.periods.push(period);
        }
        Trial { problem, pose_ref_from_node, information }
    }
}

/// Information of a pair about the pose `(x_m, y_m, heading_rad)`; none where one of the two is
/// missed.
#[must_use]
pub fn pair_information(
    pose: &Se2<Ref, Node>,
    pair: (&Option<Gaussian<Ref>>, &Option<Gaussian<Node>>),
) -> Matrix3<f64> {
    let (Some(point), Some(node)) = pair else { return Matrix3::zeros() };
    let turned = pose.rotation() * node.mean.coords_m;
    let jacobian = point_by_pose(&turned);
    let cov: Matrix2<f64> = point.cov_m2 + (*pose * *node).cov_m2;
    let information = cov.try_inverse().unwrap_or_default();
    jacobian.transpose() * information * jacobian
}

/// The paper's scene.
#[must_use]
pub fn trial(conditions: &Conditions, seed: u64) -> Trial {
    Sampler::new(seed).observe(&paper_paths(), conditions)
}

/// Five targets scattered anew in each of many periods: σ of 5 to 15 cm, 0.3 false points.
#[must_use]
pub fn large_room(seed: u64, period_count: usize) -> Trial {
    scattered(seed, period_count, 5)
}

/// Three people over 30 periods: σ of 5 to 15 cm, misses, 0.3 false points.
#[must_use]
pub fn office(seed: u64) -> Trial {
    scattered(seed, 30, 3)
}

fn scattered(seed: u64, period_count: usize, target_count: usize) -> Trial {
    let mut sampler = Sampler::new(seed);
    let conditions = Conditions {
        detection_probability: 0.9,
        false_probability: 0.3,
        noise_scale: 2.0,
        period_s: 1.0,
    };
    let mut draw = || sampler.rng.random_range(1.0..9.0);
    let paths = (0..period_count)
        .map(|_| (0..target_count).map(|_| Vector2::new(draw(), draw())).collect());
    let paths: Paths = paths.collect();
    sampler.observe(&paths, &conditions)
}
