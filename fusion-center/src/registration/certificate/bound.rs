//! An upper bound of the likelihood ratio over a cell of poses and all shares of common points.
//!
//! A pose is written as the place `c` of the middle of the node's points and the heading `φ`, so
//! that turning moves points little. Over the cell `|c_x − c_x0| ≤ h_x`, `|c_y − c_y0| ≤ h_y`,
//! `|φ − φ_0| ≤ δ` the point `j` with the arm `v_j` from that middle moves by at most
//! `ρ_j = 2 |v_j| sin(δ/2)` more than the middle, so its distance from the reference's point `l` is
//! at least `e = |d_0 outside the rectangle| − ρ_j`, `d_0 = z_l − c_0 − Φ_0 v_j`. With `λ` the sum of
//! the larger eigenvalues and `D` the least determinant of `R_l + Φ R_j Φᵀ` over all headings,
//! `N(d; 0, S) ≤ exp(−max(e, 0)² / 2λ) / (2π √D) = n_lj`.
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

/// Range of the share of common points between whose ends the chord is taken. The upper one is the
/// largest that the model admits; below the lower one the bound is loose, but no mode is there.
const SHARES: [f64; 2] = [0.05, 0.9];

/// Pairs whose weight is below this at the largest share count as nothing in the likelihood too.
const NEGLIGIBLE_WEIGHT: f64 = 1e-6;

/// Cells of half widths below this many typical standard deviations get the finer bound.
const FINE_SIGMAS: f64 = 1.0;

/// Products are taken to their logarithm before they overflow.
const LARGE_PRODUCT: f64 = 1e100;

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
    /// `2 sin(δ/2)`: how far turning by at most δ moves a point at distance 1.
    pub(super) fn chord(&self) -> f64 {
        2.0 * (0.5 * self.half_turn_rad).min(0.25 * TAU).sin()
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
    span: u32,
    node: u32,
    /// Number of the reference's point within its period.
    place: u32,
}

/// What the covariance of a pair needs at a given heading: half the trace of the sum, the deviators
/// `((xx − yy)/2, xy)` of both sides, the smaller eigenvalue of the sum at its least.
#[derive(Clone, Copy)]
struct Shape {
    mean_m2: f64,
    of_ref: [f64; 2],
    of_node: [f64; 2],
    least_m2: f64,
    /// Differences of the eigenvalues of both sides multiplied, m⁴, and that of the node's, m².
    product_m4: f64,
    node_m2: f64,
    least_determinant_m4: f64,
}

/// The heading of a fine cell, ready to use.
struct Turn {
    cos_2: f64,
    sin_2: f64,
    half_turn_rad: f64,
    half_diagonal_m: f64,
}

impl Turn {
    fn new(cell: &Cell) -> Self {
        let (sin_2, cos_2) = (2.0 * cell.heading_rad).sin_cos();
        let half_diagonal_m = cell.half_x.hypot(cell.half_y);
        Self { cos_2, sin_2, half_turn_rad: cell.half_turn_rad, half_diagonal_m }
    }
}

