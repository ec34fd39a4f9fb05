//! What the published tracker says of images that are known.

use nalgebra::Vector2;

use super::*;
use crate::tracking::TrackStatus;

/// Half a pixel, metres.
const HALF_PIXEL_M: f64 = 0.025;

fn grid() -> Grid {
    Grid { x_min_m: -3.0, y_min_m: 0.5, pixel_m: 0.05, column_count: 121, row_count: 131 }
}

/// Round hills of width 0.5 m and depth 0.3 m at places in metres.
fn hills(places_m: &[[f64; 2]]) -> Vec<f32> {
    let grid = grid();
    let value = |index: usize| {
        let pixel_m = [grid.x_m(index % grid.column_count), grid.y_m(index / grid.column_count)];
        let hill = |place_m: &[f64; 2]| {
            let (dx, dy) = ((pixel_m[0] - place_m[0]) / 0.25, (pixel_m[1] - place_m[1]) / 0.15);
            (-dx * dx - dy * dy).exp()
        };
        crate::imaging::single(places_m.iter().map(hill).sum())
    };
    (0..grid.pixel_count()).map(value).collect()
}

fn frame(number: u32, amplitude: &[f32]) -> Frame<'_> {
    let time_s = 0.1 * f64::from(number);
    Frame { time_s, grid: grid(), amplitude, noise_amplitude: 0.02, points: &[] }
}

fn tracker() -> PaperTracker {
    PaperTracker::new(&PaperConfig::default()).unwrap()
}

/// Somebody who walks away from the array at 1 m/s.
fn walker_m(number: u32) -> [f64; 2] {
    [0.3, 1.5 + 0.1 * f64::from(number)]
}

#[test]
fn a_walker_is_confirmed_after_more_than_12_updates_and_ends_after_10_without() {
    let mut tracker = tracker();
    for number in 0..20 {
        let amplitude = hills(&[walker_m(number)]);
        let tracks = tracker.track(&frame(number, &amplitude)).unwrap();
        assert_eq!(tracks.len(), 1, "frame {number}");
        let [x_m, y_m] = walker_m(number);
        let track = &tracks[0];
        assert!((track.state.x - x_m).abs() < HALF_PIXEL_M, "{}", track.state);
        assert!((track.state.y - y_m).abs() < HALF_PIXEL_M, "{}", track.state);
        // The first sight is no change of place: updates are one fewer than frames.
        let expected = if number <= 12 { TrackStatus::Tentative } else { TrackStatus::Confirmed };
        assert_eq!(track.status, expected, "frame {number}");
        assert_eq!(track.id, 1);
        if 3 < number {
            assert!((track.state.w - 1.0).abs() < 0.2, "{}", track.state);
            assert!(track.state.z.abs() < 0.2, "{}", track.state);
            assert!(0.9 < track.appearance && track.appearance <= 1.0);
        }
    }
    let empty = vec![0.0; grid().pixel_count()];
    let mut before_m2 = 0.0;
    for number in 20..29 {
        let tracks = tracker.track(&frame(number, &empty)).unwrap();
        assert_eq!(tracks[0].status, TrackStatus::Coasting, "frame {number}");
        assert!(before_m2 < tracks[0].covariance[(0, 0)], "not less sure at {number}");
        assert!((tracks[0].seen_s - 1.9).abs() < 1e-9);
        before_m2 = tracks[0].covariance[(0, 0)];
    }
    assert!(tracker.track(&frame(29, &empty)).unwrap().is_empty());
    let again = hills(&[walker_m(0)]);
    assert_eq!(tracker.track(&frame(30, &again)).unwrap()[0].id, 2);
}

#[test]
fn two_people_are_two_and_one_place_is_taken_once() {
    let mut tracker = tracker();
    let mut ids = Vec::new();
    for number in 0..60 {
        let apart_m = (2.4 - 0.1 * f64::from(number)).max(0.0);
        let amplitude =
            hills(&[[-0.5 * apart_m, 3.0], [0.5 * apart_m, 4.0 - 1.0 / 2.4 * (2.4 - apart_m)]]);
        let tracks = tracker.track(&frame(number, &amplitude)).unwrap();
        ids = tracks.iter().map(|track| track.id).collect();
        if number < 10 {
            assert_eq!(ids, [1, 2], "frame {number}");
        }
    }
    assert_eq!(ids.len(), usize::from(!ids.is_empty()), "{ids:?}");
}

#[test]
fn covariances_are_of_two_stated_errors() {
    let mut tracker = tracker();
    for number in 0..15 {
        let amplitude = hills(&[walker_m(number)]);
        let tracks = tracker.track(&frame(number, &amplitude)).unwrap();
        let covariance = tracks[0].covariance;
        assert!((covariance - covariance.transpose()).norm() < 1e-12);
        let least = covariance.symmetric_eigenvalues().min();
        assert!(0.0 < least, "frame {number}: {least}");
        if number < 11 {
            continue;
        }
        // Straight ahead range is y, nearly: differences over 1 s.
        let settings = PaperConfig::default();
        let range_m2 = settings.range_sigma_m.powi(2);
        let ratio = covariance[(1, 1)] / range_m2;
        assert!((1.0..1.3).contains(&ratio), "{ratio}");
        assert!((covariance[(1, 3)] / covariance[(1, 1)] - 1.0).abs() < 1e-6);
        assert!((covariance[(3, 3)] / covariance[(1, 1)] - 2.0).abs() < 1e-6);
    }
}

