//! Whether a registered node was moved: do its points still meet those of the others?
//!
//! Every closed period, every pair of registered nodes is asked which change of their relative pose
//! the newest points of several spans want, beside what the periods before wanted (`fit`). A single
//! pair of people seen by a real radar says little in a second or two: a person's place is known to
//! a decimetre, and its errors last about a second. So what all pairs of a node say is added up
//! (`case`), and the node that was moved is the one whose pairs say most (`blame`). Between two nodes nobody can tell; the reference stands by
//! definition.
//!
//! How much longer than a period errors last is learned for each pair too: two changes from
//! neighbouring windows under the same poses differ by chance alone, so their squared distance in
//! units of the stated covariance is the factor by which the data say less than stated.

mod blame;
mod case;
mod fit;
mod lost;

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};
use proto::geom::{Node, Ref, Se2, carried_by_pose};
use proto::ids::NodeId;
use proto::measured::line_of_sight;

use super::pairs::Pair;
use crate::config::MonitorConfig;
use crate::gather::{Gather, KeptSet};
use blame::Blame;
use case::Case;
use fit::{Candidate, Correction, Prior, Sighted, Weighted};
use lost::Met;

/// Lengths, in windows, of the spans of newest periods that are looked at: a short one, so that a
/// large move shows soon, and a long one, so that a small one shows at all.
const SPANS: [f64; 3] = [0.4, 1.0, 2.0];
const WHOLE: usize = 1;
/// By how much longer spans are louder in quiet times than what each pair has learned from
/// neighbouring windows explains: errors that last. Tuned on 12 runs of simulated radars at 2, 4 and
/// 10 periods a second, where the mean chi-squares of the spans were 3.2, 3.6 and 3.8, and at 10
/// periods a second 3.3, 4.2 and 5.2.
const LOUDNESS: [f64; SPANS.len()] = [1.0, 1.0, 1.4];
/// Windows looked at in all: those before a span say what was right before, beside the poses in
/// force, and what they miss by needs no explanation now.
const REACH: i64 = 6;
/// Periods by which the oldest common points may be younger than what a span asks for.
const SLACK_PERIODS: i64 = 5;
/// A change of a pair of which this is the chi-square is looked at often.
const STIRRED: f64 = 12.0;
/// Part of an alarm's chi-square from which on a pair's loss counts.
const LOSS_SHARE: f64 = 0.4;
/// Pairs looked at in one period; where there are more, they take turns.
const PAIRS_PER_PERIOD: usize = 64;
/// Of them, pairs in alarm that go before their turn, so that whom the alarm means is known soon.
const ALARMS_PER_PERIOD: usize = 32;
/// What is believed of the errors' duration before anything is learned, in windows' worth of trust,
/// and how many windows are remembered. Through the real chain 1 to 4 is learned. Less than one is
/// right where the repetition that is assumed for all points is not there.
const FIRST_INFLATION: f64 = 1.5;
const MIN_INFLATION: f64 = 0.5;
const FIRST_TRUST: f64 = 2.0;
const MAX_TRUST: f64 = 30.0;
/// One window counts at most this many times what is believed.
const MAX_SURPRISE: f64 = 4.0;
/// Points of a target that walks part by this much per second between two nodes' measurements.
const WALK_M_PER_S: f64 = 1.0;

/// A registered node that is not suspect.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placement {
    /// The pose in force.
    pub(super) pose: Se2<Ref, Node>,
    /// Its covariance.
    pub(super) covariance: Matrix3<f64>,
}

/// What the monitor looks at.
pub(super) struct Site<'a> {
    pub(super) gather: &'a Gather,
    pub(super) reference: &'a NodeId,
    pub(super) placements: BTreeMap<NodeId, Placement>,
}

/// A node that seems to have moved.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Moved {
    pub(super) node: NodeId,
    /// First period of the new pose, as far as can be told.
    pub(super) began: i64,
    /// `(x_m, y_m, heading_rad)` in `Ref`: what would make its points meet the others' again; zero
    /// where that cannot be told.
    pub(super) correction: Vector3<f64>,
    pub(super) chi_square: f64,
}

