//! Degrees worked by hand, and decisions against all that could be decided.

use nalgebra::{Matrix2, Vector2};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use crate::tracking::paper::decide::{Candidate, Choice, Decider};
use crate::tracking::paper::degree::{degrees, weighted};
use crate::tracking::paper::geometry::{Gradients, Sight};
use crate::tracking::paper::{BeliefDecision, Mode, PaperConfig};
use crate::tracking::{Plot, Radial};

/// Rounding of sums of a few numbers below 10.
const SAME: f64 = 1e-9;

fn plot(radial_m_per_s: f64, strength_db: f64) -> Plot {
    Plot {
        position_m: Vector2::zeros(),
        covariance_m2: Matrix2::new(25.0, 0.0, 0.0, 100.0),
        radial: Some(Radial {
            velocity_m_per_s: radial_m_per_s,
            sigma_m_per_s: 0.5,
            direction: Vector2::y(),
            wrap_m_per_s: Some(20.0),
        }),
        strength_db: Some(strength_db),
        report_index: 0,
    }
}

fn sight(range_m: f64, cone_rad: f64) -> Sight {
    Sight { range_m, cone_rad, side: 1.0 }
}

/// The range changes by 0.8 m per metre to the north, the angle by 1 mrad per metre to the west.
const GRADIENTS: Gradients =
    Gradients { range: Vector2::new(0.0, 0.8), cone: Vector2::new(-1e-3, 0.0) };

#[test]
fn degrees_by_hand() {
    let config = PaperConfig::default();
    let (expected, seen) = (sight(1000.0, 1.0), sight(1016.0, 0.98));
    let got =
        degrees(&config, (&expected, &plot(9.0, 12.0)), (&seen, &plot(-9.5, 18.0)), &GRADIENTS);
    // 16 m over 0.8 · 10 m, 20 mrad over 5 mrad, −18.5 + 20 m/s over 0.5 m/s, 6 dB over 3 dB.
    let by_hand = [2.0, 4.0, 3.0, 2.0];
    for (degree, want) in got.iter().zip(by_hand) {
        assert!((degree.unwrap() - want).abs() < SAME, "{got:?}");
    }
    assert!((weighted(&got, &config.weight) - 2.6).abs() < SAME);
}

#[test]
fn settings_stand_for_the_errors_of_the_plots() {
    let config = PaperConfig {
        range_error_m: 4.0,
        angle_error_rad: 0.01,
        radial_error_m_per_s: 1.0,
        strength_error_db: 6.0,
        ..PaperConfig::default()
    };
    let (expected, seen) = (sight(1000.0, 1.0), sight(1016.0, 0.98));
    let got =
        degrees(&config, (&expected, &plot(9.0, 12.0)), (&seen, &plot(11.0, 18.0)), &GRADIENTS);
    for (degree, want) in got.iter().zip([4.0, 2.0, 2.0, 1.0]) {
        assert!((degree.unwrap() - want).abs() < SAME, "{got:?}");
    }
}

#[test]
fn a_missing_attribute_leaves_its_weight_to_the_others() {
    let config = PaperConfig::default();
    let silent = Plot { radial: None, strength_db: None, ..plot(0.0, 0.0) };
    let (expected, seen) = (sight(1000.0, 1.0), sight(1016.0, 0.98));
    let got = degrees(&config, (&expected, &plot(9.0, 12.0)), (&seen, &silent), &GRADIENTS);
    assert_eq!(got[2..], [None, None]);
    // (0.5 · 2 + 0.2 · 4) / 0.7
    assert!((weighted(&got, &config.weight) - 1.8 / 0.7).abs() < SAME);
}

/// Up to five tracks and plots, most pairs possible; ranges weigh all, so that degrees are costs.
fn scene(rng: &mut ChaCha8Rng) -> (usize, usize, Vec<Candidate>) {
    let (rows, columns) = (rng.random_range(1..6), rng.random_range(1..6));
    let mut candidates = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            if rng.random_bool(0.7) {
                let degree = rng.random_range(0.0..6.0);
                candidates.push(Candidate {
                    row,
                    column,
                    degrees: [Some(degree), None, None, None],
                });
            }
        }
    }
    (rows, columns, candidates)
}

fn decided(
    mode: Mode,
    config: &PaperConfig,
    (rows, columns, candidates): &(usize, usize, Vec<Candidate>),
) -> Vec<Option<Choice>> {
    let mut choices = Vec::new();
    let counts = (*rows, *columns);
    Decider::default().decide((mode, config), candidates, counts, &mut choices).unwrap();
    choices
}

/// Most pairs, then least cost, over all ways to pair rows from `row` on.
fn best(
    (rows, candidates): (usize, &[(usize, usize, f64)]),
    row: usize,
    taken: &mut Vec<usize>,
) -> (usize, f64) {
    if row == rows {
        return (0, 0.0);
    }
    let mut least = best((rows, candidates), row + 1, taken);
    for (_, column, cost) in candidates.iter().filter(|candidate| candidate.0 == row) {
        if taken.contains(column) {
            continue;
        }
        taken.push(*column);
        let (count, sum) = best((rows, candidates), row + 1, taken);
        taken.pop();
        let is_better = least.0 < count + 1 || (least.0 == count + 1 && cost + sum < least.1);
        least = if is_better { (count + 1, cost + sum) } else { least };
    }
    least
}

