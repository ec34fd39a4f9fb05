//! The public scene of ten targets, positions only, with truth tags (STANAG 4607).

use nalgebra::{Matrix2, Vector2, Vector3};

use super::super::{DefaultConfig, DefaultTracker};
use super::scenes::{Scene, Taken};
use super::score::{Score, score};
use crate::tracking::{Area, Coverage, Platform, Plot, Status, Tracker};

const FILE: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../shared/data/stanag4607/ten-targets-situation-awareness.4607"
);
/// Metres per degree of latitude, and of longitude at the equator: the scene is 40 km wide.
const METRES_PER_DEG: f64 = 111_200.0;
/// The file gives no errors; those of the scene's precise version, metres in slant range and across.
const SIGMAS_M: [f64; 2] = [10.0, 60.0];
/// The mask of all its dwells: reports are index, offsets, class, tag.
const MASK: u64 = 0xffc7_1fc2_6006_0000;
const REPORT_BYTES: usize = 11;

fn number(bytes: &[u8]) -> i64 {
    bytes.iter().fold(0, |sum, byte| sum << 8 | i64::from(*byte))
}

fn count(bytes: &[u8]) -> usize {
    usize::try_from(number(bytes)).unwrap()
}

/// Two's complement of 32 or 16 bits.
fn signed(bytes: &[u8]) -> i64 {
    let value = number(bytes);
    let half = 1_i64 << (8 * bytes.len() - 1);
    if half <= value { value - 2 * half } else { value }
}

/// Payloads of the dwell segments, after size and type.
fn dwells(file: &[u8]) -> Vec<&[u8]> {
    let mut found = Vec::new();
    let mut at = 0;
    while at < file.len() {
        let end = at + count(&file[at + 2..at + 6]);
        let mut segment = at + 32;
        while segment < end {
            let size = count(&file[segment + 1..segment + 5]);
            if file[segment] == 2 {
                found.push(&file[segment + 5..segment + size]);
            }
            segment += size;
        }
        at = end;
    }
    found
}

/// The look of a dwell, in a plane about `origin_deg`, latitude and longitude.
fn look(dwell: &[u8], origin_deg: [f64; 2]) -> Taken {
    assert_eq!(number(&dwell[..8]) as u64, MASK);
    let (lat, lon) = (180.0 / 2.0_f64.powi(32), 360.0 / 2.0_f64.powi(32));
    let place = |lat_raw: f64, lon_raw: f64| {
        let north = (lat_raw * lat - origin_deg[0]) * METRES_PER_DEG;
        let east = (lon_raw * lon - origin_deg[1]) * METRES_PER_DEG;
        Vector2::new(east * origin_deg[0].to_radians().cos(), north)
    };
    let raw = |from: usize, to: usize| signed(&dwell[from..to]) as f64;
    let sensor = place(raw(19, 23), number(&dwell[23..27]) as f64);
    let (lat_step, lon_step) = (raw(31, 35), number(&dwell[35..39]) as f64);
    // Track, speed, vertical velocity: 2, 4, 1; attitude: 6.
    let (centre_lat, centre_lon) = (raw(52, 56), number(&dwell[56..60]) as f64);
    let half_range_m = number(&dwell[60..62]) as f64 / 128.0 * 1000.0;
    let half_width_rad = (number(&dwell[62..64]) as f64 * 360.0 / 65536.0).to_radians();
    let height_m = raw(27, 31) / 100.0;
    let to_centre = place(centre_lat, centre_lon) - sensor;
    let (mut plots, mut truths) = (Vec::new(), Vec::new());
    for (index, report) in dwell[64..].chunks_exact(REPORT_BYTES).enumerate() {
        let position_m = place(
            centre_lat + lat_step * signed(&report[2..4]) as f64,
            centre_lon + lon_step * signed(&report[4..6]) as f64,
        );
        let off = position_m - sensor;
        let along = off.normalize();
        let across = Vector2::new(-along.y, along.x);
        let ground = SIGMAS_M[0] * off.norm().hypot(height_m) / off.norm();
        let covariance_m2 = along * along.transpose() * ground.powi(2)
            + across * across.transpose() * SIGMAS_M[1].powi(2);
        truths.push(Some(count(&report[7..11])));
        let covariance_m2 = Matrix2::from(0.5 * (covariance_m2 + covariance_m2.transpose()));
        plots.push(Plot {
            position_m,
            covariance_m2,
            radial: None,
            strength_db: None,
            report_index: u32::try_from(index).unwrap(),
        });
    }
    let area = Area::Sector {
        origin_m: sensor,
        direction_rad: to_centre.y.atan2(to_centre.x),
        half_width_rad,
        min_range_m: to_centre.norm() - half_range_m,
        max_range_m: to_centre.norm() + half_range_m,
    };
    Taken {
        time_s: number(&dwell[15..19]) as f64 / 1000.0,
        sensor_index: 0,
        platform: Some(Platform {
            position_m: Vector3::new(sensor.x, sensor.y, height_m),
            velocity_m_per_s: Vector3::zeros(),
            beam_index: None,
        }),
        coverage: Coverage { area, detection_probability: 0.9, minimum_detectable_m_per_s: None },
        clutter_per_m2: 1e-10,
        plots,
        truths,
    }
}

