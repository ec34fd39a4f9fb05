//! The local maxima of an image: where dilation by an elliptic disc changes nothing.
//!
//! `Y(x) = max over e in E of I(x + e)`, a pixel is a maximum where `Y(x) = I(x)`
//! \[mean-shift, eqs. (2), (3)\]; `E` holds the offsets with `(e_x/a)² + (e_y/b)² ≤ 1`, pixels, and
//! beyond the border there is nothing. On a plateau every pixel is one by these formulas; here the
//! first of it counts, row by row, if no earlier one of the same value lies in its disc.
//! `Y` is worked out only at pixels above the threshold, and there only until a larger value turns
//! up: next to a pixel that is no maximum, mostly.

use nalgebra::Vector2;

/// An image, row by row.
#[derive(Clone, Copy, Debug)]
pub struct Raster<'a> {
    /// One value per pixel, `column_count · row_count` of them, none negative or not a number.
    pub amplitude: &'a [f32],
    /// Pixels in a row.
    pub column_count: usize,
    /// Rows.
    pub row_count: usize,
}

impl Raster<'_> {
    /// The value at a pixel that is in the image.
    #[must_use]
    pub fn at(&self, column: usize, row: usize) -> f32 {
        self.amplitude[row * self.column_count + column]
    }

    /// The columns `from ..= to` of a row.
    #[must_use]
    pub fn part(&self, row: usize, from: usize, to: usize) -> &[f32] {
        let start = row * self.column_count;
        &self.amplitude[start + from..=start + to]
    }
}

/// A local maximum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Peak {
    /// Where.
    pub column: usize,
    /// Where.
    pub row: usize,
    /// How large.
    pub amplitude: f32,
}

impl Peak {
    /// Column and row.
    #[must_use]
    pub fn place_px(&self) -> Vector2<f64> {
        Vector2::new(self.column as f64, self.row as f64)
    }
}

/// Which maxima are kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keep {
    /// Only larger ones.
    pub above: f32,
    /// Only the largest so many.
    pub max_count: usize,
}

/// An elliptic disc of pixels around one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Disc {
    /// How many columns it reaches to either side, in its own row and those after.
    half_columns: Vec<usize>,
}

/// Pixels that are looked over at once: as many as fit a few wide registers.
const CHUNK: usize = 32;

impl Disc {
    /// The disc with half axes along the columns and rows, in pixels; at least the pixels that
    /// touch the middle one by a side, at most 1000.
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "half axes are clamped to 1000 pixels, and the root is not negative"
    )]
    pub fn new(half_axes_px: [f64; 2]) -> Self {
        let [across, along] = half_axes_px.map(|half| half.clamp(1.0, 1000.0));
        let reach = |row: usize| {
            let share = 1.0 - (row as f64 / along).powi(2);
            (across * share.max(0.0).sqrt()) as usize
        };
        Self { half_columns: (0..=along as usize).map(reach).collect() }
    }

    /// Whether no pixel of the disc around this one is larger, and no earlier one as large.
    fn tops(&self, raster: &Raster<'_>, peak: &Peak) -> bool {
        let Peak { column, row, amplitude } = *peak;
        let part = |at: usize, half: usize| {
            let to = (column + half).min(raster.column_count - 1);
            raster.part(at, column.saturating_sub(half), to)
        };
        let own = raster.part(row, 0, raster.column_count - 1);
        let half = self.half_columns[0];
        let to = (column + half).min(raster.column_count - 1);
        let before = &own[column.saturating_sub(half)..column];
        if before.iter().any(|v| amplitude <= *v) || own[column..=to].iter().any(|v| amplitude < *v)
        {
            return false;
        }
        self.half_columns.iter().enumerate().skip(1).all(|(away, reach)| {
            let is_below = row.checked_sub(away);
            let earlier = is_below.is_none_or(|at| part(at, *reach).iter().all(|v| *v < amplitude));
            let is_inside = row + away < raster.row_count;
            earlier && (!is_inside || part(row + away, *reach).iter().all(|v| *v <= amplitude))
        })
    }
}

/// The kept maxima of an image into `peaks`, largest first, of equal ones the first of the image
/// first. Takes no memory if `peaks` has room for one more than are kept.
pub fn maxima_into(raster: &Raster<'_>, disc: &Disc, keep: Keep, peaks: &mut Vec<Peak>) {
    peaks.clear();
    if raster.column_count == 0 || keep.max_count == 0 {
        return;
    }
    let mut above = keep.above;
    for (row, values) in raster.amplitude.chunks_exact(raster.column_count).enumerate() {
        for (number, chunk) in values.chunks(CHUNK).enumerate() {
            if largest(chunk) <= above {
                continue;
            }
            let large = chunk.iter().enumerate().filter(|(_, value)| above < **value).map(
                |(offset, amplitude)| Peak {
                    column: number * CHUNK + offset,
                    row,
                    amplitude: *amplitude,
                },
            );
            for peak in large.filter(|peak| disc.tops(raster, peak)) {
                insert(peaks, peak, keep.max_count);
            }
            if let Some(least) = peaks.get(keep.max_count - 1) {
                above = least.amplitude;
            }
        }
    }
}

/// Puts a maximum in its place among those kept.
fn insert(peaks: &mut Vec<Peak>, peak: Peak, max_count: usize) {
    let place = peaks.partition_point(|kept| peak.amplitude <= kept.amplitude);
    peaks.insert(place, peak);
    peaks.truncate(max_count);
}

/// The largest of some values, 0 if there is none. In lanes, which a compiler makes one register.
#[must_use]
pub fn largest(values: &[f32]) -> f32 {
    let mut lanes = [0.0_f32; 8];
    let (eights, rest) = values.as_chunks::<8>();
    for eight in eights {
        for (lane, value) in lanes.iter_mut().zip(eight) {
            *lane = if *lane < *value { *value } else { *lane };
        }
    }
    lanes.iter().chain(rest).fold(0.0, |most: f32, value| most.max(*value))
}

#[cfg(test)]
mod tests;
