//! Figures of detection over many simulated sweeps: error over bound, NEES, false points.
//!
//! `cargo test --release -- --ignored --nocapture study_`

#![expect(
    clippy::excessive_nesting,
    clippy::too_many_lines,
    clippy::cast_possible_truncation,
    reason = "tables over several settings; seeds are small"
)]

use nalgebra::Vector2;

use super::crossing::crossing;
use super::moments::{Polar, to_cartesian, to_polar};
use super::trials::{
    Judge, PEOPLE, POINTS, Rig, Tally, cartesian, polar, shifted, simulator, standing,
};
use super::*;
use crate::imaging::wall::WallModel;
use crate::simulate::{
    AmplitudeLaw, Disturbance, EchoSimulator, Noise, Radar, Scene, Target, TargetKind, WayPoint,
};

const CLOSE: Judge = Judge { gate: [0.1, 0.07], half_depth_m: [0.0, 0.0] };

#[test]
#[ignore = "minutes: 12 positions x 500 sweeps"]
fn study_points() {
    for (name, pixels) in [("polar", polar()), ("cartesian", shifted())] {
        let rig = Rig::new(&pixels, &WallModel::None, DetectionConfig::points());
        let runs = if name == "polar" { 500 } else { 100 };
        let mut total = Tally::default();
        let mut square = Vector2::zeros();
        for range_m in [2.0, 4.0, 6.0, 8.0] {
            for angle_deg in [0.0_f64, 25.0, 45.0] {
                let place = Polar::new(range_m, angle_deg.to_radians().sin());
                let scene = Scene {
                    targets: vec![standing(place, TargetKind::Point, 0.0)],
                    ..Scene::default()
                };
                let mut tally = Tally::default();
                for seed in 0..runs {
                    let sim = simulator(&scene, Noise::InBand { snr_db: 8.0 }, seed);
                    tally.add(0, &[to_cartesian(&place)], &rig.points(&sim.sweep(0, 0.0)), &POINTS);
                }
                let (rms, mean) = (tally.rms(), tally.mean());
                println!(
                    "{name} {range_m} {angle_deg}: det {}/{} false {} rms {:.2} cm {:.2} mrad bias/sd {:.3} {:.3} NEES {:.2}",
                    tally.errors.len(),
                    tally.truth_count,
                    tally.false_count,
                    rms.x * 100.0,
                    rms.y * 1e3,
                    mean.x / rms.x,
                    mean.y / rms.y,
                    tally.mean_nees()
                );
                square += rms.component_mul(&rms) / 12.0;
                total.errors.extend(tally.errors);
                total.nees.extend(tally.nees);
                total.false_count += tally.false_count;
                total.truth_count += tally.truth_count;
            }
        }
        let (rms, mean) = (square.map(f64::sqrt), total.mean());
        println!(
            "A {name} ALL: det {}/{} false {} rms {:.3} cm {:.2} mrad bias/sd {:.3} {:.3} NEES {:.2}",
            total.errors.len(),
            total.truth_count,
            total.false_count,
            rms.x * 100.0,
            rms.y * 1e3,
            mean.x / rms.x,
            mean.y / rms.y,
            total.mean_nees()
        );
    }
}

