//! How well an association keeps all distances: candidates, their mutual costs, local improvement.
//!
//! Two candidate pairs `(l, j)`, `(l', j')` cost `(|z_l − z_l'| − |z_j − z_j'|)²` in m²; an
//! association costs the sum over all its pairs of candidates. Cost: the square of the candidates.

use std::ops::Range;

use super::super::prepared::{Blob, Prepared, Span};
use super::GraphConfig;

/// Most rounds of local improvement; each lowers the cost.
const MAX_ROUND_COUNT: usize = 200;

/// Gain below which an exchange is rounding, m².
const NEGLIGIBLE_GAIN_M2: f64 = 1e-12;

/// Indices of candidates, ascending.
pub(super) type Association = Vec<usize>;

/// A reference's and a node's point of one period, as indices of the prepared data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Candidate {
    pub(super) ref_index: usize,
    pub(super) node_index: usize,
    pub(super) group: usize,
}

impl Candidate {
    /// Whether both cannot be in one association.
    pub(super) fn excludes(&self, other: &Self) -> bool {
        self.ref_index == other.ref_index || self.node_index == other.node_index
    }
}

/// The candidates of one period.
#[derive(Clone, Debug)]
pub(super) struct Group {
    span_index: usize,
    pub(super) candidates: Range<usize>,
    /// How many pairs an association takes.
    pub(super) common_count: usize,
}

/// The candidates of some periods and what they cost each other.
pub(super) struct Agreement<'a> {
    config: &'a GraphConfig,
    pub(super) groups: Vec<Group>,
    pub(super) candidates: Vec<Candidate>,
    costs_m2: Vec<f64>,
}

impl<'a> Agreement<'a> {
    /// The candidates of as many evenly spaced periods as the limit admits, at least one, of which
    /// the first points count where even one has too many.
    pub(super) fn new(data: &Prepared, config: &'a GraphConfig) -> Self {
        let given: usize = data.spans.iter().map(Span::pair_count).sum();
        let stride = given.div_ceil(config.max_candidate_count.max(1)).max(1);
        let (mut groups, mut candidates) = (Vec::new(), Vec::new());
        for span_index in (0..data.spans.len()).step_by(stride) {
            let span = &within(&data.spans[span_index], config.max_candidate_count);
            let start = candidates.len();
            candidates.extend(candidates_of(span, groups.len()));
            let common_count = common_count(span, config);
            groups.push(Group { span_index, candidates: start..candidates.len(), common_count });
        }
        let costs_m2 = candidates
            .iter()
            .flat_map(|a| candidates.iter().map(|b| cost_m2(data, a, b)))
            .collect();
        Self { config, groups, candidates, costs_m2 }
    }

    pub(super) fn cost_m2(&self, a: usize, b: usize) -> f64 {
        self.costs_m2[a * self.candidates.len() + b]
    }

    /// The cost of a whole association, m².
    pub(super) fn total_m2(&self, association: &[usize]) -> f64 {
        let with_later = |(at, a): (usize, &usize)| {
            association[at + 1..].iter().map(|b| self.cost_m2(*a, *b)).sum::<f64>()
        };
        association.iter().enumerate().map(with_later).sum()
    }

    /// The association that takes candidates in the given order, best first, where it may.
    pub(super) fn greedy(&self, order: impl Iterator<Item = usize>) -> Association {
        let mut taken = Association::new();
        let mut counts = vec![0; self.groups.len()];
        for index in order {
            let candidate = &self.candidates[index];
            let is_free = taken.iter().all(|t| !self.candidates[*t].excludes(candidate));
            if counts[candidate.group] < self.groups[candidate.group].common_count && is_free {
                counts[candidate.group] += 1;
                taken.push(index);
            }
        }
        taken.sort_unstable();
        taken
    }

    /// The association after exchanges of one candidate, or of the partners of two, as long as they
    /// lower the cost.
    pub(super) fn improved(&self, mut association: Association) -> Association {
        for _ in 0..MAX_ROUND_COUNT {
            let Some(exchange) = self.best_exchange(&association) else { break };
            association.retain(|index| !exchange.out.contains(index));
            association.extend(exchange.entering);
            association.sort_unstable();
        }
        association
    }

    fn best_exchange(&self, association: &[usize]) -> Option<Exchange> {
        let to_all: Vec<f64> = (0..self.candidates.len())
            .map(|c| association.iter().map(|taken| self.cost_m2(c, *taken)).sum())
            .collect();
        let exchanges = association.iter().flat_map(|&leaving| {
            let group = &self.groups[self.candidates[leaving].group];
            group.candidates.clone().filter_map(move |c| self.exchange(association, leaving, c))
        });
        exchanges
            .map(|exchange| Exchange { gain_m2: self.gain_m2(&exchange, &to_all), ..exchange })
            .filter(|exchange| exchange.gain_m2 > NEGLIGIBLE_GAIN_M2)
            .max_by(|a, b| a.gain_m2.total_cmp(&b.gain_m2))
    }

