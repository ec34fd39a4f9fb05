//! Sums over matchings of all periods at several places at once, with few logarithms.
//!
//! Per period the sum over partial matchings is at most `Π_j (1 + κ Σ_l n_lj)` and at most
//! `Π_l (1 + κ Σ_j n_lj)` (see `likelihood`). All places of one period use the same side, so that
//! where every `ln n_lj` is a convex function of the place, the result is one too.
//!
//! Cost: one pass over the pairs, a product per point.

/// Products are taken to their logarithm above this, looked at after every so many factors: with
/// points of 0.1 mm in a square kilometre a factor is below 1e15.
const LARGE_PRODUCT: f64 = 1e100;
const FACTOR_COUNT: usize = 8;

/// `Σ ln f` at `N` places and both shares.
#[derive(Clone, Copy)]
struct LogProducts<const N: usize> {
    /// By share, the larger one second.
    products: [[f64; N]; 2],
    logs: [[f64; N]; 2],
    has_logs: bool,
    /// Factors since the last look.
    factor_count: usize,
}

impl<const N: usize> LogProducts<N> {
    const ONE: Self =
        Self { products: [[1.0; N]; 2], logs: [[0.0; N]; 2], has_logs: false, factor_count: 0 };

    /// Multiplies by `1 + κ s`, `s` the sums.
    #[inline]
    fn times(&mut self, kappas: [f64; 2], sums: &[f64; N]) {
        let [lower, upper] = &mut self.products;
        for lane in 0..N {
            lower[lane] *= 1.0 + kappas[0] * sums[lane];
            upper[lane] *= 1.0 + kappas[1] * sums[lane];
        }
        self.factor_count += 1;
        if self.factor_count >= FACTOR_COUNT {
            self.bound();
        }
    }

    /// Keeps the products from overflowing.
    fn bound(&mut self) {
        self.factor_count = 0;
        // The products of the second share are the larger ones.
        if largest(&self.products[1]) <= LARGE_PRODUCT {
            return;
        }
        self.has_logs = true;
        for (logs, products) in self.logs.iter_mut().zip(&mut self.products) {
            for (log, product) in logs.iter_mut().zip(products) {
                *log += product.ln();
                *product = 1.0;
            }
        }
    }

    /// Multiplies by what `other` holds and leaves one there.
    fn take(&mut self, other: &mut Self) {
        other.bound();
        for (products, factors) in self.products.iter_mut().zip(&mut other.products) {
            for (product, factor) in products.iter_mut().zip(factors) {
                *product *= *factor;
            }
        }
        self.bound();
        if other.has_logs {
            self.add_logs(&other.logs);
        }
        other.clear();
    }

    fn add_logs(&mut self, added: &[[f64; N]; 2]) {
        self.has_logs = true;
        for (log, more) in self.logs.as_flattened_mut().iter_mut().zip(added.as_flattened()) {
            *log += more;
        }
    }

    fn clear(&mut self) {
        self.products = [[1.0; N]; 2];
        if self.has_logs {
            self.logs = [[0.0; N]; 2];
        }
        (self.has_logs, self.factor_count) = (false, 0);
    }

    fn is_below(&self, other: &Self) -> bool {
        if self.has_logs || other.has_logs {
            self.largest_total(1) < other.largest_total(1)
        } else {
            largest(&self.products[1]) < largest(&other.products[1])
        }
    }

    fn largest_total(&self, share: usize) -> f64 {
        if !self.has_logs {
            return largest(&self.products[share]).ln();
        }
        let totals = self.logs[share].iter().zip(&self.products[share]);
        totals.map(|(log, product)| log + product.ln()).fold(f64::NEG_INFINITY, f64::max)
    }
}

#[inline]
fn largest<const N: usize>(values: &[f64; N]) -> f64 {
    values.iter().fold(0.0, |most, value| if *value > most { *value } else { most })
}

/// The sums of all periods so far and of the one at hand.
pub(super) struct Sums<const N: usize> {
    kappas: [f64; 2],
    span: u32,
    node: u32,
    by_node: [f64; N],
    /// By the number of the reference's point within its period; zero where none was added.
    by_ref: Vec<[f64; N]>,
    ref_count: usize,
    node_products: LogProducts<N>,
    ref_products: LogProducts<N>,
    total: LogProducts<N>,
}

/// Where a pair belongs: its period, its point of the node, and the number of its reference point
/// within the period.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Place {
    pub(super) span: u32,
    pub(super) node: u32,
    pub(super) ref_number: u32,
}

impl<const N: usize> Sums<N> {
    /// For `κ` at both shares, the larger one second, and at most `most_refs` points of the
    /// reference per period.
    pub(super) fn new(kappas: [f64; 2], most_refs: usize) -> Self {
        Self {
            kappas,
            span: u32::MAX,
            node: u32::MAX,
            by_node: [0.0; N],
            by_ref: vec![[0.0; N]; most_refs],
            ref_count: 0,
            node_products: LogProducts::ONE,
            ref_products: LogProducts::ONE,
            total: LogProducts::ONE,
        }
    }

