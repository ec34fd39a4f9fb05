//! What a track said of late, and the same with what came after: smoothing over a fixed lag.
//!
//! Rauch, Tung and Striebel's pass \[rts\] from the newest state back: with the filtered state
//! `(x_k, P_k)`, the prediction `(x⁻, P⁻)` of the next and their covariance `C = cov(x_k, x_{k+1})`,
//! `G = C (P⁻)⁻¹`, `x̂_k = x_k + G (x̂_{k+1} − x⁻)`, `P̂_k = P_k + G (P̂_{k+1} − P⁻) Gᵀ`.
//! Of the mixture of ways of moving, mean and covariance go in.

use std::collections::VecDeque;

use nalgebra::Matrix4;

use super::motion::Estimate;

/// States kept, at most.
pub(super) const MAX_COUNT: usize = 64;

/// Times that differ by less are alike, seconds.
const CLOCK_S: f64 = 1e-6;

/// One frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Record {
    pub(super) time_s: f64,
    pub(super) predicted: Estimate,
    /// Covariance of the state before with `predicted`.
    pub(super) cross: Matrix4<f64>,
    pub(super) filtered: Estimate,
}

/// The newest states, oldest first.
#[derive(Clone, Debug)]
pub(super) struct History {
    records: VecDeque<Record>,
}

impl History {
    pub(super) fn new() -> Self {
        Self { records: VecDeque::with_capacity(MAX_COUNT) }
    }

    pub(super) fn clear(&mut self) {
        self.records.clear();
    }

    /// Adds the newest, and drops what smoothing over `lag_s` needs no more.
    pub(super) fn push(&mut self, record: Record, lag_s: f64) {
        let is_old = |next: &Record| lag_s - CLOCK_S <= record.time_s - next.time_s;
        while self.records.get(1).is_some_and(is_old) || self.records.len() == MAX_COUNT {
            self.records.pop_front();
        }
        self.records.push_back(record);
    }

    /// The oldest state kept with all that came after, and when that was; `None` without any.
    pub(super) fn smoothed(&self) -> Option<(f64, Estimate)> {
        let newest = self.records.back()?;
        let (mut later, mut best) = (newest, newest.filtered);
        for record in self.records.iter().rev().skip(1) {
            if let Some(inverse) = later.predicted.cov.try_inverse() {
                let gain = later.cross * inverse;
                let mean = record.filtered.mean + gain * (best.mean - later.predicted.mean);
                let cov = record.filtered.cov
                    + gain * (best.cov - later.predicted.cov) * gain.transpose();
                best = Estimate { mean, cov: 0.5 * (cov + cov.transpose()) };
            } else {
                best = record.filtered;
            }
            later = record;
        }
        Some((later.time_s, best))
    }
}
