//! The likelihood ratio of a mode with what both sides' runs tell counted once.
//!
//! A standing target, or a fixed ghost that meets another in every period, is one coincidence and
//! not one per period, and a straight walk is two (see `runs`). So both sides' *runs* take the
//! place of their points. A run of each side meet with weight `W = Σ p / (τ o)`, at most 1, over
//! their links, `o` the periods in which the longer of the two had a run to meet, `τ` below 1 for
//! tracks, some of whose points stray. They meet at the mean difference `d̄ = J⁻¹ h`,
//! `J = Σ p S⁻¹`, `h = Σ p S⁻¹ d`, with the covariance of `n̂` independent pairs, `S̄ = P J⁻¹ / n̂`,
//! `P = Σ p`, `n̂ = P / s` between 1 and a limit, `s` how much longer errors last than a period: the
//! larger of two ratios to what independent errors give, that of the scores of blocks of periods
//! (where significant) and that of `hᵀ J⁻¹ h` over the meetings of tracks.
//!
//! Λ is taken anew, for tracks and for single points apart because false points are mostly single:
//! with `n₀'`, `n₁'` runs of `n₀`, `n₁` points in the volume `V' = K A (n₀' + n₁') / (n₀ + n₁)`,
//! `Λ' = V' c + n₀' ln(1 − c/a) + n₁' ln(1 − c/b) + Σ W ln(1 + κ N(d̄; 0, S̄))`,
//! `a = n₀'/V'`, `b = n₁'/V'`, `c = Σ W / V'`, `κ` as in the likelihood.
//! Where every point is a run this is Λ of the likelihood but for points that match half.

use std::f64::consts::TAU;
use std::ops::Range;

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

use super::likelihood::{Link, Model, for_each_period};
use super::modes::Mode;
use super::prepared::{Prepared, Span};
use super::runs::{RunClass, RunKind, Runs};
use crate::statistics::{BLOCK_COUNT, BlockRatio, MIN_PERIODS_FOR_BLOCKS, SIGNIFICANT_SIGMAS};

/// Most independent pairs that a run may stand for: errors common to all its points remain.
const MAX_AVERAGED: f64 = 16.0;

/// Runs of which this share of the points meet are taken to meet; the rest strayed.
const MET_SHARE: f64 = 0.75;

/// Runs with fewer matched points, expected, do not meet.
const NEGLIGIBLE_MATCH: f64 = 1e-3;

/// Freedom that a comparison of runs needs.
const MIN_FREEDOM: f64 = 4.0;

/// Both sides' runs.
pub(super) struct BothRuns {
    refs: Runs,
    nodes: Runs,
    place_distance_m: f64,
}

impl BothRuns {
    /// The runs of both sides; places closer than `place_distance_m` are one.
    pub(super) fn new(data: &Prepared, place_distance_m: f64) -> Self {
        let refs = Runs::new(&data.refs, &data.spans, |span| span.refs.clone(), place_distance_m);
        let nodes =
            Runs::new(&data.nodes, &data.spans, |span| span.nodes.clone(), place_distance_m);
        Self { refs, nodes, place_distance_m }
    }
}

/// What a mode matches.
pub(super) struct Matches {
    /// Pairs that more likely than not are one target.
    pub(super) matched_count: usize,
    /// Places at which they lie.
    pub(super) distinct_count: usize,
    /// Λ', natural logarithm.
    pub(super) log_ratio: f64,
    /// Expected pairs over independent pairs, at least 1.
    pub(super) repetition: f64,
    /// By how much errors that last longer than a period widen the covariance, at least 1.
    pub(super) widening: f64,
}

/// The links between a run of the reference and one of the node, added up.
struct Meeting {
    matched: f64,
    information: Matrix2<f64>,
    pull: Vector2<f64>,
    score: Vector3<f64>,
    class: RunClass,
    most_averaged: f64,
    weight: f64,
}