fn check_optimum(choices: &[Option<Choice>], candidates: &[(usize, usize, f64)]) {
    let mut columns: Vec<usize> = choices.iter().flatten().map(|choice| choice.column).collect();
    let (mut sum, count) = (0.0, columns.len());
    for (row, choice) in choices.iter().enumerate() {
        let Some(choice) = choice else { continue };
        let is_pair = |c: &&(usize, usize, f64)| c.0 == row && c.1 == choice.column;
        sum += candidates.iter().find(is_pair).unwrap().2;
    }
    columns.sort_unstable();
    columns.dedup();
    assert_eq!(columns.len(), count, "no plot twice");
    let (most, least) = best((choices.len(), candidates), 0, &mut Vec::new());
    assert_eq!(count, most);
    assert!((sum - least).abs() < SAME, "{sum} {least}");
}

#[test]
fn the_paper_makes_as_many_pairs_as_can_be_of_the_least_sum() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    for _ in 0..1000 {
        let scene = scene(&mut rng);
        let choices = decided(Mode::Paper, &PaperConfig::default(), &scene);
        let costs: Vec<_> =
            scene.2.iter().map(|c| (c.row, c.column, c.degrees[0].unwrap())).collect();
        check_optimum(&choices, &costs);
        assert!(choices.iter().flatten().all(|choice| (choice.share - 1.0).abs() < SAME));
    }
}

#[test]
fn the_nearest_is_the_least_of_its_row_and_belief_in_one_attribute_is_the_same() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for _ in 0..1000 {
        let scene = scene(&mut rng);
        let nearest = decided(Mode::Nearest, &PaperConfig::default(), &scene);
        let believed = decided(Mode::Belief, &PaperConfig::default(), &scene);
        for row in 0..scene.0 {
            let of_row = scene.2.iter().filter(|candidate| candidate.row == row);
            let least =
                of_row.min_by(|a, b| a.degrees[0].unwrap().total_cmp(&b.degrees[0].unwrap()));
            let want = least.map(|candidate| candidate.column);
            assert_eq!(nearest[row].map(|choice| choice.column), want);
            assert_eq!(believed[row].map(|choice| choice.column), want);
            assert!(believed[row].is_none_or(|c| 0.0 < c.share && c.share < 1.0));
        }
    }
}

#[test]
fn exclusive_belief_has_the_largest_product() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut config = PaperConfig::default();
    config.belief.decision = BeliefDecision::Exclusive;
    for _ in 0..500 {
        let scene = scene(&mut rng);
        let choices = decided(Mode::Belief, &config, &scene);
        let share = |pair: &Candidate| probability(pair, &scene);
        let costs: Vec<_> = scene.2.iter().map(|c| (c.row, c.column, -share(c).ln())).collect();
        check_optimum(&choices, &costs);
    }
}

/// Pignistic probability of a pair, by the enumeration that `tests/belief.rs` checks.
fn probability(pair: &Candidate, scene: &(usize, usize, Vec<Candidate>)) -> f64 {
    use crate::tracking::paper::belief;
    let trust = PaperConfig::default().belief.trust;
    let row: Vec<&Candidate> = scene.2.iter().filter(|other| other.row == pair.row).collect();
    let masses: Vec<_> = row.iter().map(|c| belief::pair(&c.degrees, &trust)).collect();
    let mut shares = Vec::new();
    belief::pignistic(&masses, &mut belief::Workspace::default(), &mut shares);
    let place = row.iter().position(|other| other.column == pair.column).unwrap();
    shares[place]
}

#[test]
fn none_is_decided_where_it_is_more_probable() {
    let near =
        |column, degree| Candidate { row: 0, column, degrees: [Some(degree), None, None, None] };
    for (decision, far) in [
        (BeliefDecision::Row, Some(0)),
        (BeliefDecision::Exclusive, Some(0)),
        (BeliefDecision::RowOrNone, None),
        (BeliefDecision::ExclusiveOrNone, None),
    ] {
        let mut config = PaperConfig::default();
        config.belief.decision = decision;
        let column = |degree| {
            let scene = (1, 1, vec![near(0, degree)]);
            decided(Mode::Belief, &config, &scene)[0].map(|choice| choice.column)
        };
        assert_eq!(column(0.1), Some(0), "{decision:?}");
        assert_eq!(column(4.0), far, "{decision:?}");
    }
}

#[test]
fn beyond_the_largest_degree_nothing_is_paired() {
    let config = PaperConfig { max_degree: 3.0, ..PaperConfig::default() };
    for mode in [Mode::Paper, Mode::Nearest] {
        for (degree, want) in [(2.9, Some(0)), (3.1, None)] {
            let pair = Candidate { row: 0, column: 0, degrees: [Some(degree), None, None, None] };
            let choices = decided(mode, &config, &(1, 1, vec![pair]));
            assert_eq!(choices[0].map(|choice| choice.column), want, "{mode:?} {degree}");
        }
    }
}
