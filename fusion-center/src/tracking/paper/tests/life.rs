//! How tracks begin, go on and end.

use nalgebra::{Matrix2, Vector2, Vector3};

use super::scene::{Lie, look as look_at, scans};
use crate::tracking::paper::{AcrossGate, Mode, PaperConfig, PaperTracker, Sharing, Start};
use crate::tracking::{
    Area, Coverage, Look, LookError, Platform, Plot, Radial, Settled, Status, Track, Tracker,
};

const MODES: [Mode; 3] = [Mode::Paper, Mode::Nearest, Mode::Belief];
const LOOK_S: f64 = 4.0;

fn sensor(look_index: u64) -> Platform {
    Platform {
        position_m: Vector3::new(100.0 * LOOK_S * look_index as f64, 0.0, 6000.0),
        velocity_m_per_s: Vector3::new(100.0, 0.0, 0.0),
        beam_index: None,
    }
}

fn plot(report_index: u32, x_m: f64, y_m: f64) -> Plot {
    Plot {
        position_m: Vector2::new(x_m, y_m),
        covariance_m2: Matrix2::identity() * 100.0,
        radial: None,
        strength_db: None,
        report_index,
    }
}

fn look(look_index: u64, plots: &[Plot]) -> Look<'_> {
    Look {
        time_s: LOOK_S * look_index as f64,
        sensor_index: 3,
        look_index,
        platform: Some(sensor(look_index)),
        coverage: Coverage {
            area: Area::Everywhere,
            detection_probability: 0.9,
            minimum_detectable_m_per_s: None,
        },
        clutter_per_m2: 1e-8,
        plots,
    }
}

fn tracker(config: &PaperConfig) -> PaperTracker {
    PaperTracker::new(Mode::Paper, config).unwrap()
}

fn ids(tracker: &PaperTracker) -> Vec<u64> {
    tracker.tracks().iter().map(|track| track.id).collect()
}

fn only(tracker: &PaperTracker) -> &Track {
    assert_eq!(tracker.tracks().len(), 1, "{:?}", tracker.tracks());
    &tracker.tracks()[0]
}

fn finished(mut tracker: PaperTracker) -> Vec<Settled> {
    let mut settled = Vec::new();
    tracker.finish();
    tracker.take_settled(&mut settled);
    settled
}

#[test]
fn a_track_is_confirmed_by_m_of_n_and_ends_unseen() {
    for mode in MODES {
        let mut tracker = PaperTracker::new(mode, &PaperConfig::default()).unwrap();
        let seen = [plot(7, 0.0, 15_000.0)];
        let mut said = Vec::new();
        for (index, is_seen) in
            [true, false, true, true, false, false, true].iter().zip(0..).map(|(s, i)| (i, *s))
        {
            tracker.look(&look(index, if is_seen { &seen } else { &[] })).unwrap();
            said.push(only(&tracker).status);
        }
        let (tentative, coasting) = (Status::Tentative, Status::Coasting);
        let confirmed = Status::Confirmed;
        let want = [tentative, tentative, tentative, confirmed, coasting, coasting, confirmed];
        assert_eq!(said, want, "{mode:?}");
        for index in 7..9 {
            tracker.look(&look(index, &[])).unwrap();
            assert_eq!(only(&tracker).status, Status::Coasting);
        }
        tracker.look(&look(9, &[])).unwrap();
        assert!(tracker.tracks().is_empty(), "three looks unseen end it");
        let mut settled = Vec::new();
        tracker.take_settled(&mut settled);
        assert_eq!(settled.len(), 10);
        let reports: Vec<bool> = settled.iter().map(|step| step.report.is_some()).collect();
        let was_seen = [true, false, true, true, false, false, true, false, false, false];
        assert_eq!(reports, was_seen);
        assert!(
            settled
                .iter()
                .all(|step| step.report.is_none_or(|r| r.report_index == 7 && r.sensor_index == 3))
        );
    }
}

#[test]
fn what_cannot_be_confirmed_any_more_ends_and_its_id_with_it() {
    let mut tracker = tracker(&PaperConfig { end_count: 50, ..PaperConfig::default() });
    tracker.look(&look(0, &[plot(0, 0.0, 15_000.0)])).unwrap();
    for (index, count) in [(1, 1), (2, 1), (3, 0)] {
        tracker.look(&look(index, &[])).unwrap();
        assert_eq!(
            tracker.tracks().len(),
            count,
            "3 of 5 are possible after two misses, not three"
        );
    }
    tracker.look(&look(4, &[plot(0, 0.0, 15_000.0)])).unwrap();
    assert_eq!(ids(&tracker), [1]);
}

