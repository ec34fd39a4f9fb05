//! Scenes that come with the program: the two of \[wide-area\], and many targets for load.

use std::f64::consts::TAU;

use nalgebra::Vector2;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, Exp1, StandardNormal};

use super::config::{
    ClutterConfig, DetectionConfig, NoiseConfig, PlaceNoise, PlatformConfig, ScanConfig, Scene,
    TargetConfig,
};
use super::way::WayPoint;

/// Stream of the seed from which the ways of many targets are drawn.
const WAYS_STREAM: u64 = 0x77;
/// Height and speed that \[wide-area\]'s prototypes had, its tables being lost.
const HEIGHT_M: f64 = 6000.0;
const SPEED_M_PER_S: f64 = 120.0;
/// Scans of the load scenes.
const LOAD_SCAN_COUNT: u32 = 30;
const LOAD_PERIOD_S: f64 = 5.0;
/// 1000 targets spread over 800 km², others over as much for each: half of its sides, metres.
const LOAD_HALF_M: [f64; 2] = [20e3, 10e3];
/// How far south of the middle of 800 km² the aircraft passes, metres.
const LOAD_SOUTH_M: f64 = 40e3;
/// Roads are so long, metres.
const ROAD_M: f64 = 4e3;
/// Mean distance of one vehicle to the next, of both lanes, metres.
const HEADWAY_M: f64 = 150.0;
/// Between the middles of two lanes, metres.
const LANE_M: f64 = 4.0;

/// How many targets are spread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// Anywhere, in any direction.
    Uniform,
    /// In convoys on straight roads with a lane for each direction, each at its own speed: they
    /// overtake.
    Roads,
}

/// Radial velocity and strength err by what the prototypes took, \[wide-area\] being silent.
fn noise(along_m2: f64, across_m2: f64) -> NoiseConfig {
    NoiseConfig {
        place: PlaceNoise::Ground { along_m2, across_m2 },
        radial_sigma_m_per_s: Some(1.0),
        strength_sigma_db: Some(3.0),
        wrap_m_per_s: None,
    }
}

/// Flies east, `south_m` south of the scene, abeam of it after half of `duration_s`.
fn past_the_scene(south_m: f64, duration_s: f64) -> PlatformConfig {
    PlatformConfig {
        east_m: -0.5 * duration_s * SPEED_M_PER_S,
        north_m: -south_m,
        height_m: HEIGHT_M,
        course_deg: 90.0,
        speed_m_per_s: SPEED_M_PER_S,
    }
}

/// One look per scan at all of the scene.
fn one_look(period_s: f64, count: u32, extent: (f64, f64)) -> ScanConfig {
    ScanConfig {
        period_s,
        count: Some(count),
        center_east_m: 0.0,
        center_north_m: 0.0,
        range_half_extent_m: extent.0,
        angle_half_extent_deg: extent.1,
        beam: None,
    }
}

fn point(east_m: f64, north_m: f64, speed_m_per_s: f64) -> WayPoint {
    WayPoint { east_m, north_m, speed_m_per_s, pause_s: 0.0, turn_radius_m: 0.0 }
}

/// Two that turn, one that drives obliquely and stands twice; their ways cross, but no two are ever
/// nearer than 155 m; 57 m per scan; they appear and disappear at different times. Variances 8 m²
/// in range and 20 m² in azimuth \[wide-area, second section, figure 4\].
#[must_use]
pub fn three_targets() -> Scene {
    let (period_s, count) = (4.0, 65);
    let on = |east_m, north_m| point(east_m, north_m, 14.25);
    let turn = |east_m, north_m, turn_radius_m| WayPoint { turn_radius_m, ..on(east_m, north_m) };
    let stand = |east_m, north_m, pause_s| WayPoint { pause_s, ..on(east_m, north_m) };
    let target = |from_s, strength_db, way| TargetConfig { from_s, way, strength_db };
    let back = vec![
        on(-1200.0, -700.0),
        turn(500.0, -700.0, 700.0),
        turn(500.0, 700.0, 700.0),
        on(-210.0, 700.0),
    ];
    let away = vec![on(1300.0, -150.0), turn(-350.0, -150.0, 800.0), on(-350.0, 1300.0)];
    let oblique = vec![
        on(-900.0, -1200.0),
        stand(-300.0, -600.0, 24.0),
        stand(200.0, -100.0, 32.0),
        on(900.0, 600.0),
    ];
    Scene {
        platform: past_the_scene(19e3, period_s * f64::from(count - 1)),
        scan: one_look(period_s, count, (6e3, 20.0)),
        noise: noise(8.0, 20.0),
        // Those that stand are not seen; for the rest the sensor of the seed's experiment sees all.
        detection: DetectionConfig { probability: 1.0, minimum_m_per_s: 0.05 },
        clutter: None,
        targets: vec![
            target(0.0, 14.0, back),
            target(12.0, 17.0, away),
            target(18.5, 20.0, oblique),
        ],
    }
}

