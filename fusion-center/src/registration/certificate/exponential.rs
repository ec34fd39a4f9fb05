//! An exponential that is never too small, in a few operations.
//!
//! `exp x = 2^k exp r`, `|r| ≤ ½ ln 2`, with `exp r` from its Taylor polynomial of degree 7, whose
//! relative error is below 1e-8, plus a margin larger than that.

use std::f64::consts::{LN_2, LOG2_E};

/// Adding it to a small number leaves the nearest integer in the lowest bits.
const ROUNDER: f64 = 6_755_399_441_055_744.0;

/// Below it the result is that of it: exp(−700) is nothing.
const LEAST: f64 = -700.0;

/// Bits of a number's fraction, and the place of the exponent 0.
const FRACTION_BITS: u32 = 52;

/// Relative margin: above the polynomial's error of `(½ ln 2)⁸ / 8! < 6e-9` and rounding.
const MARGIN: f64 = 1.0 + 2e-8;

/// At least `exp x` and at most 3e-8 more, relatively, for `x` from −700 to 700.
#[inline]
pub(super) fn exp_above(x: f64) -> f64 {
    let bounded = if x > LEAST { x } else { LEAST };
    let shifted = bounded * LOG2_E + ROUNDER;
    let whole = shifted - ROUNDER;
    let rest = bounded - whole * LN_2;
    let series = 1.0 / 720.0 + rest * (1.0 / 5040.0);
    let series = 1.0 / 120.0 + rest * series;
    let series = 1.0 / 24.0 + rest * series;
    let series = 1.0 / 6.0 + rest * series;
    let series = 0.5 + rest * series;
    let series = 1.0 + rest * series;
    let fraction = MARGIN * (1.0 + rest * series);
    let power = shifted.to_bits() << FRACTION_BITS;
    f64::from_bits(fraction.to_bits().wrapping_add(power))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_above_the_exponential_and_hardly() {
        /// Relative, as stated.
        const MOST: f64 = 3e-8;
        for step in 0..140_000 {
            let x = f64::from(step).mul_add(0.01, -700.0) + 1e-3 * f64::from(step % 7);
            let (found, expected) = (exp_above(x.min(700.0)), x.min(700.0).exp());
            assert!(
                found >= expected && found <= expected * (1.0 + MOST),
                "{x} {found} {expected}"
            );
        }
        assert!(exp_above(-1e6) > 0.0 && exp_above(-1e6) < 1e-300);
        assert!(exp_above(0.0) >= 1.0);
    }
}
