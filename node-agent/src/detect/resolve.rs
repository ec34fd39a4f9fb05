//! The second look: how many points explain the peaks, and where they are.
//!
//! Neighbouring peaks are fitted together (`fit`). A patch is explained if what is left is
//! noise; if not, each point in turn is split in two. What is explained is then fitted once more
//! without the sidelobes of all others: those of a target 1.3 m away pull the sine by up to 4 mrad. The covariance of the places is
//! `σ²/2 (Re Dᴴ D)⁻¹`, the bound, with the noise power `σ²` of a sample or, where it is larger, the
//! mean power that the fit left. A peak is confirmed if its own share of the explained power is above
//! the threshold. What no sum of points explains keeps its moments, with its extent as error on top.

use nalgebra::Matrix2;
use rustfft::num_complex::Complex;

use super::Scan;
use super::fit::Fit;
use super::moments::{Polar, to_cartesian};
use super::response::{Patch, PointModel};

/// Findings that follow each other in range by less than this, metres, disturb each other: the
/// response of one reaches into the patch of the other.
const GROUP_RANGE_M: f64 = 0.9;
/// Sidelobes of points within this range outside the group are taken off, metres: 24 cells.
const SIDELOBE_RANGE_M: f64 = 6.0;
/// Sidelobes with less power in a patch than this over the noise power of a sample move a place by
/// less than a tenth of its error.
const MIN_SIDELOBE_RATIO: f64 = 0.01;
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
/// Starts of a split: half the distance of the two points in range, metres, and in sine.
const SPLIT_HALF_RANGE_M: [f64; 3] = [0.0, 0.09, 0.18];
/// See [`SPLIT_HALF_RANGE_M`].
const SPLIT_HALF_SINE: [f64; 5] = [-0.14, -0.07, 0.0, 0.07, 0.14];
/// A fitted point this far from its peak, in range (metres) and sine, is another one.
const MAX_SHIFT: [f64; 2] = [0.5, 0.4];

/// One target as found so far.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Finding {
    /// Place `[r, u]`, metres and sine.
    pub place: Polar,
    /// Covariance of the place by noise, `[[m², m], [m, 1]]`.
    pub polar_cov: Matrix2<f64>,
    /// Second central moment of the region, m².
    pub extent_m2: Matrix2<f64>,
    /// Covariance of the error beyond noise, in the node's frame, m²: that of a blob larger than one
    /// body's, or the whole extent of what no points explain.
    pub unexplained_m2: Matrix2<f64>,
    /// Power of the peak over the noise power of a pixel.
    pub power_ratio: f64,
    /// What the threshold is applied to: the peak, or its share of the explained power.
    pub detection_ratio: f64,
}

/// A point that is known: place and reflectivity.
type Known = (Polar, Complex<f64>);

/// A group of findings that points explain.
struct Explained {
    /// The samples as they were measured.
    raw: Patch,
    fit: Fit,
    /// The finding each point of the fit comes from.
    owners: Vec<Finding>,
}

/// Looks a second time.
#[derive(Clone, Debug)]
pub struct Resolver {
    model: PointModel,
}

impl Resolver {
    /// A second look with the point responses of `model`.
    #[must_use]
    pub fn new(model: PointModel) -> Self {
        Self { model }
    }

    /// The point responses.
    #[must_use]
    pub fn model(&self) -> &PointModel {
        &self.model
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
        let mut first: Vec<Result<Explained, Vec<Finding>>> = Vec::new();
        // Strongest first: a weak group is looked at without the sidelobes of the strong ones.
        for group in groups(findings) {
            let known = points_of(&first);
            first.push(self.explain(scan, &group, &known, min_separation_m).ok_or(group));
        }
        let looked = first.iter().enumerate().map(|(index, group)| match group {
            Ok(alone) => {
                self.refined(alone, &points_of(&first[..index]), &points_of(&first[index + 1..]))
            }
            Err(group) => group.iter().map(unexplained).collect(),
        });
        looked.flatten().collect()
    }

    /// Neighbours, each with the others and the sidelobes of `known` points taken into account;
    /// `None` if no points explain them.
    fn explain(
        &self,
        scan: &Scan<'_>,
        group: &[Finding],
        known: &[Known],
        min_separation_m: f64,
    ) -> Option<Explained> {
        let places: Vec<Polar> = group.iter().map(|finding| finding.place).collect();
        let raw = self.model.patch(scan, &places)?;
        let (patch, _) = self.cleared(&raw, &places, known);
        let fit = Fit::new(&self.model, &patch, &places)?;
        let mut owners = group.to_vec();
        if is_explained(&patch, &fit) {
            fitted(&patch, &fit, &owners)?;
            return Some(Explained { raw, fit, owners });
        }
        let split = |index: usize| {
            let more = self.split(&patch, &fit, index, min_separation_m)?;
            Some((more, group[index]))
        };
        let (more, owner) = (0..group.len()).find_map(split)?;
        owners.push(owner);
        fitted(&patch, &more, &owners)?;
        Some(Explained { raw, fit: more, owners })
    }

    /// The findings of a group, fitted once more without the sidelobes of `later` points if they
    /// matter.
    fn refined(&self, alone: &Explained, earlier: &[Known], later: &[Known]) -> Vec<Finding> {
        let Explained { raw, fit, owners } = alone;
        let (patch, _) = self.cleared(raw, &fit.places, earlier);
        let (among, most_power) = self.cleared(&patch, &fit.places, later);
        let again = (MIN_SIDELOBE_RATIO * patch.noise_power < most_power)
            .then(|| Fit::new(&self.model, &among, &fit.places))
            .flatten();
        let better = again.and_then(|better| fitted(&among, &better, owners));
        let found = better.or_else(|| fitted(&patch, fit, owners));
        found.unwrap_or_else(|| owners.iter().map(unexplained).collect())
    }

