//! Whether a registered node was moved: do its points still meet those of the others?
//!
//! Every closed period, every pair of registered nodes is asked for the small correction of their
//! relative pose that its newest points want (`fit`). A correction that neither the poses'
//! covariances nor the points' errors explain is an alarm. Whom it means follows from all pairs: a
//! node that moved disagrees with everybody, and the others go on agreeing with each other. Between
//! two nodes nobody can tell; the reference stands by definition.
//!
//! How much longer than a period errors last is learned: two corrections from neighbouring windows
//! under the same poses differ by chance alone, so their squared distance in units of the stated
//! covariance is the factor by which the data say less than stated.

mod blame;
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
use fit::{Candidate, Correction, Prior, Sighted, Weighted};
use lost::Met;

/// Part of the window that is looked at by itself too, so that a large move shows sooner.
const SHORT_SHARE: f64 = 0.4;
/// A pair that would have raised the alarm at a shift of this much, metres, and has less than this
/// share of an alarm's chi-square, is known to be quiet.
const QUIET_SHIFT_M: f64 = 0.15;
const QUIET_SHARE: f64 = 0.3;
/// Windows before the newest that say what was right before, beside the poses in force: what they
/// miss by needs no explanation now.
const OLDER_WINDOWS: i64 = 3;
/// Pairs looked at in one period; where there are more, they take turns.
const PAIRS_PER_PERIOD: usize = 64;
/// Of them, pairs in alarm that go before their turn, so that whom the alarm means is known soon.
const ALARMS_PER_PERIOD: usize = 32;
/// What is believed of the errors' duration before anything is learned, in windows' worth of trust,
/// and how many windows are remembered. Errors that last half a second at 10 periods a second gave
/// 1.1 to 4.4 in tests.
const FIRST_INFLATION: f64 = 2.0;
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
enum Verdict {
    /// Too little to say anything.
    Unknown,
    /// The pair agrees, and would not if one of the two had moved.
    Quiet,
    /// The pair disagrees by this correction of the second's pose.
    Alarm(Correction),
    /// Next to nothing meets any more; this is the chi-square of the loss.
    Lost(f64),
}

