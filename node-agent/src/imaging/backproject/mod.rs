//! Back-projection: the coherent sum of all channels at every pixel, and how well they agree.
//!
//! `I(x) = Σ_t P_t(x) Σ_r P_r(x) s_tr(τ_t(x) + τ_r(x))`, `P_a = exp(j 2π f_c τ_a(x))`,
//! `E(x) = Σ_tr |s_tr|²`, coherence factor `CF = |I|² / (N E)` over the `N` channels
//! \[registration, section 4\]. `τ_a` is the delay of the leg between antenna `a` and the pixel in
//! seconds, by the wall model (`tables`); profiles are interpolated by parabolas (`coefficients`).
//!
//! The kernel is chosen when the tables are built: lookups inside a register (`permute`) where the
//! processor and the geometry allow, truncated powers (`knots`) where only the geometry does, and
//! plain loops (`portable`) everywhere else. All give the same
//! image to 1e-5 of its root mean square. The error on data that fill the band is −57 dB at the
//! default length of 2048 delay samples and −75 dB at 4096. Cost for one frame: 8 channels at
//! 334 × 334 pixels read 8 MB of tables.

use std::fmt;
use std::ops::Range;
use std::sync::Arc;

use rayon::{ThreadPool, ThreadPoolBuilder};
use serde::{Deserialize, Serialize};

use proto::radar::{Array, Band};

use super::compress::Profiles;
use super::pixels::Pixels;
use super::wall::WallModel;
use super::{InvalidSetting, invalid};
use coefficients::Coefficients;
use knots::Knots;
use portable::{Portable, Scratch};
use tables::{Eight, Tables};

pub use tables::Geometry;

mod coefficients;
mod knots;
#[cfg(target_arch = "x86_64")]
mod permute;
mod portable;
mod tables;
#[cfg(test)]
mod tests;

/// Most threads of one image.
const MAX_THREAD_COUNT: usize = 64;

/// How it is measured whether the channels agree at a pixel; 1 if they all do.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Coherence {
    /// The coherence factor `|Σ z|² / (N Σ |z|²)` \[registration, section 4\]: 1/N for noise.
    #[default]
    Power,
    /// Circular coherence `|Σ z/|z|| / N`: about 0.9/√N for noise.
    Circular,
    /// Phase coherence factor, from the spread of the phases \[mean-shift\]: near 0 for noise.
    Phase,
}

/// Which kernel computes the image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Kernel {
    /// The fastest that the processor, the geometry and the kind of coherence allow.
    #[default]
    Fastest,
    /// At most 256 bits wide.
    Avx2,
    /// Plain loops.
    Portable,
}

/// What back-projection gives, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct CoherentImage {
    /// Where the pixels are.
    pub pixels: Pixels,
    /// Number of channels `N` in the sum.
    pub channel_count: usize,
    /// `|I|²`.
    pub power: Vec<f32>,
    /// `E`, the sum of the channels' powers.
    pub energy: Vec<f32>,
    /// The coherence if it is not the coherence factor; empty if it is.
    pub phase_coherence: Vec<f32>,
}

impl CoherentImage {
    /// The coherence of pixel `index`: 1 if all channels agree, small for noise, and 0 where there
    /// is no energy.
    #[must_use]
    pub fn coherence(&self, index: usize) -> f32 {
        let energy = self.energy[index];
        if energy <= 0.0 {
            return 0.0;
        }
        let factor = || self.power[index] / (self.channel_count as f32 * energy);
        self.phase_coherence.get(index).copied().unwrap_or_else(factor)
    }

    /// The mean amplitude of a channel weighted by coherence, `|I| C / N`, for every pixel.
    #[must_use]
    pub fn weighted_amplitude(&self) -> Vec<f32> {
        let mut amplitude = Vec::new();
        self.weighted_amplitude_into(&mut amplitude);
        amplitude
    }

    /// The same into `amplitude`, whatever it held before.
    pub fn weighted_amplitude_into(&self, amplitude: &mut Vec<f32>) {
        amplitude.resize(self.power.len(), 0.0);
        let per_channel = 1.0 / self.channel_count as f32;
        if self.phase_coherence.is_empty() {
            let per_square = per_channel * per_channel;
            for ((weighted, power), energy) in
                amplitude.iter_mut().zip(&self.power).zip(&self.energy)
            {
                *weighted = power.sqrt() * power * per_square / energy.max(f32::MIN_POSITIVE);
            }
            return;
        }
        for ((weighted, power), coherence) in
            amplitude.iter_mut().zip(&self.power).zip(&self.phase_coherence)
        {
            *weighted = power.sqrt() * coherence * per_channel;
        }
    }
}

