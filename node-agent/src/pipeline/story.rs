//! People who walk, stop and leave before static clutter: what is reported where, for each canceller.

use std::f64::consts::TAU;

use nalgebra::Vector2;
use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};
use rand_distr::{Distribution, StandardNormal};

use super::*;
use crate::imaging::backproject::CoherentImage;
use crate::imaging::single;

/// A point within this of a person is his: half a body and three standard deviations, metres.
const GATE_M: f64 = 0.6;
/// Sweeps in a second, unless told otherwise.
const RATE_HZ: f64 = 10.0;
/// Amplitude of the strongest clutter over that of a person: 60 dB of power.
const CLUTTER: f64 = 1e3;
const SLOW_FAST: CancellerConfig = CancellerConfig::SlowFast { fast_s: 1.0, slow_s: 10.0 };

/// Where the middle of a person is, if he is there, metres in the node's frame.
type Path = fn(f64) -> Option<Vector2<f64>>;

struct Story {
    path: Path,
    /// When sweeps are taken.
    times_s: Vec<f64>,
    /// Power of the person in the image over noise, decibels.
    snr_db: f64,
    /// Change of all gains in a second.
    drift_per_s: f64,
    /// Whether he breathes and sways, or is a plain point.
    is_person: bool,
    seed: u64,
}

impl Story {
    fn new(path: Path, duration_s: f64) -> Self {
        let times_s = (0..).map(|k| f64::from(k) / RATE_HZ).take_while(|t| *t < duration_s);
        let times_s = times_s.collect();
        Self { path, times_s, snr_db: 25.0, drift_per_s: 5e-4, is_person: true, seed: 1 }
    }

    /// Places and gains of the scatterers: a chest that breathes and a body that sways.
    fn body(&self, time_s: f64) -> Vec<(Vector2<f64>, Complex<f64>)> {
        let Some(middle_m) = (self.path)(time_s) else { return Vec::new() };
        if !self.is_person {
            return vec![(middle_m, Complex::new(1.0, 0.0))];
        }
        let wave = |amplitude_m: f64, rate_hz: f64, phase: f64| {
            amplitude_m * (TAU * rate_hz * time_s + phase).sin()
        };
        let along_m = wave(0.004, 0.21, 1.1) + wave(0.002, 0.43, 2.0);
        let moved_m = middle_m + Vector2::new(wave(0.006, 0.13, 0.3), along_m);
        let breath_m = wave(0.0025, 0.25, 0.0);
        let part = |x: f64, y: f64, breathes: f64, gain: f64, phase: f64| {
            let place_m = moved_m + Vector2::new(x, y + breathes * breath_m);
            (place_m, Complex::from_polar(gain, phase))
        };
        vec![
            part(0.0, -0.10, 1.0, 0.85, 0.0),
            part(0.16, -0.03, 0.5, 0.3, 1.9),
            part(-0.17, -0.02, 0.5, 0.3, 4.0),
            part(0.05, 0.06, 0.0, 0.2, 2.6),
        ]
    }

    /// The sweep at `time_s`: what stands and the person, with drift, and noise.
    fn sweep(&self, fixed: &[Complex<f64>], time_s: f64, rng: &mut ChaCha8Rng) -> Sweep {
        let drift = 1.0 + Complex::from_polar(self.drift_per_s * time_s, 0.9);
        let noise = (301.0 * 8.0 * 10_f64.powf(-0.1 * self.snr_db) / 2.0).sqrt();
        let mut draw = || -> f64 { StandardNormal.sample(rng) };
        let samples = fixed.iter().zip(echo(&self.body(time_s))).map(|(stands, moves)| {
            narrow(&((stands + moves) * drift + Complex::new(draw(), draw()) * noise))
        });
        Sweep { time_s, samples: samples.collect() }
    }

    fn tell(&self, canceller: CancellerConfig) -> Told {
        let (mut chain, fixed) = (chain(canceller), echo(&clutter()));
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let mut told = Told::default();
        for time_s in &self.times_s {
            let measured = chain.process_sweep(&self.sweep(&fixed, *time_s, &mut rng)).unwrap();
            told.add(*time_s, (self.path)(*time_s), &measured);
        }
        told
    }