    /// What has to go and come for `entering` to take the place of `leaving`.
    fn exchange(&self, association: &[usize], leaving: usize, entering: usize) -> Option<Exchange> {
        let (old, new) = (&self.candidates[leaving], &self.candidates[entering]);
        let blocks = |index: &&usize| **index != leaving && self.candidates[**index].excludes(new);
        let mut blocking = association.iter().filter(blocks);
        let Some(&other) = blocking.next() else {
            let exchange = Exchange { out: vec![leaving], entering: vec![entering], gain_m2: 0.0 };
            return (entering != leaving).then_some(exchange);
        };
        if blocking.next().is_some() || new.ref_index != old.ref_index {
            return None;
        }
        // The reference points of `leaving` and `other` exchange their partners.
        let partner = Candidate { node_index: old.node_index, ..self.candidates[other] };
        let group = self.groups[old.group].candidates.clone();
        let crossed = group.into_iter().find(|index| self.candidates[*index] == partner)?;
        Some(Exchange {
            out: vec![leaving, other],
            entering: vec![entering, crossed],
            gain_m2: 0.0,
        })
    }

    fn gain_m2(&self, exchange: &Exchange, to_all: &[f64]) -> f64 {
        let sum = |set: &[usize]| set.iter().map(|index| to_all[*index]).sum::<f64>();
        let among = |set: &[usize]| self.total_m2(set);
        let across: f64 = exchange
            .entering
            .iter()
            .flat_map(|a| exchange.out.iter().map(|b| self.cost_m2(*a, *b)))
            .sum();
        let lost = sum(&exchange.out) - among(&exchange.out);
        let added = sum(&exchange.entering) - across + among(&exchange.entering);
        lost - added
    }

    /// The pairs of points of the association and, in the periods without candidates, greedily
    /// those that agree best with it.
    pub(super) fn extended(&self, data: &Prepared, association: &[usize]) -> Vec<(usize, usize)> {
        let base: Vec<Candidate> = association.iter().map(|c| self.candidates[*c]).collect();
        let mut pairs: Vec<(usize, usize)> =
            base.iter().map(|c| (c.ref_index, c.node_index)).collect();
        let is_base = |index: usize| self.groups.iter().any(|group| group.span_index == index);
        for (_, span) in data.spans.iter().enumerate().filter(|(index, _)| !is_base(*index)) {
            let count = common_count(span, self.config);
            pairs.extend(agreeing(data, &base, (span, count)));
        }
        pairs
    }
}

/// The pairs of a period that agree best with `base`, taken greedily.
fn agreeing(
    data: &Prepared,
    base: &[Candidate],
    (span, count): (&Span, usize),
) -> Vec<(usize, usize)> {
    let rated = |c: Candidate| (base.iter().map(|b| cost_m2(data, &c, b)).sum::<f64>(), c);
    let mut ranked: Vec<(f64, Candidate)> = candidates_of(span, usize::MAX).map(rated).collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut taken: Vec<Candidate> = Vec::new();
    for (_, candidate) in ranked {
        let is_free = taken.iter().all(|t| !t.excludes(&candidate));
        if taken.len() < count && is_free {
            taken.push(candidate);
        }
    }
    taken.iter().map(|c| (c.ref_index, c.node_index)).collect()
}

/// Candidates that leave and enter an association, and what that gains.
struct Exchange {
    out: Vec<usize>,
    entering: Vec<usize>,
    gain_m2: f64,
}

fn common_count(span: &Span, config: &GraphConfig) -> usize {
    let fewer = span.refs.len().min(span.nodes.len());
    if config.common_count == 0 { fewer } else { config.common_count.min(fewer) }
}

/// The first points of both sides, where all pairs of them are more than `limit`.
fn within(span: &Span, limit: usize) -> Span {
    let side = limit.isqrt().max(1);
    let cut = |points: &Range<usize>| points.start..points.end.min(points.start + side);
    let (refs, nodes) = (cut(&span.refs), cut(&span.nodes));
    if span.pair_count() <= limit { span.clone() } else { Span { refs, nodes, ..span.clone() } }
}

fn candidates_of(span: &Span, group: usize) -> impl Iterator<Item = Candidate> {
    let nodes = span.nodes.clone();
    span.refs.clone().flat_map(move |ref_index| {
        let of_ref = move |node_index| Candidate { ref_index, node_index, group };
        nodes.clone().map(of_ref)
    })
}

fn cost_m2(data: &Prepared, a: &Candidate, b: &Candidate) -> f64 {
    let distance_m = |p: &Blob, q: &Blob| (p.x - q.x).hypot(p.y - q.y);
    let in_ref = distance_m(&data.refs[a.ref_index], &data.refs[b.ref_index]);
    let in_node = distance_m(&data.nodes[a.node_index], &data.nodes[b.node_index]);
    (in_ref - in_node).powi(2)
}
