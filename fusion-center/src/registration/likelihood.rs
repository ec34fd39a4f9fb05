//! The robust likelihood ratio of a pose: common targets against nothing in common.
//!
//! Per period the reference has points of density `a` per m², the node of density `b`. A share of
//! them, of density `c = share · min(a, b)`, are pairs of one target; all others are misses of the
//! other side or false, and spread evenly. Against "nothing in common", with the same `a` and `b`,
//! the logarithm of the likelihood ratio of Poisson processes over `K` periods and the area `A` is
//!
//! `Λ = K A c + n₀ ln(1 − c/a) + n₁ ln(1 − c/b) + Σ_k ln Σ_matchings Π κ N(d_lj; 0, S_lj)`,
//! `κ = c / ((a − c)(b − c))` in m², `d_lj = z_l − (Φ z_j + t)`, `S_lj = R_l + Φ R_j Φᵀ`.
//!
//! The sum over partial matchings is bounded by `Π_l (1 + Σ_j w_lj)` and by `Π_j (1 + Σ_l w_lj)`,
//! `w = κ N`. The smaller bound stands for the sum: it is exact where pairs do not compete, and
//! where several points of one side compete for one of the other.
//!
//! Assumes independent errors and an even spread of unmatched points. Cost: one pass over all
//! pairs of points of one period.

use std::f64::consts::TAU;

use nalgebra::{Matrix2, Matrix3, Vector3};

use super::prepared::{Blob, Motion, Prepared, Span};

/// Pairs whose weight is below this are nothing to the sum `1 + Σ w`.
const NEGLIGIBLE_WEIGHT: f64 = 1e-5;

/// The same where poses are only ranked.
const WEAK_WEIGHT: f64 = 1e-2;

/// Largest share of common points that the model admits, so that a point is never forced to match.
const MAX_SHARE: f64 = 0.9;

/// Products are taken to their logarithm before they overflow.
const LARGE_PRODUCT: f64 = 1e100;

/// The model: data, share of common points, factor on all covariances.
#[derive(Clone, Copy)]
pub(super) struct Model<'a> {
    pub(super) data: &'a Prepared,
    share: f64,
    covariance_scale: f64,
    /// `κ / 2π` in m².
    weight_m2: f64,
    /// Beyond this squared Mahalanobis distance even the sharpest pair is negligible.
    gate: f64,
    /// Beyond this distance, metres, the squared Mahalanobis distance of any pair is.
    reach_m: f64,
}

impl<'a> Model<'a> {
    pub(super) fn new(data: &'a Prepared, share: f64, covariance_scale: f64) -> Self {
        Self::with_gate(data, (share, covariance_scale), NEGLIGIBLE_WEIGHT)
    }

    /// For ranking: weak pairs are left out.
    pub(super) fn rough(data: &'a Prepared, share: f64, covariance_scale: f64) -> Self {
        Self::with_gate(data, (share, covariance_scale), WEAK_WEIGHT)
    }

    fn with_gate(
        data: &'a Prepared,
        (share, covariance_scale): (f64, f64),
        negligible: f64,
    ) -> Self {
        let volume = data.spans.len() as f64 * data.area_m2;
        let (a, b) = (data.refs.len() as f64 / volume, data.nodes.len() as f64 / volume);
        let share = share.min(MAX_SHARE);
        let c = share * a.min(b);
        let weight_m2 = c / ((a - c) * (b - c)) / TAU;
        let smallest_root_det = data.smallest_root_det_m2 * covariance_scale;
        let gate = (2.0 * (weight_m2 / smallest_root_det / negligible).ln()).max(1.0);
        let reach_m = (gate * data.largest_variance_m2 * covariance_scale).sqrt();
        Self { data, share, covariance_scale, weight_m2, gate, reach_m }
    }

    /// The terms of Λ that do not depend on the pose.
    fn pose_free_terms(&self) -> f64 {
        let (n0, n1) = (self.data.refs.len() as f64, self.data.nodes.len() as f64);
        let common = self.share * n0.min(n1);
        common + n0 * (-common / n0).ln_1p() + n1 * (-common / n1).ln_1p()
    }

    /// The share that the expected number of matched pairs suggests (the EM update of `c`).
    pub(super) fn share_from(data: &Prepared, matched: f64) -> f64 {
        Self::share_of(matched, data.refs.len().min(data.nodes.len()) as f64)
    }

