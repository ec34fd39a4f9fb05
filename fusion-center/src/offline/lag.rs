//! Whether the points of two nodes fit better at other times than the stated ones.
//!
//! A node whose clock is late by `τ` saw a target that walks with velocity `v` at another place than
//! its times say. With `m = Φ z_node + t` of a matched pair and stated times `t_ref`, `t_node`:
//! `z_ref − m + v (t_node − t_ref) = J δ − v τ + noise`, `J = ∂m/∂(x, y, heading)`, `δ` the
//! correction of a pose that took the lag for a shift. `δ` and `τ` are found by weighted least
//! squares, `v` by a line through the middles of the pairs just before and after. Errors that last
//! make neighbours alike, so that the variance of `τ` is the larger of the stated errors' and the one
//! that stretches of some seconds show by their differences (sandwich over clusters). Something else
//! that depends on where a target walks to looks the same if everybody walks the same round only.
//! Cost: one pass over the points.

use nalgebra::{Matrix2, Matrix2x4, Matrix4, Vector2, Vector4};
use proto::geom::{Gaussian, Node, Ref, Se2};

use crate::registration::{Period, Problem};

/// People walk no faster, metres per second: what lies farther on is somebody else.
const MAX_SPEED_MPS: f64 = 2.5;
/// Standard deviations within which points belong together.
const GATE_SIGMAS: f64 = 4.0;
/// A velocity comes from this long before and after, seconds, at least a period each: people hardly
/// turn in it, and a few centimetres of noise leave it good to a tenth of a metre per second.
const HALF_WINDOW_S: f64 = 0.4;
/// Errors of people last for less than this, seconds.
const CLUSTER_S: f64 = 3.0;
/// Fewer such stretches say nothing about their differences.
const MIN_CLUSTER_COUNT: usize = 8;
/// Standard deviations by which a lag must differ from none to be spoken of: 4.5 for chance among many
/// pairs of nodes, and some for the few stretches.
const SIGNIFICANT_SIGMAS: f64 = 6.0;
/// A smaller lag, seconds, moves nobody by more than a radar's range error.
const LEAST_LAG_S: f64 = 0.01;

/// How much later than stated, by the first node's clock, the second seems to have measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Lag {
    /// Seconds; negative for earlier.
    pub(super) lag_s: f64,
    /// Its standard deviation.
    pub(super) sigma_s: f64,
}

impl Lag {
    /// Whether it is worth a word.
    pub(super) fn is_significant(&self) -> bool {
        let size_s = self.lag_s.abs();
        LEAST_LAG_S < size_s && SIGNIFICANT_SIGMAS * self.sigma_s < size_s
    }
}

/// Two points that are one target under the pose.
#[derive(Clone, Copy, Debug)]
struct Pair {
    middle_m: Vector2<f64>,
    /// The reference side's less the node's.
    apart_m: Vector2<f64>,
    /// Derivative of the node's point by the heading.
    by_heading_m: Vector2<f64>,
    information: Matrix2<f64>,
    sigma_m: f64,
    time_s: f64,
    /// The node's time less the reference side's.
    later_s: f64,
}

/// The lag of the node against the reference side under `pose`; `None` where too few walk.
pub(super) fn lag_of(problem: &Problem, pose: &Se2<Ref, Node>) -> Option<Lag> {
    let periods: Vec<Vec<Pair>> =
        problem.periods.iter().map(|period| pairs_of(period, pose)).collect();
    let mut sums = Sums::default();
    for (row, pairs) in periods.iter().enumerate() {
        for pair in pairs {
            sums.start_cluster_at(pair.time_s);
            if let Some(velocity_mps) = velocity(&periods, row, pair) {
                sums.add(pair, &velocity_mps);
            }
        }
    }
    sums.lag()
}

/// Mutual nearest neighbours that are near enough.
fn pairs_of(period: &Period, pose: &Se2<Ref, Node>) -> Vec<Pair> {
    let mapped: Vec<Gaussian<Ref>> = period.in_node.iter().map(|point| *pose * *point).collect();
    let own: Vec<Vector2<f64>> = period.in_ref.iter().map(|point| point.mean.coords_m).collect();
    let their: Vec<Vector2<f64>> = mapped.iter().map(|point| point.mean.coords_m).collect();
    let later_s = period.node_time_s - period.ref_time_s;
    let pair = |(one, other): (usize, usize)| {
        let (first, second) = (&period.in_ref[one], &mapped[other]);
        let apart_m = own[one] - their[other];
        let covariance = first.cov_m2 + second.cov_m2;
        let sigma_m = covariance.trace().sqrt();
        let reach_m = GATE_SIGMAS * sigma_m + MAX_SPEED_MPS * later_s.abs();
        let lever_m = their[other] - pose.translation_m();
        let found = Pair {
            middle_m: (own[one] + their[other]) * 0.5,
            apart_m,
            by_heading_m: Vector2::new(-lever_m.y, lever_m.x),
            information: covariance.try_inverse()?,
            sigma_m,
            time_s: period.ref_time_s,
            later_s,
        };
        (apart_m.norm() < reach_m).then_some(found)
    };
    mutual(&own, &their).into_iter().filter_map(pair).collect()
}

