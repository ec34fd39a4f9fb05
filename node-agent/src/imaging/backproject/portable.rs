//! The kernel that runs on every processor, for every geometry and every kind of coherence.
//!
//! Each row takes three passes per channel, so that all but the look-up vectorise: where in the
//! profile each pixel's echo is, its value there, and the sums.
//! With the focused samples `z_c = P_t P_r s_tr = |z_c| exp(j φ_c)` of the `N` channels:
//! circular coherence `|Σ z_c / |z_c|| / N`; phase coherence
//! `max(0, 1 − min(std φ_c, std φ'_c) sqrt(3) / π)`, `φ' = φ − π sign φ`, the standard deviation being
//! that of the population \[mean-shift\]: `π / sqrt 3` is that of an even distribution over `±π`, and
//! of the two ways to cut the circle the better one counts.

use std::f32::consts::{FRAC_PI_2, PI};
use std::ops::Range;

#[cfg(target_arch = "x86_64")]
use super::Kernel;
use super::coefficients::{Coefficients, Interval};
use super::tables::{Eight, Group, Leg, Tables};
use super::{Coherence, Engine, Means, Output};
use crate::imaging::compress::Profiles;

/// Pixels of a group; loops over so many vectorise without remainder.
const LANES: usize = 8;
/// Groups between two passes: their tables and cells stay in the first cache, and what one pass
/// stored is out of the store buffer before the next one reads it.
const BLOCK: usize = 12;
/// Added to a number below 2²², it leaves the nearest whole number in the lowest bits.
const ROUNDER: f32 = 12_582_912.0;
/// Coefficients of `atan q / q` by powers of `q²`, highest first; errs by less than 7e-8.
const ATAN: [f32; 8] = [
    -0.004_559_792,
    0.023_780_52,
    -0.058_829_753,
    0.098_688_655,
    -0.140_032_9,
    0.199_669_62,
    -0.333_318_13,
    0.999_999_9,
];
/// What rounding a reciprocal root needs to stay finite where there is no echo.
const SMALLEST: f32 = 1e-30;

/// The kernel with its tables, whose bases count single intervals.
#[derive(Debug)]
pub(super) struct Portable {
    tables: Tables<Eight>,
    interval_count: usize,
    coherence: Coherence,
    /// Whether wider registers may be used; the result is the same to the last bit.
    #[cfg(target_arch = "x86_64")]
    wide: Option<pulp::x86::V3>,
}

impl Portable {
    /// The kernel for `tables`, for the processor at hand unless `means` ask for plain loops.
    pub(super) fn new(tables: Tables<Eight>, interval_count: usize, means: &Means) -> Self {
        Self {
            tables,
            interval_count,
            coherence: means.coherence,
            #[cfg(target_arch = "x86_64")]
            wide: pulp::x86::V3::try_new().filter(|_| means.kernel != Kernel::Portable),
        }
    }

    fn run<A: Agreement>(&self, pass: &Pass<'_>, rows: Range<usize>, output: &mut Output<'_>) {
        #[cfg(target_arch = "x86_64")]
        if let Some(token) = self.wide {
            return token.vectorize(
                #[inline(always)]
                || pass.rows::<A>(rows, output),
            );
        }
        pass.rows::<A>(rows, output);
    }
}

impl Engine for Portable {
    fn prepare(&self, profiles: &Profiles, coefficients: &mut Coefficients) {
        coefficients.fill_intervals(profiles, self.interval_count);
    }

    fn interval_count(&self) -> usize {
        self.interval_count
    }

    fn project(&self, coefficients: &Coefficients, rows: Range<usize>, output: &mut Output<'_>) {
        let rx_count = self.tables.leg_count - self.tables.tx_count;
        let pass = Pass {
            tables: &self.tables,
            rx_count,
            channel_count: (self.tables.tx_count * rx_count) as f32,
            intervals: &coefficients.intervals,
            interval_count: self.interval_count,
        };
        match self.coherence {
            Coherence::Power => self.run::<Factor>(&pass, rows, output),
            Coherence::Circular => self.run::<Circular>(&pass, rows, output),
            Coherence::Phase => self.run::<Phase>(&pass, rows, output),
        }
    }

    fn name(&self) -> &'static str {
        "portable"
    }
}

/// What all rows share.
struct Pass<'a> {
    tables: &'a Tables<Eight>,
    rx_count: usize,
    channel_count: f32,
    intervals: &'a [Interval],
    interval_count: usize,
}

