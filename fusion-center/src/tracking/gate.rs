//! A uniform grid that finds the points within a distance of a place.
//!
//! It holds the plots and is asked around each predicted position, or the other way about; the
//! distance is that of the asking track or plot, at least half the longest axis of its gate. The
//! chi-square test is the caller's. All memory is kept from scan to scan.

use thiserror::Error;

#[cfg(test)]
mod tests;

/// Why points or a question were refused.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum GateError {
    /// Coordinates must be finite.
    #[error("give point {index} finite coordinates: ({x_m}, {y_m}) m was given")]
    Point {
        /// Which point, or [`ASKED`] for the place asked about.
        index: usize,
        /// First coordinate.
        x_m: f64,
        /// Second coordinate.
        y_m: f64,
    },
    /// A length must be finite and not negative, that of a cell above 0.
    #[error("give {what} as a finite length above 0: {length_m} m was given")]
    Length {
        /// Which length.
        what: &'static str,
        /// What was given.
        length_m: f64,
    },
    /// More points than indices of 32 bits tell apart.
    #[error("split the scene: {count} points are more than {limit}")]
    TooMany {
        /// How many there are.
        count: usize,
        /// How many there may be.
        limit: usize,
    },
}

/// Index in [`GateError::Point`] of the place asked about.
pub const ASKED: usize = usize::MAX;

/// Most cells per point, so that an empty scene costs no more than a full one.
const CELLS_PER_POINT: usize = 4;

/// Most points: their cells have indices of 32 bits.
const MAX_COUNT: usize = u32::MAX as usize / (2 * CELLS_PER_POINT);

/// One in so many of the points that may be beyond each side of the grid's core where few far
/// ones would make its cells large.
const POINTS_PER_OUTLIER: usize = 50;

/// How many points tell where nearly all are.
const CORE_SAMPLE_COUNT: usize = 500;

/// A point in the order of the cells.
#[derive(Clone, Copy, Debug)]
struct Held {
    x_m: f64,
    y_m: f64,
    index: u32,
}

/// One axis of the grid: cells of equal length, of which the first and last reach to infinity.
#[derive(Clone, Copy, Debug)]
struct Axis {
    start_m: f64,
    cells_per_m: f64,
    last: usize,
}

impl Axis {
    const WHOLE: Self = Self { start_m: 0.0, cells_per_m: 0.0, last: 0 };

    /// Never falls as `at_m` rises, so a range of places is within the range of their cells.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the cast saturates, below at the first cell, above at the last"
    )]
    #[inline]
    fn cell(&self, at_m: f64) -> usize {
        (((at_m - self.start_m) * self.cells_per_m) as usize).min(self.last)
    }
}

/// Points sorted into square cells.
#[derive(Clone, Debug)]
pub struct Grid {
    axes: [Axis; 2],
    /// Where each cell starts in `held`, row of cells after row, and the end of the last.
    starts: Vec<u32>,
    held: Vec<Held>,
    cell_of: Vec<u32>,
    sorted_m: Vec<f64>,
}

impl Default for Grid {
    fn default() -> Self {
        Self {
            axes: [Axis::WHOLE; 2],
            starts: vec![0; 2],
            held: Vec::new(),
            cell_of: Vec::new(),
            sorted_m: Vec::new(),
        }
    }
}

impl Grid {
    /// Forgets the points it held and takes `points_m`, m. Cells have sides of `cell_m`, best about
    /// the distance that most questions are asked with ([`cell_size_m`]), or longer where there would be
    /// more than four cells per point.
    ///
    /// # Errors
    /// A point or the length is not finite, the length is not above 0, or there are too many
    /// points; the grid is empty then.
    pub fn fill(&mut self, points_m: &[[f64; 2]], cell_m: f64) -> Result<(), GateError> {
        self.axes = [Axis::WHOLE; 2];
        self.held.clear();
        self.starts.clear();
        self.starts.resize(2, 0);
        check(points_m, cell_m)?;
        if points_m.is_empty() {
            return Ok(());
        }
        self.axes = self.lay(points_m, cell_m);
        self.sort(points_m);
        Ok(())
    }

    /// How many points it holds.
    #[must_use]
    pub fn count(&self) -> usize {
        self.held.len()
    }

    /// Names every point at most `radius_m` from `place_m` to `visit`, with the square of its
    /// distance, m². Each once, in the order of the cells, which is the same for the same points
    /// and cells.
    ///
    /// # Errors
    /// The place or the radius is not finite, or the radius is negative; nothing is named then.
    #[inline]
    pub fn for_each_within(
        &self,
        place_m: [f64; 2],
        radius_m: f64,
        mut visit: impl FnMut(usize, f64),
    ) -> Result<(), GateError> {
        let [x_m, y_m] = place_m;
        if !(x_m.is_finite() && y_m.is_finite()) {
            return Err(GateError::Point { index: ASKED, x_m, y_m });
        }
        if !(radius_m.is_finite() && 0.0 <= radius_m) {
            return Err(GateError::Length { what: "the radius", length_m: radius_m });
        }
        let [across, along] = &self.axes;
        let (first, last) = (across.cell(x_m - radius_m), across.cell(x_m + radius_m));
        let limit_m2 = radius_m * radius_m;
        for row in along.cell(y_m - radius_m)..=along.cell(y_m + radius_m) {
            // Cells of a row follow each other, and so do their points.
            let at = row * (across.last + 1);
            let range = self.starts[at + first] as usize..self.starts[at + last + 1] as usize;
            let measured = self.held[range].iter().map(|held| {
                let (dx_m, dy_m) = (held.x_m - x_m, held.y_m - y_m);
                (held.index as usize, dx_m * dx_m + dy_m * dy_m)
            });
            let near = measured.filter(|(_, distance_m2)| *distance_m2 <= limit_m2);
            near.for_each(|(index, distance_m2)| visit(index, distance_m2));
        }
        Ok(())
    }

