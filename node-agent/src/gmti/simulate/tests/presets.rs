//! Tests of the scenes that come with the program.

use nalgebra::Vector2;

use super::{enu_m, simulated};
use crate::gmti::simulate::{Preset, Scene, SimulatedGmtiConfig, Way, four_targets, three_targets};

fn nearest_m(scene: &Scene) -> Vec<((usize, usize), f64)> {
    let ways: Vec<Way> = scene
        .targets
        .iter()
        .map(|target| Way::new(&target.way, target.from_s, "way").unwrap())
        .collect();
    let mut nearest = Vec::new();
    for one in 0..ways.len() {
        for other in 0..one {
            let apart_m = (0..6000).filter_map(|step| {
                let time_s = f64::from(step) * 0.05;
                let (a, b) = (ways[one].at(time_s)?, ways[other].at(time_s)?);
                Some((a.position_m - b.position_m).norm())
            });
            nearest.push(((other, one), apart_m.fold(f64::INFINITY, f64::min)));
        }
    }
    nearest
}

#[test]
fn three_targets_are_as_the_specification_says() {
    let scene = three_targets();
    let config = SimulatedGmtiConfig { preset: Preset::ThreeTargets, ..Default::default() };
    let (_, dwells) = simulated(&config);
    let nearest = nearest_m(&scene);
    assert!(nearest.iter().all(|(_, apart_m)| 155.0 <= *apart_m), "{nearest:?}");
    let per_scan_m = scene.targets[0].way[0].speed_m_per_s * scene.scan.period_s;
    assert!((per_scan_m - 57.0).abs() < 1e-9);
    let count = |index: u32| {
        dwells.iter().flat_map(|d| &d.reports).filter(|r| r.truth == Some(index)).count()
    };
    let counts = [count(0), count(1), count(2)];
    // Links of consecutive reports: the prototypes had 146 per run.
    let links: usize = counts.iter().map(|reports| reports - 1).sum();
    assert!((140..=150).contains(&links), "{counts:?}");
    // Their ways cross.
    let sites = |index: usize| {
        let target = &scene.targets[index];
        let way = Way::new(&target.way, target.from_s, "way").unwrap();
        (0..2000).filter_map(move |step| Some(way.at(f64::from(step) * 0.15)?.position_m))
    };
    for (one, other) in [(0, 1), (0, 2), (1, 2)] {
        let others: Vec<Vector2<f64>> = sites(other).collect();
        let meet = sites(one).any(|at| others.iter().any(|there| (at - there).norm() < 3.0));
        assert!(meet, "{one} {other}");
    }
}

#[test]
fn four_targets_are_as_the_specification_says() {
    let scene = four_targets();
    let nearest = nearest_m(&scene);
    let of = |pair: (usize, usize)| nearest.iter().find(|(p, _)| *p == pair).unwrap().1;
    assert!((of((0, 1)) - 50.0).abs() < 1e-6);
    assert!(of((2, 3)) < 1.0);
    for pair in [(0, 2), (0, 3), (1, 2), (1, 3)] {
        assert!(100.0 < of(pair), "{nearest:?}");
    }
    let plain = SimulatedGmtiConfig::default();
    let (radar, dwells) = simulated(&plain);
    let start = radar.truths(dwells[0].time_unix_s);
    let next = radar.truths(dwells[1].time_unix_s);
    let moved_m = next[2].motion.position_m - start[2].motion.position_m;
    let other_m = next[3].motion.position_m - start[3].motion.position_m;
    assert!((moved_m.norm() - 50.0).abs() < 1e-9);
    assert!((moved_m.angle(&other_m).to_degrees() - 23.0).abs() < 1e-6);
    assert!(dwells.iter().all(|dwell| dwell.reports.len() == 4));
    for dwell in &dwells {
        let ground_m =
            (enu_m(radar.frame(), &dwell.sensor).xy() - Vector2::new(0.0, -125.0)).norm();
        assert!((18e3..=21.5e3).contains(&ground_m), "{ground_m}");
    }
    let rotated = SimulatedGmtiConfig { rotated: true, ..plain };
    let (turned, _) = simulated(&rotated);
    for (before, after) in start.iter().zip(turned.truths(dwells[0].time_unix_s)) {
        let (from, to) = (before.motion.position_m, after.motion.position_m);
        assert!((to - Vector2::new(-from.y, from.x)).norm() < 1e-9);
    }
}

#[test]
fn load_scenes_have_the_density_asked_for() {
    for preset in [Preset::LoadUniform, Preset::LoadRoads] {
        let config = SimulatedGmtiConfig { preset, target_count: 500, ..Default::default() };
        let (_, dwells) = simulated(&config);
        assert_eq!(dwells.len(), 30);
        let reports = || dwells.iter().flat_map(|dwell| &dwell.reports);
        let true_share = reports().filter(|r| r.truth.is_some()).count() as f64 / 15000.0;
        let clutter = reports().filter(|r| r.truth.is_none()).count() as f64 / 30.0;
        assert!((true_share - 0.9).abs() < 0.01, "{true_share}");
        assert!((clutter - 100.0).abs() < 8.0, "{clutter}");
        assert!(reports().all(|report| report.snr_db.is_none()));
    }
}
