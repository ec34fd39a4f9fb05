//! The small correction of one node's pose that makes its points meet another's, and how
//! significant it is.
//!
//! Both nodes' points are mapped into `Ref` by the poses in force. For a point of the one at `z_i`
//! and of the other at `z_j`, with the other node's origin at `t_j`, a correction
//! `c = (x_m, y_m, heading_rad)` of the other's pose predicts
//! `z_i − z_j = J c + u_j h_j − u_i h_i + e`, `J = [I, (z_j − t_j)^⊥]`, with the lines of sight `u`,
//! lasting offsets `h` along them and `e` of the points' covariances. Which points are the same
//! target is soft: `p = N(r) / (ν + Σ N(r))` with the density `ν` of points that have no partner,
//! found by climbing from covariances widened to the gate to the stated ones.
//!
//! Points of a target that hardly moves tell the same thing again: with `n` of them in a cell each
//! counts `1 / (1 + 0.4 (n − 1))`. Between pairs of simulated nodes, the whitened differences of a
//! walking person's points correlate by 0.3 to 0.5 within half a metre or a second, and not beyond.
//! What still repeats enters as a factor on the information,
//! which the caller learns from quiet times.

use nalgebra::{Matrix2, Matrix2x5, Matrix3, Matrix5, Vector2, Vector3, Vector5};
use proto::geom::point_by_pose;

/// Density of points without a partner, per m²: a false point or a second target in 20 m².
const STRAY_DENSITY_PER_M2: f64 = 0.05;
/// Standard deviations, metres, by which covariances are widened while climbing, and how often.
const WIDENING_M: [f64; 4] = [0.4, 0.2, 0.1, 0.0];
const CLIMB_COUNT: usize = 3;
/// A correction is believed to be of this size, metres and radians, before the data speak: it only
/// keeps the climb regular.
const PRIOR_M: f64 = 1.0;
const PRIOR_RAD: f64 = 0.35;
/// Side, metres, of the cells within which points repeat each other, and by how much.
const CELL_M: f64 = 0.6;
const REPETITION: f64 = 0.4;
/// Of a correction.
const DEGREES_OF_FREEDOM: f64 = 3.0;
/// Factor on the covariance of the poses in force: they follow the newest points too.
const POSE_DOUBT: f64 = 4.0;
/// Smallest standard deviation of a pose, metres and radians.
const MIN_POSE_SIGMA: f64 = 1e-3;
/// Smallest standard deviation of a lasting offset, metres: zero has no inverse.
const MIN_OFFSET_SIGMA_M: f64 = 1e-4;

/// A point of one node and one of the other that may be the same target.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    /// `z_i − z_j` in `Ref`, metres.
    pub(super) between_m: Vector2<f64>,
    /// `z_j − t_j`.
    pub(super) arm_m: Vector2<f64>,
    /// `u_j` and `u_i`.
    pub(super) sights: [Vector2<f64>; 2],
    /// Covariance of the difference without lasting offsets.
    pub(super) cov_m2: Matrix2<f64>,
}

/// The candidates of one point of the other node in one period.
#[derive(Clone, Debug)]
pub(super) struct Sighted {
    /// The period.
    pub(super) period: i64,
    /// `z_j`.
    pub(super) at_m: Vector2<f64>,
    /// Whom it may have met.
    pub(super) candidates: Vec<Candidate>,
}

/// What is known of `(x_m, y_m, heading_rad, h_j, h_i)` before the points that are looked at.
#[derive(Clone, Copy, Debug)]
pub(super) struct Prior {
    /// Its expectation.
    pub(super) expected: Vector5<f64>,
    /// Its information.
    pub(super) information: Matrix5<f64>,
    /// By how much the points' errors count more than stated, because they last.
    pub(super) inflation: f64,
}

impl Sums {
    /// Adds a candidate that counts `weight`; one without a usable covariance counts nothing.
    fn add(&mut self, two: &Candidate, weight: f64) {
        let Some(inverse) = two.cov_m2.try_inverse() else { return };
        let full = full_jacobian(two);
        let weighted = full.transpose() * inverse * weight;
        self.information += weighted * full;
        self.score += weighted * two.between_m;
    }
}

