//! From the truths and estimates of each moment to the score of a run.

use std::collections::BTreeMap;

use nalgebra::{Cholesky, Matrix2, Vector2};

use super::distance::{distance_m, gospa, ospa, pairs};
use super::score::Score;
use super::{Estimate, InvalidSettings, Settings, Truth};

/// Times are sums of many periods: their rounding must not move the end of the allowance by a moment.
const TIME_ROUNDING_S: f64 = 1e-6;

/// Watches one run, moment by moment.
///
/// Who belongs to whom: pairs of the moment before are kept as long as they are within the gate, as
/// \[clear-mot\] has it; the rest are paired by optimal assignment with the gate as its cut-off.
/// GOSPA and OSPA pair anew at every moment, as their definitions want it.
#[derive(Clone, Debug)]
pub struct Scorer<T, E> {
    settings: Settings,
    /// What adds up at once; the rest is worked out of the maps at the end.
    sums: Score,
    people: BTreeMap<T, Person<E>>,
    /// How many pairs a track and a truth have made, and how many of them after the allowance.
    pair_counts: BTreeMap<(E, T), [usize; 2]>,
}

#[derive(Clone, Copy, Debug)]
struct Person<E> {
    first_s: f64,
    found_s: Option<f64>,
    /// Whom it belonged to when last found.
    last: Option<E>,
    /// Whether that was at the last moment.
    is_held: bool,
}

impl<T: Copy + Ord, E: Copy + Ord> Scorer<T, E> {
    /// A scorer that has seen nothing.
    ///
    /// # Errors
    /// Names the first setting that makes no sense.
    pub fn new(settings: Settings) -> Result<Self, InvalidSettings> {
        settings.check()?;
        let (people, pair_counts) = (BTreeMap::new(), BTreeMap::new());
        Ok(Self { settings, sums: Score::default(), people, pair_counts })
    }

    /// Takes everybody who is there at `time_s` and everybody who is reported. Times ascend;
    /// identities are distinct. Gives what this moment counts; what only a whole run shows (purity,
    /// completeness, delay) is 0 there.
    pub fn add(&mut self, time_s: f64, truths: &[Truth<T>], estimates: &[Estimate<E>]) -> Score {
        for truth in truths {
            let new = Person { first_s: time_s, found_s: None, last: None, is_held: false };
            self.people.entry(truth.id).or_insert(new);
        }
        let paired = self.pair(truths, estimates);
        self.people.values_mut().for_each(|person| person.is_held = false);
        let found = truths.iter().zip(&paired).map(|(truth, estimate)| {
            self.count(time_s, truth, estimate.map(|index| &estimates[index]))
        });
        let of_people: Score = found.sum();
        let pair_count = paired.iter().flatten().count();
        let truths_m: Vec<[f64; 2]> = truths.iter().map(|truth| truth.at_m).collect();
        let estimates_m: Vec<[f64; 2]> = estimates.iter().map(|estimate| estimate.at_m).collect();
        let Settings { gospa_cutoff_m, ospa: scale, .. } = self.settings;
        let moment = Score {
            frame_count: 1,
            truth_count: truths.len(),
            estimate_count: estimates.len(),
            pair_count,
            false_count: estimates.len() - pair_count,
            gospa: gospa(&truths_m, &estimates_m, gospa_cutoff_m),
            ospa_m: ospa(&truths_m, &estimates_m, scale),
            ..of_people
        };
        self.sums = self.sums + moment;
        moment
    }

    /// The score so far.
    #[must_use]
    pub fn score(&self) -> Score {
        let mut most_of_track: BTreeMap<E, usize> = BTreeMap::new();
        let mut most_of_truth: BTreeMap<T, usize> = BTreeMap::new();
        for ((track, truth), [count, due_count]) in &self.pair_counts {
            let of_track = most_of_track.entry(*track).or_default();
            *of_track = (*of_track).max(*count);
            let of_truth = most_of_truth.entry(*truth).or_default();
            *of_truth = (*of_truth).max(*due_count);
        }
        let found = || self.people.values().filter_map(|person| Some((person, person.found_s?)));
        Score {
            pure_count: most_of_track.values().sum(),
            held_count: most_of_truth.values().sum(),
            person_count: self.people.len(),
            found_count: found().count(),
            delay_s: found().map(|(person, found_s)| found_s - person.first_s).sum(),
            ..self.sums
        }
    }

    /// The estimate of every truth.
    fn pair(&self, truths: &[Truth<T>], estimates: &[Estimate<E>]) -> Vec<Option<usize>> {
        let gate_m = self.settings.gate_m;
        let held = |truth: &Truth<T>| {
            let person = self.people.get(&truth.id).filter(|person| person.is_held)?;
            let at = estimates.iter().position(|estimate| Some(estimate.id) == person.last)?;
            (distance_m(truth.at_m, estimates[at].at_m) < gate_m).then_some(at)
        };
        let mut paired: Vec<Option<usize>> = truths.iter().map(held).collect();
        let free_truths: Vec<usize> =
            (0..truths.len()).filter(|truth| paired[*truth].is_none()).collect();
        let free_estimates: Vec<usize> =
            (0..estimates.len()).filter(|at| !paired.contains(&Some(*at))).collect();
        let truths_m: Vec<[f64; 2]> = free_truths.iter().map(|at| truths[*at].at_m).collect();
        let estimates_m: Vec<[f64; 2]> =
            free_estimates.iter().map(|at| estimates[*at].at_m).collect();
        let found = pairs(&truths_m, &estimates_m, gate_m);
        for (truth, estimate) in free_truths.into_iter().zip(found) {
            paired[truth] = estimate.map(|at| free_estimates[at]);
        }
        paired
    }

    /// What one truth adds, with its estimate.
    fn count(&mut self, time_s: f64, truth: &Truth<T>, found: Option<&Estimate<E>>) -> Score {
        let mut added = Score::default();
        let Some(person) = self.people.get_mut(&truth.id) else { return added };
        let is_due = self.settings.allowance_s <= time_s - person.first_s + TIME_ROUNDING_S;
        added.due_count = usize::from(is_due);
        let Some(estimate) = found else {
            added.missed_count = usize::from(is_due);
            return added;
        };
        let is_switched = person.last.is_some_and(|last| last != estimate.id);
        added.switch_count = usize::from(is_switched);
        person.last = Some(estimate.id);
        person.is_held = true;
        person.found_s.get_or_insert(time_s);
        let [count, due_count] = self.pair_counts.entry((estimate.id, truth.id)).or_default();
        *count += 1;
        *due_count += usize::from(is_due);
        added.squares_m2 = distance_m(truth.at_m, estimate.at_m).powi(2);
        if let Some(normalised) = normalised(truth.at_m, estimate) {
            (added.normalised, added.normalised_count) = (normalised, 1);
        }
        added
    }
}

/// `eᵀ P⁻¹ e` of the error `e` with the stated covariance `P`; `None` if none is stated, or something
/// that is no covariance.
fn normalised<E>(truth_m: [f64; 2], estimate: &Estimate<E>) -> Option<f64> {
    let covariance_m2: Matrix2<f64> = estimate.covariance_m2?;
    let error_m = Vector2::from(estimate.at_m) - Vector2::from(truth_m);
    let squared = error_m.dot(&Cholesky::new(covariance_m2)?.solve(&error_m));
    squared.is_finite().then_some(squared)
}
