//! How the points that meet under a mode lie: at one place, along one line, over an area, or on
//! one straight walk.

use nalgebra::{Matrix2, Vector2};
use proto::geom::principal_axes;

use super::Layout;
use super::likelihood::for_each_period;
use super::modes::Mode;
use super::prepared::Prepared;

/// Length over standard deviation by which places, lines and areas are told apart: a uniform line has
/// 3.5, a normal one covers 4.
const LENGTH_SIGMAS: f64 = 4.0;

/// Part of the points that may lie beyond either end of the extent that is shown: chance matches and
/// outliers do not count as covered.
const TAIL_SHARE: f64 = 0.025;

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
    let (major, minor, angle_rad) = principal_axes(&(scatter.sum::<Matrix2<f64>>() / total));
    let (spread_m, across_m) = (LENGTH_SIGMAS * major, LENGTH_SIGMAS * minor);
    let along = Vector2::new(angle_rad.cos(), angle_rad.sin());
    let length_m = extent_m(&points, &along);
    let width_m = extent_m(&points, &Vector2::new(-along.y, along.x));
    if spread_m < place_m {
        Layout::Place { length_m }
    } else if minor < NOISE_SIGMAS * data.typical_sigma_m || across_m * LINE_RATIO < spread_m {
        Layout::Line { length_m, width_m }
    } else {
        Layout::Area { length_m, width_m }
    }
}

/// Extent of weighted points along `direction`, metres: from where the lower tail ends to where the
/// upper one begins.
fn extent_m(points: &[(f64, Vector2<f64>)], direction: &Vector2<f64>) -> f64 {
    let total: f64 = points.iter().map(|(weight, _)| weight).sum();
    let mut along: Vec<(f64, f64)> =
        points.iter().map(|(weight, at)| (at.dot(direction), *weight)).collect();
    along.sort_by(|a, b| a.0.total_cmp(&b.0));
    let end = |weight: &mut f64, (at, own): &(f64, f64)| {
        *weight += own;
        Some((*weight > TAIL_SHARE * total).then_some(*at))
    };
    let lower = along.iter().scan(0.0, end).flatten().next();
    let upper = along.iter().rev().scan(0.0, end).flatten().next();
    lower.zip(upper).map_or(0.0, |(from, to)| (to - from).max(0.0))
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
    let spread_m = LENGTH_SIGMAS * velocity.norm() * (duration / count).sqrt();
    let is_walk = residual_m2 < (NOISE_SIGMAS * data.typical_sigma_m).powi(2);
    let (first, last) = points.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |range, (t, _)| {
        (range.0.min(*t), range.1.max(*t))
    });
    (is_walk && spread_m > LENGTH_SIGMAS * NOISE_SIGMAS * data.typical_sigma_m)
        .then(|| velocity.norm() * (last - first))
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
        assert!((length_m - 5.0).abs() < 0.1, "{length_m}");
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
    fn an_extent_is_that_of_nearly_all_points() {
        let at = |x: f64| Vector2::new(x, 2.0 * x);
        let points: Vec<(f64, Vector2<f64>)> =
            (0..=100).map(|k| (0.5, at(0.1 * f64::from(k)))).collect();
        // A hundred and one points from 0 to 10 m: two lie beyond either end.
        assert!((extent_m(&points, &Vector2::x()) - 9.6).abs() < 1e-9);
        assert!((extent_m(&points, &Vector2::y()) - 19.2).abs() < 1e-9);
        let mut outlying = points.clone();
        outlying.push((0.5, at(500.0)));
        outlying.push((1e-6, at(-500.0)));
        assert!((extent_m(&outlying, &Vector2::x()) - 9.7).abs() < 1e-9);
        assert!(extent_m(&[], &Vector2::x()).abs() < 1e-12);
    }

    #[test]
    fn places_lines_and_areas_are_told_apart() {
        let line = layout(&line_paths(&[[[2.0, 3.0], [6.0, 6.0]]], 9));
        let Layout::Line { length_m, width_m } = line else { panic!("{line:?}") };
        // Nine points over 5 m.
        assert!((length_m - 5.0).abs() < 0.1 && width_m < 0.15, "{line:?}");
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