    /// The largest and the mean loss of the image's peak near the person against the image without
    /// canceller and clutter, from `from_s` on, decibels.
    fn loss_db(&self, canceller: CancellerConfig, from_s: f64) -> [f64; 2] {
        let (mut chain, fixed) = (chain(canceller), echo(&clutter()));
        let nothing = vec![Complex::new(0.0, 0.0); fixed.len()];
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let mut losses_db = Vec::new();
        for time_s in &self.times_s {
            let [received, alone] = [&fixed, &nothing]
                .map(|stands| self.sweep(stands, *time_s, &mut rng))
                .map(|sweep| chain.compressor.compress(&sweep.samples));
            let state = chain.canceller.cancel(*time_s, &received);
            let (Cancelled::Moving(moving), Some(place_m)) = (state, (self.path)(*time_s)) else {
                continue;
            };
            if from_s <= *time_s {
                let [got, want] = [moving, &alone]
                    .map(|profiles| peak_near(&chain.backprojector.image(profiles), &place_m));
                losses_db.push(10.0 * (want / got).log10());
            }
        }
        let mean_db = losses_db.iter().sum::<f64>() / losses_db.len() as f64;
        [losses_db.iter().fold(f64::NEG_INFINITY, |a, b| a.max(*b)), mean_db]
    }
}

/// A chain with a coarse image, which is enough to find people.
fn chain(canceller: CancellerConfig) -> Chain {
    let grid =
        Grid { x_min_m: -4.98, y_min_m: 0.0, pixel_m: 0.06, column_count: 167, row_count: 167 };
    let config = ChainConfig { canceller, grid, ..ChainConfig::of_points() };
    let mut chain = Chain::new(&config).unwrap();
    if canceller == CancellerConfig::Background {
        let empty: Vec<Complex<f32>> = echo(&clutter()).iter().map(narrow).collect();
        chain.use_background(&empty).unwrap();
    }
    chain
}

fn narrow(z: &Complex<f64>) -> Complex<f32> {
    Complex::new(single(z.re), single(z.im))
}

/// What stands in the room: the wall and some furniture.
fn clutter() -> Vec<(Vector2<f64>, Complex<f64>)> {
    [(0.3, 0.6, 1.0), (-2.0, 4.2, 0.05), (2.5, 6.5, 0.03), (0.5, 8.0, 0.1)]
        .map(|(x, y, gain)| (Vector2::new(x, y), Complex::new(gain * CLUTTER, 0.0)))
        .to_vec()
}

/// The echo of scatterers in all channels.
fn echo(scatterers: &[(Vector2<f64>, Complex<f64>)]) -> Vec<Complex<f64>> {
    let (band, array) = (Band::default(), Array::default());
    let channels = array.tx_m.iter().flat_map(|tx| array.rx_m.iter().map(move |rx| [*tx, *rx]));
    let mut samples = Vec::new();
    for [tx, rx] in channels {
        let mut channel = vec![Complex::new(0.0, 0.0); band.step_count];
        for (place_m, gain) in scatterers {
            let legs_m = [tx, rx].map(|antenna| (place_m - Vector2::from(antenna)).norm());
            let delay_s = (legs_m[0] + legs_m[1]) / 299_792_458.0;
            let mut value = gain * Complex::cis(-TAU * band.start_hz * delay_s);
            let step = Complex::cis(-TAU * band.step_hz * delay_s);
            for sample in &mut channel {
                *sample += value;
                value *= step;
            }
        }
        samples.extend(channel);
    }
    samples
}

/// The largest power within 0.3 m of a place.
fn peak_near(image: &CoherentImage, place_m: &Vector2<f64>) -> f64 {
    (0..image.power.len())
        .filter(|index| (image.pixels.coords_m(*index) - place_m).norm() < 0.3)
        .map(|index| f64::from(image.power[index]))
        .fold(0.0, f64::max)
}

/// What was reported.
#[derive(Default)]
struct Told {
    frames: Vec<Frame>,
}

struct Frame {
    time_s: f64,
    is_there: bool,
    is_found: bool,
    others_m: Vec<Vector2<f64>>,
}