#[test]
fn a_track_outside_of_what_was_looked_at_is_not_missed() {
    let mut tracker = tracker(&PaperConfig::default());
    tracker.look(&look(0, &[plot(0, 0.0, 15_000.0)])).unwrap();
    let aside = Area::Sector {
        origin_m: Vector2::zeros(),
        direction_rad: 0.3,
        half_width_rad: 0.2,
        min_range_m: 0.0,
        max_range_m: 30_000.0,
    };
    for index in 1..20 {
        let mut look = look(index, &[]);
        look.coverage.area = aside;
        tracker.look(&look).unwrap();
    }
    let mut blind = look(19, &[]);
    blind.coverage.detection_probability = 0.0;
    tracker.look(&blind).unwrap();
    assert_eq!(only(&tracker).status, Status::Tentative);
    assert!((only(&tracker).time_s - 0.0).abs() < 1e-12, "nothing was heard of it since");
    // Towards the place where it is expected: standing, seen from where the sensor is now.
    let toward = Area::Sector {
        origin_m: Vector2::zeros(),
        direction_rad: std::f64::consts::FRAC_PI_2,
        half_width_rad: 0.2,
        min_range_m: 0.0,
        max_range_m: 30_000.0,
    };
    let mut last = look(20, &[]);
    last.coverage.area = toward;
    tracker.look(&last).unwrap();
    assert!((only(&tracker).time_s - 80.0).abs() < 1e-12);
}

#[test]
fn time_counts_from_the_look_at_that_target() {
    // Two targets that go away at 30 m/s along the line of sight; the second is seen one look later
    // and has moved twice as far when it is seen again. A common T would put both out of the gate.
    let config = PaperConfig {
        max_speed_m_per_s: 1.0,
        gate_sigma_count: 3.0,
        confirm_count: 1,
        ..PaperConfig::default()
    };
    let mut tracker = tracker(&config);
    let moving = |index: u32, look_index: u64, look_s: f64| {
        let slant = Vector3::new(0.0, 15_000.0, -6000.0);
        let direction = slant.xy().normalize();
        let radial = 30.0 * direction.dot(&slant.xy()) / slant.norm();
        let x_m = 100.0 * LOOK_S * look_index as f64 + 2000.0 * f64::from(index);
        Plot {
            radial: Some(Radial {
                velocity_m_per_s: radial,
                sigma_m_per_s: 1.0,
                direction: direction * (direction.dot(&slant.xy()) / slant.norm()),
                wrap_m_per_s: None,
            }),
            ..plot(index, x_m, 15_000.0 + 30.0 * look_s)
        }
    };
    tracker.look(&look(0, &[moving(0, 0, 0.0), moving(1, 0, 0.0)])).unwrap();
    tracker.look(&look(1, &[moving(0, 0, 4.0)])).unwrap();
    tracker.look(&look(2, &[moving(0, 0, 8.0), moving(1, 0, 8.0)])).unwrap();
    assert_eq!(ids(&tracker), [0, 1]);
    let counts: Vec<u32> = tracker.tracks().iter().map(|track| track.plot_count).collect();
    assert_eq!(counts, [3, 2]);
}

#[test]
fn gates_keep_what_is_too_far_apart() {
    let start = plot(0, 0.0, 15_000.0);
    let next = |x_m: f64, y_m: f64, config: &PaperConfig, beams: Option<[u32; 2]>| {
        let mut tracker = tracker(config);
        let [first, second] = beams.map_or([None; 2], |beams| beams.map(Some));
        for (index, plot, beam_index) in [(0, &start, first), (1, &plot(1, x_m, y_m), second)] {
            let mut look = look(index, std::slice::from_ref(plot));
            look.platform = Some(Platform { beam_index, ..sensor(index) });
            tracker.look(&look).unwrap();
        }
        tracker.tracks()[0].plot_count == 2
    };
    let config = PaperConfig::default();
    // 40 m/s · 4 s + 3 errors of 10 m, of which the slant range sees 0.93.
    assert!(next(0.0, 15_180.0, &config, None));
    assert!(!next(0.0, 15_230.0, &config, None));
    assert!(next(180.0, 15_000.0, &config, None));
    assert!(!next(250.0, 15_000.0, &config, None));
    let beams_only = PaperConfig { across: AcrossGate::Beams, ..config };
    assert!(next(250.0, 15_000.0, &beams_only, None));
    assert!(next(0.0, 15_000.0, &config, Some([4, 7])));
    assert!(next(0.0, 15_000.0, &config, Some([4, 1])));
    assert!(!next(0.0, 15_000.0, &config, Some([4, 8])));
    // The mirror image on the other side of the flight has the same range and cone angle.
    assert!(!next(0.0, -15_000.0, &beams_only, None));
}