/// Statuses of all tracks over 40 frames of one and the same image.
fn statuses(amplitude: &[f32]) -> Vec<TrackStatus> {
    let mut tracker = tracker();
    let mut all = Vec::new();
    for number in 0..40 {
        let tracks = tracker.track(&frame(number, amplitude)).unwrap();
        assert!(tracks.iter().all(is_sound));
        all.extend(tracks.iter().map(|track| track.status));
    }
    all
}

fn is_sound(track: &Track) -> bool {
    let numbers = track.state.iter().chain(track.covariance.iter()).chain(&track.extent_m2);
    numbers.chain([&track.appearance, &track.seen_s]).all(|value| value.is_finite())
}

#[test]
fn nothing_and_what_does_not_move_are_nobody() {
    let count = grid().pixel_count();
    assert_eq!(statuses(&vec![0.0; count]), []);
    let tentative = |all: &[TrackStatus]| all.iter().all(|s| *s == TrackStatus::Tentative);
    let mut amplitude = vec![0.0; count];
    amplitude[60 * 121 + 40] = 1e30;
    let one_pixel = statuses(&amplitude);
    assert!(tentative(&one_pixel), "{one_pixel:?}");
    for row in 30..80 {
        amplitude[row * 121 + 20..row * 121 + 70].fill(f32::MAX);
    }
    let block = statuses(&amplitude);
    assert!(tentative(&block));
    assert!(tentative(&statuses(&vec![f32::MAX; count])));
    assert!(tentative(&statuses(&vec![f32::MIN_POSITIVE; count])));
    assert!(tentative(&statuses(&vec![f32::from_bits(1); count])));
}

#[test]
fn frames_of_nonsense_are_refused_and_change_nothing() {
    let mut tracker = tracker();
    let amplitude = hills(&[walker_m(0)]);
    tracker.track(&frame(0, &amplitude)).unwrap();
    let before = tracker.clone();
    let good = frame(1, &amplitude);
    let mut refused = |bad: Frame<'_>| tracker.track(&bad).unwrap_err();
    let what = |error: FrameError| match error {
        FrameError::NotFinite { what, .. } => what,
        other => panic!("{other}"),
    };
    for bad in [f32::NAN, f32::INFINITY, -0.1] {
        let mut damaged = amplitude.clone();
        damaged[7] = bad;
        assert_eq!(what(refused(Frame { amplitude: &damaged, ..good })), "a pixel");
        assert_eq!(what(refused(Frame { noise_amplitude: bad, ..good })), "the noise");
    }
    assert_eq!(what(refused(Frame { time_s: f64::NAN, ..good })), "the time");
    let late = FrameError::TimeNotAscending { time_s: 0.0, previous_s: 0.0 };
    assert_eq!(refused(frame(0, &amplitude)), late);
    let short = refused(Frame { amplitude: &amplitude[1..], ..good });
    let want = grid().pixel_count();
    assert_eq!(short, FrameError::PixelCount { time_s: 0.1, got: want - 1, want });
    let endless = Grid { column_count: usize::MAX, row_count: 3, ..grid() };
    assert!(matches!(refused(Frame { grid: endless, ..good }), FrameError::PixelCount { .. }));
    for pixel_m in [0.0, f64::NAN, -1.0] {
        assert_eq!(what(refused(Frame { grid: Grid { pixel_m, ..grid() }, ..good })), "the grid");
    }
    // It goes on as if nothing had happened.
    let next = tracker.track(&good).unwrap().to_vec();
    let mut untouched = before;
    assert_eq!(untouched.track(&good).unwrap(), next);
}

#[test]
fn another_grid_starts_anew_with_new_ids() {
    let mut tracker = tracker();
    let amplitude = hills(&[walker_m(0)]);
    assert_eq!(tracker.track(&frame(0, &amplitude)).unwrap()[0].id, 1);
    let moved = Grid { x_min_m: -2.0, ..grid() };
    let tracks = tracker.track(&Frame { grid: moved, ..frame(1, &amplitude) }).unwrap();
    assert_eq!(tracks.iter().map(|track| track.id).collect::<Vec<_>>(), [2]);
    for (number, (columns, rows)) in
        [(1, 1), (2, 1), (1, 5), (0, 0), (0, 4)].into_iter().enumerate()
    {
        let tiny = Grid { column_count: columns, row_count: rows, ..grid() };
        for (step, value) in [1.0, 0.0].into_iter().enumerate() {
            let time_s = 1.0 + number as f64 + 0.5 * step as f64;
            let pixels = vec![value; columns * rows];
            let frame = Frame { grid: tiny, time_s, ..frame(0, &pixels) };
            assert!(tracker.track(&frame).unwrap().iter().all(is_sound));
        }
    }
}

