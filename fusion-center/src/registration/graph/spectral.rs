//! A start for the association: the candidates that agree most with each other.
//!
//! The principal eigenvector of the affinities `exp(−cost / (2 σ²))` rates the candidates
//! \[spectral-matching\]; they are taken greedily in its order.

use super::{Agreement, Association};

/// Rounds of the power iteration.
const ROUND_COUNT: usize = 30;

/// Smallest standard deviation of a difference of distances, metres.
const MIN_SIGMA_M: f64 = 0.01;

/// The association that the principal eigenvector suggests. `typical_sigma_m` is the standard
/// deviation per axis of the difference of two points.
pub(super) fn association(agreement: &Agreement<'_>, typical_sigma_m: f64) -> Association {
    let count = agreement.candidates.len();
    // Both ends of a distance err.
    let variance_m2 = 2.0 * typical_sigma_m.max(MIN_SIGMA_M).powi(2);
    let affinity = |a: usize, b: usize| {
        let excluded = agreement.candidates[a].excludes(&agreement.candidates[b]);
        if excluded { 0.0 } else { (-0.5 * agreement.cost_m2(a, b) / variance_m2).exp() }
    };
    let affinities: Vec<f64> =
        (0..count).flat_map(|a| (0..count).map(move |b| affinity(a, b))).collect();
    let mut rating = vec![1.0; count];
    for _ in 0..ROUND_COUNT {
        let next: Vec<f64> = affinities
            .chunks_exact(count.max(1))
            .map(|row| row.iter().zip(&rating).map(|(a, r)| a * r).sum())
            .collect();
        let norm = next.iter().map(|r: &f64| r * r).sum::<f64>().sqrt();
        if norm < f64::MIN_POSITIVE {
            break;
        }
        rating = next.into_iter().map(|r| r / norm).collect();
    }
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|a, b| rating[*b].total_cmp(&rating[*a]));
    agreement.greedy(order.into_iter())
}
