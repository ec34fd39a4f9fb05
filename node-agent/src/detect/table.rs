//! A function of delay with a limited band, tabulated.

use rustfft::num_complex::Complex;

/// Tables reach this far, in resolution cells `1 / (K Δf)`.
const HALF_CELLS: f64 = 24.0;
/// An envelope is extrapolated from here on: nearer to its end, a table may not hold the next peak.
const TAIL_CELLS: f64 = 10.0;
/// Entries of a table per cell: linear interpolation errs by −74 dB.
const STEPS_PER_CELL: f64 = 64.0;
/// `2 · 24 · 64` steps.
const ENTRY_COUNT: usize = 3073;

/// A function of delay, tabulated around 0.
#[derive(Clone, Debug)]
pub(super) struct Table {
    entries_per_s: f64,
    values: Vec<Complex<f64>>,
}

impl Table {
    /// `Σ c exp(j ω t)` over the terms `(ω, c)`, `ω` in rad/s, for cells of `cell_s` seconds.
    pub(super) fn new(cell_s: f64, terms: &[(f64, Complex<f64>)]) -> Self {
        let value_at = |entry: usize| -> Complex<f64> {
            let t_s = cell_s * (entry as f64 / STEPS_PER_CELL - HALF_CELLS);
            terms.iter().map(|(rate, c)| Complex::cis(rate * t_s) * c).sum()
        };
        let values = (0..ENTRY_COUNT).map(value_at).collect();
        Self { entries_per_s: STEPS_PER_CELL / cell_s, values }
    }

    /// The largest magnitude at the same distance from 0 or beyond, at every entry.
    pub(super) fn envelope(&self) -> Self {
        let last = self.values.len() - 1;
        let mut values = self.values.clone();
        let mut largest = 0.0_f64;
        for entry in 0..=last / 2 {
            largest = largest.max(self.values[entry].norm()).max(self.values[last - entry].norm());
            values[entry] = Complex::new(largest, 0.0);
            values[last - entry] = values[entry];
        }
        Self { entries_per_s: self.entries_per_s, values }
    }

    /// The value at `t_s`, by linear interpolation; zero beyond the table.
    #[expect(clippy::cast_possible_truncation, reason = "the whole part is meant")]
    pub(super) fn at(&self, t_s: f64) -> Complex<f64> {
        let entry = t_s * self.entries_per_s + HALF_CELLS * STEPS_PER_CELL;
        let inside = 0.0 <= entry && entry < (self.values.len() - 1) as f64;
        if !inside {
            return Complex::new(0.0, 0.0);
        }
        let before = entry as usize;
        let rest = entry - before as f64;
        self.values[before] * (1.0 - rest) + self.values[before + 1] * rest
    }

    /// The magnitude at `t_s`; beyond [`TAIL_CELLS`] it falls as `1 / t`.
    pub(super) fn at_or_tail(&self, t_s: f64) -> f64 {
        let limit_s = TAIL_CELLS * STEPS_PER_CELL / self.entries_per_s;
        let inside_s = t_s.clamp(-limit_s, limit_s);
        self.at(inside_s).norm() * (limit_s / t_s.abs().max(limit_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_those_of_the_sum_between_entries_too() {
        let terms =
            [(-1e9, Complex::new(0.3, 0.1)), (0.0, Complex::new(0.5, 0.0)), (2e9, Complex::i())];
        let table = Table::new(1e-9, &terms);
        for t_s in [-23.9e-9, -1.2345e-9, 0.0, 0.4e-9, 7.77e-9] {
            let want: Complex<f64> = terms.iter().map(|(w, c)| Complex::cis(w * t_s) * c).sum();
            // A quarter of (ω step)² / 2.
            assert!((table.at(t_s) - want).norm() < 2e-4, "{t_s}");
        }
        assert!(table.at(24.1e-9).norm() < f64::MIN_POSITIVE);
        assert!(table.at(f64::NAN).norm() < f64::MIN_POSITIVE);
    }

    #[test]
    fn an_envelope_never_rises_and_never_lies_below() {
        let terms: Vec<_> =
            (-10..=10).map(|k| (0.3e9 * f64::from(k), Complex::new(1.0 / 21.0, 0.0))).collect();
        let table = Table::new(1e-9, &terms);
        let envelope = table.envelope();
        assert!((envelope.at(0.0).re - 1.0).abs() < 1e-9);
        for step in 0..1190 {
            let t_s = 1e-11 * f64::from(step);
            assert!(table.at(t_s).norm() <= envelope.at(t_s).re + 1e-9);
            assert!(envelope.at(t_s + 1e-11).re <= envelope.at(-t_s).re + 1e-9);
        }
        let edge = envelope.at_or_tail(10e-9);
        assert!((envelope.at_or_tail(-20e-9) / edge - 0.5).abs() < 1e-9);
    }
}