/// All four drive east by 50 m per scan: two side by side, 50 m apart; two whose ways cross at 23°
/// when half of the time has passed, 350 m beyond: of the distances tried the one that meets the
/// figures of the prototypes. Variance 400 m² on both axes \[wide-area, figures 5 to 8\].
#[must_use]
pub fn four_targets() -> Scene {
    let (period_s, count) = (4.0, 40);
    let speed_m_per_s = 12.5;
    let half_m = 0.5 * speed_m_per_s * period_s * f64::from(count - 1);
    let target = |north_m: f64, off_deg: f64, strength_db| {
        let (rise, run) = off_deg.to_radians().sin_cos();
        let half = Vector2::new(half_m * run, half_m * rise);
        let from = point(-half.x, north_m - half.y, speed_m_per_s);
        let way = vec![from, point(half.x, north_m + half.y, speed_m_per_s)];
        TargetConfig { from_s: 0.0, way, strength_db }
    };
    Scene {
        platform: past_the_scene(18.65e3, period_s * f64::from(count - 1)),
        scan: one_look(period_s, count, (6e3, 20.0)),
        noise: noise(400.0, 400.0),
        detection: DetectionConfig { probability: 1.0, minimum_m_per_s: 0.0 },
        clutter: None,
        targets: vec![
            target(-150.0, 0.0, 14.0),
            target(-100.0, 0.0, 17.0),
            target(200.0, 11.5, 20.0),
            target(200.0, -11.5, 23.0),
        ],
    }
}

/// `count` targets, 1000 in 800 km²: detected with probability 0.9, variance 400 m² on both axes, radial
/// velocity to 1 m/s, no strength, 200 false plots per 1000 targets and scan.
#[must_use]
pub fn load(layout: Layout, count: usize, seed: u64) -> Scene {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(WAYS_STREAM);
    let scale = (count as f64 / 1000.0).sqrt();
    let half_m = LOAD_HALF_M.map(|half_m| half_m * scale);
    let targets = match layout {
        Layout::Uniform => (0..count).map(|_| anywhere(half_m, &mut rng)).collect(),
        Layout::Roads => on_roads(count, half_m, &mut rng),
    };
    let clutter = ClutterConfig {
        per_scan: 0.2 * count as f64,
        east_half_m: half_m[0],
        north_half_m: half_m[1],
        radial_half_m_per_s: 20.0,
        strength_db: 15.0,
    };
    let duration_s = LOAD_PERIOD_S * f64::from(LOAD_SCAN_COUNT - 1);
    // Those on the way out of the area are to be seen, too.
    let extent_m = (20e3 * scale + 10e3).min(1e6);
    Scene {
        platform: past_the_scene(LOAD_SOUTH_M * scale.max(1.0), duration_s),
        scan: one_look(LOAD_PERIOD_S, LOAD_SCAN_COUNT, (extent_m, 60.0)),
        noise: NoiseConfig { strength_sigma_db: None, ..noise(400.0, 400.0) },
        detection: DetectionConfig { probability: 0.9, minimum_m_per_s: 0.0 },
        clutter: Some(clutter),
        targets,
    }
}

fn place([east_m, north_m]: [f64; 2], rng: &mut ChaCha8Rng) -> Vector2<f64> {
    Vector2::new(rng.random_range(-east_m..east_m), rng.random_range(-north_m..north_m))
}

fn direction(rng: &mut ChaCha8Rng) -> Vector2<f64> {
    let angle_rad: f64 = rng.random_range(0.0..TAU);
    Vector2::new(angle_rad.cos(), angle_rad.sin())
}

/// Straight on from `from_m` until after the last scan.
fn straight(from_m: Vector2<f64>, velocity_m_per_s: Vector2<f64>) -> TargetConfig {
    let duration_s = LOAD_PERIOD_S * f64::from(LOAD_SCAN_COUNT);
    let to_m = from_m + velocity_m_per_s * duration_s;
    let speed_m_per_s = velocity_m_per_s.norm();
    let way = vec![point(from_m.x, from_m.y, speed_m_per_s), point(to_m.x, to_m.y, speed_m_per_s)];
    TargetConfig { from_s: 0.0, way, strength_db: 15.0 }
}

fn anywhere(half_m: [f64; 2], rng: &mut ChaCha8Rng) -> TargetConfig {
    let from_m = place(half_m, rng);
    straight(from_m, direction(rng) * rng.random_range(5.0..20.0))
}

fn on_roads(count: usize, half_m: [f64; 2], rng: &mut ChaCha8Rng) -> Vec<TargetConfig> {
    let mut targets = Vec::with_capacity(count);
    while targets.len() < count {
        let (middle_m, along) = (place(half_m, rng), direction(rng));
        let right = Vector2::new(along.y, -along.x);
        let mut at_m = -0.5 * ROAD_M;
        while at_m < 0.5 * ROAD_M && targets.len() < count {
            let headway: f64 = Exp1.sample(rng);
            at_m += HEADWAY_M * headway;
            let side = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
            let deviation: f64 = StandardNormal.sample(rng);
            let velocity = along * side * (15.0 + 2.5 * deviation).max(5.0);
            let from_m = middle_m + along * at_m + right * (side * 0.5 * LANE_M);
            targets.push(straight(from_m, velocity));
        }
    }
    targets
}