/// What the newest look at a pair says.
#[derive(Clone, Copy, Debug)]
struct Watch {
    inflation: f64,
    trust: f64,
    learned_at: i64,
    /// What the newest periods of each length say of a change.
    changes: [Option<Correction>; SPANS.len()],
    /// Next to nothing meets any more: the chi-square of the loss.
    loss: Option<f64>,
    /// The correction that was right before each of them.
    expected: [Vector3<f64>; SPANS.len()],
}

/// What a node's pairs say of each span.
type Cases = [Case; SPANS.len()];

/// What a node's pairs say most clearly.
struct Spoken<'a> {
    node: &'a NodeId,
    span: usize,
    case: &'a Case,
    chi_square: f64,
}

/// The monitor's state.
#[derive(Debug)]
pub(super) struct Monitor {
    config: MonitorConfig,
    watches: BTreeMap<Pair, Watch>,
    blame: Blame,
    /// Every pair of the nodes that were last placed.
    pairs: Vec<Pair>,
    nodes: Vec<NodeId>,
    turn: usize,
    alarm_turn: usize,
}

impl Watch {
    fn new(period: i64) -> Self {
        Self {
            inflation: FIRST_INFLATION,
            trust: FIRST_TRUST,
            learned_at: period,
            changes: [None; SPANS.len()],
            loss: None,
            expected: [Vector3::zeros(); SPANS.len()],
        }
    }

    /// Whether a change by chance alone is unlikely, so that the pair is looked at often.
    fn is_stirred(&self) -> bool {
        let stirs = |one: &Correction| STIRRED <= one.change;
        self.loss.is_some() || self.changes.iter().flatten().any(stirs)
    }

    /// Takes in by how much two windows differ, squared and over its expectation.
    fn learn(&mut self, ratio: f64) {
        let believed = ratio.min(MAX_SURPRISE * self.inflation);
        self.inflation = (self.inflation * self.trust + believed) / (self.trust + 1.0);
        self.trust = (self.trust + 1.0).min(MAX_TRUST);
    }
}

impl Monitor {
    pub(super) fn new(config: MonitorConfig) -> Self {
        Self {
            config,
            watches: BTreeMap::new(),
            blame: Blame::default(),
            pairs: Vec::new(),
            nodes: Vec::new(),
            turn: 0,
            alarm_turn: 0,
        }
    }

    fn window(&self) -> i64 {
        i64::try_from(self.config.window_count).unwrap_or(i64::MAX)
    }

    /// Looks at a period that was closed; says who seems to have moved, one node at a time.
    pub(super) fn look(&mut self, site: &Site<'_>, period: i64) -> Option<Moved> {
        if self.config.window_count == 0 {
            return None;
        }
        self.regroup(site);
        for pair in self.due() {
            self.look_at(site, &pair, period);
        }
        let (cases, limit) = (self.cases(site), self.config.min_chi_square);
        let spoken: Vec<Spoken<'_>> = cases.iter().map(|(node, of)| spoken(node, of)).collect();
        let chi_squares: Vec<(&NodeId, f64)> =
            spoken.iter().map(|one| (one.node, one.chi_square)).collect();
        let node = self.blame.decide(&chi_squares, (site.reference, limit), period)?;
        let loudest = spoken.iter().find(|one| *one.node == node)?;
        self.moved(site, loudest, period)
    }

    /// Of every node, what its pairs say together of each span.
    fn cases<'a>(&self, site: &'a Site<'_>) -> BTreeMap<&'a NodeId, Cases> {
        let mut cases: BTreeMap<&NodeId, Cases> = BTreeMap::new();
        let sides = self
            .watches
            .iter()
            .flat_map(|(pair, watch)| site.ends(pair).map(move |end| (end, watch)));
        for ((node, carried), watch) in sides {
            let of_node = cases.entry(node).or_default();
            for (case, said) in of_node.iter_mut().zip(&watch.changes) {
                case.add(watch.loss, said.as_ref(), &carried);
            }
        }
        cases
    }

    /// Notes which nodes are placed: only where that changes are all pairs gone through.
    fn regroup(&mut self, site: &Site<'_>) {
        if site.placements.keys().eq(&self.nodes) {
            return;
        }
        self.nodes = site.placements.keys().cloned().collect();
        self.pairs = site.pairs();
        self.watches.retain(|pair, _| site.both(pair).is_some());
    }

