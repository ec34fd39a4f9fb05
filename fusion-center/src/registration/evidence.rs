//! The likelihood ratio of a mode with repeated points counted once.
//!
//! A standing target, or a fixed ghost that meets another in every period, is one coincidence and
//! not one per period. So every point weighs `w = 1 / (points of its side around it)`, a pair the
//! smaller weight of its two points, and Λ is taken anew with the weighted sums
//! `n₀' = Σ w_l`, `n₁' = Σ w_j`, `m' = Σ p min(w_l, w_j)`, `K' = K (n₀' + n₁') / (n₀ + n₁)`:
//! `Λ' = K' A c + n₀' ln(1 − c/a) + n₁' ln(1 − c/b) + Σ p min(w_l, w_j) ln(1 + κ N(d_lj))`.
//! Where no point repeats this is Λ of the likelihood but for points that match half.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::likelihood::{Link, Model, for_each_period};
use super::modes::Mode;
use super::prepared::{Blob, Prepared};

/// Blocks of periods whose scores are kept apart.
pub(super) const BLOCK_COUNT: usize = 12;

/// How much each point counts, by side.
pub(super) struct Weights {
    refs: Vec<f64>,
    nodes: Vec<f64>,
    place_distance_m: f64,
}

impl Weights {
    /// Weights for points that repeat within about `place_distance_m`.
    pub(super) fn new(data: &Prepared, place_distance_m: f64) -> Self {
        let refs = weights_of(&data.refs, place_distance_m);
        let nodes = weights_of(&data.nodes, place_distance_m);
        Self { refs, nodes, place_distance_m }
    }

    fn of(&self, link: &Link) -> f64 {
        self.refs[link.ref_index].min(self.nodes[link.node_index])
    }
}

/// One over the number of points in the 3 × 3 cells of half the distance around each.
fn weights_of(blobs: &[Blob], distance_m: f64) -> Vec<f64> {
    let cell = |blob: &Blob| (cell_index(blob.x, distance_m), cell_index(blob.y, distance_m));
    let mut counts: BTreeMap<(i64, i64), f64> = BTreeMap::new();
    for blob in blobs {
        *counts.entry(cell(blob)).or_default() += 1.0;
    }
    let around = |(column, row): (i64, i64)| {
        let cells = (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (column + dx, row + dy)));
        cells.filter_map(|key| counts.get(&key)).sum::<f64>()
    };
    blobs.iter().map(|blob| 1.0 / around(cell(blob))).collect()
}

#[expect(clippy::cast_possible_truncation, reason = "coordinates are bounded and cells floored")]
fn cell_index(coordinate_m: f64, distance_m: f64) -> i64 {
    (2.0 * coordinate_m / distance_m).floor() as i64
}

/// What a mode matches.
pub(super) struct Matches {
    /// Pairs that more likely than not are one target.
    pub(super) matched_count: usize,
    /// Places at which they lie.
    pub(super) distinct_count: usize,
    /// Λ', natural logarithm.
    pub(super) log_ratio: f64,
    /// Expected pairs over weighted expected pairs, at least 1.
    pub(super) repetition: f64,
    /// Sum of `p ∂ ln w` over each block of periods.
    pub(super) block_scores: [Vector3<f64>; BLOCK_COUNT],
}

/// What `mode` matches, with repeated points counted once.
pub(super) fn matches_of(data: &Prepared, weights: &Weights, mode: &Mode) -> Matches {
    let mut likely: Vec<usize> = Vec::new();
    let mut links: Vec<(f64, f64)> = Vec::new();
    let mut block_scores = [Vector3::zeros(); BLOCK_COUNT];
    for_each_period(&mode.model(data), &mode.motion, |period, _| {
        let block = period.span_index * BLOCK_COUNT / data.spans.len();
        for link in &period.links {
            block_scores[block] += link.gradient * link.weight;
            links.push((link.weight * weights.of(link), link.log_density()));
            if link.weight > 0.5 {
                likely.push(link.ref_index);
            }
        }
    });
    let counted: f64 = links.iter().map(|(weight, _)| weight).sum();
    Matches {
        matched_count: likely.len(),
        distinct_count: place_count(data, &likely, weights.place_distance_m),
        log_ratio: weighted_log_ratio(data, weights, &links),
        repetition: (mode.fit.matched / counted.max(f64::MIN_POSITIVE)).max(1.0),
        block_scores,
    }
}

