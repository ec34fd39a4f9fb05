//! Points that have lost their partners: a node that was moved so far that nothing meets any more.
//!
//! Under the poses in force a share `q₀` of both sides' points used to have a partner, and `q₁` of
//! the newest `n₁` have one. Twice the gain in log likelihood of two shares over one,
//! `G = 2 Σ_i [k_i ln(q_i / q) + (n_i − k_i) ln((1 − q_i) / (1 − q))]`, is chi-square with one degree
//! of freedom where nothing changed. A person who is hidden from one side loses partners on the
//! other side only, so the weaker of both sides' G counts, and both must still see as much as before.

use std::collections::BTreeMap;

use nalgebra::{Matrix2, Vector2};

use super::{Placement, WALK_M_PER_S};
use crate::gather::{KeptPoint, KeptSet};

/// Squared normalised distance of partners: four standard deviations.
const PARTNER_CHI_SQUARE: f64 = 16.0;
/// Added to each point's standard deviation, metres: sway, depth, and a pose that is a little off.
const SLACK_M: f64 = 0.15;
/// Points that each side needs, in the newest periods and in the ones before.
const MIN_POINT_COUNT: f64 = 12.0;
/// Share of points that used to have partners, at least, and the most of it that a node keeps that
/// was moved: what still meets, meets by chance.
const MIN_SHARE_BEFORE: f64 = 0.5;
const MAX_KEPT: f64 = 0.4;
/// Part of its points per period that a side must still see.
const MIN_STILL_SEEN: f64 = 0.5;

/// How many points of each side had a partner in one period.
#[derive(Clone, Copy, Debug)]
pub(super) struct Met {
    pub(super) period: i64,
    /// Of the first side and of the second: points with a partner, and all.
    pub(super) sides: [(f64, f64); 2],
}

/// The points of both sides in one period, as [`Met`].
pub(super) fn met(
    period: i64,
    (one, first): (&Placement, &KeptSet),
    (other, second): (&Placement, &KeptSet),
) -> Met {
    let apart_s = first.time.since(second.time).max(second.time.since(first.time)).as_secs_f64();
    let slack_m2 = 2.0 * SLACK_M.powi(2) + (WALK_M_PER_S * apart_s).powi(2);
    let place = |at: &Placement, set: &KeptSet| -> Vec<(Vector2<f64>, Matrix2<f64>)> {
        let placed = |point: &KeptPoint| {
            let placed = at.pose * point.position;
            (placed.mean.coords_m, placed.cov_m2)
        };
        set.points.iter().map(placed).collect()
    };
    let (in_first, in_second) = (place(one, first), place(other, second));
    let meets = |a: &(Vector2<f64>, Matrix2<f64>), b: &(Vector2<f64>, Matrix2<f64>)| {
        let between_m = a.0 - b.0;
        let cov_m2 = a.1 + b.1 + Matrix2::identity() * slack_m2;
        let inverse = cov_m2.try_inverse();
        inverse.is_some_and(|inverse| between_m.dot(&(inverse * between_m)) < PARTNER_CHI_SQUARE)
    };
    let count = |own: &[(Vector2<f64>, Matrix2<f64>)], others: &[(Vector2<f64>, Matrix2<f64>)]| {
        let with_partner = own.iter().filter(|a| others.iter().any(|b| meets(a, b))).count();
        (with_partner as f64, own.len() as f64)
    };
    Met { period, sides: [count(&in_first, &in_second), count(&in_second, &in_first)] }
}

/// G of the periods after `last_before` against those up to it, if both sides lost their partners.
pub(super) fn loss(met: &[Met], last_before: i64) -> Option<f64> {
    let (before, newest) = met.split_at(met.partition_point(|one| one.period <= last_before));
    let of_side = |side: usize| side_loss(side, before, newest);
    Some(of_side(0)?.min(of_side(1)?))
}

fn side_loss(side: usize, before: &[Met], newest: &[Met]) -> Option<f64> {
    let sum = |of: &[Met]| {
        of.iter().fold((0.0, 0.0), |(k, n), one| (k + one.sides[side].0, n + one.sides[side].1))
    };
    let ((k0, n0), (k1, n1)) = (sum(before), sum(newest));
    let is_enough = n0 >= MIN_POINT_COUNT && n1 >= MIN_POINT_COUNT;
    let still_sees = n1 * before.len() as f64 >= MIN_STILL_SEEN * n0 * newest.len() as f64;
    let (q0, q1) = (k0 / n0, k1 / n1);
    let is_lost = q0 >= MIN_SHARE_BEFORE && q1 <= MAX_KEPT * q0;
    let q = (k0 + k1) / (n0 + n1);
    let gain = |k: f64, n: f64| {
        let part = |count: f64, share: f64, whole: f64| {
            if count > 0.0 { count * (share / whole).ln() } else { 0.0 }
        };
        part(k, k / n, q) + part(n - k, 1.0 - k / n, 1.0 - q)
    };
    (is_enough && still_sees && is_lost).then(|| 2.0 * (gain(k0, n0) + gain(k1, n1)))
}

/// The period from which on partners are missing.
pub(super) fn began(met: &[Met]) -> Option<i64> {
    let missing = |one: &Met| {
        let [(k0, n0), (k1, n1)] = one.sides;
        (one.period, (n0 + n1) - 2.0 * (k0 + k1))
    };
    let mut of_periods = BTreeMap::new();
    for (period, count) in met.iter().map(missing) {
        *of_periods.entry(period).or_default() += count;
    }
    super::change(&of_periods)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn periods(range: std::ops::Range<i64>, sides: [(f64, f64); 2]) -> Vec<Met> {
        range.map(|period| Met { period, sides }).collect()
    }

    #[test]
    fn both_sides_must_lose_their_partners_and_go_on_seeing() {
        let before = periods(0..40, [(2.0, 2.0), (2.0, 2.0)]);
        let with = |newest: [(f64, f64); 2]| [before.clone(), periods(40..50, newest)].concat();
        let lost = with([(0.0, 2.0), (0.0, 2.0)]);
        assert!(loss(&lost, 39).unwrap() > 30.0);
        assert_eq!(began(&lost), Some(40));
        // One of two people is hidden from the first side, which sees false points instead.
        assert_eq!(loss(&with([(1.0, 2.0), (1.0, 2.0)]), 39), None);
        assert_eq!(loss(&with([(0.0, 2.0), (2.0, 2.0)]), 39), None);
        assert_eq!(loss(&with([(0.0, 0.5), (0.0, 2.0)]), 39), None);
        assert_eq!(loss(&before, 39), None);
    }

    #[test]
    fn the_gain_is_that_of_the_binomial_likelihoods() {
        let met = [
            periods(0..10, [(9.0, 10.0), (9.0, 10.0)]),
            periods(10..12, [(2.0, 10.0), (2.0, 10.0)]),
        ]
        .concat();
        let log = |k: f64, n: f64, q: f64| k * q.ln() + (n - k) * (1.0 - q).ln();
        let q = 94.0 / 120.0;
        let expected = 2.0
            * (log(90.0, 100.0, 0.9) + log(4.0, 20.0, 0.2)
                - log(90.0, 100.0, q)
                - log(4.0, 20.0, q));
        assert!((loss(&met, 9).unwrap() - expected).abs() < 1e-9);
    }
}