impl BothRuns {
    /// The still empty meeting of a run of each side. What stands errs the same way for as long as
    /// it stands: only walks average.
    fn meeting(&self, (of_ref, of_node): (usize, usize)) -> Meeting {
        let is_walk =
            self.refs.kinds[of_ref] == RunKind::Walk && self.nodes.kinds[of_node] == RunKind::Walk;
        let is_tracked = self.refs.class(of_ref) == RunClass::Tracked
            && self.nodes.class(of_node) == RunClass::Tracked;
        Meeting {
            matched: 0.0,
            information: Matrix2::zeros(),
            pull: Vector2::zeros(),
            score: Vector3::zeros(),
            class: if is_tracked { RunClass::Tracked } else { RunClass::Single },
            most_averaged: if is_walk { MAX_AVERAGED } else { 1.0 },
            weight: 0.0,
        }
    }
}

impl Meeting {
    fn add(&mut self, link: &Link) {
        self.matched += link.weight;
        self.information += link.precision() * link.weight;
        self.pull += link.gradient.xy() * link.weight;
        self.score += link.gradient * link.weight;
    }

    /// `n̂`.
    fn averaged(&self, lasting: f64) -> f64 {
        (self.matched / lasting).clamp(1.0, self.most_averaged)
    }

    /// `hᵀ J⁻¹ h`: two for independent errors.
    fn chi_square(&self) -> f64 {
        let inverse = self.information.try_inverse();
        inverse.map_or(0.0, |inverse| self.pull.dot(&(inverse * self.pull)))
    }

    /// `N(d̄; 0, S̄)` in 1/m².
    fn density_per_m2(&self, lasting: f64) -> f64 {
        let scale = self.averaged(lasting) / self.matched;
        let root = self.information.determinant().max(0.0).sqrt();
        (-0.5 * scale * self.chi_square()).exp() * scale * root / TAU
    }
}

/// The meetings, in order of the two runs.
type Meetings = Vec<((usize, usize), Meeting)>;

/// What `mode` matches, with what runs tell counted once.
pub(super) fn matches_of(data: &Prepared, runs: &BothRuns, mode: &Mode) -> Matches {
    let mut likely: Vec<usize> = Vec::with_capacity(data.nodes.len());
    let mut links: Vec<((usize, usize), Link)> = Vec::with_capacity(data.nodes.len());
    let mut block_scores = [Vector3::zeros(); BLOCK_COUNT];
    for_each_period(&mode.model(data), &mode.motion, |period, _| {
        let block = period.span_index * BLOCK_COUNT / data.spans.len();
        for link in &period.links {
            block_scores[block] += link.gradient * link.weight;
            let key = (runs.refs.of_point[link.ref_index], runs.nodes.of_point[link.node_index]);
            links.push((key, *link));
            if link.weight > 0.5 {
                likely.push(link.ref_index);
            }
        }
    });
    let mut meetings = gathered(runs, links);
    weigh(data, runs, &mut meetings);
    let lasting = block_ratio(data, &block_scores, &mode.covariance).max(run_ratio(&meetings));
    let is_long = data.spans.len() >= MIN_PERIODS_FOR_BLOCKS;
    let widening = if is_long { score_ratio(&meetings, &mode.covariance) } else { 1.0 };
    let independent: f64 = meetings.iter().map(|(_, m)| m.weight * m.averaged(lasting)).sum();
    let log_ratio = |class| class_log_ratio(data, runs, (&meetings, class), lasting);
    Matches {
        matched_count: likely.len(),
        distinct_count: place_count(data, &likely, runs.place_distance_m),
        log_ratio: log_ratio(RunClass::Single) + log_ratio(RunClass::Tracked),
        repetition: (mode.fit.matched / independent.max(f64::MIN_POSITIVE)).max(1.0),
        widening: lasting.max(widening),
    }
}

/// The meetings of which the links are, without those that are hardly any.
fn gathered(runs: &BothRuns, mut links: Vec<((usize, usize), Link)>) -> Meetings {
    links.sort_by_key(|(key, _)| *key);
    let meeting_of = |same: &[((usize, usize), Link)]| {
        let (key, _) = *same.first()?;
        let mut meeting = runs.meeting(key);
        same.iter().for_each(|(_, link)| meeting.add(link));
        (meeting.matched > NEGLIGIBLE_MATCH).then_some((key, meeting))
    };
    links.chunk_by(|a, b| a.0 == b.0).filter_map(meeting_of).collect()
}

