//! The connected region of pixels around each peak that belongs to it.

use crate::imaging::backproject::CoherentImage;

use super::threshold::Peak;

/// Half the height and half the width of the box a region cannot leave, metres: several times the
/// blob of one target, so that a threshold below the noise cannot flood the image.
const HALF_BOX_M: (f64, f64) = (1.2, 2.4);

/// The pixels of one target.
#[derive(Clone, Debug, PartialEq)]
pub struct Region {
    /// Its peak.
    pub peak: Peak,
    /// Pixel numbers, ascending, the peak among them.
    pub pixels: Vec<usize>,
}

/// The region above `fraction` of its own peak's amplitude for each of `peaks` (strongest first).
/// A peak whose region meets a stronger one's has none of its own and is left out.
#[must_use]
pub fn regions(
    image: &CoherentImage,
    amplitude: &[f32],
    peaks: &[Peak],
    fraction: f32,
) -> Vec<Region> {
    let mut kept: Vec<Region> = Vec::new();
    for peak in peaks {
        let pixels = flood(image, amplitude, peak.index, fraction * amplitude[peak.index]);
        // Pixels are sorted.
        let is_taken = |pixel: &usize| {
            kept.iter().any(|stronger| stronger.pixels.binary_search(pixel).is_ok())
        };
        if !pixels.iter().any(is_taken) {
            kept.push(Region { peak: *peak, pixels });
        }
    }
    kept
}

/// All pixels connected by edges with `start` whose amplitude is at least `floor`.
fn flood(image: &CoherentImage, amplitude: &[f32], start: usize, floor: f32) -> Vec<usize> {
    let columns = image.pixels.column_count();
    let bounds = Bounds::around(image, start);
    let mut seen = vec![false; bounds.pixel_count()];
    let mut pixels = Vec::new();
    let mut waiting = vec![(start / columns, start % columns)];
    while let Some((row, column)) = waiting.pop() {
        let Some(place) = bounds.place(row, column) else { continue };
        if seen[place] || amplitude[row * columns + column] < floor {
            continue;
        }
        seen[place] = true;
        pixels.push(row * columns + column);
        // Wrapping below zero leaves the bounds, too.
        waiting.extend([
            (row.wrapping_sub(1), column),
            (row + 1, column),
            (row, column.wrapping_sub(1)),
            (row, column + 1),
        ]);
    }
    pixels.sort_unstable();
    pixels
}

/// The box around a peak, cut at the image's border.
struct Bounds {
    rows: std::ops::Range<usize>,
    columns: std::ops::Range<usize>,
}

impl Bounds {
    fn around(image: &CoherentImage, start: usize) -> Self {
        let (row, column) = image.pixels.row_and_column(start);
        let (rows, columns) = image.pixels.span(start, HALF_BOX_M.0, HALF_BOX_M.1);
        Self {
            rows: row.saturating_sub(rows)..(row + rows + 1).min(image.pixels.row_count()),
            columns: column.saturating_sub(columns)
                ..(column + columns + 1).min(image.pixels.column_count()),
        }
    }

    fn pixel_count(&self) -> usize {
        self.rows.len() * self.columns.len()
    }

    fn place(&self, row: usize, column: usize) -> Option<usize> {
        let inside = self.rows.contains(&row) && self.columns.contains(&column);
        inside.then(|| (row - self.rows.start) * self.columns.len() + column - self.columns.start)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::pixels::Pixels;
    use proto::radar::Grid;

    const PICTURE: [&str; 6] =
        ["9530000000", "0530004000", "0033334400", "0000000000", "0800000006", "6000000000"];

    fn amplitude() -> Vec<f32> {
        let digit = |c: u8| f32::from(c - b'0');
        PICTURE.iter().flat_map(|row| row.bytes().map(digit)).collect()
    }

    fn image() -> CoherentImage {
        let grid =
            Grid { x_min_m: 0.0, y_min_m: 1.0, pixel_m: 0.1, column_count: 10, row_count: 6 };
        CoherentImage {
            pixels: Pixels::Cartesian(grid),
            channel_count: 1,
            power: amplitude(),
            energy: vec![1.0; 60],
            phase_coherence: vec![],
        }
    }

    fn peak(index: usize) -> Peak {
        Peak { index, power: 1.0, range_m: 1.0, sine: 0.0 }
    }

    #[test]
    fn regions_are_connected_by_edges_down_to_half_their_own_peak() {
        let (image, amplitude) = (image(), amplitude());
        let found = regions(&image, &amplitude, &[peak(0), peak(41), peak(49)], 0.5);
        let pixels: Vec<&[usize]> = found.iter().map(|region| &region.pixels[..]).collect();
        // The 6 at (5, 0) touches the 8 by a corner only; the 6 at (4, 9) does not wrap around to it.
        assert_eq!(pixels, [&[0, 1, 11][..], &[41], &[49]]);
    }

    #[test]
    fn a_region_that_meets_a_stronger_one_is_left_out() {
        let (image, amplitude) = (image(), amplitude());
        // Half of the 4 at (1, 6) reaches through the row of threes to the region of the 9.
        let found = regions(&image, &amplitude, &[peak(0), peak(16)], 0.5);
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].peak.index, 0);
        let alone = regions(&image, &amplitude, &[peak(16)], 0.5);
        assert!(alone[0].pixels.contains(&26) && alone[0].pixels.contains(&22));
    }

    #[test]
    fn a_region_ends_at_its_box() {
        let grid =
            Grid { x_min_m: 0.0, y_min_m: 1.0, pixel_m: 0.6, column_count: 20, row_count: 20 };
        let flat = CoherentImage {
            pixels: Pixels::Cartesian(grid),
            channel_count: 1,
            power: vec![1.0; 400],
            energy: vec![1.0; 400],
            phase_coherence: vec![],
        };
        let found = regions(&flat, &flat.power, &[peak(10 * 20 + 10)], 0.5);
        assert_eq!(found[0].pixels.len(), 5 * 9);
    }
}
