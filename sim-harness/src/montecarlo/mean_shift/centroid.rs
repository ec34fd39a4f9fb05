//! The plain tracker beside which the others are seen: centroids of bright regions, nearest
//! neighbours, Kalman filters.
//!
//! Regions are the connected pixels above a share of the image's maximum and above the noise; their
//! centroid is weighted with the amplitude. Tracks move at constant velocity; who gets which region
//! is the optimal assignment. Life and death are counted as in \[mean-shift\].

use nalgebra::{Cholesky, Matrix2, Matrix2x4, Matrix4, Vector2, Vector4};
use node_agent::tracking::{Frame, FrameError, Track, TrackStatus, Tracker};
use proto::radar::Grid;

use crate::metrics::{Costs, assignment};

/// A region is brighter than this share of the maximum: that of the prototype in the specification.
const THRESHOLD_SHARE: f32 = 0.3;
/// And than so many times the noise in the mean of the channels: noise that the phase coherence factor
/// halves gets there at one pixel in 8000, and a region needs several.
const THRESHOLD_NOISE: f32 = 1.5;
/// Smallest region, pixels: a pixel of 0.05 m is far below the resolution.
const MIN_PIXEL_COUNT: usize = 4;
/// Spread of a centroid around the person, metres: between a body's half depth and half width.
const CENTROID_SIGMA_M: f64 = 0.15;
/// Density of the acceleration's noise, `m²/s³`: half a metre per second in a second.
const ACCELERATION_M2_PER_S3: f64 = 0.25;
/// Spread of a person's velocity when first seen, metres per second.
const FIRST_SPEED_M_PER_S: f64 = 1.0;
/// Squared normalised distance that 99.9 % of a track's own centroids keep: chi squared of 2.
const GATE: f64 = 13.8;
/// Confirmed if seen in more than `NEEDED_COUNT` of the last `WINDOW_COUNT` frames, ended after
/// `LOST_COUNT` frames unseen \[mean-shift\].
const NEEDED_COUNT: u32 = 12;
const WINDOW_COUNT: u32 = 20;
const LOST_COUNT: u32 = 10;

/// Bits of the last [`WINDOW_COUNT`] frames.
const WINDOW: u32 = (1 << WINDOW_COUNT) - 1;

/// A bright patch.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Region {
    middle_m: Vector2<f64>,
    extent_m2: [f64; 3],
}

#[derive(Clone, Debug)]
struct Followed {
    track: Track,
    /// In which of the last frames it was seen, the newest in the lowest bit.
    seen: u32,
    is_confirmed: bool,
}

/// The tracker.
#[derive(Clone, Debug, Default)]
pub(super) struct CentroidTracker {
    followed: Vec<Followed>,
    reported: Vec<Track>,
    next_id: u64,
    last_s: Option<f64>,
}

impl Tracker for CentroidTracker {
    fn track(&mut self, frame: &Frame<'_>) -> Result<&[Track], FrameError> {
        check(frame, self.last_s)?;
        let step_s = self.last_s.map_or(0.0, |last_s| frame.time_s - last_s);
        self.last_s = Some(frame.time_s);
        self.followed.iter_mut().for_each(|one| predict(&mut one.track, step_s));
        let regions = regions(frame);
        let costs = Costs::new(self.followed.len(), regions.len(), |track, region| {
            apart(&self.followed[track].track, &regions[region]).min(GATE)
        });
        let mut is_free = vec![true; regions.len()];
        for (one, region) in self.followed.iter_mut().zip(assignment(&costs)) {
            let near = region.filter(|at| apart(&one.track, &regions[*at]) < GATE);
            one.seen = (one.seen << 1 | u32::from(near.is_some())) & WINDOW;
            if let Some(at) = near {
                is_free[at] = false;
                update(&mut one.track, &regions[at], frame.time_s);
            }
        }
        self.live_and_die();
        for (region, _) in regions.iter().zip(&is_free).filter(|(_, is_free)| **is_free) {
            self.followed.push(begin(self.next_id, region, frame.time_s));
            self.next_id += 1;
        }
        self.reported.clear();
        self.reported.extend(self.followed.iter().map(|one| one.track.clone()));
        Ok(&self.reported)
    }
}

