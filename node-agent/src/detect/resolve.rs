//! The second look: does one point response explain a peak, or two, or neither?
//!
//! The profiles around some peaks are compared with `Σ_i a_i g(r_i, u_i)`, `g` being the response of
//! a point ([`PointModel`]). The complex `a_i` are eliminated by projection; the places `[r, u]_i`
//! are fitted by Levenberg and Marquardt on the squared residual. With the noise power `σ²` of a
//! profile sample, the covariance of the places is `σ²/2 (JᵀJ)⁻¹`, `J` being the Jacobian of the
//! projected residual \[golub-pereyra1973\]: the maximum of likelihood and its bound, if
//! the targets are points and the noise is white over the band. What no such sum explains keeps its
//! moments, and gets its extent as error on top.

use nalgebra::{DMatrix, DVector, Matrix2};
use rustfft::num_complex::Complex;

use super::Scan;
use super::moments::{Polar, to_cartesian};
use super::response::{Patch, PointModel};

/// Findings that follow each other in range by less than this, metres, disturb each other: the
/// response of one reaches into the patch of the other.
const GROUP_RANGE_M: f64 = 0.9;
/// Most findings fitted together: with more, side lobes fill the whole patch.
const MAX_GROUP_COUNT: usize = 6;
/// A fit is good if its residual is at most this many times the noise; 4 σ of the mean over the
/// 40 or so samples of a patch ...
const GOOD_NOISE_RATIO: f64 = 1.7;
/// ... and this share of the signal, for tables, neighbours and walls that are not quite right.
const GOOD_SIGNAL_SHARE: f64 = 0.01;
/// Two points instead of one must lower the residual by this many noise powers: noise alone does it
/// by 4 on the average (4 real numbers more, some more for the choice of the start) and reaches
/// this less than once in a million peaks.
const MIN_GAIN: f64 = 25.0;
/// A fitted point weaker than this over the noise of a pixel has been driven away, not found.
const MIN_POWER_RATIO: f64 = 4.0;
/// Starts of a split: half the distance of the two points in range, metres, and in sine.
const SPLIT_HALF_RANGE_M: [f64; 3] = [0.0, 0.09, 0.18];
/// See [`SPLIT_HALF_RANGE_M`].
const SPLIT_HALF_SINE: [f64; 5] = [-0.14, -0.07, 0.0, 0.07, 0.14];
/// Steps of the difference quotients: range in metres and sine.
const DIFFERENCE_STEP: [f64; 2] = [1e-4, 1e-4];
/// Iterations of a fit; five or so suffice.
const MAX_ITERATIONS: usize = 25;
/// A fit has converged when its residual falls by less than this share.
const RELATIVE_STOP: f64 = 1e-6;

/// One target as found so far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Finding {
    /// Place `[r, u]`, metres and sine.
    pub place: Polar,
    /// Covariance of the place by noise, `[[m², m], [m, 1]]`.
    pub polar_cov: Matrix2<f64>,
    /// Second central moment of the region, m².
    pub extent_m2: Matrix2<f64>,
    /// Covariance of the error beyond noise, in the node's frame, m².
    pub unexplained_m2: Matrix2<f64>,
    /// Power of the peak over the noise power of a pixel.
    pub power_ratio: f64,
}

/// Looks a second time.
#[derive(Clone, Debug)]
pub struct Resolver {
    model: PointModel,
}

/// Fitted places and what they leave.
struct Fit {
    places: Vec<Polar>,
    residual_power: f64,
    jacobian: DMatrix<f64>,
}

impl Resolver {
    /// A second look with the point responses of `model`.
    #[must_use]
    pub fn new(model: PointModel) -> Self {
        Self { model }
    }

    /// The findings after a second look: neighbours fitted together, broad ones split if two points
    /// at least `min_separation_m` apart explain them, and what stays unexplained told.
    #[must_use]
    pub fn look_again(
        &self,
        scan: &Scan<'_>,
        findings: Vec<Finding>,
        min_separation_m: f64,
    ) -> Vec<Finding> {
        let mut looked = Vec::with_capacity(findings.len());
        for group in groups(findings) {
            match group.as_slice() {
                [one] => looked.extend(self.one_or_two(scan, one, min_separation_m)),
                few if few.len() <= MAX_GROUP_COUNT => looked.extend(self.together(scan, few)),
                _ => looked.extend(group.iter().map(unexplained)),
            }
        }
        looked.sort_by(|a, b| b.power_ratio.total_cmp(&a.power_ratio));
        looked
    }