impl Pass<'_> {
    #[inline(always)]
    fn rows<A: Agreement>(&self, rows: Range<usize>, output: &mut Output<'_>) {
        output.scratch.cells.resize(BLOCK, Cell::default());
        for (index, row) in rows.enumerate() {
            for start in (0..self.tables.group_count).step_by(BLOCK) {
                self.block::<A>(index, row * self.tables.group_count + start, output);
            }
        }
    }

    /// Computes the groups from `first` on, of the row that is number `index` of the output.
    #[inline(always)]
    fn block<A: Agreement>(&self, index: usize, first: usize, output: &mut Output<'_>) {
        let start = first % self.tables.group_count;
        let count = BLOCK.min(self.tables.group_count - start);
        let cells = &mut output.scratch.cells[..count];
        cells.fill(Cell::default());
        let mut profiles = self.intervals.chunks_exact(self.interval_count);
        for tx in 0..self.tables.tx_count {
            for (rx, profile) in (0..self.rx_count).zip(&mut profiles) {
                self.add_channel::<A>(first, &Channel { tx, rx, profile }, cells);
            }
            for (group, cell) in cells.iter_mut().enumerate() {
                cell.add_transmitter(&self.tables.group(first + group).tx[tx]);
            }
        }
        let columns = self.tables.column_count;
        let pixels = index * columns + start * LANES
            ..((index + 1) * columns).min(index * columns + (start + count) * LANES);
        store(cells, Cell::power, &mut output.power[pixels.clone()]);
        store(cells, |cell| cell.energy, &mut output.energy[pixels.clone()]);
        if A::IS_KEPT {
            let coherence = |cell: &Cell| A::coherence(&cell.agreement, self.channel_count);
            store(cells, coherence, &mut output.coherence[pixels]);
        }
    }

    #[inline(always)]
    fn add_channel<A: Agreement>(&self, first: usize, channel: &Channel<'_>, cells: &mut [Cell]) {
        let Channel { tx, rx, profile } = *channel;
        for (index, cell) in cells.iter_mut().enumerate() {
            cell.locate(&self.tables.group(first + index), tx, rx);
        }
        for cell in cells.iter_mut() {
            cell.look_up(profile);
        }
        for (index, cell) in cells.iter_mut().enumerate() {
            let group = self.tables.group(first + index);
            let rotated = cell.add_sample(&group.rx[rx]);
            A::add(&mut cell.agreement, rotated, &group.tx[tx]);
        }
    }
}

/// One channel: which legs, and its profile.
struct Channel<'a> {
    tx: usize,
    rx: usize,
    profile: &'a [Interval],
}

/// Stores what `of` gives of each cell; the last one may reach beyond the row.
#[inline(always)]
fn store(cells: &[Cell], of: impl Fn(&Cell) -> [f32; LANES], plane: &mut [f32]) {
    for (cell, pixels) in cells.iter().zip(plane.chunks_mut(LANES)) {
        pixels.copy_from_slice(&of(cell)[..pixels.len()]);
    }
}

/// Real and imaginary parts of a group's pixels.
type Pair = [[f32; LANES]; 2];

/// Working memory of one row.
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    cells: Vec<Cell>,
}

/// Working memory of one group of pixels.
#[derive(Clone, Copy, Debug, Default)]
struct Cell {
    index: [u32; LANES],
    rest: [f32; LANES],
    sample: [[f32; 2]; LANES],
    /// `Σ_r P_r s_tr`.
    tx_sum: Pair,
    /// `I`.
    sum: Pair,
    /// `E`.
    energy: [f32; LANES],
    /// What an [`Agreement`] sums up.
    agreement: [Pair; 2],
}

impl Cell {
    /// Where in the profile each pixel's echo is: whole intervals and the rest.
    #[inline(always)]
    fn locate(&mut self, group: &Group<'_, Eight>, tx: usize, rx: usize) {
        let base = group.tx_bases[tx] + group.rx_bases[rx];
        let (a, b) = (&group.tx[tx].relative.0, &group.rx[rx].relative.0);
        for lane in 0..LANES {
            let delay = a[lane] + b[lane];
            // Rounding up at a whole number reads the end of the interval before: the same value.
            let rounded = (delay - 0.5) + ROUNDER;
            self.index[lane] = base + (rounded.to_bits() & 0x003f_ffff);
            self.rest[lane] = delay - (rounded - ROUNDER);
        }
    }

    /// The value of the profile at each pixel's place.
    #[inline(always)]
    fn look_up(&mut self, profile: &[Interval]) {
        for lane in 0..LANES {
            let [c0_re, c0_im, c1_re, c1_im, c2_re, c2_im, _, _] =
                profile[self.index[lane] as usize];
            let rest = self.rest[lane];
            let re = c0_re + rest * (c1_re + rest * c2_re);
            let im = c0_im + rest * (c1_im + rest * c2_im);
            self.sample[lane] = [re, im];
        }
    }

    /// Adds `P_r s_tr` to the transmitter's sum and `|s_tr|²` to the energy; gives `P_r s_tr`.
    #[inline(always)]
    fn add_sample(&mut self, rx: &Leg<Eight>) -> Pair {
        let sample = [self.sample.map(|[re, _]| re), self.sample.map(|[_, im]| im)];
        for (energy, square) in self.energy.iter_mut().zip(squares(&sample)) {
            *energy += square;
        }
        let rotated = rotate(&sample, rx);
        add(&mut self.tx_sum, &rotated);
        rotated
    }

    /// Adds `P_t` times the transmitter's sum to the row's sum, and starts a new one.
    #[inline(always)]
    fn add_transmitter(&mut self, tx: &Leg<Eight>) {
        add(&mut self.sum, &rotate(&self.tx_sum, tx));
        self.tx_sum = Pair::default();
    }

