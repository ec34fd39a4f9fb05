//! Tests of the joint refinement against drawn sites.

use nalgebra::{Cholesky, DMatrix};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;

use super::super::relative::Pose;
use super::super::site_cases::room;
use super::super::{Group, Placed, Refinement};
use super::*;
use crate::simulate::Conditions;
use crate::simulate_site::{SiteConditions, SiteTrial};

/// Mean of a χ² variable of three degrees of freedom over 500 trials: outside with chance 1e-4.
/// Nodes of one trial are not independent, so their number narrows nothing.
const NEES_BOUNDS: (f64, f64) = (2.6, 3.45);

const CONDITIONS: SiteConditions = SiteConditions {
    measuring: Conditions { noise_scale: 1.0, ..Conditions::WITH_FALSE_POINTS },
    reach_m: 20.0,
    half_depth_sigma_m: 0.0,
};

/// What edges err by: metres, metres, radians.
const START_SIGMAS: [f64; 3] = [0.04, 0.04, 0.008];

/// A group at the truth plus errors as edges have them.
fn started(case: &SiteTrial, seed: u64) -> Group {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(3);
    let gauge = case.problem.reference.clone();
    let nodes = case.problem.views.keys().map(|name| {
        let is_gauge = *name == gauge;
        let sigmas = if is_gauge { Vector3::zeros() } else { Vector3::from(START_SIGMAS) };
        let noise = sigmas.map(|sigma| sigma * rng.sample::<f64, _>(StandardNormal));
        let pose = Pose::from_numbers(&(case.truth(&gauge, name).unwrap() + noise));
        let covariance = Matrix3::from_diagonal(&sigmas.map(|sigma| sigma * sigma));
        let standing = if is_gauge { Standing::Gauge } else { Standing::Unconfirmed };
        let estimate = Relative { pose, covariance }.estimate();
        (name.clone(), Placed { estimate, via: vec![gauge.clone(), name.clone()], standing })
    });
    let nodes = nodes.collect();
    let refinement = Refinement::Untried;
    Group { gauge: gauge.clone(), nodes, doubtful: std::collections::BTreeMap::new(), refinement }
}

fn start_state(group: &Group) -> State {
    let pose = |placed: &Placed| placed.estimate.pose_ref_from_node.renamed();
    let poses: Vec<Pose> = group.nodes.values().map(pose).collect();
    State { depths_m: vec![0.0; poses.len()], poses }
}

fn site_of(case: &SiteTrial) -> Site {
    Site::new(&case.problem, &case.problem.views.keys().collect::<Vec<_>>())
}

/// Mean NEES, root mean square position error over that of the bound, refused share; before and
/// after.
fn tally(trials: u64, count: usize, conditions: SiteConditions) -> ([f64; 2], [f64; 2], f64) {
    let (mut nees, mut squares, mut bound, mut refused) = ([0.0; 2], [0.0; 2], 0.0, 0.0);
    for seed in 1000..1000 + trials {
        let case = room(seed, count, conditions);
        let before = started(&case, seed);
        let after = refine(&case.problem, &before);
        let is_joint = matches!(after.refinement, Refinement::Joint { .. });
        refused += f64::from(u8::from(!is_joint)) / trials as f64;
        bound += case.position_bounds_m2().unwrap().iter().sum::<f64>();
        for (index, group) in [&before, &after].into_iter().enumerate() {
            for (name, placed) in group.nodes.iter().skip(1) {
                let error = case.error(&group.gauge, name, &placed.estimate).unwrap();
                let factor = Cholesky::new(placed.estimate.covariance).unwrap();
                let nodes = trials as f64 * (count - 1) as f64;
                nees[index] += error.dot(&factor.solve(&error)) / nodes;
                squares[index] += error.xy().norm_squared();
            }
        }
    }
    (nees, squares.map(|square| (square / bound).sqrt()), refused)
}

