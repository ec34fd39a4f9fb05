//! An upper bound of the likelihood ratio over a cell of poses and all shares of common points.
//!
//! A pose is written as the place `c` of the middle of the node's points and the heading `φ`, so
//! that turning moves points little. Over the cell `|c_x − c_x0| ≤ h_x`, `|c_y − c_y0| ≤ h_y`,
//! `|φ − φ_0| ≤ δ` the point `j` with the arm `v_j` from that middle moves by at most
//! `ρ_j = 2 |v_j| sin(δ/2)` more than the middle, so its distance from the reference's point `l` is
//! at least `e = |d_0 outside the rectangle| − ρ_j`, `d_0 = z_l − c_0 − Φ_0 v_j`. With `λ` the sum of
//! the larger eigenvalues and `D` the least determinant of `R_l + Φ R_j Φᵀ` over all headings,
//! `N(d; 0, S) ≤ exp(−max(e, 0)² / 2λ) / (2π √D) = n_lj`. The same holds with the distance from the
//! rectangle around the arc. Sines and chords are replaced by the angle, which is never smaller.
//!
//! In small cells `ln n_lj` is a linear function of place and sine of the turn instead (see
//! `Pair::at_corners`), one for all poses of the cell. Then `P` is convex in these, so that it is
//! largest at a corner, and what brings one pair together may drive another apart.
//!
//! The density `c` of common points is free: with `K A` the volume,
//! `F(c) = K A c + n₀ ln(1 − c/a) + n₁ ln(1 − c/b)` and `κ(c) = c / ((a − c)(b − c))`, the sum
//! `P(c) = Σ ln(1 + κ n)` is convex in `ln κ`, so over `[c₁, c₂]` it lies below its chord of slope
//! `m`. `F + m ln κ` has its only maximum at `c = m / (K A)`, because `F' = −K A c (ln κ)'`. Below
//! `c₁` the bound is `P(c₁)`, as `F ≤ 0`.
//!
//! Cost: one pass over the pairs that reach the cell.

use std::f64::consts::TAU;
use std::ops::Range;

use super::super::prepared::{Blob, Motion, Prepared, Span};
use super::exponential::exp_above;
use super::sums::{Place, Sums};

/// Range of the share of common points between whose ends the chord is taken. The upper one is the
/// largest that the model admits; below the lower one the bound is loose, but no mode is there.
const SHARES: [f64; 2] = [0.05, 0.9];

/// Pairs whose weight is below this at the largest share count as nothing in the likelihood too.
const NEGLIGIBLE_WEIGHT: f64 = 1e-6;

/// Cells of half widths below this many typical standard deviations get the finer bound: 0.7 and 2
/// take a tenth longer in the scene of \[registration\], seeds 5000..5150.
const FINE_SIGMAS: f64 = 1.5;

/// Corners of a cell.
const CORNER_COUNT: usize = 8;

/// A box of poses.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cell {
    /// Where the middle of the node's points lies, metres.
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) heading_rad: f64,
    /// Half the widths.
    pub(super) half_x: f64,
    pub(super) half_y: f64,
    pub(super) half_turn_rad: f64,
}

impl Cell {
    /// At least `2 sin(δ/2)`: how far turning by at most δ moves a point at distance 1.
    pub(super) fn chord(&self) -> f64 {
        self.half_turn_rad.min(2.0)
    }

    /// The motion in its middle.
    pub(super) fn motion(&self, data: &Prepared) -> Motion {
        let mut motion = Motion::new(0.0, 0.0, self.heading_rad);
        let (x, y) = motion.turned(data.node_center_m.x, data.node_center_m.y);
        (motion.x, motion.y) = (self.x - x, self.y - y);
        motion
    }

    /// The two halves, cut where points at `arm_m` from the middle move most.
    pub(super) fn halves(&self, arm_m: f64) -> [Self; 2] {
        let (mut low, mut high) = (*self, *self);
        if self.chord() * arm_m > self.half_x.max(self.half_y) {
            let half = 0.5 * self.half_turn_rad;
            (low.half_turn_rad, high.half_turn_rad) = (half, half);
            (low.heading_rad, high.heading_rad) =
                (self.heading_rad - half, self.heading_rad + half);
        } else if self.half_x > self.half_y {
            let half = 0.5 * self.half_x;
            (low.half_x, high.half_x) = (half, half);
            (low.x, high.x) = (self.x - half, self.x + half);
        } else {
            let half = 0.5 * self.half_y;
            (low.half_y, high.half_y) = (half, half);
            (low.y, high.y) = (self.y - half, self.y + half);
        }
        [low, high]
    }
}