#[test]
fn a_storm_of_noise_stays_bounded_and_sound() {
    use rand::{RngExt, SeedableRng, rngs::ChaCha8Rng};
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let config = PaperConfig { max_track_count: 7, noise_factor: 0.0, ..PaperConfig::default() };
    let mut tracker = PaperTracker::new(&config).unwrap();
    let mut last_id = 0;
    for number in 0..60 {
        let amplitude: Vec<f32> = (0..grid().pixel_count()).map(|_| rng.random()).collect();
        let tracks = tracker.track(&frame(number, &amplitude)).unwrap();
        assert!(tracks.len() <= 7 && tracks.iter().all(is_sound));
        assert!(tracks.is_sorted_by(|a, b| a.id < b.id));
        last_id = tracks.last().map_or(last_id, |track| track.id.max(last_id));
    }
    assert!(0 < last_id);
}

#[test]
fn a_warm_tracker_takes_no_memory() {
    let mut tracker = tracker();
    let images: Vec<Vec<f32>> = (0..30)
        .map(|k| hills(&[walker_m(k), [-1.5, 3.0], [1.8, 2.0 + 0.05 * f64::from(k)]]))
        .collect();
    let mut play = |numbers: std::ops::Range<u32>| {
        for number in numbers {
            tracker.track(&frame(number, &images[(number % 30) as usize])).unwrap();
        }
    };
    play(0..5);
    let used = allocation_counter::measure(|| play(5..90));
    assert_eq!(used.count_total, 0, "{} bytes", used.bytes_total);
}

#[test]
fn settings_of_nonsense_are_named() {
    let field = |change: fn(&mut PaperConfig)| {
        let mut config = PaperConfig::default();
        change(&mut config);
        PaperTracker::new(&config).unwrap_err().field
    };
    assert_eq!(field(|c| c.noise_factor = -1.0), "paper.noise_factor");
    assert_eq!(field(|c| c.peak_fraction = 1.5), "paper.peak_fraction");
    assert_eq!(field(|c| c.disc_half_m[1] = f64::NAN), "paper.disc_half_m");
    assert_eq!(field(|c| c.line_share = 0.0), "paper.line_share");
    assert_eq!(field(|c| c.floor_factor = f64::INFINITY), "paper.floor_factor");
    assert_eq!(field(|c| c.bin_floor_factor = -1.0), "paper.bin_floor_factor");
    assert_eq!(field(|c| c.max_template_m[0] = 0.0), "paper.max_template_m");
    assert_eq!(field(|c| c.bandwidth = 0.0), "paper.bandwidth");
    assert_eq!(field(|c| c.epsilon_m = 0.0), "paper.epsilon_m");
    assert_eq!(field(|c| c.min_move_m = -0.1), "paper.min_move_m");
    assert_eq!(field(|c| c.range_sigma_m = 0.0), "paper.range_sigma_m");
    assert_eq!(field(|c| c.bearing_sigma_rad = 2.0), "paper.bearing_sigma_rad");
    assert_eq!(field(|c| c.speed_sigma_m_per_s = 0.0), "paper.speed_sigma_m_per_s");
    assert_eq!(field(|c| c.max_peak_count = 0), "paper.max_peak_count");
    assert_eq!(field(|c| c.bin_count = 65), "paper.bin_count");
    assert_eq!(field(|c| c.max_iteration_count = 0), "paper.max_iteration_count");
    assert_eq!(field(|c| c.window_count = 0), "paper.window_count");
    assert_eq!(field(|c| c.window_count = 65), "paper.window_count");
    assert_eq!(field(|c| c.confirm_count = 20), "paper.confirm_count");
    assert_eq!(field(|c| c.end_count = 0), "paper.end_count");
    assert_eq!(field(|c| c.max_track_count = 0), "paper.max_track_count");
    assert_eq!(field(|c| c.velocity_count = 32), "paper.velocity_count");
    let text = toml::to_string(&PaperConfig::default()).unwrap();
    assert_eq!(toml::from_str::<PaperConfig>(&text).unwrap(), PaperConfig::default());
    assert!(toml::from_str::<PaperConfig>("bins = 16").is_err());
}

#[test]
fn places_are_those_of_the_grid() {
    let mut tracker = tracker();
    let amplitude = hills(&[[1.2, 4.0]]);
    let track = &tracker.track(&frame(0, &amplitude)).unwrap()[0];
    let place_m = Vector2::new(track.state.x, track.state.y);
    assert!((place_m - Vector2::new(1.2, 4.0)).norm() < HALF_PIXEL_M, "{place_m}");
    let [xx, _, yy] = track.extent_m2;
    // T_s = 0.03 A summed over a line lies at two to three widths of the hill.
    assert!((0.3..0.8).contains(&(2.0 * xx.sqrt())), "{xx}");
    assert!(yy < xx);
}
