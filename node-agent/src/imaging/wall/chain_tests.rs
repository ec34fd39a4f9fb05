//! The wall through the whole chain: echoes made with it, imaged with it, and moved afterwards.

use nalgebra::Vector2;
use proto::geom::Se2;
use proto::radar::{Grid, Wall};

use super::*;
use crate::pipeline::{Chain, ChainConfig};
use crate::simulate::{Disturbance, EchoSimulator, Radar, Scene, Target, TargetKind, WayPoint};

const BRICK: Wall = Wall { thickness_m: 0.24, permittivity: 5.0 };
/// The bar for a point without noise behind a known wall, metres.
const KNOWN_WALL_BAR_M: f64 = 0.01;
/// The bar for a point moved in place of imaged anew, metres.
const MOVED_BAR_M: f64 = 0.003;

/// The only point a node sees through `wall` of a target without noise at `place_m`, imaged with
/// `model`.
fn measured(wall: Option<Wall>, place_m: &Vector2<f64>, model: WallModel) -> MeasuredPoint {
    let way_points = vec![WayPoint { time_s: 0.0, x_m: place_m.x, y_m: place_m.y }];
    let target = Target { way_points, kind: TargetKind::Point, amplitude_db: 0.0 };
    let scene = Scene { targets: vec![target], wall, ..Scene::default() };
    // Beside and beyond the place far enough for the wrong wall's shift.
    let grid = Grid {
        x_min_m: place_m.x - 1.0,
        y_min_m: (place_m.y - 1.0).max(0.0),
        pixel_m: 0.03,
        column_count: 68,
        row_count: 68,
    };
    let radar = Radar { grid, ..Radar::default() };
    let disturbance = Disturbance::default();
    let simulator = EchoSimulator::new(&scene, Se2::identity(), &radar, &disturbance, 1).unwrap();
    let config = ChainConfig { wall: model, grid, ..ChainConfig::of_points() };
    let mut chain = Chain::new(&config).unwrap();
    let mut points = chain.process_sweep(&simulator.sweep(0, 0.0)).unwrap().points;
    assert_eq!(points.len(), 1, "at {place_m:?} through {model:?}: {points:?}");
    points.swap_remove(0)
}

fn place_m(range_m: f64, angle_deg: f64) -> Vector2<f64> {
    let (sin, cos) = angle_deg.to_radians().sin_cos();
    Vector2::new(range_m * sin, range_m * cos)
}

/// Ranges in metres and angles in degrees of the tests.
const PLACES: [(f64, f64); 9] = [
    (1.5, 0.0),
    (1.5, 60.0),
    (2.0, -30.0),
    (3.5, 15.0),
    (3.5, -45.0),
    (5.0, 60.0),
    (6.0, 0.0),
    (8.0, 30.0),
    (8.0, -60.0),
];

#[test]
fn a_target_behind_a_known_wall_is_placed_to_a_centimetre_out_to_60_degrees() {
    for (range_m, angle_deg) in PLACES {
        let truth_m = place_m(range_m, angle_deg);
        let point = measured(Some(BRICK), &truth_m, WallModel::Refraction(BRICK));
        let error_m = (Vector2::new(point.x_m, point.y_m) - truth_m).norm();
        assert!(error_m < KNOWN_WALL_BAR_M, "{range_m} m {angle_deg} deg: {error_m} m");
    }
}

#[test]
fn the_fixed_delay_and_no_wall_fail_that_bar() {
    let truth_m = place_m(5.0, 45.0);
    for (model, at_least_m) in [(WallModel::FixedDelay(BRICK), 0.1), (WallModel::None, 0.3)] {
        let point = measured(Some(BRICK), &truth_m, model);
        let error_m = (Vector2::new(point.x_m, point.y_m) - truth_m).norm();
        assert!(at_least_m < error_m, "{model:?}: {error_m} m");
    }
}

#[test]
fn a_point_moved_is_where_imaging_anew_would_put_it() {
    let others = [
        WallModel::Refraction(Wall { thickness_m: 0.2, permittivity: 6.0 }),
        WallModel::Refraction(Wall { thickness_m: 0.3, permittivity: 4.0 }),
        WallModel::FixedDelay(BRICK),
        WallModel::None,
    ];
    for (range_m, angle_deg) in PLACES {
        let truth_m = place_m(range_m, angle_deg);
        let right = WallModel::Refraction(BRICK);
        let imaged = measured(Some(BRICK), &truth_m, right);
        for other in others {
            let anew = measured(Some(BRICK), &truth_m, other);
            let moved = right.moved(&imaged, &other).unwrap();
            let off_m = (moved.x_m - anew.x_m).hypot(moved.y_m - anew.y_m);
            assert!(off_m < MOVED_BAR_M, "{range_m} m {angle_deg} deg {other:?}: {off_m} m");
        }
    }
}
