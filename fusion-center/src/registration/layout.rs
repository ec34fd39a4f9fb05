//! How the points that meet under a mode lie: at one place, along one line, over an area, or on
//! one straight walk.

use nalgebra::{Matrix2, Vector2};
use proto::geom::principal_axes;

use super::Layout;
use super::likelihood::for_each_period;
use super::modes::Mode;
use super::prepared::Prepared;

/// Length over standard deviation that is shown: a uniform line has 3.5, a normal one covers 4.
const LENGTH_SIGMAS: f64 = 4.0;

/// Points narrower than this many typical standard deviations lie on a line: what is across it
/// may be noise alone. A line all the same is what is this much longer than wide.
const NOISE_SIGMAS: f64 = 2.0;
const LINE_RATIO: f64 = 10.0;

/// The layout of the reference's points, weighted by the chance that they meet one of the node's.
/// Extents below `place_m` are one place.
pub(super) fn layout_of(data: &Prepared, mode: &Mode, place_m: f64) -> Layout {
    let mut points: Vec<(f64, Vector2<f64>)> = Vec::new();
    for_each_period(&mode.model(data), &mode.motion, |period, _| {
        points.extend(period.links.iter().map(|link| {
            let point = &data.refs[link.ref_index];
            (link.weight, Vector2::new(point.x, point.y))
        }));
    });
    let total: f64 = points.iter().map(|(weight, _)| weight).sum();
    let total = total.max(f64::MIN_POSITIVE);
    let mean = points.iter().map(|(w, at)| at * *w).sum::<Vector2<f64>>() / total;
    let scatter = points.iter().map(|(w, at)| (at - mean) * (at - mean).transpose() * *w);
    let (major, minor, _) = principal_axes(&(scatter.sum::<Matrix2<f64>>() / total));
    let (length_m, width_m) = (LENGTH_SIGMAS * major, LENGTH_SIGMAS * minor);
    if length_m < place_m {
        Layout::Place { length_m }
    } else if minor < NOISE_SIGMAS * data.typical_sigma_m || width_m * LINE_RATIO < length_m {
        Layout::Line { length_m, width_m }
    } else {
        Layout::Area { length_m, width_m }
    }
}

/// The length of the one straight walk at constant speed on which all points lie that more likely
/// than not meet: the residuals of the least-squares line `x(t) = x̄ + v (t − t̄)` through them are
/// noise. `None` where they do not, or stay at their place.
///
/// Assumes periods of equal length, as the runs do.
pub(super) fn one_walk_m(data: &Prepared, mode: &Mode) -> Option<f64> {
    let mut points: Vec<(f64, Vector2<f64>)> = Vec::new();
    for_each_period(&mode.model(data), &mode.motion, |period, span| {
        let likely = period.links.iter().filter(|link| link.weight > 0.5);
        points.extend(likely.map(|link| {
            let point = &data.refs[link.ref_index];
            (span.period_index as f64, Vector2::new(point.x, point.y))
        }));
    });
    let count = points.len() as f64;
    let mean_t = points.iter().map(|(t, _)| t).sum::<f64>() / count;
    let mean = points.iter().map(|(_, at)| at).sum::<Vector2<f64>>() / count;
    let duration = points.iter().map(|(t, _)| (t - mean_t).powi(2)).sum::<f64>();
    let velocity = points.iter().map(|(t, at)| (at - mean) * (t - mean_t)).sum::<Vector2<f64>>()
        / duration.max(f64::MIN_POSITIVE);
    let square_m2 =
        points.iter().map(|(t, at)| (at - mean - velocity * (t - mean_t)).norm_squared());
    // Two axes, less the four numbers of the line.
    let residual_m2 = square_m2.sum::<f64>() / (2.0 * count - 4.0).max(1.0);
    let length_m = LENGTH_SIGMAS * velocity.norm() * (duration / count).sqrt();
    let is_walk = residual_m2 < (NOISE_SIGMAS * data.typical_sigma_m).powi(2);
    (is_walk && length_m > LENGTH_SIGMAS * NOISE_SIGMAS * data.typical_sigma_m).then_some(length_m)
}

#[cfg(test)]
mod tests {
    use super::super::modes::refine;
    use super::super::prepared::Motion;
    use super::*;
    use crate::simulate::{Conditions, Paths, Sampler, line_paths};

    fn layout(paths: &Paths) -> Layout {
        let case = Sampler::new(2).observe(paths, &Conditions::CLEAN);
        let (data, truth) = (Prepared::new(&case.problem), case.truth());
        let mode = refine(&data, Motion::new(truth.x, truth.y, truth.z)).unwrap();
        layout_of(&data, &mode, 0.5)
    }

    fn walk(paths: &Paths) -> Option<f64> {
        let case = Sampler::new(2).observe(paths, &Conditions::CLEAN);
        let (data, truth) = (Prepared::new(&case.problem), case.truth());
        one_walk_m(&data, &refine(&data, Motion::new(truth.x, truth.y, truth.z)).unwrap())
    }

    #[test]
    fn one_straight_walk_is_told_from_two_from_a_turn_and_from_a_change_of_speed() {
        let one = line_paths(&[[[2.0, 3.0], [6.0, 6.0]]], 9);
        let length_m = walk(&one).unwrap();
        assert!((length_m - 6.455).abs() < 0.1, "{length_m}");
        let two = line_paths(&[[[2.0, 3.0], [6.0, 6.0]], [[2.5, 3.0], [6.5, 6.0]]], 9);
        let mut back = one.clone();
        back.extend(one.iter().rev().cloned());
        let mut pausing = one.clone();
        pausing.insert(4, one[4].clone());
        pausing.insert(4, one[4].clone());
        for other in [two, back, pausing] {
            assert_eq!(walk(&other), None);
        }
    }

    #[test]
    fn places_lines_and_areas_are_told_apart() {
        let line = layout(&line_paths(&[[[2.0, 3.0], [6.0, 6.0]]], 9));
        let Layout::Line { length_m, width_m } = line else { panic!("{line:?}") };
        // Nine points 0.625 m apart: σ = 0.625 √(80/12) m.
        assert!((length_m - 6.455).abs() < 0.1 && width_m < 0.15, "{line:?}");
        let area = layout(&line_paths(&[[[2.0, 3.0], [8.0, 8.0]], [[8.0, 2.0], [3.0, 7.0]]], 8));
        assert!(
            matches!(area, Layout::Area { width_m: across_m, .. } if across_m > 3.0),
            "{area:?}"
        );
        let place = layout(&vec![vec![Vector2::new(3.0, 4.0), Vector2::new(3.2, 4.1)]; 9]);
        assert!(
            matches!(place, Layout::Place { length_m: extent_m } if extent_m < 0.5),
            "{place:?}"
        );
    }
}
