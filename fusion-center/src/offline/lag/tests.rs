//! Lags of walks with a known one.

use proto::geom::Point;
use rand::RngExt;

use super::*;
use crate::simulate::{Conditions, Paths, Sampler};

const PERIOD_S: f64 = 0.1;

/// People who walk from one random place to the next, sampled this often.
fn walks(sampler: &mut Sampler, (person_count, step_count, step_s): (usize, usize, f64)) -> Paths {
    let mut place =
        || Vector2::new(sampler.rng.random_range(1.0..9.0), sampler.rng.random_range(1.0..9.0));
    let mut people: Vec<(Vector2<f64>, Vector2<f64>)> =
        (0..person_count).map(|_| (place(), place())).collect();
    let mut step = |(at, goal): &mut (Vector2<f64>, Vector2<f64>)| {
        let left_m = *goal - *at;
        let length_m = 1.1 * step_s;
        if left_m.norm() <= length_m {
            *goal = place();
        } else {
            *at += left_m.normalize() * length_m;
        }
        *at
    };
    (0..step_count).map(|_| people.iter_mut().map(&mut step).collect()).collect()
}

/// A minute of three people, the node's sets taken `late_count` hundredths of a second later than
/// stated, and `said_s` later by its times.
fn problem(seed: u64, late_count: usize, said_s: f64) -> (Problem, Se2<Ref, Node>) {
    const FINE: usize = 10;
    const COUNT: usize = 600;
    let mut sampler = Sampler::new(seed);
    let fine = walks(&mut sampler, (3, FINE * COUNT + late_count, PERIOD_S / FINE as f64));
    let at = |late: usize| (0..COUNT).map(|k| fine[FINE * k + late].clone()).collect::<Paths>();
    let conditions = Conditions { period_s: PERIOD_S, noise_scale: 1.0, ..Conditions::MISSES };
    // Both draws start from one state, so that the poses are one.
    let (early, late) = (at(0), at(late_count));
    let seen = Sampler::new(seed).observe(&early, &conditions);
    let other = Sampler::new(seed).observe(&late, &conditions);
    let mut both = seen.problem;
    for (period, later) in both.periods.iter_mut().zip(other.problem.periods) {
        period.in_node = later.in_node;
        period.node_time_s += said_s;
    }
    (both, seen.pose_ref_from_node)
}

#[test]
fn a_lag_is_found_with_its_sign_and_its_uncertainty() {
    for (late_count, said_s) in [(4, 0.0), (0, 0.04), (4, 0.04), (0, 0.0), (8, 0.03)] {
        let expected_s = late_count as f64 * 0.01 - said_s;
        let (mut chi_square, mut significant_count) = (0.0, 0);
        for seed in 0..12 {
            let (case, truth) = problem(seed, late_count, said_s);
            let lag = lag_of(&case, &truth).unwrap();
            assert!(lag.sigma_s < 0.006, "{lag:?}");
            chi_square += ((lag.lag_s - expected_s) / lag.sigma_s).powi(2);
            significant_count += usize::from(lag.is_significant());
        }
        // Chi-square of 12 degrees of freedom: 3 to 30 with all but a chance of 0.3 %. Velocities
        // are smoothed over turns, which takes a few per cent off a lag.
        assert!((3.0..34.0).contains(&chi_square), "{late_count} {said_s}: {chi_square}");
        let expected_count = if expected_s.abs() > 0.03 { 12 } else { 0 };
        assert_eq!(significant_count, expected_count, "{late_count} {said_s}");
    }
}

#[test]
fn a_pose_that_took_the_lag_for_a_shift_hides_it_no_more_than_its_size() {
    let (case, truth) = problem(3, 4, 0.0);
    let moved = Se2::new(
        truth.translation_m().x + 0.03,
        truth.translation_m().y - 0.02,
        truth.heading_rad() + 0.01,
    );
    let (right, shifted) = (lag_of(&case, &truth).unwrap(), lag_of(&case, &moved).unwrap());
    assert!((right.lag_s - shifted.lag_s).abs() < right.sigma_s, "{right:?} {shifted:?}");
}

/// Where the point of another period nearest to `place` lies.
fn near(period: &Period, place: Vector2<f64>) -> Option<Vector2<f64>> {
    let all = period.in_node.iter().map(|other| other.mean.coords_m);
    all.min_by(|a, b| (a - place).norm().total_cmp(&(b - place).norm()))
}

/// The node's points put back along their walks by `lag_s`; those without a walk left out.
fn put_back(case: &Problem, lag_s: f64) -> Problem {
    const AROUND: usize = 4;
    let mut moved = case.clone();
    let last = case.periods.len() - 1;
    for (index, period) in moved.periods.iter_mut().enumerate() {
        let (from, to) = (index.saturating_sub(AROUND), (index + AROUND).min(last));
        let duration_s = PERIOD_S * (to - from) as f64;
        period.in_node.retain_mut(|point| {
            let place = point.mean.coords_m;
            let ends = near(&case.periods[from], place).zip(near(&case.periods[to], place));
            let velocity = ends.map(|(start, end)| (end - start) / duration_s);
            point.mean = Point::from_coords(place - velocity.unwrap_or_default() * lag_s);
            velocity.is_some_and(|velocity| velocity.norm() < 1.6)
        });
    }
    moved
}

#[test]
fn the_lag_is_that_at_which_points_put_back_fit_best() {
    let (case, truth) = problem(5, 4, 0.0);
    let cost = |lag_s: f64| {
        let moved = put_back(&case, lag_s);
        let pairs = moved.periods.iter().flat_map(|period| pairs_of(period, &truth));
        let squares: Vec<f64> =
            pairs.map(|pair| pair.apart_m.dot(&(pair.information * pair.apart_m))).collect();
        squares.iter().sum::<f64>() / squares.len() as f64
    };
    let grid: Vec<f64> = (-4..=12).map(|step| f64::from(step) * 0.01).collect();
    let best = grid.iter().copied().min_by(|a, b| cost(*a).total_cmp(&cost(*b))).unwrap();
    let found = lag_of(&case, &truth).unwrap();
    assert!((best - found.lag_s).abs() <= 0.02, "{best} {found:?}");
}

#[test]
fn nobody_walks_no_lag() {
    let (mut case, truth) = problem(1, 0, 0.0);
    case.periods.truncate(60);
    assert_eq!(lag_of(&case, &truth), None, "six seconds are two stretches");
    let stood = Sampler::new(1).observe(
        &vec![vec![Vector2::new(3.0, 4.0), Vector2::new(6.0, 6.0)]; 600],
        &Conditions { period_s: PERIOD_S, ..Conditions::CLEAN },
    );
    let lag = lag_of(&stood.problem, &stood.pose_ref_from_node);
    assert!(lag.is_none_or(|lag| !lag.is_significant()), "{lag:?}");
}
