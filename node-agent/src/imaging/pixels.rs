//! Where the pixels of an image are: on a Cartesian grid to look at, or on a polar one to measure.
//!
//! An image of a small array carries far fewer independent numbers than a Cartesian image has
//! pixels: a polar grid over range `r` and `u = sin θ`, a third of a resolution cell apart, holds
//! them all at a tenth of the cost.

use nalgebra::Vector2;
use proto::radar::Grid;
use serde::{Deserialize, Serialize};

use super::{InvalidSetting, invalid};

/// Most pixels of a polar grid, so that a typing error cannot ask for all memory.
const MAX_PIXEL_COUNT: usize = 1 << 24;

/// The pixels of a polar image: rows along `u = sin θ`, columns along the range.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PolarGrid {
    /// Range of the first column, metres.
    pub range_min_m: f64,
    /// Distance of neighbouring columns, metres.
    pub range_step_m: f64,
    /// Number of columns.
    pub range_count: usize,
    /// Sine of the angle from boresight of the first row, positive along `x`.
    pub sine_min: f64,
    /// Distance of neighbouring rows.
    pub sine_step: f64,
    /// Number of rows.
    pub sine_count: usize,
}

impl Default for PolarGrid {
    /// 184 × 49 pixels out to 10.4 m and 73°.
    fn default() -> Self {
        Self {
            range_min_m: 0.4,
            range_step_m: 0.0545,
            range_count: 184,
            sine_min: -0.96,
            sine_step: 0.04,
            sine_count: 49,
        }
    }
}

impl PolarGrid {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), InvalidSetting> {
        let positive = f64::MIN_POSITIVE..1e3;
        for (field, value) in [
            ("polar.range_min_m", self.range_min_m),
            ("polar.range_step_m", self.range_step_m),
            ("polar.sine_step", self.sine_step),
        ] {
            if !positive.contains(&value) {
                return Err(invalid(field, value, "use a positive number"));
            }
        }
        let count = self.range_count.saturating_mul(self.sine_count);
        if self.range_count < 2 || self.sine_count < 2 || MAX_PIXEL_COUNT < count {
            return Err(invalid("polar.range_count", count, "use 2 to 2^24 pixels in all"));
        }
        let last = self.sine_min + self.sine_step * (self.sine_count - 1) as f64;
        if !(-1.0 < self.sine_min && last < 1.0) {
            return Err(invalid("polar.sine_min", self.sine_min, "let all sines lie within ±1"));
        }
        Ok(())
    }
}

/// The pixels of an image, row by row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pixels {
    /// Rows along `y`, columns along `x`.
    Cartesian(Grid),
    /// Rows along the sine, columns along the range.
    Polar(PolarGrid),
}

impl Pixels {
    /// Number of rows.
    #[must_use]
    pub fn row_count(&self) -> usize {
        match self {
            Self::Cartesian(grid) => grid.row_count,
            Self::Polar(polar) => polar.sine_count,
        }
    }

    /// Number of columns.
    #[must_use]
    pub fn column_count(&self) -> usize {
        match self {
            Self::Cartesian(grid) => grid.column_count,
            Self::Polar(polar) => polar.range_count,
        }
    }

    /// Number of pixels.
    #[must_use]
    pub fn pixel_count(&self) -> usize {
        self.row_count() * self.column_count()
    }

    /// Row and column of pixel `index`.
    #[must_use]
    pub fn row_and_column(&self, index: usize) -> (usize, usize) {
        (index / self.column_count(), index % self.column_count())
    }

    /// `[x, y]` of pixel `index` in the node's frame, metres.
    #[must_use]
    pub fn coords_m(&self, index: usize) -> Vector2<f64> {
        let (row, column) = self.row_and_column(index);
        match self {
            Self::Cartesian(grid) => Vector2::new(grid.x_m(column), grid.y_m(row)),
            Self::Polar(_) => {
                let polar = self.polar(index);
                Vector2::new(polar.x * polar.y, polar.x * (1.0 - polar.y * polar.y).sqrt())
            }
        }
    }

    /// `[r, u]` of pixel `index`: range in metres and sine of the angle from boresight.
    #[must_use]
    pub fn polar(&self, index: usize) -> Vector2<f64> {
        let (row, column) = self.row_and_column(index);
        match self {
            Self::Cartesian(_) => {
                let coords_m = self.coords_m(index);
                let range_m = coords_m.norm();
                Vector2::new(range_m, coords_m.x / range_m.max(f64::MIN_POSITIVE))
            }
            Self::Polar(grid) => Vector2::new(
                grid.range_min_m + grid.range_step_m * column as f64,
                grid.sine_min + grid.sine_step * row as f64,
            ),
        }
    }

    /// The area of pixel `index` in `(r, u)`, up to a common factor: what a sum over pixels needs to
    /// be an integral over range and sine.
    #[must_use]
    pub fn polar_area(&self, index: usize) -> f64 {
        match self {
            Self::Cartesian(_) => {
                let coords_m = self.coords_m(index);
                coords_m.y / coords_m.norm_squared().max(f64::MIN_POSITIVE)
            }
            Self::Polar(_) => 1.0,
        }
    }

    /// Rows and columns that `along_m` metres in range and `across_m` across cover at pixel `index`
    /// (Cartesian: along `y` and `x`).
    #[must_use]
    pub fn span(&self, index: usize, along_m: f64, across_m: f64) -> (usize, usize) {
        match self {
            Self::Cartesian(grid) => {
                (whole(along_m / grid.pixel_m), whole(across_m / grid.pixel_m))
            }
            Self::Polar(grid) => {
                let range_m = self.polar(index).x;
                (whole(across_m / range_m / grid.sine_step), whole(along_m / grid.range_step_m))
            }
        }
    }
}

/// At least one, rounded up.
#[expect(clippy::cast_possible_truncation, reason = "clamped to a million")]
fn whole(pixels: f64) -> usize {
    pixels.ceil().clamp(1.0, 1e6) as usize
}