/// `W` of every meeting.
fn weigh(data: &Prepared, runs: &BothRuns, meetings: &mut Meetings) {
    let (refs, nodes) = (&runs.refs, &runs.nodes);
    let mut pairs: Vec<(usize, usize)> = meetings.iter().map(|(key, _)| *key).collect();
    let spans = &data.spans;
    let ref_chances = chances((refs, nodes), &pairs, spans.iter().map(Span::refs_and_nodes));
    pairs.iter_mut().for_each(|pair| *pair = (pair.1, pair.0));
    pairs.sort_unstable();
    let node_chances = chances((nodes, refs), &pairs, spans.iter().map(Span::nodes_and_refs));
    for ((r, j), meeting) in meetings.iter_mut() {
        let needed = match meeting.class {
            RunClass::Tracked => MET_SHARE,
            RunClass::Single => 1.0,
        };
        let chances = ref_chances[*r].max(node_chances[*j]).max(1.0);
        meeting.weight = (meeting.matched / (needed * chances).max(1.0)).min(1.0);
    }
}

/// For every run of `own` the points that had a run to meet in their period; `pairs` of runs that
/// meet are sorted, `ranges` are the points of both sides by period.
fn chances(
    (own, other): (&Runs, &Runs),
    pairs: &[(usize, usize)],
    ranges: impl Iterator<Item = (Range<usize>, Range<usize>)>,
) -> Vec<f64> {
    let mut first_pair = vec![0; own.sizes.len() + 1];
    pairs.iter().for_each(|(run, _)| first_pair[run + 1] += 1);
    for run in 0..own.sizes.len() {
        first_pair[run + 1] += first_pair[run];
    }
    let mut counts = vec![0.0; own.sizes.len()];
    let mut last_seen = vec![0; other.sizes.len()];
    for (period, (own_points, other_points)) in (1..).zip(ranges) {
        other_points.for_each(|point| last_seen[other.of_point[point]] = period);
        for point in own_points {
            let run = own.of_point[point];
            let partners = &pairs[first_pair[run]..first_pair[run + 1]];
            if partners.iter().any(|(_, partner)| last_seen[*partner] == period) {
                counts[run] += 1.0;
            }
        }
    }
    counts
}

/// Mean squared difference of two runs of tracks in units of what independent errors give.
fn run_ratio(meetings: &Meetings) -> f64 {
    let averaged = || {
        meetings.iter().map(|(_, m)| m).filter(|m| m.class == RunClass::Tracked && m.matched > 2.0)
    };
    let free = averaged().map(|m| 2.0 * m.weight).sum::<f64>() - 3.0;
    let sum: f64 = averaged().map(|m| m.weight * m.chi_square()).sum();
    if free > MIN_FREEDOM { (sum / free).max(1.0) } else { 1.0 }
}

/// Λ' of the runs of tracks, or of the single points.
fn class_log_ratio(
    data: &Prepared,
    runs: &BothRuns,
    (meetings, class): (&Meetings, RunClass),
    lasting: f64,
) -> f64 {
    let ((n0, given0), (n1, given1)) =
        (runs.refs.run_and_point_count(class), runs.nodes.run_and_point_count(class));
    let of_class = || meetings.iter().map(|(_, meeting)| meeting).filter(|m| m.class == class);
    if n0 < 1.0 || n1 < 1.0 {
        return 0.0;
    }
    let volume_m2 = data.spans.len() as f64 * data.area_m2 * (n0 + n1) / (given0 + given1);
    let matched: f64 = of_class().map(|meeting| meeting.weight).sum();
    let common = Model::share_of(matched, n0.min(n1)) * n0.min(n1);
    let match_area_m2 = common * volume_m2 / ((n0 - common) * (n1 - common));
    let met: f64 =
        of_class().map(|m| m.weight * (match_area_m2 * m.density_per_m2(lasting)).ln_1p()).sum();
    common + n0 * (-common / n0).ln_1p() + n1 * (-common / n1).ln_1p() + met
}