/// A point of each side in one period.
#[derive(Clone, Copy)]
struct Pair {
    ref_x: f64,
    ref_y: f64,
    arm_x: f64,
    arm_y: f64,
    arm_m: f64,
    /// `1 / (2π √D)` with the least determinant over all headings.
    peak: f64,
    shape: Shape,
    /// `1 / 2λ`.
    fall: f64,
    /// Distance beyond which the weight is nothing.
    reach_m: f64,
    place: Place,
}

/// What the covariance of a pair needs at a given heading: half the trace of the sum, the deviators
/// `((xx − yy)/2, xy)` of both sides.
#[derive(Clone, Copy)]
struct Shape {
    mean_m2: f64,
    of_ref: [f64; 2],
    of_node: [f64; 2],
    /// Differences of the eigenvalues of both sides multiplied, m⁴, and that of the node's, m².
    product_m4: f64,
    node_m2: f64,
    least_determinant_m4: f64,
}

/// A cell, ready to use.
struct Bed {
    x: f64,
    y: f64,
    half_x: f64,
    half_y: f64,
    cos: f64,
    sin: f64,
    /// Of twice the heading.
    cos_2: f64,
    sin_2: f64,
    half_turn_rad: f64,
    chord: f64,
    /// At least the largest sine of a turn within the cell, and the largest `1 − cos`.
    sine: f64,
    versine: f64,
}

/// How far a pair is from meeting.
struct Gap {
    /// `d_0`, metres.
    dx: f64,
    dy: f64,
    /// `Φ_0 v`, metres.
    arm_x: f64,
    arm_y: f64,
    /// Lower bound of `|d|²` over the cell.
    square_m2: f64,
}

impl Bed {
    fn new(cell: &Cell) -> Self {
        let (sin, cos) = cell.heading_rad.sin_cos();
        Self {
            x: cell.x,
            y: cell.y,
            half_x: cell.half_x,
            half_y: cell.half_y,
            cos,
            sin,
            cos_2: cos * cos - sin * sin,
            sin_2: 2.0 * sin * cos,
            half_turn_rad: cell.half_turn_rad,
            chord: cell.chord(),
            sine: cell.half_turn_rad.min(1.0),
            versine: (0.5 * cell.half_turn_rad * cell.half_turn_rad).min(2.0),
        }
    }

    /// `None` where the pair counts for nothing over the whole cell. A turn by `t` moves a point by
    /// `sin t J w − (1 − cos t) w`, `w = Φ_0 v`, `J` a quarter turn: at most by the chord, and
    /// along each axis at most by what that says.
    fn gap(&self, pair: &Pair) -> Option<Gap> {
        let arm_x = self.cos * pair.arm_x - self.sin * pair.arm_y;
        let arm_y = self.sin * pair.arm_x + self.cos * pair.arm_y;
        let (dx, dy) = (pair.ref_x - self.x - arm_x, pair.ref_y - self.y - arm_y);
        let (off_x, off_y) = (dx.abs() - self.half_x, dy.abs() - self.half_y);
        let turned_x = arm_y.abs() * self.sine + arm_x.abs() * self.versine;
        let turned_y = arm_x.abs() * self.sine + arm_y.abs() * self.versine;
        let of_box = squared(off_x - turned_x) + squared(off_y - turned_y);
        let outside = squared(off_x) + squared(off_y);
        let turned_m = self.chord * pair.arm_m;
        let reach_m = turned_m + pair.reach_m;
        if of_box > pair.reach_m * pair.reach_m || outside > reach_m * reach_m {
            return None;
        }
        let of_circle = squared(outside.sqrt() - turned_m);
        Some(Gap { dx, dy, arm_x, arm_y, square_m2: of_box.max(of_circle) })
    }
}

impl Gap {
    /// `½ χ²` at least.
    fn fall(&self, pair: &Pair) -> f64 {
        self.square_m2 * pair.fall
    }
}

/// The square of what is above zero.
fn squared(value: f64) -> f64 {
    let above = if value > 0.0 { value } else { 0.0 };
    above * above
}

