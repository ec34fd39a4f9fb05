//! Complex spectra, one row for every antenna or channel, and waves added to them.
//!
//! A wave over `path_m` is `g exp(−j 2π f path/c)`. It is turned from frequency to frequency by
//! one rotation, in eight interleaved sequences, each over an eighth of the band: 38 turns of a
//! band of 301 frequencies lose 1e-14.

use std::f64::consts::TAU;

use rustfft::num_complex::Complex;

use proto::radar::{Band, SPEED_OF_LIGHT_M_PER_S};

/// Sequences side by side: enough to hide the latency of a rotation.
const LANES: usize = 8;

/// Rows of spectra, real and imaginary parts apart, each row padded to whole lanes.
#[derive(Clone, Debug)]
pub(super) struct Spectra {
    row_len: usize,
    re: Vec<f64>,
    im: Vec<f64>,
}

impl Spectra {
    /// Rows of zeros over `band`.
    pub(super) fn zeros(row_count: usize, band: &Band) -> Self {
        let row_len = band.step_count.next_multiple_of(LANES);
        let zeros = vec![0.0; row_count * row_len];
        Self { row_len, re: zeros.clone(), im: zeros }
    }

    /// Sets everything to 0.
    pub(super) fn clear(&mut self) {
        self.re.fill(0.0);
        self.im.fill(0.0);
    }

    /// Adds a wave over `path_m` to a row.
    pub(super) fn add_wave(&mut self, row: usize, band: &Band, path_m: f64, gain: Complex<f64>) {
        let turn = |hz: f64| Complex::cis(-TAU * hz * path_m / SPEED_OF_LIGHT_M_PER_S);
        let step = turn(band.step_hz);
        let (mut re, mut im) = ([0.0; LANES], [0.0; LANES]);
        let mut wave = gain * turn(band.start_hz);
        for lane in 0..LANES {
            (re[lane], im[lane]) = (wave.re, wave.im);
            wave *= step;
        }
        let stride = turn(band.step_hz * LANES as f64);
        let range = row * self.row_len..(row + 1) * self.row_len;
        let sums = self.re[range.clone()].as_chunks_mut::<LANES>().0;
        for (sum_re, sum_im) in sums.iter_mut().zip(self.im[range].as_chunks_mut::<LANES>().0) {
            for lane in 0..LANES {
                sum_re[lane] += re[lane];
                sum_im[lane] += im[lane];
                let turned = re[lane] * stride.re - im[lane] * stride.im;
                im[lane] = re[lane] * stride.im + im[lane] * stride.re;
                re[lane] = turned;
            }
        }
    }

    /// Multiplies a row.
    pub(super) fn scale(&mut self, row: usize, factor: Complex<f64>) {
        let range = row * self.row_len..(row + 1) * self.row_len;
        for (re, im) in self.re[range.clone()].iter_mut().zip(&mut self.im[range]) {
            let scaled = Complex::new(*re, *im) * factor;
            (*re, *im) = (scaled.re, scaled.im);
        }
    }

    /// Adds the product of two rows, frequency by frequency, to a row.
    pub(super) fn add_product(&mut self, row: usize, [a, b]: [(&Self, usize); 2]) {
        let row_len = self.row_len;
        let slice = |of: (usize, usize)| of.0 * row_len..(of.1 + 1) * row_len;
        let (range, of_a, of_b) = (slice((row, row)), slice((a.1, a.1)), slice((b.1, b.1)));
        let (a_re, a_im) = (&a.0.re[of_a.clone()], &a.0.im[of_a]);
        let (b_re, b_im) = (&b.0.re[of_b.clone()], &b.0.im[of_b]);
        let (re, im) = (&mut self.re[range.clone()], &mut self.im[range]);
        let (re, im) = (&mut re[..row_len], &mut im[..row_len]);
        for k in 0..row_len {
            re[k] += a_re[k] * b_re[k] - a_im[k] * b_im[k];
            im[k] += a_re[k] * b_im[k] + a_im[k] * b_re[k];
        }
    }

    /// Adds another's row, weighted, to the same row.
    pub(super) fn add_row(&mut self, row: usize, other: &Self, weight: f64) {
        let range = row * self.row_len..(row + 1) * self.row_len;
        let re = self.re[range.clone()].iter_mut().zip(&other.re[range.clone()]);
        re.for_each(|(sum, value)| *sum += weight * value);
        let im = self.im[range.clone()].iter_mut().zip(&other.im[range]);
        im.for_each(|(sum, value)| *sum += weight * value);
    }

    /// The samples `[row][frequency]` without padding.
    pub(super) fn samples(&self, step_count: usize) -> Vec<Complex<f64>> {
        let rows = self.re.chunks_exact(self.row_len).zip(self.im.chunks_exact(self.row_len));
        rows.flat_map(|(re, im)| re.iter().zip(im).take(step_count))
            .map(|(re, im)| Complex::new(*re, *im))
            .collect()
    }
}
