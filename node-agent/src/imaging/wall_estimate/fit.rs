//! The echoes of a slab, fitted to the gated samples of all channels.
//!
//! Between antennas at a lateral distance `Δx`, the echo that crosses the slab `m` times to and fro
//! has the path of a straight way through its mirror images, by Fermat:
//! `max_p [p Δx + 2 s sqrt(1 − p²) + 2 m d sqrt(ε − p²)]` with the stand-off `s`: `m = 0` is the
//! front face, 1 the back face, 2 the first multiple. Each echo has a complex amplitude of its own
//! in each channel, so that antenna patterns, losses and the faces' reflection need no model;
//! amplitudes are eliminated by projection, and `[s, o, ε]`, `o = d sqrt ε`, is fitted by Levenberg
//! and Marquardt on what is left. With the noise power `σ²` its covariance is `σ²/2 (JᵀJ)⁻¹`, `J`
//! being the Jacobian of the projected residual \[golub-pereyra1973\].

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use proto::radar::{Array, SPEED_OF_LIGHT_M_PER_S, Wall};

use crate::imaging::wall::leg_path_m;

use super::DirectCoupling;
use super::gate::Gate;

/// Front face, back face, first multiple.
pub(super) const ECHO_COUNT: usize = 3;
/// Least and largest permittivity; air and more than wet concrete.
pub(super) const PERMITTIVITY_RANGE: [f64; 2] = [1.2, 20.0];
/// Thinnest slab, optical thickness in metres: a third of a range cell.
pub(super) const MIN_OPTICAL_THICKNESS_M: f64 = 0.1;
/// Steps of difference quotients: metres, metres, 1.
const DIFFERENCE_STEP: [f64; 3] = [1e-5, 1e-5, 1e-3];
/// Iterations of a fit; ten or so suffice.
const MAX_ITERATIONS: usize = 40;
/// A fit has converged when its residual falls by less than this share.
const RELATIVE_STOP: f64 = 1e-9;
/// Offsets that differ by less, metres, are the same.
const ALIKE_M: f64 = 1e-9;
/// An echo whose part across the others is shorter than this share adds nothing but rounding.
const MIN_INDEPENDENT_SHARE: f64 = 1e-6;

/// `[s, o, ε]`: stand-off and optical thickness in metres, permittivity.
pub(super) type Slab = Vector3<f64>;

/// The slab of thickness `d` for `[s, o, ε]`.
pub(super) fn wall_of(slab: &Slab) -> Wall {
    Wall { thickness_m: slab.y / slab.z.sqrt(), permittivity: slab.z }
}

/// The channels whose antennas are equally far apart, which see the slab alike.
struct Offset {
    lateral_m: f64,
    /// How far both antennas together stand before the array's line, metres.
    ahead_m: f64,
    direct: Option<DVector<f64>>,
    /// Real parts and imaginary parts of each channel.
    samples: Vec<DVector<f64>>,
}

/// The gated samples of all channels.
pub(super) struct Samples<'a> {
    gate: &'a Gate,
    offsets: Vec<Offset>,
    channel_count: usize,
    pull: Option<Pull>,
}

/// A permittivity known beforehand, as one more number of the residual, `weight (ε − known)`.
struct Pull {
    known: f64,
    /// Square root of `σ²/2` over the variance of `known`.
    weight: f64,
}

/// Fitted parameters and how sure they are.
#[derive(Clone, Debug)]
pub(super) struct Fit {
    pub(super) slab: Slab,
    /// Covariance of `slab`.
    pub(super) covariance: Matrix3<f64>,
    pub(super) residual_power: f64,
    /// How much of the power each echo alone explains, over the noise of all channels.
    pub(super) snr: [f64; ECHO_COUNT],
}

impl<'a> Samples<'a> {
    /// Gates `background`, `[channel][frequency]`.
    pub(super) fn new(
        gate: &'a Gate,
        array: &Array,
        direct: DirectCoupling,
        background: &[rustfft::num_complex::Complex<f32>],
    ) -> Self {
        let pairs = array.tx_m.iter().flat_map(|tx| array.rx_m.iter().map(move |rx| (tx, rx)));
        let channel_count = array.channel_count();
        let sweeps = background.chunks_exact(background.len() / channel_count);
        let mut offsets: Vec<Offset> = Vec::new();
        for ((tx, rx), sweep) in pairs.zip(sweeps) {
            let (lateral_m, ahead_m) = ((rx[0] - tx[0]).abs(), tx[1] + rx[1]);
            let delay_s = lateral_m.hypot(rx[1] - tx[1]) / SPEED_OF_LIGHT_M_PER_S;
            let samples = gate.pass(sweep);
            let alike = |known: &&mut Offset| {
                (known.lateral_m - lateral_m).hypot(known.ahead_m - ahead_m) < ALIKE_M
            };
            match offsets.iter_mut().find(alike) {
                Some(known) => known.samples.extend(samples),
                None => offsets.push(Offset {
                    lateral_m,
                    ahead_m,
                    direct: (direct == DirectCoupling::Present).then(|| gate.echo(delay_s)),
                    samples: samples.to_vec(),
                }),
            }
        }
        Self { gate, offsets, channel_count, pull: None }
    }

    /// The same samples with a permittivity `known` ± `sigma`; `fit` tells the noise.
    pub(super) fn with_permittivity(self, fit: &Fit, known: f64, sigma: f64) -> Self {
        let weight = (0.5 * fit.residual_power / self.freedom()).sqrt() / sigma;
        Self { pull: Some(Pull { known, weight }), ..self }
    }

