//! How far axes reach, so that everything is inside.

use std::ops::Range;

use plotters::chart::SeriesLabelPosition;

/// What a legend takes of a chart's width and height, rather more than less.
const LEGEND_SHARE: [f64; 2] = [0.32, 0.2];

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

/// The upper right corner, or another one if fewer of the places are there: for the legend.
pub fn quiet_corner(
    places: impl IntoIterator<Item = [f64; 2]>,
    ranges: &[Range<f64>; 2],
) -> SeriesLabelPosition {
    let mut counts = [0_usize; 4];
    for place in places {
        let [x, y] = [0, 1].map(|axis: usize| {
            let range = &ranges[axis];
            (place[axis] - range.start) / (range.end - range.start)
        });
        let (is_low, is_high) = (y < LEGEND_SHARE[1], 1.0 - LEGEND_SHARE[1] < y);
        let (is_left, is_right) = (x < LEGEND_SHARE[0], 1.0 - LEGEND_SHARE[0] < x);
        let corners =
            [is_high && is_right, is_high && is_left, is_low && is_right, is_low && is_left];
        counts
            .iter_mut()
            .zip(corners)
            .for_each(|(count, is_there)| *count += usize::from(is_there));
    }
    let least = counts.iter().min().copied().unwrap_or(0);
    match counts.iter().position(|count| *count == least) {
        Some(1) => SeriesLabelPosition::UpperLeft,
        Some(2) => SeriesLabelPosition::LowerRight,
        Some(3) => SeriesLabelPosition::LowerLeft,
        _ => SeriesLabelPosition::UpperRight,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_legend_goes_where_least_is() {
        let ranges = [0.0..10.0, 0.0..10.0];
        let name = |places: &[[f64; 2]]| {
            let corner = quiet_corner(places.iter().copied(), &ranges);
            match corner {
                SeriesLabelPosition::UpperRight => "upper right",
                SeriesLabelPosition::UpperLeft => "upper left",
                SeriesLabelPosition::LowerRight => "lower right",
                _ => "lower left",
            }
        };
        assert_eq!(name(&[]), "upper right");
        assert_eq!(name(&[[5.0, 5.0], [9.0, 9.0]]), "upper left");
        assert_eq!(name(&[[1.0, 9.5], [9.0, 9.0]]), "lower right");
        assert_eq!(name(&[[1.0, 9.5], [9.0, 9.0], [9.0, 1.0]]), "lower left");
        let everywhere = [[1.0, 9.5], [9.0, 9.0], [9.0, 1.0], [1.0, 1.0], [1.0, 0.5]];
        assert_eq!(name(&everywhere), "upper right");
    }

    #[test]
    fn everything_is_inside_and_scales_are_equal() {
        let ranges = around([[1.0, 5.0], [-3.0, 6.0], [0.0, 4.0]]);
        assert_eq!(ranges, [-3.0..1.0, 4.0..6.0]);
        assert_eq!(squared(ranges, 0.5, 0.25), [-4.0..2.0, 2.0..8.0]);
        assert_eq!(squared(around([]), 0.5, 0.0), [-0.5..0.5, -0.5..0.5]);
    }
}
