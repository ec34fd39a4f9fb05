//! Distances between a set of true places and a set of estimates: GOSPA with its parts, and OSPA.

use fusion_center::tracking::assign::{AssignError, Edges, Solver};
use fusion_center::tracking::gate::{GateError, Grid};
use serde::Serialize;
use thiserror::Error;

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
/// those with `d < c` are kept. A place that is no number belongs to nothing, and nothing belongs
/// together where `c` is not finite and above 0.
///
/// A pair is worth `c² − d²`, so only those with `d < c` are looked at: the time is nearly
/// proportional to the number of places where few are near each other.
#[must_use]
pub fn pairs(truths_m: &[[f64; 2]], estimates_m: &[[f64; 2]], cutoff_m: f64) -> Vec<Option<usize>> {
    let is_place = |index: &usize| estimates_m[*index].iter().all(|at_m| at_m.is_finite());
    let places: Vec<usize> = (0..estimates_m.len()).filter(is_place).collect();
    let places_m: Vec<[f64; 2]> = places.iter().map(|index| estimates_m[*index]).collect();
    let Ok(edges) = near_pairs(truths_m, &places_m, cutoff_m) else {
        return vec![None; truths_m.len()];
    };
    let mut solver = Solver::default();
    let solved = solver.solve(&edges);
    let place_of = |truth| solved.column_of(truth).map(|place| places[place]);
    (0..truths_m.len()).map(place_of).collect()
}

/// Why there are no pairs to choose from.
#[derive(Debug, Error)]
enum NoPairs {
    #[error(transparent)]
    Gate(#[from] GateError),
    #[error(transparent)]
    Assign(#[from] AssignError),
}

fn near_pairs(
    truths_m: &[[f64; 2]],
    places_m: &[[f64; 2]],
    cutoff_m: f64,
) -> Result<Edges, NoPairs> {
    let (mut grid, mut edges) = <(Grid, Edges)>::default();
    grid.fill(places_m, cutoff_m)?;
    edges.begin(places_m.len())?;
    let limit_m2 = cutoff_m.powi(2);
    for truth_m in truths_m {
        let mut pushed = Ok(());
        let push = |place: usize, distance_m2: f64| {
            if distance_m2 < limit_m2 && pushed.is_ok() {
                pushed = edges.push(place, distance_m2 - limit_m2);
            }
        };
        if truth_m.iter().all(|at_m| at_m.is_finite()) {
            grid.for_each_within(*truth_m, cutoff_m, push)?;
        }
        pushed?;
        edges.end_row()?;
    }
    Ok(edges)
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