impl Pair {
    /// Bounds of `N(d; 0, S)` whose logarithm is linear over the cell, at its corners: with
    /// `η = (μ₁ − μ₂) sin δ`, μ the eigenvalues of `R_j`, `S ≤ S_0 + η I`, hence
    /// `χ² ≥ d_0ᵀ p + 2 pᵀ (d − d_0)`, `p = (S_0 + η I)⁻¹ d_0`, linear in the place and in the sine of
    /// the turn but for `(1 − cos t) pᵀ w`; and `det S` falls by at most `δ` times the differences
    /// of the eigenvalues multiplied. Where a constant is nowhere larger, the constant.
    fn at_corners(&self, bed: &Bed, gap: &Gap) -> [f64; CORNER_COUNT] {
        let shape = &self.shape;
        let [half, cross] = shape.of_node;
        let half_sum = shape.of_ref[0] + bed.cos_2 * half - bed.sin_2 * cross;
        let cross_sum = shape.of_ref[1] + bed.sin_2 * half + bed.cos_2 * cross;
        let deviation = half_sum * half_sum + cross_sum * cross_sum;
        let determinant =
            shape.mean_m2 * shape.mean_m2 - deviation - shape.product_m4 * bed.half_turn_rad;
        let peak = 1.0 / (TAU * determinant.max(shape.least_determinant_m4).sqrt());
        let mean = shape.mean_m2 + shape.node_m2 * bed.half_turn_rad;
        let inverse = 1.0 / (mean * mean - deviation);
        let pull_x = ((mean - half_sum) * gap.dx - cross_sum * gap.dy) * inverse;
        let pull_y = ((mean + half_sum) * gap.dy - cross_sum * gap.dx) * inverse;
        let middle = -0.5 * (pull_x * gap.dx + pull_y * gap.dy)
            + (-pull_x * gap.arm_x - pull_y * gap.arm_y).max(0.0) * bed.versine;
        let by_x = pull_x * bed.half_x;
        let by_y = pull_y * bed.half_y;
        let by_turn = (pull_y * gap.arm_x - pull_x * gap.arm_y) * bed.sine;
        let constant = -gap.fall(self);
        if constant <= middle + by_x.abs() + by_y.abs() + by_turn.abs() {
            return [peak * exp_above(constant); CORNER_COUNT];
        }
        let (less, more) = (middle - by_turn, middle + by_turn);
        let (x_y, x_less_y) = (by_x + by_y, by_x - by_y);
        let exponents = [
            less + x_y,
            less - x_y,
            less + x_less_y,
            less - x_less_y,
            more + x_y,
            more - x_y,
            more + x_less_y,
            more - x_less_y,
        ];
        let mut densities = [0.0; CORNER_COUNT];
        for (density, exponent) in densities.iter_mut().zip(&exponents) {
            *density = peak * exp_above(*exponent);
        }
        densities
    }
}

/// All pairs, with what the bound needs.
pub(super) struct Bounds {
    pairs: Vec<Pair>,
    /// `n₀`, `n₁` and `K A`.
    counts: [f64; 2],
    volume_m2: f64,
    /// `κ` at both ends, and the difference of their logarithms.
    kappas: [f64; 2],
    log_span: f64,
    most_refs: usize,
    /// Cells whose half widths are below this get the finer bound.
    fine_m: f64,
}

/// Room for the sums.
pub(super) struct Room {
    single: Sums<1>,
    corners: Sums<CORNER_COUNT>,
}

impl Bounds {
    pub(super) fn new(data: &Prepared, covariance_scale: f64) -> Self {
        let counts = [data.refs.len() as f64, data.nodes.len() as f64];
        let volume_m2 = data.spans.len() as f64 * data.area_m2;
        let kappas = SHARES.map(|share| {
            let common = share * counts[0].min(counts[1]);
            common * volume_m2 / ((counts[0] - common) * (counts[1] - common))
        });
        let pairs = pairs(data, covariance_scale, gate(data, covariance_scale, kappas[1]));
        let most_refs = data.spans.iter().map(|span| span.refs.len()).max().unwrap_or(0);
        let log_span = (kappas[1] / kappas[0]).ln();
        Self {
            pairs,
            counts,
            volume_m2,
            kappas,
            log_span,
            most_refs,
            fine_m: FINE_SIGMAS * data.typical_sigma_m,
        }
    }

