//! Four vehicles under a flying radar: two side by side, two whose ways cross.

use nalgebra::{Matrix2, Vector2, Vector3};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;

use crate::tracking::links::{Links, Origin, links};
use crate::tracking::paper::{Mode, PaperConfig, PaperTracker};
use crate::tracking::{Area, Coverage, Look, Platform, Plot, Radial, ReportId, Settled, Tracker};

pub(super) const SCAN_COUNT: u64 = 40;
pub(super) const SCAN_S: f64 = 4.0;
/// 50 m per scan.
const SPEED_M_PER_S: f64 = 12.5;
/// Ground range of the nearer one of the pair in the middle of the time.
const NEAR_M: f64 = 18_500.0;
/// Where the ways cross: so far beyond it that at the ends all four are near each other. Of the
/// distances tried (225, 350, 700 m) the one that meets the figures of the prototypes, with seeds 0
/// to 499.
const CROSSING_BEYOND_M: f64 = 350.0;
/// To either side of the common course.
const CROSSING_RAD: f64 = 0.2;
const STRENGTHS_DB: [f64; 4] = [14.0, 17.0, 20.0, 23.0];
const RADIAL_SIGMA_M_PER_S: f64 = 1.0;
const STRENGTH_SIGMA_DB: f64 = 3.0;

/// How the scene lies before the sensor, which flies east.
#[derive(Clone, Copy, Debug)]
pub(super) enum Lie {
    /// Everybody drives along the flight: the pair is apart in range.
    Along,
    /// All of it turned by 90°: the pair is apart across, with the same radial velocity.
    Across,
}

/// Where target `index` is, over the plane, and its velocity.
pub(super) fn truth(lie: Lie, index: u32, time_s: f64) -> (Vector2<f64>, Vector2<f64>) {
    let middle_s = 0.5 * SCAN_S * (SCAN_COUNT - 1) as f64;
    let (beyond_m, course_rad) = match index {
        0 => (0.0, 0.0),
        1 => (50.0, 0.0),
        2 => (CROSSING_BEYOND_M, CROSSING_RAD),
        _ => (CROSSING_BEYOND_M, -CROSSING_RAD),
    };
    let velocity = SPEED_M_PER_S * Vector2::new(course_rad.cos(), course_rad.sin());
    let place_m = Vector2::new(0.0, beyond_m) + velocity * (time_s - middle_s);
    let turned = |v: Vector2<f64>| match lie {
        Lie::Along => v,
        Lie::Across => Vector2::new(-v.y, v.x),
    };
    (Vector2::new(0.0, NEAR_M) + turned(place_m), turned(velocity))
}

pub(super) fn platform(time_s: f64) -> Platform {
    Platform {
        position_m: Vector3::new(-9_600.0 + 120.0 * time_s, 0.0, 6_000.0),
        velocity_m_per_s: Vector3::new(120.0, 0.0, 0.0),
        beam_index: None,
    }
}

/// The plots of every scan; report `i` is of target `i`.
pub(super) fn scans(lie: Lie, variance_m2: f64, seed: u64) -> Vec<(f64, Vec<Plot>)> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || rng.sample::<f64, _>(StandardNormal);
    let scan = |scan| {
        let time_s = SCAN_S * scan as f64;
        let plots = (0..4).map(|index| {
            let (place_m, velocity) = truth(lie, index, time_s);
            let sensor = platform(time_s).position_m;
            let line = Vector3::new(place_m.x, place_m.y, 0.0) - sensor;
            let direction = line.xy() / line.norm();
            let off_m = variance_m2.sqrt() * Vector2::new(normal(), normal());
            let radial = direction.dot(&velocity) + RADIAL_SIGMA_M_PER_S * normal();
            Plot {
                position_m: place_m + off_m,
                covariance_m2: Matrix2::identity() * variance_m2,
                radial: Some(Radial {
                    velocity_m_per_s: radial,
                    sigma_m_per_s: RADIAL_SIGMA_M_PER_S,
                    direction,
                    wrap_m_per_s: None,
                }),
                strength_db: Some(STRENGTHS_DB[index as usize] + STRENGTH_SIGMA_DB * normal()),
                report_index: index,
            }
        });
        (time_s, plots.collect())
    };
    (0..SCAN_COUNT).map(scan).collect()
}

pub(super) fn look(look_index: u64, time_s: f64, plots: &[Plot]) -> Look<'_> {
    Look {
        time_s,
        sensor_index: 0,
        look_index,
        platform: Some(platform(time_s)),
        coverage: Coverage {
            area: Area::Everywhere,
            detection_probability: 0.99,
            minimum_detectable_m_per_s: None,
        },
        clutter_per_m2: 1e-9,
        plots,
    }
}

pub(super) struct Outcome {
    pub(super) links: Links,
    /// Of smoothed places, against the target of the track's first plot.
    pub(super) square_error_m2: f64,
}

pub(super) fn follow(
    (mode, config): (Mode, &PaperConfig),
    (lie, scans): (Lie, &[(f64, Vec<Plot>)]),
) -> Outcome {
    let mut tracker = PaperTracker::new(mode, config).unwrap();
    let mut steps: Vec<Settled> = Vec::new();
    for ((time_s, plots), index) in scans.iter().zip(0..) {
        tracker.look(&look(index, *time_s, plots)).unwrap();
        tracker.take_settled(&mut steps);
    }
    tracker.finish();
    tracker.take_settled(&mut steps);
    let target = |report: ReportId| Some(report.report_index);
    let original = |step: &Settled| {
        let first = steps.iter().find(|other| other.track == step.track);
        first.and_then(|first| first.report).map_or(0, |report| report.report_index)
    };
    let square_m2 = |step: &Settled| {
        let (place_m, _) = truth(lie, original(step), step.time_s);
        (step.smoothed_state.fixed_rows::<2>(0) - place_m).norm_squared()
    };
    let square_error_m2 = steps.iter().map(square_m2).sum::<f64>() / steps.len() as f64;
    Outcome { links: links(&steps, Origin::First, target), square_error_m2 }
}
