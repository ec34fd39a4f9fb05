//! The default solver: pair hypotheses, robust maximum likelihood, decision.
//!
//! Hypotheses compete on some of the periods first, the best of them on more, and the best of these
//! climb: with wide covariances on those periods, then with the stated ones on all.

use serde::{Deserialize, Serialize};

use super::certificate::{Goal, confirmed};
use super::decide::{DecisionConfig, decide_among, too_wide};
use super::hypotheses::{Draws, Hypothesis, all, are_few, heaped};
use super::joint::joined;
use super::likelihood::{Model, score};
use super::modes::{Mode, START_SHARE, merged, refine_all, refine_from, refine_hopeful, rescaled};
use super::prepared::{Motion, Place, Prepared, apart_m2};
use super::{Certificate, Known, Outcome, Problem, Solution, Solver, Uncertified};

/// Factor on all covariances while hypotheses are ranked: they carry the errors of two points.
const RANKING_SCALE: f64 = 2.0;

/// Hypotheses that the first ranking passes on to the second.
const SHORT_LIST_COUNT: usize = 128;

/// How far these are apart, as a share of the distance of starts.
const SHORT_LIST_SHARE: f64 = 0.3;

/// Points of the node that the second ranking looks at per one of the first.
const SECOND_RANKING_FACTOR: usize = 4;

/// Hypotheses drawn at a time, and those near the best one that end the drawing: another pose with
/// a third of its matches, and so a tenth of its hypotheses, is then missed in one search of ten
/// thousand.
const BATCH_COUNT: usize = 64;
const ENOUGH_COUNT: usize = 100;

/// Before a drawn hypothesis is ranked, it is looked at on a share of the points, and given up where
/// it has less than this share of the best one's score there.
const GLANCE_SHARE: f64 = 0.2;
const GLANCE_FACTOR: usize = 3;

/// Share of the best score below which a start is given up; the larger one where the score is also
/// less than `WEAK_SCORE`, which two pairs of points reach. A start climbs to at most three quarters
/// of its share here, and a rival needs 0.3 of the odds: seen in the scene of \[registration\],
/// offices, clutter and degenerate scenes, seeds 0 and up.
const HOPELESS_SHARE: f64 = 0.12;
const WEAK_SHARE: f64 = 0.25;
const WEAK_SCORE: f64 = 25.0;

/// Fresh hypotheses per solution that starts from known modes.
const FRESH_COUNT: usize = 48;

/// Starts closer than this many typical standard deviations climb to the same maximum.
const SEPARATION_SIGMAS: f64 = 4.0;

/// Share of the best pose's Λ that no other pose is to reach. At 0.6 the proof takes three times as
/// many cells, at 0.5 five times.
const CERTIFIED_SHARE: f64 = 0.8;

/// Settings of the default solver.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PairwiseConfig {
    /// Seed of the draws where candidate pairs are too many to try all.
    pub seed: u64,
    /// Shortest segment, metres, that may fix a heading.
    pub min_baseline_m: f64,
    /// How many standard deviations the lengths of two segments may differ.
    pub length_gate_sigma: f64,
    /// Up to this many pairs of candidate matches are tried in full.
    pub exhaustive_pair_limit: usize,
    /// Most hypotheses that are ranked.
    pub max_hypothesis_count: usize,
    /// Points of the node that the first ranking of one hypothesis looks at.
    pub ranking_point_count: usize,
    /// Separated hypotheses that are refined.
    pub mode_count: usize,
    /// Poses that carry the node's points less than this apart, metres, are the same pose.
    pub merge_distance_m: f64,
    /// Most visits of pairs of points for the proof, after a full search, that no other pose comes
    /// near a determined one; 0 for none.
    pub certificate_visit_count: usize,
}

impl Default for PairwiseConfig {
    fn default() -> Self {
        Self {
            seed: 1,
            min_baseline_m: 0.5,
            length_gate_sigma: 3.0,
            exhaustive_pair_limit: 4_000,
            max_hypothesis_count: 2_000,
            ranking_point_count: 96,
            mode_count: 10,
            merge_distance_m: 0.1,
            certificate_visit_count: 100_000,
        }
    }
}

/// The default solver.
#[derive(Clone, Debug, Default)]
pub struct Pairwise {
    config: PairwiseConfig,
    decision: DecisionConfig,
}

impl Pairwise {
    /// The solver with these settings.
    #[must_use]
    pub fn new(config: PairwiseConfig, decision: DecisionConfig) -> Self {
        Self { config, decision }
    }
}

