//! Tests of whole simulations: geometry, statistics of the errors, who is seen, the presets.

use nalgebra::Vector3;
use proto::geodesy::{EnuFrame, GeoPosition};
use proto::ids::NodeId;
use proto::wire::{Dwell, GeoRecord, Message};

use super::*;

mod presets;

/// Rounding through latitude and longitude, metres.
const SAME_M: f64 = 1e-4;

fn node() -> NodeId {
    "g1".parse().unwrap()
}

fn straight(from_m: [f64; 2], to_m: [f64; 2], speed_m_per_s: f64) -> TargetConfig {
    let point = |[east_m, north_m]: [f64; 2]| WayPoint {
        east_m,
        north_m,
        speed_m_per_s,
        pause_s: 0.0,
        turn_radius_m: 0.0,
    };
    TargetConfig { from_s: 0.0, way: vec![point(from_m), point(to_m)], strength_db: 15.0 }
}

/// A hundred vehicles on parallel ways, looked at once per scan.
fn many(place: PlaceNoise) -> SimulatedGmtiConfig {
    let targets = (0..100).map(|index| {
        let north_m = 60.0 * f64::from(index) - 3000.0;
        straight([-1000.0, north_m], [1000.0, north_m + 700.0], 13.0)
    });
    let noise = NoiseConfig {
        place,
        radial_sigma_m_per_s: Some(1.5),
        strength_sigma_db: Some(3.0),
        wrap_m_per_s: None,
    };
    SimulatedGmtiConfig {
        noise: Some(noise),
        targets: targets.collect(),
        ..SimulatedGmtiConfig::default()
    }
}

fn simulated(config: &SimulatedGmtiConfig) -> (SimulatedGmti, Vec<Dwell>) {
    let mut radar = SimulatedGmti::new(config, node()).unwrap();
    let dwells = std::iter::from_fn(|| radar.next_dwell().unwrap()).collect();
    (radar, dwells)
}

fn position(place: &GeoRecord) -> GeoPosition {
    GeoPosition::new(place.lat_deg, place.lon_deg, place.height_m).unwrap()
}

fn enu_m(frame: &EnuFrame, place: &GeoRecord) -> Vector3<f64> {
    let point = frame.to_enu(&position(place));
    Vector3::new(point.east_m, point.north_m, point.up_m)
}

fn mean_and_variance(values: &[f64]) -> (f64, f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    (mean, values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / (count - 1.0))
}

/// Of normal errors with variance 1: four standard deviations of their mean and variance.
fn assert_standard(values: &[f64], what: &str) {
    let (mean, variance) = mean_and_variance(values);
    let count = values.len() as f64;
    assert!(mean.abs() < 4.0 / count.sqrt(), "{what}: mean {mean}");
    assert!((variance - 1.0).abs() < 4.0 * (2.0 / count).sqrt(), "{what}: variance {variance}");
}

/// Errors of all reports in units of what they state: along and across the line of sight over
/// ground, radial velocity, strength.
fn normalised(config: &SimulatedGmtiConfig) -> [Vec<f64>; 4] {
    let (radar, dwells) = simulated(config);
    let mut all: [Vec<f64>; 4] = Default::default();
    for dwell in &dwells {
        let sensor_m = enu_m(radar.frame(), &dwell.sensor);
        for report in &dwell.reports {
            let motion = radar.truth(report.truth.unwrap(), dwell.time_unix_s).unwrap();
            let place_m = enu_m(radar.frame(), &report.place);
            let true_m = motion.position_m.push(place_m.z);
            let line_m = true_m - sensor_m;
            let along = line_m.xy().normalize();
            let error_m = place_m.xy() - motion.position_m;
            let cos_grazing = line_m.xy().norm() / line_m.norm();
            all[0].push(along.dot(&error_m) * cos_grazing / report.slant_sigma_m.unwrap());
            all[1].push(along.perp(&error_m) / report.cross_sigma_m.unwrap());
            let radial = line_m.normalize().xy().dot(&motion.velocity_m_per_s);
            all[2].push((report.radial_m_per_s.unwrap() - radial) / 1.5);
            all[3].push((report.snr_db.unwrap() - 15.0) / 3.0);
        }
    }
    all
}

