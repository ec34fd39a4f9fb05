//! The whole chain on simulated sweeps: the seed's crossing targets against truth and bound.

use nalgebra::{Matrix2, Vector2};
use proto::geom::{Node, Point, Se2, World};
use rustfft::num_complex::Complex;

use super::*;
use crate::detect::SecondLook;
use crate::detect::moments::to_polar;
use crate::simulate::{
    Disturbance, EchoSimulator, Noise, Radar, Scene, Target, TargetKind, WayPoint,
};

/// A point belongs to a target within these, in range (metres) and sine.
const GATE: [f64; 2] = [0.3, 0.2];

fn walker(from_m: [f64; 2], to_m: [f64; 2]) -> Target {
    let way_point = |time_s, [x_m, y_m]: [f64; 2]| WayPoint { time_s, x_m, y_m };
    let way_points = vec![way_point(0.0, from_m), way_point(7.0, to_m)];
    Target { way_points, kind: TargetKind::Point, amplitude_db: 0.0 }
}

/// The seed's scene \[registration, section 4\] and its two nodes.
fn crossing() -> (Scene, [Se2<World, Node>; 2]) {
    let targets = vec![walker([2.0, 3.0], [8.0, 8.0]), walker([8.0, 2.0], [3.0, 7.0])];
    let poses = [Se2::new(5.0, 0.0, 0.0), Se2::new(0.0, 5.0, -std::f64::consts::FRAC_PI_2)];
    (Scene { targets, ..Scene::default() }, poses)
}

/// One point with the target it belongs to.
struct Match {
    period: u64,
    /// Error in range (metres) and sine.
    error: Vector2<f64>,
    /// Squared error over its covariance.
    nees: f64,
    cov_m2: Matrix2<f64>,
}

#[derive(Default)]
struct Score {
    matches: Vec<Match>,
    truth_count: usize,
    false_count: usize,
}

impl Score {
    fn add(&mut self, period: u64, truths: &[Point<Node>], points: &[MeasuredPoint]) {
        let mut free: Vec<&MeasuredPoint> = points.iter().collect();
        self.truth_count += truths.len();
        for truth in truths {
            let place = to_polar(&truth.coords_m);
            let error = |point: &MeasuredPoint| to_polar(&point.position().mean.coords_m) - place;
            let near = |point: &&MeasuredPoint| {
                let e = error(point).abs();
                e.x < GATE[0] && e.y < GATE[1]
            };
            let Some(index) = free.iter().position(near) else { continue };
            let point = free.remove(index);
            let position = point.position();
            let off_m = position.mean.coords_m - truth.coords_m;
            let nees = off_m.dot(&(position.cov_m2.try_inverse().unwrap() * off_m));
            self.matches.push(Match { period, error: error(point), nees, cov_m2: position.cov_m2 });
        }
        self.false_count += free.len();
    }

    fn rms(&self) -> Vector2<f64> {
        let squares = self.matches.iter().map(|m| m.error.component_mul(&m.error));
        (squares.sum::<Vector2<f64>>() / self.matches.len() as f64).map(f64::sqrt)
    }

    fn mean_nees(&self) -> f64 {
        self.matches.iter().map(|m| m.nees).sum::<f64>() / self.matches.len() as f64
    }
}

fn run(config: &ChainConfig, noise: Noise, node: usize) -> Score {
    let (scene, poses) = crossing();
    let fresh = Chain::new(config).unwrap();
    let disturbance = Disturbance { noise, ..Disturbance::default() };
    let mut score = Score::default();
    for seed in 100..110 {
        let mut chain = fresh.clone();
        let simulator =
            EchoSimulator::new(&scene, poses[node], &Radar::default(), &disturbance, seed).unwrap();
        for period in 0..8 {
            let sweep = simulator.sweep(period, period as f64);
            let measured = chain.process_sweep(&sweep).unwrap();
            score.add(period, &simulator.targets_in_node(sweep.time_s), &measured.points);
        }
    }
    score
}