#[test]
fn covariances_are_true_and_errors_near_the_bound() {
    for (count, trials, depth_m) in [(4, 500, 0.0), (8, 200, 0.0), (5, 300, 0.03)] {
        let conditions = SiteConditions { half_depth_sigma_m: depth_m, ..CONDITIONS };
        let (nees, ratio, refused) = tally(trials, count, conditions);
        println!(
            "{count} nodes, {depth_m} m: nees {nees:.2?}, rmse/bound {ratio:.2?}, {refused:.3} refused"
        );
        assert!((NEES_BOUNDS.0..NEES_BOUNDS.1).contains(&nees[1]), "{count} {nees:?}");
        // The bound knows nothing of offsets.
        let limit = if depth_m > 0.0 { 1.5 } else { 1.1 };
        assert!(ratio[1] < limit && refused < 0.03, "{count} {ratio:?} {refused}");
    }
}

fn numeric_jacobian(size: usize, residuals: impl Fn(&[f64]) -> Vec<f64>) -> DMatrix<f64> {
    let step = 1e-5;
    let shifted = |index: usize, by: f64| {
        let mut moves = vec![0.0; size];
        moves[index] += by;
        residuals(&moves)
    };
    let column = |index: usize| -> Vec<f64> {
        let (plus, minus) = (shifted(index, step), shifted(index, -step));
        plus.into_iter().zip(minus).map(|(a, b)| (a - b) / (2.0 * step)).collect()
    };
    let columns: Vec<f64> = (0..size).flat_map(column).collect();
    DMatrix::from_vec(columns.len() / size, size, columns)
}

#[test]
fn the_equations_are_those_of_the_full_problem_with_every_target() {
    // The oracle: residuals of all points with the targets' places as unknowns, derivatives by
    // differences, and the full inverse.
    let conditions = SiteConditions { half_depth_sigma_m: 0.05, ..CONDITIONS };
    let case = room(4, 3, conditions);
    let (site, state) = (site_of(&case), start_state(&started(&case, 4)));
    let layout = Layout::new(&site);
    let association = associate(&site, &state, (1.0, 0.8));
    let (poses, targets) = (layout.size, &association.targets);
    let center: Vec<Vector2<f64>> =
        targets.iter().map(|target| site.points[target.members[0].0].mean).collect();
    let residuals = |moves: &[f64]| -> Vec<f64> {
        let moved = state.plus(&layout, &moves[..poses]);
        let mut all = Vec::new();
        for (index, target) in targets.iter().enumerate() {
            let place = center[index]
                + Vector2::new(moves[poses + 2 * index], moves[poses + 2 * index + 1]);
            for (point, weight) in &target.members {
                let point = &site.points[*point];
                let turn =
                    |at: &State| nalgebra::Rotation2::new(at.poses[point.node].heading_rad());
                let shift_m = moved.poses[point.node].translation_m();
                let seen = turn(&moved) * moved.middle(point.node, point) + shift_m;
                // The weights stay those of the state, as in the equations.
                let cov = turn(&state) * point.cov * turn(&state).inverse() / *weight;
                let root = Cholesky::new(cov).unwrap().l().try_inverse().unwrap();
                all.extend((root * (seen - place)).iter());
            }
        }
        for node in 0..3 {
            all.push(moved.depths_m[node] / 0.05);
        }
        all
    };
    let size = poses + 2 * targets.len();
    let residual = residuals(&vec![0.0; size]);
    let jacobian = numeric_jacobian(size, residuals);
    let inverse = (jacobian.transpose() * &jacobian).try_inverse().unwrap();
    let best = -(&inverse * jacobian.transpose() * DMatrix::from_vec(residual.len(), 1, residual));
    let equations = || Equations::new((&site, &layout), &state, &association);
    let found = equations().step().unwrap().values;
    let covariance = equations().inverse().unwrap();
    for row in 0..poses {
        assert!(
            (found[row] - best[row]).abs() < 1e-6 * best.norm(),
            "{row} {} {}",
            found[row],
            best[row]
        );
        for column in 0..poses {
            let scale = (inverse[(row, row)] * inverse[(column, column)]).sqrt();
            let off = covariance.get(row, column) - inverse[(row, column)];
            assert!(off.abs() < 1e-5 * scale, "{row} {column} {off}");
        }
    }
}

