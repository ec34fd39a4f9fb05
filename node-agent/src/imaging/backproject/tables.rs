//! The geometry of an image: delay and carrier phasor of every leg at every pixel, in processing order.
//!
//! Pixels along a row are taken in groups of as many as a register has lanes. The delay of a leg in
//! one group, in intervals of the profile, is `base + relative`: a whole number for the group and a
//! small rest for each pixel, so that single precision loses nothing. Legs stay separate: `T + R`
//! entries per group serve `T · R` channels with any wall.

use std::f64::consts::TAU;
use std::fmt;
use std::ops::Range;

use nalgebra::Vector2;
use rayon::prelude::*;

use proto::radar::{Array, Band, SPEED_OF_LIGHT_M_PER_S};

use crate::imaging::pixels::Pixels;
use crate::imaging::single;
use crate::imaging::wall::WallModel;

/// Numbers that one register holds.
pub(super) trait Lanes: Copy + fmt::Debug + Send + Sync + 'static {
    /// How many.
    const COUNT: usize;
    /// All zero.
    const ZERO: Self;
    fn as_slice(&self) -> &[f32];
    fn as_mut_slice(&mut self) -> &mut [f32];
}

/// Four numbers, aligned as a register of 128 bits is.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(16))]
pub(super) struct Four(pub(super) [f32; 4]);

impl Four {
    /// The first four of `values`.
    pub(super) fn of(values: &[f32]) -> Self {
        Self(std::array::from_fn(|lane| values[lane]))
    }
}

/// Eight numbers, aligned as a register of 256 bits is.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(32))]
pub(super) struct Eight(pub(super) [f32; 8]);

/// Sixteen numbers, aligned as a register of 512 bits is.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Sixteen(pub(super) [f32; 16]);

impl Lanes for Eight {
    const COUNT: usize = 8;
    const ZERO: Self = Self([0.0; 8]);
    #[inline(always)]
    fn as_slice(&self) -> &[f32] {
        &self.0
    }
    #[inline(always)]
    fn as_mut_slice(&mut self) -> &mut [f32] {
        &mut self.0
    }
}

#[cfg(target_arch = "x86_64")]
impl Lanes for Sixteen {
    const COUNT: usize = 16;
    const ZERO: Self = Self([0.0; 16]);
    #[inline(always)]
    fn as_slice(&self) -> &[f32] {
        &self.0
    }
    #[inline(always)]
    fn as_mut_slice(&mut self) -> &mut [f32] {
        &mut self.0
    }
}

/// One leg in one group of pixels.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub(super) struct Leg<V> {
    /// Delay beyond the base, in intervals.
    pub(super) relative: V,
    /// `cos 2π f_c τ`.
    pub(super) cos: V,
    /// `sin 2π f_c τ`.
    pub(super) sin: V,
}

/// What the tables of an image follow from.
#[derive(Clone, Copy, Debug)]
pub struct Geometry<'a> {
    /// Frequencies of a sweep.
    pub band: &'a Band,
    /// Antennas.
    pub array: &'a Array,
    /// Pixels of the image.
    pub pixels: &'a Pixels,
    /// The wall before the array.
    pub wall: &'a WallModel,
    /// Delay samples of a profile, two to an interval.
    pub fft_length: usize,
}

/// The tables of one image, `[row][group][leg]`, transmitters before receivers.
#[derive(Clone, Debug)]
pub(super) struct Tables<V> {
    pub(super) tx_count: usize,
    pub(super) leg_count: usize,
    pub(super) row_count: usize,
    pub(super) column_count: usize,
    /// Groups in a row; the last pixel is repeated to fill the last one.
    pub(super) group_count: usize,
    /// Whole part of the delay, in units of `base_unit` intervals.
    pub(super) bases: Vec<u32>,
    pub(super) legs: Vec<Leg<V>>,
    base_unit: u32,
}

/// The legs and bases of one group of pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Group<'a, V> {
    pub(super) tx: &'a [Leg<V>],
    pub(super) rx: &'a [Leg<V>],
    pub(super) tx_bases: &'a [u32],
    pub(super) rx_bases: &'a [u32],
}

impl<V: Lanes> Tables<V> {
    /// The tables of `geometry`.
    pub(super) fn new(geometry: &Geometry<'_>) -> Self {
        let Geometry { array, pixels, .. } = geometry;
        let (row_count, column_count) = (pixels.row_count(), pixels.column_count());
        let group_count = column_count.div_ceil(V::COUNT);
        let leg_count = array.tx_m.len() + array.rx_m.len();
        let zero = Leg { relative: V::ZERO, cos: V::ZERO, sin: V::ZERO };
        let mut legs = vec![zero; row_count * group_count * leg_count];
        let mut bases = vec![0; legs.len()];
        let groups = legs.par_chunks_mut(leg_count).zip(bases.par_chunks_mut(leg_count));
        groups.enumerate().with_min_len(group_count).for_each(|(index, group)| {
            let (row, first) = (index / group_count, index % group_count * V::COUNT);
            let place = |lane: usize| {
                let column = (first + lane).min(column_count - 1);
                pixels.coords_m(row * column_count + column)
            };
            let antennas = array.tx_m.iter().chain(&array.rx_m);
            for (antenna, (leg, base)) in antennas.zip(group.0.iter_mut().zip(group.1)) {
                *base = fill(leg, geometry, |lane| place(lane) - Vector2::from(*antenna));
            }
        });
        let tx_count = array.tx_m.len();
        Self {
            tx_count,
            leg_count,
            row_count,
            column_count,
            group_count,
            bases,
            legs,
            base_unit: 1,
        }
    }

