//! Small statistics that several estimators share: gates, ratios to what was expected, spread.

use nalgebra::{Matrix2, Vector2};

/// Squared distance within which two poses agree: 99.99 % of χ² with three degrees of freedom, the
/// unknowns `(x, y, heading)`.
pub(crate) const POSE_GATE: f64 = 21.1;

/// Standard deviations by which a sum of squares must exceed its expectation to count.
pub(crate) const SIGNIFICANT_SIGMAS: f64 = 3.0;

/// Blocks of periods whose scores are kept apart to see whether errors last.
pub(crate) const BLOCK_COUNT: usize = 12;

/// Periods that a comparison of blocks needs.
pub(crate) const MIN_PERIODS_FOR_BLOCKS: usize = 60;

/// A uniform rectangle's area over the root of its covariance's determinant.
const AREA_OF_RECTANGLE: f64 = 12.0;

/// Added to the spread of points, metres, so that points on a line still cover an area.
const MIN_SPREAD_M: f64 = 0.5;

/// A sum of squares against its expectation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ratio {
    /// What was found.
    pub(crate) sum: f64,
    /// What independent errors as stated give on average.
    pub(crate) expected: f64,
    /// The variance of that.
    pub(crate) variance: f64,
}

impl Ratio {
    /// χ² with `free` degrees of freedom.
    pub(crate) fn of_chi_square(chi_square: f64, free: f64) -> Self {
        Self { sum: chi_square, expected: free, variance: 2.0 * free.max(0.0) }
    }

    /// The ratio where it is above 1 by more than `sigmas` standard deviations, else 1.
    pub(crate) fn if_significant(&self, sigmas: f64) -> f64 {
        let is_significant = self.sum > self.expected + sigmas * self.variance.sqrt();
        if is_significant && self.expected >= 1.0 { self.sum / self.expected } else { 1.0 }
    }
}

/// How much longer than a period errors last, from the scores `g_b` of [`BLOCK_COUNT`] blocks of
/// periods by three unknowns whose inverse information is `C`: the mean eigenvalue of
/// `C Σ_b g_b g_bᵀ`, which is 1 for independent errors. At the maximum the scores of all blocks add
/// up to zero, which takes one block's freedom.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BlockRatio {
    /// The mean eigenvalue.
    pub(crate) value: f64,
}

impl BlockRatio {
    const FREE: f64 = (BLOCK_COUNT - 1) as f64;

    /// That of independent errors.
    pub(crate) const ONE: Self = Self { value: 1.0 };

    /// Its standard deviation for independent errors.
    pub(crate) const fn variance() -> f64 {
        2.0 / (3.0 * Self::FREE)
    }

    /// The ratio for `square_sum = Σ_b g_bᵀ C g_b`.
    pub(crate) fn new(square_sum: f64) -> Self {
        Self { value: square_sum / 3.0 * BLOCK_COUNT as f64 / Self::FREE }
    }

    /// The ratio where it is above 1 by more than `sigmas` standard deviations, else 1.
    pub(crate) fn if_significant(self, sigmas: f64) -> f64 {
        let limit = 1.0 + sigmas * Self::variance().sqrt();
        if self.value > limit { self.value } else { 1.0 }
    }
}

/// The value in the middle, of an even number the later one; 0 of none.
pub(crate) fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Mean and covariance of places, metres and m². There is at least one.
pub(crate) fn spread(places: impl Iterator<Item = Vector2<f64>> + Clone) -> Spread {
    let count = places.clone().count() as f64;
    let mean_m = places.clone().sum::<Vector2<f64>>() / count;
    let scatter = places.map(|place| {
        let offset = place - mean_m;
        offset * offset.transpose()
    });
    Spread { mean_m, cov_m2: scatter.sum::<Matrix2<f64>>() / count }
}

/// How places lie.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Spread {
    /// Their mean.
    pub(crate) mean_m: Vector2<f64>,
    /// Their covariance.
    pub(crate) cov_m2: Matrix2<f64>,
}

impl Spread {
    /// The area that uniformly spread places with this covariance cover, and some at least.
    pub(crate) fn covered_area_m2(&self) -> f64 {
        let padded = self.cov_m2 + Matrix2::identity() * MIN_SPREAD_M.powi(2);
        AREA_OF_RECTANGLE * padded.determinant().max(0.0).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Vector3};
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;

    use super::*;

    /// Rounding of a few operations on numbers of order ten.
    const TOLERANCE: f64 = 1e-12;

