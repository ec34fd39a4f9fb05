//! Peaks that are no targets: sidelobes of stronger ones, echoes inside the wall, second peaks of
//! one body.
//!
//! A peak of power `P` at `x` stays if `sqrt(P) > sqrt(m) Σ_i sqrt(P_i) ℓ(x_i, x) + 2 sqrt(N σ²)` over
//! all stronger peaks that stayed, `ℓ` being the share of a point's amplitude that shows elsewhere
//! ([`PointModel::leakage`]), `m` the margin and `N σ²` the noise power of a pixel: a target 30 dB below another and in none of its
//! blobs is seen beside the −35 dB sidelobes of a Taylor window with 4 dB of margin.
//! A body throws sidelobes from its nearest part: two parts out of phase leave a second peak 0.4 m
//! before or behind the first, at the edge of the main lobe.
//! A wave that is reflected twice inside the wall on one of its ways shows behind its target, at the
//! same angle, by `d sqrt(ε − u²)` (once more for every further time), 26 to 31 dB weaker through brick.

use super::config::Ghosts;
use super::moments::{Polar, to_cartesian};
use super::response::PointModel;
use super::threshold::Peak;
use crate::imaging::from_db;

/// An echo inside the wall lies within these of where it should be, metres and sine: a good half
/// of a resolution cell, for the permittivity is known to ±1 only.
const ECHO_GATE: [f64; 2] = [0.15, 0.12];
/// Noise lifts a sidelobe by this many times its root mean square: less than what any peak needs to
/// be looked at, so that it matters beside sidelobes only.
const NOISE_SIGMAS: f64 = 2.0;
/// Parts of a body lie this far before and behind its peak, in `body_m`.
const BODY_REACH: f64 = 0.27;
/// Times a wave is reflected back and forth inside the wall and still seen.
const ECHO_COUNT: usize = 2;

/// `peaks`, strongest first, without those that stronger ones explain; `noise_power` is that of a
/// pixel.
#[must_use]
pub fn without_ghosts(
    peaks: &[Peak],
    noise_power: f64,
    model: &PointModel,
    ghosts: &Ghosts,
) -> Vec<Peak> {
    let Ghosts::Drop { sidelobe_margin_db, wall_echo_db, body_m } = *ghosts else {
        return peaks.to_vec();
    };
    let margin = from_db(sidelobe_margin_db).sqrt();
    let noise = NOISE_SIGMAS * noise_power.sqrt();
    let echo_ratio = from_db(wall_echo_db);
    let mut kept: Vec<Peak> = Vec::new();
    for peak in peaks {
        let is_ghost = kept.iter().any(|strong| {
            is_same_body(strong, peak, body_m) || is_wall_echo(strong, peak, model, echo_ratio)
        });
        let explained = margin * sidelobe_amplitude(&kept, peak, model, body_m) + noise;
        if !is_ghost && explained < f64::from(peak.power).sqrt() {
            kept.push(*peak);
        }
    }
    kept
}

/// What the sidelobes of all `strong` peaks reach together at `peak`, each thrown by the part of the
/// body that is nearest to it in range.
fn sidelobe_amplitude(strong: &[Peak], peak: &Peak, model: &PointModel, body_m: f64) -> f64 {
    let reach_m = BODY_REACH * body_m;
    let amplitude = |s: &Peak| {
        let nearest_m = (peak.range_m - s.range_m).clamp(-reach_m, reach_m);
        let part = Polar::new(s.range_m + nearest_m, s.sine);
        let leakage = [place(s), part].map(|from| model.leakage(&from, &place(peak)));
        f64::from(s.power).sqrt() * leakage[0].max(leakage[1])
    };
    strong.iter().map(amplitude).sum()
}

fn is_same_body(strong: &Peak, peak: &Peak, body_m: f64) -> bool {
    (to_cartesian(&place(strong)) - to_cartesian(&place(peak))).norm() < body_m
}

fn is_wall_echo(strong: &Peak, peak: &Peak, model: &PointModel, echo_ratio: f64) -> bool {
    let Some(echo_m) = model.wall_echo_m(strong.sine) else { return false };
    let behind_m = peak.range_m - strong.range_m;
    let at_echo = |n: usize| (behind_m - n as f64 * echo_m).abs() < ECHO_GATE[0];
    let aside = (peak.sine - strong.sine).abs();
    let weak = f64::from(peak.power) * echo_ratio < f64::from(strong.power);
    weak && aside < ECHO_GATE[1] && (1..=ECHO_COUNT).any(at_echo)
}

