//! Graph matching against all associations, a fit by search, and a Monte Carlo of its covariance.

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;

use super::super::prepared::Motion;
use super::super::{Missing, Outcome, Period};
use super::agreement::Candidate;
use super::*;
use crate::simulate::{Conditions, Sampler, Trial, large_room, line_paths, trial};

/// m²: sums in another order.
const SAME_COST_M2: f64 = 1e-9;

fn three_walkers(seed: u64, period_count: usize, conditions: &Conditions) -> Trial {
    let ends = [[[2.0, 3.0], [8.0, 8.0]], [[8.0, 2.0], [3.0, 7.0]], [[4.0, 8.0], [6.0, 3.0]]];
    Sampler::new(seed).observe(&line_paths(&ends, period_count), conditions)
}

/// All associations, period by period, by recursion over the reference's points.
fn all_associations(agreement: &Agreement<'_>) -> Vec<Association> {
    let mut all = vec![Association::new()];
    for group in &agreement.groups {
        let subsets = subsets(agreement, group.candidates.clone().collect(), group.common_count);
        all = all
            .iter()
            .flat_map(|taken| subsets.iter().map(move |s| [&taken[..], &s[..]].concat()))
            .collect();
    }
    all
}

fn subsets(agreement: &Agreement<'_>, from: Vec<usize>, count: usize) -> Vec<Association> {
    if count == 0 {
        return vec![Association::new()];
    }
    let Some((first, rest)) = from.split_first() else { return Vec::new() };
    let chosen = agreement.candidates[*first];
    let compatible: Vec<usize> =
        rest.iter().copied().filter(|c| !agreement.candidates[*c].excludes(&chosen)).collect();
    let with = subsets(agreement, compatible, count - 1).into_iter().map(|s| {
        let mut set = vec![*first];
        set.extend(s);
        set
    });
    with.chain(subsets(agreement, rest.to_vec(), count)).collect()
}

fn least_m2(agreement: &Agreement<'_>) -> f64 {
    let costs = all_associations(agreement).into_iter().map(|a| agreement.total_m2(&a));
    costs.fold(f64::INFINITY, f64::min)
}

#[test]
fn the_exact_search_finds_the_least_of_all_associations() {
    let config = GraphConfig::default();
    for seed in 0..20 {
        let case = match seed % 3 {
            0 => trial(&Conditions::CLEAN, seed),
            1 => trial(&Conditions::WITH_FALSE_POINTS, seed),
            _ => three_walkers(seed, 4, &Conditions::WITH_FALSE_POINTS),
        };
        let data = Prepared::new(&case.problem);
        let agreement = Agreement::new(&data, &config);
        // A poor start, so that the search itself is tested.
        let start = agreement.greedy((0..agreement.candidates.len()).rev());
        let found = exact::search(&agreement, start, 1_000_000);
        let cost_m2 = agreement.total_m2(&found.association);
        assert!(found.is_proven);
        assert!((cost_m2 - least_m2(&agreement)).abs() < SAME_COST_M2, "{seed} {cost_m2}");
    }
}

#[test]
fn the_spectral_start_with_local_improvement_comes_near_the_exact_search() {
    let config = GraphConfig::default();
    let (mut as_good_count, mut true_count) = (0, 0);
    for seed in 0..20 {
        let case = three_walkers(seed, 5, &Conditions::CLEAN);
        let data = Prepared::aligned(&case.problem);
        let agreement = Agreement::new(&data, &config);
        let local = agreement.improved(spectral::association(&agreement, data.typical_sigma_m));
        let local_m2 = agreement.total_m2(&local);
        let exact = exact::search(&agreement, local, 1_000_000);
        let exact_m2 = agreement.total_m2(&exact.association);
        as_good_count += usize::from(exact_m2 > local_m2 - SAME_COST_M2);
        let truth: Association = (0..agreement.candidates.len())
            .filter(|c| agreement.candidates[*c].ref_index == agreement.candidates[*c].node_index)
            .collect();
        assert!(exact.is_proven && exact_m2 <= agreement.total_m2(&truth) + SAME_COST_M2);
        true_count += usize::from(exact.association == truth);
    }
    // Two of the walkers all but meet in one period, and noise then exchanges them.
    assert!(as_good_count >= 18 && true_count >= 15, "{as_good_count} {true_count}");
}