const LITERAL: Noise = Noise::PerProfileSample { snr_db: 8.0, fft_length: 2048 };
const PHYSICAL: Noise = Noise::InBand { snr_db: 8.0 };

#[test]
fn the_crossing_targets_are_measured_at_the_bound_with_true_covariances() {
    // Bounds at 8 dB: 1.37 cm and 14.5 mrad; the literal noise has 2048/301 times the SNR.
    for (noise, scale) in [(LITERAL, (301.0_f64 / 2048.0).sqrt()), (PHYSICAL, 1.0)] {
        for node in [0, 1] {
            let score = run(&ChainConfig::of_points(), noise, node);
            assert_eq!((score.matches.len(), score.truth_count), (160, 160), "{noise:?}");
            assert!(score.false_count <= 2, "{noise:?}: {} false points", score.false_count);
            // A root mean square of 160 values errs by 6 %: the bound, 2.5 of these, 5 % of loss.
            let rms = score.rms();
            assert!(rms.x < 1.2 * 0.0137 * scale, "{noise:?} node {node}: range {} m", rms.x);
            assert!(rms.y < 1.2 * 0.0145 * scale, "{noise:?} node {node}: sine {}", rms.y);
            // The mean of 160 values of 2 degrees of freedom errs by 0.16: 3.5 of these.
            let nees = score.mean_nees();
            assert!((1.45..2.55).contains(&nees), "{noise:?} node {node}: NEES {nees}");
        }
    }
}

#[test]
fn without_the_second_look_the_hard_case_is_confidently_wrong() {
    let detection = DetectionConfig { second_look: SecondLook::Off, ..DetectionConfig::points() };
    let config = ChainConfig { detection, ..ChainConfig::of_points() };
    let hard = |tested: &ChainConfig| {
        let mut score = run(tested, LITERAL, 1);
        score.matches.retain(|m| m.period == 4);
        score
    };
    let (off, on) = (hard(&config), hard(&ChainConfig::of_points()));
    assert!(6.0 < off.mean_nees(), "NEES {} without", off.mean_nees());
    assert!(on.mean_nees() < 4.0, "NEES {} with", on.mean_nees());
    assert_eq!(on.matches.len(), 20);
}

#[test]
fn neighbours_are_told_apart_in_place_and_strength() {
    // Where the crossing targets are for the second node in period 4, one of them 6 dB stronger.
    let places = [[-0.857, 5.429], [0.143, 5.143]];
    let mut targets = places.map(|place| walker(place, place)).to_vec();
    targets[1].amplitude_db = 6.0;
    let scene = Scene { targets, ..Scene::default() };
    let noise = Noise::InBand { snr_db: 20.0 };
    let disturbance = Disturbance { noise, ..Disturbance::default() };
    let pose = Se2::identity();
    let simulator = EchoSimulator::new(&scene, pose, &Radar::default(), &disturbance, 2).unwrap();
    let mut chain = Chain::new(&ChainConfig::of_points()).unwrap();
    let points = chain.process_sweep(&simulator.sweep(0, 0.0)).unwrap().points;
    assert_eq!(points.len(), 2);
    // 20 dB in each of 8 channels, less 0.93 dB by the window; the noise power errs by 0.2 dB.
    let strongest_db = 20.0 + 10.0 * 8.0_f64.log10() - 0.93;
    for (point, (place, want_db)) in
        points.iter().zip([(places[1], strongest_db), (places[0], strongest_db - 6.0)])
    {
        let off_m = point.position().mean.coords_m - Vector2::from(place);
        assert!(off_m.norm() < 0.06, "{off_m}");
        assert!((point.snr_db - want_db).abs() < 1.2, "{} for {want_db} dB", point.snr_db);
    }
}