#[derive(Clone, Copy, Debug)]
struct Watch {
    inflation: f64,
    trust: f64,
    learned_at: i64,
    verdict: Verdict,
    /// The larger one of the newest look.
    #[cfg(test)]
    chi_square: f64,
    /// The correction that was right before.
    expected: Vector3<f64>,
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
        let (inflation, trust) = (FIRST_INFLATION, FIRST_TRUST);
        let (verdict, expected) = (Verdict::Unknown, Vector3::zeros());
        Self {
            inflation,
            trust,
            learned_at: period,
            verdict,
            #[cfg(test)]
            chi_square: 0.0,
            expected,
        }
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
        let verdicts = self.watches.iter().map(|(pair, watch)| (pair, &watch.verdict));
        let node = self.blame.decide(verdicts, site.reference, period)?;
        self.moved(site, &node, period)
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
        let is_alarm = |watch: &Watch| matches!(watch.verdict, Verdict::Alarm(_));
        let alarms = self.watches.iter().filter(|(_, watch)| is_alarm(watch));
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
            watch.verdict = Verdict::Unknown;
        }
    }

    fn look_at(&mut self, site: &Site<'_>, pair: &Pair, period: i64) {
        let window = self.window();
        let watch = *self.watches.entry(pair.clone()).or_insert_with(|| Watch::new(period));
        let gate_m = self.config.gate_m;
        let seen = site.seen(pair, period - window, period, gate_m);
        let Some((in_force, sigma_m)) = site.prior(pair, period, watch.inflation) else { return };
        let first = period - (1 + OLDER_WINDOWS) * window;
        let before = site.seen(pair, first, period - window, gate_m);
        let prior = in_force.after(&Weighted::new(&before, sigma_m)).unwrap_or(in_force);
        #[expect(clippy::cast_possible_truncation, reason = "a share of a small count")]
        let recent = (SHORT_SHARE * window as f64).ceil() as i64;
        let first_recent = seen.partition_point(|one| one.period <= period - recent);
        let fit = |of: &[Sighted]| Weighted::new(of, sigma_m).fit(&prior);
        let whole = fit(&seen);
        let short = fit(&seen[first_recent..]);
        let met = site.met(pair, first, period);
        let loss =
            lost::loss(&met, period - recent).filter(|loss| self.config.min_chi_square <= *loss);
        let verdict = loss.map_or_else(|| self.verdict(whole, short), Verdict::Lost);
        let newest = Weighted::new(&seen, sigma_m);
        let in_force = Prior { inflation: 1.0, ..in_force };
        let learned = self.learned(&watch, (&before, &newest, &in_force), (whole, period));
        #[cfg(test)]
        let chi_square =
            whole.into_iter().chain(short).map(|one| one.chi_square).fold(0.0, f64::max);
        let expected = prior.correction();
        let kept = Watch {
            verdict,
            expected,
            #[cfg(test)]
            chi_square,
            ..learned.unwrap_or(watch)
        };
        self.watches.insert(pair.clone(), kept);
    }

    fn verdict(&self, whole: Option<Correction>, short: Option<Correction>) -> Verdict {
        let limit = self.config.min_chi_square;
        let found = whole.into_iter().chain(short);
        let worst = found.max_by(|one, other| one.chi_square.total_cmp(&other.chi_square));
        match (worst, whole) {
            (Some(worst), _) if limit <= worst.chi_square => Verdict::Alarm(worst),
            (Some(worst), Some(whole))
                if worst.chi_square < QUIET_SHARE * limit
                    && whole.blind_m * limit.sqrt() < QUIET_SHIFT_M =>
            {
                Verdict::Quiet
            }
            _ => Verdict::Unknown,
        }
    }

    /// The watch after two whole windows in which nothing stirred.
    fn learned(
        &self,
        watch: &Watch,
        (before, recent, in_force): (&[Sighted], &Weighted<'_>, &Prior),
        (whole, period): (Option<Correction>, i64),
    ) -> Option<Watch> {
        let window = self.window();
        let is_stirred = self.config.min_chi_square <= whole?.chi_square;
        if is_stirred || period < watch.learned_at + window {
            return None;
        }
        let first = before.partition_point(|one| one.period <= period - 2 * window);
        let previous = Weighted::new(&before[first..], recent.offset_sigma_m);
        let change = recent.fit(&in_force.after(&previous)?)?.change;
        let mut learned = Watch { learned_at: period, ..*watch };
        learned.learn(change / 3.0);
        learned.inflation = learned.inflation.max(1.0);
        Some(learned)
    }

    fn moved(&self, site: &Site<'_>, node: &NodeId, period: i64) -> Option<Moved> {
        let alarms = self.watches.iter().filter(|(pair, _)| pair.has(node));
        let mut gains: BTreeMap<i64, f64> = BTreeMap::new();
        let mut worst: Option<(f64, Vector3<f64>)> = None;
        for (pair, watch) in alarms {
            if let Verdict::Lost(loss) = watch.verdict {
                let met = site.met(pair, period - 2 * self.window(), period);
                // How far it was moved cannot be told from points that no longer meet.
                let correction = Vector3::zeros();
                let (node, began) = (node.clone(), lost::began(&met)?);
                return Some(Moved { node, began, correction, chi_square: loss });
            }
            let Verdict::Alarm(alarm) = watch.verdict else { continue };
            let seen = site.seen(pair, period - 2 * self.window(), period, self.config.gate_m);
            let (_, sigma_m) = site.prior(pair, period, watch.inflation)?;
            for (at, gain) in Weighted::new(&seen, sigma_m).gains(&alarm.value, &watch.expected) {
                *gains.entry(at).or_default() += gain;
            }
            if worst.is_none_or(|(chi_square, _)| chi_square < alarm.chi_square) {
                worst = Some((alarm.chi_square, site.correction_of(node, pair, &alarm.value)?));
            }
        }
        let (chi_square, correction) = worst?;
        Some(Moved { node: node.clone(), began: change(&gains)?, correction, chi_square })
    }
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
        // Moving the first node is moving the second the other way, as seen from the first.
        let arm_m = other.pose.translation_m() - one.pose.translation_m();
        let carried = carried_by_pose(&arm_m);
        let pose = other.covariance + carried * one.covariance * carried.transpose();
        let sigma_m = |node: &NodeId| {
            let sets = self.gather.node(node).map(|history| history.sets());
            let newest = sets.and_then(|sets| sets.range(..=period).next_back());
            newest.map_or(0.0, |(_, set)| set.half_depth_sigma_m)
        };
        let offset_sigma_m = [sigma_m(&pair.second), sigma_m(&pair.first)];
        Some((Prior::of_poses(&pose, offset_sigma_m, inflation), offset_sigma_m))
    }

    /// The correction of a pair's second node, as one of `node`, which is either of the two.
    fn correction_of(
        &self,
        node: &NodeId,
        pair: &Pair,
        second: &Vector3<f64>,
    ) -> Option<Vector3<f64>> {
        if *node == pair.second {
            return Some(*second);
        }
        let (one, other) = self.both(pair)?;
        let arm_m = other.pose.translation_m() - one.pose.translation_m();
        let turned_m = Vector2::new(-arm_m.y, arm_m.x) * second.z;
        Some(Vector3::new(turned_m.x - second.x, turned_m.y - second.y, -second.z))
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