/// Indices of places that are each other's nearest.
fn mutual(own: &[Vector2<f64>], their: &[Vector2<f64>]) -> Vec<(usize, usize)> {
    let nearest = |of: &Vector2<f64>, among: &[Vector2<f64>]| {
        let squares = among.iter().map(|place| (place - of).norm_squared()).enumerate();
        squares.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(index, _)| index)
    };
    let is_back = |(one, other): &(usize, usize)| nearest(&their[*other], own) == Some(*one);
    let there = own.iter().enumerate().filter_map(|(one, of)| Some((one, nearest(of, their)?)));
    there.filter(is_back).collect()
}

/// Velocity of the target of a pair `here`: that of the line through its pairs around it.
fn velocity(periods: &[Vec<Pair>], row: usize, here: &Pair) -> Option<Vector2<f64>> {
    let before = followed(periods[..row].iter().rev(), here);
    let after = followed(periods[row + 1..].iter(), here);
    let reach_s = |side: &[&Pair]| side.last().map(|pair| (pair.time_s - here.time_s).abs());
    let is_long = |side: &[&Pair]| reach_s(side).is_some_and(|s| s >= 0.5 * HALF_WINDOW_S);
    if !(is_long(&before) && is_long(&after)) {
        return None;
    }
    let all = || before.iter().chain(&after).copied().chain([here]);
    let count = (before.len() + after.len() + 1) as f64;
    let mean_s = all().map(|pair| pair.time_s).sum::<f64>() / count;
    let mean_m = all().map(|pair| pair.middle_m).sum::<Vector2<f64>>() / count;
    let moment = |pair: &Pair| (pair.middle_m - mean_m) * (pair.time_s - mean_s);
    let square_s2 = all().map(|pair| (pair.time_s - mean_s).powi(2)).sum::<f64>();
    Some(all().map(moment).sum::<Vector2<f64>>() / square_s2)
}

/// The pairs of the same target in the periods that follow `start` in either direction of time, up to
/// the first beyond the window. Periods without it are passed over.
fn followed<'a>(periods: impl Iterator<Item = &'a Vec<Pair>>, start: &'a Pair) -> Vec<&'a Pair> {
    let mut found: Vec<&Pair> = Vec::new();
    let mut last = start;
    for pairs in periods {
        let away_m = |pair: &&Pair| (pair.middle_m - last.middle_m).norm();
        let nearest = pairs.iter().min_by(|a, b| away_m(a).total_cmp(&away_m(b)));
        let Some(next) = nearest else { continue };
        let apart_s = (next.time_s - last.time_s).abs();
        if away_m(&next) < MAX_SPEED_MPS * apart_s + GATE_SIGMAS * start.sigma_m {
            found.push(next);
            last = next;
        }
        if (next.time_s - start.time_s).abs() >= HALF_WINDOW_S {
            break;
        }
    }
    found
}

/// Normal equations of `(x_m, y_m, heading_rad, lag_s)`, by cluster.
#[derive(Default)]
struct Sums {
    clusters: Vec<(Matrix4<f64>, Vector4<f64>)>,
    cluster_start_s: Option<f64>,
    square: f64,
    count: usize,
}

impl Sums {
    fn start_cluster_at(&mut self, time_s: f64) {
        if self.cluster_start_s.is_none_or(|start_s| start_s + CLUSTER_S <= time_s) {
            self.cluster_start_s = Some(time_s);
            self.clusters.push((Matrix4::zeros(), Vector4::zeros()));
        }
    }

    fn add(&mut self, pair: &Pair, velocity_mps: &Vector2<f64>) {
        let Some((information, gradient)) = self.clusters.last_mut() else { return };
        let (turn, speed) = (&pair.by_heading_m, velocity_mps);
        let jacobian = Matrix2x4::new(1.0, 0.0, turn.x, -speed.x, 0.0, 1.0, turn.y, -speed.y);
        let residual = pair.apart_m + velocity_mps * pair.later_s;
        let weighted = jacobian.transpose() * pair.information;
        *information += weighted * jacobian;
        *gradient += weighted * residual;
        self.square += residual.dot(&(pair.information * residual));
        self.count += 1;
    }

    fn lag(&self) -> Option<Lag> {
        let filled: Vec<_> = self.clusters.iter().filter(|one| one.0[(0, 0)] > 0.0).collect();
        if filled.len() < MIN_CLUSTER_COUNT {
            return None;
        }
        let information: Matrix4<f64> = filled.iter().map(|one| one.0).sum();
        let gradient: Vector4<f64> = filled.iter().map(|one| one.1).sum();
        let covariance = information.cholesky()?.inverse();
        let found = covariance * gradient;
        let freedom = (2.0 * self.count as f64 - 4.0).max(1.0);
        let scale = ((self.square - found.dot(&gradient)) / freedom).max(1.0);
        let spread: Matrix4<f64> = filled
            .iter()
            .map(|(own, pull)| pull - own * found)
            .map(|rest| rest * rest.transpose())
            .sum();
        // Four unknowns make the clusters look that much more alike.
        let count = filled.len() as f64;
        let sandwich = covariance * spread * covariance * (count / (count - 4.0));
        let variance_s2 = sandwich[(3, 3)].max(covariance[(3, 3)] * scale);
        Some(Lag { lag_s: found[3], sigma_s: variance_s2.sqrt() })
    }
}

#[cfg(test)]
mod tests;
