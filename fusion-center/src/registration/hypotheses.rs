//! Pose hypotheses from pairs of candidate matches.
//!
//! A candidate is a point of each side in one period. Two candidates, of one or of two periods,
//! span a segment on each side; if the lengths agree within their uncertainty,
//! `(L₀ − L₁)² ≤ q² (u₀ᵀ(R_l1 + R_l2)u₀ + u₁ᵀ(R_j1 + R_j2)u₁)`, the motion that lays the one
//! segment on the other, middle on middle, is a hypothesis. So the segments between two periods are
//! listed once for each side and compared with each other. All pairs of periods are compared where
//! candidates are few; else pairs of periods, and a few points of each, are drawn at random, long
//! segments preferred because their direction, and with it the heading, is the surer. Segments of
//! fixed ghosts repeat over the periods, so that drawing them often costs trials, never correctness.
//!
//! Cost: one comparison per pair of candidates.

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use super::pairwise::PairwiseConfig;
use super::prepared::{Blob, Motion, Place, Prepared, Span, apart_m2};

/// Pairs of periods that are drawn per wanted hypothesis before drawing gives up.
const DRAWS_PER_HYPOTHESIS: usize = 8;

/// Points of a side and period that one draw looks at: more would make one draw's hypotheses too
/// much alike.
const WINDOW_COUNT: usize = 4;

/// Heaps that a hypothesis is compared with, those with the most members.
const COMPARED_COUNT: usize = 16;

/// A pose that a pair of candidates suggests.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hypothesis {
    pub(super) motion: Motion,
    /// Length of the segment, metres.
    pub(super) length_m: f64,
}

/// Whether all pairs of candidates are few enough to be tried.
pub(super) fn are_few(data: &Prepared, config: &PairwiseConfig) -> bool {
    let count: usize = data.spans.iter().map(Span::pair_count).sum();
    count * count.saturating_sub(1) / 2 <= config.exhaustive_pair_limit
}

/// The hypotheses of all pairs of candidates.
pub(super) fn all(data: &Prepared, config: &PairwiseConfig) -> Vec<Hypothesis> {
    let mut segments = Segments::new(config);
    let mut found = Vec::new();
    for (index, first) in data.spans.iter().enumerate() {
        for second in &data.spans[index..] {
            let ends = |of: fn(&Span) -> Window| [of(first), of(second)];
            segments.list(data, ends(Window::refs), ends(Window::nodes));
            segments.join(data, |hypothesis| found.push(hypothesis));
        }
    }
    found
}

/// Hypotheses drawn at random.
pub(super) struct Draws<'a> {
    data: &'a Prepared,
    segments: Segments,
    rng: ChaCha8Rng,
    sure_length_m: f64,
}

impl<'a> Draws<'a> {
    /// Draws that depend on the data and the seed only.
    pub(super) fn new(data: &'a Prepared, config: &PairwiseConfig) -> Self {
        Self {
            data,
            segments: Segments::new(config),
            rng: ChaCha8Rng::seed_from_u64(config.seed),
            sure_length_m: 2.0 * data.node_spread_m,
        }
    }

    /// About `count` more hypotheses, fewer where the data hold hardly any.
    pub(super) fn next(&mut self, count: usize) -> Vec<Hypothesis> {
        let mut found = Vec::with_capacity(count + count / 2);
        if self.data.spans.is_empty() {
            return found;
        }
        for _ in 0..count.saturating_mul(DRAWS_PER_HYPOTHESIS) {
            if found.len() >= count {
                break;
            }
            self.draw(&mut found);
        }
        found
    }

    fn draw(&mut self, found: &mut Vec<Hypothesis>) {
        let spans = &self.data.spans;
        let first = &spans[self.rng.random_range(0..spans.len())];
        let second = &spans[self.rng.random_range(0..spans.len())];
        let mut ends =
            |of: fn(&Span) -> Window| [of(first).cut(&mut self.rng), of(second).cut(&mut self.rng)];
        let (refs, nodes) = (ends(Window::refs), ends(Window::nodes));
        self.segments.list(self.data, refs, nodes);
        let (rng, sure_length_m) = (&mut self.rng, self.sure_length_m);
        self.segments.join(self.data, |hypothesis| {
            if rng.random::<f64>() * sure_length_m <= hypothesis.length_m {
                found.push(hypothesis);
            }
        });
    }
}

/// Some points of one side and period: `count` from `offset` on, the first after the last.
#[derive(Clone, Copy)]
struct Window {
    start: usize,
    len: usize,
    offset: usize,
    count: usize,
}