    /// The share of `matched` pairs among `fewer` points, kept off 0 and 1.
    pub(super) fn share_of(matched: f64, fewer: f64) -> f64 {
        ((matched + 0.5) / (fewer + 1.0)).min(MAX_SHARE)
    }
}

/// Two points of one period that may be the same target.
#[derive(Clone, Copy, Debug)]
pub(super) struct Link {
    pub(super) ref_index: usize,
    pub(super) node_index: usize,
    /// `κ N(d; 0, S)`, then the probability that the pair is one target.
    pub(super) weight: f64,
    /// Squared Mahalanobis distance.
    pub(super) chi_square: f64,
    /// Gradient of `ln w` by `(x, y, heading)`.
    pub(super) gradient: Vector3<f64>,
    /// `S⁻¹` as `[xx, xy, yy]`.
    precision: [f64; 3],
    /// Derivative of the mapped point by the heading.
    turn: [f64; 2],
}

impl Link {
    /// `S⁻¹` in 1/m².
    pub(super) fn precision(&self) -> Matrix2<f64> {
        let [xx, xy, yy] = self.precision;
        Matrix2::new(xx, xy, xy, yy)
    }

    /// `Jᵀ S⁻¹ J` with `J = [I | turn]`.
    fn information(&self) -> Matrix3<f64> {
        let [xx, xy, yy] = self.precision;
        let [u, v] = self.turn;
        let (x_turn, y_turn) = (xx * u + xy * v, xy * u + yy * v);
        Matrix3::new(xx, xy, x_turn, xy, yy, y_turn, x_turn, y_turn, u * x_turn + v * y_turn)
    }
}

/// Λ, its derivatives and what goes with it.
#[derive(Clone, Debug)]
pub(super) struct Fit {
    /// Λ, natural logarithm.
    pub(super) log_ratio: f64,
    /// `∂Λ/∂(x, y, heading)`.
    pub(super) gradient: Vector3<f64>,
    /// Expected information of the matched pairs, `Σ p Jᵀ S⁻¹ J`.
    pub(super) complete: Matrix3<f64>,
    /// Information lost because the matching is not known.
    pub(super) lost: Matrix3<f64>,
    /// Expected number of matched pairs.
    pub(super) matched: f64,
    /// Expected sum of squared Mahalanobis distances of the matched pairs.
    pub(super) chi_square: f64,
}

/// The links of one period and the side on which they compete.
#[derive(Default)]
pub(super) struct PeriodLinks {
    pub(super) span_index: usize,
    pub(super) links: Vec<Link>,
    /// `1 + Σ w` by reference point, then by node point.
    sums: [Vec<f64>; 2],
    competing_side: usize,
}

impl PeriodLinks {
    fn clear_sums(&mut self, span: &Span) {
        for (sums, count) in self.sums.iter_mut().zip([span.refs.len(), span.nodes.len()]) {
            sums.clear();
            sums.resize(count, 1.0);
        }
    }

    /// Turns weights into probabilities; returns the period's part of Λ.
    fn normalise(&mut self, span: &Span) -> LogProduct {
        for link in &self.links {
            self.sums[0][link.ref_index - span.refs.start] += link.weight;
            self.sums[1][link.node_index - span.nodes.start] += link.weight;
        }
        let bounds = [LogProduct::of(&self.sums[0]), LogProduct::of(&self.sums[1])];
        self.competing_side = usize::from(bounds[1].is_below(&bounds[0]));
        for index in 0..self.links.len() {
            let group = self.group(index, span);
            self.links[index].weight /= self.sums[self.competing_side][group];
        }
        bounds[self.competing_side]
    }

    fn group(&self, index: usize, span: &Span) -> usize {
        let link = &self.links[index];
        let by_side = [link.ref_index - span.refs.start, link.node_index - span.nodes.start];
        by_side[self.competing_side]
    }

    /// `Σ (p g gᵀ) − Σ_groups ḡ ḡᵀ`, `ḡ = Σ p g`: what not knowing the matching costs. `means` is
    /// room for the ḡ.
    fn lost_information(&self, span: &Span, means: &mut Vec<Vector3<f64>>) -> Matrix3<f64> {
        means.clear();
        means.resize(self.sums[self.competing_side].len(), Vector3::zeros());
        let mut lost = Matrix3::zeros();
        for (index, link) in self.links.iter().enumerate() {
            means[self.group(index, span)] += link.gradient * link.weight;
            lost += link.gradient * link.gradient.transpose() * link.weight;
        }
        means.iter().fold(lost, |left, mean| left - mean * mean.transpose())
    }
}

