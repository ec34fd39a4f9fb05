//! The metrics against cases worked by hand, brute force, and the stored values of Stone Soup.

use std::collections::BTreeMap;

use nalgebra::Matrix2;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::Deserialize;

use super::*;

/// Sums of a few squares of metres in another order, and numbers that went through JSON.
const SAME: f64 = 1e-9;
const SETTINGS: Settings = Settings {
    gate_m: 1.0,
    allowance_s: 0.0,
    gospa_cutoff_m: 1.0,
    ospa: OspaScale { order: 1.0, cutoff_m: 1.0 },
};

fn assert_same(got: f64, want: f64, what: &str) {
    assert!((got - want).abs() < SAME, "{what}: got {got}, want {want}");
}

/// One line per moment: truths and estimates as `(id, x_m)` on a line.
type Moment<'a> = (&'a [(char, f64)], &'a [(u32, f64)]);

fn scored(settings: Settings, moments: &[Moment<'_>]) -> Score {
    let mut scorer = Scorer::new(settings).unwrap();
    for (second, (truths, estimates)) in moments.iter().enumerate() {
        let truths: Vec<_> =
            truths.iter().map(|(id, x_m)| Truth { id: *id, at_m: [*x_m, 0.0] }).collect();
        let place =
            |(id, x_m): &(u32, f64)| Estimate { id: *id, at_m: [*x_m, 0.0], covariance_m2: None };
        let estimates: Vec<_> = estimates.iter().map(place).collect();
        scorer.add(second as f64, &truths, &estimates);
    }
    scorer.score()
}

#[test]
fn gospa_and_ospa_of_a_case_worked_by_hand() {
    // 0 and 3 are found 0.3 and 0.4 away, 8 is missed, 20 is false.
    let truths_m = [[0.0, 0.0], [3.0, 0.0], [8.0, 0.0]];
    let estimates_m = [[3.0, 0.4], [20.0, 0.0], [-0.3, 0.0]];
    let parts = gospa(&truths_m, &estimates_m, 2.0);
    assert_same(parts.localisation_m2, 0.25, "0.09 + 0.16");
    assert_same(parts.missed_m2, 2.0, "c²/2");
    assert_same(parts.false_m2, 2.0, "c²/2");
    assert_same(parts.distance_m(), 4.25_f64.sqrt(), "distance");
    assert_eq!(pairs(&truths_m, &estimates_m, 2.0), [Some(2), Some(0), None]);
    // (0.3 + 0.4 + 2) / 3 of order 1.
    assert_same(
        ospa(&truths_m, &estimates_m, OspaScale { order: 1.0, cutoff_m: 2.0 }),
        0.9,
        "OSPA",
    );
    // (0.3 + 0.4 + 2 + 2) / 4 with one more estimate.
    let more = [[3.0, 0.4], [20.0, 0.0], [-0.3, 0.0], [30.0, 0.0]];
    assert_same(ospa(&truths_m, &more, OspaScale { order: 1.0, cutoff_m: 2.0 }), 1.175, "OSPA");
    assert_same(ospa(&[], &[], SETTINGS.ospa), 0.0, "nobody");
    assert_same(gospa(&[], &[], 1.0).distance_m(), 0.0, "nobody");
}

#[test]
fn a_place_that_is_no_number_is_false_and_finds_nobody() {
    let broken = [[f64::NAN, 0.0]];
    let parts = gospa(&[[0.0, 0.0]], &broken, 1.0);
    assert_same(parts.distance_m(), 1.0, "missed and false");
    assert_same(ospa(&[[0.0, 0.0]], &broken, SETTINGS.ospa), 1.0, "OSPA");
    let score = scored(SETTINGS, &[(&[('a', 0.0)], &[(1, f64::NAN)])]);
    assert_eq!((score.pair_count, score.missed_count, score.false_count), (0, 1, 1));
}

/// GOSPA as the minimum over every way to pair, straight from its definition.
fn least(truths_m: &[[f64; 2]], estimates_m: &[[f64; 2]], cutoff_m: f64) -> f64 {
    let half_m2 = 0.5 * cutoff_m * cutoff_m;
    let Some((first, rest)) = truths_m.split_first() else {
        return half_m2 * estimates_m.len() as f64;
    };
    let missed = half_m2 + least(rest, estimates_m, cutoff_m);
    let found = (0..estimates_m.len()).map(|at| {
        let mut others = estimates_m.to_vec();
        let [x_m, y_m] = others.remove(at);
        let square_m2 = (first[0] - x_m).powi(2) + (first[1] - y_m).powi(2);
        square_m2 + least(rest, &others, cutoff_m)
    });
    found.fold(missed, f64::min)
}

#[test]
fn gospa_is_the_minimum_over_all_pairings() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    for _ in 0..500 {
        let mut places = |count: usize| -> Vec<[f64; 2]> {
            (0..count).map(|_| [0, 1].map(|_| rng.random_range(-1.0..1.0))).collect()
        };
        let (truths_m, estimates_m) = (places(4), places(3));
        let got = gospa(&truths_m, &estimates_m, 0.7).distance_m();
        assert_same(got, least(&truths_m, &estimates_m, 0.7).sqrt(), "GOSPA");
    }
}