#[test]
fn a_target_seen_by_many_is_one_target_and_a_stranger_is_none() {
    let conditions = SiteConditions {
        measuring: Conditions { noise_scale: 1.0, ..Conditions::CLEAN },
        ..CONDITIONS
    };
    let case = room(2, 5, conditions);
    let (site, mut state) = (site_of(&case), start_state(&started(&case, 2)));
    for (pose, name) in state.poses.iter_mut().zip(case.problem.views.keys()) {
        *pose = Pose::from_numbers(&case.truth(&case.problem.reference, name).unwrap());
    }
    let association = associate(&site, &state, (1.0, 0.9));
    let full = association.targets.iter().filter(|target| target.members.len() == 5).count();
    // Three people over twenty periods; a few cross.
    assert!(full > 54 && association.targets.len() < 66, "{full} {}", association.targets.len());
    let mut strange = site.clone();
    strange.points[0].mean += Vector2::new(1.0, 1.0);
    let without = associate(&strange, &state, (1.0, 0.9));
    let holds = |found: &Association| {
        found.targets.iter().flat_map(|target| &target.members).any(|member| member.0 == 0)
    };
    assert!(holds(&association) && !holds(&without));
}

#[test]
fn what_lasts_longer_than_a_period_widens_the_covariance() {
    let paths = super::super::site_cases::scattered(5, (10.0, 10.0), 3, 120);
    let nodes = [[5.0, 0.0], [0.0, 5.0], [10.0, 5.0]];
    let sampler = crate::simulate_site::SiteSampler::new(5, &nodes, CONDITIONS);
    let mut case = sampler.observe(&paths).unwrap();
    let inflation = |drawn: &SiteTrial| match refine(&drawn.problem, &started(drawn, 1)).refinement
    {
        Refinement::Joint { covariance_inflation, .. } => covariance_inflation,
        other => panic!("{other:?}"),
    };
    assert!(inflation(&case) < 1.5);
    let name = case.problem.views.keys().nth(1).unwrap().clone();
    for (period, set) in &mut case.problem.views.get_mut(&name).unwrap().sets {
        let sway_m = 0.08 * (*period as f64 / 120.0 * std::f64::consts::TAU).sin();
        set.points.iter_mut().for_each(|point| point.mean.coords_m.x += sway_m);
    }
    assert!(inflation(&case) > 2.0, "{}", inflation(&case));
}

#[test]
fn results_that_are_worse_or_contradict_the_edges_are_refused() {
    let case = room(7, 4, CONDITIONS);
    let mut group = started(&case, 7);
    let reason = |given: &Group, problem: &SiteProblem| match refine(problem, given) {
        Group { refinement: Refinement::Refused { reason }, nodes, .. } => {
            assert_eq!(nodes, given.nodes);
            reason
        }
        other => panic!("{:?}", other.refinement),
    };
    let site = site_of(&case);
    let start = start_state(&group);
    let mut fitted = fit(&site, &start).unwrap();
    fitted.association.log_ratio -= 1000.0;
    let refused = accepted(&site, (&start, &group), fitted).err();
    assert!(
        matches!(refused, Some(RefusedRefinement::Unlikelier { log_loss }) if log_loss > 100.0)
    );
    let mut blind = case.problem.clone();
    blind.views.values_mut().nth(2).unwrap().sets.clear();
    assert_eq!(reason(&group, &blind), RefusedRefinement::Undetermined);
    for placed in group.nodes.values_mut().skip(1) {
        placed.estimate.covariance *= 1e-4;
    }
    let contradicted = reason(&group, &case.problem);
    assert!(matches!(contradicted, RefusedRefinement::Moved { chi_square } if chi_square > 25.0));
}
