//! The mean of many sweeps.

use rustfft::num_complex::Complex;

use crate::imaging::{double, single_complex};

/// Sums sweeps up in double precision.
#[derive(Clone, Debug, Default)]
pub(crate) struct SweepMean {
    sum: Vec<Complex<f64>>,
    count: f64,
}

impl SweepMean {
    /// Takes a sweep in; all have the same length.
    pub(crate) fn add(&mut self, samples: &[Complex<f32>]) {
        self.sum.resize(samples.len(), Complex::default());
        for (total, sample) in self.sum.iter_mut().zip(samples) {
            *total += double(*sample);
        }
        self.count += 1.0;
    }

    /// The mean; empty if there was no sweep.
    pub(crate) fn mean(&self) -> Vec<Complex<f32>> {
        self.sum.iter().map(|total| single_complex(total / self.count)).collect()
    }
}
