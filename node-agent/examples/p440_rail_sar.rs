//! A real impulse radar on a rail becomes an image: the node's own chain on someone else's echoes.
//!
//! A P440 (3.1 to 4.8 GHz) was moved along a rail past a corner reflector; cameras measured where it
//! was at each of its 641 scans. Every place it stopped at is one channel of a large array whose
//! transmitter and receiver are the same:
//! 1. scans (real samples over delay) are brought to samples over frequency, which is what a
//!    stepped-frequency radar measures in the first place ([`spectra`]);
//! 2. window and compression are the node's ([`Compressor`]): profiles without carrier;
//! 3. back-projection sums `s(2R/c) exp(j 2π f_c 2R/c)` over all places ([`back_project`]), the
//!    node's formula with other legs;
//! 4. coherence, threshold and peaks are the node's again ([`threshold`]).
//!
//! The image's frame is that of a node in the middle of the rail: `x` to the right along the rail
//! (the cameras' `z`), `y` along boresight (the cameras' `x`); all pixels at the reflector's height.
//!
//! ```text
//! cargo run --release --example p440_rail_sar -- [FOLDER] [--picture FILE] [--json]
//! ```

use std::f64::consts::TAU;
use std::path::Path;

use anyhow::{Context, ensure};
use nalgebra::{Vector2, Vector3};
use rustfft::FftPlanner;
use rustfft::num_complex::Complex;
use serde::Serialize;

use node_agent::detect::threshold::{self, Peak};
use node_agent::detect::{DetectionConfig, Threshold};
use node_agent::imaging::backproject::CoherentImage;
use node_agent::imaging::compress::{Compressor, Profiles};
use node_agent::imaging::pixels::Pixels;
use node_agent::imaging::window::Window;
use node_agent::plot::Picture;
use proto::measured::MeasuredPoint;
use proto::radar::{Band, Grid, SPEED_OF_LIGHT_M_PER_S};

use support::{Call, read_array, single};

mod support;

/// Cameras started this much before the radar, seconds (fitted on the reflector by others).
const CAMERAS_AHEAD_S: f64 = 4.62;
/// The radar's range bins say this much more than the distance, metres: cables (fitted likewise).
const RANGE_OFFSET_M: f64 = 0.43;
/// What the radar transmits.
const BAND_HZ: [f64; 2] = [3.1e9, 4.8e9];
/// Scans nearer to the one before than this, metres, add nothing: a quarter of a wavelength is 0.019.
const MIN_STEP_M: f64 = 0.005;
/// Delay samples of a profile: 30 for each resolution cell, since interpolation is linear.
const FFT_LENGTH: usize = 4096;
/// The corner reflector in the cameras' frame, metres.
const REFLECTOR_M: [f64; 3] = [-1.007, 0.067, -1.149];
/// The image, in the frame of the rail; nearer than this there is the floor below the radar.
const GRID: Grid =
    Grid { x_min_m: -3.0, y_min_m: 1.5, pixel_m: 0.03, column_count: 201, row_count: 151 };
/// Peaks are refined in steps of this, metres.
const FINE_STEP_M: f64 = 0.002;

/// The recording, and where the radar was at each scan.
struct Recording {
    /// Samples of one scan.
    sample_count: usize,
    /// Distance of the first sample and of neighbouring ones, metres.
    first_range_m: f64,
    range_step_m: f64,
    /// `[scan][sample]`.
    scans: Vec<f64>,
    /// In the cameras' frame, `y` up, metres.
    positions_m: Vec<Vector3<f64>>,
}

/// A peak of the image in the cameras' frame.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Found {
    /// Along boresight of the rail.
    pub(crate) x_m: f64,
    /// Along the rail.
    pub(crate) z_m: f64,
    /// Power under the strongest peak, decibels.
    pub(crate) power_db: f64,
    /// Coherence factor over all places.
    pub(crate) coherence: f64,
}

