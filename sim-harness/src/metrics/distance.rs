//! Distances between a set of true places and a set of estimates: GOSPA with its parts, and OSPA.

use serde::Serialize;

use super::assignment::{Costs, assignment};

/// GOSPA of one moment, `p = 2`, `alpha = 2` \[gospa\], and its parts. All in square metres, so that
/// they add.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Gospa {
    /// Sum of the squared distances of the pairs.
    pub localisation_m2: f64,
    /// `c²/2` for every true place without an estimate.
    pub missed_m2: f64,
    /// `c²/2` for every estimate without a true place.
    pub false_m2: f64,
}

impl Gospa {
    /// The distance, metres: the root of the sum of the parts.
    #[must_use]
    pub fn distance_m(&self) -> f64 {
        (self.localisation_m2 + self.missed_m2 + self.false_m2).sqrt()
    }
}

/// Exponent and cut-off of OSPA.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct OspaScale {
    /// `p`, at least 1.
    pub order: f64,
    /// `c`, metres, positive.
    pub cutoff_m: f64,
}

/// Distance of two places, metres.
pub(super) fn distance_m(one_m: [f64; 2], other_m: [f64; 2]) -> f64 {
    (one_m[0] - other_m[0]).hypot(one_m[1] - other_m[1])
}

/// Which estimate belongs to each true place: the pairs with the least sum of `min(d, c)²`, of which
/// those with `d < c` are kept. A place that is no number belongs to nothing.
#[must_use]
pub fn pairs(truths_m: &[[f64; 2]], estimates_m: &[[f64; 2]], cutoff_m: f64) -> Vec<Option<usize>> {
    let apart_m =
        |truth: usize, estimate: usize| distance_m(truths_m[truth], estimates_m[estimate]);
    let cost = |truth, estimate| within(apart_m(truth, estimate), cutoff_m).powi(2);
    let nearest = assignment(&Costs::new(truths_m.len(), estimates_m.len(), cost));
    let kept = nearest.into_iter().enumerate();
    kept.map(|(truth, estimate)| estimate.filter(|at| apart_m(truth, *at) < cutoff_m)).collect()
}

/// GOSPA with the cut-off `c`, metres: the minimum over the pairs of
/// `Σ d² + c²/2 (unpaired true places + unpaired estimates)` \[gospa, eq. (1) and proposition 1\].
#[must_use]
pub fn gospa(truths_m: &[[f64; 2]], estimates_m: &[[f64; 2]], cutoff_m: f64) -> Gospa {
    let paired = pairs(truths_m, estimates_m, cutoff_m);
    let squares = paired.iter().zip(truths_m).filter_map(|(estimate, truth_m)| {
        Some(distance_m(*truth_m, estimates_m[(*estimate)?]).powi(2))
    });
    let localisation_m2 = squares.sum();
    let pair_count = paired.iter().flatten().count();
    let half_m2 = 0.5 * cutoff_m * cutoff_m;
    Gospa {
        localisation_m2,
        missed_m2: half_m2 * (truths_m.len() - pair_count) as f64,
        false_m2: half_m2 * (estimates_m.len() - pair_count) as f64,
    }
}

/// OSPA, metres: `((min Σ min(d, c)^p + c^p (n − m)) / n)^(1/p)`, where the larger set has `n` members
/// and the smaller `m` \[ospa, eq. (3)\]; 0 of two empty sets.
#[must_use]
pub fn ospa(truths_m: &[[f64; 2]], estimates_m: &[[f64; 2]], scale: OspaScale) -> f64 {
    let OspaScale { order, cutoff_m } = scale;
    let larger = truths_m.len().max(estimates_m.len());
    if larger == 0 {
        return 0.0;
    }
    let cost = |truth: usize, estimate: usize| {
        within(distance_m(truths_m[truth], estimates_m[estimate]), cutoff_m).powf(order)
    };
    let given = assignment(&Costs::new(truths_m.len(), estimates_m.len(), cost));
    let paired = given.iter().enumerate().filter_map(|(truth, at)| Some(cost(truth, (*at)?)));
    let pair_count = given.iter().flatten().count();
    let lonely = cutoff_m.powf(order) * (larger - pair_count) as f64;
    ((paired.sum::<f64>() + lonely) / larger as f64).powf(1.0 / order)
}

/// `min(d, c)`, where a distance that is no number is as far as can be.
fn within(distance_m: f64, cutoff_m: f64) -> f64 {
    if distance_m < cutoff_m { distance_m } else { cutoff_m }
}
