//! Proportions with their confidence intervals, and distributions of errors.

use std::iter::Sum;

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::Serialize;

/// Draws of the bootstrap: the ends of 95 % then differ by a few percent of the interval between
/// seeds.
const DRAW_COUNT: usize = 1000;
/// Two-sided quantile of the standard normal distribution for 95 %.
const QUANTILE_95: f64 = 1.959_963_984_540_054;

/// How often something was so.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct Proportion {
    /// How often it was so.
    pub(super) count: usize,
    /// How often it was looked at.
    pub(super) of: usize,
    /// Their ratio; 0 of none.
    pub(super) share: f64,
    /// 95 % confidence interval of the true share.
    pub(super) low: f64,
    /// See `low`.
    pub(super) high: f64,
}

impl Proportion {
    /// With Wilson's interval: the shares `p` with `|p̂ − p| ≤ z sqrt(p (1 − p) / n)`, which are
    /// those between `(p̂ + z²/2n ± z sqrt(p̂ (1 − p̂)/n + z²/4n²)) / (1 + z²/n)`.
    pub(super) fn new(count: usize, of: usize) -> Self {
        if of == 0 {
            return Self { count, of, share: 0.0, low: 0.0, high: 1.0 };
        }
        let (number, share) = (of as f64, count as f64 / of as f64);
        let z2 = QUANTILE_95 * QUANTILE_95;
        let middle = share + z2 / (2.0 * number);
        let variance = share * (1.0 - share) / number + z2 / (4.0 * number * number);
        let half = QUANTILE_95 * variance.sqrt();
        let scale = 1.0 + z2 / number;
        // Rounding must not carry the ends of 0 and 1 outside.
        let (low, high) = ((middle - half) / scale, (middle + half) / scale);
        Self { count, of, share, low: low.clamp(0.0, share), high: high.clamp(share, 1.0) }
    }

    /// How many of `items` are so.
    pub(super) fn count_of<T>(items: &[T], is_so: impl Fn(&T) -> bool) -> Self {
        Self::new(items.iter().filter(|item| is_so(item)).count(), items.len())
    }

    /// As people read it.
    pub(super) fn text(&self) -> String {
        format!("{:.3} ({:.3}-{:.3})", self.share, self.low, self.high)
    }
}

/// Errors of many trials, ascending; trials without an estimate are infinitely wrong.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Distribution {
    ascending: Vec<f64>,
    of: usize,
}

impl Distribution {
    /// Of `of` trials, of which those in `errors` gave an estimate.
    pub(super) fn new(errors: impl Iterator<Item = f64>, of: usize) -> Self {
        let mut ascending: Vec<f64> = errors.collect();
        ascending.sort_by(f64::total_cmp);
        Self { ascending, of }
    }

    /// How many errors are at most `limit`.
    pub(super) fn at_most(&self, limit: f64) -> Proportion {
        Proportion::new(self.ascending.partition_point(|error| *error <= limit), self.of)
    }

    /// The error that `share` of the trials do not exceed; `None` if so many gave no estimate.
    pub(super) fn quantile(&self, share: f64) -> Option<f64> {
        let needed = (share * self.of as f64).ceil().max(1.0);
        (0..self.ascending.len())
            .find(|index| needed <= *index as f64 + 1.0)
            .map(|index| self.ascending[index])
    }

    /// Mean over the trials with an estimate.
    pub(super) fn mean(&self) -> Option<f64> {
        let count = self.ascending.len();
        (0 < count).then(|| self.ascending.iter().sum::<f64>() / count as f64)
    }
}

/// A figure of all trials together.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct Figure {
    pub(super) value: f64,
    /// 95 % confidence interval, if there are several trials.
    pub(super) interval: Option<[f64; 2]>,
}

impl Figure {
    /// As people read it.
    pub(super) fn text(&self, digits: usize) -> String {
        let Self { value, interval } = self;
        interval.map_or_else(
            || format!("{value:.digits$}"),
            |[low, high]| format!("{value:.digits$} ({low:.digits$}-{high:.digits$})"),
        )
    }
}

/// Trials added, and as many drawn with replacement and added, again and again: moments of one trial
/// depend on each other, trials do not.
pub(super) struct Bootstrap<S> {
    pub(super) total: S,
    draws: Vec<S>,
}

impl<S: Copy + Sum> Bootstrap<S> {
    /// Of these trials; the draws follow from `seed`.
    pub(super) fn new(trials: &[S], seed: u64) -> Self {
        let total = trials.iter().copied().sum();
        if trials.len() < 2 {
            return Self { total, draws: Vec::new() };
        }
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut draw = || trials[rng.random_range(0..trials.len())];
        let draws = (0..DRAW_COUNT).map(|_| (0..trials.len()).map(|_| draw()).sum()).collect();
        Self { total, draws }
    }

    /// A figure with its interval; that of nothing is `None`.
    pub(super) fn figure(&self, of: impl Fn(&S) -> Option<f64>) -> Option<Figure> {
        let interval = interval(self.draws.iter().filter_map(&of).collect());
        of(&self.total).map(|value| Figure { value, interval })
    }
}

/// Between which 95 % of the values are.
fn interval(mut values: Vec<f64>) -> Option<[f64; 2]> {
    values.sort_by(f64::total_cmp);
    let cut = values.len() / 40;
    Some([*values.get(cut)?, *values.get(values.len().checked_sub(cut + 1)?)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Shares this far apart are the same.
    const SAME_SHARE: f64 = 1e-9;

    /// The interval's ends are where the normal approximation of the share just reaches the count:
    /// found here by bisection.
    fn end(share: f64, number: f64, [mut inside, mut outside]: [f64; 2]) -> f64 {
        for _ in 0..200 {
            let middle = 0.5 * (inside + outside);
            let sigma = (middle * (1.0 - middle) / number).sqrt();
            let is_inside = (share - middle).abs() <= 1.959_963_984_540_054 * sigma;
            if is_inside { inside = middle } else { outside = middle }
        }
        inside
    }

    #[test]
    fn wilsons_interval_holds_the_shares_that_the_count_does_not_contradict() {
        for (count, of) in [(1, 10), (9, 20), (480, 500), (499, 500)] {
            let got = Proportion::new(count, of);
            let (share, number) = (count as f64 / of as f64, of as f64);
            let (low, high) = (end(share, number, [share, 0.0]), end(share, number, [share, 1.0]));
            assert!((got.low - low).abs() < SAME_SHARE, "{got:?} {low}");
            assert!((got.high - high).abs() < SAME_SHARE, "{got:?} {high}");
        }
        let all = Proportion::new(500, 500);
        assert!(
            all.high <= 1.0 && (all.low - 500.0 / (500.0 + 3.841_458_820_694_124)).abs() < 1e-9
        );
        assert!(Proportion::new(0, 0).high - Proportion::new(0, 0).low >= 1.0);
    }

    #[test]
    fn trials_without_an_estimate_are_wrong_beyond_every_limit() {
        let errors = Distribution::new([0.3, 0.1, 0.2].into_iter(), 4);
        assert_eq!(errors.at_most(0.2).count, 2);
        assert_eq!(errors.at_most(1e9).count, 3);
        assert_eq!(errors.at_most(1e9).of, 4);
        assert_eq!(errors.quantile(0.5), Some(0.2));
        assert_eq!(errors.quantile(0.75), Some(0.3));
        assert_eq!(errors.quantile(0.95), None);
        assert!((errors.mean().unwrap() - 0.2).abs() < 1e-12);
        assert_eq!(Distribution::new(std::iter::empty(), 4).mean(), None);
    }
}