impl Window {
    fn refs(span: &Span) -> Self {
        Self { start: span.refs.start, len: span.refs.len(), offset: 0, count: span.refs.len() }
    }

    fn nodes(span: &Span) -> Self {
        Self { start: span.nodes.start, len: span.nodes.len(), offset: 0, count: span.nodes.len() }
    }

    /// A few points at a random place.
    fn cut(self, rng: &mut ChaCha8Rng) -> Self {
        if self.len <= WINDOW_COUNT {
            return self;
        }
        Self { offset: rng.random_range(0..self.len), count: WINDOW_COUNT, ..self }
    }

    fn indices(self) -> impl Iterator<Item = usize> {
        (self.offset..self.offset + self.count).map(move |at| self.start + at % self.len)
    }
}

/// The way from one point to another of the same side.
#[derive(Clone, Copy, Debug)]
struct Segment {
    from: usize,
    to: usize,
    dx: f64,
    dy: f64,
    length_m: f64,
    /// Variance of the length times the squared gate, m².
    tolerance_m2: f64,
}

/// The segments of both sides between two periods.
struct Segments {
    refs: Vec<Segment>,
    nodes: Vec<Segment>,
    limits: Limits,
}

/// Which segments are of use, and how far the lengths of two may differ.
#[derive(Clone, Copy)]
struct Limits {
    min_length_m: f64,
    squared_gate: f64,
}

impl Segments {
    fn new(config: &PairwiseConfig) -> Self {
        let limits = Limits {
            min_length_m: config.min_baseline_m,
            squared_gate: config.length_gate_sigma.powi(2),
        };
        Self { refs: Vec::new(), nodes: Vec::new(), limits }
    }

    /// Lists the segments from the first to the second window of each side. Within one period the
    /// reference's are listed in one direction only, because the node's are in both.
    fn list(&mut self, data: &Prepared, refs: [Window; 2], nodes: [Window; 2]) {
        let is_one_period = refs[0].start == refs[1].start;
        let limits = self.limits;
        self.refs.clear();
        self.nodes.clear();
        for from in refs[0].indices() {
            let others = refs[1].indices().filter(|to| !is_one_period || from < *to);
            self.refs.extend(others.filter_map(|to| limits.segment(&data.refs, from, to)));
        }
        if self.refs.is_empty() {
            return;
        }
        for from in nodes[0].indices() {
            let others = nodes[1].indices().filter(|to| from != *to);
            self.nodes.extend(others.filter_map(|to| limits.segment(&data.nodes, from, to)));
        }
    }

    /// The motions that lay a segment of the node on one of the reference of equal length.
    fn join(&self, data: &Prepared, mut take: impl FnMut(Hypothesis)) {
        for of_ref in &self.refs {
            let is_equal = |of_node: &&Segment| {
                let difference = of_ref.length_m - of_node.length_m;
                difference * difference <= of_ref.tolerance_m2 + of_node.tolerance_m2
            };
            for of_node in self.nodes.iter().filter(is_equal) {
                let motion = laid_on(data, of_ref, of_node);
                take(Hypothesis { motion, length_m: of_ref.length_m });
            }
        }
    }
}

impl Limits {
    fn segment(&self, blobs: &[Blob], from: usize, to: usize) -> Option<Segment> {
        let (a, b) = (&blobs[from], &blobs[to]);
        let (dx, dy) = (b.x - a.x, b.y - a.y);
        let squared = dx * dx + dy * dy;
        if squared < self.min_length_m * self.min_length_m {
            return None;
        }
        let (xx, xy, yy) = (a.xx + b.xx, a.xy + b.xy, a.yy + b.yy);
        let variance = (dx * dx * xx + 2.0 * dx * dy * xy + dy * dy * yy) / squared;
        let tolerance_m2 = self.squared_gate * variance;
        Some(Segment { from, to, dx, dy, length_m: squared.sqrt(), tolerance_m2 })
    }
}