/// What the recording shows.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Figures {
    /// Places of the radar that were used.
    pub(crate) place_count: usize,
    /// Length of the way between the first and the last of them, metres.
    pub(crate) aperture_m: f64,
    /// Distance of the strongest peak from the reflector in the plane of the image, metres.
    pub(crate) reflector_error_m: f64,
    /// All peaks, strongest first.
    pub(crate) peaks: Vec<Found>,
}

fn main() -> anyhow::Result<()> {
    let call = Call::from_command_line("../shared/data/p440-rail-sar", "p440_rail_sar.png")?;
    let (figures, picture) = run(&call.folder)?;
    call.finish(&figures, &picture)
}

/// The figures and the picture (PNG) of the recording in `folder`.
///
/// # Errors
/// If the recording is absent or not as it should be.
pub(crate) fn run(folder: &Path) -> anyhow::Result<(Figures, Vec<u8>)> {
    let recording = thinned(load(folder)?);
    let (band, samples) = spectra(&recording);
    let weights = Window::Taylor.weights(band.step_count);
    let profiles = Compressor::new(&band, &weights, FFT_LENGTH).compress(&samples);
    let sar = Sar { recording: &recording, band, profiles, middle_m: middle(&recording) };

    let image = sar.back_project(&GRID);
    let amplitude = image.weighted_amplitude();
    let noise_power = threshold::noise_power(&sar.profiles);
    let peaks = threshold::peaks(&image, &amplitude, noise_power, &detection());
    let strongest = peaks.first().context("nothing stands out of the noise")?.power;
    let places: Vec<Vector2<f64>> = peaks.iter().map(|peak| sar.refined(&image, peak)).collect();
    let found = |(peak, place): (&Peak, &Vector2<f64>)| Found {
        x_m: place.y + sar.middle_m.x,
        z_m: place.x + sar.middle_m.z,
        power_db: 10.0 * f64::from(peak.power / strongest).log10(),
        coherence: f64::from(image.coherence(peak.index)),
    };
    let peaks: Vec<Found> = peaks.iter().zip(&places).map(found).collect();
    let figures = Figures {
        place_count: recording.positions_m.len(),
        aperture_m: aperture(&recording),
        reflector_error_m: (peaks[0].x_m - REFLECTOR_M[0]).hypot(peaks[0].z_m - REFLECTOR_M[2]),
        peaks,
    };
    Ok((figures, picture(&image, &places)?))
}

/// Peaks far above the noise on which many places agree.
fn detection() -> DetectionConfig {
    DetectionConfig {
        threshold: Threshold::Noise { power_ratio: 100.0, min_coherence: 0.1 },
        separation_range_m: 0.3,
        separation_sine: 0.06,
        ..DetectionConfig::default()
    }
}

fn load(folder: &Path) -> anyhow::Result<Recording> {
    let (shape, scans) = read_array::<i32>(&folder.join("scans_i32.npy"))?;
    let (_, ranges_m) = read_array::<f64>(&folder.join("range_bins_m_f64.npy"))?;
    let (_, times_ms) = read_array::<f64>(&folder.join("timestamps_ms_f64.npy"))?;
    ensure!(shape == [times_ms.len(), ranges_m.len()], "scans have the shape {shape:?}");
    ensure!(2 <= ranges_m.len() && !times_ms.is_empty(), "the recording is empty");
    let path = folder.join("radar_position.csv");
    let text = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
    let track = text.lines().skip(1).map(camera_row).collect::<anyhow::Result<Vec<_>>>()?;
    let positions_m = times_ms
        .iter()
        .map(|ms| position_at(&track, 1e-3 * (ms - times_ms[0]) + CAMERAS_AHEAD_S))
        .collect::<anyhow::Result<_>>()?;
    Ok(Recording {
        sample_count: ranges_m.len(),
        first_range_m: ranges_m[0] - RANGE_OFFSET_M,
        range_step_m: (ranges_m[ranges_m.len() - 1] - ranges_m[0]) / (ranges_m.len() - 1) as f64,
        scans: scans.into_iter().map(f64::from).collect(),
        positions_m,
    })
}