#[test]
fn tracks_of_the_same_plot_become_one_or_all_go_on() {
    let both = [plot(0, 0.0, 15_000.0), plot(1, 40.0, 15_000.0)];
    let one = [plot(2, 10.0, 15_000.0)];
    let after = |mode, sharing| {
        let config = PaperConfig { sharing, ..PaperConfig::default() };
        let mut tracker = PaperTracker::new(mode, &config).unwrap();
        tracker.look(&look(0, &both)).unwrap();
        tracker.look(&look(1, &one)).unwrap();
        let takers = finished(tracker.clone());
        let takers =
            takers.iter().filter(|s| s.report.is_some_and(|r| r.report_index == 2)).count();
        (ids(&tracker), takers)
    };
    for mode in [Mode::Nearest, Mode::Belief] {
        assert_eq!(after(mode, Sharing::OldestGoesOn), (vec![0], 2), "{mode:?}");
        assert_eq!(after(mode, Sharing::AllGoOn), (vec![0, 1], 2), "{mode:?}");
    }
    assert_eq!(after(Mode::Paper, Sharing::OldestGoesOn), (vec![0, 1], 1));
}

#[test]
fn tracks_begin_with_every_free_plot_or_in_the_first_look_only() {
    for (start, want) in [(Start::EveryLook, vec![0, 1]), (Start::FirstLook, vec![0])] {
        let mut tracker = tracker(&PaperConfig { start, ..PaperConfig::default() });
        tracker.look(&look(0, &[plot(0, 0.0, 15_000.0)])).unwrap();
        tracker.look(&look(1, &[plot(0, 0.0, 15_000.0), plot(1, 5000.0, 15_000.0)])).unwrap();
        assert_eq!(ids(&tracker), want);
    }
    let mut few = tracker(&PaperConfig { max_track_count: 1, ..PaperConfig::default() });
    few.look(&look(0, &[plot(0, 0.0, 15_000.0), plot(1, 5000.0, 15_000.0)])).unwrap();
    assert_eq!(ids(&few), [0]);
}

#[test]
fn the_order_of_plots_does_not_matter() {
    for mode in MODES {
        let mut trackers =
            [(); 2].map(|()| PaperTracker::new(mode, &PaperConfig::default()).unwrap());
        for (index, (time_s, mut plots)) in (0..).zip(scans(Lie::Along, 400.0, 5)) {
            trackers[0].look(&look_at(index, time_s, &plots)).unwrap();
            // Tracks begin in the order of plots: the first look stays as it is.
            if 0 < index {
                plots.rotate_left(1);
            }
            trackers[1].look(&look_at(index, time_s, &plots)).unwrap();
        }
        let [one, other] = trackers.map(finished);
        let chain = |steps: &[Settled], id: u64| -> Vec<_> {
            steps.iter().filter(|step| step.track == id).map(|step| step.report).collect()
        };
        for id in 0..4 {
            assert_eq!(chain(&one, id), chain(&other, id), "{mode:?}");
        }
    }
}

#[test]
fn a_long_track_is_settled_piece_by_piece_and_once() {
    let mut tracker = tracker(&PaperConfig { lag_count: 5, ..PaperConfig::default() });
    let mut settled = Vec::new();
    for (index, count) in (0..1000).zip(1..) {
        tracker.look(&look(index, &[plot(0, 0.0, 15_000.0)])).unwrap();
        tracker.take_settled(&mut settled);
        let open: usize = count - settled.len();
        assert!(open < 10, "{open} steps wait");
    }
    tracker.finish();
    tracker.take_settled(&mut settled);
    let times: Vec<f64> = settled.iter().map(|step| step.time_s).collect();
    let want: Vec<f64> = (0..1000).map(|index| 4.0 * f64::from(index)).collect();
    assert_eq!(times, want);
    let less = |step: &&Settled| step.smoothed_covariance[(0, 0)] < step.covariance[(0, 0)];
    assert!(settled[..995].iter().filter(less).count() == 995, "the future tells something");
}

