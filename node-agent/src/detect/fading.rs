//! Whether anything moves at the place of a point, or whether it is the shadow of one that left.
//!
//! With the coherent sums `I_k` at the place over the last seconds, drift of the radio undone, noise
//! power `N σ²`: `V = Σ_k |I_k − mean I|² / ((n − 1) N σ²)` is 1 with a standard deviation of
//! `1 / sqrt(n − 1)` if nothing moves, whatever stands there. A living person turns the phase by
//! `4π / λ` times his motion: `V − 1 ≈ SNR_I · var(phase)`; 2.5 mm of breathing are 0.2 rad, a
//! variance of 0.02. A shadow in an old background, `SNR_I` strong, has `V ≈ 1`.
//!
//! Between two breaths `V` may sink to 1. A place stays alive for a breath where the background was
//! learned before anyone came: there are no shadows. The range gates of what lives are held, because
//! this test is finer than that of the gates by the number of channels.

use crate::imaging::{double, from_db};
use std::f64::consts::TAU;

use nalgebra::Vector2;
use rustfft::num_complex::Complex;

use proto::measured::MeasuredPoint;
use proto::radar::{Array, Band, SPEED_OF_LIGHT_M_PER_S};

use crate::imaging::canceller::slow_fast::SlowFast;
use crate::imaging::wall::WallModel;

/// Standard deviations of `V` above 1 that noise does not reach.
const NOISE_SIGMAS: f64 = 4.0;
/// Least `(V − 1) / SNR_I` of a living person: half of what 2.5 mm of breathing give.
const MIN_MOTION: f64 = 0.01;
/// The same where the background may hold somebody who was there when it was learned: walking gives
/// about half. Breathing is not enough there, because the sidelobes of a walker at the same range
/// vary as much over a shadow.
const MIN_MOTION_UNTRUSTED: f64 = 0.2;
/// A background learned for so long in quiet, in `T_fast`, holds nobody who moves.
const KNOWN_FAST_TIMES: f64 = 1.0;
/// With fewer frames nothing is said against a point.
const MIN_FRAMES: usize = 4;
/// One breath, in `T_fast`.
const BREATH_FAST_TIMES: f64 = 4.0;
/// A background learned for this long, in `T_fast`, is that of the room.
const TRUSTED_FAST_TIMES: f64 = 3.0;
/// A point this near to where something lived is the same, metres: one that stands and sways.
const SAME_PLACE_M: f64 = 0.4;

/// The geometry of coherent sums.
#[derive(Clone, Debug)]
pub struct Focus {
    array: Array,
    wall: WallModel,
    carrier_hz: f64,
}

impl Focus {
    /// For one radar and wall.
    #[must_use]
    pub fn new(band: &Band, array: &Array, wall: &WallModel) -> Self {
        Self { array: array.clone(), wall: *wall, carrier_hz: band.carrier_hz() }
    }

    /// Where the place of `point` is in profiles of `sample_rate_hz`.
    #[must_use]
    pub fn looks(&self, point: &MeasuredPoint, sample_rate_hz: f64) -> Looks {
        let place_m = Vector2::new(point.x_m, point.y_m);
        let look = |path_m: f64| {
            let delay_s = path_m / SPEED_OF_LIGHT_M_PER_S;
            (delay_s * sample_rate_hz, Complex::cis(TAU * self.carrier_hz * delay_s))
        };
        let paths_m = self.wall.channel_paths_m(&self.array, &place_m);
        Looks { of_channel: paths_m.into_iter().map(look).collect() }
    }
}

/// A place as the channels see it: where in each one's profile, in samples, and its carrier phasor.
#[derive(Clone, Debug)]
pub struct Looks {
    of_channel: Vec<(f64, Complex<f64>)>,
}

impl Looks {
    /// The mean delay of the channels, in whole samples.
    #[expect(clippy::cast_possible_truncation, reason = "some thousand samples")]
    fn mean_delay(&self) -> usize {
        let total: f64 = self.of_channel.iter().map(|(delay, _)| delay).sum();
        (total / self.of_channel.len() as f64).clamp(0.0, 1e9) as usize
    }