    /// `P(χ²₃ > x) = erfc(√(x/2)) + √(2x/π) e^(−x/2)`, by Simpson's rule on the density.
    fn tail_of_three(x: f64) -> f64 {
        let density = |t: f64| (t / std::f64::consts::TAU).sqrt() * (-0.5 * t).exp();
        let (count, top) = (20_000, 200.0);
        let step = (top - x) / f64::from(count);
        let weight = |i: i32| match i {
            0 => 1.0,
            i if i == count => 1.0,
            i if i % 2 == 1 => 4.0,
            _ => 2.0,
        };
        (0..=count).map(|i| weight(i) * density(x + f64::from(i) * step)).sum::<f64>() * step / 3.0
    }

    #[test]
    fn the_gate_of_poses_lets_one_in_ten_thousand_out() {
        assert!((tail_of_three(7.815) - 0.05).abs() < 1e-4, "the oracle, from tables");
        assert!((tail_of_three(POSE_GATE) - 1e-4).abs() < 2e-6, "{}", tail_of_three(POSE_GATE));
    }

    #[test]
    fn a_ratio_counts_beyond_its_standard_deviations_only() {
        // χ² with 50 degrees of freedom has a standard deviation of 10.
        for (chi_square, expected) in [(79.9, 1.0), (80.1, 80.1 / 50.0), (20.0, 1.0)] {
            let found = Ratio::of_chi_square(chi_square, 50.0).if_significant(3.0);
            assert!((found - expected).abs() < TOLERANCE, "{chi_square}: {found}");
        }
        // Without a degree of freedom nothing is known.
        for free in [-1.0, 0.0, 0.5] {
            let found = Ratio::of_chi_square(1e3, free).if_significant(3.0);
            assert!((found - 1.0).abs() < TOLERANCE, "{found}");
        }
    }

    #[test]
    fn blocks_of_independent_scores_give_one_with_the_stated_deviation() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let trials = 4_000;
        let (mut mean, mut square) = (0.0, 0.0);
        for _ in 0..trials {
            let mut scores: Vec<Vector3<f64>> = (0..BLOCK_COUNT)
                .map(|_| Vector3::from_fn(|_, _| rng.sample(StandardNormal)))
                .collect();
            let middle = scores.iter().sum::<Vector3<f64>>() / BLOCK_COUNT as f64;
            scores.iter_mut().for_each(|score| *score -= middle);
            // Each score has unit information, all together BLOCK_COUNT times as much.
            let covariance = Matrix3::identity() / BLOCK_COUNT as f64;
            let sum: f64 = scores.iter().map(|g| g.dot(&(covariance * g))).sum();
            let ratio = BlockRatio::new(sum).value;
            mean += ratio / f64::from(trials);
            square += (ratio - 1.0).powi(2) / f64::from(trials);
        }
        // Four standard deviations of the mean of the trials, and 5 % of a variance.
        assert!((mean - 1.0).abs() < 4.0 * (BlockRatio::variance() / 4e3).sqrt(), "{mean}");
        assert!((square / BlockRatio::variance() - 1.0).abs() < 0.1, "{square}");
        let limit = 1.0 + 3.0 * BlockRatio::variance().sqrt();
        for (value, expected) in [(limit - 1e-9, 1.0), (limit + 1e-9, limit), (0.2, 1.0)] {
            let found = BlockRatio { value }.if_significant(3.0);
            assert!((found - expected).abs() < 1e-8, "{value} {found}");
        }
    }

    #[test]
    fn spread_and_area_are_those_of_a_rectangle() {
        // Midpoints of a fine grid over 6 m by 4 m about (1, −2).
        let places = (0..600).flat_map(|i| {
            (0..400).map(move |j| {
                let (across, along) = (f64::from(i) + 0.5, f64::from(j) + 0.5);
                Vector2::new(across / 100.0 - 2.0, along / 100.0 - 4.0)
            })
        });
        let found = spread(places);
        assert!((found.mean_m - Vector2::new(1.0, -2.0)).norm() < 1e-9);
        let expected = Matrix2::new(3.0, 0.0, 0.0, 4.0 / 3.0);
        assert!((found.cov_m2 - expected).amax() < 1e-4, "{}", found.cov_m2);
        let area_m2 = 12.0 * ((3.0 + 0.25) * (4.0 / 3.0 + 0.25_f64)).sqrt();
        assert!((found.covered_area_m2() / area_m2 - 1.0).abs() < 1e-4);
    }

    #[test]
    fn the_median_is_the_middle_and_nothing_has_none() {
        for (mut values, expected) in [
            (vec![3.0, 1.0, 2.0], 2.0),
            (vec![4.0, 1.0, 3.0, 2.0], 3.0),
            (vec![5.0], 5.0),
            (Vec::new(), 0.0),
        ] {
            assert!((median(&mut values) - expected).abs() < TOLERANCE);
        }
    }
}