    /// Adds a pair of density `densities` in 1/m². Pairs come period by period, in each node's point
    /// by node's point.
    #[inline]
    pub(super) fn add(&mut self, place: Place, densities: &[f64; N]) {
        if place.span != self.span {
            self.close_period();
            (self.span, self.node) = (place.span, place.node);
        } else if place.node != self.node {
            self.close_node();
            self.node = place.node;
        }
        let ref_number = place.ref_number as usize;
        self.ref_count = self.ref_count.max(ref_number + 1);
        let by_ref = &mut self.by_ref[ref_number];
        for ((node_sum, ref_sum), density) in self.by_node.iter_mut().zip(by_ref).zip(densities) {
            *node_sum += density;
            *ref_sum += density;
        }
    }

    #[inline]
    fn close_node(&mut self) {
        self.node_products.times(self.kappas, &self.by_node);
        self.by_node = [0.0; N];
    }

    fn close_period(&mut self) {
        if self.ref_count == 0 {
            return;
        }
        self.close_node();
        for sum in &mut self.by_ref[..self.ref_count] {
            self.ref_products.times(self.kappas, sum);
            *sum = [0.0; N];
        }
        // One side for both shares: the chord holds for either side, not for a change of sides.
        if self.ref_products.is_below(&self.node_products) {
            self.total.take(&mut self.ref_products);
            self.node_products.clear();
        } else {
            self.total.take(&mut self.node_products);
            self.ref_products.clear();
        }
        self.ref_count = 0;
    }

    /// Largest `P` of all places at each share; leaves everything as new.
    pub(super) fn finish(&mut self) -> [f64; 2] {
        self.close_period();
        let totals = [self.total.largest_total(0), self.total.largest_total(1)];
        self.total.clear();
        (self.span, self.node) = (u32::MAX, u32::MAX);
        totals
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative rounding of sums of some hundred logarithms.
    const ROUNDING: f64 = 1e-11;

    const KAPPAS: [f64; 2] = [0.3, 2.0];

    /// Density of a pair at a lane; large in some lanes, so that products must be taken to logarithms.
    fn density(place: Place, lane: usize) -> f64 {
        let mixed = place.span * 7 + place.node * 5 + place.ref_number * 3;
        let power = (mixed as usize + 2 * lane) % 11;
        10.0_f64.powi(i32::try_from(power).unwrap() - 3)
    }

    /// Period, node's points and reference's points; the pair is left out where the rest is zero.
    fn places(refs: u32, nodes: u32) -> Vec<Place> {
        let pair = |at: u32| {
            let (span, rest) = (at / (refs * nodes), at % (refs * nodes));
            Place { span, node: span * nodes + rest / refs, ref_number: rest % refs }
        };
        let is_kept = |at: &u32| at % 5 != 3;
        (0..12 * refs * nodes).filter(is_kept).map(pair).collect()
    }

    /// `Σ_points ln(1 + κ Σ n)` over the points that `key` tells apart.
    fn direct(pairs: &[Place], (share, lane): (usize, usize), key: fn(&Place) -> u32) -> f64 {
        let mut sums = std::collections::BTreeMap::new();
        for pair in pairs {
            *sums.entry(key(pair)).or_insert(0.0) += density(*pair, lane);
        }
        sums.values().map(|sum| (1.0 + KAPPAS[share] * sum).ln()).sum()
    }

    /// What the sums must be, period by period.
    fn expected(pairs: &[Place]) -> [[f64; 3]; 2] {
        let mut totals = [[0.0; 3]; 2];
        for span in 0..12 {
            let own: Vec<Place> = pairs.iter().filter(|p| p.span == span).copied().collect();
            let most = |key: fn(&Place) -> u32| {
                (0..3).map(|lane| direct(&own, (1, lane), key)).fold(f64::NEG_INFINITY, f64::max)
            };
            let keys: [fn(&Place) -> u32; 2] = [|pair| pair.ref_number, |pair| pair.node];
            let key = keys[usize::from(most(keys[0]) >= most(keys[1]))];
            for (share, lane) in (0..6).map(|index| (index % 2, index / 2)) {
                totals[share][lane] += direct(&own, (share, lane), key);
            }
        }
        totals
    }

    fn check(refs: u32, nodes: u32, sums: &mut Sums<3>) {
        let pairs = places(refs, nodes);
        for pair in &pairs {
            sums.add(*pair, &std::array::from_fn(|lane| density(*pair, lane)));
        }
        for (found, lanes) in sums.finish().iter().zip(&expected(&pairs)) {
            let most = lanes.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            assert!((found - most).abs() <= ROUNDING * most, "{refs} {nodes}: {found} {most}");
        }
    }

    #[test]
    fn they_are_sums_of_logarithms_of_the_smaller_side() {
        for (refs, nodes) in [(1, 1), (3, 2), (2, 5), (12, 12)] {
            let mut sums = Sums::new(KAPPAS, refs as usize);
            check(refs, nodes, &mut sums);
            // What one cell leaves must not reach the next.
            check(refs, nodes, &mut sums);
            assert!(sums.finish().iter().all(|rest| rest.abs() <= 0.0));
        }
    }
}