fn weighted_log_ratio(data: &Prepared, weights: &Weights, links: &[(f64, f64)]) -> f64 {
    let (n0, n1): (f64, f64) = (weights.refs.iter().sum(), weights.nodes.iter().sum());
    let given = (data.refs.len() + data.nodes.len()) as f64;
    let volume_m2 = data.spans.len() as f64 * data.area_m2 * (n0 + n1) / given;
    let matched: f64 = links.iter().map(|(weight, _)| weight).sum();
    let share = Model::share_of(matched, n0.min(n1));
    let common = share * n0.min(n1);
    let match_area_m2 = common * volume_m2 / ((n0 - common) * (n1 - common));
    let pairs: f64 = links
        .iter()
        .map(|(weight, density)| weight * (match_area_m2 * density.exp()).ln_1p())
        .sum();
    common + n0 * (-common / n0).ln_1p() + n1 * (-common / n1).ln_1p() + pairs
}

/// Places that are more than `distance_m` apart, counted greedily in order of time.
fn place_count(data: &Prepared, ref_indices: &[usize], distance_m: f64) -> usize {
    let mut places: Vec<usize> = Vec::new();
    for &index in ref_indices {
        let point = &data.refs[index];
        let is_far = |&place: &usize| {
            let other = &data.refs[place];
            (point.x - other.x).hypot(point.y - other.y) > distance_m
        };
        if places.iter().all(is_far) {
            places.push(index);
        }
    }
    places.len()
}

#[cfg(test)]
mod tests {
    use super::super::Problem;
    use super::super::modes::refine;
    use super::super::monte_carlo::{Conditions, trial};
    use super::super::prepared::Motion;
    use super::*;

    fn assess(problem: &Problem, start: &Vector3<f64>) -> (Mode, Matches) {
        let data = Prepared::new(problem);
        let mode = refine(&data, Motion::new(start.x, start.y, start.z)).unwrap();
        let weights = Weights::new(&data, 0.3);
        let matches = matches_of(&data, &weights, &mode);
        (mode, matches)
    }

    #[test]
    fn points_that_do_not_repeat_keep_their_ratio() {
        let case = trial(&Conditions::CLEAN, 2);
        let (mode, matches) = assess(&case.problem, &case.truth());
        assert_eq!((matches.matched_count, matches.distinct_count), (16, 16));
        assert!((matches.repetition - 1.0).abs() < 1e-3);
        assert!((matches.log_ratio / mode.fit.log_ratio - 1.0).abs() < 0.01);
    }

    #[test]
    fn a_problem_said_ten_times_is_no_stronger() {
        let case = trial(&Conditions::CLEAN, 2);
        let (_, once) = assess(&case.problem, &case.truth());
        let periods = case.problem.periods.iter().cycle().take(80).cloned().collect();
        let (mode, often) = assess(&Problem { periods }, &case.truth());
        assert_eq!((often.matched_count, often.distinct_count), (160, 16));
        assert!((often.repetition - 10.0).abs() < 1e-3);
        assert!((often.log_ratio / once.log_ratio - 1.0).abs() < 0.05, "{}", often.log_ratio);
        assert!(mode.fit.log_ratio > 9.0 * once.log_ratio);
    }

    #[test]
    fn a_pair_counts_as_little_as_the_more_repeated_of_its_points() {
        let case = trial(&Conditions::CLEAN, 2);
        let (mode, _) = assess(&case.problem, &case.truth());
        let data = Prepared::new(&case.problem);
        for (by_ref, by_node) in [(0.1, 1.0), (1.0, 0.1)] {
            let (refs, nodes) = (vec![by_ref; 16], vec![by_node; 16]);
            let weights = Weights { refs, nodes, place_distance_m: 0.3 };
            let matches = matches_of(&data, &weights, &mode);
            assert!((matches.repetition - 10.0).abs() < 1e-9, "{}", matches.repetition);
        }
    }
}
