//! Targets that stand for a while and go on.

use nalgebra::Vector3;

use super::super::{DefaultConfig, DefaultTracker};
use super::scenes::{EVERYWHERE, Sensor, rng};
use crate::tracking::{Coverage, Look, Status, Tracker};

const PERIOD_S: f64 = 4.0;
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

/// Ids of a run, and how many looks called it stopped; `shift_s` moves the looks against the pauses.
fn ids(detection: f64, shift_s: f64, seed: u64) -> (std::collections::BTreeSet<u64>, usize) {
    let sensor = Sensor {
        position_m: Vector3::new(0.0, -19_000.0, 6000.0),
        variances_m2: [20.0, 8.0],
        sigma_radial_m_per_s: 1.0,
        sigma_strength_db: 3.0,
    };
    let coverage = Coverage {
        detection_probability: detection,
        minimum_detectable_m_per_s: Some(0.05),
        ..EVERYWHERE
    };
    let mut rng = rng(seed, 9);
    let mut tracker = DefaultTracker::new(DefaultConfig::wide_area()).unwrap();
    let (mut ids, mut stopped) = (std::collections::BTreeSet::new(), 0);
    for index in 0..60_u32 {
        let time_s = PERIOD_S * f64::from(index) + shift_s;
        let now = state(time_s);
        let is_seen = 0.0 < now[2] && rand::RngExt::random_range(&mut rng, 0.0..1.0) < detection;
        let plots = if is_seen { vec![sensor.plot(now, Some(20.0), &mut rng)] } else { Vec::new() };
        let look = Look {
            time_s,
            sensor_index: 0,
            look_index: u64::from(index),
            platform: Some(sensor.platform()),
            coverage,
            clutter_per_m2: 1e-8,
            plots: &plots,
        };
        tracker.look(&look).unwrap();
        ids.extend(tracker.tracks().iter().map(|track| track.id));
        stopped += tracker.tracks().iter().filter(|t| t.status == Status::Stopped).count();
    }
    (ids, stopped)
}

#[test]
fn a_target_that_pauses_keeps_its_name() {
    for detection in [1.0, 0.9] {
        let runs = (0..40_u32).map(|run| ids(detection, 0.1 * f64::from(run), u64::from(run)));
        let all: Vec<_> = runs.collect();
        // Who is missed as it moves on is out of reach a look later, one time in ten for each pause.
        let kept = all.iter().filter(|(ids, _)| ids.len() == 1).count();
        let stopped = all.iter().map(|(_, stopped)| stopped).sum::<usize>();
        assert!(36 <= kept, "{detection}: {kept} of 40");
        // Of 14 looks at each, the first miss of a pause may be any.
        assert!(12 * 40 <= stopped, "{detection}: {stopped}");
    }
}