impl CentroidTracker {
    fn live_and_die(&mut self) {
        let lately: u32 = (1 << LOST_COUNT) - 1;
        self.followed.retain(|one| one.seen & lately != 0);
        for one in &mut self.followed {
            one.is_confirmed |= NEEDED_COUNT < one.seen.count_ones();
            one.track.status = match (one.is_confirmed, one.seen & 1) {
                (false, _) => TrackStatus::Tentative,
                (true, 0) => TrackStatus::Coasting,
                (true, _) => TrackStatus::Confirmed,
            };
        }
    }
}

fn check(frame: &Frame<'_>, last_s: Option<f64>) -> Result<(), FrameError> {
    let Frame { time_s, grid, amplitude, noise_amplitude, .. } = *frame;
    let (got, want) = (amplitude.len(), grid.pixel_count());
    if got != want {
        return Err(FrameError::PixelCount { time_s, got, want });
    }
    let is_good = |value: &f32| value.is_finite() && 0.0 <= *value;
    let bad = [
        ("time", !time_s.is_finite()),
        ("noise", !is_good(&noise_amplitude)),
        ("a pixel", !amplitude.iter().all(is_good)),
    ];
    if let Some((what, _)) = bad.into_iter().find(|(_, is_bad)| *is_bad) {
        return Err(FrameError::NotFinite { time_s, what });
    }
    match last_s {
        Some(previous_s) if time_s <= previous_s => {
            Err(FrameError::TimeNotAscending { time_s, previous_s })
        }
        _ => Ok(()),
    }
}

/// All regions of the image.
fn regions(frame: &Frame<'_>) -> Vec<Region> {
    let Frame { grid, amplitude, noise_amplitude, .. } = frame;
    let maximum = amplitude.iter().copied().fold(0.0, f32::max);
    let threshold = (THRESHOLD_SHARE * maximum).max(THRESHOLD_NOISE * noise_amplitude);
    let mut is_open: Vec<bool> = amplitude.iter().map(|value| threshold < *value).collect();
    let mut found = Vec::new();
    for start in 0..is_open.len() {
        if !is_open[start] {
            continue;
        }
        let pixels = fill(&mut is_open, start, grid.column_count);
        if MIN_PIXEL_COUNT <= pixels.len() {
            found.push(moments(&pixels, amplitude, grid));
        }
    }
    found
}

/// The open pixels that hang together with `start` over edges, which are then closed.
fn fill(is_open: &mut [bool], start: usize, column_count: usize) -> Vec<usize> {
    let mut pixels = Vec::new();
    let mut next = vec![start];
    while let Some(pixel) = next.pop() {
        if !std::mem::take(&mut is_open[pixel]) {
            continue;
        }
        pixels.push(pixel);
        let column = pixel % column_count;
        let around = [
            (0 < column).then(|| pixel - 1),
            (column + 1 < column_count).then_some(pixel + 1),
            pixel.checked_sub(column_count),
            Some(pixel + column_count).filter(|below| *below < is_open.len()),
        ];
        next.extend(around.into_iter().flatten());
    }
    pixels
}

/// `m = Σ a x / Σ a` and `Σ a (x − m)(x − m)ᵀ / Σ a`.
fn moments(pixels: &[usize], amplitude: &[f32], grid: &Grid) -> Region {
    let places = || {
        pixels.iter().map(|pixel| {
            let (column, row) = (pixel % grid.column_count, pixel / grid.column_count);
            (f64::from(amplitude[*pixel]), Vector2::new(grid.x_m(column), grid.y_m(row)))
        })
    };
    let total: f64 = places().map(|(weight, _)| weight).sum();
    let middle_m = places().map(|(weight, at_m)| at_m * weight).sum::<Vector2<f64>>() / total;
    let spread = |(weight, at_m): (f64, Vector2<f64>)| {
        let off_m = at_m - middle_m;
        off_m * off_m.transpose() * weight
    };
    let second_m2 = places().map(spread).sum::<Matrix2<f64>>() / total;
    let extent_m2 = [second_m2[(0, 0)], second_m2[(0, 1)], second_m2[(1, 1)]];
    Region { middle_m, extent_m2 }
}