impl Told {
    fn add(&mut self, time_s: f64, truth_m: Option<Vector2<f64>>, measured: &Measured) {
        let places_m = measured.points.iter().map(|point| Vector2::new(point.x_m, point.y_m));
        let (own, others_m): (Vec<_>, Vec<_>) = places_m.partition(|place_m| {
            truth_m.is_some_and(|truth_m: Vector2<f64>| (place_m - truth_m).norm() < GATE_M)
        });
        let (is_there, is_found) = (truth_m.is_some(), !own.is_empty());
        self.frames.push(Frame { time_s, is_there, is_found, others_m });
    }

    /// The share of the frames in which a person was found that was there, and other points per
    /// frame, from the first time to the second, seconds.
    fn found_and_others(&self, from_s: f64, to_s: f64) -> (f64, f64) {
        let part: Vec<&Frame> =
            self.frames.iter().filter(|f| (from_s..to_s).contains(&f.time_s)).collect();
        let share = |count: usize, of: usize| count as f64 / (of as f64).max(1.0);
        let there = part.iter().filter(|f| f.is_there).count();
        let found = part.iter().filter(|f| f.is_found).count();
        (share(found, there), share(part.iter().map(|f| f.others_m.len()).sum(), part.len()))
    }

    /// Share found and others per frame while he comes, stands, goes, is gone, and in all.
    fn summary(&self) -> String {
        let phases = [(2.0, 8.0), (8.0, 38.0), (38.0, 44.0), (44.0, 60.0), (0.0, 60.0)];
        let told = phases.map(|(from_s, to_s)| {
            let (found, others) = self.found_and_others(from_s, to_s);
            format!("{found:.2} + {others:.3}")
        });
        told.join(", ")
    }

    /// Other points within a range cell of `place_m` from `from_s` on.
    fn others_near(&self, place_m: [f64; 2], from_s: f64) -> usize {
        let late = self.frames.iter().filter(|f| from_s <= f.time_s);
        let near = |p: &&Vector2<f64>| (*p - Vector2::from(place_m)).norm() < GATE_M;
        late.map(|f| f.others_m.iter().filter(near).count()).sum()
    }
}

/// In at 2 s, at (0.5, 5) by 8 s, there until 38 s, out to the side by 44 s and gone.
fn visit(time_s: f64) -> Option<Vector2<f64>> {
    let [from, stop, to] = [[-2.0, 7.5], [0.5, 5.0], [-2.6, 3.6]].map(Vector2::from);
    match time_s {
        t if !(2.0..44.0).contains(&t) => None,
        t if t < 8.0 => Some(from + (stop - from) * ((t - 2.0) / 6.0)),
        t if t < 38.0 => Some(stop),
        t => Some(stop + (to - stop) * ((t - 38.0) / 6.0)),
    }
}

/// The same, but he is there when the radar is switched on.
fn there_at_first(time_s: f64) -> Option<Vector2<f64>> {
    visit(if time_s < 8.0 { 8.0 } else { time_s })
}

/// Straight from `[x, y]` metres with `[vx, vy]` m/s, from `start_s` on.
fn straight(time_s: f64, start_s: f64, walk: [[f64; 2]; 2]) -> Option<Vector2<f64>> {
    let [from, velocity] = walk.map(Vector2::from);
    (start_s <= time_s).then(|| from + velocity * (time_s - start_s))
}

/// Walks of 5 s; those that begin at 3 s find a background without anybody.
const WALKS: [(&str, f64, Path); 8] = [
    ("radial 0.5", 3.0, |t| straight(t, 3.0, [[0.4, 6.5], [0.0, -0.5]])),
    ("radial 0.8", 3.0, |t| straight(t, 3.0, [[0.4, 7.0], [0.0, -0.8]])),
    ("tangential 0.5", 3.0, |t| straight(t, 3.0, [[-1.5, 5.0], [0.5, 0.0]])),
    ("tangential 0.8", 3.0, |t| straight(t, 3.0, [[-2.0, 4.5], [0.8, 0.0]])),
    ("radial 1.5", 3.0, |t| straight(t, 3.0, [[0.4, 9.0], [0.0, -1.5]])),
    ("tangential 1.5", 3.0, |t| straight(t, 3.0, [[-3.0, 5.0], [1.5, 0.0]])),
    ("radial 0.5 at once", 1.0, |t| straight(t, 0.0, [[0.4, 6.5], [0.0, -0.5]])),
    ("tangential 0.5 at once", 1.0, |t| straight(t, 0.0, [[-1.5, 5.0], [0.5, 0.0]])),
];