/// Time in seconds and position of one line `t_s,x_m,y_m,z_m`.
fn camera_row(line: &str) -> anyhow::Result<(f64, Vector3<f64>)> {
    let numbers: Vec<f64> = line
        .split(',')
        .map(|text| text.trim().parse().with_context(|| format!("camera line {line:?}")))
        .collect::<anyhow::Result<_>>()?;
    ensure!(numbers.len() == 4, "camera line {line:?} has not 4 numbers");
    Ok((numbers[0], Vector3::new(numbers[1], numbers[2], numbers[3])))
}

fn position_at(track: &[(f64, Vector3<f64>)], time_s: f64) -> anyhow::Result<Vector3<f64>> {
    let after = track.partition_point(|(t_s, _)| *t_s < time_s);
    ensure!(0 < after && after < track.len(), "the cameras did not see the radar at {time_s} s");
    let ((before_s, before_m), (after_s, after_m)) = (track[after - 1], track[after]);
    Ok(before_m.lerp(&after_m, (time_s - before_s) / (after_s - before_s)))
}

/// One scan for each step of the radar, so that standing still gives no place more weight.
fn thinned(recording: Recording) -> Recording {
    let mut kept = Recording { scans: Vec::new(), positions_m: Vec::new(), ..recording };
    let scans = recording.scans.chunks_exact(recording.sample_count);
    for (position_m, scan) in recording.positions_m.iter().zip(scans) {
        let moved =
            kept.positions_m.last().is_none_or(|last| MIN_STEP_M < (position_m - last).norm());
        if moved {
            kept.positions_m.push(*position_m);
            kept.scans.extend(scan);
        }
    }
    kept
}

/// Samples over frequency, `[scan][frequency]`, without what all scans share: the leakage from
/// transmitter to receiver.
fn spectra(recording: &Recording) -> (Band, Vec<Complex<f32>>) {
    let count = recording.sample_count;
    let step_hz = SPEED_OF_LIGHT_M_PER_S / (2.0 * recording.range_step_m * count as f64);
    let bins: Vec<usize> = (0..count / 2)
        .filter(|bin| (BAND_HZ[0]..=BAND_HZ[1]).contains(&(step_hz * *bin as f64)))
        .collect();
    let start_hz = step_hz * bins.first().copied().unwrap_or(0) as f64;
    let band = Band { start_hz, step_hz, step_count: bins.len() };
    let scan_count = recording.positions_m.len() as f64;
    let mut shared = vec![0.0; count];
    for scan in recording.scans.chunks_exact(count) {
        shared.iter_mut().zip(scan).for_each(|(sum, sample)| *sum += sample / scan_count);
    }
    let transform = FftPlanner::new().plan_fft_forward(count);
    let mut samples = Vec::with_capacity(recording.positions_m.len() * bins.len());
    for scan in recording.scans.chunks_exact(count) {
        let own = scan.iter().zip(&shared).map(|(sample, mean)| sample - mean);
        let mut spectrum: Vec<Complex<f64>> = own.map(|s| Complex::new(s, 0.0)).collect();
        transform.process(&mut spectrum);
        // Half of a real signal's spectrum is its analytic signal.
        let half = bins.iter().map(|bin| spectrum[*bin]);
        samples.extend(half.map(|s| Complex::new(single(s.re), single(s.im))));
    }
    (band, samples)
}

fn middle(recording: &Recording) -> Vector3<f64> {
    recording.positions_m.iter().sum::<Vector3<f64>>() / recording.positions_m.len() as f64
}

fn aperture(recording: &Recording) -> f64 {
    let ends = recording.positions_m.first().zip(recording.positions_m.last());
    ends.map_or(0.0, |(first, last)| (last - first).norm())
}