#[test]
fn what_nobody_takes_is_forgotten() {
    let config = PaperConfig { lag_count: 1, ..PaperConfig::default() };
    let mut tracker = tracker(&config);
    let plots: Vec<Plot> =
        (0..500).map(|index| plot(index, 0.0, 12_000.0 + 1000.0 * f64::from(index))).collect();
    for index in 0..400 {
        tracker.look(&look(index, &plots)).unwrap();
    }
    let mut settled = Vec::new();
    tracker.take_settled(&mut settled);
    assert!(settled.len() <= (1 << 17) + 500, "{}", settled.len());
    assert!(settled.iter().all(|step| 100.0 < step.time_s), "the oldest are forgotten");
}

#[test]
fn looks_that_make_no_sense_are_refused_and_change_nothing() {
    let mut tracker = tracker(&PaperConfig::default());
    let plots = [plot(0, 0.0, 15_000.0)];
    tracker.look(&look(5, &plots)).unwrap();
    let before = tracker.tracks().to_vec();
    let indoors = Look { platform: None, ..look(6, &plots) };
    let refused = tracker.look(&indoors);
    assert_eq!(refused, Err(LookError::NoPlatform { sensor_index: 3, look_index: 6 }));
    let late = tracker.look(&look(4, &plots));
    let (time_s, previous_s) = (16.0, 20.0);
    assert_eq!(
        late,
        Err(LookError::TooLate { sensor_index: 3, look_index: 4, time_s, previous_s })
    );
    let nowhere = [plot(0, f64::NAN, 0.0)];
    assert!(matches!(tracker.look(&look(6, &nowhere)), Err(LookError::Unusable { .. })));
    assert_eq!(tracker.tracks(), before);
    tracker.look(&look(5, &plots)).unwrap();
    assert_eq!(only(&tracker).plot_count, 2, "looks may have the same time");
}

#[test]
fn settings_that_make_no_sense_are_named() {
    let config = PaperConfig { window_count: 65, ..PaperConfig::default() };
    let complaint = PaperTracker::new(Mode::Paper, &config).map(|_| ()).unwrap_err();
    assert_eq!(complaint.to_string(), "window_count is 65: use 1 to 64 looks");
    let strict = PaperConfig { confirm_count: 6, ..PaperConfig::default() };
    assert_eq!(strict.check().unwrap_err().field, "confirm_count");
    let mut sure = PaperConfig::default();
    sure.belief.trust.angle = 1.0;
    assert_eq!(sure.check().unwrap_err().field, "belief.trust.angle");
    sure.belief.trust.angle = f64::NAN;
    assert!(sure.check().is_err());
    for shipped in
        [PaperConfig::default(), PaperConfig::published_tracks(), PaperConfig::published_links()]
    {
        assert_eq!(shipped.check(), Ok(()));
    }
}

#[test]
fn odds_rise_with_plots_and_fall_with_misses() {
    let mut tracker = tracker(&PaperConfig::default());
    let seen = [plot(0, 0.0, 15_000.0)];
    tracker.look(&look(0, &seen)).unwrap();
    assert!(only(&tracker).log_odds.abs() < 1e-12);
    tracker.look(&look(1, &seen)).unwrap();
    // Variances of the innovation: 2 · 100 m² of both plots, (4 s · 40 m/s)² of the velocity and
    // 1 m²/s³ · (4 s)³ / 3 of the push; the plot is where it is expected.
    let variance_m2 = 200.0 + 160.0_f64.powi(2) + 64.0 / 3.0;
    let risen = 0.9_f64.ln() - (std::f64::consts::TAU * variance_m2).ln() - 1e-8_f64.ln();
    assert!((only(&tracker).log_odds - risen).abs() < 1e-9);
    tracker.look(&look(2, &[])).unwrap();
    assert!((only(&tracker).log_odds - risen - 0.1_f64.ln()).abs() < 1e-9);
}