    /// Where the cells are.
    fn lay(&mut self, points_m: &[[f64; 2]], cell_m: f64) -> [Axis; 2] {
        let cell_limit = CELLS_PER_POINT * points_m.len() + 1;
        let mut ends_m = [0, 1].map(|axis| ends(points_m.iter().map(|point_m| point_m[axis])));
        if cell_limit as f64 <= cell_count(ends_m, cell_m) {
            ends_m = [0, 1].map(|axis| self.core(points_m, axis));
        }
        let mut side_m = cell_m;
        while cell_limit as f64 <= cell_count(ends_m, side_m) {
            side_m *= 2.0;
        }
        ends_m.map(|[start_m, end_m]| {
            let whole = Axis { start_m, cells_per_m: side_m.recip(), last: cell_limit };
            Axis { last: whole.cell(end_m), ..whole }
        })
    }

    /// Between which two values nearly all points are, by some of them.
    fn core(&mut self, points_m: &[[f64; 2]], axis: usize) -> [f64; 2] {
        self.sorted_m.clear();
        let step = points_m.len().div_ceil(CORE_SAMPLE_COUNT);
        self.sorted_m.extend(points_m.iter().step_by(step).map(|point_m| point_m[axis]));
        let beyond = self.sorted_m.len() / POINTS_PER_OUTLIER;
        let last = self.sorted_m.len() - 1;
        [beyond, last - beyond]
            .map(|rank| *self.sorted_m.select_nth_unstable_by(rank, f64::total_cmp).1)
    }

    /// Counting sort of the points by cell.
    fn sort(&mut self, points_m: &[[f64; 2]]) {
        let [across, along] = self.axes;
        let cell_count = (across.last + 1) * (along.last + 1);
        self.starts.clear();
        self.starts.resize(cell_count + 1, 0);
        self.cell_of.clear();
        for [x_m, y_m] in points_m {
            let cell = along.cell(*y_m) * (across.last + 1) + across.cell(*x_m);
            self.starts[cell] += 1;
            self.cell_of.push(u32::try_from(cell).unwrap_or(u32::MAX));
        }
        let mut end = 0;
        for start in &mut self.starts {
            end += *start;
            *start = end;
        }
        self.held.resize(points_m.len(), Held { x_m: 0.0, y_m: 0.0, index: 0 });
        // From the last: every start comes down from the end of its cell.
        for (place, cell) in self.cell_of.iter().enumerate().rev() {
            let start = &mut self.starts[*cell as usize];
            *start -= 1;
            let ([x_m, y_m], index) = (points_m[place], u32::try_from(place).unwrap_or(u32::MAX));
            self.held[*start as usize] = Held { x_m, y_m, index };
        }
    }
}

/// A length for the cells from the distances that will be asked: their median, which a few wild ones
/// don't move; `None` if there is none above 0. Puts `distances_m` in another order.
#[must_use]
pub fn cell_size_m(distances_m: &mut [f64]) -> Option<f64> {
    if distances_m.is_empty() {
        return None;
    }
    let middle = distances_m.len() / 2;
    let (_, median_m, above_m) = distances_m.select_nth_unstable_by(middle, f64::total_cmp);
    let is_length = |length_m: &f64| length_m.is_finite() && 0.0 < *length_m;
    if is_length(median_m) {
        return Some(*median_m);
    }
    above_m.iter().copied().filter(is_length).min_by(f64::total_cmp)
}

fn check(points_m: &[[f64; 2]], cell_m: f64) -> Result<(), GateError> {
    if !(cell_m.is_finite() && 0.0 < cell_m) {
        return Err(GateError::Length { what: "the side of a cell", length_m: cell_m });
    }
    few_enough(points_m.len())?;
    let is_finite = |[x_m, y_m]: &[f64; 2]| x_m.is_finite() && y_m.is_finite();
    match points_m.iter().position(|point_m| !is_finite(point_m)) {
        None => Ok(()),
        Some(index) => {
            let [x_m, y_m] = points_m[index];
            Err(GateError::Point { index, x_m, y_m })
        }
    }
}

fn few_enough(count: usize) -> Result<(), GateError> {
    if MAX_COUNT < count {
        return Err(GateError::TooMany { count, limit: MAX_COUNT });
    }
    Ok(())
}

fn ends(values_m: impl Iterator<Item = f64>) -> [f64; 2] {
    let widen = |[low_m, high_m]: [f64; 2], at_m: f64| [at_m.min(low_m), at_m.max(high_m)];
    values_m.fold([f64::INFINITY, f64::NEG_INFINITY], widen)
}

fn cell_count(ends_m: [[f64; 2]; 2], side_m: f64) -> f64 {
    ends_m.iter().map(|[start_m, end_m]| (end_m - start_m) / side_m + 1.0).product()
}