#[test]
fn a_run_worked_by_hand() {
    // a is found from the second moment on by 1, lost once, and then found by 2. b is found at once
    // by 7, which goes over to c in the end.
    let score = scored(
        Settings { allowance_s: 1.0, ..SETTINGS },
        &[
            (&[('a', 0.0), ('b', 10.0)], &[(7, 10.5)]),
            (&[('a', 0.0), ('b', 10.0)], &[(1, 0.3), (7, 10.0), (9, 50.0)]),
            (&[('a', 0.0), ('b', 10.0)], &[(7, 10.0)]),
            (&[('a', 0.0), ('b', 10.0)], &[(2, 0.4), (7, 10.0)]),
            (&[('a', 0.0), ('c', 20.0)], &[(2, 0.0), (7, 20.0)]),
        ],
    );
    assert_eq!(score.frame_count, 5);
    assert_eq!((score.truth_count, score.estimate_count, score.pair_count), (10, 9, 8));
    assert_eq!(score.due_count, 7, "the first of a, b and c are allowed for");
    assert_eq!((score.missed_count, score.false_count), (1, 1));
    assert_eq!(score.switch_count, 1, "of a, from 1 to 2");
    assert_eq!((score.person_count, score.found_count), (3, 3));
    assert_same(score.initiation_delay_s().unwrap(), 1.0 / 3.0, "1 s of a, of three");
    assert_same(score.rmse_m().unwrap(), ((0.25 + 0.09 + 0.16) / 8.0_f64).sqrt(), "RMSE");
    // 1 and 2 are pure; 7 is with b in 4 of 5. a's longest is 2 of 4 due, b's 3 of 3.
    assert_same(score.purity().unwrap(), 7.0 / 8.0, "purity");
    assert_same(score.completeness().unwrap(), 5.0 / 7.0, "completeness");
    assert_same(score.missed_share().unwrap(), 1.0 / 7.0, "missed");
    assert_same(score.false_per_frame().unwrap(), 0.2, "false");
    // 0.5 + 1, then 1 false, then 1 missed, by halves; pairs 0.5.
    let [localisation, missed, false_] = score.gospa_parts_m2().unwrap();
    assert_same(localisation, 0.5 / 5.0, "localisation");
    assert_same(missed, 0.5 * 2.0 / 5.0, "missed");
    assert_same(false_, 0.5 / 5.0, "false");
    assert_same(score.gospa_m().unwrap(), (localisation + missed + false_).sqrt(), "GOSPA");
    // (0.5 + 1)/2, (0.3 + 0 + 1)/3, (0 + 1)/2, 0.4/2, 0.
    let ospa_m = (0.75 + 1.3 / 3.0 + 0.5 + 0.2) / 5.0;
    assert_same(score.mean_ospa_m().unwrap(), ospa_m, "OSPA");
    let twice = [score, score].into_iter().sum::<Score>();
    assert_eq!((twice.due_count, twice.switch_count), (14, 2));
    assert_eq!(twice.missed_share(), score.missed_share());
}

#[test]
fn a_track_keeps_its_person_while_it_is_within_the_gate() {
    // 2 comes nearer to a than 1 is, but 1 was a's before.
    let near: Moment<'_> = (&[('a', 0.0)], &[(1, 0.2)]);
    let two: Moment<'_> = (&[('a', 0.0)], &[(1, 0.6), (2, 0.1)]);
    let gone: Moment<'_> = (&[('a', 0.0)], &[(1, 1.1), (2, 0.1)]);
    assert_eq!(scored(SETTINGS, &[near, two]).switch_count, 0);
    assert_eq!(scored(SETTINGS, &[near, two, gone]).switch_count, 1);
    assert_eq!(scored(SETTINGS, &[near, two, gone]).false_count, 2);
    // Once lost it has no right to anybody: the nearer one is taken.
    let lost: Moment<'_> = (&[('a', 0.0)], &[]);
    assert_eq!(scored(SETTINGS, &[near, lost, two]).switch_count, 1);
}

#[test]
fn nothing_gives_no_figures() {
    let score = scored(SETTINGS, &[]);
    let figures = [
        score.rmse_m(),
        score.missed_share(),
        score.false_per_frame(),
        score.purity(),
        score.completeness(),
        score.initiation_delay_s(),
        score.nees(),
        score.gospa_m(),
        score.mean_ospa_m(),
    ];
    assert_eq!(figures, [None; 9]);
    assert_eq!(score.gospa_parts_m2(), None);
}

