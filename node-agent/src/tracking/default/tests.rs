//! The default tracker on little scenes of its own: who is followed, for how long, and as whom.

use nalgebra::Vector2;
use proto::radar::Grid;
use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};
use rand_distr::StandardNormal;

use super::*;
use crate::tracking::TrackStatus;

const FRAME_S: f64 = 0.1;
const GRID: Grid =
    Grid { x_min_m: -4.0, y_min_m: 0.5, pixel_m: 0.1, column_count: 81, row_count: 96 };
/// Standard deviation of points, metres.
const SIGMA_M: f64 = 0.05;

/// Points without wander.
const NOISE_ALONE: BodyModel = BodyModel { half_depth_m: HALF_DEPTH_M, glint_m: [0.0; 2] };

/// Frames of points alone, in the dark.
struct Play {
    tracker: DefaultTracker,
    time_s: f64,
    image: Vec<f32>,
    rng: ChaCha8Rng,
}

impl Play {
    fn new(config: &DefaultConfig) -> Self {
        // These bodies are round.
        let round = DefaultConfig { aspect_share: 0.0, ..config.clone() };
        let tracker = DefaultTracker::new(&round, NOISE_ALONE).unwrap();
        let image = vec![0.0; GRID.pixel_count()];
        Self { tracker, time_s: 0.0, image, rng: ChaCha8Rng::seed_from_u64(4) }
    }

    /// One frame with noisy points of people at `places_m`.
    fn show(&mut self, places_m: &[Vector2<f64>]) -> Vec<Track> {
        let mut noise = || self.rng.sample::<f64, _>(StandardNormal) * SIGMA_M;
        let points: Vec<MeasuredPoint> =
            places_m.iter().map(|m| point(m + Vector2::new(noise(), noise()))).collect();
        self.time_s += FRAME_S;
        let frame = Frame {
            time_s: self.time_s,
            grid: GRID,
            amplitude: &self.image,
            noise_amplitude: 0.01,
            points: &points,
        };
        self.tracker.track(&frame).unwrap().to_vec()
    }

    /// `count` frames alike.
    fn hold(&mut self, places_m: &[Vector2<f64>], count: usize) -> Vec<Track> {
        (0..count).map(|_| self.show(places_m)).last().unwrap()
    }
}

/// The near side of somebody whose middle is at `middle_m`.
fn point(middle_m: Vector2<f64>) -> MeasuredPoint {
    let surface_m = middle_m - middle_m.normalize() * HALF_DEPTH_M;
    MeasuredPoint {
        x_m: surface_m.x,
        y_m: surface_m.y,
        cov_m2: [SIGMA_M * SIGMA_M, 0.0, SIGMA_M * SIGMA_M],
        snr_db: 20.0,
        extent_m2: [0.02, 0.0, 0.01],
        radial_velocity_m_per_s: None,
    }
}

fn place_m(track: &Track) -> Vector2<f64> {
    Vector2::new(track.state[0], track.state[1])
}

fn at(x_m: f64, y_m: f64) -> Vector2<f64> {
    Vector2::new(x_m, y_m)
}

#[test]
fn one_who_walks_is_confirmed_by_three_points_and_followed() {
    let mut play = Play::new(&DefaultConfig::default());
    let mut error2 = 0.0;
    for step in 0..60 {
        let middle_m = at(0.5, 3.0 + 0.1 * f64::from(step));
        let tracks = play.show(&[middle_m]);
        assert_eq!(tracks.len(), 1);
        let want = if step < 2 { TrackStatus::Tentative } else { TrackStatus::Confirmed };
        assert_eq!((tracks[0].id, tracks[0].status), (1, want), "step {step}");
        if 20 <= step {
            error2 += (place_m(&tracks[0]) - middle_m).norm_squared();
        }
        if step == 59 {
            assert!((tracks[0].state[3] - 1.0).abs() < 0.15, "{}", tracks[0].state);
        }
    }
    // Points alone err by 0.07 m in two dimensions.
    assert!((error2 / 40.0).sqrt() < 0.05, "{}", (error2 / 40.0).sqrt());
}

