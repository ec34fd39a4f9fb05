//! Four real impulse radars around one walker: rings from each, and where they cross a track.
//!
//! Each radar (3.14 to 4.64 GHz) has one channel, so that it measures distances only: a moving person
//! lights up a ring around it. Four rings cross in one place.
//! 1. scans (real samples over delay) become samples over frequency ([`load`]);
//! 2. the node's canceller forgets what stands still ([`Canceller`]), its window and compression
//!    give profiles over delay ([`Compressor`]);
//! 3. each pixel gets the product over the radars of power over noise, plus one so that a single
//!    radar that misses the person does not erase him: `Σ ln(1 + |s_n|²/σ_n²)` ([`Radars::rings`]);
//! 4. the path through all images that collects most without running (Viterbi), smoothed: the track
//!    ([`best_way`]).
//!
//! The true way is a triangle on the floor, walked at unknown times; it is used for the score and
//! the picture alone.
//!
//! ```text
//! cargo run --release --example et4173_four_uwb -- [FOLDER] [--picture FILE] [--json]
//! ```

use std::path::Path;

use anyhow::{Context, ensure};
use nalgebra::Vector2;
use rustfft::FftPlanner;
use rustfft::num_complex::Complex;
use serde::{Deserialize, Serialize};

use node_agent::detect::threshold;
use node_agent::imaging::canceller::{Cancelled, Canceller, CancellerConfig, Gates};
use node_agent::imaging::compress::Compressor;
use node_agent::imaging::window::Window;
use proto::radar::{Band, Grid, SPEED_OF_LIGHT_M_PER_S};

use support::{Call, read_array, single};

#[path = "support/picture.rs"]
mod picture;
mod support;

/// What the radars transmit.
const BAND_HZ: [f64; 2] = [3.14e9, 4.64e9];
/// Delay samples of a profile, 23 for each resolution cell.
const FFT_LENGTH: usize = 1024;
/// How long the background remembers, seconds.
const BACKGROUND_S: f64 = 2.0;
/// Powers are averaged over this many scans before and after, 0.16 s in all.
const HALF_AVERAGE_COUNT: usize = 2;
/// Images are this far apart, seconds.
const PERIOD_S: f64 = 0.13;
/// The image: the floor between the radars.
const GRID: Grid =
    Grid { x_min_m: -1.8, y_min_m: -1.8, pixel_m: 0.05, column_count: 73, row_count: 73 };
/// A walker moves by so much in a period, one sigma in metres ...
const STEP_SIGMA_M: f64 = 0.08;
/// ... and never by more than this many pixels in `x` or `y`.
const MAX_STEP_PIXELS: isize = 5;
/// The track is smoothed over this time, one sigma in seconds: a person's limbs swing faster.
const SMOOTHING_S: f64 = 0.4;
/// The walker is seen where the radars' powers over noise have at least this geometric mean.
const MIN_POWER_RATIO: f64 = 12.0;
/// From then on the walker stands still, seconds; someone who stands still is background.
const STANDS_FROM_S: f64 = 24.5;

/// `geometry.json`.
#[derive(Debug, Deserialize)]
pub(crate) struct Geometry {
    pub(crate) nodes_m: std::collections::BTreeMap<String, [f64; 2]>,
    fast_time_start_s: f64,
    fast_time_step_s: f64,
    sample_count: usize,
    range_offset_m: f64,
    pub(crate) path_m: Vec<[f64; 2]>,
}

/// One radar and its power over noise, scan by scan.
struct Radar {
    place_m: Vector2<f64>,
    times_s: Vec<f64>,
    /// `[scan][delay sample]`; empty while the background is unknown.
    power_ratios: Vec<Vec<f32>>,
    sample_rate_hz: f64,
    first_delay_s: f64,
}

/// All radars.
struct Radars {
    radars: Vec<Radar>,
    range_offset_m: f64,
}

/// One point of the track.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct TrackPoint {
    pub(crate) time_s: f64,
    pub(crate) x_m: f64,
    pub(crate) y_m: f64,
    /// Whether the radars see the walker.
    pub(crate) seen: bool,
}

/// What the recording shows.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Figures {
    /// Median distance of the track from the true way while the walker walks and is seen, metres.
    pub(crate) median_error_m: f64,
    /// 90 % of the track are nearer than this, metres.
    pub(crate) p90_error_m: f64,
    /// Share of the walking time in which the walker is seen.
    pub(crate) seen_share: f64,
    /// The same while the walker stands.
    pub(crate) seen_standing_share: f64,
    /// Length of the track while he walks, metres.
    pub(crate) track_length_m: f64,
    /// How many images were made.
    pub(crate) image_count: usize,
}