/// A kernel with its tables.
trait Engine: fmt::Debug + Send + Sync {
    /// Fills what [`Self::project`] reads.
    fn prepare(&self, profiles: &Profiles, coefficients: &mut Coefficients);
    /// Computes some rows of the image.
    fn project(&self, coefficients: &Coefficients, rows: Range<usize>, output: &mut Output<'_>);
    /// Intervals of two samples that images read, from delay zero on.
    fn interval_count(&self) -> usize;
    fn name(&self) -> &'static str;
}

/// Where some rows go, and the memory to compute them in.
struct Output<'a> {
    power: &'a mut [f32],
    energy: &'a mut [f32],
    coherence: &'a mut [f32],
    scratch: &'a mut Scratch,
}

/// The memory of one image, reused from frame to frame.
#[derive(Clone, Debug)]
pub struct Workspace {
    /// The last image.
    pub image: CoherentImage,
    coefficients: Coefficients,
    scratches: Vec<Scratch>,
}

/// How an image is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Means {
    /// What measures agreement.
    pub coherence: Coherence,
    /// Rows are shared among this many threads, 1 to 64.
    pub thread_count: usize,
    /// Which kernel.
    pub kernel: Kernel,
}

impl Default for Means {
    fn default() -> Self {
        Self { coherence: Coherence::Power, thread_count: 1, kernel: Kernel::Fastest }
    }
}

impl Means {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense.
    pub fn check(&self) -> Result<(), InvalidSetting> {
        if !(1..=MAX_THREAD_COUNT).contains(&self.thread_count) {
            return Err(invalid("thread_count", self.thread_count, "use 1 to 64 threads"));
        }
        Ok(())
    }
}

/// The tables of one radar, image and wall; cheap to clone, for clones share them.
#[derive(Clone, Debug)]
pub struct Backprojector {
    pixels: Pixels,
    channel_count: usize,
    means: Means,
    engine: Arc<dyn Engine>,
    pool: Option<Arc<ThreadPool>>,
}

impl Backprojector {
    /// Builds the tables for profiles of `fft_length` delay samples: one thread, coherence factor.
    ///
    /// # Errors
    /// If some pixel's echo comes later than the profile is long.
    pub fn new(
        band: &Band,
        array: &Array,
        pixels: &Pixels,
        wall: &WallModel,
        fft_length: usize,
    ) -> Result<Self, InvalidSetting> {
        Self::with_means(&Geometry { band, array, pixels, wall, fft_length }, &Means::default())
    }

    /// Builds the tables of `geometry` for an image computed by `means`.
    ///
    /// # Errors
    /// If some pixel's echo comes later than the profile is long, `means` make no sense, or the
    /// system gives no threads.
    pub fn with_means(geometry: &Geometry<'_>, means: &Means) -> Result<Self, InvalidSetting> {
        means.check()?;
        let pool = match means.thread_count {
            1 => None,
            count => Some(Arc::new(pool(count)?)),
        };
        Ok(Self {
            pixels: *geometry.pixels,
            channel_count: geometry.array.channel_count(),
            means: *means,
            engine: engine(geometry, means)?,
            pool,
        })
    }

    /// How many samples of a profile images read, from delay zero on.
    #[must_use]
    pub fn needed_sample_count(&self) -> usize {
        2 * self.engine.interval_count() + 1
    }

    /// The name of the kernel in use: `avx512`, `avx2` or `portable`.
    #[must_use]
    pub fn kernel_name(&self) -> &'static str {
        self.engine.name()
    }

    /// A workspace for [`Self::project`], with all memory the image needs.
    #[must_use]
    pub fn workspace(&self) -> Workspace {
        let pixel_count = self.pixels.pixel_count();
        let is_power = self.means.coherence == Coherence::Power;
        let image = CoherentImage {
            pixels: self.pixels,
            channel_count: self.channel_count,
            power: vec![0.0; pixel_count],
            energy: vec![0.0; pixel_count],
            phase_coherence: vec![0.0; if is_power { 0 } else { pixel_count }],
        };
        let scratches = vec![Scratch::default(); self.means.thread_count];
        Workspace { image, coefficients: Coefficients::default(), scratches }
    }

    /// Sets `workspace.image` to the image of `profiles`, `[t · rx_count + r]`, of the length given
    /// to [`Self::new`]. The workspace is one of this projector's or its clones'.
    pub fn project(&self, profiles: &Profiles, workspace: &mut Workspace) {
        let Workspace { image, coefficients, scratches } = workspace;
        self.engine.prepare(profiles, coefficients);
        let columns = self.pixels.column_count();
        let share = Share {
            engine: self.engine.as_ref(),
            coefficients,
            columns,
            rows: 0..self.pixels.row_count(),
            planes: [&mut image.power, &mut image.energy, &mut image.phase_coherence],
            scratches,
        };
        match &self.pool {
            None => share.compute(),
            Some(pool) => pool.install(|| share.compute()),
        }
    }

    /// The image of `profiles`, `[t · rx_count + r]`, of the length given to [`Self::new`].
    #[must_use]
    pub fn image(&self, profiles: &Profiles) -> CoherentImage {
        let mut workspace = self.workspace();
        self.project(profiles, &mut workspace);
        workspace.image
    }
}

