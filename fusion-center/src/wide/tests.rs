//! Tests against the geometry of the earth itself, and of the vote on the Doppler sign.

use nalgebra::{Matrix4, Vector2, Vector3, Vector4};
use proto::geodesy::{EnuFrame, GeoPosition, GeodesyError};
use proto::wire::{Dwell, DwellArea, DwellReport, FlightRecord, GeoRecord};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

use super::*;
use crate::tracking::{Area, Plot};

/// What the issue asks of places, metres.
const MILLIMETRE: f64 = 1e-3;
const NAME: LookName = LookName { sensor_index: 0, look_index: 0 };

fn geo(lat_deg: f64, lon_deg: f64, height_m: f64) -> GeoRecord {
    GeoRecord { lat_deg, lon_deg, height_m }
}

fn position(place: &GeoRecord) -> GeoPosition {
    GeoPosition::new(place.lat_deg, place.lon_deg, place.height_m).unwrap()
}

/// Straight through the earth's frame, metres.
fn apart_m(one: &GeoRecord, other: &GeoRecord) -> f64 {
    position(one).to_ecef().distance_m(&position(other).to_ecef())
}

fn report(index: u32, place: GeoRecord) -> DwellReport {
    DwellReport {
        index,
        place,
        slant_sigma_m: Some(8.0),
        cross_sigma_m: Some(45.0),
        radial_m_per_s: Some(6.0),
        radial_sigma_m_per_s: Some(0.7),
        wrap_m_per_s: Some(50.0),
        snr_db: Some(13.0),
        truth: Some(index),
    }
}

/// A sensor 6 km over the ground and some 20 km from it.
fn dwell() -> Dwell {
    let ground = [(40.80, 111.70), (40.83, 111.66), (40.77, 111.79)];
    let reports =
        (0..).zip(ground).map(|(index, (lat, lon))| report(index, geo(lat, lon, 1050.0))).collect();
    Dwell {
        node: "g1".parse().unwrap(),
        time_unix_s: 1.7e9,
        revisit_index: 3,
        dwell_index: 0,
        is_last_of_revisit: true,
        sensor: geo(40.65, 111.60, 7050.0),
        flight: Some(FlightRecord { course_deg: 70.0, speed_m_per_s: 120.0, climb_m_per_s: 0.0 }),
        area: DwellArea {
            center: geo(40.8, 111.7, 1050.0),
            range_half_extent_m: 6000.0,
            angle_half_extent_deg: 10.0,
        },
        minimum_detectable_m_per_s: Some(1.5),
        detection_probability: Some(0.8),
        is_simulated: true,
        reports,
    }
}

fn own(dwell: &Dwell) -> (LocalFrame, OwnedLook) {
    let frame = LocalFrame::of_dwell(dwell).unwrap();
    let look = own_look(dwell, &frame, &WideConfig::default(), NAME).unwrap();
    (frame, look)
}

#[test]
fn places_come_back_to_a_millimetre() {
    let frame = LocalFrame::new(&geo(40.8, 111.7, 1050.0)).unwrap();
    for (lat_deg, lon_deg, height_m) in
        [(40.8, 111.7, 1050.0), (41.2, 112.3, 1900.0), (40.1, 110.9, -30.0), (42.0, 113.0, 10.0)]
    {
        let place = geo(lat_deg, lon_deg, height_m);
        let local_m = frame.local_m(&place).unwrap();
        let back = frame.place(&local_m.xy(), height_m).unwrap();
        assert!(apart_m(&place, &back) < MILLIMETRE, "{place:?} {back:?}");
    }
    assert!(frame.local_m(&geo(91.0, 0.0, 0.0)).is_err());
    assert!((frame.height_m() - 1050.0).abs() < 1e-9);
}