impl Prior {
    /// What the poses in force and the statements about half depths say: no correction, with the
    /// covariance `pose` of the relative pose.
    pub(super) fn of_poses(pose: &Matrix3<f64>, offset_sigma_m: [f64; 2], inflation: f64) -> Self {
        // The reference and a stated pose may be known exactly: a millimetre keeps this regular.
        let pose = pose * POSE_DOUBT + Matrix3::identity() * MIN_POSE_SIGMA.powi(2);
        let mut information = offset_information(offset_sigma_m);
        let of_pose = pose.try_inverse().unwrap_or_else(Matrix3::zeros);
        information.fixed_view_mut::<3, 3>(0, 0).copy_from(&of_pose);
        Self { expected: Vector5::zeros(), information, inflation }
    }

    /// The same, knowing what older points say too.
    pub(super) fn after(self, older: &Weighted<'_>) -> Option<Self> {
        let sums = older.sums(&older.climb()?, 0.0);
        let information = self.information + sums.information / self.inflation;
        let score = self.information * self.expected + sums.score / self.inflation;
        let expected = information.cholesky()?.solve(&score);
        Some(Self { expected, information, ..self })
    }

    /// The expected correction of the pose.
    pub(super) fn correction(&self) -> Vector3<f64> {
        self.expected.fixed_rows::<3>(0).into_owned()
    }
}

/// What the points say of a change since what was expected.
#[derive(Clone, Copy, Debug)]
pub(super) struct Correction {
    /// The squared change from the expected one in units of its uncertainty.
    pub(super) change: f64,
    /// `S` of the change, scaled down where the likelihood gains less than the change promises.
    pub(super) information: Matrix3<f64>,
    /// `s`, scaled alike.
    pub(super) score: Vector3<f64>,
}

/// Every point with its weight against repetition.
pub(super) struct Weighted<'a> {
    seen: &'a [Sighted],
    weights: Vec<f64>,
    offset_sigma_m: [f64; 2],
}

struct Sums {
    information: Matrix5<f64>,
    score: Vector5<f64>,
}

impl<'a> Weighted<'a> {
    pub(super) fn new(seen: &'a [Sighted], offset_sigma_m: [f64; 2]) -> Self {
        let cell = |at_m: &Vector2<f64>| at_m.map(|value| (value / CELL_M).round());
        let cells: Vec<Vector2<f64>> = seen.iter().map(|one| cell(&one.at_m)).collect();
        let near = |one: &Vector2<f64>| {
            cells.iter().filter(|other| (*other - one).amax() < 0.5).count() as f64
        };
        let weights = cells.iter().map(|one| 1.0 / (1.0 + REPETITION * (near(one) - 1.0)));
        Self { seen, weights: weights.collect(), offset_sigma_m }
    }

    /// The best correction; `None` without points that meet.
    ///
    /// With `θ` the pose's correction and the offsets of before, known to `Λ` around `m`, and a
    /// change `δ` of the pose since, the points say `g = M (θ + B δ)` with information `M / κ`.
    /// Without `θ`: `S = Bᵀ(M/κ − M/κ A⁻¹ M/κ) B`, `A = Λ + M/κ`,
    /// `s = Bᵀ(g/κ − M/κ A⁻¹ (Λ m + g/κ))`, and `sᵀ S⁻¹ s` is the chi-square of `δ`.
    pub(super) fn fit(&self, prior: &Prior) -> Option<Correction> {
        let value = self.climb()?;
        let sums = self.sums(&value, 0.0);
        let (said, score) = (sums.information / prior.inflation, sums.score / prior.inflation);
        let both = (prior.information + said).cholesky()?;
        let reduced = said - said * both.solve(&said);
        let left = score - said * both.solve(&(prior.information * prior.expected + score));
        let information = reduced.fixed_view::<3, 3>(0, 0).into_owned();
        let left = left.fixed_rows::<3>(0).into_owned();
        let covariance = (information + prior_information()).try_inverse()?;
        let change = left.dot(&(covariance * left));
        let before = prior.correction();
        let gains = self.gains(&value, &before);
        let gain = 2.0 * gains.map(|(_, gain)| gain).sum::<f64>() / prior.inflation;
        // By chance alone both are of the order of the degrees of freedom.
        let kept = ((gain + DEGREES_OF_FREEDOM) / (change + DEGREES_OF_FREEDOM)).clamp(0.0, 1.0);
        Some(Correction { change, information: information * kept, score: left * kept })
    }