/// `Σ ln f` of factors of at least 1, with few logarithms.
#[derive(Clone, Copy, Debug)]
struct LogProduct {
    /// The product that no longer fitted, as a logarithm.
    log: f64,
    product: f64,
}

impl LogProduct {
    const ONE: Self = Self { log: 0.0, product: 1.0 };

    fn of(factors: &[f64]) -> Self {
        let mut all = Self::ONE;
        factors.iter().for_each(|factor| all.multiply(*factor));
        all
    }

    fn multiply(&mut self, factor: f64) {
        self.product *= factor;
        if self.product > LARGE_PRODUCT {
            self.log += self.product.ln();
            self.product = 1.0;
        }
    }

    fn multiply_by(&mut self, other: &Self) {
        self.log += other.log;
        self.multiply(other.product);
    }

    fn is_below(&self, other: &Self) -> bool {
        if self.log > 0.0 || other.log > 0.0 {
            self.ln() < other.ln()
        } else {
            self.product < other.product
        }
    }

    fn ln(&self) -> f64 {
        self.log + self.product.ln()
    }
}

/// Λ alone, without the terms free of the pose: for ranking. `by_ref` is room for the sums of the
/// reference's points.
pub(super) fn score(model: &Model<'_>, motion: &Motion, by_ref: &mut Vec<f64>) -> f64 {
    let mut total = LogProduct::ONE;
    for span in &model.data.spans {
        by_ref.clear();
        let mut by_node = LogProduct::ONE;
        for node in &model.data.nodes[span.nodes.clone()] {
            let mut sum = 1.0;
            for_each_near(model, motion, (span, node), |ref_index, mapped| {
                let weight = pair_weight(model, &model.data.refs[ref_index], mapped);
                by_ref.resize(span.refs.len(), 1.0);
                by_ref[ref_index - span.refs.start] += weight;
                sum += weight;
            });
            by_node.multiply(sum);
        }
        if !by_ref.is_empty() {
            let bounds = [by_node, LogProduct::of(by_ref)];
            total.multiply_by(&bounds[usize::from(bounds[1].is_below(&bounds[0]))]);
        }
    }
    total.ln()
}

/// Visits the reference's points of a period that are within reach of the node's point, with that
/// point in the reference frame.
fn for_each_near(
    model: &Model<'_>,
    motion: &Motion,
    (span, node): (&Span, &Blob),
    mut visit: impl FnMut(usize, &Blob),
) {
    let (turned_x, turned_y) = motion.turned(node.x, node.y);
    let (x, y) = (turned_x + motion.x, turned_y + motion.y);
    let mut mapped = None;
    let (gate, node_trace) = (model.gate * model.covariance_scale, node.xx + node.yy);
    for ref_index in model.data.refs_from(span, x, model.reach_m) {
        let point = &model.data.refs[ref_index];
        let (dx, dy) = (point.x - x, point.y - y);
        if dx > model.reach_m {
            break;
        }
        // The largest variance is below the trace.
        if dx * dx + dy * dy <= gate * (point.xx + point.yy + node_trace) {
            visit(ref_index, mapped.get_or_insert_with(|| motion.apply(node)));
        }
    }
}

fn pair_weight(model: &Model<'_>, point: &Blob, mapped: &Blob) -> f64 {
    let (dx, dy) = (point.x - mapped.x, point.y - mapped.y);
    let scale = model.covariance_scale;
    let (xx, xy, yy) = (
        (point.xx + mapped.xx) * scale,
        (point.xy + mapped.xy) * scale,
        (point.yy + mapped.yy) * scale,
    );
    let det = xx * yy - xy * xy;
    let chi_square_times_det = dx * dx * yy - 2.0 * dx * dy * xy + dy * dy * xx;
    if chi_square_times_det > model.gate * det {
        return 0.0;
    }
    model.weight_m2 * (-0.5 * chi_square_times_det / det).exp() / det.sqrt()
}

/// Visits the links of every period that has any, with their probabilities; returns Λ.
pub(super) fn for_each_period(
    model: &Model<'_>,
    motion: &Motion,
    visit: impl FnMut(&PeriodLinks, &Span),
) -> f64 {
    for_each_period_in(&mut PeriodLinks::default(), model, motion, visit)
}

