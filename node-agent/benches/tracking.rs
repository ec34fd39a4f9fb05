//! Time of one frame of every tracker with five people in the experiments' room, noise of 15 dB; the
//! paper's tracker sees painted images, the default one what its chain measured. The budget is 0.1 ms.

#![expect(clippy::expect_used, reason = "a failing set-up is a failing run")]

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use node_agent::pipeline::{Chain, ChainConfig};
use node_agent::simulate::{EchoSimulator, Scene};
use node_agent::tracking::default::{BodyModel, DefaultConfig, DefaultTracker};
use node_agent::tracking::experiments::{
    Experiment, IMAGE_SNR_DB, disturbance, in_the_room, radar, room,
};
use node_agent::tracking::paper::{PaperConfig, PaperTracker};
use node_agent::tracking::{Frame, Tracker};
use proto::geom::Se2;
use proto::measured::MeasuredPoint;
use proto::radar::Grid;
use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};
use rustfft::num_complex::Complex;

const FRAME_COUNT: u32 = 100;
/// Where people start, metres; all walk to and fro.
const STARTS_M: [[f64; 2]; 5] = [[-2.5, 2.0], [0.0, 3.0], [2.0, 4.5], [-1.0, 6.5], [2.5, 8.5]];
/// Of peaks of 1, in the weighted image.
const NOISE: f32 = 0.03;

/// People as hills as wide as the array's beam, in even noise.
fn images(grid: &Grid) -> Vec<Vec<f32>> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let image = |number: u32| {
        let walked_m = (0.1 * f64::from(number)).sin();
        let value = |index: usize| {
            let x_m = grid.x_m(index % grid.column_count);
            let y_m = grid.y_m(index / grid.column_count);
            let hill = |start_m: &[f64; 2]| {
                let dx = (x_m - start_m[0]) / (0.12 * start_m[1]);
                let dy = (y_m - start_m[1] - walked_m) / 0.15;
                (-dx * dx - dy * dy).exp()
            };
            let people: f64 = STARTS_M.iter().map(hill).sum();
            #[expect(clippy::cast_possible_truncation, reason = "a picture")]
            let people = people as f32;
            people + NOISE * rng.random::<f32>()
        };
        (0..grid.pixel_count()).map(value).collect()
    };
    (0..FRAME_COUNT).map(image).collect()
}

/// What the chain made of a sweep.
struct Seen {
    amplitude: Vec<f32>,
    noise_amplitude: f32,
    points: Vec<MeasuredPoint>,
}

/// The side by side walk of experiment 3 by two people, and three more in that room.
fn five_people() -> Scene {
    let mut scene = Experiment::numbered(3).expect("one of the four").scene();
    for (x_m, y_m) in [(-3.0, 1.5), (1.5, 5.0), (-1.0, 5.0)] {
        let mut target = scene.targets[0].clone();
        for way_point in &mut target.way_points {
            way_point.x_m += x_m;
            way_point.y_m += y_m;
        }
        scene.targets.push(target);
    }
    scene
}

/// The frames of five people.
fn seen() -> Vec<Seen> {
    let config = in_the_room(ChainConfig::default());
    let mut chain = Chain::new(&config).expect("the default settings");
    let empty = vec![Complex::default(); config.array.channel_count() * config.band.step_count];
    chain.use_background(&empty).expect("a sweep of that radar");
    let spoilt = disturbance(IMAGE_SNR_DB);
    let simulator = EchoSimulator::new(&five_people(), Se2::identity(), &radar(), &spoilt, 1)
        .expect("a scene that makes sense");
    let seen = |number: u32| {
        let sweep = simulator.sweep(u64::from(number), 0.1 * f64::from(number));
        let measured = chain.process_sweep(&sweep).expect("a sweep of that radar");
        Seen {
            amplitude: measured.image.amplitude.to_vec(),
            noise_amplitude: measured.image.noise_amplitude,
            points: measured.points,
        }
    };
    (0..FRAME_COUNT).map(seen).collect()
}

/// One frame of the default tracker: to and fro through what was seen, so that nobody jumps.
fn default_tracker(criterion: &mut Criterion) {
    let mut tracker = DefaultTracker::new(&DefaultConfig::default(), BodyModel::default())
        .expect("the default settings");
    let (grid, seen) = (room(), seen());
    let (mut number, mut told_count, mut frame_count) = (0_u32, 0_usize, 0_usize);
    criterion.bench_function("tracking/default", |bencher| {
        bencher.iter(|| {
            let phase = number % (2 * FRAME_COUNT);
            let index = phase.min(2 * FRAME_COUNT - 1 - phase);
            let Seen { amplitude, noise_amplitude, points } = &seen[index as usize];
            let time_s = 0.1 * f64::from(number);
            number += 1;
            let noise_amplitude = *noise_amplitude;
            let frame = Frame { time_s, grid, amplitude, noise_amplitude, points };
            told_count += tracker.track(&frame).expect("a frame that makes sense").len();
            frame_count += 1;
        });
    });
    assert!(4 * frame_count < told_count, "{told_count} tracks in {frame_count} frames");
}

/// One frame of a tracker that follows five people.
fn frames(criterion: &mut Criterion, name: &str, tracker: &mut dyn Tracker) {
    let grid = room();
    let images = images(&grid);
    let mut number = 0_u32;
    criterion.bench_function(name, |bencher| {
        bencher.iter(|| {
            let amplitude = &images[(number % FRAME_COUNT) as usize];
            let time_s = 0.1 * f64::from(number);
            number += 1;
            let frame = Frame { time_s, grid, amplitude, noise_amplitude: NOISE, points: &[] };
            black_box(tracker.track(&frame).expect("a frame that makes sense").len())
        });
    });
}

fn trackers(criterion: &mut Criterion) {
    let mut paper = PaperTracker::new(&PaperConfig::default()).expect("the default settings");
    frames(criterion, "tracking/paper", &mut paper);
    default_tracker(criterion);
}

criterion_group!(benches, trackers);
criterion_main!(benches);