/// Mean eigenvalue of `C Σ_b g_b g_bᵀ`, `g_b` the score of block `b` of periods: 1 for independent
/// errors, and 1 where it is not significantly above.
fn block_ratio(
    data: &Prepared,
    block_scores: &[Vector3<f64>; BLOCK_COUNT],
    covariance: &Matrix3<f64>,
) -> f64 {
    if data.spans.len() < MIN_PERIODS_FOR_BLOCKS {
        return 1.0;
    }
    let sum: f64 = block_scores.iter().map(|g| g.dot(&(covariance * g))).sum();
    BlockRatio::new(sum).if_significant(SIGNIFICANT_SIGMAS)
}

/// Variance of the pose over that of independent errors, where errors last as long as two runs meet:
/// `Σ gᵀ C g` over the scores `g` of all meetings against its expectation `E = Σ 3 f (1 − f)`, `f` a
/// meeting's share of the matched points; 1 where it is not significantly above. Three unknowns have
/// bent towards the `n = 1 / Σ f²` equal meetings that tell it, for which `4 / n` of it is added.
fn score_ratio(meetings: &Meetings, covariance: &Matrix3<f64>) -> f64 {
    let total: f64 = meetings.iter().map(|(_, m)| m.matched).sum();
    let (mut sum, mut expected, mut variance, mut shares) = (0.0, 0.0, 0.0, 0.0);
    for (_, meeting) in meetings {
        let share = meeting.matched / total;
        sum += meeting.score.dot(&(covariance * meeting.score));
        expected += 3.0 * share * (1.0 - share);
        variance += 6.0 * (share * (1.0 - share)).powi(2);
        shares += share * share;
    }
    let is_significant = sum > expected + SIGNIFICANT_SIGMAS * f64::sqrt(variance);
    if is_significant && expected >= 1.0 { sum / expected * (1.0 + 4.0 * shares) } else { 1.0 }
}

/// Places that are more than `distance_m` apart, counted greedily in order of time.
fn place_count(data: &Prepared, ref_indices: &[usize], distance_m: f64) -> usize {
    let mut places: Vec<usize> = Vec::new();
    for &index in ref_indices {
        let point = &data.refs[index];
        let is_far = |&place: &usize| {
            let other = &data.refs[place];
            let (dx, dy) = (point.x - other.x, point.y - other.y);
            dx * dx + dy * dy > distance_m * distance_m
        };
        if places.iter().all(is_far) {
            places.push(index);
        }
    }
    places.len()
}

#[cfg(test)]
mod tests {
    use super::super::likelihood::differentiate;
    use super::super::modes::refine;
    use super::super::prepared::Motion;
    use super::super::{Period, Problem};
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;

    use super::*;
    use crate::simulate::{Conditions, Sampler, large_room, line_paths, trial};

    fn assess(problem: &Problem, start: &Vector3<f64>) -> (Mode, Matches) {
        let data = Prepared::new(problem);
        let mode = refine(&data, Motion::new(start.x, start.y, start.z)).unwrap();
        let matches = matches_of(&data, &BothRuns::new(&data, 0.3), &mode);
        (mode, matches)
    }

    #[test]
    fn points_that_do_not_repeat_keep_their_ratio() {
        let case = trial(&Conditions::CLEAN, 2);
        let (mode, matches) = assess(&case.problem, &case.truth());
        assert_eq!((matches.matched_count, matches.distinct_count), (16, 16));
        assert!((matches.repetition - 1.0).abs() < 1e-3);
        assert!((matches.log_ratio / mode.fit.log_ratio - 1.0).abs() < 0.01);
    }