#[test]
fn local_improvement_lowers_the_cost_as_far_as_single_exchanges_can() {
    let config = GraphConfig::default();
    let mut improved_count = 0;
    for seed in 0..10 {
        let case = large_room(seed, 2);
        let data = Prepared::new(&case.problem);
        let agreement = Agreement::new(&data, &config);
        let start = agreement.greedy(0..agreement.candidates.len());
        let end = agreement.improved(start.clone());
        let (before_m2, after_m2) = (agreement.total_m2(&start), agreement.total_m2(&end));
        assert_eq!(start.len(), end.len());
        assert!(after_m2 <= before_m2);
        improved_count += usize::from(after_m2 < before_m2);
        for leaving in 0..end.len() {
            for entering in agreement.groups.iter().flat_map(|g| g.candidates.clone()) {
                let mut other = end.clone();
                other[leaving] = entering;
                let is_valid = is_association(&agreement, &other);
                assert!(!is_valid || agreement.total_m2(&other) > after_m2 - SAME_COST_M2);
            }
        }
    }
    assert!(improved_count > 5);
}

fn is_association(agreement: &Agreement<'_>, set: &[usize]) -> bool {
    let at = |index: &usize| -> &Candidate { &agreement.candidates[*index] };
    let compatible =
        |(k, a): (usize, &usize)| set[k + 1..].iter().all(|b| a != b && !at(a).excludes(at(b)));
    let full = agreement.groups.iter().enumerate().all(|(index, group)| {
        set.iter().filter(|c| at(c).group == index).count() == group.common_count
    });
    full && set.iter().enumerate().all(compatible)
}

#[test]
fn the_number_of_common_points_is_kept() {
    let case = three_walkers(1, 6, &Conditions::CLEAN);
    let data = Prepared::new(&case.problem);
    for (common_count, expected) in [(0, 18), (2, 12), (9, 18)] {
        let config = GraphConfig { common_count, ..GraphConfig::default() };
        let pairs = Graph::new(config, DecisionConfig::default()).associate(&data);
        assert_eq!(pairs.len(), expected);
    }
}

#[test]
fn many_periods_are_associated_from_some() {
    let case = large_room(4, 60);
    let data = Prepared::new(&case.problem);
    let solver = Graph::default();
    let agreement = Agreement::new(&data, &solver.config);
    assert!(agreement.candidates.len() <= solver.config.max_candidate_count + 60);
    assert!(agreement.groups.len() < 20);
    let pairs = solver.associate(&data);
    let fewer: usize = data.spans.iter().map(|s| s.refs.len().min(s.nodes.len())).sum();
    assert_eq!(pairs.len(), fewer);
}

#[test]
fn one_period_of_many_targets_is_enough() {
    let mut sampler = Sampler::new(6);
    let mut draw = || sampler.rng.random_range(1.0..9.0);
    let paths = vec![(0..6).map(|_| Vector2::new(draw(), draw())).collect()];
    let case = sampler.observe(&paths, &Conditions::CLEAN);
    let data = Prepared::aligned(&case.problem);
    let pairs = Graph::default().associate(&data);
    assert!(pairs.len() == 6 && pairs.iter().all(|(l, j)| l == j), "{pairs:?}");
    let motion = rigid::fit(&data, &pairs).unwrap();
    let truth = case.truth();
    assert!(data.displacement_m(&motion, &Motion::new(truth.x, truth.y, truth.z)) < 0.1);
}

fn sum_of_squares(data: &Prepared, motion: &Motion) -> f64 {
    let squares = data.refs.iter().zip(&data.nodes).map(|(point, node)| {
        let mapped = motion.apply(node);
        (point.x - mapped.x).powi(2) + (point.y - mapped.y).powi(2)
    });
    squares.sum()
}

