//! How good a solver's answers are over many trials.

use fusion_center::registration::{Outcome, PoseEstimate, Solution};
use nalgebra::{Matrix3, Vector3};
use proto::geom::squared_length;
use serde::Serialize;

use super::statistics::{Distribution, Proportion};
use super::trials::Case;

/// The paper's box \[registration, section 3\].
pub(super) const BOX_POSITION_M: f64 = 0.05;
/// See [`BOX_POSITION_M`].
pub(super) const BOX_ANGLE_DEG: f64 = 1.0;
/// Errors beyond either of these are no imprecision but another pose.
const GROSS_POSITION_M: f64 = 1.0;
const GROSS_ANGLE_DEG: f64 = 15.0;

/// How far a pose is from the true one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct PoseError {
    pub(super) position_m: f64,
    /// Without sign.
    pub(super) angle_deg: f64,
}

impl PoseError {
    /// Of the errors `(x_m, y_m, heading_rad)`.
    pub(super) fn of(error: &Vector3<f64>) -> Self {
        Self { position_m: error.x.hypot(error.y), angle_deg: error.z.abs().to_degrees() }
    }

    /// Whether it is in the paper's box.
    pub(super) fn is_in_box(&self) -> bool {
        self.position_m < BOX_POSITION_M && self.angle_deg < BOX_ANGLE_DEG
    }

    fn is_gross(&self) -> bool {
        GROSS_POSITION_M < self.position_m || GROSS_ANGLE_DEG < self.angle_deg
    }
}

/// One trial's result.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct TrialScore {
    /// Whether the solver called the pose determined: a centre publishes no other.
    pub(super) is_determined: bool,
    /// `None` where the solver named no pose.
    pub(super) error: Option<PoseError>,
    /// Squared error in units of the stated covariance; 3 on average if that is true.
    pub(super) normalised_error: Option<f64>,
    /// Squared errors of position, m², and heading, rad².
    #[serde(skip)]
    squares: [f64; 2],
    /// The bound's variances of the same.
    #[serde(skip)]
    bound: Option<[f64; 2]>,
}

impl TrialScore {
    pub(super) fn new(case: &Case, solution: &Solution) -> Self {
        let error = solution.estimate.map(|estimate| difference(case, &estimate));
        let normalised = solution
            .estimate
            .zip(error)
            .and_then(|(estimate, error)| squared_length(&error, &estimate.covariance));
        let parts = |m: &Matrix3<f64>| [m[(0, 0)] + m[(1, 1)], m[(2, 2)]];
        Self {
            is_determined: solution.outcome == Outcome::Determined,
            error: error.map(|error| PoseError::of(&error)),
            normalised_error: normalised,
            squares: error.map_or([0.0; 2], |e| [e.x * e.x + e.y * e.y, e.z * e.z]),
            bound: case.bound.as_ref().map(parts),
        }
    }
}

/// Estimate less truth, `(x_m, y_m, heading_rad)`.
fn difference(case: &Case, estimate: &PoseEstimate) -> Vector3<f64> {
    estimate.pose_ref_from_node.minus(&case.truth)
}

/// A share of trials with an error of at most `limit`.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct CurvePoint {
    /// Metres or degrees.
    pub(super) limit: f64,
    /// How many trials do not exceed it.
    pub(super) at_most: Proportion,
}

/// Errors of one kind over all trials.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Spread {
    /// Over the trials with an estimate.
    pub(super) mean: Option<f64>,
    /// Half of all trials do not exceed it.
    pub(super) median: Option<f64>,
    /// 95 % of all trials do not exceed it.
    pub(super) p95: Option<f64>,
    /// The cumulative curve at evenly spaced limits.
    pub(super) curve: Vec<CurvePoint>,
}

/// Limits of a curve besides 0.
const CURVE_POINT_COUNT: u32 = 120;