/// All that an image is made of.
struct Sar<'a> {
    recording: &'a Recording,
    band: Band,
    profiles: Profiles,
    middle_m: Vector3<f64>,
}

impl Sar<'_> {
    /// Coherent sum and energy at every pixel.
    fn back_project(&self, grid: &Grid) -> CoherentImage {
        let pixels = Pixels::Cartesian(*grid);
        let sums = (0..grid.pixel_count()).map(|index| self.sum_at(&pixels.coords_m(index)));
        let (power, energy) =
            sums.map(|(sum, energy)| (single(sum.norm_sqr()), single(energy))).unzip();
        let channel_count = self.recording.positions_m.len();
        CoherentImage { pixels, channel_count, power, energy, phase_coherence: Vec::new() }
    }

    /// The coherent sum and the energy at `[x, y]` of the image's frame.
    fn sum_at(&self, place_m: &Vector2<f64>) -> (Complex<f64>, f64) {
        let pixel_m =
            Vector3::new(place_m.y + self.middle_m.x, REFLECTOR_M[1], place_m.x + self.middle_m.z);
        let (mut sum, mut energy) = (Complex::new(0.0, 0.0), 0.0);
        for (position_m, profile) in self.recording.positions_m.iter().zip(self.profiles.channels())
        {
            let range_m = (pixel_m - position_m).norm() - self.recording.first_range_m;
            let delay_s = 2.0 * range_m / SPEED_OF_LIGHT_M_PER_S;
            let Some(sample) = interpolated(profile, delay_s * self.profiles.sample_rate_hz) else {
                continue;
            };
            sum += sample * Complex::cis(TAU * (self.band.carrier_hz() * delay_s).fract());
            energy += sample.norm_sqr();
        }
        (sum, energy)
    }

    /// The place of most power around `peak`.
    fn refined(&self, image: &CoherentImage, peak: &Peak) -> Vector2<f64> {
        let mut place = image.pixels.coords_m(peak.index);
        let mut power = self.sum_at(&place).0.norm_sqr();
        loop {
            let steps = [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)];
            let near = steps.map(|(dx, dy)| place + Vector2::new(dx, dy) * FINE_STEP_M);
            let powers = near.map(|at| (self.sum_at(&at).0.norm_sqr(), at));
            let best = powers.iter().max_by(|a, b| a.0.total_cmp(&b.0));
            match best {
                Some((better, at)) if power < *better => (power, place) = (*better, *at),
                _ => return place,
            }
        }
    }
}

/// `profile` at `place` samples, linearly; `None` beyond its ends.
#[expect(clippy::cast_possible_truncation, reason = "the whole part is meant")]
fn interpolated(profile: &[Complex<f32>], place: f64) -> Option<Complex<f64>> {
    let at =
        |index: usize| profile.get(index).map(|s| Complex::new(f64::from(s.re), f64::from(s.im)));
    let before = if 0.0 <= place { place as usize } else { return None };
    let rest = place - before as f64;
    Some(at(before)? * (1.0 - rest) + at(before + 1)? * rest)
}

fn picture(image: &CoherentImage, places: &[Vector2<f64>]) -> anyhow::Result<Vec<u8>> {
    let mark = |place: &Vector2<f64>| MeasuredPoint {
        x_m: place.x,
        y_m: place.y,
        // A circle of 0.1 m around the peak, drawn at two sigma.
        cov_m2: [0.0025, 0.0, 0.0025],
        snr_db: 0.0,
        extent_m2: [0.0; 3],
        radial_velocity_m_per_s: None,
    };
    let amplitude = image.weighted_amplitude();
    let points: Vec<MeasuredPoint> = places.iter().map(mark).collect();
    let title = "P440 on a rail along y = 0, coherence-weighted; circles: peaks".to_owned();
    let mut png = Vec::new();
    Picture { title, grid: GRID, amplitude: &amplitude, points: &points }.write_png(&mut png)?;
    Ok(png)
}
