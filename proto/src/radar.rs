//! What a radar is: its band, its array, the grid of its image and the wall before it.

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Speed of light in vacuum.
pub const SPEED_OF_LIGHT_M_PER_S: f64 = 299_792_458.0;

/// Largest number of frequencies in a sweep, so that a typing error cannot ask for all memory.
const MAX_STEP_COUNT: usize = 1 << 16;
/// Largest number of pixels of an image, for the same reason.
const MAX_PIXEL_COUNT: usize = 1 << 24;

/// Why a description of a radar makes no sense.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("{field} is {value}: {remedy}")]
pub struct InvalidRadar {
    /// Which setting.
    pub field: &'static str,
    /// What it was, as text.
    pub value: String,
    /// What would do.
    pub remedy: &'static str,
}

#[expect(clippy::fn_params_excessive_bools, reason = "reads like an assertion")]
fn require(
    good: bool,
    field: &'static str,
    value: impl std::fmt::Debug,
    remedy: &'static str,
) -> Result<(), InvalidRadar> {
    if good { Ok(()) } else { Err(InvalidRadar { field, value: format!("{value:?}"), remedy }) }
}

/// The frequencies of one sweep: `start + k · step`, `k = 0 .. step_count`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Band {
    /// Lowest frequency.
    pub start_hz: f64,
    /// Distance of neighbouring frequencies.
    pub step_hz: f64,
    /// How many frequencies.
    pub step_count: usize,
}

impl Default for Band {
    /// 1.6 to 2.2 GHz in 2 MHz steps \[registration, section 3\].
    fn default() -> Self {
        Self { start_hz: 1.6e9, step_hz: 2e6, step_count: 301 }
    }
}

impl Band {
    /// Frequency number `index`.
    #[must_use]
    pub fn frequency_hz(&self, index: usize) -> f64 {
        self.start_hz + self.step_hz * index as f64
    }

    /// Index of the carrier, the middle of the band (exactly on a frequency).
    #[must_use]
    pub fn carrier_index(&self) -> usize {
        self.step_count / 2
    }

    /// The carrier f_c, to which profiles are brought down.
    #[must_use]
    pub fn carrier_hz(&self) -> f64 {
        self.frequency_hz(self.carrier_index())
    }

    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), InvalidRadar> {
        let positive = |hz: f64| hz.is_finite() && 0.0 < hz;
        require(
            positive(self.start_hz),
            "band.start_hz",
            self.start_hz,
            "use a positive frequency",
        )?;
        require(positive(self.step_hz), "band.step_hz", self.step_hz, "use a positive step")?;
        let counts = 2..=MAX_STEP_COUNT;
        require(
            counts.contains(&self.step_count),
            "band.step_count",
            self.step_count,
            "use 2 to 65536",
        )
    }
}

/// Where the antennas stand, `[x, y]` in metres in the node's frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Array {
    /// Transmitters.
    pub tx_m: Vec<[f64; 2]>,
    /// Receivers.
    pub rx_m: Vec<[f64; 2]>,
}

impl Default for Array {
    /// Two transmitters and four receivers on a line \[registration, section 3\].
    fn default() -> Self {
        let on_line = |x_m: &f64| [*x_m, 0.0];
        Self {
            tx_m: [-0.15, 0.15].iter().map(on_line).collect(),
            rx_m: [-0.1125, -0.0375, 0.0375, 0.1125].iter().map(on_line).collect(),
        }
    }
}

impl Array {
    /// Number of channels: every transmitter with every receiver. Channel `t · rx_count + r`.
    #[must_use]
    pub fn channel_count(&self) -> usize {
        self.tx_m.len() * self.rx_m.len()
    }

    /// Root mean square distance of the virtual elements `(x_t + x_r)/2` from their centre along
    /// `x`: the σ_x of the bound on direction.
    #[must_use]
    pub fn aperture_sigma_m(&self) -> f64 {
        let virtual_x_m: Vec<f64> = self
            .tx_m
            .iter()
            .flat_map(|t| self.rx_m.iter().map(move |r| 0.5 * (t[0] + r[0])))
            .collect();
        let count = virtual_x_m.len() as f64;
        let mean = virtual_x_m.iter().sum::<f64>() / count;
        (virtual_x_m.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / count).sqrt()
    }

    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), InvalidRadar> {
        for (field, antennas) in [("array.tx_m", &self.tx_m), ("array.rx_m", &self.rx_m)] {
            require((1..=64).contains(&antennas.len()), field, antennas, "list 1 to 64 antennas")?;
            let finite = antennas.iter().flatten().all(|m| m.is_finite() && m.abs() < 100.0);
            require(
                finite,
                field,
                antennas,
                "use [x, y] in metres within 100 m of the array centre",
            )?;
        }
        require(0.0 < self.aperture_sigma_m(), "array", &self.rx_m, "spread the antennas along x")
    }
}