/// The motion that lays the node's segment on the reference's, middle on middle.
fn laid_on(data: &Prepared, of_ref: &Segment, of_node: &Segment) -> Motion {
    let (ref_a, ref_b) = (&data.refs[of_ref.from], &data.refs[of_ref.to]);
    let (node_a, node_b) = (&data.nodes[of_node.from], &data.nodes[of_node.to]);
    let product = of_ref.length_m * of_node.length_m;
    let cos = (of_ref.dx * of_node.dx + of_ref.dy * of_node.dy) / product;
    let sin = (of_ref.dy * of_node.dx - of_ref.dx * of_node.dy) / product;
    let mut motion = Motion { x: 0.0, y: 0.0, cos, sin };
    let (x, y) = motion.turned(0.5 * (node_a.x + node_b.x), 0.5 * (node_a.y + node_b.y));
    motion.x = 0.5 * (ref_a.x + ref_b.x) - x;
    motion.y = 0.5 * (ref_a.y + ref_b.y) - y;
    motion
}

/// Hypotheses that say nearly the same.
struct Heap {
    place: Place,
    /// Sums weighted by the squared length: where the middle comes to lie, and the heading.
    sums: [f64; 5],
    member_count: usize,
}

impl Heap {
    fn new(place: Place) -> Self {
        Self { place, sums: [0.0; 5], member_count: 0 }
    }

    fn add(&mut self, place: &Place, hypothesis: &Hypothesis) {
        let weight = hypothesis.length_m * hypothesis.length_m;
        let motion = &hypothesis.motion;
        let values = [1.0, place[0], place[1], motion.cos, motion.sin];
        self.sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
        self.member_count += 1;
    }

    /// The weighted mean.
    fn mean(&self, data: &Prepared) -> Motion {
        let [weight, x, y, cos, sin] = self.sums;
        let length = (cos * cos + sin * sin).sqrt();
        let mut motion = Motion { x: 0.0, y: 0.0, cos: cos / length, sin: sin / length };
        let (turned_x, turned_y) = motion.turned(data.node_center_m.x, data.node_center_m.y);
        (motion.x, motion.y) = (x / weight - turned_x, y / weight - turned_y);
        motion
    }
}