fn main() -> anyhow::Result<()> {
    let call = Call::from_command_line("../shared/data/et4173-4uwb", "et4173_four_uwb.svg")?;
    let (figures, picture) = run(&call.folder)?;
    call.finish(&figures, picture.as_bytes())
}

/// The figures and the picture (SVG) of the recording in `folder`.
///
/// # Errors
/// If the recording is absent or not as it should be.
pub(crate) fn run(folder: &Path) -> anyhow::Result<(Figures, String)> {
    let path = folder.join("geometry.json");
    let text = std::fs::read_to_string(&path)
        .with_context(|| format!("{}: no such recording", path.display()))?;
    let geometry: Geometry = serde_json::from_str(&text)?;
    let radars = load(folder, &geometry)?;
    let times_s = radars.common_times_s();
    let images: Vec<Vec<f32>> = times_s.iter().map(|time_s| radars.rings(*time_s)).collect();
    let track = track(&times_s, &images, radars.radars.len());
    let figures = figures(&track, &geometry.path_m)?;
    let shown = images.len() / 3;
    let picture = picture::draw(&geometry, &track, &GRID, (&track[shown], &images[shown]))?;
    Ok((figures, picture))
}

/// Reads all radars and brings their scans to power over noise.
fn load(folder: &Path, geometry: &Geometry) -> anyhow::Result<Radars> {
    let mut radars = Vec::new();
    let mut start_ms = i64::MAX;
    let mut all_times_ms = Vec::new();
    for name in geometry.nodes_m.keys() {
        let (_, times_ms) =
            read_array::<i64>(&folder.join(format!("{name}_host_time_ms_i64.npy")))?;
        start_ms = start_ms.min(times_ms.first().copied().unwrap_or(i64::MAX));
        all_times_ms.push(times_ms);
    }
    for ((name, place_m), times_ms) in geometry.nodes_m.iter().zip(&all_times_ms) {
        let (shape, scans) = read_array::<i32>(&folder.join(format!("{name}_scans_i32.npy")))?;
        ensure!(
            shape == [times_ms.len(), geometry.sample_count],
            "radar {name} has scans of the shape {shape:?}"
        );
        let times_s = times_ms.iter().map(|ms| 1e-3 * (ms - start_ms) as f64).collect();
        radars.push(radar(geometry, Vector2::from(*place_m), times_s, &scans));
    }
    ensure!(!radars.is_empty(), "there are no radars");
    Ok(Radars { radars, range_offset_m: geometry.range_offset_m })
}

/// Canceller, window, compression: the node's chain for one channel.
fn radar(geometry: &Geometry, place_m: Vector2<f64>, times_s: Vec<f64>, scans: &[i32]) -> Radar {
    let count = geometry.sample_count;
    let step_hz = 1.0 / (geometry.fast_time_step_s * count as f64);
    let bins: Vec<usize> = (0..count / 2)
        .filter(|bin| (BAND_HZ[0]..=BAND_HZ[1]).contains(&(step_hz * *bin as f64)))
        .collect();
    let start_hz = step_hz * bins.first().copied().unwrap_or(0) as f64;
    let band = Band { start_hz, step_hz, step_count: bins.len() };
    let compressor = Compressor::new(&band, &Window::Taylor.weights(bins.len()), FFT_LENGTH);
    let gates = Gates { kept_count: FFT_LENGTH, per_cell: FFT_LENGTH as f64 / bins.len() as f64 };
    let exponential = CancellerConfig::Exponential { time_constant_s: BACKGROUND_S };
    let mut canceller = Canceller::new(exponential, gates);
    let transform = FftPlanner::new().plan_fft_forward(count);
    let mut powers: Vec<Vec<f32>> = Vec::new();
    let mut noise_powers = Vec::new();
    for (time_s, scan) in times_s.iter().zip(scans.chunks_exact(count)) {
        let mut spectrum: Vec<Complex<f64>> =
            scan.iter().map(|sample| Complex::new(f64::from(*sample), 0.0)).collect();
        transform.process(&mut spectrum);
        // Half of a real signal's spectrum is its analytic signal.
        let half = bins.iter().map(|bin| spectrum[*bin]);
        let samples: Vec<Complex<f32>> =
            half.map(|s| Complex::new(single(s.re), single(s.im))).collect();
        let received = compressor.compress(&samples);
        let Cancelled::Moving(profiles) = canceller.cancel(*time_s, &received) else {
            powers.push(Vec::new());
            continue;
        };
        noise_powers.push(threshold::noise_power(profiles));
        powers.push(profiles.samples.iter().map(Complex::norm_sqr).collect());
    }
    let noise_power = median(&mut noise_powers).unwrap_or(1.0).max(f32::MIN_POSITIVE);
    powers.iter_mut().flatten().for_each(|power| *power /= noise_power);
    Radar {
        place_m,
        times_s,
        power_ratios: powers,
        sample_rate_hz: step_hz * FFT_LENGTH as f64,
        first_delay_s: geometry.fast_time_start_s,
    }
}

