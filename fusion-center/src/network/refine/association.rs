//! Which points of one period are the same target, and how surely.
//!
//! Points of different nodes that agree are joined, the likeliest pair first, into targets with at
//! most one point per node; targets are joined only while their fused places agree. A point then
//! belongs to its target with the probability
//! `p = κ N / (1 + κ N + Σ κ N')`, `N = N(y − ȳ; 0, M + C)`,
//! `ȳ`, `C` the place of the target by its other points, `N'` the same of other targets that the
//! point could be and of other points of the node that could be this target's, and
//! `κ = s / ((1 − s)² a)` as for two nodes: `s` the share of points that are matched, `a` the
//! node's points per period and m².

use std::ops::Range;

use nalgebra::{Matrix2, Vector2};

use super::site::{Site, SitePoint, State};

/// Share of matched points assumed before the data say anything, and the largest admitted.
pub(super) const START_SHARE: f64 = 0.5;
const MAX_SHARE: f64 = 0.9;

/// Squared distance of two points that may be one target: 99.95 % of χ² with two degrees of
/// freedom. What lies farther is nothing to the weights.
const GATE: f64 = 15.2;

/// Points of one target, with the probability that each belongs to it.
#[derive(Clone, Debug)]
pub(super) struct Target {
    pub(super) period: usize,
    /// `(index of the point, probability)`, of different nodes.
    pub(super) members: Vec<(usize, f64)>,
}

/// All targets seen by at least two nodes.
#[derive(Clone, Debug)]
pub(super) struct Association {
    pub(super) targets: Vec<Target>,
    /// Expected number of matched points.
    pub(super) matched: f64,
    /// Their share of all points, for the next round.
    pub(super) share: f64,
    /// Sum of `ln(1 + κ N)` over the points: how well the poses explain them.
    pub(super) log_ratio: f64,
}

/// A point in the gauge's frame.
#[derive(Clone, Copy, Debug)]
struct Mapped {
    index: usize,
    node: usize,
    place: Vector2<f64>,
    cov: Matrix2<f64>,
}

/// A target under construction, with the sums of its points' information.
#[derive(Clone, Debug)]
struct Cluster {
    members: Vec<usize>,
    information: Matrix2<f64>,
    pull: Vector2<f64>,
}

/// The place of a target with its covariance.
#[derive(Clone, Copy)]
struct Place {
    at: Vector2<f64>,
    cov: Matrix2<f64>,
}

/// The targets under the given poses, with all covariances `scale` times as large.
pub(super) fn associate(site: &Site, state: &State, (scale, share): (f64, f64)) -> Association {
    let mut found = Association { targets: Vec::new(), matched: 0.0, share, log_ratio: 0.0 };
    for (period, range) in site.periods.iter().enumerate() {
        let mapped = mapped(site, state, (range, scale));
        let clusters = clusters(&mapped);
        found.weigh(site, (period, &mapped), &clusters);
    }
    let count = site.points.len() as f64;
    found.share = ((found.matched + 0.5) / (count + 1.0)).min(MAX_SHARE);
    found
}

fn mapped(site: &Site, state: &State, (range, scale): (&Range<usize>, f64)) -> Vec<Mapped> {
    let to_gauge = |index: usize| {
        let point: &SitePoint = &site.points[index];
        let pose = &state.poses[point.node];
        let turn = pose.rotation();
        let place = turn * state.middle(point.node, point) + pose.translation_m();
        let cov = turn * point.cov * turn.transpose() * scale;
        Mapped { index, node: point.node, place, cov }
    };
    range.clone().map(to_gauge).collect()
}

fn chi_square_and_det(off: &Vector2<f64>, cov: &Matrix2<f64>) -> (f64, f64) {
    let det = cov[(0, 0)] * cov[(1, 1)] - cov[(0, 1)] * cov[(0, 1)];
    let square = off.x * off.x * cov[(1, 1)] - 2.0 * off.x * off.y * cov[(0, 1)]
        + off.y * off.y * cov[(0, 0)];
    (square / det, det)
}

impl Cluster {
    fn of(position: usize, point: &Mapped) -> Self {
        let information = point.cov.try_inverse().unwrap_or_default();
        Self { members: vec![position], information, pull: information * point.place }
    }

    fn place(&self) -> Option<Place> {
        let cov = self.information.try_inverse()?;
        Some(Place { at: cov * self.pull, cov })
    }

    /// The place by all points but `own`.
    fn place_without(&self, own: &Self) -> Option<Place> {
        let cov = (self.information - own.information).try_inverse()?;
        Some(Place { at: cov * (self.pull - own.pull), cov })
    }