    /// The correction of the pose with the highest likelihood near none.
    fn climb(&self) -> Option<Vector3<f64>> {
        let mut value = Vector3::zeros();
        for widening_m in WIDENING_M {
            for _ in 0..CLIMB_COUNT {
                let sums = self.sums(&value, widening_m.powi(2));
                value = climbed(&sums, &offset_information(self.offset_sigma_m))?;
            }
        }
        Some(value)
    }

    /// By how much each point's log likelihood grows from one correction to another, oldest first.
    pub(super) fn gains(
        &self,
        value: &Vector3<f64>,
        from: &Vector3<f64>,
    ) -> impl Iterator<Item = (i64, f64)> {
        let gain = move |one: &Sighted| self.level(one, value) - self.level(one, from);
        self.seen.iter().zip(&self.weights).map(move |(one, w)| (one.period, w * gain(one)))
    }

    /// Log likelihood of one point.
    fn level(&self, one: &Sighted, value: &Vector3<f64>) -> f64 {
        let densities = one.candidates.iter().map(|two| self.density(two, value, 0.0));
        (STRAY_DENSITY_PER_M2 + densities.sum::<f64>()).ln()
    }

    /// The covariance of a difference with lasting offsets and widening.
    fn spread(&self, two: &Candidate, widening_m2: f64) -> Matrix2<f64> {
        let mut cov_m2 = two.cov_m2 + Matrix2::identity() * widening_m2;
        for (sight, sigma_m) in two.sights.iter().zip(self.offset_sigma_m) {
            cov_m2 += sight * sight.transpose() * sigma_m.powi(2);
        }
        cov_m2
    }

    fn density(&self, two: &Candidate, value: &Vector3<f64>, widening_m2: f64) -> f64 {
        let spread = self.spread(two, widening_m2);
        let residual = two.between_m - point_by_pose(&two.arm_m) * value;
        let determinant = spread.determinant();
        let Some(inverse) = spread.try_inverse() else { return 0.0 };
        let square = residual.dot(&(inverse * residual));
        (-0.5 * square).exp() / (std::f64::consts::TAU * determinant.sqrt())
    }

    /// Information and score about `(x, y, heading, h_j, h_i)`, linear around no correction, with
    /// the memberships that `value` gives.
    fn sums(&self, value: &Vector3<f64>, widening_m2: f64) -> Sums {
        let mut sums = Sums { information: Matrix5::zeros(), score: Vector5::zeros() };
        for (one, weight) in self.seen.iter().zip(&self.weights) {
            let density = |two: &Candidate| self.density(two, value, widening_m2);
            let densities: Vec<f64> = one.candidates.iter().map(density).collect();
            let all = STRAY_DENSITY_PER_M2 + densities.iter().sum::<f64>();
            for (two, part) in one.candidates.iter().zip(densities) {
                sums.add(two, weight * part / all);
            }
        }
        sums
    }
}

/// The correction at the top of the quadratic that the sums describe.
fn climbed(sums: &Sums, offsets: &Matrix5<f64>) -> Option<Vector3<f64>> {
    let mut information = sums.information + offsets;
    let mut of_pose = information.fixed_view_mut::<3, 3>(0, 0);
    of_pose += prior_information();
    let top = information.cholesky()?.solve(&sums.score);
    Some(top.fixed_rows::<3>(0).into_owned())
}

/// What keeps a correction of which the points say nothing regular.
fn prior_information() -> Matrix3<f64> {
    Matrix3::from_diagonal(&Vector3::new(PRIOR_M, PRIOR_M, PRIOR_RAD).map(|sigma| sigma.powi(-2)))
}

/// What is known of the lasting offsets.
fn offset_information(sigmas_m: [f64; 2]) -> Matrix5<f64> {
    let mut information = Matrix5::zeros();
    for (index, sigma_m) in sigmas_m.into_iter().enumerate() {
        information[(3 + index, 3 + index)] = sigma_m.max(MIN_OFFSET_SIGMA_M).powi(-2);
    }
    information
}

fn full_jacobian(two: &Candidate) -> Matrix2x5<f64> {
    let [own, other] = two.sights;
    let mut full = Matrix2x5::zeros();
    full.fixed_view_mut::<2, 3>(0, 0).copy_from(&point_by_pose(&two.arm_m));
    full.set_column(3, &own);
    full.set_column(4, &-other);
    full
}