impl Solver for Pairwise {
    fn name(&self) -> &'static str {
        "default"
    }

    fn solve(&self, problem: &Problem, known: Option<&Known>) -> Solution {
        let data = Prepared::new(problem);
        let resumed = known.filter(|last| last.may_resume(&data)).and_then(|last| {
            let modes = self.resume(&data, last)?;
            Some((last.resumed(&modes), modes))
        });
        let conclude =
            |modes: &[Mode]| decide_among(&data, modes, problem.periods.len(), &self.decision);
        let (next, modes, pairwise) = if let Some((next, modes)) = resumed {
            let mut solution = conclude(&modes);
            solution.evidence.certificate = Certificate::lacking(Uncertified::Resumed);
            (next, modes, solution)
        } else {
            let found = self.search(&data);
            let (modes, solution) = confirmed(&data, found, &self.goal(&data), conclude);
            (Known::searched(&data, &modes), modes, solution)
        };
        let mut solution = self.with_joint_fit(pairwise, problem, (&data, &modes));
        solution.known = next.with_outcome(&solution.outcome);
        solution
    }
}

impl Pairwise {
    /// How far apart starts are.
    fn separation_m(&self, data: &Prepared) -> f64 {
        self.config.merge_distance_m.max(SEPARATION_SIGMAS * data.typical_sigma_m)
    }

    /// The solution with the joint fit in place of the pairwise estimate where there is one. The
    /// decision stays, because it rests on pairs alone, but for the limits of the spread.
    fn with_joint_fit(
        &self,
        pairwise: Solution,
        problem: &Problem,
        (data, modes): (&Prepared, &[Mode]),
    ) -> Solution {
        let mut solution = pairwise;
        let Some(estimate) = solution.estimate else { return solution };
        let pose = estimate.pose_ref_from_node;
        let best = modes.iter().find(|mode| mode.motion.pose() == pose);
        let Some(best) = best else { return solution };
        let inflation = solution.evidence.covariance_inflation;
        let Some(fit) = joined(problem, data, (best, &estimate, inflation)) else {
            return solution;
        };
        solution.estimate = Some(fit.estimate);
        solution.evidence.covariance_inflation = fit.covariance_inflation;
        if let Some(missing) = too_wide(data, best, &fit.estimate.covariance, &self.decision) {
            solution.estimate = None;
            solution.outcome = Outcome::Underdetermined { missing };
        }
        solution
    }

    /// What the certificate is to prove.
    fn goal(&self, data: &Prepared) -> Goal {
        Goal {
            share: CERTIFIED_SHARE,
            reach_m: self.separation_m(data),
            visit_count: self.config.certificate_visit_count,
        }
    }

    /// The modes from nothing.
    fn search(&self, data: &Prepared) -> Vec<Mode> {
        let rankings = Rankings::new(data, self.config.ranking_point_count);
        let radius_m = self.separation_m(data);
        let ranked = if are_few(data, &self.config) {
            let heaps = heaped(data, &all(data, &self.config), radius_m);
            rankings.first().all_of(heaps.into_iter())
        } else {
            self.drawn(data, &rankings.first(), radius_m)
        };
        let starts = rankings.narrowed(ranked, (self.config.mode_count, radius_m));
        let merge_distance_m = self.config.merge_distance_m;
        let modes = refine_all((rankings.second().data, data), &starts, merge_distance_m);
        rescaled(data, modes, merge_distance_m)
    }

    /// Draws until enough hypotheses agree with the best one.
    fn drawn(&self, data: &Prepared, ranking: &Ranking<'_>, radius_m: f64) -> Vec<Ranked> {
        let glance_data = data.thinned(self.config.ranking_point_count / GLANCE_FACTOR);
        let glance = glance_data.as_ref().map(Ranking::new);
        let mut draws = Draws::new(data, &self.config);
        let mut ranked: Vec<Ranked> = Vec::new();
        let (mut left, mut best_glance) = (self.config.max_hypothesis_count, 0.0_f64);
        while left > 0 {
            let mut batch = draws.next(left.min(BATCH_COUNT));
            batch.truncate(left);
            if batch.is_empty() {
                break;
            }
            left -= batch.len();
            if let Some(glance) = &glance {
                best_glance = keep_hopeful(glance, &mut batch, best_glance);
            }
            ranked.extend(ranking.all_of(batch.iter().map(|drawn| drawn.motion)));
            if agreeing_count(&ranked, radius_m) >= ENOUGH_COUNT {
                break;
            }
        }
        ranked
    }

    /// The modes from the known ones and the best of a few fresh hypotheses; `None` where they
    /// explain the data no longer.
    fn resume(&self, data: &Prepared, known: &Known) -> Option<Vec<Mode>> {
        let merge_distance_m = self.config.merge_distance_m;
        let mut modes: Vec<Mode> =
            known.starts().filter_map(|start| refine_from(data, start, 1.0)).collect();
        if let Some((rough, fresh)) = self.fresh(data, known, &modes) {
            modes.extend(refine_hopeful((rough.as_ref().unwrap_or(data), data), fresh, &modes));
        }
        let modes = rescaled(data, merged(data, modes, merge_distance_m), merge_distance_m);
        known.still_explains(data, &modes).then_some(modes)
    }