/// 4000 reports: the bounds are 0.063 of means and 0.089 of variances.
#[test]
fn errors_are_as_large_as_the_reports_say() {
    for place in [
        PlaceNoise::Ground { along_m2: 100.0, across_m2: 900.0 },
        PlaceNoise::Polar { slant_sigma_m: 8.0, cone_sigma_deg: 0.05 },
    ] {
        let errors = normalised(&many(place));
        let names = ["along", "across", "radial", "strength"];
        for (values, name) in errors.iter().zip(names) {
            assert_eq!(values.len(), 4000);
            assert_standard(values, name);
        }
    }
}

#[test]
fn without_noise_places_are_true_to_a_tenth_of_a_millimetre() {
    let place = PlaceNoise::Polar { slant_sigma_m: 1e-6, cone_sigma_deg: 1e-9 };
    let (radar, dwells) = simulated(&many(place));
    let mut count = 0;
    for dwell in &dwells {
        for report in &dwell.reports {
            let motion = radar.truth(report.truth.unwrap(), dwell.time_unix_s).unwrap();
            let place_m = enu_m(radar.frame(), &report.place);
            assert!((place_m.xy() - motion.position_m).norm() < SAME_M, "{place_m}");
            assert!((report.place.height_m - 1050.0).abs() < 1e-9);
            count += 1;
        }
    }
    assert_eq!(count, 4000);
}

#[test]
fn the_aircraft_flies_as_it_says() {
    let config = SimulatedGmtiConfig {
        platform: Some(PlatformConfig {
            east_m: 50e3,
            north_m: -18e3,
            height_m: 5000.0,
            course_deg: 30.0,
            speed_m_per_s: 100.0,
        }),
        ..SimulatedGmtiConfig::default()
    };
    let (_, dwells) = simulated(&config);
    for pair in dwells.windows(2) {
        // In the frame of the aircraft itself: what its own compass and log would say.
        let here = EnuFrame::new(position(&pair[0].sensor));
        let step_m = enu_m(&here, &pair[1].sensor);
        let flight = pair[0].flight.unwrap();
        let course_deg = step_m.x.atan2(step_m.y).to_degrees();
        assert!((course_deg - flight.course_deg).abs() < 2e-3, "{course_deg} {flight:?}");
        assert!((step_m.xy().norm() - 400.0).abs() < 0.4, "{step_m}");
        assert!((pair[0].sensor.height_m - 6050.0).abs() < 1e-6);
        // 50 km east of the origin true north lies 0.39 degrees to the west of the frame's.
        assert!((flight.course_deg - 30.4).abs() < 0.1, "{flight:?}");
    }
}

#[test]
fn the_same_seed_gives_the_same_dwells_and_another_one_others() {
    let config = SimulatedGmtiConfig::default();
    let (_, dwells) = simulated(&config);
    assert_eq!(simulated(&config).1, dwells);
    assert_eq!(dwells.len(), 40);
    let other = SimulatedGmtiConfig { seed: 2, ..config };
    assert_ne!(simulated(&other).1, dwells);
    dwells.iter().for_each(|dwell| dwell.check().unwrap());
}

#[test]
fn with_other_variances_the_same_errors_are_drawn() {
    let errors = |variance_m2: f64| {
        let place = PlaceNoise::Ground { along_m2: variance_m2, across_m2: variance_m2 };
        normalised(&many(place))
    };
    for (few, many) in errors(100.0).iter().zip(&errors(400.0)) {
        let worst = few.iter().zip(many).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        // The line of sight to the measured place differs from the one to the true place.
        assert!(worst < 0.02, "{worst}");
    }
}

