//! States of the past from what came later: the backward pass of Rauch, Tung and Striebel \[rts\].
//!
//! With the filtered `(x, P)`, the prediction `(x⁻, P⁻)` of the next moment, the covariance `C` of
//! both and the smoothed next state `(xˢ, Pˢ)`: `G = C P⁻⁻¹`, `x + G (xˢ − x⁻)` and
//! `P + G (Pˢ − P⁻) Gᵀ`. Mixtures of ways of moving count by their mean and covariance.

use nalgebra::{Matrix4, Vector4};

use super::branch::Moment;
use super::config::DefaultConfig;
use super::imm::Steps;

/// Smoothed mean and covariance of each of `moments`, which are those of one target in order of time.
pub(super) fn smoothed(
    moments: &[Moment],
    config: &DefaultConfig,
) -> Vec<(Vector4<f64>, Matrix4<f64>)> {
    let ways = config.ways();
    let mut smooth: Vec<(Vector4<f64>, Matrix4<f64>)> = Vec::with_capacity(moments.len());
    for (index, moment) in moments.iter().enumerate().rev() {
        let merged = moment.imm.merged();
        let here = (merged.state(), merged.covariance());
        let after = smooth.last().zip(moments.get(index + 1));
        let better = after.filter(|(_, next)| !next.fresh).and_then(|(later, next)| {
            let steps = Steps::new(next.time_s - moment.time_s, &ways);
            let (expected, cross) = moment.imm.stepped_with_cross(&steps);
            let gain = cross * expected.covariance().try_inverse()?;
            let cov = here.1 + gain * (later.1 - expected.covariance()) * gain.transpose();
            Some((here.0 + gain * (later.0 - expected.state()), 0.5 * (cov + cov.transpose())))
        });
        smooth.push(better.unwrap_or(here));
    }
    smooth.reverse();
    smooth
}
