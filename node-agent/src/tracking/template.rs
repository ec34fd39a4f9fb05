//! The template of a maximum: a rectangle grown line by line, and its inner ellipse.
//!
//! From the maximum of amplitude `A` a rectangle grows by one pixel in each of four directions for
//! which the sum over the line of pixels next to that side exceeds `T_s = 0.03 A`; a direction that
//! does not, waits, and is tried again when the others have made its line longer. It ends when all
//! four wait \[mean-shift, section 2.1\]. Lines have no corners: all four sums of a round are taken
//! beside the same rectangle. Pixels below `floor` count as nothing, for else a long line of weak
//! noise passes; with `floor` 0 this is the paper's sum. Ends after at most as many rounds as the
//! image has rows and columns.

use nalgebra::Vector2;

use super::maxima::{Peak, Raster};

/// When a template grows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Growth {
    /// `T_s / A`.
    pub line_share: f64,
    /// Smaller values count as nothing.
    pub floor: f32,
    /// Columns and rows that a template has at most.
    pub max_counts: [usize; 2],
}

/// Pixels from one corner to the other, both included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rectangle {
    /// First and last column.
    pub columns: [usize; 2],
    /// First and last row.
    pub rows: [usize; 2],
}

/// An ellipse along columns and rows, in pixels: `(0, 0)` is the middle of the first pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ellipse {
    /// Column and row of its middle.
    pub centre_px: Vector2<f64>,
    /// Half axes along columns and rows, more than 0.
    pub half_axes_px: Vector2<f64>,
}

impl Ellipse {
    /// `|x*|²`: the distance from the middle over the half axes, squared; below 1 inside.
    #[must_use]
    pub fn distance2(&self, place_px: &Vector2<f64>) -> f64 {
        (place_px - self.centre_px).component_div(&self.half_axes_px).norm_squared()
    }
}

impl Rectangle {
    /// The template.
    #[must_use]
    pub fn inner_ellipse(&self) -> Ellipse {
        let middle = |[from, to]: [usize; 2]| 0.5 * (from + to) as f64;
        let half = |[from, to]: [usize; 2]| 0.5 * (to - from + 1) as f64;
        Ellipse {
            centre_px: Vector2::new(middle(self.columns), middle(self.rows)),
            half_axes_px: Vector2::new(half(self.columns), half(self.rows)),
        }
    }
}

/// The rectangle that grows from a maximum, which is in the image.
#[must_use]
pub fn grown(raster: &Raster<'_>, peak: &Peak, growth: &Growth) -> Rectangle {
    let mut rectangle = Rectangle { columns: [peak.column; 2], rows: [peak.row; 2] };
    let threshold = growth.line_share * f64::from(peak.amplitude);
    loop {
        let Rectangle { columns: [left, right], rows: [near, far] } = rectangle;
        let row = |at: usize| threshold < sum(raster.part(at, left, right).iter(), growth.floor);
        let column = |at: usize| {
            let values = raster.amplitude[at..].iter().step_by(raster.column_count);
            threshold < sum(values.skip(near).take(far - near + 1), growth.floor)
        };
        let [is_narrow, is_short] =
            [right - left + 1 < growth.max_counts[0], far - near + 1 < growth.max_counts[1]];
        let next = Rectangle {
            columns: [
                left - usize::from(is_narrow && 0 < left && column(left - 1)),
                right
                    + usize::from(
                        is_narrow && right + 1 < raster.column_count && column(right + 1),
                    ),
            ],
            rows: [
                near - usize::from(is_short && 0 < near && row(near - 1)),
                far + usize::from(is_short && far + 1 < raster.row_count && row(far + 1)),
            ],
        };
        if next == rectangle {
            return rectangle;
        }
        rectangle = next;
    }
}

