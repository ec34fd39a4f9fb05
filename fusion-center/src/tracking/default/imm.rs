//! Two ways of moving that take turns, and what a plot says about both.
//!
//! Each way is that of [`super::gauss`] with its own push and memory; a way lasts for a mean sojourn
//! `T` and is left within `Δt` with the probability `1 − exp(−Δt/T)`. Both are mixed before each
//! prediction (interacting multiple model \[imm\]), which keeps mean and covariance of the mixture.

use nalgebra::Matrix4;

use crate::tracking::Plot;

use super::config::Way;
use super::gauss::{Fit, Gauss, Step};

/// No way of moving is ruled out: it could not come back.
const MIN_WEIGHT: f64 = 1e-4;

/// The state under each way of moving, and how probable the first is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Imm {
    pub(super) ways: [Gauss; 2],
    pub(super) first_share: f64,
}

/// What a time step does under both ways of moving.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Steps {
    pub(super) dt_s: f64,
    ways: [Step; 2],
    /// Probability that a way lasts over the step.
    stays: [f64; 2],
}

impl Steps {
    /// Over `dt_s`.
    pub(super) fn new(dt_s: f64, ways: &[Way; 2]) -> Self {
        Self {
            dt_s,
            ways: ways.map(|way| Step::new(dt_s, way.memory_s, way.push_over(dt_s))),
            stays: ways.map(|way| (-dt_s / way.sojourn_s).exp()),
        }
    }
}

impl Steps {
    /// Over `dt_s`: `known` if it is that, which it is afterwards.
    pub(super) fn of<'a>(dt_s: f64, ways: &[Way; 2], known: &'a mut Option<Self>) -> &'a Self {
        if known.as_ref().is_some_and(|steps| steps.dt_s.to_bits() != dt_s.to_bits()) {
            *known = None;
        }
        known.get_or_insert_with(|| Self::new(dt_s, ways))
    }
}

impl Imm {
    /// Both ways alike.
    pub(super) fn new(start: Gauss, first_share: f64) -> Self {
        Self { ways: [start; 2], first_share }
    }

    /// The mean of [`Self::merged`].
    #[inline]
    pub(super) fn mean(&self) -> [f64; 4] {
        let [first, second] = &self.ways;
        let share = self.first_share;
        std::array::from_fn(|i| second.mean[i] + share * (first.mean[i] - second.mean[i]))
    }

    /// The state whatever the way of moving.
    #[inline]
    pub(super) fn merged(&self) -> Gauss {
        self.ways[0].mixed(&self.ways[1], self.first_share)
    }

    /// `(share of the first after the step, share of the first before among those that move in the
    /// first, in the second, way after it)`.
    #[inline]
    fn shares(&self, steps: &Steps) -> (f64, [f64; 2]) {
        let (p, q) = (self.first_share, 1.0 - self.first_share);
        let first = p * steps.stays[0] + q * (1.0 - steps.stays[1]);
        let second = p * (1.0 - steps.stays[0]) + q * steps.stays[1];
        let into = [
            p * steps.stays[0] / first.max(f64::MIN_POSITIVE),
            p * (1.0 - steps.stays[0]) / second.max(f64::MIN_POSITIVE),
        ];
        (first.clamp(MIN_WEIGHT, 1.0 - MIN_WEIGHT), into)
    }

    /// The state after a step.
    #[inline]
    pub(super) fn stepped(&self, steps: &Steps) -> Self {
        let (first_share, into) = self.shares(steps);
        let apart = self.ways[0].apart(&self.ways[1]);
        let start = |way: usize| self.ways[1].towards(&apart, into[way]);
        Self {
            ways: [start(0).stepped(&steps.ways[0]), start(1).stepped(&steps.ways[1])],
            first_share,
        }
    }

    /// The merged state after a step, and the covariance of the merged state before with it.
    pub(super) fn stepped_with_cross(&self, steps: &Steps) -> (Gauss, Matrix4<f64>) {
        let (first_share, into) = self.shares(steps);
        let start = into.map(|share| self.ways[0].mixed(&self.ways[1], share));
        let after = [start[0].stepped(&steps.ways[0]), start[1].stepped(&steps.ways[1])];
        let expected = after[0].mixed(&after[1], first_share);
        let before = start[0].mixed(&start[1], first_share).state();
        let mut cross = Matrix4::zeros();
        for (way, share) in [first_share, 1.0 - first_share].into_iter().enumerate() {
            let off = start[way].state() - before;
            // Against the mean: far from the origin, digits would be lost.
            let later = after[way].state() - expected.state();
            cross += (start[way].cross(&steps.ways[way]) + off * later.transpose()) * share;
        }
        (expected, cross)
    }

    /// How well a plot fits each way.
    #[inline]
    pub(super) fn fits(&self, plot: &Plot) -> [Fit; 2] {
        [self.ways[0].fit(plot), self.ways[1].fit(plot)]
    }

    /// The density of a plot that fits the ways so as `(d, w)`, of which it is `w exp(−d/2)`, and the
    /// first's share with it.
    #[inline]
    pub(super) fn weighed(&self, fits: &[Fit; 2]) -> ((f64, f64), f64) {
        let [a, b] = fits.map(|fit| fit.distance2);
        let less = (-0.5 * (a - b).abs()).exp();
        let [of_a, of_b] = if a <= b { [1.0, less] } else { [less, 1.0] };
        let first = self.first_share * of_a / fits[0].volume2.sqrt();
        let second = (1.0 - self.first_share) * of_b / fits[1].volume2.sqrt();
        let sum = first + second;
        ((a.min(b), sum), (first / sum).clamp(MIN_WEIGHT, 1.0 - MIN_WEIGHT))
    }

    /// Takes in a plot that gives the first way `first_share`: see [`Imm::weighed`].
    #[inline]
    pub(super) fn update(&mut self, plot: &Plot, first_share: f64) {
        self.first_share = first_share;
        self.ways.iter_mut().for_each(|way| way.update(plot));
    }
}