#[test]
fn the_fit_is_where_the_sum_of_squares_is_least() {
    for seed in 0..10 {
        let case = trial(&Conditions { noise_scale: 5.0, ..Conditions::CLEAN }, seed);
        let data = Prepared::new(&case.problem);
        let pairs: Vec<(usize, usize)> = (0..data.refs.len()).map(|i| (i, i)).collect();
        let motion = rigid::fit(&data, &pairs).unwrap();
        let least = sum_of_squares(&data, &motion);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        for power in 0..60 {
            let size = 3.0 * 0.75_f64.powi(power);
            let step = Vector3::from_fn(|_, _| size * rng.random_range(-1.0..1.0));
            assert!(sum_of_squares(&data, &motion.plus(&step)) >= least, "{step:?}");
        }
    }
}

#[test]
fn the_covariance_is_that_of_repeated_fits() {
    /// Of 4,000 draws a variance is known to 2.2 %; four such errors, and linearisation.
    const SPREAD_TOLERANCE: f64 = 0.1;
    let case = trial(&Conditions::CLEAN, 3);
    let data = Prepared::new(&case.problem);
    let pairs: Vec<(usize, usize)> = (0..data.refs.len()).map(|i| (i, i)).collect();
    let truth = case.truth();
    let motion = Motion::new(truth.x, truth.y, truth.z);
    let mut exact = data.clone();
    for (point, node) in exact.refs.iter_mut().zip(&data.nodes) {
        let mapped = motion.apply(node);
        (point.x, point.y) = (mapped.x, mapped.y);
    }
    let stated = rigid::covariance(&exact, &pairs, &motion).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let mut scatter = Matrix3::zeros();
    const DRAW_COUNT: usize = 4_000;
    for _ in 0..DRAW_COUNT {
        let mut drawn = exact.clone();
        for blob in drawn.refs.iter_mut().chain(&mut drawn.nodes) {
            let cov = Matrix2::new(blob.xx, blob.xy, blob.xy, blob.yy);
            let root = cov.cholesky().unwrap().l();
            let unit = Vector2::from_fn(|_, _| rng.sample(StandardNormal));
            let noise: Vector2<f64> = root * unit;
            blob.x += noise.x;
            blob.y += noise.y;
        }
        let fitted = rigid::fit(&drawn, &pairs).unwrap();
        let turn = proto::geom::wrap_angle(fitted.heading_rad() - truth.z);
        let error = Vector3::new(fitted.x - truth.x, fitted.y - truth.y, turn);
        scatter += error * error.transpose() / DRAW_COUNT as f64;
    }
    let ratio = stated.cholesky().unwrap().solve(&scatter);
    for eigenvalue in ratio.complex_eigenvalues().iter() {
        assert!((eigenvalue.re - 1.0).abs() < SPREAD_TOLERANCE, "{ratio}");
    }
}

#[test]
fn pairs_of_different_targets_widen_the_covariance() {
    let case = trial(&Conditions::CLEAN, 3);
    let data = Prepared::aligned(&case.problem);
    let truth = case.truth();
    let motion = Motion::new(truth.x, truth.y, truth.z);
    let mut pairs: Vec<(usize, usize)> = (0..data.refs.len()).map(|i| (i, i)).collect();
    let right = rigid::covariance(&data, &pairs, &motion).unwrap();
    (pairs[0].1, pairs[1].1) = (1, 0);
    let forced = rigid::covariance(&data, &pairs, &motion).unwrap();
    assert!(forced.trace() > 100.0 * right.trace());
}

#[test]
fn too_little_is_underdetermined() {
    let solution = Graph::default().solve(&Problem::default(), None);
    let missing = Missing::SharedPeriods { period_count: 0 };
    assert_eq!(solution.outcome, Outcome::Underdetermined { missing });
    let one = |period: &Period| Period {
        in_ref: period.in_ref[..1].to_vec(),
        in_node: period.in_node[..1].to_vec(),
        ..period.clone()
    };
    let case = trial(&Conditions::CLEAN, 3);
    let periods = vec![one(&case.problem.periods[0])];
    let of_one = Graph::default().solve(&Problem { periods, ..Problem::default() }, None);
    let common = Missing::CommonPoints { shared_period_count: 1 };
    assert_eq!(of_one.outcome, Outcome::Underdetermined { missing: common });
}
