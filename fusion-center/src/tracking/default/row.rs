//! What a branch expects of a look, and what each plot in its gate costs.
//!
//! A plot `z` of a branch costs `−ln(P_D p(z)/λ)`, nats, with the density `p` of its place, radial
//! velocity and strength, and the density `λ` of false plots; going without one costs
//! `−ln(1 − P_D)`, and a plot of nobody costs nothing. Where the target may have stopped, with the
//! probability `s`, `P_D p` is `(1 − s) P_D p_moving + s P_r p_moved-on` and the miss costs
//! `−ln((1 − s)(1 − P_D) + s)`.

use crate::tracking::{Look, Plot, Status};

use super::branch::{Branch, MAX_DETECTION};
use super::config::DefaultConfig;
use super::coverage::{Seen, View};
use super::gauss::Gauss;
use super::imm::{Imm, Steps};
use super::stand::Stand;

/// A plot is never thought less probable than this share of what the sensor detects at best: borders
/// of areas and speeds are not known so well.
const MIN_DETECTION_SHARE: f64 = 0.02;

/// A branch at the time of a look.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub(super) expected: Imm,
    pub(super) seen: Seen,
    /// The look shows the place where it may stand.
    pub(super) stands_inside: bool,
    /// Probability that it stood until then and moved on, over that it moves and is seen; 0 if it
    /// cannot have stood.
    moved_on_share: f64,
    dt_s: f64,
    /// The track is not believed yet.
    pub(super) is_tentative: bool,
    /// What every plot costs more.
    pub(super) bias: f64,
    pub(super) miss_cost: f64,
    /// `ln` of `P_D/λ`.
    log_ratio: f64,
    pub(super) first_edge: u32,
    pub(super) end_edge: u32,
}

/// A plot that a branch could take.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Edge {
    pub(super) plot: u32,
    pub(super) cost: f64,
    /// It is that of a target that stood.
    pub(super) moved_on: bool,
    /// Share of the first way of moving with it.
    pub(super) first_share: f64,
}

/// A disc around all places that pass the gate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reach {
    pub(super) middle_m: [f64; 2],
    pub(super) radius_m: f64,
}

/// What a probability of detection means, in a look.
#[derive(Clone, Copy, Debug)]
pub(super) struct Chance {
    detected: f64,
    /// The same, as far as it is trusted.
    detection: f64,
    /// `−ln(1 − P_D)`
    miss_cost: f64,
    /// `ln(P_D/λ)`
    log_ratio: f64,
    /// What every plot costs more.
    plot_bias: f64,
}

impl Chance {
    /// Of what is detected with the probability `detected`: `known` if that is for it, which it is
    /// afterwards.
    fn of(
        detected: f64,
        look: &Look<'_>,
        config: &DefaultConfig,
        known: &mut Option<Self>,
    ) -> Self {
        if let Some(chance) = known.filter(|of| of.detected.to_bits() == detected.to_bits()) {
            return chance;
        }
        let best = look.coverage.detection_probability;
        let detection = detected.max(MIN_DETECTION_SHARE * best).min(MAX_DETECTION);
        let clutter = look.clutter_per_m2.max(config.min_clutter_per_m2);
        let miss_cost = -(1.0 - detected.min(MAX_DETECTION)).ln();
        let log_ratio = (detection / clutter).ln();
        let plot_bias = config.plot_bias_nats.min((clutter / config.min_clutter_per_m2).ln());
        *known.insert(Self { detected, detection, miss_cost, log_ratio, plot_bias })
    }
}