#[test]
fn as_many_are_missed_and_false_as_asked_for() {
    let clutter = ClutterConfig {
        per_scan: 50.0,
        east_half_m: 2000.0,
        north_half_m: 3000.0,
        radial_half_m_per_s: 20.0,
        strength_db: 12.0,
    };
    let config = SimulatedGmtiConfig {
        detection: Some(DetectionConfig { probability: 0.8, minimum_m_per_s: 0.0 }),
        clutter: Some(clutter),
        ..many(PlaceNoise::Ground { along_m2: 100.0, across_m2: 100.0 })
    };
    let (radar, dwells) = simulated(&config);
    let reports = || dwells.iter().flat_map(|dwell| &dwell.reports);
    let true_count = reports().filter(|report| report.truth.is_some()).count() as f64;
    let false_count = reports().filter(|report| report.truth.is_none()).count() as f64;
    // Four standard deviations of 4000 trials at 0.8, and of a Poisson count of 2000.
    assert!((true_count - 3200.0).abs() < 4.0 * (4000.0_f64 * 0.16).sqrt(), "{true_count}");
    assert!((false_count - 2000.0).abs() < 4.0 * 2000.0_f64.sqrt(), "{false_count}");
    let mut east_m = Vec::new();
    for report in reports().filter(|report| report.truth.is_none()) {
        let place_m = enu_m(radar.frame(), &report.place);
        assert!(place_m.x.abs() <= 2000.0 + SAME_M && place_m.y.abs() <= 3000.0 + SAME_M);
        assert!(report.radial_m_per_s.unwrap().abs() <= 20.0);
        east_m.push(place_m.x / (2000.0 / 3.0_f64.sqrt()));
    }
    let (mean, variance) = mean_and_variance(&east_m);
    assert!(mean.abs() < 0.1 && (variance - 1.0).abs() < 0.1, "{mean} {variance}");
}

/// The minimum detectable velocity: exactly those whose radial velocity is not above it are unseen.
#[test]
fn slow_and_standing_targets_are_not_seen() {
    let minimum_m_per_s = 3.0;
    let mut config = SimulatedGmtiConfig {
        detection: Some(DetectionConfig { probability: 1.0, minimum_m_per_s }),
        ..many(PlaceNoise::Ground { along_m2: 1.0, across_m2: 1.0 })
    };
    config.targets[0].way[0].pause_s = 80.0;
    let (radar, dwells) = simulated(&config);
    let (mut seen_count, mut slow_count) = (0, 0);
    for dwell in &dwells {
        assert_eq!(dwell.minimum_detectable_m_per_s, Some(3.0));
        let sensor_m = enu_m(radar.frame(), &dwell.sensor);
        for TruthState { index, motion } in radar.truths(dwell.time_unix_s) {
            let line_m = motion.position_m.push(0.0) - sensor_m;
            let radial = line_m.normalize().xy().dot(&motion.velocity_m_per_s);
            // The earth's curvature tilts the line of sight a little.
            if (radial.abs() - minimum_m_per_s).abs() < 1e-3 {
                continue;
            }
            let is_seen = dwell.reports.iter().any(|report| report.truth == Some(index));
            assert_eq!(is_seen, minimum_m_per_s < radial.abs(), "{index} {radial}");
            seen_count += usize::from(is_seen);
            slow_count += usize::from(!is_seen);
        }
    }
    assert!(seen_count > 500 && slow_count > 500, "{seen_count} {slow_count}");
}

#[test]
fn radial_velocities_wrap_and_say_so() {
    let mut config = many(PlaceNoise::Ground { along_m2: 1.0, across_m2: 1.0 });
    let (_, plain) = simulated(&config);
    let span = 4.0;
    config.noise = config.noise.map(|noise| NoiseConfig { wrap_m_per_s: Some(span), ..noise });
    let (_, wrapped) = simulated(&config);
    let mut beyond_count = 0;
    for (one, other) in plain.iter().zip(&wrapped) {
        for (before, after) in one.reports.iter().zip(&other.reports) {
            assert_eq!((before.wrap_m_per_s, after.wrap_m_per_s), (None, Some(span)));
            let (before, after) = (before.radial_m_per_s.unwrap(), after.radial_m_per_s.unwrap());
            assert!(after.abs() <= 0.5 * span);
            let turns = (before - after) / span;
            assert!((turns - turns.round()).abs() < 1e-9, "{before} {after}");
            beyond_count += usize::from(turns.abs() > 0.5);
        }
    }
    assert!(beyond_count > 500, "{beyond_count}");
}