    /// `patch` without what the `points` near `places` add to it, and the power of the one that adds
    /// most.
    fn cleared(&self, patch: &Patch, places: &[Polar], points: &[Known]) -> (Patch, f64) {
        let is_near =
            |place: &Polar| places.iter().any(|own| (own.x - place.x).abs() < SIDELOBE_RANGE_M);
        let mut cleared = patch.clone();
        let mut most_power = 0.0_f64;
        for (place, amplitude) in points.iter().filter(|(place, _)| is_near(place)) {
            let [response, ..] = self.model.response(patch, place);
            let sidelobe = response * *amplitude;
            most_power = most_power.max(sidelobe.norm_squared());
            cleared.samples -= sidelobe;
        }
        (cleared, most_power)
    }

    /// `fit` with point number `index` split in two, if that explains the patch.
    fn split(&self, patch: &Patch, fit: &Fit, index: usize, min_separation_m: f64) -> Option<Fit> {
        let starts = splits(&fit.places, index);
        let left = |places: &Vec<Polar>| {
            Fit::at(&self.model, patch, places).map_or(f64::INFINITY, |at| at.residual_power)
        };
        let rated = starts.into_iter().map(|places| (left(&places), places));
        let (_, best) = rated.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let more = Fit::new(&self.model, patch, &best)?;
        let gain = (fit.residual_power - more.residual_power) / patch.noise_power;
        let [one, other] = [index, more.places.len() - 1].map(|i| to_cartesian(&more.places[i]));
        let apart = min_separation_m <= (one - other).norm();
        (MIN_GAIN < gain && apart && is_explained(patch, &more)).then_some(more)
    }
}

/// The points of all groups that are explained.
fn points_of(groups: &[Result<Explained, Vec<Finding>>]) -> Vec<Known> {
    groups.iter().flatten().flat_map(|group| group.fit.points()).collect()
}

/// The findings with the places and covariances of `fit`; `None` if one of them is not determined
/// or went elsewhere.
fn fitted(patch: &Patch, fit: &Fit, findings: &[Finding]) -> Option<Vec<Finding>> {
    // Each complex amplitude takes one complex sample, each place another.
    let free_count = patch.samples.len().saturating_sub(2 * fit.places.len()).max(1);
    let left_power = fit.residual_power / free_count as f64;
    let local_noise = patch.noise_power.max(left_power);
    let cov = fit.information.clone().try_inverse()? * (0.5 * local_noise);
    let pixel_gain = patch.delays_s.len() as f64 / patch.noise_power;
    let finding = |(i, found): (usize, &Finding)| {
        let polar_cov = cov.fixed_view::<2, 2>(2 * i, 2 * i).into_owned();
        let place = fit.places[i];
        let shift = (place - found.place).abs();
        let stayed = shift.x < MAX_SHIFT[0] && shift.y < MAX_SHIFT[1];
        stayed.then_some(Finding {
            place,
            polar_cov,
            // The other points of the fit explain the size of the blob.
            unexplained_m2: Matrix2::zeros(),
            power_ratio: fit.amplitudes[i].norm_sqr() * pixel_gain,
            detection_ratio: fit.own_powers[i] / patch.noise_power,
            ..*found
        })
    };
    findings.iter().enumerate().map(finding).collect()
}

/// Whether no more is left than noise and the imperfections every model has.
fn is_explained(patch: &Patch, fit: &Fit) -> bool {
    let noise = GOOD_NOISE_RATIO * patch.noise_power * patch.samples.len() as f64;
    fit.residual_power < noise + GOOD_SIGNAL_SHARE * patch.samples.norm_squared()
}

/// `places` with number `index` replaced by pairs around it, the second one at the end.
fn splits(places: &[Polar], index: usize) -> Vec<Vec<Polar>> {
    let halves = SPLIT_HALF_RANGE_M.iter().flat_map(|r| SPLIT_HALF_SINE.map(|u| Polar::new(*r, u)));
    let pair = |half: Polar| {
        let mut more = places.to_vec();
        more.push(places[index] - half);
        more[index] += half;
        more
    };
    halves.filter(|half| 0.0 < half.norm()).map(pair).collect()
}

/// The finding with its extent as error: no model explains it.
fn unexplained(finding: &Finding) -> Finding {
    Finding { unexplained_m2: finding.extent_m2, ..*finding }
}

/// Findings that follow each other in range by less than [`GROUP_RANGE_M`], together, at most
/// [`MAX_GROUP_COUNT`] of them; the group with the strongest first.
fn groups(mut findings: Vec<Finding>) -> Vec<Vec<Finding>> {
    findings.sort_by(|a, b| a.place.x.total_cmp(&b.place.x));
    let near = |a: &Finding, b: &Finding| b.place.x - a.place.x < GROUP_RANGE_M;
    let of_near = findings.chunk_by(near).flat_map(|group| group.chunks(MAX_GROUP_COUNT));
    let mut groups: Vec<Vec<Finding>> = of_near.map(<[Finding]>::to_vec).collect();
    let strongest = |group: &[Finding]| group.iter().map(|f| f.power_ratio).fold(0.0, f64::max);
    groups.sort_by(|a, b| strongest(b).total_cmp(&strongest(a)));
    groups
}
