//! Time of one frame of every tracker: five people in an image of the experiments' room, with the
//! noise of 15 dB. The budget is 0.1 ms.

#![expect(clippy::expect_used, reason = "a failing set-up is a failing run")]

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use node_agent::tracking::experiments::room;
use node_agent::tracking::paper::{PaperConfig, PaperTracker};
use node_agent::tracking::{Frame, Tracker};
use proto::radar::Grid;
use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};

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
}

criterion_group!(benches, trackers);
criterion_main!(benches);