#[test]
fn a_person_is_one_point_with_its_wander_as_error() {
    let mut scene = Scene { targets: vec![walker([5.0, 3.0], [5.5, 6.0])], ..Scene::default() };
    scene.targets[0].kind = TargetKind::Person;
    let disturbance =
        Disturbance { noise: Noise::InBand { snr_db: 20.0 }, ..Disturbance::default() };
    let pose = Se2::new(5.0, 0.0, 0.0);
    let simulator = EchoSimulator::new(&scene, pose, &Radar::default(), &disturbance, 4).unwrap();
    let config = ChainConfig { detection: DetectionConfig::people(), ..ChainConfig::of_points() };
    let mut chain = Chain::new(&config).unwrap();
    let mut score = Score::default();
    for period in 0..40 {
        let sweep = simulator.sweep(period, period as f64 * 0.17);
        let measured = chain.process_sweep(&sweep).unwrap();
        score.add(period, &simulator.targets_in_node(sweep.time_s), &measured.points);
    }
    // Fading hides a Rayleigh target now and then.
    assert!(34 <= score.matches.len(), "{} of 40", score.matches.len());
    assert!(score.false_count <= 3, "{} false", score.false_count);
    // The truth is the middle of the body, the points lie on its near side.
    assert!(score.rms().x < 0.25 && score.mean_nees() < 12.0, "{}", score.mean_nees());
    let sure = |m: &&Match| m.cov_m2.symmetric_eigenvalues().min() < 0.07_f64.powi(2);
    assert_eq!(score.matches.iter().filter(sure).count(), 0);
}

#[test]
fn the_seeds_own_choices_run_too() {
    let config = ChainConfig { detection: DetectionConfig::paper(), ..ChainConfig::of_points() };
    let score = run(&config, PHYSICAL, 0);
    assert!(150 <= score.matches.len() && score.false_count <= 10);
    let bias_m = score.matches.iter().map(|m| m.error.x).sum::<f64>() / score.matches.len() as f64;
    assert!(bias_m < -0.003, "binary moments are pulled to the array, not by {bias_m} m");
}

#[test]
fn amplitudes_are_reflectivities_and_noise_is_told() {
    let scene = Scene { targets: vec![walker([5.3, 4.0], [5.3, 4.0])], ..Scene::default() };
    let disturbance = Disturbance { noise: PHYSICAL, ..Disturbance::default() };
    let pose = Se2::new(5.0, 0.0, 0.0);
    let simulator = EchoSimulator::new(&scene, pose, &Radar::default(), &disturbance, 1).unwrap();
    let config = ChainConfig { window: Window::Rectangular, ..ChainConfig::of_points() };
    let mut chain = Chain::new(&config).unwrap();
    let measured = chain.process_sweep(&simulator.sweep(0, 0.0)).unwrap();
    let largest = measured.image.amplitude.iter().fold(0.0_f32, |a, b| a.max(*b));
    assert!((largest - 1.0).abs() < 0.35, "{largest}");
    // 8 dB in each of 8 channels.
    let want = (10_f32.powf(-0.8) / 8.0).sqrt();
    assert!((measured.image.noise_amplitude / want - 1.0).abs() < 0.15);
    assert!((measured.points[0].snr_db - 17.0).abs() < 3.0);
}

#[test]
fn a_warming_up_chain_says_so_and_then_sees_what_moves_only() {
    let (mut scene, [pose, _]) = crossing();
    scene.clutter.push(crate::simulate::Clutter { x_m: 6.0, y_m: 7.5, amplitude_db: 40.0 });
    let disturbance = Disturbance { noise: LITERAL, ..Disturbance::default() };
    let simulator = EchoSimulator::new(&scene, pose, &Radar::default(), &disturbance, 1).unwrap();
    let canceller = CancellerConfig::Exponential { time_constant_s: 2.0 };
    let mut chain = Chain::new(&ChainConfig { canceller, ..ChainConfig::of_points() }).unwrap();
    for period in 0..20 {
        let measured = chain.process_sweep(&simulator.sweep(period, 0.1 * period as f64)).unwrap();
        let warm = measured.state == ChainState::Ready;
        assert_eq!(warm, 5 <= period, "period {period}");
        assert!(warm || measured.points.is_empty());
        if 15 <= period {
            let from_m = |place: Vector2<f64>| {
                let away_m = |p: &MeasuredPoint| (p.position().mean.coords_m - place).norm();
                measured.points.iter().map(away_m).fold(f64::INFINITY, f64::min)
            };
            let truths = simulator.targets_in_node(0.1 * period as f64);
            assert!(truths.iter().any(|truth| from_m(truth.coords_m) < 0.5), "period {period}");
            assert!(1.0 < from_m(Vector2::new(1.0, 7.5)), "clutter seen in period {period}");
        }
    }
}