    #[test]
    fn a_problem_that_stands_still_is_no_stronger_but_one_that_comes_back_is() {
        let case = trial(&Conditions::CLEAN, 2);
        let (_, once) = assess(&case.problem, &case.truth());
        let periods = &case.problem.periods;
        let slowly = periods.iter().flat_map(|period| vec![period.clone(); 10]).collect();
        let (mode, slow) =
            assess(&Problem { periods: slowly, ..Problem::default() }, &case.truth());
        assert_eq!((slow.matched_count, slow.distinct_count), (160, 16));
        assert!((slow.repetition - 10.0).abs() < 0.1, "{}", slow.repetition);
        assert!((slow.log_ratio / once.log_ratio - 1.0).abs() < 0.05, "{}", slow.log_ratio);
        assert!(mode.fit.log_ratio > 9.0 * once.log_ratio);
        let pause = vec![Period::default(); 20];
        let (_, twice) = assess(
            &Problem { periods: [&periods[..], &pause, periods].concat(), ..Problem::default() },
            &case.truth(),
        );
        assert!((twice.log_ratio / once.log_ratio - 2.0).abs() < 0.1, "{}", twice.log_ratio);
    }

    #[test]
    fn a_straight_walk_counts_twice_at_the_precision_of_its_mean() {
        let paths = line_paths(&[[[2.0, 3.0], [6.0, 6.0]], [[8.0, 2.0], [3.0, 4.0]]], 60);
        let case = Sampler::new(3).observe(&paths, &Conditions::CLEAN);
        let (mode, matches) = assess(&case.problem, &case.truth());
        let independent = mode.fit.matched / matches.repetition;
        assert!((independent - 4.0 * MAX_AVERAGED).abs() < 1.0, "{independent}");
        assert!(matches.log_ratio < 0.2 * mode.fit.log_ratio, "{}", matches.log_ratio);
    }

    #[test]
    fn walks_that_miss_each_other_by_a_constant_show_lasting_errors() {
        let ends = [[[2.0, 3.0], [6.0, 6.0]], [[8.0, 2.0], [3.0, 4.0]], [[3.0, 7.0], [8.0, 7.5]]];
        let mut case = Sampler::new(3).observe(&line_paths(&ends, 40), &Conditions::CLEAN);
        let (_, fair) = assess(&case.problem, &case.truth());
        assert!(fair.widening < 2.0, "{}", fair.widening);
        for period in &mut case.problem.periods {
            period.in_node[0].mean.coords_m.x += 0.03;
            period.in_node[1].mean.coords_m.x -= 0.03;
        }
        let (_, biased) = assess(&case.problem, &case.truth());
        assert!(biased.widening > 2.0 * fair.widening, "{} {}", biased.widening, fair.widening);
        assert!(biased.log_ratio < fair.log_ratio);
    }

    #[test]
    fn the_density_of_a_meeting_is_that_of_the_weighted_mean() {
        let case = trial(&Conditions::CLEAN, 4);
        let data = Prepared::new(&case.problem);
        let truth = case.truth();
        let motion = Motion::new(truth.x + 0.02, truth.y, truth.z);
        let runs = BothRuns::new(&data, 0.3);
        let mut meeting = Meeting { most_averaged: 16.0, ..runs.meeting((0, 0)) };
        let mut sum = (Matrix2::zeros(), Vector2::zeros());
        for (index, weight) in [(0, 0.9), (3, 0.8), (8, 0.7)] {
            let (point, mapped) = (&data.refs[index], motion.apply(&data.nodes[index]));
            let mut link = differentiate(&motion, point, &mapped, 1.0);
            link.weight = weight;
            meeting.add(&link);
            let cov = Matrix2::new(
                point.xx + mapped.xx,
                point.xy + mapped.xy,
                point.xy + mapped.xy,
                point.yy + mapped.yy,
            );
            let precision = cov.try_inverse().unwrap() * weight;
            sum.0 += precision;
            sum.1 += precision * Vector2::new(point.x - mapped.x, point.y - mapped.y);
        }
        for (lasting, pair_count) in [(1.0, 2.4), (2.0, 1.2), (7.0, 1.0)] {
            let mean = sum.0.try_inverse().unwrap() * sum.1;
            let cov = sum.0.try_inverse().unwrap() * (2.4 / pair_count);
            let exponent = -0.5 * mean.dot(&(cov.try_inverse().unwrap() * mean));
            let expected = exponent.exp() / (TAU * cov.determinant().sqrt());
            let found = meeting.density_per_m2(lasting);
            assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
        }
    }