fn sum<'a>(values: impl Iterator<Item = &'a f32>, floor: f32) -> f64 {
    values.filter(|value| floor <= **value).map(|value| f64::from(*value)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    const AS_PUBLISHED: Growth = Growth { line_share: 0.03, floor: 0.0, max_counts: [1000; 2] };

    /// An image from its rows, first row nearest, with the maximum at `column`, `row`.
    fn grown_in<const COLUMNS: usize>(
        rows: &[[f32; COLUMNS]],
        [column, row]: [usize; 2],
        growth: &Growth,
    ) -> Rectangle {
        let amplitude: Vec<f32> = rows.iter().flatten().copied().collect();
        let raster = Raster { amplitude: &amplitude, column_count: COLUMNS, row_count: rows.len() };
        grown(&raster, &Peak { column, row, amplitude: rows[row][column] }, growth)
    }

    #[test]
    fn a_template_grows_as_worked_out_by_hand() {
        // 100 at (2, 2), so that T_s = 3. Round 1: left 4, right 2, near 3, far 50: left and far
        // grow, near waits as 3 does not exceed 3. Round 2 beside columns 1-2, rows 2-3: left 0+0,
        // right 2+2 = 4, near 1+3 = 4, far 0: right and near grow. Round 3 beside columns 1-3, rows
        // 1-3: left 0, right 0, near 0+1+0, far 0+0+2: ends.
        let rows = [
            [0.0, 0.0, 1.0, 0.0, 0.0],
            [0.0, 1.0, 3.0, 0.0, 0.0],
            [0.0, 4.0, 100.0, 2.0, 0.0],
            [0.0, 1.0, 50.0, 2.0, 0.0],
            [0.0, 0.0, 0.0, 2.0, 9.0],
        ];
        let rectangle = grown_in(&rows, [2, 2], &AS_PUBLISHED);
        assert_eq!(rectangle, Rectangle { columns: [1, 3], rows: [1, 3] });
        let ellipse = rectangle.inner_ellipse();
        assert_eq!(ellipse.centre_px, Vector2::new(2.0, 2.0));
        assert_eq!(ellipse.half_axes_px, Vector2::new(1.5, 1.5));
        // The corner of the rectangle is not in the ellipse, the middle of a side is.
        assert!(1.0 < ellipse.distance2(&Vector2::new(3.2, 3.2)));
        assert!(ellipse.distance2(&Vector2::new(1.0, 2.0)) < 1.0);
        // What is below the floor does not count: left 4 and far 50 are what is left.
        let clipped = Growth { floor: 3.5, ..AS_PUBLISHED };
        let smaller = grown_in(&rows, [2, 2], &clipped);
        assert_eq!(smaller, Rectangle { columns: [1, 2], rows: [2, 3] });
    }

    #[test]
    fn a_template_stays_in_the_image_and_below_its_largest_size() {
        let full = [[1.0; 4]; 3];
        let all = Rectangle { columns: [0, 3], rows: [0, 2] };
        assert_eq!(grown_in(&full, [0, 0], &AS_PUBLISHED), all);
        assert_eq!(grown_in(&full, [3, 2], &AS_PUBLISHED), all);
        let small = Growth { max_counts: [1, 2], ..AS_PUBLISHED };
        let rectangle = grown_in(&full, [3, 2], &small);
        assert_eq!(rectangle, Rectangle { columns: [3, 3], rows: [1, 2] });
        let alone = grown_in(&[[5.0]], [0, 0], &AS_PUBLISHED);
        assert_eq!(alone.inner_ellipse().half_axes_px, Vector2::new(0.5, 0.5));
    }

    #[test]
    fn the_growth_runs_across_the_valley_between_two() {
        // The fault of the rule that experiment 3 shows: the valley of 0.2 is above T_s.
        let rows = [[0.0, 0.5, 1.0, 0.2, 0.9, 0.5, 0.0]];
        let rectangle = grown_in(&rows, [2, 0], &AS_PUBLISHED);
        assert_eq!(rectangle.columns, [1, 5]);
    }
}
