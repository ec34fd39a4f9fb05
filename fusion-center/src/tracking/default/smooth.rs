//! States of the past from what came later: the backward pass of Rauch, Tung and Striebel \[rts\].
//!
//! With the filtered `(x, P)`, the prediction `(x⁻, P⁻)` of the next moment, the covariance `C` of
//! both and the smoothed next state `(xˢ, Pˢ)`: `G = C P⁻⁻¹`, `x + G (xˢ − x⁻)` and
//! `P + G (Pˢ − P⁻) Gᵀ`. Mixtures of ways of moving count by their mean and covariance. What does not
//! depend on later plots, `G`, `x − G x⁻` and `P − G P⁻ Gᵀ`, is worked out once for a moment.

use nalgebra::Matrix4;

use super::branch::Moment;
use super::config::Way;
use super::gauss::Gauss;
use super::imm::Steps;

/// From the smoothed state of the next moment back to that of this one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pass {
    gain: Matrix4<f64>,
    /// What is left where the gain is 0.
    rest: Gauss,
}

impl Pass {
    /// From `next` back to `moment`; `known` holds the step that was last asked for.
    pub(super) fn new(
        moment: &Moment,
        next: &Moment,
        ways: &[Way; 2],
        known: &mut Option<Steps>,
    ) -> Self {
        let here = moment.imm.merged();
        let nothing = Self { gain: Matrix4::zeros(), rest: here };
        if next.fresh {
            return nothing;
        }
        let steps = Steps::of(next.time_s - moment.time_s, ways, known);
        let (expected, cross) = moment.imm.stepped_with_cross(steps);
        let covariance = expected.covariance();
        let Some(spread) = covariance.cholesky() else { return nothing };
        let gain = spread.solve(&cross.transpose()).transpose();
        let mean = here.state() - gain * expected.state();
        // `G P⁻ = C`.
        let rest = here.covariance() - cross * gain.transpose();
        Self { gain, rest: Gauss::new(mean, rest) }
    }

    /// The smoothed state of this moment, `later` being that of the next.
    pub(super) fn back(&self, later: &Gauss) -> Gauss {
        let mean = self.rest.state() + self.gain * later.state();
        let carried = self.gain * later.covariance() * self.gain.transpose();
        Gauss::new(mean, self.rest.covariance() + carried)
    }
}

/// The smoothed state of each of `moments`, which are those of one target in order of time.
pub(super) fn smoothed(moments: &[Moment], ways: &[Way; 2]) -> Vec<Gauss> {
    let mut smooth: Vec<Gauss> = Vec::with_capacity(moments.len());
    smooth.extend(moments.last().map(|last| last.imm.merged()));
    let mut known = None;
    for pair in moments.windows(2).rev() {
        let pass = Pass::new(&pair[0], &pair[1], ways, &mut known);
        smooth.extend(smooth.last().map(|later| pass.back(later)));
    }
    smooth.reverse();
    smooth
}
