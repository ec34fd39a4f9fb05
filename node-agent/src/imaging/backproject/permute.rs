//! The kernels that look values up inside a register: AVX2 with 8 lanes, AVX-512 with 16.
//!
//! The delays of one group of pixels in one channel differ by less than a register has lanes, so
//! that one load of each coefficient and one permutation replace a gather:
//! `s = c0 + w (c1 + w c2)`, `[c0, c1, c2] = window[base_t + base_r][trunc(ρ_t + ρ_r)]`,
//! `w = fract(ρ_t + ρ_r)`, with the relative delays `ρ`. Windows start at multiples of 1, 2 or 4
//! intervals and are aligned, so that no load straddles two cache lines.

use std::fmt;
use std::ops::Range;

use pulp::x86::{V3, V4};
use pulp::{NullaryFnOnce, cast};
use std::arch::x86_64::{__m256, __m256i, __m512, __m512i};

use super::coefficients::{Coefficients, Span, Window, Windowed};
use super::tables::{Eight, Group, Lanes, Leg, Sixteen, Tables};
use super::{Engine, Output};
use crate::imaging::compress::Profiles;

/// What of a processor the kernel needs; all of it is inlined into the kernel.
pub(super) trait Unit: Copy + fmt::Debug + Send + Sync + 'static {
    type Lanes: Windowed;
    type Register: Copy;
    type Index: Copy;
    fn run<F: NullaryFnOnce>(self, function: F) -> F::Output;
    fn load(self, lanes: &Self::Lanes) -> Self::Register;
    fn store(self, register: Self::Register) -> Self::Lanes;
    fn add(self, a: Self::Register, b: Self::Register) -> Self::Register;
    fn mul(self, a: Self::Register, b: Self::Register) -> Self::Register;
    /// `a b + c`.
    fn mul_add(self, a: Self::Register, b: Self::Register, c: Self::Register) -> Self::Register;
    /// `c − a b`.
    fn mul_sub(self, a: Self::Register, b: Self::Register, c: Self::Register) -> Self::Register;
    /// Whole part and rest.
    fn split(self, value: Self::Register) -> (Self::Index, Self::Register);
    /// In each lane the value of the lane that `index` names.
    fn pick(self, index: Self::Index, values: Self::Register) -> Self::Register;
}

/// AVX2 with fused multiplication and addition.
#[derive(Clone, Copy, Debug)]
pub(super) struct Avx2(pub(super) V3);

impl Unit for Avx2 {
    type Lanes = Eight;
    type Register = __m256;
    type Index = __m256i;
    #[inline(always)]
    fn run<F: NullaryFnOnce>(self, function: F) -> F::Output {
        self.0.vectorize(function)
    }
    #[inline(always)]
    fn load(self, lanes: &Eight) -> __m256 {
        cast(lanes.0)
    }
    #[inline(always)]
    fn store(self, register: __m256) -> Eight {
        Eight(cast(register))
    }
    #[inline(always)]
    fn add(self, a: __m256, b: __m256) -> __m256 {
        self.0.avx._mm256_add_ps(a, b)
    }
    #[inline(always)]
    fn mul(self, a: __m256, b: __m256) -> __m256 {
        self.0.avx._mm256_mul_ps(a, b)
    }
    #[inline(always)]
    fn mul_add(self, a: __m256, b: __m256, c: __m256) -> __m256 {
        self.0.fma._mm256_fmadd_ps(a, b, c)
    }
    #[inline(always)]
    fn mul_sub(self, a: __m256, b: __m256, c: __m256) -> __m256 {
        self.0.fma._mm256_fnmadd_ps(a, b, c)
    }
    #[inline(always)]
    fn split(self, value: __m256) -> (__m256i, __m256) {
        let index = self.0.avx._mm256_cvttps_epi32(value);
        (index, self.0.avx._mm256_sub_ps(value, self.0.avx._mm256_cvtepi32_ps(index)))
    }
    #[inline(always)]
    fn pick(self, index: __m256i, values: __m256) -> __m256 {
        self.0.avx2._mm256_permutevar8x32_ps(values, index)
    }
}