    /// Whether something moved there lately, `None` if too few sweeps tell, for a point of `snr_db`.
    #[must_use]
    pub fn is_live(&self, seen: &SlowFast, snr_db: f64) -> Option<bool> {
        let may_hold_somebody =
            seen.learned_s(self.mean_delay()) < KNOWN_FAST_TIMES * seen.fast_s();
        let min_motion = if may_hold_somebody { MIN_MOTION_UNTRUSTED } else { MIN_MOTION };
        let sums: Vec<Complex<f64>> =
            seen.history().frames().map(|(_, samples)| self.coherent_sum(samples)).collect();
        let noise = seen.history_noise_power();
        if sums.len() < MIN_FRAMES || noise <= 0.0 {
            return None;
        }
        let degrees = (sums.len() - 1) as f64;
        let excess = variance(&sums) / noise - 1.0;
        Some((NOISE_SIGMAS / degrees.sqrt()).max(min_motion * from_db(snr_db)) < excess)
    }

    /// The sum over all channels, interpolated linearly; beyond the profiles there is nothing.
    #[expect(clippy::cast_possible_truncation, reason = "the whole part is meant")]
    fn coherent_sum(&self, samples: &[Complex<f32>]) -> Complex<f64> {
        let sample_count = samples.len() / self.of_channel.len().max(1);
        let of_channel = |(channel, (delay, phasor)): (usize, &(f64, Complex<f64>))| {
            let (index, weight) = (delay.max(0.0) as usize, delay.max(0.0).fract());
            if sample_count < index + 2 {
                return Complex::default();
            }
            let [a, b] = [0, 1].map(|step| double(samples[channel * sample_count + index + step]));
            (a + (b - a) * weight) * phasor
        };
        self.of_channel.iter().enumerate().map(of_channel).sum()
    }
}

/// What lives, and where it did lately.
#[derive(Clone, Debug)]
pub struct Living {
    focus: Focus,
    seen_alive: Vec<Place>,
}

/// Where something lived and when.
#[derive(Clone, Copy, Debug)]
struct Place {
    coords_m: Vector2<f64>,
    time_s: f64,
}

impl Living {
    /// For one radar and wall.
    #[must_use]
    pub fn new(focus: Focus) -> Self {
        Self { focus, seen_alive: Vec::new() }
    }

    /// Keeps of `points`, measured at `time_s`, those at whose place something moves, and holds
    /// their range gates; `sample_rate_hz` is that of the profiles `seen`.
    pub fn keep_living(
        &mut self,
        points: &mut Vec<MeasuredPoint>,
        time_s: f64,
        seen: &mut SlowFast,
        sample_rate_hz: f64,
    ) {
        let breath_s = BREATH_FAST_TIMES * seen.fast_s();
        self.seen_alive.retain(|place| (0.0..=breath_s).contains(&(time_s - place.time_s)));
        points.retain(|point| {
            let coords_m = Vector2::new(point.x_m, point.y_m);
            let looks = self.focus.looks(point, sample_rate_hz);
            let (moves, delay) = (looks.is_live(seen, point.snr_db), looks.mean_delay());
            let trusted = TRUSTED_FAST_TIMES * seen.fast_s() <= seen.learned_s(delay);
            if moves == Some(true) {
                self.remember(Place { coords_m, time_s });
                seen.hold(delay, time_s + breath_s, sample_rate_hz);
            }
            moves.unwrap_or(true) || (trusted && self.lived(&coords_m))
        });
    }

    fn lived(&self, coords_m: &Vector2<f64>) -> bool {
        self.seen_alive.iter().any(|place| (place.coords_m - coords_m).norm() < SAME_PLACE_M)
    }

    /// One place for each spot: the newest one.
    fn remember(&mut self, newest: Place) {
        let apart = |place: &Place| SAME_PLACE_M < (place.coords_m - newest.coords_m).norm();
        self.seen_alive.retain(apart);
        self.seen_alive.push(newest);
    }
}

/// `Σ |z − mean|² / (n − 1)`; 0 for fewer than two.
fn variance(values: &[Complex<f64>]) -> f64 {
    let count = values.len() as f64;
    let mean = values.iter().sum::<Complex<f64>>() / count.max(1.0);
    values.iter().map(|z| (z - mean).norm_sqr()).sum::<f64>() / (count - 1.0).max(1.0)
}

#[cfg(test)]
mod tests;
