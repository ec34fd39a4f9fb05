//! How far axes reach, so that everything is inside.

use std::ops::Range;

/// The least ranges that hold all places; both from 0 to 0 if there is none.
pub fn around(places: impl IntoIterator<Item = [f64; 2]>) -> [Range<f64>; 2] {
    let mut limits = [(f64::MAX, f64::MIN); 2];
    for place in places {
        for (limit, value) in limits.iter_mut().zip(place) {
            *limit = (limit.0.min(value), limit.1.max(value));
        }
    }
    limits.map(|(least, most)| if least <= most { least..most } else { 0.0..0.0 })
}

/// Both ranges about their middles, as long as the longer one times `1 + 2 margin`, at least `2
/// least_half` times that: equal scales on a square chart.
#[must_use]
pub fn squared(ranges: [Range<f64>; 2], least_half: f64, margin: f64) -> [Range<f64>; 2] {
    let halves = ranges.iter().map(|range| 0.5 * (range.end - range.start));
    let reach = halves.fold(least_half, f64::max) * (1.0 + 2.0 * margin);
    ranges.map(|range| {
        let middle = 0.5 * (range.start + range.end);
        middle - reach..middle + reach
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_is_inside_and_scales_are_equal() {
        let ranges = around([[1.0, 5.0], [-3.0, 6.0], [0.0, 4.0]]);
        assert_eq!(ranges, [-3.0..1.0, 4.0..6.0]);
        assert_eq!(squared(ranges, 0.5, 0.25), [-4.0..2.0, 2.0..8.0]);
        assert_eq!(squared(around([]), 0.5, 0.0), [-0.5..0.5, -0.5..0.5]);
    }
}