/// Overlapping beams of 3 degrees every 2: seen in just those dwells whose beam holds the target's
/// true azimuth and range, which is worked out here by spherical angles of the aircraft's own frame.
#[test]
fn a_target_is_reported_by_the_dwells_whose_beam_is_on_it() {
    let beam = BeamConfig { width_deg: 3.0, step_deg: 2.0, dwell_s: 0.3, alternates: true };
    let scan = ScanConfig {
        period_s: 4.0,
        count: Some(20),
        center_east_m: 300.0,
        center_north_m: 200.0,
        range_half_extent_m: 1500.0,
        angle_half_extent_deg: 8.0,
        beam: Some(beam),
    };
    let config = SimulatedGmtiConfig {
        scan: Some(scan),
        ..many(PlaceNoise::Ground { along_m2: 1.0, across_m2: 1.0 })
    };
    let (radar, dwells) = simulated(&config);
    assert_eq!(dwells.len(), 160);
    let (mut report_count, mut twice_count) = (0, 0);
    for dwell in &dwells {
        let here = EnuFrame::new(position(&dwell.sensor));
        let middle_m = enu_m(&here, &dwell.area.center);
        for TruthState { index, motion } in radar.truths(dwell.time_unix_s) {
            let at = motion.position_m;
            let place = radar.frame().on_surface(at.x, at.y, 1050.0).unwrap();
            let look = here.look_at(&place);
            let middle_deg = middle_m.x.atan2(middle_m.y).to_degrees();
            let off_deg = (look.azimuth_deg - middle_deg + 180.0).rem_euclid(360.0) - 180.0;
            let ground_m = look.slant_range_m * look.elevation_deg.to_radians().cos();
            let far_m = ground_m - middle_m.xy().norm();
            // Near the border the two planes may differ.
            if (off_deg.abs() - 1.5).abs() < 0.01 || (far_m.abs() - 1500.0).abs() < 10.0 {
                continue;
            }
            let is_in_beam = off_deg.abs() < 1.5 && far_m.abs() < 1500.0;
            let count = dwell.reports.iter().filter(|r| r.truth == Some(index)).count();
            assert_eq!(count, usize::from(is_in_beam), "{index} {off_deg} {far_m}");
            report_count += count;
        }
    }
    for scan_dwells in dwells.chunks(8) {
        let of = |index: u32| {
            let reports = scan_dwells.iter().flat_map(|dwell| &dwell.reports);
            reports.filter(|report| report.truth == Some(index)).count()
        };
        twice_count += (0..100).filter(|index| of(*index) == 2).count();
        assert!(scan_dwells[7].is_last_of_revisit && !scan_dwells[6].is_last_of_revisit);
    }
    assert!(report_count > 400 && twice_count > 100, "{report_count} {twice_count}");
    // It goes back every other scan: the last beam of one is the first of the next.
    let azimuth = |dwell: &Dwell| {
        let middle_m = enu_m(&EnuFrame::new(position(&dwell.sensor)), &dwell.area.center);
        middle_m.x.atan2(middle_m.y).to_degrees()
    };
    assert!((azimuth(&dwells[7]) - azimuth(&dwells[8])).abs() < 1.5);
    assert!((azimuth(&dwells[0]) - azimuth(&dwells[7])).abs() > 12.0);
}