/// A step of the stated standard deviation over ground changes the true distance to the sensor by that
/// of the slant range, one across it by next to nothing.
#[test]
fn the_covariance_of_a_plot_is_that_of_slant_range_and_cross_range() {
    let dwell = dwell();
    let (frame, look) = own(&dwell);
    for (plot, report) in look.plots.iter().zip(&dwell.reports) {
        let eigen = plot.covariance_m2.symmetric_eigen();
        let (long, short) = (eigen.eigenvalues.imax(), eigen.eigenvalues.imin());
        let moved_by = |axis: usize| {
            let step_m = eigen.eigenvectors.column(axis) * eigen.eigenvalues[axis].sqrt();
            let to = frame.place(&(plot.position_m + step_m), 1050.0).unwrap();
            apart_m(&to, &dwell.sensor) - apart_m(&report.place, &dwell.sensor)
        };
        assert!((eigen.eigenvalues[long].sqrt() - 45.0).abs() < 1e-9);
        assert!((moved_by(short).abs() - 8.0).abs() < 0.05, "{}", moved_by(short));
        assert!(moved_by(long).abs() < 0.1, "{}", moved_by(long));
    }
}

/// The radial velocity of a target that drives on is the change of its true distance per second.
#[test]
fn the_direction_of_a_plot_gives_the_change_of_its_distance() {
    let dwell = dwell();
    let (frame, look) = own(&dwell);
    for plot in &look.plots {
        for velocity in [Vector2::new(15.0, 0.0), Vector2::new(-4.0, 11.0)] {
            let at = |time_s: f64| {
                let place = frame.place(&(plot.position_m + velocity * time_s), 1050.0).unwrap();
                apart_m(&place, &dwell.sensor)
            };
            let radial = plot.radial.unwrap();
            let expected = (at(0.5) - at(-0.5)) / 1.0;
            let got = radial.direction.dot(&velocity);
            // On the way 7 km from the origin the ground falls by a thousandth.
            assert!((got - expected).abs() < 6e-3, "{got} {expected}");
            assert!((radial.velocity_m_per_s - 6.0).abs() < 1e-12);
            assert_eq!(radial.wrap_m_per_s, Some(50.0));
        }
    }
}

#[test]
fn the_sensor_is_over_the_plane_of_the_targets_and_flies_by_its_compass() {
    let dwell = dwell();
    let (frame, look) = own(&dwell);
    let on = EnuFrame::new(position(&dwell.sensor));
    let (sin, cos) = 70.0_f64.to_radians().sin_cos();
    let there = on.to_geo(&Vector3::new(1200.0 * sin, 1200.0 * cos, 0.0).into()).unwrap();
    let after = geo(there.lat_deg(), there.lon_deg(), there.height_m());
    let moved_m = frame.local_m(&after).unwrap() - frame.local_m(&dwell.sensor).unwrap();
    assert!((moved_m / 10.0 - look.platform.unwrap().velocity_m_per_s).norm() < 1e-4);
    // True distances to the plots, from the place over the plane: a centimetre where it touches.
    let line_m = look.plots[0].position_m.push(0.0) - look.platform.unwrap().position_m;
    let true_m = apart_m(&dwell.sensor, &dwell.reports[0].place);
    assert!((line_m.norm() - true_m).abs() < 0.01, "{line_m} {true_m}");
    let unknown = Dwell { flight: None, ..dwell };
    let velocity = own(&unknown).1.platform.unwrap().velocity_m_per_s;
    assert!(velocity.norm() < 1e-12);
}