#[test]
fn a_single_point_never_is_a_person() {
    let mut play = Play::new(&DefaultConfig::default());
    play.show(&[at(0.0, 4.0)]);
    let (mut before, mut newest) = (Vec::new(), 0);
    for round in 0..50 {
        let m = if round % 10 == 0 { vec![at(1.0 - 0.04 * f64::from(round), 6.0)] } else { vec![] };
        let tracks = play.show(&m);
        assert!(tracks.iter().all(|track| track.status == TrackStatus::Tentative));
        let ids: Vec<u64> = tracks.iter().map(|track| track.id).collect();
        // Nobody gets an id that another one had.
        assert!(ids.iter().all(|id| before.contains(id) || newest < *id), "{before:?} {ids:?}");
        newest = ids.iter().copied().fold(newest, u64::max);
        before = ids;
    }
    assert!(3 < newest);
}

#[test]
fn two_who_cross_keep_their_ids() {
    let mut play = Play::new(&DefaultConfig::default());
    let mut first = Vec::new();
    for step in 0..80 {
        let along_m = -2.0 + 0.05 * f64::from(step);
        let walkers = [at(along_m, 5.0 + 0.5 * along_m), at(-along_m, 5.0 + 0.5 * along_m)];
        // Where they meet, they are one point for a second.
        let apart_m = (walkers[0] - walkers[1]).norm();
        let middle = [(walkers[0] + walkers[1]) * 0.5];
        let tracks = play.show(if apart_m < 0.5 { &middle } else { &walkers });
        if step == 20 {
            first = tracks.iter().map(|track| track.id).collect();
        }
        if step == 20 || step == 79 {
            let owner = tracks.iter().position(|track| (place_m(track) - walkers[0]).norm() < 0.2);
            assert_eq!((tracks.len(), tracks[owner.unwrap()].id), (2, first[0]), "step {step}");
        }
    }
}

#[test]
fn who_stops_is_kept_and_who_walks_out_is_not() {
    let config = DefaultConfig::default();
    let mut play = Play::new(&config);
    for step in 0..20 {
        play.show(&[at(-1.0, 6.0 - 0.1 * f64::from(step))]);
    }
    play.hold(&[at(-1.0, 4.0)], 40);
    // He stops breathing, as it were: no point for 20 s.
    let kept = play.hold(&[], 200);
    assert_eq!((kept.len(), kept[0].status), (1, TrackStatus::Coasting));
    assert!((place_m(&kept[0]) - at(-1.0, 4.0)).norm() < 0.2, "{}", kept[0].state);
    let again = play.show(&[at(-0.9, 4.1)]);
    assert_eq!((again[0].id, again[0].status), (kept[0].id, TrackStatus::Confirmed));
    // The other walks out over the border.
    let mut gone = Play::new(&config);
    for step in 0..40 {
        gone.show(&[at(0.0 + 0.1 * f64::from(step), 5.0)]);
    }
    assert_eq!(gone.hold(&[], 5).len(), 1);
    assert!(gone.hold(&[], 12).is_empty());
}

#[test]
fn what_never_walked_is_not_held() {
    // The shadow of somebody who sat there when the radar was switched on, and left.
    let mut play = Play::new(&DefaultConfig::default());
    assert_eq!(play.hold(&[at(-1.0, 4.0)], 60)[0].status, TrackStatus::Confirmed);
    assert_eq!(play.hold(&[], 38).len(), 1);
    assert!(play.hold(&[], 4).is_empty());
}

#[test]
fn a_limb_beside_somebody_is_nobody() {
    let mut play = Play::new(&DefaultConfig::default());
    play.hold(&[at(0.0, 5.0)], 30);
    // Of an extent of 0.14 m by 0.10 m: inside four standard deviations at first, then outside.
    for _ in 0..20 {
        assert_eq!(play.show(&[at(0.0, 5.0), at(0.35, 5.3)]).len(), 1);
    }
    assert_eq!(play.hold(&[at(0.0, 5.0), at(1.2, 5.0)], 5).len(), 2);
}

