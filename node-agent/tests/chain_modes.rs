//! The chain in its other modes: more threads, polar pixels, other coherence, calibrated channels.

#![expect(clippy::unwrap_used, reason = "a failing set-up is a failing run")]

use node_agent::imaging::Sweep;
use node_agent::imaging::backproject::Coherence;
use node_agent::imaging::calibration::Calibration;
use node_agent::pipeline::{Chain, ChainConfig, Image, MeasureOn};
use node_agent::simulate::{
    Disturbance, EchoSimulator, Noise, Radar, Scene, Target, TargetKind, WayPoint,
};
use proto::geom::{Node, Se2, World};
use proto::measured::MeasuredPoint;
use rustfft::num_complex::Complex;

/// Where the targets stand in the node's frame, metres.
const PLACES_M: [[f64; 2]; 2] = [[-1.4, 3.1], [2.2, 5.7]];
/// Two modes of measuring the same noisy point agree to a few standard deviations of its error.
const AGREEMENT_M: f64 = 0.03;

fn sweep() -> Sweep {
    let target = |[x_m, y_m]: [f64; 2]| Target {
        way_points: vec![WayPoint { time_s: 0.0, x_m, y_m }],
        kind: TargetKind::Point,
        amplitude_db: 0.0,
    };
    let scene = Scene { targets: PLACES_M.map(target).to_vec(), ..Scene::default() };
    let disturbance =
        Disturbance { noise: Noise::InBand { snr_db: 20.0 }, ..Disturbance::default() };
    let pose: Se2<World, Node> = Se2::identity();
    let simulator = EchoSimulator::new(&scene, pose, &Radar::default(), &disturbance, 9).unwrap();
    simulator.sweep(0, 0.0)
}

#[expect(clippy::cast_possible_truncation, reason = "24 bits hold a sample")]
fn single(value: f64) -> f32 {
    value as f32
}

fn measured(config: &ChainConfig, sweep: &Sweep) -> (Vec<MeasuredPoint>, Image) {
    let mut chain = Chain::new(config).unwrap();
    let measured = chain.process_sweep(sweep).unwrap();
    (measured.points.clone(), measured.image.to_image())
}

/// The largest distance of points from the places where the targets are.
fn error_m(points: &[MeasuredPoint]) -> f64 {
    assert_eq!(points.len(), 2);
    let off_m = |[x_m, y_m]: [f64; 2]| {
        let from_m = |point: &MeasuredPoint| (point.x_m - x_m).hypot(point.y_m - y_m);
        points.iter().map(from_m).fold(f64::INFINITY, f64::min)
    };
    PLACES_M.map(off_m).into_iter().fold(0.0, f64::max)
}

#[test]
fn two_threads_measure_the_same_to_the_last_bit() {
    let config = ChainConfig { thread_count: 2, ..ChainConfig::of_points() };
    let (sweep, default) = (sweep(), ChainConfig::of_points());
    assert_eq!(measured(&config, &sweep), measured(&default, &sweep));
}

#[test]
fn polar_pixels_and_other_kinds_of_coherence_find_the_same_targets() {
    let sweep = sweep();
    assert!(error_m(&measured(&ChainConfig::of_points(), &sweep).0) < 2.0 * AGREEMENT_M);
    for (measure_on, coherence) in [
        (MeasureOn::Image, Coherence::Circular),
        (MeasureOn::Image, Coherence::Phase),
        (MeasureOn::Polar, Coherence::Power),
        (MeasureOn::Polar, Coherence::Phase),
    ] {
        let config = ChainConfig { measure_on, coherence, ..ChainConfig::of_points() };
        let (points, _) = measured(&config, &sweep);
        assert!(error_m(&points) < 2.0 * AGREEMENT_M, "{measure_on:?} {coherence:?}");
    }
}

#[test]
fn the_picture_of_polar_pixels_is_that_of_the_image() {
    let sweep = sweep();
    let polar = ChainConfig { measure_on: MeasureOn::Polar, ..ChainConfig::of_points() };
    let (want, got) = (measured(&ChainConfig::of_points(), &sweep).1, measured(&polar, &sweep).1);
    let squares = |values: Vec<f32>| values.iter().map(|v| v * v).sum::<f32>();
    let (rows, columns) = (want.grid.row_count, want.grid.column_count);
    // Compared where the polar grid reaches, between 0.45 m and 73 degrees.
    let inside: Vec<usize> = (0..rows * columns)
        .filter(|index| {
            let (x_m, y_m) = (want.grid.x_m(index % columns), want.grid.y_m(index / columns));
            let range_m = x_m.hypot(y_m);
            (0.45..10.3).contains(&range_m) && x_m.abs() < 0.95 * range_m
        })
        .collect();
    let off = inside.iter().map(|i| got.amplitude[*i] - want.amplitude[*i]).collect();
    let all = inside.iter().map(|i| want.amplitude[*i]).collect();
    let error_db = 10.0 * (squares(off) / squares(all)).log10();
    assert!(error_db < -35.0, "{error_db} dB");
}

#[test]
fn calibrated_channels_measure_what_ideal_ones_do() {
    let ideal = sweep();
    let calibration = Calibration {
        gain_db: (0..8).map(|c| f64::from(c) - 3.0).collect(),
        phase_rad: (0..8).map(|c| 0.7 * f64::from(c) - 2.0).collect(),
        delay_s: (0..8).map(|c| 1e-9 * f64::from(c % 3)).collect(),
    };
    let bend = |(index, sample): (usize, &Complex<f32>)| {
        let (channel, k) = (index / 301, index % 301);
        let frequency_hz = 1.6e9 + 2e6 * k as f64;
        let angle_rad = calibration.phase_rad[channel]
            - std::f64::consts::TAU * frequency_hz * calibration.delay_s[channel];
        let gain = 10_f64.powf(calibration.gain_db[channel] / 20.0);
        let error = Complex::from_polar(gain, angle_rad);
        sample * Complex::new(single(error.re), single(error.im))
    };
    let samples = ideal.samples.iter().enumerate().map(bend).collect();
    let bent = Sweep { samples, ..ideal.clone() };
    let config = ChainConfig { calibration, ..ChainConfig::of_points() };
    let want = measured(&ChainConfig::of_points(), &ideal).0;
    for (got, ideal_point) in measured(&config, &bent).0.iter().zip(&want) {
        let off_m = (got.x_m - ideal_point.x_m).hypot(got.y_m - ideal_point.y_m);
        assert!(off_m < 1e-3, "{off_m} m");
    }
    assert_eq!(measured(&config, &bent).0.len(), want.len());
}

#[test]
fn the_modes_are_written_in_toml() {
    let text = "
        thread_count = 2
        coherence = 'phase'
        measure_on = 'polar'
        [polar]
        range_count = 90
        [calibration]
        gain_db = [0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    ";
    let config: ChainConfig = toml::from_str(text).unwrap();
    assert_eq!(config.check(), Ok(()));
    assert_eq!((config.thread_count, config.coherence), (2, Coherence::Phase));
    assert_eq!((config.measure_on, config.polar.range_count), (MeasureOn::Polar, 90));
    for (bad, field) in [
        (ChainConfig { thread_count: 0, ..ChainConfig::of_points() }, "thread_count"),
        (
            ChainConfig {
                calibration: Calibration { gain_db: vec![1.0], ..Calibration::default() },
                ..ChainConfig::of_points()
            },
            "calibration.gain_db",
        ),
    ] {
        assert_eq!(bad.check().unwrap_err().field, field);
    }
}