/// A plain point whose noise does not matter.
fn clean_walk(path: Path) -> Story {
    Story { snr_db: 45.0, is_person: false, drift_per_s: 0.0, ..Story::new(path, 8.0) }
}

#[test]
fn a_walker_loses_nothing_to_slow_fast() {
    for (name, from_s, path) in &WALKS[..4] {
        let [worst_db, mean_db] = clean_walk(*path).loss_db(SLOW_FAST, *from_s);
        assert!(worst_db < 1.5 && mean_db < 0.3, "{name}: {worst_db} dB, {mean_db} dB");
    }
    // What the same measure says of the seed's canceller at its blind speed.
    let (_, from_s, path) = WALKS[1];
    let [worst_db, _] = clean_walk(path).loss_db(CancellerConfig::TwoPulse, from_s);
    assert!(9.0 < worst_db, "two_pulse: {worst_db} dB");
}

#[test]
fn a_visitor_is_found_all_the_time_and_leaves_nothing_behind() {
    let told = Story::new(visit, 55.0).tell(SLOW_FAST);
    for (from_s, to_s) in [(3.0, 8.0), (8.0, 38.0), (38.0, 44.0)] {
        let (found, _) = told.found_and_others(from_s, to_s);
        assert!(0.95 <= found, "{found} from {from_s} s");
    }
    let (_, others) = told.found_and_others(0.0, 55.0);
    assert!(others <= 0.02, "{others} other points a frame");
    assert_eq!(told.others_near([0.5, 5.0], 39.5), 0);
}

#[test]
fn irregular_sweeps_and_a_pause_change_nothing() {
    let mut story = Story::new(visit, 1.0);
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    story.times_s.clear();
    let mut time_s = 0.0;
    while time_s < 50.0 {
        // The source pauses for 4 s while he stands.
        time_s += if (20.0..20.2).contains(&time_s) { 4.0 } else { rng.random_range(0.06..0.3) };
        story.times_s.push(time_s);
    }
    let told = story.tell(SLOW_FAST);
    let ((found, _), (_, others)) =
        (told.found_and_others(3.0, 44.0), told.found_and_others(0.0, 50.0));
    assert!(0.95 <= found && others <= 0.03, "{found} found, {others} others");
}

const MODES: [(&str, CancellerConfig); 6] = [
    ("two_pulse", CancellerConfig::TwoPulse),
    ("exponential 1.5", CancellerConfig::Exponential { time_constant_s: 1.5 }),
    ("exponential 2", CancellerConfig::Exponential { time_constant_s: 2.0 }),
    ("exponential 10", CancellerConfig::Exponential { time_constant_s: 10.0 }),
    ("slow_fast 1 10", SLOW_FAST),
    ("background", CancellerConfig::Background),
];

#[test]
#[ignore = "minutes: walks and visits with every canceller"]
fn study_of_all_modes() {
    for (mode, canceller) in MODES {
        for (name, from_s, path) in WALKS {
            let [worst_db, mean_db] = clean_walk(path).loss_db(canceller, from_s);
            let told = Story { drift_per_s: 0.0, ..Story::new(path, 8.0) }.tell(canceller);
            let (found, others) = told.found_and_others(from_s, 8.0);
            eprintln!(
                "{mode:16} {name:22} worst {worst_db:5.1} dB mean {mean_db:5.1} dB found {found:.2} others {others:.3}"
            );
        }
        for (tale, path) in [("visit", visit as Path), ("there at first", there_at_first)] {
            for (snr_db, drift_per_s) in [(25.0, 0.0), (25.0, 5e-4), (18.0, 5e-4), (35.0, 5e-4)] {
                let told = Story { snr_db, drift_per_s, ..Story::new(path, 60.0) }.tell(canceller);
                eprintln!(
                    "{mode:16} {tale:14} {snr_db} dB drift {drift_per_s}: {}",
                    told.summary()
                );
            }
        }
    }
}