/// Inside by the azimuth and the distance over ground that the sensor itself measures.
#[test]
fn the_sector_is_what_the_dwell_says_it_saw() {
    let dwell = dwell();
    let (frame, look) = own(&dwell);
    let Area::Sector { origin_m, direction_rad, half_width_rad, min_range_m, max_range_m } =
        look.coverage.area
    else {
        panic!("no sector")
    };
    let here = EnuFrame::new(position(&dwell.sensor));
    let center = here.look_at(&position(&dwell.area.center));
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut inside_count = 0;
    for _ in 0..2000 {
        let at_m = Vector2::new(rng.random_range(-12e3..12e3), rng.random_range(-12e3..12e3));
        let place = frame.place(&at_m, 1050.0).unwrap();
        let seen = here.look_at(&position(&place));
        let off_deg = (seen.azimuth_deg - center.azimuth_deg + 180.0).rem_euclid(360.0) - 180.0;
        let ground_m = |from: &proto::geodesy::Look| {
            from.slant_range_m * from.elevation_deg.to_radians().cos()
        };
        let far_m = ground_m(&seen) - ground_m(&center);
        if (off_deg.abs() - 10.0).abs() < 0.01 || (far_m.abs() - 6000.0).abs() < 5.0 {
            continue;
        }
        let line_m = at_m - origin_m;
        let turned_rad = line_m.y.atan2(line_m.x) - direction_rad;
        let is_inside = turned_rad.sin().atan2(turned_rad.cos()).abs() <= half_width_rad
            && (min_range_m..=max_range_m).contains(&line_m.norm());
        assert_eq!(is_inside, off_deg.abs() < 10.0 && far_m.abs() < 6000.0, "{at_m}");
        inside_count += usize::from(is_inside);
    }
    assert!(200 < inside_count, "{inside_count}");
}

#[test]
fn what_a_dwell_leaves_out_is_as_configured() {
    let mut dwell = dwell();
    (dwell.minimum_detectable_m_per_s, dwell.detection_probability) = (None, None);
    for report in &mut dwell.reports {
        (report.slant_sigma_m, report.cross_sigma_m) = (None, None);
        (report.radial_sigma_m_per_s, report.snr_db) = (None, None);
    }
    dwell.reports[1].radial_m_per_s = None;
    let config = WideConfig {
        minimum_detectable_m_per_s: Some(2.0),
        clutter_per_km2: 0.25,
        radial_convention: RadialConvention::Towards,
        ..WideConfig::default()
    };
    let frame = LocalFrame::of_dwell(&dwell).unwrap();
    let look = own_look(&dwell, &frame, &config, NAME).unwrap();
    assert_eq!(look.coverage.minimum_detectable_m_per_s, Some(2.0));
    assert!((look.coverage.detection_probability - 0.9).abs() < 1e-12);
    assert!((look.clutter_per_m2 - 0.25e-6).abs() < 1e-18);
    assert!(look.plots[1].radial.is_none() && look.plots[0].strength_db.is_none());
    let radial = look.plots[0].radial.unwrap();
    assert!((radial.velocity_m_per_s + 6.0).abs() < 1e-12, "towards is negative away");
    assert!((radial.sigma_m_per_s - 2.0).abs() < 1e-12);
    let ground_m = (look.plots[0].position_m - look.platform.unwrap().position_m.xy()).norm();
    let widest_m = look.plots[0].covariance_m2.symmetric_eigenvalues().max().sqrt();
    assert!((widest_m - 1e-3 * ground_m).abs() < 1e-6);
    assert_eq!(look.look().plots.len(), 3);
    assert_eq!(look.look().look_index, 0);
}

#[test]
fn reports_from_right_under_the_sensor_are_left_out_and_wrong_places_refused() {
    let mut dwell = dwell();
    dwell.reports[1].place = GeoRecord { height_m: 1050.0, ..dwell.sensor };
    let indices: Vec<u32> = own(&dwell).1.plots.iter().map(|plot| plot.report_index).collect();
    assert_eq!(indices, [0, 2]);
    let frame = LocalFrame::of_dwell(&dwell).unwrap();
    dwell.reports[0].place.lat_deg = 100.0;
    let refused = own_look(&dwell, &frame, &WideConfig::default(), NAME).unwrap_err();
    assert!(matches!(refused, GeodesyError::Latitude { .. }), "{refused}");
}