/// The pixels of an image: rows along `y`, columns along `x`, in the node's frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Grid {
    /// Centre of the first column.
    pub x_min_m: f64,
    /// Centre of the first row.
    pub y_min_m: f64,
    /// Distance of neighbouring pixels.
    pub pixel_m: f64,
    /// Number of columns.
    pub column_count: usize,
    /// Number of rows.
    pub row_count: usize,
}

impl Default for Grid {
    /// 10 m × 10 m in 0.03 m pixels before the array \[registration, section 4\].
    fn default() -> Self {
        Self { x_min_m: -4.995, y_min_m: 0.0, pixel_m: 0.03, column_count: 334, row_count: 334 }
    }
}

impl Grid {
    /// `x` of a column.
    #[must_use]
    pub fn x_m(&self, column: usize) -> f64 {
        self.x_min_m + self.pixel_m * column as f64
    }

    /// `y` of a row.
    #[must_use]
    pub fn y_m(&self, row: usize) -> f64 {
        self.y_min_m + self.pixel_m * row as f64
    }

    /// Number of pixels; images are stored row by row.
    #[must_use]
    pub fn pixel_count(&self) -> usize {
        self.column_count * self.row_count
    }

    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), InvalidRadar> {
        require(self.x_min_m.is_finite(), "grid.x_min_m", self.x_min_m, "use metres")?;
        let before = self.y_min_m.is_finite() && 0.0 <= self.y_min_m;
        require(before, "grid.y_min_m", self.y_min_m, "start at or before the array (0 or more)")?;
        let pixel = self.pixel_m.is_finite() && 0.0 < self.pixel_m;
        require(pixel, "grid.pixel_m", self.pixel_m, "use a positive size")?;
        let fits = |n: usize| (2..=MAX_PIXEL_COUNT).contains(&n);
        require(fits(self.column_count), "grid.column_count", self.column_count, "use 2 or more")?;
        let pixels = self.column_count.saturating_mul(self.row_count);
        require(
            2 <= self.row_count && fits(pixels),
            "grid.row_count",
            self.row_count,
            "use 2 or more, and at most 2^24 pixels in all",
        )
    }
}

/// A homogeneous slab right before the array, parallel to it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Wall {
    /// Thickness d.
    pub thickness_m: f64,
    /// Relative permittivity ε.
    pub permittivity: f64,
}

impl Wall {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), InvalidRadar> {
        let thin = (0.0..=2.0).contains(&self.thickness_m);
        require(thin, "wall.thickness_m", self.thickness_m, "use 0 to 2 m")?;
        let dielectric = (1.0..=100.0).contains(&self.permittivity);
        require(dielectric, "wall.permittivity", self.permittivity, "use 1 to 100")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_radar_is_the_specified_one() {
        let band = Band::default();
        assert!((band.frequency_hz(band.step_count - 1) - 2.2e9).abs() < 1.0);
        assert!((band.carrier_hz() - 1.9e9).abs() < 1.0);
        let array = Array::default();
        assert_eq!(array.channel_count(), 8);
        // spec: σ_x = 0.0859 m of the filled line of pitch 0.075 m.
        assert!((array.aperture_sigma_m() - 0.0859).abs() < 1e-4);
        assert_eq!(Grid::default().pixel_count(), 334 * 334);
    }

    #[test]
    fn nonsense_is_named() {
        let bad_step = Band { step_hz: f64::NAN, ..Band::default() }.check().unwrap_err();
        assert_eq!(bad_step.field, "band.step_hz");
        let alone = Array { tx_m: vec![], ..Array::default() }.check().unwrap_err();
        assert_eq!(alone.field, "array.tx_m");
        let point = Array { tx_m: vec![[0.0, 0.0]], rx_m: vec![[0.0, 0.0]] }.check().unwrap_err();
        assert_eq!(point.field, "array");
        let huge = Grid { row_count: usize::MAX, ..Grid::default() }.check().unwrap_err();
        assert_eq!(huge.field, "grid.row_count");
        let glass = Wall { thickness_m: 0.2, permittivity: 0.5 }.check().unwrap_err();
        assert_eq!(glass.field, "wall.permittivity");
        for good in [Band::default().check(), Array::default().check(), Grid::default().check()] {
            assert_eq!(good, Ok(()));
        }
    }
}