#[test]
fn a_dark_point_moves_nobody_as_far_as_a_bright_one() {
    let off_m = |snr_db: f64| {
        let mut play = Play::new(&DefaultConfig::default());
        // All of a point's error is wander.
        let body = BodyModel { glint_m: [SIGMA_M; 2], ..NOISE_ALONE };
        play.tracker = DefaultTracker::new(&DefaultConfig::default(), body).unwrap();
        play.hold(&[at(0.0, 5.0)], 40);
        let aside = MeasuredPoint { snr_db, ..point(at(0.3, 5.0)) };
        let frame = Frame {
            time_s: play.time_s + FRAME_S,
            grid: GRID,
            amplitude: &play.image,
            noise_amplitude: 0.01,
            points: &[aside],
        };
        let tracks = play.tracker.track(&frame).unwrap();
        place_m(&tracks[0]).x
    };
    // A quarter of the power, four times the variance of the wander.
    assert!(off_m(14.0) < 0.6 * off_m(20.0), "{} {}", off_m(14.0), off_m(20.0));
}

#[test]
fn one_at_a_door_is_believed_sooner_and_forgotten_sooner() {
    let door = Door { x_m: 0.0, y_m: 5.0, radius_m: 0.8 };
    let config =
        DefaultConfig { doors: vec![door], confirm_point_count: 2, ..DefaultConfig::default() };
    let mut by_the_door = Play::new(&config);
    let mut inside = Play::new(&config);
    assert_eq!(by_the_door.hold(&[at(0.1, 5.1)], 2)[0].status, TrackStatus::Confirmed);
    assert_eq!(inside.hold(&[at(2.0, 5.1)], 2)[0].status, TrackStatus::Tentative);
    inside.hold(&[at(2.0, 5.1)], 10);
    by_the_door.hold(&[at(0.1, 5.1)], 10);
    assert!(by_the_door.hold(&[], 15).is_empty());
    assert_eq!(inside.hold(&[], 15).len(), 1);
}

#[test]
fn one_lost_on_a_turn_is_the_same_when_found() {
    let config = DefaultConfig { gate_sigmas: 3.0, ..DefaultConfig::default() };
    let mut play = Play::new(&config);
    for step in 0..40 {
        play.show(&[at(0.0, 3.0 + 0.1 * f64::from(step))]);
    }
    play.hold(&[], 10);
    for step in 0..10 {
        play.show(&[at(1.5 + 0.05 * f64::from(step), 6.5)]);
    }
    let tracks = play.show(&[at(2.0, 6.5)]);
    assert_eq!(tracks.iter().map(|track| track.id).collect::<Vec<_>>(), [1]);
    assert!((place_m(&tracks[0]) - at(2.0, 6.5)).norm() < 0.2);
}

#[test]
fn smoothed_states_are_a_second_old_and_better() {
    let mut play = Play::new(&DefaultConfig::default());
    let (mut raw, mut smooth) = (0.0, 0.0);
    let way = |time_s: f64| at(0.5 * (0.7 * time_s).sin(), 5.0 + 2.0 * (0.5 * time_s).sin());
    for step in 1..=150 {
        let tracks = play.show(&[way(FRAME_S * f64::from(step))]);
        if 30 < step {
            let told = play.tracker.smoothed()[0];
            assert!((play.time_s - told.time_s - 1.0).abs() < 1e-9 && told.id == 1);
            raw += (place_m(&tracks[0]) - way(play.time_s)).norm_squared();
            let smoothed_m = Vector2::new(told.state[0], told.state[1]);
            smooth += (smoothed_m - way(told.time_s)).norm_squared();
            assert!(told.covariance[(0, 0)] <= tracks[0].covariance[(0, 0)] * 1.1);
        }
    }
    assert!(smooth < 0.6 * raw, "{smooth} {raw}");
}

#[test]
fn gaps_and_uneven_times_are_borne() {
    let mut play = Play::new(&DefaultConfig::default());
    let mut way_m = 0.0;
    for step in 0..60 {
        play.time_s += if step % 3 == 0 { 0.25 } else { -0.05 };
        way_m = 0.5 * play.time_s;
        play.show(&[at(0.0, 3.0 + way_m + 0.05)]);
    }
    let tracks = play.show(&[at(0.0, 3.1 + way_m)]);
    assert_eq!(tracks.len(), 1);
    assert!((tracks[0].state[3] - 0.5).abs() < 0.2, "{}", tracks[0].state);
    play.time_s += 1e6;
    let later = play.show(&[]);
    assert!(later.is_empty());
}

