//! Smoothing of a chain of states: what is known of each step from all that was measured before
//! and after it.
//!
//! A filter's pass over steps `1 ... n` gives the filtered mean and covariance `x_k, P_k`, and the
//! predicted ones `x⁻_k, P⁻_k` that it had before the measurement of step `k`, with the transition
//! `F_k` from step `k − 1`. Backwards from `x̂_n = x_n` (Rauch, Tung and Striebel \[rts\]):
//!
//! ```text
//! G_k = P_k F_{k+1}ᵀ (P⁻_{k+1})⁻¹
//! x̂_k = x_k + G_k (x̂_{k+1} − x⁻_{k+1})
//! P̂_k = P_k + G_k (P̂_{k+1} − P⁻_{k+1}) G_kᵀ
//! ```
//!
//! Exact for linear motion with Gaussian noise; a step without measurement has `x_k = x⁻_k`. Units
//! are those of the states, metres and metres per second for tracks. Where rounding leaves no covariance
//! of `P̂_k`, as after a pause of years, what was known then stands.

use nalgebra::{Matrix4, Vector4};
use thiserror::Error;

#[cfg(test)]
mod tests;

/// Mean and covariance of a state `(x_m, y_m, x_m_per_s, y_m_per_s)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Belief {
    /// Its mean.
    pub mean: Vector4<f64>,
    /// Its covariance.
    pub covariance: Matrix4<f64>,
}

impl Belief {
    /// Whether the mean is finite and the covariance positive definite.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        self.mean.iter().all(|value| value.is_finite()) && self.covariance.cholesky().is_some()
    }
}

/// One step of a filter's pass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pass {
    /// `F`: takes the state of the step before to this one; of the first step it is not used.
    pub transition: Matrix4<f64>,
    /// Before the step's measurement; of the first step it is not used.
    pub predicted: Belief,
    /// After it.
    pub filtered: Belief,
}

/// A prediction whose covariance is not positive definite: there is no way back through it.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[error(
    "smoothing a track: the covariance predicted for step {step_index} is not positive definite"
)]
pub struct NotPositive {
    /// The step, counted from zero.
    pub step_index: usize,
}

/// Puts the smoothed state of every step into `into`, in their order; what was there is dropped.
///
/// # Errors
/// If a predicted covariance is not positive definite; `into` is then of no use.
pub fn smooth(passes: &[Pass], into: &mut Vec<Belief>) -> Result<(), NotPositive> {
    into.clear();
    let Some(last) = passes.last() else { return Ok(()) };
    into.push(last.filtered);
    let mut later = last.filtered;
    for (index, pair) in passes.windows(2).enumerate().rev() {
        later = back(&pair[0].filtered, &pair[1], &later)
            .ok_or(NotPositive { step_index: index + 1 })?;
        into.push(later);
    }
    into.reverse();
    Ok(())
}

/// The smoothed state of a step from its `filtered` one, the `next` step and that one's smoothed
/// state `later`.
fn back(filtered: &Belief, next: &Pass, later: &Belief) -> Option<Belief> {
    let spread = next.predicted.covariance.cholesky()?;
    // Gᵀ = (P⁻)⁻¹ F P, as both covariances are symmetric.
    let gain = spread.solve(&(next.transition * filtered.covariance)).transpose();
    let mean = filtered.mean + gain * (later.mean - next.predicted.mean);
    let change = later.covariance - next.predicted.covariance;
    let covariance = filtered.covariance + gain * change * gain.transpose();
    let smoothed = Belief { mean, covariance: 0.5 * (covariance + covariance.transpose()) };
    Some(if smoothed.is_sound() { smoothed } else { *filtered })
}