#[test]
fn nonsense_is_named_from_the_table_on() {
    let plain = SimulatedGmtiConfig::default();
    plain.check().unwrap();
    let field = |config: SimulatedGmtiConfig| config.check().unwrap_err().field;
    let scan = four_targets().scan;
    let beam = BeamConfig { width_deg: 3.0, step_deg: 2.0, dwell_s: 0.3, alternates: false };
    let slow = ScanConfig { beam: Some(BeamConfig { dwell_s: 1.0, ..beam }), ..scan };
    let narrow = ScanConfig { beam: Some(BeamConfig { step_deg: 1e-3, ..beam }), ..scan };
    let noise = four_targets().noise;
    let sharp =
        NoiseConfig { place: PlaceNoise::Ground { along_m2: 0.0, across_m2: 1.0 }, ..noise };
    let clutter = load(Layout::Uniform, 1, 1).clutter.unwrap();
    let platform = PlatformConfig { speed_m_per_s: 0.0, ..four_targets().platform };
    let detection = DetectionConfig { probability: 1.1, minimum_m_per_s: 0.0 };
    let alone = TargetConfig { from_s: 0.0, way: Vec::new(), strength_db: 1.0 };
    let of = |change: &dyn Fn(&mut SimulatedGmtiConfig)| {
        let mut config = plain.clone();
        change(&mut config);
        field(config)
    };
    assert_eq!(of(&|c| c.origin.lat_deg = 91.0), "simulated.origin.lat_deg");
    assert_eq!(of(&|c| c.start_unix_s = f64::NAN), "simulated.start_unix_s");
    assert_eq!(of(&|c| c.target_count = 1_000_000), "simulated.target_count");
    assert_eq!(of(&|c| c.scan = Some(slow)), "simulated.scan.beam.dwell_s");
    assert_eq!(of(&|c| c.scan = Some(narrow)), "simulated.scan.beam.step_deg");
    assert_eq!(of(&|c| c.noise = Some(sharp)), "simulated.noise.place.ground.along_m2");
    assert_eq!(of(&|c| c.platform = Some(platform)), "simulated.platform.speed_m_per_s");
    assert_eq!(of(&|c| c.detection = Some(detection)), "simulated.detection.probability");
    assert_eq!(of(&|c| c.targets = vec![alone.clone()]), "simulated.targets[0].way");
    let wild = ClutterConfig { per_scan: -1.0, ..clutter };
    assert_eq!(of(&|c| c.clutter = Some(wild)), "simulated.clutter.per_scan");
    let refused = SimulatedGmti::new(&SimulatedGmtiConfig { scan: Some(slow), ..plain }, node());
    assert!(matches!(refused, Err(SimulationError::Setting(_))));
}

#[test]
fn a_scene_that_no_message_holds_is_refused_until_it_is_scanned_by_more_beams() {
    let config = SimulatedGmtiConfig {
        preset: Preset::LoadUniform,
        target_count: 5000,
        ..SimulatedGmtiConfig::default()
    };
    assert!(config.scene().check_message().unwrap_err().remedy.contains("beam"));
    let beam = BeamConfig { width_deg: 12.0, step_deg: 12.0, dwell_s: 0.4, alternates: false };
    let scan = ScanConfig { beam: Some(beam), ..config.scene().scan };
    let scanned = SimulatedGmtiConfig { scan: Some(scan), ..config };
    scanned.scene().check_message().unwrap();
    simulated(&scanned).1.iter().for_each(|dwell| dwell.check().unwrap());
}

#[test]
fn an_aircraft_that_leaves_the_earth_is_an_error() {
    let platform = PlatformConfig { speed_m_per_s: 1000.0, ..four_targets().platform };
    let scan = ScanConfig { period_s: 1e5, count: Some(10), ..four_targets().scan };
    let config = SimulatedGmtiConfig {
        platform: Some(platform),
        scan: Some(scan),
        ..SimulatedGmtiConfig::default()
    };
    let mut radar = SimulatedGmti::new(&config, node()).unwrap();
    radar.next_dwell().unwrap();
    let error = SimulationError::from(radar.next_dwell().unwrap_err());
    assert!(error.to_string().starts_with("simulating a wide-area radar"), "{error}");
}

#[test]
fn settings_are_written_in_toml_and_unknown_keys_are_refused() {
    let text = "
        preset = 'four-targets'
        rotated = true
        [noise]
        place = { polar = { slant_sigma_m = 10.0, cone_sigma_deg = 0.1 } }
        radial_sigma_m_per_s = 2.0
        [[targets]]
        strength_db = 12.0
        way = [
            { east_m = 0.0, north_m = 0.0, speed_m_per_s = 12.0 },
            { east_m = 900.0, north_m = 0.0, speed_m_per_s = 12.0, turn_radius_m = 200.0 },
            { east_m = 900.0, north_m = 900.0 },
        ]";
    let config: SimulatedGmtiConfig = toml::from_str(text).unwrap();
    config.check().unwrap();
    assert_eq!(config.scene().targets.len(), 1);
    let again: SimulatedGmtiConfig = toml::from_str(&toml::to_string(&config).unwrap()).unwrap();
    assert_eq!(again, config);
    let wrong = toml::from_str::<SimulatedGmtiConfig>("sead = 3").unwrap_err();
    assert!(wrong.to_string().contains("sead"));
}