#[test]
#[ignore = "minutes: 500 runs of the crossing"]
fn study_crossing() {
    let runs: u64 = 500;
    for (grid, pixels) in [("polar", polar()), ("cartesian", cartesian())] {
        let rig = Rig::new(&pixels, &WallModel::None, DetectionConfig::points());
        let runs = if grid == "polar" { runs } else { runs / 5 };
        for (law_name, law) in
            [("equal", AmplitudeLaw::Equal), ("R-2", AmplitudeLaw::InverseSquare)]
        {
            for (noise_name, noise) in [
                ("literal", Noise::PerProfileSample { snr_db: 8.0, fft_length: 2048 }),
                ("in-band", Noise::InBand { snr_db: 8.0 }),
            ] {
                let (scene, poses) = crossing(law);
                for (node, pose) in poses.iter().enumerate() {
                    let mut per_period: Vec<Tally> = vec![Tally::default(); 8];
                    for seed in 0..runs {
                        let disturbance = Disturbance { noise, ..Disturbance::default() };
                        let sim = EchoSimulator::new(
                            &scene,
                            *pose,
                            &Radar::default(),
                            &disturbance,
                            seed,
                        )
                        .unwrap();
                        for period in 0..8 {
                            let sweep = sim.sweep(period, period as f64);
                            let truths: Vec<Vector2<f64>> = sim
                                .targets_in_node(sweep.time_s)
                                .iter()
                                .map(|t| t.coords_m)
                                .collect();
                            per_period[period as usize].add(
                                period,
                                &truths,
                                &rig.points(&sweep),
                                &POINTS,
                            );
                        }
                    }
                    let det: usize = per_period.iter().map(|t| t.errors.len()).sum();
                    let truth_count: usize = per_period.iter().map(|t| t.truth_count).sum();
                    let false_count: usize = per_period.iter().map(|t| t.false_count).sum();
                    let share: Vec<String> = per_period
                        .iter()
                        .map(|t| format!("{:.3}", t.errors.len() as f64 / t.truth_count as f64))
                        .collect();
                    let mut all = Tally::default();
                    for t in &per_period {
                        all.errors.extend(&t.errors);
                        all.nees.extend(&t.nees);
                        all.false_at.extend(&t.false_at);
                    }
                    let sd = all.rms() / (all.errors.len() as f64).sqrt();
                    println!(
                        "B {grid} {law_name} {noise_name} node {}: det {:.4} false/run {:.4} rms {:.2} cm {:.2} mrad, bias {:.3} cm ({:.1} s) {:.2} mrad ({:.1} s) NEES {:.2}; per period {}",
                        node + 1,
                        det as f64 / truth_count as f64,
                        false_count as f64 / runs as f64,
                        all.rms().x * 100.0,
                        all.rms().y * 1e3,
                        all.mean().x * 100.0,
                        all.mean().x / sd.x,
                        all.mean().y * 1e3,
                        all.mean().y / sd.y,
                        all.mean_nees(),
                        share.join(" ")
                    );
                    let nees: Vec<String> =
                        per_period.iter().map(|t| format!("{:.1}", t.mean_nees())).collect();
                    println!("    nees {}", nees.join(" "));
                    for (period, place, snr) in all.false_at.iter().take(4) {
                        let places = EchoSimulator::new(
                            &scene,
                            *pose,
                            &Radar::default(),
                            &Disturbance::default(),
                            0,
                        )
                        .unwrap()
                        .targets_in_node(*period as f64);
                        let t: Vec<String> = places
                            .iter()
                            .map(|t| {
                                let p = to_polar(&t.coords_m);
                                format!("({:.2} {:.2})", p.x, p.y)
                            })
                            .collect();
                        println!(
                            "    false period {period} at ({:.2} {:.2}) {snr:.1} dB; truths {}",
                            place.x,
                            place.y,
                            t.join(" ")
                        );
                    }
                }
            }
        }
    }
}