fn begin(id: u64, region: &Region, time_s: f64) -> Followed {
    let [x_m, y_m] = region.middle_m.into();
    let (place, speed) = (CENTROID_SIGMA_M.powi(2), FIRST_SPEED_M_PER_S.powi(2));
    let track = Track {
        id,
        status: TrackStatus::Tentative,
        state: Vector4::new(x_m, y_m, 0.0, 0.0),
        covariance: Matrix4::from_diagonal(&Vector4::new(place, place, speed, speed)),
        extent_m2: region.extent_m2,
        appearance: 1.0,
        seen_s: time_s,
    };
    Followed { track, seen: 1, is_confirmed: false }
}

/// `x ← F x`, `P ← F P Fᵀ + Q` with `F = [1 dt; 0 1]`, `Q = q [dt³/3 dt²/2; dt²/2 dt]` for each axis.
fn predict(track: &mut Track, step_s: f64) {
    let mut step = Matrix4::identity();
    let mut noise = Matrix4::zeros();
    for axis in [0, 1] {
        step[(axis, axis + 2)] = step_s;
        noise[(axis, axis)] = step_s.powi(3) / 3.0;
        noise[(axis, axis + 2)] = step_s.powi(2) / 2.0;
        noise[(axis + 2, axis)] = step_s.powi(2) / 2.0;
        noise[(axis + 2, axis + 2)] = step_s;
    }
    track.state = step * track.state;
    track.covariance = step * track.covariance * step.transpose() + noise * ACCELERATION_M2_PER_S3;
}

/// What is off and its covariance `S = H P Hᵀ + R`, and `H`.
fn innovation(track: &Track, region: &Region) -> (Vector2<f64>, Matrix2<f64>, Matrix2x4<f64>) {
    let place = Matrix2x4::identity();
    let off_m = region.middle_m - place * track.state;
    let spread_m2 = Matrix2::identity() * CENTROID_SIGMA_M.powi(2);
    (off_m, place * track.covariance * place.transpose() + spread_m2, place)
}

/// Squared normalised distance of a region to where the track should be.
fn apart(track: &Track, region: &Region) -> f64 {
    let (off_m, spread_m2, _) = innovation(track, region);
    let factor = Cholesky::new(spread_m2);
    factor.map_or(f64::MAX, |factor| off_m.dot(&factor.solve(&off_m)))
}