impl Row {
    /// What `branch` expects after `steps`.
    pub(super) fn new(
        branch: &Branch,
        steps: &Steps,
        view: &View<'_>,
        config: &DefaultConfig,
        known: &mut Option<Chance>,
    ) -> Self {
        let expected = branch.imm.stepped(steps);
        let seen = view.seen(|| expected.merged());
        let best = view.look.coverage.detection_probability;
        let chance = Chance::of(seen.detected, view.look, config, known);
        let (miss_cost, moved_on_share) = match &branch.stand {
            None => (chance.miss_cost, 0.0),
            Some(stand) => {
                let (stands, missed) = (stand.share(), (-chance.miss_cost).exp());
                let restart = -(-config.restart_per_s * steps.dt_s).exp_m1();
                let odds = stands / (1.0 - stands).max(f64::MIN_POSITIVE);
                let share = odds * restart * best / chance.detection;
                (-((1.0 - stands) * missed + stands).ln(), share)
            }
        };
        let moving = branch.stand.map_or(0.0, |stand| (1.0 - stand.share()).ln());
        let is_tentative = branch.status == Status::Tentative;
        Self {
            expected,
            seen,
            stands_inside: branch.stand.is_some_and(|stand| stand.is_inside(view.look)),
            moved_on_share,
            dt_s: steps.dt_s,
            is_tentative,
            bias: chance.plot_bias + if is_tentative { config.tentative_bias_nats } else { 0.0 },
            miss_cost,
            log_ratio: chance.log_ratio + moving,
            first_edge: 0,
            end_edge: 0,
        }
    }

    /// Where `branch` stands, if it can have stood and moved on.
    fn stand<'a>(&self, branch: &'a Branch) -> Option<&'a Stand> {
        branch.stand.as_ref().filter(|_| 0.0 < self.moved_on_share)
    }

    /// Where plots pass the gate whose variance is at most `variance_m2` in any direction.
    #[inline]
    pub(super) fn reach(&self, branch: &Branch, variance_m2: f64, config: &DefaultConfig) -> Reach {
        let [first, second] = &self.expected.ways;
        let middle_m = [0, 1].map(|axis| 0.5 * (first.mean[axis] + second.mean[axis]));
        let radius = |state: &Gauss| {
            let [dx, dy] = [state.mean[0] - middle_m[0], state.mean[1] - middle_m[1]];
            let off = (dx * dx + dy * dy).sqrt();
            off + (config.gate_distance2 * (state.widest_m2() + variance_m2)).sqrt()
        };
        let moving = radius(first).max(radius(second));
        let starts = self.stand(branch).map(|stand| stand.starts(self.dt_s, config));
        let moved_on = starts.iter().flatten().flatten().map(|start| radius(&start.state));
        let radius_m = moved_on.fold(moving, f64::max);
        Reach { middle_m, radius_m }
    }

    /// What `plot` costs, if it passes the gate and is worth it.
    #[inline]
    pub(super) fn edge(
        &self,
        branch: &Branch,
        (index, plot): (u32, &Plot),
        config: &DefaultConfig,
    ) -> Option<Edge> {
        let gate = config.gate_distance2;
        let passes = |fit: &super::gauss::Fit| {
            fit.place_distance2 <= gate && fit.distance2 - fit.place_distance2 <= gate
        };
        let near = |way: &Gauss| way.place_distance2(plot) <= gate;
        // Most plots end here, before there is a logarithm.
        if self.moved_on_share <= 0.0 && !self.expected.ways.iter().any(near) {
            return None;
        }
        let fits = self.expected.fits(plot);
        let (of_moving, first_share) = self.expected.weighed(&fits);
        let moving = fits.iter().any(passes).then_some(of_moving);
        let started = self.stand(branch).and_then(|stand| {
            let start = stand.start_at(plot, self.dt_s, config);
            let fit = start.state.fit(plot);
            let weight = self.moved_on_share * start.share / fit.volume2.sqrt();
            passes(&fit).then_some((fit.distance2, weight))
        });
        let ((distance2, weight), moved_on) = match (moving, started) {
            (None, None) => return None,
            (Some(one), None) => (one, false),
            (None, Some(other)) => (other, true),
            (Some(one), Some(other)) => {
                let least = one.0.min(other.0);
                let [a, b] = [one, other].map(|(d2, weight)| weight * (0.5 * (least - d2)).exp());
                ((least, a + b), a < b)
            }
        };
        let span = plot.radial.map_or(1.0, |radial| {
            let most = config.clutter_radial_span_m_per_s;
            radial.wrap_m_per_s.map_or(most, |period| period.min(most))
        });
        let strength = branch.strength.ratio(plot.strength_db, config);
        let log_density = (weight * strength.1 * span).ln() - 0.5 * (distance2 + strength.0);
        let cost = self.bias - self.log_ratio - log_density;
        let edge = Edge { plot: index, cost, moved_on, first_share };
        (cost <= self.miss_cost + config.keep_nats).then_some(edge)
    }
}