/// AVX-512 foundation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Avx512(pub(super) V4);

impl Unit for Avx512 {
    type Lanes = Sixteen;
    type Register = __m512;
    type Index = __m512i;
    #[inline(always)]
    fn run<F: NullaryFnOnce>(self, function: F) -> F::Output {
        self.0.vectorize(function)
    }
    #[inline(always)]
    fn load(self, lanes: &Sixteen) -> __m512 {
        cast(lanes.0)
    }
    #[inline(always)]
    fn store(self, register: __m512) -> Sixteen {
        Sixteen(cast(register))
    }
    #[inline(always)]
    fn add(self, a: __m512, b: __m512) -> __m512 {
        self.0.avx512f._mm512_add_ps(a, b)
    }
    #[inline(always)]
    fn mul(self, a: __m512, b: __m512) -> __m512 {
        self.0.avx512f._mm512_mul_ps(a, b)
    }
    #[inline(always)]
    fn mul_add(self, a: __m512, b: __m512, c: __m512) -> __m512 {
        self.0.avx512f._mm512_fmadd_ps(a, b, c)
    }
    #[inline(always)]
    fn mul_sub(self, a: __m512, b: __m512, c: __m512) -> __m512 {
        self.0.avx512f._mm512_fnmadd_ps(a, b, c)
    }
    #[inline(always)]
    fn split(self, value: __m512) -> (__m512i, __m512) {
        let index = self.0.avx512f._mm512_cvttps_epi32(value);
        (index, self.0.avx512f._mm512_sub_ps(value, self.0.avx512f._mm512_cvtepi32_ps(index)))
    }
    #[inline(always)]
    fn pick(self, index: __m512i, values: __m512) -> __m512 {
        self.0.avx512f._mm512_permutexvar_ps(index, values)
    }
}

/// A kernel with its tables.
#[derive(Debug)]
pub(super) struct Permute<U: Unit> {
    unit: U,
    tables: Tables<U::Lanes>,
    span: Span,
}

impl<U: Unit> Permute<U> {
    /// The kernel for `tables`, whose bases count single intervals; gives the tables back if their
    /// delays differ by more than a register holds.
    pub(super) fn new(unit: U, tables: Tables<U::Lanes>) -> Result<Self, Tables<U::Lanes>> {
        // Rounding of the sum of two relative delays in single precision stays far below.
        let limit = U::Lanes::COUNT as f32 - 1e-3;
        let Some(base_unit) = [4, 2, 1].into_iter().find(|count| tables.reach(*count) < limit)
        else {
            return Err(tables);
        };
        let tables = tables.with_base_unit(base_unit);
        let span = Span { count: tables.largest_base() + 1, stride: base_unit as usize };
        Ok(Self { unit, tables, span })
    }
}

impl<U: Unit> Engine for Permute<U> {
    fn prepare(&self, profiles: &Profiles, coefficients: &mut Coefficients) {
        coefficients.fill_windows::<U::Lanes>(profiles, self.span);
    }

    fn project(&self, coefficients: &Coefficients, rows: Range<usize>, output: &mut Output<'_>) {
        let (unit, tables, span) = (self.unit, &self.tables, self.span);
        let windows = U::Lanes::windows(coefficients);
        unit.run(Job { unit, tables, windows, span, rows, output });
    }

    fn interval_count(&self) -> usize {
        (self.span.count - 1) * self.span.stride + U::Lanes::COUNT
    }

    fn name(&self) -> &'static str {
        if U::Lanes::COUNT == 16 { "avx512" } else { "avx2" }
    }
}

/// Some rows of one image.
struct Job<'a, 'b, U: Unit> {
    unit: U,
    tables: &'a Tables<U::Lanes>,
    windows: &'a [Window<U::Lanes>],
    span: Span,
    rows: Range<usize>,
    output: &'a mut Output<'b>,
}