/// Beams of 2 degrees: the one abeam to the left of the flight is number 45 from straight ahead.
#[test]
fn beams_are_counted_by_their_width_from_the_direction_of_flight() {
    let mut dwell = dwell();
    let here = EnuFrame::new(position(&dwell.sensor));
    let beam = |azimuth_deg: f64, turned: &mut Dwell| {
        let (sin, cos) = azimuth_deg.to_radians().sin_cos();
        let place = here.to_geo(&Vector3::new(2e4 * sin, 2e4 * cos, -6e3).into()).unwrap();
        turned.area.center = geo(place.lat_deg(), place.lon_deg(), place.height_m());
        turned.area.angle_half_extent_deg = 1.0;
        own(turned).1.platform.unwrap().beam_index
    };
    assert_eq!(beam(70.0 - 91.0, &mut dwell), Some(45));
    assert_eq!(beam(70.0 - 93.0, &mut dwell), Some(46));
    assert_eq!(beam(70.0 + 1.0, &mut dwell), Some(179));
    dwell.area.angle_half_extent_deg = 20.0;
    assert_eq!(own(&dwell).1.platform.unwrap().beam_index, None, "too wide to be one of many");
    dwell.flight = None;
    assert_eq!(beam(10.0, &mut dwell), None);
}

/// Course, speed and covariance as the place's own compass has them: by two places a second apart, and
/// by a vector in place of the covariance.
#[test]
fn tracks_are_placed_with_the_north_of_where_they_are() {
    let frame = LocalFrame::new(&geo(40.8, 111.7, 1050.0)).unwrap();
    let state = Vector4::new(60e3, 25e3, -9.0, 12.0);
    let spread = Vector4::new(30.0, -10.0, 1.0, 2.0);
    let placed = frame.placed(&state, &(spread * spread.transpose()), 1100.0).unwrap();
    let own_enu = EnuFrame::new(position(&placed.place));
    let at = |offset: Vector2<f64>| {
        let at_m = state.fixed_rows::<2>(0) + offset;
        let point = own_enu.to_enu(&position(&frame.place(&at_m, 1100.0).unwrap()));
        Vector2::new(point.east_m, point.north_m)
    };
    let moved_m = at(state.fixed_rows::<2>(2).into_owned());
    assert!((placed.velocity_m_per_s - moved_m).norm() < 2e-3, "{moved_m}");
    assert!((placed.speed_m_per_s - moved_m.norm()).abs() < 2e-3);
    let course_deg = moved_m.x.atan2(moved_m.y).to_degrees().rem_euclid(360.0);
    assert!((placed.course_deg - course_deg).abs() < 0.01, "{course_deg}");
    let place = at(spread.fixed_rows::<2>(0).into_owned());
    let speed = at(spread.fixed_rows::<2>(2).into_owned());
    let expected = Vector4::new(place.x, place.y, speed.x, speed.y);
    let error = placed.covariance - expected * expected.transpose();
    assert!(error.norm() < 0.2, "{error}");
    // 60 km east north has turned by 0.46 degrees.
    let plain_deg = (-9.0_f64).atan2(12.0).to_degrees().rem_euclid(360.0);
    assert!((0.3..0.6).contains(&(placed.course_deg - plain_deg).abs()));
    let nowhere = Vector4::new(1e8, 0.0, 0.0, 0.0);
    assert!(frame.placed(&nowhere, &Matrix4::zeros(), 0.0).is_err());
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Real,
    Chance,
}

/// Targets 700 m apart on average that drive anywhere, looked at every `gap_s`; or plots of nothing.
fn driving(gap_s: f64, sign: f64, (kind, seed): (Kind, u64)) -> Vec<OwnedLook> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (_, plain) = own(&dwell());
    let mut place = || Vector2::new(rng.random_range(-2e3..2e3), rng.random_range(-2e3..2e3));
    let starts: Vec<(Vector2<f64>, Vector2<f64>)> =
        (0..30).map(|_| (place(), place() / 120.0)).collect();
    let mut looks = Vec::new();
    for index in 0..8_u32 {
        let time_s = f64::from(index) * gap_s;
        let mut look = plain.clone();
        (look.time_s, look.name.look_index) = (time_s, index.into());
        let template = plain.plots[0].clone();
        look.plots = starts
            .iter()
            .map(|(start_m, velocity)| {
                let mut error = || -> f64 { StandardNormal.sample(&mut rng) };
                let true_m = start_m + velocity * time_s;
                let chance_m = Vector2::new(error(), error()) * 1500.0;
                let radial = template.radial.unwrap();
                let measured = sign * radial.direction.dot(velocity) + 0.7 * error();
                Plot {
                    position_m: if kind == Kind::Real { true_m } else { chance_m },
                    radial: Some(crate::tracking::Radial {
                        velocity_m_per_s: measured,
                        wrap_m_per_s: None,
                        ..radial
                    }),
                    ..template.clone()
                }
            })
            .collect();
        looks.push(look);
    }
    looks
}