    /// Meetings of so many points each, whose errors have standard deviation 1 per axis and of which
    /// each meeting has `fresh_count` different ones, after the fit of three unknowns that every point
    /// sees directly; and the covariance of that fit for independent errors.
    fn meetings(
        sizes: &[usize],
        fresh: impl Fn(usize) -> usize,
        seed: u64,
    ) -> (Meetings, Matrix3<f64>) {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut mean = || -> Vector3<f64> { Vector3::from_fn(|_, _| rng.sample(StandardNormal)) };
        let errors: Vec<Vector3<f64>> =
            sizes.iter().map(|size| mean() / (fresh(*size) as f64).sqrt()).collect();
        let total = sizes.iter().sum::<usize>() as f64;
        let fitted =
            sizes.iter().zip(&errors).map(|(n, e)| e * *n as f64).sum::<Vector3<f64>>() / total;
        let case = trial(&Conditions::CLEAN, 4);
        let runs = BothRuns::new(&Prepared::new(&case.problem), 0.3);
        let meeting = |(n, error): (&usize, &Vector3<f64>)| {
            let matched = *n as f64;
            ((0, 0), Meeting { matched, score: (error - fitted) * matched, ..runs.meeting((0, 0)) })
        };
        (sizes.iter().zip(&errors).map(meeting).collect(), Matrix3::identity() / total)
    }

    #[test]
    fn errors_that_last_for_a_meeting_widen_by_its_length() {
        let sizes = [[40; 20], [5; 20]].concat();
        let (mut mean, mut fair_count) = (0.0, 0);
        const TRIAL_COUNT: u64 = 400;
        for seed in 0..TRIAL_COUNT {
            let (lasting, covariance) = meetings(&sizes, |_| 1, seed);
            mean += score_ratio(&lasting, &covariance) / TRIAL_COUNT as f64;
            let (fair, of_fair) = meetings(&sizes, |size| size, seed);
            fair_count += u64::from(score_ratio(&fair, &of_fair) <= 1.0);
        }
        // The fit's variance is Σ n² / (Σ n)² and not 1 / Σ n: 36.1 times that. It is told by 24.9
        // equal meetings, for which 4 / 24.9 of it is added. One trial spreads by a sixth.
        assert!((mean / (36.1 * (1.0 + 4.0 / 24.9)) - 1.0).abs() < 0.04, "{mean}");
        assert!(fair_count >= TRIAL_COUNT - 8, "{fair_count}");
    }

    #[test]
    fn chances_are_the_points_with_a_partner_in_their_period() {
        let case = large_room(4, 40);
        let data = Prepared::new(&case.problem);
        let runs = BothRuns::new(&data, 0.3);
        // Any set of pairs will do.
        let mut pairs: Vec<(usize, usize)> = (0..300)
            .map(|k| (k * 7919 % runs.refs.sizes.len(), k * 104_729 % runs.nodes.sizes.len()))
            .collect();
        for span in &data.spans {
            let (r, j) = (span.refs.start, span.nodes.start);
            pairs.push((runs.refs.of_point[r], runs.nodes.of_point[j]));
        }
        pairs.sort_unstable();
        pairs.dedup();
        let ranges = data.spans.iter().map(Span::refs_and_nodes);
        let found = chances((&runs.refs, &runs.nodes), &pairs, ranges);
        let mut expected = vec![0.0; runs.refs.sizes.len()];
        for span in &data.spans {
            for point in span.refs.clone() {
                let run = runs.refs.of_point[point];
                let meets = |j: usize| pairs.contains(&(run, runs.nodes.of_point[j]));
                expected[run] += f64::from(u8::from(span.nodes.clone().any(meets)));
            }
        }
        assert_eq!(found, expected);
        assert!(expected.iter().sum::<f64>() >= 40.0);
    }
}