/// Confirmed tracks, and how pure they are.
fn follow(scene: &Scene, config: &DefaultConfig) -> (usize, Score) {
    let mut tracker = DefaultTracker::new(config.clone()).unwrap();
    let mut ids = std::collections::BTreeSet::new();
    for (index, taken) in scene.looks.iter().enumerate() {
        tracker.look(&taken.look(index)).unwrap();
        let sure = tracker.tracks().iter().filter(|track| track.status != Status::Tentative);
        ids.extend(sure.map(|track| track.id));
    }
    let mut settled = Vec::new();
    tracker.finish();
    tracker.take_settled(&mut settled);
    (ids.len(), score(scene, &settled))
}

/// The scene, if its file is there.
fn scene() -> Option<Scene> {
    let Ok(file) = std::fs::read(FILE) else {
        println!("skipped: no {FILE}");
        return None;
    };
    let dwells = dwells(&file);
    let centre = |dwell: &[u8]| {
        [signed(&dwell[52..56]) as f64 * 180.0, number(&dwell[56..60]) as f64 * 360.0]
            .map(|value| value / 2.0_f64.powi(32))
    };
    let origin_deg = centre(dwells[0]);
    let looks: Vec<Taken> = dwells.iter().map(|dwell| look(dwell, origin_deg)).collect();
    assert_eq!((looks.len(), looks.iter().map(|look| look.plots.len()).sum()), (154, 218));
    let truth = vec![vec![[0.0; 4]; 11]; looks.len()];
    Some(Scene { looks, truth })
}

#[test]
fn ten_targets_make_ten_tracks() {
    let Some(scene) = scene() else { return };
    let (tracks, sum) = follow(&scene, &DefaultConfig::wide_area());
    println!("tracks {tracks} purity {:.4} links {}/{}", sum.purity(), sum.right_links, sum.links);
    assert_eq!(tracks, 10);
    assert!(0.98 <= sum.purity());
}

#[test]
#[ignore = "seconds: settings on the scene of ten"]
fn study_ten_targets() {
    let Some(scene) = scene() else { return };
    for (push, clutter) in [35.0, 50.0, 65.0, 80.0]
        .into_iter()
        .flat_map(|push| [3e-10, 1e-9, 3e-9].map(|clutter| (push, clutter)))
    {
        let mut config = DefaultConfig::wide_area();
        config.lively.push_m2_per_s3 = push;
        config.min_clutter_per_m2 = clutter;
        let (tracks, sum) = follow(&scene, &config);
        let (purity, right) = (sum.purity(), sum.right_links);
        println!(
            "push {push} clutter {clutter}: {tracks} tracks, purity {purity:.4}, {right}/{}",
            sum.links
        );
    }
}
