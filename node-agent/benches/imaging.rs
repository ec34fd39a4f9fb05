//! Time of every stage of a node's chain, of every kernel of back-projection, and of the textbook's
//! loop beside them: 334 × 334 pixels, 8 channels; then one table of it all.

#![expect(clippy::expect_used, reason = "a failing set-up is a failing run")]

use std::hint::black_box;
use std::io;
use std::time::{Duration, SystemTime};

use criterion::{BatchSize, Criterion, criterion_group};
use node_agent::detect::resolve::Resolver;
use node_agent::detect::response::PointModel;
use node_agent::detect::{DetectionConfig, Precision, Scan, SecondLook, detect, threshold};
use node_agent::imaging::Sweep;
use node_agent::imaging::backproject::{Backprojector, Coherence, Geometry, Kernel, Means};
use node_agent::imaging::canceller::{Cancelled, Canceller, CancellerConfig, Gates};
use node_agent::imaging::compress::{Compressor, Profiles};
use node_agent::imaging::oracle::textbook_image;
use node_agent::imaging::pixels::{Pixels, PolarGrid};
use node_agent::imaging::resample::resample;
use node_agent::imaging::wall::WallModel;
use node_agent::imaging::window::Window;
use node_agent::pipeline::{Chain, ChainConfig, MeasureOn};
use node_agent::simulate::{
    Disturbance, EchoSimulator, Noise, Radar, Scene, Target, TargetKind, WayPoint,
};
use proto::geom::{Node, Se2, World};
use proto::radar::{Array, Band, Grid};
use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};
use rustfft::num_complex::Complex;

#[path = "imaging/table.rs"]
mod table;

const FFT_LENGTH: usize = 2048;

/// Two targets, one of them hard to tell from a third.
fn sweep() -> Sweep {
    let target = |[x_m, y_m]: [f64; 2]| Target {
        way_points: vec![WayPoint { time_s: 0.0, x_m, y_m }],
        kind: TargetKind::Point,
        amplitude_db: 0.0,
    };
    let targets = [[-0.857, 5.429], [0.143, 5.143], [2.4, 7.0]].map(target).to_vec();
    let scene = Scene { targets, ..Scene::default() };
    let disturbance =
        Disturbance { noise: Noise::InBand { snr_db: 14.0 }, ..Disturbance::default() };
    let pose: Se2<World, Node> = Se2::identity();
    EchoSimulator::new(&scene, pose, &Radar::default(), &disturbance, 1)
        .expect("a scene that makes sense")
        .sweep(0, 0.0)
}

fn cartesian() -> Pixels {
    Pixels::Cartesian(Grid::default())
}

fn projector(pixels: &Pixels, means: &Means) -> Backprojector {
    let (band, array, wall) = (&Band::default(), &Array::default(), &WallModel::None);
    let geometry = Geometry { band, array, pixels, wall, fft_length: FFT_LENGTH };
    Backprojector::with_means(&geometry, means).expect("an image within the profile")
}

fn compressor() -> Compressor {
    let band = Band::default();
    Compressor::new(&band, &Window::Taylor.weights(band.step_count), FFT_LENGTH)
}

fn before_imaging(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("stages");
    let raw = sweep();
    let compressor = compressor();
    let mut memory = compressor.memory(8);
    compressor.compress_into(&raw.samples, &mut memory);
    let gates = Gates { kept_count: 580, per_cell: FFT_LENGTH as f64 / 301.0 };
    for (name, config) in [
        ("canceller_exponential", CancellerConfig::Exponential { time_constant_s: 2.0 }),
        ("canceller_slow_fast", CancellerConfig::default()),
    ] {
        let mut canceller = Canceller::new(config, gates);
        let mut time_s = 0.0;
        group.bench_function(name, |b| {
            b.iter(|| {
                time_s += 0.1;
                matches!(canceller.cancel(time_s, &memory.profiles), Cancelled::WarmingUp)
            });
        });
    }
    group.bench_function("compression", |b| {
        b.iter(|| compressor.compress_into(black_box(&raw.samples), &mut memory));
    });
    group.bench_function("noise_power", |b| {
        b.iter(|| threshold::noise_power(black_box(&memory.profiles)));
    });
    group.finish();
}

/// Profiles of data that fill the band.
fn noise_profiles() -> Profiles {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let samples: Vec<Complex<f32>> = (0..8 * 301)
        .map(|_| Complex::new(rng.random_range(-1.0..1.0), rng.random_range(-1.0..1.0)))
        .collect();
    compressor().compress(&samples)
}

fn back_projection(criterion: &mut Criterion) {
    let profiles = noise_profiles();
    let mut group = criterion.benchmark_group("back_projection");
    let (polar, whole) = (Pixels::Polar(PolarGrid::default()), cartesian());
    let by = |kernel| Means { kernel, ..Means::default() };
    let of = |coherence| Means { coherence, ..Means::default() };
    let shared = |kernel| Means { thread_count: 2, ..by(kernel) };
    for (name, pixels, means) in [
        ("one_thread", &whole, by(Kernel::Fastest)),
        ("one_thread", &whole, by(Kernel::Avx2)),
        ("one_thread", &whole, by(Kernel::Portable)),
        ("two_threads", &whole, shared(Kernel::Fastest)),
        ("two_threads", &whole, shared(Kernel::Avx2)),
        ("circular", &whole, of(Coherence::Circular)),
        ("phase", &whole, of(Coherence::Phase)),
        ("polar", &polar, by(Kernel::Fastest)),
        ("polar", &polar, by(Kernel::Avx2)),
        ("polar", &polar, by(Kernel::Portable)),
    ] {
        let projector = projector(pixels, &means);
        let mut workspace = projector.workspace();
        group.bench_function(format!("{name}/{}", projector.kernel_name()), |b| {
            b.iter(|| projector.project(black_box(&profiles), &mut workspace));
        });
    }
    group.sample_size(10);
    group.bench_function("textbook", |b| {
        let (band, array) = (Band::default(), Array::default());
        b.iter(|| textbook_image(&band, &array, &whole, black_box(&profiles)));
    });
    group.finish();
}

