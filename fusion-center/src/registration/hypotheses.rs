//! Pose hypotheses from pairs of candidate matches.
//!
//! A candidate is a point of each side in one period. Two candidates, of one or of two periods,
//! span a segment on each side; if the lengths agree within their uncertainty,
//! `|L₀ − L₁| ≤ q sqrt(u₀ᵀ(R_l1 + R_l2)u₀ + u₁ᵀ(R_j1 + R_j2)u₁)`, the motion that lays the one
//! segment on the other, middle on middle, is a hypothesis. All pairs of candidates are tried
//! where they are few; else they are drawn at random, long segments preferred because their
//! direction, and with it the heading, is the surer. Segments of fixed ghosts repeat over the
//! periods, so that drawing them often costs trials, never correctness.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use super::pairwise::PairwiseConfig;
use super::prepared::{Blob, Motion, Prepared};

/// Draws per wanted hypothesis before sampling gives up.
const DRAWS_PER_HYPOTHESIS: usize = 100;

/// A point of each side in one period.
#[derive(Clone, Copy)]
struct Candidate {
    ref_index: usize,
    node_index: usize,
}

struct Proposal {
    motion: Motion,
    length_m: f64,
}

/// Hypotheses of the node's pose, at most `config.max_hypothesis_count`. The order and the values
/// depend on the data and the seed only.
pub(super) fn propose(data: &Prepared, config: &PairwiseConfig) -> Vec<Motion> {
    let candidates = candidates(data);
    let pair_count = candidates.len() * candidates.len().saturating_sub(1) / 2;
    let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
    if pair_count <= config.exhaustive_pair_limit {
        let proposals = all_pairs(data, &candidates, config);
        thinned(proposals, config.max_hypothesis_count, &mut rng)
    } else {
        sampled(data, &candidates, config, &mut rng)
    }
}

/// As [`propose`], but drawn at random however few the candidates are.
pub(super) fn propose_few(data: &Prepared, config: &PairwiseConfig) -> Vec<Motion> {
    let candidates = candidates(data);
    if candidates.is_empty() {
        return Vec::new();
    }
    let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
    sampled(data, &candidates, config, &mut rng)
}

fn candidates(data: &Prepared) -> Vec<Candidate> {
    let mut all =
        Vec::with_capacity(data.spans.iter().map(super::prepared::Span::pair_count).sum());
    for span in &data.spans {
        for ref_index in span.refs.clone() {
            all.extend(span.nodes.clone().map(|node_index| Candidate { ref_index, node_index }));
        }
    }
    all
}

fn all_pairs(data: &Prepared, candidates: &[Candidate], config: &PairwiseConfig) -> Vec<Proposal> {
    let mut proposals = Vec::new();
    for (index, first) in candidates.iter().enumerate() {
        let later = &candidates[index + 1..];
        proposals.extend(later.iter().filter_map(|second| join(data, *first, *second, config)));
    }
    proposals
}

fn sampled(
    data: &Prepared,
    candidates: &[Candidate],
    config: &PairwiseConfig,
    rng: &mut ChaCha8Rng,
) -> Vec<Motion> {
    let mut motions = Vec::with_capacity(config.max_hypothesis_count);
    let sure_length_m = 2.0 * data.node_spread_m;
    for _ in 0..config.max_hypothesis_count.saturating_mul(DRAWS_PER_HYPOTHESIS) {
        if motions.len() == config.max_hypothesis_count {
            break;
        }
        let first = candidates[rng.random_range(0..candidates.len())];
        let second = candidates[rng.random_range(0..candidates.len())];
        let Some(proposal) = join(data, first, second, config) else { continue };
        if rng.random::<f64>() * sure_length_m <= proposal.length_m {
            motions.push(proposal.motion);
        }
    }
    motions
}

/// At most `limit` of the proposals, drawn without replacement with chances that grow with the
/// length (the largest of `u^(1/length)`, u uniform), in their order.
fn thinned(proposals: Vec<Proposal>, limit: usize, rng: &mut ChaCha8Rng) -> Vec<Motion> {
    if proposals.len() <= limit {
        return proposals.into_iter().map(|proposal| proposal.motion).collect();
    }
    let mut keyed: Vec<(f64, Motion)> = proposals
        .into_iter()
        .map(|proposal| (rng.random::<f64>().ln() / proposal.length_m, proposal.motion))
        .collect();
    keyed.sort_by(|a, b| b.0.total_cmp(&a.0));
    keyed.truncate(limit);
    keyed.into_iter().map(|(_, motion)| motion).collect()
}