    fn one_or_two(
        &self,
        scan: &Scan<'_>,
        finding: &Finding,
        min_separation_m: f64,
    ) -> Vec<Finding> {
        let patch = self.model.patch(scan, &[finding.place]);
        let one = patch.as_ref().and_then(|patch| self.fit(patch, &[finding.place]));
        let (Some(patch), Some(one)) = (patch, one) else { return vec![unexplained(finding)] };
        if is_explained(&patch, &one) {
            return self.fitted(&patch, &one, &[*finding]).unwrap_or_else(|| vec![*finding]);
        }
        let starts = splits(&finding.place);
        let best = starts.iter().min_by(|a, b| {
            let left = |places: &[Polar; 2]| self.residual(&patch, places).norm_squared();
            left(a).total_cmp(&left(b))
        });
        let two = best.and_then(|places| self.fit(&patch, places));
        let split = two.filter(|pair| {
            let gain = (one.residual_power - pair.residual_power) / patch.noise_power;
            let apart_m = (to_cartesian(&pair.places[0]) - to_cartesian(&pair.places[1])).norm();
            MIN_GAIN < gain && min_separation_m <= apart_m && is_explained(&patch, pair)
        });
        split
            .and_then(|pair| self.fitted(&patch, &pair, &[*finding; 2]))
            .unwrap_or_else(|| vec![unexplained(finding)])
    }

    /// Neighbours, each with the others taken into account.
    fn together(&self, scan: &Scan<'_>, group: &[Finding]) -> Vec<Finding> {
        let places: Vec<Polar> = group.iter().map(|finding| finding.place).collect();
        let fitted = self.model.patch(scan, &places).and_then(|patch| {
            let fit = self.fit(&patch, &places).filter(|fit| is_explained(&patch, fit))?;
            self.fitted(&patch, &fit, group)
        });
        fitted.unwrap_or_else(|| group.iter().map(unexplained).collect())
    }

    /// The findings with the places and covariances of `fit`; `None` if one of them
    /// is not determined.
    fn fitted(&self, patch: &Patch, fit: &Fit, findings: &[Finding]) -> Option<Vec<Finding>> {
        let information = fit.jacobian.tr_mul(&fit.jacobian);
        let cov = information.try_inverse()? * (0.5 * patch.noise_power);
        let pixel_gain = patch.delays_s.len() as f64 / patch.noise_power;
        let finding = |(i, found): (usize, &Finding)| {
            let amplitude = self.amplitude(patch, &fit.places, i);
            let polar_cov = cov.fixed_view::<2, 2>(2 * i, 2 * i).into_owned();
            let power_ratio = amplitude.norm_sqr() * pixel_gain;
            let place = fit.places[i];
            (MIN_POWER_RATIO < power_ratio).then_some(Finding {
                place,
                polar_cov,
                power_ratio,
                ..*found
            })
        };
        findings.iter().enumerate().map(finding).collect()
    }

    /// What is left of the samples after the best amplitudes at `places`, real parts before
    /// imaginary parts.
    fn residual(&self, patch: &Patch, places: &[Polar]) -> DVector<f64> {
        let mut left = patch.samples.clone();
        for (direction, _) in self.directions(patch, places.iter()) {
            let share = direction.dotc(&left);
            left.axpy(-share, &direction, Complex::new(1.0, 0.0));
        }
        let parts = left.iter().map(|z| z.re).chain(left.iter().map(|z| z.im));
        DVector::from_iterator(2 * left.len(), parts)
    }

    /// The reflectivity at place number `index`, beside the others.
    fn amplitude(&self, patch: &Patch, places: &[Polar], index: usize) -> Complex<f64> {
        let others = places.iter().enumerate().filter(|(other, _)| *other != index);
        let own = others.map(|(_, place)| place).chain([&places[index]]);
        let mut directions = self.directions(patch, own);
        let last = directions.pop();
        last.map_or(Complex::new(0.0, 0.0), |(unit, length)| unit.dotc(&patch.samples) / length)
    }