impl<U: Unit> NullaryFnOnce for Job<'_, '_, U> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { unit, tables, windows, span, rows, output } = self;
        let columns = tables.column_count;
        let planes =
            output.power.chunks_exact_mut(columns).zip(output.energy.chunks_exact_mut(columns));
        for (row, (power, energy)) in rows.zip(planes) {
            let outputs = power.chunks_mut(U::Lanes::COUNT).zip(energy.chunks_mut(U::Lanes::COUNT));
            for (group, (to_power, to_energy)) in tables.row(row).zip(outputs) {
                let [p, e] = group_sums(unit, &group, windows, span.count);
                to_power.copy_from_slice(&unit.store(p).as_slice()[..to_power.len()]);
                to_energy.copy_from_slice(&unit.store(e).as_slice()[..to_energy.len()]);
            }
        }
    }
}

/// `|I|²` and `E` of one group.
#[inline(always)]
fn group_sums<U: Unit>(
    unit: U,
    group: &Group<'_, U::Lanes>,
    windows: &[Window<U::Lanes>],
    window_count: usize,
) -> [U::Register; 2] {
    let zero = unit.load(&U::Lanes::ZERO);
    let (mut re, mut im, mut energy) = (zero, zero, zero);
    let mut channels = windows.chunks_exact(window_count);
    for (tx, tx_base) in group.tx.iter().zip(group.tx_bases) {
        let tx_relative = unit.load(&tx.relative);
        let (mut tx_re, mut tx_im) = (zero, zero);
        for ((rx, rx_base), channel) in group.rx.iter().zip(group.rx_bases).zip(&mut channels) {
            let window = &channel[(tx_base + rx_base) as usize];
            let delay = unit.add(tx_relative, unit.load(&rx.relative));
            let [s_re, s_im] = sample(unit, window, delay);
            energy = unit.mul_add(s_re, s_re, unit.mul_add(s_im, s_im, energy));
            [tx_re, tx_im] = add_rotated(unit, rx, [s_re, s_im], [tx_re, tx_im]);
        }
        [re, im] = add_rotated(unit, tx, [tx_re, tx_im], [re, im]);
    }
    [unit.mul_add(re, re, unit.mul(im, im)), energy]
}

/// `c0 + w (c1 + w c2)`, real and imaginary part.
#[inline(always)]
fn sample<U: Unit>(unit: U, window: &Window<U::Lanes>, delay: U::Register) -> [U::Register; 2] {
    let (index, rest) = unit.split(delay);
    let [c0_re, c0_im, c1_re, c1_im, c2_re, c2_im] = &window.planes;
    let quadratic_re = unit.pick(index, unit.load(c2_re));
    let linear_re = unit.mul_add(quadratic_re, rest, unit.pick(index, unit.load(c1_re)));
    let re = unit.mul_add(linear_re, rest, unit.pick(index, unit.load(c0_re)));
    let quadratic_im = unit.pick(index, unit.load(c2_im));
    let linear_im = unit.mul_add(quadratic_im, rest, unit.pick(index, unit.load(c1_im)));
    let im = unit.mul_add(linear_im, rest, unit.pick(index, unit.load(c0_im)));
    [re, im]
}

/// `sum + P z`, `P = cos + j sin` of `leg`.
#[inline(always)]
fn add_rotated<U: Unit>(
    unit: U,
    leg: &Leg<U::Lanes>,
    [re, im]: [U::Register; 2],
    [sum_re, sum_im]: [U::Register; 2],
) -> [U::Register; 2] {
    let (cos, sin) = (unit.load(&leg.cos), unit.load(&leg.sin));
    let new_re = unit.mul_sub(im, sin, unit.mul_add(re, cos, sum_re));
    let new_im = unit.mul_add(im, cos, unit.mul_add(re, sin, sum_im));
    [new_re, new_im]
}