    /// The pairs to look at now: those in alarm, then whose turn it is.
    fn due(&mut self) -> Vec<Pair> {
        let alarms = self.watches.iter().filter(|(_, watch)| watch.is_stirred());
        let alarms: Vec<&Pair> = alarms.map(|(pair, _)| pair).collect();
        let (from, count) = (self.alarm_turn, alarms.len().min(ALARMS_PER_PERIOD));
        let first = alarms.iter().cycle().skip(from % alarms.len().max(1)).take(count);
        let mut due: BTreeSet<&Pair> = first.copied().collect();
        let (start, mut turn_count) = (self.turn % self.pairs.len().max(1), 0);
        let turns = self.pairs.iter().cycle().skip(start).take(self.pairs.len());
        for pair in turns {
            if PAIRS_PER_PERIOD <= due.len() {
                break;
            }
            due.insert(pair);
            turn_count += 1;
        }
        self.turn = self.turn.wrapping_add(turn_count);
        self.alarm_turn = self.alarm_turn.wrapping_add(count);
        due.into_iter().cloned().collect()
    }

    /// What is known of a node's pairs no longer holds.
    pub(super) fn forget(&mut self, node: &NodeId) {
        for (_, watch) in self.watches.iter_mut().filter(|(pair, _)| pair.has(node)) {
            (watch.changes, watch.loss) = ([None; SPANS.len()], None);
        }
    }

    fn look_at(&mut self, site: &Site<'_>, pair: &Pair, period: i64) {
        let watch = *self.watches.entry(pair.clone()).or_insert_with(|| Watch::new(period));
        let Some((in_force, sigma_m)) = site.prior(pair, period, watch.inflation) else { return };
        let window = self.window();
        let first = period - REACH * window;
        let all = site.seen(pair, first, period, self.config.gate_m);
        let split =
            |count: i64| all.split_at(all.partition_point(|one| one.period <= period - count));
        let prior = |count: i64| {
            let before = Weighted::new(split(count).0, sigma_m);
            in_force.after(&before).unwrap_or(in_force)
        };
        // The short span has the whole window's: what came between says nothing new of it.
        let of_whole = prior(window);
        let priors = std::array::from_fn(|index| match index {
            0 | WHOLE => of_whole,
            _ => prior(self.span(index)),
        });
        let oldest = all.first().map_or(period, |one| one.period);
        let fit = |index: usize| {
            // Without enough of before, what was right before is not known well enough.
            let is_known = oldest + 2 * window <= period - self.span(index) + SLACK_PERIODS;
            let newest = || Weighted::new(split(self.span(index)).1, sigma_m);
            is_known.then(newest)?.fit(&priors[index])
        };
        let changes = std::array::from_fn(fit);
        let met = site.met(pair, first, period);
        let loss = lost::loss(&met, period - self.span(0));
        let loss = loss.filter(|loss| LOSS_SHARE * self.config.min_chi_square <= *loss);
        let learned = self.learned(&watch, (&all, sigma_m, &in_force), (changes[WHOLE], period));
        let expected = priors.map(|of_span: Prior| of_span.correction());
        let kept = Watch { changes, loss, expected, ..learned.unwrap_or(watch) };
        self.watches.insert(pair.clone(), kept);
    }

    /// Periods in the span of this number.
    fn span(&self, index: usize) -> i64 {
        #[expect(clippy::cast_possible_truncation, reason = "a share of a small count")]
        let span = (SPANS[index] * self.window() as f64).ceil() as i64;
        span
    }

    /// The watch after two whole windows in which nothing stirred.
    fn learned(
        &self,
        watch: &Watch,
        (all, sigma_m, in_force): (&[Sighted], [f64; 2], &Prior),
        (whole, period): (Option<Correction>, i64),
    ) -> Option<Watch> {
        let window = self.window();
        let is_stirred = self.config.min_chi_square <= whole?.change;
        if is_stirred || period < watch.learned_at + window {
            return None;
        }
        let from = |count: i64| all.partition_point(|one| one.period <= period - count);
        let previous = Weighted::new(&all[from(2 * window)..from(window)], sigma_m);
        let recent = Weighted::new(&all[from(window)..], sigma_m);
        let stated = Prior { inflation: 1.0, ..*in_force };
        let change = recent.fit(&stated.after(&previous)?)?.change;
        let mut learned = Watch { learned_at: period, ..*watch };
        learned.learn(change / 3.0);
        learned.inflation = learned.inflation.max(MIN_INFLATION);
        Some(learned)
    }