    #[inline(always)]
    fn groups(&self, groups: Range<usize>) -> impl Iterator<Item = Group<'_, V>> {
        let span = groups.start * self.leg_count..groups.end * self.leg_count;
        let legs = self.legs[span.clone()].chunks_exact(self.leg_count);
        legs.zip(self.bases[span].chunks_exact(self.leg_count)).map(|(legs, bases)| {
            let (tx, rx) = legs.split_at(self.tx_count);
            let (tx_bases, rx_bases) = bases.split_at(self.tx_count);
            Group { tx, rx, tx_bases, rx_bases }
        })
    }

    /// Group number `index` of all, row by row.
    #[inline(always)]
    pub(super) fn group(&self, index: usize) -> Group<'_, V> {
        let span = index * self.leg_count..(index + 1) * self.leg_count;
        let (tx, rx) = self.legs[span.clone()].split_at(self.tx_count);
        let (tx_bases, rx_bases) = self.bases[span].split_at(self.tx_count);
        Group { tx, rx, tx_bases, rx_bases }
    }

    fn all_groups(&self) -> impl Iterator<Item = Group<'_, V>> {
        self.groups(0..self.row_count * self.group_count)
    }

    /// The largest of `of(base, largest relative delay)` over each group's slowest channel.
    fn largest(&self, of: impl Fn(u32, f32) -> f32) -> f32 {
        let slowest = |legs: &[Leg<V>], bases: &[u32]| {
            let of_leg = |(leg, base): (&Leg<V>, &u32)| {
                of(*base, leg.relative.as_slice().iter().fold(0.0, |a: f32, b| a.max(*b)))
            };
            legs.iter().zip(bases).map(of_leg).fold(0.0, f32::max)
        };
        self.all_groups()
            .map(|g| slowest(g.tx, g.tx_bases) + slowest(g.rx, g.rx_bases))
            .fold(0.0, f32::max)
    }

    /// The longest delay of both legs together, in intervals.
    pub(super) fn longest_delay(&self) -> f32 {
        let unit = self.base_unit;
        self.largest(|base, relative| (base * unit) as f32 + relative)
    }
}

/// What only kernels with look-ups inside registers need.
#[cfg(target_arch = "x86_64")]
impl<V: Lanes> Tables<V> {
    /// The groups of one row.
    #[inline(always)]
    pub(super) fn row(&self, row: usize) -> impl Iterator<Item = Group<'_, V>> {
        self.groups(row * self.group_count..(row + 1) * self.group_count)
    }

    /// How far beyond the sum of two bases a delay reaches, in intervals, if all bases were
    /// multiples of `unit`.
    pub(super) fn reach(&self, unit: u32) -> f32 {
        self.largest(|base, relative| (base % unit) as f32 + relative)
    }

    /// The largest sum of two bases.
    pub(super) fn largest_base(&self) -> usize {
        let largest = |bases: &[u32]| bases.iter().copied().max().unwrap_or(0);
        self.all_groups()
            .map(|g| (largest(g.tx_bases) + largest(g.rx_bases)) as usize)
            .max()
            .unwrap_or(0)
    }

    /// The same tables with bases in units of `unit` intervals instead of one.
    pub(super) fn with_base_unit(mut self, unit: u32) -> Self {
        for (leg, base) in self.legs.iter_mut().zip(&mut self.bases) {
            let rest = (*base % unit) as f32;
            leg.relative.as_mut_slice().iter_mut().for_each(|relative| *relative += rest);
            *base /= unit;
        }
        self.base_unit = unit;
        self
    }
}

/// Fills one leg whose pixels lie at `offset_m(lane)` from the antenna; gives its base.
#[expect(clippy::cast_possible_truncation, reason = "a delay of at most some thousand intervals")]
fn fill<V: Lanes>(
    leg: &mut Leg<V>,
    geometry: &Geometry<'_>,
    offset_m: impl Fn(usize) -> Vector2<f64>,
) -> u32 {
    let interval_rate_hz = 0.5 * geometry.band.step_hz * geometry.fft_length as f64;
    let mut shortest_s = f64::INFINITY;
    let mut delays_s = [0.0; 16];
    for (lane, delay_s) in delays_s.iter_mut().enumerate().take(V::COUNT) {
        let offset = offset_m(lane);
        *delay_s = geometry.wall.leg_path_m(offset.x, offset.y) / SPEED_OF_LIGHT_M_PER_S;
        shortest_s = shortest_s.min(*delay_s);
    }
    let base = (shortest_s * interval_rate_hz).floor();
    for (lane, delay_s) in delays_s.iter().enumerate().take(V::COUNT) {
        // Whole turns are dropped before single precision sees the phase.
        let (sin, cos) = (TAU * (geometry.band.carrier_hz() * delay_s).fract()).sin_cos();
        leg.relative.as_mut_slice()[lane] = single(delay_s * interval_rate_hz - base);
        leg.cos.as_mut_slice()[lane] = single(cos);
        leg.sin.as_mut_slice()[lane] = single(sin);
    }
    base as u32
}