/// What a watch says of these looks, and after how many.
fn watched(looks: &[OwnedLook]) -> (DopplerSign, Option<(usize, Verdict)>) {
    let mut watch = SignWatch::default();
    let said: Vec<(usize, Verdict)> = looks
        .iter()
        .enumerate()
        .filter_map(|(index, look)| Some((index, watch.take(look.time_s, &look.plots)?)))
        .collect();
    assert!(said.len() <= 1, "a verdict is said once: {said:?}");
    (watch.sign(), said.first().copied())
}

#[test]
fn targets_vote_for_the_sign_with_which_they_go() {
    for gap_s in [10.0, 30.0] {
        let (_, right) = watched(&driving(gap_s, 1.0, (Kind::Real, 8)));
        assert_eq!(right.map(|(_, verdict)| verdict), Some(Verdict::AsStated));
        let (_, wrong) = watched(&driving(gap_s, -1.0, (Kind::Real, 8)));
        assert_eq!(wrong.map(|(_, verdict)| verdict), Some(Verdict::Reversed));
    }
    assert_eq!(watched(&driving(50.0, 1.0, (Kind::Real, 8))), (DopplerSign::default(), None));
    assert_eq!(watched(&[]), (DopplerSign::default(), None));
}

/// By the threshold alone one run in 16,000 would be decided; that all sums of a run count makes it some
/// in a thousand.
#[test]
fn chance_decides_nothing() {
    let mut vote_count = 0;
    for seed in 0..300 {
        let (sign, verdict) = watched(&driving(10.0, 1.0, (Kind::Chance, seed)));
        assert_eq!(verdict, None, "{seed}: {sign:?}");
        vote_count += sign.as_stated_count + sign.reversed_count;
    }
    assert!(300 * 50 < vote_count, "{vote_count} votes");
}

#[test]
fn velocities_known_up_to_too_little_have_no_vote() {
    let mut looks = driving(10.0, 1.0, (Kind::Real, 8));
    let plots = looks.iter_mut().flat_map(|look| &mut look.plots);
    plots.filter_map(|plot| plot.radial.as_mut()).for_each(|r| r.wrap_m_per_s = Some(79.0));
    assert_eq!(watched(&looks), (DopplerSign::default(), None));
}

#[test]
fn settings_that_make_no_sense_are_named() {
    WideConfig::default().check().unwrap();
    let of = |change: &dyn Fn(&mut WideConfig)| {
        let mut config = WideConfig::default();
        change(&mut config);
        config.check().unwrap_err()
    };
    assert_eq!(of(&|c| c.slant_sigma_m = 0.0).field, "slant_sigma_m");
    assert_eq!(of(&|c| c.cross_sigma_rad = 2.0).field, "cross_sigma_rad");
    assert_eq!(of(&|c| c.radial_sigma_m_per_s = f64::NAN).field, "radial_sigma_m_per_s");
    assert_eq!(of(&|c| c.detection_probability = 1.0).field, "detection_probability");
    let least = of(&|c| c.minimum_detectable_m_per_s = Some(-1.0));
    assert_eq!(least.field, "minimum_detectable_m_per_s");
    assert!(of(&|c| c.clutter_per_km2 = 0.0).to_string().contains("clutter_per_km2 is 0: use"));
    let read: WideConfig = toml::from_str("radial_convention = 'towards'").unwrap();
    assert_eq!(read.radial_convention, RadialConvention::Towards);
    assert!(toml::from_str::<WideConfig>("x = 1").is_err());
}
