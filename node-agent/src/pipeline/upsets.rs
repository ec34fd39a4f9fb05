//! What the field does to a radar in mid-stream: steps of gain, silence, bursts, pauses.

use rustfft::num_complex::Complex;

use super::*;
use crate::simulate::{
    Clutter, Disturbance, EchoSimulator, Noise, Radar, Scene, Target, TargetKind, WayPoint,
};
use proto::geom::Se2;

/// Sweeps per second, and sweeps of a run.
const RATE_HZ: f64 = 10.0;
const SWEEP_COUNT: u32 = 160;
/// The upset comes here.
const UPSET: u32 = 60;
/// What is demanded begins so many sweeps after it.
const RECOVERY: u32 = 25;

/// A walker among furniture 20 to 30 dB stronger than he is.
fn simulator() -> EchoSimulator {
    let at = |time_s, x_m, y_m| WayPoint { time_s, x_m, y_m };
    // He comes in when the room is known, and walks to and fro.
    let way_points = vec![
        at(2.0, -1.5, 12.0),
        at(3.0, -1.5, 6.5),
        at(8.0, 0.5, 3.0),
        at(12.0, 1.5, 5.5),
        at(16.0, -0.5, 4.0),
    ];
    let clutter = |x_m, y_m, amplitude_db| Clutter { x_m, y_m, amplitude_db };
    let scene = Scene {
        targets: vec![Target { way_points, kind: TargetKind::Point, amplitude_db: 0.0 }],
        clutter: vec![clutter(-2.0, 5.5, 20.0), clutter(2.5, 7.0, 25.0), clutter(0.3, 1.2, 30.0)],
        ..Scene::default()
    };
    let noise = Noise::InBand { snr_db: 15.0 };
    let disturbance = Disturbance { noise, ..Disturbance::default() };
    EchoSimulator::new(&scene, Se2::identity(), &Radar::default(), &disturbance, 5).unwrap()
}

/// Share of frames with the walker, and false points per frame, after the upset.
fn after(upset: impl Fn(u32) -> Option<Complex<f32>>, pause_s: f64) -> (f64, f64) {
    let simulator = simulator();
    let mut chain = Chain::new(&ChainConfig::default()).unwrap();
    let (mut frame_count, mut hit_count, mut false_count) = (0.0, 0.0, 0.0);
    for k in 0..SWEEP_COUNT {
        let scene_s = f64::from(k) / RATE_HZ;
        let mut sweep = simulator.sweep(u64::from(k), scene_s);
        let Some(factor) = upset(k) else { continue };
        sweep.samples.iter_mut().for_each(|sample| *sample *= factor);
        sweep.time_s += if UPSET <= k { pause_s } else { 0.0 };
        let points = chain.process_sweep(&sweep).unwrap().points;
        if k < UPSET + RECOVERY {
            continue;
        }
        let truth_m = simulator.targets_in_node(scene_s)[0].coords_m;
        let is_near = |p: &&MeasuredPoint| (truth_m.x - p.x_m).hypot(truth_m.y - p.y_m) < 0.6;
        let near_count = points.iter().filter(is_near).count();
        frame_count += 1.0;
        hit_count += f64::from(u8::from(0 < near_count));
        false_count += (points.len() - near_count) as f64;
    }
    (hit_count / frame_count, false_count / frame_count)
}

#[test]
fn a_walker_is_followed_through_what_the_field_does() {
    let one = Complex::new(1.0, 0.0);
    let from_upset = |factor: Complex<f32>| move |k| Some(if UPSET <= k { factor } else { one });
    let once = |factor: f32| move |k| Some(if k == UPSET { one * factor } else { one });
    let silent = |k| Some(if (UPSET..UPSET + 10).contains(&k) { one * 0.0 } else { one });
    for (what, (found, false_per_frame)) in [
        ("nothing", after(|_| Some(one), 0.0)),
        ("20 dB more", after(from_upset(one * 10.0), 0.0)),
        ("20 dB less", after(from_upset(one * 0.1), 0.0)),
        ("another phase", after(from_upset(Complex::cis(1.0)), 0.0)),
        ("a burst", after(once(1e4), 0.0)),
        ("one silent sweep", after(once(0.0), 0.0)),
        ("a second of silence", after(silent, 0.0)),
        ("a pause", after(|k| (!(UPSET..UPSET + 5).contains(&k)).then_some(one), 0.0)),
    ] {
        assert!(0.9 <= found, "{what}: found in {found} of the frames");
        assert!(false_per_frame <= 0.1, "{what}: {false_per_frame} false points per frame");
    }
    // After a pause longer than the memory the room is learned anew, with the walker in it.
    let (found, false_per_frame) = after(|_| Some(one), 15.0);
    assert!(0.4 <= found && false_per_frame <= 0.1, "long pause: {found} {false_per_frame}");
}