    /// The point responses at `places`, each made orthogonal to those before: unit vector, length.
    fn directions<'a>(
        &self,
        patch: &Patch,
        places: impl Iterator<Item = &'a Polar>,
    ) -> Vec<(DVector<Complex<f64>>, f64)> {
        let mut directions: Vec<(DVector<Complex<f64>>, f64)> = Vec::new();
        for place in places {
            let mut direction = self.model.response(patch, place);
            for (earlier, _) in &directions {
                let share = earlier.dotc(&direction);
                direction.axpy(-share, earlier, Complex::new(1.0, 0.0));
            }
            let length = direction.norm().max(f64::MIN_POSITIVE);
            direction.unscale_mut(length);
            directions.push((direction, length));
        }
        directions
    }

    /// The places from `start` on that leave least; `None` if they are not determined.
    fn fit(&self, patch: &Patch, start: &[Polar]) -> Option<Fit> {
        let mut places = start.to_vec();
        let mut residual = self.residual(patch, &places);
        let mut damping = 1e-3;
        for _ in 0..MAX_ITERATIONS {
            let jacobian = self.jacobian(patch, &places);
            let mut normal = jacobian.tr_mul(&jacobian);
            normal.set_diagonal(&(normal.diagonal() * (1.0 + damping)));
            let step = normal.cholesky()?.solve(&jacobian.tr_mul(&residual));
            let moved: Vec<Polar> =
                places.iter().enumerate().map(|(i, p)| step_from(p, &step, i)).collect();
            let moved_residual = self.residual(patch, &moved);
            let fall = 1.0 - moved_residual.norm_squared() / residual.norm_squared();
            if 0.0 < fall {
                (places, residual) = (moved, moved_residual);
                damping *= 0.2;
            } else {
                damping *= 8.0;
            }
            if fall.abs() < RELATIVE_STOP {
                break;
            }
        }
        let jacobian = self.jacobian(patch, &places);
        let residual_power = residual.norm_squared();
        residual_power.is_finite().then_some(Fit { places, residual_power, jacobian })
    }

    /// `∂ residual / ∂ [r₁, u₁, r₂, ...]` by central differences.
    fn jacobian(&self, patch: &Patch, places: &[Polar]) -> DMatrix<f64> {
        let columns: Vec<DVector<f64>> = (0..2 * places.len())
            .map(|column| {
                let step = DIFFERENCE_STEP[column % 2];
                let shifted = |by: f64| {
                    let mut moved = places.to_vec();
                    moved[column / 2][column % 2] += by;
                    self.residual(patch, &moved)
                };
                (shifted(step) - shifted(-step)) / (2.0 * step)
            })
            .collect();
        DMatrix::from_columns(&columns)
    }
}

/// Whether no more is left than noise and the imperfections every model has.
fn is_explained(patch: &Patch, fit: &Fit) -> bool {
    let noise = GOOD_NOISE_RATIO * patch.noise_power * patch.samples.len() as f64;
    fit.residual_power < noise + GOOD_SIGNAL_SHARE * patch.samples.norm_squared()
}

/// Place number `index` moved against `step`, still before the array.
fn step_from(place: &Polar, step: &DVector<f64>, index: usize) -> Polar {
    let moved = place - Polar::new(step[2 * index], step[2 * index + 1]);
    Polar::new(moved.x.max(0.0), moved.y.clamp(-0.999, 0.999))
}

/// Pairs of places around `place` from which a split can start.
fn splits(place: &Polar) -> Vec<[Polar; 2]> {
    let halves = SPLIT_HALF_RANGE_M.iter().flat_map(|r| SPLIT_HALF_SINE.map(|u| Polar::new(*r, u)));
    halves.filter(|half| 0.0 < half.norm()).map(|half| [place + half, place - half]).collect()
}

/// The finding with its extent as error: no model explains it.
fn unexplained(finding: &Finding) -> Finding {
    Finding { unexplained_m2: finding.extent_m2, ..*finding }
}

/// Findings that follow each other in range by less than [`GROUP_RANGE_M`], together.
fn groups(mut findings: Vec<Finding>) -> Vec<Vec<Finding>> {
    findings.sort_by(|a, b| a.place.x.total_cmp(&b.place.x));
    let near = |a: &Finding, b: &Finding| b.place.x - a.place.x < GROUP_RANGE_M;
    findings.chunk_by(near).map(<[Finding]>::to_vec).collect()
}
