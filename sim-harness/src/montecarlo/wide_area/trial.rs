//! What one tracker makes of one flight: counts and sums, which add over flights.

use std::collections::BTreeMap;
use std::iter::Sum;
use std::ops::Add;
use std::time::Duration;

use fusion_center::tracking::links::{Links, Origin, links, of_confirmed};
use fusion_center::tracking::{ReportId, Settled, Status, Track, Tracker};
use nalgebra::{Matrix2, Vector2, Vector4};
use serde::{Serialize, Serializer};

use super::case::Case;
use super::clock::thread_time;
use crate::metrics::{Estimate, Score, Scorer, Settings};

/// A track belongs to the target of the majority of so many first plots: with one plot alone, a track
/// that begins between two close targets belongs to either.
const ORIGIN: Origin = Origin::MajorityOf(3);

/// Counts and sums of one flight, or of several added.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub(super) struct Tally {
    #[serde(serialize_with = "link_counts")]
    pub(super) links: Links,
    /// By which right links are counted: those of the tracks, or, where that is another thing, of all
    /// plots with those of the look before.
    #[serde(serialize_with = "link_counts")]
    pub(super) plot_links: Links,
    /// Squared errors of smoothed places against the target to which the track belonged at its origin,
    /// at plots, square metres.
    pub(super) smoothed_m2: f64,
    /// The same before smoothing.
    pub(super) filtered_m2: f64,
    /// Plots at which these were taken.
    pub(super) error_count: usize,
    /// Squared errors of unsmoothed places in units of their covariance, per dimension, at plots of
    /// that target.
    pub(super) normalised: f64,
    /// Plots at which these were taken.
    pub(super) normalised_count: usize,
    /// Of what was reported at once; nothing where it was not asked for.
    pub(super) score: Score,
}

impl Tally {
    /// Root mean square error of smoothed places, metres.
    pub(super) fn rmse_m(&self) -> Option<f64> {
        self.mean_square_m2().map(f64::sqrt)
    }

    /// Mean square error of smoothed places, square metres.
    pub(super) fn mean_square_m2(&self) -> Option<f64> {
        (0 < self.error_count).then(|| self.smoothed_m2 / self.error_count as f64)
    }

    /// Root mean square error of unsmoothed places, metres.
    pub(super) fn filtered_rmse_m(&self) -> Option<f64> {
        (0 < self.error_count).then(|| (self.filtered_m2 / self.error_count as f64).sqrt())
    }

    /// 1 if covariances are true.
    pub(super) fn nees_per_dimension(&self) -> Option<f64> {
        (0 < self.normalised_count).then(|| self.normalised / self.normalised_count as f64)
    }
}

impl Add for Tally {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            links: [self.links, other.links].into_iter().sum(),
            plot_links: [self.plot_links, other.plot_links].into_iter().sum(),
            smoothed_m2: self.smoothed_m2 + other.smoothed_m2,
            filtered_m2: self.filtered_m2 + other.filtered_m2,
            error_count: self.error_count + other.error_count,
            normalised: self.normalised + other.normalised,
            normalised_count: self.normalised_count + other.normalised_count,
            score: self.score + other.score,
        }
    }
}

impl Sum for Tally {
    fn sum<I: Iterator<Item = Self>>(tallies: I) -> Self {
        tallies.fold(Self::default(), Add::add)
    }
}

fn link_counts<S: Serializer>(links: &Links, serializer: S) -> Result<S::Ok, S::Error> {
    let Links { track_count, update_count, clutter_count, link_count, right_link_count, .. } =
        *links;
    let counts = [
        ("track_count", track_count),
        ("update_count", update_count),
        ("clutter_count", clutter_count),
        ("link_count", link_count),
        ("right_link_count", right_link_count),
        ("identity_count", links.identity_count),
        ("pure_count", links.pure_count),
        ("target_count", links.target_count),
        ("switch_count", links.switch_count),
    ];
    serializer.collect_map(counts)
}

/// One track, for pictures.
#[derive(Clone, Debug, Default)]
pub(super) struct TrackWay {
    /// The plots that it took, with their targets.
    pub(super) plots_m: Vec<([f64; 2], Option<u32>)>,
    /// The smoothed way.
    pub(super) smoothed_m: Vec<[f64; 2]>,
}

/// What one tracker made of one flight.
#[derive(Clone, Debug, Default)]
pub(super) struct Outcome {
    pub(super) tally: Tally,
    /// Every track that was ever confirmed.
    pub(super) ways: Vec<TrackWay>,
    /// Processor time of each look.
    pub(super) took: Vec<Duration>,
    /// The same of taking what was settled, over all looks.
    pub(super) settling: Duration,
}