    fn moved(&self, site: &Site<'_>, spoken: &Spoken<'_>, period: i64) -> Option<Moved> {
        let Spoken { node, span, case, chi_square } = *spoken;
        let own = self.watches.iter().filter(|(pair, _)| pair.has(node));
        let first = period - self.span(SPANS.len() - 1) - self.window();
        if case.is_lost() {
            let lost = own.filter(|(_, watch)| watch.loss.is_some());
            let met: Vec<Met> = lost.flat_map(|(pair, _)| site.met(pair, first, period)).collect();
            // How far it was moved cannot be told from points that no longer meet.
            let correction = Vector3::zeros();
            return Some(Moved {
                node: node.clone(),
                began: lost::began(&met)?,
                correction,
                chi_square,
            });
        }
        let correction = case.change()?;
        let mut gains: BTreeMap<i64, f64> = BTreeMap::new();
        for (pair, watch) in own.filter(|(_, watch)| watch.changes[span].is_some()) {
            let seen = site.seen(pair, first, period, self.config.gate_m);
            let (_, sigma_m) = site.prior(pair, period, watch.inflation)?;
            let expected = watch.expected[span];
            let value = expected + site.carried(node, pair)? * correction;
            for (at, gain) in Weighted::new(&seen, sigma_m).gains(&value, &expected) {
                *gains.entry(at).or_default() += gain;
            }
        }
        Some(Moved { node: node.clone(), began: change(&gains)?, correction, chi_square })
    }
}

/// The span over which a node's pairs say most.
fn spoken<'a>(node: &'a NodeId, cases: &'a Cases) -> Spoken<'a> {
    let of_span = |(span, case): (usize, &'a Case)| {
        let chi_square = case.chi_square(LOUDNESS[span]);
        Spoken { node, span, case, chi_square }
    };
    let first = of_span((0, &cases[0]));
    let louder = |best: Spoken<'a>, one| {
        if best.chi_square < of_span(one).chi_square { of_span(one) } else { best }
    };
    cases.iter().enumerate().fold(first, louder)
}

/// The period from which on the gains add up to most: where the correction began to hold.
fn change(gains: &BTreeMap<i64, f64>) -> Option<i64> {
    let mut sum = 0.0;
    let sums = gains.iter().rev().map(|(period, gain)| {
        sum += gain;
        (sum, *period)
    });
    let sums: Vec<(f64, i64)> = sums.collect();
    sums.into_iter().max_by(|one, other| one.0.total_cmp(&other.0)).map(|(_, period)| period)
}