/// As [`for_each_period`], with room that is used again.
fn for_each_period_in(
    period: &mut PeriodLinks,
    model: &Model<'_>,
    motion: &Motion,
    mut visit: impl FnMut(&PeriodLinks, &Span),
) -> f64 {
    let mut total = LogProduct::ONE;
    for (span_index, span) in model.data.spans.iter().enumerate() {
        period.span_index = span_index;
        period.links.clear();
        for node_index in span.nodes.clone() {
            collect_links(model, motion, span, (node_index, &mut period.links));
        }
        if !period.links.is_empty() {
            period.clear_sums(span);
            total.multiply_by(&period.normalise(span));
            visit(period, span);
        }
    }
    model.pose_free_terms() + total.ln()
}

fn collect_links(
    model: &Model<'_>,
    motion: &Motion,
    span: &Span,
    (node_index, links): (usize, &mut Vec<Link>),
) {
    for_each_near(model, motion, (span, &model.data.nodes[node_index]), |ref_index, mapped| {
        let point = &model.data.refs[ref_index];
        let weight = pair_weight(model, point, mapped);
        if weight > 0.0 {
            let link = differentiate(motion, point, mapped, model.covariance_scale);
            links.push(Link { ref_index, node_index, weight, ..link });
        }
    });
}

/// `∂ ln N(d; 0, S)`: by the shift `S⁻¹ d`; by the heading through the mapped point and through
/// `S' = Q R + R Qᵀ`, `Q` the quarter turn, `R` the turned covariance of the node's point.
pub(super) fn differentiate(motion: &Motion, point: &Blob, mapped: &Blob, scale: f64) -> Link {
    let (xx, xy, yy) = (
        (point.xx + mapped.xx) * scale,
        (point.xy + mapped.xy) * scale,
        (point.yy + mapped.yy) * scale,
    );
    let det = xx * yy - xy * xy;
    let precision = [yy / det, -xy / det, xx / det];
    let (dx, dy) = (point.x - mapped.x, point.y - mapped.y);
    let pull = [precision[0] * dx + precision[1] * dy, precision[1] * dx + precision[2] * dy];
    let turn = [-(mapped.y - motion.y), mapped.x - motion.x];
    let slope = [-2.0 * mapped.xy * scale, (mapped.xx - mapped.yy) * scale];
    let trace = (precision[0] - precision[2]) * slope[0] + 2.0 * precision[1] * slope[1];
    let bent =
        (pull[0] * pull[0] - pull[1] * pull[1]) * slope[0] + 2.0 * pull[0] * pull[1] * slope[1];
    let by_heading = pull[0] * turn[0] + pull[1] * turn[1] + 0.5 * (bent - trace);
    Link {
        ref_index: 0,
        node_index: 0,
        weight: 0.0,
        chi_square: dx * pull[0] + dy * pull[1],
        gradient: Vector3::new(pull[0], pull[1], by_heading),
        precision,
        turn,
    }
}

/// Room that evaluations use again.
#[derive(Default)]
pub(super) struct Room {
    period: PeriodLinks,
    means: Vec<Vector3<f64>>,
}

impl Fit {
    const NOTHING: Self = Self {
        log_ratio: 0.0,
        gradient: Vector3::new(0.0, 0.0, 0.0),
        complete: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        lost: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        matched: 0.0,
        chi_square: 0.0,
    };

    fn add(&mut self, links: &[Link]) {
        for link in links {
            self.gradient += link.gradient * link.weight;
            self.complete += link.information() * link.weight;
            self.matched += link.weight;
            self.chi_square += link.weight * link.chi_square;
        }
    }
}

/// Λ and its derivatives at a pose.
pub(super) fn evaluate(model: &Model<'_>, motion: &Motion) -> Fit {
    let mut room = Room::default();
    let mut fit = Fit::NOTHING;
    fit.log_ratio = for_each_period_in(&mut room.period, model, motion, |period, span| {
        fit.add(&period.links);
        fit.lost += period.lost_information(span, &mut room.means);
    });
    fit
}

/// As [`evaluate`], without what the unknown matching costs, which a climb does not need.
pub(super) fn evaluate_slope(model: &Model<'_>, motion: &Motion, room: &mut Room) -> Fit {
    let mut fit = Fit::NOTHING;
    fit.log_ratio =
        for_each_period_in(&mut room.period, model, motion, |period, _| fit.add(&period.links));
    fit
}

#[cfg(test)]
#[path = "likelihood_tests.rs"]
mod tests;