fn median(values: &mut [f32]) -> Option<f32> {
    let middle = values.len() / 2;
    values.sort_by(f32::total_cmp);
    values.get(middle).copied()
}

impl Radar {
    /// Power over noise over delay around `time_s`, mean of some scans.
    fn around(&self, time_s: f64) -> Vec<f32> {
        let nearest = self.times_s.partition_point(|t_s| *t_s < time_s);
        let first = nearest.saturating_sub(HALF_AVERAGE_COUNT);
        let last = (nearest + HALF_AVERAGE_COUNT + 1).min(self.power_ratios.len());
        let mut mean = vec![0.0; FFT_LENGTH];
        let share = 1.0 / (last - first) as f32;
        for scan in &self.power_ratios[first.min(last)..last] {
            mean.iter_mut().zip(scan).for_each(|(sum, power)| *sum += share * power);
        }
        mean
    }

    /// The delay sample that shows `place_m`.
    #[expect(clippy::cast_possible_truncation, reason = "a place beyond the profile shows nothing")]
    fn sample_index(&self, place_m: &Vector2<f64>, range_offset_m: f64) -> usize {
        let range_m = (place_m - self.place_m).norm() - range_offset_m;
        let delay_s = 2.0 * range_m / SPEED_OF_LIGHT_M_PER_S - self.first_delay_s;
        (delay_s * self.sample_rate_hz).round().max(0.0) as usize
    }
}

impl Radars {
    /// Times within which all radars have measured, one period apart.
    fn common_times_s(&self) -> Vec<f64> {
        let known = |radar: &Radar| radar.power_ratios.iter().position(|scan| !scan.is_empty());
        let start = |radar: &Radar| known(radar).map_or(f64::INFINITY, |scan| radar.times_s[scan]);
        let end = |radar: &Radar| radar.times_s.last().copied().unwrap_or(0.0);
        let from_s = self.radars.iter().map(start).fold(0.0, f64::max);
        let to_s = self.radars.iter().map(end).fold(f64::INFINITY, f64::min);
        (0..).map(|k| from_s + PERIOD_S * f64::from(k)).take_while(|t_s| *t_s < to_s).collect()
    }

    /// The logarithm of the product over all radars, pixel by pixel.
    fn rings(&self, time_s: f64) -> Vec<f32> {
        let mut image = vec![0.0; GRID.pixel_count()];
        for radar in &self.radars {
            let profile = radar.around(time_s);
            for (index, pixel) in image.iter_mut().enumerate() {
                let sample = radar.sample_index(&place(index), self.range_offset_m);
                *pixel += profile.get(sample).map_or(0.0, |ratio| ratio.ln_1p());
            }
        }
        image
    }
}

fn place(index: usize) -> Vector2<f64> {
    let (row, column) = (index / GRID.column_count, index % GRID.column_count);
    Vector2::new(GRID.x_m(column), GRID.y_m(row))
}

/// The track through all images.
fn track(times_s: &[f64], images: &[Vec<f32>], radar_count: usize) -> Vec<TrackPoint> {
    let way = best_way(images);
    let raw_m: Vec<Vector2<f64>> = way.iter().map(|index| place(*index)).collect();
    let least = radar_count as f64 * MIN_POWER_RATIO.ln_1p();
    let point = |k: usize| {
        let weight =
            |other: usize| (-0.5 * ((times_s[other] - times_s[k]) / SMOOTHING_S).powi(2)).exp();
        let total: f64 = (0..raw_m.len()).map(weight).sum();
        let smooth_m = (0..raw_m.len()).map(|i| raw_m[i] * weight(i)).sum::<Vector2<f64>>() / total;
        let seen = least <= f64::from(images[k][way[k]]);
        TrackPoint { time_s: times_s[k], x_m: smooth_m.x, y_m: smooth_m.y, seen }
    };
    (0..way.len()).map(point).collect()
}

