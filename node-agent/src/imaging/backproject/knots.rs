//! The kernel for every processor where neighbouring pixels are closer than a few intervals.
//!
//! The profile around a group of pixels is one sum without look-up. With the intervals from the
//! group's first on and the delay `x ≥ 0` from there, in intervals:
//! `s(x) = c0 + x (c1 + x c2) + Σ_{k=1..K} m_k (b1_k + m_k b2_k)`, `m_k = max(x − k, 0)`, where
//! `c` is the parabola of the first interval, and `b1`, `b2` are the changes of slope and curvature
//! from interval `k − 1` to `k`: the truncated powers of a continuous spline \[deboor1978\]. Assumes
//! `x < K + 1`. All pixels of a group read the same numbers, so that four lanes vectorise anywhere.
//! Cost for a group and channel: `4 + 6 K` products and sums of complex and real numbers.

use std::ops::Range;

use super::coefficients::{Coefficients, Piece};
use super::tables::{Eight, Four, Group, Leg, Tables};
use super::{Engine, Output};
use crate::imaging::compress::Profiles;

/// Pixels of a group: the lanes of the narrowest registers in use, SSE2 and NEON.
const LANES: usize = 4;
/// Most knots in a group: with more, a look-up costs less.
const MAX_KNOT_COUNT: usize = 3;

/// Carrier phasor of one leg.
#[derive(Clone, Copy, Debug)]
struct Turn {
    cos: Four,
    sin: Four,
}

/// The kernel with its tables, `[row][group]`.
#[derive(Debug)]
pub(super) struct Knots {
    tx_count: usize,
    rx_count: usize,
    column_count: usize,
    group_count: usize,
    interval_count: usize,
    /// `[leg]`, transmitters before receivers.
    turns: Vec<Turn>,
    /// Delays beyond the first interval, in intervals, `[t · rx_count + r]`.
    delays: Vec<Four>,
    /// First intervals, `[t · rx_count + r]`.
    firsts: Vec<u32>,
    /// Knots that some channel of each group passes.
    knot_counts: Vec<u8>,
}

impl Knots {
    /// The kernel for `tables`, whose bases count single intervals; `None` if the delays of
    /// neighbouring pixels differ by too much.
    pub(super) fn new(tables: &Tables<Eight>) -> Option<Self> {
        let rx_count = tables.leg_count - tables.tx_count;
        let group_count = 2 * tables.row_count * tables.group_count;
        let mut kernel = Self {
            tx_count: tables.tx_count,
            rx_count,
            column_count: tables.column_count,
            group_count: 2 * tables.group_count,
            interval_count: 0,
            turns: Vec::with_capacity(2 * tables.legs.len()),
            delays: Vec::with_capacity(group_count * tables.tx_count * rx_count),
            firsts: Vec::with_capacity(group_count * tables.tx_count * rx_count),
            knot_counts: Vec::with_capacity(group_count),
        };
        for index in 0..tables.row_count * tables.group_count {
            let group = tables.group(index);
            for from in [0, LANES] {
                kernel.push(&group, from)?;
            }
        }
        Some(kernel)
    }

    /// Adds the pixels of `group` from lane `from` on.
    fn push(&mut self, group: &Group<'_, Eight>, from: usize) -> Option<()> {
        let turn = |leg: &Leg<Eight>| Turn {
            cos: Four::of(&leg.cos.0[from..]),
            sin: Four::of(&leg.sin.0[from..]),
        };
        self.turns.extend(group.tx.iter().chain(group.rx).map(turn));
        let mut knot_count = 0;
        for (tx, tx_base) in group.tx.iter().zip(group.tx_bases) {
            for (rx, rx_base) in group.rx.iter().zip(group.rx_bases) {
                let sum = |lane: usize| tx.relative.0[from + lane] + rx.relative.0[from + lane];
                let sums: [f32; LANES] = std::array::from_fn(sum);
                let shortest = sums.iter().fold(f32::INFINITY, |a, b| a.min(*b)).floor();
                let rest = sums.map(|delay| delay - shortest);
                let longest = rest.iter().fold(0.0, |a: f32, b| a.max(*b));
                knot_count = knot_count.max(whole(longest));
                let first = tx_base + rx_base + whole(shortest);
                self.delays.push(Four(rest));
                self.firsts.push(first);
                let needed_count = first as usize + MAX_KNOT_COUNT + 1;
                self.interval_count = self.interval_count.max(needed_count);
            }
        }
        self.knot_counts.push(u8::try_from(knot_count).ok()?);
        (knot_count as usize <= MAX_KNOT_COUNT).then_some(())
    }