impl Spread {
    fn new(errors: &Distribution, reach: f64) -> Self {
        let point = |index: u32| {
            let limit = reach * f64::from(index) / f64::from(CURVE_POINT_COUNT);
            CurvePoint { limit, at_most: errors.at_most(limit) }
        };
        Self {
            mean: errors.mean(),
            median: errors.quantile(0.5),
            p95: errors.quantile(0.95),
            curve: (0..=CURVE_POINT_COUNT).map(point).collect(),
        }
    }
}

/// Up to where curves are drawn.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct Reach {
    pub(super) position_m: f64,
    pub(super) angle_deg: f64,
}

/// All trials of one solver under one condition, or what the bound allows.
#[derive(Clone, Debug, Serialize)]
pub(super) struct MethodScore {
    /// The solver's name, or `bound`.
    pub(super) method: String,
    /// Trials in the paper's box.
    pub(super) in_box: Proportion,
    /// Trials whose pose was called determined.
    pub(super) determined: Option<Proportion>,
    /// Of these, those in the box.
    pub(super) in_box_of_determined: Option<Proportion>,
    /// Of these, those that are another pose altogether: beyond 1 m or 15 degrees.
    pub(super) gross_of_determined: Option<Proportion>,
    pub(super) position_m: Spread,
    pub(super) angle_deg: Spread,
    /// Root mean square error of the determined trials over the bound's, position and heading;
    /// where a bound is known.
    pub(super) rmse_over_bound: Option<[f64; 2]>,
    /// Mean squared error of the determined trials in units of the stated covariance; 3 if true.
    pub(super) mean_normalised_error: Option<f64>,
    /// Processor time of a solve, milliseconds. The one figure that differs from run to run.
    pub(super) solve_ms: Option<f64>,
    /// Trial by trial.
    pub(super) trials: Vec<TrialScore>,
}

impl MethodScore {
    /// The score of a solver.
    pub(super) fn of_solver(
        method: &str,
        trials: Vec<TrialScore>,
        solve_ms: f64,
        reach: Reach,
    ) -> Self {
        let errors: Vec<Option<PoseError>> = trials.iter().map(|trial| trial.error).collect();
        let determined: Vec<TrialScore> =
            trials.iter().filter(|trial| trial.is_determined).copied().collect();
        let count_of = |is_so: fn(&PoseError) -> bool| {
            Some(Proportion::count_of(&determined, |trial| trial.error.as_ref().is_some_and(is_so)))
        };
        Self {
            determined: Some(Proportion::new(determined.len(), trials.len())),
            in_box_of_determined: count_of(PoseError::is_in_box),
            gross_of_determined: count_of(PoseError::is_gross),
            rmse_over_bound: rmse_over_bound(&determined),
            mean_normalised_error: mean(determined.iter().filter_map(|t| t.normalised_error)),
            solve_ms: Some(solve_ms),
            trials,
            ..Self::of_errors(method, &errors, reach)
        }
    }

    /// The score of the bound: errors that an efficient estimator would have made, as many for each
    /// trial; `None` where a trial's data allow no pose.
    pub(super) fn of_errors(method: &str, errors: &[Option<PoseError>], reach: Reach) -> Self {
        let known = || errors.iter().flatten();
        let positions = Distribution::new(known().map(|error| error.position_m), errors.len());
        let angles = Distribution::new(known().map(|error| error.angle_deg), errors.len());
        Self {
            method: method.to_owned(),
            in_box: Proportion::count_of(errors, |e| e.as_ref().is_some_and(PoseError::is_in_box)),
            determined: None,
            in_box_of_determined: None,
            gross_of_determined: None,
            position_m: Spread::new(&positions, reach.position_m),
            angle_deg: Spread::new(&angles, reach.angle_deg),
            rmse_over_bound: None,
            mean_normalised_error: None,
            solve_ms: None,
            trials: Vec::new(),
        }
    }
}

fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (mut sum, mut count) = (0.0, 0.0);
    for value in values {
        sum += value;
        count += 1.0;
    }
    (0.0 < count).then(|| sum / count)
}

/// `sqrt(Σ error² / Σ bound's variance)` of position and heading.
fn rmse_over_bound(trials: &[TrialScore]) -> Option<[f64; 2]> {
    let bounded = || trials.iter().filter_map(|trial| Some((trial.squares, trial.bound?)));
    bounded().next()?;
    Some([0, 1].map(|part| {
        let squares: f64 = bounded().map(|(squares, _)| squares[part]).sum();
        let variances: f64 = bounded().map(|(_, bound)| bound[part]).sum();
        (squares / variances).sqrt()
    }))
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use fusion_center::registration::{Evidence, Known, Missing, Problem};
    use proto::geom::Se2;

    use super::*;

    const REACH: Reach = Reach { position_m: 0.1, angle_deg: 2.0 };

    fn case() -> Case {
        let bound = Matrix3::from_diagonal(&Vector3::new(1e-4, 3e-4, 4e-4));
        Case {
            problem: Problem::default(),
            truth: Se2::new(1.0, 2.0, PI - 0.01),
            bound: Some(bound),
        }
    }

    fn solution(pose: Option<[f64; 3]>, outcome: Outcome) -> Solution {
        let estimate = pose.map(|[x, y, heading]| PoseEstimate {
            pose_ref_from_node: Se2::new(x, y, heading),
            covariance: Matrix3::from_diagonal(&Vector3::new(1e-4, 1e-4, 1e-4)),
        });
        Solution { estimate, outcome, evidence: Evidence::default(), known: Known::default() }
    }

    #[test]
    fn a_solution_is_scored_against_truth_covariance_and_bound() {
        // 0.03 m and 0.04 m away, the heading across the half turn by 0.02 rad.
        let found = solution(Some([1.03, 2.04, -PI + 0.01]), Outcome::Determined);
        let score = TrialScore::new(&case(), &found);
        let error = score.error.unwrap();
        assert!((error.position_m - 0.05).abs() < 1e-12);
        assert!((error.angle_deg - 0.02_f64.to_degrees()).abs() < 1e-9);
        assert!((score.normalised_error.unwrap() - 29.0).abs() < 1e-9);
        let method = MethodScore::of_solver("m", vec![score], 1.0, REACH);
        let [position, heading] = method.rmse_over_bound.unwrap();
        assert!((position - 2.5).abs() < 1e-9 && (heading - 1.0).abs() < 1e-9);
        assert_eq!(method.in_box.count, 0);
    }

    #[test]
    fn refusals_count_against_the_box_but_not_among_the_determined() {
        let missing = Missing::SharedPeriods { period_count: 0 };
        let refused = solution(None, Outcome::Underdetermined { missing });
        let unsure = solution(Some([9.0, 2.0, PI]), Outcome::Ambiguous { rivals: Vec::new() });
        let good = solution(Some([1.01, 2.0, PI - 0.01]), Outcome::Determined);
        let wrong = solution(Some([-9.0, 2.0, PI]), Outcome::Determined);
        let scores = [&refused, &unsure, &good, &wrong].map(|s| TrialScore::new(&case(), s));
        let method = MethodScore::of_solver("m", scores.to_vec(), 1.0, REACH);
        let counts = |p: Proportion| (p.count, p.of);
        assert_eq!(counts(method.in_box), (1, 4));
        assert_eq!(counts(method.determined.unwrap()), (2, 4));
        assert_eq!(counts(method.in_box_of_determined.unwrap()), (1, 2));
        assert_eq!(counts(method.gross_of_determined.unwrap()), (1, 2));
        let last = method.position_m.curve.last().unwrap();
        assert!((last.limit - REACH.position_m).abs() < 1e-12);
        assert_eq!(counts(last.at_most), (1, 4));
    }
}