/// Some rows, for as many threads as there are scratches.
struct Share<'a> {
    engine: &'a dyn Engine,
    coefficients: &'a Coefficients,
    columns: usize,
    rows: Range<usize>,
    planes: [&'a mut [f32]; 3],
    scratches: &'a mut [Scratch],
}

impl Share<'_> {
    /// Every pixel is computed alike, whichever thread does it: the image does not depend on how
    /// the rows are shared.
    fn compute(self) {
        let Self { engine, coefficients, columns, rows, planes, scratches } = self;
        if let [scratch] = scratches {
            let [power, energy, coherence] = planes;
            let mut output = Output { power, energy, coherence, scratch };
            engine.project(coefficients, rows, &mut output);
            return;
        }
        let first_count = scratches.len() / 2;
        let middle = rows.start + rows.len() * first_count / scratches.len();
        let split = (middle - rows.start) * columns;
        let [power, energy, coherence] =
            planes.map(|plane| plane.split_at_mut(split.min(plane.len())));
        let (left, right) = scratches.split_at_mut(first_count);
        let share = |of_rows, of_planes, of_scratches| Share {
            engine,
            coefficients,
            columns,
            rows: of_rows,
            planes: of_planes,
            scratches: of_scratches,
        };
        let first = share(rows.start..middle, [power.0, energy.0, coherence.0], left);
        let second = share(middle..rows.end, [power.1, energy.1, coherence.1], right);
        rayon::join(|| first.compute(), || second.compute());
    }
}

/// A pool of `count` threads.
fn pool(count: usize) -> Result<ThreadPool, InvalidSetting> {
    let remedy = "the system gives no threads: use 1";
    let builder = ThreadPoolBuilder::new().num_threads(count);
    let named = builder.thread_name(|index| format!("image-{index}"));
    named.build().map_err(|error| invalid("thread_count", format!("{count} ({error})"), remedy))
}

/// The kernel for `geometry` and `means`.
fn engine(geometry: &Geometry<'_>, means: &Means) -> Result<Arc<dyn Engine>, InvalidSetting> {
    let narrow = match wide_engine(geometry, means)? {
        Ok(engine) => return Ok(engine),
        Err(tables) => tables,
    };
    if means.coherence == Coherence::Power
        && let Some(engine) = Knots::new(&narrow)
    {
        return Ok(Arc::new(engine));
    }
    // Every interval that a delay can touch, and one for rounding.
    let interval_count = whole(narrow.longest_delay()) + 2;
    Ok(Arc::new(Portable::new(narrow, interval_count, means)))
}

/// A kernel with lookups inside registers, or the tables for plain loops.
#[cfg(target_arch = "x86_64")]
fn wide_engine(
    geometry: &Geometry<'_>,
    means: &Means,
) -> Result<Result<Arc<dyn Engine>, Tables<Eight>>, InvalidSetting> {
    use permute::{Avx2, Avx512, Permute};
    use pulp::x86::{V3, V4};
    let fits = means.coherence == Coherence::Power && means.kernel != Kernel::Portable;
    let wide = V4::try_new().filter(|_| fits && means.kernel == Kernel::Fastest);
    if let Some(token) = wide
        && let Ok(engine) = Permute::new(Avx512(token), checked_tables(geometry)?)
    {
        return Ok(Ok(Arc::new(engine)));
    }
    let tables = checked_tables(geometry)?;
    let Some(token) = V3::try_new().filter(|_| fits) else { return Ok(Err(tables)) };
    Ok(Permute::new(Avx2(token), tables).map(|engine| Arc::new(engine) as Arc<dyn Engine>))
}

/// No other processor has a kernel of its own.
#[cfg(not(target_arch = "x86_64"))]
fn wide_engine(
    geometry: &Geometry<'_>,
    _: &Means,
) -> Result<Result<Arc<dyn Engine>, Tables<Eight>>, InvalidSetting> {
    Ok(Err(checked_tables(geometry)?))
}

/// The tables, if the profile is long enough for them.
fn checked_tables<V: tables::Lanes>(geometry: &Geometry<'_>) -> Result<Tables<V>, InvalidSetting> {
    let tables = Tables::new(geometry);
    // One sample beyond for interpolation, one for rounding.
    let needed_sample_count = whole(2.0 * tables.longest_delay()) + 3;
    if geometry.fft_length < needed_sample_count {
        let remedy = "the echo of the farthest pixel comes after 1 / band.step_hz: use a smaller image or a finer step";
        return Err(invalid("grid", geometry.pixels, remedy));
    }
    Ok(tables)
}

/// Rounded up.
#[expect(clippy::cast_possible_truncation, reason = "a delay of at most some thousand samples")]
fn whole(samples: f32) -> usize {
    samples.ceil() as usize
}