    fn agrees(&self, other: &Self, mapped: &[Mapped]) -> bool {
        let shares_node = self
            .members
            .iter()
            .any(|a| other.members.iter().any(|b| mapped[*a].node == mapped[*b].node));
        let places = (self.place(), other.place());
        let (Some(one), Some(two)) = places else { return false };
        !shares_node && chi_square_and_det(&(one.at - two.at), &(one.cov + two.cov)).0 < GATE
    }

    fn join(&mut self, other: &mut Self) {
        self.members.append(&mut other.members);
        self.information += other.information;
        self.pull += other.pull;
    }
}

/// Clusters of points, those of one point too; emptied ones are left out.
fn clusters(mapped: &[Mapped]) -> Vec<Cluster> {
    let mut clusters: Vec<Cluster> =
        mapped.iter().enumerate().map(|(position, point)| Cluster::of(position, point)).collect();
    let mut home: Vec<usize> = (0..mapped.len()).collect();
    for (_, a, b) in close_pairs(mapped) {
        let (one, other) = (home[a].min(home[b]), home[a].max(home[b]));
        if one != other && clusters[one].agrees(&clusters[other], mapped) {
            let (left, right) = clusters.split_at_mut(other);
            right[0].members.iter().for_each(|member| home[*member] = one);
            left[one].join(&mut right[0]);
        }
    }
    clusters.retain(|cluster| !cluster.members.is_empty());
    clusters
}

/// Pairs of different nodes within the gate, likeliest first.
fn close_pairs(mapped: &[Mapped]) -> Vec<(f64, usize, usize)> {
    let widest = mapped.iter().map(|point| point.cov.trace()).fold(0.0, f64::max);
    let reach_m = (2.0 * widest * GATE).sqrt();
    let mut by_x: Vec<usize> = (0..mapped.len()).collect();
    by_x.sort_by(|a, b| mapped[*a].place.x.total_cmp(&mapped[*b].place.x));
    let mut pairs = Vec::new();
    for (rank, &a) in by_x.iter().enumerate() {
        let near = by_x[rank + 1..]
            .iter()
            .take_while(|b| mapped[**b].place.x - mapped[a].place.x < reach_m)
            .filter(|b| mapped[**b].node != mapped[a].node);
        for &b in near {
            let off = mapped[a].place - mapped[b].place;
            let (square, det) = chi_square_and_det(&off, &(mapped[a].cov + mapped[b].cov));
            if square < GATE {
                pairs.push((square + det.ln(), a.min(b), a.max(b)));
            }
        }
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
    pairs
}

/// `N(off; 0, cov)` in 1/m², 0 beyond the gate.
fn density_per_m2(point: &Mapped, place: &Place) -> f64 {
    let (square, det) = chi_square_and_det(&(point.place - place.at), &(point.cov + place.cov));
    if square < GATE { (-0.5 * square).exp() / (std::f64::consts::TAU * det.sqrt()) } else { 0.0 }
}

impl Association {
    fn weigh(&mut self, site: &Site, (period, mapped): (usize, &[Mapped]), clusters: &[Cluster]) {
        let places: Vec<Option<Place>> = clusters.iter().map(Cluster::place).collect();
        let kappa_m2 =
            |node: usize| self.share / ((1.0 - self.share).powi(2) * site.densities_per_m2[node]);
        let mut targets = Vec::new();
        let (mut matched, mut log_ratio) = (0.0, 0.0);
        for (own, cluster) in clusters.iter().enumerate().filter(|(_, c)| c.members.len() > 1) {
            let weigh_one = |&position: &usize| {
                let point = &mapped[position];
                let others = cluster.place_without(&Cluster::of(position, point))?;
                let kappa = kappa_m2(point.node);
                let fit = kappa * density_per_m2(point, &others);
                let elsewhere = rival_density(point, (own, &places));
                let instead = mapped
                    .iter()
                    .filter(|other| other.node == point.node && other.index != point.index)
                    .map(|other| density_per_m2(other, &others));
                let rivals = kappa * (elsewhere + instead.sum::<f64>());
                Some((point.index, fit / (1.0 + fit + rivals), fit.ln_1p()))
            };
            let weighed: Vec<(usize, f64, f64)> =
                cluster.members.iter().filter_map(weigh_one).collect();
            matched += weighed.iter().map(|member| member.1).sum::<f64>();
            log_ratio += weighed.iter().map(|member| member.2).sum::<f64>();
            let members = weighed.into_iter().map(|(index, weight, _)| (index, weight)).collect();
            targets.push(Target { period, members });
        }
        self.targets.extend(targets);
        self.matched += matched;
        self.log_ratio += log_ratio;
    }
}

/// Density of a point under the targets other than its own.
fn rival_density(point: &Mapped, (own, places): (usize, &[Option<Place>])) -> f64 {
    let others = places.iter().enumerate().filter(|(index, _)| *index != own);
    others.filter_map(|(_, place)| Some(density_per_m2(point, place.as_ref()?))).sum()
}
