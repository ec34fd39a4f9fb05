//! Profiles as piecewise parabolas, laid out for the kernels.
//!
//! An interval spans two samples of the profile. Through its values `v0, v1, v2` at 0, 1/2 and 1 goes
//! `c0 + w (c1 + w c2)`, `c0 = v0`, `c1 = −3 v0 + 4 v1 − v2`, `c2 = 2 v0 − 4 v1 + 2 v2`, `w = 0 .. 1`.
//! The error at angular frequency `ω` from the carrier is `(ω h)³ / (72 sqrt 3)` for intervals of `h`
//! seconds: −56 dB over a rectangular band of 600 MHz at `h = 0.49 ns` (2048 delay samples).

use rustfft::num_complex::Complex;

use super::tables::Four;
#[cfg(target_arch = "x86_64")]
use super::tables::{Eight, Lanes, Sixteen};
use crate::imaging::compress::Profiles;

/// Planes of coefficients: `c0 re, c0 im, c1 re, c1 im, c2 re, c2 im`.
#[cfg(target_arch = "x86_64")]
const PLANE_COUNT: usize = 6;

/// The coefficients of one interval: the planes, and two zeros to fill 32 bytes.
pub(super) type Interval = [f32; 8];

/// One interval for the kernel that sums truncated powers: every number in all lanes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece {
    /// `c0 re, c0 im, c1 re, c1 im, c2 re, c2 im`.
    pub(super) parabola: [Four; 6],
    /// By how much the slope and the curvature change where the interval begins:
    /// `b1 re, b1 im, b2 re, b2 im`.
    pub(super) bend: [Four; 4],
}

impl Piece {
    const ZERO: Self = Self { parabola: [Four([0.0; 4]); 6], bend: [Four([0.0; 4]); 4] };

    /// The piece of `interval`, which follows `before`.
    fn new(before: &Interval, interval: &Interval) -> Self {
        let everywhere = |value: f32| Four([value; 4]);
        let [.., old1_re, old1_im, old2_re, old2_im, _, _] = *before;
        let [_, _, new1_re, new1_im, new2_re, new2_im, _, _] = *interval;
        let bend = [
            new1_re - (old1_re + 2.0 * old2_re),
            new1_im - (old1_im + 2.0 * old2_im),
            new2_re - old2_re,
            new2_im - old2_im,
        ];
        let parabola = std::array::from_fn(|plane| everywhere(interval[plane]));
        Self { parabola, bend: bend.map(everywhere) }
    }
}

/// The coefficients of as many intervals as a register has lanes, plane by plane.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(super) struct Window<V> {
    pub(super) planes: [V; PLANE_COUNT],
}

#[cfg(target_arch = "x86_64")]
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
#[cfg(target_arch = "x86_64")]
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
    pub(super) pieces: Vec<Piece>,
    #[cfg(target_arch = "x86_64")]
    eight: Vec<Window<Eight>>,
    #[cfg(target_arch = "x86_64")]
    sixteen: Vec<Window<Sixteen>>,
}

/// Lanes with a place of their own in [`Coefficients`].
#[cfg(target_arch = "x86_64")]
pub(super) trait Windowed: Lanes {
    fn windows(coefficients: &Coefficients) -> &[Window<Self>];
    fn windows_mut(coefficients: &mut Coefficients) -> &mut Vec<Window<Self>>;
}

#[cfg(target_arch = "x86_64")]
impl Windowed for Eight {
    fn windows(coefficients: &Coefficients) -> &[Window<Self>] {
        &coefficients.eight
    }
    fn windows_mut(coefficients: &mut Coefficients) -> &mut Vec<Window<Self>> {
        &mut coefficients.eight
    }
}

#[cfg(target_arch = "x86_64")]
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

    /// Fills `pieces` with the first `count` intervals of every channel.
    pub(super) fn fill_pieces(&mut self, profiles: &Profiles, count: usize) {
        self.fill_intervals(profiles, count);
        self.pieces.resize(self.intervals.len(), Piece::ZERO);
        let channels = self.intervals.chunks_exact(count);
        for (pieces, intervals) in self.pieces.chunks_exact_mut(count).zip(channels) {
            // No group begins before the profile: the first bend is never read.
            let mut before = &intervals[0];
            for (piece, interval) in pieces.iter_mut().zip(intervals) {
                *piece = Piece::new(before, interval);
                before = interval;
            }
        }
    }

    /// Fills the windows of every channel.
    #[cfg(target_arch = "x86_64")]
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