    #[inline(always)]
    fn power(&self) -> [f32; LANES] {
        squares(&self.sum)
    }
}

/// `P z`, `P = cos + j sin` of `leg`.
#[inline(always)]
fn rotate([re, im]: &Pair, leg: &Leg<Eight>) -> Pair {
    let (cos, sin) = (&leg.cos.0, &leg.sin.0);
    let mut rotated = Pair::default();
    for lane in 0..LANES {
        rotated[0][lane] = re[lane] * cos[lane] - im[lane] * sin[lane];
        rotated[1][lane] = re[lane] * sin[lane] + im[lane] * cos[lane];
    }
    rotated
}

#[inline(always)]
fn add(sum: &mut Pair, term: &Pair) {
    for lane in 0..LANES {
        sum[0][lane] += term[0][lane];
        sum[1][lane] += term[1][lane];
    }
}

/// `|z|²`.
#[inline(always)]
fn squares([re, im]: &Pair) -> [f32; LANES] {
    let mut squares = [0.0; LANES];
    for lane in 0..LANES {
        squares[lane] = re[lane] * re[lane] + im[lane] * im[lane];
    }
    squares
}

/// A way to sum up how well the channels agree.
trait Agreement {
    /// Whether there is a coherence beside `|I|²` and `E`.
    const IS_KEPT: bool;
    /// Adds a channel, given `P_r s_tr` and its transmitter.
    fn add(sums: &mut [Pair; 2], rotated: Pair, tx: &Leg<Eight>);
    /// What the sums say.
    fn coherence(sums: &[Pair; 2], channel_count: f32) -> [f32; LANES];
}

/// The coherence factor follows from `|I|²` and `E`.
struct Factor;

impl Agreement for Factor {
    const IS_KEPT: bool = false;
    #[inline(always)]
    fn add(_: &mut [Pair; 2], _: Pair, _: &Leg<Eight>) {}
    #[inline(always)]
    fn coherence(_: &[Pair; 2], _: f32) -> [f32; LANES] {
        [0.0; LANES]
    }
}

/// Sums `z / |z|`.
struct Circular;

impl Agreement for Circular {
    const IS_KEPT: bool = true;

    #[inline(always)]
    fn add(sums: &mut [Pair; 2], rotated: Pair, tx: &Leg<Eight>) {
        let lengths = squares(&rotated).map(|square| square.max(SMALLEST).sqrt());
        let mut phasor = rotate(&rotated, tx);
        for lane in 0..LANES {
            phasor[0][lane] /= lengths[lane];
            phasor[1][lane] /= lengths[lane];
        }
        add(&mut sums[0], &phasor);
    }

    #[inline(always)]
    fn coherence(sums: &[Pair; 2], channel_count: f32) -> [f32; LANES] {
        squares(&sums[0]).map(|square| square.sqrt() / channel_count)
    }
}

/// Sums `[φ, φ²]` and `[φ', φ'²]`.
struct Phase;

impl Agreement for Phase {
    const IS_KEPT: bool = true;

    #[inline(always)]
    fn add(sums: &mut [Pair; 2], rotated: Pair, tx: &Leg<Eight>) {
        let [re, im] = rotate(&rotated, tx);
        let [sum, other_sum] = sums;
        for lane in 0..LANES {
            let phase_rad = angle_rad(im[lane], re[lane]);
            let other_rad = phase_rad - PI.copysign(phase_rad);
            sum[0][lane] += phase_rad;
            sum[1][lane] += phase_rad * phase_rad;
            other_sum[0][lane] += other_rad;
            other_sum[1][lane] += other_rad * other_rad;
        }
    }

    #[inline(always)]
    fn coherence(sums: &[Pair; 2], channel_count: f32) -> [f32; LANES] {
        let mut coherence = [0.0; LANES];
        for (lane, value) in coherence.iter_mut().enumerate() {
            let [variance, other_variance] = [0, 1].map(|cut: usize| {
                let mean = sums[cut][0][lane] / channel_count;
                sums[cut][1][lane] / channel_count - mean * mean
            });
            let sigma_rad = variance.min(other_variance).max(0.0).sqrt();
            *value = (1.0 - sigma_rad * (3.0_f32.sqrt() / PI)).max(0.0);
        }
        coherence
    }
}

/// `atan2(im, re)` to 1e-6 rad, without branches; 0 at the origin.
///
/// `atan q = q p(q²)` on `0 ≤ q ≤ 1`, `p` interpolating at the eight Chebyshev points of `q²`.
#[inline(always)]
fn angle_rad(im: f32, re: f32) -> f32 {
    let (high, low) = (re.abs().max(im.abs()), re.abs().min(im.abs()));
    let ratio = low / high.max(SMALLEST);
    let square = ratio * ratio;
    let mut polynomial = ATAN[0];
    for coefficient in &ATAN[1..] {
        polynomial = polynomial * square + coefficient;
    }
    let octant = ratio * polynomial;
    let quadrant = if re.abs() < im.abs() { FRAC_PI_2 - octant } else { octant };
    let half = if re < 0.0 { PI - quadrant } else { quadrant };
    half.copysign(im)
}