#[test]
#[ignore = "minutes: dynamic range"]
fn study_dynamic_range() {
    let rigs = [
        ("polar", Rig::new(&polar(), &WallModel::None, DetectionConfig::points())),
        ("cartesian", Rig::new(&cartesian(), &WallModel::None, DetectionConfig::points())),
    ];
    for (grid, rig) in &rigs {
        for noise in [
            Noise::None,
            Noise::InBand { snr_db: 60.0 },
            Noise::InBand { snr_db: 40.0 },
            Noise::InBand { snr_db: 30.0 },
        ] {
            let (mut one, mut scenes, mut extra) = (0, 0, 0);
            for range_m in [1.0, 2.0, 3.3, 4.7, 6.0, 7.5] {
                for sine in [-0.6, -0.3, 0.0, 0.1, 0.45] {
                    let place = Polar::new(range_m, sine);
                    let scene = Scene {
                        targets: vec![standing(place, TargetKind::Point, 0.0)],
                        ..Scene::default()
                    };
                    let points = rig.points(&simulator(&scene, noise, 1).sweep(0, 0.0));
                    scenes += 1;
                    one += usize::from(points.len() == 1);
                    extra += points.len().saturating_sub(1);
                }
            }
            println!(
                "C {grid} one target {noise:?}: exactly one in {one}/{scenes}, {extra} extra points"
            );
        }
        for noise_db in [35.0, 60.0] {
            for weak_db in [-20.0, -25.0, -28.0, -30.0] {
                let (mut both, mut scenes, mut extra) = (0, 0, 0);
                for range_m in [2.0, 4.1, 6.2] {
                    for (dr, du) in [(1.05, 0.0), (1.3, 0.1), (-1.1, -0.2), (1.6, -0.3), (2.2, 0.4)]
                    {
                        let (strong, weak) =
                            (Polar::new(range_m, 0.1), Polar::new(range_m + dr, 0.1 + du));
                        let scene = Scene {
                            targets: vec![
                                standing(strong, TargetKind::Point, 0.0),
                                standing(weak, TargetKind::Point, weak_db),
                            ],
                            ..Scene::default()
                        };
                        let mut tally = Tally::default();
                        tally.add(
                            0,
                            &[to_cartesian(&strong), to_cartesian(&weak)],
                            &rig.points(
                                &simulator(&scene, Noise::InBand { snr_db: noise_db }, 3)
                                    .sweep(0, 0.0),
                            ),
                            &CLOSE,
                        );
                        scenes += 1;
                        both += usize::from(tally.errors.len() == 2);
                        extra += tally.false_count;
                    }
                }
                println!(
                    "C {grid} weak {weak_db} dB at SNR {noise_db}: both {both}/{scenes}, extra {extra}"
                );
            }
        }
    }
}

/// A person at `place` with an orientation and shape that follow from `seed`.
fn person(place: Polar, seed: u64) -> Target {
    let place_m = to_cartesian(&place);
    let heading_rad = seed as f64 * 2.399;
    let step_m = Vector2::new(heading_rad.cos(), heading_rad.sin()) * 1e-3;
    let way = |t: f64| WayPoint {
        time_s: t,
        x_m: place_m.x + t * step_m.x,
        y_m: place_m.y + t * step_m.y,
    };
    Target { way_points: vec![way(0.0), way(1.0)], kind: TargetKind::Person, amplitude_db: 0.0 }
}

const SINES: [f64; 4] = [-0.5, -0.2, 0.1, 0.4];

#[test]
#[ignore = "minutes: people"]
fn study_people() {
    let people = DetectionConfig::people();
    let cohering = Threshold::Noise { power_ratio: 14.0, min_coherence: 0.4 };
    for (name, config) in
        [("people", people), ("coherence 0.4", DetectionConfig { threshold: cohering, ..people })]
    {
        for (grid, pixels, runs) in [("polar", polar(), 100), ("cartesian", cartesian(), 12)] {
            if grid == "cartesian" && name != "people" {
                continue;
            }
            let rig = Rig::new(&pixels, &WallModel::None, config);
            for snr_db in [10.0, 15.0, 20.0, 30.0] {
                one_person(&rig, &format!("{name} {grid}"), snr_db, runs);
            }
            for snr_db in [15.0, 25.0] {
                two_people(&rig, &format!("{name} {grid}"), snr_db, runs);
            }
        }
    }
}

