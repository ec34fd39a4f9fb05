//! Random numbers that depend on nothing but a seed and what they are for.

use std::f64::consts::FRAC_1_SQRT_2;

use rand::{SeedableRng, rngs::ChaCha8Rng};
use rand_distr::{Distribution, StandardNormal};
use rustfft::num_complex::Complex;

/// What a stream of random numbers is for.
#[derive(Clone, Copy)]
pub(super) enum Purpose {
    Noise = 0,
    Missed = 1,
    False = 2,
    BodyShape = 3,
    BodyGain = 4,
    BodyFading = 5,
    Sway = 6,
    Coupling = 7,
    CommonPhase = 8,
    ChannelPhase = 9,
    PhaseWalk = 10,
    GainDrift = 11,
}

/// When a sweep is taken: all that its random numbers may depend on besides the seed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moment {
    pub(super) period_index: u64,
    pub(super) time_s: f64,
}

/// All random numbers of one node.
#[derive(Clone, Copy, Debug)]
pub(super) struct Streams {
    seed: u64,
}

impl Streams {
    pub(super) fn new(seed: u64) -> Self {
        Self { seed }
    }

    /// The stream for `purpose`; `index` is a target, a channel or the like, below 2^16, and
    /// `period_index` a period or another number below 2^44.
    pub(super) fn rng(&self, purpose: Purpose, index: usize, period_index: u64) -> ChaCha8Rng {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let low = ((index as u64) & 0xffff) << 4;
        rng.set_stream((period_index << 20) | low | purpose as u64);
        rng
    }

    /// One normal number of mean 0 and variance 1.
    pub(super) fn normal(&self, purpose: Purpose, index: usize, period_index: u64) -> f64 {
        StandardNormal.sample(&mut self.rng(purpose, index, period_index))
    }
}

/// A circular complex Gaussian number of power 1.
pub(super) fn gaussian(rng: &mut ChaCha8Rng) -> Complex<f64> {
    let (re, im): (f64, f64) = (StandardNormal.sample(rng), StandardNormal.sample(rng));
    Complex::new(re, im) * FRAC_1_SQRT_2
}