impl Site<'_> {
    fn pairs(&self) -> Vec<Pair> {
        let nodes: Vec<&NodeId> = self.placements.keys().collect();
        let pair = |(index, one): (usize, &&NodeId)| {
            let others = nodes[..index].iter();
            others.map(|other| Pair::new(self.reference, one, other)).collect::<Vec<_>>()
        };
        nodes.iter().enumerate().flat_map(pair).collect()
    }

    /// The points of the pair's second node in the periods `after < period <= last`, each with the
    /// first node's points near it.
    fn seen(&self, pair: &Pair, after: i64, last: i64, gate_m: f64) -> Vec<Sighted> {
        let Some((one, other)) = self.both(pair) else { return Vec::new() };
        let history = |node: &NodeId| self.gather.node(node);
        let (Some(first), Some(second)) = (history(&pair.first), history(&pair.second)) else {
            return Vec::new();
        };
        let mut seen = Vec::new();
        for (period, set) in second.sets().range(after.saturating_add(1)..=last) {
            let Some(opposite) = first.sets().get(period) else { continue };
            let sighted = meetings((one, opposite), (other, set), gate_m);
            seen.extend(sighted.map(|(at_m, candidates)| Sighted {
                period: *period,
                at_m,
                candidates,
            }));
        }
        seen
    }

    /// How many points of both met in the periods `after < period <= last`.
    fn met(&self, pair: &Pair, after: i64, last: i64) -> Vec<Met> {
        let Some((one, other)) = self.both(pair) else { return Vec::new() };
        let history = |node: &NodeId| self.gather.node(node);
        let (Some(first), Some(second)) = (history(&pair.first), history(&pair.second)) else {
            return Vec::new();
        };
        let sets = second.sets().range(after.saturating_add(1)..=last);
        let common =
            sets.filter_map(|(period, set)| Some((*period, first.sets().get(period)?, set)));
        common
            .map(|(period, opposite, set)| lost::met(period, (one, opposite), (other, set)))
            .collect()
    }

    fn both(&self, pair: &Pair) -> Option<(&Placement, &Placement)> {
        Some((self.placements.get(&pair.first)?, self.placements.get(&pair.second)?))
    }

    /// What the poses in force say of a pair, and the standard deviations of its half depths.
    fn prior(&self, pair: &Pair, period: i64, inflation: f64) -> Option<(Prior, [f64; 2])> {
        let (one, other) = self.both(pair)?;
        let carried = self.carried(&pair.first, pair)?;
        let pose = other.covariance + carried * one.covariance * carried.transpose();
        let sigma_m = |node: &NodeId| {
            let sets = self.gather.node(node).map(|history| history.sets());
            let newest = sets.and_then(|sets| sets.range(..=period).next_back());
            newest.map_or(0.0, |(_, set)| set.half_depth_sigma_m)
        };
        let offset_sigma_m = [sigma_m(&pair.second), sigma_m(&pair.first)];
        Some((Prior::of_poses(&pose, offset_sigma_m, inflation), offset_sigma_m))
    }

    /// The pair's nodes that are placed, each with its [`Self::carried`].
    fn ends<'a>(&'a self, pair: &Pair) -> impl Iterator<Item = (&'a NodeId, Matrix3<f64>)> {
        [&pair.first, &pair.second].into_iter().filter_map(move |name| {
            let (node, _) = self.placements.get_key_value(name)?;
            Some((node, self.carried(node, pair)?))
        })
    }

    /// The change of a pair's second node that does the same as a change of `node`, which is either
    /// of the two: moving the first is moving the second the other way.
    fn carried(&self, node: &NodeId, pair: &Pair) -> Option<Matrix3<f64>> {
        if *node == pair.second {
            return Some(Matrix3::identity());
        }
        let (one, other) = self.both(pair)?;
        let arm_m = other.pose.translation_m() - one.pose.translation_m();
        Some(-carried_by_pose(&arm_m))
    }
}

/// Every point of the second node that has points of the first near it.
fn meetings<'a>(
    (one, opposite): (&'a Placement, &'a KeptSet),
    (other, set): (&'a Placement, &'a KeptSet),
    gate_m: f64,
) -> impl Iterator<Item = (Vector2<f64>, Vec<Candidate>)> + 'a {
    let apart_s = set.time.since(opposite.time).max(opposite.time.since(set.time)).as_secs_f64();
    let walked = Matrix2::identity() * (WALK_M_PER_S * apart_s).powi(2);
    let sight = |placement: &Placement, at_m: &Vector2<f64>| {
        line_of_sight(&(at_m - placement.pose.translation_m()))
    };
    set.points.iter().filter_map(move |point| {
        let placed = other.pose * point.position;
        let at_m = placed.mean.coords_m;
        let candidate = |partner: &crate::gather::KeptPoint| {
            let met = one.pose * partner.position;
            let between_m = met.mean.coords_m - at_m;
            (between_m.norm() <= gate_m).then(|| Candidate {
                between_m,
                arm_m: at_m - other.pose.translation_m(),
                sights: [sight(other, &at_m), sight(one, &met.mean.coords_m)],
                cov_m2: met.cov_m2 + placed.cov_m2 + walked,
            })
        };
        let candidates: Vec<Candidate> = opposite.points.iter().filter_map(candidate).collect();
        (!candidates.is_empty()).then_some((at_m, candidates))
    })
}

#[cfg(test)]
mod tests;
#[cfg(test)]
mod turn_tests;