fn after_imaging(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("stages");
    let (band, array, wall) = (Band::default(), Array::default(), WallModel::None);
    let weights = Window::Taylor.weights(band.step_count);
    let profiles = compressor().compress(&sweep().samples);
    let image = projector(&cartesian(), &Means::default()).image(&profiles);
    let mut amplitude = image.weighted_amplitude();
    group.bench_function("amplitude", |b| {
        b.iter(|| black_box(&image).weighted_amplitude_into(&mut amplitude));
    });
    let noise_power = threshold::noise_power(&profiles);
    let precision = Precision::new(&band, &array, &weights);
    let resolver = Resolver::new(PointModel::new(&band, &array, &wall, &weights));
    let scan = Scan { profiles: &profiles, image: &image, amplitude: &amplitude, noise_power };
    let twice = DetectionConfig::points();
    let once = DetectionConfig { second_look: SecondLook::Off, ..twice };
    group.bench_function("peaks", |b| {
        b.iter(|| threshold::peaks(black_box(&image), &amplitude, noise_power, &once));
    });
    group.bench_function("detection_first_look", |b| {
        b.iter(|| detect(black_box(&scan), &once, &precision, &resolver));
    });
    group.bench_function("detection", |b| {
        b.iter(|| detect(black_box(&scan), &twice, &precision, &resolver));
    });
    let polar = projector(&Pixels::Polar(PolarGrid::default()), &Means::default()).image(&profiles);
    group.bench_function("resample_polar", |b| {
        b.iter(|| resample(black_box(&polar), &Grid::default()));
    });
    group.finish();
}

/// Two people who walk about an empty room for ten seconds; and the empty room.
fn walk() -> (Vec<Sweep>, Sweep) {
    let walker = |from_m: [f64; 2], to_m: [f64; 2]| Target {
        way_points: [(0.0, from_m), (10.0, to_m)]
            .map(|(time_s, [x_m, y_m])| WayPoint { time_s, x_m, y_m })
            .to_vec(),
        kind: TargetKind::Point,
        amplitude_db: 0.0,
    };
    let targets = vec![walker([-2.0, 3.0], [-1.0, 8.0]), walker([1.5, 6.0], [2.5, 2.5])];
    let disturbance =
        Disturbance { noise: Noise::InBand { snr_db: 14.0 }, ..Disturbance::default() };
    let scene = Scene { targets, ..Scene::default() };
    let pose: Se2<World, Node> = Se2::identity();
    let people = EchoSimulator::new(&scene, pose, &Radar::default(), &disturbance, 1)
        .expect("a scene that makes sense");
    let sweeps = (0..100).map(|k| people.sweep(k, 0.1 * k as f64)).collect();
    let mut empty = people.sweep(0, 0.0);
    empty.samples.fill(Complex::default());
    (sweeps, empty)
}

/// The chain as it runs on a node: the canceller of two backgrounds, two people.
fn chain(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("chain");
    let (sweeps, empty) = walk();
    let points = ChainConfig { detection: DetectionConfig::points(), ..ChainConfig::default() };
    for (name, thread_count, measure_on, like) in [
        ("one_thread", 1, MeasureOn::Image, &ChainConfig::default()),
        ("two_threads", 2, MeasureOn::Image, &ChainConfig::default()),
        ("polar", 1, MeasureOn::Polar, &ChainConfig::default()),
        ("points_one_thread", 1, MeasureOn::Image, &points),
    ] {
        let config = ChainConfig { thread_count, measure_on, ..like.clone() };
        let mut chain = Chain::new(&config).expect("settings that make sense");
        chain.use_background(&empty.samples).expect("a sweep of this radar");
        let mut next = (0..).zip(sweeps.iter().chain(sweeps.iter().rev()).cycle());
        group.bench_function(name, |b| {
            b.iter_batched(
                || {
                    let (number, sweep) = next.next().expect("no end");
                    Sweep { time_s: 0.1 * f64::from(number), samples: sweep.samples.clone() }
                },
                |next| chain.process_sweep(&next).map(|measured| measured.points.len()),
                BatchSize::SmallInput,
            );
        });
    }
    group.sample_size(10);
    group.bench_function("new", |b| b.iter(|| Chain::new(black_box(&ChainConfig::of_points()))));
    group.finish();
}

criterion_group! {
    name = imaging;
    config = Criterion::default()
        .sample_size(30)
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1));
    targets = before_imaging, back_projection, after_imaging, chain
}

fn main() -> io::Result<()> {
    #[expect(clippy::disallowed_methods, reason = "only what this run measured is told")]
    let start = SystemTime::now();
    imaging();
    Criterion::default().configure_from_args().final_summary();
    let kernel = projector(&cartesian(), &Means::default()).kernel_name();
    table::write(&mut io::stdout().lock(), start, kernel)
}
