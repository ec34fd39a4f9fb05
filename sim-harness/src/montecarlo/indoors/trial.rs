//! One trial: a scenario played once, what the centre showed, and what that is worth.

use std::collections::BTreeMap;

use proto::wire::Picture;
use serde::Serialize;
use tracing::Level;
use tracing::subscriber::{NoSubscriber, with_default};

use crate::metrics::{Estimate, Score, Scorer, Settings, Truth};
use crate::rehearsal::Rehearsal;
use crate::scenario::Scenario;

/// What came out of one trial.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Outcome {
    pub(super) seed: u64,
    /// Scored from the first period on in which the centre follows anybody: before that, the nodes
    /// are not registered.
    pub(super) score: Score,
    /// When that was, seconds of the scene.
    pub(super) first_s: Option<f64>,
    /// The longest time for which one track was with nobody, seconds of the scene.
    pub(super) longest_false_s: f64,
    /// When somebody was found under another identity than before, seconds of the scene.
    pub(super) switches_s: Vec<f64>,
}

/// How long tracks have been with nobody.
#[derive(Debug, Default)]
struct Strays {
    since_s: BTreeMap<u64, f64>,
    longest_s: f64,
}

impl Strays {
    /// Takes the tracks of a moment that are with nobody.
    fn take(&mut self, time_s: f64, strays: &[u64]) {
        self.since_s.retain(|id, _| strays.contains(id));
        for id in strays {
            let since_s = *self.since_s.entry(*id).or_insert(time_s);
            self.longest_s = self.longest_s.max(time_s - since_s);
        }
    }
}

/// Plays `scenario` once.
///
/// # Errors
/// If it cannot be played.
pub(super) fn play(scenario: &Scenario, settings: Settings) -> anyhow::Result<Outcome> {
    // The centre tells of every registration: of many trials at once nobody could read that.
    if tracing::enabled!(Level::DEBUG) {
        return play_aloud(scenario, settings);
    }
    with_default(NoSubscriber::new(), || play_aloud(scenario, settings))
}

fn play_aloud(scenario: &Scenario, settings: Settings) -> anyhow::Result<Outcome> {
    let mut rehearsal = Rehearsal::new(scenario)?;
    let mut scorer: Scorer<usize, u64> = Scorer::new(settings)?;
    let (mut first_s, mut strays, mut switches_s) = (None, Strays::default(), Vec::new());
    for period in 0..scenario.period_count.unwrap_or(0) {
        rehearsal.play(period)?;
        let time_s = period as f64 * scenario.period_s;
        let estimates = rehearsal.site.picture.as_ref().map_or_else(Vec::new, estimates);
        if estimates.is_empty() && first_s.is_none() {
            continue;
        }
        first_s.get_or_insert(time_s);
        let truths: Vec<Truth<usize>> = rehearsal
            .truth(period)
            .iter()
            .enumerate()
            .map(|(id, at)| Truth { id, at_m: at.coords_m.into() })
            .collect();
        let moment = scorer.add(time_s, &truths, &estimates);
        switches_s.extend((0..moment.switch_count).map(|_| time_s));
        strays.take(time_s, &of_nobody(&truths, &estimates, settings.gate_m));
    }
    let (seed, score, longest_false_s) = (scenario.seed, scorer.score(), strays.longest_s);
    Ok(Outcome { seed, score, first_s, longest_false_s, switches_s })
}

fn estimates(picture: &Picture) -> Vec<Estimate<u64>> {
    let estimate = |person: &proto::wire::PersonInPicture| {
        let [x_m, y_m, ..] = person.state;
        let covariance_m2 = person.covariance_matrix().fixed_view::<2, 2>(0, 0).into_owned();
        Estimate { id: person.id, at_m: [x_m, y_m], covariance_m2: Some(covariance_m2) }
    };
    picture.people.iter().map(estimate).collect()
}

fn of_nobody(truths: &[Truth<usize>], estimates: &[Estimate<u64>], gate_m: f64) -> Vec<u64> {
    let is_near = |estimate: &Estimate<u64>, truth: &Truth<usize>| {
        let [x_m, y_m] = [0, 1].map(|axis| estimate.at_m[axis] - truth.at_m[axis]);
        x_m.hypot(y_m) <= gate_m
    };
    let is_stray = |one: &&Estimate<u64>| !truths.iter().any(|truth| is_near(one, truth));
    estimates.iter().filter(is_stray).map(|one| one.id).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_track_counts_as_false_for_as_long_as_it_is_with_nobody_on_end() {
        let mut strays = Strays::default();
        for (time_s, ids) in [(0.0, vec![1, 2]), (0.5, vec![1]), (1.0, vec![1, 2]), (1.5, vec![2])]
        {
            strays.take(time_s, &ids);
        }
        assert!((strays.longest_s - 1.0).abs() < 1e-12);
        let truths = [Truth { id: 0, at_m: [0.0, 0.0] }];
        let estimate = |id, x_m| Estimate { id, at_m: [x_m, 0.0], covariance_m2: None };
        let estimates = [estimate(7, 0.4), estimate(8, 0.6)];
        assert_eq!(of_nobody(&truths, &estimates, 0.5), [8]);
    }
}