    /// What is left of the samples after the best amplitudes of all echoes but `without`.
    fn residual(&self, slab: &Slab, without: Option<usize>) -> DVector<f64> {
        let mut all_left = Vec::with_capacity(2 * self.channel_count * self.gate.width() + 1);
        for offset in &self.offsets {
            let directions = self.directions(offset, slab, without);
            for samples in &offset.samples {
                all_left.extend(across(&directions, samples.clone()).iter());
            }
        }
        all_left.extend(self.pull.iter().map(|pull| pull.weight * (slab.z - pull.known)));
        DVector::from_vec(all_left)
    }

    /// Orthonormal vectors that span the echoes at one offset.
    fn directions(
        &self,
        offset: &Offset,
        slab: &Slab,
        without: Option<usize>,
    ) -> Vec<DVector<f64>> {
        let mut directions = Vec::with_capacity(ECHO_COUNT + 1);
        if let Some(direct) = &offset.direct {
            add_direction(&mut directions, direct.clone());
        }
        for echo in (0..ECHO_COUNT).filter(|echo| Some(*echo) != without) {
            let delay_s = offset.path_m(slab, echo) / SPEED_OF_LIGHT_M_PER_S;
            add_direction(&mut directions, self.gate.echo(delay_s));
        }
        directions
    }

    /// Power left by `slab`.
    pub(super) fn residual_power(&self, slab: &Slab) -> f64 {
        self.residual(slab, None).norm_squared()
    }

    /// The fit from `start` on, or `None` if it is not determined.
    pub(super) fn fit(&self, start: &Slab, bounds: &[Slab; 2]) -> Option<Fit> {
        let mut slab = *start;
        let mut residual = self.residual(&slab, None);
        let mut damping = 1e-3;
        for _ in 0..MAX_ITERATIONS {
            let jacobian = self.jacobian(&slab);
            let mut normal = jacobian.tr_mul(&jacobian);
            normal.set_diagonal(&(normal.diagonal() * (1.0 + damping)));
            let step = normal.cholesky()?.solve(&jacobian.tr_mul(&residual));
            let moved =
                (slab - Slab::new(step[0], step[1], step[2])).inf(&bounds[1]).sup(&bounds[0]);
            let moved_residual = self.residual(&moved, None);
            let fall = 1.0 - moved_residual.norm_squared() / residual.norm_squared();
            if 0.0 < fall {
                (slab, residual) = (moved, moved_residual);
                damping *= 0.2;
            } else {
                damping *= 8.0;
            }
            if fall.abs() < RELATIVE_STOP {
                break;
            }
        }
        self.finished(slab, residual.norm_squared())
    }

    fn finished(&self, slab: Slab, residual_power: f64) -> Option<Fit> {
        let noise_power = residual_power / self.freedom();
        let jacobian = self.jacobian(&slab);
        let information = Matrix3::from_iterator(jacobian.tr_mul(&jacobian).iter().copied());
        let covariance = information.try_inverse()? * (0.5 * noise_power);
        let noise = noise_power * self.channel_count as f64;
        let gain = |echo| self.residual(&slab, Some(echo)).norm_squared() - residual_power;
        let snr = std::array::from_fn(|echo| gain(echo) / noise.max(f64::MIN_POSITIVE));
        covariance.iter().all(|c| c.is_finite()).then_some(Fit {
            slab,
            covariance,
            residual_power,
            snr,
        })
    }

    /// Complex numbers that noise has left, less those that were fitted.
    fn freedom(&self) -> f64 {
        let left_count = |offset: &Offset| {
            let fitted_count = ECHO_COUNT + usize::from(offset.direct.is_some());
            // Each channel has two entries and complex numbers count once.
            0.5 * (offset.samples.len() * self.gate.width().saturating_sub(fitted_count)) as f64
        };
        (self.offsets.iter().map(left_count).sum::<f64>() - 1.5).max(1.0)
    }

    /// `∂ residual / ∂ [s, o, ε]` by central differences.
    fn jacobian(&self, slab: &Slab) -> DMatrix<f64> {
        let column = |index: usize| {
            let step = DIFFERENCE_STEP[index];
            let shifted = |by: f64| {
                let mut moved = *slab;
                moved[index] += by;
                self.residual(&moved, None)
            };
            (shifted(step) - shifted(-step)) / (2.0 * step)
        };
        DMatrix::from_columns(&[0, 1, 2].map(column))
    }
}

impl Offset {
    /// Path of the echo that crosses the slab `crossings` times to and fro, metres.
    fn path_m(&self, slab: &Slab, crossings: usize) -> f64 {
        let air_m = 2.0 * slab.x - self.ahead_m;
        let Wall { thickness_m, permittivity } = wall_of(slab);
        let slab_m = 2.0 * crossings as f64 * thickness_m;
        let mirrored = Wall { thickness_m: slab_m, permittivity };
        leg_path_m(self.lateral_m, air_m + slab_m, Some(&mirrored))
    }
}

/// The part of `vector` across orthonormal `directions`.
fn across(directions: &[DVector<f64>], mut vector: DVector<f64>) -> DVector<f64> {
    for direction in directions {
        vector.axpy(-direction.dot(&vector), direction, 1.0);
    }
    vector
}

/// Adds the part of `vector` across `directions`, made a unit vector.
fn add_direction(directions: &mut Vec<DVector<f64>>, vector: DVector<f64>) {
    let whole = vector.norm();
    let new = across(directions, vector);
    let length = new.norm();
    if MIN_INDEPENDENT_SHARE * whole < length {
        directions.push(new / length);
    }
}