/// Lets a tracker see a flight. `settings` of the score of what it reports at once; none where that
/// would take longer than the tracking.
///
/// # Errors
/// If the tracker refuses a look, which no sound one does, or the settings make no sense.
pub(super) fn play(
    case: &Case,
    tracker: &mut dyn Tracker,
    settings: Option<Settings>,
) -> anyhow::Result<Outcome> {
    let mut scorer = settings.map(Scorer::new).transpose()?;
    let (mut settled, mut took) = (Vec::new(), Vec::with_capacity(case.looks.len()));
    let mut settling = Duration::ZERO;
    for look in &case.looks {
        let started = thread_time();
        tracker.look(&look.look())?;
        let looked = thread_time();
        took.push(looked.saturating_sub(started));
        tracker.take_settled(&mut settled);
        settling += thread_time().saturating_sub(looked);
        if let Some(scorer) = &mut scorer {
            scorer.add(look.time_s, &case.truths(look.time_s), &estimates(tracker.tracks()));
        }
    }
    tracker.finish();
    tracker.take_settled(&mut settled);
    let confirmed = of_confirmed(&settled);
    let score = scorer.map_or_else(Score::default, |scorer| scorer.score());
    let tally = Tally { score, ..tally(case, &confirmed) };
    Ok(Outcome { tally, ways: ways(case, &confirmed), took, settling })
}

/// Lets a tracker see a flight for the sake of the present alone, as the map does; processor time of
/// each look.
///
/// # Errors
/// If the tracker refuses a look, which no sound one does.
pub(super) fn follow(case: &Case, tracker: &mut dyn Tracker) -> anyhow::Result<Vec<Duration>> {
    let mut took = Vec::with_capacity(case.looks.len());
    for look in &case.looks {
        let started = thread_time();
        tracker.look(&look.look())?;
        tracker.forget_settled();
        took.push(thread_time().saturating_sub(started));
    }
    Ok(took)
}

/// Everything that is believed to be there.
fn estimates(tracks: &[Track]) -> Vec<Estimate<u64>> {
    let shown = tracks.iter().filter(|track| track.status != Status::Tentative);
    let estimate = |track: &Track| Estimate {
        id: track.id,
        at_m: [track.state[0], track.state[1]],
        covariance_m2: Some(track.covariance.fixed_view::<2, 2>(0, 0).into_owned()),
    };
    shown.map(estimate).collect()
}

fn tally(case: &Case, settled: &[Settled]) -> Tally {
    let target_of = |report: ReportId| case.target_of(report);
    let counted = links(settled, ORIGIN, target_of);
    let mut tally = Tally { links: counted, plot_links: counted, ..Tally::default() };
    let origins = origins(case, settled);
    for step in settled {
        let Some(target) = origins.get(&step.track).copied().flatten() else { continue };
        let Some(report) = step.report else { continue };
        let Some(true_m) = case.place_m(target, step.time_s) else { continue };
        let error = |state: &Vector4<f64>| -> Vector2<f64> {
            state.fixed_rows::<2>(0).into_owned() - true_m
        };
        tally.smoothed_m2 += error(&step.smoothed_state).norm_squared();
        tally.filtered_m2 += error(&step.state).norm_squared();
        tally.error_count += 1;
        let covariance_m2: Matrix2<f64> = step.covariance.fixed_view::<2, 2>(0, 0).into_owned();
        let is_right = case.target_of(report) == Some(target);
        if let Some(inverse) = covariance_m2.cholesky().filter(|_| is_right) {
            let off_m = error(&step.state);
            tally.normalised += 0.5 * off_m.dot(&inverse.solve(&off_m));
            tally.normalised_count += 1;
        }
    }
    tally
}

/// To which target each track belonged at its origin: the majority of its first plots, as [`ORIGIN`]
/// has it, the earlier one of equals.
fn origins(case: &Case, settled: &[Settled]) -> BTreeMap<u64, Option<u32>> {
    let Origin::MajorityOf(first_count) = ORIGIN else { return BTreeMap::new() };
    let mut firsts: BTreeMap<u64, Vec<Option<u32>>> = BTreeMap::new();
    for step in settled {
        let first = firsts.entry(step.track).or_default();
        if let Some(report) = step.report.filter(|_| first.len() < first_count) {
            first.push(case.target_of(report));
        }
    }
    firsts.iter().map(|(track, first)| (*track, majority(first))).collect()
}

/// The target that most of the plots are of; the earlier one of equals.
fn majority(plots: &[Option<u32>]) -> Option<u32> {
    let count = |target: u32| plots.iter().filter(|other| **other == Some(target)).count();
    let most = plots.iter().flatten().map(|target| count(*target)).max()?;
    plots.iter().flatten().copied().find(|target| count(*target) == most)
}

fn ways(case: &Case, settled: &[Settled]) -> Vec<TrackWay> {
    let mut ways: BTreeMap<u64, TrackWay> = BTreeMap::new();
    for step in settled {
        let way = ways.entry(step.track).or_default();
        way.smoothed_m.push([step.smoothed_state[0], step.smoothed_state[1]]);
        let plot = step.report.and_then(|report| {
            let look = case.looks.get(usize::try_from(report.look_index).ok()?)?;
            let plot = look.plots.iter().find(|plot| plot.report_index == report.report_index)?;
            Some((plot.position_m.into(), case.target_of(report)))
        });
        way.plots_m.extend(plot);
    }
    ways.into_values().collect()
}