/// `K = P Hᵀ S⁻¹`, `x ← x + K e`, `P ← (1 − K H) P (1 − K H)ᵀ + K R Kᵀ`.
fn update(track: &mut Track, region: &Region, time_s: f64) {
    let (off_m, spread_m2, place) = innovation(track, region);
    let Some(factor) = Cholesky::new(spread_m2) else { return };
    let gain = (factor.solve(&(place * track.covariance))).transpose();
    track.state += gain * off_m;
    let kept = Matrix4::identity() - gain * place;
    let added = gain * gain.transpose() * CENTROID_SIGMA_M.powi(2);
    track.covariance = kept * track.covariance * kept.transpose() + added;
    track.extent_m2 = region.extent_m2;
    track.seen_s = time_s;
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Kalman updates of a few numbers of metres.
    const SAME: f64 = 1e-9;
    const GRID: Grid =
        Grid { x_min_m: -1.0, y_min_m: 1.0, pixel_m: 0.1, column_count: 30, row_count: 40 };

    /// A square of 3 by 3 pixels around each place, the middle row brighter.
    fn image(middles: &[(usize, usize)]) -> Vec<f32> {
        let mut amplitude = vec![0.0; GRID.pixel_count()];
        for (column, row) in middles {
            for (line, value) in [(row - 1, 1.0), (*row, 2.0), (row + 1, 1.0)] {
                let first = line * GRID.column_count + column - 1;
                amplitude[first..first + 3].fill(value);
            }
        }
        amplitude
    }

    fn frame(time_s: f64, amplitude: &[f32]) -> Frame<'_> {
        Frame { time_s, grid: GRID, amplitude, noise_amplitude: 0.01, points: &[] }
    }

    #[test]
    fn regions_have_their_moments() {
        let mut amplitude = image(&[(5, 5), (20, 30)]);
        amplitude[0] = 2.0;
        let found = regions(&frame(0.0, &amplitude));
        assert_eq!(found.len(), 2, "one pixel is no region");
        assert!((found[0].middle_m - Vector2::new(-0.5, 1.5)).norm() < SAME);
        assert!((found[1].middle_m - Vector2::new(1.0, 4.0)).norm() < SAME);
        // Two columns of three 0.1 m off; six of twelve parts of the weight 0.1 m off in rows.
        let [xx, xy, yy] = found[0].extent_m2;
        assert!((xx - 0.02 / 3.0).abs() < SAME && xy.abs() < SAME && (yy - 0.005).abs() < SAME);
    }

    #[test]
    fn people_are_confirmed_followed_and_lost_as_counted() {
        let mut tracker = CentroidTracker::default();
        for step in 0..45_usize {
            // Two people walk towards each other, 1 m/s, and pass; the first leaves at frame 25.
            let (first, second) = ((5, 5 + step / 2), (20, 35 - step / 2));
            let amplitude = if step < 25 { image(&[first, second]) } else { image(&[second]) };
            let tracks = tracker.track(&frame(0.1 * step as f64, &amplitude)).unwrap();
            let of = |id: u64| tracks.iter().find(|track| track.id == id);
            match step {
                0..12 => assert_eq!(of(0).unwrap().status, TrackStatus::Tentative, "{step}"),
                12..25 => assert_eq!(of(1).unwrap().status, TrackStatus::Confirmed, "{step}"),
                25..34 => assert_eq!(of(0).unwrap().status, TrackStatus::Coasting, "{step}"),
                _ => assert_eq!(of(0), None, "{step}"),
            }
            assert!(tracks.len() <= 2);
        }
        let last = &tracker.reported[0];
        assert!((last.state[0] - 1.0).abs() < 0.01 && (last.state[3] + 0.5).abs() < 0.1);
    }

    #[test]
    fn the_filter_is_the_weighted_mean_of_what_was_seen() {
        let at = |x_m: f64| Region { middle_m: Vector2::new(x_m, 0.0), extent_m2: [0.0; 3] };
        let mut one = begin(0, &at(0.0), 0.0);
        // After 1 s P_xx = 0.0225 + 1 + 0.25/3: gain P / (P + 0.0225).
        predict(&mut one.track, 1.0);
        let spread = 0.0225 + 1.0 + 0.25 / 3.0;
        assert!((one.track.covariance[(0, 0)] - spread).abs() < SAME);
        let gain = spread / (spread + 0.0225);
        assert!((apart(&one.track, &at(0.3)) - 0.09 / (spread + 0.0225)).abs() < SAME);
        update(&mut one.track, &at(0.3), 1.0);
        assert!((one.track.state[0] - 0.3 * gain).abs() < SAME);
        assert!((one.track.covariance[(0, 0)] - (1.0 - gain) * spread).abs() < SAME);
        let speed_gain = (1.0 + 0.125) / (spread + 0.0225);
        assert!((one.track.state[2] - 0.3 * speed_gain).abs() < SAME);
    }

    #[test]
    fn senseless_frames_are_refused() {
        let amplitude = image(&[(5, 5)]);
        let mut tracker = CentroidTracker::default();
        assert_eq!(tracker.track(&frame(1.0, &amplitude)).unwrap().len(), 1);
        let again = tracker.track(&frame(1.0, &amplitude)).unwrap_err();
        assert_eq!(again, FrameError::TimeNotAscending { time_s: 1.0, previous_s: 1.0 });
        let few = tracker.track(&frame(2.0, &amplitude[1..])).unwrap_err();
        assert_eq!(few, FrameError::PixelCount { time_s: 2.0, got: 1199, want: 1200 });
        let mut spoilt = amplitude.clone();
        spoilt[7] = f32::NAN;
        let broken = tracker.track(&frame(2.0, &spoilt)).unwrap_err();
        assert_eq!(broken, FrameError::NotFinite { time_s: 2.0, what: "a pixel" });
        let empty = vec![0.0; GRID.pixel_count()];
        assert_eq!(tracker.track(&frame(2.0, &empty)).unwrap().len(), 1, "one coasts");
    }
}