    /// `|I|²` and `E` of group number `index`, which no channel sees beyond `K` knots.
    #[inline(always)]
    fn sums<const K: usize>(&self, index: usize, pieces: &[Piece]) -> [[f32; LANES]; 2] {
        let (leg_count, channel_count) =
            (self.tx_count + self.rx_count, self.tx_count * self.rx_count);
        let (tx, rx) = self.turns[index * leg_count..][..leg_count].split_at(self.tx_count);
        let span = index * channel_count..(index + 1) * channel_count;
        let delays = self.delays[span.clone()].iter().zip(&self.firsts[span]);
        let mut channels = delays.zip(pieces.chunks_exact(self.interval_count));
        let (mut sum, mut energy) = ([[0.0; LANES]; 2], [0.0; LANES]);
        for tx_turn in tx {
            let mut tx_sum = [[0.0; LANES]; 2];
            for (rx_turn, ((delay, first), profile)) in rx.iter().zip(&mut channels) {
                let start = *first as usize;
                let sample = sample::<K>(*delay, &profile[start..=start + K]);
                let [re, im] = sample;
                energy = mul_add(re, re, mul_add(im, im, energy));
                add_rotated(&mut tx_sum, sample, rx_turn);
            }
            add_rotated(&mut sum, tx_sum, tx_turn);
        }
        let [re, im] = sum;
        [mul_add(re, re, mul_add(im, im, [0.0; LANES])), energy]
    }
}

impl Engine for Knots {
    fn prepare(&self, profiles: &Profiles, coefficients: &mut Coefficients) {
        coefficients.fill_pieces(profiles, self.interval_count);
    }

    fn project(&self, coefficients: &Coefficients, rows: Range<usize>, output: &mut Output<'_>) {
        let pieces = &coefficients.pieces;
        let planes = output
            .power
            .chunks_exact_mut(self.column_count)
            .zip(output.energy.chunks_exact_mut(self.column_count));
        for (row, (power, energy)) in rows.zip(planes) {
            let outputs = power.chunks_mut(LANES).zip(energy.chunks_mut(LANES));
            for (index, (to_power, to_energy)) in (row * self.group_count..).zip(outputs) {
                let [p, e] = match self.knot_counts[index] {
                    0 | 1 => self.sums::<1>(index, pieces),
                    2 => self.sums::<2>(index, pieces),
                    _ => self.sums::<MAX_KNOT_COUNT>(index, pieces),
                };
                to_power.copy_from_slice(&p[..to_power.len()]);
                to_energy.copy_from_slice(&e[..to_energy.len()]);
            }
        }
    }

    fn interval_count(&self) -> usize {
        self.interval_count
    }

    fn name(&self) -> &'static str {
        "portable"
    }
}

/// Rounded down.
#[expect(clippy::cast_possible_truncation, reason = "a delay of at most some thousand intervals")]
fn whole(intervals: f32) -> u32 {
    intervals as u32
}

/// `s(x)`, real and imaginary part, over the intervals of `pieces`.
#[inline(always)]
fn sample<const K: usize>(Four(x): Four, pieces: &[Piece]) -> [[f32; LANES]; 2] {
    let [c0_re, c0_im, c1_re, c1_im, c2_re, c2_im] = &pieces[0].parabola;
    let mut re = mul_add(mul_add(c2_re.0, x, c1_re.0), x, c0_re.0);
    let mut im = mul_add(mul_add(c2_im.0, x, c1_im.0), x, c0_im.0);
    for (k, piece) in pieces.iter().enumerate().take(K + 1).skip(1) {
        let beyond = x.map(|delay| (delay - k as f32).max(0.0));
        let [b1_re, b1_im, b2_re, b2_im] = &piece.bend;
        re = mul_add(mul_add(b2_re.0, beyond, b1_re.0), beyond, re);
        im = mul_add(mul_add(b2_im.0, beyond, b1_im.0), beyond, im);
    }
    [re, im]
}