    pub(super) fn room(&self) -> Room {
        Room {
            single: Sums::new(self.kappas, self.most_refs),
            corners: Sums::new(self.kappas, self.most_refs),
        }
    }

    pub(super) fn pair_count(&self) -> usize {
        self.pairs.len()
    }

    /// Largest distance from the middle of the node's points at which a pair still counts.
    pub(super) fn margin_m(&self) -> f64 {
        self.pairs.iter().map(|pair| pair.arm_m + pair.reach_m).fold(0.0, f64::max)
    }

    /// The bound over `cell`; of the pairs `arena[given]` those that reach it are appended to
    /// `arena`.
    pub(super) fn over(
        &self,
        cell: &Cell,
        pairs: (&mut Vec<u32>, Range<usize>),
        room: &mut Room,
    ) -> f64 {
        let bed = Bed::new(cell);
        let totals = if cell.half_x.max(cell.half_y) < self.fine_m {
            let weigh = |pair: &Pair, gap: &Gap| pair.at_corners(&bed, gap);
            self.summed(&bed, pairs, (&mut room.corners, weigh))
        } else {
            let weigh = |pair: &Pair, gap: &Gap| [pair.peak * exp_above(-gap.fall(pair))];
            self.summed(&bed, pairs, (&mut room.single, weigh))
        };
        self.over_shares(totals)
    }

    /// `P` at both shares with the densities that `weigh` gives for the pairs that reach the cell.
    fn summed<const N: usize>(
        &self,
        bed: &Bed,
        (arena, given): (&mut Vec<u32>, Range<usize>),
        (sums, weigh): (&mut Sums<N>, impl Fn(&Pair, &Gap) -> [f64; N]),
    ) -> [f64; 2] {
        for position in given {
            let index = arena[position];
            let pair = &self.pairs[index as usize];
            if let Some(gap) = bed.gap(pair) {
                arena.push(index);
                sums.add(pair.place, &weigh(pair, &gap));
            }
        }
        sums.finish()
    }

    /// The largest `F + P` over all shares.
    fn over_shares(&self, [low, high]: [f64; 2]) -> f64 {
        let slope = (high - low) / self.log_span;
        let fewer = self.counts[0].min(self.counts[1]);
        let common = slope.clamp(SHARES[0] * fewer, SHARES[1] * fewer);
        let [n0, n1] = self.counts;
        let kappa = common * self.volume_m2 / ((n0 - common) * (n1 - common));
        let free = common + n0 * (-common / n0).ln_1p() + n1 * (-common / n1).ln_1p();
        (free + low + slope * (kappa / self.kappas[0]).ln()).max(low)
    }
}

/// Squared Mahalanobis distance beyond which the likelihood takes any pair for nothing, whatever
/// the share.
fn gate(data: &Prepared, covariance_scale: f64, largest_kappa: f64) -> f64 {
    let least = |blobs: &[Blob]| {
        blobs.iter().map(|b| b.xx * b.yy - b.xy * b.xy).fold(f64::INFINITY, f64::min).sqrt()
    };
    let root_m2 = covariance_scale * (least(&data.refs) + least(&data.nodes));
    (2.0 * (largest_kappa / TAU / root_m2 / NEGLIGIBLE_WEIGHT).ln()).max(1.0)
}

fn pairs(data: &Prepared, covariance_scale: f64, gate: f64) -> Vec<Pair> {
    let mut all = Vec::with_capacity(data.spans.iter().map(Span::pair_count).sum());
    for (span, period) in data.spans.iter().enumerate() {
        for node in period.nodes.clone() {
            for (number, reference) in period.refs.clone().enumerate() {
                let blobs = (&data.refs[reference], &data.nodes[node]);
                let mut pair = pair(data, blobs, covariance_scale, gate);
                pair.place =
                    Place { span: index(span), node: index(node), ref_number: index(number) };
                all.push(pair);
            }
        }
    }
    all
}

fn index(value: usize) -> u32 {
    u32::try_from(value).unwrap_or(u32::MAX)
}

