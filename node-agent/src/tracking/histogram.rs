//! Histograms of amplitude in an ellipse, weighted towards its middle, and how alike two are.
//!
//! `p_u(y) = C Σ_i k(|x_i*|²) δ[b(x_i) − u]`, `x* = (x − y) / h` along either axis, with the
//! Epanechnikov profile `k(r²) = 1 − r²` for `r < 1`, 0 beyond, and `C = 1 / Σ_i k`
//! \[mean-shift, eqs. (4)-(8)\]; `b = floor(m I / A)`, at most `m − 1`, of `m` bins, where `A` is the
//! template's maximum. Likeness is Bhattacharyya's `ρ = Σ_u sqrt(p_u q_u)` (9).
//! The sums that the shift needs are taken in the same pass: `g = −k' = 1` inside.

use nalgebra::Vector2;

use super::maxima::Raster;
use super::template::Ellipse;

/// Bins there can be.
pub const MAX_BIN_COUNT: usize = 64;

/// How amplitudes are put into bins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bins {
    /// `m`, 1 to [`MAX_BIN_COUNT`].
    pub count: usize,
    /// `A`: the least amplitude of beyond the last bin, more than 0.
    pub top: f32,
    /// Smaller values go into the first bin.
    pub floor: f32,
}

/// What the pixels of one bin add up to.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BinSums {
    /// `Σ k`.
    pub kernel: f64,
    /// `Σ g`: how many pixels.
    pub count: f64,
    /// `Σ g x`: column and row, relative to the middle of the ellipse, pixels.
    pub offset_px: Vector2<f64>,
}

/// The sums of all bins.
#[derive(Clone, Debug, PartialEq)]
pub struct Sums {
    bins: [BinSums; MAX_BIN_COUNT],
    count: usize,
}

/// Shares of the bins, adding up to 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    shares: [f64; MAX_BIN_COUNT],
    count: usize,
}

impl Bins {
    /// The bin of an amplitude, from 0.
    #[must_use]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the cast saturates, and what is no number or negative goes to the first bin"
    )]
    pub fn index(&self, amplitude: f32) -> usize {
        if amplitude < self.floor {
            return 0;
        }
        ((self.count as f32 / self.top * amplitude) as usize).min(self.count - 1)
    }
}

/// The sums over the pixels of `raster` inside `ellipse`; no pixel of it need be in the image.
#[must_use]
pub fn sums(raster: &Raster<'_>, ellipse: &Ellipse, bins: &Bins) -> Sums {
    let mut all = Sums { bins: [BinSums::default(); MAX_BIN_COUNT], count: bins.count };
    let Ellipse { centre_px, half_axes_px } = ellipse;
    let Some(rows) = within(centre_px.y, half_axes_px.y, raster.row_count) else { return all };
    for row in rows[0]..=rows[1] {
        let dy = row as f64 - centre_px.y;
        let left = 1.0 - (dy / half_axes_px.y).powi(2);
        let half = half_axes_px.x * left.max(0.0).sqrt();
        let Some(columns) = within(centre_px.x, half, raster.column_count) else { continue };
        let mut dx = columns[0] as f64 - centre_px.x;
        for value in raster.part(row, columns[0], columns[1]) {
            let kernel = left - (dx / half_axes_px.x).powi(2);
            if 0.0 < kernel {
                let bin = &mut all.bins[bins.index(*value)];
                bin.kernel += kernel;
                bin.count += 1.0;
                bin.offset_px += Vector2::new(dx, dy);
            }
            dx += 1.0;
        }
    }
    all
}

/// First and last pixel of `count` within `half` of `centre`; `None` if there is none.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "both ends are clamped to the image, whose sides are far below 2^52"
)]
fn within(centre: f64, half: f64, count: usize) -> Option<[usize; 2]> {
    let (from, to) = ((centre - half).ceil().max(0.0), (centre + half).floor());
    let to = to.min(count as f64 - 1.0);
    (from <= to).then_some([from as usize, to as usize])
}

impl Sums {
    /// One for each bin.
    #[must_use]
    pub fn bins(&self) -> &[BinSums] {
        &self.bins[..self.count]
    }

    /// The histogram; `None` if no pixel is inside.
    #[must_use]
    pub fn histogram(&self) -> Option<Histogram> {
        let total: f64 = self.bins().iter().map(|bin| bin.kernel).sum();
        let mut shares = [0.0; MAX_BIN_COUNT];
        for (share, bin) in shares.iter_mut().zip(self.bins()) {
            *share = bin.kernel / total;
        }
        (0.0 < total).then_some(Histogram { shares, count: self.count })
    }
}

impl Histogram {
    /// One share for each bin.
    #[must_use]
    pub fn shares(&self) -> &[f64] {
        &self.shares[..self.count]
    }

    /// How alike two histograms are, 0 to 1: Bhattacharyya's coefficient.
    #[must_use]
    pub fn likeness(&self, other: &Self) -> f64 {
        self.shares().iter().zip(other.shares()).map(|(p, q)| (p * q).sqrt()).sum()
    }
}

#[cfg(test)]
mod tests;
