//! Profiles as piecewise parabolas, laid out for the kernels.
//!
//! An interval spans two samples of the profile. Through its values `v0, v1, v2` at 0, 1/2 and 1 goes
//! `c0 + w (c1 + w c2)`, `c0 = v0`, `c1 = −3 v0 + 4 v1 − v2`, `c2 = 2 v0 − 4 v1 + 2 v2`, `w = 0 .. 1`.
//! The error at angular frequency `ω` from the carrier is `(ω h)³ / (72 sqrt 3)` for intervals of `h`
//! seconds: −56 dB over a rectangular band of 600 MHz at `h = 0.49 ns` (2048 delay samples).

use rustfft::num_complex::Complex;

use super::tables::{Eight, Lanes, Sixteen};
use crate::imaging::compress::Profiles;

/// Planes of coefficients: `c0 re, c0 im, c1 re, c1 im, c2 re, c2 im`.
const PLANE_COUNT: usize = 6;

/// The coefficients of one interval: the planes, and two zeros to fill 32 bytes.
pub(super) type Interval = [f32; 8];

/// The coefficients of as many intervals as a register has lanes, plane by plane.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(super) struct Window<V> {
    pub(super) planes: [V; PLANE_COUNT],
}

impl<V: Lanes> Window<V> {
    fn fill(&mut self, intervals: &[Interval]) {
        for (lane, interval) in intervals.iter().enumerate() {
            for (plane, value) in self.planes.iter_mut().zip(interval) {
                plane.as_mut_slice()[lane] = *value;
            }
        }
    }
}

/// Which intervals a kernel reads.
#[derive(Clone, Copy, Debug)]
pub(super) struct Span {
    /// Intervals, or windows, of one channel.
    pub(super) count: usize,
    /// From one window to the next, in intervals.
    pub(super) stride: usize,
}

/// The coefficients of all channels; each kernel fills and reads one of these.
#[derive(Clone, Debug, Default)]
pub(super) struct Coefficients {
    pub(super) intervals: Vec<Interval>,
    eight: Vec<Window<Eight>>,
    sixteen: Vec<Window<Sixteen>>,
}

/// Lanes with a place of their own in [`Coefficients`].
pub(super) trait Windowed: Lanes {
    fn windows(coefficients: &Coefficients) -> &[Window<Self>];
    fn windows_mut(coefficients: &mut Coefficients) -> &mut Vec<Window<Self>>;
}

impl Windowed for Eight {
    fn windows(coefficients: &Coefficients) -> &[Window<Self>] {
        &coefficients.eight
    }
    fn windows_mut(coefficients: &mut Coefficients) -> &mut Vec<Window<Self>> {
        &mut coefficients.eight
    }
}

impl Windowed for Sixteen {
    fn windows(coefficients: &Coefficients) -> &[Window<Self>] {
        &coefficients.sixteen
    }
    fn windows_mut(coefficients: &mut Coefficients) -> &mut Vec<Window<Self>> {
        &mut coefficients.sixteen
    }
}

impl Coefficients {
    /// Fills `intervals` with the first `count` intervals of every channel.
    pub(super) fn fill_intervals(&mut self, profiles: &Profiles, count: usize) {
        let channel_count = profiles.samples.len() / profiles.sample_count;
        self.intervals.resize(channel_count * count, [0.0; 8]);
        for (intervals, profile) in self.intervals.chunks_exact_mut(count).zip(profiles.channels())
        {
            for (interval, values) in intervals.iter_mut().zip(triples(profile)) {
                *interval = parabola(values);
            }
        }
    }

    /// Fills the windows of every channel.
    pub(super) fn fill_windows<V: Windowed>(&mut self, profiles: &Profiles, span: Span) {
        let Span { count, stride } = span;
        self.fill_intervals(profiles, (count - 1) * stride + V::COUNT);
        // Out of its place for a moment, so that both can be borrowed.
        let mut windows = std::mem::take(V::windows_mut(self));
        let channel_count = profiles.samples.len() / profiles.sample_count;
        windows.resize(channel_count * count, Window { planes: [V::ZERO; PLANE_COUNT] });
        let channels = self.intervals.chunks_exact((count - 1) * stride + V::COUNT);
        for (of_channel, intervals) in windows.chunks_exact_mut(count).zip(channels) {
            for (index, window) in of_channel.iter_mut().enumerate() {
                window.fill(&intervals[index * stride..][..V::COUNT]);
            }
        }
        *V::windows_mut(self) = windows;
    }
}

/// The values at 0, 1/2 and 1 of each interval; beyond the profile there are none.
fn triples(profile: &[Complex<f32>]) -> impl Iterator<Item = [Complex<f32>; 3]> {
    profile.windows(3).step_by(2).map(|v| [v[0], v[1], v[2]])
}

fn parabola([v0, v1, v2]: [Complex<f32>; 3]) -> Interval {
    let c1 = v1 * 4.0 - v0 * 3.0 - v2;
    let c2 = (v0 + v2) * 2.0 - v1 * 4.0;
    [v0.re, v0.im, c1.re, c1.im, c2.re, c2.im, 0.0, 0.0]
}