fn one_person(rig: &Rig, name: &str, snr_db: f64, runs: u64) {
    for range_m in [2.0, 4.0, 6.0, 8.0] {
        let mut tally = Tally::default();
        let mut counts = [0; 3];
        for seed in 0..runs {
            let place = Polar::new(range_m, SINES[seed as usize % 4]);
            let scene = Scene { targets: vec![person(place, seed)], ..Scene::default() };
            let sim = simulator(&scene, Noise::InBand { snr_db }, seed);
            for period in 0..4 {
                let points = rig.points(&sim.sweep(period, 0.0));
                counts[points.len().min(2)] += 1;
                tally.add(period, &[to_cartesian(&place)], &points, &PEOPLE);
            }
        }
        let (mean, rms) = (tally.mean(), tally.rms());
        let sd_m = (rms.x * rms.x - mean.x * mean.x).sqrt();
        println!(
            "D {name} SNR {snr_db} R {range_m}: none/one/more {counts:?}; range bias {:.3} sd {:.3} m, cross rms {:.3} m, NEES {:.2}",
            mean.x,
            sd_m,
            rms.y * range_m,
            tally.mean_nees()
        );
    }
}

fn two_people(rig: &Rig, name: &str, snr_db: f64, runs: u64) {
    for (place, step) in [
        (Polar::new(2.0, 0.1), Polar::new(0.0, 0.35)),
        (Polar::new(3.0, -0.1), Polar::new(0.0, 0.23)),
        (Polar::new(5.0, 0.1), Polar::new(0.0, 0.14)),
        (Polar::new(3.0, 0.2), Polar::new(0.7, 0.0)),
        (Polar::new(6.0, 0.2), Polar::new(0.7, 0.0)),
        (Polar::new(4.0, 0.0), Polar::new(0.5, 0.12)),
    ] {
        let mut counts = [0; 4];
        let mut tally = Tally::default();
        for seed in 0..runs {
            let places = [place, place + step];
            let targets = places.iter().zip([seed, seed + 7]).map(|(p, s)| person(*p, s)).collect();
            let scene = Scene { targets, ..Scene::default() };
            let sim = simulator(&scene, Noise::InBand { snr_db }, seed);
            let points = rig.points(&sim.sweep(0, 0.0));
            counts[points.len().min(3)] += 1;
            let truths: Vec<Vector2<f64>> = places.iter().map(to_cartesian).collect();
            tally.add(0, &truths, &points, &PEOPLE);
        }
        println!(
            "D {name} two people SNR {snr_db} at {:.1} {:.2} + {:.2} {:.2}: 0/1/2/3 points {counts:?} NEES {:.2}",
            place.x,
            place.y,
            step.x,
            step.y,
            tally.mean_nees()
        );
    }
}

/// The errors without noise at the second node: what neighbours do to each other.
#[test]
#[ignore = "minutes: bias"]
fn study_bias() {
    let rig = Rig::new(&polar(), &WallModel::None, DetectionConfig::points());
    let (scene, poses) = crossing(AmplitudeLaw::Equal);
    let sim = EchoSimulator::new(&scene, poses[1], &Radar::default(), &Disturbance::default(), 1)
        .unwrap();
    for period in 0..8 {
        let truths: Vec<Vector2<f64>> =
            sim.targets_in_node(period as f64).iter().map(|t| t.coords_m).collect();
        let mut tally = Tally::default();
        tally.add(period, &truths, &rig.points(&sim.sweep(period, period as f64)), &POINTS);
        let errors: Vec<String> = tally
            .errors
            .iter()
            .map(|e| format!("({:.3} cm {:.2} mrad)", e.x * 100.0, e.y * 1e3))
            .collect();
        println!(
            "G period {period}: {} points, errors {}",
            tally.errors.len() + tally.false_count,
            errors.join(" ")
        );
    }
}

/// One and two people at once, on the quick grid.
#[test]
#[ignore = "seconds: pairs of people"]
fn study_pairs() {
    let rig = Rig::new(&polar(), &WallModel::None, DetectionConfig::people());
    for snr_db in [15.0, 20.0, 25.0] {
        one_person(&rig, "people polar", snr_db, 100);
        two_people(&rig, "people polar", snr_db, 200);
    }
}