/// The motion that lays the node's segment on the reference's, if their lengths agree.
fn join(
    data: &Prepared,
    first: Candidate,
    second: Candidate,
    config: &PairwiseConfig,
) -> Option<Proposal> {
    if first.ref_index == second.ref_index || first.node_index == second.node_index {
        return None;
    }
    let (ref_a, ref_b) = (&data.refs[first.ref_index], &data.refs[second.ref_index]);
    let (node_a, node_b) = (&data.nodes[first.node_index], &data.nodes[second.node_index]);
    let (ref_dx, ref_dy) = (ref_b.x - ref_a.x, ref_b.y - ref_a.y);
    let (node_dx, node_dy) = (node_b.x - node_a.x, node_b.y - node_a.y);
    let ref_length = (ref_dx * ref_dx + ref_dy * ref_dy).sqrt();
    let node_length = (node_dx * node_dx + node_dy * node_dy).sqrt();
    let difference = ref_length - node_length;
    if ref_length.min(node_length) < config.min_baseline_m {
        return None;
    }
    let variance = along(ref_a, ref_b, ref_dx / ref_length, ref_dy / ref_length)
        + along(node_a, node_b, node_dx / node_length, node_dy / node_length);
    if difference * difference > config.length_gate_sigma.powi(2) * variance {
        return None;
    }
    let product = ref_length * node_length;
    let cos = (ref_dx * node_dx + ref_dy * node_dy) / product;
    let sin = (ref_dy * node_dx - ref_dx * node_dy) / product;
    let mut motion = Motion { x: 0.0, y: 0.0, cos, sin };
    let (x, y) = motion.turned(0.5 * (node_a.x + node_b.x), 0.5 * (node_a.y + node_b.y));
    motion.x = 0.5 * (ref_a.x + ref_b.x) - x;
    motion.y = 0.5 * (ref_a.y + ref_b.y) - y;
    Some(Proposal { motion, length_m: ref_length })
}

/// Variance of the length of a segment: that of both ends along its direction.
fn along(a: &Blob, b: &Blob, ux: f64, uy: f64) -> f64 {
    let (xx, xy, yy) = (a.xx + b.xx, a.xy + b.xy, a.yy + b.yy);
    ux * ux * xx + 2.0 * ux * uy * xy + uy * uy * yy
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::{Conditions, large_room, trial};

    fn best_displacement_m(data: &Prepared, motions: &[Motion], truth: &Motion) -> f64 {
        motions.iter().map(|m| data.displacement_m(m, truth)).fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn the_true_pose_is_among_the_hypotheses_of_small_and_large_problems() {
        let small = trial(&Conditions::WITH_FALSE_POINTS, 11);
        let large = large_room(5, 120);
        for (case, limit_m) in [(small, 0.1), (large, 0.3)] {
            let data = Prepared::new(&case.problem);
            let truth = case.truth();
            let config = PairwiseConfig::default();
            let motions = propose(&data, &config);
            let truth_motion = Motion::new(truth.x, truth.y, truth.z);
            assert!(best_displacement_m(&data, &motions, &truth_motion) < limit_m);
            assert!(motions.len() <= config.max_hypothesis_count);
        }
    }

    #[test]
    fn an_exact_segment_gives_the_exact_motion() {
        let mut data = Prepared::new(&trial(&Conditions::CLEAN, 1).problem);
        let truth = Motion::new(-5.0, 5.0, -2.0);
        for (point, node) in data.refs.iter_mut().zip(&data.nodes) {
            let mapped = truth.apply(node);
            (point.x, point.y) = (mapped.x, mapped.y);
        }
        let first = Candidate { ref_index: 0, node_index: 0 };
        let second = Candidate { ref_index: 9, node_index: 9 };
        let found = join(&data, first, second, &PairwiseConfig::default()).unwrap();
        assert!(data.displacement_m(&found.motion, &truth) < 1e-12);
        // A segment of another length must not be joined.
        data.refs[9].x += 1.0;
        data.refs[9].y += 1.0;
        assert!(join(&data, first, second, &PairwiseConfig::default()).is_none());
    }
}
