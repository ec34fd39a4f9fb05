//! Solves that cost time: the budget holds, and pairs with the reference come first.

use super::*;

/// How long a solve takes.
const SOLVE_S: f64 = 0.25;
/// The share of the solves that go to pairs with the reference where all pairs have a result: one
/// that has waited for 64 solves goes before them, and 40 solves are looked at.
const LEAST_REFERENCE_SHARE: f64 = 0.8;

#[test]
fn many_pairs_take_their_share_of_the_time_only() {
    let turn = |k: usize| f64::from(u32::try_from(k).unwrap()) * 0.7;
    let ring =
        (0..7).map(|k| Se2::new(4.0 + 4.0 * turn(k).sin(), 4.0 - 4.0 * turn(k).cos(), turn(k)));
    let mut site = Site::new(10, 2, ring.collect());
    site.steps(25);
    assert!((1..7).all(|index| site.error(index).is_none_or(|error| error.0 < 0.3)));
    let pair_count = site.solved.iter().collect::<BTreeSet<_>>().len();
    assert_eq!(pair_count, 21, "solves that cost nothing: every pair is solved");
    site.solved.clear();
    site.solve_time = Duration::from_secs_f64(SOLVE_S);
    let period_count = 80;
    site.steps(period_count);
    // One half of two workers' time, two seconds' savings, and what was under way when the budget
    // ran out, one solve of each worker.
    let time_s = period_count as f64 * PERIOD_NS as f64 * 1e-9;
    let (spent_s, earned_s) = (site.solved.len() as f64 * SOLVE_S, time_s + 2.0);
    assert!(spent_s <= earned_s + 2.0 * SOLVE_S, "{spent_s} s of {earned_s} s");
    assert!(0.8 * earned_s <= spent_s, "{spent_s} s of {earned_s} s: what is earned is used");
    let with_reference = site.solved.iter().filter(|pair| pair.first == name(0)).count();
    let share = with_reference as f64 / site.solved.len() as f64;
    assert!(LEAST_REFERENCE_SHARE <= share, "{share}");
    assert!(site.under_way.len() <= 2, "as many as there are workers");
}