fn pair(data: &Prepared, (point, node): (&Blob, &Blob), covariance_scale: f64, gate: f64) -> Pair {
    let (arm_x, arm_y) = (node.x - data.node_center_m.x, node.y - data.node_center_m.y);
    let (of_ref, of_node) = (eigenvalues(point), eigenvalues(node));
    let largest = covariance_scale * (of_ref[1] + of_node[1]);
    // The determinant of a sum is least where the larger axes are aligned.
    let smallest = covariance_scale * (of_ref[0] + of_node[0]);
    let peak = 1.0 / (TAU * (largest * smallest).sqrt());
    let deviator = |blob: &Blob| [0.5 * (blob.xx - blob.yy), blob.xy].map(|v| v * covariance_scale);
    let shape = Shape {
        mean_m2: 0.5 * (largest + smallest),
        of_ref: deviator(point),
        of_node: deviator(node),
        product_m4: covariance_scale.powi(2) * (of_ref[1] - of_ref[0]) * (of_node[1] - of_node[0]),
        node_m2: covariance_scale * (of_node[1] - of_node[0]),
        least_determinant_m4: largest * smallest,
    };
    Pair {
        shape,
        ref_x: point.x,
        ref_y: point.y,
        arm_x,
        arm_y,
        arm_m: arm_x.hypot(arm_y),
        peak,
        fall: 0.5 / largest,
        reach_m: (gate * largest).sqrt(),
        place: Place::default(),
    }
}

/// Eigenvalues of a covariance, the smaller first.
fn eigenvalues(blob: &Blob) -> [f64; 2] {
    let (mean, half) = (0.5 * (blob.xx + blob.yy), 0.5 * (blob.xx - blob.yy));
    let radius = half.hypot(blob.xy);
    [(mean - radius).max(0.0), mean + radius]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::{Conditions, trial};

    /// Signs of place and turn at the corners, in the order of the densities.
    const SIGNS: [[f64; 2]; 4] = [[1.0, 1.0], [-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]];

    /// `N(d; 0, S)` of a pair under a motion.
    fn density(point: &Blob, node: &Blob, motion: &Motion) -> f64 {
        let moved = motion.apply(node);
        let (x, y) = (point.x - moved.x, point.y - moved.y);
        let (xx, xy, yy) = (point.xx + moved.xx, point.xy + moved.xy, point.yy + moved.yy);
        let determinant = xx * yy - xy * xy;
        let chi_square = (yy * x * x - 2.0 * xy * x * y + xx * y * y) / determinant;
        (-0.5 * chi_square).exp() / (TAU * determinant.sqrt())
    }

    #[test]
    fn no_density_at_a_corner_exceeds_that_of_the_corner() {
        /// For cells of a tenth of a standard deviation, the largest covariance over the turn.
        const MOST: f64 = 1.4;
        let case = trial(&Conditions::CLEAN, 2);
        let (data, truth) = (Prepared::new(&case.problem), case.truth());
        let at = Motion::new(truth.x, truth.y, truth.z);
        let (x, y) = at.turned(data.node_center_m.x, data.node_center_m.y);
        let mut differing_count = 0;
        for (step, pair) in Bounds::new(&data, 1.0).pairs.iter().enumerate() {
            let span = &data.spans[pair.place.span as usize];
            let point = &data.refs[span.refs.start + pair.place.ref_number as usize];
            let node = &data.nodes[pair.place.node as usize];
            let cell = Cell {
                x: x + at.x + 0.03 * (step as f64).sin(),
                y: y + at.y + 0.03 * (3.0 * step as f64).cos(),
                heading_rad: truth.z + 0.01,
                half_x: 0.002,
                half_y: 0.003,
                half_turn_rad: 0.002,
            };
            let bed = Bed::new(&cell);
            let Some(gap) = bed.gap(pair) else { continue };
            let bounds = pair.at_corners(&bed, &gap);
            differing_count += usize::from(bounds[0] > 1.2 * bounds[5].min(bounds[6]));
            for (corner, bound) in bounds.iter().enumerate() {
                let ([sign_x, sign_y], turn) = (SIGNS[corner % 4], (corner / 4) as f64 * 2.0 - 1.0);
                let place = Cell {
                    x: cell.x + sign_x * cell.half_x,
                    y: cell.y + sign_y * cell.half_y,
                    heading_rad: cell.heading_rad + turn * cell.half_turn_rad.asin(),
                    ..cell
                };
                let there = density(point, node, &place.motion(&data));
                assert!(
                    there <= *bound && *bound < MOST * there,
                    "{step} {corner}: {there} {bound}"
                );
            }
        }
        assert!(differing_count > 5, "{differing_count}");
    }
}
