//! Targets that stand for a while and go on.

use nalgebra::{Vector2, Vector3};

use super::super::{DefaultConfig, DefaultTracker};
use super::scenes::{Sensor, rng};
use crate::tracking::{Area, Coverage, Look, Status, Tracker};

const PERIOD_S: f64 = 4.0;
const SENSOR_M: Vector3<f64> = Vector3::new(0.0, -19_000.0, 6000.0);
/// Along each axis: 14.25 m/s.
const SPEED_M_PER_S: f64 = 10.076;

/// Where a target is and how fast on each axis that pauses twice, for 24 and 32 s, as in the scene of three
/// targets.
fn state(time_s: f64) -> [f64; 4] {
    let (mut moved_s, mut moves) = (time_s, true);
    for (from_s, pause_s) in [(59.3, 24.0), (132.9, 32.0)] {
        if from_s < time_s {
            moved_s -= (time_s - from_s).min(pause_s);
            moves = from_s + pause_s < time_s;
        }
    }
    let speed = if moves { SPEED_M_PER_S } else { 0.0 };
    let at_m = SPEED_M_PER_S * moved_s;
    [at_m - 900.0, at_m - 1200.0, speed, speed]
}

/// All of the scene.
fn everywhere(_: [f64; 4]) -> Area {
    Area::Everywhere
}

/// A beam on the target, 150 m to either side.
fn beam(at: [f64; 4]) -> Area {
    let line_m = Vector2::new(at[0], at[1]) - SENSOR_M.xy();
    let range_m = line_m.norm();
    Area::Sector {
        origin_m: SENSOR_M.xy(),
        direction_rad: line_m.y.atan2(line_m.x),
        half_width_rad: 150.0 / range_m,
        min_range_m: range_m - 3000.0,
        max_range_m: range_m + 3000.0,
    }
}

/// Ids of a run, and how many looks called it stopped; looks are shifted against the pauses by a tenth of
/// a second per run.
fn ids(
    detection: f64,
    area: fn([f64; 4]) -> Area,
    run: u32,
) -> (std::collections::BTreeSet<u64>, usize) {
    let sensor = Sensor {
        position_m: SENSOR_M,
        variances_m2: [20.0, 8.0],
        sigma_radial_m_per_s: 1.0,
        sigma_strength_db: 3.0,
    };
    let mut rng = rng(u64::from(run), 9);
    let mut tracker = DefaultTracker::new(DefaultConfig::wide_area()).unwrap();
    let (mut ids, mut stopped) = (std::collections::BTreeSet::new(), 0);
    for index in 0..60_u32 {
        let time_s = PERIOD_S * f64::from(index) + 0.1 * f64::from(run % 40);
        let now = state(time_s);
        let is_seen = 0.0 < now[2] && rand::RngExt::random_range(&mut rng, 0.0..1.0) < detection;
        let plots = if is_seen { vec![sensor.plot(now, Some(20.0), &mut rng)] } else { Vec::new() };
        let look = Look {
            time_s,
            sensor_index: 0,
            look_index: u64::from(index),
            platform: Some(sensor.platform()),
            coverage: Coverage {
                area: area(now),
                detection_probability: detection,
                minimum_detectable_m_per_s: Some(0.05),
            },
            clutter_per_m2: 1e-8,
            plots: &plots,
        };
        tracker.look(&look).unwrap();
        ids.extend(tracker.tracks().iter().map(|track| track.id));
        stopped += tracker.tracks().iter().filter(|t| t.status == Status::Stopped).count();
    }
    (ids, stopped)
}

/// Also where it is missed before it stops or as it moves on, and where the beam has left the place to
/// which it would have coasted. Of 400 runs of other seeds none, 8 and 18 had a second name, the first
/// plots of a run, which may be given up, among them.
#[test]
fn a_target_that_pauses_keeps_its_name() {
    for detection in [1.0, 0.9, 0.8] {
        for area in [everywhere as fn([f64; 4]) -> Area, beam] {
            let all: Vec<_> = (0..40).map(|run| ids(detection, area, run)).collect();
            let kept = all.iter().filter(|(ids, _)| ids.len() == 1).count();
            assert!(37 <= kept, "{detection}: {kept} of 40");
            // Of 14 looks at each, the first miss of a pause may be any.
            let stopped = all.iter().map(|(_, stopped)| stopped).sum::<usize>();
            assert!(11 * 40 <= stopped, "{detection}: {stopped}");
        }
    }
}

#[test]
#[ignore = "prints figures"]
fn study_of_pauses() {
    for detection in [1.0, 0.9, 0.8] {
        for (name, area) in [("everywhere", everywhere as fn([f64; 4]) -> Area), ("beam", beam)] {
            let all: Vec<_> = (1000..1400).map(|run| ids(detection, area, run)).collect();
            let lost = all.iter().filter(|(ids, _)| ids.len() > 1).count();
            let stopped = all.iter().map(|(_, stopped)| stopped).sum::<usize>();
            println!("{detection} {name}: lost {lost} of 400, stopped {stopped}");
        }
    }
}