/// The means of hypotheses that lie within `radius_m` of each other. Only the largest heaps grow;
/// what is far from them stays as it is.
pub(super) fn heaped(data: &Prepared, hypotheses: &[Hypothesis], radius_m: f64) -> Vec<Motion> {
    let mut heaps: Vec<Heap> = Vec::with_capacity(hypotheses.len().min(4 * COMPARED_COUNT));
    let limit_m2 = radius_m * radius_m;
    for hypothesis in hypotheses {
        let place = data.place(&hypothesis.motion);
        let compared = heaps.iter().take(COMPARED_COUNT);
        let near = compared.map(|heap| apart_m2(&heap.place, &place)).position(|d| d < limit_m2);
        let index = near.unwrap_or(heaps.len());
        if near.is_none() {
            heaps.push(Heap::new(place));
        }
        heaps[index].add(&place, hypothesis);
        // A heap that grows moves to the front, where it is found sooner.
        if index > 0 && heaps[index].member_count > heaps[index - 1].member_count {
            heaps.swap(index, index - 1);
        }
    }
    heaps.iter().map(|heap| heap.mean(data)).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix2, Vector2};

    use super::*;
    use crate::simulate::{Conditions, large_room, trial};

    fn best_displacement_m(data: &Prepared, motions: &[Motion], truth: &Motion) -> f64 {
        motions.iter().map(|m| data.displacement_m(m, truth)).fold(f64::INFINITY, f64::min)
    }

    fn motions(hypotheses: &[Hypothesis]) -> Vec<Motion> {
        hypotheses.iter().map(|hypothesis| hypothesis.motion).collect()
    }

    /// All pairs of candidates, one at a time, with matrices: the oracle.
    fn one_by_one(data: &Prepared, config: &PairwiseConfig) -> Vec<Motion> {
        let pairs_of = |span: &Span| -> Vec<(usize, usize)> {
            let refs = span.refs.clone();
            refs.flat_map(|r| span.nodes.clone().map(move |j| (r, j))).collect()
        };
        let candidates: Vec<(usize, usize)> = data.spans.iter().flat_map(pairs_of).collect();
        let later =
            |index: usize| candidates[index + 1..].iter().map(move |second| (index, second));
        (0..candidates.len())
            .flat_map(later)
            .map(|(index, second)| (candidates[index], *second))
            .filter(|(first, second)| first.0 != second.0 && first.1 != second.1)
            .filter_map(|pair| slowly_joined(data, pair, config))
            .collect()
    }

    fn slowly_joined(
        data: &Prepared,
        (first, second): ((usize, usize), (usize, usize)),
        config: &PairwiseConfig,
    ) -> Option<Motion> {
        let at = |blob: &Blob| Vector2::new(blob.x, blob.y);
        let cov = |blob: &Blob| Matrix2::new(blob.xx, blob.xy, blob.xy, blob.yy);
        let (ref_a, ref_b) = (&data.refs[first.0], &data.refs[second.0]);
        let (node_a, node_b) = (&data.nodes[first.1], &data.nodes[second.1]);
        let (long, other) = (at(ref_b) - at(ref_a), at(node_b) - at(node_a));
        let variance = |way: &Vector2<f64>, a: &Blob, b: &Blob| {
            let along = way.normalize();
            along.dot(&((cov(a) + cov(b)) * along))
        };
        let sigma = (variance(&long, ref_a, ref_b) + variance(&other, node_a, node_b)).sqrt();
        let difference = (long.norm() - other.norm()).abs();
        if long.norm().min(other.norm()) < config.min_baseline_m
            || difference > config.length_gate_sigma * sigma
        {
            return None;
        }
        let turn = nalgebra::Rotation2::rotation_between(&other, &long);
        let shift = (at(ref_a) + at(ref_b) - turn * (at(node_a) + at(node_b))) * 0.5;
        Some(Motion::new(shift.x, shift.y, turn.angle()))
    }

    #[test]
    fn all_hypotheses_are_those_of_candidates_tried_one_by_one() {
        let config = PairwiseConfig::default();
        for seed in 0..5 {
            let data = Prepared::new(&trial(&Conditions::WITH_FALSE_POINTS, seed).problem);
            let (found, expected) = (motions(&all(&data, &config)), one_by_one(&data, &config));
            assert_eq!(found.len(), expected.len());
            assert!(expected.len() > 20);
            for motion in &expected {
                assert!(best_displacement_m(&data, &found, motion) < 1e-9);
            }
        }
    }

    #[test]
    fn drawn_hypotheses_are_some_of_all_and_hold_the_true_pose() {
        let config = PairwiseConfig::default();
        for (case, limit_m) in
            [(trial(&Conditions::WITH_FALSE_POINTS, 11), 0.1), (large_room(5, 12), 0.3)]
        {
            let data = Prepared::new(&case.problem);
            let drawn = motions(&Draws::new(&data, &config).next(400));
            assert_eq!(drawn, motions(&Draws::new(&data, &config).next(400)));
            let truth = Motion::new(case.truth().x, case.truth().y, case.truth().z);
            assert!(best_displacement_m(&data, &drawn, &truth) < limit_m);
            let every = motions(&all(&data, &config));
            for motion in &drawn {
                assert!(best_displacement_m(&data, &every, motion) < 1e-9);
            }
        }
    }

    #[test]
    fn points_without_a_segment_end_the_drawing() {
        let mut problem = trial(&Conditions::CLEAN, 1).problem;
        problem.periods.truncate(1);
        problem.periods[0].in_node.truncate(1);
        let data = Prepared::new(&problem);
        let config = PairwiseConfig::default();
        assert!(Draws::new(&data, &config).next(50).is_empty());
        assert!(all(&data, &config).is_empty());
    }

    #[test]
    fn windows_of_many_points_reach_every_point() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let whole = Window { start: 30, len: 9, offset: 0, count: 9 };
        let mut hits = [0; 9];
        for _ in 0..900 {
            let cut: Vec<usize> = whole.cut(&mut rng).indices().collect();
            assert_eq!(cut.len(), WINDOW_COUNT);
            cut.iter().for_each(|index| hits[index - 30] += 1);
        }
        // 400 expected, binomial standard deviation 15.
        assert!(hits.iter().all(|count| (325..475).contains(count)), "{hits:?}");
    }

    #[test]
    fn a_heap_is_the_weighted_mean_of_its_members() {
        let data = Prepared::new(&trial(&Conditions::CLEAN, 1).problem);
        let hypothesis = |x: f64, heading_rad: f64, length_m: f64| Hypothesis {
            motion: Motion::new(x, 2.0, heading_rad),
            length_m,
        };
        // Equal headings: the middle moves as the origin does. Weights 1 and 4.
        let near = [hypothesis(0.0, 0.3, 1.0), hypothesis(0.05, 0.3, 2.0)];
        let far = hypothesis(3.0, 0.3, 1.0);
        let means = heaped(&data, &[near[0], far, near[1]], 0.2);
        assert_eq!(means.len(), 2);
        let expected = [Motion::new(0.04, 2.0, 0.3), far.motion];
        for motion in &expected {
            assert!(best_displacement_m(&data, &means, motion) < 1e-12, "{means:?}");
        }
    }
}
