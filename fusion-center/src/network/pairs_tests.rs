//! Tests of the choice of pairs and of whole sites.

use std::time::Instant;

use proto::geom::{Gaussian, Node, Point, Ref, Se2};

use super::super::site_cases::grid;
use super::super::{Refinement, SeenSet, SiteSolution, refine, solve_site};
use super::*;
use crate::registration::{Outcome, Pairwise};
use crate::simulate_site::SiteTrial;

fn distance_m(case: &SiteTrial, first: &NodeId, second: &NodeId) -> f64 {
    let place = |name: &NodeId| case.world_from_node[name].translation_m();
    (place(first) - place(second)).norm()
}

#[test]
fn a_vote_is_the_pose_that_carries_one_segment_onto_the_other() {
    let truth = Se2::<Ref, Node>::new(3.0, -1.0, -2.2);
    let (a, b) = (Point::<Node>::new(1.0, 2.0), Point::<Node>::new(-2.0, 4.5));
    let point = |at: Vector2<f64>| vec![(at, 0.01)];
    let in_second = segments(&point(a.coords_m), &point(b.coords_m));
    let moved = |at: Point<Node>| point((truth * at).coords_m);
    let in_first = segments(&moved(a), &moved(b));
    let [heading, x, y] = pose(&in_first[0], &in_second[0]);
    assert!((heading - truth.heading_rad().rem_euclid(TAU)).abs() < 1e-12);
    assert!((Vector2::new(x, y) - truth.translation_m()).norm() < 1e-12);
}

#[test]
fn the_best_partners_are_picked_from_either_side() {
    // Node 0 stands out with all others, of which only some are among its best.
    let scores = |first: usize| {
        (first + 1..12)
            .map(|second| (second, if first == 0 { 20.0 - second as f64 } else { 0.0 }))
            .collect()
    };
    let scored: Vec<Vec<(usize, f64)>> = (0..12).map(scores).collect();
    assert_eq!(picked(&scored), (1..12).map(|second| (0, second)).collect::<Vec<_>>());
    let dull = vec![vec![(1, MIN_PROMISE - 0.1)], vec![]];
    assert!(picked(&dull).is_empty());
}

#[test]
fn pairs_without_common_periods_are_not_tried() {
    let point = Gaussian { mean: Point::new(1.0, 2.0), cov_m2: nalgebra::Matrix2::identity() };
    let view = |periods: &[i64]| NodeView {
        sets: periods.iter().map(|k| (*k, SeenSet { time_s: 0.0, points: vec![point] })).collect(),
        ..NodeView::default()
    };
    let name = |text: &str| text.parse::<NodeId>().unwrap();
    let views = [("a", view(&[1, 2])), ("b", view(&[2, 3])), ("c", view(&[3])), ("d", view(&[]))];
    let views = views.into_iter().map(|(text, seen)| (name(text), seen)).collect();
    let problem = SiteProblem { reference: name("a"), views };
    let pairs: Vec<String> = promising(&problem).iter().map(|(a, b)| format!("{a}{b}")).collect();
    assert_eq!(pairs, ["ab", "bc"]);
}

#[test]
fn most_neighbours_of_a_grid_are_picked_and_few_others() {
    let case = grid(5, 30, 20);
    let pairs = promising(&case.problem);
    let near = pairs.iter().filter(|(a, b)| distance_m(&case, a, b) < 6.0).count();
    println!("{} picked, {near} of 83 neighbours", pairs.len());
    assert!(near > 66 && pairs.len() < 150, "{near} {}", pairs.len());
}

/// A grid of two rows whose middle columns see nobody, so that two halves remain.
fn cut_in_two() -> SiteTrial {
    let mut case = grid(3, 20, 20);
    let middle: Vec<NodeId> = case
        .problem
        .views
        .keys()
        .enumerate()
        .filter(|(i, _)| (4..6).contains(&(i % 10)))
        .map(|(_, n)| n.clone())
        .collect();
    for name in middle {
        case.problem.views.remove(&name);
    }
    case
}

#[test]
fn a_scene_cut_in_two_gives_two_groups_whatever_the_thread_count() {
    let case = cut_in_two();
    let solve = |threads: usize| -> SiteSolution {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| solve_site(&case.problem, &Pairwise::default()))
    };
    let solution = solve(1);
    assert_eq!(solution, solve(2));
    let sizes: Vec<usize> = solution.groups.iter().map(|group| group.nodes.len()).collect();
    assert_eq!(sizes, [8, 8]);
    for group in &solution.groups {
        assert!(matches!(group.refinement, Refinement::Joint { .. }), "{:?}", group.refinement);
        let column = |name: &NodeId| name.as_str()[1..].parse::<usize>().unwrap() % 10;
        let is_left = column(&group.gauge) < 5;
        for (name, placed) in &group.nodes {
            assert_eq!(column(name) < 5, is_left);
            let error = case.error(&group.gauge, name, &placed.estimate).unwrap();
            assert!(error.xy().norm() < 0.3, "{name} {error}");
        }
    }
}

#[test]
#[ignore = "minutes: prints the figures of 100 nodes"]
fn study_a_hundred_nodes() {
    for seed in 1..4 {
        let case = grid(seed, 100, 30);
        let mut times = Vec::new();
        #[expect(clippy::disallowed_methods, reason = "a study may time what it calls")]
        let mut lap = |what: &str, since: Instant| {
            times.push(format!("{what} {:.0} ms", since.elapsed().as_secs_f64() * 1e3));
            Instant::now()
        };
        #[expect(clippy::disallowed_methods, reason = "a study may time what it calls")]
        let start = Instant::now();
        let pairs = promising(&case.problem);
        let near = pairs.iter().filter(|(a, b)| distance_m(&case, a, b) < 6.0).count();
        let start = lap("screening", start);
        let edges = solve_pairs(&case.problem, &Pairwise::default());
        let start = lap("screening and edges", start);
        let names: Vec<NodeId> = case.problem.views.keys().cloned().collect();
        let before = super::super::combine(&case.problem.reference, &names, &edges);
        let start = lap("combine", start);
        let after = refine(&case.problem, &before[0]);
        lap("refine", start);
        let determined = edges.iter().filter(|e| e.solution.outcome == Outcome::Determined).count();
        println!(
            "{} pairs, {near} of 342 neighbours, {determined} determined; {times:?}",
            pairs.len()
        );
        let bounds = case.position_bounds_m2().unwrap();
        let bound = (bounds.iter().sum::<f64>() / bounds.len() as f64).sqrt() * 1e3;
        for group in [&before[0], &after] {
            let (mut square, mut nees) = (0.0, 0.0);
            let count = (group.nodes.len() - 1) as f64;
            for (name, placed) in group.nodes.iter().filter(|(name, _)| **name != group.gauge) {
                let error = case.error(&group.gauge, name, &placed.estimate).unwrap();
                square += error.xy().norm_squared() / count;
                let factor = nalgebra::Cholesky::new(placed.estimate.covariance).unwrap();
                nees += error.dot(&factor.solve(&error)) / count;
            }
            let rms = square.sqrt() * 1e3;
            println!(
                "{} nodes: {rms:.1} mm (bound {bound:.1}), nees {nees:.2}, {:?}",
                group.nodes.len(),
                group.refinement
            );
        }
    }
}
