//! Mean shift: from where somebody was to where the image looks like their template.
//!
//! With the template's histogram `q` and the candidate's `p(y0)`, pixels weigh
//! `w_i = W_u sqrt(q_u / p_u(y0))`, `u` their bin from 1, with `W_u = u − 1` so that the background
//! does not hold the iteration back (without it 1), and
//! `y1 = Σ x_i w_i g / Σ w_i g`, `g = 1` inside the ellipse \[mean-shift, eqs. (11)-(14)\]; on from
//! `y1` until `|y1 − y0| < ε` or the limit. The pixels of a bin weigh alike, so that the sums of
//! [`Sums`] are all that is needed. Without `W_u`, `y1 − y0` is along the gradient of
//! Bhattacharyya's coefficient, each axis scaled by its bandwidth squared.

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use super::histogram::{Bins, Histogram, Sums, sums};
use super::maxima::Raster;
use super::template::Ellipse;

/// How bins weigh besides `sqrt(q_u / p_u)`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Weighting {
    /// By `W_u = u − 1`: bright ones more, the background not at all.
    #[default]
    Bright,
    /// All alike, as before the paper.
    Even,
}

/// What somebody looked like.
#[derive(Clone, Debug, PartialEq)]
pub struct Template {
    /// `q`.
    pub histogram: Histogram,
    /// The bins it was taken with.
    pub bins: Bins,
    /// Half axes, pixels.
    pub half_axes_px: Vector2<f64>,
}

/// When the iteration ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShiftRule {
    /// How bins weigh.
    pub weighting: Weighting,
    /// `ε`, pixels.
    pub epsilon_px: f64,
    /// Iterations at most.
    pub max_iteration_count: usize,
    /// `h`: the candidate's half axes over the template's.
    pub bandwidth: f64,
}

/// Where an iteration ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shifted {
    /// Column and row, pixels.
    pub centre_px: Vector2<f64>,
    /// How alike template and image are at the place before the last step, less than `ε` away if
    /// `converged`.
    pub likeness: f64,
    /// Steps made.
    pub iteration_count: usize,
    /// Whether the last step was shorter than `ε`.
    pub converged: bool,
}

impl Template {
    /// The template in an ellipse of the image; `None` if no pixel is inside.
    #[must_use]
    pub fn new(raster: &Raster<'_>, ellipse: &Ellipse, bins: Bins) -> Option<Self> {
        let histogram = sums(raster, ellipse, &bins).histogram()?;
        Some(Self { histogram, bins, half_axes_px: ellipse.half_axes_px })
    }
}

/// One step, pixels from the middle of the ellipse, and the likeness there; `None` if nothing has
/// weight: none of the template's amplitudes is inside.
#[must_use]
pub fn step(all: &Sums, template: &Histogram, weighting: Weighting) -> Option<(Vector2<f64>, f64)> {
    let candidate = all.histogram()?;
    let shares = template.shares().iter().zip(candidate.shares());
    let (mut offset_px, mut total) = (Vector2::zeros(), 0.0);
    for (u, ((q, p), bin)) in shares.zip(all.bins()).enumerate() {
        if *p <= 0.0 {
            continue;
        }
        let factor = match weighting {
            Weighting::Bright => u as f64,
            Weighting::Even => 1.0,
        };
        let weight = factor * (q / p).sqrt();
        offset_px += bin.offset_px * weight;
        total += bin.count * weight;
    }
    (0.0 < total).then(|| (offset_px / total, candidate.likeness(template)))
}

/// Iterates from `start_px`; `None` if nothing on the way has weight.
#[must_use]
pub fn shift(
    raster: &Raster<'_>,
    template: &Template,
    start_px: Vector2<f64>,
    rule: &ShiftRule,
) -> Option<Shifted> {
    let half_axes_px = template.half_axes_px * rule.bandwidth;
    let mut end =
        Shifted { centre_px: start_px, likeness: 0.0, iteration_count: 0, converged: false };
    while !end.converged && end.iteration_count < rule.max_iteration_count.max(1) {
        let ellipse = Ellipse { centre_px: end.centre_px, half_axes_px };
        let all = sums(raster, &ellipse, &template.bins);
        let (offset_px, likeness) = step(&all, &template.histogram, rule.weighting)?;
        end = Shifted {
            centre_px: end.centre_px + offset_px,
            likeness,
            iteration_count: end.iteration_count + 1,
            converged: offset_px.norm() < rule.epsilon_px,
        };
    }
    Some(end)
}

#[cfg(test)]
mod tests;
