//! Against Dempster's rule from its definition, over all subsets.

use std::collections::BTreeMap;

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use crate::tracking::paper::PerAttribute;
use crate::tracking::paper::belief::{Masses, Workspace, pair, pignistic};
use crate::tracking::paper::degree::Degrees;

/// Rounding of sums of a few dozen products below 1, over their sum.
const SAME: f64 = 1e-12;
const TRUST: PerAttribute = PerAttribute { range: 0.9, angle: 0.6, radial: 0.6, strength: 0.3 };

/// Mass of every set of elements, as bits.
type Mass = BTreeMap<u32, f64>;

/// Dempster's rule: products go to intersections, the empty set's are shared out in proportion.
fn dempster(one: &Mass, other: &Mass) -> Mass {
    let mut both = Mass::new();
    for (a, mass_a) in one {
        for (b, mass_b) in other {
            *both.entry(a & b).or_default() += mass_a * mass_b;
        }
    }
    let conflict = both.remove(&0).unwrap_or(0.0);
    both.into_iter().map(|(set, mass)| (set, mass / (1.0 - conflict))).collect()
}

/// Each mass shared alike among the members of its set.
fn shared(mass: &Mass, element: u32) -> f64 {
    let holding = mass.iter().filter(|(set, _)| *set & (1 << element) != 0);
    holding.map(|(set, of_set)| of_set / f64::from(set.count_ones())).sum()
}

fn some_degrees(rng: &mut ChaCha8Rng) -> Degrees {
    let mut degree = || rng.random_bool(0.9).then(|| rng.random_range(0.0..4.0));
    [Some(0.5), degree(), degree(), degree()]
}

#[test]
fn attributes_combine_by_dempsters_rule() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for _ in 0..500 {
        let degrees = some_degrees(&mut rng);
        // Elements: match 1, no 2.
        let mut whole = Mass::from([(3, 1.0)]);
        for (degree, trust) in degrees.iter().zip([0.9, 0.6, 0.6, 0.3]) {
            let Some(degree) = degree else { continue };
            let likeness = (-degree * degree / 2.0).exp();
            let of_attribute = Mass::from([
                (1, trust * likeness),
                (2, trust * (1.0 - likeness)),
                (3, 1.0 - trust),
            ]);
            whole = dempster(&whole, &of_attribute);
        }
        for (got, set) in pair(&degrees, &TRUST).into_iter().zip([1, 2, 3]) {
            let want = whole.get(&set).copied().unwrap_or(0.0);
            assert!((got - want).abs() < SAME, "{degrees:?} {set}: {got} {want}");
        }
    }
}

#[test]
fn candidates_combine_by_dempsters_rule() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let (mut space, mut into) = (Workspace::default(), Vec::new());
    for trial in 0..400 {
        let count = trial % 6;
        let row: Vec<Masses> = (0..count).map(|_| pair(&some_degrees(&mut rng), &TRUST)).collect();
        // The highest bit is "none of them".
        let every = (1 << (count + 1)) - 1;
        let mut whole = Mass::from([(every, 1.0)]);
        for (index, [matching, no, either]) in row.iter().enumerate() {
            let candidate = 1 << index;
            let of_candidate =
                Mass::from([(candidate, *matching), (every & !candidate, *no), (every, *either)]);
            whole = dempster(&whole, &of_candidate);
        }
        let none = pignistic(&row, &mut space, &mut into);
        let none_wanted = shared(&whole, count);
        assert!((none - none_wanted).abs() < SAME, "none of {count}: {none} {none_wanted}");
        assert_eq!(into.len(), row.len());
        for (got, element) in into.iter().zip(0..) {
            let want = shared(&whole, element);
            assert!((got - want).abs() < SAME, "{element} of {count}: {got} {want}");
        }
    }
}

#[test]
fn one_attribute_ranks_as_its_degree_does() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let (mut space, mut into) = (Workspace::default(), Vec::new());
    for _ in 0..500 {
        let count = rng.random_range(1..12);
        let degrees: Vec<f64> = (0..count).map(|_| rng.random_range(0.0..5.0)).collect();
        let row: Vec<Masses> =
            degrees.iter().map(|d| pair(&[Some(*d), None, None, None], &TRUST)).collect();
        pignistic(&row, &mut space, &mut into);
        let least = degrees.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1)).unwrap().0;
        let most = into.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).unwrap().0;
        assert_eq!(least, most, "{degrees:?} {into:?}");
    }
}

#[test]
fn many_candidates_lose_no_digits() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let (mut space, mut into) = (Workspace::default(), Vec::new());
    let row: Vec<Masses> = (0..400).map(|_| pair(&some_degrees(&mut rng), &TRUST)).collect();
    let none = pignistic(&row, &mut space, &mut into);
    // Twins have the same probability wherever they are in the row.
    let mut twins = row.clone();
    twins.rotate_left(137);
    let mut rotated = Vec::new();
    let none_of_rotated = pignistic(&twins, &mut space, &mut rotated);
    rotated.rotate_right(137);
    assert!((none - none_of_rotated).abs() < SAME);
    for (one, other) in into.iter().zip(&rotated) {
        assert!(0.0 < *one && (one - other).abs() < SAME, "{one} {other}");
    }
    let sum: f64 = none + into.iter().sum::<f64>();
    assert!((sum - 1.0).abs() < SAME);
}