#[test]
fn senseless_frames_are_refused_and_change_nothing() {
    let mut play = Play::new(&DefaultConfig::default());
    let before = play.hold(&[at(0.0, 4.0)], 5);
    let dark = vec![0.0; GRID.pixel_count()];
    let spoiled = vec![f32::NAN; GRID.pixel_count()];
    let mut bad = point(at(0.0, 4.0));
    bad.cov_m2 = [1.0, 2.0, 1.0];
    let (time_s, points) = (play.time_s + 1.0, std::slice::from_ref(&bad));
    let good = Frame { time_s, grid: GRID, amplitude: &dark, noise_amplitude: 0.1, points: &[] };
    let frames = [
        Frame { amplitude: &dark[1..], ..good },
        Frame { amplitude: &spoiled, ..good },
        Frame { noise_amplitude: -1.0, ..good },
        Frame { time_s: f64::NAN, ..good },
        Frame { time_s: play.time_s, ..good },
        Frame { points, ..good },
    ];
    let what: Vec<FrameError> =
        frames.iter().map(|frame| play.tracker.track(frame).unwrap_err()).collect();
    assert!(matches!(what[0], FrameError::PixelCount { .. }));
    assert!(matches!(what[4], FrameError::TimeNotAscending { .. }));
    assert_eq!(what[5], FrameError::NotFinite { time_s, what: "a point" });
    for index in [1, 2, 3] {
        assert!(matches!(what[index], FrameError::NotFinite { .. }), "{:?}", what[index]);
    }
    let after = play.show(&[at(0.0, 4.0)]);
    assert_eq!(after[0].id, before[0].id);
    assert!((after[0].seen_s - before[0].seen_s - FRAME_S).abs() < 1e-9);
}

#[test]
fn strange_images_give_nobody_and_no_nonsense() {
    let mut tracker = DefaultTracker::new(&DefaultConfig::default(), BodyModel::default()).unwrap();
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    for step in 1..200_u32 {
        let side = if step % 50 == 0 { 1 } else { 40 + step as usize % 3 };
        let grid = Grid { column_count: side, row_count: side, ..GRID };
        let mut image = vec![0.0; grid.pixel_count()];
        match step % 4 {
            0 => image[0] = f32::MAX,
            1 => image.fill(1e9),
            2 => image.iter_mut().for_each(|value| *value = rng.random()),
            _ => {}
        }
        let mut wild = point(at(rng.random_range(-3.0..3.0), rng.random_range(1.0..4.0)));
        wild.extent_m2 = [-1.0, 5.0, 1e12];
        wild.snr_db = if step % 7 == 0 { 3000.0 } else { -3000.0 };
        let points = [wild.clone(), wild];
        let frame = Frame {
            time_s: f64::from(step),
            grid,
            amplitude: &image,
            noise_amplitude: 0.0,
            points: if step % 5 == 0 { &points } else { &[] },
        };
        let tracks = tracker.track(&frame).unwrap();
        for track in tracks {
            assert_eq!(track.status, TrackStatus::Tentative);
            let numbers = track.state.iter().chain(track.covariance.iter());
            assert!(numbers.chain([&track.appearance]).all(|value| value.is_finite()));
        }
    }
}

#[test]
fn nothing_is_allocated_once_everybody_is_known() {
    let mut play = Play::new(&DefaultConfig::default());
    let people = [at(-2.0, 2.0), at(0.0, 3.0), at(2.0, 4.5), at(-1.0, 6.5), at(2.5, 8.0)];
    play.hold(&people, 30);
    let points: Vec<MeasuredPoint> = people.iter().map(|m| point(*m)).collect();
    let allocated = allocation_counter::measure(|| {
        for step in 1..100_u32 {
            let seen = &points[..if step % 3 == 0 { 2 } else { 5 }];
            let frame = Frame {
                time_s: play.time_s + FRAME_S * f64::from(step),
                grid: GRID,
                amplitude: &play.image,
                noise_amplitude: 0.01,
                points: seen,
            };
            assert_eq!(play.tracker.track(&frame).unwrap().len(), 5);
        }
    });
    assert_eq!(allocated.count_total, 0);
}