impl Shape {
    /// Bound of `N(d; 0, S)` over a cell whose differences lie within `r` of `d_0`: with
    /// `η = (μ₁ − μ₂) sin δ`, μ the eigenvalues of `R_j`, `S ≤ S_0 + η I`, hence
    /// `√χ² ≥ √(d_0ᵀ (S_0 + η I)⁻¹ d_0) − r / √λ_min`; and `det S` falls by at most
    /// `δ` times the differences of the eigenvalues multiplied.
    fn density(&self, turn: &Turn, [dx, dy]: [f64; 2], turned_m: f64) -> f64 {
        let [half, cross] = self.of_node;
        let half_sum = self.of_ref[0] + turn.cos_2 * half - turn.sin_2 * cross;
        let cross_sum = self.of_ref[1] + turn.sin_2 * half + turn.cos_2 * cross;
        let deviation = half_sum * half_sum + cross_sum * cross_sum;
        let mean = self.mean_m2 + self.node_m2 * turn.half_turn_rad;
        let quadratic =
            (mean - half_sum) * dx * dx - 2.0 * cross_sum * dx * dy + (mean + half_sum) * dy * dy;
        let chi = (quadratic / (mean * mean - deviation)).sqrt();
        let slack = (turn.half_diagonal_m + turned_m) / self.least_m2.sqrt();
        let determinant =
            self.mean_m2 * self.mean_m2 - deviation - self.product_m4 * turn.half_turn_rad;
        let least = determinant.max(self.least_determinant_m4);
        (-0.5 * (chi - slack).max(0.0).powi(2)).exp() / (TAU * least.sqrt())
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

/// Room for the sums of one period.
pub(super) struct Room {
    by_ref: Vec<f64>,
}

/// `Σ ln f` at both shares with few logarithms.
#[derive(Clone, Copy)]
struct LogProducts {
    products: [f64; 2],
    logs: [f64; 2],
}

impl LogProducts {
    const ONE: Self = Self { products: [1.0; 2], logs: [0.0; 2] };

    fn times(&mut self, factors: [f64; 2]) {
        self.products[0] *= factors[0];
        self.products[1] *= factors[1];
        // The second is the larger one.
        if self.products[1] > LARGE_PRODUCT {
            for (log, product) in self.logs.iter_mut().zip(&mut self.products) {
                *log += product.ln();
                *product = 1.0;
            }
        }
    }

    fn join(&mut self, other: &Self) {
        self.times(other.products);
        self.logs[0] += other.logs[0];
        self.logs[1] += other.logs[1];
    }

    fn is_below(&self, other: &Self) -> bool {
        let (mine, theirs) = (self.logs[1], other.logs[1]);
        if mine.max(theirs) <= 0.0 {
            self.products[1] < other.products[1]
        } else {
            mine + self.products[1].ln() < theirs + other.products[1].ln()
        }
    }

    fn total(&self) -> [f64; 2] {
        [self.logs[0] + self.products[0].ln(), self.logs[1] + self.products[1].ln()]
    }
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
        Room { by_ref: vec![0.0; self.most_refs] }
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
        (arena, given): (&mut Vec<u32>, Range<usize>),
        room: &mut Room,
    ) -> f64 {
        let (sin, cos) = cell.heading_rad.sin_cos();
        let chord = cell.chord();
        let fine = (cell.half_x.max(cell.half_y) < self.fine_m).then(|| Turn::new(cell));
        let mut total = LogProducts::ONE;
        let mut period = Period::new(self.kappas);
        for position in given {
            let index = arena[position];
            let pair = &self.pairs[index as usize];
            let dx = pair.ref_x - cell.x - (cos * pair.arm_x - sin * pair.arm_y);
            let dy = pair.ref_y - cell.y - (sin * pair.arm_x + cos * pair.arm_y);
            let outside_x = (dx.abs() - cell.half_x).max(0.0);
            let outside_y = (dy.abs() - cell.half_y).max(0.0);
            let square = outside_x * outside_x + outside_y * outside_y;
            let turned_m = chord * pair.arm_m;
            if square > (turned_m + pair.reach_m).powi(2) {
                continue;
            }
            arena.push(index);
            let mut density = pair.peak;
            if square > turned_m * turned_m {
                density *= (-(square.sqrt() - turned_m).powi(2) * pair.fall).exp();
            }
            if let Some(turn) = &fine {
                density = density.min(pair.shape.density(turn, [dx, dy], turned_m));
            }
            if pair.span != period.span {
                period.close(&mut total, room);
                period.span = pair.span;
            }
            period.add(pair, density, room);
        }
        period.close(&mut total, room);
        self.over_shares(total.total())
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

/// The sums of the period at hand.
struct Period {
    span: u32,
    node: u32,
    kappas: [f64; 2],
    by_node: f64,
    node_products: LogProducts,
    places: usize,
}

impl Period {
    fn new(kappas: [f64; 2]) -> Self {
        Self {
            span: u32::MAX,
            node: u32::MAX,
            kappas,
            by_node: 0.0,
            node_products: LogProducts::ONE,
            places: 0,
        }
    }

    fn add(&mut self, pair: &Pair, density: f64, room: &mut Room) {
        if pair.node != self.node {
            self.close_node();
            self.node = pair.node;
        }
        self.by_node += density;
        let place = pair.place as usize;
        room.by_ref[place] += density;
        self.places = self.places.max(place + 1);
    }

    fn factors(&self, sum: f64) -> [f64; 2] {
        [1.0 + self.kappas[0] * sum, 1.0 + self.kappas[1] * sum]
    }

    fn close_node(&mut self) {
        self.node_products.times(self.factors(self.by_node));
        self.by_node = 0.0;
    }

    /// Multiplies the smaller of both bounds of the sum over matchings into `total`.
    fn close(&mut self, total: &mut LogProducts, room: &mut Room) {
        self.close_node();
        let mut ref_products = LogProducts::ONE;
        for sum in &mut room.by_ref[..self.places] {
            ref_products.times(self.factors(*sum));
            *sum = 0.0;
        }
        // One side for both shares: the chord holds for either side, not for a change of sides.
        let smaller = if ref_products.is_below(&self.node_products) {
            ref_products
        } else {
            self.node_products
        };
        total.join(&smaller);
        self.node_products = LogProducts::ONE;
        self.places = 0;
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
            for (place, reference) in period.refs.clone().enumerate() {
                let blobs = (&data.refs[reference], &data.nodes[node]);
                let mut pair = pair(data, blobs, covariance_scale, gate);
                (pair.span, pair.node, pair.place) = (index(span), index(node), index(place));
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
        least_m2: smallest,
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
        span: 0,
        node: 0,
        place: 0,
    }
}

/// Eigenvalues of a covariance, the smaller first.
fn eigenvalues(blob: &Blob) -> [f64; 2] {
    let (mean, half) = (0.5 * (blob.xx + blob.yy), 0.5 * (blob.xx - blob.yy));
    let radius = half.hypot(blob.xy);
    [(mean - radius).max(0.0), mean + radius]
}