fn place(peak: &Peak) -> Polar {
    Polar::new(peak.range_m, peak.sine)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imaging::wall::WallModel;
    use crate::imaging::window::Window;
    use proto::radar::{Array, Band, Wall};

    fn model(wall: &WallModel) -> PointModel {
        let band = Band::default();
        PointModel::new(&band, &Array::default(), wall, &Window::Taylor.weights(band.step_count))
    }

    fn peak(range_m: f64, sine: f64, power_db: f64) -> Peak {
        let power = crate::imaging::single(from_db(power_db));
        Peak { index: 0, power, range_m, sine }
    }

    /// How many of `peaks` stay beside a noise of 0 dB.
    fn stay(peaks: &[Peak], wall: &WallModel, body_m: f64) -> usize {
        let ghosts = Ghosts::Drop { sidelobe_margin_db: 4.0, wall_echo_db: 22.0, body_m };
        assert_eq!(without_ghosts(peaks, 1.0, &model(wall), &Ghosts::Keep).len(), peaks.len());
        without_ghosts(peaks, 1.0, &model(wall), &ghosts).len()
    }

    #[test]
    fn what_the_window_and_the_aperture_throw_elsewhere_is_dropped() {
        let strong = peak(4.0, 0.2, 60.0);
        for (range_m, sine, power_db, want) in [
            // The Taylor window promises -35 dB.
            (4.6, 0.2, 25.0, 1),
            (5.5, 0.2, 29.0, 2),
            (5.5, 0.2, 22.0, 1),
            // The first sidelobe of eight evenly weighted elements lies at -13 dB ...
            (4.0, 0.2 + 0.38, 46.5, 1),
            // ... and between the lobes there is room.
            (4.0, 0.2 + 0.38, 55.0, 2),
            (9.0, -0.5, 5.0, 1),
            (9.0, -0.5, 25.0, 2),
        ] {
            let got = stay(&[strong, peak(range_m, sine, power_db)], &WallModel::None, 0.0);
            assert_eq!(got, want, "{range_m} m, sine {sine}, {power_db} dB");
        }
    }

    #[test]
    fn an_echo_inside_the_wall_is_dropped_if_there_is_a_wall() {
        let wall = WallModel::Refraction(Wall { thickness_m: 0.24, permittivity: 5.0 });
        // 0.24 m sqrt(5 - 0.04) behind.
        let pair = |behind_m: f64, power_db: f64| {
            [peak(4.0, 0.2, 60.0), peak(4.0 + behind_m, 0.2, power_db)]
        };
        assert_eq!(stay(&pair(0.5345, 34.0), &wall, 0.0), 1);
        assert_eq!(stay(&pair(0.5345, 34.0), &WallModel::None, 0.0), 2);
        assert_eq!(stay(&pair(0.5345, 40.0), &wall, 0.0), 2);
        assert_eq!(stay(&pair(0.8, 34.0), &wall, 0.0), 2);
        assert_eq!(stay(&pair(-0.5345, 34.0), &wall, 0.0), 2);
        assert_eq!(stay(&pair(2.0 * 0.5345, 34.0), &wall, 0.0), 1);
    }

    #[test]
    fn the_depth_of_a_body_counts_for_its_sidelobes() {
        // Beyond what counts as the same body, at the edge of the main lobe of its front and back.
        let pair = |behind_m: f64, power_db: f64| {
            [peak(4.0, 0.2, 60.0), peak(4.0 + behind_m, 0.2, power_db)]
        };
        for behind_m in [-0.42, 0.42] {
            assert_eq!(stay(&pair(behind_m, 48.0), &WallModel::None, 0.0), 2, "{behind_m}");
            assert_eq!(stay(&pair(behind_m, 48.0), &WallModel::None, 0.41), 1, "{behind_m}");
        }
        assert_eq!(stay(&pair(1.0, 35.0), &WallModel::None, 0.55), 2);
    }

    #[test]
    fn a_body_has_one_peak() {
        let pair = [peak(3.0, 0.0, 40.0), peak(3.5, 0.05, 39.0)];
        assert_eq!(stay(&pair, &WallModel::None, 0.55), 1);
        assert_eq!(stay(&pair, &WallModel::None, 0.45), 2);
    }
}