/// `a b + c`, rounded twice: without the instruction for it, rounding once takes a library call.
#[inline(always)]
fn mul_add(a: [f32; LANES], b: [f32; LANES], c: [f32; LANES]) -> [f32; LANES] {
    std::array::from_fn(|lane| a[lane] * b[lane] + c[lane])
}

/// Adds `P z`, `P = cos + j sin`, to `sum`.
#[inline(always)]
fn add_rotated(sum: &mut [[f32; LANES]; 2], [re, im]: [[f32; LANES]; 2], turn: &Turn) {
    let Turn { cos: Four(cos), sin: Four(sin) } = *turn;
    for lane in 0..LANES {
        sum[0][lane] += re[lane] * cos[lane] - im[lane] * sin[lane];
        sum[1][lane] += re[lane] * sin[lane] + im[lane] * cos[lane];
    }
}

#[cfg(test)]
mod tests {
    use super::super::Means;
    use super::super::portable::{Portable, Scratch};
    use super::super::tables::Geometry;
    use super::*;
    use crate::imaging::pixels::Pixels;
    use crate::imaging::wall::WallModel;
    use proto::radar::{Array, Band, Grid};
    use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};
    use rustfft::num_complex::Complex;

    /// Samples without any band limit bend ten times as much as those of a sweep: single precision
    /// leaves this much of their root mean square.
    const ROUNDING: f32 = 1e-4;

    fn tables(pixel_m: f64, row_count: usize) -> Tables<Eight> {
        let grid = Grid { x_min_m: -5.0, y_min_m: 0.4, pixel_m, column_count: 61, row_count };
        let (band, array) = (&Band::default(), &Array::default());
        let pixels = &Pixels::Cartesian(grid);
        let geometry = Geometry { band, array, pixels, wall: &WallModel::None, fft_length: 2048 };
        Tables::new(&geometry)
    }

    fn planes(engine: &dyn Engine, profiles: &Profiles, row_count: usize) -> [Vec<f32>; 2] {
        let mut coefficients = Coefficients::default();
        engine.prepare(profiles, &mut coefficients);
        let [mut power, mut energy] = [vec![0.0; 61 * row_count], vec![0.0; 61 * row_count]];
        let scratch = &mut Scratch::default();
        let (coherence, rows) = (&mut [][..], 0..row_count);
        let mut output = Output { power: &mut power, energy: &mut energy, coherence, scratch };
        engine.project(&coefficients, rows, &mut output);
        [power, energy]
    }

    #[test]
    fn truncated_powers_are_what_a_look_up_gives_for_one_two_and_three_knots() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let mut draw = || Complex::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0));
        let samples = (0..8 * 2048).map(|_| draw()).collect();
        let profiles = Profiles { sample_count: 2048, sample_rate_hz: 1.0, samples };
        let mut seen = [false; MAX_KNOT_COUNT + 1];
        for pixel_m in [0.005, 0.03, 0.055] {
            let tables = tables(pixel_m, 20);
            let kernel = Knots::new(&tables).unwrap();
            kernel.knot_counts.iter().for_each(|count| seen[usize::from(*count)] = true);
            let got = planes(&kernel, &profiles, 20);
            let want = planes(&Portable::new(tables, 400, &Means::default()), &profiles, 20);
            for (plane, exact) in got.iter().zip(&want) {
                let mean_square = exact.iter().map(|v| v * v).sum::<f32>() / exact.len() as f32;
                let off = plane.iter().zip(exact).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(off < ROUNDING * mean_square.sqrt(), "{pixel_m} m: {off}");
            }
        }
        assert_eq!(seen[1..], [true; MAX_KNOT_COUNT]);
    }

    #[test]
    fn pixels_far_apart_are_left_to_the_look_up() {
        assert!(Knots::new(&tables(0.2, 2)).is_none());
    }
}