/// The pixels, one of each image, whose sum is largest with `|step|² / (2 σ²)` taken off for every
/// step.
fn best_way(images: &[Vec<f32>]) -> Vec<usize> {
    let Some(first) = images.first() else { return Vec::new() };
    let steps = steps();
    let mut score = first.clone();
    let mut origins: Vec<Vec<usize>> = Vec::new();
    for image in &images[1..] {
        let best: Vec<(usize, f32)> =
            (0..image.len()).map(|pixel| best_origin(&score, pixel, &steps)).collect();
        score = best.iter().zip(image).map(|((_, sum), own)| sum + own).collect();
        origins.push(best.into_iter().map(|(origin, _)| origin).collect());
    }
    let last = (0..score.len()).max_by(|a, b| score[*a].total_cmp(&score[*b])).unwrap_or(0);
    let mut way = vec![last];
    for origin in origins.iter().rev() {
        way.push(origin[way[way.len() - 1]]);
    }
    way.reverse();
    way
}

/// Steps in rows and columns with what they cost.
fn steps() -> Vec<(isize, isize, f32)> {
    let all = -MAX_STEP_PIXELS..=MAX_STEP_PIXELS;
    let cost = |rows: isize, columns: isize| {
        let squared_m2 = GRID.pixel_m.powi(2) * (rows * rows + columns * columns) as f64;
        single(0.5 * squared_m2 / STEP_SIGMA_M.powi(2))
    };
    all.clone()
        .flat_map(|rows| all.clone().map(move |columns| (rows, columns)))
        .map(|(rows, columns)| (rows, columns, cost(rows, columns)))
        .collect()
}

/// From where `pixel` is best reached, and the score of getting there.
fn best_origin(score: &[f32], pixel: usize, steps: &[(isize, isize, f32)]) -> (usize, f32) {
    let (row, column) = (pixel / GRID.column_count, pixel % GRID.column_count);
    let from = |(rows, columns, cost): &(isize, isize, f32)| {
        let row = row.checked_add_signed(*rows).filter(|row| *row < GRID.row_count)?;
        let column = column.checked_add_signed(*columns).filter(|c| *c < GRID.column_count)?;
        let origin = row * GRID.column_count + column;
        Some((origin, score[origin] - cost))
    };
    let best = steps.iter().filter_map(from).max_by(|a, b| a.1.total_cmp(&b.1));
    best.unwrap_or((pixel, score[pixel]))
}

fn figures(track: &[TrackPoint], path_m: &[[f64; 2]]) -> anyhow::Result<Figures> {
    let (walking, standing): (Vec<&TrackPoint>, Vec<&TrackPoint>) =
        track.iter().partition(|point| point.time_s < STANDS_FROM_S);
    let mut errors_m: Vec<f64> = walking
        .iter()
        .filter(|point| point.seen)
        .map(|point| distance_to(path_m, &Vector2::new(point.x_m, point.y_m)))
        .collect();
    errors_m.sort_by(f64::total_cmp);
    ensure!(!errors_m.is_empty(), "the walker is never seen");
    let step = |pair: &[&TrackPoint]| (pair[1].x_m - pair[0].x_m).hypot(pair[1].y_m - pair[0].y_m);
    Ok(Figures {
        median_error_m: errors_m[errors_m.len() / 2],
        p90_error_m: errors_m[errors_m.len() * 9 / 10],
        seen_share: seen_share(&walking),
        seen_standing_share: seen_share(&standing),
        track_length_m: walking.windows(2).map(step).sum(),
        image_count: track.len(),
    })
}

fn seen_share(points: &[&TrackPoint]) -> f64 {
    points.iter().filter(|point| point.seen).count() as f64 / points.len().max(1) as f64
}

/// Distance of `place_m` from a way of straight pieces.
fn distance_to(path_m: &[[f64; 2]], place_m: &Vector2<f64>) -> f64 {
    let piece = |ends: &[[f64; 2]]| {
        let (from, to) = (Vector2::from(ends[0]), Vector2::from(ends[1]));
        let along = to - from;
        let share = (place_m - from).dot(&along) / along.norm_squared().max(f64::MIN_POSITIVE);
        (place_m - from - along * share.clamp(0.0, 1.0)).norm()
    };
    path_m.windows(2).map(piece).fold(f64::INFINITY, f64::min)
}