#[test]
fn nees_is_of_the_stated_covariance() {
    let nees = |covariance_m2: Option<Matrix2<f64>>| {
        let mut scorer = Scorer::new(SETTINGS).unwrap();
        let estimate = Estimate { id: 1, at_m: [0.1, 0.2], covariance_m2 };
        scorer.add(0.0, &[Truth { id: 1, at_m: [0.0, 0.0] }], &[estimate]);
        scorer.score().nees()
    };
    // P = [[2, 1], [1, 3]] / 100 has the inverse [[3, -1], [-1, 2]] * 20: 20 (0.03 - 0.04 + 0.08).
    let correlated = Matrix2::new(0.02, 0.01, 0.01, 0.03);
    assert_same(nees(Some(correlated)).unwrap(), 1.4, "NEES");
    assert_eq!(nees(None), None);
    assert_eq!(nees(Some(Matrix2::zeros())), None);
    assert_eq!(nees(Some(Matrix2::from_element(f64::NAN))), None);
}

#[test]
fn settings_that_make_no_sense_are_named() {
    let spoilt: [(Settings, &str); 5] = [
        (Settings { gate_m: 0.0, ..SETTINGS }, "gate_m is 0"),
        (Settings { allowance_s: -1.0, ..SETTINGS }, "allowance_s is -1"),
        (Settings { gospa_cutoff_m: f64::NAN, ..SETTINGS }, "gospa_cutoff_m is NaN"),
        (Settings { ospa: OspaScale { order: 0.5, cutoff_m: 1.0 }, ..SETTINGS }, "order is 0.5"),
        (Settings { ospa: OspaScale { order: 1.0, cutoff_m: -2.0 }, ..SETTINGS }, "cutoff_m is -2"),
    ];
    for (settings, complaint) in spoilt {
        let error = Scorer::<u8, u8>::new(settings).unwrap_err();
        assert!(error.to_string().contains(complaint), "{error}");
    }
}

/// Made by fixtures/stone_soup.py.
const STONE_SOUP: &str = include_str!("fixtures/stone_soup.json");

#[derive(Deserialize)]
struct Fixture {
    moments: Vec<SoupMoment>,
    runs: Vec<SoupRun>,
}

#[derive(Deserialize)]
struct SoupMoment {
    truths_m: Vec<[f64; 2]>,
    estimates_m: Vec<[f64; 2]>,
    cutoff_m: f64,
    order: f64,
    gospa_m: f64,
    localisation_m2: f64,
    missed_m2: f64,
    false_m2: f64,
    ospa_m: f64,
}

#[derive(Deserialize)]
struct SoupRun {
    /// `truth` or `track`, second, identity, x, y.
    rows: Vec<(String, u32, u32, f64, f64)>,
    completeness: f64,
    ambiguity: f64,
    spuriousness: f64,
    track_changes: f64,
}

#[test]
fn gospa_and_ospa_are_stone_soups() {
    let fixture: Fixture = serde_json::from_str(STONE_SOUP).unwrap();
    assert!(100 <= fixture.moments.len());
    for SoupMoment { truths_m, estimates_m, cutoff_m, order, .. } in &fixture.moments {
        assert!(truths_m.len() + estimates_m.len() > 0 && 0.0 < *cutoff_m && 1.0 <= *order);
    }
    for soup in &fixture.moments {
        let parts = gospa(&soup.truths_m, &soup.estimates_m, soup.cutoff_m);
        assert_same(parts.distance_m(), soup.gospa_m, "GOSPA");
        assert_same(parts.localisation_m2, soup.localisation_m2, "localisation");
        assert_same(parts.missed_m2, soup.missed_m2, "missed");
        assert_same(parts.false_m2, soup.false_m2, "false");
        let scale = OspaScale { order: soup.order, cutoff_m: soup.cutoff_m };
        assert_same(ospa(&soup.truths_m, &soup.estimates_m, scale), soup.ospa_m, "OSPA");
    }
}

/// Everybody who is there and every track of one second.
type SoupSecond = (Vec<Truth<u32>>, Vec<Estimate<u32>>);

#[test]
fn runs_are_counted_as_stone_soups_siap_metrics_do() {
    let fixture: Fixture = serde_json::from_str(STONE_SOUP).unwrap();
    for soup in &fixture.runs {
        let mut moments: BTreeMap<u32, SoupSecond> = BTreeMap::new();
        for (kind, second, id, x_m, y_m) in &soup.rows {
            let (truths, estimates) = moments.entry(*second).or_default();
            let (id, at_m) = (*id, [*x_m, *y_m]);
            match kind.as_str() {
                "truth" => truths.push(Truth { id, at_m }),
                _ => estimates.push(Estimate { id, at_m, covariance_m2: None }),
            }
        }
        let mut scorer = Scorer::new(SETTINGS).unwrap();
        for (second, (truths, estimates)) in &moments {
            scorer.add(f64::from(*second), truths, estimates);
        }
        let score = scorer.score();
        let share = |part: usize, whole: usize| part as f64 / whole as f64;
        assert_same(1.0 - score.missed_share().unwrap(), soup.completeness, "completeness");
        assert_same(share(score.false_count, score.estimate_count), soup.spuriousness, "spurious");
        assert_same(score.switch_count as f64, soup.track_changes, "changes");
        assert_same(soup.ambiguity, 1.0, "one track for each");
        assert_same(score.purity().unwrap(), 1.0, "no track follows two");
    }
}