#[test]
fn sweeps_that_are_none_are_refused() {
    let mut chain = Chain::new(&ChainConfig::of_points()).unwrap();
    let good = Sweep { time_s: 1.0, samples: vec![Complex::new(0.0, 0.0); 8 * 301] };
    let measured = chain.process_sweep(&good).unwrap();
    assert!(measured.points.is_empty() && measured.image.amplitude.iter().all(|a| a.is_finite()));
    let short = Sweep { time_s: 2.0, samples: vec![Complex::new(0.0, 0.0); 8 * 300] };
    let wrong_size = chain.process_sweep(&short).unwrap_err();
    assert_eq!(wrong_size, ChainError::SampleCount { time_s: 2.0, got: 2400, want: 2408 });
    let mut broken = Sweep { time_s: 2.0, ..good.clone() };
    broken.samples[2 * 301 + 17].im = f32::NAN;
    let not_finite = chain.process_sweep(&broken).unwrap_err();
    assert_eq!(not_finite, ChainError::NotFinite { time_s: 2.0, channel: 2, frequency: 17 });
    let not_later = chain.process_sweep(&good).unwrap_err();
    assert_eq!(not_later, ChainError::TimeNotAscending { time_s: 1.0, previous_s: 1.0 });
}

#[test]
fn a_given_background_is_subtracted_from_the_first_sweep_on() {
    let canceller = CancellerConfig::Background;
    let mut chain = Chain::new(&ChainConfig { canceller, ..ChainConfig::of_points() }).unwrap();
    let empty = vec![Complex::new(3.0, 0.0); 8 * 301];
    let sweep = Sweep { time_s: 1.0, samples: empty.clone() };
    assert_eq!(chain.process_sweep(&sweep).unwrap().state, ChainState::WarmingUp);
    chain.use_background(&empty).unwrap();
    let later = Sweep { time_s: 2.0, ..sweep };
    let measured = chain.process_sweep(&later).unwrap();
    assert_eq!(measured.state, ChainState::Ready);
    assert!(measured.image.amplitude.iter().all(|a| a.abs() < f32::MIN_POSITIVE));
    let short = chain.use_background(&empty[1..]).unwrap_err();
    assert_eq!(short, ChainError::SampleCount { time_s: 0.0, got: 2407, want: 2408 });
    let broken = vec![Complex::new(f32::NAN, 0.0); 8 * 301];
    let not_finite = chain.use_background(&broken).unwrap_err();
    assert_eq!(not_finite, ChainError::NotFinite { time_s: 0.0, channel: 0, frequency: 0 });
}

#[test]
fn settings_are_written_in_toml_and_nonsense_is_named() {
    let text = "
        window = 'hann'
        canceller = { exponential = { time_constant_s = 1.5 } }
        [wall.refraction]
        thickness_m = 0.24
        permittivity = 5.0
        [detection]
        threshold = { relative = { fraction = 0.5 } }
        second_look = 'off'
    ";
    let config: ChainConfig = toml::from_str(text).unwrap();
    assert_eq!(config.check(), Ok(()));
    assert_eq!(toml::from_str::<ChainConfig>(&toml::to_string(&config).unwrap()).unwrap(), config);
    assert!(toml::from_str::<ChainConfig>("fft_lenght = 2048").is_err());
    let short = ChainConfig { fft_length: 300, ..ChainConfig::of_points() };
    assert!(Chain::new(&short).unwrap_err().to_string().contains("fft_length is 300"));
}