    /// The best of a few fresh hypotheses that is none of the modes, and the periods on which it
    /// was best where these are not all.
    fn fresh(
        &self,
        data: &Prepared,
        known: &Known,
        modes: &[Mode],
    ) -> Option<(Option<Prepared>, Motion)> {
        let config = PairwiseConfig {
            seed: self.config.seed.wrapping_add(u64::from(known.resumed_count()) + 1),
            ..self.config.clone()
        };
        let radius_m = self.separation_m(data);
        let is_new = |drawn: &Hypothesis| {
            let is_far = |mode: &Mode| data.displacement_m(&mode.motion, &drawn.motion) > radius_m;
            modes.iter().all(is_far)
        };
        let count = FRESH_COUNT.min(config.max_hypothesis_count);
        let drawn = Draws::new(data, &config).next(count);
        let fresh = drawn.into_iter().take(count).filter(is_new).map(|drawn| drawn.motion);
        let rankings = Rankings::new(data, config.ranking_point_count);
        let ranked = rankings.first().all_of(fresh);
        let best = rankings.narrowed(ranked, (1, radius_m)).first().copied()?;
        Some((rankings.second, best))
    }
}

/// Leaves out what does badly against the best so far; returns that one's score.
fn keep_hopeful(glance: &Ranking<'_>, batch: &mut Vec<Hypothesis>, best: f64) -> f64 {
    let mut room = Vec::new();
    let mut most = best;
    batch.retain(|drawn| {
        let found = score(&glance.model, &drawn.motion, &mut room);
        most = most.max(found);
        found >= GLANCE_SHARE * most
    });
    most
}

/// How many are at the best one's place.
fn agreeing_count(ranked: &[Ranked], radius_m: f64) -> usize {
    let best = ranked.iter().max_by(|a, b| a.score.total_cmp(&b.score));
    let count_near = |place: &Place| {
        let limit_m2 = radius_m * radius_m;
        ranked.iter().filter(|one| apart_m2(place, &one.place) < limit_m2).count()
    };
    best.map_or(0, |one| count_near(&one.place))
}

/// A hypothesis and how well it did.
#[derive(Clone, Copy, Debug)]
struct Ranked {
    score: f64,
    motion: Motion,
    place: Place,
}

/// Some of the periods, on which hypotheses compete.
struct Ranking<'a> {
    data: &'a Prepared,
    model: Model<'a>,
}

impl<'a> Ranking<'a> {
    fn new(data: &'a Prepared) -> Self {
        Self { data, model: Model::rough(data, START_SHARE, RANKING_SCALE) }
    }

    fn all_of(&self, motions: impl Iterator<Item = Motion>) -> Vec<Ranked> {
        let mut room = Vec::new();
        let ranked = |motion: Motion| Ranked {
            score: score(&self.model, &motion, &mut room),
            motion,
            place: self.data.place(&motion),
        };
        motions.map(ranked).collect()
    }
}

/// Few periods, and more; all where there is `None`.
struct Rankings<'a> {
    first: Option<Prepared>,
    second: Option<Prepared>,
    all: &'a Prepared,
}

impl<'a> Rankings<'a> {
    fn new(data: &'a Prepared, point_count: usize) -> Self {
        Self {
            first: data.thinned(point_count),
            second: data.thinned(point_count.saturating_mul(SECOND_RANKING_FACTOR)),
            all: data,
        }
    }

    fn first(&self) -> Ranking<'_> {
        Ranking::new(self.first.as_ref().unwrap_or(self.all))
    }

    fn second(&self) -> Ranking<'_> {
        Ranking::new(self.second.as_ref().unwrap_or(self.all))
    }

    /// The best `count` that are `radius_m` apart: of those some way apart that did best in the
    /// first ranking the best in the second.
    fn narrowed(&self, ranked: Vec<Ranked>, (count, radius_m): (usize, f64)) -> Vec<Motion> {
        let sorted = if self.first.is_some() {
            let short = best_apart(ranked, SHORT_LIST_COUNT, SHORT_LIST_SHARE * radius_m);
            self.second().all_of(short.iter().map(|one| one.motion))
        } else {
            ranked
        };
        let starts = best_apart(sorted, count, radius_m);
        let best = starts.first().map_or(0.0, |start| start.score);
        let is_hopeful = |one: &&Ranked| {
            one.score >= WEAK_SHARE * best
                || one.score >= HOPELESS_SHARE * best && one.score >= WEAK_SCORE
        };
        starts.iter().filter(is_hopeful).map(|one| one.motion).collect()
    }
}

/// The `count` best, each at least `radius_m` away from every better one.
fn best_apart(mut ranked: Vec<Ranked>, count: usize, radius_m: f64) -> Vec<Ranked> {
    ranked.sort_by(|a, b| b.score.total_cmp(&a.score));
    let limit_m2 = radius_m * radius_m;
    let mut kept: Vec<Ranked> = Vec::with_capacity(count.min(ranked.len()));
    for one in ranked {
        if kept.len() == count {
            break;
        }
        if kept.iter().all(|other| apart_m2(&other.place, &one.place) > limit_m2) {
            kept.push(one);
        }
    }
    kept
}
